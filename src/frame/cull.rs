//! Stage 5, cull: what pixels show -> the caches that the gather has to light. METHOD 9, thesis 6.1.3.
//!
//! A cache matters where a visible triangle's corner refers to it, on whatever side of the model it lies. Both paths of
//! the gather start from the list of visible elements: the fragment path draws each reference as a point into the depth
//! of the atlas, the compute path flags it and closes up the list of flagged caches. The set is the same.

use super::gather::GatherPath;
use super::pack::Pack;
use super::targets::{CacheTargets, ValTargets};
use super::{SceneBuffers, Settings};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Cmd, Depth, Gpu, Image, Pipeline, Raster, Shape, Use};
use crate::shared::{ATLAS_WIDTH, AtlasPush, CLUSTER_GROUP, ElementArgs};

/// Finds the live caches.
pub struct Cull {
    elements: Pipeline,
    path: Path,
}

enum Path {
    /// Points into the mask.
    Fragment { histogram: Pipeline },
    /// Flags, and their list.
    Compute { flag: Pipeline, pack: Pack },
}

impl Cull {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu, settings: &Settings) -> Result<Self> {
        let references = settings.references as u32;
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
                Path::Compute { flag: gpu.compute("flag_caches.comp", &[references, group])?, pack: Pack::new(gpu)? }
            }
        };
        Ok(Self { elements: gpu.compute("elements.comp", &[references])?, path })
    }

    /// Records the stage for all `views`, images of visible elements: a cache that one of them needs is live.
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        scene: &SceneBuffers,
        views: &[&Image],
        vals: &ValTargets,
        caches: &CacheTargets,
    ) {
        let _zone = cmd.zone("cull");
        let visible = caches.visible.as_ref().expect("culling has its targets");
        cmd.copy_buffer(&visible.none, &visible.args, size_of::<ElementArgs>() as u64);
        cmd.barrier(Use::CopyWrite | Use::ColorWrite, Use::ComputeRead | Use::ComputeWrite); // elements -> here
        for (i, view) in views.iter().enumerate() {
            if i > 0 {
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            }
            cmd.bind(&self.elements, &[(*view).into(), (&visible.list).into(), (&visible.args).into()]);
            cmd.dispatch(view.width, view.height, 1);
        }
        let references =
            [(&visible.list).into(), (&scene.draw_records).into(), scene.indices().into(), (&scene.references).into()];
        match &self.path {
            Path::Fragment { histogram } => {
                let mask = caches.mask.as_ref().expect("of this path");
                cmd.barrier(Use::ComputeWrite, Use::IndirectRead | Use::VertexRead);
                let area = [0, 0, ATLAS_WIDTH, caches.rows()];
                cmd.render(&Attachments { colors: &[], depth: Some(Attach::clear(mask)), area }, |draw| {
                    draw.bind(histogram, &references);
                    draw.push(&AtlasPush { rows: caches.rows() });
                    draw.draw_indirect(&visible.args);
                });
            }
            Path::Compute { flag, pack } => {
                let live = caches.live.as_ref().expect("of this path");
                cmd.barrier(Use::ComputeWrite, Use::IndirectRead | Use::ComputeRead);
                let [elements, draws, indices, refs] = references;
                let (args, flags) = ((&visible.args).into(), (&live.flags).into());
                cmd.bind(flag, &[elements, draws, indices, refs, args, flags]);
                cmd.dispatch_indirect(&visible.args, std::mem::offset_of!(ElementArgs, groups_x) as u64);
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                pack.caches(cmd, live, caches.light_count(vals), false);
            }
        }
    }
}
