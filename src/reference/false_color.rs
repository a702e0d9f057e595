//! False colours: Turbo (Mikhailov 2019, "Turbo, An Improved Rainbow Colormap for Visualization") by his polynomials of
//! degree five.

use glam::DVec3;

/// Coefficients for red, green, blue, from the highest power down.
const POWERS: [DVec3; 6] = [
    DVec3::new(59.28637943, 2.82956604, 27.34824973),
    DVec3::new(-152.94239396, 4.27729857, -89.90310912),
    DVec3::new(132.13108234, -14.18503333, 110.36276771),
    DVec3::new(-42.66032258, 4.84296658, -60.58204836),
    DVec3::new(4.61539260, 2.19418839, 12.64194608),
    DVec3::new(0.13572138, 0.09140261, 0.10667330),
];

/// sRGB colour from dark blue over green and yellow to dark red, for `t` from 0 to 1.
pub fn false_color(t: f64) -> DVec3 {
    let t = t.clamp(0.0, 1.0);
    POWERS.iter().fold(DVec3::ZERO, |sum, power| sum * t + *power).clamp(DVec3::ZERO, DVec3::ONE)
}

/// Logarithmic position of a value between two bounds, 0 to 1; 0 for values without a logarithm.
pub fn decades(value: f64, low: f64, high: f64) -> f64 {
    if value > 0.0 { ((value.ln() - low.ln()) / (high.ln() - low.ln())).clamp(0.0, 1.0) } else { 0.0 }
}
