//! Lights and cameras in unusual positions.

use super::oracle::{brute_force_picture, brute_force_picture_near, cast_vals, largest, material, sums_against_twins};
use super::{Case, Outcome, oracle};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::lab::knobs::{Gi, Knobs};
use crate::lab::shot::{Shot, seen, sent_on, shoot, small, triangles};
use crate::lab::worlds::{SPOT, add, baked, camera, corner, lamp, phong};
use crate::reference::light::direct_irradiance;
use crate::reference::phong::DIFFUSE_LOBE;
use crate::reference::triangle::nearest;
use crate::scene::build::{cuboid, quad, sphere};
use crate::scene::{LightKind, Scene};
use glam::{DAffine3, DQuat, DVec3, Vec3, dvec3, vec3};

pub(super) fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    for elevation in [0.1, 1e-2, 1e-3, 1e-5] {
        let input = format!("parallel light at {elevation:e} rad over a floor");
        all.push(Case::new("grazing light", input, "VALs' flux rho E A sin within 0.5 %", move |gpu| {
            grazing(gpu, elevation)
        }));
    }
    all.push(Case::new("coplanar VALs", "a lit floor alone, tilted", "caches: exactly no indirect light", coplanar));
    let oracle = "wall dark outside, f64 brute force within 1e-3, f64 sums within 5e-5";
    all.push(Case::new("light in a wall", "point light inside a thick wall", oracle, in_wall));
    let oracle = "f64 VALs, f64 brute force within 1e-3";
    all.push(Case::new("light on a wall", "point light in the plane of the floor", oracle, on_floor));
    let dark = "exactly no direct and no indirect light inside";
    all.push(Case::new("closed box", "walls 5 cm thick, three lights outside", dark, |gpu| closed_box(gpu, 0.05)));
    let dark = "inside, direct light only within 2 shadow texels of an edge, indirect light below 1e-6 (1e-4 on GPUs) of the brightest outside";
    all.push(Case::new("closed box", "walls without thickness, three lights outside", dark, |gpu| {
        closed_box(gpu, 0.0)
    }));
    let through = "exactly no direct light, f64 brute force within 1e-3, f64 sums within 5e-5";
    all.push(Case::new("closed box", "the thick box over a lit ground", through, box_on_ground));
    all.push(Case::new(
        "no lights",
        "an emissive ball without lights",
        "exactly its radiance, no other direct light, no indirect light on the ball",
        no_lights,
    ));
    for distance in [1e2, 1e3, 1e4] {
        let input = format!("camera {distance:e} m away");
        let expected = "f64 brute force within 4 f32 roundings of the distance and 1e-3, no acne";
        all.push(Case::new("far camera", input, expected, move |gpu| far(gpu, distance)));
    }
    all
}

fn brute_force() -> Knobs {
    Knobs { gi: Gi::BruteForce, ..small() }
}

/// A floor of 2 m by 2 m.
fn floor() -> Scene {
    let mut scene = Scene { name: "floor".into(), ..Scene::default() };
    let surface = quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 0.5);
    add(&mut scene, surface, phong([0.7, 0.5, 0.3], [0.2; 3], 20.0), DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(1.0, 2.0, 2.0), DVec3::ZERO, 0.9));
    scene
}

fn grazing(gpu: &Gpu, elevation: f64) -> Result<Outcome> {
    let mut scene = floor();
    let mut light = lamp(LightKind::Directional);
    light.direction = dvec3(elevation.cos() * 0.8, -elevation.sin(), elevation.cos() * 0.6).as_vec3();
    let direction = light.direction.as_dvec3().normalize();
    scene.lights.push(light);
    let shot = shoot(gpu, &scene, Some(&baked(&scene, 0.5, 8)?), &small())?;
    let light = &scene.lights[0];
    let entering = light.color.as_dvec3() * f64::from(light.intensity) * 4.0 * -direction.y;
    let expected = sent_on(&scene, 0) * entering;
    let flux: DVec3 = shot.vals.iter().map(|v| v.flux).sum();
    Ok(Outcome::bounded(flux.distance(expected) / expected.length(), 5e-3).of(&[&shot]))
}

fn coplanar(gpu: &Gpu) -> Result<Outcome> {
    let mut scene = floor();
    scene.instances[0].world_from_model = DAffine3::from_axis_angle(dvec3(0.3, 0.2, 1.0).normalize(), 0.4);
    scene.lights.push(lamp(LightKind::Point));
    let caches = shoot(gpu, &scene, Some(&baked(&scene, 0.5, 8)?), &small())?;
    let truth = shoot(gpu, &scene, None, &brute_force())?;
    let light = |shot: &Shot| largest(&shot.diffuse).max(largest(&shot.glossy)) / largest(&shot.direct);
    // In brute force rounding puts some VALs above a pixel's plane by 1e-7.
    Ok(Outcome::all([("caches", light(&caches), 0.0), ("brute force", light(&truth), 1e-6)]).of(&[&caches, &truth]))
}

fn in_wall(gpu: &Gpu) -> Result<Outcome> {
    let mut scene = floor();
    let wall = cuboid(vec3(-0.1, 0.05, -0.8), vec3(0.1, 1.0, 0.8), 0.3, |_| true);
    let turn = DQuat::from_rotation_y(0.3);
    add(&mut scene, wall, phong([0.6, 0.7, 0.5], [0.2; 3], 10.0), DAffine3::from_quat(turn));
    scene.lights.push(lamp(LightKind::Point));
    scene.lights[0].position = turn * dvec3(0.02, 0.5, 0.1);
    let truth = shoot(gpu, &scene, None, &brute_force())?;
    let [diffuse, glossy] = brute_force_picture(&scene, &truth);
    let caches = shoot(gpu, &scene, Some(&baked(&scene, 0.4, 8)?), &small())?;
    let [all, lobe] = sums_against_twins(&scene, &caches);
    let errors = [
        ("direct", largest(&truth.direct), 0.0),
        ("diffuse", diffuse, 1e-3),
        ("glossy", glossy, 1e-3),
        ("diffuse sums", all, 5e-5),
        ("glossy sums", lobe, 5e-5),
    ];
    Ok(Outcome::all(errors).of(&[&truth, &caches]).provided(largest(&truth.diffuse) > 0.0, "nothing is lit"))
}

fn on_floor(gpu: &Gpu) -> Result<Outcome> {
    let mut scene = corner(&[LightKind::Point], 10.0);
    scene.lights[0].position = dvec3(0.625, 0.0, 0.375);
    let truth = shoot(gpu, &scene, None, &brute_force())?;
    let [elsewhere, turned, brighter] = cast_vals(&scene, &truth);
    let [diffuse, glossy] = brute_force_picture(&scene, &truth);
    let caches = shoot(gpu, &scene, Some(&baked(&scene, 0.4, 8)?), &small())?;
    let errors = [
        ("VALs elsewhere", elsewhere, 2e-2),
        ("normals", turned, 1e-5),
        ("flux", brighter, 1e-4),
        ("diffuse", diffuse, 1e-3),
        ("glossy", glossy, 1e-3),
    ];
    Ok(Outcome::all(errors).of(&[&truth, &caches]))
}

/// A box of 2 m with a ball inside, seen from inside; all lights are outside.
fn box_scene(thickness: f32) -> Scene {
    let turn = DAffine3::from_axis_angle(dvec3(0.3, 1.0, 0.2).normalize(), 0.6);
    let mut scene = Scene { name: "box".into(), ..Scene::default() };
    let (outer, inner) = (Vec3::ONE, Vec3::splat(1.0 - thickness));
    let material = phong([0.7, 0.6, 0.5], [0.2; 3], 10.0);
    add(&mut scene, cuboid(-outer, outer, 0.3, |_| true), material.clone(), turn);
    add(&mut scene, cuboid(-inner, inner, 0.3, |_| true).reversed(), material.clone(), turn);
    add(&mut scene, sphere(0.3, 8), material, turn);
    let wide = LightKind::Spot { inner: 0.6, outer: 0.8 };
    scene.lights = [wide, LightKind::Point, LightKind::Directional].map(lamp).to_vec();
    for (light, place) in scene.lights.iter_mut().zip([dvec3(2.0, 3.0, 1.0), dvec3(-2.5, 1.0, 0.5), DVec3::ZERO]) {
        light.position = place;
        light.direction = (-place).normalize_or(dvec3(0.2, -1.0, 0.3)).as_vec3().normalize();
    }
    scene.cameras.push(camera(dvec3(0.7, 0.6, 0.7), dvec3(-0.5, -0.4, -0.6), 1.6));
    scene
}

fn indirect(shot: &Shot) -> f64 {
    largest(&shot.diffuse).max(largest(&shot.glossy))
}

/// The walls are convex: lit outer faces face away from everything inside.
fn closed_box(gpu: &Gpu, thickness: f32) -> Result<Outcome> {
    let mut scene = box_scene(thickness);
    let truth = shoot(gpu, &scene, None, &brute_force())?;
    let caches = shoot(gpu, &scene, Some(&baked(&scene, 0.4, 8)?), &small())?;
    let leaks = leaks(&scene, &truth, thickness);
    scene.cameras = vec![camera(dvec3(4.0, 3.0, 5.0), DVec3::ZERO, 0.8)];
    let outside = shoot(gpu, &scene, None, &brute_force())?;
    let bright = largest(&outside.direct);
    let outcome = Outcome::all([
        // A wall without thickness coincides with its lit side: a shadow map separates them except at edges.
        ("direct: texels from an edge", leaks, if thickness > 0.0 { 0.0 } else { 2.0 }),
        ("indirect by caches", indirect(&caches) / bright, 0.0),
        // Cosines of VALs in the wall's own plane round around 0 as well. A rasteriser's grid moves pixels off the plane.
        (
            "brute force",
            indirect(&truth) / bright,
            match truth.subpixels {
                _ if thickness > 0.0 => 0.0,
                Some(_) => 1e-4,
                None => 1e-6,
            },
        ),
    ]);
    Ok(outcome.of(&[&truth, &caches, &outside]).provided(bright > 0.0, "nothing is lit outside"))
}

/// Largest distance from the box's edges at which direct light appears inside, in texels of the coarsest shadow map.
fn leaks(scene: &Scene, shot: &Shot, thickness: f32) -> f64 {
    // The point light's faces have a third of the texels per side; the box is up to 4 m away.
    let texel = 2.0 * 4.0 / f64::from(small().light_shadows.map() / 3);
    let model_from_world = scene.instances[1].world_from_model.inverse();
    let from_edge = |position: DVec3| {
        let mut near = (1.0 - f64::from(thickness) - model_from_world.transform_point3(position).abs()).to_array();
        near.sort_by(f64::total_cmp);
        near[1]
    };
    let reached = seen(scene, small().size).into_iter().filter(|s| shot.direct[s.pixel] != DVec3::ZERO);
    reached.map(|s| if s.instance == 1 { from_edge(s.position) / texel } else { f64::INFINITY }).fold(0.0, f64::max)
}

/// The lit ground below shines through the box's floor because indirect light is unshadowed: exactly as much as in the
/// references.
fn box_on_ground(gpu: &Gpu) -> Result<Outcome> {
    let mut scene = box_scene(0.05);
    let ground = quad(vec3(-4.0, -2.0, -4.0), Vec3::Z * 8.0, Vec3::X * 8.0, 1.0);
    add(&mut scene, ground, phong([0.7, 0.6, 0.5], [0.2; 3], 10.0), DAffine3::IDENTITY);
    let truth = shoot(gpu, &scene, None, &brute_force())?;
    let [diffuse, glossy] = brute_force_picture(&scene, &truth);
    let caches = shoot(gpu, &scene, Some(&baked(&scene, 0.4, 8)?), &small())?;
    let [all, lobe] = sums_against_twins(&scene, &caches);
    let errors = [
        ("direct", largest(&truth.direct), 0.0),
        ("diffuse", diffuse, 1e-3),
        ("glossy", glossy, 1e-3),
        ("diffuse sums", all, 5e-5),
        ("glossy sums", lobe, 5e-5),
    ];
    Ok(Outcome::all(errors).of(&[&truth, &caches]).provided(indirect(&truth) > 0.0, "nothing shines through"))
}

fn no_lights(gpu: &Gpu) -> Result<Outcome> {
    let mut scene = corner(&[], 10.0);
    let radiance = vec3(2.0, 3.0, 4.0);
    scene.materials[2].emissive = radiance;
    let (mut wrong, mut own) = (0, 0.0_f64);
    let mut shots = Vec::new();
    for gi in [Gi::LightSkin, Gi::BruteForce] {
        let bounces = u32::from(gi == Gi::BruteForce);
        let shot = shoot(gpu, &scene, Some(&baked(&scene, 0.5, 8)?), &Knobs { gi, bounces, ..small() })?;
        let shines: Vec<usize> =
            seen(&scene, small().size).iter().filter(|s| s.instance == 2).map(|s| s.pixel).collect();
        for (pixel, found) in shot.direct.iter().enumerate() {
            let expected = if shines.contains(&pixel) { radiance.as_dvec3() } else { DVec3::ZERO };
            wrong += u32::from(*found != expected);
        }
        // A ball does not see itself, except for rounding between patches that share an edge.
        own = shines.iter().map(|pixel| shot.diffuse[*pixel].max_element()).fold(own, f64::max);
        shots.push(shot);
    }
    let is_lit = shots.iter().all(|shot| indirect(shot) > 0.0);
    // Two pictures, each with its rim pixels.
    let wrong = ("wrong pixels", f64::from(wrong), 2.0 * oracle::RIMS as f64);
    let most = if shots[0].subpixels.is_some() { 5e-3 } else { 2e-5 };
    let outcome = Outcome::all([wrong, ("light on the ball", own, most)]);
    Ok(outcome.of(&shots.iter().collect::<Vec<_>>()).provided(is_lit, "the ball lights nothing"))
}

/// The corner through a telescope. A pixel's position comes from its depth, which f32 rounds relative to the distance.
fn far(gpu: &Gpu, distance: f64) -> Result<Outcome> {
    let mut scene = corner(&[SPOT], 10.0);
    let target = dvec3(-0.3, 0.6, -0.1);
    let eye = target + distance * dvec3(1.4, 1.1, 2.0).normalize();
    scene.cameras = vec![camera(eye, target, (2.4 / distance) as f32)];
    let truth = shoot(gpu, &scene, None, &brute_force())?;
    let [diffuse, glossy] = brute_force_picture_near(&scene, &truth, distance * 4.0 * f64::from(f32::EPSILON) / 2.0);
    let triangles: Vec<_> = triangles(&scene).into_iter().map(|(triangle, _)| triangle).collect();
    let light = &scene.lights[0];
    let (mut lit, mut acne) = (0, 0);
    for s in seen(&scene, small().size) {
        let offset = s.position - light.position;
        let hit = nearest(&triangles, light.position, offset.normalize());
        let free = hit.is_some_and(|h| h.distance > 0.99 * offset.length());
        let twin = material(&s, &scene, &truth).diffuse * DIFFUSE_LOBE * direct_irradiance(light, s.position, s.normal);
        if free && twin.length() > 1.0 {
            lit += 1;
            acne += usize::from(truth.direct[s.pixel].length() < 0.5 * twin.length());
        }
    }
    let caches = shoot(gpu, &scene, Some(&baked(&scene, 0.5, 8)?), &small())?;
    let share = acne as f64 / f64::from(lit.max(1));
    // Shadow rims are up to a hundredth of the lit pixels.
    let errors = [("diffuse", diffuse, 1e-3), ("glossy", glossy, 1e-3), ("acne", share, 0.01)];
    Ok(Outcome::all(errors).of(&[&truth, &caches]).provided(lit > 200, "little is lit"))
}
