//! Background work: one thread at a time, which pauses while the user moves something; and threads that must end before the
//! device closes.

use anyhow::{Result, anyhow};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long work pauses after the last input.
const REST: Duration = Duration::from_millis(300);

/// Longest pause between two steps of a bake. It makes a bake finish even if the camera moves for minutes.
const LONGEST: Duration = Duration::from_secs(2);

/// Controls when background work pauses. All clones share their state.
#[derive(Clone)]
pub(super) struct Rest {
    start: Instant,
    /// Time of the last input [ms since the start].
    touched: Arc<AtomicU64>,
    /// Number of running jobs with priority.
    held: Arc<AtomicU32>,
}

impl Rest {
    pub(super) fn new() -> Self {
        Self { start: Instant::now(), touched: Arc::default(), held: Arc::default() }
    }

    /// Records that there was input.
    pub(super) fn touch(&self) {
        self.touched.store(self.start.elapsed().as_millis() as u64, Ordering::Relaxed);
    }

    /// Whether the last input was long enough ago.
    pub(super) fn is_over(&self) -> bool {
        let now = self.start.elapsed().as_millis() as u64;
        now.saturating_sub(self.touched.load(Ordering::Relaxed)) >= REST.as_millis() as u64
    }

    /// Waits until there is no recent input and no job with priority runs, or until `ends` returns true.
    pub(super) fn wait(&self, ends: impl Fn() -> bool) {
        while !ends() && (!self.is_over() || self.held.load(Ordering::Relaxed) > 0) {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until there is no recent input, at most `LONGEST`, so that requested work always finishes.
    pub(super) fn pause(&self) {
        let start = Instant::now();
        while !self.is_over() && start.elapsed() < LONGEST {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Runs requested work on one thread. It has priority over work that calls `wait`.
    pub(super) fn first<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        struct Held<'a>(&'a AtomicU32);
        impl Drop for Held<'_> {
            fn drop(&mut self) {
                self.0.fetch_sub(1, Ordering::Relaxed);
            }
        }
        self.held.fetch_add(1, Ordering::Relaxed);
        let _held = Held(&self.held); // also if the work panics
        alone(work)
    }
}

/// Runs work on one thread, including parts that would otherwise use all cores.
pub(super) fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

/// A thread that uses the device, which must not be closed before it ends. So dropping this waits.
pub(super) struct Thread<T>(Option<JoinHandle<Result<T>>>);

impl<T> Default for Thread<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T: Send + 'static> Thread<T> {
    pub(super) fn start(work: impl FnOnce() -> Result<T> + Send + 'static) -> Self {
        Self(Some(std::thread::spawn(work)))
    }

    pub(super) fn is_finished(&self) -> bool {
        self.0.as_ref().is_none_or(JoinHandle::is_finished)
    }

    pub(super) fn join(mut self) -> Result<T> {
        self.0.take().map_or_else(|| Err(anyhow!("joined twice")), joined)
    }
}

impl<T> Drop for Thread<T> {
    fn drop(&mut self) {
        if let Some(thread) = self.0.take() {
            drop(thread.join());
        }
    }
}

/// The result of a thread.
pub(super) fn joined<T>(thread: JoinHandle<Result<T>>) -> Result<T> {
    thread.join().map_err(|_| anyhow!("a background job panicked; this is a bug of lightskin"))?
}
