//! Before stages 1 and 4: finds the triangles that a view may show. METHOD 9. The vertices of all others are not
//! shaded: their indices are replaced in a list of the view's own. Triangles keep their order and number, so no pixel
//! changes.

use super::world::World;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{CullTrianglesPush, DEFORM_ROW};
use glam::{Mat4, Vec2};

/// Threads per workgroup.
const GROUP: u32 = 64;

/// Culls triangles for one view at a time.
pub(super) struct TriangleCulling {
    cull: Pipeline,
    pub(super) shown: Buffer,
    /// Whether the passes that draw from it show front faces only.
    backs: bool,
}

impl TriangleCulling {
    /// Creates the pipeline and a list; `None` if the scene has so few triangles that culling does not pay. `backs`
    /// says that back faces are not drawn.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shader.
    pub(super) fn new(gpu: &Gpu, world: &World, name: &str, backs: bool) -> Result<Option<Self>> {
        let Some(blocks) = &world.cull_blocks else { return Ok(None) };
        let shown = gpu.buffer(name, 4 * u64::from(blocks.indices))?;
        Ok(Some(Self { cull: gpu.compute("cull_triangles.comp", &[])?, shown, backs }))
    }

    /// Lists the triangles that a view of this size \[pixels\] may show: all, or those of opaque and masked surfaces.
    /// If the list was drawn from before in this frame, `again` must be set. Returns the list for `World::draw`.
    pub(super) fn record(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        clip_from_world: Mat4,
        size: [u32; 2],
        (solid, again): (bool, bool),
    ) -> &Buffer {
        let Some(blocks) = &world.cull_blocks else { return &self.shown };
        if again {
            cmd.barrier(Use::IndexRead, Use::ComputeWrite);
        }
        let resources = [&blocks.list, &world.draw_records, &world.instances, world.vertices(), world.indices()];
        let mut resources = resources.map(Into::into).to_vec();
        resources.push((&self.shown).into());
        cmd.bind(&self.cull, &resources);
        let block_count = if solid { blocks.solid } else { blocks.all };
        let half_size = 0.5 * Vec2::new(size[0] as f32, size[1] as f32);
        cmd.push(&CullTrianglesPush { clip_from_world, half_size, block_count, backs: u32::from(self.backs) });
        cmd.dispatch(GROUP * block_count.min(DEFORM_ROW), block_count.div_ceil(DEFORM_ROW), 1);
        cmd.barrier(Use::ComputeWrite, Use::IndexRead);
        &self.shown
    }
}
