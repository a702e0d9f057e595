//! Pictures of points and heat maps of their errors for the report.

use super::measure::Layers;
use super::references::{Truth, make_folder};
use crate::error::Result;
use crate::image::write_png;
use crate::metrics::display::{clean, encode, middle_grey};
use crate::metrics::heat::{Scale, colors};
use crate::metrics::relative_squares;
use crate::reference::tonemap::pbr_neutral;
use std::path::PathBuf;

/// Scale of the heat maps of the relative squared error.
pub const HEAT: Scale = Scale::Log(1e-6, 1.0);

/// Factor on radiance for display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure(f64);

impl Exposure {
    /// Maps the log-average of the lit pixels to middle grey.
    pub fn of(layers: &Layers) -> Self {
        Self(middle_grey(&layers.sum()).unwrap_or(1.0))
    }
}

/// The folder of pictures.
pub struct Pictures {
    folder: PathBuf,
}

/// Content of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    /// Both lobes of indirect light.
    Light,
    /// Relative squared error of indirect light against a reference.
    Error(Truth),
}

impl Pictures {
    /// Creates the folder if it is missing.
    ///
    /// # Errors
    /// Fails if a file cannot be read or written.
    pub fn open(folder: PathBuf) -> Result<Self> {
        make_folder(&folder)?;
        Ok(Self { folder })
    }

    /// File of a point's or a reference's picture.
    pub fn path(&self, key: &str, shows: Shows) -> PathBuf {
        let what = match shows {
            Shows::Light => "light".to_owned(),
            Shows::Error(truth) => format!("error-{}", truth.name()),
        };
        self.folder.join(format!("{}-{what}.png", &key[..16.min(key.len())]))
    }

    /// Whether a point's picture and these error maps exist.
    pub fn has(&self, key: &str, errors: &[Truth]) -> bool {
        let errors = errors.iter().map(|truth| Shows::Error(*truth));
        errors.chain([Shows::Light]).all(|shows| self.path(key, shows).is_file())
    }

    /// Writes a picture of indirect light.
    ///
    /// # Errors
    /// Fails if a file cannot be read or written.
    pub fn write_light(&self, key: &str, layers: &Layers, exposure: Exposure) -> Result<()> {
        let shown = |pixel: &[f32; 3]| {
            let srgb = encode(pbr_neutral(clean(*pixel) * exposure.0)) * 255.0 + 0.5;
            [srgb.x as u8, srgb.y as u8, srgb.z as u8, 255]
        };
        let rgba: Vec<u8> = layers.sum().iter().flat_map(shown).collect();
        write_png(&self.path(key, Shows::Light), layers.size[0], layers.size[1], &rgba)
    }

    /// Writes the error of indirect light against a reference of the same size.
    ///
    /// # Errors
    /// Fails if a file cannot be read or written.
    pub fn write_error(&self, key: &str, layers: &Layers, truth: Truth, reference: &Layers) -> Result<()> {
        let mut errors = relative_squares(&layers.sum(), &reference.sum());
        for (error, (a, b)) in errors.iter_mut().zip(layers.covered.iter().zip(&reference.covered)) {
            // Nothing to compare where either shows no surface.
            *error = if *a && *b { *error } else { 0.0 };
        }
        write_png(&self.path(key, Shows::Error(truth)), layers.size[0], layers.size[1], &colors(&errors, HEAT))
    }
}
