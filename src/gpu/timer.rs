//! Times of a frame's zones, from the device's timestamps and the CPU's clock.

use std::time::Instant;

/// Maximum number of zones per frame that are timed on the device; further zones have CPU times only.
pub(crate) const MAX_ZONES: u32 = 192;

/// Number of these that single shaders leave to stages.
pub(crate) const STAGE_ZONES: u32 = 64;

/// A time interval \[ms\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Span {
    /// Start.
    pub begin_ms: f64,
    /// End; never before the start.
    pub end_ms: f64,
}

impl Span {
    /// Duration \[ms\].
    pub fn ms(self) -> f64 {
        self.end_ms - self.begin_ms
    }
}

/// CPU work for a frame, besides the zones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Waiting for the device.
    Wait,
    /// Recording commands. It includes a split frame's submissions and waits.
    Record,
    /// Submitting commands to the driver.
    Submit,
}

/// One zone of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ZoneTime {
    /// Name of the stage.
    pub name: &'static str,
    /// Number of zones around this one.
    pub depth: u32,
    /// Whether it is a single dispatch of a compute shader within a stage.
    pub is_shader: bool,
    /// Time on the device, relative to the frame's first timestamp; `None` if the queue has no timestamps.
    pub gpu: Option<Span>,
    /// Time of its recording on the CPU, relative to the start of the frame.
    pub cpu: Span,
}

/// All zones of one name in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageTime {
    /// Name of the stage.
    pub name: &'static str,
    /// GPU time \[ms\]; `None` if any of the zones has none.
    pub gpu_ms: Option<f64>,
    /// CPU time of recording \[ms\].
    pub cpu_ms: f64,
}

/// Times of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTimes {
    /// Number of the frame on this device, from 0.
    pub number: u64,
    /// Whether each zone was submitted alone. Outer zones then include the waits between inner ones.
    pub split: bool,
    /// When the CPU started the frame.
    pub begin: Instant,
    /// The frame's first timestamp on the device's clock \[ms\], which has its own zero.
    pub first_stamp_ms: Option<f64>,
    /// Zones in the order in which they open.
    pub zones: Vec<ZoneTime>,
    /// CPU work, relative to the start of the frame.
    pub work: Vec<(Work, Span)>,
}

impl FrameTimes {
    /// How the device's times were measured.
    pub fn way(&self) -> &'static str {
        match (self.first_stamp_ms, self.split) {
            (None, _) => "no GPU times: the queue has no timestamps",
            (_, true) => "each stage submitted alone",
            (_, false) => "timestamps within one submission",
        }
    }

    /// Times of the stages in frame order; zones of the same name are summed.
    pub fn stages(&self) -> Vec<StageTime> {
        let mut stages: Vec<StageTime> = Vec::with_capacity(self.zones.len());
        for zone in self.zones.iter().filter(|zone| !zone.is_shader) {
            let (gpu_ms, cpu_ms) = (zone.gpu.map(Span::ms), zone.cpu.ms());
            match stages.iter_mut().find(|s| s.name == zone.name) {
                Some(s) => (s.gpu_ms, s.cpu_ms) = (s.gpu_ms.zip(gpu_ms).map(|(a, b)| a + b), s.cpu_ms + cpu_ms),
                None => stages.push(StageTime { name: zone.name, gpu_ms, cpu_ms }),
            }
        }
        stages
    }

    /// GPU time of the whole frame \[ms\]: the sum of its outermost zones.
    pub fn gpu_ms(&self) -> Option<f64> {
        self.zones.iter().filter(|z| z.depth == 0).map(|z| z.gpu.map(Span::ms)).sum()
    }

    /// Time from the first timestamp to the last \[ms\], including gaps between zones.
    pub fn gpu_span_ms(&self) -> Option<f64> {
        self.zones.iter().filter_map(|z| z.gpu).map(|g| g.end_ms).reduce(f64::max)
    }

    /// CPU time of one kind of work \[ms\]. Recording does not include submissions and waits inside.
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

    /// Time from the start of the frame to the end of the last CPU work for it \[ms\].
    pub fn cpu_span_ms(&self) -> f64 {
        self.work.iter().map(|(_, s)| s.end_ms).fold(0.0, f64::max)
    }
}

/// The queue's timestamps: unit and valid bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    /// Nanoseconds per tick.
    pub(crate) period_ns: f64,
    /// Number of valid bits of a timestamp; the other bits are undefined. 0 if the queue has no timestamps.
    pub(crate) bits: u32,
}

impl Clock {
    /// Milliseconds between two timestamps.
    fn ms(&self, from: u64, to: u64) -> f64 {
        ticks_between(from, to, self.bits) as f64 * self.period_ns * 1e-6
    }
}

/// Ticks from one timestamp to another; negative if the other is earlier. Only the lowest `bits` (1 to 64) of a
/// timestamp count, and they wrap around. The result is correct for timestamps less than half their range apart (with
/// 36 bits of 1 ns, the least that Vulkan allows: 34 s).
pub fn ticks_between(from: u64, to: u64, bits: u32) -> i64 {
    let unused = 64 - bits;
    (to.wrapping_sub(from) << unused).cast_signed() >> unused
}

/// Places the timestamps of all frames on one time line, across wrap-arounds.
#[derive(Debug, Default)]
pub(crate) struct Line {
    last: Option<u64>,
    ms: f64,
}

impl Line {
    /// Position of a timestamp on the line \[ms\]. It must be less than half the range from the previous one.
    fn place(&mut self, clock: &Clock, stamp: u64) -> f64 {
        self.ms += self.last.map_or(0.0, |last| clock.ms(last, stamp));
        self.last = Some(stamp);
        self.ms
    }
}

/// A recorded zone.
#[derive(Debug)]
pub(crate) struct Recorded {
    pub(crate) name: &'static str,
    pub(crate) depth: u32,
    pub(crate) is_shader: bool,
    pub(crate) timed: bool,
    pub(crate) cpu: Span,
}

/// Data collected while a frame is recorded.
#[derive(Debug)]
pub(crate) struct Notes {
    pub(crate) number: u64,
    pub(crate) split: bool,
    pub(crate) begin: Instant,
    /// Number of open zones.
    pub(crate) depth: u32,
    pub(crate) zones: Vec<Recorded>,
    pub(crate) work: Vec<(Work, Span)>,
}

impl Notes {
    /// Time since the frame began \[ms\].
    pub(crate) fn now(&self) -> f64 {
        self.begin.elapsed().as_secs_f64() * 1e3
    }

    /// Records a piece of work that began at `begin_ms` and ends now.
    pub(crate) fn worked(&mut self, what: Work, begin_ms: f64) {
        let end_ms = self.now();
        self.work.push((what, Span { begin_ms, end_ms }));
    }

    /// Times of the frame, from a pair of timestamps for each timed zone.
    pub(crate) fn times(&self, stamps: &[u64], clock: &Clock, line: &mut Line) -> FrameTimes {
        let first = stamps.first().copied();
        let mut pairs = stamps.chunks_exact(2);
        let zone = |zone: &Recorded| {
            let pair = if zone.timed { pairs.next().zip(first) } else { None };
            let gpu = pair.map(|(pair, first)| {
                let begin_ms = clock.ms(first, pair[0]).max(0.0);
                Span { begin_ms, end_ms: clock.ms(first, pair[1]).max(begin_ms) }
            });
            ZoneTime { name: zone.name, depth: zone.depth, is_shader: zone.is_shader, gpu, cpu: zone.cpu }
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

/// The nearest-rank percentile: the smallest value that at least `percent` of the sorted values do not exceed.
pub fn nearest_rank(sorted: &[f64], percent: f64) -> f64 {
    let rank = (percent / 100.0 * sorted.len() as f64).ceil() as usize;
    sorted[rank.clamp(1, sorted.len()) - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two frames of a queue with 36 valid bits and ticks of 2 ns. The counter wraps within the first frame, and the
    /// higher bits are arbitrary.
    #[test]
    fn frames_lie_on_one_line_across_a_wrap() {
        let clock = Clock { period_ns: 2.0, bits: 36 };
        let mut line = Line::default();
        let zone = |name, depth| Recorded { name, depth, is_shader: false, timed: true, cpu: Span::default() };
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
        // The next frame, then one from before the wrap that was read late.
        notes.zones.truncate(1);
        assert_eq!(notes.times(&[4_000_000, 5_000_000], &clock, &mut line).first_stamp_ms, Some(10.0));
        assert_eq!(notes.times(&[a - 1_000_000, a], &clock, &mut line).first_stamp_ms, Some(-2.0));
        // An end before the start, which no queue should produce, counts as zero instead of a huge time.
        let odd = notes.times(&[100, 90], &clock, &mut line);
        assert_eq!(odd.gpu_ms(), Some(0.0));
    }
}
