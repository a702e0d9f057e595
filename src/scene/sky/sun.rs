//! Separates the sun from a sky as a directional light of its own, for sharp shadows.
//!
//! A sun is a small connected region of texels, far brighter than the sky's mean and its surroundings, with a
//! considerable share of all light. The search lowers a luminance threshold step by step, from half of the brightest
//! texel's luminance: a sun's glare belongs to its region as long as the region stays small.

use super::Sky;
use crate::scene::{Light, luminance};
use glam::{DVec3, Vec3};

/// Largest width of a sun \[rad\]; larger regions are lamps and windows with soft shadows.
const WIDEST: f64 = 5.0_f64.to_radians();

/// Least luminance of a sun's texels, as a multiple of the sky's mean.
const BRIGHT: f64 = 30.0;

/// Least luminance of the brightest texel, as a multiple of the surroundings' mean.
const CONTRAST: f64 = 10.0;

/// Least share of the sky's luminous energy.
const SHARE: f64 = 0.01;

/// A candidate for the sun: its texels and its light in excess of its surroundings.
struct Region {
    texels: Vec<usize>,
    /// Mean radiance [cd/m^2] of the surrounding texels.
    around: DVec3,
    /// Light \[lx\] in excess of the surroundings, through a plane that faces it.
    light: DVec3,
    /// Sum of directions weighted by the luminance of this light.
    vector: DVec3,
}

impl Sky {
    /// Removes the sun from the lighting, down to the radiance around it, and returns the sun as a light. The displayed
    /// sky keeps it.
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

    /// Radiance that remains in a texel if its surroundings have radiance `around`.
    fn left(&self, texel: usize, around: DVec3) -> DVec3 {
        self.texels[texel].as_dvec3().min(around).as_vec3().as_dvec3()
    }

    /// Regions of texels above a luminance threshold, connected at edges and corners.
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

    /// The eight texels around a texel; neighbours across a pole are left out.
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

    /// Whether all texel centres lie within a circle around the centre of energy.
    fn is_small(&self, region: &Region) -> bool {
        let centre = region.vector.normalize_or_zero();
        let width = self.width as usize;
        region.texels.iter().all(|t| self.direction(t % width, t / width).dot(centre) >= (0.5 * WIDEST).cos())
    }

    /// Solid angle \[sr\] of the whole grid.
    fn sphere(&self) -> f64 {
        (0..self.height as usize).map(|row| self.solid_angle(row) * f64::from(self.width)).sum()
    }
}

/// Note for the user about a sun that was separated.
pub(super) fn note(sun: &Light, sky: DVec3) -> String {
    let light = luminance((sun.color * sun.intensity).as_dvec3());
    let Vec3 { x, y, z } = -sun.direction;
    let share = 100.0 * light / (light + luminance(sky));
    format!(
        "The sky's sun is a separate light: {light:.4} lx from ({x:.4}, {y:.4}, {z:.4}), {share:.1} % of all light."
    )
}
