//! Stage 6, before the gather: images of what each live cache sees of the scene. METHOD 6, "beyond the print".
//!
//! An image stores where a cache's view ends in each direction, on the unit disc of `Proj`, eq. 5.60. The gather then
//! leaves out every VAL that lies farther away. So shadows get colour and several directions, and occluders fuse.

use super::atlas::Atlas;
use super::live::Live;
use super::near::{CACHE_REACH, SEEN_LIFT};
use super::occlude::Bounds;
use super::world::World;
use crate::error::{Error, Result};
use crate::gpu::{Bind, Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{DEPTH_IMAGE_TEXELS, DepthImagePush, LiveArgs, OCCLUDER_GROUP, TraceImagesPush};
use std::mem::offset_of;

/// The images, and the passes that create them.
pub struct DepthImages {
    /// Where the view of each live cache ends, by slots of the list.
    pub buffer: Buffer,
    /// Separate images for the light that caches send on, if those differ: short rays at pixels see nearby surfaces
    /// themselves, but light between caches must account for such surfaces here.
    pub sent_on: Option<SentOn>,
    made: Made,
}

/// Everything that caches see around them, at all distances.
pub struct SentOn {
    /// Where the view of each live cache ends, by slots of the list.
    pub images: Buffer,
    /// For each texel of these images, the cache at the hit, or `NO_REFERENCES`.
    pub met: Buffer,
    /// The same for the rays of `DepthImages::buffer`, which start beyond the range of short rays.
    pub far_met: Buffer,
}

/// How the images are created.
enum Made {
    /// Drawn from the rectangles of all caches.
    Drawn {
        bounds: Bounds,
        pipeline: Pipeline,
        /// Whether one thread draws an image, instead of a workgroup.
        alone: bool,
    },
    /// Traced by rays through the scene.
    Traced {
        trace: Pipeline,
        /// Moves the planes back.
        margins: Pipeline,
        /// Distance at which rays start \[m\].
        reach: f32,
    },
}

/// Rectangles that a thread draws per dispatch, in whole groups. Older lavapipe leaves loops after 65 535 iterations,
/// counting groups, rectangles and texels together, and a rectangle may cover all texels.
const AT_ONCE: u32 = (65_535 / (DEPTH_IMAGE_TEXELS + 1) - 1) / OCCLUDER_GROUP * OCCLUDER_GROUP;

/// Bytes of the images of this many caches. A texel is a number where the images are drawn, and a plane, of twice the
/// size, where they are traced.
fn bytes(caches: u32, are_traced: bool) -> u64 {
    u64::from(caches) * u64::from(DEPTH_IMAGE_TEXELS) * if are_traced { 8 } else { 4 }
}

/// Whether shaders can read the images of this many caches from a texel buffer.
pub(super) fn are_texels(gpu: &Device, caches: u32, are_traced: bool) -> bool {
    bytes(caches, are_traced) / 16 <= gpu.most_texels()
}

/// Bindings for `lib/sees.glsl`, which can read the images either way.
pub(super) fn binds(images: &Buffer) -> [Bind<'_>; 2] {
    [Bind::SomeTexels(images), images.into()]
}

impl DepthImages {
    /// Images of this many caches, drawn in the way that suits the device.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, caches: u32) -> Result<Self> {
        Self::with(gpu, caches, gpu.is_software())
    }

    /// Images drawn by one thread each (`alone`) or by one workgroup each. The results are identical.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn with(gpu: &Device, caches: u32, alone: bool) -> Result<Self> {
        let name = if alone { "depth_images_alone.comp" } else { "depth_images.comp" };
        let buffer = gpu.buffer("gather.depth_images", bytes(caches.max(1), false))?;
        let pipeline = gpu.compute(name, &[])?;
        Ok(Self { buffer, sent_on: None, made: Made::Drawn { bounds: Bounds::new(gpu, caches)?, pipeline, alone } })
    }

    /// Images traced by rays, which show the scene beyond the range of short rays. With `send_on`, caches also get
    /// images of everything that they see, for the light they send on.
    ///
    /// # Errors
    /// As `new`. Also fails for a world without rays.
    pub(super) fn traced(gpu: &Device, world: &World, send_on: bool) -> Result<Self> {
        let rays = world.rays().ok_or_else(|| Error::Nothing("the world has no rays".into()))?;
        let caches = world.cache_count.max(1);
        let (planes, met) = (bytes(caches, true), 4 * u64::from(caches) * u64::from(DEPTH_IMAGE_TEXELS));
        let name = if send_on { "trace_images_sent_on.comp" } else { "trace_images.comp" };
        let [stack, levels, texels, holes] = rays.constants(gpu);
        let by_cells = u32::from(world.references_of_pixels().is_some());
        let constants = [stack, levels, texels, holes, world.references_each as u32, by_cells];
        let trace = gpu.compute(name, &constants[..if send_on { 6 } else { 4 }])?;
        let margins = gpu.compute("image_margins.comp", &[])?;
        let made = Made::Traced { trace, margins, reach: (CACHE_REACH * world.spacing()) as f32 };
        let sent_on = || -> Result<SentOn> {
            Ok(SentOn {
                images: gpu.buffer("gather.sent_on_images", planes)?,
                met: gpu.buffer("gather.met", met)?,
                far_met: gpu.buffer("gather.far_met", met)?,
            })
        };
        let sent_on = send_on.then(sent_on).transpose()?;
        Ok(Self { buffer: gpu.buffer("gather.depth_images", planes)?, sent_on, made })
    }

    /// Whether rays trace the images: their texels are planes.
    pub fn are_traced(&self) -> bool {
        matches!(self.made, Made::Traced { .. })
    }

    /// Records the pass. The atlas and the list of live caches must be complete.
    pub fn record(&self, cmd: &Cmd<'_>, world: &World, atlas: &Atlas, live: &Live) {
        match &self.made {
            Made::Drawn { bounds, pipeline, alone } => self.draw(cmd, atlas, live, (bounds, pipeline, *alone)),
            Made::Traced { trace, margins, reach } => {
                self.trace(cmd, world, atlas, live, (trace, *reach));
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                cmd.bind(margins, &[&atlas.caches, &live.list, &live.args, &self.buffer].map(Bind::from));
                cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
                if let Some(SentOn { images, .. }) = &self.sent_on {
                    cmd.bind(margins, &[&atlas.caches, &live.list, &live.args, images].map(Bind::from));
                    cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
                }
            }
        }
    }

    fn trace(&self, cmd: &Cmd<'_>, world: &World, atlas: &Atlas, live: &Live, (pipeline, reach): (&Pipeline, f32)) {
        let Some(rays) = world.rays() else { return };
        let mut resources = rays.binds(world).to_vec();
        resources.extend([&atlas.caches, &live.list, &live.args, &self.buffer].map(Bind::from));
        if let Some(SentOn { images, met, far_met }) = &self.sent_on {
            let (grids, entries) =
                world.cells.as_ref().map_or((&world.references, &world.references), |c| (&c.grids, &c.entries));
            let of_caches = [images, met, far_met, &world.references, &world.instance_caches, grids, entries];
            resources.extend(of_caches.map(Bind::from));
            resources.push(Bind::SomeTexels(&atlas.caches));
        }
        cmd.bind(pipeline, &resources);
        let cache_reach = world.cells.as_ref().map_or(world.spacing(), |cells| cells.reach) as f32;
        let seen_lift = (SEEN_LIFT * world.spacing()) as f32;
        cmd.push(&TraceImagesPush { reach, cache_reach, seen_lift, root: rays.root });
        cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
    }

    /// Draws the images from the rectangles of all caches.
    pub fn draw(
        &self,
        cmd: &Cmd<'_>,
        atlas: &Atlas,
        live: &Live,
        (bounds, pipeline, alone): (&Bounds, &Pipeline, bool),
    ) {
        bounds.record(cmd, atlas);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let resources = [
            (&atlas.caches).into(),
            (&live.list).into(),
            (&live.args).into(),
            (&bounds.groups).into(),
            Bind::Texels(&atlas.caches),
            (&self.buffer).into(),
        ];
        let push = DepthImagePush { cache_count: atlas.count, first: 0, count: AT_ONCE };
        if !alone {
            cmd.bind(pipeline, &resources);
            cmd.push(&push);
            cmd.dispatch_indirect(&live.args, offset_of!(LiveArgs, images_x) as u64);
            return;
        }
        for first in (0..atlas.count).step_by(AT_ONCE as usize) {
            if first > 0 {
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            }
            cmd.bind(pipeline, &resources);
            cmd.push(&DepthImagePush { first, ..push });
            cmd.dispatch(atlas.count, 1, 1);
        }
    }
}
