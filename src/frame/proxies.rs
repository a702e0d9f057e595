//! The proxy lights of caches: written by stage 6, dimmed by stage 7 and interpolated by stage 8. METHOD 4.

use super::atlas::Atlas;
use super::vals::Vals;
use crate::error::Result;
use crate::gpu::{Buffer, Device};
use crate::shared::Proxy;
use glam::Vec4;

/// Proxy lights of both lobes. The sums of the glossy lobe depend on the eye. With a glossy lobe every eye therefore
/// has its own run of proxies; without one, all eyes share a run.
pub struct Proxies {
    /// Proxies, run by run. Proxies of unlit caches keep values of an earlier frame.
    pub buffer: Buffer,
    /// Caches per run.
    pub count: u32,
    /// Number of runs.
    pub runs: u32,
}

impl Proxies {
    /// Creates unlit proxies of this many caches, one run per eye if there is a glossy lobe.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn new(gpu: &Device, count: u32, glossy: bool, eyes: u32) -> Result<Self> {
        let runs = if glossy { eyes.max(1) } else { 1 };
        let buffer = gpu.buffer_from("gather.proxies", &vec![Proxy::default(); (count.max(1) * runs) as usize])?;
        Ok(Self { buffer, count, runs })
    }

    /// First proxy of an eye's run.
    pub fn first(&self, eye: u32) -> u32 {
        self.count * eye.min(self.runs - 1)
    }
}

/// Inputs and outputs of a gather.
#[derive(Clone, Copy)]
pub struct Lit<'a> {
    /// VALs, or the VALs below the pyramids.
    pub vals: &'a Vals,
    /// The caches.
    pub atlas: &'a Atlas,
    /// One run of proxies per eye.
    pub proxies: &'a Proxies,
    /// Position and 1, or direction towards the eye and 0.
    pub eyes: &'a [Vec4],
    /// Diffuse albedos of the caches; only with further bounces.
    pub albedos: Option<&'a Buffer>,
    /// The sky as caches see it; only where they do.
    pub sky: Option<SeenSky<'a>>,
}

/// The sky as caches see it.
#[derive(Clone, Copy)]
pub struct SeenSky<'a> {
    /// One `SkySeen` per cache.
    pub seen: &'a Buffer,
    /// Openness of each cache by direction.
    pub open: &'a Buffer,
    /// Texels of the sky's grids.
    pub texels: &'a Buffer,
    /// The grids.
    pub levels: &'a Buffer,
}

impl Lit<'_> {
    /// Runs to compute: first proxy and eye of each. With a single run, the first eye is used for all.
    pub(super) fn runs(&self) -> impl Iterator<Item = (u32, Vec4)> {
        let eyes = self.eyes.iter().take(self.proxies.runs as usize);
        eyes.enumerate().map(|(eye, position)| (self.proxies.first(eye as u32), *position))
    }
}
