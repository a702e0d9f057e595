//! Subsurface scattering: the dipole model, light of inner VALs at caches, proxy dipoles and their average. METHOD 7,
//! thesis 5.5.

use std::f64::consts::PI;

use glam::DVec3;

use crate::scene::medium::{Medium, SOURCES, fresnel};
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
    /// Share of the light that entered on the cache's side of the body.
    pub facing: DVec3,
}

/// Sums the part of a body's inner VALs that a cache with this position and normal brings. `bodies` are the position and
/// area of all caches of the body; they limit the sum, because no part may send on more light than arrives.
pub fn gather(medium: &Medium, [cache, normal]: [DVec3; 2], vals: &[InnerVal], bodies: &[(DVec3, f64)]) -> ProxyDipole {
    let whole = bodies.iter().fold(DVec3::ZERO, |sum, &(position, area)| {
        sum + area * diffuse_reflectance(medium, position.distance(cache), widest(area))
    });
    let mut proxy = ProxyDipole::default();
    let mut second = DVec3::ZERO;
    for val in vals {
        let d = val.position - cache;
        let wide = widest(val.area);
        let facing = on_same_side(normal, val.normal);
        let r_d = diffuse_reflectance(medium, d.length(), wide);
        let given = val.flux * r_d * brought(medium, d.length_squared(), wide, facing);
        proxy.irradiance += given;
        second += given * d.length_squared();
        proxy.widest += given * wide;
        proxy.facing += given * facing;
        for i in 0..3 {
            proxy.place[i] += given[i] * d;
        }
    }
    for i in 0..3 {
        let sum = proxy.irradiance[i];
        if sum > 0.0 {
            proxy.place[i] /= sum;
            proxy.widest[i] /= sum;
            proxy.facing[i] /= sum;
            proxy.variance[i] = (second[i] / sum - proxy.place[i].length_squared()).max(0.0);
        }
    }
    proxy.irradiance /= whole.max(DVec3::ONE);
    proxy
}

/// 1 where light enters on the side of the body that a cache is on, by both unit normals. A hidden cache has the normal 0,
/// and is on both sides.
pub fn on_same_side(of_cache: DVec3, of_light: DVec3) -> f64 {
    if of_cache == DVec3::ZERO { 1.0 } else { (2.0 * of_cache.dot(of_light)).clamp(0.0, 1.0) }
}

/// Share of `R_d` that caches bring at the squared distance `r2` [m^2]; pixels reflect what enters around them on their
/// own side. `facing`: part of the light that entered on this side.
pub fn brought(medium: &Medium, r2: f64, wide: f64, facing: f64) -> DVec3 {
    let of = |channel: usize| brought_of(medium, channel, r2, wide, facing);
    DVec3::new(of(0), of(1), of(2))
}

/// One channel of `brought`.
fn brought_of(medium: &Medium, channel: usize, r2: f64, wide: f64, facing: f64) -> f64 {
    let integral = |radius: f64| -> f64 {
        let of = |source: usize| {
            let (z, sigma_tr) = (medium.depths[source][channel], medium.sigma_tr[channel]);
            let z_wide = z.max(wide);
            let decay = sigma_tr.min((sigma_tr * z).max(1.0) / z_wide);
            let d = radius.hypot(z_wide);
            SOURCES[source] * (-sigma_tr * z).exp() * z_wide / d * (decay * (z_wide - d)).exp()
        };
        medium.strength[channel] * (of(0) + of(1))
    };
    let (all, beyond) = (integral(0.0), integral(medium.around.sqrt()));
    let share = medium.close_by[channel];
    let left_out = (share * medium.returned[channel] / (all - beyond).max(1e-30)).min(1.0);
    let near = (1.5 - r2 / medium.around).clamp(0.0, 1.0);
    (1.0 - left_out * facing * near) * ((1.0 - share) * all / beyond.max(1e-30)).min(1.0)
}

/// One channel of `R_d`, as far as caches bring it, for light with this variance [m^2] about a position.
fn spread(medium: &Medium, channel: usize, r2: f64, variance: f64, wide: f64, facing: f64) -> f64 {
    // Spread light acts at its root mean square distance and is as wide.
    let r_d = diffuse_reflectance(medium, r2.sqrt(), (wide * wide + 0.5 * variance).sqrt());
    r_d[channel] * brought_of(medium, channel, r2 + variance, wide, facing)
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
        let (mut roots, mut lit, mut place) = (0.0, 0.0, DVec3::ZERO);
        let (mut second, mut variance, mut wide, mut facing) = (0.0, 0.0, 0.0, 0.0);
        for (position, weight, proxy) in caches {
            roots += weight * proxy.irradiance[i].powf(0.25);
            if proxy.irradiance[i] > 0.0 {
                let at = *position + proxy.place[i] - x;
                lit += weight;
                place += *weight * at;
                second += weight * at.length_squared();
                variance += weight * proxy.variance[i];
                wide += weight * proxy.widest[i];
                facing += weight * proxy.facing[i];
            }
        }
        if lit <= 0.0 {
            continue;
        }
        let (place, wide, facing) = (place / lit, wide / lit, facing / lit);
        let between = (second / lit - place.length_squared()).max(0.0);
        // If positions move with the caches or light is wide, it comes from all around: average irradiance itself.
        let follows = (between / apart.max(1e-30) + variance / lit / medium.around).clamp(0.0, 1.0);
        let variance = variance / lit + between;
        let mean = (roots / all).powi(4);
        let mut scale = 0.0;
        for (_, weight, proxy) in caches.iter().filter(|(_, _, proxy)| proxy.irradiance[i] > 0.0) {
            let own = spread(medium, i, proxy.place[i].length_squared(), variance, wide, proxy.facing[i]);
            scale += weight / lit * (proxy.irradiance[i].max(LEAST) / own.max(LEAST)).ln();
        }
        let here = spread(medium, i, place.length_squared(), variance, wide, facing);
        let brighter = (here.max(LEAST) * scale.exp() * lit / (mean * all)).min(MOST_BRIGHTER);
        irradiance[i] = mean * brighter.powf(1.0 - follows);
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
