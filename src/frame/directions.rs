//! Stage 6, after the gather: VALs x caches -> where the light of each cache comes from. METHOD 11.
//!
//! A proxy says it with one place. Short rays close some directions and leave others open, so they ask for the light along
//! each.

use super::gather::{Compute, Lit};
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Gpu, Pipeline};
use crate::shared::{DIRECTIONS, DirectionsPush, LiveArgs};
use std::mem::offset_of;

/// The light of caches by directions.
pub(super) struct Directions {
    /// Radiance that arrives \[cd/m^2\], packed, `DIRECTIONS` of each cache.
    pub(super) radiances: Buffer,
    pipeline: Pipeline,
}

impl Directions {
    /// Of so many caches, for a gather with shadows of every VAL or without, and with further bounces or without.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shader.
    pub(super) fn new(gpu: &Gpu, caches: u32, shadowed: bool, bounces: bool) -> Result<Self> {
        let bytes = u64::from(caches.max(1)) * u64::from(4 * DIRECTIONS);
        let name = match (shadowed, bounces) {
            (false, false) => "directions.comp",
            (true, false) => "directions_shadowed.comp",
            (false, true) => "directions_bounces.comp",
            (true, true) => "directions_shadowed_bounces.comp",
        };
        Ok(Self { radiances: gpu.buffer("directions.radiances", bytes)?, pipeline: gpu.compute(name, &[])? })
    }

    /// Records the pass for what a gather has just lit; `within` is where VALs fade in [m^2].
    pub(super) fn record(&self, cmd: &Cmd<'_>, lit: &Lit<'_>, gather: &Compute, [begin, end]: [f32; 2], together: u32) {
        let (live, vals) = (&gather.live, lit.vals);
        let caches = [&lit.atlas.caches, &live.list, &live.args, &vals.live_count, &vals.live, &self.radiances];
        let mut resources = caches.map(Bind::from).to_vec();
        if let Some(bounces) = &gather.bounces {
            resources.extend([&bounces.val_count, &bounces.vals, &bounces.scales].map(Bind::from));
        }
        resources.extend(gather.depth_images.as_ref().map(|images| Bind::Texels(&images.buffer)));
        cmd.bind(&self.pipeline, &resources);
        cmd.push(&DirectionsPush { near_begin: begin, near_scale: 1.0 / (end - begin), together });
        cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
    }
}
