//! Stage 6, gather: VALs x caches -> proxy lights. METHOD 3-4, thesis 5.3.
//!
//! Two paths, one loop body (glsl/lib/gather.glsl). The fragment path draws every tile of VALs over the atlas, two caches
//! to a texel, adds to float targets, and leaves culling to the depth test. The compute path works through the list of
//! live caches with several caches per thread, and splits the VALs into parts, so that few caches fill a device too.

use super::bounce::Bounces;
use super::depth_images::DepthImages;
use super::lights::LightInfo;
use super::pack::Pack;
use super::targets::{CacheTargets, ValTargets};
use super::{Plan, Settings, Shadows, View};
use crate::error::{Error, Result};
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cmd, Cull, Depth, Format, Gpu, Load, Pipeline, Raster, Shape, Use,
};
use crate::shared::{GatherPush, TEXEL_CACHES, VALS_SHARED, VALS_STORAGE, VALS_TEXELS};

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

/// Texels of an RSM's side from which on that many neighbours are near enough.
const FINE_RSM: u32 = 96;

/// Adds up VALs; those that follow each other, so many `together`, a cache sees or does not see as one.
pub(super) fn sum_pipeline(
    gpu: &Gpu,
    glossy: bool,
    settings: &GatherSettings,
    shadows: Shadows,
    together: u32,
) -> Result<Pipeline> {
    let spread = u32::from(shadows == Shadows::Proxy);
    let constants = [u32::from(glossy), settings.source as u32, settings.caches_per_thread, spread, together];
    if shadows == Shadows::PerLight {
        gpu.compute("gather_shadowed.comp", &constants)
    } else {
        gpu.compute("gather.comp", &constants[..4])
    }
}

/// Lights the caches.
pub struct Gather {
    path: Path,
    resolve: Pipeline,
    /// Only where light bounces more than once.
    bounces: Option<Box<Bounces>>,
    depth_images: Option<DepthImages>,
}

enum Path {
    Fragment { sum: Pipeline, tile: u32 },
    Compute { pack: Option<Box<Pack>>, sum: Pipeline },
}

impl Gather {
    /// Makes the pipelines. Without culling the compute path lists all caches itself.
    pub fn new(gpu: &Gpu, glossy: bool, cull: bool, settings: &GatherSettings) -> Result<Self> {
        Self::made(gpu, glossy, cull, settings, Shadows::Off, 1)
    }

    fn made(
        gpu: &Gpu,
        glossy: bool,
        cull: bool,
        settings: &GatherSettings,
        shadows: Shadows,
        together: u32,
    ) -> Result<Self> {
        if settings.path == GatherPath::Fragment && !Self::draws(gpu) {
            return Err(Error::NoDevice(format!(
                "{} draws into fewer than 8 images at a time, and the gather by draws needs that; take --gather compute",
                gpu.report().name
            )));
        }
        // Stage 7 wants to know of the glossy lobe, too, how far from the cache its VALs are.
        let (glossy_constant, spread) = (u32::from(glossy), u32::from(shadows == Shadows::Proxy));
        let shadowed = shadows == Shadows::PerLight;
        let targets = [Format::R32G32B32A32_SFLOAT; 4 * TEXEL_CACHES as usize];
        let source = settings.source as u32;
        Ok(match settings.path {
            GatherPath::Fragment => Self {
                path: Path::Fragment {
                    sum: gpu.raster(&Raster {
                        vertex: "tile.vert",
                        fragment: Some(if glossy { "gather.frag" } else { "gather_diffuse.frag" }),
                        shape: Shape::Triangles,
                        streams: &[],
                        colors: &targets[..targets.len() / if glossy { 1 } else { 2 }],
                        blend: Blend::Add,
                        depth: if cull { Depth::Behind } else { Depth::None },
                        cull: Cull::None,
                        constants: &[source, spread],
                    })?,
                    tile: settings.tile,
                },
                resolve: gpu.compute("proxies_images.comp", &[glossy_constant, 1, spread])?,
                bounces: None,
                depth_images: None,
            },
            GatherPath::Compute => Self {
                path: Path::Compute {
                    pack: (!cull).then(|| Pack::new(gpu).map(Box::new)).transpose()?,
                    sum: sum_pipeline(gpu, glossy, settings, shadows, together)?,
                },
                resolve: gpu.compute("proxies.comp", &[glossy_constant, 1, spread])?,
                bounces: None,
                depth_images: shadowed.then(|| DepthImages::new(gpu)).transpose()?,
            },
        })
    }

    /// Whether the device draws into as many images at a time as the fragment path has sums.
    pub fn draws(gpu: &Gpu) -> bool {
        gpu.most_color_targets() >= 4 * TEXEL_CACHES
    }

    /// What a frame needs: where light bounces more than once without culling, and so, or with shadows of every VAL, by the
    /// compute path.
    pub fn of_frame(gpu: &Gpu, plan: &Plan, settings: &Settings, lights: &[LightInfo]) -> Result<Self> {
        // What follows each other in a coarse picture, or in the list of patches, lies in different directions.
        let fine = !plan.emitters && lights.iter().all(|light| light.rsm_size(settings.rsm) >= FINE_RSM);
        let together = if fine { SHADOWED_TOGETHER } else { 1 };
        let mut made = Self::made(gpu, plan.glossy, plan.cull, &settings.gather, settings.shadows, together)?;
        if plan.bounces {
            made.resolve =
                gpu.compute("proxies_bounces.comp", &[u32::from(plan.glossy), 1, u32::from(plan.occlude)])?;
            made.bounces = Some(Box::new(Bounces::new(gpu, plan, settings)?));
        }
        Ok(made)
    }

    /// Records the stage. The caches' albedos are needed where light bounces more than once.
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        vals: &ValTargets,
        view: &View,
        caches: &CacheTargets,
        albedos: Option<&Buffer>,
    ) {
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
            split: caches.live.as_ref().map_or(0, |live| live.split),
            columns: caches.columns(),
            cache_parts: caches.bounces.as_ref().map_or(0, |bounces| bounces.parts),
            eye: view.eye,
        };
        match &self.path {
            Path::Fragment { sum, tile } => self.draw(cmd, sum, vals, caches, &GatherPush { tile: *tile, ..push }),
            Path::Compute { pack, sum } => {
                self.sum(cmd, pack.as_deref(), sum, vals, caches, &push);
                if let Some(bounces) = &self.bounces {
                    bounces.record(cmd, albedos.expect("looked for when the frame was made"), caches, &push);
                }
                self.resolve(cmd, caches, &push);
            }
        }
    }

    fn draw(&self, cmd: &Cmd<'_>, sum: &Pipeline, vals: &ValTargets, caches: &CacheTargets, push: &GatherPush) {
        let sums: Vec<_> = caches.sums.iter().map(Attach::clear).collect();
        let depth = caches.mask.as_ref().map(|image| Attach { image, load: Load::ReadOnly });
        cmd.render(&Attachments { colors: &sums, depth, area: caches.area() }, |draw| {
            let resources =
                [(&caches.atlas).into(), (&vals.live_count).into(), Bind::Texels(&vals.live), (&vals.live).into()];
            draw.bind(sum, &resources);
            for first in (0..vals.count).step_by(push.tile as usize) {
                draw.push(&GatherPush { first, ..*push });
                draw.draw(3);
            }
        });
        cmd.barrier(Use::ColorWrite, Use::ComputeRead);
        let [[a, b, c, d], [e, f, g, h]] = caches.sums_of_texel().map(|of_cache| of_cache.map(Bind::Image));
        cmd.bind(&self.resolve, &[(&caches.atlas).into(), (&caches.proxies).into(), a, b, c, d, e, f, g, h]);
        cmd.push(push);
        cmd.dispatch(caches.count, 1, 1);
    }

    fn sum(
        &self,
        cmd: &Cmd<'_>,
        pack: Option<&Pack>,
        sum: &Pipeline,
        vals: &ValTargets,
        caches: &CacheTargets,
        push: &GatherPush,
    ) {
        let (live, parts) = (caches.live.as_ref().expect("of this path"), caches.parts.as_ref().expect("of this path"));
        if let Some(pack) = pack.filter(|_| self.depth_images.is_none()) {
            pack.caches(cmd, live, &vals.live_count, true);
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::IndirectRead);
        }
        let resources = [
            (&caches.atlas).into(),
            (&live.list).into(),
            (&live.args).into(),
            (&vals.live_count).into(),
            Bind::Texels(&vals.live),
            (&vals.live).into(),
            parts.into(),
        ];
        let images = caches.depth_images.as_ref().filter(|_| self.depth_images.is_some()).map(Bind::Texels);
        cmd.bind(sum, &resources.into_iter().chain(images).collect::<Vec<_>>());
        cmd.push(push);
        cmd.dispatch_indirect(&live.args, 0);
    }

    fn resolve(&self, cmd: &Cmd<'_>, caches: &CacheTargets, push: &GatherPush) {
        let (live, parts) = (caches.live.as_ref().expect("of this path"), caches.parts.as_ref().expect("of this path"));
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        let scales = caches.bounces.as_ref().map(|bounces| (&bounces.scales).into());
        let resources: [Bind<'_>; 5] =
            [(&caches.atlas).into(), (&caches.proxies).into(), (&live.list).into(), (&live.args).into(), parts.into()];
        cmd.bind(&self.resolve, &resources.into_iter().chain(scales).collect::<Vec<_>>());
        cmd.push(push);
        cmd.dispatch(caches.count, 1, 1);
    }
}
