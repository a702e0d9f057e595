//! Accuracy of the gather: errors of its sums against f64.

use crate::error::Result;
use crate::frame::gather::Gather;
use crate::gpu::Gpu;
use crate::lab::shot::{cache, gather_sums, val};
use crate::reference::gather::receive;
use crate::reference::phong::mirrored_view;
use crate::shared::{Cache, Val};
use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

/// Number of caches sampled.
const SAMPLES: usize = 32;

/// Relative error of a sum; infinite for NaN.
fn off(sum: f64, found: f64) -> f64 {
    match ((found - sum) / sum).abs() {
        _ if found == sum => 0.0,
        off if off.is_nan() => f64::INFINITY,
        off => off,
    }
}

/// Largest relative error in any channel of the irradiance \[lx\] that a sample of these caches received from these
/// VALs, for the diffuse and the glossy lobe. The view is a perspective camera (`eye` as in `shared::GatherPush`). All
/// terms have one sign, so that the error is relative to their sum.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn worst(gpu: &Gpu, caches: &[Cache], vals: &[Val], eye: Vec4, gather: &Gather) -> Result<[f64; 2]> {
    let sums = gather_sums(gpu, gather, caches.len() as u32)?;
    let vals: Vec<_> = vals.iter().map(|v| val(v, DVec3::ZERO)).collect();
    let eye = eye.truncate().as_dvec3();
    let sampled: Vec<usize> = (0..caches.len()).step_by(caches.len().div_ceil(SAMPLES).max(1)).collect();
    let of_cache = |i: &usize| {
        let at = cache(&caches[*i], DVec3::ZERO);
        let mirrored = mirrored_view(at.position, at.normal, eye);
        let (mut diffuse, mut glossy) = (DVec3::ZERO, DVec3::ZERO);
        for val in &vals {
            let received = receive(&at, Some(mirrored), val, 0.0);
            diffuse += received.irradiance;
            glossy += received.irradiance * received.lobe;
        }
        let of = |sum: DVec3, found: Vec3| (0..3).map(|i| off(sum[i], found[i].into())).fold(0.0, f64::max);
        [of(diffuse, sums[*i].diffuse_irradiance), of(glossy, sums[*i].glossy_irradiance)]
    };
    Ok(sampled.par_iter().map(of_cache).reduce(|| [0.0; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]))
}
