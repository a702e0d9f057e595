//! Animated numbers of lights, cameras and materials (KHR_animation_pointer).

use std::f64::consts::{FRAC_PI_2, PI};

use crate::scene::material::texture_transform;
use crate::scene::{Light, LightKind, Projection, Scene, Texture};
use glam::{DVec3, Vec3, Vec4};

/// An animated quantity of one or more lights, cameras or materials that are a single object in the file.
#[derive(Clone, Debug)]
pub struct Property {
    quantity: Quantity,
    /// Indices into the scene's lights, cameras or materials.
    of: Vec<usize>,
    rest: [[f64; 4]; 3],
    now: [[f64; 4]; 3],
}

/// Kind of a property. Properties of several parts are set part by part; all others have one part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quantity {
    /// Light: linear colour.
    LightColor,
    /// Light: intensity [cd or lx].
    LightIntensity,
    /// Light: range \[m\].
    LightRange,
    /// Spot light: inner and outer half angle \[rad\], two parts.
    Cone,
    /// Perspective camera: vertical field of view \[rad\].
    Yfov,
    /// Orthographic camera: half height \[m\].
    Ymag,
    /// Material: base colour and alpha.
    BaseColor,
    /// Material: metalness.
    Metallic,
    /// Material: perceptual roughness.
    Roughness,
    /// Material: emissive factor and strength [cd/m^2], two parts.
    Emission,
    /// Material: alpha cutoff.
    AlphaCutoff,
    /// Material: normal texture scale.
    NormalScale,
    /// Material: index of refraction.
    Ior,
    /// Material: specular factor.
    Specular,
    /// Material: specular colour.
    SpecularColor,
    /// Texture at this index of `Material::textures_mut`: offset, rotation \[rad\] and scale, three parts.
    TextureTransform(usize),
}

impl Property {
    /// A property with the given rest values, by part.
    pub fn new(quantity: Quantity, of: Vec<usize>, rest: [[f64; 4]; 3]) -> Self {
        Self { quantity, of, rest, now: rest }
    }

    /// Kind of the property.
    pub fn quantity(&self) -> Quantity {
        self.quantity
    }

    /// Indices of the scene's lights, cameras or materials that have this property.
    pub fn of(&self) -> &[usize] {
        &self.of
    }

    /// Rest values, by part.
    pub fn at_rest(&self) -> [[f64; 4]; 3] {
        self.rest
    }

    pub(super) fn rest(&mut self) {
        self.now = self.rest;
    }

    pub(super) fn set(&mut self, part: usize, value: &[f64]) {
        self.now[part][..value.len()].copy_from_slice(value);
    }

    /// Writes the current values to the scene, clamped to the ranges that the loader allows.
    pub(super) fn apply(&self, scene: &mut Scene) {
        for &of in &self.of {
            match self.quantity {
                Quantity::LightColor | Quantity::LightIntensity | Quantity::LightRange | Quantity::Cone => {
                    scene.lights.get_mut(of).into_iter().for_each(|light| self.apply_to_light(light))
                }
                Quantity::Yfov | Quantity::Ymag => {
                    scene.cameras.get_mut(of).into_iter().for_each(|c| self.apply_to_projection(&mut c.projection));
                }
                _ => self.apply_to_material(scene, of),
            }
        }
    }

    fn apply_to_light(&self, light: &mut Light) {
        let value = self.now[0];
        match self.quantity {
            Quantity::LightColor => light.color = rgb(value, Light::BRIGHTEST),
            Quantity::LightIntensity => light.intensity = within(value[0], Light::BRIGHTEST),
            Quantity::LightRange => light.range = Some(within(value[0], Light::BRIGHTEST)).filter(|range| *range > 0.0),
            Quantity::Cone => {
                let outer = self.now[1][0].clamp(1e-6, FRAC_PI_2);
                let inner = value[0].clamp(0.0, outer);
                light.kind = LightKind::Spot { inner: inner as f32, outer: outer as f32 };
            }
            _ => {}
        }
    }

    fn apply_to_projection(&self, projection: &mut Projection) {
        let value = self.now[0][0];
        match projection {
            Projection::Perspective { yfov } => *yfov = value.clamp(1e-6, PI - 1e-6) as f32,
            Projection::Orthographic { ymag } => *ymag = value.abs().max(1e-6) as f32,
        }
    }

    fn apply_to_material(&self, scene: &mut Scene, of: usize) {
        let Some(material) = scene.materials.get_mut(of) else { return };
        let most = f64::from(f32::MAX);
        let value = self.now[0];
        match self.quantity {
            Quantity::BaseColor => material.base_color = Vec4::from(value.map(|x| within(x, 1.0))),
            Quantity::Metallic => material.metallic = within(value[0], 1.0),
            Quantity::Roughness => material.roughness = within(value[0], 1.0),
            Quantity::Emission => {
                let emission = rgb(value, most) * within(self.now[1][0], 1e12);
                material.emissive = emission.min(Vec3::splat(1e12));
            }
            Quantity::AlphaCutoff => material.alpha_cutoff = Some(within(value[0], most)),
            Quantity::NormalScale => material.normal_scale = value[0] as f32,
            Quantity::Ior => material.ior = if value[0] == 0.0 { 0.0 } else { value[0].max(1.0) as f32 },
            Quantity::Specular => material.specular = within(value[0], 1.0),
            Quantity::SpecularColor => material.specular_color = rgb(value, most),
            Quantity::TextureTransform(place) => {
                let [offset, rotation, scale] = self.now;
                let transform = texture_transform([offset[0], offset[1]], rotation[0], [scale[0], scale[1]]);
                let [texture] = &mut material.textures_mut()[place..=place] else { return };
                **texture = texture.map(|texture| Texture { transform, ..texture });
            }
            _ => {}
        }
    }
}

fn within(value: f64, most: f64) -> f32 {
    value.clamp(0.0, most) as f32
}

fn rgb(value: [f64; 4], most: f64) -> Vec3 {
    DVec3::new(value[0], value[1], value[2]).clamp(DVec3::ZERO, DVec3::splat(most)).as_vec3()
}
