//! A material at a point of a surface: CPU twin of the shaders' mapping from glTF to a diffuse and a glossy lobe.

use std::f64::consts::TAU;

use glam::{Affine2, DVec3, Vec2, Vec3, Vec4};

use super::animation::Quantity;
use super::medium::Subsurface;
use super::{Image, Material, Scene, Texture, Wrap, ggx, sheen};
use crate::image::linear_from_srgb;

/// Limit of texture coordinates and of the numbers in a texture transform. Far beyond it single precision cannot
/// resolve texels, and products overflow.
pub(super) const MOST_UV: f32 = 1e6;

/// KHR_texture_transform with its numbers clamped to [-[`MOST_UV`], [`MOST_UV`]]: scale, then rotate \[rad\], then
/// translate. v points down, so a counter-clockwise turn by 90 degrees is (u, v) -> (v, -u).
pub(super) fn texture_transform(offset: [f64; 2], rotation: f64, scale: [f64; 2]) -> Affine2 {
    let bounded = |x: f64| x.clamp(-f64::from(MOST_UV), f64::from(MOST_UV));
    let (offset, scale) = (offset.map(bounded), scale.map(bounded));
    let (sin, cos) = rotation.rem_euclid(TAU).sin_cos();
    let column = |x: f64, y: f64| Vec2::new(x as f32, y as f32);
    Affine2::from_cols(
        column(cos * scale[0], -sin * scale[0]),
        column(sin * scale[1], cos * scale[1]),
        column(offset[0], offset[1]),
    )
}

/// How a surface reflects light: a diffuse lobe and a glossy lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflectance {
    /// Base colour: diffuse albedo of a non-metal, before the glossy lobe takes its share.
    pub base: Vec3,
    /// The glossy lobe.
    pub lobe: Lobe,
    /// Share of the diffuse light that is transmitted instead.
    pub transmission: f32,
    /// Layers over both lobes.
    pub over: Over,
}

/// Layers over a surface's own lobes: a clear coat, and sheen below the coat. Most surfaces have none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Over {
    /// Share of the surface covered by a coat.
    pub coat: f32,
    /// Perceptual roughness of the coat, at least [`ggx::LEAST_ROUGHNESS`].
    pub coat_roughness: f32,
    /// Sheen colour.
    pub sheen: Vec3,
    /// Perceptual roughness of the sheen, at least [`sheen::LEAST_ROUGHNESS`].
    pub sheen_roughness: f32,
}

impl Over {
    /// Reflectance of a coat at normal incidence, for an index of refraction of 1.5.
    pub const F0: f64 = 0.04;

    /// Share of uniform light that the coat reflects to a viewer at this cosine.
    pub fn coated(&self, cosine: f64) -> f64 {
        if self.coat == 0.0 {
            return 0.0;
        }
        let once = ggx::scattered_once(self.coat_roughness.into(), cosine);
        f64::from(self.coat) * ggx::albedo(Self::F0, 1.0, once)
    }

    /// Share of uniform light that the sheen reflects to a viewer at this cosine, and the transmitted share of the
    /// light from the layers below: 1 minus the largest channel.
    pub fn shone(&self, cosine: f64) -> (DVec3, f64) {
        if self.sheen == Vec3::ZERO {
            return (DVec3::ZERO, 1.0);
        }
        let shone = self.sheen.as_dvec3() * sheen::albedo(self.sheen_roughness.into(), cosine);
        (shone, 1.0 - shone.max_element())
    }
}

/// A glossy lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lobe {
    /// Normalised modified Phong, `rho_g (k + 2) / (2 pi) cos^k`.
    Phong {
        /// `rho_g`.
        albedo: Vec3,
        /// `k`.
        exponent: f32,
    },
    /// The lobe of glTF 2.0: GGX, Smith's height-correlated shadowing, Schlick's Fresnel.
    Ggx {
        /// Reflectance at normal incidence.
        f0: Vec3,
        /// Reflectance at the horizon.
        f90: f32,
        /// Perceptual roughness, the root of alpha, at least [`ggx::LEAST_ROUGHNESS`].
        roughness: f32,
        /// Metallic share of the surface.
        metallic: f32,
        /// Reflectance of the dielectric part at normal incidence.
        dielectric: Vec3,
        /// Reflectance of the dielectric part at the horizon.
        dielectric_f90: f32,
    },
}

/// Share of uniform light that a GGX lobe reflects, from its single-scattering terms `once`.
fn albedo(f0: Vec3, f90: f32, once: [f64; 2]) -> Vec3 {
    DVec3::from(f0.to_array().map(|f0| ggx::albedo(f0.into(), f90.into(), once))).as_vec3()
}

impl Reflectance {
    /// Diffuse albedo `rho_d` for a viewer at this cosine.
    pub fn diffuse(&self, cosine: f64) -> Vec3 {
        self.under(cosine) * (1.0 - self.transmission)
    }

    /// Share of light that enters the surface and leaves it again, reflected or transmitted, for a viewer at this
    /// cosine.
    fn under(&self, cosine: f64) -> Vec3 {
        match self.lobe {
            Lobe::Phong { .. } => self.base,
            Lobe::Ggx { f0, f90, roughness, metallic, dielectric, dielectric_f90 } => {
                let once = ggx::scattered_once(roughness.into(), cosine);
                let albedo = |f0: Vec3, f90: f32| albedo(f0, f90, once);
                let whole = albedo(dielectric, dielectric_f90);
                let under = (1.0 - whole.max_element()).clamp(0.0, 1.0);
                // Multiple scattering computed for both parts exceeds that of their mean F0. The difference counts as
                // diffuse.
                let more = whole.lerp(albedo(self.base, 1.0), metallic) - albedo(f0, f90);
                self.base * ((1.0 - metallic) * under) + more.max(Vec3::ZERO)
            }
        }
    }

    /// Share of light that both lobes reflect, averaged over viewers and at most 1, as if the surface were diffuse.
    pub fn sent_on(&self) -> Vec3 {
        let diffuse = self.diffuse(ggx::MEAN_COSINE);
        let glossy = match self.lobe {
            Lobe::Phong { albedo, exponent } => {
                albedo * ggx::phong_albedo(exponent.into(), ggx::MEAN_PHONG_COSINE) as f32
            }
            Lobe::Ggx { f0, f90, roughness, .. } => {
                let once = ggx::scattered_once(roughness.into(), ggx::MEAN_COSINE);
                albedo(f0, f90, once)
            }
        };
        diffuse.max((diffuse + glossy).min(Vec3::ONE))
    }

    /// Exponent of the Phong lobe with which caches represent this lobe.
    pub fn cache_exponent(&self) -> f32 {
        match self.lobe {
            Lobe::Phong { exponent, .. } => exponent,
            Lobe::Ggx { roughness, .. } => ggx::fitted_exponent(roughness.into()).min(ggx::CACHE_EXPONENT) as f32,
        }
    }
}

impl Material {
    /// The material's textures, in the order of the fields.
    pub fn textures_mut(&mut self) -> [&mut Option<Texture>; 12] {
        [
            &mut self.base_color_texture,
            &mut self.metallic_roughness_texture,
            &mut self.normal_texture,
            &mut self.emissive_texture,
            &mut self.specular_texture,
            &mut self.specular_color_texture,
            &mut self.transmission_texture,
            &mut self.thickness_texture,
            &mut self.coat_texture,
            &mut self.coat_roughness_texture,
            &mut self.sheen_color_texture,
            &mut self.sheen_roughness_texture,
        ]
    }

    /// Fills the body with a medium. The base colour becomes the total share of light that leaves the surface, for code
    /// that does not simulate the inside. The material becomes non-metallic and opaque. It keeps a base colour texture
    /// only for the holes of an alpha mask.
    pub fn fill(&mut self, inside: Subsurface) {
        let color = inside.medium().diffuse_albedo().as_vec3();
        self.base_color = color.extend(self.base_color.w);
        self.metallic = 0.0;
        if self.is_seen_through() {
            (self.transmission, self.transmission_texture, self.thickness) = (0.0, None, 0.0);
            (self.blend, self.alpha_cutoff) = (false, None);
        }
        if self.alpha_cutoff.is_none() {
            self.base_color_texture = None;
        }
        self.subsurface = Some(inside);
    }

    /// Whether the background can show through.
    pub fn is_seen_through(&self) -> bool {
        self.blend || self.transmission > 0.0
    }

    /// Whether the surface bounds a body of glass that bends light (a texture may still make it thin).
    pub fn is_solid(&self) -> bool {
        self.transmission > 0.0 && self.thickness > 0.0
    }

    /// Whether a coat or sheen lies over the lobes (textures may still remove it).
    pub fn is_coated(&self) -> bool {
        self.coat > 0.0 || self.sheen_color.max_element() > 0.0
    }

    /// Alpha below this value is a hole for a viewer.
    pub fn seen_cutoff(&self) -> Option<f32> {
        let cutoff = if self.blend { Some(f32::MIN_POSITIVE) } else { self.alpha_cutoff };
        cutoff.filter(|cutoff| cutoff.is_finite())
    }

    /// Contributions of a see-through surface and its background to a viewer at this cosine: the share of the surface's
    /// own light, and the share of the background's light by channel. Rough glass is as clear as smooth glass. What the
    /// body behind a solid surface absorbs is not included.
    ///
    /// ```text
    /// behind = 1 - alpha + alpha transmission (share that passes coat, sheen and surface)
    /// ```
    pub fn seen_through(&self, scene: &Scene, uv: [Vec2; 2], vertex_color: Vec4, cosine: f64) -> (f32, Vec3) {
        let alpha =
            self.base_color.w * vertex_color.w * self.base_color_texture.map_or(1.0, |t| t.sample(scene, uv, true).w);
        let alpha = if self.blend { alpha.clamp(0.0, 1.0) } else { 1.0 };
        let reflectance = self.reflectance(scene, uv, vertex_color);
        let passed = (1.0 - reflectance.over.coated(cosine)) * reflectance.over.shone(cosine).1;
        let under = reflectance.under(cosine) * passed as f32;
        (alpha, 1.0 - alpha + alpha * reflectance.transmission * under)
    }

    /// Whether a surface that is seen through bends light at a point.
    pub fn bends_light(&self, scene: &Scene, uv: [Vec2; 2]) -> bool {
        self.is_solid() && self.thickness_texture.is_none_or(|t| t.sample(scene, uv, false).y > 0.0)
    }

    /// Evaluates the material at a point with texture coordinates `uv` and linear vertex colour.
    ///
    /// With `base` = factor x texture x vertex colour:
    ///
    /// ```text
    /// dielectric = min(((ior - 1) / (ior + 1))^2 specularColor, 1)
    /// F90        = mix(specular min(50 dielectric, 1), 1, metallic)
    /// F0         = mix(dielectric specular, base, metallic)
    /// rho_d      = base (1 - metallic) (1 - reflectance of the dielectric part)
    /// ```
    ///
    /// A dielectric that reflects less than 2 % at normal incidence also reflects less at the horizon; with 0 % there
    /// is no lobe. With `Material::phong`, `rho_d` is `base`, and `rho_g` and k are used as given, unchecked.
    pub fn reflectance(&self, scene: &Scene, uv: [Vec2; 2], vertex_color: Vec4) -> Reflectance {
        let linear = |texture: Option<Texture>| texture.map_or(Vec4::ONE, |t| t.sample(scene, uv, false));
        let color = |texture: Option<Texture>| texture.map_or(Vec4::ONE, |t| t.sample(scene, uv, true));
        let base = (self.base_color * color(self.base_color_texture) * vertex_color).truncate();
        let transmission = self.transmission * linear(self.transmission_texture).x;
        let over = self.over(scene, uv);
        if let Some(phong) = self.phong {
            let lobe = Lobe::Phong { albedo: phong.specular, exponent: phong.exponent };
            return Reflectance { base, lobe, transmission, over };
        }
        let metallic_roughness = linear(self.metallic_roughness_texture);
        let metallic = self.metallic * metallic_roughness.z;
        let roughness = (self.roughness * metallic_roughness.y).clamp(ggx::LEAST_ROUGHNESS as f32, 1.0);

        let specular = self.specular * linear(self.specular_texture).w;
        let specular_color = self.specular_color * color(self.specular_color_texture).truncate();
        let normal_incidence = ((self.ior - 1.0) / (self.ior + 1.0)).powi(2);
        let dielectric = (normal_incidence * specular_color).min(Vec3::ONE);
        let dielectric_f90 = specular * (50.0 * dielectric.max_element()).min(1.0);
        let dielectric = dielectric * specular;
        let f0 = dielectric.lerp(base, metallic);
        let f90 = dielectric_f90 + (1.0 - dielectric_f90) * metallic;
        let lobe = Lobe::Ggx { f0, f90, roughness, metallic, dielectric, dielectric_f90 };
        Reflectance { base, lobe, transmission, over }
    }

    /// Coat and sheen at a point.
    fn over(&self, scene: &Scene, uv: [Vec2; 2]) -> Over {
        if !self.is_coated() {
            return Over::default();
        }
        let texel = |texture: Option<Texture>, srgb| texture.map_or(Vec4::ONE, |t| t.sample(scene, uv, srgb));
        let coat_roughness = self.coat_roughness * texel(self.coat_roughness_texture, false).y;
        let sheen_roughness = self.sheen_roughness * texel(self.sheen_roughness_texture, false).w;
        Over {
            coat: self.coat * texel(self.coat_texture, false).x,
            coat_roughness: coat_roughness.clamp(ggx::LEAST_ROUGHNESS as f32, 1.0),
            sheen: self.sheen_color * texel(self.sheen_color_texture, true).truncate(),
            sheen_roughness: sheen_roughness.clamp(sheen::LEAST_ROUGHNESS as f32, 1.0),
        }
    }
}

/// Light that a material emits from its front side.
pub struct Emission<'a> {
    scene: &'a Scene,
    material: &'a Material,
    /// Factor [cd/m^2], positive and finite.
    factor: Vec3,
}

impl Scene {
    /// Light that a material emits; `None` for most. A dark material that an animation may light counts as white.
    pub fn emission(&self, material: usize) -> Option<Emission<'_>> {
        let found = &self.materials[material];
        if found.emissive.max_element() > 0.0 || !self.animates(&[Quantity::Emission], material) {
            return found.emission(self);
        }
        Some(Emission { scene: self, material: found, factor: Vec3::ONE })
    }
}

impl Material {
    /// Light that the material emits without animation; `None` for most.
    pub fn emission<'a>(&'a self, scene: &'a Scene) -> Option<Emission<'a>> {
        let factor = Vec3::from(self.emissive.to_array().map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 }));
        let is_black = |image: &Image| image.rgba.chunks_exact(4).all(|texel| texel[..3] == [0; 3]);
        let is_dark = self.emissive_texture.is_some_and(|t| is_black(&scene.images[t.image]));
        (factor != Vec3::ZERO && !is_dark).then_some(Emission { scene, material: self, factor })
    }
}

impl Emission<'_> {
    /// Emitted radiance without textures [cd/m^2].
    pub fn factor(&self) -> Vec3 {
        self.factor
    }

    /// Whether the emission is the same everywhere.
    pub fn is_uniform(&self) -> bool {
        self.material.emissive_texture.is_none() && self.material.alpha_cutoff.is_none()
    }

    /// Radiance [cd/m^2] at a point with these texture coordinates; zero in a hole.
    pub fn radiance(&self, uv: [Vec2; 2]) -> Vec3 {
        self.factor * self.share(uv)
    }

    /// Texture factor of the emission at a point with these texture coordinates; zero in a hole.
    pub fn share(&self, uv: [Vec2; 2]) -> Vec3 {
        let sample = |texture: Option<Texture>| texture.map_or(Vec4::ONE, |t| t.sample(self.scene, uv, true));
        let alpha = self.material.base_color.w * sample(self.material.base_color_texture).w;
        if self.material.alpha_cutoff.is_some_and(|cutoff| alpha < cutoff) {
            return Vec3::ZERO;
        }
        sample(self.material.emissive_texture).truncate()
    }
}

impl Texture {
    /// The image's nearest texel or bilinear mean at a surface's texture coordinates, after the transform. `srgb`
    /// images are decoded to linear before filtering; alpha is always linear. No mip levels.
    pub fn sample(&self, scene: &Scene, uv: [Vec2; 2], srgb: bool) -> Vec4 {
        let image = &scene.images[self.image];
        let uv = self.transform.transform_point2(uv[usize::from(self.uv_set)]);
        let texel = uv * Vec2::new(image.width as f32, image.height as f32);
        let fetch = |x: f32, y: f32| {
            let x = wrap(self.sampler.wrap_u, x, image.width);
            let y = wrap(self.sampler.wrap_v, y, image.height);
            image.texel(x, y, srgb)
        };
        if self.sampler.nearest {
            let corner = texel.floor();
            return fetch(corner.x, corner.y);
        }
        let corner = (texel - 0.5).floor();
        let t = texel - 0.5 - corner;
        let row = |y: f32| fetch(corner.x, y).lerp(fetch(corner.x + 1.0, y), t.x);
        row(corner.y).lerp(row(corner.y + 1.0), t.y)
    }
}

impl Image {
    /// A texel as numbers in [0, 1]; `srgb` decodes the colour but not alpha.
    pub fn texel(&self, x: u32, y: u32, srgb: bool) -> Vec4 {
        let at = 4 * (y as usize * self.width as usize + x as usize);
        let number = |channel: usize| f32::from(self.rgba[at + channel]) / 255.0;
        let decoded = |channel| if srgb { linear_from_srgb(self.rgba[at + channel]) } else { number(channel) };
        Vec4::new(decoded(0), decoded(1), decoded(2), number(3))
    }
}

/// Wraps a whole texel coordinate into [0, size).
fn wrap(mode: Wrap, at: f32, size: u32) -> u32 {
    let (at, size) = (at as i64, i64::from(size));
    let inside = match mode {
        Wrap::Repeat => at.rem_euclid(size),
        Wrap::Mirror => {
            let at = at.rem_euclid(2 * size);
            at.min(2 * size - 1 - at)
        }
        Wrap::Clamp => at.clamp(0, size - 1),
    };
    inside as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Phong, Sampler};
    use glam::Affine2;

    const UV: [Vec2; 2] = [Vec2::ZERO; 2];

    fn material() -> Material {
        Material { metallic: 0.0, ..Material::default() }
    }

    #[test]
    fn dielectric_has_four_percent() {
        let r = Material { base_color: Vec4::splat(0.5), ..material() }.reflectance(&Scene::default(), UV, Vec4::ONE);
        assert_eq!(r.base, Vec3::splat(0.5));
        let Lobe::Ggx { f0, f90, roughness, .. } = r.lobe else { panic!("{r:?}") };
        assert!((f0 - 0.04).abs().max_element() < 1e-6);
        assert_eq!((f90, roughness), (1.0, 1.0));
        assert!(r.diffuse(0.1).x < r.diffuse(1.0).x && r.diffuse(1.0).x < 0.5);
    }

    #[test]
    fn metal_reflects_its_colour_only() {
        let gold = Vec4::new(1.0, 0.8, 0.3, 1.0);
        let r = Material { base_color: gold, roughness: 0.5, ..Material::default() };
        let r = r.reflectance(&Scene::default(), UV, Vec4::ONE);
        let Lobe::Ggx { f0, f90, .. } = r.lobe else { panic!("{r:?}") };
        assert_eq!((r.diffuse(0.5), f0, f90, r.cache_exponent()), (Vec3::ZERO, gold.truncate(), 1.0, 7.5));
    }

    #[test]
    fn energy_is_bounded_and_mirrors_are_finite() {
        for (metallic, roughness, ior) in [(0.0, 0.0, 0.0), (0.5, 0.0, 3.0), (1.0, 1.0, 1.0)] {
            let r = Material { metallic, roughness, ior, specular_color: Vec3::splat(9.0), ..material() };
            let r = r.reflectance(&Scene::default(), UV, Vec4::ONE);
            let Lobe::Ggx { f0, f90, roughness, .. } = r.lobe else { panic!("{r:?}") };
            assert!(f0.max_element() <= 1.0 && f90 <= 1.0 && r.diffuse(0.5).min_element() >= 0.0);
            assert!(
                f64::from(roughness) >= ggx::LEAST_ROUGHNESS - 1e-8 && (0.25..=2048.0).contains(&r.cache_exponent())
            );
        }
    }

    #[test]
    fn what_reflects_nothing_has_no_lobe() {
        for material in [Material { ior: 1.0, ..material() }, Material { specular: 0.0, ..material() }] {
            let r = material.reflectance(&Scene::default(), UV, Vec4::ONE);
            let Lobe::Ggx { f0, f90, .. } = r.lobe else { panic!("{r:?}") };
            assert_eq!((r.sent_on(), f0, f90), (Vec3::ONE, Vec3::ZERO, 0.0));
        }
    }

    #[test]
    fn phong_is_taken_at_its_word() {
        let phong = Phong { specular: Vec3::splat(0.7), exponent: 0.5 };
        let r = Material { phong: Some(phong), ..material() }.reflectance(&Scene::default(), UV, Vec4::splat(0.5));
        assert_eq!((r.diffuse(0.3), r.cache_exponent()), (Vec3::splat(0.5), 0.5));
        assert_eq!(r.lobe, Lobe::Phong { albedo: Vec3::splat(0.7), exponent: 0.5 });
    }

    #[test]
    fn textures_wrap_and_filter() {
        let rgba = vec![0, 0, 0, 255, 255, 255, 255, 255];
        let image = Image { name: "step".into(), width: 2, height: 1, rgba };
        let scene = Scene { images: vec![image], ..Scene::default() };
        let value = |wrap_u, nearest, u| {
            let sampler = Sampler { wrap_u, wrap_v: Wrap::Repeat, nearest };
            let texture = Texture { image: 0, uv_set: 1, transform: Affine2::IDENTITY, sampler };
            texture.sample(&scene, [Vec2::ZERO, Vec2::new(u, 0.5)], true).x
        };
        assert_eq!(value(Wrap::Repeat, true, 1.1), 0.0);
        assert_eq!(value(Wrap::Mirror, true, 1.1), 1.0);
        assert_eq!(value(Wrap::Clamp, true, 7.0), 1.0);
        assert_eq!(value(Wrap::Clamp, true, -7.0), 0.0);
        assert_eq!(value(Wrap::Repeat, false, 0.5), 0.5);
        assert_eq!(value(Wrap::Repeat, false, 0.0), 0.5);
        assert_eq!(value(Wrap::Clamp, false, 0.0), 0.0);
        assert!(value(Wrap::Repeat, false, 1e30).is_finite());
        assert!((linear_from_srgb(128) - 0.215_861).abs() < 1e-5);
    }
}
