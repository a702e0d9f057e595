//! Stage 8, interpolate: proxies -> indirect radiance per pixel. METHOD 5, thesis listing 5.2. Vertex level: the
//! average is made in the vertex shader, the shading per pixel, on the surfaces that stage 1 found nearest.

use super::targets::{CacheTargets, IndirectTargets};
use super::upload::Which;
use super::{Interpolation, POSITION_NORMAL, Plan, SceneBuffers, Settings, Targets, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Cull, Depth, Format, Gpu, Load, Pipeline, Raster, Shape};

/// Averages and shades.
pub struct Interpolate {
    pipeline: Pipeline,
}

impl Interpolate {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu, plan: &Plan, settings: &Settings) -> Result<Self> {
        let targets = [Format::R32G32B32A32_SFLOAT; 2];
        let printed = u32::from(settings.interpolation == Interpolation::Printed);
        let pipeline = gpu.raster(&Raster {
            vertex: "interpolate.vert",
            fragment: Some(if plan.glossy { "interpolate.frag" } else { "interpolate_diffuse.frag" }),
            shape: Shape::Triangles,
            streams: &[POSITION_NORMAL],
            colors: &targets[..if plan.glossy { 2 } else { 1 }],
            blend: Blend::Replace,
            depth: Depth::Equal,
            cull: Cull::Back,
            constants: &[settings.references as u32, u32::from(plan.glossy), printed],
        })?;
        Ok(Self { pipeline })
    }

    /// Records the stage.
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        scene: &SceneBuffers,
        view: &View,
        t: &Targets,
        caches: &CacheTargets,
        out: &IndirectTargets,
    ) {
        let _zone = cmd.zone("interpolate");
        let colors: Vec<_> = [&out.diffuse].into_iter().chain(&out.glossy).map(Attach::clear).collect();
        let depth = Some(Attach { image: &t.depth, load: Load::ReadOnly });
        let attachments = Attachments { colors: &colors, depth, area: [0, 0, t.size[0], t.size[1]] };
        let all = [
            (&scene.instances).into(),
            (&scene.references).into(),
            (&caches.atlas).into(),
            (&caches.proxies).into(),
            (&t.normal).into(),
            (&t.albedo).into(),
            (&t.specular).into(),
        ];
        let own = &all[..if out.glossy.is_some() { 7 } else { 6 }];
        cmd.render(&attachments, |draw| {
            scene.draw(draw, &self.pipeline, Which::WithCaches, view.clip_from_world, view.eye, Some(own));
        });
    }
}
