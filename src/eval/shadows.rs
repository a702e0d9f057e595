//! Soft shadows of indirect light on the device against one bounce of the path tracer: how far each kind is from the truth.

use super::measure::{Bench, Layers};
use super::metrics::{Metrics, mean, metrics};
use super::references::{PathTraced, path_traced};
use super::sweep::Point;
use crate::error::Result;
use crate::frame::{self, Plan, Shadows};
use crate::gpu::Gpu;
use crate::scene::Scene;
use std::path::Path;

/// What a comparison is made of.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Picture [pixels].
    pub size: [u32; 2],
    /// Caches that are asked for.
    pub caches: usize,
    /// Texels of an RSM's side.
    pub rsm: u32,
    /// Samples per pixel of the path tracer.
    pub samples: u32,
    /// Frames whose median time counts.
    pub frames: usize,
}

/// One kind of shadows in one scene.
#[derive(Clone, Debug)]
pub struct Row {
    /// The kind.
    pub shadows: Shadows,
    /// Errors of each layer by its name, over the pixels that show a surface; or why there are none.
    pub errors: std::result::Result<Vec<(&'static str, Errors)>, String>,
    /// Median GPU time [ms] of the whole frame; 0 where the device has no timestamps.
    pub frame_ms: f64,
    /// Of the gather and what shadows add to it.
    pub gather_ms: f64,
}

/// Errors of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Against the path tracer.
    pub metrics: Metrics,
    /// Root of the mean squared error over the mean of the truth.
    pub rmse_over_mean: f64,
}

/// All kinds in one scene.
#[derive(Clone, Debug)]
pub struct Compared {
    /// One for each kind.
    pub rows: Vec<Row>,
    /// Caches that were placed.
    pub caches: u32,
    /// Relative standard error of the truth, mean over its pixels.
    pub noise: f64,
    /// What the barrier check said against the frames.
    pub problems: Vec<String>,
}

/// All kinds of shadows.
pub const KINDS: [Shadows; 3] = [Shadows::Off, Shadows::Proxy, Shadows::PerLight];

/// Stages whose time is the gather's.
const GATHER_STAGES: [&str; 3] = ["depth images", "gather", "occlude"];

/// Compares every kind with the path tracer, from the scene's first camera. Path-traced samples are kept in `folder`.
pub fn compare(
    gpu: &Gpu,
    scene: &Scene,
    settings: &Settings,
    folder: &Path,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Compared> {
    let camera = &scene.cameras[0];
    let frame = frame::Settings { size: settings.size, rsm: settings.rsm, ..frame::Settings::default() };
    let glossy = Plan::new(scene, &frame).glossy;
    let wanted = PathTraced { size: settings.size, visibility: true, samples: settings.samples, glossy };
    let (truth, about) = path_traced(scene, camera, &wanted, folder, progress);
    let mut bench = Bench::new(gpu, scene, camera);
    let mut compared = Compared {
        rows: Vec::new(),
        caches: 0,
        noise: about["noise"].as_f64().unwrap_or(f64::NAN),
        problems: Vec::new(),
    };
    for shadows in KINDS {
        let point = Point {
            frame: frame::Settings { shadows, ..frame },
            caches: settings.caches,
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
                    gather_ms: time(&|name| GATHER_STAGES.contains(&name)),
                }
            }
            Err(error) => Row { shadows, errors: Err(error.to_string()), frame_ms: 0.0, gather_ms: 0.0 },
        };
        compared.rows.push(row);
    }
    Ok(compared)
}

/// Errors of each lobe over the pixels that both say show a surface.
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
    if let (Some(image), Some(truth)) = (&layers.glossy, &truth.glossy) {
        all.push(layer("glossy", image, truth));
    }
    all
}
