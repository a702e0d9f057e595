//! The proxy lights of caches: what stage 6 makes, stage 7 dims and stage 8 interpolates. METHOD 4.

use super::atlas::Atlas;
use super::vals::Vals;
use crate::error::Result;
use crate::gpu::{Buffer, Gpu};
use crate::shared::Proxy;
use glam::Vec4;

/// Proxy lights of both lobes. The glossy lobe's sums are made for an eye, so where there is one every eye has a run of
/// proxies of its own; else all share one.
pub struct Proxies {
    /// Run by run; of a cache that is not lit what an earlier frame has left.
    pub buffer: Buffer,
    /// Caches of a run.
    pub count: u32,
    /// Runs.
    pub runs: u32,
}

impl Proxies {
    /// Unlit proxies of this many caches, for this many eyes if there is a glossy lobe.
    ///
    /// # Errors
    /// What the device has no memory for.
    pub fn new(gpu: &Gpu, count: u32, glossy: bool, eyes: u32) -> Result<Self> {
        let runs = if glossy { eyes.max(1) } else { 1 };
        let buffer = gpu.buffer_from("gather.proxies", &vec![Proxy::default(); (count.max(1) * runs) as usize])?;
        Ok(Self { buffer, count, runs })
    }

    /// First proxy of an eye's run.
    pub fn first(&self, eye: u32) -> u32 {
        self.count * eye.min(self.runs - 1)
    }
}

/// What a gather reads and writes.
#[derive(Clone, Copy)]
pub struct Lit<'a> {
    /// VALs, or what pyramids stand on.
    pub vals: &'a Vals,
    /// The caches.
    pub atlas: &'a Atlas,
    /// A run of proxies for each eye.
    pub proxies: &'a Proxies,
    /// Position and 1, or direction towards the eye and 0.
    pub eyes: &'a [Vec4],
    /// Diffuse albedos of the caches, where light bounces more than once.
    pub albedos: Option<&'a Buffer>,
}

impl Lit<'_> {
    /// Eyes that need sums of their own: with one run of proxies, the first one's are used for all.
    pub(super) fn runs(&self) -> impl Iterator<Item = (u32, Vec4)> {
        let eyes = self.eyes.iter().take(self.proxies.runs as usize);
        eyes.enumerate().map(|(eye, position)| (self.proxies.first(eye as u32), *position))
    }
}
