//! Stage 6, before the gather: rectangles of all caches -> what each live cache sees of them. METHOD 6, "beyond the print".
//!
//! An image holds where a cache's view ends, on the unit disc of `Proj`, eq. 5.60. The gather then leaves out every VAL
//! that lies farther away: shadows get colour and several directions, and things in the way fuse.

use super::atlas::Atlas;
use super::live::Live;
use super::occlude::Bounds;
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{DEPTH_IMAGE_TEXELS, DepthImagePush, LiveArgs, OCCLUDER_GROUP};
use std::mem::offset_of;

/// The images, and what draws them.
pub struct DepthImages {
    /// Slot by slot of the list, where the view of a live cache ends.
    pub buffer: Buffer,
    bounds: Bounds,
    pipeline: Pipeline,
    /// Whether a thread draws an image, instead of a workgroup.
    alone: bool,
}

/// Rectangles that a thread draws at a time, in whole groups: older lavapipe leaves loops after 65 535 rounds, of groups,
/// rectangles and texels together, and a rectangle may have all texels.
const AT_ONCE: u32 = (65_535 / (DEPTH_IMAGE_TEXELS + 1) - 1) / OCCLUDER_GROUP * OCCLUDER_GROUP;

impl DepthImages {
    /// Of so many caches, drawn in the way that suits the device.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn new(gpu: &Gpu, caches: u32) -> Result<Self> {
        Self::with(gpu, caches, gpu.is_software())
    }

    /// Makes it for a thread an image, or a workgroup. The images are the same.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn with(gpu: &Gpu, caches: u32, alone: bool) -> Result<Self> {
        let name = if alone { "depth_images_alone.comp" } else { "depth_images.comp" };
        let bytes = u64::from(caches.max(1)) * u64::from(4 * DEPTH_IMAGE_TEXELS);
        let buffer = gpu.buffer("gather.depth_images", bytes)?;
        Ok(Self { buffer, bounds: Bounds::new(gpu, caches)?, pipeline: gpu.compute(name, &[])?, alone })
    }

    /// Records the pass; atlas and list of live caches must be there.
    pub fn record(&self, cmd: &Cmd<'_>, atlas: &Atlas, live: &Live) {
        self.bounds.record(cmd, atlas);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let resources = [
            (&atlas.caches).into(),
            (&live.list).into(),
            (&live.args).into(),
            (&self.bounds.groups).into(),
            Bind::Texels(&atlas.caches),
            (&self.buffer).into(),
        ];
        let push = DepthImagePush { cache_count: atlas.count, first: 0, count: AT_ONCE };
        if !self.alone {
            cmd.bind(&self.pipeline, &resources);
            cmd.push(&push);
            cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
            return;
        }
        for first in (0..atlas.count).step_by(AT_ONCE as usize) {
            if first > 0 {
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            }
            cmd.bind(&self.pipeline, &resources);
            cmd.push(&DepthImagePush { first, ..push });
            cmd.dispatch(atlas.count, 1, 1);
        }
    }
}
