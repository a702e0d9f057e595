//! Stage 3, cache atlas: model caches, instance transforms -> caches in the world. METHOD 1 and 9.

use super::SceneBuffers;
use super::targets::CacheTargets;
use crate::error::Result;
use crate::gpu::{Cmd, Gpu, Pipeline};
use crate::shared::PlacePush;

/// Places every instance's caches.
pub struct Atlas {
    pipeline: Pipeline,
}

impl Atlas {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self { pipeline: gpu.compute("atlas.comp", &[])? })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, scene: &SceneBuffers, caches: &CacheTargets) {
        let _zone = cmd.zone("atlas");
        cmd.bind(
            &self.pipeline,
            &[
                (&scene.model_caches).into(),
                (&scene.instances).into(),
                scene.indices().into(),
                (&scene.corners).into(),
                (&caches.atlas).into(),
            ],
        );
        cmd.push(&PlacePush { cache_count: caches.count });
        cmd.dispatch(caches.count, 1, 1);
    }
}
