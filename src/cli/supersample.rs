//! Supersampling: the mean of many pictures, each through another point of the pixels. METHOD 13.

use super::picture::{Layers, Read};
use anyhow::Result;
use lightskin::frame::{Picture, SUPERSAMPLES, View};
use lightskin::gpu::Gpu;

/// Number of pictures whose mean is taken.
pub(super) const SAMPLES: u32 = SUPERSAMPLES * SUPERSAMPLES;

/// Shift of the sample next to the pixels' centres. Albedo, normal and depth are its: their mean would belong to no surface.
const CENTRAL: [u32; 2] = [SUPERSAMPLES / 2; 2];

/// The sum of the pictures so far.
pub(super) struct Supersampled {
    size: [u32; 2],
    sum: Option<Layers>,
}

impl Supersampled {
    /// Starts with nothing, for a picture of this size.
    pub(super) fn new(size: [u32; 2]) -> Self {
        Self { size, sum: None }
    }

    /// Reads the picture of the last frame, of this sample's view and shift, and adds it.
    pub(super) fn add(&mut self, gpu: &Gpu, picture: &Picture, view: &View, shift: [u32; 2]) -> Result<()> {
        let mut new = Read::begin(gpu, picture, view, true)?()?.layers().cropped(shift, self.size);
        let Some(sum) = &mut self.sum else {
            self.sum = Some(new);
            return Ok(());
        };
        let (to, from) = (sum.light_mut(), new.light_mut());
        for (to, from) in to.into_iter().zip(from) {
            to.iter_mut().flatten().zip(from.iter().flatten()).for_each(|(to, from)| *to += from);
        }
        sum.covered.iter_mut().zip(&new.covered).for_each(|(to, from)| *to += from);
        if shift == CENTRAL {
            (sum.albedo, sum.normal, sum.depth) = (new.albedo, new.normal, new.depth);
        }
        Ok(())
    }

    /// The mean, after all samples were added.
    pub(super) fn mean(self) -> Layers {
        let mut mean = self.sum.expect("samples were added");
        let share = 1.0 / SAMPLES as f32;
        mean.light_mut().into_iter().flatten().flatten().for_each(|value| *value *= share);
        mean.covered.iter_mut().for_each(|covered| *covered *= share);
        mean
    }
}
