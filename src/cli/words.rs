//! Words that flags of `render` take, and what they mean.

use clap::ValueEnum;
use lightskin::frame::{Antialiasing, LightShadows, Shadows};

#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
pub(super) enum GiArg {
    /// Light caches.
    #[default]
    Lightskin,
    /// Every virtual light at every pixel, without shadows: slow, measures interpolation.
    BruteForce,
    /// A path tracer on the CPU: the reference.
    PathTrace,
    /// No indirect light.
    Off,
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub(super) enum InterpolationArg {
    /// The light that a surface facing the proxy light would receive, and the proxy's position.
    #[default]
    Facing,
    /// Flux and position, with the thesis's weights.
    Printed,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum InterpArg {
    /// At vertices: fast; triangles must be small against the spacing of the caches.
    #[default]
    Vertex,
    /// At every pixel: slower; triangles may be of any size.
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
    /// None: a pixel shows what is in its middle.
    Off,
    /// Four extra points.
    #[value(name = "4")]
    Four,
    /// Eight extra points.
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
    /// Their irradiance on the cache.
    #[default]
    Irradiance,
    /// Their form factor, as in the thesis.
    FormFactor,
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum NearArg {
    /// From caches, like all other indirect light.
    Off,
    /// From short rays at pixels.
    Rays,
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum ShadowsArg {
    /// Not at all.
    Off,
    /// Each cache's light is dimmed as a whole: cheaper, the thesis's method.
    Proxy,
    /// Each virtual light is shadowed at each cache.
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
