//! Albedo of a layer of fine fibres, KHR_materials_sheen. Twin of `glsl/lib/coat.glsl`; the fitted integrals are in
//! `reference::coat`. METHOD 16.

use super::ggx::LEAST_COSINE;

/// Lower limit of the roughness. Smoother sheen would be visible only at grazing angles.
pub const LEAST_ROUGHNESS: f64 = 0.1;

/// Estevez and Kulla's fit of ln(Lambda): coefficients for alpha = 1 and alpha = 0.
const LAMBDA: [[f64; 2]; 5] =
    [[21.5473, 25.3245], [3.82987, 3.32435], [0.19823, 0.16801], [-1.97760, -1.27393], [-4.32054, -4.85967]];

/// Fit of the albedo, one row per power of 2 sqrt(cosine) - 1: coefficients of powers of ln(roughness) + 1.
const ALBEDO: [[f64; 4]; 5] = [
    [-0.8648058, 0.1153187, -0.3688529, 0.2132948],
    [-1.705422, 1.904287, -1.150307, 0.3470406],
    [-0.8879002, 1.519958, -0.8343759, 0.08235765],
    [-0.7520157, 0.9126094, 0.07790181, -0.3056653],
    [-0.5639245, 0.3321902, 0.3511139, -0.2085173],
];

/// Smith's Lambda of the fibre distribution, Estevez and Kulla 2017.
pub fn lambda(alpha: f64, cosine: f64) -> f64 {
    let [a, b, c, d, e] = LAMBDA.map(|[one, zero]| one + (zero - one) * (1.0 - alpha).powi(2));
    let log = |x: f64| a / (1.0 + b * x.powf(c)) + d * x + e;
    if cosine < 0.5 { log(cosine).exp() } else { (2.0 * log(0.5) - log(1.0 - cosine)).exp() }
}

/// Share of uniform light that white sheen reflects to a viewer at this cosine, by its formula. The fit is within .004
/// of the integral, absolute or relative. Exceeds 1 at grazing angles of smooth sheen.
pub fn whole(roughness: f64, cosine: f64) -> f64 {
    let c = cosine.clamp(LEAST_COSINE, 1.0);
    let polynomial = |row: &[f64], x: f64| row.iter().rev().fold(0.0, |sum, c| sum * x + c);
    let rows = ALBEDO.map(|row| polynomial(&row, roughness.ln() + 1.0));
    polynomial(&rows, 2.0 * c.sqrt() - 1.0).exp() / (c * (1.0 + lambda(roughness * roughness, c)))
}

/// [`whole`], limited to 1 to conserve energy.
pub fn albedo(roughness: f64, cosine: f64) -> f64 {
    whole(roughness, cosine).min(1.0)
}
