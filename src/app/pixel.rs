//! All values of one pixel of the picture.

use super::camera::point_at;
use super::document::Document;
use anyhow::Result;
use glam::DVec3;
use half::f16;
use lightskin::gpu::{Gpu, Image};
use lightskin::scene::luminance;

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
        Ok(Some(Self {
            at,
            place: place.map(|place| (place, eye.map_or(0.0, |eye| eye.distance(place)))),
            normal: float(&surface.normal)?,
            light,
            albedo: DVec3::from_slice(&albedo.map(|h| f16::from_bits(h).to_f64())),
            instance: shown.map(|(instance, _)| (instance, scene.instances[instance].name.clone())),
            material: shown.map(|(_, material)| (material, scene.materials[material].name.clone())),
        }))
    }

    /// Names and values.
    pub(super) fn values(&self) -> Vec<(String, String)> {
        let three = |v: DVec3| format!("{:.4} {:.4} {:.4}", v.x, v.y, v.z);
        let mut values = vec![("pixel".to_owned(), format!("{} {}", self.at[0], self.at[1]))];
        let mut add = |name: &str, value: String| values.push((name.to_owned(), value));
        match &self.place {
            Some((place, distance)) => {
                add("position", format!("{} m", three(*place)));
                add("distance", format!("{distance:.4} m"));
                add("normal", three(self.normal));
                add("albedo", three(self.albedo));
            }
            None => add("position", "no surface".into()),
        }
        for (name, light) in &self.light {
            add(name, three(*light));
        }
        let all = self.light.last().map_or(0.0, |(_, light)| luminance(*light));
        add("luminance", format!("{all:.4} cd/m\u{b2}"));
        for (name, found) in [("object", &self.instance), ("material", &self.material)] {
            if let Some((index, named)) = found {
                add(name, format!("{index} {named}"));
            }
        }
        values
    }

    /// All values in one line.
    pub(super) fn line(&self) -> String {
        let values = self.values();
        let told: Vec<String> = values.iter().skip(1).map(|(name, value)| format!("{name} {value}")).collect();
        format!("pixel     {}; {}", values[0].1, told.join("; "))
    }
}
