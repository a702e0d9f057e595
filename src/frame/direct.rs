//! Stage 2, direct light: G-buffer, shadow maps -> radiance. METHOD 1. Light by light, with one shadow map for all
//! lights, which all views use before the next light is drawn. An area light has a map for each of its samples.

use super::gbuffer::Surface;
use super::plan::Plan;
use super::view::View;
use super::world::{LightInfo, VERTEX, Which, World};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Cull, Depth, Format, Gpu, Image, Pipeline, Raster, Shape, Use};
use crate::shared::{AreaPush, ScreenPush};
use glam::Vec4;

/// Shadow maps and their use.
pub struct Direct {
    /// Shadow map of one light at a time; six-view lights tile it three by two.
    pub shadow: Image,
    opaque: Pipeline,
    masked: Pipeline,
    /// Only with punctual lights.
    shade: Option<Pipeline>,
    /// Only with area lights.
    shade_area: Option<Pipeline>,
    /// Whether caches see the sky, so that no light stands for it here.
    sky_light: bool,
}

impl Direct {
    /// Makes the pipelines, and a shadow map of so many texels a side.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn new(gpu: &Gpu, world: &World, plan: &Plan, side: u32) -> Result<Self> {
        let depth_only = Raster {
            vertex: "mesh.vert",
            fragment: None,
            shape: Shape::Triangles,
            streams: &[VERTEX],
            colors: &[],
            blend: Blend::Replace,
            depth: Depth::Nearest,
            cull: Cull::None,
            constants: &[],
        };
        let used = |light: &&LightInfo| !(plan.sky_light && light.of_sky);
        let has = |area| world.lights().iter().filter(used).any(|light| light.is_area == area);
        let samples = plan.antialiasing.samples();
        Ok(Self {
            shadow: gpu.target("direct.shadow", Format::D32_SFLOAT, side, side)?,
            opaque: gpu.raster(&depth_only)?,
            masked: gpu.raster(&Raster { fragment: Some("shadow_mask.frag"), ..depth_only })?,
            shade: has(false).then(|| Surface::adding(gpu, "direct.frag", &[samples])).transpose()?,
            shade_area: has(true).then(|| Surface::adding(gpu, "direct_area.frag", &[])).transpose()?,
            sky_light: plan.sky_light,
        })
    }

    /// Records the stage for views and what they see of surfaces.
    pub fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        views: impl Iterator<Item = (&'a View, &'a Surface)> + Clone,
    ) {
        let shadow = &self.shadow;
        let used = |(_, light): &(usize, &LightInfo)| !(self.sky_light && light.of_sky);
        let mut is_first = true;
        for (i, light) in world.lights().iter().enumerate().filter(used) {
            let size = light.shadow_size(shadow.width);
            if !std::mem::take(&mut is_first) {
                cmd.barrier(Use::FragmentRead, Use::DepthWrite); // the last light's map has been read
            }
            let depth = Attachments {
                colors: &[],
                depth: Some(Attach::clear(shadow)),
                area: [0, 0, shadow.width, shadow.height],
            };
            cmd.render(&depth, |draw| {
                for face in 0..light.views {
                    let [x, y] = light.tile(face);
                    draw.area([x * size, y * size, size, size]);
                    let clip = world.clip_from_world(light.first_view + face);
                    let (least, view) = (light.least(size), (clip, Vec4::ZERO));
                    world.draw_large(draw, &self.opaque, Which::Opaque, view, least);
                    world.draw_large(draw, &self.masked, Which::Masked, view, least);
                }
            });
            cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::FragmentRead | Use::ColorWrite);
            for (view, surface) in views.clone() {
                let radiance =
                    Attachments { colors: &[Attach::keep(&surface.radiance)], depth: None, area: surface.area() };
                let shade = if light.is_area { &self.shade_area } else { &self.shade };
                let Some(shade) = shade else { continue };
                cmd.render(&radiance, |draw| {
                    let resources = [
                        (&world.light_buffer).into(),
                        (&world.view_buffer).into(),
                        (&surface.depth).into(),
                        (&surface.normal).into(),
                        (&surface.albedo).into(),
                        (&surface.specular).into(),
                        shadow.into(),
                    ];
                    draw.bind(shade, &resources);
                    let View { world_from_clip, eye, .. } = *view;
                    if light.is_area {
                        let columns = light.columns();
                        draw.push(&AreaPush { world_from_clip, eye, light: i as u32, face_size: size, columns });
                    } else {
                        let first_val = 0;
                        draw.push(&ScreenPush { world_from_clip, eye, light: i as u32, shadow_size: size, first_val });
                    }
                    draw.draw(3);
                });
            }
        }
    }
}
