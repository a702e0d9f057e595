//! Stage 8, last part: adds the sky's light to the visible surfaces, by the share that short rays find at pixels, or
//! that caches see.
//! METHOD 12.

use super::atlas::Atlas;
use super::gbuffer::Surface;
use super::interpolate::Shaded;
use super::near::{self, NearPixels};
use super::plan::Plan;
use super::settings::Near;
use super::view::View;
use super::world::{SkyLight, World};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Bind, Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{InterpolatePush, NearPush};

/// Adds the light of the sky to direct light.
pub struct SkyShading {
    shade: Pipeline,
    /// Whether pixels average caches themselves.
    by_cells: bool,
}

impl SkyShading {
    /// Creates the pipeline.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub(super) fn new(gpu: &Device, plan: &Plan, world: &World) -> Result<Option<Self>> {
        if !plan.sky_light {
            return Ok(None);
        }
        let by_cells = world.references_of_pixels().is_some();
        let constants = [u32::from(plan.glossy), world.references_each as u32, near::as_texels(gpu)];
        let fragment = match (plan.near == Near::Off, by_cells, plan.coated) {
            (true, false, false) => "sky_light.frag",
            (true, true, false) => "sky_light_cells.frag",
            (false, _, false) => "sky_light_near.frag",
            (true, false, true) => "sky_light_coat.frag",
            (true, true, true) => "sky_light_cells_coat.frag",
            (false, _, true) => "sky_light_near_coat.frag",
        };
        let constants = &constants[..if plan.near == Near::Off { 2 } else { 3 }];
        let shade = Surface::adding(gpu, fragment, constants)?;
        Ok(Some(Self { shade, by_cells }))
    }

    /// Records the stage for views, after their indirect light.
    pub(super) fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        (world, sky): (&World, &SkyLight),
        atlas: &Atlas,
        seen: &Buffer,
        views: impl Iterator<Item = Shaded<'a>>,
    ) {
        cmd.barrier(Use::ColorWrite, Use::ColorWrite); // direct light -> here
        for Shaded { view, surface, visible, near, first_proxy, .. } in views {
            let Some(element) = &surface.element else { continue };
            let mut resources = vec![Bind::from(element), (&world.draw_records).into()];
            if near.is_some() {
                resources.extend([world.indices(), &world.instances, &world.corners].map(Bind::from));
            } else if self.by_cells {
                let of_cells = [&world.references, world.indices(), &world.instances, &world.corners];
                resources.extend(of_cells.map(Bind::from));
                resources.extend([&visible.slots, &atlas.caches, seen].map(Bind::from));
            } else {
                resources.extend([world.indices(), &visible.slots, &visible.lights].map(Bind::from));
                resources.extend(visible.sky_lights.as_ref().map(Bind::from));
            }
            resources.extend([&surface.normal, &surface.albedo, &surface.specular].map(Bind::from));
            resources.extend(near.into_iter().flat_map(NearPixels::binds));
            resources.extend([&sky.texels, &sky.levels].map(Bind::from));
            resources.extend(surface.coat.as_ref().map(Bind::from));
            let radiance =
                Attachments { colors: &[Attach::keep(&surface.radiance)], depth: None, area: surface.area() };
            let reach = world.cells.as_ref().map_or(0.0, |cells| cells.reach as f32);
            cmd.render(&radiance, |draw| {
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
}
