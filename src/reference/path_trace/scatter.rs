//! Directions that a surface scatters light along: Lambert and normalised modified Phong, evaluated and sampled.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use crate::reference::gather::luminance;
use crate::reference::phong::{DIFFUSE_LOBE, Material, phong_lobe, reflect};
use crate::reference::world::Surface;

/// A point that scatters light towards a viewer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scatter {
    /// World position \[m\].
    pub(super) position: DVec3,
    /// Unit normal that reflection is about.
    pub(super) normal: DVec3,
    /// Unit normal of the triangle: nothing passes through it.
    pub(super) geometric: DVec3,
    /// Unit mirror direction of the viewer.
    mirrored: DVec3,
    material: Material,
    /// Probability that a direction is drawn from the glossy lobe.
    glossy_share: f64,
}

impl Scatter {
    /// A surface met by a ray of unit `direction`.
    pub(super) fn new(surface: &Surface, direction: DVec3) -> Self {
        let material = surface.reflection;
        let (diffuse, glossy) = (luminance(material.diffuse), luminance(material.specular));
        Self {
            position: surface.position,
            normal: surface.normal,
            geometric: surface.geometric,
            mirrored: reflect(direction, surface.normal),
            material,
            glossy_share: if glossy > 0.0 { glossy / (diffuse + glossy) } else { 0.0 },
        }
    }

    /// The diffuse lobe alone.
    pub(super) fn diffuse(self) -> Self {
        Self { material: Material { specular: DVec3::ZERO, ..self.material }, glossy_share: 0.0, ..self }
    }

    /// The glossy lobe alone.
    pub(super) fn glossy(self) -> Self {
        Self { material: Material { diffuse: DVec3::ZERO, ..self.material }, glossy_share: 1.0, ..self }
    }

    /// Whether nothing is reflected at all.
    pub(super) fn is_black(&self) -> bool {
        self.material.diffuse == DVec3::ZERO && self.material.specular == DVec3::ZERO
    }

    /// BRDF times cosine [1/sr] for light from the unit direction `towards`.
    pub(super) fn reflected(&self, towards: DVec3) -> DVec3 {
        let cosine = self.normal.dot(towards);
        if cosine <= 0.0 {
            return DVec3::ZERO;
        }
        let mut brdf = self.material.diffuse * DIFFUSE_LOBE;
        if self.glossy_share > 0.0 {
            brdf += self.material.specular * phong_lobe(self.material.exponent, self.mirrored.dot(towards));
        }
        brdf * cosine
    }

    /// Probability density [1/sr] with which [`Self::sample`] gives the unit direction `towards`.
    pub(super) fn density(&self, towards: DVec3) -> f64 {
        let diffuse = self.normal.dot(towards).max(0.0) / PI;
        if self.glossy_share == 0.0 {
            return diffuse;
        }
        let k = self.material.exponent;
        let glossy = (k + 1.0) / TAU * self.mirrored.dot(towards).max(0.0).powf(k);
        diffuse + self.glossy_share * (glossy - diffuse)
    }

    /// A unit direction, by the cosine or by the lobe; `u` uniform in the unit square.
    pub(super) fn sample(&self, u: DVec2) -> DVec3 {
        if u.x < self.glossy_share {
            let cosine = (1.0 - u.y).powf(1.0 / (self.material.exponent + 1.0));
            around(self.mirrored, cosine, u.x / self.glossy_share)
        } else {
            let x = (u.x - self.glossy_share) / (1.0 - self.glossy_share);
            around(self.normal, (1.0 - u.y).sqrt(), x)
        }
    }
}

/// The unit direction at this cosine to the unit `axis`, and `turn` of a full turn about it.
pub(super) fn around(axis: DVec3, cosine: f64, turn: f64) -> DVec3 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (tangent, bitangent) = axis.any_orthonormal_pair();
    let (y, x) = (TAU * turn).sin_cos();
    (cosine * axis + sine * (x * tangent + y * bitangent)).normalize()
}
