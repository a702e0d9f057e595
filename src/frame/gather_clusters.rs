//! Stage 6 by clusters: sums nodes and VALs at caches into proxy lights. METHOD 9, thesis listing 6.6;
//! docs/clustering.md.
//!
//! Groups of neighbouring caches traverse the pyramids together. All caches of a group that need the children of a node
//! take all of them there. Groups are fixed parts of the atlas, so a cache receives the same light whichever other
//! caches are visible.

use super::live::{Items, Live, new_parts, parts_of, split_of};
use super::proxies::Lit;
use super::pyramid::Pyramid;
use super::settings::ClusterRule;
use super::world::World;
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Device, Gpu, Pipeline, Use};
use crate::shared::{CLUSTER_BOUND, CLUSTER_DISTANCE, CLUSTER_GROUP, ClusterPush, GatherPush, LiveArgs};
use glam::Vec4;

/// Largest spread of the normals in a node, as points on the unit sphere, for the distance rule. `ERROR_SPREAD` is the
/// unit in which the error rule counts the spread. Both were chosen in docs/clustering.md.
const SPREAD: f32 = 0.3;
const ERROR_SPREAD: f32 = 0.5;

/// Maximum number of nodes in a part. Older lavapipe leaves loops after 65 535 iterations. Each node takes one, and so
/// does each VAL below it: at most three VALs per node on average.
const LONGEST_PART: u32 = 12_288;

/// Nodes in a part if memory allows. They cover about 3000 VALs.
const PART: u32 = 1024;

/// The gather by clusters.
pub struct Clusters {
    /// The nodes.
    pub pyramid: Pyramid,
    /// The groups of caches that it lights.
    pub live: Live,
    /// Sums, one after the other for each part of the nodes.
    pub parts: Buffer,
    /// Number of nodes.
    pub(super) node_count: Buffer,
    /// Light that each slot of the list receives in the coarse traversal \[lx\].
    totals: Buffer,
    /// Number of computed pairs of a cache and a node or VAL, for each workgroup.
    pairs: Buffer,
    coarse: Option<Coarse>,
    walk: Pipeline,
    resolve: Pipeline,
    rule: ClusterRule,
}

/// Estimates the light that a cache receives, as the base of the error rule. Accepts nodes from a distance of one
/// radius.
struct Coarse {
    walk: Pipeline,
    totals: Pipeline,
}

impl Clusters {
    /// Creates pipelines, list and nodes for RSMs with `rsm` texels a side.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, world: &World, rsm: u32, rule: ClusterRule, glossy: bool, dim: bool) -> Result<Self> {
        let spread = u32::from(dim);
        let by_hand = u32::from(gpu.is_software());
        let walk = |glossy: bool, rule: u32| match gpu.voting_threads() {
            Some(threads) => {
                let constants = [glossy.into(), rule, CLUSTER_GROUP / threads, threads, spread, by_hand];
                gpu.compute_in_subgroups("gather_clusters_votes.comp", &constants, threads)
            }
            None => gpu.compute("gather_clusters.comp", &[glossy.into(), rule, 1, CLUSTER_GROUP, spread, by_hand]),
        };
        let coarse = || -> Result<Coarse> {
            Ok(Coarse { walk: walk(false, CLUSTER_DISTANCE)?, totals: gpu.compute("cluster_totals.comp", &[])? })
        };
        let is_error = matches!(rule, ClusterRule::Error(_));
        let (caches, pyramid) = (world.cache_count, Pyramid::new(gpu, world, rsm)?);
        let lights = pyramid.node_count;
        let split = split_of(caches, lights, PART, LONGEST_PART);
        let live = Live::new(gpu, Items { caches, group: CLUSTER_GROUP, per_workgroup: 1, lights, split })?;
        let workgroups = u64::from(live.count.max(1)) * u64::from(parts_of(lights, split));
        Ok(Self {
            parts: new_parts(gpu, caches, parts_of(lights, split))?,
            node_count: gpu.buffer_from("gather.node_count", &[lights])?,
            totals: gpu.buffer("gather.totals", 4 * u64::from(caches.max(1)))?,
            pairs: gpu.buffer("gather.pairs", 4 * workgroups)?,
            pyramid,
            live,
            coarse: is_error.then(coarse).transpose()?,
            walk: walk(glossy, if is_error { CLUSTER_BOUND } else { CLUSTER_DISTANCE })?,
            resolve: gpu.compute("proxies.comp", &[glossy.into(), CLUSTER_GROUP, spread])?,
            rule,
        })
    }

    /// Pairs of a cache and a node or VAL whose light the last frame computed. Waits for the device.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn pairs(&self, gpu: &Gpu) -> Result<u64> {
        let LiveArgs { groups_x, groups_y, .. } = gpu.read(&self.live.args)?[0];
        let pairs: Vec<u32> = gpu.read(&self.pairs)?;
        Ok(pairs[..(groups_x * groups_y) as usize].iter().map(|n| u64::from(*n)).sum())
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, lit: &Lit<'_>) {
        for (i, (first_proxy, eye)) in lit.runs().enumerate() {
            if i > 0 {
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // parts
            }
            self.record_eye(cmd, lit, first_proxy, eye);
        }
    }

    fn record_eye(&self, cmd: &Cmd<'_>, lit: &Lit<'_>, first_proxy: u32, eye: Vec4) {
        let (live, parts) = (&self.live, &self.parts);
        let (limit, spread) = match self.rule {
            ClusterRule::Distance(radii) => (radii, SPREAD),
            ClusterRule::Error(share) => (share, ERROR_SPREAD),
        };
        let (cache_count, node_count) = (lit.atlas.count, self.pyramid.node_count);
        let push = ClusterPush { eye, cache_count, node_count, split: live.split, limit, spread };
        if let Some(coarse) = &self.coarse {
            self.walk(cmd, &coarse.walk, lit, &ClusterPush { limit: 1.0, spread: f32::INFINITY, ..push });
            // The traversal's shader binds these totals in both rules but reads them only in the error rule.
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            cmd.bind(&coarse.totals, &[(&live.args).into(), parts.into(), (&self.totals).into()]);
            cmd.push(&push);
            cmd.dispatch(cache_count, 1, 1);
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
        }
        self.walk(cmd, &self.walk, lit, &push);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let resources = [&lit.atlas.caches, &lit.proxies.buffer, &live.list, &live.args, parts];
        cmd.bind(&self.resolve, &resources.map(Into::into));
        cmd.push(&GatherPush { cache_count, split: live.split, first_proxy, eye, ..GatherPush::default() });
        // Slots in whole groups.
        cmd.dispatch(cache_count.next_multiple_of(CLUSTER_GROUP), 1, 1);
    }

    fn walk(&self, cmd: &Cmd<'_>, pipeline: &Pipeline, lit: &Lit<'_>, push: &ClusterPush) {
        cmd.bind(
            pipeline,
            &[
                (&lit.atlas.caches).into(),
                (&self.live.list).into(),
                Bind::Texels(&self.pyramid.nodes),
                (&self.pyramid.nodes).into(),
                Bind::Texels(&lit.vals.all),
                (&self.totals).into(),
                (&self.parts).into(),
                (&self.pairs).into(),
            ],
        );
        cmd.push(push);
        cmd.dispatch_indirect(&self.live.args, 0);
    }
}
