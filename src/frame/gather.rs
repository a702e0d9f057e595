//! Stage 6, gather: VALs x caches -> proxy lights. METHOD 3-4, thesis 5.3.
//!
//! Two paths, one loop body (glsl/lib/gather.glsl). The fragment path draws every tile of VALs over the atlas, adds to
//! float targets, and leaves culling to the depth test. The compute path works through the list of live caches with
//! several caches per thread, and splits the VALs into parts, so that few caches fill a device too.

use super::View;
use super::depth_images::DepthImages;
use super::pack::Pack;
use super::targets::{CacheTargets, ValTargets};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Format, Gpu, Load, Pipeline, Raster, Shape, Use};
use crate::shared::{GatherPush, VALS_SHARED, VALS_STORAGE, VALS_TEXELS};

/// What lights the caches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GatherPath {
    /// Additive draws into float targets.
    Fragment,
    /// Compute shader over a list of caches.
    Compute,
}

/// Where VALs are read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ValSource {
    /// A texel buffer.
    Texels = VALS_TEXELS,
    /// A storage buffer.
    Storage = VALS_STORAGE,
    /// The workgroup's memory, tile by tile; the compute path alone.
    Shared = VALS_SHARED,
}

/// How caches are lit. None of it changes what they receive by more than rounding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GatherSettings {
    /// By draws or dispatches.
    pub path: GatherPath,
    /// Where VALs are read from.
    pub source: ValSource,
    /// VALs of one draw of the fragment path; a multiple of `VAL_TILE`.
    pub tile: u32,
    /// Caches that a thread of the compute path keeps in registers.
    pub caches_per_thread: u32,
    /// VALs that a thread of the compute path adds up; a multiple of `VAL_TILE`.
    pub split: u32,
}

impl Default for GatherSettings {
    fn default() -> Self {
        Self { path: GatherPath::Compute, source: ValSource::Texels, tile: 4096, caches_per_thread: 4, split: 2048 }
    }
}

/// VALs in a row that shadows show or hide together, as the first of them: neighbours in an RSM, which together are mostly
/// smaller than a texel of a depth image.
const SHADOWED_TOGETHER: u32 = 4;

/// Lights the caches.
pub struct Gather {
    path: Path,
    resolve: Pipeline,
    depth_images: Option<DepthImages>,
}

enum Path {
    Fragment { sum: Pipeline, tile: u32 },
    Compute { pack: Option<Box<Pack>>, sum: Pipeline },
}

impl Gather {
    /// Makes the pipelines. Without culling the compute path lists all caches itself.
    pub fn new(gpu: &Gpu, glossy: bool, cull: bool, settings: &GatherSettings) -> Result<Self> {
        let targets = [Format::R32G32B32A32_SFLOAT; 4];
        let source = settings.source as u32;
        Ok(match settings.path {
            GatherPath::Fragment => Self {
                path: Path::Fragment {
                    sum: gpu.raster(&Raster {
                        vertex: "tile.vert",
                        fragment: Some(if glossy { "gather.frag" } else { "gather_diffuse.frag" }),
                        shape: Shape::Triangles,
                        streams: &[],
                        colors: &targets[..if glossy { 4 } else { 2 }],
                        blend: Blend::Add,
                        depth: if cull { Depth::Behind } else { Depth::None },
                        cull: Cull::None,
                        constants: &[source],
                    })?,
                    tile: settings.tile,
                },
                resolve: gpu.compute("proxies_images.comp", &[u32::from(glossy)])?,
                depth_images: None,
            },
            GatherPath::Compute => Self {
                path: Path::Compute {
                    pack: (!cull).then(|| Pack::new(gpu).map(Box::new)).transpose()?,
                    sum: gpu.compute("gather.comp", &[u32::from(glossy), source, settings.caches_per_thread])?,
                },
                resolve: gpu.compute("proxies.comp", &[u32::from(glossy), 1])?,
                depth_images: None,
            },
        })
    }

    /// The same by the compute path with shadows: of VALs that a cache does not see it takes no light.
    pub fn shadowed(gpu: &Gpu, glossy: bool, cull: bool, settings: &GatherSettings) -> Result<Self> {
        let constants = [u32::from(glossy), settings.source as u32, settings.caches_per_thread, SHADOWED_TOGETHER];
        Ok(Self {
            path: Path::Compute {
                pack: (!cull).then(|| Pack::new(gpu).map(Box::new)).transpose()?,
                sum: gpu.compute("gather_shadowed.comp", &constants)?,
            },
            resolve: gpu.compute("proxies.comp", &[u32::from(glossy), 1])?,
            depth_images: Some(DepthImages::new(gpu)?),
        })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, vals: &ValTargets, view: &View, caches: &CacheTargets) {
        if let Some(depth_images) = &self.depth_images {
            let _zone = cmd.zone("depth images");
            if let Path::Compute { pack: Some(pack), .. } = &self.path {
                let live = caches.live.as_ref().expect("of this path");
                pack.caches(cmd, live, &vals.live_count, true);
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::IndirectRead);
            }
            depth_images.record(cmd, caches);
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        }
        let _zone = cmd.zone("gather");
        let push = GatherPush {
            cache_count: caches.count,
            first: 0,
            tile: 0,
            split: 0,
            columns: caches.columns(),
            eye: view.eye,
        };
        match &self.path {
            Path::Fragment { sum, tile } => self.draw(cmd, sum, vals, caches, &GatherPush { tile: *tile, ..push }),
            Path::Compute { pack, sum } => self.dispatch(cmd, pack.as_deref(), sum, vals, caches, push),
        }
    }

    fn draw(&self, cmd: &Cmd<'_>, sum: &Pipeline, vals: &ValTargets, caches: &CacheTargets, push: &GatherPush) {
        let sums: Vec<_> = caches.sums.iter().map(Attach::clear).collect();
        let depth = caches.mask.as_ref().map(|image| Attach { image, load: Load::ReadOnly });
        cmd.render(&Attachments { colors: &sums, depth, area: [0, 0, caches.columns() * 8, caches.rows()] }, |draw| {
            let resources =
                [(&caches.atlas).into(), (&vals.live_count).into(), Bind::Texels(&vals.live), (&vals.live).into()];
            draw.bind(sum, &resources);
            for first in (0..vals.count).step_by(push.tile as usize) {
                draw.push(&GatherPush { first, ..*push });
                draw.draw(3);
            }
        });
        cmd.barrier(Use::ColorWrite, Use::ComputeRead);
        let image = |i: usize| Bind::Image(caches.sums.get(i).unwrap_or(&caches.sums[0]));
        cmd.bind(
            &self.resolve,
            &[(&caches.atlas).into(), (&caches.proxies).into(), image(0), image(1), image(2), image(3)],
        );
        cmd.push(push);
        cmd.dispatch(caches.count, 1, 1);
    }

    fn dispatch(
        &self,
        cmd: &Cmd<'_>,
        pack: Option<&Pack>,
        sum: &Pipeline,
        vals: &ValTargets,
        caches: &CacheTargets,
        push: GatherPush,
    ) {
        let (live, parts) = (caches.live.as_ref().expect("of this path"), caches.parts.as_ref().expect("of this path"));
        if let Some(pack) = pack.filter(|_| self.depth_images.is_none()) {
            pack.caches(cmd, live, &vals.live_count, true);
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::IndirectRead);
        }
        let mut resources: Vec<Bind<'_>> = vec![
            (&caches.atlas).into(),
            (&live.list).into(),
            (&live.args).into(),
            (&vals.live_count).into(),
            Bind::Texels(&vals.live),
            (&vals.live).into(),
            parts.into(),
        ];
        resources.extend(caches.depth_images.as_ref().filter(|_| self.depth_images.is_some()).map(Bind::Texels));
        cmd.bind(sum, &resources);
        let push = GatherPush { split: live.split, ..push };
        cmd.push(&push);
        cmd.dispatch_indirect(&live.args, 0);
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        cmd.bind(
            &self.resolve,
            &[(&caches.atlas).into(), (&caches.proxies).into(), (&live.list).into(), (&live.args).into(), parts.into()],
        );
        cmd.push(&push);
        cmd.dispatch(caches.count, 1, 1);
    }
}
