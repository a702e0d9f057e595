//! Stage 6, first: caches, a sky -> what each sees of it. METHOD 12.
//!
//! A cache sees the sky where its rays meet nothing. What it keeps is a share: what arrives of all that an open surface would
//! receive. Pixels know the latter exactly, by their own normals. Only what moves changes it, so all caches have it, whether
//! they are live or not.

use super::atlas::Atlas;
use super::near::CACHE_REACH;
use super::plan::Plan;
use super::settings::Near;
use super::world::{SkyLight, World};
use crate::error::{Error, Result};
use crate::gpu::{Bind, Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{DEPTH_IMAGE_ROW, DIRECTIONS, SkySeen, SkySeenPush};

/// What caches see of the sky, and the pass that finds it.
pub struct SkyOfCaches {
    /// Of each cache a `SkySeen`.
    pub seen: Buffer,
    /// Of each cache how far it is open by directions, in 8 bits, of which 4 is all.
    pub open: Buffer,
    pipeline: Pipeline,
    /// Where rays begin \[m\].
    reach: f32,
}

impl SkyOfCaches {
    /// Makes what a plan needs for a world with rays.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shader.
    pub(super) fn new(gpu: &Gpu, world: &World, plan: &Plan) -> Result<Option<Self>> {
        if !plan.sky_light {
            return Ok(None);
        }
        let rays = world.rays().ok_or_else(|| Error::Nothing("the world has no rays".into()))?;
        let count = u64::from(world.cache_count.max(1));
        Ok(Some(Self {
            seen: gpu.buffer("gather.sky_seen", count * size_of::<SkySeen>() as u64)?,
            open: gpu.buffer("gather.sky_open", count * u64::from(DIRECTIONS))?,
            pipeline: gpu.compute("sky_seen.comp", &rays.constants(gpu))?,
            // Without short rays caches see all that there is.
            reach: if plan.near == Near::Off { 0.0 } else { (CACHE_REACH * world.spacing()) as f32 },
        }))
    }

    /// Records the pass; caches must be there.
    pub(super) fn record(&self, cmd: &Cmd<'_>, (world, sky): (&World, &SkyLight), atlas: &Atlas) {
        let Some(rays) = world.rays() else { return };
        let mut resources = rays.binds(world).to_vec();
        resources.extend([&atlas.caches, &sky.texels, &sky.levels, &self.seen, &self.open].map(Bind::from));
        cmd.bind(&self.pipeline, &resources);
        let (cache_count, least) = (atlas.count, sky.least);
        cmd.push(&SkySeenPush { cache_count, root: rays.root, reach: self.reach, least });
        cmd.dispatch(64 * cache_count.min(DEPTH_IMAGE_ROW), cache_count.div_ceil(DEPTH_IMAGE_ROW), 1);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
    }
}
