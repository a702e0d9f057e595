//! Display values of linear images, on which FLIP and SSIM judge errors as an eye sees them.

use crate::reference::gather;
use crate::reference::tonemap::srgb_from_linear;
use glam::{DVec3, Vec3};

/// Interpretation of an image's linear values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Values {
    /// Display values from 0 to 1, as in PNG files; used unchanged.
    Display,
    /// Radiance of any scale, as in EXR files; exposed according to the reference.
    Radiance,
}

/// Luminance of linear Rec.709. Values that no radiance can have (negative, infinite, NaN) count as black.
pub fn luminance(color: [f32; 3]) -> f64 {
    gather::luminance(clean(color))
}

/// sRGB encoding of a colour, clipped to 0 and 1.
pub fn encode(color: DVec3) -> DVec3 {
    srgb_from_linear(color.clamp(DVec3::ZERO, DVec3::ONE))
}

/// Replaces values that no radiance can have by 0.
pub fn clean(color: [f32; 3]) -> DVec3 {
    Vec3::from(color).as_dvec3().map(|v| if v > 0.0 && v.is_finite() { v } else { 0.0 })
}

/// Whether a colour has a non-finite value. Error maps are NaN at such pixels, and only there.
pub fn is_broken(color: [f32; 3]) -> bool {
    color.iter().any(|v| !v.is_finite())
}

/// Factor that maps the log-average luminance of an image's lit pixels to middle grey, 0.18; `None` if none is lit.
///
/// Pixels darker than 1/32 of the mean count as 1/32 of it.
pub fn middle_grey(image: &[[f32; 3]]) -> Option<f64> {
    let lit: Vec<f64> = image.iter().map(|c| luminance(*c)).filter(|l| *l > 0.0).collect();
    if lit.is_empty() {
        return None;
    }
    let n = lit.len() as f64;
    let darkest = lit.iter().sum::<f64>() / n / 32.0;
    Some(0.18 / (lit.iter().map(|l| l.max(darkest).ln()).sum::<f64>() / n).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn middle_grey_follows_the_lit_pixels() {
        // Log-average of 1 and 4 is 2; black and broken pixels do not count.
        let image = [[1.0; 3], [0.0; 3], [4.0; 3], [f32::NAN; 3]];
        let factor = middle_grey(&image).expect("lit pixels");
        assert!((factor - 0.09).abs() < 1e-12, "{factor}");
        // 1e-9 counts as 1/32 of the mean, 0.5: the log-average of 1 and 1/64 is 1/8.
        let factor = middle_grey(&[[1.0; 3], [1e-9; 3]]).expect("lit pixels");
        assert!((factor - 0.18 * 8.0).abs() < 1e-7, "{factor}");
        assert_eq!(middle_grey(&[[0.0; 3]]), None);
    }
}
