//! The window from a user's view: real key and button events on a private display, with validation.

use crate::cli::{fails, folder, works};
use crate::common::window::{App, Display, SMALL, cornell, png, words};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

/// The window shows the same picture as `render`, bit for bit: from a camera of the scene, from cameras that the user
/// has turned and flown, and so does the file that F12 writes.
#[test]
fn the_window_shows_what_render_writes() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_same");
    let scene = cornell();
    let scene = scene.to_str().expect("a path");
    let flags = ["--bounces", "2", "--shadow-map", "256", "--interpolation", "printed"];
    let arguments = [&["view", scene, "--size", "160x120", "--no-panels"], &SMALL[..], &flags].concat();
    let mut app = App::start(&display, &folder, &arguments);
    app.line("scene");
    let command = app.command();
    assert!(flags.chunks(2).all(|flag| command.contains(&flag.join(" "))), "{command}");
    for step in ["initial view", "turned", "flown"] {
        match step {
            "turned" => {
                app.drag(1, [60, 60], [90, 50]);
                app.click(4, [80, 60]);
            }
            "flown" => {
                app.hold("W", true);
                std::thread::sleep(Duration::from_millis(300));
                app.hold("W", false);
            }
            _ => {}
        }
        let command = app.command();
        let saved = app.picture();
        let mut words = words(&command);
        assert_eq!(words.remove(0), "lightskin");
        let rendered = folder.join("picture.png");
        let _ = fs::remove_file(&rendered);
        works(&folder, &words.iter().map(String::as_str).collect::<Vec<_>>());
        let (size, wanted) = png(&rendered);
        assert_eq!(size, [160, 120], "{command}");
        assert!(png(&folder.join(&saved)).1 == wanted, "{step}: the picture of F12 differs from that of {command}");
        app.shows(size, &wanted, step);
    }
    app.quit();
}

/// A small window with panels: moves the camera, uses every row of the panels and all keys, sets sixty window
/// sizes down to nearly nothing, and minimises the window.
#[test]
fn everything_can_be_pressed() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_keys");
    let scene = cornell();
    let path = scene.to_str().expect("a path");
    let mut app = App::start(
        &display,
        &folder,
        &[&["-vv", "view", path, "--size", "64x48", "--layers", "3"], &SMALL[..]].concat(),
    );
    app.line("scene");
    app.resize(384, 1100);
    let began = app.command();
    app.drag(1, [20, 20], [40, 30]);
    app.drag(2, [20, 20], [30, 30]);
    app.drag(3, [20, 20], [30, 20]);
    app.click(5, [30, 300]);
    app.click(1, [30, 300]);
    app.click(1, [30, 300]);
    app.hold("Shift", true);
    app.press("W");
    app.hold("Shift", false);
    let moved = app.command();
    assert_ne!(moved, began);
    app.press_with("Control", "2");
    app.press("1");
    assert_eq!(app.command(), began, "camera 1 is the scene's own");
    app.press("2");
    assert_eq!(app.command(), moved, "camera 2 was kept");
    app.press("1");
    // The panels have rows 26 pixels high. Each control must change the named part of the printed command line.
    let x = 64 + 135;
    app.slide([x, 220], 30, "--bounces");
    app.choose([x, 246], 1, "--shadows off");
    app.choose([x, 272], 3, "--near endless --near-rays 8");
    app.choose([x, 272], 2, "--near rays --near-rays 8");
    assert!(!app.command().contains("--near-every"), "the picture's size decides");
    app.slide([x, 298], -40, "--near-rays ");
    assert!(!app.command().contains("--near-rays 8"));
    app.slide([x, 324], 30, "--near-every ");
    app.choose([x, 350], 1, "--rsm 32");
    app.choose([x, 376], 1, "--shadow-map 512");
    app.choose([x, 402], 1, "--aa off");
    app.choose([x, 428], 3, "--layers 4");
    let lit = png(&folder.join(app.picture())).1;
    app.tap([64 + 16, 491], "");
    assert!(png(&folder.join(app.picture())).1 != lit, "the light was switched off, but the picture stays");
    app.tap([64 + 16, 491], "");
    app.slide([x, 632], 30, "--camera '");
    app.tap([64 + 112, 658], "--ev ");
    app.choose([x, 710], 2, "--tonemap agx");
    for shown in 2..=9 {
        app.choose([x, 736], shown, "");
    }
    // Marks over the last layer.
    app.tap([64 + 60, 822], "");
    std::thread::sleep(Duration::from_millis(300));
    app.settle("");
    for discs in [2, 3, 4] {
        app.choose([x, 849], discs, "");
    }
    app.tap([64 + 112, 875], "");
    app.tap([64 + 112, 901], "");
    // The reference. Its controls appear when it opens.
    app.press("Space");
    std::thread::sleep(Duration::from_millis(300));
    app.settle("");
    app.choose([x, 875], 4, "");
    assert!(app.line("errors").contains("brute force"));
    app.slide([64 + 120, 901], 40, "");
    for map in [2, 3] {
        app.choose([x, 927], map, "");
        app.line("errors");
    }
    app.press("Space");
    app.choose([x, 194], 3, "--gi off");
    app.choose([x, 194], 2, "--gi brute-force");
    app.choose([x, 142], 1, "lightskin");
    app.line("scene");
    let command = app.command();
    let reset = ["--gi", "--layers"];
    assert!(command.contains("--quality low") && !reset.iter().any(|flag| command.contains(flag)), "{command}");
    app.slide([64 + 120, 168], 40, "lightskin");
    app.line("scene");
    assert!(app.command().contains("--caches"));
    // Without a desktop no file dialog opens.
    app.press_with("Control", "O");
    for _ in 0..3 {
        app.press("F1");
        app.press("Tab");
    }
    app.press("Tab");
    for turn in 0..60_u32 {
        let (width, height) = (1 + turn * 97 % 300, 1 + turn * 61 % 200);
        app.resize(width, height);
        app.press("H");
    }
    app.resize(1, 1);
    app.command();
    app.minimise();
    app.resize(96, 64);
    app.press("Tab");
    let name = app.picture();
    let (size, picture) = png(&folder.join(name));
    assert_eq!(size, [96, 64], "without panels the picture must be as large as the window");
    // A file that does not load leaves the shown scene in place.
    let broken = folder.join("broken.glb");
    fs::write(&broken, b"nonsense").expect("a file");
    app.drop_file(&broken);
    std::thread::sleep(Duration::from_millis(800));
    app.settle("");
    app.drop_file(&scene.with_file_name("cornell_diffuse.glb"));
    assert!(app.line("scene").contains("cornell_diffuse"));
    let name = app.picture();
    assert!(png(&folder.join(name)).1 != picture, "the picture must change with the scene");
    let mut held = app.held();
    held.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("longest delays beyond a frame [ms]: {:?}", &held[..10]);
    app.quit_after(&["broken.glb"]);
}

/// The picture keeps a part of windows that are too narrow for it and the panels.
#[test]
fn narrow_windows_have_a_picture() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_narrow");
    let scene = cornell();
    let path = scene.to_str().expect("a path");
    let mut app = App::start(&display, &folder, &[&["view", path, "--size", "96x64"], &SMALL[..]].concat());
    app.line("scene");
    for width in [320, 250, 20] {
        app.resize(width, 200);
        app.command();
        let command = app.command();
        assert!(command.contains(&format!("--size {}x200", width / 5)), "{width}: {command}");
    }
    app.quit();
}

/// The thesis's gather and clusters are chosen in the panel; the printed command draws the same picture.
#[test]
fn variants_of_the_method_can_be_chosen() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_variants");
    let scene = cornell();
    let path = scene.to_str().expect("a path");
    let mut app = App::start(&display, &folder, &[&["view", path, "--size", "160x48"], &SMALL[..]].concat());
    app.line("scene");
    app.resize(480, 1000);
    // Buttons lie where the previous frame put them, so wait for one frame.
    app.command();
    app.tap([160 + 60, 868], "");
    std::thread::sleep(Duration::from_millis(300));
    app.settle("");
    let x = 160 + 135;
    let mut seen = vec![png(&folder.join(app.picture())).1];
    app.choose([x, 895], 2, "--gather fragment --shadows proxy");
    seen.push(png(&folder.join(app.picture())).1);
    // Bounces, shadows and short rays belong to compute: three rows fewer are above.
    app.choose([x, 817], 3, "--cluster 8 --shadows proxy");
    app.slide([160 + 110, 843], 30, "--cluster ");
    seen.push(png(&folder.join(app.picture())).1);
    app.choose([x, 869], 2, "--interpolation printed");
    let name = app.picture();
    seen.push(png(&folder.join(&name)).1);
    assert!((1..seen.len()).all(|i| seen[i] != seen[i - 1]), "each variant must change the picture");
    let command = app.command();
    app.quit();
    let mut words = words(&command)[1..].to_vec();
    let at = words.iter().position(|word| word == "-o").expect("a file") + 1;
    words[at] = "again.png".to_owned();
    works(&folder, &words.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(png(&folder.join("again.png")).1 == seen[3], "the command must draw the picture of the window: {command}");
}

/// A window with the Cornell box, 32 x 32 virtual lights and no discs of lights.
fn with_few_lights(display: &Display, folder: &Path) -> App {
    let scene = cornell();
    let path = scene.to_str().expect("a path");
    let mut app = App::start(display, folder, &[&["view", path, "--size", "160x48"], &SMALL[..]].concat());
    app.line("scene");
    app.resize(480, 1000);
    app.press("L");
    // Buttons lie where the previous frame put them, so wait for one frame.
    app.command();
    app.choose([160 + 135, 298], 1, "--rsm 32");
    app
}

/// Each kind of mark is drawn over the picture, and nothing is where there are no caches and no virtual lights.
#[test]
fn marks_are_drawn_over_the_picture() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_marks");
    let mut app = with_few_lights(&display, &folder);
    let x = 160 + 135;
    // Tooltips cover the lower part of the picture.
    let (size, upper) = ([160, 600], |i: usize| i < 160 * 600);
    let plain = png(&folder.join(app.picture())).1;
    app.shows_at([160, 1000], &plain, upper, "without marks");
    app.tap([160 + 60, 744], "");
    std::thread::sleep(Duration::from_millis(300));
    app.settle("");
    let mut seen = vec![plain[..160 * 600].to_vec()];
    let [caches, proxies, vals] = [771, 797, 823];
    for discs in 2..=4 {
        app.choose([x, caches], discs, "");
        seen.push(app.changes(size, &seen[seen.len() - 1], "caches as discs"));
    }
    // All caches are live, because they light each other.
    assert!(seen[1] != seen[2] && seen[1] == seen[3], "live caches must have their own colours");
    app.choose([x, caches], 1, "");
    for (row, what) in [(proxies, "proxy lights"), (vals, "virtual lights")] {
        app.shows_at([160, 1000], &plain, upper, "without marks");
        app.tap([160 + 112, row], "");
        seen.push(app.changes(size, &seen[0], what));
        app.tap([160 + 112, row], "");
    }
    assert!(seen[4] != seen[5]);
    app.shows_at([160, 1000], &plain, upper, "without marks");
    assert!(png(&folder.join(app.picture())).1 == plain, "marks must not change the picture");
    app.choose([x, caches], 2, "");
    app.tap([160 + 112, proxies], "");
    app.tap([160 + 112, vals], "");
    // Brute force has virtual lights, but no caches.
    app.choose([x, 194], 2, "--gi brute-force");
    let exact = png(&folder.join(app.picture())).1;
    app.changes(size, &exact[..160 * 600], "virtual lights of brute force");
    app.choose([x, 194], 3, "--gi off");
    let direct = png(&folder.join(app.picture())).1;
    app.shows_at([160, 1000], &direct, upper, "nothing to mark");
    app.quit();
}

/// Insets show a light's map with texels as squares, and the depth image of the cache at the pointer. Saved pictures lack
/// them.
#[test]
fn insets_lie_in_a_corner() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_insets");
    let mut app = with_few_lights(&display, &folder);
    let (x, middle) = (160 + 135, [80, 300]);
    let plain = png(&folder.join(app.picture())).1;
    app.tap([160 + 60, 744], "");
    std::thread::sleep(Duration::from_millis(300));
    app.settle("");
    let [map, depth_image] = [849, 875];
    // The map has 32 x 32 texels. An inset may fill 40 % of the picture's width.
    let (corner, side) = ([160 - 12 - 64, 1000 - 12 - 64], 64);
    // The window once it differs from `before` and has come to rest. The pointer is moved off the panels first, so that
    // no tooltip lies over the picture.
    let shown = |app: &App, before: &[[u8; 3]], what: &str| {
        app.move_to(middle);
        let mut seen = app.changes([160, 1000], before, what);
        loop {
            std::thread::sleep(Duration::from_millis(500));
            let now = app.pixels([0, 0], [160, 1000]);
            if now == seen {
                return seen;
            }
            seen = now;
        }
    };
    let square = |seen: &[[u8; 3]]| -> Vec<[u8; 3]> {
        let at = |i: usize| (corner[1] + i / side) * 160 + corner[0] + i % side;
        (0..side * side).map(|i| seen[at(i)]).collect()
    };
    let mut seen = vec![plain.clone()];
    for entry in [3, 4, 5] {
        app.choose([x, map], entry, "");
        let now = shown(&app, &seen[seen.len() - 1], "an RSM");
        let inset = square(&now);
        for (i, pixel) in inset.iter().enumerate() {
            let first = i / side / 2 * 2 * side + i % side / 2 * 2;
            assert_eq!(*pixel, inset[first], "{entry}: pixel {i} of a texel of 2 x 2 pixels");
        }
        let kinds: std::collections::BTreeSet<_> = inset.iter().collect();
        assert!(kinds.len() > 2, "{entry}: {} colours", kinds.len());
        assert!(now[..160 * 800] == plain[..160 * 800], "{entry}: the picture around it must stay");
        seen.push(now);
    }
    app.choose([x, map], 2, "");
    let shadow = shown(&app, &seen[3], "the shadow map");
    assert!((1..4).all(|i| square(&seen[i]) != square(&shadow)), "the shadow map is another image");
    // Without a map a text says why.
    app.choose([x, 324], 5, "--shadow-map rays");
    let traced = png(&folder.join(app.picture())).1;
    let why = shown(&app, &shadow, "no map");
    // The text's background is black over the picture: nothing becomes brighter but the letters.
    let is_text = |seen: &[[u8; 3]], picture: &[[u8; 3]]| {
        let (seen, picture) = (square(seen), square(picture));
        let darker = |(a, b): (&[u8; 3], &[u8; 3])| a != b && (0..3).all(|c| a[c] <= b[c].max(1));
        let count = seen.iter().zip(&picture).filter(|(a, b)| darker((*a, *b))).count();
        let same = seen.iter().zip(&picture).filter(|(a, b)| a == b).count();
        count > 300 && same > 200
    };
    assert!(is_text(&why, &traced) && !is_text(&shadow, &plain), "only a text");
    app.choose([x, map], 1, "");
    app.choose([x, 324], 3, "");
    assert!(png(&folder.join(app.picture())).1 == plain, "insets must not change the picture");

    // Shadows per cache need no depth images.
    app.tap([160 + 112, depth_image], "");
    let why = shown(&app, &plain, "no depth image");
    assert!(is_text(&why, &plain), "only a text");
    app.choose([x, 246], 3, "--shadows per-light");
    let lit = png(&folder.join(app.picture())).1;
    let wall = shown(&app, &lit, "a depth image");
    app.move_to([80, 700]);
    std::thread::sleep(Duration::from_millis(500));
    let floor = app.changes([160, 1000], &wall, "the depth image of another cache");
    // 24 x 24 texels of 2 x 2 pixels.
    let inner = |seen: &[[u8; 3]]| -> Vec<[u8; 3]> {
        (0..48 * 48).map(|i| seen[(1000 - 12 - 48 + i / 48) * 160 + 160 - 12 - 48 + i % 48]).collect()
    };
    assert!(inner(&wall) != inner(&floor), "another cache sees something else");
    app.move_to(middle);
    app.shows_at([160, 1000], &wall, |i| i / 160 > 800, "the first cache again");
    assert!(png(&folder.join(app.picture())).1 == lit, "insets must not change the picture");
    app.quit();
}

/// Without a display the tool says in one line what to do instead.
#[test]
fn no_display_is_one_line() {
    let folder = folder("app_blind");
    // A scene file as the only argument opens the window, too.
    for argument in [Path::new("view"), &cornell()] {
        let out = Command::new(env!("CARGO_BIN_EXE_lightskin"))
            .arg(argument)
            .current_dir(&folder)
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .output()
            .expect("the tool runs");
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(1), "{said}");
        assert!(said.lines().count() == 1 && said.contains("display") && said.contains("`lightskin render`"), "{said}");
    }
}

/// A window has the settings of `render`, but draws frames only.
#[test]
fn a_window_is_not_path_traced() {
    fails(&folder("app_paths"), &["view", "--gi", "path-trace"], 2, &["--gi path-trace", "Space"]);
    fails(&folder("app_paths"), &["view", "--gi", "brute-force", "--bounces", "2"], 2, &["one bounce"]);
}
