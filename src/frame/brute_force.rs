//! Brute force: every VAL lights every pixel, the reference for interpolation. METHOD 3. Replaces stages 3, 6 and 8.

use super::gbuffer::Surface;
use super::inside::InsideBruteForce;
use super::interpolate::Radiance;
use super::plan::Plan;
use super::vals::Vals;
use super::view::View;
use crate::error::Result;
use crate::gpu::{Attachments, Bind, Blend, Cmd, Cull, Depth, Device, Format, Pipeline, Raster, Shape, Use};
use crate::shared::{ScreenPush, VAL_TILE, Val};
use std::ops::Range;

/// Width and height of a block of pixels, the part of a picture that can be lit on its own.
const BLOCK: u32 = 16;

/// Number of blocks of a picture. They are counted row by row from the top.
pub fn blocks([width, height]: [u32; 2]) -> u32 {
    width.div_ceil(BLOCK) * height.div_ceil(BLOCK)
}

/// The rectangles of these blocks: the end of a row of blocks, whole rows, and the begin of a row.
fn rectangles(part: &Range<u32>, [width, height]: [u32; 2]) -> impl Iterator<Item = [u32; 4]> {
    let columns = width.div_ceil(BLOCK);
    let end = part.end.min(blocks([width, height]));
    let mut next = part.start;
    std::iter::from_fn(move || {
        if next >= end {
            return None;
        }
        let (row, column) = (next / columns, next % columns);
        let whole = if column == 0 { (end - next) / columns } else { 0 };
        let [wide, high] = if whole > 0 { [columns, whole] } else { [(columns - column).min(end - next), 1] };
        next += wide * high;
        let [left, top] = [column * BLOCK, row * BLOCK];
        Some([left, top, (wide * BLOCK).min(width - left), (high * BLOCK).min(height - top)])
    })
}

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
            multisampled: false,
            constants: &[],
        })?;
        Ok(Self { pipeline, inside: InsideBruteForce::new(gpu, plan)? })
    }

    /// Records the stage for these blocks of a view. Blocks outside the picture are ignored.
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        vals: &Vals,
        view: &View,
        surface: &Surface,
        (out, blocks): (&Radiance, &Range<u32>),
    ) {
        let [_, _, width, height] = surface.area();
        for (index, area) in rectangles(blocks, [width, height]).enumerate() {
            if index > 0 {
                cmd.barrier(Use::ColorWrite, Use::ColorWrite); // one rectangle -> the next
            }
            self.record_area(cmd, vals, view, surface, (out, area));
        }
    }

    fn record_area(
        &self,
        cmd: &Cmd<'_>,
        vals: &Vals,
        view: &View,
        surface: &Surface,
        (out, area): (&Radiance, [u32; 4]),
    ) {
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

#[cfg(test)]
mod tests {
    use crate::frame::brute_force::{blocks, rectangles};

    /// Any ranges of blocks one after another cover every pixel once.
    #[test]
    fn blocks_cover_each_pixel_once() {
        for size in [[1, 1], [16, 16], [17, 40], [100, 33], [0, 5]] {
            for step in [1, 2, 3, 7, 1000] {
                let mut covered = vec![0; (size[0] * size[1]) as usize];
                for begin in (0..blocks(size)).step_by(step) {
                    for [left, top, width, height] in rectangles(&(begin..begin + step as u32), size) {
                        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (left + x, top + y))) {
                            covered[(y * size[0] + x) as usize] += 1;
                        }
                    }
                }
                assert!(covered.iter().all(|times| *times == 1), "{size:?} by {step}");
            }
            assert_eq!(rectangles(&(0..u32::MAX), size).count(), usize::from(!size.contains(&0)));
        }
    }
}
