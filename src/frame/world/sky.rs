//! A sky's radiance on the device. Its light is that of directional lights (`scene::sky`).

use crate::error::Result;
use crate::gpu::{Buffer, Gpu};
use crate::scene::sky::Sky;

/// A sky on the device.
pub struct SkyBuffer {
    /// Radiances, row by row.
    pub texels: Buffer,
    pub(in crate::frame) width: u32,
    pub(in crate::frame) height: u32,
    pub(in crate::frame) turn: f32,
}

impl SkyBuffer {
    /// Uploads a sky.
    ///
    /// # Errors
    /// What the device has no memory for.
    pub fn new(gpu: &Gpu, sky: &Sky) -> Result<Self> {
        let texels = gpu.buffer_from("scene.sky", &sky.texels)?;
        Ok(Self { texels, width: sky.width, height: sky.height, turn: sky.turn as f32 })
    }
}
