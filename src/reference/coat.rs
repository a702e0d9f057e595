//! What lies over a surface's own lobes, as a viewer sees it: a clear coat, and sheen below it. METHOD 16.

use std::f64::consts::TAU;

use glam::DVec3;

use super::brdf::Lobe;
use crate::scene::material::Over;
use crate::scene::{ggx, sheen};

/// Coat and sheen at a point, towards a viewer.
#[derive(Clone, Copy, Debug)]
pub struct Coat {
    /// The coat's lobe, about its own normal, of a surface that all of is coated.
    pub lobe: Lobe,
    /// Unit normal of the coat.
    pub normal: DVec3,
    /// Share of the surface that has the coat.
    pub share: f64,
    /// The sheen.
    pub sheen: Sheen,
    /// Share of even light that the coat reflects.
    pub coated: f64,
    /// Share of what is below both that comes through.
    pub under: f64,
}

impl Coat {
    /// Nothing over a surface.
    pub const NONE: Self = Self {
        lobe: Lobe::NONE,
        normal: DVec3::Z,
        share: 0.0,
        sheen: Sheen { color: DVec3::ZERO, roughness: 1.0, normal: DVec3::Z, view: DVec3::Z },
        coated: 0.0,
        under: 1.0,
    };

    /// What lies over a surface, looked at in the unit `direction`; sheen is about the first normal, the coat about the second.
    pub fn new(over: &Over, [normal, of_coat]: [DVec3; 2], direction: DVec3) -> Self {
        if *over == Over::default() {
            return Self::NONE;
        }
        let view = |normal: DVec3| {
            let up = (ggx::LEAST_COSINE + normal.dot(direction)).max(0.0);
            (up * normal - direction).normalize()
        };
        let coated = over.coated(-of_coat.dot(direction));
        Self {
            lobe: Lobe::Ggx {
                f0: DVec3::splat(Over::F0),
                f90: 1.0,
                roughness: over.coat_roughness.into(),
                normal: of_coat,
                view: view(of_coat),
            },
            normal: of_coat,
            share: over.coat.into(),
            sheen: Sheen {
                color: over.sheen.as_dvec3(),
                roughness: over.sheen_roughness.into(),
                normal,
                view: view(normal),
            },
            coated,
            under: (1.0 - coated) * over.shone(-normal.dot(direction)).1,
        }
    }

    /// BRDF times cosine [1/sr] of the coat for light from the unit direction `towards`.
    pub fn reflected(&self, towards: DVec3) -> DVec3 {
        let cosine = self.normal.dot(towards);
        if self.share == 0.0 || cosine <= 0.0 {
            return DVec3::ZERO;
        }
        self.share * cosine * self.lobe.brdf(towards)
    }

    /// The same of the sheen below it.
    pub fn shone(&self, towards: DVec3) -> DVec3 {
        if self.sheen.color == DVec3::ZERO {
            return DVec3::ZERO;
        }
        (1.0 - self.coated) * self.sheen.reflected(towards)
    }
}

/// Fine fibres: Estevez and Kulla's "Charlie", with Smith's shadowing.
#[derive(Clone, Copy, Debug)]
pub struct Sheen {
    /// Colour.
    pub color: DVec3,
    /// Root of alpha.
    pub roughness: f64,
    /// Unit normal.
    pub normal: DVec3,
    /// Unit direction towards the viewer, turned up to a cosine of [`ggx::LEAST_COSINE`].
    pub view: DVec3,
}

impl Sheen {
    /// BRDF times cosine [1/sr] for light from the unit direction `towards`, as the formula says.
    pub fn whole(&self, towards: DVec3) -> f64 {
        let [nv, nl] = [self.view, towards].map(|w| self.normal.dot(w));
        if nl <= 0.0 {
            return 0.0;
        }
        let alpha = self.roughness * self.roughness;
        let sine = self.normal.cross((self.view + towards).normalize()).length();
        let density = (2.0 + 1.0 / alpha) * sine.powf(1.0 / alpha) / TAU;
        let shadowing = 1.0 / (1.0 + sheen::lambda(alpha, nv.min(1.0)) + sheen::lambda(alpha, nl.min(1.0)));
        density * shadowing / (4.0 * nv)
    }

    /// The same of its colour, and never more light than it gets.
    pub fn reflected(&self, towards: DVec3) -> DVec3 {
        let excess = sheen::whole(self.roughness, self.normal.dot(self.view)).max(1.0);
        self.color * (self.whole(towards) / excess)
    }
}
