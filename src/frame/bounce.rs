//! Stage 6, further bounces: lit caches become VALs and light all caches, bounce after bounce. METHOD 9, thesis 6.1.7.
//!
//! Every cache takes part in every bounce: one that is not seen sends light to those that are. The sums of the primary
//! lights' VALs are made once; those of the caches lie in parts of their own and are made anew in every bounce. Before the
//! first, a gather of the caches' areas gives each the sum of its form factors, by which what caches send is bounded.
//!
//! What a surface that emits gives to a cache has not bounced yet. So where there are such VALs, caches first send on their
//! light alone, and there is a gather more: after N of them all light has bounced N times at most, whatever it came from.

use super::depth_images::{SentOn, are_texels};
use super::live::Live;
use super::settings::{ProxyWeight, Shadows, Ways};
use super::sums::{ComputeKind, SumBinds, SumKind, sum_pipeline};
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{
    BOUNCE_AGAIN, BOUNCE_AREAS, BOUNCE_EMITTED, BOUNCE_FIRST, BouncePush, DEPTH_IMAGE_ROW, GATHER_THREADS, GatherPush,
    VAL_TILE, Val,
};

/// Makes VALs of lit caches and gathers them.
pub struct Bounces {
    /// The caches as VALs, padded with dark ones to whole tiles.
    pub vals: Buffer,
    /// Their number before padding.
    pub(super) val_count: Buffer,
    /// By what the light of all caches is multiplied at each.
    pub scales: Buffer,
    /// Parts that the caches' VALs are split into; they lie before those of the primary lights.
    pub parts: u32,
    /// Gathers of the caches' light.
    count: u32,
    caches_per_thread: u32,
    light: Pipeline,
    /// Where caches trace rays: what they receive of the caches of what these meet, instead of a gather.
    exchange: Option<Pipeline>,
    /// Gathers of the diffuse lobe alone: what later bounces need of earlier ones.
    diffuse: Pipeline,
    /// Of both lobes, where there are two.
    all: Pipeline,
    resolve: Pipeline,
}

impl Bounces {
    /// Makes it for caches that light caches once or more.
    pub(super) fn new(gpu: &Gpu, live: &Live, ways: &Ways, kind: ComputeKind, is_traced: bool) -> Result<Self> {
        let near = kind.near > 0.0;
        let ComputeKind { glossy, shadows, bounces, emitted, weight, .. } = kind;
        // What follows each other in the list of caches lies in different directions.
        let caches = live.caches;
        let images_as_texels = are_texels(gpu, caches);
        let sum = |glossy| {
            let (together, proxies, two_eyes) = (1, false, false);
            let kind = SumKind { glossy, shadows, together, proxies, two_eyes, near, images_as_texels };
            sum_pipeline(gpu, ways, kind)
        };
        let padded = caches.next_multiple_of(VAL_TILE).max(VAL_TILE) as usize;
        let spread = u32::from(shadows == Shadows::Proxy);
        Ok(Self {
            vals: gpu.buffer_from("bounce.vals", &vec![Val { area: 1.0, ..Val::default() }; padded])?,
            val_count: gpu.buffer_from("bounce.val_count", &[caches])?,
            scales: gpu.buffer("bounce.scales", 4 * u64::from(caches.max(1)))?,
            parts: caches.max(emitted).div_ceil(live.split),
            count: bounces,
            caches_per_thread: ways.caches(),
            light: gpu.compute(
                if is_traced { "bounce_traced.comp" } else { "bounce.comp" },
                &[u32::from(weight == ProxyWeight::Irradiance)],
            )?,
            exchange: is_traced.then(|| gpu.compute("exchange.comp", &[])).transpose()?,
            diffuse: sum(false)?,
            all: sum(glossy)?,
            resolve: gpu.compute("proxies_bounces.comp", &[u32::from(glossy), 1, spread])?,
        })
    }

    /// Gathers of the caches' light, or of what stands for it.
    pub fn gathers(&self) -> u32 {
        if self.exchange.is_some() { 2 } else { 1 + self.count }
    }

    /// Records the bounces: in front of them the primary lights' sums are being written, and proxies are made of those and of
    /// the caches' at their end. The last one has the glossy lobe, too, where there is one. What caches send on is gathered by
    /// the first of `sums` and `pushes`, what pixels get by the second ones; for that `leave_out` makes the primary lights' sums anew, where
    /// something nearby is left to short rays.
    pub(super) fn record(
        &self,
        cmd: &Cmd<'_>,
        (albedos, emitted, sent_on): (&Buffer, Option<&(Buffer, Buffer)>, Option<&SentOn>),
        [sums, last_sums]: [&SumBinds<'_>; 2],
        proxies: &Buffer,
        [push, last]: [&GatherPush; 2],
        leave_out: Option<&dyn Fn()>,
    ) {
        let caches = (&self.vals, &self.val_count);
        // The sums before, and the VALs that they were made of.
        let wait = || cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
        let light = |step| {
            wait();
            self.light(cmd, (albedos, sent_on), sums, step);
            wait();
        };
        light(BOUNCE_AREAS);
        // Rays say what caches see of all; the gather's form factors are asked for what it is needed for.
        let (of_areas, areas_push) = if self.exchange.is_some() { (last_sums, last) } else { (sums, push) };
        self.gather(cmd, &self.diffuse, caches, of_areas, areas_push);
        light(BOUNCE_FIRST);
        if let Some((vals, count)) = emitted {
            self.gather(cmd, &self.diffuse, (vals, count), sums, push);
            light(BOUNCE_EMITTED);
        }
        for bounce in 1..=self.count {
            if bounce > 1 {
                light(BOUNCE_AGAIN);
            }
            if let (true, Some(exchange), Some(sent_on)) = (bounce < self.count, &self.exchange, sent_on) {
                cmd.bind(exchange, &[&sent_on.met, &self.vals, sums.parts].map(Into::into));
                cmd.push(&BouncePush { cache_count: sums.atlas.count, cache_parts: self.parts, step: BOUNCE_AGAIN });
                let row = DEPTH_IMAGE_ROW;
                cmd.dispatch(sums.atlas.count.min(row) * GATHER_THREADS, sums.atlas.count.div_ceil(row), 1);
            } else if bounce < self.count {
                self.gather(cmd, &self.diffuse, caches, sums, push);
            } else {
                self.gather(cmd, &self.all, caches, last_sums, last);
                if let Some(leave_out) = leave_out {
                    wait();
                    leave_out();
                }
            }
        }
        self.resolve(cmd, sums, proxies, push);
    }

    fn light(&self, cmd: &Cmd<'_>, (albedos, sent_on): (&Buffer, Option<&SentOn>), sums: &SumBinds<'_>, step: u32) {
        let resources = [&sums.atlas.caches, albedos, &sums.live.args, sums.parts, &self.scales, &self.vals];
        let closed = sent_on.filter(|_| self.exchange.is_some()).map(|sent_on| &sent_on.closed);
        let resources: Vec<Bind<'_>> = resources.into_iter().chain(closed).map(Into::into).collect();
        cmd.bind(&self.light, &resources);
        cmd.push(&BouncePush { cache_count: sums.atlas.count, cache_parts: self.parts, step });
        cmd.dispatch(sums.atlas.count, 1, 1);
    }

    fn gather(
        &self,
        cmd: &Cmd<'_>,
        pipeline: &Pipeline,
        vals: (&Buffer, &Buffer),
        sums: &SumBinds<'_>,
        push: &GatherPush,
    ) {
        SumBinds { vals, ..*sums }.bind(cmd, pipeline);
        cmd.push(&GatherPush { cache_parts: 0, ..*push });
        let groups = sums.atlas.count.div_ceil(GATHER_THREADS * self.caches_per_thread);
        cmd.dispatch(groups * GATHER_THREADS, self.parts, 1);
    }

    fn resolve(&self, cmd: &Cmd<'_>, sums: &SumBinds<'_>, proxies: &Buffer, push: &GatherPush) {
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let live = sums.live;
        let resources = [&sums.atlas.caches, proxies, &live.list, &live.args, sums.parts, &self.scales];
        cmd.bind(&self.resolve, &resources.map(Into::into));
        cmd.push(push);
        cmd.dispatch(sums.atlas.count, 1, 1);
    }
}
