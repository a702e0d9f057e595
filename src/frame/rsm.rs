//! Stage 4, extended RSM: the scene as each light sees it -> VALs. METHOD 2, thesis 5.2.

use super::pack::Pack;
use super::targets::RsmTargets;
use super::upload::Which;
use super::{ProxyWeight, SceneBuffers, VERTEX};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster, Shape, Use};
use crate::shared::ValPush;

/// Draws an RSM per view of each light and turns its texels into VALs.
pub struct Rsm {
    draw: Pipeline,
    vals: Pipeline,
    pack: Pack,
    weight: ProxyWeight,
}

impl Rsm {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu, weight: ProxyWeight) -> Result<Self> {
        Ok(Self {
            draw: gpu.raster(&Raster {
                vertex: "mesh.vert",
                fragment: Some("rsm.frag"),
                shape: Shape::Triangles,
                streams: &[VERTEX],
                colors: &[Format::R32G32B32A32_SFLOAT; 3],
                blend: Blend::Replace,
                depth: Depth::Nearest,
                cull: Cull::None,
                constants: &[],
            })?,
            vals: gpu.compute("vals.comp", &[u32::from(weight == ProxyWeight::Irradiance)])?,
            pack: Pack::new(gpu)?,
            weight,
        })
    }

    /// Records the stage for the lights that are due; the VALs of the others are as they were. `emitters` says whether those
    /// of surfaces that emit are not.
    pub fn record(&self, cmd: &Cmd<'_>, scene: &SceneBuffers, due: &[bool], emitters: bool, t: &RsmTargets) {
        let _zone = cmd.zone("rsm");
        if emitters {
            t.vals.update(cmd, &scene.emitters, self.weight);
            cmd.barrier(Use::CopyWrite, Use::ComputeRead | Use::ComputeWrite);
        }
        let (mut first, mut drawn) = (0, false);
        for (i, light) in scene.lights().iter().enumerate() {
            let size = light.rsm_size(t.depth.width);
            if !due[i] {
                first += light.views * size * size;
                continue;
            }
            for view in light.first_view..light.first_view + light.views {
                if drawn {
                    cmd.barrier(Use::ComputeRead | Use::DepthWrite, Use::ColorWrite | Use::DepthWrite); // the last view is read
                }
                let attachments = Attachments {
                    colors: &[Attach::clear(&t.position), Attach::clear(&t.normal), Attach::clear(&t.albedo)],
                    depth: Some(Attach::clear(&t.depth)),
                    area: [0, 0, size, size],
                };
                let clip = scene.clip_from_world(view);
                cmd.render(&attachments, |draw| scene.draw(draw, &self.draw, Which::All, clip, light.eye));
                if drawn {
                    cmd.barrier(Use::ColorWrite | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                } else {
                    cmd.barrier(Use::ColorWrite, Use::ComputeRead);
                }
                cmd.bind(
                    &self.vals,
                    &[
                        (&scene.light_buffer).into(),
                        (&scene.view_buffer).into(),
                        (&t.position).into(),
                        (&t.normal).into(),
                        (&t.albedo).into(),
                        (&t.vals.all).into(),
                        (&t.vals.flags).into(),
                    ],
                );
                cmd.push(&ValPush { light: i as u32, view, size, first });
                cmd.dispatch(size, size, 1);
                first += size * size;
                drawn = true;
            }
        }
        if drawn {
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead); // VALs, flags -> their list
        }
        self.pack.vals(cmd, &t.vals);
    }
}
