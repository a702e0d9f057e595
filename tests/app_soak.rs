//! A monkey test of the window: random keys, buttons, sizes and files for a given time. `scripts/soak` runs it.

use crate::cli::folder;
use crate::common::window::{App, Display, KEYS, SMALL, cornell};
use std::time::{Duration, Instant};

/// How many times memory is measured.
const MEASURED: u32 = 8;

/// Xorshift random numbers. The same seed gives the same numbers.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % end
    }

    /// A random place in the window, below the panels' third row. The controls above can ask for more caches than a
    /// software device lights in a minute.
    fn place(&mut self, [width, height]: [u64; 2]) -> [i16; 2] {
        [self.below(width) as i16, (180 + self.below(height.saturating_sub(180).max(1))) as i16]
    }
}

fn asked(name: &str, usual: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// Fails on a panic, a message of the validation layer, a hang or growing memory. Prints its seed.
#[test]
#[ignore = "takes minutes; scripts/soak runs it"]
fn a_monkey_breaks_nothing() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_soak");
    let (minutes, seed) = (asked("LIGHTSKIN_SOAK_MINUTES", 10), asked("LIGHTSKIN_SOAK_SEED", 1));
    println!("{minutes} minutes with seed {seed}");
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let scene = cornell();
    let path = scene.to_str().expect("a path");
    let mut app = App::start(&display, &folder, &[&["-vv", "view", path, "--size", "160x120"], &SMALL[..]].concat());
    app.line("scene");
    let mut size = [480, 600];
    app.resize(480, 600);
    // Memory is measured with the initial scene and settings and a fixed size. This session file restores them.
    app.press_with("Control", "S");
    let session = folder.join(app.line("session").split_whitespace().last().expect("a name"));
    let (start, mut steps, mut most) = (Instant::now(), 0_u64, Duration::ZERO);
    let mut measured = Vec::new();
    while start.elapsed() < Duration::from_secs(60 * minutes) {
        for _ in 0..20 {
            steps += 1;
            match random.below(20) {
                0..=6 => app.click(1, random.place(size)),
                7..=9 => app.drag([1, 1, 2, 3][random.below(4) as usize], random.place(size), random.place(size)),
                10 => app.click(4 + random.below(2) as u8, random.place(size)),
                11..=15 => {
                    let key = KEYS[random.below(KEYS.len() as u64) as usize].0;
                    // `press` releases the key again. Control is never held here, because Control+Q would close the
                    // window.
                    app.press(key);
                }
                16 => app.press_with("Control", ["1", "2", "S", "C", "O"][random.below(5) as usize]),
                17 => {
                    size = [200 + random.below(500), 100 + random.below(700)];
                    app.resize(size[0] as u32, size[1] as u32);
                }
                18 if random.below(8) == 0 => {
                    let name = ["cornell_diffuse.glb", "cornell_glossy.glb"][random.below(2) as usize];
                    app.drop_file(&scene.with_file_name(name));
                }
                _ => std::thread::sleep(Duration::from_millis(random.below(400))),
            }
        }
        // The window must answer.
        let asked = Instant::now();
        app.command();
        most = most.max(asked.elapsed());
        if start.elapsed() >= Duration::from_secs(60 * minutes) * (measured.len() as u32 + 1) / MEASURED {
            let busy = app.memory();
            app.drop_file(&session);
            app.line("scene");
            app.resize(480, 600);
            app.command();
            // If the panels are hidden, the picture fills their space. Tab shows them again.
            if app.command().contains("480x600") {
                app.press("Tab");
            }
            std::thread::sleep(Duration::from_secs(2));
            app.command();
            let held = app.told(" Counters { ").pop().unwrap_or_default();
            let held = held.split_once(" Counters ").map_or("", |(_, held)| held);
            measured.push(app.memory());
            println!("{:.0} s: {busy} MiB, {} MiB at rest {held}", start.elapsed().as_secs_f64(), app.memory());
            size = [480, 600];
        }
    }
    println!("{steps} steps, longest answer {:.1} s; longest delays beyond a frame:", most.as_secs_f64());
    let mut held = app.held();
    held.sort_by(|a, b| b.0.total_cmp(&a.0));
    held.iter().take(5).for_each(|(_, line)| println!("{line}"));
    let least = |part: &[u64]| part.iter().min().copied().expect("measured");
    let (first, second) = measured.split_at(measured.len() / 2);
    let grown = least(second) as f64 / least(first) as f64;
    assert!(grown < 1.2, "memory at rest grows: {measured:?} MiB");
    app.quit();
}

/// `frames` frames of this size with a moving camera create no descriptor set, pool, pipeline or resource, and take no
/// memory.
fn frames_leave_nothing(name: &str, frames: u64, size: &str) {
    let scene = cornell().with_file_name("cornell_diffuse.glb");
    let scene = scene.to_str().expect("a path");
    let Some(display) = Display::open() else { return };
    let folder = folder(name);
    let words = ["-vv", "view", scene, "--size", size, "--no-panels", "--max-edge", "0"];
    let light = ["--caches", "30", "--quality", "low", "--rsm", "32", "--shadow-map", "128", "--validation", "sync"];
    let mut app = App::start(&display, &folder, &[&words[..], &light].concat());
    app.line("scene");
    let start = Instant::now();
    let [before, after] = app.fly(frames);
    let (seconds, memory) = (start.elapsed().as_secs_f64(), before["memory"]);
    println!("{} frames in {seconds:.1} s, {memory} to {} MiB, {after:?}", after["frames"], app.memory());
    for name in ["pipelines_made", "pipelines_kept", "sets", "pools", "resources", "allocated_bytes"] {
        assert!(after[name] <= before[name], "{name} grow: {before:?} to {after:?}");
    }
    assert!(app.memory() <= memory + 4, "{memory} to {} MiB", app.memory());
    app.quit();
}

#[test]
fn a_thousand_frames_leave_nothing_behind() {
    frames_leave_nothing("app_frames_1000", 1000, "160x120");
}

#[test]
#[ignore = "takes minutes; scripts/soak runs it"]
fn large_frames_leave_nothing_behind() {
    frames_leave_nothing("app_frames_large", 300, "1280x720");
}
