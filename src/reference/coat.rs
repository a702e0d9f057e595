//! Layers above a surface's own lobes, for a viewer: a clear coat, and sheen below it. METHOD 16.

use std::f64::consts::TAU;

use glam::DVec3;

use super::brdf::Lobe;
use crate::scene::material::Over;
use crate::scene::{ggx, sheen};

/// Coat and sheen at a point for one viewer.
#[derive(Clone, Copy, Debug)]
pub struct Coat {
    /// Lobe of a full coat, about the coat's own normal.
    pub lobe: Lobe,
    /// Unit normal of the coat.
    pub normal: DVec3,
    /// Share of the surface that is coated.
    pub share: f64,
    /// The sheen.
    pub sheen: Sheen,
    /// Share of uniform light that the coat reflects.
    pub coated: f64,
    /// Share of the base layer's light that passes both.
    pub under: f64,
}

impl Coat {
    /// No coat and no sheen.
    pub const NONE: Self = Self {
        lobe: Lobe::NONE,
        normal: DVec3::Z,
        share: 0.0,
        sheen: Sheen { color: DVec3::ZERO, roughness: 1.0, normal: DVec3::Z, view: DVec3::Z },
        coated: 0.0,
        under: 1.0,
    };

    /// Coat and sheen of a surface seen in the unit `direction`. Sheen is about the first normal, the coat about the
    /// second.
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

    /// The same for the sheen below the coat.
    pub fn shone(&self, towards: DVec3) -> DVec3 {
        if self.sheen.color == DVec3::ZERO {
            return DVec3::ZERO;
        }
        (1.0 - self.coated) * self.sheen.reflected(towards)
    }
}

/// Sheen of fine fibres: Estevez and Kulla's "Charlie" with Smith's shadowing.
#[derive(Clone, Copy, Debug)]
pub struct Sheen {
    /// Colour.
    pub color: DVec3,
    /// Square root of alpha.
    pub roughness: f64,
    /// Unit normal.
    pub normal: DVec3,
    /// Unit direction towards the viewer, raised to a cosine of at least [`ggx::LEAST_COSINE`].
    pub view: DVec3,
}

impl Sheen {
    /// BRDF times cosine [1/sr] of white sheen for light from the unit direction `towards`, by the formula.
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

    /// The same in its colour, scaled down where the formula would reflect more light than arrives.
    pub fn reflected(&self, towards: DVec3) -> DVec3 {
        let excess = sheen::whole(self.roughness, self.normal.dot(self.view)).max(1.0);
        self.color * (self.whole(towards) / excess)
    }
}
