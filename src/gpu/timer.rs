//! Times of a frame: what the device's timestamps and the CPU's clock say of its zones.

use std::time::Instant;

/// Zones per frame that are timed on the device; further ones have CPU times alone.
pub(crate) const MAX_ZONES: u32 = 64;

/// From when to when \[ms\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Span {
    /// Beginning.
    pub begin_ms: f64,
    /// End; not before the beginning.
    pub end_ms: f64,
}

impl Span {
    /// How long \[ms\].
    pub fn ms(self) -> f64 {
        self.end_ms - self.begin_ms
    }
}

/// What the CPU does for a frame besides the zones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Waiting for the device.
    Wait,
    /// Recording commands; a split frame's submissions and waits lie inside.
    Record,
    /// Handing commands to the driver.
    Submit,
}

/// One zone of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ZoneTime {
    /// The stage's name.
    pub name: &'static str,
    /// Zones around this one.
    pub depth: u32,
    /// On the device, since the frame's first stamp; `None` where the queue has no timestamps.
    pub gpu: Option<Span>,
    /// Its recording on the CPU, since the frame began.
    pub cpu: Span,
}

/// All zones of one name in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageTime {
    /// The stage's name.
    pub name: &'static str,
    /// GPU time \[ms\]; `None` where a zone has none.
    pub gpu_ms: Option<f64>,
    /// CPU time of recording \[ms\].
    pub cpu_ms: f64,
}

/// Times of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTimes {
    /// Which frame of this device, from 0.
    pub number: u64,
    /// Whether each zone was submitted alone. A zone around others then holds the waits between them, too.
    pub split: bool,
    /// When the CPU began with it.
    pub begin: Instant,
    /// The frame's first stamp on the device's clock \[ms\], which has a zero of its own.
    pub first_stamp_ms: Option<f64>,
    /// Zones in the order in which they open.
    pub zones: Vec<ZoneTime>,
    /// The CPU's work, since the frame began.
    pub work: Vec<(Work, Span)>,
}

impl FrameTimes {
    /// How the device's times were taken.
    pub fn way(&self) -> &'static str {
        match (self.first_stamp_ms, self.split) {
            (None, _) => "no GPU times: the queue has no timestamps",
            (_, true) => "each stage submitted alone",
            (_, false) => "timestamps within one submission",
        }
    }

    /// Time of each stage in the order of the frame; zones of the same name are summed.
    pub fn stages(&self) -> Vec<StageTime> {
        let mut stages: Vec<StageTime> = Vec::with_capacity(self.zones.len());
        for zone in &self.zones {
            let (gpu_ms, cpu_ms) = (zone.gpu.map(Span::ms), zone.cpu.ms());
            match stages.iter_mut().find(|s| s.name == zone.name) {
                Some(s) => (s.gpu_ms, s.cpu_ms) = (s.gpu_ms.zip(gpu_ms).map(|(a, b)| a + b), s.cpu_ms + cpu_ms),
                None => stages.push(StageTime { name: zone.name, gpu_ms, cpu_ms }),
            }
        }
        stages
    }

    /// GPU time \[ms\] of the whole frame: the sum of its outermost zones.
    pub fn gpu_ms(&self) -> Option<f64> {
        self.zones.iter().filter(|z| z.depth == 0).map(|z| z.gpu.map(Span::ms)).sum()
    }

    /// From the first stamp to the last \[ms\]: what lies between the zones counts as well.
    pub fn gpu_span_ms(&self) -> Option<f64> {
        self.zones.iter().filter_map(|z| z.gpu).map(|g| g.end_ms).reduce(f64::max)
    }

    /// CPU time \[ms\] of one kind of work; that of recording without what was submitted and waited for in between.
    pub fn cpu_ms(&self, of: Work) -> f64 {
        let sum = |what: Work| self.work.iter().filter(move |(w, _)| *w == what).map(|(_, s)| s.ms()).sum::<f64>();
        let Some((_, record)) = self.work.iter().find(|(w, _)| *w == Work::Record && of == Work::Record) else {
            return sum(of);
        };
        let inside = self
            .work
            .iter()
            .filter(|(w, s)| *w != Work::Record && s.begin_ms >= record.begin_ms && s.end_ms <= record.end_ms);
        (record.ms() - inside.map(|(_, s)| s.ms()).sum::<f64>()).max(0.0)
    }

    /// From the beginning of the frame to the end of the CPU's last work for it \[ms\].
    pub fn cpu_span_ms(&self) -> f64 {
        self.work.iter().map(|(_, s)| s.end_ms).fold(0.0, f64::max)
    }
}

/// The queue's timestamps: unit and valid bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    /// Nanoseconds of a tick.
    pub(crate) period_ns: f64,
    /// Bits of a stamp that count, the others are anything; 0 where the queue has no timestamps.
    pub(crate) bits: u32,
}

impl Clock {
    /// Milliseconds between two stamps.
    fn ms(&self, from: u64, to: u64) -> f64 {
        ticks_between(from, to, self.bits) as f64 * self.period_ns * 1e-6
    }
}

/// Ticks from one stamp to another; negative if the other is earlier. Only the lowest `bits` (1 to 64) of a stamp count
/// and they wrap around: right for stamps less than half their range apart (36 bits of 1 ns, the least that Vulkan
/// allows: 34 s).
pub fn ticks_between(from: u64, to: u64, bits: u32) -> i64 {
    let unused = 64 - bits;
    (to.wrapping_sub(from) << unused).cast_signed() >> unused
}

/// Places the stamps of all frames on one line, across wrap-arounds.
#[derive(Debug, Default)]
pub(crate) struct Line {
    last: Option<u64>,
    ms: f64,
}

impl Line {
    /// Where a stamp lies \[ms\]; it must be less than half the range from the one before.
    fn place(&mut self, clock: &Clock, stamp: u64) -> f64 {
        self.ms += self.last.map_or(0.0, |last| clock.ms(last, stamp));
        self.last = Some(stamp);
        self.ms
    }
}

/// A zone as it is recorded.
#[derive(Debug)]
pub(crate) struct Recorded {
    pub(crate) name: &'static str,
    pub(crate) depth: u32,
    pub(crate) timed: bool,
    pub(crate) cpu: Span,
}

/// What is noted of a frame while it is recorded.
#[derive(Debug)]
pub(crate) struct Notes {
    pub(crate) number: u64,
    pub(crate) split: bool,
    pub(crate) begin: Instant,
    /// Zones that are open.
    pub(crate) depth: u32,
    pub(crate) zones: Vec<Recorded>,
    pub(crate) work: Vec<(Work, Span)>,
}

impl Notes {
    /// Since the frame began \[ms\].
    pub(crate) fn now(&self) -> f64 {
        self.begin.elapsed().as_secs_f64() * 1e3
    }

    /// Notes a piece of work that began at `begin_ms` and ends now.
    pub(crate) fn worked(&mut self, what: Work, begin_ms: f64) {
        let end_ms = self.now();
        self.work.push((what, Span { begin_ms, end_ms }));
    }

    /// Times with the stamps of the zones, a pair for each timed one.
    pub(crate) fn times(&self, stamps: &[u64], clock: &Clock, line: &mut Line) -> FrameTimes {
        let first = stamps.first().copied();
        let mut pairs = stamps.chunks_exact(2);
        let zone = |zone: &Recorded| {
            let pair = if zone.timed { pairs.next().zip(first) } else { None };
            let gpu = pair.map(|(pair, first)| {
                let begin_ms = clock.ms(first, pair[0]).max(0.0);
                Span { begin_ms, end_ms: clock.ms(first, pair[1]).max(begin_ms) }
            });
            ZoneTime { name: zone.name, depth: zone.depth, gpu, cpu: zone.cpu }
        };
        FrameTimes {
            number: self.number,
            split: self.split,
            begin: self.begin,
            first_stamp_ms: first.map(|stamp| line.place(clock, stamp)),
            zones: self.zones.iter().map(zone).collect(),
            work: self.work.clone(),
        }
    }
}

/// The smallest of the sorted values that at least `percent` of them do not exceed: the nearest-rank percentile.
pub fn nearest_rank(sorted: &[f64], percent: f64) -> f64 {
    let rank = (percent / 100.0 * sorted.len() as f64).ceil() as usize;
    sorted[rank.clamp(1, sorted.len()) - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two frames of a queue with 36 valid bits and ticks of 2 ns; the counter wraps inside the first, and the bits above
    /// it hold anything.
    #[test]
    fn frames_lie_on_one_line_across_a_wrap() {
        let clock = Clock { period_ns: 2.0, bits: 36 };
        let mut line = Line::default();
        let zone = |name, depth| Recorded { name, depth, timed: true, cpu: Span::default() };
        let mut notes = Notes {
            number: 0,
            split: false,
            begin: Instant::now(),
            depth: 0,
            zones: vec![zone("outer", 0), zone("inner", 1)],
            work: Vec::new(),
        };
        let wrap = 1_u64 << 36;
        let (a, b) = (wrap - 1_000_000, 0xabc << 36);
        let first = notes.times(&[a, b | 3_000_000, wrap - 500_000, b | 1_000_000], &clock, &mut line);
        assert_eq!(first.first_stamp_ms, Some(0.0));
        assert_eq!(first.zones[0].gpu, Some(Span { begin_ms: 0.0, end_ms: 8.0 }));
        assert_eq!(first.zones[1].gpu, Some(Span { begin_ms: 1.0, end_ms: 4.0 }));
        assert_eq!((first.gpu_ms(), first.gpu_span_ms()), (Some(8.0), Some(8.0)));
        // The next frame, and then one from before the wrap that was read late.
        notes.zones.truncate(1);
        assert_eq!(notes.times(&[4_000_000, 5_000_000], &clock, &mut line).first_stamp_ms, Some(10.0));
        assert_eq!(notes.times(&[a - 1_000_000, a], &clock, &mut line).first_stamp_ms, Some(-2.0));
        // An end before its beginning, as no queue should give it, takes no time instead of an age.
        let odd = notes.times(&[100, 90], &clock, &mut line);
        assert_eq!(odd.gpu_ms(), Some(0.0));
    }
}
