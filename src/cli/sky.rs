//! Flags for the sky, the sizes of lights, and the background.

use anyhow::{Result, bail};
use clap::Args;
use glam::Vec3;
use lightskin::frame::Behind;
use lightskin::image::read_radiance;
use lightskin::reference::tonemap::linear_from_srgb;
use lightskin::scene::sky::Sky;
use lightskin::scene::studio::Backdrop;
use lightskin::scene::{Light, LightKind, Scene};
use std::path::PathBuf;

/// Heading of the help.
pub(super) const HEADING: &str = "Light and background";

#[derive(Args, Clone, PartialEq)]
#[command(next_help_heading = HEADING)]
pub(crate) struct SkyArgs {
    /// Environment map: an equirectangular .hdr or .exr picture in cd/m^2.
    ///
    /// The middle column of the picture is the direction -Z.
    #[arg(long, value_name = "FILE", group = "any_sky")]
    pub(crate) sky: Option<PathBuf>,
    /// Uniform sky of this radiance [cd/m^2].
    #[arg(long, value_name = "R,G,B", group = "any_sky", value_parser = color)]
    pub(crate) sky_color: Option<Vec3>,
    /// Number of directional lights that approximate the sky for methods that cannot use the sky itself.
    ///
    /// These are --gather fragment, clusters and brute force.
    #[arg(long, hide_short_help = true, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1024))]
    sky_lights: u32,
    /// Multiply the radiance of --sky or --sky-color by this factor.
    #[arg(long, value_name = "F", default_value_t = 1.0, requires = "any_sky", value_parser = super::positive)]
    pub(crate) sky_scale: f64,
    /// Rotate --sky about +Y [degrees], counter-clockwise seen from above.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, requires = "sky", value_parser = super::finite)]
    pub(crate) sky_rotate: f64,
    /// Radius of all lamps [m]; larger lamps cast softer shadows [default: extras.lightskin.radius of each lamp, or 0].
    #[arg(long, value_name = "M", value_parser = super::at_least_zero)]
    light_radius: Option<f64>,
    /// Apparent diameter of all directional lights [degrees], 0.53 for the sun [default: extras.lightskin.angle of
    /// each, or 0].
    ///
    /// Larger lights cast softer shadows. A sun that lightskin adds, or finds in --sky, has 0.53 by default.
    #[arg(long, value_name = "DEG", value_parser = super::at_least_zero)]
    sun_angle: Option<f64>,
    /// Background where there is no surface.
    ///
    /// studio is a neutral grey. sky is the sky that lights the scene. transparent has alpha 0. R,G,B is an sRGB colour
    /// with components from 0 to 1, for .png only. The default is studio if lightskin added the studio light, else the
    /// sky if there is one, else black.
    #[arg(long, value_name = "studio|sky|transparent|R,G,B", value_parser = background)]
    pub(crate) background: Option<Background>,
}

/// Value of `--background`.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Background {
    Studio,
    Sky,
    Transparent,
    /// Display colour, sRGB in [0, 1].
    Color(Vec3),
}

fn background(text: &str) -> std::result::Result<Background, String> {
    match text {
        "studio" => Ok(Background::Studio),
        "sky" => Ok(Background::Sky),
        "transparent" => Ok(Background::Transparent),
        _ => match color(text) {
            Ok(color) if color.max_element() <= 1.0 => Ok(Background::Color(color)),
            _ => Err("needs studio, sky, transparent or three numbers from 0 to 1, like 0.2,0.2,0.25".into()),
        },
    }
}

fn color(text: &str) -> std::result::Result<Vec3, String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some([r, g, b]) if [r, g, b].iter().all(|c| c.is_finite() && **c >= 0.0) => Ok(Vec3::new(*r, *g, *b)),
        _ => Err("needs three numbers from 0 up, like 1000,1200,1500".into()),
    }
}

impl SkyArgs {
    /// The background of the picture.
    pub(super) fn behind(&self) -> Behind {
        match self.background {
            Some(Background::Transparent) => Behind::Transparent,
            Some(Background::Color(srgb)) => Behind::Color(linear_from_srgb(srgb.as_dvec3()).as_vec3()),
            _ => Behind::Scene,
        }
    }

    /// Replaces the sky by this environment map.
    #[cfg(feature = "app")]
    pub(super) fn replace(&mut self, file: &std::path::Path) {
        (self.sky, self.sky_color) = (Some(file.to_owned()), None);
    }

    /// Makes the path of the environment map absolute.
    #[cfg(feature = "app")]
    pub(super) fn make_absolute(&mut self) {
        self.sky = self.sky.take().map(|path| std::path::absolute(&path).unwrap_or(path));
    }

    /// The flags that differ from their defaults, as command-line words.
    #[cfg(feature = "app")]
    pub(super) fn words(&self) -> Vec<String> {
        let Self { sky, sky_color, sky_lights, sky_scale, sky_rotate, light_radius, sun_angle, background } = self;
        let color = |c: Vec3| format!("{},{},{}", c.x, c.y, c.z);
        let mut words = Vec::new();
        let mut flag = |name: &str, value: Option<String>| {
            words.extend(value.into_iter().flat_map(|value| [name.to_owned(), value]));
        };
        flag("--sky", sky.as_ref().map(|path| path.display().to_string()));
        flag("--sky-color", sky_color.map(color));
        flag("--sky-lights", (*sky_lights != 16).then(|| sky_lights.to_string()));
        let has_sky = sky.is_some() || sky_color.is_some();
        flag("--sky-scale", (has_sky && *sky_scale != 1.0).then(|| sky_scale.to_string()));
        flag("--sky-rotate", (sky.is_some() && *sky_rotate != 0.0).then(|| sky_rotate.to_string()));
        flag("--light-radius", light_radius.map(|radius| radius.to_string()));
        flag("--sun-angle", sun_angle.map(|angle| angle.to_string()));
        flag(
            "--background",
            background.map(|background| match background {
                Background::Studio => "studio".into(),
                Background::Sky => "sky".into(),
                Background::Transparent => "transparent".into(),
                Background::Color(srgb) => color(srgb),
            }),
        );
        words
    }

    /// Gives lights the requested sizes, except the lights that approximate the sky.
    pub(super) fn size_lights(&self, scene: &mut Scene) {
        let of_sky = scene.sky.as_ref().map_or(0..0, |sky| sky.lights.clone());
        for (_, light) in scene.lights.iter_mut().enumerate().filter(|(i, _)| !of_sky.contains(i)) {
            let asked = match light.kind {
                LightKind::Directional => {
                    self.sun_angle.map(|angle| ((0.5 * angle).to_radians() as f32).min(Light::WIDEST_SUN))
                }
                _ => self.light_radius.map(|radius| radius as f32),
            };
            light.radius = asked.unwrap_or(light.radius);
        }
    }

    /// Gives a scene the requested backdrop.
    pub(super) fn put_behind(&self, scene: &mut Scene) -> Result<()> {
        scene.backdrop = match self.background {
            None => return Ok(()),
            Some(Background::Sky) if scene.sky.is_none() => {
                bail!("--background sky: the scene has no sky; add one with --sky or --sky-color")
            }
            Some(Background::Sky) => Backdrop::Sky,
            Some(Background::Studio) => Backdrop::Studio,
            Some(Background::Transparent | Background::Color(_)) => Backdrop::Nothing,
        };
        Ok(())
    }

    /// The requested sky, and the number of directional lights that approximate it.
    pub(super) fn sky(&self) -> Result<Option<(Sky, usize)>> {
        let lights = self.sky_lights as usize;
        if let Some(color) = self.sky_color {
            if color.max_element() <= 0.0 {
                bail!("--sky-color: a black sky gives no light; remove the flag");
            }
            return Ok(Some((Sky::even(color * self.sky_scale as f32), lights)));
        }
        let Some(file) = &self.sky else { return Ok(None) };
        let picture = read_radiance(file)?;
        let radiance = picture.rgb.iter().map(|rgb| Vec3::from(*rgb) * self.sky_scale as f32);
        let sky = Sky::new(picture.width, picture.height, radiance, self.sky_rotate.to_radians());
        if sky.illuminance().max_element() <= 0.0 {
            bail!("{}: the sky is black; choose another picture", file.display());
        }
        Ok(Some((sky, lights)))
    }
}
