//! Errors of an image against a reference on linear RGB values, on display values, and as heat maps.

pub mod display;
pub mod flip;
pub mod heat;
pub mod ssim;

use glam::{DVec3, Vec3};

/// Errors of an image against a reference. All are 0 for equal images, except `psnr`, which is infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics {
    /// Number of pixels compared.
    pub pixels: usize,
    /// Mean absolute error: `mean(|a - b|)`.
    pub mae: f64,
    /// Mean absolute relative error: `mean(|a - b| / (b + 0.01 mean(b)))`.
    pub mare: f64,
    /// Root mean squared error.
    pub rmse: f64,
    /// Relative mean squared error: `mean((a - b)^2 / (b^2 + 0.01 mean(b)^2))`.
    pub relmse: f64,
    /// The same without the worst 1 % of pixels.
    pub relmse_trimmed: f64,
    /// Median over pixels of the relative luminance error `|Y(a) - Y(b)| / (Y(b) + 0.01 mean(b))`. With an even number
    /// of pixels the upper of the two middle values.
    pub median_relative: f64,
    /// Relative error of the mean: `mean(a) / mean(b) - 1`.
    pub bias: f64,
    /// Peak signal-to-noise ratio \[dB\]; the peak is the reference's largest value.
    pub psnr: f64,
}

impl Metrics {
    /// Names and values in the order of the fields.
    pub fn named(&self) -> [(&'static str, f64); 8] {
        [
            ("mae", self.mae),
            ("mare", self.mare),
            ("rmse", self.rmse),
            ("relmse", self.relmse),
            ("relmse-trimmed", self.relmse_trimmed),
            ("median-relative", self.median_relative),
            ("bias", self.bias),
            ("psnr", self.psnr),
        ]
    }
}

/// Relative squared error of each pixel; `Metrics::relmse` is its mean. The images must have equal length.
pub fn relative_squares(image: &[[f32; 3]], reference: &[[f32; 3]]) -> Vec<f64> {
    let floor = 0.01 * mean(reference).powi(2);
    let channel = |a: f32, b: f32| {
        let (a, b) = (f64::from(a), f64::from(b));
        let square = (a - b).powi(2);
        ratio(square, b * b + floor)
    };
    let pixel = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| channel(a[c], b[c])).sum::<f64>() / 3.0;
    image.iter().zip(reference).map(pixel).collect()
}

/// Absolute error of each pixel, averaged over channels; `Metrics::mae` is its mean. The images must have equal length.
pub fn absolutes(image: &[[f32; 3]], reference: &[[f32; 3]]) -> Vec<f64> {
    let pixel =
        |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| (f64::from(a[c]) - f64::from(b[c])).abs()).sum::<f64>() / 3.0;
    image.iter().zip(reference).map(pixel).collect()
}

/// Relative luminance error of each pixel; `Metrics::median_relative` is its median. The images must have equal length.
fn relative_luminances(image: &[[f32; 3]], reference: &[[f32; 3]]) -> Vec<f64> {
    let floor = 0.01 * mean(reference);
    let luminance = |rgb: &[f32; 3]| Vec3::from(*rgb).as_dvec3().dot(DVec3::new(0.2126, 0.7152, 0.0722));
    let pixel = |(a, b): (&[f32; 3], &[f32; 3])| {
        let (a, b) = (luminance(a), luminance(b));
        ratio((a - b).abs(), b + floor)
    };
    image.iter().zip(reference).map(pixel).collect()
}

/// Quotient that is 0 for 0 / 0, so that two black images are equal.
fn ratio(up: f64, down: f64) -> f64 {
    if up == 0.0 { 0.0 } else { up / down }
}

/// Median; NaN if any value is NaN.
fn median(mut values: Vec<f64>) -> f64 {
    if values.iter().any(|value| value.is_nan()) {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Compares two images. Panics if they differ in the number of pixels or have none.
pub fn metrics(image: &[[f32; 3]], reference: &[[f32; 3]]) -> Metrics {
    assert_eq!(image.len(), reference.len(), "images of the same size");
    assert!(!image.is_empty(), "an image with pixels");
    let pairs = || image.iter().flatten().zip(reference.iter().flatten()).map(|(a, b)| (f64::from(*a), f64::from(*b)));
    let n = 3.0 * image.len() as f64;
    let (mean_a, mean_b) = (mean(image), mean(reference));
    let average = |error: &dyn Fn(f64, f64) -> f64| pairs().map(|(a, b)| error(a, b)).sum::<f64>() / n;
    let rmse = average(&|a, b| (a - b).powi(2)).sqrt();
    let peak = pairs().map(|(_, b)| b).fold(0.0, f64::max);
    let mut squares = relative_squares(image, reference);
    squares.sort_by(f64::total_cmp);
    let kept = (squares.len() * 99 / 100).max(1);
    Metrics {
        pixels: image.len(),
        mae: absolutes(image, reference).iter().sum::<f64>() / image.len() as f64,
        mare: average(&|a, b| ratio((a - b).abs(), b + 0.01 * mean_b)),
        rmse,
        relmse: squares.iter().sum::<f64>() / squares.len() as f64,
        relmse_trimmed: squares[..kept].iter().sum::<f64>() / kept as f64,
        median_relative: median(relative_luminances(image, reference)),
        bias: ratio(mean_a - mean_b, mean_b),
        // Two black images are equal too.
        psnr: if rmse == 0.0 { f64::INFINITY } else { 20.0 * (peak / rmse).log10() },
    }
}

/// Mean over pixels and channels.
pub fn mean(image: &[[f32; 3]]) -> f64 {
    image.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / (3.0 * image.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_images_have_no_error() {
        for image in [vec![[0.0; 3]; 4], vec![[1.0, 2.0, 3.0]; 4]] {
            let m = metrics(&image, &image);
            assert_eq!(m.psnr, f64::INFINITY);
            assert_eq!((m.mae, m.mare, m.rmse, m.relmse), (0.0, 0.0, 0.0, 0.0));
            assert_eq!((m.relmse_trimmed, m.median_relative, m.bias), (0.0, 0.0, 0.0));
        }
    }

    #[test]
    fn known_errors() {
        // b is 2 everywhere, a is 10 % brighter.
        let m = metrics(&[[2.2; 3]; 100], &[[2.0; 3]; 100]);
        let near = |value: f64, wanted: f64| assert!((value - wanted).abs() < 1e-6 * wanted, "{value} is not {wanted}");
        near(m.mae, 0.2);
        near(m.rmse, 0.2);
        near(m.bias, 0.1);
        near(m.mare, 0.2 / 2.02);
        near(m.relmse, 0.04 / 4.04);
        near(m.median_relative, 0.2 / 2.02);
        near(m.psnr, 20.0);
    }

    #[test]
    fn the_worst_pixel_of_a_hundred_is_trimmed() {
        let mut image = vec![[1.0_f32; 3]; 100];
        image[7] = [50.0; 3];
        let m = metrics(&image, &[[1.0; 3]; 100]);
        assert_eq!(m.relmse_trimmed, 0.0);
        assert!(m.relmse > 20.0);
    }

    #[test]
    fn half_of_the_pixels_err_by_less_than_the_median() {
        let at = |errors: &[f32]| {
            let image: Vec<[f32; 3]> = errors.iter().map(|e| [1.0 + e, 1.0, 1.0]).collect();
            metrics(&image, &vec![[1.0; 3]; errors.len()]).median_relative
        };
        let near = |value: f64, error: f64| assert!((value - 0.2126 * error / 1.01).abs() < 1e-6, "{value}, {error}");
        // However large the largest is, and of two in the middle the upper one.
        near(at(&[0.0, 0.25, 0.5, -0.75, 1e6]), 0.5);
        near(at(&[0.0, 0.25, 0.5, 1e6]), 0.5);
        assert!(at(&[0.0, 0.0, 0.0, f32::NAN]).is_nan(), "the middle is fine, the picture is not");
    }

    #[test]
    fn a_value_that_is_no_number_shows() {
        let m = metrics(&[[f32::NAN; 3]], &[[1.0; 3]]);
        assert!(m.mae.is_nan() && m.bias.is_nan() && m.relmse.is_nan());
    }
}
