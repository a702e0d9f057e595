//! Ends of stages 4 and 5: compacts the VALs that carry light, and the caches that are needed, in order. METHOD 9.

use super::live::Live;
use super::vals::Vals;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{PACK_BLOCK, PACK_THREADS, PackPush};

/// Maximum number of items that one workgroup compacts in a single pass. On a software device a second pass costs more
/// than the items.
const ALONE: u32 = 4 * PACK_BLOCK;

/// Compacts VALs in two passes: the first counts flags per block, the second places the items.
pub struct PackVals {
    count: Pipeline,
    place: Pipeline,
    /// Whether the gather's dispatch size depends only on the number of VALs.
    lights_all: bool,
}

impl PackVals {
    /// Creates the pipelines. If the gather lights all caches, this pass also writes the gather's dispatch size.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn new(gpu: &Device, lights_all: bool) -> Result<Self> {
        let place = if lights_all { "pack_vals_args.comp" } else { "pack_vals.comp" };
        Ok(Self { count: gpu.compute("count_flags.comp", &[])?, place: gpu.compute(place, &[])?, lights_all })
    }

    /// Copies flagged VALs to `live` and writes their number and, if the gather lights all caches, its dispatch size.
    /// The flags must be complete.
    pub fn record(&self, cmd: &Cmd<'_>, vals: &Vals, caches: Option<&Live>) {
        let args = caches.filter(|_| self.lights_all);
        let push = PackPush {
            count: vals.count,
            per_thread: PACK_BLOCK / PACK_THREADS,
            cache_count: args.map_or(0, |caches| caches.count),
            caches_per_group: args.map_or(0, |caches| caches.per_workgroup),
            split: args.map_or(0, |caches| caches.split),
        };
        count_blocks(cmd, &self.count, &push, &vals.flags, &vals.blocks);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let lists = [&vals.flags, &vals.blocks, &vals.all, &vals.live, &vals.live_count];
        let resources: Vec<_> = lists.into_iter().chain(args.map(|caches| &caches.args)).map(Into::into).collect();
        cmd.bind(&self.place, &resources);
        cmd.push(&push);
        cmd.dispatch(threads(&push), 1, 1);
    }
}

/// Compacts caches: few in one pass, many in two, like VALs.
pub struct PackCaches {
    count: Pipeline,
    place: Pipeline,
}

impl PackCaches {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn new(gpu: &Device) -> Result<Self> {
        Ok(Self { count: gpu.compute("count_flags.comp", &[])?, place: gpu.compute("pack_caches.comp", &[])? })
    }

    /// Writes flagged caches to `list`, and the gather's dispatch size over these and `light_count` VALs or nodes.
    /// Flags and count must be complete.
    pub fn record(&self, cmd: &Cmd<'_>, caches: &Live, light_count: &Buffer) {
        let block = if caches.count <= ALONE { ALONE } else { PACK_BLOCK };
        let push = PackPush {
            count: caches.count,
            per_thread: block / PACK_THREADS,
            cache_count: 0,
            caches_per_group: caches.per_workgroup,
            split: caches.split,
        };
        if caches.count > ALONE {
            count_blocks(cmd, &self.count, &push, &caches.flags, &caches.blocks);
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
        }
        let lists = [&caches.flags, &caches.blocks, light_count, &caches.list, &caches.args];
        cmd.bind(&self.place, &lists.map(Into::into));
        cmd.push(&push);
        cmd.dispatch(threads(&push), 1, 1);
    }
}

fn count_blocks(cmd: &Cmd<'_>, pipeline: &Pipeline, push: &PackPush, flags: &Buffer, blocks: &Buffer) {
    cmd.bind(pipeline, &[flags.into(), blocks.into()]);
    cmd.push(push);
    cmd.dispatch(threads(push), 1, 1);
}

/// Number of threads for the items. At least one workgroup, which then writes a count of 0.
fn threads(push: &PackPush) -> u32 {
    push.count.div_ceil(push.per_thread * PACK_THREADS).max(1) * PACK_THREADS
}
