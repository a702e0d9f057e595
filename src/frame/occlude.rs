//! Stage 7, occlusion: caches x live caches -> dimmed proxy lights. METHOD 6, thesis 5.4.
//!
//! Every cache of the atlas is a disc in the way of what the live ones receive. Groups of consecutive discs, which lie
//! near each other, are skipped together where their bounds say that none of them can cover anything of a light.

use super::atlas::Atlas;
use super::live::Live;
use super::proxies::Proxies;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{CLUSTER_GROUP, OCCLUDE_PARTS, OCCLUDER_GROUP, OccludePush, OccluderGroup};

/// Bounds of groups of consecutive caches, which stage 7 and what draws depth images skip together.
pub struct Bounds {
    /// Group by group.
    pub groups: Buffer,
    pipeline: Pipeline,
}

impl Bounds {
    /// For this many caches.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn new(gpu: &Gpu, caches: u32) -> Result<Self> {
        let groups = u64::from(caches.div_ceil(OCCLUDER_GROUP).max(1));
        let groups = gpu.buffer("occlude.groups", groups * size_of::<OccluderGroup>() as u64)?;
        Ok(Self { groups, pipeline: gpu.compute("occluder_groups.comp", &[])? })
    }

    /// Records the pass.
    pub fn record(&self, cmd: &Cmd<'_>, atlas: &Atlas) {
        cmd.bind(&self.pipeline, &[(&atlas.caches).into(), (&self.groups).into()]);
        let push = push(atlas, 0);
        cmd.push(&push);
        cmd.dispatch(push.group_count, 1, 1);
    }
}

fn push(atlas: &Atlas, first_proxy: u32) -> OccludePush {
    OccludePush { cache_count: atlas.count, group_count: atlas.count.div_ceil(OCCLUDER_GROUP), first_proxy }
}

/// Dims proxies.
pub struct Occlude {
    bounds: Bounds,
    /// Whether groups are skipped.
    skip: bool,
    dim: Pipeline,
}

impl Occlude {
    /// Makes it for this many caches, `group` of which are live together, or 0 where no list says which are: then those that
    /// are not are unlit.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn new(gpu: &Gpu, caches: u32, glossy: bool, group: u32) -> Result<Self> {
        Self::made(gpu, caches, glossy, group, true)
    }

    /// The same without skipping any disc: what skipping is measured against.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn without_skipping(gpu: &Gpu, caches: u32, glossy: bool, group: u32) -> Result<Self> {
        Self::made(gpu, caches, glossy, group, false)
    }

    fn made(gpu: &Gpu, caches: u32, glossy: bool, group: u32, skip: bool) -> Result<Self> {
        let dim = if group == 0 { "occlude_all.comp" } else { "occlude.comp" };
        let dim = gpu.compute(dim, &[glossy.into(), group, skip.into()])?;
        Ok(Self { bounds: Bounds::new(gpu, caches)?, skip, dim })
    }

    /// Records the stage for the runs of this many eyes; it waits for the proxies itself. The list is that of the gather, if it
    /// has one.
    pub fn record(&self, cmd: &Cmd<'_>, atlas: &Atlas, live: Option<&Live>, proxies: &Proxies, eyes: usize) {
        if self.skip {
            self.bounds.record(cmd, atlas);
        }
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // proxies, bounds -> here
        for eye in 0..proxies.runs.min(eyes as u32) {
            if eye > 0 {
                // Other proxies, but the same buffer.
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            }
            let all = [(&atlas.caches).into(), (&self.bounds.groups).into(), (&proxies.buffer).into()];
            match live {
                Some(live) => {
                    let [atlas, groups, proxies] = all;
                    cmd.bind(&self.dim, &[atlas, groups, proxies, (&live.list).into(), (&live.args).into()]);
                }
                None => cmd.bind(&self.dim, &all),
            }
            cmd.push(&push(atlas, proxies.first(eye)));
            // Items of the list are groups of caches with clusters.
            cmd.dispatch(atlas.count.next_multiple_of(CLUSTER_GROUP), OCCLUDE_PARTS, 1);
        }
    }
}
