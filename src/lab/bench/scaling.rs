//! Exponents by which the gather's time grows with live caches and live VALs: stage 6 alone, all points in turn, in
//! several rounds. Other load on the machine may last longer than one measurement, and slows long measurements more
//! than short ones. So the smallest point is timed between all others, and each time is taken relative to it.

use super::contexts::{Contexts, light_and_caches};
use super::measure::{Budget, OnDevice, bake, settings};
use super::table::{Cell, Table, exponent, power_law};
use crate::error::{Error, Result};
use crate::frame::atlas::Atlas;
use crate::frame::gather::{Compute, ComputeKind, Lit};
use crate::frame::proxies::Proxies;
use crate::frame::vals::Vals;
use crate::frame::{View, tune};
use crate::gpu::{Cmd, Use};
use crate::lab::knobs::{Gi, Knobs};
use crate::lab::plot::short;
use crate::lab::scenes::valley;
use crate::shared::{Cache, Val};
use std::time::Instant;

/// Rounds over all points, after one warm-up.
const ROUNDS: usize = 7;

/// Gathers of a point are repeated within one measurement until it takes this long \[ms\].
const LONG_ENOUGH: f64 = 12.0;

/// Most gathers per measurement.
const MOST: usize = 256;

/// Time of one gather at one point of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Live caches.
    pub caches: f64,
    /// Live VALs.
    pub vals: f64,
    /// Time \[ms\].
    pub ms: f64,
}

/// Growth of times with caches and VALs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth {
    /// Exponents of caches and VALs: least squares fit of the logarithms over all points.
    pub all: [f64; 2],
    /// Smallest and largest exponent of caches, fitted separately for each VAL count.
    pub of_caches: [f64; 2],
    /// Smallest and largest exponent of VALs, fitted separately for each cache count.
    pub of_vals: [f64; 2],
    /// Largest ratio of a time to the fit, or of the fit to a time.
    pub worst: f64,
}

impl Growth {
    /// The growth of these times; `None` if there are too few.
    pub fn new(points: &[Point]) -> Option<Self> {
        let logs: Vec<[f64; 3]> = points.iter().map(|p| [p.caches.ln(), p.vals.ln(), p.ms.ln()]).collect();
        let [constant, caches, vals] = power_law(&logs)?;
        let off = |p: &[f64; 3]| (p[2] - constant - caches * p[0] - vals * p[1]).abs();
        Some(Self {
            all: [caches, vals],
            of_caches: range(points, |p| p.vals, |p| p.caches)?,
            of_vals: range(points, |p| p.caches, |p| p.vals)?,
            worst: logs.iter().map(off).fold(0.0, f64::max).exp(),
        })
    }
}

/// Smallest and largest exponent over groups of points that share a count.
fn range(points: &[Point], shared: fn(&Point) -> f64, grows: fn(&Point) -> f64) -> Option<[f64; 2]> {
    let mut counts: Vec<f64> = points.iter().map(shared).collect();
    counts.sort_by(f64::total_cmp);
    counts.dedup();
    let slope = |count: &f64| {
        let line: Vec<(f64, f64)> = points.iter().filter(|p| shared(p) == *count).map(|p| (grows(p), p.ms)).collect();
        exponent(&line).filter(|_| line.len() >= 3)
    };
    let slopes: Vec<f64> = counts.iter().filter_map(slope).collect();
    let least = slopes.iter().copied().reduce(f64::min)?;
    Some([least, slopes.iter().copied().fold(least, f64::max)])
}

/// One measurement, repeated.
struct Work<'a> {
    /// Several pipelines of one kind, used in turn.
    gathers: Vec<Compute>,
    atlas: Atlas,
    proxies: Proxies,
    vals: &'a Vals,
    glossy: bool,
    /// Gathers per measurement.
    often: usize,
    /// Time of one gather \[ms\] in each round.
    times: Vec<f64>,
    /// The same relative to the smallest point, measured just before and just after.
    relative: Vec<f64>,
}

impl Work<'_> {
    fn pairs(&self) -> f64 {
        f64::from(self.atlas.count) * f64::from(self.vals.count)
    }

    /// The pipeline whose turn it is.
    fn next(&self) -> &Compute {
        &self.gathers[self.times.len() % self.gathers.len()]
    }

    fn record(&self, cmd: &Cmd<'_>, gather: &Compute, view: &View) {
        let eyes = [view.eye];
        let (vals, atlas, proxies) = (self.vals, &self.atlas, &self.proxies);
        let lit = Lit { vals, atlas, proxies, eyes: &eyes, albedos: None, sky: None };
        for i in 0..self.often {
            if i > 0 {
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            }
            gather.record(cmd, &lit);
        }
    }

    fn least(&self) -> f64 {
        self.times.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// The median.
fn median(times: &[f64]) -> f64 {
    let mut times = times.to_vec();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Caches and VALs of the grid, and the view.
struct Lists {
    caches: Vec<Vec<Cache>>,
    vals: Vec<Vec<Val>>,
    view: View,
}

impl Contexts<'_> {
    /// The tables of times and of exponents.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn scaling(&mut self) -> Result<[Table; 2]> {
        (self.progress)(0.0, "caches and VALs of the grid");
        let Lists { caches, vals, view } = self.lists()?;
        let vals = vals.iter().map(|vals| Vals::of(self.gpu, vals)).collect::<Result<Vec<_>>>()?;
        // Cost of a gather with almost no work.
        let (one_cache, one_val) = tune::world(1, 1);
        let one_val = Vals::of(self.gpu, &one_val)?;
        let mut alone = self.work(&one_cache, &one_val, true)?;
        let mut often = self.work(&one_cache, &one_val, true)?;
        often.often = MOST;

        let started = Instant::now();
        let mut budget = Budget::new(0.2 * self.extent.budget);
        let mut skipped = Vec::new();
        let mut all = Vec::new();
        for (glossy, name) in [(false, "D"), (true, "DG")] {
            for (caches, vals) in caches.iter().flat_map(|caches| vals.iter().map(move |vals| (caches, vals))) {
                let what = format!("{name}, {} caches, {} VALs", caches.len(), vals.count);
                (self.progress)(0.1, &what);
                let mut work = self.work(caches, vals, glossy)?;
                match budget.begin(work.pairs()) {
                    Ok(()) => {
                        // The first gather of a pipeline takes longer.
                        for gather in &work.gathers {
                            self.zone(&|cmd| work.record(cmd, gather, &view))?;
                        }
                        let mut ms = self.measure(&work, &view)?;
                        if ms < 5.0 * LONG_ENOUGH {
                            ms = self.measure(&work, &view)?;
                        }
                        work.often = ((LONG_ENOUGH / ms).ceil() as usize).clamp(1, MOST);
                        all.push(work);
                    }
                    Err(reason) => skipped.push(format!("{what}: {reason}.")),
                }
            }
        }
        let mut empty = Vec::new();
        for round in 0..if all.is_empty() { 0 } else { ROUNDS } {
            // Enough rounds for a minimum.
            if round >= 3 && started.elapsed().as_secs_f64() > self.extent.budget {
                break;
            }
            (self.progress)(0.2 + 0.8 * round as f32 / ROUNDS as f32, &format!("gather alone, round {}", round + 1));
            for glossy in [false, true] {
                self.round(&mut all, glossy, &view)?;
            }
            for work in [&mut alone, &mut often] {
                work.times.push(self.measure(work, &view)?);
            }
            empty.push(self.zone(&|_| ())?);
        }
        let fixed = empty.into_iter().reduce(f64::min).map(|empty| [empty, alone.least(), often.least()]);
        let mut table = self.times_table(fixed);
        table.skipped = skipped;
        let mut growth = growth_table();
        for (glossy, name) in [(false, "D"), (true, "DG")] {
            let of: Vec<&Work<'_>> = all.iter().filter(|work| work.glossy == glossy).collect();
            let Some(unit) = of.first().map(|first| first.least()) else { continue };
            let (mut steadied, mut least) = (Vec::new(), Vec::new());
            for work in of {
                let ms = [unit * median(&work.relative), work.least(), median(&work.times)];
                let mut row: Vec<Cell> = vec![name.into()];
                row.extend([work.atlas.count, work.vals.count].map(|count| Cell::from(count as usize)));
                row.extend([work.often, work.times.len()].map(Cell::from));
                row.extend(ms.map(Cell::from));
                row.push((1e6 * ms[0] / work.pairs()).into());
                table.push(row);
                let [caches, vals] = [work.atlas.count, work.vals.count].map(f64::from);
                steadied.push(Point { caches, vals, ms: ms[0] });
                least.push(Point { caches, vals, ms: ms[1] });
            }
            for (times, points) in [("steadied", steadied), ("least", least)] {
                if let Some(Growth { all, of_caches, of_vals, worst }) = Growth::new(&points) {
                    let mut row: Vec<Cell> = vec![name.into(), times.into(), points.len().into()];
                    row.extend([all, of_caches, of_vals].concat().into_iter().chain([worst]).map(Cell::from));
                    growth.push(row);
                }
            }
        }
        Ok([table, growth])
    }

    /// Times all points of a version once, and the first point before and after each.
    fn round(&mut self, all: &mut [Work<'_>], glossy: bool, view: &View) -> Result<()> {
        let mut of: Vec<&mut Work<'_>> = all.iter_mut().filter(|work| work.glossy == glossy).collect();
        let Some((first, others)) = of.split_first_mut() else { return Ok(()) };
        let mut before = self.measure(first, view)?;
        first.times.push(before);
        first.relative.push(1.0);
        for work in others {
            let ms = self.measure(work, view)?;
            let after = self.measure(first, view)?;
            work.times.push(ms);
            work.relative.push(2.0 * ms / (before + after));
            first.times.push(after);
            before = after;
        }
        Ok(())
    }

    fn times_table(&self, fixed: Option<[f64; 3]>) -> Table {
        let way = self.tuned.ways;
        let columns = [
            "lobes",
            "caches",
            "VALs",
            "gathers at once",
            "times",
            "steadied [ms]",
            "least [ms]",
            "median [ms]",
            "steadied [ns/pair]",
        ];
        let mut how = format!(
            "Stage 6 alone by the compute path ({} caches per thread, parts of {} VALs, read from {}), on live caches and VALs of \
             the valley, all of which the camera and the sun see. One measurement repeats a gather within one submission, with \
             barriers in between, for {LONG_ENOUGH} ms; times are per gather. All points are measured in turn in {ROUNDS} rounds, \
             over {} pipelines in turn (pipelines of identical code can differ in speed). The first point is timed between all \
             others. \"steadied\" is the median over the rounds of a time relative to the first point's times just before and \
             after, multiplied by the first point's least time, so that temporary slowness of the machine cancels out. On an \
             idle machine the least times are more meaningful, on a busy one the steadied times.",
            way.caches_per_thread,
            way.split,
            way.source.name(),
            self.extent.pipelines
        );
        if let Some([empty, alone, often]) = fixed {
            how += &format!(
                " No overhead is subtracted. For comparison, in the same rounds: a gather of one cache and one VAL takes {} ms in a \
                 submission of its own, as stages are measured in the other tables, and {} ms if {MOST} gathers share a submission; \
                 an empty submission takes {} ms.",
                short(alone),
                short(often),
                short(empty)
            );
        }
        Table::new("scaling", "Scaling: the gather alone", how, &columns)
    }

    /// Time \[ms\] of one gather in a measurement.
    fn measure(&mut self, work: &Work<'_>, view: &View) -> Result<f64> {
        Ok(self.zone(&|cmd| work.record(cmd, work.next(), view))? / work.often as f64)
    }

    /// Time \[ms\] of a zone, which is submitted alone on software devices, as in frames.
    fn zone(&mut self, record: &dyn Fn(&Cmd<'_>)) -> Result<f64> {
        let drawn = self.gpu.timed_frame(|cmd| {
            let _zone = cmd.zone("gather");
            record(cmd);
            Ok(())
        })?;
        let ms = self.gpu.times(&drawn)?.gpu_ms();
        self.problems.extend(drawn.problems);
        ms.ok_or_else(|| Error::Nothing("the device has no timestamps; the bench needs them".into()))
    }

    fn work<'v>(&self, caches: &[Cache], vals: &'v Vals, glossy: bool) -> Result<Work<'v>> {
        let atlas = Atlas::of(self.gpu, caches)?;
        let gather = || {
            self.gpu.forget_pipelines();
            Compute::new(self.gpu, atlas.count, vals.count, &self.tuned.ways, ComputeKind::plain(glossy))
        };
        let gathers = (0..self.extent.pipelines).map(|_| gather()).collect::<Result<_>>()?;
        let proxies = Proxies::new(self.gpu, atlas.count, glossy, 1)?;
        Ok(Work { gathers, atlas, proxies, vals, glossy, often: 1, times: Vec::new(), relative: Vec::new() })
    }

    /// Caches and VALs gathered in frames of the valley.
    fn lists(&mut self) -> Result<Lists> {
        let scene = valley(self.extent.ground, true);
        let size = self.extent.size;
        let (mut caches, mut vals) = (Vec::new(), Vec::new());
        let mut view = View::new(&scene.cameras[0], size, glam::DVec3::ZERO, 1.0);
        let [counts, sides] = [&self.extent.scaling.0, &self.extent.scaling.1.iter().map(|n| *n as usize).collect()];
        for i in 0..counts.len().max(sides.len()) {
            // Covers each count and each side at least once, combined.
            let [asked, side] = [counts, sides].map(|all: &Vec<usize>| all[i.min(all.len() - 1)]);
            let set = bake(&scene, asked, 8)?.0;
            let world = OnDevice::new(self.gpu, &scene, Some(&set))?;
            let way = self.tuned.ways;
            let all = Knobs { cull: false, ..settings(size, Gi::LightSkin, side as u32, way) };
            let mut frame = world.frame(&all)?;
            let times = world.times(&mut frame, 0, 1)?;
            self.problems.extend(times.problems);
            let (of_frame, placed) = light_and_caches(self.gpu, &frame.light)?;
            if i < counts.len() {
                caches.push(placed);
            }
            if i < sides.len() {
                vals.push(of_frame);
            }
            view = View::new(&scene.cameras[0], size, world.world.origin, world.world.radius);
        }
        Ok(Lists { caches, vals, view })
    }
}

fn growth_table() -> Table {
    let columns = [
        "lobes",
        "times",
        "points",
        "of caches",
        "of VALs",
        "of caches in the least row",
        "in the largest row",
        "of VALs in the least column",
        "in the largest column",
        "worst point / fit",
    ];
    let how = "Exponents of the times above: log time = a + e log caches + f log VALs by least squares over all points; 1 means \
               proportional. A row has one VAL count, a column one cache count; each is fitted separately, and the least and the \
               largest exponents are listed.";
    Table::new("growth", "How the gather grows", how.into(), &columns)
}

/// Exponents by which whole frames grow with caches and VALs, from the table of caches.
pub fn exponents(caches: &Table) -> Table {
    let how = "Least squares slope of log time over log count, over points that share everything else; 1 means proportional. The \
               thesis's column is for whole frames at the same points, because it gives no times of stages.";
    let columns = ["lobes", "grows with", "at", "points", "frame", "thesis frame"];
    let mut table = Table::new("exponents", "How frames grow", how.into(), &columns);
    let counts = |column: &str| -> Vec<f64> {
        let mut all: Vec<f64> = (0..caches.rows.len()).filter_map(|row| caches.number(row, column)).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    };
    for lobes in ["D", "DG"] {
        for (grows, measured, fixed) in [("caches", "caches", "VALs"), ("VALs", "VALs", "asked")] {
            for at in counts(fixed) {
                let wanted = |row| caches.has(row, lobes) && caches.number(row, fixed) == Some(at);
                let slope = |y| exponent(&caches.pairs(measured, y, wanted));
                let points = caches.pairs(measured, "frame [ms]", wanted).len();
                if points >= 3 {
                    let unit = if fixed == "asked" { "caches" } else { "VALs" };
                    let mut row: Vec<Cell> = vec![lobes.into(), grows.into()];
                    row.extend([Cell::Text(format!("{at} {unit}")), points.into()]);
                    row.extend(["frame [ms]", "thesis [ms]"].map(|y| Cell::from(slope(y))));
                    table.push(row);
                }
            }
        }
    }
    table
}

/// One sentence with the exponents for each version.
pub(super) fn headlines(growth: &Table) -> Vec<String> {
    let line = |row: usize| {
        let of = |column: &str| growth.number(row, column).map_or("-".into(), |e| format!("{e:.3}"));
        let lobes = if growth.has(row, "DG") { "DG" } else { "D" };
        format!(
            "Gather {lobes} grows with caches to the power of {} (rows {} to {}) and with VALs to the power of {} (columns {} \
             to {}), by the least times of all rounds.",
            of("of caches"),
            of("of caches in the least row"),
            of("in the largest row"),
            of("of VALs"),
            of("of VALs in the least column"),
            of("in the largest column")
        )
    };
    (0..growth.rows.len()).filter(|row| growth.has(*row, "least")).map(line).collect()
}
