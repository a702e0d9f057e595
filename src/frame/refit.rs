//! Before stage 1, after poses: triangles of meshes that bend and the boxes about them, for rays. METHOD 11.

use super::world::World;
use crate::error::Result;
use crate::gpu::{Cmd, Gpu, Pipeline, Use};
use crate::shared::{DEFORM_ROW, RefitPush};

/// Nodes of a workgroup.
const GROUP: u32 = 64;

/// Fits hierarchies to what bends.
pub struct Refit(Pipeline);

impl Refit {
    /// Makes the pipeline.
    ///
    /// # Errors
    /// A driver that refuses the shader.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self(gpu.compute("refit.comp", &[])?))
    }

    /// Records the pass, where rays have been asked for; posed vertices have been waited for.
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
