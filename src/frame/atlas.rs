//! Stage 3, cache atlas: transforms the caches of all instances from model space into the world. METHOD 1 and 9.

use super::world::World;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Device, Pipeline};
use crate::shared::{Cache, PlacePush};

/// The caches of all instances in the world.
pub struct Atlas {
    /// The caches of all instances in order. At least one element, so that the buffer can be bound.
    pub caches: Buffer,
    /// Number of caches.
    pub count: u32,
    pipeline: Pipeline,
}

impl Atlas {
    /// Creates a buffer for this many caches, and the pipeline.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, count: u32) -> Result<Self> {
        let caches = gpu.buffer("atlas.caches", u64::from(count.max(1)) * size_of::<Cache>() as u64)?;
        Ok(Self { caches, count, pipeline: gpu.compute("atlas.comp", &[])? })
    }

    /// Creates an atlas with these caches, for callers that run later stages themselves.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn of(gpu: &Device, caches: &[Cache]) -> Result<Self> {
        Ok(Self { caches: gpu.buffer_from("atlas.caches", caches)?, ..Self::new(gpu, caches.len() as u32)? })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, world: &World) {
        cmd.bind(
            &self.pipeline,
            &[
                (&world.model_caches).into(),
                (&world.instances).into(),
                world.indices().into(),
                (&world.corners).into(),
                (&self.caches).into(),
            ],
        );
        cmd.push(&PlacePush { cache_count: self.count });
        cmd.dispatch(self.count, 1, 1);
    }
}
