//! Output of times by `lightskin render`: the printed table, JSON lines, CSV, and a trace.

use super::{Baked, thousands};
use anyhow::Result;
use lightskin::files::replace_file;
use lightskin::frame::{Counts, Light};
use lightskin::gpu::{FrameTimes, Gpu, Work, nearest_rank};
use lightskin::scene::{Camera, Scene};
use lightskin::trace::Trace;
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

pub(super) fn timings_file(text: &str) -> std::result::Result<PathBuf, String> {
    named(text, &["jsonl", "csv"], "the name must end in .jsonl or .csv")
}

pub(super) fn trace_file(text: &str) -> std::result::Result<PathBuf, String> {
    named(text, &["json"], "the name must end in .json")
}

fn named(text: &str, extensions: &[&str], otherwise: &str) -> std::result::Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if extensions.iter().any(|e| has_extension(&path, e)) { Ok(path) } else { Err(otherwise.into()) }
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// All data that is reported about a render.
pub(super) struct Report<'a> {
    pub(super) scene: &'a Scene,
    pub(super) camera: &'a Camera,
    pub(super) baked: Option<&'a Baked>,
    pub(super) gpu: &'a Gpu,
    pub(super) light: &'a Light,
    /// Counts of the last frame.
    pub(super) counts: Counts,
    /// Time of the uncounted first frame, in which the driver compiles its shaders [ms]. `None` if frames skip
    /// unchanged stages: no extra frame is drawn then.
    pub(super) first_ms: Option<f64>,
    /// Names and values of the flags that affect cost.
    pub(super) settings: Vec<(&'static str, Value)>,
    /// Times of the rendered frames, at least one.
    pub(super) runs: &'a [FrameTimes],
}

impl Report<'_> {
    fn caches(&self) -> usize {
        self.baked.map_or(0, |b| b.count)
    }

    fn vals(&self) -> u32 {
        self.light.vals().map_or(0, |vals| vals.count)
    }

    /// Number of pairs of a lit cache and a VAL that carries light.
    fn pairs(&self) -> f64 {
        f64::from(self.counts.caches) * f64::from(self.counts.vals)
    }

    /// Device memory of render targets and other per-frame resources, of scene buffers, and of textures [bytes].
    fn memory(&self) -> [(&'static str, u64); 3] {
        let (mut targets, mut scene, mut textures) = (0, 0, 0);
        for resource in self.gpu.resources() {
            *match resource.name.as_str() {
                name if name.starts_with("scene.texture ") => &mut textures,
                name if name.starts_with("scene.") || name.starts_with("deform.") => &mut scene,
                _ => &mut targets,
            } += resource.bytes;
        }
        [("targets", targets), ("scene", scene), ("textures", textures)]
    }

    pub(super) fn print(&self, loaded: Duration, ev: f32) {
        let report = self.gpu.report();
        say!(
            "scene     {} ({} triangles, {} lights; loaded in {:.2} s)",
            self.scene.name,
            thousands(self.scene.triangle_count()),
            self.scene.lights.len(),
            loaded.as_secs_f64()
        );
        say!("device    {} ({}, {})", report.name, report.kind, report.driver);
        if let Some(baked) = self.baked {
            let how = if baked.kept { "read from the stored bake" } else { "baked" };
            say!(
                "caches    {} at {:.3} m spacing ({how} in {:.2} s)",
                thousands(baked.count),
                baked.caches.spacing,
                baked.time.as_secs_f64()
            );
        }
        if self.light.plan.cull {
            say!("          {} of them lit for the surfaces in view", thousands(self.counts.caches as usize));
        }
        match self.counts.vals as usize {
            0 if self.light.plan.sends_sky => say!("VALs      none: caches send the sky's light on"),
            lit => say!("VALs      {} of {} texels carry light", thousands(lit), thousands(self.vals() as usize)),
        }
        if self.light.plan.clusters {
            let (computed, all) = (self.counts.pairs, self.pairs());
            say!(
                "clusters  {} of {} pairs of cache and VAL computed ({:.2} %)",
                thousands(computed as usize),
                thousands(all as usize),
                100.0 * computed as f64 / all.max(1.0)
            );
        }
        say!("exposure  EV {ev:.2}");
        if let Some(ms) = self.first_ms {
            say!("first     {ms:.0} ms, not counted below: the driver compiles its shaders");
        }
        self.print_times();
    }

    /// Prints a line for each stage, for the whole frame, and for each part of the CPU's work.
    fn print_times(&self) {
        let repeated = self.runs.len() > 1;
        let way = self.runs[0].way();
        if repeated {
            say!(
                "  GPU{:>21} {:>10} {:>10} {:>10}     ({way}, {} frames)",
                "median",
                "p95",
                "p99",
                "max",
                self.runs.len()
            );
        } else {
            say!("  GPU ({way})");
        }
        for (name, ms) in self.stages() {
            let pairs = self.pairs();
            let per_pair = match ms.get(ms.len() / 2) {
                Some(_) if name == "gather" && pairs > 0.0 => {
                    let ns = nearest_rank(&ms, 50.0) * 1e6;
                    let computed = match self.counts.pairs as f64 {
                        computed if self.light.plan.clusters && computed > 0.0 => {
                            format!("; {:.3} ns per pair computed", ns / computed)
                        }
                        _ => String::new(),
                    };
                    format!("  ({:.3} ns per live cache and VAL{computed})", ns / pairs)
                }
                _ => String::new(),
            };
            say!("  {name:<14}{}{per_pair}", columns(&ms));
        }
        say!("  {:<14}{}", "frame", columns(&self.sorted(FrameTimes::gpu_ms)));
        say!("  CPU");
        for (name, work) in [("record", Work::Record), ("submit", Work::Submit), ("wait", Work::Wait)] {
            say!("  {name:<14}{}", columns(&self.sorted(|run| Some(run.cpu_ms(work)))));
        }
        say!("  {:<14}{}", "frame", columns(&self.sorted(|run| Some(run.cpu_span_ms()))));
    }

    /// One kind of time of all frames that have it, sorted.
    fn sorted(&self, ms: impl Fn(&FrameTimes) -> Option<f64>) -> Vec<f64> {
        let mut all: Vec<f64> = self.runs.iter().filter_map(ms).collect();
        all.sort_by(f64::total_cmp);
        all
    }

    /// GPU times [ms] of each stage, sorted.
    fn stages(&self) -> Vec<(&'static str, Vec<f64>)> {
        let of = |name| self.sorted(|run| run.stages().iter().find(|s| s.name == name)?.gpu_ms);
        // Frames may skip stages. The list has the stages of all frames, each at the place where it first occurs.
        let mut names: Vec<&'static str> = Vec::new();
        for run in self.runs {
            let mut at = 0;
            for stage in run.stages() {
                match names.iter().position(|name| *name == stage.name) {
                    Some(known) => at = known + 1,
                    None => {
                        names.insert(at, stage.name);
                        at += 1;
                    }
                }
            }
        }
        names.into_iter().map(|name| (name, of(name))).collect()
    }

    /// Facts that are the same for all frames.
    fn facts(&self) -> Vec<(&'static str, Value)> {
        let report = self.gpu.report();
        let mut facts = vec![
            ("schema", json!(1)),
            ("device", json!(report.name)),
            ("device_kind", json!(report.kind)),
            ("driver", json!(report.driver)),
            ("vulkan", json!(report.api)),
            ("software", json!(self.gpu.is_software())),
            ("method", json!(self.runs[0].way())),
            ("scene", json!(self.scene.name)),
            ("camera", json!(self.camera.name)),
            ("triangles", json!(self.scene.triangle_count())),
            ("instances", json!(self.scene.instances.len())),
            ("lights", json!(self.scene.lights.len())),
            ("caches", json!(self.caches())),
            ("spacing", json!(self.baked.map(|b| b.caches.spacing))),
            ("vals", json!(self.vals())),
            ("live_caches", json!(self.counts.caches)),
            ("live_vals", json!(self.counts.vals)),
            ("pairs", json!(self.pairs())),
            ("pairs_computed", json!(self.counts.pairs)),
            ("device_bytes", json!(self.memory().iter().map(|m| m.1).sum::<u64>())),
        ];
        facts.extend(self.settings.iter().cloned());
        facts
    }

    /// Facts that differ from frame to frame, without the stages.
    fn of_frame(&self, index: usize) -> Vec<(&'static str, Value)> {
        let run = &self.runs[index];
        let gather = run.stages().iter().find(|s| s.name == "gather").and_then(|s| s.gpu_ms);
        let pairs = self.pairs();
        vec![
            ("frame", json!(index)),
            ("gpu_ms", json!(run.gpu_ms())),
            ("gpu_span_ms", json!(run.gpu_span_ms())),
            ("gather_ns_per_pair", json!(gather.filter(|_| pairs > 0.0).map(|ms| ms * 1e6 / pairs))),
            ("cpu_ms", json!(run.cpu_span_ms())),
            ("cpu_record_ms", json!(run.cpu_ms(Work::Record))),
            ("cpu_submit_ms", json!(run.cpu_ms(Work::Submit))),
            ("cpu_wait_ms", json!(run.cpu_ms(Work::Wait))),
        ]
    }

    /// Writes one JSON object per frame, or one line of CSV per frame and stage with the same facts.
    pub(super) fn write_timings(&self, path: &Path) -> Result<()> {
        let facts = self.facts();
        let is_csv = has_extension(path, "csv");
        replace_file(path, |file| {
            for (i, run) in self.runs.iter().enumerate() {
                let here: Vec<_> = self.of_frame(i).into_iter().chain(facts.iter().cloned()).collect();
                if is_csv && i == 0 {
                    let names = ["stage", "stage_gpu_ms", "stage_cpu_ms"].into_iter().chain(here.iter().map(|f| f.0));
                    writeln!(file, "{}", names.collect::<Vec<_>>().join(","))?;
                }
                if is_csv {
                    for s in run.stages() {
                        let stage = [json!(s.name), json!(s.gpu_ms), json!(s.cpu_ms)];
                        let cells = stage.iter().chain(here.iter().map(|f| &f.1)).map(cell);
                        writeln!(file, "{}", cells.collect::<Vec<_>>().join(","))?;
                    }
                } else {
                    let mut line: Map<String, Value> = here.into_iter().map(|(n, v)| (n.to_owned(), v)).collect();
                    let stages = run.stages();
                    let stages = stages.iter().map(|s| json!({"name": s.name, "gpu_ms": s.gpu_ms, "cpu_ms": s.cpu_ms}));
                    line.insert("stages".into(), stages.collect());
                    writeln!(file, "{}", Value::from(line))?;
                }
            }
            Ok(())
        })?;
        Ok(())
    }

    /// Writes the trace, with counters and all facts.
    pub(super) fn write_trace(&self, path: &Path, trace: &Trace) -> Result<()> {
        let facts = self.facts().into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let counters = [
            ("VALs", &[("VALs", u64::from(self.counts.vals))][..]),
            ("live caches", &[("caches", u64::from(self.counts.caches))][..]),
            ("device memory [bytes]", &self.memory()[..]),
        ];
        Ok(trace.write(path, &counters, &facts)?)
    }
}

/// Median, 95th and 99th percentile and maximum by nearest rank, or the time itself if there is only one.
fn columns(sorted: &[f64]) -> String {
    match sorted {
        [] => format!("{:>10}", "-"),
        [ms] => format!("{ms:>10.3} ms"),
        _ => {
            let of = |percent| format!("{:>10.3}", nearest_rank(sorted, percent));
            format!("{} ms", [50.0, 95.0, 99.0, 100.0].map(of).join(" "))
        }
    }
}

/// A cell of CSV: text is quoted if necessary, a size is written as WxH, null is empty.
fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) if text.contains([',', '"', '\n', '\r']) => format!("\"{}\"", text.replace('"', "\"\"")),
        Value::String(text) => text.clone(),
        Value::Array(numbers) => numbers.iter().map(cell).collect::<Vec<_>>().join("x"),
        other => other.to_string(),
    }
}
