//! Stage 6: the compute pipeline that sums VALs at caches. Further bounces use it as well. METHOD 3-4.

use super::atlas::Atlas;
use super::depth_images::binds;
use super::live::Live;
use super::settings::{ProxyWeight, Shadows, Ways};
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Device, Pipeline};

/// Configuration of a compute gather.
#[derive(Clone, Copy, Debug)]
pub struct ComputeKind {
    /// Some material has a glossy lobe.
    pub glossy: bool,
    /// How indirect light is shadowed.
    pub shadows: Shadows,
    /// Consecutive VALs that share one visibility test, 1 or 4.
    pub together: u32,
    /// Number of further bounces, in each of which the lit caches light all caches.
    pub bounces: u32,
    /// Number of VALs on emissive surfaces. Their light has not bounced yet when it reaches a cache.
    pub emitted: u32,
    /// Caches send the sky's light on.
    pub sky: bool,
    /// Caches see a sky.
    pub sees_sky: bool,
    /// Weight of VALs in the positions of proxies.
    pub weight: ProxyWeight,
    /// Maximum number of views in a frame.
    pub eyes: u32,
    /// Distance below which light is left to short rays \[m\]; 0: none.
    pub near: f32,
    /// VALs send a share of their flux in a lobe; only with short rays.
    pub lobes: bool,
}

impl ComputeKind {
    /// A single gather without shadows.
    pub fn plain(glossy: bool) -> Self {
        let (shadows, weight) = (Shadows::Off, ProxyWeight::Irradiance);
        Self {
            glossy,
            shadows,
            together: 1,
            bounces: 0,
            emitted: 0,
            sky: false,
            sees_sky: false,
            weight,
            eyes: 1,
            near: 0.0,
            lobes: false,
        }
    }
}

/// Variant of the summing pipeline.
#[derive(Clone, Copy, Debug)]
pub(super) struct SumKind {
    /// Sums the glossy lobe as well.
    pub(super) glossy: bool,
    pub(super) shadows: Shadows,
    /// Consecutive VALs that share one visibility test.
    pub(super) together: u32,
    /// The pipeline also turns the sums into proxies.
    pub(super) proxies: bool,
    /// Handles the glossy lobe of two eyes at once; needs `proxies`.
    pub(super) two_eyes: bool,
    /// Leaves light from nearby surfaces to short rays.
    pub(super) near: bool,
    /// VALs send a share of their flux in a lobe.
    pub(super) lobes: bool,
    /// With shadows of every VAL: reads the depth images as texels.
    pub(super) images_as_texels: bool,
}

/// Creates the pipeline that sums VALs.
pub(super) fn sum_pipeline(gpu: &Device, ways: &Ways, kind: SumKind) -> Result<Pipeline> {
    let spread = u32::from(kind.shadows == Shadows::Proxy);
    let by_hand = u32::from(gpu.is_software());
    let (glossy, near) = (u32::from(kind.glossy), u32::from(kind.near));
    let images_as_texels = u32::from(kind.images_as_texels);
    let lobes = u32::from(kind.lobes);
    let constants =
        [glossy, ways.source as u32, ways.caches(), spread, by_hand, near, lobes, kind.together, images_as_texels];
    let shadowed = kind.shadows == Shadows::PerLight;
    if kind.two_eyes {
        let (name, used) = if shadowed { ("gather_shadowed_eyes.comp", 9) } else { ("gather_eyes.comp", 7) };
        return gpu.compute(name, &constants[..used]);
    }
    match (shadowed, kind.proxies) {
        (false, false) => gpu.compute("gather_sums.comp", &constants[..7]),
        (false, true) => gpu.compute("gather.comp", &constants[..7]),
        (true, false) => gpu.compute("gather_shadowed_sums.comp", &constants),
        (true, true) => gpu.compute("gather_shadowed.comp", &constants),
    }
}

/// Resources of a pipeline from `sum_pipeline`.
#[derive(Clone, Copy)]
pub(super) struct SumBinds<'a> {
    pub(super) atlas: &'a Atlas,
    pub(super) live: &'a Live,
    /// VALs and their number.
    pub(super) vals: (&'a Buffer, &'a Buffer),
    pub(super) parts: &'a Buffer,
    /// With `SumKind::proxies`: the proxies, and the count of finished parts.
    pub(super) proxies: Option<(&'a Buffer, &'a Buffer)>,
    /// Only with shadows of every VAL.
    pub(super) depth_images: Option<&'a Buffer>,
    /// Only with two eyes.
    pub(super) second_parts: Option<&'a Buffer>,
}

impl SumBinds<'_> {
    pub(super) fn bind(&self, cmd: &Cmd<'_>, pipeline: &Pipeline) {
        let (vals, count) = self.vals;
        let mut resources: Vec<Bind<'_>> = vec![
            (&self.atlas.caches).into(),
            (&self.live.list).into(),
            (&self.live.args).into(),
            count.into(),
            Bind::SomeTexels(vals),
            vals.into(),
            self.parts.into(),
        ];
        resources.extend(self.proxies.iter().flat_map(|(proxies, arrived)| [Bind::from(*proxies), (*arrived).into()]));
        let [texels, words] = self.depth_images.map(binds).map_or([None; 2], |binds| binds.map(Some));
        resources.extend([texels, self.second_parts.map(Bind::Buffer), words].into_iter().flatten());
        cmd.bind(pipeline, &resources);
    }
}
