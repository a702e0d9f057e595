//! The report of speed against error: measured points, kept points and written files.

use crate::cli::{fails, folder, left, works};
use crate::common::{assert_clean, gpu};
use lightskin::frame::Quality;
use lightskin::lab::eval::report;
use lightskin::lab::eval::run::{Job, Results, run};
use lightskin::lab::eval::sweep::{Extent, Point, Sweep};
use lightskin::lab::knobs::Knobs;
use lightskin::scene::build::{CornellSurface, cornell};
use lightskin::scene::{Scene, write::write_glb};
use std::fs;
use std::path::Path;

/// A Cornell box with few triangles.
fn small() -> Scene {
    cornell(CornellSurface::Glossy, 0.5)
}

fn eval(at: &Path, more: &[&str]) -> String {
    let args = ["eval", "box.glb", "-o", "report", "--quick", "--size", "32x18", "--spp", "16", "--frames", "1"];
    works(at, &[&args, &["--max-edge", "0"][..], more].concat())
}

/// Numbers of measured, kept and failed points.
fn counts(out: &str) -> (usize, usize, usize) {
    let line = out.lines().find(|line| line.starts_with("points")).expect("a line of counts");
    let numbers: Vec<usize> = line.split(|c: char| !c.is_ascii_digit()).filter_map(|n| n.parse().ok()).collect();
    let [points, measured, kept, failed] = numbers[..] else { panic!("{line}") };
    assert_eq!(points, measured + kept + failed, "{line}");
    (measured, kept, failed)
}

#[test]
fn a_report_stands_alone_and_a_restart_measures_what_is_missing() {
    let at = folder("eval-report");
    write_glb(&small(), &at.join("box.glb")).expect("a scene");
    let caches = ["--caches", "250"];
    let first = eval(&at, &caches);
    // The default, and one bounce without shadows: three cache counts by three RSM sizes, and one alternative for each of
    // three knobs. Also two more kinds of shadows, one of them with and without short rays, shadows without short rays,
    // one bounce with shadows, and two cluster distances.
    assert_eq!(counts(&first), (31, 0, 0), "{first}");
    let report = at.join("report");
    let wanted = ["index.html", "pictures", "plots", "points.jsonl", "references", "results.csv", "results.json"];
    assert_eq!(left(&report), wanted);

    let page = fs::read_to_string(report.join("index.html")).expect("a page");
    assert!(
        !page.contains("http") && !page.contains("href") && !page.contains("url("),
        "the page must not load other files"
    );
    assert!(!page.contains("<script") && !page.contains("@import"));
    assert_eq!(page.matches("src=").count(), page.matches("src=\"data:image/png;base64,").count());
    assert!(page.matches("<img").count() > 20 && page.matches("<svg").count() > 15);
    let words: String =
        page.split("data:image/png;base64,").map(|part| part.split_once('"').map_or(part, |of| of.1)).collect();
    assert!(!words.contains("NaN") && !words.contains("Not measured"));
    assert!(!lightskin_is_software() || page.contains("software device"), "the page must name a software device");
    for name in ["same virtual lights", "most virtual lights", "no shadows", "all light", "Pareto front"] {
        assert!(page.contains(name), "{name}");
    }

    let table = fs::read_to_string(report.join("results.csv")).expect("a table");
    let head: Vec<&str> = table.lines().next().expect("a head").split(',').collect();
    assert!(table.lines().all(|line| line.split(',').count() == head.len()), "{table}");
    for name in [
        "caches",
        "rsm",
        "refs",
        "interpolation",
        "proxy-weight",
        "cluster",
        "bounces",
        "frame_ms",
        "gather_ms",
        "reference",
    ] {
        assert!(head.contains(&name), "{head:?}");
    }
    for name in ["mae", "mare", "rmse", "relmse", "relmse-trimmed", "median-relative", "bias", "psnr", "ssim", "flip"] {
        assert!(head.contains(&name), "{head:?}");
    }
    // Fourteen points of one bounce without shadows have three references, the other seventeen have one, and three of brute
    // force have two. Each has two lobes and their sum.
    assert_eq!(table.lines().count(), 1 + (17 + 14 * 3 + 3 * 2) * 3);
    // Only points of one bounce without shadows are compared with references of that, and with no others.
    let [gi, shadows, bounces, reference] =
        ["gi", "shadows", "bounces", "reference"].map(|name| head.iter().position(|n| *n == name).expect(name));
    for line in table.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let is_bare = cells[gi] == "brute-force" || (cells[shadows] == "off" && cells[bounces] == "1");
        assert_eq!(is_bare, cells[reference] != "path-traced", "{line}");
    }
    let results: serde_json::Value =
        serde_json::from_slice(&fs::read(report.join("results.json")).expect("results")).expect("JSON");
    assert_eq!(results["points"].as_array().map(Vec::len), Some(34));
    assert_eq!(results["references"].as_array().map(Vec::len), Some(5));

    let second = eval(&at, &caches);
    assert_eq!(counts(&second), (0, 31, 0), "{second}");
    assert_eq!(fs::read_to_string(report.join("results.csv")).expect("a table"), table);
    assert!(
        fs::read_to_string(report.join("index.html")).expect("a page") == page,
        "the same numbers must give the same page"
    );

    // An interrupted run: one line is cut short, and another point lacks a picture.
    let lines = fs::read_to_string(report.join("points.jsonl")).expect("points");
    fs::write(report.join("points.jsonl"), &lines[..lines.len() - 100]).expect("points");
    let picture = fs::read_dir(report.join("pictures")).expect("pictures").map(|e| e.expect("entry").path());
    let key = &serde_json::from_str::<serde_json::Value>(lines.lines().nth(3).expect("a row")).expect("JSON")["key"];
    let key = &key.as_str().expect("a key")[..16];
    let picture: Vec<_> = picture.filter(|p| p.to_string_lossy().contains(&format!("{key}-error"))).collect();
    fs::remove_file(&picture[0]).expect("a picture of the default");
    let third = eval(&at, &caches);
    assert_eq!(counts(&third), (2, 29, 0), "{third}");
}

fn lightskin_is_software() -> bool {
    lightskin::gpu::Gpu::new(&lightskin::gpu::Options::default()).expect("a Vulkan device").is_software()
}

/// Measures only these points of the quick sweep around 50 caches and RSMs of this side, and writes the report.
fn measure(scene: &Scene, folder: &Path, rsm: u32, points: impl Fn(&Point) -> bool) -> Results {
    let frame = Knobs { rsm, ..Knobs::at(Quality::High, 50, [32, 18]) };
    let base = Point { frame, caches: 50, references: 8, angle: 1.0, max_edge: Some(0.0) };
    let mut sweep = Sweep::new(base, Extent::Quick, 1, 16);
    sweep.points.retain(points);
    let gpu = gpu();
    let job = Job { gpu: &gpu, scene, camera: &scene.cameras[0], sweep: &sweep, folder, program: "this test" };
    let results = run(&job, &|_, _| ()).expect("measured");
    report::write(&job, &results, &[]).expect("written");
    assert_eq!(results.problems, [""; 0]);
    assert_clean(&gpu);
    results
}

/// With another scene no kept point fits, but none is lost.
#[test]
fn points_of_another_scene_stay() {
    let at = folder("eval-scenes");
    let mut brighter = small();
    brighter.lights[0].intensity *= 2.0;
    for (scene, is_new) in [(small(), true), (brighter, true), (small(), false)] {
        let results =
            measure(&scene, &at, 32, |point| point.caches == 50 && point.frame.rsm == 32 && point.frame.bounces == 1);
        let (new, kept, all) = (results.measured, results.kept, results.rows.len());
        assert!(all > 2 && (new, kept) == if is_new { (all, 0) } else { (0, all) }, "{new} {kept} of {all}");
    }
}

/// Three lights of 4096 x 4096 texels each exceed the maximum number of VALs.
#[test]
fn a_point_that_fails_is_a_row_with_its_reason() {
    let at = folder("eval-fails");
    let mut scene = small();
    for _ in 0..2 {
        scene.lights.push(scene.lights[0].clone());
    }
    let is_wanted =
        |point: &Point| point.caches == 50 && [32, 4096].contains(&point.frame.rsm) && point.frame.bounces == 1;
    let results = measure(&scene, &at, 4096, is_wanted);
    let failed = results.rows.iter().filter(|row| row.failed.is_some()).count();
    assert!(results.measured > 0 && results.kept == 0 && failed > 0 && results.measured + failed == results.rows.len());
    let table = fs::read_to_string(at.join("results.csv")).expect("a table");
    let failures: Vec<&str> = table.lines().filter(|line| line.contains("smaller --rsm")).collect();
    // One brute-force point fails, too.
    assert_eq!(failures.len(), failed + 1, "{table}");
    assert!(failures.iter().all(|line| line.contains(",4096,")), "{table}");
    assert!(table.lines().any(|line| line.contains("same-vals")), "{table}");
    let page = fs::read_to_string(at.join("index.html")).expect("a page");
    assert!(page.contains("Not measured") && page.contains("smaller --rsm"));
    // Failed points are tried again, measured points are kept.
    let again = measure(&scene, &at, 4096, is_wanted);
    assert_eq!((again.measured, again.kept), (0, results.measured));
    assert_eq!(again.rows.iter().filter(|row| row.failed.is_some()).count(), failed);
}

#[test]
fn a_folder_that_cannot_hold_a_report_is_one_line() {
    let at = folder("eval-bad");
    write_glb(&small(), &at.join("box.glb")).expect("a scene");
    fs::write(at.join("file"), "text").expect("file");
    fs::create_dir_all(at.join("taken/index.html")).expect("folder");
    fs::create_dir_all(at.join("points/points.jsonl")).expect("folder");
    let run = ["eval", "box.glb", "--quick", "--size", "16x9", "-o"];
    let try_in = |out: &str, parts: &[&str]| fails(&at, &[&run[..], &[out]].concat(), 1, parts);
    try_in("file", &["file", "name a folder"]);
    try_in("file/below", &["file/below", "cannot write"]);
    try_in("taken", &["taken/index.html", "is a directory", "give the name of a file"]);
    try_in("points", &["points.jsonl", "is a folder"]);
    fails(&at, &["eval", "missing.glb", "-o", "report"], 1, &["missing.glb"]);
    fails(&at, &["eval", "box.glb", "-o", "report", "--camera", "9"], 1, &["--camera 9"]);
    let away = "0,1,9;0,1,19;0,1,0;40";
    let quick = ["eval", "box.glb", "-o", "away", "--quick", "--size", "16x9", "--spp", "16", "--camera", away];
    fails(&at, &quick, 1, &["no surface", "--camera"]);
    fails(&at, &["eval", "--size", "12"], 2, &["--size"]);
    fails(&at, &["eval", "--spp", "0"], 2, &["--spp"]);
}
