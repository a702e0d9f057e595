//! Stage 5, second half, cull: visible vertices -> the caches that the gather has to light. METHOD 9, thesis 6.1.3.
//!
//! A cache matters where a visible triangle's corner refers to it, on whatever side of the model it lies. The fragment
//! path draws each reference as a point into the depth of the atlas, the compute path flags it and closes up the list of
//! flagged caches. Both take the same references, but what they light may be more: the fragment path lights both caches
//! of a texel in which one is needed, clusters all of a group.

use super::gather::GatherPath;
use super::pack::PackCaches;
use super::targets::{CacheTargets, ValTargets, VisibleTargets};
use super::{SceneBuffers, Settings};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Depth, Gpu, Pipeline, Raster, Shape, Use};
use crate::shared::{AtlasPush, CLUSTER_GROUP, VisibleArgs};

/// Finds the live caches.
pub struct Cull {
    path: Path,
}

enum Path {
    /// Points into the mask.
    Fragment { histogram: Pipeline },
    /// Flags, and their list.
    Compute { flag: Pipeline, pack: Box<PackCaches> },
}

impl Cull {
    /// Makes the pipelines, for so many `references` of a visible vertex or cell.
    pub fn new(gpu: &Gpu, settings: &Settings, references: usize) -> Result<Self> {
        let references = references as u32;
        let path = match settings.gather.path {
            GatherPath::Fragment => Path::Fragment {
                histogram: gpu.raster(&Raster {
                    vertex: "histogram.vert",
                    fragment: None,
                    shape: Shape::Points,
                    streams: &[],
                    colors: &[],
                    blend: Blend::Replace,
                    depth: Depth::Nearest,
                    cull: crate::gpu::Cull::None,
                    constants: &[references],
                })?,
            },
            GatherPath::Compute => {
                let group = if settings.cluster.is_some() { CLUSTER_GROUP } else { 1 };
                let flag = gpu.compute("flag_caches.comp", &[references, group])?;
                Path::Compute { flag, pack: Box::new(PackCaches::new(gpu)?) }
            }
        };
        Ok(Self { path })
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
        let references = [(&visible.list).into(), (&scene.draw_records).into(), (&scene.references).into()];
        match &self.path {
            Path::Fragment { histogram } => {
                let mask = caches.mask.as_ref().expect("of this path");
                cmd.barrier(Use::ComputeWrite, Use::IndirectRead | Use::VertexRead); // visible vertices -> here
                let area = caches.area();
                cmd.render(&Attachments { colors: &[], depth: Some(Attach::clear(mask)), area }, |draw| {
                    draw.bind(histogram, &references);
                    draw.push(&AtlasPush { columns: caches.columns(), rows: caches.rows() });
                    draw.draw_indirect(&visible.args);
                });
            }
            Path::Compute { flag, pack } => {
                let live = caches.live.as_ref().expect("of this path");
                cmd.barrier(Use::ComputeWrite, Use::IndirectRead | Use::ComputeRead); // visible vertices -> here
                let [list, draws, refs] = references;
                cmd.bind(flag, &[list, draws, refs, (&visible.args).into(), (&live.flags).into()]);
                cmd.dispatch_indirect(&visible.args, std::mem::offset_of!(VisibleArgs, groups_x) as u64);
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                pack.record(cmd, live, caches.light_count(vals));
            }
        }
    }
}
