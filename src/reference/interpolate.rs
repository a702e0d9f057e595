//! Stage 8, interpolate: proxies of a point's references -> its indirect radiance. METHOD 5, thesis 5.3.5.

use std::f64::consts::PI;

use glam::DVec3;

use super::gather::{Cache, Gathered, Lobe};
use super::phong::{DIFFUSE_LOBE, Material, phong_lobe};

/// What is averaged, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Facing irradiances and positions with a kernel that decays fast; the position gives the direction alone.
    #[default]
    Facing,
    /// Fluxes and positions with the printed weights 5.50 and 5.51; the light falls off from its averaged position.
    Printed,
}

/// A point's averaged light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interpolated {
    /// Where the diffuse light stands [m].
    pub diffuse_position: DVec3,
    /// Irradiance [lx] at the point on a plane that faces the diffuse light.
    pub diffuse_irradiance: DVec3,
    /// Whether any diffuse light takes part; without, the position has no meaning.
    pub has_diffuse: bool,
    /// Where the glossy light stands [m].
    pub glossy_position: DVec3,
    /// Irradiance [lx] at the point on a plane that faces the glossy light.
    pub glossy_irradiance: DVec3,
    /// Whether any glossy light takes part; without, the position has no meaning.
    pub has_glossy: bool,
}

/// Share of the squared farthest distance that is added to the kernel's: keeps it finite at a cache, without a unit.
pub const KERNEL_CORE: f64 = 1e-3;

/// Weight of a reference whose distance is the share `t` of the farthest one's and whose direction (normal, or mirrored
/// view for the glossy lobe) makes the cosine `cos` with the point's.
///
/// `Facing`: `(1-t)^2 (cos+)^4 / (t^2 + 1e-3)`; `Printed`, eq. 5.50 and 5.51: `(1-t) sqrt(cos+)`.
pub fn kernel(scheme: Scheme, t: f64, cos: f64) -> f64 {
    match scheme {
        Scheme::Facing => (1.0 - t).powi(2) * cos.max(0.0).powi(4) * distance_kernel(t),
        Scheme::Printed => (1.0 - t) * cos.max(0.0).sqrt(),
    }
}

/// Weight by distance alone, for when all others vanish: `1 / (t^2 + 1e-3)`.
pub fn distance_kernel(t: f64) -> f64 {
    1.0 / (t * t + KERNEL_CORE)
}

/// Averages the lights of a point's references at `x` [m] with unit `normal` and `mirrored_view` R(x), which is not
/// used where no reference has a glossy lobe.
///
/// An unlit diffuse lobe counts with its darkness but not with its position. An unlit glossy lobe takes no part at all,
/// but in the printed scheme it counts with its darkness as well.
pub fn interpolate(
    x: DVec3,
    normal: DVec3,
    mirrored_view: DVec3,
    references: &[(Cache, Gathered)],
    scheme: Scheme,
) -> Interpolated {
    let farthest = references.iter().map(|(cache, _)| cache.position.distance(x)).fold(0.0, f64::max);
    let entries = |lobe: fn(&Gathered) -> &Lobe, cos: &dyn Fn(&Cache, &Gathered) -> f64| -> Vec<Entry> {
        let entry = |(cache, gathered): &(Cache, Gathered)| Entry {
            // All caches on the point itself: all equally near.
            t: if farthest > 0.0 { cache.position.distance(x) / farthest } else { 0.0 },
            cos: cos(cache, gathered),
            cache: *cache,
            lobe: *lobe(gathered),
        };
        references.iter().map(entry).collect()
    };
    let diffuse = entries(|gathered| &gathered.diffuse, &|cache, _| normal.dot(cache.normal));
    let mut glossy = entries(|gathered| &gathered.glossy, &|_, gathered| mirrored_view.dot(gathered.mirrored_view));
    if scheme == Scheme::Facing {
        glossy.retain(|entry| entry.lobe.lit);
    }
    let (diffuse_position, diffuse_irradiance, has_diffuse) = average(x, normal, &diffuse, scheme);
    let (glossy_position, glossy_irradiance, has_glossy) = average(x, normal, &glossy, scheme);
    Interpolated { diffuse_position, diffuse_irradiance, has_diffuse, glossy_position, glossy_irradiance, has_glossy }
}

/// One reference as one lobe sees it.
struct Entry {
    t: f64,
    cos: f64,
    cache: Cache,
    lobe: Lobe,
}

/// Position [m], facing irradiance [lx] and whether there is light at all.
fn average(x: DVec3, normal: DVec3, entries: &[Entry], scheme: Scheme) -> (DVec3, DVec3, bool) {
    let mut weights: Vec<f64> = entries.iter().map(|entry| kernel(scheme, entry.t, entry.cos)).collect();
    if weights.iter().all(|&weight| weight == 0.0) {
        weights = entries.iter().map(|entry| distance_kernel(entry.t)).collect();
    }
    let (mut total, mut total_lit) = (0.0, 0.0);
    let (mut position, mut light) = (DVec3::ZERO, DVec3::ZERO);
    for (entry, weight) in entries.iter().zip(weights) {
        total += weight;
        if entry.lobe.lit {
            total_lit += weight;
            position += weight * (entry.lobe.position - x);
            light += weight
                * match scheme {
                    Scheme::Facing => entry.lobe.facing_irradiance,
                    Scheme::Printed => entry.lobe.flux(&entry.cache),
                };
        }
    }
    if total_lit == 0.0 {
        return (x + normal, DVec3::ZERO, false);
    }
    let offset = position / total_lit;
    let irradiance = match scheme {
        Scheme::Facing => light / total,
        // As printed: without bound where the averaged light meets the surface, short of dividing by zero.
        Scheme::Printed => light / total / (4.0 * PI * offset.length_squared().max(f64::MIN_POSITIVE)),
    };
    (x + offset, irradiance, true)
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
