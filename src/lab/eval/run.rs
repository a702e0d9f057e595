//! Measures those points of a sweep that are not stored yet.

use super::measure::{Bench, Layers, Measured};
use super::pictures::{Exposure, Pictures};
use super::record::{Errors, Row, Store};
use super::references::{Library, PathTraced, Reference, Truth, make_folder, path_traced};
use super::sweep::{Knob, Point, Sweep};
use crate::error::{Error, Result};
use crate::frame::plan::has_glossy_lobe;
use crate::gpu::Gpu;
use crate::reference::path_trace::PathTraceSettings;
use crate::scene::{Camera, Scene};
use serde_json::json;
use std::path::Path;

/// Incremented when the meaning of stored rows or references changes.
const VERSION: u32 = 3;

/// A sweep to measure: device, scene, points and storage.
pub struct Job<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The scene, not tessellated yet.
    pub scene: &'a Scene,
    /// One of its cameras.
    pub camera: &'a Camera,
    /// The points.
    pub sweep: &'a Sweep,
    /// Folder for rows, references, pictures and the report.
    pub folder: &'a Path,
    /// Identity of the program: results of another program are not used.
    pub program: &'a str,
}

/// Results of a job.
pub struct Results {
    /// One row per point of the sweep, in order.
    pub rows: Vec<Row>,
    /// One brute-force row for each RSM side of the sweep.
    pub brute_force: Vec<Row>,
    /// Metadata of each reference, as in `Reference::about`.
    pub references: Vec<serde_json::Value>,
    /// Number of points measured in this run.
    pub measured: usize,
    /// Number of points that were stored already.
    pub kept: usize,
    /// Missing and superfluous barriers, with `Validation::Sync`.
    pub problems: Vec<String>,
    /// Pictures of the points that have some.
    pub pictures: Pictures,
}

/// A reference, or the reason why there is none.
type Made = std::result::Result<Reference, String>;

/// A job in progress.
struct Work<'a> {
    job: &'a Job<'a>,
    /// Everything that all points depend on.
    context: String,
    bench: Bench<'a>,
    store: Store,
    library: Library,
    progress: &'a (dyn Fn(f32, &str) + Sync),
    steps: usize,
    done: usize,
    results: Results,
}

/// Measures all points that are not stored. `progress` receives the completed share, 0 to 1, and the current step.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn run(job: &Job<'_>, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<Results> {
    make_folder(job.folder)?;
    let (scene, camera, report) = (job.scene.fingerprint(), job.camera, job.gpu.report());
    let pose = (camera.world_from_camera, camera.projection);
    let mut work = Work {
        job,
        context: format!("{VERSION} {} {scene} {pose:?} {} {}", job.program, report.name, report.driver),
        bench: Bench::new(job.gpu, job.scene, job.camera),
        store: Store::open(&job.folder.join("points.jsonl"))?,
        library: Library::open(job.folder.join("references"))?,
        progress,
        steps: job.sweep.points.len() + job.sweep.rsm_sides().len() + 2,
        done: 0,
        results: Results {
            rows: Vec::new(),
            brute_force: Vec::new(),
            references: Vec::new(),
            measured: 0,
            kept: 0,
            problems: Vec::new(),
            pictures: Pictures::open(job.folder.join("pictures"))?,
        },
    };
    let kept_before = work.store.len();
    let sides = job.sweep.rsm_sides();
    let brute_force: Vec<_> = sides.iter().map(|side| Ok((*side, work.brute_force(*side)?))).collect::<Result<_>>()?;
    let traced = [work.path_traced(Truth::Unshadowed)?, work.path_traced(Truth::AllLight)?];
    let truths = Truths { brute_force, traced };
    let best = &truths.best_bare().1.layers;
    if !best.covered.contains(&true) {
        return Err(Error::Nothing("the camera sees no surface; choose another with --camera".into()));
    }
    let exposure = Exposure::of(best);
    for truth in [Truth::FinestVals, Truth::Unshadowed, Truth::AllLight] {
        if let Some(reference) = truths.of(truth, 0) {
            // References differ from each other, too: shows the difference between VALs and paths.
            let key = reference.key();
            work.results.pictures.write_light(key, &reference.layers, exposure)?;
            work.results.pictures.write_error(key, best, truth, &reference.layers)?;
        }
    }
    for (index, side) in sides.into_iter().enumerate() {
        work.compare_brute_force(index, side, &truths)?;
    }
    for point in &job.sweep.points {
        work.point(point, &truths, exposure)?;
    }
    if work.results.kept == 0 && kept_before > 0 {
        log::info!("{kept_before} kept points belong to another scene, device, program or settings");
    }
    progress(1.0, "done");
    Ok(work.results)
}

/// All references.
struct Truths {
    brute_force: Vec<(u32, Made)>,
    /// Path-traced: one bounce without shadows, and all light.
    traced: [Reference; 2],
}

impl Truths {
    /// A reference for points with this RSM side.
    fn of(&self, truth: Truth, side: u32) -> Option<&Reference> {
        let made = |side| self.brute_force.iter().find(|(s, _)| *s == side)?.1.as_ref().ok();
        match truth {
            Truth::SameVals => made(side),
            Truth::FinestVals => made(self.brute_force.last()?.0),
            Truth::Unshadowed => Some(&self.traced[0]),
            Truth::AllLight => Some(&self.traced[1]),
        }
    }

    /// Errors of a point's picture against each reference that fits it.
    fn errors(&self, point: &Point, layers: &Layers) -> Vec<Errors> {
        let side = point.frame.rsm;
        let truths = Truth::ALL.into_iter().filter(|truth| truth.fits(&point.frame));
        let mut all: Vec<Errors> = Vec::new();
        for (truth, reference) in truths.filter_map(|truth| Some((truth, self.of(truth, side)?))) {
            if truth == Truth::FinestVals
                && self.of(Truth::SameVals, side).is_some_and(|own| std::ptr::eq(own, reference))
            {
                // The point's own VALs are the finest: reuse the same errors.
                let same: Vec<Errors> = all.iter().filter(|e| e.truth == Truth::SameVals.name()).cloned().collect();
                all.extend(same.into_iter().map(|errors| Errors { truth: truth.name().into(), ..errors }));
            } else {
                all.extend(Errors::of(layers, truth, &reference.layers));
            }
        }
        all
    }

    /// Whether a stored row was compared with every fitting reference that exists now.
    fn are_in(&self, row: &Row, point: &Point) -> bool {
        let is_in = |truth: Truth| row.errors.iter().any(|errors| errors.truth == truth.name());
        let mut truths = Truth::ALL.into_iter().filter(|truth| truth.fits(&point.frame));
        truths.all(|truth| is_in(truth) || self.of(truth, point.frame.rsm).is_none())
    }

    /// Reference shown next to pictures without shadows: the most VALs, or else unshadowed paths.
    fn best_bare(&self) -> (Truth, &Reference) {
        let finest = self.of(Truth::FinestVals, 0).map(|reference| (Truth::FinestVals, reference));
        finest.unwrap_or((Truth::Unshadowed, &self.traced[0]))
    }

    /// References for a point's error maps: all light, or the best one without shadows.
    fn pictured(&self, point: &Point) -> Vec<Truth> {
        let both = [Truth::AllLight, self.best_bare().0];
        both.into_iter().filter(|truth| truth.fits(&point.frame)).collect()
    }
}

impl<'a> Work<'a> {
    /// Announces a step and counts it; the returned function reports progress within the step.
    fn step(&mut self, what: &str) -> impl Fn(f32, &str) + Sync + use<'a> {
        let (done, steps, what, progress) = (self.done as f32, self.steps as f32, what.to_owned(), self.progress);
        self.done += 1;
        progress(done / steps, &what);
        move |part: f32, _: &str| progress((done + part) / steps, &what)
    }

    fn key(&self, what: &str) -> String {
        blake3::hash(format!("{}\n{what}", self.context).as_bytes()).to_hex().to_string()
    }

    /// Key of a point's row, which also depends on its references.
    fn row_key(&self, point: &Point) -> String {
        let sweep = self.job.sweep;
        let (frames, samples, sides) = (sweep.frames, sweep.samples, sweep.rsm_sides());
        self.key(&format!("row {point:?} {frames} {samples} {:?}", sides.last()))
    }

    /// The brute-force reference for one RSM side, and its row without errors.
    fn brute_force(&mut self, side: u32) -> Result<Made> {
        let point = Point::brute_force(self.job.sweep.base.frame.size, side);
        let key = self.key(&format!("{point:?}"));
        let (name, what) = (format!("brute-force-{side}"), format!("brute force, {side} x {side} texels"));
        let knobs = vec![("gi".into(), "brute-force".into()), ("rsm".into(), side.to_string())];
        let step = self.step(&what);
        let kept = self.library.find(&name, &key);
        let (made, row) = match kept.and_then(|kept| Some((kept.about.get("row").and_then(Row::from_json)?, kept))) {
            Some((row, kept)) => (Ok(kept), row),
            None => match self.bench.measure(&point, self.job.sweep.frames, &step) {
                Ok(measured) => {
                    let row = row(&key, knobs, &measured);
                    self.results.problems.extend(measured.problems);
                    (Ok(self.library.keep(&name, &key, measured.layers, json!({ "row": row.to_json() }))?), row)
                }
                Err(error) => {
                    let failed = Some(error.to_string());
                    (Err(format!("{what}: {error}")), Row { key, knobs, failed, ..Row::default() })
                }
            },
        };
        self.results.brute_force.push(row);
        match &made {
            Ok(reference) => self.results.references.push(reference.about.clone()),
            Err(reason) => log::warn!("{reason}"),
        }
        Ok(made)
    }

    /// Compares brute force with the other references: its VALs have errors, too.
    fn compare_brute_force(&mut self, index: usize, side: u32, truths: &Truths) -> Result<()> {
        let Some(own) = truths.of(Truth::SameVals, side) else { return Ok(()) };
        let point = Point::brute_force(own.layers.size, side);
        let key = self.row_key(&point);
        let row = &mut self.results.brute_force[index];
        row.errors = match self.store.find(&key) {
            Some(kept) => kept.errors.clone(),
            None => {
                let mut errors = truths.errors(&point, &own.layers);
                errors.retain(|errors| errors.truth != Truth::SameVals.name());
                self.store.keep(Row { key, errors: errors.clone(), ..row.clone() })?;
                errors
            }
        };
        Ok(())
    }

    fn path_traced(&mut self, truth: Truth) -> Result<Reference> {
        let (job, sweep) = (self.job, self.job.sweep);
        let size = sweep.base.frame.size;
        let settings = match truth {
            Truth::AllLight => PathTraceSettings::of(size),
            _ => PathTraceSettings::unshadowed(size),
        };
        let wanted = PathTraced { settings, samples: sweep.samples, glossy: has_glossy_lobe(job.scene) };
        let key = self.key(&format!("{wanted:?}"));
        let step = self.step(truth.title());
        let reference = match self.library.find(truth.name(), &key) {
            Some(kept) => kept,
            None => {
                let progress = |part| step(part, "");
                let (layers, about) = path_traced(job.scene, job.camera, &wanted, &self.library.folder, &progress);
                self.library.keep(truth.name(), &key, layers, about)?
            }
        };
        self.results.references.push(reference.about.clone());
        Ok(reference)
    }

    /// Row of one point: stored, measured, or the reason for its failure.
    fn point(&mut self, point: &Point, truths: &Truths, exposure: Exposure) -> Result<()> {
        let sweep = self.job.sweep;
        let value = |knob: &Knob| Some((knob.name.to_owned(), knob.values[knob.of(point)?].label.clone()));
        let mut knobs = vec![("gi".to_owned(), "lightskin".to_owned())];
        knobs.extend(sweep.knobs.iter().filter_map(value));
        let what: Vec<String> = knobs[1..].iter().map(|(name, value)| format!("{name} {value}")).collect();
        let step = self.step(&what.join(", "));
        let (key, is_pictured) = (self.row_key(point), sweep.is_pictured(point));
        let pictured = if is_pictured { truths.pictured(point) } else { Vec::new() };
        let is_whole =
            |row: &&Row| truths.are_in(row, point) && (!is_pictured || self.results.pictures.has(&key, &pictured));
        if let Some(row) = self.store.find(&key).filter(is_whole) {
            self.results.kept += 1;
            self.results.rows.push(row.clone());
            return Ok(());
        }
        match self.bench.measure(point, sweep.frames, &step) {
            Ok(measured) => {
                let mut row = row(&key, knobs, &measured);
                row.errors = truths.errors(point, &measured.layers);
                if is_pictured {
                    self.results.pictures.write_light(&key, &measured.layers, exposure)?;
                }
                for (truth, reference) in pictured.iter().filter_map(|t| Some((*t, truths.of(*t, 0)?))) {
                    self.results.pictures.write_error(&key, &measured.layers, truth, &reference.layers)?;
                }
                self.store.keep(row.clone())?;
                self.results.measured += 1;
                self.results.problems.extend(measured.problems);
                self.results.rows.push(row);
            }
            Err(error) => {
                log::warn!("{}: {error}", what.join(", "));
                self.results.rows.push(Row { key, knobs, failed: Some(error.to_string()), ..Row::default() });
            }
        }
        Ok(())
    }
}

fn row(key: &str, knobs: Vec<(String, String)>, measured: &Measured) -> Row {
    let Measured { caches, spacing, vals, triangles, frames, .. } = *measured;
    let stages = measured.stages.clone();
    Row { key: key.into(), knobs, caches, spacing, vals, triangles, stages, frames, ..Row::default() }
}
