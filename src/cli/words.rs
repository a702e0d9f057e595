//! Values of the flags of `render`.

use clap::ValueEnum;
use lightskin::frame::{Antialiasing, LightShadows, Near, Shadows};

#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
pub(super) enum GiArg {
    /// Light caches, in real time.
    #[default]
    Lightskin,
    /// Every virtual light at every pixel, without shadows. Slow; shows the error of interpolation.
    BruteForce,
    /// Path tracer on the CPU, as a reference.
    PathTrace,
    /// No indirect light.
    Off,
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub(super) enum InterpolationArg {
    /// Position of the proxy light, and the irradiance on a surface that faces it.
    #[default]
    Facing,
    /// Position and flux of the proxy light, with the weights of the thesis.
    Printed,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum InterpArg {
    /// At vertices. Fast; triangles must be small compared to the cache spacing.
    #[default]
    Vertex,
    /// At every pixel. Slower; triangles may have any size.
    Texel,
}

/// Parses the value of `--shadow-map`.
pub(super) fn light_shadows(text: &str) -> Result<LightShadows, String> {
    match text.parse() {
        _ if text == "rays" => Ok(LightShadows::Rays),
        Ok(side @ 16..=16384) => Ok(LightShadows::Maps(side)),
        _ => Err("needs rays, or the side of a shadow map from 16 to 16384 texels".into()),
    }
}

/// The value of `--shadow-map` for these shadows.
pub(super) fn light_shadows_word(light_shadows: LightShadows) -> String {
    match light_shadows {
        LightShadows::Rays => "rays".into(),
        LightShadows::Maps(side) => side.to_string(),
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum AntialiasingArg {
    /// No antialiasing: a pixel shows the surface at its centre.
    Off,
    /// Four extra sample points. Those on another surface take their light from the pixels around.
    Fast,
    /// Four extra sample points, shaded where they show another surface.
    #[value(name = "4")]
    Four,
    /// Eight extra sample points.
    #[value(name = "8")]
    Eight,
    /// The mean of 64 pictures, each through another point of the pixels. Slow; a reference for the others.
    #[value(name = "64")]
    Supersampled,
}

impl AntialiasingArg {
    /// The value of `--aa` for this setting.
    pub(super) fn of(antialiasing: Antialiasing) -> Self {
        match antialiasing {
            Antialiasing::Off => Self::Off,
            Antialiasing::Fast => Self::Fast,
            Antialiasing::Four => Self::Four,
            Antialiasing::Eight => Self::Eight,
            Antialiasing::Supersampled => Self::Supersampled,
        }
    }
}

impl From<AntialiasingArg> for Antialiasing {
    fn from(arg: AntialiasingArg) -> Self {
        match arg {
            AntialiasingArg::Off => Self::Off,
            AntialiasingArg::Fast => Self::Fast,
            AntialiasingArg::Four => Self::Four,
            AntialiasingArg::Eight => Self::Eight,
            AntialiasingArg::Supersampled => Self::Supersampled,
        }
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub(super) enum ProxyWeightArg {
    /// Irradiance on the cache.
    #[default]
    Irradiance,
    /// Form factor, as in the thesis.
    FormFactor,
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum NearArg {
    /// No rays: nearby light comes from the caches, like all other indirect light.
    Off,
    /// Short rays traced at pixels.
    Rays,
    /// Rays from pixels go on to the first surface. More accurate and slower; caches give the light of further bounces.
    Endless,
}

impl NearArg {
    /// The value of `--near` for this setting.
    pub(super) fn of(near: Near) -> Self {
        match near {
            Near::Off => Self::Off,
            Near::Rays { .. } => Self::Rays,
            Near::Endless { .. } => Self::Endless,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum ShadowsArg {
    /// No shadows of indirect light.
    Off,
    /// Dims the light of each cache as a whole. Cheaper; the method of the thesis.
    Proxy,
    /// Shadows each virtual light at each cache.
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

    /// The value of `--shadows` for this setting.
    pub(super) fn of(shadows: Shadows) -> String {
        super::word(match shadows {
            Shadows::Off => Self::Off,
            Shadows::Proxy => Self::Proxy,
            Shadows::PerLight => Self::PerLight,
        })
    }
}
