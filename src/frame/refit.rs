//! Before stage 1, after posing: updates the triangles and BVH boxes of deformed meshes for rays. METHOD 11.

use super::world::World;
use crate::error::Result;
use crate::gpu::{Cmd, Device, Pipeline, Use};
use crate::shared::{DEFORM_ROW, RefitPush};

/// Nodes per workgroup.
const GROUP: u32 = 64;

/// Refits the BVHs of deformed meshes.
pub struct Refit(Pipeline);

impl Refit {
    /// Creates the pipeline.
    ///
    /// # Errors
    /// Fails if the driver rejects the shader.
    pub fn new(gpu: &Device) -> Result<Self> {
        Ok(Self(gpu.compute("refit.comp", &[])?))
    }

    /// Records the pass if rays have been requested. The caller must have waited for the posed vertices.
    pub fn record(&self, cmd: &Cmd<'_>, world: &World) {
        let Some((rays, refit)) = world.rays().and_then(|rays| Some((rays, rays.refit.as_ref()?))) else { return };
        let _zone = cmd.zone("refit");
        for (deeper, &[first, count]) in refit.depths.iter().enumerate() {
            if deeper > 0 {
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // children -> parents
            }
            cmd.bind(
                &self.0,
                &[
                    (&refit.list).into(),
                    world.vertices().into(),
                    world.indices().into(),
                    (&rays.nodes).into(),
                    (&rays.triangles).into(),
                    (&refit.boxes).into(),
                ],
            );
            cmd.push(&RefitPush { first, count, first_node: refit.first_node });
            let groups = count.div_ceil(GROUP);
            cmd.dispatch(GROUP * groups.min(DEFORM_ROW), groups.div_ceil(DEFORM_ROW), 1);
        }
    }
}
