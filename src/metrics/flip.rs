//! FLIP: the difference that is visible when flipping between two images. LDR-FLIP: Andersson et al. 2020, "FLIP: A
//! Difference Evaluator for Alternating Images"; HDR-FLIP: Andersson et al. 2021, "Visualizing Errors in Rendered High
//! Dynamic Range Images". The crate `nv-flip` computes LDR-FLIP; this module builds HDR-FLIP from it.

use super::display::{Values, clean, encode, is_broken, luminance};
use nv_flip::FlipImageRgb8;
use rayon::prelude::*;

/// Pixels per degree of the papers' observer: 0.7 m from a display that is 0.7 m and 3840 pixels wide.
pub const PIXELS_PER_DEGREE: f32 = nv_flip::DEFAULT_PIXELS_PER_DEGREE;

/// FLIP error of each pixel from 0 (equal) to 1; NaN where a value is broken. The metric is the mean of the map.
///
/// Display values: LDR-FLIP of the sRGB codes. Radiance: for each pixel the largest LDR-FLIP over the exposures that
/// HDR-FLIP derives from the reference (see `exposures`). Exposed images are tone-mapped as in HDR-FLIP, clipped, and
/// encoded as 8-bit sRGB. The paper does not round to 8 bits; the crate does. This matters below a few percent: in
/// `tests/compare.rs` a pattern 2 % brighter has 0.0357 instead of 0.0337, one 10 % brighter 0.1070 instead of 0.1069.
///
/// `pixels_per_degree`: per degree of visual angle, above 0; see [`PIXELS_PER_DEGREE`]. Both images hold
/// `size[0] * size[1]` pixels, at most 2^28.
pub fn flip(
    image: &[[f32; 3]],
    reference: &[[f32; 3]],
    size: [u32; 2],
    values: Values,
    pixels_per_degree: f32,
) -> Vec<f64> {
    let pixels = size[0] as usize * size[1] as usize;
    assert!(image.len() == pixels && reference.len() == pixels && pixels <= 1 << 28, "images of this size");
    let ldr = |code: &(dyn Fn(&[f32; 3]) -> [u8; 3] + Sync)| -> Vec<f32> {
        let shown =
            |p: &[[f32; 3]]| FlipImageRgb8::with_data(size[0], size[1], &p.iter().flat_map(code).collect::<Vec<u8>>());
        nv_flip::flip(shown(reference), shown(image), pixels_per_degree).to_vec()
    };
    let bytes = |display: glam::DVec3| (encode(display) * 255.0 + 0.5).to_array().map(|v| v as u8);
    let seen = match values {
        Values::Display => ldr(&|c| bytes(clean(*c))),
        Values::Radiance => exposures(reference)
            // A black reference defines no exposures.
            .or_else(|| exposures(image))
            .unwrap_or_else(|| vec![1.0])
            .into_par_iter()
            .map(|exposure| ldr(&|c| bytes((clean(*c) * exposure).map(tone_map))))
            .reduce(|| vec![0.0; pixels], |a, b| a.iter().zip(&b).map(|(a, b)| a.max(*b)).collect()),
    };
    let is_broken = |i: usize| is_broken(image[i]) || is_broken(reference[i]);
    (0..pixels).map(|i| if is_broken(i) { f64::NAN } else { f64::from(seen[i]) }).collect()
}

/// Weighted quantile: the value of a map below which this share of the map's sum lies. 0.5 gives the weighted median
/// that FLIP's authors report. NaN if the map holds a NaN.
pub fn weighted_quantile(map: &[f64], share: f64) -> f64 {
    let mut sorted = map.to_vec();
    sorted.sort_by(f64::total_cmp);
    let total: f64 = sorted.iter().sum();
    let mut sum = 0.0;
    let reaches = |v: &f64| {
        sum += v;
        sum >= share * total
    };
    if total.is_nan() { f64::NAN } else { sorted.iter().copied().find(reaches).unwrap_or(0.0) }
}

/// Coefficients of HDR-FLIP's tone map: Narkowicz's fit of ACES without its exposure of 0.6.
const UP: [f64; 2] = [0.36 * 2.51, 0.6 * 0.03];
const DOWN: [f64; 3] = [0.36 * 2.43, 0.6 * 0.59, 0.14];

/// HDR-FLIP's tone map for one exposed channel.
fn tone_map(x: f64) -> f64 {
    // Far beyond white; avoids overflow of the squares.
    let x = x.min(1e9);
    (UP[0] * x * x + UP[1] * x) / (DOWN[0] * x * x + DOWN[1] * x + DOWN[2])
}

/// Exposure factors of HDR-FLIP. They range from the one that maps the largest luminance to 0.85 of the display's range
/// to the one that does so for the median, with one factor per stop and at least two. `None` if there is no light.
///
/// The median is over all pixels, or over the lit ones if at least half of the pixels are black.
fn exposures(image: &[[f32; 3]]) -> Option<Vec<f64>> {
    let mut luminances: Vec<f64> = image.iter().map(|c| luminance(*c)).collect();
    luminances.sort_by(f64::total_cmp);
    let median = |sorted: &[f64]| (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2]) / 2.0;
    let lit = &luminances[luminances.partition_point(|l| *l == 0.0)..];
    let largest = *lit.last()?;
    let median = if median(&luminances) > 0.0 { median(&luminances) } else { median(lit) };
    // The tone map is 0.85 where a x^2 + b x + c = 0.
    let (a, b, c) = (UP[0] - 0.85 * DOWN[0], UP[1] - 0.85 * DOWN[1], -0.85 * DOWN[2]);
    let bright = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let (start, stop) = ((bright / largest).log2(), (bright / median).log2());
    let steps = ((stop - start).ceil() - 1.0).max(1.0);
    Some((0..=steps as u32).map(|i| (start + (stop - start) * f64::from(i) / steps).exp2()).collect())
}
