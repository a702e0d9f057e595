//! Stage 11, tone mapping: exposed linear Rec.709 to linear display values from 0 to 1; and the sRGB encoding.

use glam::{DMat3, DVec3};

use super::gather::luminance;

/// No curve: clamps to the display's range.
pub fn linear(color: DVec3) -> DVec3 {
    color.clamp(DVec3::ZERO, DVec3::ONE)
}

/// Reflectance of a dielectric of index 1.5 that Khronos PBR Neutral subtracts.
const NEUTRAL_F90: f64 = 0.04;
/// Where its compression starts.
const NEUTRAL_START: f64 = 0.8 - NEUTRAL_F90;
/// Rate of desaturation beyond it.
const NEUTRAL_DESATURATION: f64 = 0.15;

/// Khronos PBR Neutral (specification in KhronosGroup/ToneMapping): keeps base colours up to 0.8.
pub fn pbr_neutral(color: DVec3) -> DVec3 {
    let least = color.min_element();
    let fresnel = if least <= 2.0 * NEUTRAL_F90 { least - least * least / (4.0 * NEUTRAL_F90) } else { NEUTRAL_F90 };
    let color = color - fresnel;
    let peak = color.max_element();
    if peak <= NEUTRAL_START {
        return color;
    }
    let new_peak = 1.0 - (1.0 - NEUTRAL_START).powi(2) / (peak + 1.0 - 2.0 * NEUTRAL_START);
    let saturation = 1.0 / (NEUTRAL_DESATURATION * (peak - new_peak) + 1.0);
    color * (new_peak / peak) * saturation + new_peak * (1.0 - saturation)
}

/// Inverse of [`pbr_neutral`] for displayed colours in [0, 1); infinite where a channel reaches 1.
pub fn pbr_neutral_inverse(color: DVec3) -> DVec3 {
    let mut color = color;
    let new_peak = color.max_element();
    if new_peak > NEUTRAL_START {
        let peak = (1.0 - NEUTRAL_START).powi(2) / (1.0 - new_peak) - 1.0 + 2.0 * NEUTRAL_START;
        let saturation = 1.0 / (NEUTRAL_DESATURATION * (peak - new_peak) + 1.0);
        color = (color - new_peak * (1.0 - saturation)) / saturation * (peak / new_peak);
    }
    // The smallest channel was x - (x - x^2 / (4 F90)) below 2 F90, x - F90 above.
    let least = color.min_element().max(0.0);
    let original = if least <= NEUTRAL_F90 { (4.0 * NEUTRAL_F90 * least).sqrt() } else { least + NEUTRAL_F90 };
    color + (original - least)
}

/// ACES: Stephen Hill's fit of the reference rendering and output transforms, as in Khronos's glTF sample viewer
/// (without its optional exposure boost).
pub fn aces(color: DVec3) -> DVec3 {
    // Columns. sRGB -> XYZ -> D65 to D60 -> AP1 -> saturation of the reference rendering transform, and back.
    let input = DMat3::from_cols_array(&[
        0.59719, 0.07600, 0.02840, //
        0.35458, 0.90834, 0.13383, //
        0.04823, 0.01566, 0.83777,
    ]);
    let output = DMat3::from_cols_array(&[
        1.60475, -0.10208, -0.00327, //
        -0.53108, 1.10813, -0.07276, //
        -0.07367, -0.00605, 1.07602,
    ]);
    let v = input * color;
    let fit = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
    linear(output * fit)
}

/// AgX (Troy Sobotka) with its default look, by Benjamin Wrensch's matrices and polynomial of the contrast curve.
///
/// The curve is made for a display of exponent 2.2; the result is made linear again, as for every tone map.
pub fn agx(color: DVec3) -> DVec3 {
    const LEAST_LOG2: f64 = -12.47393;
    const GREATEST_LOG2: f64 = 4.026069;
    let inset = DMat3::from_cols_array(&[
        0.842479062253094,
        0.0423282422610123,
        0.0423756549057051, //
        0.0784335999999992,
        0.878468636469772,
        0.0784336, //
        0.0792237451477643,
        0.0791661274605434,
        0.879142973793104,
    ]);
    let outset = DMat3::from_cols_array(&[
        1.19687900512017,
        -0.0528968517574562,
        -0.0529716355144438, //
        -0.0980208811401368,
        1.15190312990417,
        -0.0980434501171241, //
        -0.0990297440797205,
        -0.0989611768448433,
        1.15107367264116,
    ]);
    let log2 =
        |v: f64| (v.max(0.0).log2().clamp(LEAST_LOG2, GREATEST_LOG2) - LEAST_LOG2) / (GREATEST_LOG2 - LEAST_LOG2);
    let display = outset * (inset * color).map(|v| agx_contrast(log2(v)));
    linear(display).powf(2.2)
}

/// Sixth-order fit of AgX's default contrast; 0 and 1 within 0.003 at the ends.
fn agx_contrast(x: f64) -> f64 {
    let coefficients = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232];
    coefficients.into_iter().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// sRGB's encoding of a linear colour in [0, 1] (IEC 61966-2-1).
pub fn srgb_from_linear(color: DVec3) -> DVec3 {
    color.map(|v| if v <= 0.0031308 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 })
}

/// Linear colour of an sRGB-encoded one in [0, 1] (IEC 61966-2-1).
pub fn linear_from_srgb(color: DVec3) -> DVec3 {
    color.map(|v| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) })
}

/// Automatic exposure value at ISO 100 for a picture's surfaces: their mean log luminance, without the darkest and the
/// brightest tenth, without what is 16 stops darker than the rest, and weighted towards the centre, becomes middle grey.
/// METHOD 10. `radiance` [cd/m^2] and `seen` (whether the pixel shows a surface) are row by row. 0 for a black picture.
pub fn automatic_ev([width, height]: [u32; 2], radiance: &[DVec3], seen: &[bool]) -> f64 {
    const TAIL: f64 = 0.1;
    const DARKEST_STOPS: f64 = 5.0;
    const BLACK_STOPS: f64 = 16.0;
    let step = (f64::from(width) * f64::from(height) / f64::from(1 << 18)).sqrt().ceil() as usize;
    let window = |at: usize, count: u32| {
        let from_centre = (at as f64 + 0.5) / f64::from(count) * 2.0 - 1.0;
        1.0 - 0.75 * from_centre * from_centre
    };
    // Log luminance and weight of lit pixels, from dark to bright.
    let metered = |surfaces: bool| -> Vec<(f64, f64)> {
        let mut all = Vec::new();
        for y in (0..height as usize).step_by(step) {
            for x in (0..width as usize).step_by(step) {
                let i = y * width as usize + x;
                let l = luminance(radiance[i]);
                if l > 0.0 && seen[i] == surfaces {
                    all.push((l.log2().clamp(-32.0, 32.0), window(x, width) * window(y, height)));
                }
            }
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    };
    let Some(mut sorted) = [true, false].into_iter().map(metered).find(|sorted| !sorted.is_empty()) else { return 0.0 };
    // Luminance below which nine tenths of the weight lie.
    let nine_tenths = (1.0 - TAIL) * sorted.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut below = 0.0;
    let brightest = sorted.iter().find(|(_, weight)| {
        below += weight;
        below >= nine_tenths
    });
    let black = brightest.map_or(f64::MIN, |(log2, _)| log2 - BLACK_STOPS);
    sorted.retain(|(log2, _)| *log2 >= black);
    let total: f64 = sorted.iter().map(|(_, weight)| weight).sum();
    let (first, last) = (TAIL * total, (1.0 - TAIL) * total);
    // Part of each pixel's weight between the tails.
    let mut end = 0.0;
    let mut kept = Vec::new();
    for (log2, weight) in sorted {
        let start = end;
        end += weight;
        let between = f64::min(end, last) - f64::max(start, first);
        if between > 0.0 {
            kept.push((log2, between));
        }
    }
    let darkest = kept.last().map_or(0.0, |(log2, _)| log2 - DARKEST_STOPS);
    let mean = kept.iter().map(|(log2, weight)| log2.max(darkest) * weight).sum::<f64>() / (last - first);
    mean - (1.2 * 0.18_f64).log2()
}
