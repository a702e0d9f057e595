//! Before stage 1: poses deformed meshes by morphing and skinning, as glTF defines them (METHOD 8). Only vertices are
//! posed; caches follow the triangles they lie on (`atlas.comp`). Every instance has its own posed vertices, which all
//! stages then draw like any others.

use super::world::World;
use super::world::deform::Blocks;
use crate::error::Result;
use crate::gpu::{Bind, Cmd, Device, Pipeline, Use};
use crate::shared::{DEFORM_ROW, DeformPush};

/// Vertices, or followers, per workgroup.
const GROUP: u32 = 64;

/// Poses deformed meshes.
pub struct Poses {
    deform: Pipeline,
    follow: Pipeline,
}

impl Poses {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn new(gpu: &Device) -> Result<Self> {
        Ok(Self { deform: gpu.compute("deform.comp", &[])?, follow: gpu.compute("follow.comp", &[])? })
    }

    /// Records the pass for all deformed instances.
    pub fn record(&self, cmd: &Cmd<'_>, world: &World) {
        let Some(bodies) = &world.deform else { return };
        let _zone = cmd.zone("deform");
        let blocks = &bodies.bind_blocks;
        cmd.bind(
            &self.deform,
            &[
                (&blocks.buffer).into(),
                (&bodies.bodies).into(),
                (&bodies.bind).into(),
                (&bodies.influences).into(),
                (&bodies.displacements).into(),
                (&bodies.joints).into(),
                (&bodies.weights).into(),
                world.vertices().into(),
                (&world.corners).into(),
            ],
        );
        dispatch(cmd, blocks);
        let blocks = &bodies.follower_blocks;
        if blocks.count > 0 {
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            let resources: [Bind<'_>; 6] = [
                (&blocks.buffer).into(),
                (&bodies.bodies).into(),
                (&bodies.followers).into(),
                (&bodies.bind).into(),
                world.vertices().into(),
                (&world.corners).into(),
            ];
            cmd.bind(&self.follow, &resources);
            dispatch(cmd, blocks);
        }
    }
}

fn dispatch(cmd: &Cmd<'_>, blocks: &Blocks) {
    cmd.push(&DeformPush { block_count: blocks.count });
    cmd.dispatch(GROUP * blocks.count.min(DEFORM_ROW), blocks.count.div_ceil(DEFORM_ROW), 1);
}
