//! Reading back what is on the device. A copy can be taken later and on another thread, so that nothing waits for it.

use super::{Buffer, Cmd, Gpu, Image};
use crate::error::Result;
use bytemuck::Pod;
use std::marker::PhantomData;

/// A copy of an image or a buffer that the device makes. Any thread can take it.
pub struct Readback<T> {
    buffer: Buffer,
    of: PhantomData<T>,
}

impl<T: Pod> Readback<T> {
    /// Waits until the device has made the copy, and returns it.
    ///
    /// # Errors
    /// Fails if the device is lost.
    ///
    /// # Panics
    /// Panics before the commands that make it are submitted.
    pub fn take(mut self) -> Result<Vec<T>> {
        self.buffer.wait()?;
        Ok(bytemuck::pod_collect_to_vec(self.buffer.bytes()))
    }
}

impl Cmd<'_> {
    /// Copies the largest mip level of an image: tightly packed texels, layer after layer. For `Gpu::begin`.
    ///
    /// # Errors
    /// Fails if there is no memory for the copy.
    pub fn read_image<T: Pod>(&self, image: &Image) -> Result<Readback<T>> {
        let buffer = self.gpu.readback_buffer("readback", image.made.level_bytes(0))?;
        self.copy_image_to_buffer(image, &buffer);
        Ok(Readback { buffer, of: PhantomData })
    }

    /// Copies a whole buffer. For `Gpu::begin`.
    ///
    /// # Errors
    /// Fails if there is no memory for the copy.
    pub fn read_buffer<T: Pod>(&self, buffer: &Buffer) -> Result<Readback<T>> {
        let back = self.gpu.readback_buffer("readback", buffer.held)?;
        self.copy_buffer(buffer, &back, buffer.held);
        Ok(Readback { buffer: back, of: PhantomData })
    }
}

impl Gpu {
    /// Reads the largest mip level of an image back as tightly packed texels, layer after layer; waits for the device.
    ///
    /// # Errors
    /// Fails if the device is lost, or there is no memory to read into.
    pub fn read_image<T: Pod>(&self, image: &Image) -> Result<Vec<T>> {
        self.begin("readback", |cmd| cmd.read_image(image))?.take()
    }

    /// Reads a whole buffer back; waits for the device.
    ///
    /// # Errors
    /// Fails if the device is lost, or there is no memory to read into.
    pub fn read<T: Pod>(&self, buffer: &Buffer) -> Result<Vec<T>> {
        self.begin("readback", |cmd| cmd.read_buffer(buffer))?.take()
    }

    /// Reads one texel of the largest mip level back, by column and row, from the first layer if there are several;
    /// waits for the device.
    ///
    /// # Errors
    /// Fails if the device is lost, or there is no memory to read into.
    ///
    /// # Panics
    /// Panics if the image has no such texel, or its texels are larger than `T`.
    pub fn read_texel<T: Pod>(&self, image: &Image, at: [u32; 2]) -> Result<T> {
        let mut back = self.readback_buffer("readback", size_of::<T>() as u64)?;
        self.run_once("readback", |cmd| cmd.copy_texel_to_buffer(image, at, &back))?;
        Ok(bytemuck::pod_read_unaligned(&back.bytes()[..size_of::<T>()]))
    }
}
