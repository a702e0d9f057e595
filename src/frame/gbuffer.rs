//! Stage 1, G-buffer: scene, camera -> depth, normal, reflectances, emitted radiance, element. METHOD 1.

use super::upload::Which;
use super::{Plan, SceneBuffers, Targets, VERTEX, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster, Shape};

/// Draws every surface once; double-sided ones have both their sides among the triangles.
pub struct GBuffer {
    pipeline: Pipeline,
}

impl GBuffer {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let (float, half) = (Format::R32G32B32A32_SFLOAT, Format::R16G16B16A16_SFLOAT);
        let pipeline = gpu.raster(&Raster {
            vertex: "mesh.vert",
            fragment: Some(if plan.lightskin { "gbuffer_elements.frag" } else { "gbuffer.frag" }),
            shape: Shape::Triangles,
            streams: &[VERTEX],
            colors: &[float, half, half, float, Format::R32G32_UINT][..if plan.lightskin { 5 } else { 4 }],
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
        let images = [&t.normal, &t.albedo, &t.specular, &t.direct];
        let colors: Vec<_> = images.into_iter().chain(&t.element).map(Attach::clear).collect();
        let attachments =
            Attachments { colors: &colors, depth: Some(Attach::clear(&t.depth)), area: [0, 0, t.size[0], t.size[1]] };
        cmd.render(&attachments, |draw| scene.draw(draw, &self.pipeline, Which::All, view.clip_from_world, view.eye));
    }
}
