//! Stage 6, gather: VALs x caches -> proxy lights. METHOD 3-4, thesis 5.3.
//!
//! Two paths, one loop body (glsl/lib/gather.glsl). The fragment path draws every tile of VALs over the atlas, two caches
//! to a texel, adds to float targets, and leaves culling to the depth test. The compute path works through the list of
//! live caches with several caches per thread, and splits the VALs into parts, so that few caches fill a device too.

use super::bounce::Bounces;
use super::depth_images::DepthImages;
use super::lights::LightInfo;
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

/// Adds up VALs; those that follow each other, so many `together`, a cache sees or does not see as one. `proxies`: and makes
/// proxies of the sums.
pub(super) fn sum_pipeline(
    gpu: &Gpu,
    glossy: bool,
    settings: &GatherSettings,
    shadows: Shadows,
    together: u32,
    proxies: bool,
) -> Result<Pipeline> {
    let spread = u32::from(shadows == Shadows::Proxy);
    let shadowed = shadows == Shadows::PerLight;
    let by_hand = u32::from(gpu.is_software());
    let constants = [u32::from(glossy), settings.source as u32, settings.caches_per_thread, spread, by_hand, together];
    match (shadowed, proxies) {
        (false, false) => gpu.compute("gather_sums.comp", &constants[..5]),
        (false, true) => gpu.compute("gather.comp", &constants[..5]),
        (true, false) => gpu.compute("gather_shadowed_sums.comp", &constants),
        (true, true) => gpu.compute("gather_shadowed.comp", &constants),
    }
}

/// Lights the caches.
pub struct Gather {
    path: Path,
    /// Only where light bounces more than once.
    bounces: Option<Box<Bounces>>,
    depth_images: Option<DepthImages>,
}

enum Path {
    Fragment {
        sum: Pipeline,
        tile: u32,
        resolve: Pipeline,
    },
    /// Makes proxies of the sums itself, unless light bounces more than once.
    Compute {
        sum: Pipeline,
    },
}

impl Gather {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu, glossy: bool, cull: bool, settings: &GatherSettings) -> Result<Self> {
        let path = match settings.path {
            GatherPath::Fragment => Self::by_draws(gpu, glossy, cull, settings, Shadows::Off)?,
            GatherPath::Compute => Path::Compute { sum: sum_pipeline(gpu, glossy, settings, Shadows::Off, 1, true)? },
        };
        Ok(Self { path, bounces: None, depth_images: None })
    }

    fn by_draws(gpu: &Gpu, glossy: bool, cull: bool, settings: &GatherSettings, shadows: Shadows) -> Result<Path> {
        if !Self::draws(gpu) {
            return Err(Error::NoDevice(format!(
                "{} draws into fewer than 8 images at a time, and the gather by draws needs that; take --gather compute",
                gpu.report().name
            )));
        }
        // Stage 7 wants to know of the glossy lobe, too, how far from the cache its VALs are.
        let spread = u32::from(shadows == Shadows::Proxy);
        let targets = [Format::R32G32B32A32_SFLOAT; 4 * TEXEL_CACHES as usize];
        Ok(Path::Fragment {
            sum: gpu.raster(&Raster {
                vertex: "tile.vert",
                fragment: Some(if glossy { "gather.frag" } else { "gather_diffuse.frag" }),
                shape: Shape::Triangles,
                streams: &[],
                colors: &targets[..targets.len() / if glossy { 1 } else { 2 }],
                blend: Blend::Add,
                depth: if cull { Depth::Behind } else { Depth::None },
                cull: Cull::None,
                constants: &[settings.source as u32, spread, u32::from(gpu.is_software())],
            })?,
            tile: settings.tile,
            resolve: gpu.compute("proxies_images.comp", &[u32::from(glossy), 1, spread])?,
        })
    }

    /// Whether the device draws into as many images at a time as the fragment path has sums.
    pub fn draws(gpu: &Gpu) -> bool {
        gpu.most_color_targets() >= 4 * TEXEL_CACHES
    }

    /// What a frame needs: where light bounces more than once without culling, and so, or with shadows of every VAL, by the
    /// compute path.
    pub fn of_frame(gpu: &Gpu, plan: &Plan, settings: &Settings, lights: &[LightInfo]) -> Result<Self> {
        let (ways, shadows) = (&settings.gather, settings.shadows);
        // What follows each other in a coarse picture, or in the list of patches, lies in different directions.
        let fine = !plan.emitters && lights.iter().all(|light| light.rsm_size(settings.rsm) >= FINE_RSM);
        let together = if fine { SHADOWED_TOGETHER } else { 1 };
        Ok(Self {
            path: match ways.path {
                GatherPath::Fragment => Self::by_draws(gpu, plan.glossy, plan.cull, ways, shadows)?,
                GatherPath::Compute => {
                    Path::Compute { sum: sum_pipeline(gpu, plan.glossy, ways, shadows, together, !plan.bounces)? }
                }
            },
            bounces: plan.bounces.then(|| Bounces::new(gpu, plan, settings).map(Box::new)).transpose()?,
            depth_images: plan.depth_images.then(|| DepthImages::new(gpu)).transpose()?,
        })
    }

    /// Records the stage. The caches' albedos are needed where light bounces more than once; `images` says whether caches see
    /// anything else than when they last looked.
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        vals: &ValTargets,
        view: &View,
        caches: &CacheTargets,
        albedos: Option<&Buffer>,
        images: bool,
    ) {
        if let Some(depth_images) = self.depth_images.as_ref().filter(|_| images) {
            let _zone = cmd.zone("depth images");
            depth_images.record(cmd, caches);
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        }
        let _zone = cmd.zone("gather");
        self.light(cmd, vals, view, caches, albedos);
    }

    /// Records the stage without its zone and what lies before it: for several in one measurement.
    pub fn light(
        &self,
        cmd: &Cmd<'_>,
        vals: &ValTargets,
        view: &View,
        caches: &CacheTargets,
        albedos: Option<&Buffer>,
    ) {
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
            Path::Fragment { sum, tile, resolve } => {
                draw(cmd, [sum, resolve], vals, caches, &GatherPush { tile: *tile, ..push });
            }
            Path::Compute { sum } => {
                let of_lights = (&vals.live_count, &vals.live);
                bind_sum(cmd, sum, of_lights, caches, [self.bounces.is_none(), self.depth_images.is_some()]);
                cmd.push(&push);
                cmd.dispatch_indirect(&caches.live.as_ref().expect("of this path").args, 0);
                if let Some(bounces) = &self.bounces {
                    bounces.record(cmd, albedos.expect("looked for when the frame was made"), caches, &push);
                }
            }
        }
    }
}

fn draw(cmd: &Cmd<'_>, [sum, resolve]: [&Pipeline; 2], vals: &ValTargets, caches: &CacheTargets, push: &GatherPush) {
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
    cmd.bind(resolve, &[(&caches.atlas).into(), (&caches.proxies).into(), a, b, c, d, e, f, g, h]);
    cmd.push(push);
    cmd.dispatch(caches.count, 1, 1);
}

/// Binds a pipeline of `sum_pipeline` for a list of VALs and its length, with what it needs for `proxies` and where it is
/// `shadowed`.
pub(super) fn bind_sum(
    cmd: &Cmd<'_>,
    pipeline: &Pipeline,
    (count, vals): (&Buffer, &Buffer),
    caches: &CacheTargets,
    [proxies, shadowed]: [bool; 2],
) {
    let (live, parts) = (caches.live.as_ref().expect("of this path"), caches.parts.as_ref().expect("of this path"));
    let mut resources: Vec<Bind<'_>> = vec![
        (&caches.atlas).into(),
        (&live.list).into(),
        (&live.args).into(),
        count.into(),
        Bind::Texels(vals),
        vals.into(),
        parts.into(),
    ];
    if proxies {
        resources.extend([Bind::Buffer(&caches.proxies), Bind::Buffer(&live.arrived)]);
    }
    resources.extend(caches.depth_images.as_ref().filter(|_| shadowed).map(Bind::Texels));
    cmd.bind(pipeline, &resources);
}
