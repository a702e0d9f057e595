//! Soft shadows of indirect light: error of each kind on the device against one bounce of the path tracer.

use super::eval::measure::{Bench, Layers};
use super::eval::references::{PathTraced, path_traced};
use super::eval::sweep::Point;
use crate::error::Result;
use crate::frame::Shadows;
use crate::frame::plan::{STAGES, has_glossy_lobe};
use crate::gpu::Gpu;
use crate::lab::knobs::Knobs;
use crate::metrics::{Metrics, mean, metrics};
use crate::reference::path_trace::{PathTraceSettings, camera_ray};
use crate::reference::world::{Sides, World};
use crate::scene::{Camera, Scene};
use rayon::prelude::*;
use std::path::Path;

/// Parameters of a comparison.
#[derive(Clone, Copy, Debug)]
pub struct ShadowsSettings {
    /// Picture \[pixels\].
    pub size: [u32; 2],
    /// Caches requested.
    pub caches: usize,
    /// Side of an RSM \[texels\].
    pub rsm: u32,
    /// Samples per pixel of the path tracer.
    pub samples: u32,
    /// Frames of which the median time is taken.
    pub frames: usize,
}

/// Results for one kind of shadows in one scene.
#[derive(Clone, Debug)]
pub struct Row {
    /// The kind.
    pub shadows: Shadows,
    /// Errors of each layer by name, over pixels that show a surface; or the reason for failure.
    pub errors: std::result::Result<Vec<(&'static str, Errors)>, String>,
    /// Median GPU time \[ms\] of the whole frame; 0 if the device has no timestamps.
    pub frame_ms: f64,
    /// GPU time \[ms\] of the gather and its shadows.
    pub gather_ms: f64,
}

/// Errors of one layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Metrics against the path tracer.
    pub metrics: Metrics,
    /// Root mean square error, divided by the mean of the reference.
    pub rmse_over_mean: f64,
}

/// Results for all kinds in one scene.
#[derive(Clone, Debug)]
pub struct Compared {
    /// One row per kind.
    pub rows: Vec<Row>,
    /// Caches placed.
    pub caches: u32,
    /// Mean relative standard error of the reference.
    pub noise: f64,
    /// Excluded pixels with an edge through their centre, where rasterizer and rays may show different surfaces.
    pub on_edges: usize,
    /// Complaints of the barrier check about the frames.
    pub problems: Vec<String>,
}

/// All kinds of shadows.
pub const KINDS: [Shadows; 3] = [Shadows::Off, Shadows::Proxy, Shadows::PerLight];

/// Whether a stage belongs to lighting the caches: METHOD's stages 6 and 7.
fn lights_caches(name: &str) -> bool {
    STAGES.iter().any(|stage| stage.name == name && (6..=7).contains(&stage.number))
}

/// Compares every kind with the path tracer from the scene's first camera. Path-traced samples are kept in `folder`.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn compare(
    gpu: &Gpu,
    scene: &Scene,
    settings: &ShadowsSettings,
    folder: &Path,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Compared> {
    let camera = &scene.cameras[0];
    let frame = Knobs { rsm: settings.rsm, ..Knobs::plain(settings.size) };
    let wanted = PathTraced {
        settings: PathTraceSettings::engine(settings.size, 1),
        samples: settings.samples,
        glossy: has_glossy_lobe(scene),
    };
    let (mut truth, about) = path_traced(scene, camera, &wanted, folder, progress);
    let edges = edges(scene, camera, settings.size);
    truth.covered.iter_mut().zip(&edges).for_each(|(covered, edge)| *covered &= !edge);
    let mut bench = Bench::new(gpu, scene, camera);
    let mut compared = Compared {
        rows: Vec::new(),
        caches: 0,
        noise: about["noise"].as_f64().unwrap_or(f64::NAN),
        on_edges: edges.iter().filter(|edge| **edge).count(),
        problems: Vec::new(),
    };
    for shadows in KINDS {
        let point = Point {
            frame: Knobs { shadows, ..frame },
            caches: settings.caches,
            references: 8,
            angle: 60_f32.to_radians(),
            max_edge: None,
        };
        let row = match bench.measure(&point, settings.frames, &|_, _| ()) {
            Ok(measured) => {
                compared.caches = measured.caches;
                compared.problems.extend(measured.problems);
                let time = |is: &dyn Fn(&str) -> bool| -> f64 {
                    measured.stages.iter().filter(|stage| is(&stage.0)).map(|stage| stage.1).sum()
                };
                Row {
                    shadows,
                    errors: Ok(errors(&measured.layers, &truth)),
                    frame_ms: time(&|_| true),
                    gather_ms: time(&lights_caches),
                }
            }
            Err(error) => Row { shadows, errors: Err(error.to_string()), frame_ms: 0.0, gather_ms: 0.0 },
        };
        compared.rows.push(row);
    }
    Ok(compared)
}

/// Pixels whose centre lies on an edge between two surfaces, tested by rays a thousandth of a pixel away. In a view
/// along a room's axis whole edges pass through pixel centres.
pub fn edges(scene: &Scene, camera: &Camera, size: [u32; 2]) -> Vec<bool> {
    const PARTS: u32 = 1001;
    let world = World::new(scene);
    let fine = size.map(|pixels| pixels * PARTS);
    let [w, h] = size.map(|pixels| pixels as usize);
    let hit = |x: usize, y: usize, aside: [i64; 2]| {
        let at = |pixel: usize, aside: i64| pixel as i64 * i64::from(PARTS) + i64::from(PARTS / 2) + aside;
        let index = at(y, aside[1]) * i64::from(fine[0]) + at(x, aside[0]);
        let (origin, direction) = camera_ray(camera, fine, index as usize);
        let hit = world.nearest(origin, direction, Sides::Front)?;
        Some((hit.instance, hit.distance, world.surface(&hit).geometric))
    };
    let is_edge = |index: usize| {
        let around = [[-1, -1], [1, -1], [-1, 1], [1, 1]].map(|aside| hit(index % w, index / w, aside));
        around[1..].iter().any(|other| match (&around[0], other) {
            (None, None) => false,
            (Some(a), Some(b)) => a.0 != b.0 || (a.1 - b.1).abs() > 0.01 * a.1 || a.2.dot(b.2) < 0.9,
            _ => true,
        })
    };
    (0..w * h).into_par_iter().map(is_edge).collect()
}

/// Errors of each lobe and their sum, over pixels that show a surface in both.
pub fn errors(layers: &Layers, truth: &Layers) -> Vec<(&'static str, Errors)> {
    let covered = |image: &[[f32; 3]]| -> Vec<[f32; 3]> {
        let both = layers.covered.iter().zip(&truth.covered).map(|(a, b)| *a && *b);
        image.iter().zip(both).filter(|pixel| pixel.1).map(|pixel| *pixel.0).collect()
    };
    let layer = |name, image: &[[f32; 3]], truth: &[[f32; 3]]| {
        let (image, truth) = (covered(image), covered(truth));
        let metrics = metrics(&image, &truth);
        (name, Errors { metrics, rmse_over_mean: metrics.rmse / mean(&truth) })
    };
    let mut all = vec![layer("diffuse", &layers.diffuse, &truth.diffuse)];
    if let (Some(image), Some(of_truth)) = (&layers.glossy, &truth.glossy) {
        all.push(layer("glossy", image, of_truth));
        all.push(layer("both", &layers.sum(), &truth.sum()));
    }
    all
}
