//! Random walks of light through a medium with a smooth boundary: the ground truth of dipoles. METHOD 7; Henyey and
//! Greenstein 1941.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::scene::medium::{Subsurface, fresnel};

/// Steps after which a walk counts as absorbed.
const MOST_STEPS: usize = 1 << 20;

/// Steps in a row without any surface ahead after which a walk counts as lost.
const MOST_MISSED: usize = 64;

/// A medium at one wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// Extinction [1/m].
    pub sigma_t: f64,
    /// Single-scattering albedo: share of interactions that scatter.
    pub albedo: f64,
    /// Mean cosine of scattering.
    pub g: f64,
    /// Index of refraction.
    pub ior: f64,
}

impl Volume {
    /// One channel of a medium.
    pub fn of(inside: &Subsurface, channel: usize) -> Self {
        let scattered = f64::from(inside.sigma_s[channel] / inside.scale);
        let sigma_t = scattered + f64::from(inside.sigma_a[channel] / inside.scale);
        Self { sigma_t, albedo: scattered / sigma_t, g: inside.g.into(), ior: inside.ior.into() }
    }
}

/// Point where a walk leaves the medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exit<S> {
    /// The surface there.
    pub surface: S,
    /// Unit direction inside, towards the surface.
    pub direction: DVec3,
}

/// Walks from a point inside until the walk leaves or is absorbed (`None`). `boundary` returns the distance \[m\] to
/// the surface in a direction, its unit outward normal and the surface itself; `None` where nothing is ahead, as in a hole of
/// a mesh. A walk with nothing ahead for many steps is lost.
pub fn walk<S>(
    volume: &Volume,
    mut position: DVec3,
    mut direction: DVec3,
    random: &mut impl FnMut() -> f64,
    mut boundary: impl FnMut(DVec3, DVec3) -> Option<(f64, DVec3, S)>,
) -> Option<Exit<S>> {
    let mut missed = 0;
    for _ in 0..MOST_STEPS {
        let path = -(1.0 - random()).ln() / volume.sigma_t;
        let met = boundary(position, direction);
        missed = if met.is_none() { missed + 1 } else { 0 };
        match met {
            Some((distance, normal, surface)) if distance <= path => {
                let cosine = normal.dot(direction);
                if random() >= fresnel(cosine, 1.0 / volume.ior) {
                    return Some(Exit { surface, direction });
                }
                position += distance * direction;
                direction -= 2.0 * cosine * normal;
            }
            _ => {
                position += path * direction;
                if missed > MOST_MISSED || random() >= volume.albedo {
                    return None;
                }
                direction = scattered(direction, volume.g, random(), random());
            }
        }
    }
    None
}

/// Samples a unit direction after scattering; `u` and `v` are uniform in the unit square.
fn scattered(direction: DVec3, g: f64, u: f64, v: f64) -> DVec3 {
    let cosine = if g.abs() < 1e-3 {
        1.0 - 2.0 * u
    } else {
        let part = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
        ((1.0 + g * g - part * part) / (2.0 * g)).clamp(-1.0, 1.0)
    };
    let (across, along) = direction.any_orthonormal_pair();
    let sine = (1.0 - cosine * cosine).sqrt();
    let (s, c) = (TAU * v).sin_cos();
    (sine * (c * across + s * along) + cosine * direction).normalize()
}

/// Unit direction inside of light that arrives in the unit `direction` at a surface with this outward normal.
pub fn refracted(direction: DVec3, normal: DVec3, ior: f64) -> DVec3 {
    let cosine = -normal.dot(direction);
    let below = (1.0 - (1.0 - cosine * cosine) / (ior * ior)).max(0.0).sqrt();
    ((direction + cosine * normal) / ior - below * normal).normalize()
}
