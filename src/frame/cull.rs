//! Stage 5, second half, cull: finds the caches that the gather must light for the visible vertices. METHOD 9, thesis
//! 6.1.3.
//!
//! A cache is needed if a corner of a visible triangle references it, on whichever side of the model it lies. Such
//! caches are flagged. The compute path compacts the flagged caches into a list. The fragment path flags texels of the
//! atlas, each with two caches, and draws every flagged texel as a point into the atlas's depth. It therefore lights
//! both caches of a texel if one is needed, as the cluster path lights whole groups.

use super::gather::Gather;
use super::gather_draws::Draws;
use super::pack::PackCaches;
use super::vals::Vals;
use super::visible::VisibleList;
use super::world::World;
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Buffer, Cmd, Depth, Device, Pipeline, Raster, Shape, Use};
use crate::shared::{AtlasPush, TEXEL_CACHES, VisibleArgs};

/// Finds the live caches.
pub struct Cull {
    flag: Pipeline,
    close_up: CloseUp,
}

/// How flags become the set of caches that the gather lights.
enum CloseUp {
    /// Points are drawn into the mask.
    Mask { histogram: Pipeline },
    /// Flagged items are compacted into a list.
    List { pack: Box<PackCaches> },
}

impl Cull {
    /// Creates the pipelines. `references` is the number of references of a vertex or cell.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn new(gpu: &Device, gather: &Gather, references: usize) -> Result<Self> {
        assert!(references.is_multiple_of(2), "references are read in pairs");
        let (group, close_up) = match gather.live() {
            None => {
                let histogram = gpu.raster(&Raster {
                    vertex: "histogram.vert",
                    fragment: None,
                    shape: Shape::Points,
                    streams: &[],
                    colors: &[],
                    blend: Blend::Replace,
                    depth: Depth::Nearest,
                    cull: crate::gpu::Cull::None,
                    multisampled: false,
                    constants: &[],
                })?;
                (TEXEL_CACHES, CloseUp::Mask { histogram })
            }
            Some(live) => (live.group, CloseUp::List { pack: Box::new(PackCaches::new(gpu)?) }),
        };
        Ok(Self { flag: gpu.compute("flag_caches.comp", &[references as u32, group])?, close_up })
    }

    /// Records the stage for all views. Their lists must be complete.
    pub fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        views: impl Iterator<Item = &'a VisibleList> + Clone,
        vals: &Vals,
        gather: &Gather,
    ) {
        match (&self.close_up, gather, gather.live()) {
            (CloseUp::Mask { histogram }, Gather::Draws(draws), _) => {
                self.record_mask(cmd, world, views, draws, histogram);
            }
            (CloseUp::List { pack }, _, Some(live)) => {
                self.flag(cmd, world, views, &live.flags);
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                pack.record(cmd, live, gather.light_count(vals));
            }
            _ => {}
        }
    }

    /// Flags all caches that the visible vertices or cells of any view reference.
    fn flag<'a>(&self, cmd: &Cmd<'_>, world: &World, views: impl Iterator<Item = &'a VisibleList>, flags: &Buffer) {
        for (i, visible) in views.enumerate() {
            if i > 0 {
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // flags
            }
            let references = [&visible.list, &world.draw_records, &world.references, &visible.args, flags];
            cmd.bind(&self.flag, &references.map(Into::into));
            cmd.dispatch_indirect(&visible.args, std::mem::offset_of!(VisibleArgs, groups_x) as u64);
        }
    }

    fn record_mask<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        views: impl Iterator<Item = &'a VisibleList>,
        draws: &Draws,
        histogram: &Pipeline,
    ) {
        let Some(mask) = &draws.mask else { return };
        cmd.clear(&mask.flags);
        cmd.barrier(Use::CopyWrite, Use::ComputeRead | Use::ComputeWrite); // cleared flags
        self.flag(cmd, world, views, &mask.flags);
        cmd.barrier(Use::ComputeWrite, Use::VertexRead);
        let (texels, depth) = (draws.texels, Some(Attach::clear(&mask.image)));
        cmd.render(&Attachments { colors: &[], depth, area: texels.area() }, |draw| {
            draw.bind(histogram, &[(&mask.flags).into()]);
            draw.push(&AtlasPush { columns: texels.columns(), rows: texels.rows() });
            draw.draw(texels.count());
        });
    }
}
