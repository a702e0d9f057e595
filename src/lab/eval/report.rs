//! The report: a self-contained page, and its numbers as CSV and JSON.

use super::figures::{Figure, Figures, LAYER, METRIC};
use super::pictures::{HEAT, Shows};
use super::record::{Row, csv};
use super::references::Truth;
use super::run::{Job, Results};
use super::sweep::{Knob, Point};
use crate::error::Result;
use crate::files;
use crate::lab::plot::{escape, short};
use base64::Engine;
use serde_json::json;
use std::fmt::Write;
use std::path::Path;

/// A section of the page.
pub struct Section {
    /// Heading, as text.
    pub title: String,
    /// Content, as self-contained HTML.
    pub html: String,
}

/// One of the two defaults and its references.
struct Half<'a> {
    /// Heading, as text.
    title: &'static str,
    /// The default around which knobs are varied.
    base: &'a Point,
    /// The references.
    truths: Vec<Truth>,
    /// The reference for pictures.
    best: Truth,
}

const STYLE: &str = include_str!("report.css");

/// Creates the folder and checks that a report can be written there, before the long measurement starts.
///
/// # Errors
/// Fails if a folder or file cannot be written.
pub fn check_writable(folder: &Path) -> Result<()> {
    super::references::make_folder(folder)?;
    files::check_writable(&folder.join("index.html"))
}

/// Writes `index.html`, `results.csv`, `results.json` and `plots/*.svg`. `extra` sections follow the built-in ones.
///
/// # Errors
/// Fails if a folder or file cannot be written.
pub fn write(job: &Job<'_>, results: &Results, extra: &[Section]) -> Result<()> {
    let page = Page { job, results, figures: Figures { job, results } };
    let folder = job.folder;
    super::references::make_folder(&folder.join("plots"))?;
    for figure in page.all_figures() {
        text(&folder.join("plots").join(format!("{}.svg", figure.name)), &figure.plot.svg())?;
    }
    let rows: Vec<Row> = results.rows.iter().chain(&results.brute_force).cloned().collect();
    text(&folder.join("results.csv"), &csv(&rows))?;
    text(&folder.join("results.json"), &format!("{:#}\n", page.json(&rows)))?;
    text(&folder.join("index.html"), &page.html(extra))
}

fn text(path: &Path, content: &str) -> Result<()> {
    files::write(path, content.as_bytes())
}

struct Page<'a> {
    job: &'a Job<'a>,
    results: &'a Results,
    figures: Figures<'a>,
}

/// A table of text cells; the first row is the header.
fn table(rows: &[Vec<String>]) -> String {
    let row = |(i, cells): (usize, &Vec<String>)| {
        let tag = if i == 0 { "th" } else { "td" };
        let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    format!("<div class=\"wide\"><table>\n{}</table></div>\n", rows.iter().enumerate().map(row).collect::<String>())
}

/// A plot inside the page, which needs no namespace.
fn inline(figure: &Figure) -> String {
    figure.plot.svg().replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1)
}

fn percent(value: Option<f64>) -> String {
    let decimals = |v: f64| if v.abs() < 0.1 { 2 } else { usize::from(v.abs() < 1.0) };
    value.filter(|v| v.is_finite()).map_or("-".into(), |v| format!("{:.*} %", decimals(v), v * 100.0))
}

impl Page<'_> {
    /// Facts on how the numbers were measured.
    fn facts(&self) -> Vec<(&'static str, String)> {
        let (job, sweep) = (self.job, self.job.sweep);
        let report = job.gpu.report();
        let (method, note) = if job.gpu.is_software() {
            (
                "each stage submitted alone",
                "; a software device: times are comparable with each other, not with a GPU's",
            )
        } else {
            ("timestamps within one submission", "")
        };
        let knobs = self.results.rows.first().map_or_else(Vec::new, |row| row.knobs.clone());
        let knobs: Vec<String> = knobs.iter().map(|(name, value)| format!("{name} {value}")).collect();
        let [w, h] = sweep.base.frame.size;
        vec![
            (
                "scene",
                format!(
                    "{}, {} triangles before tessellation, lights: {}",
                    job.scene.name,
                    job.scene.triangle_count(),
                    job.scene.lights.len()
                ),
            ),
            ("camera", job.camera.name.clone()),
            ("picture", format!("{w} x {h} pixels; only pixels that show a surface count")),
            ("device", format!("{}, {} ({}){note}", self.figures.device(), report.kind, report.driver)),
            (
                "times",
                format!(
                    "median of {} frames after one warm-up frame, fewer if they take over 10 s; {method}",
                    sweep.frames
                ),
            ),
            ("path tracer", format!("at least {} samples per pixel", sweep.samples)),
            ("default", knobs.join(", ")),
            ("angle", format!("at most {:.0} degrees between a surface and its cache", sweep.base.angle.to_degrees())),
            ("program", format!("lightskin {}", env!("CARGO_PKG_VERSION"))),
        ]
    }

    fn json(&self, rows: &[Row]) -> serde_json::Value {
        let facts: serde_json::Map<_, _> = self.facts().into_iter().map(|(k, v)| (k.to_owned(), json!(v))).collect();
        json!({
            "schema": 1,
            "device": self.job.gpu.report().name,
            "is_software": self.job.gpu.is_software(),
            "facts": facts,
            "references": self.results.references,
            "points": rows.iter().map(Row::to_json).collect::<Vec<_>>(),
        })
    }

    /// References that results were compared with.
    fn truths(&self) -> Vec<Truth> {
        let all = Truth::ALL.into_iter();
        all.filter(|t| self.results.rows.iter().any(|row| row.error(*t, LAYER, METRIC.0).is_some())).collect()
    }

    fn all_figures(&self) -> Vec<Figure> {
        let mut all: Vec<Figure> = self.truths().into_iter().map(|truth| self.figures.against_time(truth)).collect();
        all.extend(self.job.sweep.knobs.iter().flat_map(|knob| self.figures.of_knob(knob)));
        all.extend(self.grids());
        all
    }

    fn grids(&self) -> Vec<Figure> {
        let with = [Truth::AllLight, Truth::FinestVals].into_iter().filter(|truth| self.truths().contains(truth));
        with.map(|truth| self.figures.grid(truth)).collect()
    }

    fn html(&self, extra: &[Section]) -> String {
        let title = format!("lightskin: speed against error, {}", self.job.scene.name);
        let mut page = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width\"><title>{0}</title><style>{STYLE}</style></head>\n\
             <body>\n<h1>{0}</h1>\n",
            escape(&title)
        );
        let facts = self.facts().into_iter().map(|(name, what)| vec![name.to_owned(), what]);
        let facts: String = facts
            .map(|f| format!("<tr><td>{}</td><td class=\"text\">{}</td></tr>\n", escape(&f[0]), escape(&f[1])))
            .collect();
        // Writing to a string cannot fail.
        let _ = write!(page, "<table>{facts}</table>\n{}", self.problems());
        let mut sections = vec![self.summary(), self.against_time()];
        sections.extend(self.job.sweep.knobs.iter().map(|knob| self.of_knob(knob)));
        sections.extend([self.grid(), self.references()]);
        let ours = sections.iter();
        for section in ours.chain(extra).chain([&self.all_points()]) {
            let _ = write!(page, "<section><h2>{}</h2>\n{}</section>\n", escape(&section.title), section.html);
        }
        page.push_str("</body></html>\n");
        page
    }

    /// Points that could not be measured, with reasons.
    fn problems(&self) -> String {
        let failed = self.results.rows.iter().chain(&self.results.brute_force);
        let failed = failed.filter_map(|row| Some(format!("{}: {}", self.name(row), row.failed.as_ref()?)));
        let lines: String = failed.map(|line| format!("<li>{}</li>\n", escape(&line))).collect();
        if lines.is_empty() { lines } else { format!("<div class=\"warn\">Not measured:<ul>{lines}</ul></div>\n") }
    }

    /// Name of a point by its differences from the default of `render`.
    fn name(&self, row: &Row) -> String {
        self.figures.name(row, &self.job.sweep.base)
    }

    /// The default of `render` against all light, and one bounce without shadows against references of that.
    fn halves(&self) -> [Half<'_>; 2] {
        let sweep = self.job.sweep;
        let (shadowed, bare): (Vec<_>, Vec<_>) = self.truths().into_iter().partition(|t| *t == Truth::AllLight);
        let best = [Truth::FinestVals, Truth::Unshadowed].into_iter().find(|t| bare.contains(t));
        [
            Half { title: "Default of render", base: &sweep.base, truths: shadowed, best: Truth::AllLight },
            Half {
                title: "One bounce without shadows: the error of caches and virtual lights alone",
                base: &sweep.bare,
                truths: bare,
                best: best.unwrap_or(Truth::Unshadowed),
            },
        ]
    }

    fn summary(&self) -> Section {
        let mut html = String::new();
        for half in self.halves() {
            let Some(row) = self.figures.row(half.base) else { continue };
            let metrics: Vec<&str> =
                row.errors.first().map_or_else(Vec::new, |e| e.values.iter().map(|v| v.0.as_str()).collect());
            let head = ["against", "layer"].into_iter().chain(metrics);
            let mut rows: Vec<Vec<String>> = vec![head.map(str::to_owned).collect()];
            for errors in &row.errors {
                let Some(truth) = half.truths.iter().find(|t| t.name() == errors.truth) else { continue };
                let values = errors.values.iter().map(|(_, v)| if v.is_finite() { short(*v) } else { "-".into() });
                rows.push([truth.title().to_owned(), errors.layer.clone()].into_iter().chain(values).collect());
            }
            let times =
                row.stages.iter().map(|(name, ms)| format!("{name} {} ms", short(*ms))).collect::<Vec<_>>().join(", ");
            let _ = write!(
                html,
                "<h3>{}</h3>\n<p>{} caches, {} virtual lights: <b>{} ms</b> a frame ({}).</p>\n{}",
                escape(half.title),
                row.caches,
                row.vals,
                short(row.frame_ms()),
                escape(&times),
                table(&rows),
            );
        }
        let _ = writeln!(html, "<p><small>{}</small></p>", escape(&self.noise()));
        Section { title: "The default".into(), html }
    }

    /// Noise of the path-traced references themselves.
    fn noise(&self) -> String {
        let noise = |about: &serde_json::Value| {
            Some(format!("{} of {}", percent(Some(about["noise"].as_f64()?)), about["name"].as_str()?))
        };
        let all: Vec<String> = self.results.references.iter().filter_map(noise).collect();
        if all.is_empty() {
            return "Noise of the path tracer is part of every error against it; one pass does not allow an estimate."
                .into();
        }
        format!(
            "Noise of the path tracer is part of every error against it: a relative standard error of {}.",
            all.join(", ")
        )
    }

    fn against_time(&self) -> Section {
        let plots: String = self.truths().into_iter().map(|truth| inline(&self.figures.against_time(truth))).collect();
        let html = format!(
            "<p>Each mark is a point of the sweep: GPU time of a whole frame, and {} of indirect light (both lobes). \
             Points of one bounce without shadows are compared with references of the same light, all others with all \
             light. Lower left is better. Ringed marks are the Pareto front: no other point is both faster and closer.</p>\n\
             <div class=\"plots\">{plots}</div>\n",
            METRIC.1
        );
        Section { title: "Error against time".into(), html }
    }

    fn of_knob(&self, knob: &Knob) -> Section {
        let plots: String = self.figures.of_knob(knob).iter().map(inline).collect();
        let mut html = format!("<div class=\"plots\">{plots}</div>\n");
        for half in self.halves() {
            let rows = knob.values.iter().zip(self.figures.rows_of(knob, half.base));
            let rows = rows.filter_map(|(value, row)| Some((value.label.as_str(), row?)));
            let fits = |row: &Row| row.failed.is_some() || row.error(half.best, LAYER, METRIC.0).is_some();
            let rows: Vec<(&str, &Row)> = rows.filter(|(_, row)| fits(row)).collect();
            // One value alone fits the reference.
            if rows.len() > 1 {
                html.push_str(&self.half_of_knob(knob, &half, &rows));
            }
        }
        html.push_str(&self.scale());
        let title = knob.title[..1].to_uppercase() + &knob.title[1..];
        Section { title: format!("{title} ({})", knob.name), html }
    }

    /// Table and pictures for a knob's values.
    fn half_of_knob(&self, knob: &Knob, half: &Half<'_>, rows: &[(&str, &Row)]) -> String {
        let mut cells = vec![[knob.name, "caches placed", "VALs", "frame [ms]"].map(str::to_owned).to_vec()];
        cells[0].extend(half.truths.iter().flat_map(|t| [format!("{}: error", t.short()), "bias".into()]));
        let mut strip = String::new();
        for (value, row) in rows {
            if let Some(reason) = &row.failed {
                cells.push(vec![(*value).to_owned(), reason.clone()]);
                continue;
            }
            let mut line =
                vec![(*value).to_owned(), row.caches.to_string(), row.vals.to_string(), short(row.frame_ms())];
            line.extend(half.truths.iter().flat_map(|t| ["mare", "bias"].map(|m| percent(row.error(*t, LAYER, m)))));
            cells.push(line);
            let error = percent(row.error(half.best, LAYER, METRIC.0));
            strip.push_str(&self.figure(&row.key, &format!("{} {value}: error {error}", knob.name), Some(half.best)));
        }
        strip.push_str(&self.figure(&self.key_of(half.best), &format!("reference: {}", half.best.title()), None));
        format!("<h3>{}</h3>\n{}<div class=\"strip\">{strip}</div>\n", escape(half.title), table(&cells))
    }

    fn scale(&self) -> String {
        format!("<p><small>Upper row: indirect light. Lower row: its relative squared error, {HEAT}.</small></p>\n")
    }

    /// Key of a reference's pictures.
    fn key_of(&self, truth: Truth) -> String {
        let finest = format!("brute-force-{}", self.job.sweep.rsm_sides().last().copied().unwrap_or(0));
        let name = if truth == Truth::FinestVals { finest.as_str() } else { truth.name() };
        let found = self.results.references.iter().find(|about| about["name"] == name);
        found.and_then(|about| about["key"].as_str()).unwrap_or_default().to_owned()
    }

    /// A picture with the heat map of its error against a reference below; empty if there is no file.
    fn figure(&self, key: &str, caption: &str, error_against: Option<Truth>) -> String {
        let image = |shows: Shows, alt: &str| {
            let bytes = files::read(&self.results.pictures.path(key, shows)).ok()?;
            let data = base64::engine::general_purpose::STANDARD.encode(bytes);
            Some(format!("<img alt=\"{}\" src=\"data:image/png;base64,{data}\">", escape(alt)))
        };
        let light = image(Shows::Light, &format!("Indirect light, {caption}"));
        let error = error_against.and_then(|truth| image(Shows::Error(truth), &format!("Error, {caption}")));
        match light {
            None => String::new(),
            Some(light) => format!(
                "<figure>{light}{}<figcaption>{}</figcaption></figure>\n",
                error.unwrap_or_default(),
                escape(caption)
            ),
        }
    }

    fn grid(&self) -> Section {
        let [caches, vals] = [&self.job.sweep.knobs[0], &self.job.sweep.knobs[1]];
        let plots: String = self.grids().iter().map(inline).collect();
        let mut html = format!("<div class=\"plots\">{plots}</div>\n");
        for half in self.halves() {
            let head = vals.values.iter().map(|v| format!("rsm {}", v.label));
            let mut cells = vec![["caches".to_owned()].into_iter().chain(head).collect::<Vec<_>>()];
            for row in 0..caches.values.len() {
                let cell = |column: usize| match self.figures.row(&vals.set(&caches.set(half.base, row), column)) {
                    Some(row) if row.failed.is_none() => {
                        let error = percent(row.error(half.best, LAYER, METRIC.0));
                        format!("{error} in {} ms", short(row.frame_ms()))
                    }
                    _ => "failed".into(),
                };
                let line = (0..vals.values.len()).map(cell);
                cells.push([caches.values[row].label.clone()].into_iter().chain(line).collect());
            }
            let _ = write!(
                html,
                "<h3>{}</h3>\n<p>{} against {}, and GPU time of a frame:</p>\n{}",
                escape(half.title),
                METRIC.1,
                half.best.title(),
                table(&cells)
            );
        }
        Section { title: "Caches by virtual lights".into(), html }
    }

    fn references(&self) -> Section {
        let text = |value: &serde_json::Value| match value {
            serde_json::Value::Null => "-".to_owned(),
            serde_json::Value::Number(n) => n.as_f64().map_or_else(|| n.to_string(), short),
            other => other.as_str().map_or_else(|| other.to_string(), str::to_owned),
        };
        let mut cells = vec![
            ["reference", "VALs", "GPU [ms]", "samples per pixel", "relative standard error"]
                .map(str::to_owned)
                .to_vec(),
        ];
        for about in &self.results.references {
            let row = about.get("row").and_then(Row::from_json);
            let samples = about["samples"].as_u64().map_or("-".into(), |n| n.to_string());
            let (vals, ms) = row.map_or(("-".into(), "-".into()), |row| (row.vals.to_string(), short(row.frame_ms())));
            cells.push(vec![text(&about["name"]), vals, ms, samples, text(&about["noise"])]);
        }
        let mut strip = String::new();
        let [_, bare] = self.halves();
        for truth in [Truth::AllLight, Truth::Unshadowed, Truth::FinestVals] {
            let error_against = (truth != bare.best).then_some(truth);
            strip.push_str(&self.figure(&self.key_of(truth), truth.title(), error_against));
        }
        let html = format!(
            "{}<div class=\"strip\">{strip}</div>\n<p><small>Below the path-traced pictures: relative squared error of brute force \
             against them, {HEAT}.</small></p>\n",
            table(&cells)
        );
        Section { title: "References".into(), html }
    }

    fn all_points(&self) -> Section {
        let truths = self.truths();
        let mut cells = vec![["point", "caches placed", "VALs", "triangles", "frame [ms]"].map(str::to_owned).to_vec()];
        cells[0].extend(truths.iter().map(|t| format!("{}: error", t.short())));
        cells[0].push("not measured because".into());
        for row in self.results.rows.iter().chain(&self.results.brute_force) {
            let mut line = vec![self.name(row), row.caches.to_string(), row.vals.to_string()];
            line.extend([row.triangles.to_string(), short(row.frame_ms())]);
            line.extend(truths.iter().map(|t| percent(row.error(*t, LAYER, METRIC.0))));
            line.push(row.failed.clone().unwrap_or_default());
            cells.push(line);
        }
        let html = format!(
            "<details><summary>{} points</summary>\n{}</details>\n<p>All metrics of all layers: \
             <code>results.csv</code>, <code>results.json</code>; the plots: <code>plots/</code>.</p>\n",
            cells.len() - 1,
            table(&cells)
        );
        Section { title: "All points".into(), html }
    }
}
