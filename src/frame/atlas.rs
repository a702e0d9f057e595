//! Stage 3, cache atlas: model caches, instance transforms -> caches in the world. METHOD 1 and 9.

use super::world::World;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Gpu, Pipeline};
use crate::shared::{Cache, PlacePush};

/// The caches of all instances in the world.
pub struct Atlas {
    /// Every instance's, one after the other; at least one, so that it can be bound.
    pub caches: Buffer,
    /// How many.
    pub count: u32,
    pipeline: Pipeline,
}

impl Atlas {
    /// Makes room for this many caches.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn new(gpu: &Gpu, count: u32) -> Result<Self> {
        let caches = gpu.buffer("atlas.caches", u64::from(count.max(1)) * size_of::<Cache>() as u64)?;
        Ok(Self { caches, count, pipeline: gpu.compute("atlas.comp", &[])? })
    }

    /// The atlas of these caches, for callers that drive later stages themselves.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn of(gpu: &Gpu, caches: &[Cache]) -> Result<Self> {
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
