//! Words that flags of `render` take, and what they mean.

use clap::ValueEnum;
use lightskin::frame::{Antialiasing, LightShadows, Shadows};

#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
pub(super) enum GiArg {
    /// Interpolated caches.
    #[default]
    Lightskin,
    /// Every virtual light onto every pixel.
    BruteForce,
    /// All light, by paths drawn at random on the CPU: the reference (see --spp and --match).
    PathTrace,
    /// Direct light of lights and of the largest flat surfaces that emit.
    Off,
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub(super) enum InterpolationArg {
    /// Facing irradiance and position of lit caches, faster kernel.
    #[default]
    Facing,
    /// Flux and position with the thesis's weights.
    Printed,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum InterpArg {
    /// At vertices: fast, but triangles must be small against the caches' distances.
    #[default]
    Vertex,
    /// At every pixel, whatever the triangles, which are left undivided.
    Texel,
}

/// Reads what tells where lamps and the sun shine.
pub(super) fn light_shadows(text: &str) -> Result<LightShadows, String> {
    match text.parse() {
        _ if text == "rays" => Ok(LightShadows::Rays),
        Ok(side @ 16..=16384) => Ok(LightShadows::Maps(side)),
        _ => Err("rays, or texels of a shadow map's side from 16 to 16384".into()),
    }
}

/// The same as one types it.
pub(super) fn light_shadows_word(light_shadows: LightShadows) -> String {
    match light_shadows {
        LightShadows::Rays => "rays".into(),
        LightShadows::Maps(side) => side.to_string(),
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum AntialiasingArg {
    /// None: a pixel shows the surface in its middle.
    Off,
    /// Four.
    #[value(name = "4")]
    Four,
    /// Eight.
    #[value(name = "8")]
    Eight,
}

impl AntialiasingArg {
    /// What one types for a kind.
    #[cfg(feature = "app")]
    pub(super) fn of(antialiasing: Antialiasing) -> Self {
        match antialiasing {
            Antialiasing::Off => Self::Off,
            Antialiasing::Four => Self::Four,
            Antialiasing::Eight => Self::Eight,
        }
    }
}

impl From<AntialiasingArg> for Antialiasing {
    fn from(arg: AntialiasingArg) -> Self {
        match arg {
            AntialiasingArg::Off => Self::Off,
            AntialiasingArg::Four => Self::Four,
            AntialiasingArg::Eight => Self::Eight,
        }
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub(super) enum ProxyWeightArg {
    /// Irradiance on the cache.
    #[default]
    Irradiance,
    /// Form factor, as printed.
    FormFactor,
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum NearArg {
    /// Caches alone.
    Off,
    /// Short rays at pixels; caches give what is farther away.
    Rays,
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum ShadowsArg {
    /// Nothing.
    Off,
    /// The other caches' discs, for each cache's light as a whole, after all bounces. Harder than they should be with
    /// clusters.
    Proxy,
    /// What the other caches stand for, for every virtual light.
    PerLight,
}

impl ShadowsArg {
    pub(super) fn kind(self) -> Shadows {
        match self {
            Self::Off => Shadows::Off,
            Self::Proxy => Shadows::Proxy,
            Self::PerLight => Shadows::PerLight,
        }
    }

    /// What one types for a kind.
    pub(super) fn of(shadows: Shadows) -> String {
        super::word(match shadows {
            Shadows::Off => Self::Off,
            Shadows::Proxy => Self::Proxy,
            Shadows::PerLight => Self::PerLight,
        })
    }
}
