//! Stage 8, interpolate: proxies -> indirect radiance per pixel. METHOD 5, thesis listing 5.2. Vertex level: the lights of
//! each visible vertex's references are averaged once, and every pixel shades by those of its triangle's corners. Triangles
//! are not drawn again, so the stage costs by what is seen, not by what there is.

use super::targets::{CacheTargets, IndirectTargets, VisibleTargets};
use super::{Interpolation, Plan, SceneBuffers, Settings, Targets, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster, Shape, Use};
use crate::shared::{AveragePush, InterpolatePush, VisibleArgs};

/// Averages and shades.
pub struct Interpolate {
    average: Pipeline,
    shade: Pipeline,
}

impl Interpolate {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu, plan: &Plan, settings: &Settings) -> Result<Self> {
        let targets = [Format::R32G32B32A32_SFLOAT; 2];
        let printed = u32::from(settings.interpolation == Interpolation::Printed);
        Ok(Self {
            average: gpu.compute("average.comp", &[settings.references as u32, u32::from(plan.glossy), printed])?,
            shade: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some(if plan.glossy { "interpolate.frag" } else { "interpolate_diffuse.frag" }),
                shape: Shape::Triangles,
                streams: &[],
                colors: &targets[..if plan.glossy { 2 } else { 1 }],
                blend: Blend::Replace,
                depth: Depth::None,
                cull: Cull::None,
                constants: &[printed],
            })?,
        })
    }

    /// Records the stage; it waits for the proxies and visible vertices itself.
    #[expect(clippy::too_many_arguments, reason = "what stage 8 reads comes from all stages before it")]
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        scene: &SceneBuffers,
        view: &View,
        t: &Targets,
        visible: &VisibleTargets,
        caches: &CacheTargets,
        out: &IndirectTargets,
    ) {
        let _zone = cmd.zone("interpolate");
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::IndirectRead); // proxies, visible vertices -> here
        cmd.bind(
            &self.average,
            &[
                (&visible.list).into(),
                (&scene.draw_records).into(),
                (&scene.references).into(),
                (&visible.args).into(),
                (&scene.instances).into(),
                (&scene.corners).into(),
                (&caches.atlas).into(),
                (&caches.proxies).into(),
                (&visible.lights).into(),
            ],
        );
        cmd.push(&AveragePush { eye: view.eye });
        cmd.dispatch_indirect(&visible.args, std::mem::offset_of!(VisibleArgs, groups_x) as u64);

        cmd.barrier(Use::ComputeWrite | Use::ColorWrite, Use::FragmentRead); // lights of vertices, G-buffer -> here
        let colors: Vec<_> = [&out.diffuse].into_iter().chain(&out.glossy).map(Attach::clear).collect();
        let element = t.element.as_ref().expect("stage 8 has elements");
        let all = [
            element.into(),
            (&scene.draw_records).into(),
            scene.indices().into(),
            (&visible.slots).into(),
            (&visible.lights).into(),
            (&t.normal).into(),
            (&t.albedo).into(),
            (&t.specular).into(),
        ];
        cmd.render(&Attachments { colors: &colors, depth: None, area: [0, 0, t.size[0], t.size[1]] }, |draw| {
            draw.bind(&self.shade, &all[..if out.glossy.is_some() { 8 } else { 7 }]);
            draw.push(&InterpolatePush { clip_from_world: view.clip_from_world, eye: view.eye });
            draw.draw(3);
        });
    }
}
