//! A sky on the device: as a visible background and as light on surfaces.

use crate::error::Result;
use crate::gpu::{Buffer, Device};
use crate::scene::sky::Sky;
use crate::scene::sky_filter;
use crate::shared::SkyLevel;

/// A sky as visible background.
pub struct SkyBuffer {
    /// Radiance, row by row.
    pub texels: Buffer,
    pub(in crate::frame) width: u32,
    pub(in crate::frame) height: u32,
    pub(in crate::frame) turn: f32,
}

impl SkyBuffer {
    /// Uploads a sky.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn new(gpu: &Device, sky: &Sky) -> Result<Self> {
        let texels = gpu.buffer_from("scene.sky", &sky.texels)?;
        Ok(Self { texels, width: sky.width, height: sky.height, turn: sky.turn as f32 })
    }
}

/// A sky that lights surfaces, as grids: irradiance by normal, the sky itself, and the sky filtered by increasingly
/// wide lobes.
pub struct SkyLight {
    /// Location of each grid.
    pub levels: Buffer,
    /// Texels of all grids.
    pub texels: Buffer,
    /// Irradiance below which a cache's own share has no meaning, a small part of the mean illuminance \[lx\].
    pub(in crate::frame) least: f32,
}

/// Maximum number of columns of the sky itself, as mirrors show it.
const MOST_COLUMNS: u32 = 2048;

impl SkyLight {
    /// Computes the grids and uploads them.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn new(gpu: &Device, sky: &Sky) -> Result<Self> {
        let mut grids = vec![sky_filter::irradiance(sky), sky_filter::halved(sky, MOST_COLUMNS)];
        grids.extend(sky_filter::lobes(sky));
        let (mut levels, mut texels) = (Vec::new(), Vec::new());
        for grid in &grids {
            let first = texels.len() as u32;
            levels.push(SkyLevel { first, width: grid.width, height: grid.height, turn: grid.turn as f32 });
            texels.extend_from_slice(&grid.texels);
        }
        Ok(Self {
            levels: gpu.buffer_from("scene.sky_levels", &levels)?,
            texels: gpu.buffer_from("scene.sky_light", &texels)?,
            least: (1e-4 * sky.illuminance().max_element() / 4.0) as f32,
        })
    }
}
