//! Stage 8, interpolate: proxies -> indirect radiance per pixel. METHOD 5, thesis listings 5.2 and 6.5. Vertex level: the
//! lights of each visible vertex's references are averaged once, and every pixel shades by those of its triangle's corners.
//! Pixel level: every pixel averages the lights of its cell's references itself, whatever the triangles. Triangles are not
//! drawn again, so the stage costs by what is seen, not by what there is.

use super::targets::{CacheTargets, IndirectTargets, VisibleTargets};
use super::{Interpolation, Plan, SceneBuffers, Settings, Targets, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster, Shape, Use};
use crate::shared::{AveragePush, InterpolatePush, VisibleArgs};

/// Averages and shades.
pub struct Interpolate {
    /// Only at vertex level.
    average: Option<Pipeline>,
    shade: Pipeline,
}

impl Interpolate {
    /// Makes the pipelines. Pixels look for so many `references` each; without, vertices have done so.
    pub fn new(gpu: &Gpu, plan: &Plan, settings: &Settings, of_pixels: Option<usize>) -> Result<Self> {
        let targets = [Format::R32G32B32A32_SFLOAT; 2];
        let printed = u32::from(settings.interpolation == Interpolation::Printed);
        let constants = [settings.references as u32, u32::from(plan.glossy), printed];
        Ok(Self {
            average: of_pixels.is_none().then(|| gpu.compute("average.comp", &constants)).transpose()?,
            shade: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some(match (of_pixels, plan.glossy) {
                    (None, true) => "interpolate.frag",
                    (None, false) => "interpolate_diffuse.frag",
                    (Some(_), true) => "interpolate_cells.frag",
                    (Some(_), false) => "interpolate_cells_diffuse.frag",
                }),
                shape: Shape::Triangles,
                streams: &[],
                colors: &targets[..if plan.glossy { 2 } else { 1 }],
                blend: Blend::Replace,
                depth: Depth::None,
                cull: Cull::None,
                constants: &[printed, of_pixels.unwrap_or(settings.references) as u32],
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
        if let Some(average) = &self.average {
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::IndirectRead); // proxies, visible vertices -> here
            cmd.bind(
                average,
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
        }

        // Lights of vertices, or proxies and the pixels' cells; G-buffer -> here.
        cmd.barrier(Use::ComputeWrite | Use::ColorWrite, Use::FragmentRead);
        let colors: Vec<_> = [&out.diffuse].into_iter().chain(&out.glossy).map(Attach::clear).collect();
        let element: Bind<'_> = t.element.as_ref().expect("stage 8 has elements").into();
        let (draws, surface) = ((&scene.draw_records).into(), [&t.normal, &t.albedo, &t.specular].map(Bind::from));
        let [normal, albedo, specular] = surface;
        let by_vertices = [
            element,
            draws,
            scene.indices().into(),
            (&visible.slots).into(),
            (&visible.lights).into(),
            normal,
            albedo,
            specular,
        ];
        let by_cells = [
            element,
            draws,
            (&scene.references).into(),
            scene.indices().into(),
            (&scene.instances).into(),
            (&scene.corners).into(),
            (&visible.slots).into(),
            (&caches.atlas).into(),
            (&caches.proxies).into(),
            normal,
            albedo,
            specular,
        ];
        let all = if self.average.is_some() { &by_vertices[..] } else { &by_cells };
        let used = all.len() - usize::from(out.glossy.is_none());
        let reach = scene.cells.as_ref().map_or(0.0, |cells| cells.reach as f32);
        cmd.render(&Attachments { colors: &colors, depth: None, area: [0, 0, t.size[0], t.size[1]] }, |draw| {
            draw.bind(&self.shade, &all[..used]);
            draw.push(&InterpolatePush { clip_from_world: view.clip_from_world, eye: view.eye, reach });
            draw.draw(3);
        });
    }
}
