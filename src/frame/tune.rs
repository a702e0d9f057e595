//! Finds the fastest way of the compute gather on a device. It is measured once and stored by device and driver.

use super::atlas::Atlas;
use super::gather::{Compute, ComputeKind, Lit};
use super::proxies::Proxies;
use super::settings::{ValSource, Ways};
use super::vals::Vals;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::shared::{Cache, Val};
use crate::{files, kept};
use glam::{Vec3, Vec4};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Numbers of caches and VALs for timing a candidate. The first pair is enough to fill a device, yet quick. The second
/// has so few caches that only a good distribution fills a device. Slow devices get fewer VALs.
const WORLDS: [[u32; 2]; 2] = [[2048, 4096], [250, 16_384]];

/// Number of times that a pipeline is created for measuring. On lavapipe, some pipelines built from identical code stay
/// slower than others for their whole lifetime. The address of the code seems to decide, when a long loop spans two
/// pages.
pub const PIPELINES: usize = 3;

/// Frames timed per pipeline, after one that does not count.
const FRAMES: usize = 3;

/// Time limit for one of these frames [s]. The whole measurement takes about 150 frames.
const LONGEST_FRAME: f64 = 0.03;

/// VALs of the frames that measure the speed of a device.
const FEW_VALS: u32 = 256;

/// A candidate and its speed.
#[derive(Clone, Copy, Debug)]
pub struct Tuned {
    /// The way of the gather.
    pub ways: Ways,
    /// Pairs of cache and VAL per second [1/s], both lobes: the best of a few frames, averaged over a few pipelines,
    /// and the geometric mean over several worlds.
    pub pairs_per_second: f64,
}

/// All ways that are worth trying: many caches per thread on CPUs, many threads on GPUs.
pub fn candidates(software: bool) -> Vec<Ways> {
    let (sources, shapes): (&[ValSource], &[(u32, u32)]) = if software {
        (&[ValSource::Texels, ValSource::Storage], &[(4, 2048), (6, 2048), (8, 2048)])
    } else {
        (&[ValSource::Texels, ValSource::Storage, ValSource::Shared], &[(1, 256), (2, 256), (4, 1024)])
    };
    let of_source =
        |source| shapes.iter().map(move |&(caches_per_thread, split)| Ways { source, caches_per_thread, split });
    sources.iter().copied().flat_map(of_source).collect()
}

/// Times one way on random caches and VALs, with this many pipelines.
fn time(gpu: &Gpu, ways: &Ways, [caches, vals]: [u32; 2], pipelines: usize) -> Result<Tuned> {
    let (cache_list, val_list) = world(caches, vals);
    let (atlas, vals_on_device) = (Atlas::of(gpu, &cache_list)?, Vals::of(gpu, &val_list)?);
    let proxies = Proxies::new(gpu, caches, true, 1)?;
    let eyes = [Vec4::new(0.0, 0.0, 9.0, 1.0)];
    let lit = Lit { vals: &vals_on_device, atlas: &atlas, proxies: &proxies, eyes: &eyes, albedos: None, sky: None };
    let mut rates = 0.0;
    for _ in 0..pipelines {
        gpu.forget_pipelines();
        let gather = Compute::new(gpu, caches, vals, ways, ComputeKind::plain(true))?;
        let mut best = f64::INFINITY;
        for i in 0..=FRAMES {
            let drawn = gpu.timed_frame(|cmd| {
                let _zone = cmd.zone("gather");
                gather.record(cmd, &lit);
                Ok(())
            })?;
            let times = gpu.times(&drawn)?;
            best = times.gpu_ms().filter(|_| i > 0).map_or(best, |ms| best.min(ms));
        }
        rates += f64::from(caches) * f64::from(vals) / (best * 1e-3);
    }
    Ok(Tuned { ways: *ways, pairs_per_second: rates / pipelines as f64 })
}

/// Sizes of the worlds for timing candidates. VALs are halved until the device lights them within `LONGEST_FRAME`.
fn worlds(gpu: &Gpu) -> Result<[[u32; 2]; 2]> {
    let pairs = time(gpu, &Ways::default(), [WORLDS[0][0], FEW_VALS], 1)?.pairs_per_second * LONGEST_FRAME;
    Ok(WORLDS.map(|[caches, most]| {
        let halves = std::iter::successors(Some(most), |vals| Some(vals / 2)).take_while(|vals| *vals >= FEW_VALS);
        [caches, halves.clone().find(|vals| f64::from(caches * vals) <= pairs).or(halves.last()).unwrap_or(most)]
    }))
}

/// Times one way on both worlds: many caches and few.
fn both(gpu: &Gpu, ways: &Ways, worlds: [[u32; 2]; 2]) -> Result<Tuned> {
    let mut product = 1.0;
    // A slow device also compiles pipelines slowly.
    let pipelines = if worlds == WORLDS { PIPELINES } else { 1 };
    for world in worlds {
        product *= time(gpu, ways, world, pipelines)?.pairs_per_second;
    }
    Ok(Tuned { ways: *ways, pairs_per_second: product.powf(1.0 / WORLDS.len() as f64) })
}

/// The fastest way of the compute gather on this device. It is measured on the first call and stored.
///
/// # Errors
/// Fails if the device runs out of memory.
pub fn fastest(gpu: &Gpu) -> Result<Tuned> {
    let ways = candidates(gpu.is_software());
    let file = file(gpu, &ways);
    let kept = file.as_ref().and_then(|file| files::read(file).ok()).and_then(|bytes| read(&bytes, &ways));
    let all = match kept {
        Some(all) => all,
        None => {
            log::info!("measuring the fastest gather on {}", gpu.report().name);
            let worlds = worlds(gpu)?;
            let all: Vec<Tuned> = ways.iter().map(|ways| both(gpu, ways, worlds)).collect::<Result<_>>()?;
            if let Some(file) = &file
                && let Err(error) = kept::write(file, &serde_json::to_vec_pretty(&write(gpu, &all)).expect("plain"))
            {
                log::warn!("{}: {error}; the measurement is not stored", file.display());
            }
            all
        }
    };
    let fastest = all.into_iter().max_by(|a, b| a.pairs_per_second.total_cmp(&b.pairs_per_second));
    Ok(fastest.unwrap_or(Tuned { ways: Ways::default(), pairs_per_second: 0.0 }))
}

/// One file per device, driver and shader version.
fn file(gpu: &Gpu, ways: &[Ways]) -> Option<PathBuf> {
    let report = gpu.report();
    let mut hash = blake3::Hasher::new();
    for part in [&report.name, &report.driver, &report.api] {
        hash.update(part.as_bytes()).update(&[0]);
    }
    hash.update(crate::gpu::shader("gather.comp"));
    hash.update(format!("{ways:?} {WORLDS:?}").as_bytes());
    Some(kept::folder()?.join(format!("gather-{}.json", &hash.finalize().to_hex()[..32])))
}

fn write(gpu: &Gpu, all: &[Tuned]) -> Value {
    let line = |t: &Tuned| {
        json!({
            "vals": t.ways.source.name(),
            "caches_per_thread": t.ways.caches_per_thread,
            "split": t.ways.split,
            "pairs_per_second": t.pairs_per_second,
        })
    };
    let report = gpu.report();
    json!({ "device": report.name, "driver": report.driver, "candidates": all.iter().map(line).collect::<Vec<_>>() })
}

/// The stored measurement; `None` if it is damaged.
fn read(bytes: &[u8], candidates: &[Ways]) -> Option<Vec<Tuned>> {
    let all: Value = serde_json::from_slice(bytes).ok()?;
    let line = |(line, ways): (&Value, &Ways)| {
        let number = |key: &str| line[key].as_u64();
        let known = line["vals"] == ways.source.name()
            && number("caches_per_thread") == Some(ways.caches_per_thread.into())
            && number("split") == Some(ways.split.into());
        known.then_some(Tuned { ways: *ways, pairs_per_second: line["pairs_per_second"].as_f64()? })
    };
    let all = all["candidates"].as_array()?;
    (all.len() == candidates.len()).then(|| all.iter().zip(candidates).map(line).collect())?
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
        kind: 0,
        flux: Vec3::new(3.0, 2.0, 1.0) * (1.0 + 0.1 * position.x),
        weight: 2.0 + 0.2 * position.x,
    };
    let caches = (0..caches).map(|_| cache(place(-3.0))).collect();
    (caches, (0..vals).map(|_| val(place(2.0))).collect())
}
