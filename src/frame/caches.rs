//! Indirect light by interpolated caches: stages 3 and 5 to 10, and what they write.

use super::atlas::Atlas;
use super::cull::Cull;
use super::gather::Gather;
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
use crate::gpu::Gpu;

/// Caches in the world, what lights them, and how that gets to pixels.
pub struct CacheLight {
    /// Stage 3.
    pub atlas: Atlas,
    /// Stage 6.
    pub gather: Gather,
    /// What stage 6 makes and stage 7 dims.
    pub proxies: Proxies,
    /// Stage 8, first; only where what is nearby is left to short rays.
    pub near: Option<NearRays>,
    /// Stages 6 and 8 of a sky, where caches see one.
    pub sky: Option<(SkyOfCaches, SkyShading)>,
    /// Stages 9 and 10; only where light goes on inside bodies.
    pub inside: Option<Dipoles>,
    pub(super) visible: Visible,
    pub(super) cull: Option<Cull>,
    /// Stage 7; only where discs dim proxies.
    pub occlude: Option<Occlude>,
    pub(super) interpolate: Interpolate,
    pub(super) made: MadeOfCaches,
}

/// What is up to date.
#[derive(Default)]
pub(super) struct MadeOfCaches {
    pub(super) atlas: Made,
    /// Which caches are live, and in which order.
    pub(super) order: Made,
    /// The list itself, with the gather's dispatch in it.
    pub(super) live: Made,
    pub(super) depth_images: Made,
    pub(super) proxies: Made,
    /// What caches see of the sky.
    pub(super) sky: Made,
}

impl CacheLight {
    /// Makes it for a world, so many VALs of RSMs of `rsm` texels a side, and so many eyes.
    pub(super) fn new(
        gpu: &Gpu,
        plan: &Plan,
        world: &World,
        settings: &settings::Caches,
        [vals, rsm, eyes]: [u32; 3],
    ) -> Result<Self> {
        let gather = Gather::new(gpu, plan, world, settings, [vals, rsm, eyes])?;
        let count = world.cache_count;
        let near = NearRays::new(gpu, world, plan)?;
        // Caches that are live together.
        let group = gather.live().map_or(0, |live| live.group);
        Ok(Self {
            atlas: Atlas::new(gpu, count)?,
            proxies: Proxies::new(gpu, count, plan.lobes, eyes)?,
            visible: Visible::new(gpu)?,
            cull: plan.cull.then(|| Cull::new(gpu, &gather, world.references_each)).transpose()?,
            occlude: plan.occlude.then(|| Occlude::new(gpu, count, plan.lobes, group)).transpose()?,
            interpolate: Interpolate::new(gpu, plan, world, settings.interpolation)?,
            sky: SkyOfCaches::new(gpu, world, plan)?.zip(SkyShading::new(gpu, plan, world)?),
            near,
            inside: Dipoles::new(gpu, plan, world)?,
            gather,
            made: MadeOfCaches::default(),
        })
    }
}
