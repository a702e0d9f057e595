//! Ends of stages 4 and 5: VALs that carry light, and caches that matter, close up in order. METHOD 9.

use super::targets::{LiveCaches, ValTargets};
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{PACK_BLOCK, PACK_THREADS, PackPush};

/// Closes up lists; each in two passes, a count of every block and then the places.
pub struct Pack {
    count: Pipeline,
    vals: Pipeline,
    caches: Pipeline,
}

impl Pack {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            count: gpu.compute("count_flags.comp", &[])?,
            vals: gpu.compute("pack_vals.comp", &[])?,
            caches: gpu.compute("pack_caches.comp", &[])?,
        })
    }

    /// Flagged VALs, which must be there -> `live` and their number.
    pub fn vals(&self, cmd: &Cmd<'_>, vals: &ValTargets) {
        let push = PackPush { count: vals.count, all: 0, caches_per_group: 0, split: 0 };
        self.count_blocks(cmd, &push, &vals.flags, &vals.blocks);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        cmd.bind(
            &self.vals,
            &[
                (&vals.flags).into(),
                (&vals.blocks).into(),
                (&vals.all).into(),
                (&vals.live).into(),
                (&vals.live_count).into(),
            ],
        );
        cmd.push(&push);
        cmd.dispatch(threads(push.count), 1, 1);
    }

    /// Flagged caches, or all -> `list` and the gather's dispatch over so many VALs or nodes, a number that must be there.
    pub fn caches(&self, cmd: &Cmd<'_>, caches: &LiveCaches, light_count: &Buffer, all: bool) {
        let push = PackPush {
            count: caches.count,
            all: u32::from(all),
            caches_per_group: caches.per_workgroup,
            split: caches.split,
        };
        if !all {
            self.count_blocks(cmd, &push, &caches.flags, &caches.blocks);
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
        }
        cmd.bind(
            &self.caches,
            &[
                (&caches.flags).into(),
                (&caches.blocks).into(),
                light_count.into(),
                (&caches.list).into(),
                (&caches.args).into(),
            ],
        );
        cmd.push(&push);
        cmd.dispatch(threads(push.count), 1, 1);
    }

    fn count_blocks(&self, cmd: &Cmd<'_>, push: &PackPush, flags: &Buffer, blocks: &Buffer) {
        cmd.bind(&self.count, &[flags.into(), blocks.into()]);
        cmd.push(push);
        cmd.dispatch(threads(push.count), 1, 1);
    }
}

/// Threads that look at so many items; at least one group, which writes that there are none.
fn threads(items: u32) -> u32 {
    items.div_ceil(PACK_BLOCK).max(1) * PACK_THREADS
}
