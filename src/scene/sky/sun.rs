//! The sun of a sky, which becomes a directional light of its own: shadows of it are sharp.
//!
//! A sun is a connected region of texels that is small, far brighter than the sky's mean and than what is around it, and
//! has a good part of all light. Regions are looked for above one threshold after the other, from half of the brightest
//! texel's luminance down: a sun's glare is in its region as far as that stays small.

use super::Sky;
use crate::scene::{Light, luminance};
use glam::{DVec3, Vec3};

/// Widest region \[rad\]: larger ones are lamps and windows, whose shadows are soft.
const WIDEST: f64 = 5.0_f64.to_radians();

/// Least luminance of a sun's texels, in means of the sky.
const BRIGHT: f64 = 30.0;

/// Least luminance of its brightest texel, in means of what is around it.
const CONTRAST: f64 = 10.0;

/// Least share of the sky's luminous energy.
const SHARE: f64 = 0.01;

/// Texels that may be a sun's, and what is beyond their surroundings.
struct Region {
    texels: Vec<usize>,
    /// Mean radiance [cd/m^2] of the texels around it.
    around: DVec3,
    /// Light \[lx\] beyond that of the surroundings, through a plane that faces it.
    light: DVec3,
    /// Sum of directions by that light's luminance.
    vector: DVec3,
}

impl Sky {
    /// Takes the sun out of what lights, down to the radiance around it, and gives its light. What is shown keeps it.
    pub(super) fn split_sun(&mut self) -> Option<Light> {
        let shades: Vec<f64> = self.texels.iter().map(|texel| luminance(texel.as_dvec3())).collect();
        let energy = luminance(self.illuminance());
        let least = BRIGHT * energy / self.sphere();
        let peak = shades.iter().copied().fold(0.0, f64::max);
        let is_sun = |region: &Region| {
            let brightest = region.texels.iter().map(|texel| shades[*texel]).fold(0.0, f64::max);
            luminance(region.light) >= SHARE * energy
                && brightest >= CONTRAST * luminance(region.around)
                && self.is_small(region)
        };
        let mut best: Option<Region> = None;
        let mut threshold = 0.5 * peak;
        while threshold > least {
            for region in self.regions(&shades, threshold).into_iter().filter(is_sun) {
                if best.as_ref().is_none_or(|best| luminance(best.light) < luminance(region.light)) {
                    best = Some(region);
                }
            }
            threshold *= 0.5;
        }
        let sun = best?;
        let shown = self.texels.clone();
        for texel in &sun.texels {
            self.texels[*texel] = self.left(*texel, sun.around).as_vec3();
        }
        self.shown = Some(shown);
        let sun = super::parallel("sun".into(), sun.light, sun.vector);
        Some(Light { radius: Light::SUN_RADIUS, ..sun })
    }

    /// What is left of a texel's radiance where the surroundings have this one.
    fn left(&self, texel: usize, around: DVec3) -> DVec3 {
        self.texels[texel].as_dvec3().min(around).as_vec3().as_dvec3()
    }

    /// Connected texels, at edges and corners, above a threshold of luminance.
    fn regions(&self, shades: &[f64], threshold: f64) -> Vec<Region> {
        let mut seen = vec![false; shades.len()];
        let mut regions = Vec::new();
        for first in (0..shades.len()).filter(|texel| shades[*texel] > threshold) {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let (mut texels, mut next) = (vec![first], 0);
            let (mut around, mut weight) = (DVec3::ZERO, 0.0);
            while let Some(&texel) = texels.get(next) {
                next += 1;
                for neighbour in self.neighbours(texel) {
                    if shades[neighbour] > threshold {
                        if !std::mem::replace(&mut seen[neighbour], true) {
                            texels.push(neighbour);
                        }
                    } else {
                        let solid_angle = self.solid_angle(neighbour / self.width as usize);
                        around += solid_angle * self.texels[neighbour].as_dvec3();
                        weight += solid_angle;
                    }
                }
            }
            regions.push(self.region_of(texels, if weight > 0.0 { around / weight } else { DVec3::ZERO }));
        }
        regions
    }

    /// The eight texels around one; across the poles those of the other side are left out.
    fn neighbours(&self, texel: usize) -> impl Iterator<Item = usize> {
        let (width, height) = (self.width as usize, self.height as usize);
        let (column, row) = (texel % width, texel / width);
        let rows = row.saturating_sub(1)..(row + 2).min(height);
        let columns = move |row| [width - 1, 0, 1].map(|step| row * width + (column + step) % width);
        rows.flat_map(columns).filter(move |neighbour| *neighbour != texel)
    }

    fn region_of(&self, texels: Vec<usize>, around: DVec3) -> Region {
        let (mut light, mut vector) = (DVec3::ZERO, DVec3::ZERO);
        for texel in &texels {
            let (column, row) = (texel % self.width as usize, texel / self.width as usize);
            let beyond = (self.texels[*texel].as_dvec3() - self.left(*texel, around)) * self.solid_angle(row);
            light += beyond;
            vector += luminance(beyond) * self.direction(column, row);
        }
        Region { texels, around, light, vector }
    }

    /// Whether the middles of all texels are within a circle about the energy's centre.
    fn is_small(&self, region: &Region) -> bool {
        let centre = region.vector.normalize_or_zero();
        let width = self.width as usize;
        region.texels.iter().all(|t| self.direction(t % width, t / width).dot(centre) >= (0.5 * WIDEST).cos())
    }

    /// Solid angle \[sr\] of all texels.
    fn sphere(&self) -> f64 {
        (0..self.height as usize).map(|row| self.solid_angle(row) * f64::from(self.width)).sum()
    }
}

/// What is told of a sun that was split off.
pub(super) fn note(sun: &Light, sky: DVec3) -> String {
    let light = luminance((sun.color * sun.intensity).as_dvec3());
    let Vec3 { x, y, z } = -sun.direction;
    let share = 100.0 * light / (light + luminance(sky));
    format!(
        "The sky's sun is a light of its own: {light:.4} lx from ({x:.4}, {y:.4}, {z:.4}), {share:.1} % of its light."
    )
}
