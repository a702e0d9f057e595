//! Debugging: counts invalid values of radiances, VALs, the caches' sums and proxies on the device. By METHOD 4 there are
//! none.
//!
//! The check is a separate submission after the frame. So it costs unchecked frames nothing and does not affect the
//! stage times of checked ones.

use super::light::Light;
use super::picture::Picture;
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Gpu, Image, Pipeline};
use crate::shared::{
    CHECK_DIFFUSE, CHECK_DIRECT, CHECK_GLOSSY, CHECK_GROUPS, CHECK_PROXIES, CHECK_SUMS, CHECK_TARGETS, CHECK_VALS,
    CheckPush, LiveArgs,
};

/// Counts broken values: NaN, infinite, or negative where that makes no sense.
pub struct Check {
    pipeline: Pipeline,
    counts: Buffer,
}

/// Broken values in one target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Broken {
    /// Name of the target.
    pub target: &'static str,
    /// Values that are NaN, infinite or negative.
    pub broken: u64,
    /// Values that were checked.
    pub values: u64,
}

/// Names in the order of the shader's targets, and the number of values checked per item.
const TARGETS: [(u32, &str, u64); CHECK_TARGETS as usize] = [
    (CHECK_DIRECT, "direct", 3),
    (CHECK_DIFFUSE, "indirect.diffuse", 3),
    (CHECK_GLOSSY, "indirect.glossy", 3),
    (CHECK_VALS, "VALs", 11),
    (CHECK_SUMS, "caches' sums", 16),
    (CHECK_PROXIES, "proxies", 14),
];

impl Check {
    /// Creates the pipeline and its buffer.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        let counts = gpu.buffer("check.counts", u64::from(4 * CHECK_TARGETS * CHECK_GROUPS))?;
        Ok(Self { pipeline: gpu.compute("count_broken.comp", &[])?, counts })
    }

    /// Checks the results of the last frame in a picture and its light; waits for the device. Targets that the frame
    /// does not have are left out.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn count(&self, gpu: &Gpu, light: &Light, picture: &Picture) -> Result<Vec<Broken>> {
        let (surface, exposure) = (&picture.surface, &picture.output.exposure);
        let diffuse = picture.indirect.as_ref().map(|i| &i.diffuse);
        let glossy = picture.indirect.as_ref().and_then(|i| i.glossy.as_ref());
        let (vals, proxies) = (light.vals(), light.caches().map(|caches| &caches.proxies));
        let sums = light.caches().and_then(|caches| caches.gather.sums());
        let pixels = |image: Option<&Image>| image.map_or(0, |i| i.width * i.height);
        let push = CheckPush {
            width: surface.size[0],
            direct_pixels: pixels(Some(&surface.radiance)),
            diffuse_pixels: pixels(diffuse),
            glossy_pixels: pixels(glossy),
            val_count: vals.map_or(0, |vals| vals.count),
            cache_count: proxies.map_or(0, |proxies| proxies.count * proxies.runs),
            summed_caches: sums.map_or(0, |_| proxies.map_or(0, |proxies| proxies.count)),
            cache_parts: sums.map_or(0, |sums| sums.cache_parts),
        };
        // Missing targets are not read; another resource takes their binding.
        let binds: [Bind<'_>; 8] = [
            (&surface.radiance).into(),
            diffuse.unwrap_or(&surface.radiance).into(),
            glossy.unwrap_or(&surface.radiance).into(),
            vals.map_or(exposure, |vals| &vals.all).into(),
            proxies.map_or(exposure, |proxies| &proxies.buffer).into(),
            sums.map_or(exposure, |sums| sums.parts).into(),
            sums.map_or(exposure, |sums| sums.args).into(),
            (&self.counts).into(),
        ];
        gpu.run_once("check", |cmd| {
            let _zone = cmd.zone("check");
            cmd.bind(&self.pipeline, &binds);
            cmd.push(&push);
            cmd.dispatch(256 * CHECK_GROUPS, CHECK_TARGETS, 1);
        })?;
        let counts: Vec<u32> = gpu.read(&self.counts)?;
        let summed = sums
            .map_or(Ok(0), |sums| gpu.read::<LiveArgs>(sums.args).map(|args| args[0].groups_y * args[0].cache_count))?;
        let items =
            [push.direct_pixels, push.diffuse_pixels, push.glossy_pixels, push.val_count, summed, push.cache_count];
        let line = |(target, name, each): (u32, &'static str, u64)| {
            let first = (target * CHECK_GROUPS) as usize;
            let broken = counts[first..first + CHECK_GROUPS as usize].iter().map(|c| u64::from(*c)).sum();
            Broken { target: name, broken, values: each * u64::from(items[target as usize]) }
        };
        Ok(TARGETS.into_iter().map(line).filter(|l| l.values > 0).collect())
    }
}
