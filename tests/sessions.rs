//! Sessions as `render` draws them: the same picture as that of the flags, with edits of lights, and flags that override
//! those of the file.

use crate::cli::{fails, folder, lightskin, works};
use lightskin::image::read_radiance;
use lightskin::scene::LightKind;
use lightskin::scene::build::{CornellSurface, cornell};
use lightskin::scene::medium::Subsurface;
use lightskin::scene::write::write_glb;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A folder with the Cornell box.
fn with_box(name: &str) -> PathBuf {
    let folder = folder(name);
    write_glb(&cornell(CornellSurface::Diffuse, 0.5), &folder.join("box.glb")).expect("a scene");
    folder
}

/// Sums of the three channels of what `render` draws with these words.
fn drawn(folder: &Path, words: &[&str]) -> [f64; 3] {
    works(folder, &[&["render"], words, &["-o", "a.exr", "--layer", "color"]].concat());
    let picture = read_radiance(&folder.join("a.exr")).expect("a picture");
    picture.rgb.iter().fold([0.0; 3], |sum, rgb| [0, 1, 2].map(|i| sum[i] + f64::from(rgb[i])))
}

fn session(folder: &Path, change: impl FnOnce(&mut Value)) {
    let mut session = json!({
        "lightskin_session": 1,
        "arguments": ["box.glb", "--caches", "150", "--quality", "low"],
        "settings": ["--caches", "150", "--quality", "low", "--bounces", "2"],
        "camera": "0,1,3.2;0,1,0;0,1,0;40",
        "animation": { "clip": null, "time": 0.0, "speed": 1.0 },
    });
    change(&mut session);
    std::fs::write(folder.join("box.json"), session.to_string()).expect("a session");
}

#[test]
fn a_session_is_drawn_as_its_flags_say() {
    let folder = with_box("sessions_flags");
    session(&folder, |_| ());
    let size = ["--size", "48x32"];
    let flags =
        ["box.glb", "--caches", "150", "--quality", "low", "--bounces", "2", "--camera", "0,1,3.2;0,1,0;0,1,0;40"];
    let wanted = drawn(&folder, &[&flags[..], &size].concat());
    assert!(wanted[0] > 0.0);
    assert_eq!(drawn(&folder, &[&["box.json"], &size[..]].concat()), wanted);
    let direct = drawn(&folder, &[&flags[..], &size, &["--gi", "off"]].concat());
    assert_eq!(
        drawn(&folder, &[&["box.json", "--gi", "off"], &size[..]].concat()),
        direct,
        "a flag overrides the file"
    );
    let finer = [&flags[..1], &["--spacing", "0.2"], &flags[3..], &size].concat();
    let finer = drawn(&folder, &finer);
    assert_ne!(finer, wanted);
    assert_eq!(drawn(&folder, &[&["box.json", "--spacing", "0.2"], &size[..]].concat()), finer, "instead of --caches");
    session(&folder, |s| {
        s["arguments"] = json!(["box.glb", "--spacing", "0.2", "--quality", "low"]);
        s["settings"] = json!(["--spacing", "0.2", "--quality", "low", "--bounces", "2"]);
    });
    assert_eq!(drawn(&folder, &[&["box.json"], &size[..]].concat()), finer);
    assert_eq!(drawn(&folder, &[&["box.json", "--caches", "150"], &size[..]].concat()), wanted, "instead of --spacing");
}

#[test]
fn lights_of_a_session_shine() {
    let folder = with_box("sessions_lights");
    let words = ["box.json", "--size", "48x32", "--gi", "off"];
    session(&folder, |_| ());
    let own = drawn(&folder, &words);
    let intensity = cornell(CornellSurface::Diffuse, 0.5).lights[0].intensity;
    let near = |found: [f64; 3], wanted: [f64; 3]| (0..3).all(|i| (found[i] - wanted[i]).abs() < 1e-3 * own[0]);
    session(&folder, |s| s["lights"] = json!([{ "intensity": 3.0 * intensity, "color": [1.0, 1.0, 1.0] }]));
    let threefold = drawn(&folder, &words);
    // A second light at the same place adds its part.
    let place = cornell(CornellSurface::Diffuse, 0.5).lights[0].clone();
    let LightKind::Spot { inner, outer } = place.kind else { panic!("the box has a spot") };
    let second = json!({ "type": "spot", "innerConeAngle": inner, "outerConeAngle": outer, "intensity": 2.0 * intensity, "color": [1.0, 1.0, 1.0],
                         "position": place.position.to_array(), "direction": place.direction.to_array() });
    session(&folder, |s| s["lights"] = json!([{ "intensity": intensity, "color": [1.0, 1.0, 1.0] }, second]));
    let both = drawn(&folder, &words);
    assert!(near(both, threefold), "{both:?} {threefold:?}");
    session(&folder, |s| s["lights"] = json!([{ "on": false }]));
    let off = drawn(&folder, &words);
    assert!(off.iter().all(|sum| *sum < 1e-6 * own[0]), "{off:?}");
    // Moved out of the box, the light shines on its outside alone.
    let away = json!([{ "position": [0.0, 1.0, -50.0], "direction": [0.0, -1.0, 0.0] }]);
    session(&folder, |s| s["lights"] = away);
    assert!(drawn(&folder, &words)[0] < 1e-3 * own[0]);
    session(&folder, |s| s["hidden"] = json!(["short block", "tall block"]));
    assert!(!near(drawn(&folder, &words), own), "hidden bodies cast no shadows");
}

#[test]
fn broken_sessions_say_what_to_do() {
    let folder = with_box("sessions_broken");
    let words = ["render", "box.json", "-o", "a.png"];
    std::fs::write(folder.join("box.json"), "{").expect("a file");
    fails(&folder, &words, 1, &["box.json: file: the JSON is broken; save the session again"]);
    session(&folder, |s| s["settings"] = json!(["--qualty", "low"]));
    fails(&folder, &words, 1, &["box.json: correct this, or save the session again", "--qualty"]);
    session(&folder, |s| s["arguments"] = json!(["gone.glb"]));
    fails(&folder, &words, 1, &["gone.glb"]);
    session(&folder, |_| ());
    fails(&folder, &[&words[..], &["--size", "0x3"]].concat(), 2, &["--size"]);
}

/// A medium of a session is that of a file with the same coefficients, and a session can take it out again.
#[test]
fn media_of_a_session_fill_bodies() {
    let folder = with_box("sessions_media");
    let words = ["box.json", "--size", "48x32"];
    session(&folder, |_| ());
    let hollow = drawn(&folder, &words);
    let marble = Subsurface { scale: 40.0, ..Subsurface::preset("marble").expect("marble") };
    let told = json!({ "sigma_s": marble.sigma_s.to_array(), "sigma_a": marble.sigma_a.to_array(), "g": marble.g,
                       "ior": marble.ior, "scale": marble.scale });
    session(&folder, |s| s["materials"] = json!({ "white": { "subsurface": told } }));
    let filled = drawn(&folder, &words);
    assert_ne!(filled, hollow, "light must enter the walls");
    // A value that no medium can have changes nothing, and is named.
    let mut broken = told.clone();
    broken["ior"] = json!(0.5);
    session(&folder, |s| s["materials"] = json!({ "white": { "subsurface": broken } }));
    assert_eq!(drawn(&folder, &words), hollow);
    let drawn_again = lightskin(&folder, &["render", "box.json", "-o", "a.png", "--size", "8x8"]);
    let warnings = String::from_utf8_lossy(&drawn_again.stderr).into_owned();
    assert!(warnings.contains("materials.white.subsurface: not a possible value"), "{warnings}");

    let mut scene = cornell(CornellSurface::Diffuse, 0.5);
    let white = scene.materials.iter_mut().find(|material| material.name == "white").expect("a white wall");
    let before = white.base_color;
    white.fill(marble);
    write_glb(&scene, &folder.join("box.glb")).expect("a scene");
    session(&folder, |_| ());
    assert_eq!(drawn(&folder, &words), filled, "the file's medium");
    session(&folder, |s| {
        s["materials"] = json!({ "white": { "base_color": before.to_array(), "subsurface": null } });
    });
    assert_eq!(drawn(&folder, &words), hollow, "the file's medium is taken out");
}
