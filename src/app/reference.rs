//! Sources of references: the path tracer in the background, first coarse, then pass after pass; and brute force on the
//! device, a few blocks of pixels per frame.

use super::background::{Rest, Thread, alone};
use super::compare::{Now, read};
use anyhow::Result;
use lightskin::frame::brute_force::blocks;
use lightskin::frame::{Engine, Light, Look, Part, Picture, Settings, record_part};
use lightskin::gpu::Gpu;
use lightskin::metrics::display::Values;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::{Camera, Scene};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Factors by which the first passes are smaller than the picture.
const COARSE: [u32; 3] = [8, 4, 2];

/// A path trace that runs in the background.
pub(super) struct Trace {
    thread: JoinHandle<()>,
    told: Arc<Told>,
}

/// State shared with the thread.
#[derive(Default)]
struct Told {
    stop: AtomicBool,
    newest: Mutex<Option<Traced>>,
    /// Finished pixels of the current pass, and all its pixels.
    pixels: [AtomicU32; 2],
}

/// The result of a path trace so far.
pub(super) struct Traced {
    /// Radiance [cd/m^2], row by row from the top.
    pub(super) rgb: Vec<[f32; 3]>,
    /// Samples per pixel. `None` if the picture is still coarse.
    pub(super) samples: Option<u32>,
    /// Mean relative standard error.
    pub(super) noise: f64,
}

impl Trace {
    /// Starts a path trace that ends after `most` samples per pixel.
    pub(super) fn start(scene: Arc<Scene>, camera: Camera, settings: PathTraceSettings, most: u32, rest: Rest) -> Self {
        let told = Arc::new(Told::default());
        let of_thread = told.clone();
        let thread = std::thread::spawn(move || alone(|| of_thread.trace(&scene, &camera, settings, most, &rest)));
        Self { thread, told }
    }

    /// Takes the newest result, if there is one since the last call.
    pub(super) fn newest(&self) -> Option<Traced> {
        self.told.newest.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Progress of the current pass from 0 to 1.
    pub(super) fn progress(&self) -> f32 {
        let [done, all] = self.told.pixels.each_ref().map(|n| n.load(Ordering::Relaxed));
        done as f32 / all.max(1) as f32
    }

    /// Requests the thread to stop. It does so within a moment.
    pub(super) fn stop(&self) {
        self.told.stop.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_over(&self) -> bool {
        self.thread.is_finished()
    }
}

impl Drop for Trace {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Told {
    fn trace(&self, scene: &Scene, camera: &Camera, settings: PathTraceSettings, most: u32, rest: &Rest) {
        let stopped = || self.stop.load(Ordering::Relaxed);
        rest.wait(stopped);
        let size = settings.size;
        let mut trace = PathTrace::new(scene, camera, &settings);
        let coarse = COARSE.into_iter().filter(|by| size[0] / by >= 64);
        for by in coarse.chain([1]) {
            let small = size.map(|side| side.div_ceil(by));
            trace.resize(small);
            while trace.samples() == 0 || (by == 1 && trace.samples() < most && !trace.is_exact()) {
                self.pixels[0].store(0, Ordering::Relaxed);
                self.pixels[1].store(small[0] * small[1], Ordering::Relaxed);
                let whole = trace.pass_while(&|| {
                    rest.wait(stopped);
                    self.pixels[0].fetch_add(1, Ordering::Relaxed);
                    !stopped()
                });
                if !whole {
                    return;
                }
                let rgb = enlarged(&sum(&trace), small, size, by);
                let samples = (by == 1).then(|| trace.samples());
                let traced = Traced { rgb, samples, noise: trace.noise() };
                *self.newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(traced);
            }
        }
    }
}

/// Total radiance.
fn sum(trace: &PathTrace<'_>) -> Vec<[f32; 3]> {
    let mut all = trace.direct();
    for layer in [trace.diffuse(), trace.glossy()] {
        all.iter_mut().zip(layer).for_each(|(all, one)| (0..3).for_each(|c| all[c] += one[c]));
    }
    all
}

/// Enlarges each pixel `by` times.
fn enlarged(rgb: &[[f32; 3]], [small, _]: [u32; 2], [width, height]: [u32; 2], by: u32) -> Vec<[f32; 3]> {
    let at = |x: u32, y: u32| rgb[(y / by * small + x / by) as usize];
    (0..height).flat_map(|y| (0..width).map(move |x| at(x, y))).collect()
}

/// Target for the time that one step of brute force holds up the window.
const PART: Duration = Duration::from_millis(40);

/// An unfinished brute-force picture of the current view.
pub(super) struct BruteForce {
    settings: Settings,
    size: [u32; 2],
    state: State,
    /// The number of blocks for the next step.
    blocks: u32,
}

/// How far a brute-force picture is.
enum State {
    /// A thread makes the pipelines that are missing.
    Pipelines(Thread<()>),
    /// This part is drawn next.
    Draws(Box<(Light, Picture)>, Part),
    /// A thread reads the radiance back.
    Reads(Thread<Vec<[f32; 3]>>),
}

impl BruteForce {
    pub(super) fn new(gpu: &Gpu, now: &Now<'_>, settings: &Settings, rest: &Rest) -> Result<Self> {
        let size = now.picture.size();
        let missing = now.engine.missing(gpu, settings, Some(size))?;
        let (device, rest) = (gpu.device().clone(), rest.clone());
        let make = move || if missing.is_empty() { Ok(()) } else { rest.first(|| Ok(device.make(missing)?)) };
        Ok(Self { settings: *settings, size, state: State::Pipelines(Thread::start(make)), blocks: 1 })
    }

    /// Whether its light was created for the scene on the device.
    pub(super) fn fits(&self, engine: &Engine) -> bool {
        if let State::Draws(made, _) = &self.state { made.0.fits(engine.world()) } else { true }
    }

    /// Whether the next step should follow at once. Otherwise it waits for a thread.
    pub(super) fn hurries(&self) -> bool {
        matches!(self.state, State::Draws(..))
    }

    /// Progress from 0 to 1.
    pub(super) fn progress(&self) -> f32 {
        match &self.state {
            State::Draws(_, Part::Blocks(next)) => next.start as f32 / blocks(self.size).max(1) as f32,
            State::Pipelines(_) | State::Draws(..) => 0.0,
            State::Reads(_) => 1.0,
        }
    }

    /// Draws the next part: the stages before brute force, then blocks, as many as fit in `PART`. Returns the radiance
    /// after the last part.
    pub(super) fn step(
        &mut self,
        gpu: &Gpu,
        now: &Now<'_>,
        problems: &mut Vec<String>,
    ) -> Result<Option<Vec<[f32; 3]>>> {
        let (light, picture, part) = match &mut self.state {
            State::Pipelines(thread) => {
                if thread.is_finished() {
                    std::mem::take(thread).join()?;
                    let (engine, world) = (now.engine, now.engine.world());
                    let light = Light::new(gpu, engine.scene(), world, &self.settings, 1)?;
                    let picture = Picture::new(gpu, world, &light, self.size)?;
                    self.state = State::Draws(Box::new((light, picture)), Part::Before);
                }
                return Ok(None);
            }
            State::Reads(thread) => {
                return if thread.is_finished() { std::mem::take(thread).join().map(Some) } else { Ok(None) };
            }
            State::Draws(made, part) => (&mut made.0, &mut made.1, part),
        };
        let begin = Instant::now();
        let frame = gpu.frame(|cmd| {
            record_part(cmd, now.engine.world(), light, &mut [(now.view, picture)], &Look::default(), part);
            Ok(())
        })?;
        gpu.wait()?;
        problems.extend(frame.problems);
        let mut first = 0;
        if let Part::Blocks(drawn) = part {
            let faster = PART.as_secs_f64() / begin.elapsed().as_secs_f64().max(1e-4);
            self.blocks = ((f64::from(self.blocks) * faster.clamp(0.25, 4.0)) as u32).max(1);
            first = drawn.end;
        }
        if first < blocks(self.size) {
            *part = Part::Blocks(first..first.saturating_add(self.blocks));
        } else {
            let wait = read(gpu, picture, Values::Radiance)?;
            self.state = State::Reads(Thread::start(wait));
        }
        Ok(None)
    }
}
