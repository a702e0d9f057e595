//! The proxy lights of caches: what stage 6 makes, stage 7 dims and stage 8 interpolates. METHOD 4.

use crate::error::Result;
use crate::gpu::{Buffer, Gpu};
use crate::shared::Proxy;

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
    /// Unlit ones of so many caches, for so many eyes if there is a glossy lobe.
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
