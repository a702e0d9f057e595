//! Edges, stages 1 and 8: finds which surface each point of a pixel shows, and averages over all points. METHOD 13.
//!
//! The scene is drawn again for a few more points of every pixel. If such a point shows another surface than the
//! pixel's centre, that surface becomes the pixel's second one. Every shading pass treats the second surfaces as a
//! separate picture. Third surfaces are looked up in the neighbouring pixels. The fast kind draws all points at once,
//! into a multisampled image, and looks up every other surface in the neighbouring pixels.

use super::gbuffer::{GBuffer, Surface};
use super::interpolate::Radiance;
use super::plan::Plan;
use super::samples::Samples;
use super::settings::Antialiasing;
use super::view::View;
use super::visible::VisibleList;
use super::world::World;
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Device, Extent, Format, Image, ImageDesc, Pipeline, Raster,
    Shape, Use,
};
use crate::shared::{EdgesPush, SHOWS_ANOTHER, SHOWS_AROUND, SHOWS_FIRST, SHOWS_SECOND};

/// The surface at a point of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// The first surface of the pixel this many columns and rows away, at most 1.
    First([isize; 2]),
    /// The second surface of the pixel.
    Second,
}

/// What the points of a picture's pixels show, and its light.
pub struct Edges {
    /// Kind and number of points per pixel.
    pub antialiasing: Antialiasing,
    /// Codes of the surface at each point of a pixel.
    pub codes: Image,
    /// Direct light of the first surfaces, before the points are averaged.
    pub before: Image,
    /// Indirect light of the first surfaces, before the points are averaged.
    pub indirect_before: Option<Radiance>,
    /// The second surfaces; none with the fast kind.
    pub second: Option<Second>,
    samples: Option<Samples>,
    keep: Pipeline,
    mix: Pipeline,
}

/// Second surfaces of a picture's pixels, and their light.
pub struct Second {
    /// G-buffer of one more point of every pixel.
    sample: Surface,
    /// The second surfaces.
    pub surface: Surface,
    /// Stage 5; only where caches are interpolated.
    pub visible: Option<VisibleList>,
    /// Stage 8; only with indirect light.
    pub indirect: Option<Radiance>,
    take: Pipeline,
}

/// Format of radiance images.
const RADIANCE: Format = Format::R32G32B32A32_SFLOAT;

impl Edges {
    /// Creates the resources that a plan needs.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub(super) fn new(gpu: &Device, world: &World, plan: &Plan, size: [u32; 2]) -> Result<Option<Self>> {
        if plan.antialiasing.points() == 0 {
            return Ok(None);
        }
        let over = |fragment, constants| {
            gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some(fragment),
                shape: Shape::Triangles,
                streams: &[],
                colors: &[RADIANCE],
                blend: Blend::Replace,
                depth: Depth::None,
                cull: Cull::None,
                multisampled: false,
                constants,
            })
        };
        Ok(Some(Self {
            antialiasing: plan.antialiasing,
            codes: gpu.image(&ImageDesc {
                name: "edges.codes",
                format: Format::R32_UINT,
                size,
                extent: Extent::Plane,
                storage: true,
            })?,
            before: gpu.target("edges.before", RADIANCE, size[0], size[1])?,
            indirect_before: plan.indirect().then(|| Radiance::new(gpu, plan, size)).transpose()?,
            second: (plan.antialiasing.shaded_points() > 0).then(|| Second::new(gpu, world, plan, size)).transpose()?,
            samples: (plan.antialiasing == Antialiasing::Fast)
                .then(|| Samples::new(gpu, world, plan, size))
                .transpose()?,
            keep: over("edges_keep.frag", &[])?,
            mix: over("edges_mix.frag", &[plan.antialiasing.points()])?,
        }))
    }

    /// Decodes a texel of `codes`: the surfaces at all points of a pixel that count, the centre first.
    pub fn shown(antialiasing: Antialiasing, codes: u32) -> impl Iterator<Item = Shown> {
        let further = (0..antialiasing.points()).filter_map(move |point| match codes >> (4 * point) & 15 {
            SHOWS_FIRST => Some(Shown::First([0, 0])),
            SHOWS_SECOND => Some(Shown::Second),
            SHOWS_ANOTHER => None,
            around => {
                let number = (around - SHOWS_AROUND) as isize;
                let at = if number < 4 { number } else { number + 1 };
                Some(Shown::First([at % 3 - 1, at / 3 - 1]))
            }
        });
        std::iter::once(Shown::First([0, 0])).chain(further)
    }

    /// Finds what the points of a view's pixels show, after their first surfaces.
    pub(super) fn record(&self, cmd: &Cmd<'_>, world: &World, view: &View, (gbuffer, first): (&GBuffer, &Surface)) {
        if let Some(second) = &self.second {
            second.record(cmd, (world, view), (gbuffer, first), (&self.codes, self.antialiasing));
        }
        if let Some(samples) = &self.samples {
            samples.record(cmd, world, view, first, &self.codes);
        }
        // Without second surfaces no pass has waited for the first ones, which the mix reads.
        let written = if self.second.is_some() { Use::ComputeWrite } else { Use::ComputeWrite | Use::ColorWrite };
        cmd.barrier(written, Use::FragmentRead | Use::ColorWrite | Use::ComputeRead); // for all shading
    }

    /// Replaces the light of pixels, direct or indirect, by the mean over their points. Call it after all surfaces are
    /// shaded.
    pub(super) fn record_mix(&self, cmd: &Cmd<'_>, first: (&Surface, Option<&Radiance>), which: (bool, bool)) {
        let (direct, indirect) = which;
        // Without second surfaces no point shows them; the first ones take their binding.
        let second = self.second.as_ref();
        let second_direct = second.map_or(&self.before, |second| &second.surface.radiance);
        let of_direct = direct.then_some([&first.0.radiance, &self.before, second_direct]);
        let all = first.1.zip(self.indirect_before.as_ref()).filter(|_| indirect);
        let all = all.map(|(to, before)| (to, before, second.and_then(|s| s.indirect.as_ref()).unwrap_or(before)));
        let diffuse = all.map(|(to, before, second)| [&to.diffuse, &before.diffuse, &second.diffuse]);
        let glossy = all.and_then(|(to, before, second)| {
            Some([to.glossy.as_ref()?, before.glossy.as_ref()?, second.glossy.as_ref()?])
        });
        let layers = || [of_direct, diffuse, glossy].into_iter().flatten();
        let over = |to, pipeline, resources: &[Bind<'_>]| {
            let into = Attachments { colors: &[Attach::keep(to)], depth: None, area: first.0.area() };
            cmd.render(&into, |draw| {
                draw.bind(pipeline, resources);
                draw.draw(3);
            });
        };
        for [to, before, _] in layers() {
            over(before, &self.keep, &[to.into()]);
        }
        cmd.barrier(Use::ColorWrite | Use::FragmentRead, Use::FragmentRead | Use::ColorWrite);
        for [to, before, second] in layers() {
            over(to, &self.mix, &[before, second, &self.codes].map(Bind::from));
        }
    }
}

impl Second {
    /// As `Edges::new`.
    fn new(gpu: &Device, world: &World, plan: &Plan, size: [u32; 2]) -> Result<Self> {
        let take = match (plan.elements(), plan.coated) {
            (false, false) => "edges.comp",
            (true, false) => "edges_elements.comp",
            (false, true) => "edges_coat.comp",
            (true, true) => "edges_elements_coat.comp",
        };
        Ok(Self {
            sample: Surface::unlit(gpu, plan, size)?,
            surface: Surface::written(gpu, plan, size)?,
            visible: plan.lightskin.then(|| VisibleList::new(gpu, world, plan, size)).transpose()?,
            indirect: plan.indirect().then(|| Radiance::new(gpu, plan, size)).transpose()?,
            take: gpu.compute(take, &[])?,
        })
    }

    /// Finds the second surfaces of a view, after its first ones.
    fn record(
        &self,
        cmd: &Cmd<'_>,
        (world, view): (&World, &View),
        (gbuffer, first): (&GBuffer, &Surface),
        (codes, antialiasing): (&Image, Antialiasing),
    ) {
        let Self { sample, surface, .. } = self;
        let mut resources: Vec<Bind<'_>> =
            [&first.depth, &first.albedo, &first.specular, &first.radiance].map(Bind::from).to_vec();
        for of in [sample, surface] {
            resources.extend([&of.depth, &of.normal, &of.albedo, &of.specular, &of.radiance].map(Bind::from));
        }
        resources.push(codes.into());
        resources.push((&first.normal).into());
        resources.extend([first, sample, surface].into_iter().filter_map(|of| of.element.as_ref()).map(Bind::from));
        resources.extend([sample, surface].into_iter().filter_map(|of| of.coat.as_ref()).map(Bind::from));
        for (i, offset) in antialiasing.offsets().enumerate() {
            if i > 0 {
                cmd.barrier(Use::ComputeRead, Use::ColorWrite | Use::DepthWrite); // the last sample has been processed
            }
            gbuffer.record(cmd, world, &view.moved(offset, sample.size), sample);
            let before = if i > 0 { Use::ComputeWrite } else { Use::ColorWrite };
            cmd.barrier(Use::ColorWrite | Use::DepthWrite | before, Use::ComputeRead | Use::ComputeWrite);
            cmd.bind(&self.take, &resources);
            let world_from_clip = view.world_from_clip;
            cmd.push(&EdgesPush { world_from_clip, offset, point: i as u32 });
            cmd.dispatch(sample.size[0], sample.size[1], 1);
        }
    }
}
