//! Brute force: every VAL lights every pixel, the reference for interpolation. METHOD 3. Replaces stages 3, 6 and 8.

use super::gbuffer::Surface;
use super::inside::InsideBruteForce;
use super::interpolate::Radiance;
use super::plan::Plan;
use super::vals::Vals;
use super::view::View;
use crate::error::Result;
use crate::gpu::{Attachments, Bind, Blend, Cmd, Cull, Depth, Device, Format, Pipeline, Raster, Shape};
use crate::shared::{ScreenPush, VAL_TILE, Val};
use std::ops::Range;

/// One full-screen draw per tile of VALs.
pub struct BruteForce {
    pipeline: Pipeline,
    /// Stage 10; only where light travels through translucent bodies.
    pub(super) inside: Option<InsideBruteForce>,
}

impl BruteForce {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn new(gpu: &Device, plan: &Plan) -> Result<Self> {
        let targets = [Format::R32G32B32A32_SFLOAT; 2];
        let pipeline = gpu.raster(&Raster {
            vertex: "screen.vert",
            fragment: Some(if plan.glossy { "brute_force.frag" } else { "brute_force_diffuse.frag" }),
            shape: Shape::Triangles,
            streams: &[],
            colors: &targets[..if plan.glossy { 2 } else { 1 }],
            blend: Blend::Add,
            depth: Depth::None,
            cull: Cull::None,
            constants: &[],
        })?;
        Ok(Self { pipeline, inside: InsideBruteForce::new(gpu, plan)? })
    }

    /// Records the stage for these rows of a view. Rows outside the picture are ignored.
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        vals: &Vals,
        view: &View,
        surface: &Surface,
        (out, rows): (&Radiance, &Range<u32>),
    ) {
        let [left, top, width, height] = surface.area();
        let (first, end) = (rows.start.min(height), rows.end.min(height));
        if first >= end {
            return;
        }
        let area = [left, top + first, width, end - first];
        cmd.render(&Attachments { colors: &out.cleared(), depth: None, area }, |draw| {
            for first_val in (0..vals.count).step_by(VAL_TILE as usize) {
                let val = size_of::<Val>() as u64;
                let all = [
                    Bind::Slice(&vals.live, u64::from(first_val) * val, u64::from(VAL_TILE) * val),
                    (&vals.live_count).into(),
                    (&surface.depth).into(),
                    (&surface.normal).into(),
                    (&surface.albedo).into(),
                    (&surface.specular).into(),
                ];
                draw.bind(&self.pipeline, &all[..if out.glossy.is_some() { 6 } else { 5 }]);
                draw.push(&ScreenPush {
                    world_from_clip: view.world_from_clip,
                    eye: view.eye,
                    light: 0,
                    shadow_size: 0,
                    first_val,
                });
                draw.draw(3);
            }
        });
    }
}
