//! All values of one pixel of the picture, and where its light comes from.

use super::camera::point_at;
use super::document::Document;
use super::lights::light_name;
use anyhow::Result;
use glam::{DVec3, Vec3};
use half::f16;
use lightskin::frame::Engine;
use lightskin::frame::pixel::PixelLight;
use lightskin::gpu::{Gpu, Image};
use lightskin::scene::luminance;
use lightskin::shared::PixelCache;

/// Most lights that are listed one by one.
const MOST_LIGHTS: usize = 8;

/// The values of a pixel.
pub(super) struct Pixel {
    /// Column and row.
    pub(super) at: [u32; 2],
    /// Position in the world and distance from the eye [m]. `None` if there is no surface.
    pub(super) place: Option<(DVec3, f64)>,
    pub(super) normal: DVec3,
    /// Names and radiances [cd/m^2].
    pub(super) light: Vec<(&'static str, DVec3)>,
    pub(super) albedo: DVec3,
    /// Index and name of the object.
    pub(super) instance: Option<(usize, String)>,
    /// Index and name of the material.
    pub(super) material: Option<(usize, String)>,
    /// Names of lights, and the radiance [cd/m^2] that the surface reflects of their direct light. Brightest first.
    pub(super) lights: Vec<(String, DVec3)>,
    /// The caches that it averages, heaviest first. Positions are relative to the scene's origin.
    pub(super) caches: Vec<PixelCache>,
    /// The scene's origin [m].
    pub(super) origin: DVec3,
}

impl Pixel {
    /// Reads a pixel of the last frame. `at` is from 0 at the top left of the picture to 1. `None` without a frame.
    pub(super) fn pick(gpu: &Gpu, document: &Document, at: [f32; 2]) -> Result<Option<Self>> {
        let (Some(view), Some(picture), Some(engine)) = (document.drawn, &document.picture, &document.engine) else {
            return Ok(None);
        };
        let (size, surface) = (picture.size(), &picture.surface);
        let at = [0, 1].map(|i| ((at[i].max(0.0) * size[i] as f32) as u32).min(size[i].saturating_sub(1)));
        if picture.is_empty() {
            return Ok(None);
        }
        let float = |image: &Image| -> Result<DVec3> {
            Ok(DVec3::from_slice(&gpu.read_texel::<[f32; 4]>(image, at)?.map(f64::from)))
        };
        let mut light = vec![("direct", float(&surface.radiance)?)];
        if let Some(indirect) = &picture.indirect {
            light.push(("indirect, diffuse", float(&indirect.diffuse)?));
            if let Some(glossy) = &indirect.glossy {
                light.push(("indirect, glossy", float(glossy)?));
            }
        }
        light.push(("total", light.iter().map(|(_, light)| light).sum()));
        let albedo = gpu.read_texel::<[u16; 4]>(&surface.albedo, at)?;
        let depth = gpu.read_texel::<f32>(&surface.depth, at)?;
        let middle = [0, 1].map(|i| (at[i] as f32 + 0.5) / size[i] as f32);
        let place = point_at(&view, middle, depth).map(|point| point + engine.world().origin);
        let eye = document.camera().map(|camera| camera.world_from_camera.translation);
        let element = match &surface.element {
            Some(element) if place.is_some() => Some(gpu.read_texel::<[u32; 2]>(element, at)?),
            _ => None,
        };
        let shown = element.and_then(|[draw, _]| engine.world().drawn(draw));
        let scene = engine.scene();
        let PixelLight { lights, caches } =
            PixelLight::find(gpu, (engine.world(), engine.light()), (&view, picture), at)?;
        Ok(Some(Self {
            at,
            place: place.map(|place| (place, eye.map_or(0.0, |eye| eye.distance(place)))),
            normal: float(&surface.normal)?,
            light,
            albedo: DVec3::from_slice(&albedo.map(|h| f16::from_bits(h).to_f64())),
            instance: shown.map(|(instance, _)| (instance, scene.instances[instance].name.clone())),
            material: shown.map(|(_, material)| (material, scene.materials[material].name.clone())),
            lights: named(engine, &lights),
            caches,
            origin: engine.world().origin,
        }))
    }

    /// Names, values and what they mean.
    pub(super) fn values(&self) -> Vec<(String, String, &'static str)> {
        let three = |v: DVec3| format!("{:.4} {:.4} {:.4}", v.x, v.y, v.z);
        let mut values = vec![("pixel".to_owned(), format!("{} {}", self.at[0], self.at[1]), "Column and row.")];
        let mut add = |name: &str, value: String, help| values.push((name.to_owned(), value, help));
        match &self.place {
            Some((place, distance)) => {
                add("position", format!("{} m", three(*place)), "Position in the world.");
                add("distance", format!("{distance:.4} m"), "Distance from the camera.");
                add("normal", three(self.normal), "Unit normal, with the material's normal map.");
                add("albedo", three(self.albedo), "Diffuse albedo, linear.");
            }
            None => add("position", "no surface".into(), "The pixel shows what lies behind the scene."),
        }
        for (name, light) in &self.light {
            add(
                name,
                three(*light),
                "Radiance towards the camera [cd/m\u{b2}], linear. Direct light includes emitted light.",
            );
        }
        let all = self.light.last().map_or(0.0, |(_, light)| luminance(*light));
        add("luminance", format!("{all:.4} cd/m\u{b2}"), "Luminance of the total.");
        for (name, found) in [("object", &self.instance), ("material", &self.material)] {
            if let Some((index, named)) = found {
                add(name, format!("{index} {named}"), "Number from 0, and name.");
            }
        }
        for (name, light) in &self.lights {
            let help = "Radiance [cd/m\u{b2}] that the surface reflects of this light alone, without other surfaces' light. It \
                        is part of the direct light.";
            add(&format!("light {name}"), three(*light), help);
        }
        for cache in &self.caches {
            let place = self.place.map_or(DVec3::ZERO, |(place, _)| place - self.origin);
            let (weight, away) = (100.0 * cache.weight, cache.position.as_dvec3().distance(place));
            let light = luminance(cache.irradiance.as_dvec3());
            let help = "A cache whose light the surface averages: its weight, its distance, and its part of the averaged \
                        light, as illuminance on a plane that faces that light. The picture shows these caches as rings.";
            add(&format!("cache {}", cache.number - 1), format!("{weight:.1} %, {away:.3} m, {light:.4} lx"), help);
        }
        values
    }

    /// All values in one line.
    pub(super) fn line(&self) -> String {
        let values = self.values();
        let told: Vec<String> = values.iter().skip(1).map(|(name, value, _)| format!("{name} {value}")).collect();
        format!("pixel     {}; {}", values[0].1, told.join("; "))
    }
}

/// Lights with light, by name. Those of a sky are one, and all beyond the brightest are one.
fn named(engine: &Engine, lights: &[Vec3]) -> Vec<(String, DVec3)> {
    let (mut all, mut sky) = (Vec::new(), DVec3::ZERO);
    for (i, (light, info)) in lights.iter().zip(engine.world().lights()).enumerate() {
        match light.as_dvec3() {
            DVec3::ZERO => {}
            light if info.of_sky => sky += light,
            light => all.push((light_name(engine, i), light)),
        }
    }
    if sky != DVec3::ZERO {
        all.push(("of the sky".into(), sky));
    }
    all.sort_by(|a, b| luminance(b.1).total_cmp(&luminance(a.1)));
    if all.len() > MOST_LIGHTS {
        let rest = all.split_off(MOST_LIGHTS - 1);
        all.push((format!("{} others", rest.len()), rest.iter().map(|(_, light)| light).sum()));
    }
    all
}
