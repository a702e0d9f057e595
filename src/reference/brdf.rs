//! A surface's glossy lobe for a viewer: modified Phong, or glTF 2.0's GGX. METHOD 3.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::phong::{Material, phong_lobe, reflect};
use crate::scene::ggx;
use crate::scene::material::{self, Reflectance};

/// A glossy lobe at a point for one viewer.
#[derive(Clone, Copy, Debug)]
pub enum Lobe {
    /// Normalised modified Phong.
    Phong {
        /// `rho_g`.
        albedo: DVec3,
        /// `k`.
        exponent: f64,
        /// Unit view direction, reflected about the normal.
        mirrored: DVec3,
    },
    /// GGX with Smith's height-correlated shadowing, Schlick's Fresnel and multiple scattering.
    Ggx {
        /// Reflectance at normal incidence.
        f0: DVec3,
        /// Reflectance at grazing incidence.
        f90: f64,
        /// Square root of alpha.
        roughness: f64,
        /// Unit normal.
        normal: DVec3,
        /// Unit direction towards the viewer, raised to a cosine of at least [`ggx::LEAST_COSINE`].
        view: DVec3,
    },
}

/// Smith's Lambda for GGX.
fn lambda(alpha: f64, cosine: f64) -> f64 {
    let tan2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// GGX normal distribution [1/sr] by sine and cosine (squared) between microfacet and surface normal; Trowbridge and
/// Reitz 1975.
fn facets(alpha: f64, sine2: f64, cosine2: f64) -> f64 {
    alpha * alpha / (PI * (sine2 + alpha * alpha * cosine2).powi(2))
}

impl Lobe {
    /// A lobe that reflects nothing.
    pub const NONE: Self = Self::Phong { albedo: DVec3::ZERO, exponent: 1.0, mirrored: DVec3::Z };

    /// The lobe of a surface with this unit normal for a ray in the unit `direction`.
    pub fn new(reflectance: &Reflectance, normal: DVec3, direction: DVec3) -> Self {
        match reflectance.lobe {
            material::Lobe::Phong { albedo, exponent } => Self::Phong {
                albedo: albedo.as_dvec3(),
                exponent: exponent.into(),
                mirrored: reflect(direction, normal),
            },
            material::Lobe::Ggx { f0, f90, roughness, .. } => {
                let up = (ggx::LEAST_COSINE + normal.dot(direction)).max(0.0);
                let view = (up * normal - direction).normalize();
                Self::Ggx { f0: f0.as_dvec3(), f90: f90.into(), roughness: roughness.into(), normal, view }
            }
        }
    }

    /// BRDF [1/sr] for light from the unit direction `towards`, which must be above the surface.
    pub fn brdf(&self, towards: DVec3) -> DVec3 {
        match *self {
            Self::Phong { albedo, exponent, mirrored } => albedo * phong_lobe(exponent, mirrored.dot(towards)),
            Self::Ggx { f0, f90, roughness, normal, view } => {
                let alpha = roughness * roughness;
                let [nv, nl] = [view, towards].map(|w| normal.dot(w));
                if nl <= 0.0 {
                    return DVec3::ZERO;
                }
                let half = (view + towards).normalize();
                let density = facets(alpha, normal.cross(half).length_squared(), normal.dot(half).powi(2));
                let seen = 1.0 / (1.0 + lambda(alpha, nv) + lambda(alpha, nl));
                let edge = (1.0 - view.dot(half).clamp(0.0, 1.0)).powi(5);
                let fresnel = f0 * (1.0 - edge) + DVec3::splat(f90 * edge);
                let once = ggx::scattered_once(roughness, nv);
                let again = f0.to_array().map(|f0| ggx::scattered_again(f0, once));
                fresnel * DVec3::from(again) * (density * seen / (4.0 * nv * nl))
            }
        }
    }

    /// Albedo under uniform light by the shaders' fits; of a Phong lobe the one at normal incidence.
    pub fn albedo(&self) -> DVec3 {
        match *self {
            Self::Phong { albedo, .. } => albedo,
            Self::Ggx { f0, f90, roughness, normal, view } => {
                let once = ggx::scattered_once(roughness, normal.dot(view));
                DVec3::from(f0.to_array().map(|f0| ggx::albedo(f0, f90, once)))
            }
        }
    }

    /// Probability density [1/sr] of the unit direction `towards` in [`Self::sample`].
    pub fn density(&self, towards: DVec3) -> f64 {
        match *self {
            Self::Phong { exponent: k, mirrored, .. } => (k + 1.0) / TAU * mirrored.dot(towards).max(0.0).powf(k),
            Self::Ggx { roughness, normal, view, .. } => {
                let alpha = roughness * roughness;
                let half = (view + towards).normalize_or(normal);
                let cosine = normal.dot(half);
                if cosine <= 0.0 {
                    return 0.0;
                }
                let nv = normal.dot(view);
                let density = facets(alpha, normal.cross(half).length_squared(), cosine * cosine);
                density / ((1.0 + lambda(alpha, nv)) * 4.0 * nv)
            }
        }
    }

    /// Samples a unit direction, by Phong's power or by the visible normals of GGX (Dupuy and Benyoub 2023). It may lie
    /// below the surface. `u` is uniform in the unit square.
    pub fn sample(&self, u: DVec2) -> DVec3 {
        match *self {
            Self::Phong { exponent, mirrored, .. } => around(mirrored, (1.0 - u.y).powf(1.0 / (exponent + 1.0)), u.x),
            Self::Ggx { roughness, normal, view, .. } => {
                let alpha = roughness * roughness;
                let (tangent, bitangent) = normal.any_orthonormal_pair();
                let local = DVec3::new(view.dot(tangent), view.dot(bitangent), view.dot(normal));
                let stretched = DVec3::new(alpha * local.x, alpha * local.y, local.z).normalize();
                let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
                let (y, x) = (TAU * u.x).sin_cos();
                let cap = DVec3::new(x, y, 0.0) * (1.0 - z * z).max(0.0).sqrt() + z * DVec3::Z;
                let half = cap + stretched;
                let half = DVec3::new(alpha * half.x, alpha * half.y, half.z.max(0.0)).normalize();
                let half = half.x * tangent + half.y * bitangent + half.z * normal;
                (2.0 * view.dot(half) * half - view).normalize()
            }
        }
    }
}

/// Unit direction at this cosine from the unit `axis`; `turn` is the rotation about it in full turns.
pub fn around(axis: DVec3, cosine: f64, turn: f64) -> DVec3 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (tangent, bitangent) = axis.any_orthonormal_pair();
    let (y, x) = (TAU * turn).sin_cos();
    (cosine * axis + sine * (x * tangent + y * bitangent)).normalize()
}

/// A surface at this view cosine as caches model it: diffuse plus a Phong lobe of equal width, with an exponent of at
/// most [`ggx::CACHE_EXPONENT`] and the same albedo under uniform light.
pub fn fitted(reflectance: &Reflectance, cosine: f64) -> Material {
    let diffuse = reflectance.diffuse(cosine).as_dvec3();
    match reflectance.lobe {
        material::Lobe::Phong { albedo, exponent } => {
            Material { diffuse, specular: albedo.as_dvec3(), exponent: exponent.into() }
        }
        material::Lobe::Ggx { f0, f90, roughness, .. } => {
            let cosine = cosine.clamp(ggx::LEAST_COSINE, 1.0);
            let exponent = ggx::fitted_exponent(roughness.into()).min(ggx::CACHE_EXPONENT);
            let once = ggx::scattered_once(roughness.into(), cosine);
            let albedo = f0.to_array().map(|f0| ggx::albedo(f0.into(), f90.into(), once));
            Material { diffuse, specular: DVec3::from(albedo) / ggx::phong_albedo(exponent, cosine), exponent }
        }
    }
}

/// Integral of a function over the hemisphere about +z. The function may be steep only within `width` \[rad\] of
/// `axis`: rings about the axis, by a midpoint rule with finer steps near it.
pub fn hemisphere(axis: DVec3, width: f64, mut value: impl FnMut(DVec3) -> f64) -> f64 {
    const RINGS: usize = 200;
    const TURNS: usize = 128;
    let mut sum = 0.0;
    for ring in 0..RINGS {
        // tan(angle / 2) = width t / (1 - t).
        let t = (ring as f64 + 0.5) / RINGS as f64;
        let tan = width * t / (1.0 - t);
        let angle = 2.0 * tan.atan();
        let step = 2.0 * width / ((1.0 - t).powi(2) * (1.0 + tan * tan)) / RINGS as f64;
        let area = angle.sin() * step * TAU / TURNS as f64;
        for turn in 0..TURNS {
            let towards = around(axis, angle.cos(), (turn as f64 + 0.5) / TURNS as f64);
            if towards.z > 0.0 {
                sum += value(towards) * area;
            }
        }
    }
    sum
}
