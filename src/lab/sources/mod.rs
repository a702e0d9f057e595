//! Sources of error of indirect light: the engine's picture is made exact step by step in f64 on the CPU, up to the
//! path tracer's. METHOD 2-5.
//!
//! The chain starts with the twin of the device's picture ([`Stage::interpolate`]). Each link replaces one
//! approximation and keeps all previous replacements, so that differences between neighbours add up to the whole error.
//! Each replacement is also measured alone in the engine.

mod between;
pub mod curves;
pub mod exact;
pub mod stage;
pub mod table;
pub mod vals;

use std::time::Instant;

use glam::DVec3;

use crate::bake::CacheSet;
use crate::reference::path_trace::{self, PASS_SAMPLES, PathTrace};
use crate::reference::world::World;
use crate::scene::{Camera, Scene};
use exact::Exact;
use stage::{Level, Stage};
use table::{Figures, Row, Table};
use vals::{Texel, cast};

/// Diffuse and glossy radiance [cd/m^2] of each pixel that shows a surface.
pub type Lights = Vec<[DVec3; 2]>;

/// Parameters of the measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourcesSettings {
    /// Grid of pixels over the camera's picture.
    pub size: [u32; 2],
    /// Side of an RSM \[texels\].
    pub rsm: u32,
    /// Samples per pixel of the path tracer.
    pub samples: u32,
    /// Number of indirect bounces taken as the limit.
    pub bounces: u32,
}

impl Default for SourcesSettings {
    fn default() -> Self {
        Self { size: [96, 54], rsm: 128, samples: 1024, bounces: 8 }
    }
}

/// Results of the measurement.
#[derive(Clone, Debug)]
pub struct Sources {
    /// Number of caches.
    pub caches: usize,
    /// Number of VALs with light.
    pub vals: usize,
    /// Index of each pixel that shows a surface, row by row from the top: the order of all [`Lights`].
    pub pixels: Vec<usize>,
    /// Start of the chain, which should equal the device's picture.
    pub engine: Lights,
    /// End of the chain: one indirect bounce, path-traced with shadows.
    pub truth: Lights,
    /// One table per lobe: diffuse and, if any, glossy.
    pub tables: Vec<Table>,
}

/// Measurement in progress.
struct Work<'a> {
    stage: Stage<'a>,
    camera: &'a Camera,
    settings: SourcesSettings,
    progress: &'a (dyn Fn(f32, &str) + Sync),
    done: usize,
}

/// Number of pictures, for progress.
const PICTURES: usize = 23;

/// Makes all pictures and compares them. `scene` must be the baked one; `progress` receives the completed share, 0 to
/// 1, and the current step.
pub fn sources(
    scene: &Scene,
    camera: &Camera,
    caches: &CacheSet,
    settings: &SourcesSettings,
    progress: &(dyn Fn(f32, &str) + Sync),
) -> Sources {
    let stage = Stage::new(World::new(scene), camera, caches, settings.size);
    let mut work = Work { stage, camera, settings: *settings, progress, done: 0 };
    let n = settings.rsm;
    let [texels, double, fourfold] =
        [n, 2 * n, 4 * n].map(|n| work.step("virtual lights", |w| cast(&w.stage.world, n)));
    let none = Exact::default();
    let rsm = |n: u32| format!("RSM: {n} texels a side");

    let engine = work.engine("engine", &texels, none, false);
    let mut chain = Chain::new(engine.clone());
    let proxies = work.stage.gather(&texels, none, false);
    chain.add(ACROSS, work.step("references at the pixel", |w| w.stage.interpolate(&proxies, Level::Pixel)));
    chain.add(PROXY, work.step("all lights of each cache", |w| w.stage.interpolate_each(&texels, Level::Pixel)));
    chain.add(CACHES, work.brute_force("brute force", &texels, none));
    let mut exact = Exact { form_factor: true, ..none };
    chain.add(FORM_FACTOR, work.brute_force("exact form factor", &texels, exact));
    exact.lobe = true;
    chain.add(LOBE, work.brute_force("lobe over the disc", &texels, exact));
    exact.footprint = true;
    chain.add(FOOTPRINT, work.brute_force("tilted footprint", &texels, exact));
    chain.add(&rsm(2 * n), work.brute_force("RSM of 2N", &double, exact));
    chain.add(&rsm(4 * n), work.brute_force("RSM of 4N", &fourfold, exact));
    let unlimited = path_trace::PathTraceSettings::unshadowed(settings.size);
    let [limit, limit_half] = work.traced("path tracer without shadows", &unlimited);
    chain.add("RSM: without end", limit.clone());
    let one_bounce = path_trace::PathTraceSettings::engine(settings.size, 1);
    let [truth, truth_half] = work.traced("path tracer", &one_bounce);
    chain.add(SHADOWS, truth.clone());

    let mut alone: Vec<(String, Lights)> = Vec::new();
    alone.push((ACROSS.into(), chain.links[1].1.clone()));
    let each = work.step("all lights of each cache, at vertices", |w| w.stage.interpolate_each(&texels, Level::Vertex));
    alone.push((PROXY.into(), each));
    alone.push((CACHES.into(), chain.links[3].1.clone()));
    let only = Exact { form_factor: true, ..none };
    alone.push((FORM_FACTOR.into(), work.engine("exact form factor alone", &texels, only, false)));
    let only = Exact { lobe: true, ..none };
    alone.push((LOBE.into(), work.engine("lobe over the disc alone", &texels, only, false)));
    let only = Exact { footprint: true, ..none };
    alone.push((FOOTPRINT.into(), work.engine("tilted footprint alone", &texels, only, false)));
    alone.push((rsm(2 * n), work.engine("RSM of 2N alone", &double, none, false)));
    alone.push((rsm(4 * n), work.engine("RSM of 4N alone", &fourfold, none, false)));
    alone.push((SHADOWS.into(), work.engine("shadows alone", &texels, none, true)));

    let mut beyond = Chain::new(truth.clone());
    let glossy = path_trace::PathTraceSettings { glossy_bounces: true, ..one_bounce };
    beyond.add("glossy first bounce", work.traced("path tracer with glossy bounces", &glossy)[0].clone());
    let bounces = path_trace::PathTraceSettings { bounces: Some(settings.bounces), ..glossy };
    let what = format!("{} bounces", settings.bounces);
    beyond.add(&what, work.traced("path tracer with more bounces", &bounces)[0].clone());

    let lobes: &[&str] = if work.stage.glossy { &["diffuse", "glossy"] } else { &["diffuse"] };
    let table = |(lobe, name): (usize, &&str)| {
        let of = |lights: &Lights| -> Vec<DVec3> { lights.iter().map(|light| light[lobe]).collect() };
        let (whole, truth) = (&truth, of(&truth));
        Table {
            lobe: (*name).into(),
            rows: chain.rows(lobe, &alone, &truth),
            beyond: beyond.rows(lobe, &[], &truth),
            whole: Figures::of(&of(&engine), &truth, &truth),
            noise: [(&limit_half, &limit), (&truth_half, whole)]
                .map(|(half, all)| Figures::of(&of(half), &of(all), &truth)),
        }
    };
    progress(1.0, "done");
    Sources {
        caches: work.stage.caches.len(),
        vals: texels.len(),
        pixels: work.stage.pixels.iter().map(|pixel| pixel.index).collect(),
        tables: lobes.iter().enumerate().map(table).collect(),
        engine,
        truth,
    }
}

const ACROSS: &str = "interpolation across a triangle";
const PROXY: &str = "one proxy for many lights";
const CACHES: &str = "interpolation between caches";
const FORM_FACTOR: &str = "disc form factor";
const LOBE: &str = "BRDF constant over the disc";
const FOOTPRINT: &str = "area square to the axis";
const SHADOWS: &str = "missing shadows";

impl Work<'_> {
    fn step<T>(&mut self, what: &str, work: impl FnOnce(&Self) -> T) -> T {
        (self.progress)((self.done as f32 / PICTURES as f32).min(1.0), what);
        self.done += 1;
        let start = Instant::now();
        let made = work(self);
        log::info!("{what}: {:.1} s", start.elapsed().as_secs_f64());
        made
    }

    fn engine(&mut self, what: &str, texels: &[Texel], exact: Exact, shadows: bool) -> Lights {
        let picture = |w: &Self| w.stage.interpolate(&w.stage.gather(texels, exact, shadows), Level::Vertex);
        self.step(what, picture)
    }

    fn brute_force(&mut self, what: &str, texels: &[Texel], exact: Exact) -> Lights {
        self.step(what, |w| w.stage.brute_force(texels, exact))
    }

    /// The picture of all samples, and that of half of them: on average it differs from the full one by as much as the
    /// full one from the limit.
    fn traced(&mut self, what: &str, settings: &path_trace::PathTraceSettings) -> [Lights; 2] {
        let half = |w: &Self, seed| {
            let settings = path_trace::PathTraceSettings { seed, ..*settings };
            let mut trace = PathTrace::new(w.stage.world.scene(), w.camera, &settings);
            for _ in 0..w.settings.samples.div_ceil(2 * PASS_SAMPLES) {
                trace.pass();
            }
            let (diffuse, glossy) = (trace.diffuse(), trace.glossy());
            let at = |i: usize| [&diffuse, &glossy].map(|lobe| DVec3::from(lobe[i].map(f64::from)));
            w.stage.pixels.iter().map(|pixel| at(pixel.index)).collect::<Lights>()
        };
        self.step(what, |w| {
            let (a, b) = (half(w, 1), half(w, 2));
            let mean = a.iter().zip(&b).map(|(a, b)| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]).collect();
            [mean, a]
        })
    }
}

/// Pictures, each with one more approximation replaced.
struct Chain {
    /// The last replacement, and the picture.
    links: Vec<(String, Lights)>,
}

impl Chain {
    fn new(first: Lights) -> Self {
        Self { links: vec![(String::new(), first)] }
    }

    fn add(&mut self, what: &str, picture: Lights) {
        self.links.push((what.into(), picture));
    }

    /// The steps for one lobe, relative to the mean of `truth`.
    fn rows(&self, lobe: usize, alone: &[(String, Lights)], truth: &[DVec3]) -> Vec<Row> {
        let of = |lights: &Lights| -> Vec<DVec3> { lights.iter().map(|light| light[lobe]).collect() };
        let pictures: Vec<Vec<DVec3>> = self.links.iter().map(|(_, lights)| of(lights)).collect();
        let row = |i: usize| Row {
            name: self.links[i].0.clone(),
            change: Figures::of(&pictures[i - 1], &pictures[i], truth),
            share: 0.0,
            square_share: table::square_share(
                &pictures[i - 1],
                &pictures[i],
                &pictures[0],
                &pictures[pictures.len() - 1],
            ),
            alone: alone.iter().find(|a| a.0 == self.links[i].0).map(|a| Figures::of(&of(&a.1), truth, truth)),
        };
        let mut rows: Vec<Row> = (1..pictures.len()).map(row).collect();
        let total: f64 = rows.iter().map(|row| row.change.mae).sum();
        rows.iter_mut().for_each(|row| row.share = if total > 0.0 { row.change.mae / total } else { 0.0 });
        rows
    }
}
