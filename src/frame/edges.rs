//! Edges, stages 1 and 8: a pixel's second surface, shaded like the first and mixed in by its share of the pixel. METHOD 13.
//!
//! The scene is drawn again for a few more points of every pixel. Where such a point shows another surface than the pixel's
//! middle, that becomes the pixel's second one. Every pass that shades a picture works on it as on a picture of its own.

use super::gbuffer::{GBuffer, Surface};
use super::interpolate::Radiance;
use super::plan::Plan;
use super::settings::Antialiasing;
use super::view::View;
use super::visible::VisibleList;
use super::world::World;
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Extent, Format, Gpu, Image, ImageDesc, Pipeline, Raster, Shape,
    Use,
};
use crate::shared::EdgesPush;

/// Second surfaces of a picture's pixels.
pub struct Edges {
    antialiasing: Antialiasing,
    /// What one more point of every pixel shows.
    sample: Surface,
    /// The second surfaces.
    pub surface: Surface,
    /// Points of the pixel on its first surface, and from bit 16 on of its second.
    pub counts: Image,
    /// Stage 5 of them; only where caches are interpolated.
    pub visible: Option<VisibleList>,
    /// Stage 8 of them; only with indirect light.
    pub indirect: Option<Radiance>,
    take: Pipeline,
    mix: Pipeline,
}

impl Edges {
    /// Makes what a plan needs.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub(super) fn new(gpu: &Gpu, world: &World, plan: &Plan, size: [u32; 2]) -> Result<Option<Self>> {
        if plan.antialiasing == Antialiasing::Off {
            return Ok(None);
        }
        let format = Format::R32_UINT;
        let take = match (plan.lightskin, plan.coated) {
            (false, false) => "edges.comp",
            (true, false) => "edges_elements.comp",
            (false, true) => "edges_coat.comp",
            (true, true) => "edges_elements_coat.comp",
        };
        Ok(Some(Self {
            antialiasing: plan.antialiasing,
            sample: Surface::new(gpu, plan, size)?,
            surface: Surface::written(gpu, plan, size)?,
            counts: gpu.image(&ImageDesc {
                name: "edges.counts",
                format,
                size,
                extent: Extent::Plane,
                storage: true,
            })?,
            visible: plan.lightskin.then(|| VisibleList::new(gpu, world, plan.sky_light, size)).transpose()?,
            indirect: plan.indirect().then(|| Radiance::new(gpu, plan, size)).transpose()?,
            take: gpu.compute(take, &[])?,
            mix: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some("edges_mix.frag"),
                shape: Shape::Triangles,
                streams: &[],
                colors: &[Format::R32G32B32A32_SFLOAT],
                blend: Blend::Over,
                depth: Depth::None,
                cull: Cull::None,
                constants: &[],
            })?,
        }))
    }

    /// Finds the second surfaces of a view, after its first ones.
    pub(super) fn record(&self, cmd: &Cmd<'_>, world: &World, view: &View, (gbuffer, first): (&GBuffer, &Surface)) {
        let Self { sample, surface, .. } = self;
        let mut resources: Vec<Bind<'_>> =
            vec![(&first.depth).into(), (&first.albedo).into(), (&first.specular).into()];
        for of in [sample, surface] {
            resources.extend([&of.depth, &of.normal, &of.albedo, &of.specular, &of.radiance].map(Bind::from));
        }
        resources.push((&self.counts).into());
        resources.extend([first, sample, surface].into_iter().filter_map(|of| of.element.as_ref()).map(Bind::from));
        resources.extend([sample, surface].into_iter().filter_map(|of| of.coat.as_ref()).map(Bind::from));
        for (i, offset) in self.antialiasing.offsets().enumerate() {
            if i > 0 {
                cmd.barrier(Use::ComputeRead, Use::ColorWrite | Use::DepthWrite); // the last sample has been taken in
            }
            gbuffer.record(cmd, world, &view.moved(offset, sample.size), sample);
            let before = if i > 0 { Use::ComputeWrite } else { Use::ColorWrite };
            cmd.barrier(Use::ColorWrite | Use::DepthWrite | before, Use::ComputeRead | Use::ComputeWrite);
            cmd.bind(&self.take, &resources);
            let world_from_clip = view.world_from_clip;
            cmd.push(&EdgesPush { world_from_clip, offset, begins: u32::from(i == 0) });
            cmd.dispatch(sample.size[0], sample.size[1], 1);
        }
        cmd.barrier(Use::ComputeWrite, Use::FragmentRead | Use::ColorWrite | Use::ComputeRead); // for all that shades
    }

    /// Mixes the light of second surfaces into that of the first, direct or indirect, once both are done.
    pub(super) fn record_mix(&self, cmd: &Cmd<'_>, first: (&Surface, Option<&Radiance>), which: (bool, bool)) {
        let (direct, indirect) = which;
        let of_direct = direct.then_some((&first.0.radiance, &self.surface.radiance));
        let of_indirect = first.1.zip(self.indirect.as_ref()).filter(|_| indirect);
        let glossy = of_indirect.and_then(|(to, from)| to.glossy.as_ref().zip(from.glossy.as_ref()));
        let diffuse = of_indirect.map(|(to, from)| (&to.diffuse, &from.diffuse));
        for (to, from) in [of_direct, diffuse, glossy].into_iter().flatten() {
            let into = Attachments { colors: &[Attach::keep(to)], depth: None, area: first.0.area() };
            cmd.render(&into, |draw| {
                draw.bind(&self.mix, &[from, &self.counts].map(Bind::from));
                draw.draw(3);
            });
        }
    }
}
