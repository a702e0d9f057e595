//! Stage 2, direct light: G-buffer, shadow maps -> radiance. METHOD 1. Light by light, with one shadow map for all.

use super::upload::Which;
use super::{SceneBuffers, Targets, VERTEX, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster, Shape, Use};
use crate::shared::ScreenPush;
use glam::Vec4;

/// Shadow maps and their use.
pub struct Direct {
    opaque: Pipeline,
    masked: Pipeline,
    shade: Pipeline,
}

impl Direct {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu) -> Result<Self> {
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
        Ok(Self {
            opaque: gpu.raster(&depth_only)?,
            masked: gpu.raster(&Raster { fragment: Some("shadow_mask.frag"), ..depth_only })?,
            shade: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some("direct.frag"),
                shape: Shape::Triangles,
                streams: &[],
                colors: &[Format::R32G32B32A32_SFLOAT],
                blend: Blend::Add,
                depth: Depth::None,
                cull: Cull::None,
                constants: &[],
            })?,
        })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, scene: &SceneBuffers, view: &View, t: &Targets) {
        let _zone = cmd.zone("direct");
        let shadow = t.shadow.as_ref().expect("the plan has direct light");
        for (i, light) in scene.lights().iter().enumerate() {
            let size = light.shadow_size(shadow.width);
            if i > 0 {
                cmd.barrier(Use::FragmentRead, Use::DepthWrite); // the last light's map has been read
            }
            let depth = Attachments {
                colors: &[],
                depth: Some(Attach::clear(shadow)),
                area: [0, 0, shadow.width, shadow.height],
            };
            cmd.render(&depth, |draw| {
                for face in 0..light.views {
                    draw.area([face % 3 * size, face / 3 * size, size, size]);
                    let clip = scene.clip_from_world(light.first_view + face);
                    scene.draw(draw, &self.opaque, Which::Opaque, clip, Vec4::ZERO);
                    scene.draw(draw, &self.masked, Which::Masked, clip, Vec4::ZERO);
                }
            });
            cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::FragmentRead | Use::ColorWrite);
            let radiance =
                Attachments { colors: &[Attach::keep(&t.direct)], depth: None, area: [0, 0, t.size[0], t.size[1]] };
            cmd.render(&radiance, |draw| {
                draw.bind(
                    &self.shade,
                    &[
                        (&scene.light_buffer).into(),
                        (&scene.view_buffer).into(),
                        (&t.depth).into(),
                        (&t.normal).into(),
                        (&t.albedo).into(),
                        (&t.specular).into(),
                        shadow.into(),
                    ],
                );
                draw.push(&ScreenPush {
                    world_from_clip: view.world_from_clip,
                    eye: view.eye,
                    light: i as u32,
                    shadow_size: size,
                    first_val: 0,
                });
                draw.draw(3);
            });
        }
    }
}
