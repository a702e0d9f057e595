//! Stage 6, further bounces: lit caches become VALs and light all caches, bounce after bounce. METHOD 9, thesis 6.1.7.
//!
//! Every cache takes part in every bounce: one that is not seen sends light to those that are. The sums of the primary
//! lights' VALs are made once; those of the caches lie in parts of their own and are made anew in every bounce. Before the
//! first, a gather of the caches' areas gives each the sum of its form factors, by which what caches send is bounded.

use super::gather::{bind_sum, sum_pipeline};
use super::targets::CacheTargets;
use super::{Plan, ProxyWeight, Settings, Shadows};
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{BOUNCE_AGAIN, BOUNCE_AREAS, BOUNCE_FIRST, BouncePush, GATHER_THREADS, GatherPush, VAL_TILE, Val};

/// What further bounces need.
pub struct BounceTargets {
    /// The caches as VALs, padded with dark ones to whole tiles.
    pub vals: Buffer,
    /// Their number before padding.
    pub val_count: Buffer,
    /// By what the light of all caches is multiplied at each.
    pub scales: Buffer,
    /// Parts that the caches' VALs are split into; they lie before those of the primary lights.
    pub parts: u32,
}

impl BounceTargets {
    /// Makes them for so many caches, split into parts.
    pub fn new(gpu: &Gpu, caches: u32, parts: u32) -> Result<Self> {
        let padded = caches.next_multiple_of(VAL_TILE).max(VAL_TILE) as usize;
        Ok(Self {
            vals: gpu.buffer_from("bounce.vals", &vec![Val { area: 1.0, ..Val::default() }; padded])?,
            val_count: gpu.buffer_from("bounce.val_count", &[caches])?,
            scales: gpu.buffer("bounce.scales", 4 * u64::from(caches.max(1)))?,
            parts,
        })
    }

    /// Every buffer.
    pub fn buffers(&self) -> [&Buffer; 3] {
        [&self.vals, &self.val_count, &self.scales]
    }
}

/// Makes VALs of lit caches and gathers them.
pub struct Bounces {
    /// All bounces, the first of which is the primary lights'.
    count: u32,
    caches_per_thread: u32,
    light: Pipeline,
    /// Gathers of the diffuse lobe alone: what later bounces need of earlier ones.
    diffuse: Pipeline,
    /// Of both lobes, where there are two.
    all: Pipeline,
    /// Whether caches do not see all others.
    shadowed: bool,
    resolve: Pipeline,
}

impl Bounces {
    /// Makes the pipelines for two bounces or more.
    pub fn new(gpu: &Gpu, plan: &Plan, settings: &Settings) -> Result<Self> {
        // What follows each other in the list of caches lies in different directions.
        let sum = |glossy| sum_pipeline(gpu, glossy, &settings.gather, settings.shadows, 1, false);
        Ok(Self {
            count: settings.bounces,
            caches_per_thread: settings.gather.caches_per_thread,
            light: gpu.compute("bounce.comp", &[u32::from(settings.proxy_weight == ProxyWeight::Irradiance)])?,
            diffuse: sum(false)?,
            all: sum(plan.glossy)?,
            shadowed: settings.shadows == Shadows::PerLight,
            resolve: gpu.compute("proxies_bounces.comp", &[u32::from(plan.glossy), 1, u32::from(plan.occlude)])?,
        })
    }

    /// Records the bounces after the first: in front of them the primary lights' sums are being written, and proxies are made
    /// of those and of the caches' at their end. The last one has the glossy lobe, too, where there is one.
    pub fn record(&self, cmd: &Cmd<'_>, albedos: &Buffer, caches: &CacheTargets, push: &GatherPush) {
        let last = self.count - 1;
        for bounce in 0..self.count {
            // The sums before, and the VALs that they were made of.
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            let step = [BOUNCE_AREAS, BOUNCE_FIRST, BOUNCE_AGAIN][bounce.min(2) as usize];
            self.light(cmd, albedos, caches, step);
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            self.gather(cmd, if bounce == last { &self.all } else { &self.diffuse }, caches, push);
        }
        self.resolve(cmd, caches, push);
    }

    fn light(&self, cmd: &Cmd<'_>, albedos: &Buffer, caches: &CacheTargets, step: u32) {
        let (live, parts) = (caches.live.as_ref().expect("of this path"), caches.parts.as_ref().expect("of this path"));
        let targets = caches.bounces.as_ref().expect("made for bounces");
        cmd.bind(
            &self.light,
            &[
                (&caches.atlas).into(),
                albedos.into(),
                (&live.args).into(),
                parts.into(),
                (&targets.scales).into(),
                (&targets.vals).into(),
            ],
        );
        cmd.push(&BouncePush { cache_count: caches.count, cache_parts: targets.parts, step });
        cmd.dispatch(caches.count, 1, 1);
    }

    fn gather(&self, cmd: &Cmd<'_>, pipeline: &Pipeline, caches: &CacheTargets, push: &GatherPush) {
        let targets = caches.bounces.as_ref().expect("made for bounces");
        bind_sum(cmd, pipeline, (&targets.val_count, &targets.vals), caches, [false, self.shadowed]);
        cmd.push(&GatherPush { cache_parts: 0, ..*push });
        let groups = caches.count.div_ceil(GATHER_THREADS * self.caches_per_thread);
        cmd.dispatch(groups * GATHER_THREADS, targets.parts, 1);
    }

    fn resolve(&self, cmd: &Cmd<'_>, caches: &CacheTargets, push: &GatherPush) {
        let (live, parts) = (caches.live.as_ref().expect("of this path"), caches.parts.as_ref().expect("of this path"));
        let scales = &caches.bounces.as_ref().expect("made for bounces").scales;
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let resources = [&caches.atlas, &caches.proxies, &live.list, &live.args, parts, scales];
        cmd.bind(&self.resolve, &resources.map(Into::into));
        cmd.push(push);
        cmd.dispatch(caches.count, 1, 1);
    }
}
