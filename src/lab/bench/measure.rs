//! Frame times, and the limits of time and memory.

use crate::bake::{self, CacheSet, Density};
use crate::error::Result;
use crate::frame::{Exposure, View, Ways, World};
use crate::gpu::{FrameTimes, Gpu};
use crate::lab::eval::measure::medians;
use crate::lab::knobs::{Frame, Gi, Knobs};
use crate::scene::Scene;
use std::time::Instant;

/// Median times of one kind of frame.
pub struct Times {
    /// GPU time \[ms\] of each stage.
    pub stages: Vec<(String, f64)>,
    /// Missing and superfluous barriers, with `Validation::Sync`.
    pub problems: Vec<String>,
}

impl Times {
    /// All stages \[ms\].
    pub fn frame(&self) -> f64 {
        self.stages.iter().map(|s| s.1).sum()
    }

    /// One stage \[ms\].
    pub fn stage(&self, name: &str) -> Option<f64> {
        self.stages.iter().find(|s| s.0 == name).map(|s| s.1)
    }
}

/// A scene on the device.
pub struct OnDevice<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The scene.
    pub scene: &'a Scene,
    /// Its triangles and caches.
    pub world: World,
}

impl<'a> OnDevice<'a> {
    /// Uploads a scene.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn new(gpu: &'a Gpu, scene: &'a Scene, caches: Option<&CacheSet>) -> Result<Self> {
        Ok(Self { gpu, scene, world: World::new(gpu, scene, caches)? })
    }

    /// Creates the stages of a frame.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn frame(&self, knobs: &Knobs) -> Result<Frame> {
        Frame::new(self.gpu, self.scene, &self.world, knobs)
    }

    /// Draws `warm_up` frames that do not count, then `frames` that do.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn times(&self, frame: &mut Frame, warm_up: usize, frames: usize) -> Result<Times> {
        Ok(in_turn(&mut [(self, frame)], warm_up, frames)?.remove(0))
    }

    fn drawn(&self, frame: &mut Frame, problems: &mut Vec<String>) -> Result<FrameTimes> {
        let view = View::new(&self.scene.cameras[0], frame.picture.size(), self.world.origin, self.world.radius);
        // Software drivers attribute chained passes wrongly: submit each stage alone there.
        let drawn = self.gpu.timed_frame(|cmd| {
            frame.record(cmd, &self.world, &view);
            Ok(())
        })?;
        let times = self.gpu.times(&drawn)?;
        problems.extend(drawn.problems);
        Ok(times)
    }
}

/// Times of several frames that are compared: `warm_up` frames of each that do not count and `frames` that do. The
/// frames alternate, so that other load on the machine affects all of them.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn in_turn(compared: &mut [(&OnDevice<'_>, &mut Frame)], warm_up: usize, frames: usize) -> Result<Vec<Times>> {
    let mut runs: Vec<(Vec<FrameTimes>, Vec<String>)> = compared.iter().map(|_| Default::default()).collect();
    for i in 0..warm_up + frames {
        for ((world, frame), (runs, problems)) in compared.iter_mut().zip(&mut runs) {
            let times = world.drawn(frame, problems)?;
            if i >= warm_up {
                runs.push(times);
            }
        }
    }
    Ok(runs.into_iter().map(|(runs, problems)| Times { stages: medians(&runs), problems }).collect())
}

/// Settings of the thesis's frames. Exposure is fixed because the thesis measures none.
pub fn settings(size: [u32; 2], gi: Gi, rsm: u32, ways: Ways) -> Knobs {
    Knobs { gi, rsm, ways, exposure: Exposure::Ev(10.0), ..Knobs::plain(size) }
}

/// Bakes without the kept files; returns the caches and the time \[s\].
///
/// # Errors
/// As `bake::bake`.
pub fn bake(scene: &Scene, caches: usize, references: usize) -> Result<(CacheSet, f64)> {
    let density = Density::Count(caches);
    let settings = bake::BakeSettings { density, angle: 60_f32.to_radians(), references };
    let start = Instant::now();
    let set = bake::bake(scene, &settings, &|_, _| ())?;
    Ok((set, start.elapsed().as_secs_f64()))
}

/// Upper bound of the expected growth in time from one step to the next.
const MOST_GROWTH: f64 = 4.0;

/// Time budget of a table. The largest step so far predicts the time of a larger one.
pub struct Budget {
    start: Instant,
    limit: f64,
    last: Option<(f64, Instant)>,
}

impl Budget {
    /// A budget of this many seconds from now on.
    pub fn new(limit: f64) -> Self {
        Self { start: Instant::now(), limit, last: None }
    }

    /// Begins a step of this size, or returns why there is no time for it.
    pub fn begin(&mut self, size: f64) -> std::result::Result<(), String> {
        let now = Instant::now();
        // Much of a small step's time is constant: limit the expected growth.
        let expected =
            self.last.map_or(0.0, |(last, since)| (now - since).as_secs_f64() * (size / last).min(MOST_GROWTH));
        let left = self.limit - (now - self.start).as_secs_f64();
        if expected <= left {
            self.last = Some((size, now));
            return Ok(());
        }
        Err(format!("would take about {expected:.0} s, and {:.0} s are left for this table", left.max(0.0)))
    }
}

/// Peak host memory \[bytes\] per triangle of a generated scene in five versions, including those on a software device;
/// slightly more than measured.
const BYTES_PER_TRIANGLE: u64 = 1300;

/// Returns why there is no memory for this many triangles; `None` if there is, or if the system does not tell.
pub fn too_large(triangles: usize) -> Option<String> {
    let needed = triangles as u64 * BYTES_PER_TRIANGLE;
    let free = free_memory()?;
    let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
    (needed > free).then(|| format!("needs about {:.1} GiB of memory, and {:.1} GiB are free", gib(needed), gib(free)))
}

/// Memory \[bytes\] available to programs; known on Linux only.
fn free_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(1024 * line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?)
}
