//! Writes CPU and GPU zones as a Chrome trace: JSON that <https://ui.perfetto.dev> and `chrome://tracing` open. Format:
//! "Trace Event Format", Google; times in microseconds.

use crate::error::Result;
use crate::files::replace_file;
use crate::gpu::{FrameTimes, Work, ZoneTime};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

const PROCESS: u32 = 1;

/// A track (thread) of the trace.
#[derive(Clone, Copy, PartialEq)]
enum Track {
    Cpu = 1,
    Gpu = 2,
}

/// A span of time on a track, relative to the trace's start \[ns\]. Whole numbers, so that nested spans stay nested.
struct Spent {
    track: Track,
    name: &'static str,
    begin: i64,
    end: i64,
    /// Index of the frame this span belongs to.
    frame: Option<usize>,
}

/// The trace of a program run, under construction.
pub struct Trace {
    start: Instant,
    /// End of the last lap.
    last: Instant,
    spans: Vec<Spent>,
    /// Start times of the frames, where counters are sampled.
    frames: Vec<i64>,
    way: &'static str,
}

/// A counter: its name, and its named series with their values.
pub type Counter<'a> = (&'a str, &'a [(&'a str, u64)]);

impl Default for Trace {
    fn default() -> Self {
        let start = Instant::now();
        Self { start, last: start, spans: Vec::new(), frames: Vec::new(), way: "no frames" }
    }
}

impl Trace {
    /// Records a CPU span from the last lap (or the start) until now.
    pub fn lap(&mut self, name: &'static str) {
        let now = Instant::now();
        let (begin, end) = (self.ns(self.last, 0.0), self.ns(now, 0.0));
        self.last = now;
        self.spans.push(Spent { track: Track::Cpu, name, begin, end, frame: None });
    }

    /// Time of `from` plus `ms` milliseconds, in nanoseconds since the trace's start.
    fn ns(&self, from: Instant, ms: f64) -> i64 {
        ((from.duration_since(self.start).as_secs_f64() * 1e3 + ms) * 1e6).round() as i64
    }

    /// Adds frames, oldest first. The CPU must have finished each frame before it started the next.
    ///
    /// The device's clock has its own zero. The GPU track is therefore shifted as a whole, by the smallest amount for
    /// which no zone starts before the CPU started to submit it.
    pub fn frames(&mut self, frames: &[FrameTimes]) {
        let shift = frames.iter().flat_map(|frame| self.least_shifts(frame)).reduce(f64::max);
        let mut idle_since = 0;
        for (i, frame) in frames.iter().enumerate() {
            let at = |ms| self.ns(frame.begin, ms);
            let mut spans = vec![(Track::Cpu, "frame", at(0.0), at(frame.cpu_span_ms()))];
            spans.extend(frame.work.iter().map(|(w, s)| (Track::Cpu, word(*w), at(s.begin_ms), at(s.end_ms))));
            spans.extend(frame.zones.iter().map(|z| (Track::Cpu, z.name, at(z.cpu.begin_ms), at(z.cpu.end_ms))));
            if let (Some(first), Some(shift), Some(length)) = (frame.first_stamp_ms, shift, frame.gpu_span_ms()) {
                // Rounding must not let a frame start before the previous one ended.
                let at = |ms: f64| (((shift + first + ms) * 1e6).round() as i64).max(idle_since);
                spans.push((Track::Gpu, "frame", at(0.0), at(length)));
                let zones = frame.zones.iter().filter_map(|z| Some((z.name, z.gpu?)));
                spans.extend(zones.map(|(name, s)| (Track::Gpu, name, at(s.begin_ms), at(s.end_ms))));
                idle_since = at(length);
            }
            self.frames.push(self.ns(frame.begin, 0.0));
            self.spans.extend(spans.into_iter().map(|(track, name, begin, end)| Spent {
                track,
                name,
                begin,
                end,
                frame: Some(i),
            }));
            self.way = frame.way();
        }
    }

    /// For each timed zone, the smallest shift \[ms\] of the device's clock for which the zone's first timestamp
    /// follows the start of its submission.
    fn least_shifts(&self, frame: &FrameTimes) -> Vec<f64> {
        let began = frame.begin.duration_since(self.start).as_secs_f64() * 1e3;
        let submits = || frame.work.iter().filter(|(work, _)| *work == Work::Submit).map(|(_, span)| span.begin_ms);
        let shift = |zone: &ZoneTime| {
            let submitted = submits().find(|begin_ms| *begin_ms >= zone.cpu.begin_ms)?;
            Some(began + submitted - (frame.first_stamp_ms? + zone.gpu?.begin_ms))
        };
        frame.zones.iter().filter_map(shift).collect()
    }

    /// Writes the trace, with counters sampled at the start of each frame and facts about the run.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn write(&self, path: &Path, counters: &[Counter<'_>], facts: &Map<String, Value>) -> Result<()> {
        let named = |what: &str, track: u32, name: String| json!({ "name": what, "ph": "M", "pid": PROCESS, "tid": track, "ts": 0, "args": { "name": name } });
        let mut head =
            vec![named("process_name", 0, "lightskin".into()), named("thread_name", Track::Cpu as u32, "CPU".into())];
        if self.spans.iter().any(|s| s.track == Track::Gpu) {
            head.push(named("thread_name", Track::Gpu as u32, format!("GPU ({})", self.way)));
        }
        // Enclosing spans come before the spans that they contain.
        let mut spans: Vec<&Spent> = self.spans.iter().collect();
        spans.sort_by_key(|s| (s.track as u32, s.begin, -s.end));
        let us = |ns: i64| ns as f64 / 1e3;
        let spans = spans.into_iter().map(|s| {
            let args = s.frame.map_or_else(|| json!({}), |frame| json!({ "frame": frame }));
            let (ts, dur) = (us(s.begin), us(s.end - s.begin));
            json!({
                "name": s.name, "ph": "X", "pid": PROCESS, "tid": s.track as u32, "ts": ts, "dur": dur, "args": args,
            })
        });
        let counts = self.frames.iter().flat_map(|at| counters.iter().map(move |counter| (*at, counter)));
        let counts = counts.map(|(at, (name, series))| {
            let args: Map<String, Value> = series.iter().map(|(name, value)| ((*name).into(), json!(value))).collect();
            json!({ "name": name, "ph": "C", "pid": PROCESS, "tid": Track::Cpu as u32, "ts": us(at), "args": args })
        });
        replace_file(path, |file| {
            write!(
                file,
                "{{\"displayTimeUnit\":\"ms\",\"otherData\":{},\"traceEvents\":[",
                Value::from(facts.clone())
            )?;
            for (i, event) in head.into_iter().chain(spans).chain(counts).enumerate() {
                write!(file, "{}\n{event}", if i == 0 { "" } else { "," })?;
            }
            writeln!(file, "\n]}}")
        })
    }
}

fn word(work: Work) -> &'static str {
    match work {
        Work::Wait => "wait",
        Work::Record => "record",
        Work::Submit => "submit",
    }
}
