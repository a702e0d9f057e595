//! Levels of interpolation: caches averaged at vertices, or at pixels with references from textures or cells. METHOD 5.

use super::study::{Pixel, Study};
use super::{ProxyWeight, Row};
use crate::reference::gather::{Cache, Gathered};
use crate::reference::interpolate::{Scheme, interpolate, interpolate_within, shade};
use glam::DVec3;
use rayon::prelude::*;

/// One row of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Levelled {
    /// The variation.
    pub name: String,
    /// Errors of the diffuse and the glossy lobe against brute force.
    pub lobes: [Row; 2],
    /// Mean number of caches averaged per pixel.
    pub averaged: f64,
    /// Mean jump of the diffuse radiance between neighbouring reference texels, relative to the mean; only with
    /// textures.
    pub seams: f64,
}

impl Study<'_> {
    /// The levels of interpolation, with 8 references unless stated otherwise. Textures are ideal: undistorted and
    /// without seams between charts. Distances are in units of the spacing `d_eps`.
    pub fn interpolation_levels(&self) -> Vec<Levelled> {
        let gathered = self.gather(ProxyWeight::Irradiance);
        let entry = |index: usize| (self.caches[index], gathered[index]);
        let at_vertices = |pixel: &Pixel| -> Picked {
            let lights = pixel.corners.map(|corner| {
                let vertex = &self.vertices[corner];
                let references: Vec<_> = vertex.references.iter().map(|i| entry(*i)).collect();
                interpolate(vertex.position, vertex.normal, vertex.mirrored, &references, Scheme::Facing)
            });
            let mut light = lights[0];
            let mean = |of: &dyn Fn(usize) -> DVec3| -> DVec3 { (0..3).map(|i| pixel.weights[i] * of(i)).sum() };
            light.diffuse_position = mean(&|i| lights[i].diffuse_position);
            light.diffuse_irradiance = mean(&|i| lights[i].diffuse_irradiance);
            light.glossy_position = mean(&|i| lights[i].glossy_position);
            light.glossy_irradiance = mean(&|i| lights[i].glossy_irradiance);
            let (diffuse, glossy) = shade(&light, pixel.position, pixel.normal, pixel.mirrored, &pixel.material);
            Picked { radiance: [diffuse, glossy], averaged: 24.0 }
        };
        let mut rows = vec![self.levelled("vertices", &at_vertices, None)];
        // Weights reach 0 at the farthest of them, as at a vertex.
        let nearest = |pixel: &Pixel| {
            let references: Vec<_> = self.best(pixel, pixel.position, 8).map(entry).collect();
            let d_max = references.iter().map(|(cache, _)| cache.position.distance(pixel.position)).fold(0.0, f64::max);
            shaded(pixel, &references, d_max)
        };
        rows.push(self.levelled("pixels, their own 8 best", &nearest, None));
        for reach in [0.8, 1.0, 1.2, 1.6] {
            let within = |pixel: &Pixel| {
                let near = |cache: &Cache| cache.position.distance(pixel.position) < reach * self.spacing;
                let own = self.vertices[pixel.corners[0]].own.clone();
                let references: Vec<_> = own.filter(|i| near(&self.caches[*i])).map(entry).collect();
                shaded(pixel, &references, reach * self.spacing)
            };
            rows.push(self.levelled(&format!("cells, all within {reach}"), &within, None));
        }
        for reach in [1.0, 1.6] {
            for side in [1.0, 0.5, 0.25, 0.125] {
                let of_texel = |pixel: &Pixel, texel: DVec3| {
                    let references: Vec<_> = self.best(pixel, texel, 8).map(entry).collect();
                    shaded(pixel, &references, reach * self.spacing)
                };
                let texel = |pixel: &Pixel| texel(pixel, side * self.spacing);
                let picked = |pixel: &Pixel| of_texel(pixel, texel(pixel));
                let next = |pixel: &Pixel| {
                    let (here, tangent) = (texel(pixel), pixel.normal.any_orthonormal_vector());
                    let step = tangent * (side * self.spacing);
                    of_texel(pixel, here).radiance[0].distance(of_texel(pixel, here + step).radiance[0])
                };
                let name = format!("textures, texels of {side}, d_max {reach}");
                rows.push(self.levelled(&name, &picked, Some(&next)));
            }
        }
        rows
    }

    /// The `count` caches of least error (5.95, corrected) for a pixel's surface at `place`.
    fn best(&self, pixel: &Pixel, place: DVec3, count: usize) -> impl Iterator<Item = usize> {
        let own = self.vertices[pixel.corners[0]].own.clone();
        let error = |index: usize| {
            let cache = &self.caches[index];
            let turned = (1.0 - pixel.normal.dot(cache.normal).clamp(0.0, 1.0)).sqrt();
            cache.position.distance(place) / self.spacing + turned
        };
        let mut all: Vec<(f64, usize)> = own.map(|index| (error(index), index)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.into_iter().take(count).map(|(_, index)| index)
    }

    fn levelled(
        &self,
        name: &str,
        picked: &(dyn Fn(&Pixel) -> Picked + Sync),
        next: Option<&(dyn Fn(&Pixel) -> f64 + Sync)>,
    ) -> Levelled {
        let all: Vec<Picked> = self.pixels.par_iter().map(picked).collect();
        let lobe = |lobe: usize| {
            let image: Vec<[f32; 3]> = all.iter().map(|p| p.radiance[lobe].as_vec3().to_array()).collect();
            Row::new(name, &image, &self.truth[lobe])
        };
        let count = all.len().max(1) as f64;
        let mean = all.iter().map(|p| p.radiance[0].length()).sum::<f64>() / count;
        let seams = next.map_or(0.0, |next| self.pixels.par_iter().map(next).sum::<f64>() / count);
        Levelled {
            name: name.into(),
            lobes: [lobe(0), lobe(1)],
            averaged: all.iter().map(|p| p.averaged).sum::<f64>() / count,
            seams: seams / mean.max(f64::MIN_POSITIVE),
        }
    }
}

/// Result for one pixel.
struct Picked {
    /// Diffuse and glossy [cd/m^2].
    radiance: [DVec3; 2],
    /// Number of caches that took part.
    averaged: f64,
}

fn shaded(pixel: &Pixel, references: &[(Cache, Gathered)], d_max: f64) -> Picked {
    let counts =
        |cache: &Cache| cache.position.distance(pixel.position) < d_max && cache.normal.dot(pixel.normal) > 0.0;
    let light = interpolate_within(pixel.position, pixel.normal, pixel.mirrored, references, Scheme::Facing, d_max);
    let (diffuse, glossy) = shade(&light, pixel.position, pixel.normal, pixel.mirrored, &pixel.material);
    let averaged = references.iter().filter(|(cache, _)| counts(cache)).count() as f64;
    Picked { radiance: [diffuse, glossy], averaged }
}

/// Centre of the reference texel that contains a pixel: squares of this side \[m\] in the pixel's tangent plane.
fn texel(pixel: &Pixel, side: f64) -> DVec3 {
    let u = pixel.normal.any_orthonormal_vector();
    let v = pixel.normal.cross(u);
    let snap = |x: f64| ((x / side).floor() + 0.5) * side - x;
    pixel.position + u * snap(u.dot(pixel.position)) + v * snap(v.dot(pixel.position))
}
