//! Heat maps: map an error per pixel to a colour per pixel.

/// Range of values that a heat map shows, from black to the lightest colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// From 0 to this value.
    Linear(f64),
    /// Logarithmic, from the first value to the second, both above 0.
    Log(f64, f64),
}

impl Scale {
    /// Position of a value on the scale, 0 to 1. NaN stays NaN.
    pub fn place(self, value: f64) -> f64 {
        let place = match self {
            Self::Linear(most) => value / most,
            Self::Log(least, most) => (value.max(least) / least).ln() / (most / least).ln(),
        };
        // `max` above turns NaN into the minimum.
        if value.is_nan() { f64::NAN } else { place.clamp(0.0, 1.0) }
    }
}

impl std::fmt::Display for Scale {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            // As f32: seven digits are enough.
            Self::Linear(most) => write!(f, "from 0 (black) to {} (light yellow), linear", *most as f32),
            Self::Log(least, most) => write!(f, "from {least:e} (black) to {most} (light yellow), logarithmic"),
        }
    }
}

/// RGBA bytes of a heat map, as `image::write_png` takes them: black, purple, red, light yellow (the map "magma"). NaN
/// is green, which the map does not contain.
pub fn colors(values: &[f64], scale: Scale) -> Vec<u8> {
    let magma = nv_flip::magma_lut().to_vec();
    let color = |value: &f64| {
        let place = scale.place(*value);
        if place.is_nan() {
            return [0, 255, 0, 255];
        }
        let i = 3 * (place * 255.0 + 0.5) as usize;
        [magma[i], magma[i + 1], magma[i + 2], 255]
    };
    values.iter().flat_map(color).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_run_from_black_to_light() {
        let log = Scale::Log(1e-6, 1.0);
        for (value, place) in [(0.0, 0.0), (1e-6, 0.0), (1e-3, 0.5), (1.0, 1.0), (f64::INFINITY, 1.0)] {
            assert!((log.place(value) - place).abs() < 1e-12, "{value} is at {}", log.place(value));
        }
        for (value, place) in [(-1.0, 0.0), (1.0, 0.5), (2.0, 1.0), (3.0, 1.0)] {
            assert_eq!(Scale::Linear(2.0).place(value), place);
        }
        let bytes = colors(&[0.0, 2.0, f64::NAN], Scale::Linear(2.0));
        assert!(bytes[..3].iter().all(|v| *v < 5), "black: {bytes:?}");
        assert!(bytes[4] > 240 && bytes[5] > 240, "light: {bytes:?}");
        assert_eq!(bytes[8..], [0, 255, 0, 255]);
        assert_eq!(colors(&[f64::NAN], log), [0, 255, 0, 255]);
    }
}
