//! Light below a surface: the dipole model, what VALs inside bodies give to caches, proxy dipoles and their average. METHOD 7,
//! thesis 5.5.

use std::f64::consts::PI;

use glam::DVec3;

use crate::scene::medium::{Medium, fresnel};

/// Light that has entered a body through one texel of an RSM, or around one cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InnerVal {
    /// Where \[m\].
    pub position: DVec3,
    /// Unit normal of the surface, outwards.
    pub normal: DVec3,
    /// Area of the surface [m^2] that it enters through.
    pub area: f64,
    /// Flux below the surface \[lm\].
    pub flux: DVec3,
}

/// One source of a dipole, `z` \[m\] below or above the surface at lateral distance `r`: its share of `R_d` [1/m^2] without
/// albedo. Sources nearer to the surface than `widest` \[m\] are moved away from it and decay no faster than that, with the same
/// integral over the plane: texels do not show where mean free paths are smaller than they are.
pub fn source(r: f64, z: f64, sigma_tr: f64, widest: f64) -> f64 {
    let deep = z.max(widest);
    let decay = sigma_tr.min((sigma_tr * z).max(1.0) / deep);
    let d = r.hypot(deep);
    deep * (1.0 + decay * d) * (-decay * (d - deep) - sigma_tr * z).exp() / (4.0 * PI * d.powi(3))
}

/// `R_d` [1/m^2]: what leaves at distance `r` \[m\] of what has entered, by channel (5.83, without its first `1/sigma_t'`),
/// with sources at least `widest` \[m\] from the surface.
pub fn diffuse_reflectance(medium: &Medium, r: f64, widest: f64) -> DVec3 {
    let of = |i: usize| {
        let at = |z: f64| source(r, z, medium.sigma_tr[i], widest);
        medium.albedo[i] * (at(medium.z_r[i]) + at(medium.z_v[i]))
    };
    DVec3::new(of(0), of(1), of(2))
}

/// By how much texels of this area widen dipoles \[m\].
pub fn widest(area: f64) -> f64 {
    area.sqrt()
}

/// What all VALs inside a body give to one cache: a dipole of each channel that stands for them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProxyDipole {
    /// Irradiance from below \[lx\], (5.89).
    pub irradiance: DVec3,
    /// Mean place of the light on the surface \[m\], relative to the cache, of each channel, (5.88).
    pub place: [DVec3; 3],
    /// Its variance [m^2].
    pub variance: DVec3,
    /// By how much its texels widen it \[m\].
    pub widest: DVec3,
}

/// Sums up the VALs inside a body at a cache; `bodies` are its caches, position and area, which bound what it receives: nothing
/// sends on more than has come to it.
pub fn gather(medium: &Medium, cache: DVec3, vals: &[InnerVal], bodies: &[(DVec3, f64)]) -> ProxyDipole {
    let whole = bodies.iter().fold(DVec3::ZERO, |sum, &(position, area)| {
        sum + area * diffuse_reflectance(medium, position.distance(cache), widest(area))
    });
    let share = whole.max(DVec3::ONE).recip();
    let mut proxy = ProxyDipole::default();
    let mut second = DVec3::ZERO;
    for val in vals {
        let d = val.position - cache;
        let wide = widest(val.area);
        let given = val.flux * diffuse_reflectance(medium, d.length(), wide);
        proxy.irradiance += given;
        second += given * d.length_squared();
        proxy.widest += given * wide;
        for i in 0..3 {
            proxy.place[i] += given[i] * d;
        }
    }
    for i in 0..3 {
        let sum = proxy.irradiance[i];
        if sum > 0.0 {
            proxy.place[i] /= sum;
            proxy.widest[i] /= sum;
            proxy.variance[i] = (second[i] / sum - proxy.place[i].length_squared()).max(0.0);
        }
    }
    proxy.irradiance *= share;
    proxy
}

/// One channel of `R_d` from light that is spread by this variance [m^2] about a place `r` \[m\] away.
fn spread(medium: &Medium, channel: usize, r2: f64, variance: f64, wide: f64) -> f64 {
    // What is spread is as far away as it is in the root mean square, and as wide.
    let wide = (wide * wide + 0.5 * variance).sqrt();
    let at = |z: f64| source(r2.sqrt(), z, medium.sigma_tr[channel], wide);
    at(medium.z_r[channel]) + at(medium.z_v[channel])
}

/// Irradiance from below \[lx\] at a point, from the proxies of caches around it, with positions \[m\] and weights: (5.92), (5.93)
/// with positions averaged, and scales as the quotient of averages.
pub fn interpolate(medium: &Medium, x: DVec3, caches: &[(DVec3, f64, ProxyDipole)]) -> DVec3 {
    let mut irradiance = DVec3::ZERO;
    for i in 0..3 {
        let (mut all, mut sum, mut lit, mut place) = (0.0, 0.0, 0.0, DVec3::ZERO);
        let (mut second, mut variance, mut wide) = (0.0, 0.0, 0.0);
        for (position, weight, proxy) in caches {
            all += weight;
            sum += weight * proxy.irradiance[i];
            if proxy.irradiance[i] > 0.0 {
                let at = *position + proxy.place[i] - x;
                lit += weight;
                place += *weight * at;
                second += weight * at.length_squared();
                variance += weight * proxy.variance[i];
                wide += weight * proxy.widest[i];
            }
        }
        if lit <= 0.0 {
            continue;
        }
        let (place, wide) = (place / lit, wide / lit);
        let variance = variance / lit + (second / lit - place.length_squared()).max(0.0);
        let (mut own, mut weights) = (0.0, 0.0);
        for (_, weight, proxy) in caches.iter().filter(|(_, _, proxy)| proxy.irradiance[i] > 0.0) {
            own += weight * spread(medium, i, proxy.place[i].length_squared(), variance, wide);
            weights += weight;
        }
        let here = spread(medium, i, place.length_squared(), variance, wide);
        irradiance[i] = sum / all * (here * weights / own.max(f64::MIN_POSITIVE)).min(MOST_BRIGHTER);
    }
    irradiance
}

/// How many times brighter a point is at most than the mean of its caches: where light falls between them.
pub const MOST_BRIGHTER: f64 = 64.0;

/// Radiance [cd/m^2] that a viewer at this cosine sees of irradiance from below. What leaves in all is that irradiance; Fresnel
/// says in which direction.
pub fn leaving(medium: &Medium, cosine: f64, irradiance: DVec3) -> DVec3 {
    irradiance * ((1.0 - fresnel(cosine.max(0.0), medium.ior)) / (medium.entering * PI))
}
