//! Work beside the frames: one thread at a time, which rests while the user moves something.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How long work rests after the last input.
const REST: Duration = Duration::from_millis(300);

/// How long it rests at most between two steps of a bake: who moves the camera for minutes gets caches, too.
const LONGEST: Duration = Duration::from_secs(2);

/// Tells work when to rest. All copies are one.
#[derive(Clone)]
pub(super) struct Rest {
    start: Instant,
    /// When the last input came [ms since the start].
    touched: Arc<AtomicU64>,
    /// Works that others have to wait for.
    held: Arc<AtomicU32>,
}

impl Rest {
    pub(super) fn new() -> Self {
        Self { start: Instant::now(), touched: Arc::default(), held: Arc::default() }
    }

    /// There was input just now.
    pub(super) fn touch(&self) {
        self.touched.store(self.start.elapsed().as_millis() as u64, Ordering::Relaxed);
    }

    /// Whether the last input was long enough ago.
    pub(super) fn is_over(&self) -> bool {
        let now = self.start.elapsed().as_millis() as u64;
        now.saturating_sub(self.touched.load(Ordering::Relaxed)) >= REST.as_millis() as u64
    }

    /// Waits until the user rests and nothing else works that comes first, or this says to end.
    pub(super) fn wait(&self, ends: impl Fn() -> bool) {
        while !ends() && (!self.is_over() || self.held.load(Ordering::Relaxed) > 0) {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until the user rests, but for a few seconds at most: there is always an end to work that was asked for.
    pub(super) fn pause(&self) {
        let start = Instant::now();
        while !self.is_over() && start.elapsed() < LONGEST {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Runs work that was asked for, on this thread alone, before all that waits.
    pub(super) fn first<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.held.fetch_add(1, Ordering::Relaxed);
        let done = alone(work);
        self.held.fetch_sub(1, Ordering::Relaxed);
        done
    }
}

/// Runs work on one thread, also what of it would spread over all cores.
pub(super) fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}
