//! Stage 7, occlusion: caches x live caches -> dimmed proxy lights. METHOD 6, thesis 5.4.
//!
//! Every cache of the atlas is a disc in the way of what the live ones receive. Groups of consecutive discs, which lie
//! near each other, are skipped together where their bounds say that none of them can cover anything of a light.

use super::targets::CacheTargets;
use super::{GatherPath, Plan, Settings};
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{CLUSTER_GROUP, OCCLUDE_PARTS, OCCLUDER_GROUP, OccludePush};

/// Bounds groups of consecutive caches.
pub struct Bound(Pipeline);

impl Bound {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self(gpu.compute("occluder_groups.comp", &[])?))
    }

    /// Records the pass; gives what it writes.
    pub fn record<'a>(&self, cmd: &Cmd<'_>, caches: &'a CacheTargets) -> &'a Buffer {
        let groups = caches.occluders.as_ref().expect("made for shadows");
        cmd.bind(&self.0, &[(&caches.atlas).into(), groups.into()]);
        let push = push(caches);
        cmd.push(&push);
        cmd.dispatch(push.group_count, 1, 1);
        groups
    }
}

fn push(caches: &CacheTargets) -> OccludePush {
    OccludePush { cache_count: caches.count, group_count: caches.count.div_ceil(OCCLUDER_GROUP) }
}

/// Dims proxies.
pub struct Occlude {
    bound: Option<Bound>,
    dim: Pipeline,
}

impl Occlude {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu, plan: &Plan, settings: &Settings) -> Result<Self> {
        Self::made(gpu, plan, settings, true)
    }

    /// The same without skipping any disc: what skipping is measured against.
    pub fn without_skipping(gpu: &Gpu, plan: &Plan, settings: &Settings) -> Result<Self> {
        Self::made(gpu, plan, settings, false)
    }

    fn made(gpu: &Gpu, plan: &Plan, settings: &Settings, skip: bool) -> Result<Self> {
        // Caches that are live together; the fragment path has no list, and leaves those that are not live unlit.
        let group = match (settings.gather.path, settings.cluster) {
            (GatherPath::Fragment, _) => 0,
            (GatherPath::Compute, None) => 1,
            (GatherPath::Compute, Some(_)) => CLUSTER_GROUP,
        };
        let dim = if group == 0 { "occlude_all.comp" } else { "occlude.comp" };
        Ok(Self {
            bound: skip.then(|| Bound::new(gpu)).transpose()?,
            dim: gpu.compute(dim, &[plan.glossy.into(), group, skip.into()])?,
        })
    }

    /// Records the stage; it waits for the proxies itself.
    pub fn record(&self, cmd: &Cmd<'_>, caches: &CacheTargets) {
        let _zone = cmd.zone("occlude");
        let groups = caches.occluders.as_ref().expect("made for this stage");
        if let Some(bound) = &self.bound {
            bound.record(cmd, caches);
        }
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // proxies, bounds -> here
        let all = [(&caches.atlas).into(), groups.into(), (&caches.proxies).into()];
        match &caches.live {
            Some(live) => {
                let [atlas, groups, proxies] = all;
                cmd.bind(&self.dim, &[atlas, groups, proxies, (&live.list).into(), (&live.args).into()]);
            }
            None => cmd.bind(&self.dim, &all),
        }
        cmd.push(&push(caches));
        // Items of the list are groups of caches with clusters.
        cmd.dispatch(caches.count.next_multiple_of(CLUSTER_GROUP), OCCLUDE_PARTS, 1);
    }
}
