//! Stage 7, occlusion: discs of all caches dim the proxy lights of the live ones. METHOD 6, thesis 5.4.
//!
//! Every cache of the atlas is a disc that can block the light of live caches. Consecutive discs lie near each other. A
//! group of them is skipped as a whole if its bounds show that none can cover any part of a light.

use super::atlas::Atlas;
use super::live::Live;
use super::proxies::Proxies;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{CLUSTER_GROUP, OCCLUDE_PARTS, OCCLUDER_GROUP, OccludePush, OccluderGroup};

/// Bounds of groups of consecutive caches. Stage 7 and the drawing of depth images use them to skip whole groups.
pub struct Bounds {
    /// One element per group.
    pub groups: Buffer,
    pipeline: Pipeline,
}

impl Bounds {
    /// Creates bounds for this many caches.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, caches: u32) -> Result<Self> {
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
    /// Creates the pass for this many caches. `group` is the number of caches that are live together, or 0 if there is
    /// no list of live caches: caches that are not live then have unlit proxies.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, caches: u32, glossy: bool, group: u32) -> Result<Self> {
        Self::made(gpu, caches, glossy, group, true)
    }

    /// Creates a pass that skips no disc: the reference for skipping.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn without_skipping(gpu: &Device, caches: u32, glossy: bool, group: u32) -> Result<Self> {
        Self::made(gpu, caches, glossy, group, false)
    }

    fn made(gpu: &Device, caches: u32, glossy: bool, group: u32, skip: bool) -> Result<Self> {
        let dim = if group == 0 { "occlude_all.comp" } else { "occlude.comp" };
        let dim = gpu.compute(dim, &[glossy.into(), group, skip.into()])?;
        Ok(Self { bounds: Bounds::new(gpu, caches)?, skip, dim })
    }

    /// Records the stage for the runs of this many eyes, including the barrier for the proxies. `live` is the gather's
    /// list, if it has one.
    pub fn record(&self, cmd: &Cmd<'_>, atlas: &Atlas, live: Option<&Live>, proxies: &Proxies, eyes: usize) {
        if self.skip {
            self.bounds.record(cmd, atlas);
        }
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // proxies, bounds -> here
        for eye in 0..proxies.runs.min(eyes as u32) {
            if eye > 0 {
                // Other proxies, but in the same buffer.
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
            // In the cluster path, items of the list are groups of caches.
            cmd.dispatch(atlas.count.next_multiple_of(CLUSTER_GROUP), OCCLUDE_PARTS, 1);
        }
    }
}
