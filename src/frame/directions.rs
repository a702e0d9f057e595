//! Stage 6, after the gather: VALs x caches -> where the light of each cache comes from. METHOD 11.
//!
//! A proxy says it with one place. Short rays close some directions and leave others open, so they ask for the light along
//! each.

use super::bounce::Bounces;
use super::depth_images::{DepthImages, are_texels, binds};
use super::live::Live;
use super::proxies::Lit;
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Gpu, Pipeline};
use crate::shared::{DIRECTIONS, DirectionsPush, LiveArgs};
use std::mem::offset_of;

/// The light of caches by directions.
pub(super) struct Directions {
    /// Radiance that arrives \[cd/m^2\], packed, `DIRECTIONS` of each cache.
    pub(super) radiances: Buffer,
    pipeline: Pipeline,
    /// Squared distances between which VALs begin to count [m^2].
    pub(super) fade: [f32; 2],
    /// VALs that are taken as one.
    together: u32,
}

impl Directions {
    /// For this many caches, and a gather with shadows of every VAL or without, and with further bounces or without. VALs nearer
    /// than `near` \[m\] are left to rays; so many in a row are taken as one.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shader.
    pub(super) fn new(
        gpu: &Gpu,
        caches: u32,
        [shadowed, bounces]: [bool; 2],
        near: f32,
        together: u32,
    ) -> Result<Self> {
        let bytes = u64::from(caches.max(1)) * u64::from(4 * DIRECTIONS);
        let constants = [u32::from(are_texels(gpu, caches))];
        let name = match (shadowed, bounces) {
            (false, false) => "directions.comp",
            (true, false) => "directions_shadowed.comp",
            (false, true) => "directions_bounces.comp",
            (true, true) => "directions_shadowed_bounces.comp",
        };
        Ok(Self {
            radiances: gpu.buffer("directions.radiances", bytes)?,
            pipeline: gpu.compute(name, &constants[..usize::from(shadowed)])?,
            fade: [0.8, 1.2].map(|share| (share * near).powi(2)),
            together,
        })
    }

    /// Records the pass for what a gather has just lit.
    pub(super) fn record(
        &self,
        cmd: &Cmd<'_>,
        lit: &Lit<'_>,
        live: &Live,
        bounces: Option<&Bounces>,
        images: Option<&DepthImages>,
    ) {
        let vals = lit.vals;
        let caches = [&lit.atlas.caches, &live.list, &live.args, &vals.live_count, &vals.live, &self.radiances];
        let mut resources = caches.map(Bind::from).to_vec();
        if let Some(bounces) = bounces {
            resources.extend([&bounces.val_count, &bounces.vals, &bounces.scales].map(Bind::from));
        }
        resources.extend(images.iter().flat_map(|images| binds(&images.buffer)));
        cmd.bind(&self.pipeline, &resources);
        let [begin, end] = self.fade;
        cmd.push(&DirectionsPush { near_begin: begin, near_scale: 1.0 / (end - begin), together: self.together });
        cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
    }
}
