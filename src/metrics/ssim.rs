//! SSIM: structural similarity. Wang, Bovik, Sheikh and Simoncelli 2004, "Image quality assessment: from error
//! visibility to structural similarity".

use super::display::{Values, encode, is_broken, luminance, middle_grey};
use glam::DVec3;
use rayon::prelude::*;

/// Half the width of the window: 11 x 11 pixels.
const RADIUS: usize = 5;
/// Standard deviation of the window's Gaussian \[pixels\].
const SIGMA: f64 = 1.5;
/// `(K1 L)^2` and `(K2 L)^2` with the paper's K1 = 0.01 and K2 = 0.03 and the value range L = 1.
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;

/// Structural similarity around each pixel, -1 to 1 (equal); NaN where a value is broken. The metric is the mean of the
/// map.
///
/// Compares sRGB-encoded Rec.709 luminance, clipped to 0 and 1. Radiance is first scaled so that the reference's
/// log-average luminance is middle grey; the image gets the same factor. At the borders the window is clipped and
/// renormalised, where the paper leaves out five pixels. Both images hold `size[0] * size[1]` pixels.
pub fn ssim(image: &[[f32; 3]], reference: &[[f32; 3]], size: [u32; 2], values: Values) -> Vec<f64> {
    let width = size[0] as usize;
    assert!(
        width > 0 && image.len() == width * size[1] as usize && image.len() == reference.len(),
        "images of this size"
    );
    let factor = match values {
        Values::Display => 1.0,
        // A black reference defines no exposure.
        Values::Radiance => middle_grey(reference).or_else(|| middle_grey(image)).unwrap_or(1.0),
    };
    let shown =
        |p: &[[f32; 3]]| -> Vec<f64> { p.iter().map(|c| encode(DVec3::splat(luminance(*c) * factor)).x).collect() };
    let (a, b) = (shown(image), shown(reference));
    let moment = |of: &(dyn Fn(f64, f64) -> f64 + Sync)| {
        blur(&a.iter().zip(&b).map(|(a, b)| of(*a, *b)).collect::<Vec<f64>>(), width)
    };
    let (mean_a, mean_b) = (moment(&|a, _| a), moment(&|_, b| b));
    let (aa, bb, ab) = (moment(&|a, _| a * a), moment(&|_, b| b * b), moment(&|a, b| a * b));
    let pixel = |i: usize| {
        if is_broken(image[i]) || is_broken(reference[i]) {
            return f64::NAN;
        }
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (variances, covariance) = (aa[i] - ma * ma + (bb[i] - mb * mb), ab[i] - ma * mb);
        (2.0 * ma * mb + C1) * (2.0 * covariance + C2) / ((ma * ma + mb * mb + C1) * (variances + C2))
    };
    (0..a.len()).map(pixel).collect()
}

/// Gaussian-weighted mean around each pixel, one axis after the other.
fn blur(values: &[f64], width: usize) -> Vec<f64> {
    let height = values.len() / width;
    let weights: Vec<f64> = (0..=RADIUS).map(|d| (-0.5 * (d as f64 / SIGMA).powi(2)).exp()).collect();
    // Mean along a line of `count` values, around position `at`.
    let mean = |at: usize, count: usize, value: &dyn Fn(usize) -> f64| {
        let window = at.saturating_sub(RADIUS)..=(at + RADIUS).min(count - 1);
        let (sum, weight) = window.fold((0.0, 0.0), |(sum, weight), i| {
            let w = weights[i.abs_diff(at)];
            (sum + w * value(i), weight + w)
        });
        sum / weight
    };
    let across: Vec<f64> =
        (0..values.len()).into_par_iter().map(|i| mean(i % width, width, &|x| values[i / width * width + x])).collect();
    let both = |i: usize| mean(i / width, height, &|y| across[y * width + i % width]);
    (0..values.len()).into_par_iter().map(both).collect()
}
