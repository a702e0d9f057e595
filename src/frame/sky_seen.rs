//! Stage 6, first part: finds how much of the sky each cache sees. METHOD 12.
//!
//! A cache sees the sky where its rays hit nothing. It stores a share: the light that arrives, relative to that on an
//! open surface. Pixels compute the light on an open surface exactly, with their own normals. Since only moving objects
//! change the shares, all caches have them, live or not.

use super::atlas::Atlas;
use super::depth_images::SentOn;
use super::near::CACHE_REACH;
use super::plan::Plan;
use super::settings::Near;
use super::world::{SkyLight, World};
use crate::error::{Error, Result};
use crate::gpu::{Bind, Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{DEPTH_IMAGE_ROW, DIRECTIONS, SkySeen, SkySeenPush};

/// The sky as caches see it, and the pass that computes it.
pub struct SkyOfCaches {
    /// One `SkySeen` per cache.
    pub seen: Buffer,
    /// Openness of each cache by direction, one byte each: the number of open parts of the direction, 0 to 4.
    pub open: Buffer,
    pipeline: Pipeline,
    /// Distance at which rays start \[m\].
    reach: f32,
}

impl SkyOfCaches {
    /// Creates the pass that a plan needs, with or without what the rays of depth images have met. The world must have
    /// rays.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shader.
    pub(super) fn new(gpu: &Device, world: &World, plan: &Plan, sent_on: Option<&SentOn>) -> Result<Option<Self>> {
        if !plan.sky_light {
            return Ok(None);
        }
        let rays = world.rays().ok_or_else(|| Error::Nothing("the world has no rays".into()))?;
        let count = u64::from(world.cache_count.max(1));
        Ok(Some(Self {
            seen: gpu.buffer("gather.sky_seen", count * size_of::<SkySeen>() as u64)?,
            open: gpu.buffer("gather.sky_open", count * u64::from(DIRECTIONS))?,
            pipeline: match sent_on {
                Some(_) => gpu.compute("sky_seen_met.comp", &[])?,
                None => gpu.compute("sky_seen.comp", &rays.constants(gpu))?,
            },
            // Without short rays, caches see everything at any distance.
            reach: if plan.near == Near::Off { 0.0 } else { (CACHE_REACH * world.spacing()) as f32 },
        }))
    }

    /// Records the pass. Caches must be complete, and so must `sent_on`, if it was given to `new`: both passes trace the
    /// same rays.
    pub(super) fn record(
        &self,
        cmd: &Cmd<'_>,
        (world, sky): (&World, &SkyLight),
        atlas: &Atlas,
        sent_on: Option<&SentOn>,
    ) {
        let Some(rays) = world.rays() else { return };
        let mut resources = if sent_on.is_some() { Vec::new() } else { rays.binds(world).to_vec() };
        resources.extend([&atlas.caches, &sky.texels, &sky.levels, &self.seen, &self.open].map(Bind::from));
        resources.extend(sent_on.iter().flat_map(|of| [&of.met, &of.far_met]).map(Bind::from));
        cmd.bind(&self.pipeline, &resources);
        let (cache_count, least) = (atlas.count, sky.least);
        cmd.push(&SkySeenPush { cache_count, root: rays.root, reach: self.reach, least });
        cmd.dispatch(64 * cache_count.min(DEPTH_IMAGE_ROW), cache_count.div_ceil(DEPTH_IMAGE_ROW), 1);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
    }
}
