//! Tools of the window besides the picture, driven by real key and button events: comparing pictures, inspecting a
//! pixel, sessions, videos, materials.

use crate::cli::{folder, works};
use crate::common::window::{App, Display, SMALL, cornell, png};
use crate::common::{Builder, glb};
use lightskin::image::read_picture;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::time::Duration;

/// All numbers in a line of text.
fn numbers(text: &str) -> Vec<f64> {
    text.split(|c: char| !(c.is_ascii_digit() || ".-+e".contains(c))).filter_map(|word| word.parse().ok()).collect()
}

/// Asserts that the window's FLIP, relMSE and bias equal those of `lightskin compare`.
fn assert_errors(line: &str, folder: &Path, image: &str, reference: &str) {
    let told = works(folder, &["compare", image, reference, "--json"]);
    let wanted: Value = serde_json::from_str(&told).expect("JSON");
    let found = numbers(line);
    for (i, name) in ["flip", "relmse", "bias"].into_iter().enumerate() {
        let wanted = wanted[name].as_f64().expect(name);
        assert!((found[i] - wanted).abs() < 1e-6 + 1e-5 * wanted.abs(), "{name} is {wanted}: {line}");
    }
}

/// A picture from a file is shown bit for bit next to lightskin's own with the wipe, and its errors equal those of
/// `compare`.
#[test]
fn a_file_is_compared() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_against");
    let (scene, size) = (cornell(), [64, 48]);
    let scene = scene.to_str().expect("a path");
    works(&folder, &["render", scene, "-o", "other.png", "--size", "64x48", "--ev", "6", "--gi", "off"]);
    let (_, other) = png(&folder.join("other.png"));
    let words = ["view", scene, "--size", "64x48", "--ev", "5", "--no-panels", "--against", "other.png"];
    let mut app = App::start(&display, &folder, &[&words[..], &SMALL].concat());
    let errors = app.line("errors");
    let name = app.picture();
    let own = png(&folder.join(&name)).1;
    assert_errors(&errors, &folder, &name, "other.png");
    app.shows(size, &other, "the file");
    // The wipe's line is at the left edge at first.
    app.slide([3, 20], 29, "");
    let wanted: Vec<_> = (0..own.len()).map(|i| if i % 64 < 32 { own[i] } else { other[i] }).collect();
    app.shows_at(size, &wanted, |i| (i % 64).abs_diff(32) > 2, "the wipe");
    app.press("Space");
    app.command();
    app.shows(size, &own, "without the reference");
    app.quit();
}

/// Compares any two pictures: a file on the left, brute force on the right. The brute-force picture is computed in
/// blocks and equals `render`'s.
#[test]
fn a_file_is_held_against_brute_force() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_both");
    let scene = cornell();
    let scene = scene.to_str().expect("a path");
    let same = ["--size", "64x1000", "--quality", "low", "--caches", "150", "--rsm", "32"];
    for (gi, file) in [("off", "left.exr"), ("brute-force", "right.exr")] {
        works(&folder, &[&["render", scene, "-o", file, "--gi", gi], &same[..]].concat());
    }
    let words = ["-vv", "view", scene, "--ev", "4", "--validation", "sync"];
    let mut app = App::start(&display, &folder, &[&words[..], &same].concat());
    app.line("scene");
    app.resize(384, 1000);
    app.press("Space");
    std::thread::sleep(Duration::from_millis(300));
    app.settle("");
    app.choose([64 + 135, 825], 4, "");
    assert!(app.line("errors").contains("brute force"));
    app.choose([64 + 135, 799], 5, "");
    app.drop_file(&folder.join("left.exr"));
    let errors = app.line("errors");
    assert!(errors.contains("left.exr | brute force"), "{errors}");
    assert_errors(&errors, &folder, "left.exr", "right.exr");
    // The left picture ends at the wipe.
    app.slide([64 + 120, 851], 60, "");
    let seen = app.pixels([0, 0], [64, 1000]);
    let files = ["left", "right"].map(|file| {
        let shown = format!("{file}.png");
        let gi = if file == "left" { "off" } else { "brute-force" };
        works(&folder, &[&["render", scene, "-o", &shown, "--gi", gi, "--ev", "4"], &same[..]].concat());
        png(&folder.join(shown)).1
    });
    for (column, file) in [(2, 0), (61, 1)] {
        // A different shader evaluates the tone curve, so one step of rounding is allowed.
        let far = |row: &usize| {
            let [a, b] = [&seen, &files[file]].map(|pixels: &Vec<[u8; 3]>| pixels[row * 64 + column]);
            (0..3).any(|c| a[c].abs_diff(b[c]) > 1)
        };
        assert_eq!((100..700).filter(far).count(), 0, "pixels of column {column} differ from picture {file}");
    }
    app.quit();
}

/// Brute force begins again when a setting needs another upload of the scene.
#[test]
fn brute_force_follows_another_upload() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_upload");
    let scene = cornell();
    let words = ["view", scene.to_str().expect("a path"), "--size", "64x1000"];
    let mut app = App::start(&display, &folder, &[&words[..], &SMALL].concat());
    app.line("scene");
    app.resize(384, 1000);
    // Buttons lie where the previous frame put them, so wait for one frame.
    app.command();
    app.choose([64 + 135, 298], 2, "--rsm 64");
    app.press("Space");
    std::thread::sleep(Duration::from_millis(300));
    app.settle("");
    app.choose([64 + 135, 799], 4, "");
    // It begins when there was no input for a while, and takes seconds.
    std::thread::sleep(Duration::from_millis(700));
    app.choose([64 + 135, 272], 2, "--near rays");
    assert!(app.line("errors").contains("brute force"));
    app.quit();
}

/// The path tracer's samples equal those of `render --gi path-trace`. Another view gets another reference. Ctrl+click
/// prints the values of the layers at a pixel, its lights and its caches.
#[test]
fn the_view_is_path_traced() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_traced");
    let scene = cornell();
    let scene = scene.to_str().expect("a path");
    let words = ["view", scene, "--size", "48x36", "--no-panels", "--reference-spp", "32"];
    let mut app = App::start(&display, &folder, &[&words[..], &SMALL].concat());
    app.line("scene");
    app.frame();
    app.hold("Control", true);
    app.click(1, [10, 16]);
    app.hold("Control", false);
    let told = app.line("pixel");
    let part = |name: &str| numbers(told.split(name).nth(1).unwrap_or_else(|| panic!("no {name} in {told}")));
    let (direct, spot) = (part("; direct "), part("; light 1 spot "));
    assert!(direct[0] > 1.0 && (0..3).all(|c| (direct[c] - spot[c]).abs() <= 1e-3 * direct[0]), "{told}");

    app.press("Space");
    let errors = app.line("errors");
    assert!(errors.contains("32 samples"), "{errors}");
    let traced = ["--gi", "path-trace", "--spp", "32", "--size", "48x36", "--quality", "medium"];
    works(&folder, &[&["render", scene, "-o", "traced.exr"], &traced[..]].concat());
    app.hold("Shift", true);
    app.press("F12");
    app.hold("Shift", false);
    let name = app.line("picture").split_whitespace().last().expect("a name").to_owned();
    assert_errors(&errors, &folder, &name, "traced.exr");

    app.hold("Control", true);
    app.click(1, [30, 25]);
    app.hold("Control", false);
    let told = app.line("pixel");
    let part = |name: &str| numbers(told.split(name).nth(1).unwrap_or_else(|| panic!("no {name} in {told}")));
    for (layer, said) in
        [("direct", "direct "), ("indirect.diffuse", "indirect, diffuse "), ("indirect.glossy", "indirect, glossy ")]
    {
        let picture = read_picture(&folder.join(&name), Some(layer)).expect("a layer");
        let (found, wanted) = (part(said), picture.rgb[25 * 48 + 30]);
        let far = (0..3).map(|c| (found[c] - f64::from(wanted[c])).abs()).fold(0.0, f64::max);
        assert!(far <= 5.1e-5, "{layer}: {wanted:?} in {told}");
    }
    assert!(told.contains("object 2 short block") && told.contains("material "), "{told}");
    let weights: f64 = told.split("; cache ").skip(1).map(|cache| numbers(cache)[1]).sum();
    assert!((weights - 100.0).abs() < 1.0, "weights of {weights} % in {told}");
    assert!(!told.contains("; light "), "the spot does not reach the short block: {told}");
    app.drag(1, [20, 20], [30, 18]);
    let turned = app.line("errors");
    assert_ne!(turned, errors, "the errors must change with the view");
    app.quit();
}

/// A scene whose file changes is loaded again, and the view stays. A session restores view, light, materials and
/// settings, both in the same window and in a new one.
#[test]
fn files_and_sessions_come_back() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_session");
    let scene = folder.join("box.glb");
    fs::copy(cornell(), &scene).expect("a scene");
    let words = ["view", "box.glb", "--size", "64x48", "--ev", "6", "--no-panels", "--watch"];
    let mut app = App::start(&display, &folder, &[&words[..], &SMALL].concat());
    app.line("scene");
    app.drag(1, [40, 20], [48, 22]);
    app.press_with("Control", "2");
    let turned = app.command();
    let glossy = png(&folder.join(app.picture())).1;
    fs::copy(cornell().with_file_name("cornell_diffuse.glb"), &scene).expect("another scene");
    app.line("scene");
    assert_eq!(app.command(), turned, "the view must stay");
    // A diffuse scene lights all of its caches, so another view does not change the light.
    app.press("1");
    app.command();
    app.press("2");
    app.command();
    let diffuse = png(&folder.join(app.picture())).1;
    assert!(diffuse != glossy, "the picture must change with the scene");

    app.press_with("Control", "S");
    let file = folder.join(app.line("session").split_whitespace().last().expect("a name"));
    let read = || -> Value { serde_json::from_slice(&fs::read(&file).expect("a session")).expect("JSON") };
    let mut session = read();
    session["lights"][0]["intensity"] = json!(200.0);
    session["materials"] = json!({ "white": { "base_color": [0.1, 0.2, 0.9, 1.0], "emissive": [0.0, 0.0, 0.0] } });
    session["hidden"] = json!(["short block"]);
    session["settings"]
        .as_array_mut()
        .expect("flags")
        .extend(["--bounces", "1", "--shadow-map", "rays"].map(Value::from));
    session["bookmarks"][0] = json!("0,1,3;0,1,0;0,1,0;50");
    fs::write(&file, session.to_string()).expect("a session");
    app.drop_file(&file);
    app.line("scene");
    let command = app.command();
    let [bounces, rays] = [" --bounces 1", " --shadow-map rays"];
    let shorter = command.replace(bounces, "").replace(rays, "").replace(&format!("{}/", folder.display()), "");
    assert_eq!(shorter, turned);
    assert!(command.contains(bounces) && command.contains(rays), "{command}");
    let mut changed = png(&folder.join(app.picture())).1;
    assert!(changed != diffuse, "the picture must change with light and material");
    session["lights"][0]["radius"] = json!(0.25);
    fs::write(&file, session.to_string()).expect("a session");
    app.drop_file(&file);
    app.line("scene");
    app.command();
    let hard = std::mem::replace(&mut changed, png(&folder.join(app.picture())).1);
    assert!(changed != hard, "shadows must become softer with the light's size");
    app.press("1");
    assert!(app.command().contains("0,1,3;0,1,0;0,1,0;50"), "the session's camera must return");
    app.press("2");
    app.press_with("Control", "S");
    app.line("session");
    let again = read();
    for part in ["hidden", "camera", "bookmarks", "exposure", "settings"] {
        assert_eq!(again[part], session[part], "{part}");
    }
    for part in ["intensity", "radius"] {
        assert_eq!(again["lights"][0][part], session["lights"][0][part], "{part}");
    }
    let color = &again["materials"]["white"]["base_color"];
    assert!((color[2].as_f64().expect("blue") - 0.9).abs() < 1e-6, "{color}");
    // A file that is no valid session leaves the shown scene in place.
    let broken = folder.join("broken.json");
    fs::write(&broken, "{\"lightskin_session\": 1, \"arguments\": [\"--quality\", \"best\"]}").expect("a file");
    app.drop_file(&broken);
    assert_eq!(png(&folder.join(app.picture())).1, changed);
    app.quit_after(&["broken.json: arguments: "]);

    let name = file.to_str().expect("a path");
    let words = ["view", name, "--size", "64x48", "--no-panels", "--validation", "sync"];
    let mut app = App::start(&display, &folder, &words);
    app.line("scene");
    app.command();
    assert_eq!(png(&folder.join(app.picture())).1, changed, "in a new window");
    app.quit();
}

/// Shift+P writes the same frames as `render --frames`. Afterwards the scene is at rest again.
#[test]
fn a_video_is_renders_frames() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_video");
    let mut file = Builder::triangle();
    let times = file.floats("SCALAR", &[0.0, 0.09]);
    (file.json["accessors"][times]["min"], file.json["accessors"][times]["max"]) = (json!([0.0]), json!([0.09]));
    let places = file.floats("VEC3", &[0.0, 0.0, 0.0, 0.4, 0.3, 0.0]);
    file.json["animations"] = json!([{
        "samplers": [{"input": times, "output": places}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
    }]);
    fs::write(folder.join("moves.glb"), glb(&file.json, &file.binary)).expect("a scene");
    let same = ["--size", "64x48", "--ev", "4", "--caches", "150", "--quality", "low", "--validation", "sync"];
    let mut app = App::start(&display, &folder, &[&["view", "moves.glb", "--no-panels"], &same[..]].concat());
    app.line("scene");
    let rests = png(&folder.join(app.picture())).1;
    app.hold("Shift", true);
    app.press("P");
    app.hold("Shift", false);
    let told = app.line("video");
    assert!(told.ends_with("moves-video-1: 3 pictures"), "{told}");
    works(&folder, &[&["render", "moves.glb", "-o", "{frame:05}.png", "--frames", "0..3"], &same[..]].concat());
    let frame = |from: &str, n: u32| png(&folder.join(from).join(format!("{n:05}.png"))).1;
    for n in 0..3 {
        assert!(frame("moves-video-1", n) == frame(".", n), "frame {n}");
    }
    assert!(frame(".", 0) != frame(".", 2), "the animation must move something");
    assert_eq!(png(&folder.join(app.picture())).1, rests);
    app.quit();
}

/// A window with the Cornell box and an open panel of materials.
fn with_materials(display: &Display, folder: &Path) -> App {
    let scene = cornell();
    let words = ["view", scene.to_str().expect("a path"), "--size", "64x48", "--ev", "4"];
    let mut app = App::start(display, folder, &[&words[..], &SMALL].concat());
    app.line("scene");
    app.resize(384, 1000);
    // Buttons lie where the previous frame put them, so wait for one frame.
    app.command();
    app.tap([64 + 60, 796], "");
    std::thread::sleep(Duration::from_millis(300));
    app.settle("");
    app
}

/// Editing a material in the panel changes the picture at once, and the session stores the change.
#[test]
fn materials_change_live() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_materials");
    let mut app = with_materials(&display, &folder);
    let before = png(&folder.join(app.picture())).1;
    app.slide([64 + 180, 953], 40, "");
    assert!(png(&folder.join(app.picture())).1 != before, "the emissive surface must change the picture");
    app.press_with("Control", "S");
    let file = folder.join(app.line("session").split_whitespace().last().expect("a name"));
    let session: Value = serde_json::from_slice(&fs::read(file).expect("a session")).expect("JSON");
    let emissive = session["materials"]["white"]["emissive"].as_array().expect("a colour");
    assert!(emissive.iter().all(|v| v.as_f64().is_some_and(|v| v > 0.1)), "{session}");
    app.quit();
}

/// A medium below a surface is chosen, changed, undone, stored and taken out again. `render` draws the session as the
/// window shows it.
#[test]
fn bodies_are_filled() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_media");
    let mut app = with_materials(&display, &folder);
    let picture = |app: &mut App| png(&folder.join(app.picture())).1;
    let file = std::cell::RefCell::new(std::path::PathBuf::new());
    let saved = |app: &mut App| -> Value {
        app.press_with("Control", "S");
        *file.borrow_mut() = folder.join(app.line("session").split_whitespace().last().expect("a name"));
        let session = fs::read(&*file.borrow()).expect("a session");
        let session: Value = serde_json::from_slice(&session).expect("JSON");
        session["materials"]["white"].clone()
    };
    let hollow = picture(&mut app);
    let [x, below] = [64 + 180, 979];
    // The list opens upwards. Its first entry is "off".
    let choose = |app: &mut App, entry: i16| {
        app.tap([x, below], "");
        app.tap([x, below - 393 + 25 * entry], "");
    };
    choose(&mut app, 7);
    let marble = picture(&mut app);
    assert!(marble != hollow, "light must enter the surfaces");
    let white = saved(&mut app);
    assert_eq!(white["subsurface"]["sigma_s"][0], 2190.0, "{white}");
    assert_eq!(white["subsurface"]["scale"], 1.0);
    app.press_with("Control", "Z");
    app.settle("");
    assert!(picture(&mut app) == hollow, "undone");
    assert!(saved(&mut app)["subsurface"].is_null());
    app.hold("Shift", true);
    app.press_with("Control", "Z");
    app.hold("Shift", false);
    app.settle("");
    assert!(picture(&mut app) == marble, "redone");

    // Edits during the uploads of others. Below a preset the list lacks "own colour", so "off" is one entry further down.
    for entry in [3, 7, 1, 7] {
        choose(&mut app, entry);
    }
    assert!(picture(&mut app) == marble, "the last of several edits");
    app.press_with("Control", "Z");
    assert!(picture(&mut app) == hollow, "undone during or after an upload");
    app.hold("Shift", true);
    app.press_with("Control", "Z");
    app.hold("Shift", false);
    assert!(picture(&mut app) == marble, "redone");

    // Rows below: colour, mean free path, scale.
    app.resize(384, 1100);
    app.command();
    app.slide([64 + 130, below + 52], 40, "");
    let white = saved(&mut app);
    let inside = &white["subsurface"];
    let [scattered, absorbed] = ["sigma_s", "sigma_a"].map(|name| inside[name][0].as_f64().expect("a number"));
    let path = 1e3 / (scattered + absorbed);
    assert!(path > 0.46, "the mean free path must grow from 0.456 mm: {path}");
    let other = inside["sigma_s"][1].as_f64().expect("a number") + inside["sigma_a"][1].as_f64().expect("a number");
    assert!((other / 2624.1 - 1.0).abs() < 1e-4, "that of green stays: {other}");
    app.slide([64 + 130, below + 78], 60, "");
    let white = saved(&mut app);
    assert!(white["subsurface"]["scale"].as_f64().is_some_and(|scale| scale > 1.1), "{white}");
    let shown = picture(&mut app);
    assert!(shown != marble, "longer paths must change the picture");
    let session = file.borrow().clone();
    let name = session.to_str().expect("a path");
    works(&folder, &["render", name, "--size", "64x1100", "-o", "of_session.png"]);
    assert!(png(&folder.join("of_session.png")).1 == shown, "the session's picture differs from the window's");
    app.drop_file(&session);
    app.line("scene");
    app.settle("");
    assert!(picture(&mut app) == shown, "the session again");
    // Without the medium the file's colour returns.
    choose(&mut app, 0);
    assert!(saved(&mut app)["subsurface"].is_null());
    app.resize(384, 1000);
    app.command();
    assert!(picture(&mut app) == hollow, "empty again");
    app.quit();
}

/// With `--dev` the window draws by shaders that change while it runs. Shaders that do not compile, or that the
/// device refuses, leave the picture as it is.
#[cfg(feature = "glsl")]
#[test]
fn shaders_change_while_the_window_runs() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_shaders");
    let glsl = folder.join("glsl");
    fs::create_dir_all(glsl.join("lib")).expect("a folder");
    for part in ["", "lib"] {
        for entry in fs::read_dir(Path::new("glsl").join(part)).expect("shaders") {
            let path = entry.expect("a file").path();
            let to = glsl.join(part).join(path.file_name().expect("a name"));
            if path.is_file() {
                fs::copy(path, to).expect("a copy");
            }
        }
    }
    let file = cornell();
    let dev = format!("--dev={}", glsl.display());
    let words = ["view", file.to_str().expect("a path"), "--size", "64x48", "--no-panels", &dev];
    let mut app = App::start(&display, &folder, &[&words[..], &SMALL].concat());
    app.line("scene");
    app.command();
    let before = png(&folder.join(app.picture())).1;
    let shader = glsl.join("lib/tonemap.glsl");
    let text = fs::read_to_string(&shader).expect("a shader");
    let wanted = |app: &mut App, what: &str, part: &str| {
        let start = std::time::Instant::now();
        while app.told(part).is_empty() {
            assert!(start.elapsed() < crate::common::window::PATIENCE, "{what}");
            std::thread::sleep(Duration::from_millis(50));
        }
        app.command();
        png(&folder.join(app.picture())).1
    };
    fs::write(&shader, text.replace("return ", "return 0.5 * ")).expect("a shader");
    let darker = wanted(&mut app, "it must be compiled", "compiled composite.frag");
    let sum = |pixels: &[[u8; 3]]| pixels.iter().flatten().map(|v| u64::from(*v)).sum::<u64>();
    assert!(sum(&darker) < sum(&before) * 9 / 10, "{} of {}", sum(&darker), sum(&before));
    fs::write(&shader, text.replace("return ", "return nothing * ")).expect("a shader");
    assert!(wanted(&mut app, "an error must be told", "'nothing' : undeclared identifier") == darker);
    // The host would not fill another binding.
    fs::write(&shader, &text).expect("a shader");
    let composite = glsl.join("composite.frag");
    let own = fs::read_to_string(&composite).expect("a shader");
    let reads = "layout(binding = 19) uniform sampler2D extra;\n\nvoid main() {\n    if (textureLod(extra, vec2(0.5), 0.0).r > 1e30) discard;\n";
    fs::write(&composite, own.replace("void main() {", reads)).expect("a shader");
    assert!(wanted(&mut app, "a binding must be refused", "has other bindings") == darker);
    // No device runs groups as large as these.
    fs::write(&composite, &own).expect("a shader");
    let expose = glsl.join("expose.comp");
    let own = fs::read_to_string(&expose).expect("a shader");
    let large = own.replace("local_size_x = 256", "local_size_x = 1024, local_size_y = 1024");
    assert_ne!(large, own);
    fs::write(&expose, large).expect("a shader");
    assert!(wanted(&mut app, "large groups must be refused", "the device refuses it: ") == darker);
    fs::write(&expose, &own).expect("a shader");
    std::thread::sleep(Duration::from_millis(200));
    let start = std::time::Instant::now();
    while png(&folder.join(app.picture())).1 != before {
        assert!(start.elapsed() < crate::common::window::PATIENCE, "the first picture must return");
    }
    app.quit_after(&["composite.frag: ", "has other bindings", "groups of [1024, 1024, 1] threads"]);
}
