//! Measures one point on the device: its layers and times.

use super::sweep::Point;
use crate::bake::{self, Density};
use crate::error::{Error, Result};
use crate::frame::{Picture, View, World};
use crate::gpu::{FrameTimes, Gpu};
use crate::image::broken_values;
use crate::lab::knobs::{Frame, Gi};
use crate::scene::{Camera, Scene, tessellate};
use std::time::{Duration, Instant};

/// Indirect radiance of a picture, lobe by lobe, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Layers {
    /// Picture \[pixels\].
    pub size: [u32; 2],
    /// Diffuse lobe [cd/m^2].
    pub diffuse: Vec<[f32; 3]>,
    /// Glossy lobe [cd/m^2]; `None` if no material has one.
    pub glossy: Option<Vec<[f32; 3]>>,
    /// Pixels that show a surface.
    pub covered: Vec<bool>,
}

impl Layers {
    /// Sum of both lobes.
    pub fn sum(&self) -> Vec<[f32; 3]> {
        match &self.glossy {
            None => self.diffuse.clone(),
            Some(glossy) => {
                let add = |(a, b): (&[f32; 3], &[f32; 3])| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
                self.diffuse.iter().zip(glossy).map(add).collect()
            }
        }
    }

    /// Layers by their names in EXR files: the lobes and their sum.
    pub fn named(&self) -> Vec<(&'static str, Vec<[f32; 3]>)> {
        let glossy = self.glossy.clone().map(|glossy| ("indirect.glossy", glossy));
        [("indirect.diffuse", self.diffuse.clone())]
            .into_iter()
            .chain(glossy)
            .chain([("indirect", self.sum())])
            .collect()
    }
}

/// Result of measuring a point.
pub struct Measured {
    /// The picture.
    pub layers: Layers,
    /// Median GPU time \[ms\] of each stage.
    pub stages: Vec<(String, f64)>,
    /// Number of frames in that median.
    pub frames: usize,
    /// Caches placed.
    pub caches: u32,
    /// Spacing of the caches \[m\]; 0 without caches.
    pub spacing: f64,
    /// Number of VALs.
    pub vals: u32,
    /// Triangles after tessellation.
    pub triangles: usize,
    /// Missing and superfluous barriers, with `Validation::Sync`.
    pub problems: Vec<String>,
}

/// No further frames are drawn once a point's frames have taken this long.
const LONGEST: Duration = Duration::from_secs(10);

/// A scene on the device, with caches that several points share.
struct Prepared {
    of: (Option<Density>, f32, usize, Option<f64>),
    scene: Scene,
    world: World,
    spacing: f64,
}

/// Measures points one after another; consecutive points with the same caches share a bake and an upload.
pub struct Bench<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    camera: &'a Camera,
    prepared: Option<Prepared>,
}

impl<'a> Bench<'a> {
    /// For a scene that is not tessellated yet.
    pub fn new(gpu: &'a Gpu, scene: &'a Scene, camera: &'a Camera) -> Self {
        Self { gpu, scene, camera, prepared: None }
    }

    /// Renders a point: one warm-up frame, then `frames` of which the median is taken. Slow frames are drawn fewer
    /// times, at least the first one.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn measure(&mut self, point: &Point, frames: usize, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<Measured> {
        let (gpu, camera) = (self.gpu, self.camera);
        let Prepared { scene, world, spacing, .. } = self.prepare(point, progress)?;
        let view = View::new(camera, point.frame.size, world.origin, world.radius);
        let mut frame = Frame::new(gpu, scene, world, &point.frame)?;
        let (mut runs, mut problems) = (Vec::new(), Vec::new());
        let start = Instant::now();
        while runs.is_empty() || (runs.len() <= frames && start.elapsed() < LONGEST) {
            // Software drivers attribute chained passes wrongly: submit each stage alone there.
            let drawn = gpu.timed_frame(|cmd| {
                frame.record(cmd, world, &view);
                Ok(())
            })?;
            runs.push(gpu.times(&drawn)?);
            problems.extend(drawn.problems);
        }
        let layers = read_layers(gpu, &frame)?;
        let values = layers.diffuse.iter().chain(layers.glossy.iter().flatten());
        let broken: usize = values.map(|pixel| broken_values(pixel)).sum();
        if broken > 0 {
            let what = format!("{broken} values of the picture are negative or not finite; this is a bug of lightskin");
            return Err(Error::Nothing(what));
        }
        Ok(Measured {
            layers,
            stages: medians(if runs.len() > 1 { &runs[1..] } else { &runs }),
            frames: (runs.len() - 1).max(1),
            caches: frame.light.caches().map_or(0, |caches| caches.atlas.count),
            spacing: *spacing,
            vals: frame.light.vals().map_or(0, |vals| vals.count),
            triangles: scene.triangle_count(),
            problems,
        })
    }

    fn prepare(&mut self, point: &Point, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<&Prepared> {
        let density = (point.frame.gi == Gi::LightSkin).then_some(Density::Count(point.caches));
        let of = (density, point.angle, point.references, point.max_edge);
        if self.prepared.as_ref().is_none_or(|prepared| prepared.of != of) {
            // Drop the old one first: the device may not hold two.
            self.prepared = None;
            let mut scene = self.scene.clone();
            let spacing = tessellate::expected_spacing(&scene, point.caches);
            tessellate::divide(&mut scene, spacing, point.max_edge);
            let settings = |density| bake::BakeSettings { density, angle: point.angle, references: point.references };
            let caches = density.map(|d| bake::bake_cached(&scene, &settings(d), progress)).transpose()?;
            let caches = caches.map(|(caches, _)| caches);
            let world = World::new(self.gpu, &scene, caches.as_ref())?;
            let spacing = caches.map_or(0.0, |caches| caches.spacing);
            self.prepared = Some(Prepared { of, scene, world, spacing });
        }
        self.prepared.as_ref().ok_or_else(|| Error::Nothing("no scene".into()))
    }
}

/// Indirect light and coverage of the last frame.
fn read_layers(gpu: &Gpu, frame: &Frame) -> Result<Layers> {
    let Picture { surface, indirect, .. } = &frame.picture;
    let depth: Vec<f32> = gpu.read_image(&surface.depth)?;
    let rgb = |image| -> Result<Vec<[f32; 3]>> {
        let texels: Vec<[f32; 4]> = gpu.read_image(image)?;
        Ok(texels.into_iter().map(|t| [t[0], t[1], t[2]]).collect())
    };
    let indirect = indirect.as_ref().ok_or_else(|| Error::Nothing("the scene has no light".into()))?;
    Ok(Layers {
        size: surface.size,
        diffuse: rgb(&indirect.diffuse)?,
        glossy: indirect.glossy.as_ref().map(rgb).transpose()?,
        covered: depth.iter().map(|d| *d > 0.0).collect(),
    })
}

/// Median time \[ms\] of each stage over these frames; empty without timestamps.
pub(crate) fn medians(runs: &[FrameTimes]) -> Vec<(String, f64)> {
    let stages: Vec<_> = runs.iter().map(FrameTimes::stages).collect();
    let median = |name: &str| {
        let mut all: Vec<f64> = stages.iter().flatten().filter(|s| s.name == name).filter_map(|s| s.gpu_ms).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied()
    };
    let names = stages.first().into_iter().flatten().map(|s| s.name);
    names.filter_map(|name| Some((name.to_owned(), median(name)?))).collect()
}
