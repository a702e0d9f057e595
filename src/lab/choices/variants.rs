//! Variants of averaging the proxies of a vertex's references; two of them are the engine's.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::study::{Pixel, Study, Vertex};
use crate::reference::gather::{Cache, Gathered, Lobe, luminance, val_geometry};
use crate::reference::interpolate::{KERNEL_CORE, Scheme};
use crate::reference::interpolate::{LEAST_LOBE_COSINE, LEAST_PULL, falloff, kernel};
use crate::reference::phong::{DIFFUSE_LOBE, cos_power, phong_lobe};

/// One way to interpolate one lobe. METHOD 5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Variant {
    /// Weights of the references.
    pub(super) kernel: Kernel,
    /// Whether the kernel compares mirrored view directions instead of normals.
    pub(super) by_view: bool,
    /// Quantity averaged besides the position.
    pub(super) carried: Carried,
    /// Exponent on the engine's `falloff`; 0 for none.
    pub(super) falloff: f64,
    /// Share of the light vector (sum of directions weighted by light) in the direction.
    pub(super) vector: f64,
    /// Exponent, relative to the lobe's, of a point's lobe response to a proxy in the weights of positions.
    pub(super) pull: f64,
    /// The same in the weights of irradiances.
    pub(super) weighed: f64,
    /// How unlit caches count: 0 not at all, 1 in the irradiance, 2 also with a position above themselves.
    pub(super) unlit: u32,
}

/// Weights of the references.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kernel {
    /// One of the engine's two kernels.
    Of(Scheme),
    /// `(1-t)^2 cos^n / (t^p + 1e-3)` with `n` and `p`.
    Powers(f64, f64),
    /// The faster kernel, with this many squared distances from the tangent planes added to the squared distance.
    Planes(f64),
}

/// Quantity averaged besides the position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Carried {
    /// Facing irradiance.
    Facing,
    /// Flux, as printed.
    Flux,
    /// Flux, with the averaged light pushed out to the mean distance of the caches' nearest VALs (lines 1757-1772).
    PushedFlux,
}

impl Variant {
    /// Fluxes, as printed.
    pub(super) const PRINTED: Self = Self {
        kernel: Kernel::Of(Scheme::Printed),
        by_view: false,
        carried: Carried::Flux,
        falloff: 0.0,
        vector: 0.0,
        pull: 0.0,
        weighed: 0.0,
        unlit: 1,
    };
    /// Facing irradiances with the faster kernel, without extras.
    pub(super) const FACING: Self =
        Self { kernel: Kernel::Of(Scheme::Facing), carried: Carried::Facing, ..Self::PRINTED };
    /// The engine's diffuse lobe.
    pub(super) const DIFFUSE: Self = Self { falloff: 1.0, ..Self::FACING };
    /// The engine's glossy lobe.
    pub(super) const GLOSSY: Self = Self { pull: 1.0, weighed: 0.1, unlit: 0, ..Self::FACING };
}

/// A cache's lobe, with the data that variants need.
pub(super) struct Proxy<'a> {
    pub(super) cache: &'a Cache,
    pub(super) mirrored: DVec3,
    pub(super) lobe: Lobe,
    /// Distance \[m\] to its nearest contributing VAL.
    pub(super) nearest: f64,
}

/// Averages that vary linearly over a triangle.
#[derive(Clone, Copy, Default)]
struct Average {
    position: DVec3,
    carried: DVec3,
}

impl Study<'_> {
    /// Proxies of one lobe for all caches, from what they gathered.
    pub(super) fn proxies(&self, gathered: &[Gathered], lobe: fn(&Gathered) -> &Lobe) -> Vec<Proxy<'_>> {
        let all = self.caches.par_iter().zip(gathered);
        all.map(|(cache, gathered)| {
            let reaches = |val: &&_| val_geometry(cache.position, cache.normal, val).0 > 0.0;
            let nearest = self.vals.iter().filter(reaches).map(|val| val.position.distance(cache.position));
            Proxy {
                cache,
                mirrored: gathered.mirrored_view,
                lobe: *lobe(gathered),
                nearest: nearest.fold(f64::INFINITY, f64::min),
            }
        })
        .collect()
    }

    /// Radiance of one lobe in every pixel, averaged at the vertices as in the engine.
    pub(super) fn render(&self, variant: &Variant, proxies: &[Proxy<'_>], is_glossy: bool) -> Vec<[f32; 3]> {
        let references: Vec<Vec<usize>> = self.vertices.iter().map(|vertex| vertex.references.clone()).collect();
        self.render_with(variant, proxies, is_glossy, &references)
    }

    /// The same with other references per vertex.
    pub(super) fn render_with(
        &self,
        variant: &Variant,
        proxies: &[Proxy<'_>],
        is_glossy: bool,
        references: &[Vec<usize>],
    ) -> Vec<[f32; 3]> {
        let vertices = self.vertices.par_iter().zip(references);
        let averages: Vec<Average> = vertices.map(|(v, own)| average(variant, v, own, proxies)).collect();
        let shade = |pixel: &Pixel| {
            let mean = |of: fn(&Average) -> DVec3| -> DVec3 {
                pixel.corners.iter().zip(pixel.weights).map(|(corner, weight)| weight * of(&averages[*corner])).sum()
            };
            let offset = mean(|average| average.position) - pixel.position;
            let sphere = if variant.carried == Carried::Facing { 1.0 } else { 4.0 * PI * offset.length_squared() };
            let towards = offset.normalize_or_zero();
            let material = &pixel.material;
            let brdf = match is_glossy {
                true => material.specular * phong_lobe(material.exponent, pixel.mirrored.dot(towards)),
                false => material.diffuse * DIFFUSE_LOBE,
            };
            let carried = mean(|average| average.carried) / sphere.max(f64::MIN_POSITIVE);
            (brdf * carried * pixel.normal.dot(towards).max(0.0)).as_vec3().to_array()
        };
        self.pixels.par_iter().map(shade).collect()
    }
}

/// The proxies of the references that take part, with their weights.
fn weights<'a>(
    variant: &Variant,
    vertex: &Vertex,
    references: &[usize],
    proxies: &'a [Proxy<'a>],
) -> Vec<(&'a Proxy<'a>, f64)> {
    let distance = |proxy: &Proxy<'_>| proxy.cache.position.distance(vertex.position);
    let farthest = references.iter().map(|r| distance(&proxies[*r])).fold(f64::MIN_POSITIVE, f64::max);
    let weight = |proxy: &Proxy<'_>| {
        let t = distance(proxy) / farthest;
        let cos = match variant.by_view {
            true => vertex.mirrored.dot(proxy.mirrored),
            false => vertex.normal.dot(proxy.cache.normal),
        };
        let fast = |power: f64, t2: f64| (1.0 - t).powi(2) * cos.max(0.0).powf(power) / (t2 + KERNEL_CORE);
        match variant.kernel {
            Kernel::Of(scheme) => kernel(scheme, t, cos),
            Kernel::Powers(normal, distance) => fast(normal, t.powf(distance)),
            Kernel::Planes(share) => {
                let offset = (proxy.cache.position - vertex.position) / farthest;
                let plane = vertex.normal.dot(offset).abs().max(proxy.cache.normal.dot(offset).abs());
                fast(4.0, t * t + share * plane * plane)
            }
        }
    };
    let taking_part = references.iter().map(|r| &proxies[*r]);
    let all: Vec<_> = taking_part.filter(|proxy| variant.unlit > 0 || proxy.lobe.lit).collect();
    let mut weights: Vec<f64> = all.iter().map(|proxy| weight(proxy)).collect();
    if weights.iter().all(|w| *w == 0.0) {
        weights = all.iter().map(|proxy| 1.0 / ((distance(proxy) / farthest).powi(2) + KERNEL_CORE)).collect();
    }
    all.into_iter().zip(weights).collect()
}

fn average(variant: &Variant, vertex: &Vertex, references: &[usize], proxies: &[Proxy<'_>]) -> Average {
    let x = vertex.position;
    let sees = |offset: DVec3, exponent: f64| {
        cos_power(exponent, vertex.mirrored.dot(offset.normalize_or_zero()).max(LEAST_LOBE_COSINE))
    };
    let (mut total, mut pulls, mut exponent, mut nearest) = (0.0, 0.0, 0.0, 0.0);
    let [mut position, mut carried, mut plain, mut vector] = [DVec3::ZERO; 4];
    for (Proxy { cache, lobe, nearest: own, .. }, weight) in weights(variant, vertex, references, proxies) {
        total += weight;
        exponent += weight * cache.exponent;
        if !lobe.lit && variant.unlit < 2 {
            continue;
        }
        let offset = lobe.position - x;
        let pull = match variant.pull {
            0.0 => weight,
            share => weight * (sees(offset, share * cache.exponent) + LEAST_PULL),
        };
        pulls += pull;
        position += pull * offset;
        nearest += weight * if own.is_finite() { *own } else { 0.0 };
        let own2 = lobe.position.distance_squared(cache.position);
        let light = match variant.carried {
            Carried::Facing => lobe.facing_irradiance,
            Carried::Flux | Carried::PushedFlux => lobe.flux(cache),
        };
        let light = match variant.falloff {
            0.0 => light,
            share => light * falloff(lobe.distance2, own2, offset.length_squared()).powf(share),
        };
        plain += weight * light;
        carried +=
            weight * light * if variant.weighed > 0.0 { sees(offset, variant.weighed * cache.exponent) } else { 1.0 };
        vector += weight * luminance(light) * offset.normalize_or_zero();
    }
    if pulls == 0.0 {
        return Average { position: x + vertex.normal, carried: DVec3::ZERO };
    }
    let mut offset = position / pulls;
    if variant.vector > 0.0 {
        let towards = offset.normalize_or_zero().lerp(vector.normalize_or_zero(), variant.vector);
        offset = offset.length() * towards.normalize_or_zero();
    }
    if variant.carried == Carried::PushedFlux && offset.length() * total < nearest {
        offset *= nearest / total / offset.length().max(f64::MIN_POSITIVE);
    }
    if variant.weighed > 0.0 {
        carried = (carried / sees(offset, variant.weighed * exponent / total).max(1e-30)).min(plain);
    }
    Average { position: x + offset, carried: carried / total }
}

#[cfg(test)]
mod tests {
    use super::super::study::StudySettings;
    use super::*;
    use crate::reference::gather::{ProxyWeight, gather};
    use crate::reference::interpolate::interpolate;
    use crate::scene::build::{CornellSurface, cornell};

    #[test]
    fn the_engines_schemes_are_among_the_variants() {
        let scene = cornell(CornellSurface::Glossy, 0.2);
        let settings = StudySettings { size: [32, 18], caches: 100, rsm: 12 };
        let study = Study::new(&scene, &scene.cameras[0], settings).expect("a study");
        let gathered = study.caches.iter().map(|c| gather(c, &study.vals, Some(study.eye()), ProxyWeight::Irradiance));
        let gathered: Vec<Gathered> = gathered.collect();
        let [diffuse, glossy] = [study.proxies(&gathered, |g| &g.diffuse), study.proxies(&gathered, |g| &g.glossy)];
        let printed_glossy = Variant { by_view: true, ..Variant::PRINTED };
        for (scheme, of_diffuse, of_glossy) in
            [(Scheme::Facing, Variant::DIFFUSE, Variant::GLOSSY), (Scheme::Printed, Variant::PRINTED, printed_glossy)]
        {
            for v in &study.vertices {
                let references: Vec<_> = v.references.iter().map(|r| (study.caches[*r], gathered[*r])).collect();
                let light = interpolate(v.position, v.normal, v.mirrored, &references, scheme);
                for (variant, proxies, position, irradiance) in [
                    (of_diffuse, &diffuse, light.diffuse_position, light.diffuse_irradiance),
                    (of_glossy, &glossy, light.glossy_position, light.glossy_irradiance),
                ] {
                    let found = average(&variant, v, &v.references, proxies);
                    let sphere = 4.0 * PI * found.position.distance_squared(v.position);
                    let carried = if scheme == Scheme::Printed { irradiance * sphere } else { irradiance };
                    assert!(found.position.distance(position) < 1e-9, "{} instead of {position}", found.position);
                    let off = found.carried.distance(carried);
                    assert!(off <= 1e-9 * carried.length(), "{} instead of {carried}", found.carried);
                }
            }
        }
    }
}
