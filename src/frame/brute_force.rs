//! Every VAL onto every pixel: what interpolation is measured against. METHOD 3. Stands in for stages 3, 6 and 8.

use super::gather::{tile_of, tiles};
use super::targets::{IndirectTargets, RsmTargets};
use super::{Plan, Targets, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster};
use crate::shared::ScreenPush;

/// One full-screen draw per tile of VALs.
pub struct BruteForce {
    pipeline: Pipeline,
}

impl BruteForce {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let targets = [Format::R32G32B32A32_SFLOAT; 2];
        let pipeline = gpu.raster(&Raster {
            vertex: "screen.vert",
            fragment: Some(if plan.glossy { "brute_force.frag" } else { "brute_force_diffuse.frag" }),
            streams: &[],
            colors: &targets[..if plan.glossy { 2 } else { 1 }],
            blend: Blend::Add,
            depth: Depth::None,
            cull: Cull::None,
            constants: &[],
        })?;
        Ok(Self { pipeline })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, rsm: &RsmTargets, view: &View, t: &Targets, out: &IndirectTargets) {
        let _zone = cmd.zone("brute force");
        let colors: Vec<_> = [&out.diffuse].into_iter().chain(&out.glossy).map(Attach::clear).collect();
        cmd.render(&Attachments { colors: &colors, depth: None, area: [0, 0, t.size[0], t.size[1]] }, |draw| {
            for (tile, val_count) in tiles(rsm.val_count) {
                let all = [
                    tile_of(rsm, tile),
                    (&t.depth).into(),
                    (&t.normal).into(),
                    (&t.albedo).into(),
                    (&t.specular).into(),
                ];
                draw.bind(&self.pipeline, &all[..if out.glossy.is_some() { 5 } else { 4 }]);
                draw.push(&ScreenPush {
                    world_from_clip: view.world_from_clip,
                    eye: view.eye,
                    light: 0,
                    shadow_size: 0,
                    val_count,
                });
                draw.draw(3);
            }
        });
    }
}
