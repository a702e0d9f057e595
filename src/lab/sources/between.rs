//! Interpolation between caches (stage 8): with one proxy per cache, or with each VAL separately. METHOD 5.

use glam::DVec3;
use rayon::prelude::*;

use super::Lights;
use super::exact::{Exact, Receiver, receive};
use super::stage::{Level, Pixel, Point, Stage};
use super::vals::Texel;
use crate::reference::gather::{Cache, Gathered, LEAST_COSINE};
use crate::reference::interpolate::{Interpolated, Scheme, distance_kernel, falloff, interpolate, kernel, shade};
use crate::reference::phong::{cos_power, mirrored_view};

impl Stage<'_> {
    /// The engine's picture: proxies averaged at `level`, interpolated linearly across a triangle and shaded at the
    /// pixel.
    pub fn interpolate(&self, proxies: &[Gathered], level: Level) -> Lights {
        let light = |pixel: &Pixel| {
            let average = |point: Point| {
                let references: Vec<_> = point.references.iter().map(|i| (self.caches[*i], proxies[*i])).collect();
                let light = interpolate(point.position, point.normal, point.mirrored, &references, Scheme::Facing);
                (point.share, light)
            };
            let averaged: Vec<(f64, Interpolated)> = self.points(pixel, level).into_iter().map(average).collect();
            let mean = |of: fn(&Interpolated) -> DVec3| averaged.iter().map(|(share, l)| *share * of(l)).sum::<DVec3>();
            let light = Interpolated {
                diffuse_position: mean(|l| l.diffuse_position),
                diffuse_irradiance: mean(|l| l.diffuse_irradiance),
                has_diffuse: true,
                glossy_position: mean(|l| l.glossy_position),
                glossy_irradiance: mean(|l| l.glossy_irradiance),
                has_glossy: true,
            };
            let (diffuse, glossy) = shade(&light, pixel.position, pixel.normal, pixel.mirrored, &pixel.material);
            [diffuse, glossy]
        };
        self.pixels.par_iter().map(light).collect()
    }

    /// The same with each VAL separately: gathered alone, interpolated alone by the engine's rules, then summed. A
    /// proxy of one VAL is the VAL itself, so only its facing irradiance is averaged.
    pub fn interpolate_each(&self, texels: &[Texel], level: Level) -> Lights {
        let weights: Vec<Vec<Weights>> = self
            .pixels
            .par_iter()
            .map(|pixel| self.points(pixel, level).iter().map(|point| self.weights(point)).collect())
            .collect();
        let mut sums = vec![[DVec3::ZERO; 2]; self.pixels.len()];
        for block in texels.chunks(BLOCK) {
            let rows: Vec<Vec<f32>> = self.caches.par_iter().map(|cache| self.row(cache, block)).collect();
            sums.par_iter_mut().zip(&self.pixels).zip(&weights).for_each(|((sum, pixel), weights)| {
                let is_glossy = pixel.material.specular != DVec3::ZERO;
                for (j, texel) in block.iter().enumerate() {
                    let direction = (texel.val.position - pixel.position).normalize_or_zero();
                    let cosine = pixel.normal.dot(direction);
                    if cosine <= 0.0 {
                        continue;
                    }
                    let diffuse: f64 =
                        weights.iter().map(|w| w.diffuse(&self.caches, &rows, j, texel.val.position)).sum();
                    sum[0] += texel.val.flux * (diffuse * cosine);
                    let lobe =
                        if is_glossy { cos_power(pixel.material.exponent, pixel.mirrored.dot(direction)) } else { 0.0 };
                    if lobe > 0.0 {
                        let glossy: f64 = weights.iter().map(|w| w.glossy(&rows, j)).sum();
                        sum[1] += texel.val.flux * (glossy * cosine * lobe);
                    }
                }
            });
        }
        let reflected = |(pixel, [diffuse, glossy]): (&Pixel, [DVec3; 2])| pixel.reflect(diffuse, glossy);
        self.pixels.iter().zip(sums).map(reflected).collect()
    }

    /// A cache's facing irradiance per flux [1/m^2] for each VAL, negated if its glossy lobe is unlit.
    fn row(&self, cache: &Cache, block: &[Texel]) -> Vec<f32> {
        let mirrored = mirrored_view(cache.position, cache.normal, self.eye);
        let at = Receiver {
            position: cache.position,
            normal: cache.normal,
            lobe: self.glossy.then_some((mirrored, cache.exponent)),
        };
        let kept = |texel: &Texel| {
            let (geometry, direction, lobe) = receive(texel, &at, Exact::default());
            let cosine = cache.normal.dot(direction);
            let facing = if cosine > LEAST_COSINE { geometry / cosine } else { 0.0 };
            (if lobe > 0.0 { facing } else { -facing }) as f32
        };
        block.iter().map(kept).collect()
    }

    fn weights(&self, point: &Point) -> Weights {
        let distance = |i: &usize| self.caches[*i].position.distance(point.position);
        let farthest = point.references.iter().map(distance).fold(0.0, f64::max);
        let t = |i: &usize| if farthest > 0.0 { distance(i) / farthest } else { 0.0 };
        let apart: Vec<f64> = point.references.iter().map(|i| distance_kernel(t(i))).collect();
        let weight = |i: &usize| kernel(Scheme::Facing, t(i), point.normal.dot(self.caches[*i].normal));
        let glossy: Vec<f64> = point.references.iter().map(weight).collect();
        let mut diffuse = glossy.clone();
        if diffuse.iter().all(|weight| *weight == 0.0) {
            diffuse.clone_from(&apart);
        }
        let total: f64 = diffuse.iter().sum();
        diffuse.iter_mut().for_each(|weight| *weight *= point.share / total);
        Weights {
            share: point.share,
            position: point.position,
            caches: point.references.clone(),
            diffuse,
            glossy,
            apart,
        }
    }
}

/// VALs whose rows are held at a time: 16 MiB for 2000 caches.
const BLOCK: usize = 2048;

/// Weights of the references at one point.
struct Weights {
    share: f64,
    /// Position of the point \[m\].
    position: DVec3,
    caches: Vec<usize>,
    /// Normalised, times `share`.
    diffuse: Vec<f64>,
    glossy: Vec<f64>,
    /// Weights by distance alone, used if no participating cache has weight.
    apart: Vec<f64>,
}

impl Weights {
    /// Average at the point of the caches' values for the VAL at `val` \[m\], with falloff.
    fn diffuse(&self, caches: &[Cache], rows: &[Vec<f32>], j: usize, val: DVec3) -> f64 {
        let here = val.distance_squared(self.position);
        let left = |(cache, weight): (&usize, &f64)| {
            let there = val.distance_squared(caches[*cache].position);
            weight * f64::from(rows[*cache][j].abs()) * falloff(there, there, here)
        };
        self.caches.iter().zip(&self.diffuse).map(left).sum()
    }

    /// Skips caches whose glossy lobe the VAL does not reach. A single VAL has the same response in the point's lobe
    /// for all caches, so that lobes do not change the weights.
    fn glossy(&self, rows: &[Vec<f32>], j: usize) -> f64 {
        for weights in [&self.glossy, &self.apart] {
            let (mut sum, mut total) = (0.0, 0.0);
            for (cache, weight) in self.caches.iter().zip(weights) {
                let facing = rows[*cache][j];
                if facing > 0.0 {
                    sum += weight * f64::from(facing);
                    total += weight;
                }
            }
            if total > 0.0 {
                return self.share * sum / total;
            }
        }
        0.0
    }
}
