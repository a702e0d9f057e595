//! Errors of an image against a reference, over linear RGB values; what a display shows of them, and maps of them.

pub mod display;
pub mod flip;
pub mod heat;
pub mod ssim;

/// Errors of an image against a reference. All are 0 for equal images but `psnr`, which is infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics {
    /// Pixels that were compared.
    pub pixels: usize,
    /// Mean absolute error: `mean(|a - b|)`.
    pub mae: f64,
    /// Mean absolute relative error: `mean(|a - b| / (b + 0.01 mean(b)))`.
    pub mare: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// Relative mean squared error: `mean((a - b)^2 / (b^2 + 0.01 mean(b)^2))`.
    pub relmse: f64,
    /// The same without the worst 1 % of pixels.
    pub relmse_trimmed: f64,
    /// Relative error of the mean: `mean(a) / mean(b) - 1`.
    pub bias: f64,
    /// Peak signal-to-noise ratio \[dB\], the peak being the reference's largest value.
    pub psnr: f64,
}

impl Metrics {
    /// Names and values, in the order of the fields.
    pub fn named(&self) -> [(&'static str, f64); 7] {
        [
            ("mae", self.mae),
            ("mare", self.mare),
            ("rmse", self.rmse),
            ("relmse", self.relmse),
            ("relmse-trimmed", self.relmse_trimmed),
            ("bias", self.bias),
            ("psnr", self.psnr),
        ]
    }
}

/// Relative squared error of each pixel, as `Metrics::relmse` averages it. The images are equally long.
pub fn relative_squares(image: &[[f32; 3]], reference: &[[f32; 3]]) -> Vec<f64> {
    let floor = 0.01 * mean(reference).powi(2);
    let channel = |a: f32, b: f32| {
        let (a, b) = (f64::from(a), f64::from(b));
        let square = (a - b).powi(2);
        // Two black images are equal, not undefined.
        if square == 0.0 { 0.0 } else { square / (b * b + floor) }
    };
    let pixel = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| channel(a[c], b[c])).sum::<f64>() / 3.0;
    image.iter().zip(reference).map(pixel).collect()
}

/// Absolute error of each pixel, mean of its channels, as `Metrics::mae` averages it. The images are equally long.
pub fn absolutes(image: &[[f32; 3]], reference: &[[f32; 3]]) -> Vec<f64> {
    let pixel =
        |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| (f64::from(a[c]) - f64::from(b[c])).abs()).sum::<f64>() / 3.0;
    image.iter().zip(reference).map(pixel).collect()
}

/// Compares two images of the same number of pixels. Panics if they differ in it or hold none.
pub fn metrics(image: &[[f32; 3]], reference: &[[f32; 3]]) -> Metrics {
    assert_eq!(image.len(), reference.len(), "images of the same size");
    assert!(!image.is_empty(), "an image with pixels");
    let pairs = || image.iter().flatten().zip(reference.iter().flatten()).map(|(a, b)| (f64::from(*a), f64::from(*b)));
    let n = 3.0 * image.len() as f64;
    let (mean_a, mean_b) = (mean(image), mean(reference));
    let average = |error: &dyn Fn(f64, f64) -> f64| pairs().map(|(a, b)| error(a, b)).sum::<f64>() / n;
    let ratio = |up: f64, down: f64| if up == 0.0 { 0.0 } else { up / down };
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
            assert_eq!((m.mae, m.mare, m.rmse, m.relmse, m.relmse_trimmed, m.bias), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
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
    fn a_value_that_is_no_number_shows() {
        let m = metrics(&[[f32::NAN; 3]], &[[1.0; 3]]);
        assert!(m.mae.is_nan() && m.bias.is_nan() && m.relmse.is_nan());
    }
}
