//! Stage 6, further bounces: lit caches become VALs and light all caches; this repeats for each bounce. METHOD 9,
//! thesis 6.1.7.
//!
//! Every cache takes part in every bounce, since caches that are not visible light visible ones. The primary lights'
//! VALs are summed once. The caches' VALs have separate parts of the sums, which each bounce recomputes.
//!
//! Where caches trace rays, each receives the light of the caches at the ends of its rays. Elsewhere it gathers all
//! caches, and before the first bounce, a gather of their areas gives each cache the sum of its form factors, which
//! bounds the light that it gets.
//!
//! Light from an emissive surface or from the sky has not bounced yet when it reaches a cache. If there is such light,
//! caches first send on this light alone, and there is one more gather. So after N gathers all light has bounced at most
//! N times, whatever its source. Caches know the sky's light exactly, so it needs no VALs.

use super::depth_images::{SentOn, are_texels};
use super::live::Live;
use super::settings::{ProxyWeight, Shadows, Ways};
use super::sums::{ComputeKind, SumBinds, SumKind, sum_pipeline};
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{
    BOUNCE_AGAIN, BOUNCE_AREAS, BOUNCE_EMITTED, BOUNCE_FIRST, BOUNCE_SKY, BouncePush, DEPTH_IMAGE_ROW, GATHER_THREADS,
    GatherPush, VAL_TILE, Val,
};

/// Turns lit caches into VALs and gathers them.
pub struct Bounces {
    /// The caches as VALs, padded to whole tiles with VALs without light.
    pub vals: Buffer,
    /// Number of VALs before padding.
    pub(super) val_count: Buffer,
    /// Factor for the light of all caches, one per receiving cache; 1 where they trace rays.
    pub scales: Buffer,
    /// Number of parts that the caches' VALs are split into. They come before the parts of the primary lights.
    pub parts: u32,
    /// Number of gathers of the caches' light.
    count: u32,
    caches_per_thread: u32,
    light: Pipeline,
    /// Only if caches trace rays: these replace gathers by light from the caches at the hits of these rays, for all
    /// bounces but the last, and for the last.
    exchange: Option<[Pipeline; 2]>,
    /// Gathers the diffuse lobe only, for all bounces but the last.
    diffuse: Pipeline,
    /// Gathers both lobes, if there are two.
    all: Pipeline,
    resolve: Pipeline,
}

/// What decides the light that caches send on, besides the primary lights' VALs.
#[derive(Clone, Copy)]
pub(super) struct Sources<'a> {
    /// Diffuse albedos of the caches.
    pub(super) albedos: &'a Buffer,
    /// The sky as caches see it, one `SkySeen` each; only where they do.
    pub(super) sky: Option<&'a Buffer>,
    /// VALs of emissive surfaces, and their number.
    pub(super) emitted: Option<&'a (Buffer, Buffer)>,
    /// What the caches' rays hit; only if they trace rays.
    pub(super) sent_on: Option<&'a SentOn>,
}

impl Bounces {
    /// Creates the passes for caches that light each other at least once.
    pub(super) fn new(gpu: &Device, live: &Live, ways: &Ways, kind: ComputeKind, is_traced: bool) -> Result<Self> {
        let near = kind.near > 0.0;
        let ComputeKind { glossy, shadows, bounces, emitted, sky, weight, .. } = kind;
        // Neighbours in the list of caches lie in different directions.
        let caches = live.caches;
        let images_as_texels = are_texels(gpu, caches, near);
        let sum = |glossy| {
            let (together, proxies, two_eyes) = (1, false, false);
            let lobes = false; // caches send diffusely
            let kind = SumKind { glossy, shadows, together, proxies, two_eyes, near, lobes, images_as_texels };
            sum_pipeline(gpu, ways, kind)
        };
        let padded = caches.next_multiple_of(VAL_TILE).max(VAL_TILE) as usize;
        let spread = u32::from(shadows == Shadows::Proxy);
        let by_irradiance = u32::from(weight == ProxyWeight::Irradiance);
        let exchange = || -> Result<[Pipeline; 2]> {
            let [sent_on, far] = ["exchange.comp", "exchange_far.comp"];
            Ok([gpu.compute(sent_on, &[])?, gpu.compute(far, &[by_irradiance])?])
        };
        let gathered = if is_traced { emitted } else { caches.max(emitted) };
        Ok(Self {
            vals: gpu.buffer_from("bounce.vals", &vec![Val { area: 1.0, ..Val::default() }; padded])?,
            val_count: gpu.buffer_from("bounce.val_count", &[caches])?,
            scales: gpu.buffer_from("bounce.scales", &vec![1.0_f32; caches.max(1) as usize])?,
            parts: gathered.div_ceil(live.split).max(1),
            count: bounces,
            caches_per_thread: ways.caches(),
            light: gpu.compute(
                match (is_traced, sky) {
                    (false, false) => "bounce.comp",
                    (true, false) => "bounce_traced.comp",
                    (false, true) => "bounce_sky.comp",
                    (true, true) => "bounce_traced_sky.comp",
                },
                &[by_irradiance],
            )?,
            exchange: is_traced.then(exchange).transpose()?,
            diffuse: sum(false)?,
            all: sum(glossy)?,
            resolve: gpu.compute("proxies_bounces.comp", &[u32::from(glossy), 1, spread])?,
        })
    }

    /// Number of gathers of all caches by all; none where rays replace them.
    pub fn gathers(&self) -> u32 {
        if self.exchange.is_some() { 0 } else { 1 + self.count }
    }

    /// Records the bounces. The primary lights' sums must have been recorded before. At the end, proxies are made from
    /// the primary sums and those of the caches. The last bounce includes the glossy lobe, if there is one. The first
    /// of `sums` and `pushes` gather the light that caches send on; the second gather the light for pixels. If short
    /// rays provide the light from nearby surfaces, `leave_out` recomputes the primary lights' sums for pixels.
    pub(super) fn record(
        &self,
        cmd: &Cmd<'_>,
        Sources { albedos, sky, emitted, sent_on }: Sources<'_>,
        [sums, last_sums]: [&SumBinds<'_>; 2],
        proxies: &Buffer,
        [push, last]: [&GatherPush; 2],
        leave_out: Option<&dyn Fn()>,
    ) {
        let caches = (&self.vals, &self.val_count);
        // Waits for the previous sums, and for reads of the VALs they were computed from.
        let wait = || cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
        let light = |step| {
            wait();
            self.light(cmd, (albedos, sky), sums, step);
            wait();
        };
        if self.exchange.is_none() {
            light(BOUNCE_AREAS);
            self.gather(cmd, &self.diffuse, caches, sums, push);
        }
        light(if sky.is_some() && emitted.is_none() { BOUNCE_SKY } else { BOUNCE_FIRST });
        if let Some((vals, count)) = emitted {
            self.gather(cmd, &self.diffuse, (vals, count), sums, push);
            light(BOUNCE_EMITTED);
        }
        for bounce in 1..=self.count {
            if bounce > 1 {
                light(BOUNCE_AGAIN);
            }
            let is_last = bounce == self.count;
            if let (Some([exchange, far]), Some(sent_on)) = (&self.exchange, sent_on) {
                let (exchange, met) = if is_last { (far, &sent_on.far_met) } else { (exchange, &sent_on.met) };
                cmd.bind(exchange, &[met, &self.vals, sums.parts].map(Into::into));
                cmd.push(&BouncePush { cache_count: sums.atlas.count, cache_parts: self.parts, step: BOUNCE_AGAIN });
                let row = DEPTH_IMAGE_ROW;
                cmd.dispatch(sums.atlas.count.min(row) * GATHER_THREADS, sums.atlas.count.div_ceil(row), 1);
            } else if is_last {
                self.gather(cmd, &self.all, caches, last_sums, last);
            } else {
                self.gather(cmd, &self.diffuse, caches, sums, push);
            }
        }
        if let Some(leave_out) = leave_out {
            wait();
            leave_out();
        }
        self.resolve(cmd, sums, proxies, push);
    }

    fn light(&self, cmd: &Cmd<'_>, (albedos, sky): (&Buffer, Option<&Buffer>), sums: &SumBinds<'_>, step: u32) {
        let resources = [&sums.atlas.caches, albedos, &sums.live.args, sums.parts, &self.vals];
        let scales = self.exchange.is_none().then_some(&self.scales);
        let resources: Vec<Bind<'_>> = resources.into_iter().chain(scales).chain(sky).map(Into::into).collect();
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
