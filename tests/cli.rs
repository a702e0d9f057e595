//! The command-line tool from a user's view: outputs, messages, exit codes, and no partially written files.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

/// Creates an empty folder for one test.
pub(crate) fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).expect("a folder for the test");
    path
}

/// Makes a command run in a folder and keep its cache there. The driver's shader cache stays in the user's own folder,
/// because a software device takes ten seconds to compile all shaders.
pub(crate) fn keeping<'a>(command: &'a mut Command, folder: &Path) -> &'a mut Command {
    let set = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let own = set("XDG_CACHE_HOME").or_else(|| Some(set("HOME")?.join(".cache")));
    command.current_dir(folder).env("XDG_CACHE_HOME", folder.join("cache"));
    if let Some(own) = own {
        command.env("MESA_SHADER_CACHE_DIR", own);
    }
    command
}

/// Gives a folder without a cache the measured speed of the gather. The tool would measure for four seconds in each.
fn with_measured_gather(folder: &Path) {
    static MEASURED: LazyLock<Vec<PathBuf>> = LazyLock::new(|| {
        // Kept from run to run, as a user's is: the tool measures again when device or shaders change.
        let at = Path::new(env!("CARGO_TARGET_TMPDIR")).join("measured_gather");
        fs::create_dir_all(&at).expect("a folder");
        let words = ["render", "-o", "a.png", "--size", "8x8", "--quality", "low", "--caches", "60"];
        let room = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/cornell_diffuse.glb");
        // Commands that need no device run without one, so nothing is required here.
        let _ = keeping(Command::new(env!("CARGO_BIN_EXE_lightskin")).args(words).arg(room), &at).output();
        let kept = fs::read_dir(at.join("cache/lightskin")).into_iter().flatten().flatten().map(|file| file.path());
        kept.filter(|file| file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("gather-"))).collect()
    });
    let cache = folder.join("cache");
    if !cache.exists() {
        fs::create_dir_all(cache.join("lightskin")).expect("a folder");
        for file in MEASURED.iter() {
            fs::copy(file, cache.join("lightskin").join(file.file_name().expect("a name"))).expect("a copy");
        }
    }
}

/// Runs the tool in a folder. Its cache is in the same folder.
pub(crate) fn lightskin(folder: &Path, args: &[&str]) -> Output {
    with_measured_gather(folder);
    keeping(Command::new(env!("CARGO_BIN_EXE_lightskin")).args(args), folder).output().expect("the tool runs")
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs the tool, requires success and returns its standard output.
pub(crate) fn works(folder: &Path, args: &[&str]) -> String {
    let out = lightskin(folder, args);
    assert!(out.status.success(), "{args:?}: {}{}", text(&out.stdout), text(&out.stderr));
    text(&out.stdout)
}

/// Runs the tool and requires this exit code and an error message of one line that contains all of `parts`.
pub(crate) fn fails(folder: &Path, args: &[&str], code: i32, parts: &[&str]) {
    let out = lightskin(folder, args);
    let message = text(&out.stderr);
    assert_eq!(out.status.code(), Some(code), "{args:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{args:?}: '{part}' is not in: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
    if code == 1 {
        let line = message.lines().filter(|l| l.starts_with("lightskin: ")).count();
        assert!((1..=2).contains(&line) && message.lines().count() == line, "one line: {message}");
    }
}

/// Files in a folder, except the tool's cache.
pub(crate) fn left(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("folder");
    let mut names: Vec<_> = entries.map(|e| e.expect("entry").file_name().to_string_lossy().into_owned()).collect();
    names.retain(|n| n != "cache");
    names.sort();
    names
}

/// The scene that benchmarks use. Without a scene argument `render` takes longer.
pub(crate) const ATRIUM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/atrium.glb");

const SMALL: [&str; 6] = ["--size", "64x36", "--caches", "100", "--rsm", "16"];

#[test]
fn a_scene_becomes_a_png_with_times_and_counts() {
    let at = folder("cli-default");
    let mut args =
        vec!["render", ATRIUM, "-o", "a.png", "--timings", "t.jsonl", "--repeat", "2", "--validation", "sync"];
    args.extend(SMALL);
    let out = works(&at, &args);
    for part in
        ["caches", "VALs", "gbuffer", "gather", "interpolate", "composite", "ns per live cache and VAL", "a.png"]
    {
        assert!(out.contains(part), "'{part}' is not in {out}");
    }
    let picture = image::open(at.join("a.png")).expect("a PNG").to_rgb8();
    assert_eq!(picture.dimensions(), (64, 36));
    assert!(picture.pixels().any(|p| p.0[0] > 100), "the picture must not be black");
    let timings = fs::read_to_string(at.join("t.jsonl")).expect("timings");
    assert_eq!(timings.lines().count(), 2);
    for line in timings.lines() {
        let frame: serde_json::Value = serde_json::from_str(line).expect("JSON");
        let names: Vec<_> =
            frame["stages"].as_array().expect("stages").iter().map(|s| s["name"].as_str().expect("name")).collect();
        assert_eq!(
            names,
            [
                "gbuffer",
                "edges",
                "direct",
                "atlas",
                "rsm",
                "visible",
                "depth images",
                "gather",
                "near rays",
                "interpolate",
                "mix edges",
                "composite"
            ]
        );
        assert!(frame["gather_ns_per_pair"].as_f64().expect("figure") > 0.0);
    }
    assert_eq!(left(&at), ["a.png", "t.jsonl"]);
}

/// The channels of an EXR file, by name.
fn planes(file: &Path) -> impl Fn(&str) -> Vec<f32> + use<> {
    use exr::prelude::{ReadChannels, ReadLayers};
    let read = exr::prelude::read().no_deep_data().largest_resolution_level();
    let image = read.all_channels().first_valid_layer().all_attributes().from_file(file).expect("an EXR");
    move |name| {
        let channel = image.layer_data.channel_data.list.iter().find(|c| c.name.to_string() == name);
        channel.unwrap_or_else(|| panic!("no channel {name}")).sample_data.values_as_f32().collect()
    }
}

/// The mean of 64 pictures against the squares of a picture with 8 times as many columns and rows.
#[test]
fn the_highest_quality_is_supersampled() {
    let at = folder("cli-supersampled");
    let render = |out: &str, size: &str, more: &[&str]| {
        let mut args =
            vec!["render", ATRIUM, "-o", out, "--caches", "100", "--rsm", "16", "--shadow-map", "512", "--near", "off"];
        args.extend(["--refs", "8", "--bounces", "1", "--shadows", "off", "--size", size]);
        args.extend(more);
        works(&at, &args)
    };
    let out = render("mean.exr", "24x16", &["--quality", "reference", "--check", "--timings", "t.jsonl"]);
    // The light is computed once.
    assert!(out.contains("64 frames") && out.contains("rsm 63"), "{out}");
    assert!(fs::read_to_string(at.join("t.jsonl")).expect("times").contains("\"aa\":\"64\""));
    render("large.exr", "192x128", &["--quality", "reference", "--aa", "off"]);
    let (mean, large) = (planes(&at.join("mean.exr")), planes(&at.join("large.exr")));
    for (name, limit) in [("direct.G", 0.01), ("indirect.diffuse.G", 0.01), ("indirect.glossy.G", 0.01)] {
        let (mean, large) = (mean(name), large(name));
        let of_square = |i: usize| {
            let corner = 8 * (i / 24) * 192 + 8 * (i % 24);
            (0..64).map(|s| large[corner + s / 8 * 192 + s % 8]).sum::<f32>() / 64.0
        };
        let off: f32 = mean.iter().enumerate().map(|(i, value)| (value - of_square(i)).abs()).sum();
        let share = off / large.iter().sum::<f32>() * 64.0;
        println!("{name}: mean absolute difference {:.3} %", 100.0 * share);
        assert!(share < limit, "{name}: {share}");
    }
    // Distances are no means, even where a pixel shows near and far surfaces.
    let (z, fine) = (mean("Z"), large("Z"));
    let mut mixed = 0;
    for (i, z) in z.iter().enumerate() {
        let corner = 8 * (i / 24) * 192 + 8 * (i % 24);
        let average = (0..64).map(|s| fine[corner + s / 8 * 192 + s % 8]).sum::<f32>() / 64.0;
        let central = fine[corner + 4 * 192 + 4];
        assert!((z - central).abs() < 0.01 * central, "pixel {i}: {z}, {central}");
        mixed += usize::from((average - central).abs() > 0.1 * central);
    }
    assert!(mixed > 5, "{mixed}");
    // From outside, surfaces cover parts of pixels.
    let outside = ["--gi", "off", "--ev", "12", "--background", "transparent", "--camera", "30,20,50;0,3,0;0,1,0;40"];
    let alphas = |out: &str, size: &str, aa: &str| -> Vec<u8> {
        works(&at, &[&["render", ATRIUM, "-o", out, "--size", size, "--aa", aa], &outside[..]].concat());
        image::open(at.join(out)).expect("a PNG").to_rgba8().pixels().map(|p| p.0[3]).collect()
    };
    let (mean, large) = (alphas("mean.png", "24x16", "64"), alphas("large.png", "192x128", "off"));
    let mut partly = 0;
    for (i, alpha) in mean.iter().enumerate() {
        let corner = 8 * (i / 24) * 192 + 8 * (i % 24);
        let covered = (0..64).filter(|s| large[corner + s / 8 * 192 + s % 8] > 0).count();
        let off = f64::from(*alpha) - 255.0 * covered as f64 / 64.0;
        assert!(off.abs() < 255.0 * 1.5 / 64.0, "pixel {i}: alpha {alpha}, {covered} of 64");
        partly += usize::from(covered % 64 > 0);
    }
    assert!(partly > 10, "{partly}");
}

#[test]
fn exr_holds_all_layers_and_their_sum() {
    let at = folder("cli-exr");
    let mut args = vec!["render", ATRIUM, "-o", "a.exr"];
    args.extend(SMALL);
    works(&at, &args);
    let plane = planes(&at.join("a.exr"));
    let (r, direct) = (plane("R"), plane("direct.R"));
    let (diffuse, glossy) = (plane("indirect.diffuse.R"), plane("indirect.glossy.R"));
    for i in 0..r.len() {
        let sum = direct[i] + diffuse[i] + glossy[i];
        assert!((r[i] - sum).abs() <= 1e-5 * sum.max(1.0), "pixel {i}: {} is not {sum}", r[i]);
    }
    for name in ["G", "B", "albedo.R", "normal.X", "normal.Y", "normal.Z", "Z"] {
        assert_eq!(plane(name).len(), 64 * 36, "{name}");
    }
    assert!(plane("Z").iter().all(|z| *z > 0.0));

    let mut args = vec!["render", ATRIUM, "-o", "n.exr", "--layer", "normal"];
    args.extend(SMALL);
    works(&at, &args);
    let mut args = vec!["render", ATRIUM, "-o", "d.png", "--layer", "indirect.diffuse"];
    args.extend(SMALL);
    works(&at, &args);
    assert_eq!(left(&at), ["a.exr", "d.png", "n.exr"]);
}

#[test]
fn two_runs_write_the_same_bytes() {
    let at = folder("cli-same");
    for name in ["a.exr", "b.exr"] {
        let mut args = vec!["render", ATRIUM, "-o", name];
        args.extend(SMALL);
        works(&at, &args);
    }
    assert!(
        fs::read(at.join("a.exr")).expect("a") == fs::read(at.join("b.exr")).expect("b"),
        "the same scene must give the same bytes"
    );
}

#[test]
fn bake_info_devices_and_assets_print_what_they_promise() {
    let at = folder("cli-others");
    let bake = works(&at, &["bake", ATRIUM, "--caches", "100"]);
    assert!(bake.contains("every surface point has a cache within"), "{bake}");
    assert!(works(&at, &["bake", ATRIUM, "--caches", "100"]).contains("read from the stored bake"));
    let info = works(&at, &["info", ATRIUM, "--caches", "100"]);
    for part in ["frame plan", " 6 gather", "atlas", "KiB", "of each cache", "directional", "spot"] {
        assert!(info.contains(part), "'{part}' is not in {info}");
    }
    assert!(works(&at, &["devices"]).contains("ok"));
    works(&at, &["assets", "made"]);
    assert_eq!(left(&at.join("made")), ["atrium.glb", "cornell_diffuse.glb", "cornell_glossy.glb"]);
    works(&at, &["assets", "moved", "--moving"]);
    assert!(["crowd.glb", "moving.glb"].iter().all(|file| at.join("moved").join(file).exists()));
    assert!(works(&at, &["info", "moved/moving.glb", "--caches", "100"]).contains("animation 0 'all' 0 to 4 s"));
    let mut args = vec!["render", "made", "-o", "a.png", "--camera", "-0.5,1.6,5;0,1.5,0;0,1,0;50", "--ev", "9"];
    args.extend(SMALL);
    works(&at, &args);
}

#[test]
fn scenes_that_move_are_rendered_moment_by_moment() {
    let at = folder("cli-moving");
    works(&at, &["assets", "made", "--moving"]);
    let render = |out: &str, more: &[&str]| {
        let mut args = vec!["render", "made/moving.glb", "-o", out, "--ev", "6"];
        args.extend(SMALL);
        args.extend(more);
        works(&at, &args)
    };
    let told = render("f_{frame:03}.png", &["--frames", "3..6", "--fps", "2"]);
    assert!(told.contains("pictures  f_003.png to f_005.png"), "{told}");
    render("all.png", &["--time", "2"]);
    let read = |name: &str| fs::read(at.join(name)).expect("a picture");
    assert!(
        read("f_004.png") == read("all.png") && read("f_003.png") != read("f_004.png"),
        "frame 4 must be the picture of second 2"
    );
    // Playback repeats.
    render("again.png", &["--time", "6"]);
    assert!(read("again.png") == read("all.png"));
    // An animation of the lamp alone gives the same pictures, whether unchanged stages are skipped or not.
    let lamp = ["--animation", "lamp", "--frames", "0..3", "--fps", "4"];
    render("s_{frame}.png", &lamp);
    render("n_{frame}.png", &[&lamp[..], &["--no-skip"]].concat());
    assert!((0..3).all(|i| read(&format!("s_{i}.png")) == read(&format!("n_{i}.png"))));
    let told = render("p.png", &["--play", "--fps", "2", "--timings", "t.csv"]);
    assert!(told.contains("8 frames") && told.contains("deform") && told.contains("update"), "{told}");
    let told = render("q.png", &["--animation", "lamp", "--frames", "0..3", "--fps", "1e6", "--play"]);
    assert!(told.contains("skipped") && told.contains("atlas 2"), "{told}");

    let fails = |args: &[&str], code: i32, parts: &[&str]| fails(&at, &[&["render"], args].concat(), code, parts);
    fails(&["made/moving.glb", "-o", "a.png", "--frames", "0..3"], 2, &["{frame:04}"]);
    fails(&["made/moving.glb", "-o", "a_{frame}.png"], 2, &["--frames A..B"]);
    fails(&["made/moving.glb", "--frames", "5..5"], 2, &["is empty"]);
    fails(&["made/moving.glb", "--time", "soon"], 2, &["seconds"]);
    fails(&["made/moving.glb", "--time", "1", "--animation", "jump"], 1, &["jump", "0 'all'"]);
    fails(&["made/moving.glb", "--animation", "lamp"], 2, &["--time, --frames or --play"]);
    fails(&["made/moving.glb", "--frames", "0..4294967295", "-o", "a_{frame}.png"], 2, &["a million"]);
    fails(&["made/moving.glb", "--frames", "0..2", "-o", "a_{frame}/b.png"], 2, &["folder"]);
    fails(&["made/moving.glb", "--play", "--gi", "path-trace"], 2, &["one moment"]);
    fails(&["made/atrium.glb", "--time", "1"], 1, &["nothing is animated"]);
    let paths = ["--gi", "path-trace", "--spp", "1", "--time", "1"];
    works(&at, &[&["render", "made/moving.glb", "-o", "paths.png", "--size", "16x16"][..], &paths].concat());
    // Without caches the frame only computes poses.
    render("b.png", &["--time", "1", "--gi", "brute-force"]);
    assert!(!left(&at).iter().any(|name| name.starts_with("a_") || name == "a.png" || name.ends_with(".part")));
}

#[test]
fn compare_measures_maps_and_fails_above_limits() {
    let at = folder("cli-compare");
    for (name, gi) in [("a.exr", "lightskin"), ("b.exr", "brute-force")] {
        // The same settings as brute force, which has no occlusion.
        let mut args = vec!["render", ATRIUM, "-o", name, "--gi", gi, "--near", "off", "--bounces", "1"];
        args.extend(SMALL);
        works(&at, &args);
    }
    let same = works(&at, &["compare", "a.exr", "a.exr", "--fail-above", "mae=0"]);
    assert!(same.contains("pixels") && same.contains("2 304"), "{same}");
    let args = ["compare", "a.exr", "b.exr", "--layer", "indirect.diffuse", "--json", "--diff", "d.png"];
    let found: serde_json::Value = serde_json::from_str(&works(&at, &args)).expect("JSON");
    let mare = found["mare"].as_f64().expect("mare");
    assert!(mare > 0.0 && mare < 2.0, "{found}");
    assert_eq!(image::open(at.join("d.png")).expect("heat map").to_rgb8().dimensions(), (64, 36));
    fails(
        &at,
        &["compare", "a.exr", "b.exr", "--layer", "indirect.diffuse", "--fail-above", "mare=1e-9"],
        1,
        &["above"],
    );
    fails(&at, &["compare", "a.exr", "b.exr", "--layer", "nonesuch"], 1, &["no layer 'nonesuch'", "albedo.R"]);
    fails(&at, &["compare", "a.exr", "c.exr"], 1, &["c.exr"]);
    fails(&at, &["compare", "a.exr", "d.png", "--fail-above", "beauty=1"], 2, &["one of mae"]);
}

#[test]
fn wrong_usage_is_exit_code_2() {
    let at = folder("cli-usage");
    fails(&at, &["render", "--size", "12"], 2, &["--size", "1280x720"]);
    fails(&at, &["render", "-o", "a.tiff"], 2, &[".png or .exr"]);
    fails(&at, &["render", "--refs", "9"], 2, &["--refs"]);
    fails(&at, &["render", "--spacing", "-1"], 2, &["above zero"]);
    fails(&at, &["render", "--spacing", "1", "--caches", "5"], 2, &["cannot be used with"]);
    fails(&at, &["render", "--angle", "200"], 2, &["degrees"]);
    fails(&at, &["lab"], 2, &["flicker", "hard-cases", "shadows", "sources"]);
    fails(&at, &["lab", "flicker", "--cluster", "4", "--cluster-error", "0.1"], 2, &["cannot be used with"]);
    fails(&at, &["lab", "sheet", ".", "--", "--seed", "3"], 2, &["--seed", "leave it out"]);
    fails(&at, &["view", "--aa", "64"], 2, &["--aa 64", "--aa 8"]);
    fails(&at, &["frobnicate"], 2, &["frobnicate"]);
    assert_eq!(left(&at), [] as [&str; 0]);
}

#[test]
fn bad_input_is_one_line_and_exit_code_1() {
    let at = folder("cli-bad");
    fs::write(at.join("empty.glb"), b"").expect("file");
    fs::write(at.join("text.gltf"), b"hello").expect("file");
    let dds = r#"{"asset":{"version":"2.0"},"extensionsRequired":["MSFT_texture_dds"],"extensionsUsed":["MSFT_texture_dds"]}"#;
    fs::write(at.join("dds.gltf"), dds).expect("file");
    fs::write(at.join("nothing.gltf"), r#"{"asset":{"version":"2.0"}}"#).expect("file");
    fs::create_dir(at.join("folder")).expect("folder");
    let before = left(&at);
    fails(&at, &["render", "missing.glb"], 1, &["missing.glb"]);
    fails(&at, &["render", "empty.glb"], 1, &["empty.glb"]);
    fails(&at, &["render", "text.gltf"], 1, &["text.gltf"]);
    fails(&at, &["render", "dds.gltf"], 1, &["dds.gltf", "MSFT_texture_dds"]);
    fails(&at, &["render", "nothing.gltf"], 1, &["nothing.gltf", "no triangles"]);
    fails(&at, &["render", "folder"], 1, &["no .gltf or .glb"]);
    fails(&at, &["info", "two\nlines.glb"], 1, &["two\u{fffd}lines.glb", "does not exist"]);
    fails(&at, &["render", ATRIUM, "--camera", "9"], 1, &["--camera 9", "'Hero'"]);
    fails(&at, &["render", ATRIUM, "--camera", "0,0,0;1,0,0;0,1,0"], 2, &["eye;target;up;fov"]);
    fails(&at, &["render", ATRIUM, "--caches", "-1"], 2, &["invalid value '-1' for '--caches <N>'"]);
    fails(&at, &["render", ATRIUM, "--sky-rotate", "nan"], 2, &["--sky-rotate", "needs a number"]);
    // Without a sky these would do nothing.
    fails(&at, &["render", ATRIUM, "--sky-rotate", "90"], 2, &["not provided", "--sky <FILE>"]);
    fails(&at, &["render", ATRIUM, "--sky-scale", "2"], 2, &["not provided", "--sky-color <R,G,B>"]);
    fails(&at, &["render", ATRIUM, "--sky", "a.hdr", "--sky-color", "1,1,1"], 2, &["cannot be used with"]);
    fails(&at, &["render", ATRIUM, "-o", "{frame:x}.png"], 2, &["{frame:04}"]);
    fails(&at, &["render", ATRIUM, "--device", "nonesuch"], 1, &["nonesuch", "matches none"]);
    fails(&at, &["render", "-o", "no/such/folder/a.png"], 1, &["no/such/folder/a.png", "does not exist"]);
    fails(&at, &["render", "-o", "folder/x/a.png"], 1, &["cannot write"]);
    fails(&at, &["render", "-o", "a.png/"], 1, &["a.png/: cannot write", "give the name of a file"]);
    fails(&at, &["lab", "sheet", "nonesuch"], 1, &["nonesuch: does not exist; check the path"]);
    fails(&at, &["compare", ATRIUM, ATRIUM], 1, &["give a .png or .exr file"]);
    fails(&at, &["bake", "--spacing", "1e-9"], 1, &["larger --spacing"]);
    assert_eq!(left(&at), before, "no files must be left behind");
}

#[test]
fn no_driver_is_one_line() {
    let at = folder("cli-no-driver");
    let out = Command::new(env!("CARGO_BIN_EXE_lightskin"))
        .args(["render", ATRIUM, "--gi", "off"])
        .current_dir(&at)
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .output()
        .expect("the tool runs");
    let message = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{message}");
    assert!(message.contains("no suitable Vulkan device") && message.contains("install a driver"), "{message}");
    assert_eq!(left(&at), [] as [&str; 0]);
}

/// At the defaults, one point in a light's view of this file has no finite position on lavapipe. It must not be a light.
#[test]
fn points_without_a_position_are_no_lights() {
    let Some(data) = crate::common::data() else { return };
    let file = data
        .canonicalize()
        .expect("the folder of test data")
        .join("scenes/features/multiuv/MultiUVTest/MultiUVTest.gltf");
    let file = file.to_str().expect("a path in UTF-8");
    works(&folder("cli-points"), &["render", file, "-o", "a.png", "--size", "96x54", "--aa", "off", "--caches", "200"]);
}

/// Renders real files: pictures without invalid values (the tool fails on one) and without validation messages.
#[test]
fn shared_scenes_render_clean() {
    let Some(data) = crate::common::data() else { return };
    let data = data.canonicalize().expect("the folder of test data");
    let at = folder("cli-scenes");
    let scenes = [
        "cornell/CornellBox.glb",
        "thesis/stanford_bunny.glb",
        "features/skin/CesiumMan.glb",
        "features/lights/KHR_lights_punctual_test.glb",
        "features/materials/AttenuationTest.glb",
        "features/normalmap/NormalTangentTest.glb",
    ];
    for scene in scenes {
        let file = data.join("scenes").join(scene);
        let file = file.to_str().expect("a path in UTF-8");
        let mut args = vec!["render", file, "-o", "a.png", "--validation", "sync", "--size", "64x36"];
        args.extend(["--caches", "100", "--rsm", "32"]);
        works(&at, &args);
        let picture = image::open(at.join("a.png")).expect("a PNG").to_luma8();
        let bright = picture.pixels().filter(|p| p.0[0] > 40).count();
        assert!(bright > 9, "{scene}: {bright} of 2304 pixels are lit");
    }
}

#[test]
fn a_path_trace_that_is_interrupted_goes_on() {
    let folder = folder("cli path trace");
    let cornell = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/cornell_diffuse.glb");
    let args = ["render", cornell, "--gi", "path-trace", "--size", "48x48", "-o", "traced.exr", "--spp"];
    let mut tool = Command::new(env!("CARGO_BIN_EXE_lightskin"));
    let started = keeping(tool.args(args).arg("1000000"), &folder)
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the tool runs");
    std::thread::sleep(std::time::Duration::from_secs(3));
    let killed = Command::new("kill").args(["-TERM", &started.id().to_string()]).status();
    assert!(killed.expect("kill runs").success());
    let out = started.wait_with_output().expect("the tool ends");
    let message = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{message}");
    let samples = message.split("stopped at ").nth(1).and_then(|rest| rest.split(' ').next());
    let samples: u32 = samples.and_then(|n| n.parse().ok()).unwrap_or_else(|| panic!("no count in: {message}"));
    assert!(samples >= 16 && message.contains("continues from there"), "{message}");
    assert_eq!(left(&folder), [""; 0]);

    // All earlier samples were kept, and a few more are added.
    let more = (samples + 32).to_string();
    let said = works(&folder, &[&args[..], &[&more]].concat());
    assert!(said.contains(&format!("({samples} were stored, 32 made")), "{said}");
    assert_eq!(left(&folder), ["traced.exr"]);
    let said = works(&folder, &[&args[..], &[&more, "--layer", "indirect"]].concat());
    assert!(said.contains("0 made"), "{said}");
    fails(&folder, &[&args[..], &["16", "--no-visibility", "--bounces", "2"]].concat(), 2, &["--no-visibility"]);
    fails(&folder, &[&args[..], &["16", "--no-visibility", "--match", "engine"]].concat(), 2, &["--no-visibility"]);
}

#[test]
fn a_path_trace_is_of_all_light_unless_told_otherwise() {
    let folder = folder("cli path light");
    let cornell = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/cornell_glossy.glb");
    let mean = |flags: &[&str]| {
        let args = ["render", cornell, "--gi", "path-trace", "--size", "32x32", "-o", "a.exr", "--spp", "64"];
        works(&folder, &[&args[..], flags].concat());
        let picture = lightskin::image::read_picture(&folder.join("a.exr"), None).expect("read");
        picture.rgb.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / (3 * picture.rgb.len()) as f64
    };
    let [all, matched, one] = [&[][..], &["--match", "engine"], &["--match", "engine", "--bounces", "1"]].map(mean);
    println!("mean {all} with all light, {matched} with the engine's paths");
    // By default the engine traces several bounces with the full energy of glossy lobes, but not their directions.
    assert!(one < 0.9 * all && one < 0.95 * matched && (matched / all - 1.0).abs() < 0.05, "{all}, {matched}, {one}");
    assert!(mean(&["--bounces", "1"]) < all);
}

#[test]
fn the_fastest_gather_is_measured_once_and_kept() {
    let at = folder("cli-gather");
    fs::create_dir_all(at.join("cache/lightskin")).expect("a cache without the measurement");
    let mut args = vec!["render", ATRIUM, "-o", "a.exr", "--bounces", "1"];
    args.extend(SMALL);
    let measured = || -> Vec<PathBuf> {
        let files = fs::read_dir(at.join("cache/lightskin")).expect("kept").map(|f| f.expect("file").path());
        let of_gather = |f: &PathBuf| f.file_name().is_some_and(|name| name.to_string_lossy().starts_with("gather-"));
        files.filter(of_gather).collect()
    };
    let kept = || {
        let all = measured();
        assert_eq!(all.len(), 1, "{all:?}");
        (fs::read_to_string(&all[0]).expect("text"), all[0].clone())
    };
    let mut direct = args.clone();
    direct.extend(["--gi", "off"]);
    works(&at, &direct);
    assert!(measured().is_empty(), "direct light alone must not need a measurement");
    works(&at, &[&args[..], &["--gather", "fragment"]].concat());
    assert!(measured().is_empty(), "a gather by draws must not need a measurement");
    works(&at, &args);
    let (first, file) = kept();
    assert!(first.contains("\"vals\": \"texels\"") && first.contains("\"vals\": \"storage\""), "{first}");
    for way in ["fragment", "compute"] {
        let out = format!("{way}.exr");
        let mut args =
            vec!["render", ATRIUM, "-o", &out, "--gather", way, "--shadows", "off", "--near", "off", "--bounces", "1"];
        args.extend(SMALL);
        works(&at, &args);
        assert_eq!(kept().0, first, "nothing must be measured again");
    }
    // With draws, the default shadows are the ones that draws support.
    works(&at, &[&["render", ATRIUM, "-o", "a.png", "--gather", "fragment"][..], &SMALL[..]].concat());
    let mut compare = vec!["compare", "fragment.exr", "compute.exr", "--fail-above", "mare=1e-5"];
    compare.extend(["--layer", "indirect.diffuse"]);
    works(&at, &compare);
    fs::write(&file, "half a fi").expect("damaged");
    works(&at, &args);
    assert!(kept().0.contains("pairs_per_second"), "a damaged file must cause a new measurement");
}

#[test]
fn bounces_and_skies_that_cannot_be_are_refused() {
    let folder = folder("bounces");
    fails(&folder, &["render", "--bounces", "2", "--gather", "fragment"], 2, &["--bounces above 1"]);
    fails(&folder, &["render", "--bounces", "2", "--cluster", "8"], 2, &["--cluster"]);
    fails(&folder, &["render", "--bounces", "17"], 2, &["16"]);
    fails(&folder, &["render", "--bounces", "2", "--gi", "brute-force"], 2, &["one bounce"]);
    fails(&folder, &["render", "--sky-color", "1,-2,3"], 2, &["three numbers"]);
    fails(&folder, &["render", "--sky", "no.hdr"], 1, &["no.hdr"]);
    assert!(left(&folder).is_empty());
}

#[test]
fn lamps_are_as_large_as_the_flags_say() {
    let at = folder("cli-sizes");
    let picture = |flags: &[&str]| {
        let args = ["render", ATRIUM, "-o", "a.png", "--size", "64x36", "--gi", "off", "--ev", "0"];
        works(&at, &[&args[..], flags].concat());
        fs::read(at.join("a.png")).expect("a picture")
    };
    let sharp = picture(&[]);
    assert!(picture(&["--light-radius", "0.3"]) != sharp && picture(&["--sun-angle", "8"]) != sharp);
    assert!(picture(&["--light-radius", "0", "--sun-angle", "0"]) == sharp);
    fails(&at, &["render", ATRIUM, "--sun-angle=-1"], 2, &["--sun-angle"]);
}
