//! Stage 6: the compute shader that adds up VALs at caches, which further bounces use again. METHOD 3-4.

use super::atlas::Atlas;
use super::depth_images::binds;
use super::live::Live;
use super::settings::{ProxyWeight, Shadows, Ways};
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Gpu, Pipeline};

/// What a compute gather is made for.
#[derive(Clone, Copy, Debug)]
pub struct ComputeKind {
    /// A material has a glossy lobe.
    pub glossy: bool,
    /// How indirect light is shadowed.
    pub shadows: Shadows,
    /// VALs in a row that a cache sees or does not see as one, 1 or 4.
    pub together: u32,
    /// How many times lit caches light all caches afterwards.
    pub bounces: u32,
    /// VALs of surfaces that emit, whose light at a cache has not bounced yet.
    pub emitted: u32,
    /// What pulls proxies.
    pub weight: ProxyWeight,
    /// Most views of a frame.
    pub eyes: u32,
    /// What is nearer than this \[m\] is left to short rays; 0: nothing.
    pub near: f32,
}

impl ComputeKind {
    /// One gather without shadows.
    pub fn plain(glossy: bool) -> Self {
        let (shadows, weight) = (Shadows::Off, ProxyWeight::Irradiance);
        Self { glossy, shadows, together: 1, bounces: 0, emitted: 0, weight, eyes: 1, near: 0.0 }
    }
}

/// What sums are made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct SumKind {
    /// The glossy lobe's, too.
    pub(super) glossy: bool,
    pub(super) shadows: Shadows,
    /// VALs in a row that a cache sees or does not see as one.
    pub(super) together: u32,
    /// Proxies are made of the sums at once.
    pub(super) proxies: bool,
    /// The glossy lobe's are made for two eyes at once, with proxies.
    pub(super) two_eyes: bool,
    /// What is nearby is left to short rays.
    pub(super) near: bool,
    /// What caches see, with shadows of every VAL, is read as texels.
    pub(super) images_as_texels: bool,
}

/// The pipeline that adds up VALs.
pub(super) fn sum_pipeline(gpu: &Gpu, ways: &Ways, kind: SumKind) -> Result<Pipeline> {
    let spread = u32::from(kind.shadows == Shadows::Proxy);
    let by_hand = u32::from(gpu.is_software());
    let (glossy, near) = (u32::from(kind.glossy), u32::from(kind.near));
    let images_as_texels = u32::from(kind.images_as_texels);
    let constants = [glossy, ways.source as u32, ways.caches(), spread, by_hand, near, kind.together, images_as_texels];
    let shadowed = kind.shadows == Shadows::PerLight;
    if kind.two_eyes {
        let (name, used) = if shadowed { ("gather_shadowed_eyes.comp", 8) } else { ("gather_eyes.comp", 6) };
        return gpu.compute(name, &constants[..used]);
    }
    match (shadowed, kind.proxies) {
        (false, false) => gpu.compute("gather_sums.comp", &constants[..6]),
        (false, true) => gpu.compute("gather.comp", &constants[..6]),
        (true, false) => gpu.compute("gather_shadowed_sums.comp", &constants),
        (true, true) => gpu.compute("gather_shadowed.comp", &constants),
    }
}

/// What a pipeline of `sum_pipeline` reads and writes.
#[derive(Clone, Copy)]
pub(super) struct SumBinds<'a> {
    pub(super) atlas: &'a Atlas,
    pub(super) live: &'a Live,
    /// VALs and their number.
    pub(super) vals: (&'a Buffer, &'a Buffer),
    pub(super) parts: &'a Buffer,
    /// Where proxies are made at once: those, and the count of parts that are there.
    pub(super) proxies: Option<(&'a Buffer, &'a Buffer)>,
    /// With shadows of every VAL.
    pub(super) depth_images: Option<&'a Buffer>,
    /// With two eyes.
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
