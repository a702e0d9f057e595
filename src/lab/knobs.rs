//! Settings as a flat struct, for sweeps and tests that vary one at a time; and a frame with one view.

use crate::error::Result;
use crate::frame::settings::{Caches, Gather};
use crate::frame::{
    Antialiasing, ClusterRule, DrawSource, Exposure, Indirect, Interpolation, Light, LightShadows, Look, Near, Picture,
    Plan, ProxyWeight, Quality, Settings, Shadows, Tonemap, View, Ways, World, record,
};
use crate::gpu::{Cmd, Gpu};
use crate::scene::Scene;

/// Kind of indirect light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gi {
    /// Interpolated caches.
    #[default]
    LightSkin,
    /// Every VAL onto every pixel.
    BruteForce,
    /// None.
    Off,
}

/// Method of lighting the caches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Path {
    /// Compute shader over a list of caches.
    #[default]
    Compute,
    /// Additive draws into float targets, each with this many VALs.
    Draws(DrawSource, u32),
    /// Clusters of VALs.
    Clusters(ClusterRule),
}

impl Path {
    /// The default gather by draws.
    pub const DRAWS: Self = Self::Draws(DrawSource::Texels, 4096);
}

/// All settings and the picture size as a flat struct. Some combinations are invalid: see `go_together`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knobs {
    /// Picture \[pixels\].
    pub size: [u32; 2],
    /// Indirect light.
    pub gi: Gi,
    /// Indirect bounces; 0 is direct light only, including that of emitting surfaces.
    pub bounces: u32,
    /// Side of an RSM \[texels\].
    pub rsm: u32,
    /// Shadows of lamps and the sun.
    pub light_shadows: LightShadows,
    /// Kernel and quantities of stage 8.
    pub interpolation: Interpolation,
    /// Weights of stage 6.
    pub proxy_weight: ProxyWeight,
    /// Method of stage 6.
    pub path: Path,
    /// Parameters of the compute gather.
    pub ways: Ways,
    /// Only caches that visible surfaces need are lit.
    pub cull: bool,
    /// Soft shadows of indirect light.
    pub shadows: Shadows,
    /// Light and occlusion from nearby surfaces.
    pub near: Near,
    /// Antialiasing of edges.
    pub antialiasing: Antialiasing,
    /// Largest number of transparent layers.
    pub layers: u32,
    /// Whether stages with unchanged inputs are skipped.
    pub reuse: bool,
    /// Tone curve of stage 11.
    pub tonemap: Tonemap,
    /// Exposure of stage 11.
    pub exposure: Exposure,
}

impl Knobs {
    /// The default of `render` for this many caches, but without antialiasing, like the references.
    pub fn at(quality: Quality, caches: usize, size: [u32; 2]) -> Self {
        Self {
            rsm: quality.rsm(),
            light_shadows: quality.light_shadows(),
            shadows: quality.shadows(caches, quality.near()),
            near: quality.near(),
            ..Self::plain(size)
        }
    }

    /// Caches without shadows: the thesis's method.
    pub fn plain(size: [u32; 2]) -> Self {
        Self {
            size,
            gi: Gi::LightSkin,
            bounces: 1,
            rsm: Quality::High.rsm(),
            light_shadows: LightShadows::Maps(2048),
            interpolation: Interpolation::Facing,
            proxy_weight: ProxyWeight::Irradiance,
            path: Path::Compute,
            ways: Ways::default(),
            cull: true,
            shadows: Shadows::Off,
            near: Near::Off,
            antialiasing: Antialiasing::Off,
            layers: Quality::High.layers(),
            reuse: false,
            tonemap: Tonemap::PbrNeutral,
            exposure: Exposure::Automatic,
        }
    }

    /// Whether these knobs form valid settings: per-light shadows and bounces need the compute gather.
    pub fn go_together(&self) -> bool {
        match (self.gi, self.path) {
            (Gi::Off, _) | (_, Path::Compute) => true,
            (Gi::BruteForce, _) => self.bounces <= 1,
            (Gi::LightSkin, _) => self.bounces <= 1 && self.shadows != Shadows::PerLight && self.near == Near::Off,
        }
    }

    /// The settings.
    ///
    /// # Panics
    /// Panics if the knobs do not go together.
    pub fn settings(&self) -> Settings {
        assert!(self.go_together(), "{self:?} is no frame");
        let dim = self.shadows == Shadows::Proxy;
        let caches = || {
            Indirect::Caches(Caches {
                gather: match self.path {
                    Path::Compute => {
                        let Self { ways, bounces, shadows, near, .. } = *self;
                        Gather::Compute { ways, bounces, shadows, near }
                    }
                    Path::Draws(source, tile) => Gather::Draws { source, tile, dim },
                    Path::Clusters(rule) => Gather::Clusters { rule, dim },
                },
                cull: self.cull,
                interpolation: self.interpolation,
                proxy_weight: self.proxy_weight,
            })
        };
        Settings {
            indirect: match (self.gi, self.path) {
                (Gi::Off, _) => Indirect::Off,
                (Gi::LightSkin, Path::Compute) => caches(),
                _ if self.bounces == 0 => Indirect::Off,
                (Gi::BruteForce, _) => Indirect::BruteForce,
                (Gi::LightSkin, _) => caches(),
            },
            rsm: self.rsm,
            light_shadows: self.light_shadows,
            antialiasing: self.antialiasing,
            layers: self.layers,
            reuse: self.reuse,
        }
    }

    /// Tone mapping and exposure.
    pub fn look(&self) -> Look {
        Look { tonemap: self.tonemap, exposure: self.exposure, ..Look::default() }
    }
}

/// One view of a world: its light and picture.
pub struct Frame {
    /// The light.
    pub light: Light,
    /// The picture.
    pub picture: Picture,
    /// Tone mapping and exposure.
    pub look: Look,
}

impl Frame {
    /// Creates light and picture.
    ///
    /// # Errors
    /// As `Light::new` and `Picture::new`.
    pub fn new(gpu: &Gpu, scene: &Scene, world: &World, knobs: &Knobs) -> Result<Self> {
        let light = Light::new(gpu, scene, world, &knobs.settings(), 1)?;
        let picture = Picture::new(gpu, world, &light, knobs.size)?;
        Ok(Self { light, picture, look: knobs.look() })
    }

    /// The plan of stages.
    pub fn plan(&self) -> &Plan {
        &self.light.plan
    }

    /// Records one frame.
    pub fn record(&mut self, cmd: &Cmd<'_>, world: &World, view: &View) {
        record(cmd, world, &mut self.light, &mut [(*view, &mut self.picture)], &self.look);
    }
}
