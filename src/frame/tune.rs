//! Which way of lighting caches is the fastest on a device: measured once, kept by device and driver.

use super::View;
use super::gather::{Gather, GatherPath, GatherSettings, ValSource};
use super::targets::{CacheTargets, ValTargets};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::kept;
use crate::shared::{Cache, Val};
use glam::{Mat4, Vec3, Vec4};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Caches and VALs that a candidate is timed on: enough to fill a device, few enough to take no time; and so few caches
/// that a device is filled only where they are shared out well.
const WORLDS: [[u32; 2]; 2] = [[2048, 4096], [250, 16_384]];

/// Times that a pipeline is made to be measured. Some of lavapipe's, of the same code, stay slower than others as long as they
/// live, by what two pages of a long loop take; where the code happens to lie seems to decide.
pub const PIPELINES: usize = 3;

/// Frames that each of them is timed in, after one that does not count.
const FRAMES: usize = 3;

/// A candidate and how fast it is.
#[derive(Clone, Copy, Debug)]
pub struct Tuned {
    /// How caches are lit.
    pub settings: GatherSettings,
    /// Pairs of cache and VAL [1/s], both lobes: the best of a few frames, mean of a few pipelines; geometric mean where there
    /// are several worlds.
    pub pairs_per_second: f64,
}

/// All ways that are worth trying: on a CPU, threads that keep many caches, on GPUs, many threads.
pub fn candidates(software: bool) -> Vec<GatherSettings> {
    let (sources, shapes): (&[ValSource], &[(u32, u32)]) = if software {
        (&[ValSource::Texels, ValSource::Storage], &[(4, 2048), (6, 2048), (8, 2048)])
    } else {
        (&[ValSource::Texels, ValSource::Storage, ValSource::Shared], &[(1, 256), (2, 256), (4, 1024)])
    };
    let mut all = Vec::new();
    for source in [ValSource::Texels, ValSource::Storage] {
        for tile in [4096, 16_384] {
            all.push(GatherSettings { path: GatherPath::Fragment, source, tile, ..GatherSettings::default() });
        }
    }
    for source in sources.iter().copied() {
        for (caches_per_thread, split) in shapes.iter().copied() {
            let path = GatherPath::Compute;
            all.push(GatherSettings { path, source, caches_per_thread, split, ..GatherSettings::default() });
        }
    }
    all
}

/// Times one way on random caches and VALs.
pub fn time(gpu: &Gpu, settings: &GatherSettings, caches: u32, vals: u32) -> Result<Tuned> {
    let (cache_list, val_list) = world(caches, vals);
    let vals_on_device = ValTargets::of(gpu, &val_list)?;
    let mut targets = CacheTargets::new(gpu, true, caches, vals, settings)?;
    targets.atlas = gpu.buffer_from("atlas.caches", &cache_list)?;
    let (clip_from_world, world_from_clip) = (Mat4::IDENTITY, Mat4::IDENTITY);
    let view = View { clip_from_world, world_from_clip, eye: Vec4::new(0.0, 0.0, 9.0, 1.0), plane: Vec4::ZERO };
    let mut rates = 0.0;
    for _ in 0..PIPELINES {
        let gather = Gather::new(gpu, true, false, settings)?;
        let mut best = f64::INFINITY;
        for i in 0..=FRAMES {
            let drawn = gpu.frame(gpu.is_software(), |cmd| {
                cmd.begin_frame(&targets.sums);
                gather.record(cmd, &vals_on_device, &view, &targets, None, true);
                Ok(())
            })?;
            let times = gpu.times(&drawn)?;
            best = times.gpu_ms().filter(|_| i > 0).map_or(best, |ms| best.min(ms));
        }
        rates += f64::from(caches) * f64::from(vals) / (best * 1e-3);
    }
    Ok(Tuned { settings: *settings, pairs_per_second: rates / PIPELINES as f64 })
}

/// Times one way on many and on few caches.
fn both(gpu: &Gpu, settings: &GatherSettings) -> Result<Tuned> {
    let mut product = 1.0;
    for [caches, vals] in WORLDS {
        product *= time(gpu, settings, caches, vals)?.pairs_per_second;
    }
    Ok(Tuned { settings: *settings, pairs_per_second: product.powf(1.0 / WORLDS.len() as f64) })
}

/// The fastest way of a path, or of all, on this device; measured on the first call and kept.
pub fn fastest(gpu: &Gpu, path: Option<GatherPath>) -> Result<Tuned> {
    let mut ways = candidates(gpu.is_software());
    ways.retain(|way| way.path == GatherPath::Compute || Gather::draws(gpu));
    let file = file(gpu, &ways);
    let kept = file.as_ref().and_then(|file| std::fs::read(file).ok()).and_then(|bytes| read(&bytes, &ways));
    let all = match kept {
        Some(all) => all,
        None => {
            log::info!("measuring how caches are lit fastest on {}", gpu.report().name);
            let all: Vec<Tuned> = ways.iter().map(|settings| both(gpu, settings)).collect::<Result<_>>()?;
            if let Some(file) = &file
                && let Err(error) = kept::write(file, &serde_json::to_vec_pretty(&write(gpu, &all)).expect("plain"))
            {
                log::warn!("{}: {error}; the measurement is not kept", file.display());
            }
            all
        }
    };
    let of_path = all.into_iter().filter(|t| path.is_none_or(|path| t.settings.path == path));
    // A path that the device does not have is refused by name when it is made.
    let fastest = of_path.max_by(|a, b| a.pairs_per_second.total_cmp(&b.pairs_per_second));
    Ok(fastest.unwrap_or(Tuned {
        settings: GatherSettings { path: GatherPath::Fragment, ..GatherSettings::default() },
        pairs_per_second: 0.0,
    }))
}

/// One file per device, driver and version of the shaders.
fn file(gpu: &Gpu, ways: &[GatherSettings]) -> Option<PathBuf> {
    let report = gpu.report();
    let mut hash = blake3::Hasher::new();
    for part in [&report.name, &report.driver, &report.api] {
        hash.update(part.as_bytes()).update(&[0]);
    }
    for shader in ["gather.comp", "gather.frag"] {
        hash.update(crate::gpu::shader(shader));
    }
    hash.update(format!("{ways:?} {WORLDS:?}").as_bytes());
    Some(kept::folder()?.join(format!("gather-{}.json", &hash.finalize().to_hex()[..32])))
}

const PATHS: [(GatherPath, &str); 2] = [(GatherPath::Fragment, "fragment"), (GatherPath::Compute, "compute")];
const SOURCES: [(ValSource, &str); 3] =
    [(ValSource::Texels, "texels"), (ValSource::Storage, "storage"), (ValSource::Shared, "shared")];

fn write(gpu: &Gpu, all: &[Tuned]) -> Value {
    let line = |t: &Tuned| {
        let s = t.settings;
        json!({
            "path": s.path.name(),
            "vals": s.source.name(),
            "tile": s.tile,
            "caches_per_thread": s.caches_per_thread,
            "split": s.split,
            "pairs_per_second": t.pairs_per_second,
        })
    };
    let report = gpu.report();
    json!({ "device": report.name, "driver": report.driver, "candidates": all.iter().map(line).collect::<Vec<_>>() })
}

/// The kept measurement; `None` if it is damaged.
fn read(bytes: &[u8], ways: &[GatherSettings]) -> Option<Vec<Tuned>> {
    let all: Value = serde_json::from_slice(bytes).ok()?;
    let line = |line: &Value| {
        let number = |key: &str| line[key].as_u64().and_then(|n| u32::try_from(n).ok());
        let settings = GatherSettings {
            path: PATHS.iter().find(|(_, name)| line["path"] == *name)?.0,
            source: SOURCES.iter().find(|(_, name)| line["vals"] == *name)?.0,
            tile: number("tile")?,
            caches_per_thread: number("caches_per_thread")?,
            split: number("split")?,
        };
        let known = ways.contains(&settings);
        known.then_some(Tuned { settings, pairs_per_second: line["pairs_per_second"].as_f64()? })
    };
    let all: Vec<Tuned> = all["candidates"].as_array()?.iter().map(line).collect::<Option<_>>()?;
    (all.len() == ways.len()).then_some(all)
}

impl GatherPath {
    /// As `--gather` names it.
    pub fn name(self) -> &'static str {
        PATHS.iter().find(|(path, _)| *path == self).expect("all are listed").1
    }
}

impl ValSource {
    /// In reports.
    pub fn name(self) -> &'static str {
        SOURCES.iter().find(|(source, _)| *source == self).expect("all are listed").1
    }
}

/// Caches on the floor of a room of 8 m and VALs on its ceiling, from a fixed seed.
pub fn world(caches: u32, vals: u32) -> (Vec<Cache>, Vec<Val>) {
    let mut state = 1_u32;
    let mut next = move || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut place = move |height: f32| Vec3::new(8.0 * next() - 4.0, 8.0 * next() - 4.0, height + next());
    let normal = |p: Vec3, z: f32| Vec3::new(0.05 * p.x, 0.05 * p.y, z).normalize();
    let cache = |position: Vec3| Cache {
        position,
        normal: normal(position, 1.0),
        exponent: 40.0,
        area: 0.01,
        ..Cache::default()
    };
    let val = |position: Vec3| Val {
        position,
        area: 0.01,
        normal: normal(position, -1.0),
        material: 0,
        flux: Vec3::new(3.0, 2.0, 1.0) * (1.0 + 0.1 * position.x),
        weight: 2.0 + 0.2 * position.x,
    };
    let caches = (0..caches).map(|_| cache(place(-3.0))).collect();
    (caches, (0..vals).map(|_| val(place(2.0))).collect())
}
