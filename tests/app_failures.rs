//! The window when the device fails, and its settings for size, frame rate and motion. Driven by real key and button
//! events. Variables ask the program for failures that no driver produces on request.

use crate::cli::{folder, works};
use crate::common::window::{App, Display, PATIENCE, SMALL, cornell, png, words as shell_words};
use crate::common::{Builder, glb};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Takes a picture with F12, removes its file, and returns the pixels.
fn picture(app: &mut App, folder: &Path) -> Vec<[u8; 3]> {
    let path = folder.join(app.picture());
    let pixels = png(&path).1;
    fs::remove_file(path).expect("a picture");
    pixels
}

/// After the loss of the device, whichever call reports it, the window shows the same picture and the same panels on a
/// new device, with the edits of light, view and settings. Neither device gets validation messages.
#[test]
fn a_lost_device_is_replaced() {
    let scene = cornell();
    let scene = scene.to_str().expect("a path");
    for call in ["submit", "wait", "copy", "acquire", "present"] {
        let Some(display) = Display::open() else { return };
        let folder = folder("app_lost");
        let words = ["view", scene, "--size", "64x48", "--reduced-motion"];
        let lose = format!("90:{call}");
        let variables = [("LIGHTSKIN_LOSE_DEVICE", lose.as_str())];
        let light = ["--caches", "60", "--quality", "low", "--validation", "sync"];
        let mut app = App::start_with(&display, &folder, &variables, &[&words[..], &light].concat());
        app.line("scene");
        app.resize(384, 1000);
        let first = picture(&mut app, &folder);
        app.drag(1, [20, 20], [40, 30]);
        app.choose([64 + 135, 298], 1, "--rsm 32");
        // The light is switched off, so that it would return with another scene.
        app.tap([64 + 16, 439], "");
        app.move_to([20, 300]);
        let (command, lit) = (app.command(), picture(&mut app, &folder));
        assert!(first != lit, "the edits must change the picture");
        // Names and values of the settings.
        let panels = |app: &App| app.pixels([64, 130], [320, 280]);
        let before = panels(&app);
        assert!(app.told("lost").is_empty(), "{call}: the device was lost before the edits were made");
        let start = Instant::now();
        while app.told("lost").is_empty() {
            assert!(picture(&mut app, &folder) == lit, "{call}: the picture that finds the loss");
            assert!(start.elapsed() < PATIENCE, "{call}: the device is not lost");
        }
        assert!(picture(&mut app, &folder) == lit, "{call}: the picture differs on the new device");
        assert_eq!(app.command(), command, "{call}");
        assert!(panels(&app) == before, "{call}: the panels differ on the new device");
        let told = app.told("lost");
        assert!(told.len() == 1 && told[0].contains("continues on a new one"), "{call}: {told:?}");
        // The light comes back with its intensity.
        app.tap([64 + 16, 439], "");
        assert!(picture(&mut app, &folder) != lit, "{call}: nothing can be edited on the new device");
        app.quit();
    }
}

/// A window whose surface is lost, as while it is drawn or asked for its size, goes on with another surface.
#[test]
fn a_lost_surface_is_replaced() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_surface");
    let scene = cornell();
    let words = ["view", scene.to_str().expect("a path"), "--size", "64x48", "--no-panels"];
    let variables = [("LIGHTSKIN_LOSE_DEVICE", "5:surface,10:query")];
    let mut app = App::start_with(&display, &folder, &variables, &[&words[..], &SMALL].concat());
    app.line("scene");
    for turn in 0..8 {
        app.drag(1, [20, 20], [24 + turn, 20]);
        app.command();
    }
    for (width, height) in [(80, 60), (96, 72)] {
        app.resize(width, height);
        app.move_to([20, 20]);
        app.command();
        let file = folder.join(app.picture());
        let (size, picture) = png(&file);
        assert_eq!([u32::from(size[0]), u32::from(size[1])], [width, height]);
        app.shows(size, &picture, "a window with another surface");
        fs::remove_file(file).expect("a picture");
    }
    assert_eq!(app.told("the window's surface was lost").len(), 2);
    app.quit();
}

/// A second loss within a minute ends the run.
#[test]
fn a_device_that_is_lost_again_ends_the_run() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_lost_twice");
    let scene = cornell();
    let words = ["view", scene.to_str().expect("a path"), "--size", "64x48", "--no-panels"];
    let variables = [("LIGHTSKIN_LOSE_DEVICE", "5:submit,9:present")];
    let mut app = App::start_with(&display, &folder, &variables, &[&words[..], &SMALL].concat());
    wait_for_end(&mut app);
    assert_eq!(app.told("continues on a new one").len(), 1);
    let told = app.failure();
    assert!(told.contains("lost twice within a minute, now at: showing a picture; update the driver"), "{told}");
}

/// Moves the pointer, which draws frames, until the program ends.
fn wait_for_end(app: &mut App) {
    let start = Instant::now();
    while !app.has_ended() {
        app.move_to([20 + start.elapsed().as_millis() as i16 % 9, 20]);
        std::thread::sleep(Duration::from_millis(20));
        assert!(start.elapsed() < PATIENCE, "the program does not end");
    }
}

/// If no device can take over, the run ends with the reason. Here the driver has gone.
#[test]
fn a_loss_without_another_device_ends_the_run() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_lost_driver");
    let all = std::env::var("VK_DRIVER_FILES").unwrap_or_else(|_| "/usr/share/vulkan/icd.d/lvp_icd.x86_64.json".into());
    let Some(driver) = all.split(':').map(PathBuf::from).find(|file| file.exists()) else {
        println!("skipped: no driver file here; VK_DRIVER_FILES names one");
        return;
    };
    let own = folder.join("driver.json");
    fs::copy(driver, &own).expect("a driver");
    let scene = cornell();
    let words = ["view", scene.to_str().expect("a path"), "--size", "64x48", "--no-panels"];
    let files = own.to_str().expect("a path");
    let variables = [("LIGHTSKIN_LOSE_DEVICE", "5:submit"), ("VK_DRIVER_FILES", files), ("VK_ICD_FILENAMES", files)];
    let mut app = App::start_with(&display, &folder, &variables, &[&words[..], &SMALL].concat());
    app.line("scene");
    fs::remove_file(&own).expect("a driver");
    wait_for_end(&mut app);
    let told = app.failure();
    assert!(told.contains("the device was lost, and no other takes over: "), "{told}");
}

/// Writes a scene with a triangle that moves for this long [s].
fn moving(folder: &Path, seconds: f32) {
    let mut file = Builder::triangle();
    let times = file.floats("SCALAR", &[0.0, seconds]);
    (file.json["accessors"][times]["min"], file.json["accessors"][times]["max"]) = (json!([0.0]), json!([seconds]));
    let places = file.floats("VEC3", &[0.0, 0.0, 0.0, 0.4, 0.3, 0.0]);
    file.json["animations"] = json!([{
        "samplers": [{"input": times, "output": places}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
    }]);
    fs::write(folder.join("moves.glb"), glb(&file.json, &file.binary)).expect("a scene");
}

/// An animation plays on after a loss, and the scene has the pose of its time.
#[test]
fn an_animation_outlives_a_loss() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_lost_moving");
    moving(&folder, 50.0);
    let words = ["view", "moves.glb", "--size", "64x48", "--no-panels", "--ev", "4"];
    let variables = [("LIGHTSKIN_LOSE_DEVICE", "40:wait")];
    let mut app = App::start_with(&display, &folder, &variables, &[&words[..], &SMALL].concat());
    app.line("scene");
    let rests = picture(&mut app, &folder);
    app.press("P");
    app.tells("continues on a new one");
    let before = app.command();
    std::thread::sleep(Duration::from_millis(300));
    app.press("P");
    let command = app.command();
    assert!(command.contains("--time") && command != before, "the animation stands still: {command}");
    let poses = picture(&mut app, &folder);
    works(&folder, &shell_words(&command)[1..].iter().map(String::as_str).collect::<Vec<_>>());
    assert!(png(&folder.join("picture.png")).1 == poses, "not the picture of {command}");
    assert!(poses != rests, "nothing has moved");
    app.quit();
}

/// A scene whose upload finds the device lost is loaded again. A file in the comparison is shown again.
#[test]
fn what_is_opened_outlives_a_loss() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_lost_loading");
    let (scene, size) = (cornell(), [64, 48]);
    let scene = scene.to_str().expect("a path");
    works(&folder, &["render", scene, "-o", "other.png", "--size", "64x48", "--ev", "6", "--gi", "off"]);
    let (_, other) = png(&folder.join("other.png"));
    let words = ["view", scene, "--size", "64x48", "--no-panels", "--against", "other.png"];
    let variables = [("LIGHTSKIN_LOSE_DEVICE", "100:copy")];
    let mut app = App::start_with(&display, &folder, &variables, &[&words[..], &SMALL].concat());
    let errors = app.line("errors");
    app.shows(size, &other, "the file");
    // More than enough frames, none of which copies anything.
    for turn in 0..400 {
        app.move_to([20 + turn % 9, 20]);
        std::thread::sleep(Duration::from_millis(5));
    }
    app.command();
    assert!(app.told("lost").is_empty());
    app.drop_file(&cornell().with_file_name("cornell_diffuse.glb"));
    assert!(app.line("scene").contains("cornell_diffuse"));
    assert_eq!(app.told("continues on a new one").len(), 1);
    assert_ne!(app.line("errors"), errors);
    app.shows(size, &other, "the file on the new device");
    app.quit();
}

/// What needs more memory than the device has is refused with a message that says what to lower. The picture stays.
#[test]
fn memory_runs_out() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_memory");
    let scene = cornell();
    let path = scene.to_str().expect("a path");
    let words = ["view", path, "--size", "64x48", "--aa", "4", "--reduced-motion"];
    let variables = [("LIGHTSKIN_DEVICE_MIB", "64")];
    let mut app = App::start_with(&display, &folder, &variables, &[&words[..], &SMALL].concat());
    app.line("scene");
    app.resize(384, 1000);
    let (command, before) = (app.command(), picture(&mut app, &folder));
    let stays = |app: &mut App, what: &str| {
        app.tells(what);
        assert_eq!(app.command(), command, "{what}");
        assert!(picture(app, &folder) == before, "{what}: the picture has changed");
    };
    app.resize(1384, 1000);
    stays(&mut app, "use a smaller window, picture, RSM or shadow map, or fewer caches; the picture stays at 64x1000");
    assert_eq!(app.size(), [384, 1000], "the window must return to its size");
    app.choose([64 + 135, 324], 4, "");
    stays(&mut app, "the previous settings are restored");
    app.slide([64 + 120, 168], 40, "");
    stays(&mut app, "the scene stays as it was");
    app.drop_file(&scene.with_file_name("cornell_diffuse.glb"));
    let start = Instant::now();
    while app.told("the scene stays as it was").len() < 2 {
        assert!(start.elapsed() < PATIENCE, "the scene is not refused");
        std::thread::sleep(Duration::from_millis(10));
    }
    stays(&mut app, "the scene stays as it was");
    // Less memory for shadows leaves enough for another scene.
    app.choose([64 + 135, 324], 1, "--shadow-map 512");
    app.drop_file(&scene.with_file_name("cornell_diffuse.glb"));
    assert!(app.line("scene").contains("cornell_diffuse"));
    let scene = "the scene stays as it was";
    app.quit_after(&["the picture stays at 64x1000", "the previous settings are restored", scene, scene]);
}

/// `--ui-scale` and its keys change the size of the panels. Their controls stay where they are drawn.
#[test]
fn panels_have_any_size() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_scale");
    fs::create_dir_all(folder.join("config/lightskin")).expect("a folder");
    fs::write(folder.join("config/lightskin/settings.toml"), "ui-scale = 2").expect("settings");
    let scene = cornell();
    let words = ["view", scene.to_str().expect("a path"), "--size", "64x48", "--caches", "60", "--validation", "sync"];
    let mut app = App::start(&display, &folder, &[&words[..], &["--quality", "low", "--rsm", "32"]].concat());
    assert_eq!(app.size(), [64 + 640, 48]);
    app.line("scene");
    app.resize(1000, 620);
    app.settle("--size 360x620");
    app.slide([360 + 270, 440], -40, "--bounces");
    app.press_with("Control", "Minus");
    app.settle("--size 392x620");
    app.press_with("Control", "Plus");
    app.press_with("Control", "Plus");
    app.settle("--size 328x620");
    app.press_with("Control", "0");
    app.settle("--size 360x620");
    for _ in 0..20 {
        app.press_with("Control", "Minus");
    }
    app.settle("--size 840x620");
    let turned = app.command();
    app.drag(1, [820, 20], [830, 30]);
    assert_ne!(app.command(), turned, "a drag next to the panels must turn the camera");
    app.quit();
}

/// Number of frames so far. Needs `-vv`.
fn frames(app: &App) -> usize {
    app.told("draw held input").len()
}

/// Frames per second have a limit while an animation plays, the camera flies and the pointer moves. What moves keeps
/// its speed. Nothing moves before it is asked to.
#[test]
fn frames_have_a_limit() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_fps");
    moving(&folder, 50.0);
    let words = ["-vv", "view", "moves.glb", "--size", "64x48", "--no-panels", "--max-fps", "5"];
    let mut app = App::start(&display, &folder, &[&words[..], &SMALL].concat());
    app.line("scene");
    let command = app.command();
    assert!(!command.contains("--time"), "{command}");
    std::thread::sleep(Duration::from_millis(500));
    let still = frames(&app);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(frames(&app), still, "something moves by itself");
    for key in ["P", "W"] {
        let (start, first) = (Instant::now(), frames(&app));
        app.hold(key, true);
        while start.elapsed() < Duration::from_secs(2) {
            app.move_to([20 + start.elapsed().as_millis() as i16 % 9, 20]);
            std::thread::sleep(Duration::from_millis(5));
        }
        let (drawn, seconds) = (frames(&app) - first, start.elapsed().as_secs_f64());
        app.hold(key, false);
        assert!((4..=(5.0 * seconds) as usize + 1).contains(&drawn), "{key}: {drawn} frames in {seconds} s");
        if key == "P" {
            let command = app.command();
            let time = command.split("--time ").nth(1).and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
            assert!(time.is_some_and(|time| time > 0.8 * seconds), "after {seconds} s: {command}");
            app.press("P");
            app.command();
        }
    }
    app.quit();
}
