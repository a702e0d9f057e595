//! Indirect light by interpolated caches: stages 3 and 5 to 10 with their results.

use super::atlas::Atlas;
use super::cull::Cull;
use super::gather::Gather;
use super::hidden_caches::HiddenCaches;
use super::inside::Dipoles;
use super::interpolate::Interpolate;
use super::near::NearRays;
use super::occlude::Occlude;
use super::plan::Plan;
use super::proxies::Proxies;
use super::revision::Made;
use super::settings;
use super::sky_light::SkyShading;
use super::sky_seen::SkyOfCaches;
use super::visible::Visible;
use super::world::World;
use crate::error::Result;
use crate::gpu::Device;

/// Caches in the world, the passes that light them, and the passes that carry their light to pixels.
pub struct CacheLight {
    /// Stage 3.
    pub atlas: Atlas,
    /// Stage 3, end; only where caches trace rays.
    pub(super) hidden: Option<HiddenCaches>,
    /// Stage 6.
    pub gather: Gather,
    /// Written by stage 6, dimmed by stage 7.
    pub proxies: Proxies,
    /// Stage 8, first part; only with short rays.
    pub near: Option<NearRays>,
    /// Stages 6 and 8 for a sky; only where caches see one.
    pub sky: Option<(SkyOfCaches, SkyShading)>,
    /// Stages 9 and 10; only where light travels through translucent bodies.
    pub inside: Option<Dipoles>,
    pub(super) visible: Visible,
    pub(super) cull: Option<Cull>,
    /// Stage 7; only where discs dim proxies.
    pub occlude: Option<Occlude>,
    pub(super) interpolate: Interpolate,
    pub(super) made: MadeOfCaches,
}

/// Revisions of the results of these stages.
#[derive(Default)]
pub(super) struct MadeOfCaches {
    pub(super) atlas: Made,
    /// Which caches are live, and their order.
    pub(super) order: Made,
    /// The list of live caches, including the gather's dispatch size.
    pub(super) live: Made,
    pub(super) depth_images: Made,
    pub(super) proxies: Made,
    /// The sky as caches see it.
    pub(super) sky: Made,
}

impl CacheLight {
    /// Creates the stages for a world, this many VALs, RSMs with `rsm` texels a side, and this many eyes.
    pub(super) fn new(
        gpu: &Device,
        plan: &Plan,
        world: &World,
        settings: &settings::Caches,
        [vals, rsm, eyes]: [u32; 3],
    ) -> Result<Self> {
        let gather = Gather::new(gpu, plan, world, settings, [vals, rsm, eyes])?;
        let count = world.cache_count;
        let near = NearRays::new(gpu, world, plan)?;
        // Number of consecutive caches that become live together.
        let group = gather.live().map_or(0, |live| live.group);
        Ok(Self {
            atlas: Atlas::new(gpu, count)?,
            hidden: HiddenCaches::new(gpu, world, plan)?,
            proxies: Proxies::new(gpu, count, plan.lobes, eyes)?,
            visible: Visible::new(gpu)?,
            cull: plan.cull.then(|| Cull::new(gpu, &gather, world.references_each)).transpose()?,
            occlude: plan.occlude.then(|| Occlude::new(gpu, count, plan.lobes, group)).transpose()?,
            interpolate: Interpolate::new(gpu, plan, world, settings.interpolation)?,
            sky: SkyOfCaches::new(gpu, world, plan, gather.sent_on())?.zip(SkyShading::new(gpu, plan, world)?),
            near,
            inside: Dipoles::new(gpu, plan, world)?,
            gather,
            made: MadeOfCaches::default(),
        })
    }
}
