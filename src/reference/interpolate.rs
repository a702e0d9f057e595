//! Stage 8, interpolation: indirect radiance at a point from the proxies of its references. METHOD 5, thesis 5.3.5.

use std::f64::consts::PI;

use glam::DVec3;

use super::gather::{Cache, Gathered, Lobe};
use super::phong::{DIFFUSE_LOBE, Material, cos_power, phong_lobe};

/// Averaged quantities and weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Facing irradiances and positions with a fast-decaying kernel; the position only gives the direction.
    #[default]
    Facing,
    /// Fluxes and positions with the printed weights 5.50 and 5.51; light falls off from the averaged position.
    Printed,
}

/// The averaged light at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interpolated {
    /// Position of the diffuse light \[m\].
    pub diffuse_position: DVec3,
    /// Irradiance \[lx\] at the point on a plane that faces the diffuse light.
    pub diffuse_irradiance: DVec3,
    /// Whether any diffuse light takes part; otherwise the position is meaningless.
    pub has_diffuse: bool,
    /// Position of the glossy light \[m\].
    pub glossy_position: DVec3,
    /// Irradiance \[lx\] at the point on a plane that faces the glossy light.
    pub glossy_irradiance: DVec3,
    /// Whether any glossy light takes part; otherwise the position is meaningless.
    pub has_glossy: bool,
}

/// Share of the squared largest distance that is added to the kernel's denominator: keeps it finite at a cache.
pub const KERNEL_CORE: f64 = 1e-3;

/// Exponent with which facing irradiances are weighted at a point, as a share of the material's Phong exponent. At 0
/// light outside the point's lobe counts fully, and dark pixels get too bright. At 1 a wide light vanishes between two
/// caches whose lobes see different parts of it.
pub const WEIGHED_SHARE: f64 = 0.1;

/// Lower bound of a lobe's cosine at a point: keeps weights positive and quotients finite.
pub const LEAST_LOBE_COSINE: f64 = 1e-2;

/// Lower bound of a proxy's weight in the averaged position: if no lobe sees its proxy, all count equally.
pub const LEAST_PULL: f64 = 1e-12;

/// Smallest divisor that f32 handles.
const LEAST_DIVISOR: f64 = 1e-30;

/// Weight of a reference. `t` is its distance as a share of `d_max`; `cos` is the cosine between its direction (normal,
/// or mirrored view in the printed scheme's glossy lobe) and the point's.
///
/// `Facing`: `(1-t)^2 (cos+)^4 / (t^2 + 1e-3)`; `Printed`, eq. 5.50 and 5.51: `(1-t) sqrt(cos+)`.
pub fn kernel(scheme: Scheme, t: f64, cos: f64) -> f64 {
    match scheme {
        Scheme::Facing => (1.0 - t).max(0.0).powi(2) * cos.max(0.0).powi(4) * distance_kernel(t),
        Scheme::Printed => (1.0 - t).max(0.0) * cos.max(0.0).sqrt(),
    }
}

/// Weight by distance alone, used if all others vanish: `1 / (t^2 + 1e-3)`.
pub fn distance_kernel(t: f64) -> f64 {
    1.0 / (t * t + KERNEL_CORE)
}

/// Scales a proxy's facing irradiance from its cache to another point: falls off as the root mean square distance of
/// the VALs. `distance2` is its square at the cache; `from_cache2` and `from_point2` [m^2] are the proxy's own squared
/// distances. A proxy that comes nearer brightens at most fourfold.
pub fn falloff(distance2: f64, from_cache2: f64, from_point2: f64) -> f64 {
    let here = ((distance2 - from_cache2).max(0.0) + from_point2).max(LEAST_DIVISOR);
    (distance2 / here).sqrt().min(4.0)
}

/// Averages the lights of a point's references, with weights that reach 0 at the farthest one: the vertex level. See
/// [`interpolate_within`].
pub fn interpolate(
    x: DVec3,
    normal: DVec3,
    mirrored_view: DVec3,
    references: &[(Cache, Gathered)],
    scheme: Scheme,
) -> Interpolated {
    let farthest = references.iter().map(|(cache, _)| cache.position.distance(x)).fold(0.0, f64::max);
    interpolate_within(x, normal, mirrored_view, references, scheme, farthest)
}

/// Averages the lights of a point's references at `x` \[m\] with unit `normal` and mirrored view direction
/// `mirrored_view` R(x), which is unused if no reference has a glossy lobe.
///
/// An unlit diffuse lobe counts with zero irradiance, but not with its position. An unlit glossy lobe is ignored; in
/// the printed scheme it counts with zero irradiance as well.
pub fn interpolate_within(
    x: DVec3,
    normal: DVec3,
    mirrored_view: DVec3,
    references: &[(Cache, Gathered)],
    scheme: Scheme,
    d_max: f64,
) -> Interpolated {
    let entries = |lobe: fn(&Gathered) -> &Lobe, cos: &dyn Fn(&Cache, &Gathered) -> f64| -> Vec<Entry> {
        let entry = |(cache, gathered): &(Cache, Gathered)| Entry {
            // If all caches lie on the point itself, all are equally near.
            t: if d_max > 0.0 { cache.position.distance(x) / d_max } else { 0.0 },
            cos: cos(cache, gathered),
            cache: *cache,
            lobe: *lobe(gathered),
        };
        references.iter().map(entry).collect()
    };
    let by_normal = |cache: &Cache, _: &Gathered| normal.dot(cache.normal);
    let by_view = |_: &Cache, gathered: &Gathered| mirrored_view.dot(gathered.mirrored_view);
    let diffuse = entries(|gathered| &gathered.diffuse, &by_normal);
    let (diffuse, glossy) = match scheme {
        Scheme::Facing => {
            let mut glossy = entries(|gathered| &gathered.glossy, &by_normal);
            glossy.retain(|entry| entry.lobe.lit);
            (average_facing(x, &diffuse), average_seen(x, mirrored_view, &glossy))
        }
        Scheme::Printed => {
            let glossy = entries(|gathered| &gathered.glossy, &by_view);
            (average_printed(x, &diffuse), average_printed(x, &glossy))
        }
    };
    // Any finite position for missing light.
    let place = |light: Option<Light>| light.unwrap_or(Light { position: x + normal, irradiance: DVec3::ZERO });
    Interpolated {
        diffuse_position: place(diffuse).position,
        diffuse_irradiance: place(diffuse).irradiance,
        has_diffuse: diffuse.is_some(),
        glossy_position: place(glossy).position,
        glossy_irradiance: place(glossy).irradiance,
        has_glossy: glossy.is_some(),
    }
}

/// Shares of the references in the diffuse lobe at `x` \[m\] with unit `normal`; they sum to 1. `d_max` \[m\] as in
/// [`interpolate_within`].
pub fn weights(x: DVec3, normal: DVec3, references: &[Cache], scheme: Scheme, d_max: f64) -> Vec<f64> {
    let t = |cache: &Cache| if d_max > 0.0 { cache.position.distance(x) / d_max } else { 0.0 };
    let all = kernels(references.iter().map(|cache| (t(cache), normal.dot(cache.normal))), scheme);
    let sum: f64 = all.iter().sum();
    all.iter().map(|weight| weight / sum).collect()
}

/// One reference as one lobe sees it.
struct Entry {
    t: f64,
    cos: f64,
    cache: Cache,
    lobe: Lobe,
}

/// One lobe's averaged light.
#[derive(Clone, Copy)]
struct Light {
    position: DVec3,
    irradiance: DVec3,
}

/// Weights of references, given by `t` and `cos` as in [`kernel`]; by distance alone if all weights vanish.
fn kernels(references: impl Iterator<Item = (f64, f64)> + Clone, scheme: Scheme) -> Vec<f64> {
    let weights: Vec<f64> = references.clone().map(|(t, cos)| kernel(scheme, t, cos)).collect();
    let none = weights.iter().all(|weight| *weight == 0.0);
    if none { references.map(|(t, _)| distance_kernel(t)).collect() } else { weights }
}

/// Every reference with its weight.
fn weighted(entries: &[Entry], scheme: Scheme) -> Vec<(&Entry, f64)> {
    entries.iter().zip(kernels(entries.iter().map(|entry| (entry.t, entry.cos)), scheme)).collect()
}

/// Diffuse lobe: averages facing irradiances, scaled to `x`; `None` if no reference is lit.
fn average_facing(x: DVec3, entries: &[Entry]) -> Option<Light> {
    let (mut total, mut total_lit, mut position, mut irradiance) = (0.0, 0.0, DVec3::ZERO, DVec3::ZERO);
    for (Entry { cache, lobe, .. }, weight) in weighted(entries, Scheme::Facing) {
        total += weight;
        if lobe.lit {
            let here = lobe.position - x;
            let there2 = lobe.position.distance_squared(cache.position);
            total_lit += weight;
            position += weight * here;
            irradiance += weight * lobe.facing_irradiance * falloff(lobe.distance2, there2, here.length_squared());
        }
    }
    (total_lit > 0.0).then(|| Light { position: x + position / total_lit, irradiance: irradiance / total })
}

/// Glossy lobe: weights positions by the response of the lobe about `mirrored_view` to each proxy, and facing
/// irradiances by its tenth power; `None` if no reference is lit.
///
/// Light outside the point's lobe says little about the light inside. Some weight must remain, however: the proxies of
/// a wide light lie where the caches' lobes look, not where the point's lobe does.
fn average_seen(x: DVec3, mirrored_view: DVec3, entries: &[Entry]) -> Option<Light> {
    let cos = |offset: DVec3| mirrored_view.dot(offset.normalize_or_zero()).max(LEAST_LOBE_COSINE);
    let (mut total, mut pulls, mut exponent) = (0.0, 0.0, 0.0);
    let (mut position, mut irradiance, mut plain) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for (Entry { cache, lobe, .. }, weight) in weighted(entries, Scheme::Facing) {
        let offset = lobe.position - x;
        let pull = weight * (cos_power(cache.exponent, cos(offset)) + LEAST_PULL);
        total += weight;
        pulls += pull;
        exponent += weight * cache.exponent;
        position += pull * offset;
        irradiance += weight * cos_power(WEIGHED_SHARE * cache.exponent, cos(offset)) * lobe.facing_irradiance;
        plain += weight * lobe.facing_irradiance;
    }
    (total > 0.0).then(|| {
        let offset = position / pulls;
        let seen = cos_power(WEIGHED_SHARE * exponent / total, cos(offset)).max(LEAST_DIVISOR);
        Light { position: x + offset, irradiance: (irradiance / seen).min(plain) / total }
    })
}

/// As printed: fluxes and positions.
fn average_printed(x: DVec3, entries: &[Entry]) -> Option<Light> {
    let (mut total, mut total_lit, mut position, mut flux) = (0.0, 0.0, DVec3::ZERO, DVec3::ZERO);
    for (Entry { cache, lobe, .. }, weight) in weighted(entries, Scheme::Printed) {
        total += weight;
        if lobe.lit {
            total_lit += weight;
            position += weight * (lobe.position - x);
            flux += weight * lobe.flux(cache);
        }
    }
    (total_lit > 0.0).then(|| {
        let offset = position / total_lit;
        // As printed: unbounded where the averaged light meets the surface; only division by zero is avoided.
        let sphere = 4.0 * PI * offset.length_squared().max(f64::MIN_POSITIVE);
        Light { position: x + offset, irradiance: flux / total / sphere }
    })
}

/// Diffuse and glossy radiance [cd/m^2] of the averaged light at `x` with the point's own normal, view and material:
/// `L_d = rho_d/pi I_d (N.w)+`, `L_g = rho_g (k+2)/(2 pi) max(0, R.w)^k I_g (N.w)+`, each `w` towards its light.
pub fn shade(
    light: &Interpolated,
    x: DVec3,
    normal: DVec3,
    mirrored_view: DVec3,
    material: &Material,
) -> (DVec3, DVec3) {
    let (mut diffuse, mut glossy) = (DVec3::ZERO, DVec3::ZERO);
    if light.has_diffuse {
        let direction = (light.diffuse_position - x).normalize_or_zero();
        diffuse = material.diffuse * DIFFUSE_LOBE * light.diffuse_irradiance * normal.dot(direction).max(0.0);
    }
    if light.has_glossy {
        let direction = (light.glossy_position - x).normalize_or_zero();
        let lobe = phong_lobe(material.exponent, mirrored_view.dot(direction));
        glossy = material.specular * lobe * light.glossy_irradiance * normal.dot(direction).max(0.0);
    }
    (diffuse, glossy)
}
