//! Directions that a surface scatters light along: Lambert and its glossy lobe, evaluated and sampled.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use crate::reference::brdf::Lobe;
pub(super) use crate::reference::brdf::around;
use crate::reference::gather::luminance;
use crate::reference::phong::DIFFUSE_LOBE;
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
    /// Diffuse albedo for this viewer.
    diffuse: DVec3,
    lobe: Lobe,
    /// Probability that a direction is drawn from the glossy lobe.
    glossy_share: f64,
}

impl Scatter {
    /// A surface met by a ray of unit `direction`.
    pub(super) fn new(surface: &Surface, direction: DVec3) -> Self {
        let lobe = Lobe::new(&surface.reflection, surface.normal, direction);
        let albedo = surface.reflection.diffuse(-surface.normal.dot(direction)).as_dvec3();
        let (diffuse, glossy) = (luminance(albedo), luminance(lobe.albedo()));
        Self {
            position: surface.position,
            normal: surface.normal,
            geometric: surface.geometric,
            diffuse: albedo,
            lobe,
            glossy_share: if glossy > 0.0 { glossy / (diffuse + glossy) } else { 0.0 },
        }
    }

    /// A surface that light goes on from as the engine has it: its diffuse lobe with the mean albedo, about the vertex normal.
    pub(super) fn sending_on(surface: &Surface) -> Self {
        Self {
            position: surface.position,
            normal: surface.vertex_normal,
            geometric: surface.geometric,
            diffuse: surface.reflection.sent_on().as_dvec3(),
            lobe: Lobe::NONE,
            glossy_share: 0.0,
        }
    }

    /// The diffuse lobe alone.
    pub(super) fn diffuse(self) -> Self {
        Self { lobe: Lobe::NONE, glossy_share: 0.0, ..self }
    }

    /// The glossy lobe alone.
    pub(super) fn glossy(self) -> Self {
        Self { diffuse: DVec3::ZERO, glossy_share: 1.0, ..self }
    }

    /// Whether nothing is reflected at all.
    pub(super) fn is_black(&self) -> bool {
        self.diffuse == DVec3::ZERO && self.lobe.albedo() == DVec3::ZERO
    }

    /// BRDF times cosine [1/sr] for light from the unit direction `towards`.
    pub(super) fn reflected(&self, towards: DVec3) -> DVec3 {
        let cosine = self.normal.dot(towards);
        if cosine <= 0.0 {
            return DVec3::ZERO;
        }
        let mut brdf = self.diffuse * DIFFUSE_LOBE;
        if self.glossy_share > 0.0 {
            brdf += self.lobe.brdf(towards);
        }
        brdf * cosine
    }

    /// Probability density [1/sr] with which [`Self::sample`] gives the unit direction `towards`.
    pub(super) fn density(&self, towards: DVec3) -> f64 {
        let diffuse = self.normal.dot(towards).max(0.0) / PI;
        if self.glossy_share == 0.0 {
            return diffuse;
        }
        diffuse + self.glossy_share * (self.lobe.density(towards) - diffuse)
    }

    /// A unit direction, by the cosine or by the lobe; `u` uniform in the unit square.
    pub(super) fn sample(&self, u: DVec2) -> DVec3 {
        if u.x < self.glossy_share {
            self.lobe.sample(DVec2::new(u.x / self.glossy_share, u.y))
        } else {
            let x = (u.x - self.glossy_share) / (1.0 - self.glossy_share);
            around(self.normal, (1.0 - u.y).sqrt(), x)
        }
    }
}
