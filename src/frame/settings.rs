//! Settings of a frame, apart from scene, caches, camera and size. The types can only express valid combinations, so no
//! settings are ever rejected. This file imports nothing from `frame`.

use crate::shared::{VAL_TILE, VALS_SHARED, VALS_STORAGE, VALS_TEXELS};
use glam::{Vec2, Vec3};

/// All settings of a frame. Equal settings draw equal pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How indirect light is computed.
    pub indirect: Indirect,
    /// Texels along each side of an RSM. The views of a six-view light together share this texel budget.
    pub rsm: u32,
    /// How shadows of punctual lights, area lights and the sun are computed.
    pub light_shadows: LightShadows,
    /// How edges are antialiased.
    pub antialiasing: Antialiasing,
    /// Maximum number of transparent layers per pixel. METHOD 15.
    pub layers: u32,
    /// Skips stages whose inputs have not changed since the previous frame. This changes times, not pictures.
    pub reuse: bool,
}

/// How shadows of punctual lights, area lights and the sun are computed. METHOD 14.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightShadows {
    /// Shadow maps with this many texels a side.
    Maps(u32),
    /// Rays from the visible surfaces. Falls back to maps where the device cannot hold the scene for ray tracing.
    Rays,
}

impl LightShadows {
    /// Texels along each side of a shadow map. With rays, this is the size of the fallback maps.
    pub fn map(self) -> u32 {
        match self {
            Self::Maps(side) => side.max(1),
            Self::Rays => 2048,
        }
    }
}

/// How edges are smoothed. METHOD 13.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Antialiasing {
    /// None: a pixel shows the surface at its centre.
    #[default]
    Off,
    /// Four points of a pixel, besides its centre, are drawn at once and not shaded. Those on another surface take the
    /// light of pixels around.
    Fast,
    /// Four points are drawn and shaded, too.
    Four,
    /// Eight points.
    Eight,
    /// None: the picture is one of many, each through another point of the pixels, and the caller takes their mean.
    /// Textures are filtered over a point's share of the pixel. See `View::sample`.
    Supersampled,
}

/// Columns and rows of a pixel's points with supersampling.
pub const SUPERSAMPLES: u32 = 8;

/// How indirect light is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Indirect {
    /// Direct light only.
    Off,
    /// Every VAL lights every pixel, without shadows and with one bounce: the reference for caches.
    BruteForce,
    /// Caches are lit and their light is interpolated. Needs a `World` with caches; without them it acts as `Off`.
    Caches(Caches),
}

/// How light reaches caches, and pixels from caches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Caches {
    /// How VALs light caches.
    pub gather: Gather,
    /// Lights only the caches that visible surfaces need. Pictures do not change. With further bounces all caches are
    /// lit, because each one lights others.
    pub cull: bool,
    /// Kernel of stage 8 and the quantities it averages.
    pub interpolation: Interpolation,
    /// Weights for the position of a proxy.
    pub proxy_weight: ProxyWeight,
}

/// Method of stage 6. Each variant carries the options that only it supports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gather {
    /// A compute shader processes the list of live caches.
    Compute {
        /// How the work is distributed over the device.
        ways: Ways,
        /// Indirect bounces. With 0, only emissive surfaces that are not area lights light the caches, if there are
        /// any.
        bounces: u32,
        /// How indirect light is shadowed.
        shadows: Shadows,
        /// Source of light and occlusion from nearby surfaces.
        near: Near,
    },
    /// Tiles of VALs are drawn over the atlas and added into float images by blending.
    Draws {
        /// Where VALs are read from.
        source: DrawSource,
        /// VALs per draw; rounded up to whole tiles of 64.
        tile: u32,
        /// Stage 7: the discs of other caches dim the proxy lights of a cache.
        dim: bool,
    },
    /// Clusters of VALs light a cache where they approximate the VALs well enough.
    Clusters {
        /// When a cluster is used.
        rule: ClusterRule,
        /// Stage 7, as in `Draws`.
        dim: bool,
    },
}

/// How the compute gather is distributed over a device. All ways give the same light up to rounding, so the fastest one
/// is found by measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ways {
    /// Where VALs are read from.
    pub source: ValSource,
    /// Caches that a thread keeps in registers, 1 to 16.
    pub caches_per_thread: u32,
    /// VALs that a thread sums; rounded up to whole tiles of 64.
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
    /// Workgroup shared memory, loaded tile by tile.
    Shared = VALS_SHARED,
}

/// Where the gather by draws reads VALs. Fragments have no shared memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DrawSource {
    /// A texel buffer.
    Texels = VALS_TEXELS,
    /// A storage buffer.
    Storage = VALS_STORAGE,
}

/// When a cluster replaces its VALs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClusterRule {
    /// Its distance is more than this many of its radii, and its normals are similar.
    Distance(f32),
    /// The upper bound of its error is at most this fraction of the light that the cache receives.
    Error(f32),
}

/// Quantities and kernel of the average over a vertex's caches. METHOD 5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Averages facing irradiance and position of the lit caches with a faster kernel: bounded, and better by
    /// measurement.
    #[default]
    Facing,
    /// Averages flux and position with the thesis's weights, eq. 5.49 to 5.51.
    Printed,
}

/// Weight of a VAL in a proxy's position. METHOD 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ProxyWeight {
    /// Its irradiance at the cache.
    #[default]
    Irradiance,
    /// Its form factor, as printed in eq. 5.42.
    FormFactor,
}

/// How indirect light is shadowed. METHOD 6.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shadows {
    /// Without shadows.
    #[default]
    Off,
    /// Stage 7: the discs of other caches dim the proxy lights of a cache.
    Proxy,
    /// Stage 6 tests every VAL against the rectangles of the other caches, as each cache sees them.
    PerLight,
}

/// Source of light and occlusion that caches cannot resolve, as from surfaces within one cache spacing of a pixel. METHOD 11.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Near {
    /// From caches, as at all other distances.
    #[default]
    Off,
    /// From short rays at pixels. Caches then leave out surfaces nearer than half of their spacing.
    Rays {
        /// Rays per traced pixel, 1 to 32. 16 neighbouring traced pixels share their rays.
        per_pixel: u32,
        /// Distance in columns and rows between traced pixels. 0: 2, but 1 in pictures below `SMALL_PICTURE`.
        every: u32,
    },
    /// As `Rays`, but they go on to the first surface. Caches give only the light of further bounces.
    Endless {
        /// Rays per traced pixel, 1 to 32.
        per_pixel: u32,
        /// Distance in columns and rows between traced pixels, as in `Rays`.
        every: u32,
    },
}

/// Number of pixels below which a picture is small: there rays at every pixel cost little, and light that a few of them
/// share would be blurred over large parts of it.
pub const SMALL_PICTURE: u32 = 640 * 360;

/// How a picture is displayed. It may change every frame at no cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// Curve from scene to display.
    pub tonemap: Tonemap,
    /// Exposure.
    pub exposure: Exposure,
    /// What the picture shows where there is no surface.
    pub behind: Behind,
}

/// What the picture shows where there is no surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Behind {
    /// The scene's own background, exposed like the surfaces: [`crate::scene::studio::Backdrop`].
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
    /// No curve, only clipping.
    Linear = 3,
}

/// Exposure of the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// The log-average luminance becomes middle grey.
    #[default]
    Automatic,
    /// Exposure value at ISO 100: 1.2 * 2^EV cd/m^2 becomes 1.
    Ev(f32),
}

/// Quality level: one choice for everything that affects the picture. It does not depend on the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quality {
    /// A quick look: few caches, small maps, no shadows of indirect light.
    Low,
    /// Shadows for the light of each cache as a whole.
    Medium,
    /// Shadows for every VAL, unless there are very many caches.
    #[default]
    High,
    /// Twice the density of `High` in everything: the reference for the other levels.
    Reference,
}

impl Quality {
    /// All levels, lowest first.
    pub const ALL: [Self; 4] = [Self::Low, Self::Medium, Self::High, Self::Reference];

    /// The value of `--quality`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Low => "low",
            Self::Medium => "medium",
            Self::High => "high",
            Self::Reference => "reference",
        }
    }

    /// Approximate number of caches in the whole scene.
    pub fn caches(self) -> usize {
        match self {
            Self::Low => 500,
            Self::Medium => 1000,
            Self::High => 2000,
            Self::Reference => 4000,
        }
    }

    /// Caches that each vertex references.
    pub fn references(self) -> usize {
        if self == Self::Reference { 16 } else { 8 }
    }

    /// Texels along each side of an RSM.
    pub fn rsm(self) -> u32 {
        match self {
            Self::Low => 64,
            Self::Medium => 96,
            Self::High => 128,
            Self::Reference => 256,
        }
    }

    /// How shadows of direct light are computed.
    pub fn light_shadows(self) -> LightShadows {
        match self {
            Self::Low => LightShadows::Maps(1024),
            Self::Medium => LightShadows::Maps(2048),
            Self::High | Self::Reference => LightShadows::Rays,
        }
    }

    /// How edges are antialiased in one picture. `render` supersamples at `Reference`.
    pub fn antialiasing(self) -> Antialiasing {
        match self {
            Self::Low => Antialiasing::Off,
            Self::Medium => Antialiasing::Fast,
            Self::High => Antialiasing::Four,
            Self::Reference => Antialiasing::Eight,
        }
    }

    /// Maximum number of transparent layers per pixel.
    pub fn layers(self) -> u32 {
        match self {
            Self::Low => 1,
            Self::Medium => 2,
            Self::High => 4,
            Self::Reference => 8,
        }
    }

    /// Indirect bounces. Without shadows for every VAL, light leaks, and each bounce leaks more.
    pub const fn bounces(self) -> u32 {
        match self {
            Self::Low | Self::Medium => 4,
            Self::High | Self::Reference => 16,
        }
    }

    /// Source of light and occlusion from nearby surfaces.
    pub fn near(self) -> Near {
        match self {
            Self::Low | Self::Medium => Near::Off,
            Self::High => Near::Rays { per_pixel: 8, every: 0 },
            Self::Reference => Near::Endless { per_pixel: 32, every: 1 },
        }
    }

    /// Shadows of indirect light for this many caches. Without short rays, shadows test pairs of caches, and their
    /// number grows too large.
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
    /// Settings of a quality level for a world with this many caches: the common default of the command line, the
    /// reports and the library. The ways of the gather are fixed; `tune::fastest` measures the best ones for a device.
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

    /// The same settings with these ways of the compute gather. Without a compute gather nothing changes.
    pub fn with_ways(mut self, new: Ways) -> Self {
        if let Indirect::Caches(Caches { gather: Gather::Compute { ways, .. }, .. }) = &mut self.indirect {
            *ways = new;
        }
        self
    }

    /// Weight of VALs in the positions of proxies.
    pub fn proxy_weight(&self) -> ProxyWeight {
        if let Indirect::Caches(caches) = &self.indirect { caches.proxy_weight } else { ProxyWeight::Irradiance }
    }
}

impl Antialiasing {
    /// Number of points, besides the centre, that are drawn and shaded.
    pub fn shaded_points(self) -> u32 {
        match self {
            Self::Off | Self::Fast | Self::Supersampled => 0,
            Self::Four => 4,
            Self::Eight => 8,
        }
    }

    /// Number of points, besides the centre, over which the light of a pixel is averaged.
    pub fn points(self) -> u32 {
        if self == Self::Fast { crate::gpu::SAMPLES } else { self.shaded_points() }
    }

    /// Number of points, besides the first, at which textures are looked up, in one picture or in many. Each covers its
    /// share of the pixel.
    pub(super) fn textured_points(self) -> u32 {
        if self == Self::Supersampled { SUPERSAMPLES * SUPERSAMPLES - 1 } else { self.shaded_points() }
    }

    /// Offsets of the points from the centre \[pixels\]. Those of four and eight points form a lattice with the centre:
    /// no two share a row or column. Those of the fast kind are Vulkan's standard samples.
    pub fn offsets(self) -> impl Iterator<Item = Vec2> {
        let all = self.points() + 1;
        // Within half a pixel of the centre.
        let centred = move |i: u32| ((i % all) as f32 / all as f32 + 0.5).fract() - 0.5;
        let standard = [Vec2::new(-1.0, -3.0), Vec2::new(3.0, -1.0), Vec2::new(-3.0, 1.0), Vec2::new(1.0, 3.0)];
        let point = move |i: u32| match self {
            Self::Fast => standard[i as usize - 1] / 8.0,
            _ => Vec2::new(centred(i), centred(2 * i)),
        };
        (1..all).map(point)
    }
}

impl Near {
    /// Rays per traced pixel, and the distance between traced pixels, as set. `None` without rays.
    pub fn rays(self) -> Option<[u32; 2]> {
        match self {
            Self::Off => None,
            Self::Rays { per_pixel, every } | Self::Endless { per_pixel, every } => Some([per_pixel, every]),
        }
    }

    /// Rays per traced pixel.
    pub fn per_pixel(self) -> u32 {
        self.rays().map_or(0, |[per_pixel, _]| per_pixel.clamp(1, 32))
    }

    /// Distance in columns and rows between traced pixels of a picture.
    pub fn every(self, [width, height]: [u32; 2]) -> u32 {
        match self.rays() {
            Some([_, 0]) if width * height >= SMALL_PICTURE => 2,
            Some([_, every]) => every.max(1),
            None => 1,
        }
    }
}

impl Gather {
    /// The gather by draws as `--gather fragment` requests it; `dim`: with stage 7.
    pub fn draws(dim: bool) -> Self {
        Self::Draws { source: DrawSource::Texels, tile: 4096, dim }
    }

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

    /// Source of light and occlusion from nearby surfaces.
    pub fn near(&self) -> Near {
        if let Self::Compute { near, .. } = *self { near } else { Near::Off }
    }

    /// Indirect bounces.
    pub fn bounces(&self) -> u32 {
        if let Self::Compute { bounces, .. } = *self { bounces } else { 1 }
    }

    /// Name in reports.
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
    /// Caches per thread, limited to the range that shaders support.
    pub fn caches(&self) -> u32 {
        self.caches_per_thread.clamp(1, 16)
    }

    /// The same ways for this many VALs on a device whose shaders can read `most_texels` texels of a buffer. If the
    /// VALs need more texels, they are read from the storage buffer.
    pub(super) fn within(self, most_texels: u64, vals: u32) -> Self {
        let texels = 3 * u64::from(vals.next_multiple_of(VAL_TILE));
        let fit = self.source != ValSource::Texels || texels <= most_texels;
        if fit { self } else { Self { source: ValSource::Storage, ..self } }
    }
}

/// VALs per draw, rounded up to whole tiles.
pub(super) fn whole_tiles(vals: u32) -> u32 {
    vals.clamp(1, 1 << 25).next_multiple_of(VAL_TILE)
}

impl ValSource {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Texels => "texels",
            Self::Storage => "storage",
            Self::Shared => "shared",
        }
    }
}

impl DrawSource {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Texels => "texels",
            Self::Storage => "storage",
        }
    }
}
