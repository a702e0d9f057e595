//! Where the time of a frame of the window goes, for the log.

use std::fmt;
use std::time::{Duration, Instant};

/// The name of the part of a frame in which the device draws. Input waits for it in any case.
pub(super) const FRAME: &str = "frame";

/// The time since the begin of some work, split into parts.
pub(super) struct Spent {
    begin: Instant,
    last: Instant,
    parts: Vec<(&'static str, Duration)>,
}

impl Spent {
    pub(super) fn new() -> Self {
        let now = Instant::now();
        Self { begin: now, last: now, parts: Vec::with_capacity(8) }
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
        log::debug!("{what} held input for {self}");
    }
}

impl fmt::Display for Spent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let all = self.last - self.begin;
        let frame: Duration = self.parts.iter().filter(|(name, _)| *name == FRAME).map(|(_, time)| *time).sum();
        write!(f, "{:.1} ms, {:.1} ms of them beyond the frame", ms(all), ms(all - frame))?;
        for (index, (name, time)) in self.parts.iter().enumerate() {
            write!(f, "{} {name} {:.1}", if index == 0 { ":" } else { "," }, ms(*time))?;
        }
        Ok(())
    }
}
