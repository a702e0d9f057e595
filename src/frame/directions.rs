//! Stage 6, after the gather: computes the radiance that reaches each cache from a set of directions, and lists where
//! most of it comes from. METHOD 11.
//!
//! A proxy describes this light by a single position. Short rays block some directions and leave others open, so they
//! need the light along each direction.

use super::bounce::Bounces;
use super::depth_images::{DepthImages, are_texels, binds};
use super::live::Live;
use super::proxies::Lit;
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{DIRECTIONS, DirectionsPush, GUIDE_WORDS, LiveArgs, VAL_TILE, Val};
use std::mem::offset_of;

/// Threads per cache on a GPU. Software devices have as many lanes as there are maps, which then need not take turns.
const THREADS: u32 = 128;

/// Radiance at caches by direction.
pub(super) struct Directions {
    /// Incoming radiance \[cd/m^2\], packed, `DIRECTIONS` values per cache.
    pub(super) radiances: Buffer,
    /// What guides the rays of pixels, `GUIDE_WORDS` values per cache.
    pub(super) guides: Buffer,
    pipeline: Pipeline,
    guide: Pipeline,
    /// Squared distances between which VALs fade in [m^2].
    pub(super) fade: [f32; 2],
    /// Consecutive VALs that are treated as one.
    together: u32,
}

impl Directions {
    /// Creates the pass for this many caches and VALs, for a gather with or without shadows of every VAL, further
    /// bounces, and lobes of VALs. VALs nearer than `near` \[m\] are left to rays. `together` consecutive VALs have one
    /// direction.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shader.
    pub(super) fn new(
        gpu: &Device,
        [caches, vals]: [u32; 2],
        [shadowed, bounces, lobes, sky]: [bool; 4],
        near: f32,
        together: u32,
    ) -> Result<Self> {
        let bytes = u64::from(caches.max(1)) * u64::from(4 * DIRECTIONS);
        let vals_bytes = u64::from(vals.max(caches).next_multiple_of(VAL_TILE)) * size_of::<Val>() as u64;
        let [vals, images] = [gpu.reads_texels(vals_bytes), are_texels(gpu, caches, true)].map(u32::from);
        let constants = [if gpu.is_software() { 8 } else { THREADS }, vals, u32::from(lobes), images];
        let name = match (shadowed, bounces) {
            (false, false) => "directions.comp",
            (true, false) => "directions_shadowed.comp",
            (false, true) => "directions_bounces.comp",
            (true, true) => "directions_shadowed_traced.comp",
        };
        Ok(Self {
            guides: gpu.buffer("directions.guides", u64::from(caches.max(1)) * u64::from(4 * GUIDE_WORDS))?,
            radiances: gpu.buffer("directions.radiances", bytes)?,
            pipeline: gpu.compute(name, &constants[..3 + usize::from(shadowed)])?,
            guide: gpu.compute(if sky { "guides_sky.comp" } else { "guides.comp" }, &[])?,
            fade: [0.8, 1.2].map(|share| (share * near).powi(2)),
            together,
        })
    }

    /// Records the pass for the result of a gather, whose sums are `parts`.
    pub(super) fn record(
        &self,
        cmd: &Cmd<'_>,
        lit: &Lit<'_>,
        live: &Live,
        bounces: Option<&Bounces>,
        images: Option<&DepthImages>,
        parts: &Buffer,
    ) {
        let vals = lit.vals;
        let caches = [&lit.atlas.caches, &live.list, &live.args, &vals.live_count, &vals.live];
        let mut resources = caches.map(Bind::from).to_vec();
        resources.extend([Bind::SomeTexels(&vals.live), (&self.radiances).into()]);
        resources.extend(images.iter().flat_map(|images| binds(&images.buffer)));
        if let Some(Bounces { vals, val_count, scales, .. }) = bounces {
            match images.and_then(|images| images.sent_on.as_ref()) {
                Some(sent_on) => resources.extend([vals, &sent_on.far_met, parts].map(Bind::from)),
                None => resources.extend([val_count.into(), vals.into(), Bind::SomeTexels(vals), scales.into()]),
            }
        }
        cmd.bind(&self.pipeline, &resources);
        let [begin, end] = self.fade;
        cmd.push(&DirectionsPush { near_begin: begin, near_scale: 1.0 / (end - begin), together: self.together });
        cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead); // radiances
        let caches = [&lit.atlas.caches, &live.list, &live.args, &self.radiances, &self.guides];
        let sky = lit.sky.iter().flat_map(|sky| [sky.open, sky.texels, sky.levels]);
        cmd.bind(&self.guide, &caches.into_iter().chain(sky).map(Bind::from).collect::<Vec<_>>());
        cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
    }
}
