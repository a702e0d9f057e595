//! Scattering at a surface: Lambert, the glossy lobe, coat and sheen, evaluated and sampled.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Vec3};

use crate::reference::brdf::Lobe;
pub(super) use crate::reference::brdf::around;
use crate::reference::coat::Coat;
use crate::reference::gather::luminance;
use crate::reference::phong::DIFFUSE_LOBE;
use crate::reference::world::Surface;
use crate::scene::medium::{Medium, fresnel};

/// A point that scatters light towards a viewer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scatter {
    /// World position \[m\].
    pub(super) position: DVec3,
    /// Unit shading normal.
    pub(super) normal: DVec3,
    /// Unit normal of the triangle; light cannot pass through it.
    pub(super) geometric: DVec3,
    /// Diffuse albedo for this viewer.
    diffuse: DVec3,
    lobe: Lobe,
    coat: Coat,
    /// Whether there is sheen; it belongs to the diffuse part, the coat to the glossy part.
    shines: bool,
    /// Medium of the body that light enters at this point, if the path came out of it.
    entering: Option<Medium>,
    /// Probabilities of sampling the glossy lobe, the coat's lobe, and the uniform hemisphere for sheen.
    chances: [f64; 3],
}

impl Scatter {
    /// A surface hit by a ray of unit `direction`.
    pub(super) fn new(surface: &Surface, direction: DVec3) -> Self {
        let lobe = Lobe::new(&surface.reflection, surface.normal, direction);
        let cosine = -surface.normal.dot(direction);
        let over = &surface.reflection.over;
        Self {
            position: surface.position,
            normal: surface.normal,
            geometric: surface.geometric,
            diffuse: surface.reflection.diffuse(cosine).as_dvec3(),
            lobe,
            coat: Coat::new(over, [surface.normal, surface.vertex_normal], direction),
            shines: over.sheen != Vec3::ZERO,
            entering: None,
            chances: [0.0; 3],
        }
        .weighed(over.shone(cosine).0)
    }

    /// Sets the probabilities in proportion to the lobes' albedos under uniform light.
    fn weighed(self, shone: DVec3) -> Self {
        let under = self.coat.under;
        let sheen = if self.shines { (1.0 - self.coat.coated) * luminance(shone) } else { 0.0 };
        let all = [under * luminance(self.lobe.albedo()), self.coat.coated, sheen];
        let sum = under * luminance(self.diffuse) + all.iter().sum::<f64>();
        Self { chances: if sum > 0.0 { all.map(|own| own / sum) } else { [0.0; 3] }, ..self }
    }

    /// A surface as the engine's bounces see it: diffuse with the mean albedo, about the vertex normal.
    pub(super) fn sending_on(surface: &Surface) -> Self {
        Self {
            position: surface.position,
            normal: surface.vertex_normal,
            geometric: surface.geometric,
            diffuse: surface.reflection.sent_on().as_dvec3(),
            lobe: Lobe::NONE,
            coat: Coat::NONE,
            shines: false,
            entering: None,
            chances: [0.0; 3],
        }
    }

    /// Without the diffuse lobe: for a body that light enters.
    pub(super) fn on_the_surface(self) -> Self {
        Self { diffuse: DVec3::ZERO, ..self.glossy() }
    }

    /// A point where light enters a body of this medium: from each direction by its Fresnel transmittance; inside it
    /// continues as uniform light would.
    pub(super) fn entering(surface: &Surface, medium: Medium) -> Self {
        Self { diffuse: DVec3::ONE, entering: Some(medium), ..Self::sending_on(surface) }
    }

    /// Only the diffuse lobe and the sheen.
    pub(super) fn diffuse(self) -> Self {
        let [_, _, sheen] = self.chances;
        let sum = sheen + self.coat.under * luminance(self.diffuse);
        let chances = [0.0, 0.0, if self.shines { sheen / sum } else { 0.0 }];
        Self { lobe: Lobe::NONE, coat: Coat { share: 0.0, ..self.coat }, chances, ..self }
    }

    /// Only the glossy lobe and the coat.
    pub(super) fn glossy(self) -> Self {
        let [lobe, coat, _] = self.chances;
        let chances = if coat > 0.0 { [lobe / (lobe + coat), coat / (lobe + coat), 0.0] } else { [1.0, 0.0, 0.0] };
        Self { diffuse: DVec3::ZERO, shines: false, chances, ..self }
    }

    /// Whether nothing is reflected.
    pub(super) fn is_black(&self) -> bool {
        let own = self.diffuse == DVec3::ZERO && self.lobe.albedo() == DVec3::ZERO;
        own && self.coat.share == 0.0 && !self.shines
    }

    /// Share of the surface's emission that passes the coat.
    pub(super) fn uncoated(&self) -> f64 {
        1.0 - self.coat.coated
    }

    /// BRDF times cosine [1/sr] for light from the unit direction `towards`.
    pub(super) fn reflected(&self, towards: DVec3) -> DVec3 {
        let coat = self.coat.reflected(towards);
        let cosine = self.normal.dot(towards);
        if cosine <= 0.0 {
            return coat;
        }
        let mut brdf = self.diffuse * DIFFUSE_LOBE;
        if self.chances[0] > 0.0 {
            brdf += self.lobe.brdf(towards);
        }
        if let Some(medium) = &self.entering {
            brdf *= (1.0 - fresnel(cosine, medium.ior)) / medium.entering;
        }
        let sheen = if self.shines { self.coat.shone(towards) } else { DVec3::ZERO };
        brdf * (cosine * self.coat.under) + sheen + coat
    }

    /// Probability density [1/sr] of the unit direction `towards` in [`Self::sample`].
    pub(super) fn density(&self, towards: DVec3) -> f64 {
        let diffuse = self.normal.dot(towards).max(0.0) / PI;
        let [glossy, coat, sheen] = self.chances;
        let mut density = diffuse;
        if glossy > 0.0 {
            density += glossy * (self.lobe.density(towards) - diffuse);
        }
        if coat > 0.0 {
            density += coat * (self.coat.lobe.density(towards) - diffuse);
        }
        if sheen > 0.0 {
            let even = if self.normal.dot(towards) > 0.0 { 1.0 / TAU } else { 0.0 };
            density += sheen * (even - diffuse);
        }
        density
    }

    /// Samples a unit direction, by the cosine or from one of the other lobes; `u` is uniform in the unit square.
    pub(super) fn sample(&self, u: DVec2) -> DVec3 {
        let mut before = 0.0;
        for (which, chance) in self.chances.into_iter().enumerate() {
            if u.x < before + chance {
                let u = DVec2::new((u.x - before) / chance, u.y);
                return match which {
                    0 => self.lobe.sample(u),
                    1 => self.coat.lobe.sample(u),
                    _ => around(self.normal, 1.0 - u.y, u.x),
                };
            }
            before += chance;
        }
        around(self.normal, (1.0 - u.y).sqrt(), ((u.x - before) / (1.0 - before)).clamp(0.0, 1.0))
    }
}
