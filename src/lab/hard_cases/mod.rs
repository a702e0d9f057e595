//! Numerically difficult cases: each has an input, an expectation from an independent source, and the engine's result.
//!
//! Expectations come from the f64 references, from closed forms, or from another frame that must be equal (METHOD 4),
//! never from earlier results of the engine. NaN, infinite and negative values are counted on the device in every
//! frame. Any of them, any message of the validation layer and any missing barrier fails the case.

mod caches;
mod invariance;
mod oracle;
mod places;
mod surfaces;

pub use oracle::difference;

use super::shot::Shot;
use crate::error::Result;
use crate::gpu::Gpu;

/// One difficult case.
pub struct Case {
    /// The difficulty, in a word or two; shared by all cases of a kind.
    pub kind: &'static str,
    /// Description of the input.
    pub input: String,
    /// Expected result and its source.
    pub expected: String,
    check: Box<Check>,
}

type Check = dyn Fn(&Gpu) -> Result<Outcome>;

/// One row of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// [`Case::kind`].
    pub kind: &'static str,
    /// [`Case::input`].
    pub input: String,
    /// [`Case::expected`].
    pub expected: String,
    /// The engine's result.
    pub measured: String,
    /// Whether the result meets the expectation.
    pub pass: bool,
}

/// All cases, kind by kind.
pub fn lines() -> Vec<Case> {
    [invariance::cases(), caches::cases(), surfaces::cases(), places::cases()].into_iter().flatten().collect()
}

/// Runs a case.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn run(gpu: &Gpu, case: &Case) -> Result<Line> {
    let Outcome { mut measured, mut pass, complaints } = (case.check)(gpu)?;
    for complaint in complaints {
        measured = format!("{measured}; {complaint}");
        pass = false;
    }
    Ok(Line { kind: case.kind, input: case.input.clone(), expected: case.expected.clone(), measured, pass })
}

impl Case {
    fn new(
        kind: &'static str,
        input: impl Into<String>,
        expected: impl Into<String>,
        check: impl Fn(&Gpu) -> Result<Outcome> + 'static,
    ) -> Self {
        Self { kind, input: input.into(), expected: expected.into(), check: Box::new(check) }
    }
}

/// Result of a case.
struct Outcome {
    measured: String,
    pass: bool,
    complaints: Vec<String>,
}

impl Outcome {
    /// An error that must not exceed a bound; NaN exceeds it.
    fn bounded(error: f64, bound: f64) -> Self {
        Self { measured: number(error), pass: error <= bound, complaints: Vec::new() }
    }

    /// Several errors, each with its bound.
    fn all<const N: usize>(errors: [(&str, f64, f64); N]) -> Self {
        let texts: Vec<_> = errors.iter().map(|(what, error, _)| format!("{what} {}", number(*error))).collect();
        let pass = errors.iter().all(|(_, error, bound)| error <= bound);
        Self { measured: texts.join(", "), pass, complaints: Vec::new() }
    }

    /// Adds the complaints about the frames.
    fn of(mut self, shots: &[&Shot]) -> Self {
        self.complaints.extend(shots.iter().flat_map(|shot| shot.complaints.clone()));
        self
    }

    /// Fails unless the case tests what it should: a dark picture proves nothing.
    fn provided(mut self, condition: bool, otherwise: &str) -> Self {
        if !condition {
            self.complaints.push(format!("the case is void: {otherwise}"));
        }
        self
    }
}

/// Two significant digits, or 0.
fn number(value: f64) -> String {
    if value == 0.0 { "0".into() } else { format!("{value:.1e}") }
}
