//! Frame times: read without waiting, correct across wrap-arounds, and the same in tables and traces.

use crate::cli::{fails, folder, left, works};
use crate::common::frames::{SPOT, baked, corner, small};
use crate::common::{apart, assert_clean, compile, frame_of, from_spirv, gpu, open};
use crate::moving::{bend, world};
use glam::Vec3;
use lightskin::frame::{ClusterRule, Features, LightShadows, Plan, Quality, Settings, Shadows, View, World};
use lightskin::gpu::{FrameTimes, Gpu, Validation, Work, nearest_rank, ticks_between};
use lightskin::lab::knobs::{Frame, Gi, Knobs, Path};
use lightskin::scene::sky::Sky;
use lightskin::scene::{Scene, gltf};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;

const CORNELL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/cornell_glossy.glb");

#[test]
fn percentiles_are_nearest_ranks() {
    let five = [15.0, 20.0, 35.0, 40.0, 50.0];
    let of = |percent| nearest_rank(&five, percent);
    assert_eq!([5.0, 30.0, 40.0, 50.0, 100.0].map(of), [15.0, 20.0, 20.0, 35.0, 50.0]);
    let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
    assert_eq!([50.0, 95.0, 99.0, 100.0].map(|p| nearest_rank(&hundred, p)), [50.0, 95.0, 99.0, 100.0]);
    assert_eq!([50.0, 95.0, 99.0, 100.0].map(|p| nearest_rank(&[1.0, 2.0, 3.0], p)), [2.0, 3.0, 3.0, 3.0]);
    assert_eq!([0.0, 50.0, 100.0].map(|p| nearest_rank(&[7.0], p)), [7.0; 3]);
}

#[test]
fn stamps_wrap_around_their_valid_bits() {
    assert_eq!(ticks_between(5, 12, 64), 7);
    assert_eq!(ticks_between(12, 5, 64), -7);
    assert_eq!(ticks_between(u64::MAX - 1, 3, 64), 5);
    let bits = 36;
    let last = (1_u64 << bits) - 1;
    assert_eq!(ticks_between(last, 0, bits), 1);
    assert_eq!(ticks_between(last - 9, 20, bits), 30);
    assert_eq!(ticks_between(20, last - 9, bits), -30);
    // Bits above the valid bits are ignored.
    assert_eq!(ticks_between(0xdead << 40 | 7, 0xbeef << 40 | 9, bits), 2);
    // Differences of up to half the range.
    assert_eq!(ticks_between(3, 3 + (1 << 35) - 1, bits), (1 << 35) - 1);
}

/// A frame of two stages. The first has two parts.
fn draw(gpu: &Gpu, split: bool) -> lightskin::gpu::Frame {
    let frame = frame_of(gpu, split, |cmd| {
        {
            let _outer = cmd.zone("outer");
            for _ in 0..2 {
                let _inner = cmd.zone("inner");
            }
        }
        let _last = cmd.zone("last");
        Ok(())
    });
    frame.expect("frame")
}

fn assert_sound(times: &FrameTimes, split: bool) {
    let zones: Vec<_> = times.zones.iter().map(|z| (z.name, z.depth)).collect();
    assert_eq!(zones, [("outer", 0), ("inner", 1), ("inner", 1), ("last", 0)]);
    assert_eq!(times.split, split);
    for spans in [times.zones.iter().map(|z| z.cpu).collect(), times.zones.iter().filter_map(|z| z.gpu).collect()] {
        let spans: Vec<lightskin::gpu::Span> = spans;
        assert!(spans.is_empty() || spans.len() == 4);
        for [outer, one, two, last] in spans.as_chunks::<4>().0 {
            assert!(outer.begin_ms >= 0.0 && outer.begin_ms <= one.begin_ms && one.begin_ms <= one.end_ms, "{times:?}");
            assert!(
                one.end_ms <= two.begin_ms && two.begin_ms <= two.end_ms && two.end_ms <= outer.end_ms,
                "{times:?}"
            );
            assert!(outer.end_ms <= last.begin_ms && last.begin_ms <= last.end_ms, "{times:?}");
        }
    }
    let stages: Vec<_> = times.stages().iter().map(|s| s.name).collect();
    assert_eq!(stages, ["outer", "inner", "last"]);
    let [record, submit, wait] = [Work::Record, Work::Submit, Work::Wait].map(|work| times.cpu_ms(work));
    assert!(record > 0.0 && submit > 0.0 && wait >= 0.0, "{times:?}");
    assert!(record + submit + wait <= times.cpu_span_ms() * 1.001, "{times:?}");
    let submissions = times.work.iter().filter(|(work, _)| *work == Work::Submit).count();
    // The first stamp of a zone is submitted separately.
    assert_eq!(submissions, if split { 9 } else { 1 });
}

#[test]
fn many_frames_without_waiting_have_as_many_times() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    assert!(gpu.has_timestamps());
    for split in [false, true] {
        let mut all = Vec::new();
        for _ in 0..60 {
            assert_eq!(draw(&gpu, split).problems, [""; 0]);
            all.extend(gpu.finished_times().expect("times"));
        }
        gpu.wait().expect("done");
        all.extend(gpu.finished_times().expect("times"));
        assert_eq!(all.len(), 60);
        for times in &all {
            assert_sound(times, split && gpu.is_software());
            assert!(
                times.gpu_ms().is_some() && times.gpu_span_ms() >= times.gpu_ms().map(|ms| ms * 0.999),
                "{times:?}"
            );
        }
        for pair in all.windows(2) {
            assert!(pair[0].number < pair[1].number && pair[0].begin < pair[1].begin);
            let end = pair[0].first_stamp_ms.zip(pair[0].gpu_span_ms()).map(|(first, span)| first + span);
            assert!(end.expect("stamps") <= pair[1].first_stamp_ms.expect("stamps") + 1e-6, "{pair:?}");
        }
        assert_eq!(gpu.finished_times().expect("times"), []);
    }
    // Times can be read late and together. Work in between leaves no times.
    let frames: Vec<_> = (0..10).map(|_| draw(&gpu, false)).collect();
    gpu.run_once("between", |_| ()).expect("run");
    assert_sound(&gpu.times(&frames[9]).expect("times"), false);
    assert_sound(&gpu.times(&frames[0]).expect("times"), false);
    assert_eq!(gpu.finished_times().expect("times").len(), 8);
    // A loop that never reads times keeps the last 256.
    for _ in 0..300 {
        let _ = draw(&gpu, false);
    }
    gpu.wait().expect("done");
    assert_eq!(gpu.finished_times().expect("times").len(), 256);
    assert_clean(&gpu);
}

/// Shaders have zones of their own within stages, and are no stages themselves.
#[test]
fn shaders_are_timed_within_their_stage() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let code = compile("#version 460\nlayout(local_size_x = 1) in;\nvoid main() {}\n").expect("compiles");
    let pipeline = from_spirv(&gpu, "test.nothing", &code, &[]).expect("pipeline");
    let mut zones = Vec::new();
    for is_timed in [false, true] {
        if is_timed {
            gpu.time_shaders();
        }
        let frame = gpu.frame(|cmd| {
            let _stage = cmd.zone("stage");
            cmd.bind(&pipeline, &[]);
            cmd.dispatch(1, 1, 1);
            cmd.dispatch(1, 1, 1);
            Ok(())
        });
        let times = gpu.times(&frame.expect("frame")).expect("times");
        assert_eq!(times.stages().iter().map(|stage| stage.name).collect::<Vec<_>>(), ["stage"]);
        zones.push(times.zones.iter().map(|zone| (zone.name, zone.depth, zone.is_shader)).collect::<Vec<_>>());
    }
    let (stage, shader) = (("stage", 0, false), ("test.nothing", 1, true));
    assert_eq!(zones, [vec![stage], vec![stage, shader, shader]]);
    // However many shaders there are, stages keep their times.
    let frame = gpu.frame(|cmd| {
        for _ in 0..2 {
            let _stage = cmd.zone("stage");
            cmd.bind(&pipeline, &[]);
            (0..300).for_each(|_| cmd.dispatch(1, 1, 1));
        }
        Ok(())
    });
    let times = gpu.times(&frame.expect("frame")).expect("times");
    assert!(times.gpu_ms().is_some() && times.zones.iter().any(|zone| zone.is_shader));
    assert_clean(&gpu);
}

#[test]
fn a_queue_without_timestamps_gives_cpu_times() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync).without_timestamps();
    for split in [false, true] {
        let frame = draw(&gpu, split);
        let times = gpu.times(&frame).expect("times");
        assert_sound(&times, split && gpu.is_software());
        assert!(times.zones.iter().all(|z| z.gpu.is_none()) && times.first_stamp_ms.is_none());
        assert_eq!((times.gpu_ms(), times.gpu_span_ms()), (None, None));
        assert_eq!(times.way(), "no GPU times: the queue has no timestamps");
        let mut trace = lightskin::trace::Trace::default();
        trace.frames(&[times]);
        let file = folder(&format!("timing-none-{split}")).join("t.json");
        trace.write(&file, &[], &serde_json::Map::new()).expect("written");
        let events = events(&file);
        assert!(events.iter().any(|e| e["name"] == "inner") && events.iter().all(|e| e["tid"] != 2));
    }
    assert_clean(&gpu);
}

/// The events of a trace. Each must have the fields that viewers need.
fn events(file: &std::path::Path) -> Vec<Value> {
    let text = fs::read_to_string(file).expect("a trace");
    let trace: Value = serde_json::from_str(&text).expect("JSON");
    let events = trace["traceEvents"].as_array().expect("events").clone();
    for event in &events {
        assert!(["M", "X", "C"].contains(&event["ph"].as_str().expect("ph")), "{event}");
        assert!(event["pid"].is_u64() && event["tid"].is_u64() && event["name"].is_string(), "{event}");
        assert!(event["ts"].as_f64().expect("ts") >= 0.0 && event["args"].is_object(), "{event}");
        assert!(event["ph"] != "X" || event["dur"].as_f64().expect("dur") >= 0.0, "{event}");
    }
    events
}

/// Asserts that the spans [ns] of each track are nested or disjoint.
fn assert_nested(events: &[Value]) {
    let mut tracks: BTreeMap<u64, Vec<(i64, i64, String)>> = BTreeMap::new();
    let ns = |value: &Value| (value.as_f64().expect("number") * 1e3).round() as i64;
    for event in events.iter().filter(|e| e["ph"] == "X") {
        let (begin, name) = (ns(&event["ts"]), event["name"].to_string());
        tracks.entry(event["tid"].as_u64().expect("tid")).or_default().push((begin, begin + ns(&event["dur"]), name));
    }
    assert_eq!(tracks.keys().copied().collect::<Vec<_>>(), [1, 2]);
    for spans in tracks.values_mut() {
        spans.sort_by_key(|s| (s.0, -s.1));
        let mut open: Vec<&(i64, i64, String)> = Vec::new();
        for span in spans.iter() {
            while open.last().is_some_and(|outer| outer.1 <= span.0) {
                open.pop();
            }
            assert!(open.last().is_none_or(|outer| span.1 <= outer.1), "{span:?} extends beyond {open:?}");
            open.push(span);
        }
    }
}

/// Asserts that on a software device each zone lies between the start of its submission and the end of the wait for it.
fn assert_aligned(events: &[Value]) {
    let spans = |track: u64, names: &[&str]| -> Vec<(f64, f64)> {
        let of = |e: &&Value| e["ph"] == "X" && e["tid"] == track && names.contains(&e["name"].as_str().expect("name"));
        let span = |e: &Value| {
            let begin = e["ts"].as_f64().expect("ts");
            (begin, begin + e["dur"].as_f64().expect("dur"))
        };
        let mut all: Vec<_> = events.iter().filter(of).map(span).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    };
    let (submits, waits) = (spans(1, &["submit"]), spans(1, &["wait"]));
    for name in ["gbuffer", "gather", "composite"] {
        for ((cpu_begin, _), (begin, end)) in spans(1, &[name]).into_iter().zip(spans(2, &[name])) {
            let submit = submits.iter().find(|s| s.0 >= cpu_begin).expect("a submission").0;
            // The first stamp is submitted separately, and then the zone.
            let waited = waits.iter().filter(|w| w.0 >= submit).nth(1).expect("two waits").1;
            // Allow a microsecond for rounding and a hundred microseconds for clocks that drift apart.
            assert!(begin >= submit - 1.0 && end <= waited + 100.0, "{name}: {begin} to {end}, {submit} to {waited}");
        }
    }
}

/// Lines of a CSV file, with cells by heading.
fn rows(text: &str) -> Vec<BTreeMap<String, String>> {
    let cells = |line: &str| {
        let (mut all, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => all.push(String::new()),
                c => all.last_mut().expect("a cell").push(c),
            }
        }
        all
    };
    let mut lines = text.lines();
    let head = cells(lines.next().expect("a heading"));
    lines
        .map(|line| {
            let row = cells(line);
            assert_eq!(row.len(), head.len(), "{line}");
            head.iter().cloned().zip(row).collect()
        })
        .collect()
}

#[test]
fn trace_csv_and_json_lines_tell_of_every_stage() {
    let at = folder("timing-render");
    let args = ["render", CORNELL, "-o", "a.png", "--size", "48x48", "--caches", "60", "--rsm", "16", "--repeat", "3"];
    let files = ["--trace", "t.json", "--timings", "t.csv", "--timings", "t.jsonl", "--validation", "sync"];
    let said = works(&at, &[&args[..], &files].concat());
    for word in ["median", "p95", "p99", "max", "3 frames", "record", "submit", "wait"] {
        assert!(said.contains(word), "no {word} in {said}");
    }
    assert_eq!(left(&at), ["a.png", "t.csv", "t.json", "t.jsonl"]);

    // Every stage of the command's default plan is on both tracks, once for each frame.
    let scene = gltf::load(CORNELL.as_ref()).expect("loads");
    let plan = Plan::of(&Features::new(&scene, false, false), &Settings::at(Quality::High, 60));
    let stages: Vec<_> = plan.stages().map(|stage| stage.name).collect();
    assert!(stages.len() >= 10, "{stages:?}");
    let events = events(&at.join("t.json"));
    assert_nested(&events);
    if Gpu::new(&Default::default()).expect("a device").is_software() {
        assert_aligned(&events);
    }
    let count = |ph: &str, tid: u64, name: &str| {
        events.iter().filter(|e| e["ph"] == ph && e["tid"] == tid && e["name"] == name).count()
    };
    for stage in &stages {
        assert_eq!((count("X", 1, stage), count("X", 2, stage)), (3, 3), "{stage}");
    }
    assert_eq!((count("X", 1, "frame"), count("X", 2, "frame"), count("X", 1, "record")), (3, 3, 3));
    for name in ["load", "bake", "upload", "frames", "picture"] {
        assert_eq!(count("X", 1, name), 1, "{name}");
    }
    assert!(count("X", 1, "submit") >= 3 && count("X", 1, "wait") >= 3);
    assert_eq!((count("M", 0, "process_name"), count("M", 1, "thread_name"), count("M", 2, "thread_name")), (1, 1, 1));
    let counter = |name: &str, series: &str| {
        let all: Vec<_> = events.iter().filter(|e| e["ph"] == "C" && e["name"] == name).collect();
        assert_eq!(all.len(), 3, "{name}");
        all[0]["args"][series].as_u64().expect("a count")
    };
    let targets = counter("device memory [bytes]", "targets");
    assert!(targets > 48 * 48 * (16 + 16 + 8 + 8 + 4 + 4) && targets < 100_000_000, "{targets}");

    // Both tables have the same numbers.
    let rows = rows(&fs::read_to_string(at.join("t.csv")).expect("CSV"));
    let text = fs::read_to_string(at.join("t.jsonl")).expect("JSON lines");
    let frames: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!((rows.len(), frames.len()), (3 * stages.len(), 3));
    assert_eq!(counter("VALs", "VALs"), frames[0]["live_vals"].as_u64().expect("vals"));
    assert_eq!(counter("live caches", "caches"), frames[0]["live_caches"].as_u64().expect("caches"));
    for (frame, rows) in frames.iter().zip(rows.chunks(stages.len())) {
        for ((row, stage), name) in rows.iter().zip(frame["stages"].as_array().expect("stages")).zip(&stages) {
            assert_eq!((&row["stage"], stage["name"].as_str()), (&(*name).to_owned(), Some(*name)));
            for what in ["gpu_ms", "cpu_ms"] {
                let ms: f64 = row[&format!("stage_{what}")].parse().expect("a number");
                assert_eq!(Some(ms), stage[what].as_f64());
            }
            assert_eq!(row.len(), 3 + frame.as_object().expect("object").len() - 1);
            for (name, value) in frame.as_object().expect("object").iter().filter(|(name, _)| *name != "stages") {
                let same = match value {
                    Value::Null => row[name].is_empty(),
                    Value::String(text) => row[name] == *text,
                    Value::Array(_) => row[name] == "48x48",
                    other => serde_json::from_str::<Value>(&row[name]).is_ok_and(|v| v == *other),
                };
                assert!(same, "{name}: {} is not {value}", row[name]);
            }
        }
        let sum: f64 = rows.iter().map(|row| row["stage_gpu_ms"].parse::<f64>().expect("ms")).sum();
        let whole = frame["gpu_ms"].as_f64().expect("ms");
        assert!((sum - whole).abs() < 1e-6 && frame["gpu_span_ms"].as_f64().expect("ms") >= whole - 1e-6);
        for name in ["device", "driver", "method", "gi", "interpolation", "gather", "proxy_weight", "validation"] {
            assert!(frame[name].as_str().is_some_and(|text| !text.is_empty()), "{name} in {frame}");
        }
    }
    // A frame is as long in the trace as in the table.
    let drawn =
        events.iter().filter(|e| e["tid"] == 2 && e["name"] == "frame").map(|e| e["dur"].as_f64().expect("dur"));
    for (us, frame) in drawn.zip(&frames) {
        let ms = frame["gpu_span_ms"].as_f64().expect("ms");
        assert!((us / 1e3 - ms).abs() < 1e-5, "{us} us, {ms} ms");
    }
}

#[test]
fn traces_name_every_pass_of_every_kind_of_frame() {
    /// Name, world, settings, and a test that its plan is of the intended kind.
    type Kind<'a> = (&'a str, &'a Scene, Knobs, fn(&Plan) -> bool);
    const FRAMES: usize = 2;
    let gpu = gpu();
    let room = corner(&[SPOT], 20.0);
    let mut open = room.clone();
    Sky::even(Vec3::splat(100.0)).put_over(&mut open, 2);
    let mut glowing = room.clone();
    glowing.materials[2].emissive = Vec3::splat(100.0);
    let mut glowing_alone = glowing.clone();
    glowing_alone.lights.clear();
    let moving = world();
    let usual = Knobs { size: [32, 32], rsm: 16, light_shadows: LightShadows::Maps(64), cull: true, ..small() };
    let with = |shadows| Knobs { shadows, ..usual };
    let by = |rule| Knobs { path: Path::Clusters(rule), ..usual };
    let frames: [Kind<'_>; 13] = [
        ("draws", &room, Knobs { path: Path::DRAWS, ..usual }, |plan| plan.cull),
        ("all-caches", &room, Knobs { cull: false, ..usual }, |plan| plan.lightskin && !plan.cull),
        ("clusters", &room, by(ClusterRule::Distance(8.0)), |plan| plan.clusters),
        ("cluster-errors", &room, by(ClusterRule::Error(0.05)), |plan| plan.clusters),
        ("proxy-shadows", &room, with(Shadows::Proxy), |plan| plan.occlude),
        ("per-light-shadows", &room, with(Shadows::PerLight), |plan| plan.depth_images),
        ("bounces", &room, Knobs { bounces: 2, ..usual }, |plan| plan.bounces > 0),
        ("brute-force", &room, Knobs { gi: Gi::BruteForce, ..usual }, |plan| plan.brute_force),
        ("direct-alone", &room, Knobs { gi: Gi::Off, ..usual }, |plan| !plan.indirect()),
        ("sky", &open, usual, |plan| plan.sky),
        ("emitters", &glowing, usual, |plan| plan.emitters && plan.direct),
        ("emitters-alone", &glowing_alone, usual, |plan| plan.emitters && !plan.direct),
        ("moving", &moving, usual, |plan| plan.deform),
    ];
    let texels: [Kind<'_>; 2] = [
        ("texels", &room, usual, |plan| plan.lightskin),
        ("moving-with-all", &moving, with(Shadows::PerLight), |plan| plan.deform),
    ];
    let frames = frames.map(|kind| (kind, false)).into_iter().chain(texels.map(|kind| (kind, true)));
    for ((kind, scene, settings, is_it), cells) in frames {
        let mut scene = scene.clone();
        let mut caches = baked(&scene, 0.5, 8);
        if cells {
            caches = caches.with_cells(&scene).expect("cells");
        }
        let mut buffers = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
        let mut frame = Frame::new(&gpu, &scene, &buffers, &settings).expect("made");
        assert!(is_it(&frame.light.plan), "{kind}: {:?}", frame.light.plan);
        let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
        let (mut trace, mut all) = (lightskin::trace::Trace::default(), Vec::new());
        for i in 0..FRAMES {
            if frame.light.plan.deform {
                bend(&mut scene, 0.3 * (i + 1) as f64, 0.2);
            }
            buffers.update(&gpu, &scene).expect("the same scene");
            let drawn = gpu.timed_frame(|cmd| {
                frame.record(cmd, &buffers, &view);
                Ok(())
            });
            let drawn = drawn.expect("drawn");
            assert_eq!(drawn.problems, [""; 0], "{kind}");
            all.push(gpu.times(&drawn).expect("times"));
        }
        trace.frames(&all);
        let file = folder(&format!("timing-{kind}")).join("t.json");
        trace.write(&file, &[], &serde_json::Map::new()).expect("written");

        let mut expected = if frame.light.plan.deform { vec!["update", "deform"] } else { Vec::new() };
        expected.extend(frame.light.plan.stages().map(|stage| stage.name));
        let events = events(&file);
        assert_nested(&events);
        for i in 0..FRAMES {
            let zones = |track: u64| -> Vec<&Value> {
                let is_zone = |e: &&Value| e["ph"] == "X" && e["tid"] == track && e["args"]["frame"] == i;
                let of_cpu = |e: &&Value| ["frame", "wait", "record", "submit"].map(Value::from).contains(&e["name"]);
                events.iter().filter(is_zone).filter(|e| !of_cpu(e)).collect()
            };
            for zones in [zones(1), zones(2)] {
                let names: Vec<&str> = zones.iter().map(|e| e["name"].as_str().expect("a name")).collect();
                assert_eq!(names, expected, "{kind}, frame {i}");
                // Stamps in the wrong order would make a zone without duration.
                assert!(!gpu.is_software() || zones.iter().all(|e| e["dur"].as_f64() > Some(0.0)), "{kind}: {zones:?}");
            }
        }
    }
    assert_clean(&gpu);
}

#[test]
fn names_of_files_and_path_traces_are_checked() {
    let at = folder("timing-usage");
    fails(&at, &["render", "--timings", "t.txt"], 2, &[".jsonl or .csv"]);
    fails(&at, &["render", "--trace", "t.jsonl"], 2, &[".json"]);
    for flag in [["--trace", "t.json"], ["--timings", "t.csv"]] {
        fails(&at, &[&["render", "--gi", "path-trace"], &flag[..]].concat(), 2, &["--gi path-trace has no stages"]);
    }
    fails(&at, &["render", "--trace", "no/folder/t.json"], 1, &["does not exist"]);
    assert_eq!(left(&at), [""; 0]);
}
