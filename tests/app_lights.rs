//! Lights in the window: handles that move and aim them, added lights, undo, and sessions that keep all of it.

use crate::cli::{folder, works};
use crate::common::window::{App, Display, cornell, png};
use glam::{DVec3, Vec2};
use lightskin::frame::View;
use lightskin::image::{Layer, write_exr};
use lightskin::scene::{Scene, gltf};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Size of the picture, left of the panels.
const SIZE: [u32; 2] = [400, 560];

/// The session that the window saves.
fn saved(app: &mut App, folder: &Path) -> (PathBuf, Value) {
    app.press_with("Control", "S");
    let file = folder.join(app.line("session").split_whitespace().last().expect("a name"));
    let value = serde_json::from_slice(&std::fs::read(&file).expect("a session")).expect("JSON");
    (file, value)
}

fn vector(value: &Value) -> DVec3 {
    let [x, y, z] = [0, 1, 2].map(|i| value[i].as_f64().expect("a number"));
    DVec3::new(x, y, z)
}

/// Where a point appears in the picture [pixels], and its distance from the camera plane [m].
fn seen(scene: &Scene, point: DVec3) -> (Vec2, f32) {
    let view = View::new(&scene.cameras[0], SIZE, DVec3::ZERO, 10.0);
    let clip = view.clip_from_world * point.as_vec3().extend(1.0);
    let at = Vec2::new(clip.x, clip.y) / clip.w * 0.5 + 0.5;
    (at * Vec2::new(SIZE[0] as f32, SIZE[1] as f32), view.plane.dot(point.as_vec3().extend(1.0)))
}

fn pixel(at: Vec2) -> [i16; 2] {
    [at.x.round() as i16, at.y.round() as i16]
}

/// A sky that is dropped on the window lights the scene, and edits of lights stay. The panel turns it.
#[test]
fn a_sky_leaves_the_edits() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_sky");
    let texels: Vec<[f32; 4]> = (0..32).map(|i| [900.0, 40.0 * i as f32, 100.0, 1.0]).collect();
    write_exr(&folder.join("sky.exr"), 8, 4, &[Layer::rgb("", &texels)], "").expect("a sky");
    let light = ["--caches", "100", "--quality", "low", "--validation", "sync"];
    let file = cornell();
    let words = ["view", file.to_str().expect("a path"), "--size", "96x1000"];
    let mut app = App::start(&display, &folder, &[&words[..], &light].concat());
    let first = app.line("scene");
    app.settle("");
    // Switch the light off, add a point light, deselect it.
    app.tap([96 + 16, 439], "");
    app.tap([96 + 64, 466], "");
    app.press("Escape");
    app.settle("");
    let before = saved(&mut app, &folder).1;
    assert_eq!(before["lights"][0]["on"], false);
    assert_eq!(before["lights"][1]["type"], "point");
    app.drop_file(&folder.join("sky.exr"));
    app.line("scene");
    app.settle("--sky ");
    let with_sky = png(&folder.join(app.picture())).1;
    assert_eq!(saved(&mut app, &folder).1["lights"], before["lights"]);
    // Open the section of the sky and drag its rotation.
    app.tap([96 + 40, 527], "");
    std::thread::sleep(std::time::Duration::from_millis(300));
    app.settle("");
    app.slide([96 + 155, 606], 20, "");
    app.line("scene");
    app.settle("--sky-rotate ");
    assert!(png(&folder.join(app.picture())).1 != with_sky, "the picture must turn with the sky");
    assert_eq!(saved(&mut app, &folder).1["lights"], before["lights"]);
    // A ground below the box, which rises.
    app.choose([96 + 155, 658], 3, "");
    let with_ground = app.line("scene");
    assert_ne!(with_ground.split(':').nth(1), first.split(':').nth(1), "the ground must add triangles");
    app.settle("--ground ");
    let height = |app: &mut App| -> f64 {
        let command = app.command();
        let word = command.split("--ground ").nth(1).and_then(|rest| rest.split_whitespace().next()).expect("a height");
        word.parse().expect("a number")
    };
    let lowest = height(&mut app);
    app.slide([96 + 155, 684], 20, "");
    app.line("scene");
    app.settle("");
    assert!(height(&mut app) > lowest, "{lowest}");
    // The sky has no sun, so that the lights are the same, and both steps can be undone.
    for step in 0..2 {
        app.press_with("Control", "Z");
        app.settle("");
        assert_ne!(saved(&mut app, &folder).1["lights"], before["lights"], "step {step}");
    }
    app.quit();
}

/// The colour of a light opens a picker, which shows all hues and changes the light.
#[test]
fn colours_are_picked() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_colours");
    let light = ["--caches", "100", "--quality", "low", "--validation", "sync"];
    let file = cornell();
    let words = ["view", file.to_str().expect("a path"), "--size", "96x1000"];
    let mut app = App::start(&display, &folder, &[&words[..], &light].concat());
    app.line("scene");
    app.settle("");
    let is_colourful = |[r, g, b]: &[u8; 3]| r.max(g).max(b) - r.min(g).min(b) > 150;
    let colourful = |app: &App| app.pixels([96, 0], [320, 1000]).iter().filter(|pixel| is_colourful(pixel)).count();
    let before = colourful(&app);
    app.tap([96 + 55, 439], "");
    std::thread::sleep(std::time::Duration::from_millis(300));
    app.settle("");
    let shown = colourful(&app);
    assert!(shown > before + 1000, "{before} pixels, then {shown}");
    app.press("Escape");
    app.quit();
}

#[test]
fn lights_are_moved_added_and_undone() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_lights");
    let file = cornell();
    let scene = gltf::load(&file).expect("a scene");
    let light = ["--caches", "150", "--quality", "low", "--validation", "sync"];
    let words = ["view", file.to_str().expect("a path"), "--size", "400x560"];
    let mut app = App::start(&display, &folder, &[&words[..], &light].concat());
    app.line("scene");
    app.settle("400x560");
    let light = &scene.lights[0];
    let (at, depth) = seen(&scene, light.position);
    let before = png(&folder.join(app.picture())).1;

    // Choose the light in the picture, then drag it parallel to the picture.
    app.tap(pixel(at), "");
    let by = Vec2::new(18.0, 41.0);
    app.drag(1, pixel(at), pixel(at + by));
    app.settle("");
    let (_, session) = saved(&mut app, &folder);
    let moved = vector(&session["lights"][0]["position"]);
    let (now, depth_now) = seen(&scene, moved);
    assert!((now - at - by).length() < 1e-2 && (depth_now - depth).abs() < 1e-5, "{at} to {now}, {moved}");
    assert!(png(&folder.join(app.picture())).1 != before, "the picture must change with the light");

    // Drag it along +X by its arrow.
    let scale = f64::from((seen(&scene, moved + 1e-3 * DVec3::X).0.x - now.x) / 1e-3);
    let tip = seen(&scene, moved + 70.0 / scale * DVec3::X).0;
    app.drag(1, pixel(tip), pixel(tip + Vec2::new(-25.0, 3.0)));
    app.settle("");
    let (_, session) = saved(&mut app, &folder);
    let along = vector(&session["lights"][0]["position"]) - moved;
    assert!(along.y == 0.0 && along.z == 0.0 && (along.x * scale + 25.0).abs() < 0.5, "{along}");

    // Undo both, redo one.
    for (shift, wanted) in [(false, Some(moved)), (false, None), (true, Some(moved))] {
        app.hold("Control", true);
        app.hold("Shift", shift);
        app.press("Z");
        app.hold("Shift", false);
        app.hold("Control", false);
        app.settle("");
        let (_, session) = saved(&mut app, &folder);
        let position = &session["lights"][0]["position"];
        match wanted {
            Some(wanted) => assert_eq!(vector(position), wanted),
            None => assert!(position.is_null(), "{position}"),
        }
    }

    // Add a spot, and aim it by its handle.
    app.press("Escape");
    app.settle("");
    app.tap([400 + 114, 466], "");
    let (_, session) = saved(&mut app, &folder);
    let spot = &session["lights"][1];
    assert_eq!(spot["type"], "spot");
    let (centre, direction) = (vector(&spot["position"]), vector(&spot["direction"]));
    let scale = f64::from((seen(&scene, centre + 1e-3 * DVec3::X).0.x - seen(&scene, centre).0.x) / 1e-3);
    let tip = seen(&scene, centre + 70.0 / scale * direction).0;
    let aim = seen(&scene, centre).0 + Vec2::new(-60.0, 0.0);
    app.drag(1, pixel(tip), pixel(aim));
    app.settle("");
    let (saved_file, session) = saved(&mut app, &folder);
    let turned = vector(&session["lights"][1]["direction"]);
    assert!((turned.length() - 1.0).abs() < 1e-6 && turned.x < -0.75 && turned.y.abs() < 0.1, "{turned}");
    assert_eq!(vector(&session["lights"][1]["position"]), centre);

    // `render` draws the session as the window shows it.
    let shown = png(&folder.join(app.picture())).1;
    let name = saved_file.to_str().expect("a path");
    works(&folder, &["render", name, "--size", "400x560", "-o", "of_session.png"]);
    assert!(png(&folder.join("of_session.png")).1 == shown, "the session's picture differs from the window's");

    app.press("Delete");
    app.settle("");
    let (_, session) = saved(&mut app, &folder);
    assert_eq!(session["lights"].as_array().map(Vec::len), Some(1));
    // Without the handles the window shows the picture alone.
    let plain = png(&folder.join(app.picture())).1;
    assert!(app.pixels([0, 0], [400, 560]) != plain, "handles must be shown");
    app.press("L");
    app.shows([400, 560], &plain, "without handles");
    app.quit();
}
