//! Stage 1, G-buffer: scene, camera -> depth, normal, reflectances, emitted radiance. METHOD 1.

use super::upload::Which;
use super::{SceneBuffers, Targets, VERTEX, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster};

/// Draws every surface once; double-sided ones have both their sides among the triangles.
pub struct GBuffer {
    pipeline: Pipeline,
}

impl GBuffer {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        let (float, half) = (Format::R32G32B32A32_SFLOAT, Format::R16G16B16A16_SFLOAT);
        let pipeline = gpu.raster(&Raster {
            vertex: "mesh.vert",
            fragment: Some("gbuffer.frag"),
            streams: &[VERTEX],
            colors: &[float, half, half, float],
            blend: Blend::Replace,
            depth: Depth::Nearest,
            cull: Cull::Back,
            constants: &[],
        })?;
        Ok(Self { pipeline })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, scene: &SceneBuffers, view: &View, t: &Targets) {
        let _zone = cmd.zone("gbuffer");
        let attachments = Attachments {
            colors: &[
                Attach::clear(&t.normal),
                Attach::clear(&t.albedo),
                Attach::clear(&t.specular),
                Attach::clear(&t.direct),
            ],
            depth: Some(Attach::clear(&t.depth)),
            area: [0, 0, t.size[0], t.size[1]],
        };
        cmd.render(&attachments, |draw| {
            scene.draw(draw, &self.pipeline, Which::All, view.clip_from_world, view.eye, None)
        });
    }
}
