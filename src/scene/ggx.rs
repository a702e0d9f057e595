//! Albedo of a GGX lobe over the hemisphere, and the Phong lobe that matches it. Twin of `glsl/lib/brdf.glsl`; the
//! fitted integrals are in `reference::brdf`. METHOD 3.

use std::f64::consts::{PI, TAU};

/// Lower limit of the roughness, so that the highlight of a point light stays finite.
pub const LEAST_ROUGHNESS: f64 = 0.045;

/// Lower limit of the view cosine; a normal from a normal map may even face away.
pub const LEAST_COSINE: f64 = 0.01;

/// Cosine at which the reflectance of a dielectric lobe is about its mean over the hemisphere.
pub const MEAN_COSINE: f64 = 0.475;

/// Cosine at which the reflectance of a Phong lobe is about its mean over the hemisphere; exact for narrow lobes.
pub const MEAN_PHONG_COSINE: f64 = 2.0 / 3.0;

/// Exponent above which a lobe is narrower than caches can resolve.
pub const CACHE_EXPONENT: f64 = 2048.0;

/// Fit of the single-scattering albedo for F0 = F90 = 1, one row per power of cosine / (cosine + alpha): coefficients
/// of 1, alpha, alpha^2, alpha^3.
const WHOLE: [[f64; 4]; 6] = [
    [0.9760314, 0.1620926, -0.2620544, 0.1039931],
    [0.1939374, -3.278414, 0.3070236, -0.3667155],
    [-1.88827, 17.98381, -8.505335, 2.695105],
    [2.219887, -39.50036, 5.196035, 3.272633],
    [0.8242185, 39.14375, 8.987958, -3.34294],
    [-1.329452, -14.78641, -4.205442, -9.211608],
];

/// Fit of the effective Fresnel cosine, one row per power of the cosine (the last row: cosine / (cosine + alpha)):
/// coefficients of roughness^0 to ^4.
const MEETING: [[f64; 5]; 5] = [
    [-0.02288454, 0.6119457, 0.03954586, -0.09075218, -0.08407662],
    [0.9627351, 1.661892, -15.3, 15.61723, -3.295657],
    [-0.1903572, 1.745568, 11.67772, -20.20051, 7.251153],
    [0.2899276, -4.235289, 3.581084, 0.3299611, 0.1033743],
    [0.02710257, -0.6735195, -0.7388668, 8.464338, -6.21879],
];

fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Single-scattering albedo for uniform light, as factors of F0 and F90. The fits are within .004 of the integrals.
pub fn scattered_once(roughness: f64, cosine: f64) -> [f64; 2] {
    let c = cosine.clamp(LEAST_COSINE, 1.0);
    let alpha = roughness * roughness;
    let p = c / (c + alpha);
    let whole = polynomial(&WHOLE.map(|row| polynomial(&row, alpha)), p).min(1.0);
    let met = MEETING.map(|row| polynomial(&row, roughness));
    let met = polynomial(&met[..4], c) + p * met[4];
    let at_edges = whole * (1.0 - met).clamp(0.0, 1.0).powi(5);
    [whole - at_edges, at_edges]
}

/// Factor by which multiple scattering raises a lobe with this F0; Turquin 2019.
pub fn scattered_again(f0: f64, once: [f64; 2]) -> f64 {
    1.0 + f0 * (1.0 / (once[0] + once[1]) - 1.0)
}

/// Share of uniform light that a lobe reflects.
pub fn albedo(f0: f64, f90: f64, once: [f64; 2]) -> f64 {
    (f0 * once[0] + f90 * once[1]) * scattered_again(f0, once)
}

/// Share of uniform light that a Phong lobe of albedo 1 reflects, within .5 %.
pub fn phong_albedo(k: f64, cosine: f64) -> f64 {
    let flat2 = 1.0 / (TAU * k + PI + (4.0 - PI) / (1.0 + 0.95 * k));
    let c2 = cosine * cosine;
    0.5 * (cosine + (c2 + 4.0 * flat2 * (1.0 - c2) * (-0.81 * k * c2).exp2()).sqrt())
}

/// Exponent of the Phong lobe of equal width: 1/2 (1/alpha^2 - 1), which has the same peak as GGX; at least 1/4.
pub fn fitted_exponent(roughness: f64) -> f64 {
    let alpha = roughness * roughness;
    (0.5 * (1.0 / (alpha * alpha) - 1.0)).max(0.25)
}
