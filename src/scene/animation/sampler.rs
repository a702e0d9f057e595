//! Animated values over time: keys and interpolation.

use glam::DQuat;

/// Values at increasing times, and their interpolation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sampler {
    /// Times of the keys \[s\], increasing; at least one.
    pub times: Vec<f32>,
    /// `width` numbers per key; with `Cubic` three times as many: in-tangents, values, out-tangents.
    pub values: Vec<f32>,
    /// Numbers per value.
    pub width: usize,
    /// Interpolation between keys.
    pub interpolation: Interpolation,
}

/// glTF's three interpolation modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Interpolation {
    /// The value of the previous key.
    Step,
    /// Linear; spherical along the shorter arc for rotations.
    #[default]
    Linear,
    /// Hermite spline; rotations are normalised.
    Cubic,
}

impl Sampler {
    /// Time of the first key \[s\].
    pub fn begin(&self) -> f64 {
        self.times.first().copied().map_or(0.0, f64::from)
    }

    /// Time of the last key \[s\].
    pub fn end(&self) -> f64 {
        self.times.last().copied().map_or(0.0, f64::from)
    }

    /// Writes the value at `time` \[s\] to `out`, which holds `width` numbers. Values are held before the first and
    /// after the last key.
    pub fn sample(&self, time: f64, out: &mut [f64]) {
        let (key, part) = self.place(time);
        let step = (part > 0.0).then(|| f64::from(self.times[key + 1]) - f64::from(self.times[key]));
        for (at, out) in out.iter_mut().enumerate() {
            let value = |key: usize| self.value(key, at);
            *out = match (step, self.interpolation) {
                (None, _) | (_, Interpolation::Step) => value(key),
                (_, Interpolation::Linear) => value(key) * (1.0 - part) + value(key + 1) * part,
                (Some(step), Interpolation::Cubic) => {
                    let (t, t2, t3) = (part, part * part, part * part * part);
                    let (leaving, arriving) = (self.number(key, 2, at) * step, self.number(key + 1, 0, at) * step);
                    (2.0 * t3 - 3.0 * t2 + 1.0) * value(key)
                        + (t3 - 2.0 * t2 + t) * leaving
                        + (3.0 * t2 - 2.0 * t3) * value(key + 1)
                        + (t3 - t2) * arriving
                }
            };
        }
    }

    /// The unit rotation at `time` \[s\].
    pub fn rotation(&self, time: f64) -> DQuat {
        let (key, part) = self.place(time);
        let value = |key: usize| unit([0, 1, 2, 3].map(|at| self.value(key, at))).unwrap_or(DQuat::IDENTITY);
        match self.interpolation {
            Interpolation::Linear if part > 0.0 => slerp(value(key), value(key + 1), part),
            Interpolation::Cubic if part > 0.0 => {
                let mut out = [0.0; 4];
                self.sample(time, &mut out);
                unit(out).unwrap_or_else(|| value(key))
            }
            _ => value(key),
        }
    }

    /// The last key not after `time`, and the fraction of the way to the next key, in [0, 1); 0 before the first and
    /// after the last key.
    fn place(&self, time: f64) -> (usize, f64) {
        let after = self.times.partition_point(|&key| f64::from(key) <= time);
        if after == 0 || after == self.times.len() {
            return (after.saturating_sub(1), 0.0);
        }
        let (from, to) = (f64::from(self.times[after - 1]), f64::from(self.times[after]));
        (after - 1, (time - from) / (to - from))
    }

    fn value(&self, key: usize, at: usize) -> f64 {
        self.number(key, usize::from(self.interpolation == Interpolation::Cubic), at)
    }

    /// A number of a key's in-tangent (0), value (1) or out-tangent (2). Other interpolations have only part 0.
    fn number(&self, key: usize, part: usize, at: usize) -> f64 {
        let parts = if self.interpolation == Interpolation::Cubic { 3 } else { 1 };
        f64::from(self.values[(parts * key + part) * self.width + at])
    }
}

fn unit(q: [f64; 4]) -> Option<DQuat> {
    let q = DQuat::from_array(q);
    let length = q.length();
    (length > 0.0 && length.is_finite()).then(|| q / length)
}

/// Spherical interpolation by `part` along the shorter arc from `a` to `b`.
fn slerp(a: DQuat, b: DQuat, part: f64) -> DQuat {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    // Half of the angle from its tangent: unlike the cosine, exact for small angles too.
    let angle = 2.0 * (a - b).length().atan2((a + b).length());
    let sine = angle.sin();
    let blended = if sine < 1e-12 {
        a * (1.0 - part) + b * part
    } else {
        a * (((1.0 - part) * angle).sin() / sine) + b * ((part * angle).sin() / sine)
    };
    blended.normalize()
}
