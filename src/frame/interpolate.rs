//! Stage 8, interpolate: computes each pixel's indirect radiance from proxies. METHOD 5, thesis listings 5.2 and 6.5.
//! At vertex level, the lights of each visible vertex's references are averaged once, and every pixel is shaded with
//! the lights of its triangle's corners. At pixel level, every pixel averages the lights of its cell's references
//! itself, whatever the triangles. Triangles are not drawn again, so the cost depends on the visible part of the scene,
//! not on its size.

use super::atlas::Atlas;
use super::gbuffer::Surface;
use super::near::{self, NearPixels};
use super::plan::Plan;
use super::proxies::Proxies;
use super::settings::{self, Near};
use super::view::View;
use super::visible::VisibleList;
use super::world::World;
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cmd, Cull, Depth, Device, Format, Image, Pipeline, Raster, Shape, Use,
};
use crate::shared::{AveragePush, InterpolatePush, NearPush, VisibleArgs};

/// Indirect radiance of a picture.
pub struct Radiance {
    /// Diffuse lobe.
    pub diffuse: Image,
    /// Glossy lobe; only where a material has one.
    pub glossy: Option<Image>,
}

impl Radiance {
    /// Makes the images.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, plan: &Plan, [w, h]: [u32; 2]) -> Result<Self> {
        let float = Format::R32G32B32A32_SFLOAT;
        Ok(Self {
            diffuse: gpu.target("interpolate.diffuse", float, w, h)?,
            glossy: plan.glossy.then(|| gpu.target("interpolate.glossy", float, w, h)).transpose()?,
        })
    }

    /// Both lobes as cleared targets.
    pub(super) fn cleared(&self) -> Vec<Attach<'_>> {
        [&self.diffuse].into_iter().chain(&self.glossy).map(Attach::clear).collect()
    }
}

/// Inputs and output of the stage for one view.
#[derive(Clone, Copy)]
pub struct Shaded<'a> {
    /// The camera.
    pub view: &'a View,
    /// Visible surfaces.
    pub surface: &'a Surface,
    /// Visible vertices or cells.
    pub visible: &'a VisibleList,
    /// Results of the short rays, if any.
    pub near: Option<&'a NearPixels>,
    /// Output.
    pub out: &'a Radiance,
    /// First proxy of the view's eye.
    pub first_proxy: u32,
}

/// Averages the lights of references and shades pixels.
pub struct Interpolate {
    /// Only at vertex level.
    average: Option<Pipeline>,
    shade: Pipeline,
}

impl Interpolate {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, plan: &Plan, world: &World, interpolation: settings::Interpolation) -> Result<Self> {
        let targets = [Format::R32G32B32A32_SFLOAT; 2];
        let printed = u32::from(interpolation == settings::Interpolation::Printed);
        // With cells, every pixel reads this many references. Otherwise the vertices have done so.
        let (of_pixels, references) = (world.references_of_pixels(), world.references_each as u32);
        let constants = [references, u32::from(plan.lobes), printed];
        let average = if plan.sky_at_vertices() { "average_sky.comp" } else { "average.comp" };
        Ok(Self {
            average: of_pixels.is_none().then(|| gpu.compute(average, &constants)).transpose()?,
            shade: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some(match (of_pixels, plan.glossy, plan.near) {
                    (None, true, Near::Off) => "interpolate.frag",
                    (None, false, Near::Off) => "interpolate_diffuse.frag",
                    (Some(_), true, Near::Off) => "interpolate_cells.frag",
                    (Some(_), false, Near::Off) => "interpolate_cells_diffuse.frag",
                    (None, true, _) => "interpolate_near.frag",
                    (None, false, _) => "interpolate_near_diffuse.frag",
                    (Some(_), true, _) => "interpolate_near_cells.frag",
                    (Some(_), false, _) => "interpolate_near_cells_diffuse.frag",
                }),
                shape: Shape::Triangles,
                streams: &[],
                colors: &targets[..if plan.glossy { 2 } else { 1 }],
                blend: Blend::Replace,
                depth: Depth::None,
                cull: Cull::None,
                multisampled: false,
                constants: &[printed, references, near::as_texels(gpu)][..if plan.near == Near::Off { 2 } else { 3 }],
            })?,
        })
    }

    /// Records the stage for views. `waits` adds a barrier for its inputs, if no earlier pass has waited for them.
    /// `near` says that there are short rays. `seen` is the sky as caches see it.
    pub fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        atlas: &Atlas,
        proxies: &Proxies,
        (waits, near, seen): (bool, bool, Option<&Buffer>),
        views: impl Iterator<Item = Shaded<'a>> + Clone,
    ) {
        if let Some(average) = &self.average {
            if waits {
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::IndirectRead); // proxies, visible vertices -> here
            }
            for Shaded { view, visible, first_proxy, .. } in views.clone() {
                let lists = [&visible.list, &world.draw_records, &world.references, &visible.args];
                let mut resources = lists.map(Bind::from).to_vec();
                resources.extend([&world.instances, &world.corners, &atlas.caches, &proxies.buffer].map(Bind::from));
                resources.push((&visible.lights).into());
                resources.extend(
                    seen.zip(visible.sky_lights.as_ref()).into_iter().flat_map(|(a, b)| [a, b].map(Bind::from)),
                );
                cmd.bind(average, &resources);
                cmd.push(&AveragePush { eye: view.eye, first_proxy });
                cmd.dispatch_indirect(&visible.args, std::mem::offset_of!(VisibleArgs, groups_x) as u64);
            }
        }

        // Lights of vertices, or proxies and the pixels' cells; G-buffer -> here.
        cmd.barrier(Use::ComputeWrite | Use::ColorWrite, Use::FragmentRead);
        for shaded in views {
            self.shade(cmd, world, atlas, proxies, near, shaded);
        }
    }

    fn shade(&self, cmd: &Cmd<'_>, world: &World, atlas: &Atlas, proxies: &Proxies, near: bool, shaded: Shaded<'_>) {
        let Shaded { view, surface, visible, near: found, out, first_proxy } = shaded;
        let Some(element) = surface.element.as_ref().map(Bind::from) else { return };
        let draws = (&world.draw_records).into();
        let [normal, albedo, specular] = [&surface.normal, &surface.albedo, &surface.specular].map(Bind::from);
        let by_vertices = [
            element,
            draws,
            world.indices().into(),
            (&visible.slots).into(),
            (&visible.lights).into(),
            normal,
            albedo,
            specular,
        ];
        let by_cells = [
            element,
            draws,
            (&world.references).into(),
            world.indices().into(),
            (&world.instances).into(),
            (&world.corners).into(),
            (&visible.slots).into(),
            (&atlas.caches).into(),
            (&proxies.buffer).into(),
            normal,
            albedo,
            specular,
        ];
        let all = if self.average.is_some() { &by_vertices[..] } else { &by_cells };
        let near = found.filter(|_| near);
        let used = all.len() - usize::from(out.glossy.is_none() && near.is_none());
        let mut resources = all[..used].to_vec();
        resources.extend(near.into_iter().flat_map(NearPixels::binds));
        let reach = world.cells.as_ref().map_or(0.0, |cells| cells.reach as f32);
        cmd.render(&Attachments { colors: &out.cleared(), depth: None, area: surface.area() }, |draw| {
            draw.bind(&self.shade, &resources);
            let View { clip_from_world, eye, .. } = *view;
            match near {
                Some(found) => {
                    let NearPixels { size: [width, height], every, .. } = *found;
                    draw.push(&NearPush { clip_from_world, eye, reach, first_proxy, width, height, every });
                }
                None => draw.push(&InterpolatePush { clip_from_world, eye, reach, first_proxy }),
            }
            draw.draw(3);
        });
    }
}
