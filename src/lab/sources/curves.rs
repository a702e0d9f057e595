//! Errors of a single disc or square: of the form factor over distance and tilt, and of a constant BRDF (figure 5.7).

use glam::DVec3;

use crate::reference::disc::{self, lobe_integral};
use crate::reference::form_factor;
use crate::reference::phong::cos_power;

/// One point of a curve of figure 5.7.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LobeError {
    /// Phong exponent.
    pub k: f64,
    /// Angle \[degrees\] between the lobe's axis and the direction to the square's centre.
    pub angle: f64,
    /// Distance in sides of the square.
    pub distance: f64,
    /// `|L - L'| / L`: relative error of the radiance with the BRDF constant over the square.
    pub error: f64,
}

/// Exponents, angles \[degrees\] and distances \[sides\] of the curves.
pub const EXPONENTS: [f64; 8] = [1.0, 3.0, 10.0, 30.0, 60.0, 100.0, 300.0, 1000.0];
/// See [`EXPONENTS`].
pub const ANGLES: [f64; 3] = [0.0, 10.0, 20.0];
/// See [`EXPONENTS`].
pub const DISTANCES: [f64; 13] = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 20.0];

/// Figure 5.7: a square and a point that face each other, and a viewer whose mirror direction makes an angle with the
/// direction to the square's centre. `L` integrates BRDF times geometry over the square; `L'` takes the BRDF at the
/// centre out of the integral.
pub fn lobe_errors() -> Vec<LobeError> {
    let mut all = Vec::new();
    for (k, angle) in EXPONENTS.into_iter().flat_map(|k| ANGLES.map(|angle| (k, angle))) {
        all.extend(DISTANCES.map(|distance| LobeError { k, angle, distance, error: lobe_error(k, angle, distance) }));
    }
    all
}

/// One point of [`lobe_errors`].
pub fn lobe_error(k: f64, angle: f64, distance: f64) -> f64 {
    let (sin, cos) = angle.to_radians().sin_cos();
    let h = 0.5;
    let corners = [(-h, -h), (h, -h), (h, h), (-h, h)].map(|(x, y)| DVec3::new(x, y, distance));
    let mean = lobe_integral(&corners, DVec3::ZERO, DVec3::Z, DVec3::new(sin, 0.0, cos), k);
    (cos_power(k, cos) - mean).abs() / mean
}

/// The curves as text: `k,angle_degrees,distance_in_sides,relative_error`.
pub fn lobe_csv(errors: &[LobeError]) -> String {
    let line = |e: &LobeError| format!("{},{},{},{:.6}\n", e.k, e.angle, e.distance, e.error);
    "k,angle_degrees,distance_in_sides,relative_error\n".to_owned() + &errors.iter().map(line).collect::<String>()
}

/// Distances (in square roots of the disc's area) and angles \[degrees\] from the disc's axis for
/// [`form_factor_error`].
pub const FORM_FACTOR_DISTANCES: [f64; 7] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0];
/// See [`FORM_FACTOR_DISTANCES`].
pub const TILTS: [f64; 5] = [0.0, 30.0, 60.0, 75.0, 85.0];

/// Orientation of the receiving point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Receives {
    /// Its normal points to the disc's centre.
    Facing,
    /// Its normal is opposite to the disc's.
    Parallel,
    /// Its normal is perpendicular to the disc's and points to the disc's axis: a floor below a wall.
    Upright,
}

/// Signed relative error of a VAL, `A cos cos / max(A, pi d^2)`, against the true disc, at a distance in square roots of the area
/// and an angle \[degrees\] from the disc's axis. `None` if there is no light.
pub fn form_factor_error(receives: Receives, distance: f64, tilt: f64) -> Option<f64> {
    let (sin, cos) = tilt.to_radians().sin_cos();
    let (disc_normal, point) = (DVec3::Z, distance * DVec3::new(sin, 0.0, cos));
    let normal = match receives {
        Receives::Facing => DVec3::new(-sin, 0.0, -cos),
        Receives::Parallel => -DVec3::Z,
        Receives::Upright => -DVec3::X,
    };
    let cos_x = normal.dot(-point) / distance;
    let formula = form_factor::val_geometry(1.0, cos, cos_x, distance * distance);
    let exact = disc::disc_form_factor(1.0, DVec3::ZERO, disc_normal, point, normal);
    (exact > 0.0).then(|| formula / exact - 1.0)
}
