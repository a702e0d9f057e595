//! The path tracer under a sky: against furnaces, the sky's own sum and numerical integration, and by parts of its
//! light.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec2, DVec3, Vec3, dvec3, vec3};
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings, Sources, camera_ray};
use lightskin::reference::phong::{phong_lobe, reflect};
use lightskin::scene::build::{cuboid, quad, sphere};
use lightskin::scene::sky::Sky;
use lightskin::scene::{Material, Scene};

use crate::common::frames::{SPOT, add, camera, corner, phong};

fn traced(scene: &Scene, settings: &PathTraceSettings, samples: u32) -> Vec<DVec3> {
    let mut trace = PathTrace::new(scene, &scene.cameras[0], settings);
    while trace.samples() < samples {
        trace.pass();
    }
    let layers = [trace.direct(), trace.diffuse(), trace.glossy()];
    let covered = trace.covered();
    let sum = |pixel: usize| layers.iter().map(|layer| DVec3::from(layer[pixel].map(f64::from))).sum();
    (0..covered.len()).map(|pixel| if covered[pixel] { sum(pixel) } else { DVec3::NAN }).collect()
}

fn settings(size: u32, bounces: u32) -> PathTraceSettings {
    PathTraceSettings { bounces: Some(bounces), ..PathTraceSettings::of([size; 2]) }
}

/// A sky whose radiance is a function of the direction.
fn sky(width: u32, height: u32, turn: f64, radiance: impl Fn(DVec3) -> DVec3) -> Sky {
    let empty = Sky::new(width, height, (0..width * height).map(|_| Vec3::ZERO), turn);
    let middle = |i: u32| DVec2::new(f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
    Sky::new(width, height, (0..width * height).map(|i| radiance(empty.direction_at(middle(i))).as_vec3()), turn)
}

/// Brighter on one side, with a bright spot of about 20 degrees, and some light from below.
fn uneven(direction: DVec3) -> DVec3 {
    let spot = 5000.0 * (-30.0 * (1.0 - direction.dot(dvec3(0.6, 0.64, -0.48)))).exp();
    let blue = if direction.y > 0.0 { dvec3(100.0, 200.0, 400.0) * (1.2 + direction.x) } else { DVec3::splat(30.0) };
    blue + spot
}

/// A floor of 2 m, seen from above. The picture shows a single point in its centre.
fn floor(material: Material) -> Scene {
    let mut scene = Scene::default();
    add(&mut scene, quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 2.0), material, DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.4, 1.5, 0.3), DVec3::ZERO, 0.01));
    scene
}

/// Integral over the sphere of radiance times `of`, with 4 x 4 directions for each texel.
fn integral(sky: &Sky, of: impl Fn(DVec3) -> f64) -> DVec3 {
    let (width, height, fine) = (sky.width, sky.height, 4);
    let mut sum = DVec3::ZERO;
    for row in 0..height * fine {
        let y = (f64::from(row) + 0.5) / f64::from(fine);
        let solid_angle =
            (PI * y / f64::from(height)).sin() * (PI / f64::from(height * fine)) * TAU / f64::from(width * fine);
        for column in 0..width * fine {
            let direction = sky.direction_at(DVec2::new((f64::from(column) + 0.5) / f64::from(fine), y));
            let weight = of(direction);
            if weight > 0.0 {
                sum += weight * solid_angle * sky.radiance(direction);
            }
        }
    }
    sum
}

#[test]
fn a_white_sphere_vanishes_under_an_even_sky() {
    for albedo in [1.0, 0.5] {
        for bounces in [0, 1, 8] {
            let mut scene = Scene::default();
            add(&mut scene, sphere(1.0, 64), phong([albedo; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
            scene.cameras.push(camera(dvec3(0.5, 1.0, 4.0), DVec3::ZERO, 0.6));
            Sky::even(Vec3::splat(100.0)).put_over(&mut scene, 16);
            let seen: Vec<f64> =
                traced(&scene, &settings(24, bounces), 64).into_iter().filter(|p| p.is_finite()).map(|p| p.y).collect();
            let mean = seen.iter().sum::<f64>() / seen.len() as f64 / (100.0 * f64::from(albedo));
            println!("white furnace, albedo {albedo}, {bounces} bounces: {mean:.4} of {} pixels", seen.len());
            assert!(seen.len() > 200 && (mean - 1.0).abs() < 0.01, "{mean}");
        }
    }
}

#[test]
fn what_is_between_white_walls_vanishes_after_many_bounces() {
    // Half a box, open at the top and in front. Light needs many bounces to leave its corner.
    let mut scene = Scene::default();
    let walls = cuboid(Vec3::ZERO, Vec3::ONE, 1.0, |n| n != Vec3::Y && n != Vec3::Z).reversed();
    add(&mut scene, walls, phong([1.0; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.5, 0.5, 2.0), dvec3(0.5, 0.5, 0.0), 0.6));
    Sky::even(vec3(1.0, 2.0, 3.0)).put_over(&mut scene, 16);
    let mut means = Vec::new();
    for bounces in [Some(0), Some(1), None] {
        let mut seen = traced(&scene, &PathTraceSettings { bounces, ..PathTraceSettings::of([16; 2]) }, 128);
        seen.retain(|p| p.is_finite());
        assert!(seen.len() > 200, "{}", seen.len());
        means.push(seen.iter().map(|p| *p / dvec3(1.0, 2.0, 3.0)).sum::<DVec3>() / seen.len() as f64);
    }
    println!("half a white box after 0, 1 and all bounces: {means:?}");
    assert!(means[0].x < 0.7 && means[1].x < 0.9 && means[0].x < means[1].x);
    assert!((means[2] - 1.0).abs().max_element() < 0.01, "{}", means[2]);
}

#[test]
fn an_open_plane_receives_the_sum_of_the_sky() {
    for turn in [0.0, 2.0] {
        let mut scene = floor(phong([0.5; 3], [0.0; 3], 1.0));
        let sky = sky(256, 128, turn, uneven);
        let expected = 0.5 / PI * sky.received(DVec3::Y);
        sky.put_over(&mut scene, 16);
        let seen = traced(&scene, &settings(1, 0), 16_384)[0];
        println!("open plane: {seen} instead of {expected}");
        assert!((seen / expected - 1.0).abs().max_element() < 0.003, "{seen} instead of {expected}");
    }
}

#[test]
fn a_wall_hides_its_part_of_the_sky() {
    let mut scene = floor(phong([0.5; 3], [0.0; 3], 1.0));
    // A black wall between the bright spot and the visible point. It extends from z = -0.7 to 0.1.
    let wall = quad(vec3(0.5, 0.0, -0.7), Vec3::Y * 0.8, Vec3::Z * 0.8, 2.0);
    add(&mut scene, wall.clone(), phong([0.0; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    add(&mut scene, wall.reversed(), phong([0.0; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene.cameras[0] = camera(dvec3(-0.4, 1.5, 0.3), DVec3::ZERO, 0.001);
    let sky = sky(256, 128, 0.0, uneven);
    let hidden = |d: DVec3| {
        let at = d * (0.5 / d.x);
        d.x > 0.0 && at.y < 0.8 && (-0.7..0.1).contains(&at.z)
    };
    let open = 0.5 / PI * integral(&sky, |d| d.y.max(0.0));
    let expected = 0.5 / PI * integral(&sky, |d| if hidden(d) { 0.0 } else { d.y.max(0.0) });
    sky.put_over(&mut scene, 16);
    let seen = traced(&scene, &settings(1, 0), 65_536)[0];
    println!("behind a wall: {seen} instead of {expected}, open {open}");
    assert!(expected.y < 0.8 * open.y, "the wall hides too little: {expected} of {open}");
    assert!((seen / expected - 1.0).abs().max_element() < 0.005, "{seen} instead of {expected}");
}

#[test]
fn glossy_floors_reflect_the_sky_by_their_lobes() {
    for exponent in [5.0_f32, 100.0, 2000.0] {
        let mut scene = floor(phong([0.0; 3], [0.6; 3], exponent));
        // The brightest spot is not in the mirrored direction of the eye.
        let sky = sky(256, 128, 0.0, uneven);
        let (_, direction) = camera_ray(&scene.cameras[0], [1, 1], 0);
        let mirrored = reflect(direction, DVec3::Y);
        let lobe = |d: DVec3| 0.6 * phong_lobe(exponent.into(), mirrored.dot(d)) * d.y.max(0.0);
        let expected = integral(&sky, lobe);
        sky.put_over(&mut scene, 16);
        let seen = traced(&scene, &settings(1, 0), 16_384)[0];
        println!("glossy floor, k = {exponent}: {seen} instead of {expected}");
        assert!((seen / expected - 1.0).abs().max_element() < 0.005, "{seen} instead of {expected}");
    }
}

#[test]
fn a_closed_box_is_black_under_a_bright_sky() {
    let mut scene = Scene::default();
    let walls = cuboid(Vec3::NEG_ONE, Vec3::ONE, 1.0, |_| true);
    let white = phong([0.5; 3], [0.5; 3], 20.0);
    add(&mut scene, walls.clone().reversed(), white.clone(), DAffine3::IDENTITY);
    add(&mut scene, walls, white, DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.3, 0.2, 0.8), dvec3(-0.2, 0.0, -1.0), 1.4));
    Sky::even(Vec3::splat(1e4)).put_over(&mut scene, 16);
    let seen = traced(&scene, &settings(16, 8), 64);
    let most = seen.iter().map(|p| p.max_element()).fold(0.0, f64::max);
    println!("closed box: {:.3} at most, {:.5} in the mean", most, seen.iter().sum::<DVec3>().y / seen.len() as f64);
    // Rays ignore hits within a millionth of the box, so a few rays leave it at its edges.
    assert!(seen.iter().all(|p| p.is_finite()) && most < 1e-4 * 1e4, "{most} in a closed box");
}

#[test]
fn the_sky_and_the_punctual_lights_add_up_and_its_stand_ins_give_nothing() {
    let mut scene = corner(&[SPOT], 10.0);
    let punctual = scene.clone();
    sky(64, 32, 0.3, uneven).put_over(&mut scene, 16);
    let of = |scene: &Scene, sources| traced(scene, &PathTraceSettings { sources, ..settings(16, 2) }, 256);
    let [all, sky, lamps] = [Sources::All, Sources::Sky, Sources::Punctual].map(|sources| of(&scene, sources));
    let without = of(&punctual, Sources::Punctual);
    for pixel in (0..all.len()).filter(|pixel| all[*pixel].is_finite()) {
        let sum = sky[pixel] + lamps[pixel];
        assert!(sky[pixel].y > 0.0 && sum.distance(all[pixel]) < 1e-4 * sum.length(), "{sum} and {}", all[pixel]);
        assert!(lamps[pixel] == without[pixel], "{} and {}", lamps[pixel], without[pixel]);
    }
}

#[test]
fn other_skies_have_other_kept_samples() {
    let under = |radiance: f32, turn: f64| {
        let mut scene = floor(phong([0.5; 3], [0.0; 3], 1.0));
        let mut sky = Sky::even(Vec3::splat(radiance));
        sky.turn = turn;
        sky.put_over(&mut scene, 1);
        // Remove the lights that stand for the sky, so that the sky itself must change the fingerprint.
        scene.lights.clear();
        scene.fingerprint()
    };
    assert_eq!(under(1.0, 0.0), under(1.0, 0.0));
    assert_ne!(under(1.0, 0.0), under(2.0, 0.0));
    assert_ne!(under(1.0, 0.0), under(1.0, 1.0));
}
