//! Stage 6, before the gather: discs of all caches -> what each live cache sees of them. METHOD 6, "beyond the print".
//!
//! An image holds where a cache's view ends, on the unit disc of `Proj`, eq. 5.60. The gather then leaves out every VAL
//! that lies farther away: shadows get colour and several directions, and things in the way fuse.

use super::targets::CacheTargets;
use crate::error::Result;
use crate::gpu::{Cmd, Gpu, Pipeline};
use crate::shared::{DepthImagePush, LiveArgs};
use std::mem::offset_of;

/// Draws the images.
pub struct DepthImages {
    pipeline: Pipeline,
}

impl DepthImages {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self { pipeline: gpu.compute("depth_images.comp", &[])? })
    }

    /// Records the pass; atlas and list of live caches must be there.
    pub fn record(&self, cmd: &Cmd<'_>, caches: &CacheTargets) {
        let live = caches.live.as_ref().expect("of this path");
        let images = caches.depth_images.as_ref().expect("made for shadows");
        cmd.bind(&self.pipeline, &[(&caches.atlas).into(), (&live.list).into(), (&live.args).into(), images.into()]);
        cmd.push(&DepthImagePush { cache_count: caches.count });
        cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
    }
}
