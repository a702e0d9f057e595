//! Stage 5, second half, cull: visible vertices -> the caches that the gather has to light. METHOD 9, thesis 6.1.3.
//!
//! A cache matters where a visible triangle's corner refers to it, on whatever side of the model it lies. These are
//! flagged. The compute path closes up the list of flagged caches; the fragment path flags texels of the atlas, of two caches
//! each, and draws each that is flagged as a point into the atlas's depth. So it lights both caches of a texel in which one is
//! needed, as clusters light all of a group.

use super::gather::GatherPath;
use super::pack::PackCaches;
use super::targets::{CacheTargets, ValTargets, VisibleTargets};
use super::{SceneBuffers, Settings};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Buffer, Cmd, Depth, Gpu, Pipeline, Raster, Shape, Use};
use crate::shared::{AtlasPush, CLUSTER_GROUP, TEXEL_CACHES, VisibleArgs};

/// Finds the live caches.
pub struct Cull {
    flag: Pipeline,
    path: Path,
}

enum Path {
    /// Points into the mask.
    Fragment { histogram: Pipeline },
    /// The list.
    Compute { pack: Box<PackCaches> },
}

impl Cull {
    /// Makes the pipelines, for so many `references` of a visible vertex or cell.
    pub fn new(gpu: &Gpu, settings: &Settings, references: usize) -> Result<Self> {
        assert!(references.is_multiple_of(2), "references are read in pairs");
        let (group, path) = match settings.gather.path {
            GatherPath::Fragment => {
                let histogram = gpu.raster(&Raster {
                    vertex: "histogram.vert",
                    fragment: None,
                    shape: Shape::Points,
                    streams: &[],
                    colors: &[],
                    blend: Blend::Replace,
                    depth: Depth::Nearest,
                    cull: crate::gpu::Cull::None,
                    constants: &[],
                })?;
                (TEXEL_CACHES, Path::Fragment { histogram })
            }
            GatherPath::Compute => {
                let group = if settings.cluster.is_some() { CLUSTER_GROUP } else { 1 };
                (group, Path::Compute { pack: Box::new(PackCaches::new(gpu)?) })
            }
        };
        Ok(Self { flag: gpu.compute("flag_caches.comp", &[references as u32, group])?, path })
    }

    /// Records the stage.
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        scene: &SceneBuffers,
        visible: &VisibleTargets,
        vals: &ValTargets,
        caches: &CacheTargets,
    ) {
        let _zone = cmd.zone("cull");
        let flag = |flags: &Buffer| {
            let references = [&visible.list, &scene.draw_records, &scene.references, &visible.args, flags];
            cmd.bind(&self.flag, &references.map(Into::into));
            cmd.dispatch_indirect(&visible.args, std::mem::offset_of!(VisibleArgs, groups_x) as u64);
        };
        match &self.path {
            Path::Fragment { histogram } => {
                let mask = caches.mask.as_ref().expect("of this path");
                let flags = caches.texel_flags.as_ref().expect("of this path");
                cmd.clear(flags);
                // Visible vertices -> here; flags that are not set.
                cmd.barrier(
                    Use::ComputeWrite | Use::CopyWrite,
                    Use::IndirectRead | Use::ComputeRead | Use::ComputeWrite,
                );
                flag(flags);
                cmd.barrier(Use::ComputeWrite, Use::VertexRead);
                let area = caches.area();
                cmd.render(&Attachments { colors: &[], depth: Some(Attach::clear(mask)), area }, |draw| {
                    draw.bind(histogram, &[flags.into()]);
                    draw.push(&AtlasPush { columns: caches.columns(), rows: caches.rows() });
                    draw.draw(caches.texels());
                });
            }
            Path::Compute { pack } => {
                let live = caches.live.as_ref().expect("of this path");
                cmd.barrier(Use::ComputeWrite, Use::IndirectRead | Use::ComputeRead); // visible vertices -> here
                flag(&live.flags);
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                pack.record(cmd, live, caches.light_count(vals));
            }
        }
    }
}
