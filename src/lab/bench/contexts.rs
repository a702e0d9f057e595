//! The thesis's four contexts: triangles (table 6.1) with bake times, resolution (6.2), caches and VALs (6.3) with
//! pairs per second.

use super::extent::Extent;
use super::measure::{Budget, OnDevice, Times, bake, in_turn, settings, too_large};
use super::table::{Cell, Table};
use super::thesis;
use super::{accuracy, native};
use crate::bake::{CacheSet, NO_CACHE};
use crate::error::{Error, Result};
use crate::frame::atlas::Atlas;
use crate::frame::gather::{Compute, ComputeKind, Gather, Lit};
use crate::frame::gather_draws::Draws;
use crate::frame::occlude::Occlude;
use crate::frame::plan::{Features, Plan};
use crate::frame::proxies::Proxies;
use crate::frame::tune::Tuned;
use crate::frame::vals::Vals;
use crate::frame::{DrawSource, Light, Shadows, View};
use crate::gpu::Gpu;
use crate::lab::knobs::{Gi, Knobs, Path};
use crate::lab::scenes::valley;
use crate::scene::Projection;
use crate::shared::{Cache, Val};
use std::time::Instant;

/// Versions of table 6.1: name, glossy lobes, references per vertex.
pub const VERSIONS: [(&str, bool, usize); 4] =
    [("D8", false, 8), ("D16", false, 16), ("DG8", true, 8), ("DG16", true, 16)];

/// Stages of the frames of table 6.1, in order.
fn stages() -> Vec<&'static str> {
    let settings = Knobs::plain([1, 1]).settings();
    let plan = Plan::of(&Features { lights: true, glossy: true, ..Features::default() }, &settings);
    plan.stages().map(|stage| stage.name).collect()
}

/// Caches of tables 6.1 and 6.2.
const CACHES: [usize; 2] = [500, 1000];

/// RSM side \[texels\] where the thesis gives none: its usual value.
const RSM: u32 = 128;

/// Arithmetic operations per pair in `glsl/lib/gather.glsl`, without and with the glossy lobe. Sums, products, quotients,
/// roots, powers and maxima count one each, a multiply-add two.
pub const FLOP_PER_PAIR: [f64; 2] = [42.0, 69.0];

/// Minimum number of rounds of stage 6 by both paths and the CPU.
const ROUNDS: usize = 3;

/// Inputs of the measurements.
pub struct Contexts<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// Points to measure.
    pub extent: &'a Extent,
    /// Arithmetic peak of the device [flop/s].
    pub peak: f64,
    /// Fastest settings of the compute gather.
    pub tuned: Tuned,
    /// Receives the completed share, 0 to 1, and the current step.
    pub progress: &'a dyn Fn(f32, &str),
    /// Missing and superfluous barriers, with `Validation::Sync`.
    pub problems: Vec<String>,
}

/// Rows for one triangle count.
struct OfTriangles {
    times: Vec<Cell>,
    bake: Vec<Cell>,
    stages: Vec<Vec<Cell>>,
}

/// Whether an error means that the world is too large for the device, as opposed to a bug.
fn does_not_fit(error: &Error) -> bool {
    matches!(error, Error::TooLarge(_) | Error::Vulkan { .. })
}

impl Contexts<'_> {
    fn method(&self) -> String {
        let Extent { warm_up, frames, .. } = self.extent;
        let how =
            if self.gpu.is_software() { "each stage submitted alone" } else { "timestamps within one submission" };
        format!("GPU timestamps of each stage ({how}), median of {frames} frames after {warm_up} warm-up frames.")
    }

    fn keep(&mut self, times: Times) -> Times {
        self.problems.extend(times.problems.iter().cloned());
        times
    }

    /// Times of frames that are compared, measured in turn.
    fn in_turn(&mut self, compared: &[(&OnDevice<'_>, Knobs)]) -> Result<Vec<Times>> {
        let mut frames = compared.iter().map(|(world, knobs)| world.frame(knobs)).collect::<Result<Vec<_>>>()?;
        let mut compared: Vec<_> =
            compared.iter().zip(&mut frames).map(|((world, _), frame)| (*world, frame)).collect();
        let times = in_turn(&mut compared, self.extent.warm_up, self.extent.frames)?;
        Ok(times.into_iter().map(|times| self.keep(times)).collect())
    }

    /// Table 6.1, the table of its stages, and the table of bake times.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn triangles(&mut self) -> Result<[Table; 3]> {
        let [w, h] = self.extent.window;
        let mut columns = vec!["triangles".to_owned(), "LI [ms]".into()];
        columns.extend(VERSIONS.map(|v| format!("{} [ms]", v.0)));
        columns.extend(VERSIONS.iter().flat_map(|v| [format!("{} / LI", v.0), format!("thesis {} / LI", v.0)]));
        columns.extend(["LI", "DG8"].map(|v| format!("thesis {v} [ms]")));
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        let how = format!(
            "D: diffuse only; DG: diffuse and glossy lobes; each with 8 or 16 references per vertex. LI: direct light only. \
             {} caches, {w}x{h} pixels, {RSM}x{RSM} VALs; the thesis does not state its picture size and number of VALs. \
             Versions alternate frame by frame. {}",
            CACHES[0],
            self.method()
        );
        let mut table = Table::new("triangles", "Triangles (thesis table 6.1)", how, &columns);
        let how = "Time to place the caches and find 8 or 16 references per vertex, on all cores, measured once without kept files.";
        let columns = ["triangles", "caches", "bake of 8 [s]", "bake of 16 [s]"];
        let mut bakes = Table::new("bake", "Bake", how.into(), &columns);
        let columns: Vec<String> = ["triangles", "version"]
            .into_iter()
            .map(str::to_owned)
            .chain(stages().iter().map(|s| format!("{s} [ms]")))
            .collect();
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        let how = "The stages of the frames of table 6.1.".to_owned();
        let mut stages = Table::new("stages", "Stages", how, &columns);
        let mut budget = Budget::new(self.extent.budget);
        for (i, count) in self.extent.triangles.iter().enumerate() {
            (self.progress)(i as f32 / self.extent.triangles.len() as f32, &format!("{count} triangles"));
            let fits = too_large(*count).map_or_else(|| budget.begin(*count as f64), Err);
            let measured = match fits {
                Err(reason) => Err(reason),
                Ok(()) => match self.of_triangles(*count) {
                    Err(error) if does_not_fit(&error) => Err(error.to_string()),
                    other => Ok(other?),
                },
            };
            match measured {
                Ok(rows) => {
                    table.push(rows.times);
                    bakes.push(rows.bake);
                    rows.stages.into_iter().for_each(|row| stages.push(row));
                }
                Err(reason) => {
                    let rest: Vec<String> = self.extent.triangles[i..].iter().map(usize::to_string).collect();
                    table.skipped.push(format!("{} triangles: {reason}.", rest.join(", ")));
                    break;
                }
            }
        }
        Ok([table, bakes, stages])
    }

    fn of_triangles(&mut self, count: usize) -> Result<OfTriangles> {
        let size = self.extent.window;
        let scene = valley(count, false);
        let (of_8, seconds_8) = bake(&scene, CACHES[0], 8)?;
        let (of_16, seconds_16) = bake(&scene, CACHES[0], 16)?;
        let caches: usize = of_8.models.iter().map(|model| model.caches.len()).sum();
        // The same surface with another material: the caches are the same.
        let glossy = valley(count, true);
        let ways = self.tuned.ways;
        let mut worlds = vec![(OnDevice::new(self.gpu, &scene, None)?, settings(size, Gi::Off, RSM, ways))];
        for (_, is_glossy, references) in VERSIONS {
            let scene = if is_glossy { &glossy } else { &scene };
            let set = if references == 16 { &of_16 } else { &of_8 };
            worlds.push((OnDevice::new(self.gpu, scene, Some(set))?, settings(size, Gi::LightSkin, RSM, ways)));
        }
        let worlds: Vec<_> = worlds.iter().map(|(world, settings)| (world, *settings)).collect();
        let all = self.in_turn(&worlds)?;
        let triangles = scene.triangle_count();
        let of_stages = |(name, times): (&str, &Times)| -> Vec<Cell> {
            let stage = |stage| Cell::from(times.stage(stage));
            [triangles.into(), name.into()].into_iter().chain(stages().into_iter().map(stage)).collect()
        };
        let names = ["LI"].into_iter().chain(VERSIONS.map(|version| version.0));
        let stages = names.zip(&all).map(of_stages).collect();
        let all: Vec<f64> = all.iter().map(Times::frame).collect();
        let (direct, all) = (all[0], &all[1..]);
        let thesis = |version| thesis::frame_ms(thesis::TRIANGLES, &[triangles as u32], version);
        let ratio = |version| Some(thesis(version)? / thesis("LI")?);
        let mut row: Vec<Cell> = vec![triangles.into(), direct.into()];
        row.extend(all.iter().map(|ms| Cell::from(*ms)));
        for ((version, ..), ms) in VERSIONS.iter().zip(all) {
            row.extend([Cell::from(ms / direct), ratio(version).into()]);
        }
        row.extend(["LI", "DG8"].map(|version| Cell::from(thesis(version))));
        let bake = vec![triangles.into(), caches.into(), seconds_8.into(), seconds_16.into()];
        Ok(OfTriangles { times: row, bake, stages })
    }

    /// Table 6.2.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn resolution(&mut self) -> Result<Table> {
        let columns =
            ["width", "height", "LI [ms]", "GI [ms]", "GI / LI", "thesis LI [ms]", "thesis GI [ms]", "thesis GI / LI"];
        let how = format!(
            "GI: diffuse and glossy lobes, 8 references per vertex, {} caches, {RSM}x{RSM} VALs; LI: direct light only. {} \
             triangles; the thesis states neither its scene nor its lobes. {}",
            CACHES[1],
            self.extent.ground,
            self.method()
        );
        let mut table = Table::new("resolution", "Resolution (thesis table 6.2)", how, &columns);
        let scene = valley(self.extent.ground, true);
        let (set, _) = bake(&scene, CACHES[1], 8)?;
        let world = OnDevice::new(self.gpu, &scene, Some(&set))?;
        let mut budget = Budget::new(self.extent.budget);
        for (i, [w, h]) in self.extent.resolutions.iter().copied().enumerate() {
            (self.progress)(i as f32 / self.extent.resolutions.len() as f32, &format!("{w}x{h} pixels"));
            let both = |this: &mut Self| -> Result<[f64; 2]> {
                let ways = this.tuned.ways;
                let both = [Gi::Off, Gi::LightSkin].map(|gi| (&world, settings([w, h], gi, RSM, ways)));
                let both = this.in_turn(&both)?;
                Ok([both[0].frame(), both[1].frame()])
            };
            let measured = match budget.begin(f64::from(w * h)) {
                Err(reason) => Err(reason),
                Ok(()) => match both(self) {
                    Err(error) if does_not_fit(&error) => Err(error.to_string()),
                    other => Ok(other?),
                },
            };
            match measured {
                Ok([direct, all]) => {
                    let thesis = |column| thesis::frame_ms(thesis::RESOLUTION, &[w, h], column);
                    let (thesis_direct, thesis_all) = (thesis("LI"), thesis("GI"));
                    let ratio = thesis_direct.zip(thesis_all).map(|(direct, all)| all / direct);
                    let mut row: Vec<Cell> = vec![(w as usize).into(), (h as usize).into()];
                    row.extend([direct, all, all / direct].map(Cell::from));
                    row.extend([thesis_direct, thesis_all, ratio].map(Cell::from));
                    table.push(row);
                }
                Err(reason) => table.skipped.push(format!("{w}x{h} pixels: {reason}.")),
            }
        }
        Ok(table)
    }

    /// Table 6.3 and the table of pairs per second.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn caches(&mut self) -> Result<[Table; 2]> {
        let columns = [
            "lobes",
            "asked",
            "caches",
            "VALs",
            "frame [ms]",
            "gather [ms]",
            "occlude [ms]",
            "of all discs [ms]",
            "frame / first",
            "thesis [ms]",
            "thesis / first",
        ];
        let [w, h] = self.extent.size;
        let how = format!(
            "{} triangles, {w}x{h} pixels, 8 references per vertex. DGS: DG with proxy shadows (stage 7); \"of all discs\" is that \
             stage without skipping. \"first\" is the row with the fewest caches and VALs. The thesis's \
             column SSS (subsurface scattering) is in the table of that name. {}",
            self.extent.ground,
            self.method()
        );
        let mut table = Table::new("caches", "Caches x VALs (thesis table 6.3)", how, &columns);
        let (registers, lanes) = native::registers();
        let columns = [
            "lobes",
            "caches",
            "VALs",
            "compute [G pairs/s]",
            "fragment [G pairs/s]",
            "share of peak",
            "native [G pairs/s]",
            "compute / native",
            "fragment / native",
            "diffuse off f64",
            "glossy off f64",
        ];
        let how = format!(
            "Pairs of a cache and a VAL in stage 6 with every cache lit, by both paths. Share of peak: of the faster path, relative \
             to {:.1} Gflop/s, the rate of independent multiply-adds in a shader in the same run (`glsl/peak.comp`); a pair \
             counts {} operations, {} with the glossy lobe. Native: the same sums for the same caches and VALs on {} CPU \
             threads with {lanes} lanes per register ({registers}). Both paths and the CPU alternate; medians of at least {ROUNDS} \
             rounds and {} s, over {} pipelines in turn, because pipelines of identical code can differ in speed. Off \
             f64: largest relative error of a lobe's irradiance by either path at a sample of caches.",
            self.peak * 1e-9,
            FLOP_PER_PAIR[0],
            FLOP_PER_PAIR[1],
            rayon::current_num_threads(),
            self.extent.rounds,
            self.extent.pipelines
        );
        let mut pairs = Table::new("pairs", "Gather: pairs per second", how, &columns);
        for (glossy, name) in [(false, "D"), (true, "DG")] {
            let scene = valley(self.extent.ground, glossy);
            let mut budget = Budget::new(0.5 * self.extent.budget);
            let mut first = [None; 2];
            for (i, asked) in self.extent.caches.iter().copied().enumerate() {
                let set = bake(&scene, asked, 8)?.0;
                let world = OnDevice::new(self.gpu, &scene, Some(&set))?;
                for rsm in self.extent.rsm.iter().copied() {
                    let done = (i as f32 / self.extent.caches.len() as f32 + f32::from(u8::from(glossy))) * 0.5;
                    (self.progress)(done, &format!("{name}: {asked} caches, {rsm}x{rsm} VALs"));
                    let what = format!("{name}, {asked} caches, {rsm}x{rsm} VALs");
                    if let Err(reason) = budget.begin(asked as f64 * f64::from(rsm * rsm)) {
                        table.skipped.push(format!("{what}: {reason}."));
                        continue;
                    }
                    match self.of_caches(&world, rsm, glossy) {
                        Ok(Measured { caches, vals, frame, gather: both, shadowed, native, off }) => {
                            let gather = both[0].min(both[1]);
                            let versions =
                                [Some((name, frame, None)), shadowed.map(|s| ("DGS", s.frame, Some(s.occlude)))];
                            for ((name, frame, occlude), first) in versions.into_iter().flatten().zip(&mut first) {
                                let column = format!("{name}_{}", rsm * rsm);
                                let of_thesis = thesis::frame_ms(thesis::CACHES, &[asked as u32], &column);
                                let first = first.get_or_insert((frame, of_thesis));
                                let slower = of_thesis.zip(first.1).map(|(now, first)| now / first);
                                let mut row: Vec<Cell> = vec![name.into(), asked.into(), caches.into(), vals.into()];
                                let gather = occlude.is_none().then_some(gather);
                                let [skipping, all] = occlude.map_or([None; 2], |both: [f64; 2]| both.map(Some));
                                row.extend([Some(frame), gather, skipping, all, Some(frame / first.0)].map(Cell::from));
                                row.extend([of_thesis, slower].map(Cell::from));
                                table.push(row);
                            }
                            let rate = |ms: f64| (caches * vals) as f64 / ms * 1e-6;
                            let [fragment, compute] = both.map(rate);
                            let share = rate(gather) * 1e9 * FLOP_PER_PAIR[usize::from(glossy)] / self.peak;
                            let mut row: Vec<Cell> = vec![name.into(), caches.into(), vals.into()];
                            let ratios = [compute / native, fragment / native];
                            row.extend([compute, fragment, share, native].into_iter().chain(ratios).map(Cell::from));
                            row.extend([Some(off[0]), Some(off[1]).filter(|_| glossy)].map(Cell::from));
                            pairs.push(row);
                        }
                        Err(error) if does_not_fit(&error) => table.skipped.push(format!("{what}: {error}.")),
                        Err(error) => return Err(error),
                    }
                }
            }
        }
        Ok([table, pairs])
    }

    fn of_caches(&mut self, world: &OnDevice<'_>, rsm: u32, glossy: bool) -> Result<Measured> {
        let size = self.extent.size;
        // Without culling, so that the number of lit caches is known.
        let all = Knobs { cull: false, ..settings(size, Gi::LightSkin, rsm, self.tuned.ways) };
        let mut whole = world.frame(&all)?;
        let whole_ms = self.keep(world.times(&mut whole, self.extent.warm_up, self.extent.frames)?).frame();
        let shadowed = glossy.then(|| self.shadowed(world, &all)).transpose()?;
        let (vals, caches) = light_and_caches(self.gpu, &whole.light)?;
        let view = View::new(&world.scene.cameras[0], size, world.world.origin, world.world.radius);

        // Stage 6 alone on the VALs of that frame. Both paths and the CPU run in turn, so that other load on the
        // machine affects all of them.
        let (atlas, vals_on_device) = (Atlas::of(self.gpu, &caches)?, Vals::of(self.gpu, &vals)?);
        let proxies = Proxies::new(self.gpu, atlas.count, glossy, 1)?;
        let eyes = [view.eye];
        let lit =
            Lit { vals: &vals_on_device, atlas: &atlas, proxies: &proxies, eyes: &eyes, albedos: None, sky: None };
        let (gpu, count, ways) = (self.gpu, atlas.count, self.tuned.ways);
        let by_draws = || -> Result<Gather> {
            Ok(Gather::Draws(Box::new(Draws::new(gpu, count, glossy, false, DrawSource::Texels, 4096, false)?)))
        };
        let by_compute = || -> Result<Gather> {
            let kind = ComputeKind::plain(glossy);
            Ok(Gather::Compute(Box::new(Compute::new(gpu, count, vals_on_device.count, &ways, kind)?)))
        };
        let mut gathers = [Vec::new(), Vec::new()];
        for _ in 0..self.extent.pipelines {
            self.gpu.forget_pipelines();
            gathers[0].push(by_draws()?);
            gathers[1].push(by_compute()?);
        }
        let pairs = (caches.len() * vals.len()) as f64;
        let (mut paths, mut native) = ([Vec::new(), Vec::new()], Vec::new());
        // The first round of each pipeline is a warm-up.
        let begin = Instant::now();
        for round in 0.. {
            let counts = round >= self.extent.pipelines;
            if round >= self.extent.pipelines + ROUNDS && begin.elapsed().as_secs_f64() > self.extent.rounds {
                break;
            }
            for (gathers, times) in gathers.iter().zip(&mut paths) {
                let gather = &gathers[round % self.extent.pipelines];
                let drawn = self.gpu.timed_frame(|cmd| {
                    let _zone = cmd.zone("gather");
                    gather.record(cmd, &lit);
                    Ok(())
                })?;
                let ms = self.gpu.times(&drawn)?.gpu_ms();
                times.extend(ms.filter(|_| counts));
                self.problems.extend(drawn.problems);
            }
            if counts {
                let start = Instant::now();
                std::hint::black_box(native::gather(&vals, &caches, view.eye, glossy));
                native.push(start.elapsed().as_secs_f64());
            }
        }
        let median = |times: &mut Vec<f64>| -> Result<f64> {
            times.sort_by(f64::total_cmp);
            let none = || Error::Nothing("the device has no timestamps; the bench needs them".into());
            times.get(times.len() / 2).copied().ok_or_else(none)
        };
        let [mut fragment, mut compute] = paths;
        let both = [median(&mut fragment)?, median(&mut compute)?];
        let native = pairs / median(&mut native)? * 1e-9;
        let mut off = [0.0_f64; 2];
        for gathers in &gathers {
            let of_path = accuracy::worst(self.gpu, &caches, &vals, view.eye, &gathers[0])?;
            off = [off[0].max(of_path[0]), off[1].max(of_path[1])];
        }
        Ok(Measured { caches: caches.len(), vals: vals.len(), frame: whole_ms, gather: both, shadowed, native, off })
    }
}

impl Contexts<'_> {
    fn shadowed(&mut self, world: &OnDevice<'_>, knobs: &Knobs) -> Result<ShadowedFrame> {
        let mut frame = world.frame(&Knobs { shadows: Shadows::Proxy, ..*knobs })?;
        let times = self.keep(world.times(&mut frame, self.extent.warm_up, self.extent.frames)?);
        // Dims the same proxies repeatedly: the work is the same each time.
        let caches = frame.light.caches().ok_or_else(|| Error::Nothing("the frame has no caches".into()))?;
        let all = Occlude::without_skipping(self.gpu, caches.atlas.count, frame.light.plan.glossy, 1)?;
        let mut runs = Vec::new();
        for _ in 0..self.extent.frames {
            let drawn = self.gpu.timed_frame(|cmd| {
                let _zone = cmd.zone("occlude");
                all.record(cmd, &caches.atlas, caches.gather.live(), &caches.proxies, 1);
                Ok(())
            })?;
            runs.push(self.gpu.times(&drawn)?.gpu_ms().unwrap_or_default());
        }
        runs.sort_by(f64::total_cmp);
        let skipping = times.stage("occlude").unwrap_or_default();
        Ok(ShadowedFrame { frame: times.frame(), occlude: [skipping, runs[runs.len() / 2]] })
    }

    /// Cost and savings of culling.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn culling(&mut self) -> Result<Table> {
        let columns = [
            "triangles",
            "caches",
            "live",
            "share",
            "order",
            "path",
            "gather of all [ms]",
            "cull [ms]",
            "gather of live [ms]",
            "(cull + gather) / all",
        ];
        let [w, h] = self.extent.size;
        let how = format!(
            "A camera that sees a part of the valley, {w}x{h} pixels, {RSM}x{RSM} VALs, both lobes. Caches are stored in the atlas \
             in the bake's space-filling order (near), or shuffled (random), which scatters the live ones. Finding the visible \
             vertices is not counted, because averaging caches needs it, too. {}",
            self.method()
        );
        let mut table = Table::new("culling", "Culling", how, &columns);
        let mut budget = Budget::new(self.extent.budget);
        for (i, (triangles, asked)) in self.extent.culled.iter().copied().enumerate() {
            (self.progress)(i as f32 / self.extent.culled.len() as f32, &format!("culling {asked} caches"));
            if let Err(reason) = budget.begin(asked as f64) {
                table.skipped.push(format!("{asked} caches of {triangles} triangles: {reason}."));
                continue;
            }
            let mut scene = valley(triangles, true);
            // Sees about a tenth of the caches.
            let Projection::Perspective { yfov } = &mut scene.cameras[0].projection else { return Ok(table) };
            *yfov = 2.0 * ((0.5 * *yfov).tan() / 4.6).atan();
            let near = bake(&scene, asked, 8)?.0;
            for (order, set) in [("near", near.clone()), ("random", shuffled(&near))] {
                let world = OnDevice::new(self.gpu, &scene, Some(&set))?;
                for (name, path) in [("fragment", Path::DRAWS), ("compute", Path::Compute)] {
                    let live = Knobs { path, ..settings([w, h], Gi::LightSkin, RSM, self.tuned.ways) };
                    // The median of several pipelines, as for the table of pairs.
                    let mut stage = |knobs: &Knobs| -> Result<(f64, f64, usize, usize)> {
                        let mut runs = Vec::new();
                        for _ in 0..self.extent.pipelines {
                            self.gpu.forget_pipelines();
                            let mut frame = world.frame(knobs)?;
                            let times = self.keep(world.times(&mut frame, self.extent.warm_up, self.extent.frames)?);
                            let all = frame.light.caches().map_or(0, |caches| caches.atlas.count as usize);
                            let of = |name| times.stage(name).unwrap_or(0.0);
                            runs.push((of("cull"), of("gather"), frame.light.counts(self.gpu)?.caches as usize, all));
                        }
                        runs.sort_by(|a, b| a.1.total_cmp(&b.1));
                        Ok(runs[runs.len() / 2])
                    };
                    let (_, all, ..) = stage(&Knobs { cull: false, ..live })?;
                    let (cull, gather, lit, count) = stage(&live)?;
                    let mut row: Vec<Cell> = vec![triangles.into(), count.into(), lit.into()];
                    row.push((lit as f64 / count as f64).into());
                    row.extend([Cell::from(order), name.into()]);
                    row.extend([all, cull, gather, (cull + gather) / all].map(Cell::from));
                    table.push(row);
                }
            }
        }
        Ok(table)
    }
}

/// The same caches in a random but reproducible order.
fn shuffled(set: &CacheSet) -> CacheSet {
    let mut set = set.clone();
    let mut state = 1_u64;
    for model in &mut set.models {
        let mut place: Vec<u16> = (0..model.caches.len() as u16).collect();
        for i in (1..place.len()).rev() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            place.swap(i, (state >> 33) as usize % (i + 1));
        }
        let mut caches = model.caches.clone();
        for (cache, place) in model.caches.iter().zip(&place) {
            caches[*place as usize] = *cache;
        }
        model.caches = caches;
        for reference in model.references.iter_mut().filter(|reference| **reference != NO_CACHE) {
            *reference = place[*reference as usize];
        }
    }
    set
}

/// Results for one point of table 6.3.
struct Measured {
    caches: usize,
    vals: usize,
    /// All stages \[ms\].
    frame: f64,
    /// Stage 6 \[ms\] by the fragment and the compute path.
    gather: [f64; 2],
    /// The frame with proxy shadows; only with both lobes.
    shadowed: Option<ShadowedFrame>,
    /// Rate of the CPU [G pairs/s].
    native: f64,
    /// Largest relative errors of both lobes' irradiance.
    off: [f64; 2],
}

/// Times of a frame with proxy shadows.
#[derive(Clone, Copy)]
struct ShadowedFrame {
    /// All stages \[ms\].
    frame: f64,
    /// Stage 7 \[ms\], as it is and without skipping discs.
    occlude: [f64; 2],
}

/// VALs and caches of the last frame, as the gather reads them.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn light_and_caches(gpu: &Gpu, light: &Light) -> Result<(Vec<Val>, Vec<Cache>)> {
    let none = || Error::Nothing("the frame gathers no light".into());
    let (vals, caches) = (light.vals().ok_or_else(none)?, light.caches().ok_or_else(none)?);
    let mut all: Vec<Val> = gpu.read(&vals.live)?;
    all.truncate(gpu.read::<u32>(&vals.live_count)?[0] as usize);
    let mut placed: Vec<Cache> = gpu.read(&caches.atlas.caches)?;
    placed.truncate(caches.atlas.count as usize);
    Ok((all, placed))
}
