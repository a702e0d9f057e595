//! Stage 6, gather: VALs x caches -> proxy lights. METHOD 3-4, thesis 5.3. Fragment path: one draw per tile of VALs,
//! added to float targets, then a resolve.

use super::targets::{CacheTargets, RsmTargets};
use super::{Plan, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster, Use};
use crate::shared::{ATLAS_WIDTH, GatherPush, VAL_TILE, Val};

/// Lights the caches.
pub struct Gather {
    sum: Pipeline,
    resolve: Pipeline,
}

impl Gather {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let targets = [Format::R32G32B32A32_SFLOAT; 4];
        Ok(Self {
            sum: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some(if plan.glossy { "gather.frag" } else { "gather_diffuse.frag" }),
                streams: &[],
                colors: &targets[..if plan.glossy { 4 } else { 2 }],
                blend: Blend::Add,
                depth: Depth::None,
                cull: Cull::None,
                constants: &[],
            })?,
            resolve: gpu.compute("proxies.comp", &[u32::from(plan.glossy)])?,
        })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, rsm: &RsmTargets, view: &View, caches: &CacheTargets) {
        let _zone = cmd.zone("gather");
        let sums: Vec<_> = caches.sums.iter().map(Attach::clear).collect();
        let push = |val_count| GatherPush { cache_count: caches.count, val_count, eye: view.eye };
        cmd.render(
            &Attachments { colors: &sums, depth: None, area: [0, 0, ATLAS_WIDTH, caches.rows().max(1)] },
            |draw| {
                for (tile, val_count) in tiles(rsm.val_count) {
                    draw.bind(&self.sum, &[(&caches.atlas).into(), tile_of(rsm, tile)]);
                    draw.push(&push(val_count));
                    draw.draw(3);
                }
            },
        );
        cmd.barrier(Use::ColorWrite | Use::ComputeWrite, Use::ComputeRead);
        let image = |i: usize| Bind::Image(caches.sums.get(i).unwrap_or(&caches.sums[0]));
        cmd.bind(
            &self.resolve,
            &[(&caches.atlas).into(), image(0), image(1), image(2), image(3), (&caches.proxies).into()],
        );
        cmd.push(&push(rsm.val_count));
        cmd.dispatch(caches.count, 1, 1);
    }
}

/// Tiles of so many VALs: index, and how many the tile holds.
pub(super) fn tiles(val_count: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..val_count.div_ceil(VAL_TILE)).map(move |tile| (tile, (val_count - tile * VAL_TILE).min(VAL_TILE)))
}

/// The uniform-buffer range of a tile; the list of VALs is padded to whole tiles.
pub(super) fn tile_of(rsm: &RsmTargets, tile: u32) -> Bind<'_> {
    let bytes = u64::from(VAL_TILE) * size_of::<Val>() as u64;
    Bind::Slice(&rsm.vals, u64::from(tile) * bytes, bytes)
}
