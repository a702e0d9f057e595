//! Stage 6, before the gather: rectangles of all caches -> what each live cache sees of them. METHOD 6, "beyond the print".
//!
//! An image holds where a cache's view ends, on the unit disc of `Proj`, eq. 5.60. The gather then leaves out every VAL
//! that lies farther away: shadows get colour and several directions, and things in the way fuse.

use super::occlude::Bound;
use super::targets::CacheTargets;
use crate::error::Result;
use crate::gpu::{Bind, Cmd, Gpu, Pipeline, Use};
use crate::shared::{DEPTH_IMAGE_TEXELS, DepthImagePush, LiveArgs, OCCLUDER_GROUP};
use std::mem::offset_of;

/// Draws the images.
pub struct DepthImages {
    bound: Bound,
    pipeline: Pipeline,
    /// Whether a thread draws an image, instead of a workgroup.
    alone: bool,
}

/// Rectangles that a thread draws at a time, in whole groups: older lavapipe leaves loops after 65 535 rounds, of groups,
/// rectangles and texels together, and a rectangle may have all texels.
const AT_ONCE: u32 = (65_535 / (DEPTH_IMAGE_TEXELS + 1) - 1) / OCCLUDER_GROUP * OCCLUDER_GROUP;

impl DepthImages {
    /// Makes the pipeline that suits the device.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Self::with(gpu, gpu.is_software())
    }

    /// Makes it for a thread an image, or a workgroup. The images are the same.
    pub fn with(gpu: &Gpu, alone: bool) -> Result<Self> {
        let name = if alone { "depth_images_alone.comp" } else { "depth_images.comp" };
        Ok(Self { bound: Bound::new(gpu)?, pipeline: gpu.compute(name, &[])?, alone })
    }

    /// Records the pass; atlas and list of live caches must be there.
    pub fn record(&self, cmd: &Cmd<'_>, caches: &CacheTargets) {
        let live = caches.live.as_ref().expect("of this path");
        let images = caches.depth_images.as_ref().expect("made for shadows");
        let groups = self.bound.record(cmd, caches);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let resources = [
            (&caches.atlas).into(),
            (&live.list).into(),
            (&live.args).into(),
            groups.into(),
            Bind::Texels(&caches.atlas),
            images.into(),
        ];
        let push = DepthImagePush { cache_count: caches.count, first: 0, count: AT_ONCE };
        if !self.alone {
            cmd.bind(&self.pipeline, &resources);
            cmd.push(&push);
            cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
            return;
        }
        for first in (0..caches.count).step_by(AT_ONCE as usize) {
            if first > 0 {
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            }
            cmd.bind(&self.pipeline, &resources);
            cmd.push(&DepthImagePush { first, ..push });
            cmd.dispatch(caches.count, 1, 1);
        }
    }
}
