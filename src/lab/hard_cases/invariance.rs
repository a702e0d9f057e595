//! Scenes that must look like another one: scaled, moved or brighter. METHOD 4.

use super::oracle::{largest, layers};
use super::{Case, Outcome};
use crate::bake::CacheSet;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::lab::knobs::{Gi, Knobs};
use crate::lab::shot::{Shot, shoot, small};
use crate::lab::worlds::{SPOT, baked, corner, placed};
use crate::scene::{LightKind, Scene};
use glam::{DVec3, dvec3};

/// Reflectances are half floats; their last bit is 1e-3 of the value and may flip with f32 rounding.
const ROUNDED: f64 = 1e-3;

/// A floor, a wall and a squeezed ball under one light of each kind.
fn world() -> Scene {
    let mut scene = corner(&[SPOT, LightKind::Point, LightKind::Directional], 40.0);
    scene.lights[1].range = Some(6.0);
    scene
}

/// The scene with interpolated caches, and by brute force.
fn both(gpu: &Gpu, scene: &Scene, caches: &CacheSet) -> Result<[Shot; 2]> {
    let brute_force = Knobs { gi: Gi::BruteForce, ..small() };
    Ok([shoot(gpu, scene, Some(caches), &small())?, shoot(gpu, scene, None, &brute_force)?])
}

/// Compares both frames of a changed scene, `factor` times as bright, with those of the world.
fn same(gpu: &Gpu, change: impl Fn(&Scene) -> Scene, factor: f64, bound: f64) -> Result<Outcome> {
    let world = world();
    let caches = baked(&world, 0.5, 8)?;
    let (a, b) = (both(gpu, &world, &caches)?, both(gpu, &change(&world), &caches)?);
    let lit = a.iter().all(|s| largest(&s.direct).min(largest(&s.diffuse)).min(largest(&s.glossy)) > 0.0);
    let errors = [layers(&a[0], &b[0], factor), layers(&a[1], &b[1], factor)];
    let outcome = Outcome::all([("caches", errors[0], bound), ("brute force", errors[1], bound)]);
    Ok(outcome.of(&[&a[0], &a[1], &b[0], &b[1]]).provided(lit, "a layer is dark"))
}

pub(super) fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    let exact = 2_f64.powi(20);
    for scale in [1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6, 1.0 / exact, exact] {
        // Scaling by powers of two is exact, so that any constant with a unit shows.
        let is_exact = [exact, 1.0 / exact].contains(&scale);
        let (bound, input) = match is_exact {
            true => (1e-6, format!("scene times 2^{}, intensities times its square", scale.log2())),
            false => (ROUNDED, format!("scene times {scale:e}, intensities times its square")),
        };
        let expected = format!("the same pictures within {bound:e}");
        all.push(Case::new("scale", input, expected, move |gpu| {
            same(gpu, |scene| placed(scene, scale, DVec3::ZERO), 1.0, bound)
        }));
    }
    for metres in [1.0, 1e2, 1e4, 1e5, 1e6] {
        let input = format!("scene moved by {metres:e} m along every axis");
        let expected = format!("the same pictures within {ROUNDED:e}");
        let shift = metres * dvec3(1.0, -1.0, 1.0);
        all.push(Case::new("offset", input, expected, move |gpu| {
            same(gpu, |scene| placed(scene, 1.0, shift), 1.0, ROUNDED)
        }));
    }
    // The world's lights have 300 lx or 500 cd.
    for factor in [2e-9_f32, 2e-6, 2e-3, 2.0, 2e3, 2e6] {
        let input = format!("lights of {:e} cd and {:e} lx", 500.0 * factor, 300.0 * factor);
        let expected = format!("{factor:e} times the radiance within {ROUNDED:e}");
        all.push(Case::new("intensity", input, expected, move |gpu| {
            let brighter = |scene: &Scene| {
                let mut scene = scene.clone();
                scene.lights.iter_mut().for_each(|light| light.intensity *= factor);
                scene
            };
            same(gpu, brighter, factor.into(), ROUNDED)
        }));
    }
    all
}
