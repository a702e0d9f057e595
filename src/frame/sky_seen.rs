//! Stage 6, last: depth images, a sky -> what each live cache sees of it. METHOD 12.
//!
//! A cache sees the sky where its image shows nothing. What it keeps is a share: what arrives of all that an open surface would
//! receive. Pixels know the latter exactly, by their own normals.

use super::atlas::Atlas;
use super::depth_images::DepthImages;
use super::live::Live;
use super::near::CACHE_REACH;
use super::plan::Plan;
use super::settings::Near;
use super::world::{SkyLight, World};
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{LiveArgs, SkySeenPush};
use glam::Vec3;
use std::mem::offset_of;

/// What caches see of the sky, and the pass that finds it.
pub struct SkySeen {
    /// Of each cache the share of the sky's light that arrives.
    pub seen: Buffer,
    /// Images of its own, where the gather's are others.
    images: Option<DepthImages>,
    pipeline: Pipeline,
}

impl SkySeen {
    /// Makes what a plan needs for a world with rays.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shader.
    pub(super) fn new(gpu: &Gpu, world: &World, plan: &Plan) -> Result<Option<Self>> {
        if !plan.sky_light {
            return Ok(None);
        }
        let near = plan.near != Near::Off;
        // Without short rays caches see all that there is.
        let reach = if near { CACHE_REACH * world.spacing() } else { 0.0 };
        let shared = near && plan.depth_images;
        let count = world.cache_count.max(1) as usize;
        Ok(Some(Self {
            seen: gpu.buffer_from("gather.sky_seen", &vec![Vec3::ONE; count])?,
            images: (!shared).then(|| DepthImages::traced(gpu, world, reach, false)).transpose()?,
            pipeline: gpu.compute(if near { "sky_seen_directed.comp" } else { "sky_seen.comp" }, &[])?,
        }))
    }

    /// Records the pass for what a gather has just lit: with its images, and with its light by directions where rays ask for
    /// that. Images of its own are made first where they are `outdated`.
    pub(super) fn record(
        &self,
        cmd: &Cmd<'_>,
        (world, sky): (&World, &SkyLight),
        atlas: &Atlas,
        live: &Live,
        (images, radiances): (Option<&DepthImages>, Option<&Buffer>),
        outdated: bool,
    ) {
        let own = self.images.as_ref();
        let Some(images) = own.or(images) else { return };
        if outdated && own.is_some() {
            images.record(cmd, world, atlas, live);
        }
        if radiances.is_some() || (outdated && own.is_some()) {
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
        }
        let all = [&atlas.caches, &live.list, &live.args, &images.buffer, &sky.levels, &sky.texels, &self.seen];
        let mut resources = all.map(Bind::from).to_vec();
        resources.extend(radiances.map(Bind::from));
        cmd.bind(&self.pipeline, &resources);
        cmd.push(&SkySeenPush { least: sky.least });
        cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
    }
}
