//! Arithmetic peak of a device: independent chains of multiply-adds and nothing else.

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::shared::{PEAK_CHAINS, PEAK_STEPS};

/// Runs grow until one takes this long \[ms\].
const LONG_ENOUGH: f64 = 30.0;

/// Invocations of the first run, and the limit.
const INVOCATIONS: [u32; 2] = [1 << 10, 1 << 21];

/// Runs at the final size; the fastest counts.
const RUNS: usize = 5;

/// Measured arithmetic peak [flop/s]; a multiply-add counts as two operations. Fails if the chains give wrong results.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn measure(gpu: &Gpu) -> Result<f64> {
    let pipeline = gpu.compute("peak.comp", &[])?;
    let mut count = INVOCATIONS[0];
    loop {
        let results = gpu.buffer("peak.results", 4 * u64::from(count))?;
        let run = || -> Result<f64> {
            let drawn = gpu.timed_frame(|cmd| {
                let _zone = cmd.zone("peak");
                cmd.bind(&pipeline, &[(&results).into()]);
                cmd.dispatch(count, 1, 1);
                Ok(())
            })?;
            gpu.times(&drawn)?.gpu_ms().ok_or_else(|| Error::Nothing("the device has no timestamps".into()))
        };
        let mut best = run()?;
        if best >= LONG_ENOUGH || count == INVOCATIONS[1] {
            for _ in 1..RUNS {
                best = best.min(run()?);
            }
            check(&gpu.read(&results)?)?;
            let flop = 2.0 * f64::from(PEAK_STEPS) * f64::from(PEAK_CHAINS) * f64::from(count);
            return Ok(flop / (best * 1e-3).max(1e-9));
        }
        count *= 2;
    }
}

/// Each chain x -> x + (1 - x) / 4096 ends at `(1 - 1/4096)^steps` of its initial distance from 1.
fn check(results: &[f32]) -> Result<()> {
    let left = (1.0 - 1.0 / 4096.0_f64).powi(PEAK_STEPS as i32);
    for (at, result) in results.iter().enumerate() {
        let starts = (0..PEAK_CHAINS).map(|chain| 100.0 + f64::from(chain) + (at % 8) as f64);
        let expected: f64 = starts.map(|start| 1.0 + (start - 1.0) * left).sum();
        // Rounding errors of a step add up to 4096-fold.
        if (f64::from(*result) - expected).abs() > 0.005 * expected {
            let what = format!("the kernel of the arithmetic peak returned {result} instead of {expected}");
            return Err(Error::Nothing(format!("{what}; the device or its driver computes wrong results")));
        }
    }
    Ok(())
}
