//! Stage 6 by clusters: caches x nodes and VALs -> proxy lights. METHOD 9, thesis listing 6.6; docs/clustering.md.
//!
//! Groups of neighbouring caches walk down the pyramids together: who of a group needs what is below a node takes all of it
//! there. Groups are fixed parts of the atlas, so that a cache receives the same whatever else is seen.

use super::pyramid::Pyramid;
use super::targets::{CacheTargets, ValTargets};
use super::{SceneBuffers, Settings, Shadows, View};
use crate::error::Result;
use crate::gpu::{Bind, Cmd, Gpu, Pipeline, Use};
use crate::shared::{CLUSTER_BOUND, CLUSTER_DISTANCE, CLUSTER_GROUP, ClusterPush, GatherPush};

/// What decides whether a node stands for its VALs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cluster {
    /// It is farther away than so many of its radii, and its normals are alike.
    Distance(f32),
    /// The most by which it could be wrong is no more than this share of what the cache receives.
    Error(f32),
}

/// Most that the normals of a node may differ by, as points on the unit sphere; of errors what the spread counts in
/// units of. By the study.
const SPREAD: f32 = 0.3;
const ERROR_SPREAD: f32 = 0.5;

/// Builds the pyramids and lights the caches.
pub struct Clusters {
    /// The nodes.
    pub pyramid: Pyramid,
    coarse: Option<Coarse>,
    walk: Pipeline,
    resolve: Pipeline,
    rule: Cluster,
}

/// Estimates what a cache receives, for shares of it: nodes one radius away will do.
struct Coarse {
    walk: Pipeline,
    totals: Pipeline,
}

impl Clusters {
    /// Makes pipelines and nodes.
    pub fn new(gpu: &Gpu, scene: &SceneBuffers, settings: &Settings, rule: Cluster, glossy: bool) -> Result<Self> {
        let spread = u32::from(settings.shadows == Shadows::Proxy);
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
        let is_error = matches!(rule, Cluster::Error(_));
        Ok(Self {
            pyramid: Pyramid::new(gpu, scene, settings.rsm)?,
            coarse: is_error.then(coarse).transpose()?,
            walk: walk(glossy, if is_error { CLUSTER_BOUND } else { CLUSTER_DISTANCE })?,
            resolve: gpu.compute("proxies.comp", &[glossy.into(), CLUSTER_GROUP, spread])?,
            rule,
        })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, vals: &ValTargets, view: &View, caches: &CacheTargets) {
        let _zone = cmd.zone("gather");
        let live = caches.live.as_ref().expect("of this path");
        let (limit, spread) = match self.rule {
            Cluster::Distance(radii) => (radii, SPREAD),
            Cluster::Error(share) => (share, ERROR_SPREAD),
        };
        let (eye, cache_count, node_count) = (view.eye, caches.count, self.pyramid.node_count);
        let push = ClusterPush { eye, cache_count, node_count, split: live.split, limit, spread };
        if let Some(coarse) = &self.coarse {
            let (clusters, parts) = (caches.clusters.as_ref().expect("made"), caches.parts.as_ref().expect("made"));
            self.walk(cmd, &coarse.walk, vals, caches, &ClusterPush { limit: 1.0, spread: f32::INFINITY, ..push });
            // The walk's shader has the totals of shares bound, which it reads by the other rule alone.
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            cmd.bind(&coarse.totals, &[(&live.args).into(), parts.into(), (&clusters.totals).into()]);
            cmd.push(&push);
            cmd.dispatch(caches.count, 1, 1);
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
        }
        self.walk(cmd, &self.walk, vals, caches, &push);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let parts = caches.parts.as_ref().expect("of this path");
        cmd.bind(
            &self.resolve,
            &[(&caches.atlas).into(), (&caches.proxies).into(), (&live.list).into(), (&live.args).into(), parts.into()],
        );
        cmd.push(&GatherPush { cache_count, first: 0, tile: 0, split: live.split, columns: 0, cache_parts: 0, eye });
        // Slots of whole groups.
        cmd.dispatch(caches.count.next_multiple_of(CLUSTER_GROUP), 1, 1);
    }

    fn walk(&self, cmd: &Cmd<'_>, pipeline: &Pipeline, vals: &ValTargets, caches: &CacheTargets, push: &ClusterPush) {
        let live = caches.live.as_ref().expect("of this path");
        let (clusters, parts) = (caches.clusters.as_ref().expect("made"), caches.parts.as_ref().expect("made"));
        cmd.bind(
            pipeline,
            &[
                (&caches.atlas).into(),
                (&live.list).into(),
                Bind::Texels(&self.pyramid.nodes),
                (&self.pyramid.nodes).into(),
                Bind::Texels(&vals.all),
                (&clusters.totals).into(),
                parts.into(),
                (&clusters.pairs).into(),
            ],
        );
        cmd.push(push);
        cmd.dispatch_indirect(&live.args, 0);
    }
}
