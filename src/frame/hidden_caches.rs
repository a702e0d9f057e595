//! Stage 3, end: finds caches in gaps and inside other bodies, which no light reaches and no eye sees. METHOD 8.
//!
//! They would be dark neighbours of visible caches: under a body that stands on a floor, they darken the floor around it.
//! The bake removes those between static things. This pass finds the others, in each frame that moves something.

use super::atlas::Atlas;
use super::plan::Plan;
use super::settings::Near;
use super::world::World;
use crate::bake::closed::GAP;
use crate::error::Result;
use crate::gpu::{Cmd, Device, Pipeline, Use};
use crate::shared::{DEPTH_IMAGE_ROW, HIDDEN_RAYS, HiddenPush};

/// The pass that takes the normals of hidden caches: all their rays but one end in a gap or behind another surface.
pub struct HiddenCaches {
    pipeline: Pipeline,
    /// Distance below which a surface closes a gap \[m\].
    gap: f32,
}

impl HiddenCaches {
    /// Creates the pass if the plan traces rays from caches.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shader.
    pub(super) fn new(gpu: &Device, world: &World, plan: &Plan) -> Result<Option<Self>> {
        let Some(rays) = world.rays().filter(|_| plan.near != Near::Off || plan.sky_light) else { return Ok(None) };
        let pipeline = gpu.compute("hidden_caches.comp", &rays.constants(gpu))?;
        Ok(Some(Self { pipeline, gap: (GAP * world.spacing()) as f32 }))
    }

    /// Records the pass, right after the caches are placed.
    pub(super) fn record(&self, cmd: &Cmd<'_>, world: &World, atlas: &Atlas) {
        let Some(rays) = world.rays() else { return };
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // caches, ray hierarchies -> here
        let mut resources = rays.binds(world).to_vec();
        resources.push((&atlas.caches).into());
        cmd.bind(&self.pipeline, &resources);
        cmd.push(&HiddenPush { cache_count: atlas.count, root: rays.root, gap: self.gap });
        let columns = atlas.count.min(DEPTH_IMAGE_ROW);
        cmd.dispatch(HIDDEN_RAYS * columns, atlas.count.div_ceil(DEPTH_IMAGE_ROW), 1);
    }
}
