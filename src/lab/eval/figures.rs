//! The plots of a report.

use super::record::Row;
use super::references::Truth;
use super::run::{Job, Results};
use super::sweep::{Knob, Point};
use crate::lab::plot::{Axis, Mark, Plot, Series};

/// Metric of the plots, and its readable name. The tables have the other metrics.
pub const METRIC: (&str, &str) = ("mare", "mean relative error");

/// Layer of the plots that show a single one.
pub const LAYER: &str = "indirect";

/// A plot and the name of its file.
pub struct Figure {
    /// File name without folder and extension.
    pub name: String,
    /// The plot.
    pub plot: Plot,
}

/// Colours with the same meaning in all plots.
const GREY: usize = 6;
const RED: usize = 7;

/// Inputs of all plots.
#[derive(Clone, Copy)]
pub struct Figures<'a> {
    /// The job.
    pub job: &'a Job<'a>,
    /// Its results.
    pub results: &'a Results,
}

impl<'a> Figures<'a> {
    /// The row of a point.
    pub fn row(&self, point: &Point) -> Option<&'a Row> {
        let index = self.job.sweep.points.iter().position(|other| other == point)?;
        self.results.rows.get(index)
    }

    /// The default whose errors against a reference are shown.
    pub fn base(&self, truth: Truth) -> &'a Point {
        let sweep = self.job.sweep;
        if truth.fits(&sweep.base.frame) { &sweep.base } else { &sweep.bare }
    }

    /// Rows of a knob's values around a default.
    pub fn rows_of(&self, knob: &Knob, base: &Point) -> Vec<Option<&'a Row>> {
        (0..knob.values.len()).map(|value| self.row(&knob.set(base, value))).collect()
    }

    /// Name of a point by its differences from a default; brute force is named as such.
    pub fn name(&self, row: &Row, base: &Point) -> String {
        if row.knob("gi") == Some("brute-force") {
            return format!("brute force, rsm {}", row.knob("rsm").unwrap_or("?"));
        }
        let base = self.row(base);
        let differs = |(name, value): &&(String, String)| base.and_then(|b| b.knob(name)) != Some(value.as_str());
        let apart = row.knobs.iter().filter(differs).map(|(name, value)| format!("{name} {value}"));
        let apart: Vec<String> = apart.collect();
        if apart.is_empty() { "default".into() } else { apart.join(", ") }
    }

    /// Name of the device, marked if it is a software device.
    pub fn device(&self) -> String {
        let software = if self.job.gpu.is_software() { " (software device)" } else { "" };
        format!("{}{software}", self.job.gpu.report().name)
    }

    fn mark(&self, row: &Row, truth: Truth) -> Option<Mark> {
        Some(Mark { x: row.frame_ms(), y: row.error(truth, LAYER, METRIC.0)?, label: self.name(row, self.base(truth)) })
    }

    /// Error of every point over its time: one curve per knob, and the Pareto front.
    pub fn against_time(&self, truth: Truth) -> Figure {
        let marks = |rows: &[Row]| rows.iter().filter_map(|row| self.mark(row, truth)).collect();
        let mut series =
            vec![Series { name: "caches x VALs".into(), marks: marks(&self.results.rows), line: false, color: GREY }];
        for (color, knob) in self.job.sweep.knobs.iter().enumerate() {
            let rows = self.rows_of(knob, self.base(truth));
            let marks: Vec<Mark> = rows.into_iter().flatten().filter_map(|row| self.mark(row, truth)).collect();
            if marks.len() < 2 {
                // One value alone fits the reference.
                continue;
            }
            series.push(Series {
                name: knob.name.into(),
                marks,
                line: true,
                color: if color < GREY { color } else { color + 2 },
            });
        }
        let brute_force = marks(&self.results.brute_force);
        series.push(Series { name: "brute force".into(), marks: brute_force, line: true, color: RED });
        series.retain(|series| !series.marks.is_empty());
        let title = format!("Error against time: {}, against {}", self.job.scene.name, truth.title());
        let x = Axis { label: format!("GPU time of a frame [ms], {}", self.device()), names: Vec::new() };
        let plot = Plot { title, x, y: error_axis(), series, front: true, size: [860.0, 480.0] };
        Figure { name: format!("error-against-time-{}", truth.name()), plot }
    }

    /// Plots of a knob: errors of the lobes with and without shadows, errors against each reference, times of the
    /// stages. Omits references that only one of its values can be compared with.
    pub fn of_knob(&self, knob: &Knob) -> Vec<Figure> {
        let is_numeric = knob.is_numeric();
        let names = if is_numeric { Vec::new() } else { knob.values.iter().map(|v| v.label.clone()).collect() };
        let x = Axis { label: knob.title.into(), names };
        let rows = self.rows_of(knob, &self.job.sweep.base);
        let place = |i: usize| if is_numeric { knob.values[i].label.parse().unwrap_or(f64::NAN) } else { i as f64 };
        let line = |name: &str, color: usize, y: &dyn Fn(usize) -> Option<f64>| {
            let mark = |i: usize| Some(Mark { x: place(i), y: y(i)?, label: knob.values[i].label.clone() });
            Series { name: name.into(), marks: (0..knob.values.len()).filter_map(mark).collect(), line: true, color }
        };
        let curve = |name: &str, color: usize, y: &dyn Fn(&Row) -> Option<f64>| line(name, color, &|i| y(rows[i]?));
        let error = |name: &str, color: usize, truth: Truth, layer: &str| {
            let rows = self.rows_of(knob, self.base(truth));
            line(name, color, &|i| rows[i]?.error(truth, layer, METRIC.0))
        };
        let plot = |name: &str, what: &str, y: Axis, series: Vec<Series>| {
            let series = series.into_iter().filter(|s| !s.marks.is_empty()).collect();
            let (name, title) = (format!("{}-{name}", knob.name), format!("{}: {what}", knob.name));
            Figure { name, plot: Plot { title, x: x.clone(), y, series, front: false, size: [470.0, 330.0] } }
        };
        let lobes = [("indirect.diffuse", "diffuse"), ("indirect.glossy", "glossy"), ("indirect", "sum")];
        let lobes = |truth: Truth| {
            let series = lobes.iter().enumerate().map(|(i, (layer, name))| error(name, i, truth, layer)).collect();
            plot(&format!("lobes-{}", truth.name()), &format!("lobes against {}", truth.short()), error_axis(), series)
        };
        let truths =
            Truth::ALL.into_iter().enumerate().map(|(i, truth)| error(truth.short(), i, truth, LAYER)).collect();
        let mut stages: Vec<&str> = Vec::new();
        for (name, _) in rows.iter().flatten().flat_map(|row| &row.stages) {
            if !stages.contains(&name.as_str()) {
                stages.push(name);
            }
        }
        let stage = |(i, name): (usize, &&str)| {
            let time = |row: &Row| row.stages.iter().find(|(stage, _)| stage == name).map(|(_, ms)| *ms);
            curve(name, if i < GREY { i } else { i + 1 }, &time)
        };
        let total = curve("frame", GREY, &|row| row.failed.is_none().then(|| row.frame_ms()));
        let times = stages.iter().enumerate().map(stage).chain([total]);
        let time_axis = Axis { label: "GPU time [ms]".into(), names: Vec::new() };
        let mut all = vec![
            lobes(Truth::AllLight),
            lobes(Truth::SameVals),
            plot("references", "error of the sum, each reference", error_axis(), truths),
            plot("times", "time of each stage", time_axis, times.collect()),
        ];
        all.retain(|figure| figure.plot.series.iter().any(|series| series.marks.len() > 1));
        all
    }

    /// Error over caches, one curve per RSM side: shows which of the two limits quality.
    pub fn grid(&self, truth: Truth) -> Figure {
        let [caches, vals] = [&self.job.sweep.knobs[0], &self.job.sweep.knobs[1]];
        let base = self.base(truth);
        let curve = |column: usize| {
            let mark = |row: usize| {
                let found = self.row(&vals.set(&caches.set(base, row), column))?;
                let y = found.error(truth, LAYER, METRIC.0)?;
                Some(Mark { x: caches.values[row].label.parse().ok()?, y, label: self.name(found, base) })
            };
            let name = format!("rsm {}", vals.values[column].label);
            Series { name, marks: (0..caches.values.len()).filter_map(mark).collect(), line: true, color: column }
        };
        let title = format!("Caches by VALs, against {}", truth.title());
        let x = Axis { label: caches.title.into(), names: Vec::new() };
        let series = (0..vals.values.len()).map(curve).collect();
        let plot = Plot { title, x, y: error_axis(), series, front: false, size: [560.0, 360.0] };
        Figure { name: format!("caches-by-vals-{}", truth.name()), plot }
    }
}

fn error_axis() -> Axis {
    Axis { label: METRIC.1.into(), names: Vec::new() }
}
