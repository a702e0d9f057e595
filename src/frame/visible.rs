//! Stage 5, first half: lists the visible vertices, or cells of surfaces, for stages 5, 6 and 8. METHOD 9. Every view
//! has its own list; culling flags the union.

use super::plan::Plan;
use super::view::View;
use super::world::World;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Device, Image, Pipeline, Use};
use crate::shared::{VertexLight, VisibleArgs, VisibleCellsPush, VisiblePush, VisibleVertex};
use glam::Vec3;
use std::cell::Cell;

/// Vertices of the triangles in a view's pixels, or cells of the visible surfaces.
pub struct VisibleList {
    /// For each vertex or cell of each instance, the last frame in which it was visible.
    pub seen: Buffer,
    /// Index in `list` for each vertex. With cells, the cell's row of references for each pixel.
    pub slots: Buffer,
    /// Visible vertices or cells, each once.
    pub list: Buffer,
    /// Averaged lights of vertices.
    pub lights: Buffer,
    /// Share of the sky's light at vertices; only where caches see it, without short rays and without cells.
    pub sky_lights: Option<Buffer>,
    /// Irradiance from below at vertices; only with translucent bodies, and without cells.
    pub below: Option<Buffer>,
    /// Length of the list.
    pub args: Buffer,
    /// `args` of an empty list.
    none: Buffer,
    /// Number of the next frame. Marks of earlier frames need no clearing.
    frame: Cell<u32>,
}

impl VisibleList {
    /// Creates a list for a picture of this size.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn new(gpu: &Device, world: &World, plan: &Plan, [w, h]: [u32; 2]) -> Result<Self> {
        let all = u64::from(world.slot_count.max(1));
        let pixels = u64::from(w) * u64::from(h);
        let by_cells = world.cells.is_some();
        let most = all.min(3 * pixels);
        let none = VisibleArgs { groups_y: 1, groups_z: 1, ..VisibleArgs::default() };
        Ok(Self {
            seen: gpu.buffer_from("visible.seen", &vec![0_u32; all as usize])?,
            slots: gpu.buffer("visible.slots", 4 * if by_cells { pixels } else { all })?,
            list: gpu.buffer("visible.list", most * size_of::<VisibleVertex>() as u64)?,
            lights: gpu.buffer("visible.lights", if by_cells { 1 } else { most } * size_of::<VertexLight>() as u64)?,
            sky_lights: (plan.sky_at_vertices() && !by_cells)
                .then(|| gpu.buffer("visible.sky_lights", most * size_of::<Vec3>() as u64))
                .transpose()?,
            below: (plan.inside && !by_cells)
                .then(|| gpu.buffer("visible.below", most * size_of::<Vec3>() as u64))
                .transpose()?,
            args: gpu.buffer("visible.args", size_of::<VisibleArgs>() as u64)?,
            none: gpu.buffer_from("visible.none", &[none])?,
            frame: Cell::new(1),
        })
    }
}

/// Lists the corners of visible triangles, or the cells in which pixels look up references.
pub struct Visible {
    vertices: Pipeline,
    cells: Pipeline,
}

impl Visible {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn new(gpu: &Device) -> Result<Self> {
        Ok(Self { vertices: gpu.compute("visible.comp", &[])?, cells: gpu.compute("visible_cells.comp", &[])? })
    }

    /// Records the pass for views, their element images and their lists.
    pub fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        views: impl Iterator<Item = (&'a View, &'a Image, &'a VisibleList)> + Clone,
    ) {
        for (.., out) in views.clone() {
            cmd.copy_buffer(&out.none, &out.args, size_of::<VisibleArgs>() as u64);
        }
        cmd.barrier(Use::CopyWrite | Use::ColorWrite, Use::ComputeRead | Use::ComputeWrite); // elements -> here
        for (view, elements, out) in views {
            let frame = out.frame.get();
            out.frame.set(frame.checked_add(1).unwrap_or(1));
            match &world.cells {
                None => {
                    cmd.bind(
                        &self.vertices,
                        &[
                            elements.into(),
                            (&world.draw_records).into(),
                            world.indices().into(),
                            (&out.seen).into(),
                            (&out.slots).into(),
                            (&out.list).into(),
                            (&out.args).into(),
                        ],
                    );
                    cmd.push(&VisiblePush { frame });
                }
                Some(cells) => {
                    cmd.bind(
                        &self.cells,
                        &[
                            elements.into(),
                            (&world.draw_records).into(),
                            world.indices().into(),
                            (&world.instances).into(),
                            (&world.corners).into(),
                            (&cells.grids).into(),
                            (&cells.entries).into(),
                            (&out.seen).into(),
                            (&out.list).into(),
                            (&out.args).into(),
                            (&out.slots).into(),
                        ],
                    );
                    cmd.push(&VisibleCellsPush { clip_from_world: view.clip_from_world, frame });
                }
            }
            cmd.dispatch(elements.width, elements.height, 1);
        }
    }
}
