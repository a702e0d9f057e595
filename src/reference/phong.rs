//! Reflection at a surface: diffuse and normalised modified Phong. METHOD 3, thesis 5.3.1-5.3.2.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// Reflection parameters of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse albedo `rho_d`.
    pub diffuse: DVec3,
    /// Glossy albedo `rho_g`.
    pub specular: DVec3,
    /// Phong exponent `k`.
    pub exponent: f64,
}

/// Diffuse BRDF [1/sr] per unit of albedo: `f_d = rho_d / pi`.
pub const DIFFUSE_LOBE: f64 = 1.0 / PI;

/// Glossy BRDF [1/sr] per unit of albedo: `(k+2)/(2 pi) max(0, cos_e)^k`, eq. 5.24 with the base clamped.
///
/// Its albedo is 1 at normal incidence and decreases with the angle; it never gains energy.
pub fn phong_lobe(k: f64, cos_e: f64) -> f64 {
    (k + 2.0) / TAU * cos_power(k, cos_e)
}

/// `max(0, cos_e)^k`, the lobe without its constant factor.
pub fn cos_power(k: f64, cos_e: f64) -> f64 {
    cos_e.max(0.0).powf(k)
}

/// Reflects the direction `incident`, which arrives at a surface of unit `normal`: GLSL's `reflect`.
pub fn reflect(incident: DVec3, normal: DVec3) -> DVec3 {
    incident - 2.0 * normal.dot(incident) * normal
}

/// `R`: unit view direction from `eye`, reflected at `position`; the normal if the two coincide.
pub fn mirrored_view(position: DVec3, normal: DVec3, eye: DVec3) -> DVec3 {
    reflect((position - eye).normalize_or(-normal), normal)
}
