//! One diffuse bounce by random sampling, without RSM, disc or proxy: the sum over VALs must converge to it. METHOD 2.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::light::{intensity, range_window, shine};
use super::rsm::{View, views};
use super::triangle::{Triangle, nearest};
use crate::scene::{Light, LightKind};

/// Samples per random sequence: the result depends on the seed, not on the number of threads.
const BLOCK: usize = 4096;

/// Irradiance \[lx\] at `point` from light reflected once, diffusely. The primary light is shadowed; as with VALs, the
/// way from the lit surface to the point is not.
///
/// Directions from the light are uniform over its cone or sphere; parallel rays are uniform over the image plane. Each
/// first hit is a diffuse emitter: `E = mean rho_d I Omega / pi * cos+_l cos+_x / d^2`. Points must keep away from lit
/// surfaces, because the `1/d^2` of near hits is unbounded.
pub fn one_bounce_irradiance(
    point: DVec3,
    normal: DVec3,
    triangles: &[Triangle],
    light: &Light,
    samples: usize,
    seed: u64,
) -> DVec3 {
    let parallel = views(triangles, light).into_iter().find(|view| view.parallel);
    let sample = |random: &mut Random| {
        let (origin, direction, measure) = primary_ray(light, parallel.as_ref(), random);
        let Some(hit) = nearest(triangles, origin, direction) else { return DVec3::ZERO };
        let window = if parallel.is_some() { 1.0 } else { range_window(hit.distance, light.range) };
        let radiosity = hit.diffuse * intensity(light, direction) * measure * window;
        let offset = hit.position - point;
        let d2 = offset.length_squared();
        let cosines = (-hit.normal.dot(offset)).max(0.0) * normal.dot(offset).max(0.0) / d2;
        radiosity / PI * cosines / d2
    };
    let block = |index: usize| {
        let mut random = Random::new(seed, index as u64);
        let count = BLOCK.min(samples - index * BLOCK);
        (0..count).map(|_| sample(&mut random)).sum::<DVec3>()
    };
    // Collected first, so that the order of the sum does not depend on thread timing.
    let sums: Vec<DVec3> = (0..samples.div_ceil(BLOCK)).into_par_iter().map(block).collect();
    sums.into_iter().sum::<DVec3>() / samples as f64
}

/// Origin, unit direction and measure of a ray: solid angle \[sr\], or area [m^2] for parallel rays.
fn primary_ray(light: &Light, parallel: Option<&View>, random: &mut Random) -> (DVec3, DVec3, f64) {
    let (u, v) = (random.uniform(), random.uniform());
    if let Some(view) = parallel {
        let (origin, direction) = view.ray(u, v, 1);
        return (origin, direction, 4.0 * view.half.x * view.half.y);
    }
    let (axis, least_cos) = match light.kind {
        LightKind::Spot { outer, .. } => (shine(light), f64::from(outer).cos()),
        _ => (DVec3::Z, -1.0),
    };
    // Spherical cap: its area is linear in the cosine.
    let cos = 1.0 - u * (1.0 - least_cos);
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let (tangent, bitangent) = axis.any_orthonormal_pair();
    let (around_sin, around_cos) = (TAU * v).sin_cos();
    let direction = cos * axis + sin * (around_cos * tangent + around_sin * bitangent);
    (light.position, direction.normalize(), TAU * (1.0 - least_cos))
}

/// PCG-XSH-RR with 64 bits of state (O'Neill 2014).
struct Random {
    state: u64,
    increment: u64,
}

impl Random {
    fn new(seed: u64, sequence: u64) -> Self {
        let mut random = Self { state: 0, increment: 2 * sequence + 1 };
        random.next();
        random.state = random.state.wrapping_add(seed);
        random.next();
        random
    }

    fn next(&mut self) -> u32 {
        let state = self.state;
        self.state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(self.increment);
        ((((state >> 18) ^ state) >> 27) as u32).rotate_right((state >> 59) as u32)
    }

    /// Uniform in [0, 1).
    fn uniform(&mut self) -> f64 {
        f64::from(self.next()) / 4_294_967_296.0
    }
}
