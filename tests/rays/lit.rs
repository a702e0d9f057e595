//! Direct light that surfaces reflect at hits: the mean over many light samples is the sum over all lights.

use super::{Asked, NOTHING, Ray, Tracer, still};
use crate::analytic::numbers;
use crate::bodies::below;
use crate::common::frames::{SPOT, add, corner, phong};
use glam::{DAffine3, DQuat, DVec3, Vec3, dvec3, vec3};
use lightskin::frame::{AreaLight, BodyLight};
use lightskin::reference::light::{body_falloff, facing_irradiance};
use lightskin::reference::near::brdf_along;
use lightskin::reference::world::{self, Sides};
use lightskin::scene::build::{quad, sphere};
use lightskin::scene::{LightKind, Material, Scene};
use rayon::prelude::*;

/// Light samples per shader invocation, and invocations per ray. llvmpipe ends the loops of a thread after 65 535
/// iterations.
const CHANCES: u32 = 32;
const TIMES: usize = 64;

/// Adds a lamp of 0.5 m by 0.3 m to the scene. It shines down if `place` does not rotate it.
fn with_lamp(mut scene: Scene, place: DAffine3) -> Scene {
    let lamp = quad(vec3(-0.25, 0.0, -0.15), Vec3::X * 0.5, Vec3::Z * 0.3, 0.3);
    let material = Material { emissive: vec3(300.0, 200.0, 100.0), ..phong([0.0; 3], [0.0; 3], 1.0) };
    add(&mut scene, lamp, material, place);
    scene
}

/// Radiance [cd/m^2] that a surface with this BRDF reflects from the visible parts of a rectangle.
fn of_lamp(truth: &world::World<'_>, lamp: &AreaLight, at: &world::Surface, brdf: &dyn Fn(DVec3) -> DVec3) -> DVec3 {
    const SIDE: usize = 32;
    let place = |i: usize| (2.0 * i as f64 + 1.0) / SIDE as f64 - 1.0;
    let part = lamp.right.cross(lamp.up).length() * 4.0 / (SIDE * SIDE) as f64;
    let normal = at.vertex_normal;
    let mut sum = DVec3::ZERO;
    for (i, j) in (0..SIDE).flat_map(|i| (0..SIDE).map(move |j| (i, j))) {
        let point = lamp.middle + place(i) * lamp.right + place(j) * lamp.up;
        let way = point - at.position;
        let (distance, towards) = (way.length(), way.normalize());
        let factor = normal.dot(towards).max(0.0) * (-lamp.normal.dot(towards)).max(0.0) / (distance * distance);
        if factor > 0.0 && at.geometric.dot(towards) > 0.0 && !truth.blocked(at.position, point) {
            sum += brdf(towards) * (factor * part);
        }
    }
    lamp.radiance * sum
}

/// Radiance [cd/m^2] that a surface with this BRDF reflects of a small emissive body.
fn of_body(truth: &world::World<'_>, body: &BodyLight, at: &world::Surface, brdf: &dyn Fn(DVec3) -> DVec3) -> DVec3 {
    let way = body.middle - at.position;
    let (distance, towards) = (way.length(), way.normalize());
    let cosine = at.vertex_normal.dot(towards).max(0.0);
    if at.geometric.dot(towards) <= 0.0 || truth.blocked_within(at.position, towards, distance - body.clear) {
        return DVec3::ZERO;
    }
    body.intensity * (body_falloff(-towards, body.q, body.lean) * cosine / (distance * distance)) * brdf(towards)
}

/// Radiance [cd/m^2] that a surface reflects from all lights along a ray of this direction.
fn reflected(
    truth: &world::World<'_>,
    (lamps, bodies): (&[AreaLight], &[BodyLight]),
    at: &world::Surface,
    looking: DVec3,
) -> DVec3 {
    let brdf = brdf_along(at, looking);
    let mut sum = DVec3::ZERO;
    for light in &truth.scene().lights {
        let (facing, towards) = facing_irradiance(light, at.position);
        let cosine = at.vertex_normal.dot(towards).max(0.0);
        if facing == DVec3::ZERO || cosine == 0.0 || at.geometric.dot(towards) <= 0.0 {
            continue;
        }
        let blocked = match light.kind {
            LightKind::Directional => truth.blocked_within(at.position, towards, f64::INFINITY),
            _ => truth.blocked(at.position, light.position),
        };
        if !blocked {
            sum += facing * cosine * brdf(towards);
        }
    }
    sum += lamps.iter().map(|lamp| of_lamp(truth, lamp, at, &brdf)).sum::<DVec3>();
    sum + bodies.iter().map(|body| of_body(truth, body, at, &brdf)).sum::<DVec3>()
}

/// Errors of the device's mean. `bias`: relative error of the sum over all points. `mean`: relative mean error of the
/// points. `lit`: share of lit points. `off`: share of points with an error of more than 10 %.
#[derive(Clone, Copy, Debug)]
struct Result {
    bias: f64,
    mean: f64,
    lit: f64,
    off: f64,
}

fn check(scene: &Scene) -> Result {
    let tracer = Tracer::new(scene);
    let mut next = numbers(9);
    let mut rays = Vec::new();
    for _ in 0..1500 {
        let origin = dvec3(1.5 * next() - 0.6, 0.6 + next(), 1.5 * next() - 0.6) - tracer.world.origin;
        rays.push(Ray::new(origin.as_vec3(), super::direction(&mut next).as_vec3()));
    }
    let often: Vec<Ray> = rays.iter().flat_map(|ray| [*ray; TIMES]).collect();
    let found = tracer.trace(&often, Asked { chances: CHANCES, times: TIMES as u32, ..Asked::default() });
    let mean = |all: &[super::Met]| all.iter().map(|met| met.direct.as_dvec3()).sum::<DVec3>() / TIMES as f64;
    let found: Vec<(super::Met, DVec3)> = found.chunks(TIMES).map(|all| (all[0], mean(all))).collect();
    let (frozen, _) = still(scene);
    let truth = world::World::new(&frozen);
    let (lamps, middle) = ((&tracer.world.areas[..], &tracer.world.bodies[..]), tracer.world.origin);
    let one = |(ray, (met, direct)): (&Ray, &(super::Met, DVec3))| {
        let origin = middle + ray.origin.as_dvec3();
        let hit = truth.nearest(origin, ray.direction.as_dvec3(), Sides::Both)?;
        (met.triangle as usize == hit.triangle && met.triangle != NOTHING)
            .then(|| (reflected(&truth, lamps, &truth.surface(&hit), ray.direction.as_dvec3()), *direct))
    };
    let pairs: Vec<(DVec3, DVec3)> = rays.par_iter().zip(&found).filter_map(one).collect();
    let whole: DVec3 = pairs.iter().map(|pair| pair.0).sum();
    let given: DVec3 = pairs.iter().map(|pair| pair.1).sum();
    let size: f64 = pairs.iter().map(|pair| pair.0.distance(pair.1)).sum();
    let typical = whole.length() / pairs.len() as f64;
    let lit = pairs.iter().filter(|pair| pair.0 != DVec3::ZERO).count();
    let far = pairs.iter().filter(|pair| pair.0.distance(pair.1) > 0.1 * pair.0.length() + 1e-3 * typical).count();
    let count = pairs.len() as f64;
    assert!(pairs.len() > 300 && whole.length() > 0.0);
    Result {
        bias: (given - whole).length() / whole.length(),
        mean: size / whole.length(),
        lit: lit as f64 / count,
        off: far as f64 / count,
    }
}

#[test]
fn one_light_and_all_lights_together_are_their_sum() {
    let lamps: [(&str, &[LightKind], f64); 5] = [
        ("spot", &[SPOT], 1e-3),
        ("point", &[LightKind::Point], 1e-3),
        ("directional", &[LightKind::Directional], 1e-3),
        ("three", &[SPOT, LightKind::Point, LightKind::Directional], 5e-3),
        ("with a range", &[LightKind::Point], 1e-3),
    ];
    for (what, kinds, bound) in lamps {
        let mut scene = corner(kinds, 20.0);
        if what == "with a range" {
            scene.lights[0].range = Some(1.9);
        }
        let result = check(&scene);
        println!("{what}: {result:?}");
        assert!(
            result.lit > 0.1 && result.bias < bound && result.mean < 4.0 * bound && result.off < 0.01,
            "{what}: {result:?}"
        );
    }
}

#[test]
fn small_bodies_light_what_they_see() {
    // Half of an ellipsoid, so that no direction is like another.
    let place = DAffine3::from_scale_rotation_translation(
        dvec3(1.3, 1.0, 0.6),
        DQuat::from_rotation_z(-0.9),
        dvec3(0.1, 1.2, 0.1),
    );
    let mut scene = corner(&[], 20.0);
    let material = Material { emissive: vec3(3e4, 2e4, 1e4), ..phong([0.0; 3], [0.0; 3], 1.0) };
    add(&mut scene, below(sphere(0.03, 24), 0.0), material, place);
    let result = check(&scene);
    println!("{result:?}");
    assert!(result.lit > 0.1 && result.bias < 1e-3 && result.mean < 4e-3 && result.off < 0.01, "{result:?}");
}

#[test]
fn rectangles_light_what_they_see() {
    let down = DAffine3::from_translation(dvec3(0.1, 1.6, 0.1));
    // Upright next to the wall: points of the floor and of the ball see a part of the lamp.
    let upright = DAffine3::from_rotation_translation(DQuat::from_rotation_z(-1.4), dvec3(0.9, 0.35, 0.0));
    // If the rectangle is partly hidden, the estimate uses the visible share of its area instead of the visible share
    // of its light. The bounds allow for this.
    for (what, scene) in [
        ("lamp above", with_lamp(corner(&[], 20.0), down)),
        ("lamp upright", with_lamp(corner(&[], 20.0), upright)),
        ("lamp and spot", with_lamp(corner(&[SPOT, LightKind::Point], 20.0), down)),
    ] {
        let result = check(&scene);
        println!("{what}: {result:?}");
        assert!(result.lit > 0.1 && result.bias < 0.008 && result.mean < 0.012, "{what}: {result:?}");
    }
}
