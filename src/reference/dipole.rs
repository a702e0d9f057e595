//! Subsurface scattering: the dipole model, light of inner VALs at caches, proxy dipoles and their average. METHOD 7,
//! thesis 5.5.

use std::f64::consts::PI;

use glam::DVec3;

use crate::scene::medium::{Medium, fresnel};
pub use crate::scene::medium::{diffuse_reflectance, widest};

/// Light that entered a body through one texel of an RSM or around one cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InnerVal {
    /// Position \[m\].
    pub position: DVec3,
    /// Unit normal of the surface, outwards.
    pub normal: DVec3,
    /// Area of the surface [m^2] through which it entered.
    pub area: f64,
    /// Flux below the surface \[lm\].
    pub flux: DVec3,
}

/// The light of all inner VALs of a body at one cache, condensed into one dipole per channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProxyDipole {
    /// Irradiance from below \[lx\], (5.89).
    pub irradiance: DVec3,
    /// Mean position of the light on the surface \[m\] relative to the cache, by channel, (5.88).
    pub place: [DVec3; 3],
    /// Variance of the position [m^2].
    pub variance: DVec3,
    /// Widening of the dipole by the size of texels \[m\].
    pub widest: DVec3,
}

/// Sums a body's inner VALs at a cache. `bodies` are the position and area of all caches of the body; they limit the
/// sum, because no part may send on more light than arrives.
pub fn gather(medium: &Medium, cache: DVec3, vals: &[InnerVal], bodies: &[(DVec3, f64)]) -> ProxyDipole {
    let whole = bodies.iter().fold(DVec3::ZERO, |sum, &(position, area)| {
        sum + area * diffuse_reflectance(medium, position.distance(cache), widest(area))
    });
    let share = (1.0 - medium.close_by) / whole.max(DVec3::ONE);
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

/// One channel of `R_d` for light with this variance [m^2] about a position `r` \[m\] away.
fn spread(medium: &Medium, channel: usize, r2: f64, variance: f64, wide: f64) -> f64 {
    // Spread light acts at its root mean square distance and is as wide.
    let wide = (wide * wide + 0.5 * variance).sqrt();
    diffuse_reflectance(medium, r2.sqrt(), wide)[channel]
}

/// Irradiance from below \[lx\] at a point from the proxies of the caches around it, with positions \[m\] and weights:
/// (5.92), (5.93) with averaged positions and the geometric mean of the scales (5.90).
pub fn interpolate(medium: &Medium, x: DVec3, caches: &[(DVec3, f64, ProxyDipole)]) -> DVec3 {
    let all: f64 = caches.iter().map(|(_, weight, _)| weight).sum();
    let middle = caches.iter().map(|(position, weight, _)| *weight * (*position - x)).sum::<DVec3>() / all;
    let apart = caches.iter().map(|(position, weight, _)| weight * (*position - x).length_squared()).sum::<f64>() / all
        - middle.length_squared();
    let mut irradiance = DVec3::ZERO;
    for i in 0..3 {
        let (mut sum, mut lit, mut place) = (0.0, 0.0, DVec3::ZERO);
        let (mut second, mut variance, mut wide) = (0.0, 0.0, 0.0);
        for (position, weight, proxy) in caches {
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
        let between = (second / lit - place.length_squared()).max(0.0);
        let variance = variance / lit + between;
        // If positions move with the caches, light comes from all around: average irradiance itself.
        let follows = (between / apart.max(1e-30)).clamp(0.0, 1.0);
        let mut scale = 0.0;
        for (_, weight, proxy) in caches.iter().filter(|(_, _, proxy)| proxy.irradiance[i] > 0.0) {
            let own = spread(medium, i, proxy.place[i].length_squared(), variance, wide);
            scale += weight / lit * (proxy.irradiance[i].max(LEAST) / own.max(LEAST)).ln();
        }
        let here = spread(medium, i, place.length_squared(), variance, wide);
        let brighter = (here.max(LEAST) * scale.exp() * lit / sum).min(MOST_BRIGHTER);
        irradiance[i] = sum / all * brighter.powf(1.0 - follows);
    }
    irradiance
}

/// Least irradiance \[lx\] or reflectance [1/m^2] that counts.
const LEAST: f64 = 1e-37;

/// Upper bound of a point's brightness relative to the mean of its caches, for light that falls between caches.
pub const MOST_BRIGHTER: f64 = 64.0;

/// Lower bound of the cosine with the viewer.
const LEAST_EXIT: f64 = 0.1;

/// Radiance [cd/m^2] towards a viewer at this cosine, from the irradiance from below. The total leaving flux equals
/// that irradiance; Fresnel sets its distribution over directions.
pub fn leaving(medium: &Medium, cosine: f64, irradiance: DVec3) -> DVec3 {
    irradiance * ((1.0 - fresnel(cosine.max(LEAST_EXIT), medium.ior)) / (medium.entering * PI))
}
