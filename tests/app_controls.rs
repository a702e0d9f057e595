//! Controls of the panels' sections, pressed one after the other. Each must change what the window stores or prints.

use crate::cli::folder;
use crate::common::glb;
use crate::common::window::{App, Display, cornell, png};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Left edge of the panels: width of the picture [pixels].
const LEFT: i16 = 64;

/// Column of lists, sliders and numbers.
const X: i16 = LEFT + 135;

/// Rows of the sections' names from "Materials" on, while these sections are closed.
const MATERIALS: i16 = 794;
const ANIMATION: i16 = 819;
const SCENE: i16 = 844;
const PLACEMENT: i16 = 869;
const TIMINGS: i16 = 919;
const MEMORY: i16 = 944;
const FILES: i16 = 969;
const LOG: i16 = 994;

/// A window with panels.
struct Panels {
    app: App,
    folder: PathBuf,
    /// The last saved session.
    session: Value,
}

/// The Cornell box with metallic-roughness materials, a group of two blocks, one of which can be lifted, as a file.
fn room(folder: &Path) {
    let file = fs::read(cornell()).expect("a room");
    let length = u32::from_le_bytes(file[12..16].try_into().expect("four bytes")) as usize;
    let mut json: Value = serde_json::from_slice(&file[20..20 + length]).expect("JSON");
    let mut binary = file[28 + length..].to_vec();
    for material in json["materials"].as_array_mut().expect("materials") {
        material.as_object_mut().expect("a material").remove("extras");
    }
    let nodes = json["nodes"].as_array_mut().expect("nodes");
    nodes.push(json!({"name": "furniture", "children": [1, 2]}));
    json["scenes"][0]["nodes"] = json!([0, 5, 3, 4]);
    let start = binary.len();
    let times = [0.0_f32, 0.2];
    let places = [0.333_f32, 0.0, 0.396, 0.333, 0.3, 0.396];
    binary.extend(times.iter().chain(&places).flat_map(|value| value.to_le_bytes()));
    json["buffers"][0]["byteLength"] = json!(binary.len());
    let mut add = |list: &str, value: Value| {
        let list = json[list].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    };
    let view = add("bufferViews", json!({"buffer": 0, "byteOffset": start, "byteLength": 8}));
    let times =
        json!({"bufferView": view, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0.0], "max": [0.2]});
    let times = add("accessors", times);
    let view = add("bufferViews", json!({"buffer": 0, "byteOffset": start + 8, "byteLength": 24}));
    let places = add("accessors", json!({"bufferView": view, "componentType": 5126, "count": 2, "type": "VEC3"}));
    json["animations"] = json!([{
        "name": "lift",
        "samplers": [{"input": times, "output": places}],
        "channels": [{"sampler": 0, "target": {"node": 2, "path": "translation"}}],
    }]);
    fs::write(folder.join("room.glb"), glb(&json, &binary)).expect("a room");
}

impl Panels {
    /// Opens the room, with flags before it and without a subcommand.
    fn open(display: &Display, folder: &Path) -> Self {
        room(folder);
        let words =
            ["--size", "64x48", "--reduced-motion", "--target-hz", "50", "room.glb", "--caches", "60", "--ev", "4"];
        let mut app =
            App::start(display, folder, &[&words[..], &["--quality", "low", "--validation", "sync"]].concat());
        app.line("scene");
        app.resize(384, 1700);
        let mut panels = Self { app, folder: folder.to_owned(), session: Value::Null };
        // Buttons lie where the previous frame put them, so wait for one frame.
        panels.app.command();
        panels.section(TIMINGS);
        panels.session = panels.saved();
        panels
    }

    /// Opens or closes the section in this row.
    fn section(&mut self, row: i16) {
        self.app.tap([LEFT + 60, row], "");
        std::thread::sleep(Duration::from_millis(300));
        self.app.settle("");
    }

    fn saved(&mut self) -> Value {
        self.app.press_with("Control", "S");
        let file = self.folder.join(self.app.line("session").split_whitespace().last().expect("a name"));
        let session = serde_json::from_slice(&fs::read(&file).expect("a session")).expect("JSON");
        fs::remove_file(file).expect("a session");
        session
    }

    /// Requires that this value of the session differs from that in the last session. Returns it.
    fn stores(&mut self, place: &str) -> Value {
        let before = std::mem::replace(&mut self.session, Value::Null);
        self.session = self.saved();
        let [before, now] = [&before, &self.session].map(|session| session.pointer(place).cloned());
        assert_ne!(before, now, "{place} does not change");
        now.unwrap_or(Value::Null)
    }

    /// Drags a number.
    fn drag(&mut self, at: [i16; 2], place: &str) -> Value {
        self.app.slide(at, 30, "");
        self.stores(place)
    }

    fn picture(&mut self) -> Vec<[u8; 3]> {
        let file = self.folder.join(self.app.picture());
        let picture = png(&file).1;
        fs::remove_file(file).expect("a picture");
        picture
    }
}

/// Lights and camera.
#[test]
fn lights_and_camera_have_controls() {
    let Some(display) = Display::open() else { return };
    let mut panels = Panels::open(&display, &folder("app_controls_lights"));
    let lamp = 440;
    panels.drag([LEFT + 130, lamp], "/lights/0/intensity");
    panels.drag([LEFT + 211, lamp], "/lights/0/radius");
    panels.app.tap([LEFT + 55, lamp], "");
    panels.app.tap([LEFT + 172, lamp + 200], "");
    panels.app.press("Escape");
    panels.stores("/lights/0/color");
    // The chosen light has rows of its own.
    panels.app.tap([LEFT + 268, lamp], "");
    for (x, member) in [(132, "position/0"), (196, "position/1"), (260, "position/2")] {
        panels.drag([LEFT + x, lamp + 26], &format!("/lights/0/{member}"));
    }
    panels.drag([LEFT + 136, lamp + 53], "/lights/0/direction");
    panels.drag([LEFT + 204, lamp + 53], "/lights/0/direction");
    panels.drag([LEFT + 132, lamp + 80], "/lights/0/innerConeAngle");
    panels.drag([LEFT + 196, lamp + 80], "/lights/0/outerConeAngle");
    // "Reset", and the buttons below it, which then move up.
    panels.app.tap([LEFT + 32, lamp + 105], "");
    assert_eq!(panels.stores("/lights/0").get("intensity"), None, "the light must be the file's again");
    panels.app.tap([LEFT + 161, lamp + 106], "");
    assert_eq!(panels.stores("/lights/1")["type"], "sun");
    // The sun is chosen. It has two angles.
    panels.drag([LEFT + 132, lamp + 53], "/lights/1/direction");
    panels.drag([LEFT + 196, lamp + 53], "/lights/1/direction");
    panels.app.tap([LEFT + 210, lamp + 79], "");
    assert_eq!(panels.stores("/lights/2")["type"], "sun");
    panels.app.tap([LEFT + 272, lamp + 105], "");
    assert_eq!(panels.stores("/lights/2"), Value::Null);

    // Two lights, none of which is chosen.
    let camera = 579;
    panels.app.drag(1, [20, 20], [40, 30]);
    panels.stores("/camera");
    panels.app.choose([X, camera], 1, "");
    assert_eq!(panels.stores("/camera"), "0");
    panels.drag([LEFT + 128, camera + 78], "/exposure");
    let shown = |panels: &Panels| panels.app.pixels([0, 0], [LEFT as u16, 1000]);
    let mut seen = vec![shown(&panels)];
    for entry in [3, 5, 8] {
        panels.app.choose([X, camera + 130], entry, "");
        seen.push(panels.app.changes([LEFT as u16, 1000], &seen[seen.len() - 1], "another layer"));
    }
    // The scale of false colours: both ends, and "fit".
    for x in [124, 168] {
        panels.app.slide([LEFT + x, camera + 156], 30, "");
        seen.push(panels.app.changes([LEFT as u16, 1000], &seen[seen.len() - 1], "another scale"));
    }
    panels.app.tap([LEFT + 262, camera + 156], "");
    panels.app.changes([LEFT as u16, 1000], &seen[seen.len() - 1], "a scale that fits");
    panels.app.choose([X, camera + 130], 1, "");
    panels.app.click(1, [LEFT + 200, camera + 156]);
    let saved = panels.app.line("picture");
    assert!(png(&panels.folder.join(saved.split_whitespace().last().expect("a name"))).0 == [64, 1700], "{saved}");
    panels.app.click(1, [LEFT + 80, camera + 156]);
    panels.app.line("lightskin render");
    panels.app.quit();
}

/// Materials, animation, visible objects, placement of caches, and files.
#[test]
fn sections_of_the_scene_have_controls() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_controls_scene");
    let mut panels = Panels::open(&display, &folder);
    // Sections that only show something.
    for (row, what) in [(TIMINGS, "timings"), (MEMORY, "memory")] {
        let bright = |panels: &Panels| {
            let below = panels.app.pixels([LEFT, row + 15], [320, 120]);
            below.iter().filter(|pixel| pixel[1] > 100).count()
        };
        panels.app.move_to([20, 20]);
        panels.app.command();
        let before = bright(&panels);
        panels.section(row);
        assert!(bright(&panels) > before + 100, "{what}");
        panels.section(row);
    }

    panels.section(FILES);
    panels.app.tap([LEFT + 167, FILES + 52], "");
    room(&panels.folder);
    panels.app.line("scene");
    panels.app.click(1, [LEFT + 111, FILES + 52]);
    panels.app.line("session");
    panels.app.click(1, [LEFT + 30, FILES + 76]);
    assert!(panels.app.line("scene").contains("room"));
    panels.section(FILES);

    panels.section(PLACEMENT);
    panels.app.slide([LEFT + 139, PLACEMENT + 27], 30, "");
    panels.app.line("scene");
    panels.app.settle("--spacing ");
    panels.app.slide([LEFT + 124, PLACEMENT + 53], -30, "");
    panels.app.line("scene");
    panels.app.settle("--angle ");
    panels.app.choose([X, PLACEMENT + 79], 2, "");
    panels.app.line("scene");
    panels.app.settle("--refs 16");
    let command = panels.app.command();
    assert!(command.contains("--spacing") && !command.contains("--caches"), "{command}");
    panels.app.slide([LEFT + 120, 168], 10, "");
    panels.app.line("scene");
    panels.app.settle("--caches ");
    assert!(!panels.app.command().contains("--spacing"));
    panels.section(PLACEMENT);

    panels.section(SCENE);
    panels.session = panels.saved();
    let all = panels.picture();
    panels.app.tap([LEFT + 37, SCENE + 28], "");
    assert_eq!(panels.stores("/hidden"), json!(["room"]));
    assert!(panels.picture() != all, "the room must vanish");
    panels.app.tap([LEFT + 37, SCENE + 28], "");
    assert_eq!(panels.stores("/hidden"), json!([]));
    assert!(panels.picture() == all, "the room must be back");
    // A group hides what it holds. Its triangle lists it.
    panels.app.tap([LEFT + 37, SCENE + 53], "");
    assert_eq!(panels.stores("/hidden"), json!(["tall block", "short block"]));
    panels.app.tap([LEFT + 15, SCENE + 53], "");
    panels.app.tap([LEFT + 51, SCENE + 78], "");
    assert_eq!(panels.stores("/hidden"), json!(["short block"]));
    // A group of which only a part is visible becomes visible.
    panels.app.tap([LEFT + 37, SCENE + 53], "");
    assert_eq!(panels.stores("/hidden"), json!([]));
    panels.section(SCENE);

    panels.section(ANIMATION);
    panels.app.choose([X, ANIMATION + 27], 2, "--animation 0");
    assert_eq!(panels.stores("/animation/clip"), 0);
    panels.drag([LEFT + 110, ANIMATION + 53], "/animation/time");
    panels.drag([LEFT + 134, ANIMATION + 79], "/animation/speed");
    panels.app.slide([LEFT + 134, ANIMATION + 129], 30, "");
    panels.app.click(1, [LEFT + 45, ANIMATION + 129]);
    let told = panels.app.line("video");
    assert!(told.ends_with("room-video-1: 7 pictures"), "0.2 s with 33 frames/s instead of 30: {told}");
    panels.app.tap([LEFT + 28, ANIMATION + 104], "");
    std::thread::sleep(Duration::from_millis(100));
    panels.app.tap([LEFT + 28, ANIMATION + 104], "");
    panels.stores("/animation/time");
    panels.app.choose([X, ANIMATION + 27], 1, "");
    panels.section(ANIMATION);

    // What was logged about the video.
    let bright =
        |panels: &Panels| panels.app.pixels([LEFT, LOG + 15], [320, 120]).iter().filter(|p| p[1] > 100).count();
    let before = bright(&panels);
    panels.section(LOG);
    assert!(bright(&panels) > before + 100, "the log is empty");
    panels.section(LOG);

    panels.section(MATERIALS);
    panels.app.choose([X, MATERIALS + 27], 2, "");
    panels.app.tap([LEFT + 124, MATERIALS + 53], "");
    panels.app.tap([LEFT + 136, MATERIALS - 134], "");
    panels.app.press("Escape");
    panels.stores("/materials/red/base_color");
    panels.app.slide([LEFT + 216, MATERIALS + 79], -30, "");
    panels.stores("/materials/red/roughness");
    panels.drag([LEFT + 110, MATERIALS + 105], "/materials/red/metallic");
    panels.app.slide([LEFT + 172, MATERIALS + 131], -30, "");
    panels.stores("/materials/red/specular");
    panels.app.tap([LEFT + 124, MATERIALS + 131], "");
    panels.app.tap([LEFT + 136, MATERIALS - 52], "");
    panels.app.press("Escape");
    panels.stores("/materials/red/specular_color");
    panels.drag([LEFT + 191, MATERIALS + 157], "/materials/red/emissive");
    // A session brings all of it back.
    let (session, edited) = (panels.session.clone(), panels.picture());
    fs::write(panels.folder.join("edited.json"), session.to_string()).expect("a session");
    for _ in 0..6 {
        panels.app.press_with("Control", "Z");
    }
    panels.app.settle("");
    assert!(panels.picture() != edited, "undone");
    panels.app.drop_file(&panels.folder.join("edited.json"));
    panels.app.line("scene");
    panels.app.settle("");
    assert!(panels.picture() == edited, "the session's picture differs");
    assert_eq!(panels.saved()["materials"], session["materials"]);
    panels.app.quit();
}
