//! A monkey at the window: random keys, buttons, sizes and files for as long as it is asked to. `scripts/soak` runs it.

use crate::cli::folder;
use crate::common::window::{App, Display, KEYS, SMALL, cornell};
use std::time::{Duration, Instant};

/// Random numbers, the same for the same seed: xorshift.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % end
    }

    /// A place in the window. Above the third row of the panels controls ask for more caches than a software device lights in a minute.
    fn place(&mut self, [width, height]: [u64; 2]) -> [i16; 2] {
        [self.below(width) as i16, (180 + self.below(height.saturating_sub(180).max(1))) as i16]
    }
}

fn asked(name: &str, usual: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// No panic, no message of the validation layer, no hang and no growth of memory. The seed is printed.
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
    let mut app = App::start(&display, &folder, &[&["view", path, "--size", "160x120"], &SMALL[..]].concat());
    app.line("scene");
    let mut size = [480, 600];
    app.resize(480, 600);
    let (start, mut steps, mut settled, mut most) = (Instant::now(), 0_u64, None, Duration::ZERO);
    while start.elapsed() < Duration::from_secs(60 * minutes) {
        for _ in 0..20 {
            steps += 1;
            match random.below(20) {
                0..=6 => app.click(1, random.place(size)),
                7..=9 => app.drag([1, 1, 2, 3][random.below(4) as usize], random.place(size), random.place(size)),
                10 => app.click(4 + random.below(2) as u8, random.place(size)),
                11..=15 => {
                    let key = KEYS[random.below(KEYS.len() as u64) as usize].0;
                    // What is held is let go of; Control with Q would be the end.
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
        // It answers.
        let asked = Instant::now();
        app.command();
        most = most.max(asked.elapsed());
        // Pipelines of all kinds are there after a while.
        if start.elapsed() > Duration::from_secs(20 * minutes) {
            settled = settled.or(Some(app.memory()));
        }
    }
    let (before, after) = (settled.unwrap_or_else(|| app.memory()), app.memory());
    println!(
        "{steps} steps, longest answer {:.1} s, memory {before} MiB after a third, {after} MiB at the end",
        most.as_secs_f64()
    );
    assert!(after < before + before / 2 + 64, "memory grows: {before} to {after} MiB");
    app.quit();
}
