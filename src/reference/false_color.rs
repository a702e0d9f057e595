//! Numbers as colours of the display: Turbo (Mikhailov 2019, "Turbo, An Improved Rainbow Colormap for Visualization"), by his
//! polynomials of the fifth degree.

use glam::DVec3;

/// Coefficients from the highest power on: red, green, blue.
const POWERS: [DVec3; 6] = [
    DVec3::new(59.28637943, 2.82956604, 27.34824973),
    DVec3::new(-152.94239396, 4.27729857, -89.90310912),
    DVec3::new(132.13108234, -14.18503333, 110.36276771),
    DVec3::new(-42.66032258, 4.84296658, -60.58204836),
    DVec3::new(4.61539260, 2.19418839, 12.64194608),
    DVec3::new(0.13572138, 0.09140261, 0.10667330),
];

/// From dark blue by green and yellow to dark red, for `t` from 0 to 1; sRGB.
pub fn false_color(t: f64) -> DVec3 {
    let t = t.clamp(0.0, 1.0);
    POWERS.iter().fold(DVec3::ZERO, |sum, power| sum * t + *power).clamp(DVec3::ZERO, DVec3::ONE)
}

/// Where a value is between two others, 0 to 1, by its logarithm; 0 for what has none.
pub fn decades(value: f64, low: f64, high: f64) -> f64 {
    if value > 0.0 { ((value.ln() - low.ln()) / (high.ln() - low.ln())).clamp(0.0, 1.0) } else { 0.0 }
}
