//! Where the time of a frame of the window goes, for the log.

use std::time::{Duration, Instant};

/// The name of the part of a frame in which the device draws. Input waits for it in any case.
pub(super) const FRAME: &str = "frame";

/// The time of some work, split into parts.
pub(super) struct Spent {
    last: Instant,
    parts: Vec<(&'static str, Duration)>,
}

impl Spent {
    pub(super) fn new() -> Self {
        Self { last: Instant::now(), parts: Vec::new() }
    }

    /// Adds the time since the end of the last part to this part.
    pub(super) fn on(&mut self, part: &'static str) {
        let now = Instant::now();
        let time = now - self.last;
        self.last = now;
        match self.parts.iter_mut().find(|(name, _)| *name == part) {
            Some((_, sum)) => *sum += time,
            None => self.parts.push((part, time)),
        }
    }

    /// Logs how long the work held input up, how much of this was beyond the frame, and the parts.
    pub(super) fn log(&self, what: &str) {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let sum = |counts: &dyn Fn(&str) -> bool| {
            let times = self.parts.iter().filter(|(name, _)| counts(name)).map(|(_, time)| *time);
            ms(times.sum())
        };
        let (all, beyond) = (sum(&|_| true), sum(&|name| name != FRAME));
        let parts: Vec<_> = self.parts.iter().map(|(name, time)| format!("{name} {:.1}", ms(*time))).collect();
        log::debug!("{what} held input for {all:.1} ms, {beyond:.1} ms of them beyond the frame: {}", parts.join(", "));
    }
}
