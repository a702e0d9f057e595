//! What shapes a frame besides scene, caches, camera and size. Only states that can be drawn can be written down, so
//! nothing here is ever refused. This file imports nothing of `frame`.

use crate::shared::{VAL_TILE, VALS_SHARED, VALS_STORAGE, VALS_TEXELS};
use glam::{Vec2, Vec3};

/// Everything that shapes a frame. Two that are equal draw equal pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How indirect light is made.
    pub indirect: Indirect,
    /// Texels of an RSM's side; six-view lights share as many.
    pub rsm: u32,
    /// What tells where the light of lamps and the sun arrives.
    pub light_shadows: LightShadows,
    /// How edges are smoothed.
    pub antialiasing: Antialiasing,
    /// How many surfaces show that are seen through, one behind another. METHOD 15.
    pub layers: u32,
    /// Stages whose inputs are those of the frame before are left out. Pictures do not change, times do.
    pub reuse: bool,
}

/// What tells where the light of lamps and the sun arrives. METHOD 14.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightShadows {
    /// Shadow maps with this many texels a side.
    Maps(u32),
    /// Rays from what pixels show; maps where the device cannot hold the scene for them.
    Rays,
}

impl LightShadows {
    /// Texels of a shadow map's side, where there is one.
    pub fn map(self) -> u32 {
        match self {
            Self::Maps(side) => side.max(1),
            Self::Rays => 2048,
        }
    }
}

/// At how many points of a pixel, beside its middle, other surfaces are looked for than the one in the middle. METHOD 13.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Antialiasing {
    /// None: a pixel shows the surface in its middle.
    #[default]
    Off,
    /// Four.
    Four,
    /// Eight.
    Eight,
}

/// How indirect light is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Indirect {
    /// Not at all: direct light alone.
    Off,
    /// Every VAL lights every pixel, without shadows, by one bounce: what caches are measured against.
    BruteForce,
    /// Caches are lit, and their lights interpolated. Needs a `World` with caches; without any it is `Off`.
    Caches(Caches),
}

/// How light gets to caches and from them to pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Caches {
    /// How VALs light caches.
    pub gather: Gather,
    /// Only caches that visible surfaces need are lit. Pictures do not change. Where caches light caches, bounce after
    /// bounce, all are lit.
    pub cull: bool,
    /// Kernel and quantities of stage 8.
    pub interpolation: Interpolation,
    /// What pulls a proxy's position.
    pub proxy_weight: ProxyWeight,
}

/// Stage 6. Each way carries what only it can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gather {
    /// A compute shader works through the list of live caches.
    Compute {
        /// How it is spread over the device.
        ways: Ways,
        /// Indirect bounces. With 0 caches are lit by surfaces that emit alone, and only where some are no area lights.
        bounces: u32,
        /// How indirect light is shadowed.
        shadows: Shadows,
        /// Where light and shade from nearby come from.
        near: Near,
    },
    /// Tiles of VALs are drawn over the atlas and added to float images.
    Draws {
        /// Where VALs are read from.
        source: DrawSource,
        /// VALs of one draw; rounded up to whole tiles of 64.
        tile: u32,
        /// Stage 7: the discs of the other caches dim a cache's proxy lights.
        dim: bool,
    },
    /// Clusters of VALs light caches where that is near enough.
    Clusters {
        /// Where it is.
        rule: ClusterRule,
        /// Stage 7, as above.
        dim: bool,
    },
}

/// How the compute gather is spread over a device. All give the same light up to rounding, so the fastest is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ways {
    /// Where VALs are read from.
    pub source: ValSource,
    /// Caches that a thread keeps in registers, 1 to 16.
    pub caches_per_thread: u32,
    /// VALs that a thread adds up; rounded up to whole tiles of 64.
    pub split: u32,
}

/// Where the compute gather reads VALs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ValSource {
    /// A texel buffer.
    Texels = VALS_TEXELS,
    /// A storage buffer.
    Storage = VALS_STORAGE,
    /// The workgroup's memory, tile by tile.
    Shared = VALS_SHARED,
}

/// Where the gather by draws reads VALs: fragments share no memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DrawSource {
    /// A texel buffer.
    Texels = VALS_TEXELS,
    /// A storage buffer.
    Storage = VALS_STORAGE,
}

/// When a cluster stands for its VALs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClusterRule {
    /// It is farther away than so many of its radii, and its normals are alike.
    Distance(f32),
    /// The most by which it could be wrong is no more than this share of what the cache receives.
    Error(f32),
}

/// What the light of a vertex's caches is averaged as. METHOD 5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Facing irradiance and position of the lit caches, faster kernel: bounded, and the better one by measurement.
    #[default]
    Facing,
    /// Flux and position with the thesis's weights, eq. 5.49 to 5.51.
    Printed,
}

/// How strongly a VAL pulls a proxy's position. METHOD 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ProxyWeight {
    /// By its irradiance on the cache.
    #[default]
    Irradiance,
    /// By its form factor, as eq. 5.42 prints it.
    FormFactor,
}

/// How indirect light is shadowed. METHOD 6.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shadows {
    /// Nothing is.
    #[default]
    Off,
    /// Stage 7: the discs of the other caches dim a cache's proxy lights.
    Proxy,
    /// Stage 6 tests every VAL against what each cache sees of the others' rectangles.
    PerLight,
}

/// Where the light and shade come from that what is within one spacing of the caches gives to a pixel. METHOD 11.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Near {
    /// From caches, like all else.
    #[default]
    Off,
    /// From short rays at pixels; caches leave out what is nearer than half of their spacing.
    Rays {
        /// Rays of a pixel that has rays, 1 to 32; 16 neighbours share theirs.
        per_pixel: u32,
        /// Pixels and rows from one with rays to the next.
        every: u32,
    },
}

/// How a picture is shown; changes from frame to frame at no cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// Curve from scene to display.
    pub tonemap: Tonemap,
    /// How bright.
    pub exposure: Exposure,
    /// What shows where no surface is.
    pub behind: Behind,
}

/// What a picture shows where no surface is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Behind {
    /// What the scene has there, exposed like all else: [`crate::scene::studio::Backdrop`].
    #[default]
    Scene,
    /// This colour of the display, linear Rec.709 in [0, 1].
    Color(Vec3),
    /// Nothing: alpha is 0.
    Transparent,
}

/// Curve from scene to display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Tonemap {
    /// Khronos PBR Neutral.
    #[default]
    PbrNeutral = 0,
    /// AgX.
    Agx = 1,
    /// ACES, Hill's fit.
    Aces = 2,
    /// None but clipping.
    Linear = 3,
}

/// How bright the picture is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// The log-average luminance becomes middle grey.
    #[default]
    Automatic,
    /// Exposure value at ISO 100: 1.2 * 2^EV cd/m^2 becomes 1.
    Ev(f32),
}

/// What changes the picture, as one choice; the same on every device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quality {
    /// A quick look: few caches, small maps, no shadows of indirect light.
    Low,
    /// Shadows of each cache's light as a whole.
    Medium,
    /// Shadows of every virtual light, where caches are not very many.
    #[default]
    High,
    /// Twice as dense in everything: what the others are compared with.
    Reference,
}

impl Quality {
    /// All levels, least first.
    pub const ALL: [Self; 4] = [Self::Low, Self::Medium, Self::High, Self::Reference];

    /// Number of caches over the whole scene, about.
    pub fn caches(self) -> usize {
        match self {
            Self::Low => 500,
            Self::Medium => 1000,
            Self::High => 2000,
            Self::Reference => 4000,
        }
    }

    /// Caches that each vertex refers to.
    pub fn references(self) -> usize {
        if self == Self::Reference { 16 } else { 8 }
    }

    /// Texels of an RSM's side.
    pub fn rsm(self) -> u32 {
        match self {
            Self::Low => 64,
            Self::Medium => 96,
            Self::High => 128,
            Self::Reference => 256,
        }
    }

    /// What tells where the light of lamps and the sun arrives.
    pub fn light_shadows(self) -> LightShadows {
        match self {
            Self::Low => LightShadows::Maps(1024),
            Self::Medium => LightShadows::Maps(2048),
            Self::High | Self::Reference => LightShadows::Rays,
        }
    }

    /// How edges are smoothed.
    pub fn antialiasing(self) -> Antialiasing {
        match self {
            Self::Low => Antialiasing::Off,
            Self::Medium | Self::High => Antialiasing::Four,
            Self::Reference => Antialiasing::Eight,
        }
    }

    /// Surfaces that are seen through, one behind another.
    pub fn layers(self) -> u32 {
        match self {
            Self::Low => 1,
            Self::Medium => 2,
            Self::High => 4,
            Self::Reference => 8,
        }
    }

    /// Indirect bounces. Without shadows of every VAL light leaks, and more with each.
    pub fn bounces(self) -> u32 {
        match self {
            Self::Low | Self::Medium => 4,
            Self::High | Self::Reference => 8,
        }
    }

    /// Light and shade from nearby.
    pub fn near(self) -> Near {
        match self {
            Self::Low | Self::Medium => Near::Off,
            Self::High => Near::Rays { per_pixel: 8, every: 2 },
            Self::Reference => Near::Rays { per_pixel: 32, every: 1 },
        }
    }

    /// Shadows of indirect light for this many caches. Without rays they test pairs of caches, which get too many.
    pub fn shadows(self, caches: usize, near: Near) -> Shadows {
        let best = match caches {
            0..=4096 => Shadows::PerLight,
            4097..=20_000 if near != Near::Off => Shadows::PerLight,
            4097..=20_000 => Shadows::Proxy,
            _ => Shadows::Off,
        };
        best.min(match self {
            Self::Low => Shadows::Off,
            Self::Medium => Shadows::Proxy,
            Self::High | Self::Reference => Shadows::PerLight,
        })
    }
}

impl Settings {
    /// What is drawn at a level for a world with so many caches: the one default of the command line, the reports and the
    /// library. Ways of the gather are fixed; `tune::fastest` measures the device's own.
    pub fn at(quality: Quality, caches: usize) -> Self {
        Self {
            indirect: Indirect::Caches(Caches {
                gather: Gather::Compute {
                    ways: Ways::default(),
                    bounces: quality.bounces(),
                    shadows: quality.shadows(caches, quality.near()),
                    near: quality.near(),
                },
                cull: true,
                interpolation: Interpolation::Facing,
                proxy_weight: ProxyWeight::Irradiance,
            }),
            rsm: quality.rsm(),
            light_shadows: quality.light_shadows(),
            antialiasing: quality.antialiasing(),
            layers: quality.layers(),
            reuse: false,
        }
    }

    /// The same with these ways of the compute gather, where that is what is used.
    pub fn with_ways(mut self, new: Ways) -> Self {
        if let Indirect::Caches(Caches { gather: Gather::Compute { ways, .. }, .. }) = &mut self.indirect {
            *ways = new;
        }
        self
    }

    /// The weights by which VALs pull proxies.
    pub fn proxy_weight(&self) -> ProxyWeight {
        if let Indirect::Caches(caches) = &self.indirect { caches.proxy_weight } else { ProxyWeight::Irradiance }
    }
}

impl Antialiasing {
    /// Points beside the middle.
    pub fn samples(self) -> u32 {
        match self {
            Self::Off => 0,
            Self::Four => 4,
            Self::Eight => 8,
        }
    }

    /// Where they are, from the middle \[pixels\]. With the middle they are a lattice: no two in one row or column.
    pub fn offsets(self) -> impl Iterator<Item = Vec2> {
        let all = self.samples() + 1;
        // Within half a pixel of the middle.
        let centred = move |i: u32| ((i % all) as f32 / all as f32 + 0.5).fract() - 0.5;
        (1..all).map(move |i| Vec2::new(centred(i), centred(2 * i)))
    }
}

impl Near {
    /// Rays of a pixel that has some, and pixels and rows from one to the next.
    pub fn rays(self) -> (u32, u32) {
        match self {
            Self::Off => (0, 1),
            Self::Rays { per_pixel, every } => (per_pixel.clamp(1, 32), every.max(1)),
        }
    }
}

impl Gather {
    /// How indirect light is shadowed.
    pub fn shadows(&self) -> Shadows {
        match *self {
            Self::Compute { shadows, .. } => shadows,
            Self::Draws { dim, .. } | Self::Clusters { dim, .. } => {
                if dim {
                    Shadows::Proxy
                } else {
                    Shadows::Off
                }
            }
        }
    }

    /// Where light and shade from nearby come from.
    pub fn near(&self) -> Near {
        if let Self::Compute { near, .. } = *self { near } else { Near::Off }
    }

    /// Indirect bounces.
    pub fn bounces(&self) -> u32 {
        if let Self::Compute { bounces, .. } = *self { bounces } else { 1 }
    }

    /// In reports.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Compute { .. } => "compute",
            Self::Draws { .. } => "fragment",
            Self::Clusters { .. } => "clusters",
        }
    }
}

impl Default for Ways {
    fn default() -> Self {
        Self { source: ValSource::Texels, caches_per_thread: 4, split: 2048 }
    }
}

impl Ways {
    /// Caches that a thread keeps, within what shaders are made for.
    pub fn caches(&self) -> u32 {
        self.caches_per_thread.clamp(1, 16)
    }

    /// The same for this many VALs, on a device whose shaders see this many texels of a buffer: more VALs than that are read from
    /// the storage buffer.
    pub(super) fn within(self, most_texels: u64, vals: u32) -> Self {
        let texels = 3 * u64::from(vals.next_multiple_of(VAL_TILE));
        let fit = self.source != ValSource::Texels || texels <= most_texels;
        if fit { self } else { Self { source: ValSource::Storage, ..self } }
    }
}

/// VALs of one draw, as whole tiles.
pub(super) fn whole_tiles(vals: u32) -> u32 {
    vals.clamp(1, 1 << 25).next_multiple_of(VAL_TILE)
}

impl ValSource {
    /// In reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Texels => "texels",
            Self::Storage => "storage",
            Self::Shared => "shared",
        }
    }
}

impl DrawSource {
    /// In reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Texels => "texels",
            Self::Storage => "storage",
        }
    }
}
