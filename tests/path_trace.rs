//! The path tracer against closed forms, another sampling method, brute force on the device, and itself. The reference
//! must be correct before anything is measured with it.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::frame::{self, LightShadows, View};
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::metrics::metrics;
use lightskin::reference::monte_carlo::one_bounce_irradiance;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings, camera_ray};
use lightskin::reference::triangle::nearest;
use lightskin::reference::world::{Sides, World};
use lightskin::scene::build::{CornellSurface, Surface, cornell, cuboid, quad, sphere};
use lightskin::scene::defaults::Ground;
use lightskin::scene::{Camera, Material, Scene, defaults, gltf};

use crate::bake::meshes::Random;
use crate::common::frames::{SPOT, add, camera, corner, phong, shoot, small, triangles};
use crate::common::{data, gpu};

/// Traces a picture from the scene's first camera.
fn traced<'a>(scene: &'a Scene, settings: &PathTraceSettings, samples: u32) -> PathTrace<'a> {
    let mut trace = PathTrace::new(scene, &scene.cameras[0], settings);
    while trace.samples() < samples {
        trace.pass();
    }
    trace
}

fn mean(values: &[[f32; 3]]) -> f64 {
    values.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / (3 * values.len()) as f64
}

fn glowing(albedo: f32, radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..phong([albedo; 3], [0.0; 3], 1.0) }
}

/// A box of 2 m seen from inside, all of one material.
fn furnace(material: Material) -> Scene {
    let mut scene = Scene::default();
    let inwards = cuboid(Vec3::NEG_ONE, Vec3::ONE, 1.0, |_| true).reversed();
    add(&mut scene, inwards, material, DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.3, 0.2, 0.8), dvec3(-0.2, 0.0, -1.0), 1.4));
    scene
}

#[test]
fn a_white_furnace_gains_one_emission_per_bounce() {
    let scene = furnace(glowing(1.0, 3.0));
    for bounces in [0, 1, 4] {
        let settings = PathTraceSettings::engine([24, 24], bounces);
        let trace = traced(&scene, &settings, 256);
        let radiance = mean(&trace.direct()) + mean(&trace.diffuse());
        // Emission, its first reflection, and one more reflection for each bounce. No light is lost.
        let expected = 3.0 * f64::from(2 + bounces);
        println!("furnace, {bounces} bounces: {radiance:.4} instead of {expected}");
        assert!((radiance / expected - 1.0).abs() < 0.01, "{radiance} instead of {expected}");
    }
}

#[test]
fn grey_furnaces_reach_their_sums() {
    // With limited and unlimited bounces. Without a limit paths end at random, and the remaining paths make up for
    // them.
    for (albedo, bounces) in [(0.5, Some(12)), (0.5, None), (0.8, None), (0.95, None)] {
        let scene = furnace(glowing(albedo, 1.0));
        let trace = traced(&scene, &PathTraceSettings { bounces, ..PathTraceSettings::of([16, 16]) }, 256);
        let radiance = (mean(&trace.direct()) + mean(&trace.diffuse())) * (1.0 - f64::from(albedo));
        println!("furnace of albedo {albedo}, {bounces:?} bounces: {radiance:.4} of the closed form");
        assert!((radiance - 1.0).abs() < 0.01, "{radiance} of 1 / (1 - {albedo})");
    }
}

#[test]
fn the_default_is_all_light_and_the_engines_a_part_of_it() {
    let scene = cornell(CornellSurface::Glossy, 0.5);
    let size = [32, 32];
    let sum = |settings: &PathTraceSettings| {
        let trace = traced(&scene, settings, 256);
        [mean(&trace.direct()), mean(&trace.diffuse()) + mean(&trace.glossy())]
    };
    let [one, four, all] = [
        PathTraceSettings::engine(size, 1),
        PathTraceSettings::engine(size, 4),
        PathTraceSettings { size, ..PathTraceSettings::default() },
    ]
    .map(|settings| sum(&settings));
    let limited = sum(&PathTraceSettings { bounces: Some(1), ..PathTraceSettings::of(size) });
    println!("direct and indirect: one bounce {one:?}, one that may be glossy {limited:?}, four {four:?}, all {all:?}");
    assert_eq!(PathTraceSettings::default(), PathTraceSettings::of([1280, 720]));
    assert!(one[0] == all[0], "direct light must be the same");
    assert!(one[1] < 0.9 * all[1] && limited[1] < 0.9 * all[1] && one[1] < 0.9 * four[1] && four[1] < 1.05 * all[1]);
    assert!((one[1] / limited[1] - 1.0).abs() > 0.01, "the engine's only bounce must be diffuse");
}

#[test]
fn a_glossy_floor_seen_from_straight_above_reflects_its_albedo() {
    let mut scene = furnace(glowing(0.0, 1.0));
    let floor = quad(vec3(-0.5, -0.9, -0.5), Vec3::Z, Vec3::X, 1.0);
    add(&mut scene, floor, phong([0.0; 3], [0.6; 3], 30.0), DAffine3::IDENTITY);
    scene.cameras[0] = camera(dvec3(0.0, 0.5, 0.0), dvec3(0.0, -0.9, 0.0), 0.01);
    let settings = PathTraceSettings::engine([1, 1], 0);
    let radiance = mean(&traced(&scene, &settings, 16_384).direct());
    // The integral of (k+2)/(2 pi) cos^(k+1) over the hemisphere is 1.
    assert!((radiance / 0.6 - 1.0).abs() < 0.005, "{radiance} instead of 0.6");
}

/// Irradiance [lx] of a small floor's centre from an emitter, computed from the radiance that the floor reflects.
fn received(emitter: Surface) -> f64 {
    let mut scene = Scene::default();
    add(
        &mut scene,
        quad(vec3(-0.1, 0.0, -0.1), Vec3::Z * 0.2, Vec3::X * 0.2, 1.0),
        phong([0.5; 3], [0.0; 3], 1.0),
        DAffine3::IDENTITY,
    );
    add(&mut scene, emitter, glowing(0.0, 7.0), DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.4, 0.3, 0.0), DVec3::ZERO, 0.01));
    let settings = PathTraceSettings::engine([1, 1], 0);
    mean(&traced(&scene, &settings, 16_384).direct()) * PI / 0.5
}

#[test]
fn disc_sphere_and_rectangle_lights_bring_their_closed_forms() {
    // A fan of radius 0.5 at height 1.2 that faces down.
    let mut disc = Surface::default();
    let rim = |i: u32| {
        let (y, x) = (f32::to_radians(360.0) * i as f32 / 512.0).sin_cos();
        vec3(0.5 * x, 1.2, 0.5 * y)
    };
    for i in 0..512 {
        let corners = [vec3(0.0, 1.2, 0.0), rim(i), rim(i + 1)];
        disc.indices.extend([0, 1, 2].map(|c| disc.vertices.len() as u32 + c));
        disc.vertices.extend(corners.map(|position| lightskin::scene::Vertex {
            position,
            normal: Vec3::NEG_Y,
            color: [255; 4],
            ..Default::default()
        }));
    }
    let ball = sphere(0.4, 96).shifted(0.0, 1.5, 0.0);
    // A rectangle of 0.8 by 0.6 at height 1 whose near corner is above the point, and a tilted rectangle to the side.
    let (x, y) = (0.8, 0.6_f64);
    let rectangle = quad(vec3(0.0, 1.0, 0.0), Vec3::X * 0.8, Vec3::Z * 0.6, 1.0);
    let above = |a: f64, b: f64| a / (1.0 + a * a).sqrt() * (b / (1.0 + a * a).sqrt()).atan();
    let aside = [vec3(0.5, 0.6, -0.3), vec3(0.3, 0.8, 0.0), vec3(0.0, 0.2, 0.7)];
    let tilted = quad(aside[0], aside[1], aside[2], 1.0);
    for (name, emitter, expected) in [
        ("disc", disc, PI * 7.0 * 0.25 / (0.25 + 1.44)),
        ("sphere", ball, PI * 7.0 * (0.4_f64 / 1.5).powi(2)),
        ("rectangle", rectangle, 7.0 / 2.0 * (above(x, y) + above(y, x))),
        ("tilted rectangle", tilted.reversed(), 7.0 / 2.0 * lambert(aside.map(Vec3::as_dvec3)).abs()),
    ] {
        let irradiance = received(emitter);
        println!("{name}: {irradiance:.5} lx instead of {expected:.5}");
        assert!((irradiance / expected - 1.0).abs() < 0.005, "{name}: {irradiance} lx instead of {expected}");
    }
}

/// Lambert's contour sum of a parallelogram, seen from a floor's centre: `sum angle_i (n . axis_i)`.
fn lambert([corner, u, v]: [DVec3; 3]) -> f64 {
    let corners = [corner, corner + u, corner + u + v, corner + v];
    let edge = |i: usize| {
        let (a, b) = (corners[i].normalize(), corners[(i + 1) % 4].normalize());
        a.dot(b).acos() * a.cross(b).normalize().y
    };
    (0..4).map(edge).sum()
}

#[test]
fn the_hierarchy_finds_what_trying_all_triangles_finds() {
    let mut scene = corner(&[SPOT], 20.0);
    // Mirroring and distance from the origin must not matter.
    for instance in &mut scene.instances {
        instance.world_from_model = DAffine3::from_translation(dvec3(3e5, -1e5, 2e5))
            * DAffine3::from_scale(dvec3(-1.0, 1.0, 1.0))
            * instance.world_from_model;
    }
    scene.cameras[0] = camera(dvec3(3e5 - 1.4, 1.5 - 1e5, 2e5 + 2.0), dvec3(3e5 + 0.3, 0.5 - 1e5, 2e5 - 0.1), 0.9);
    let world = World::new(&scene);
    let all: Vec<_> = triangles(&scene).into_iter().map(|(triangle, _)| triangle).collect();
    let mut met = 0;
    for index in 0..64 * 64 {
        let (origin, direction) = camera_ray(&scene.cameras[0], [64, 64], index);
        let expected = nearest(&all, origin, direction);
        let hit = world.nearest(origin, direction, Sides::Both);
        assert_eq!(hit.is_some(), expected.is_some(), "ray {index}");
        if let (Some(hit), Some(expected)) = (hit, expected) {
            let surface = world.surface(&hit);
            met += 1;
            // At 3e5 m from the origin f64 resolves positions to 1e-10 m.
            assert!((hit.distance - expected.distance).abs() < 1e-8, "ray {index}");
            assert!(surface.position.distance(expected.position) < 1e-8, "ray {index}");
            // At a silhouette, `nearest` turns the vertex normal against the ray, but `surface` turns it by the
            // winding.
            let same =
                surface.vertex_normal.distance(expected.normal).min(surface.vertex_normal.distance(-expected.normal));
            assert!(same < 1e-6, "ray {index}");
            let mut nearest_of_all = f64::INFINITY;
            world.all(origin, direction, |hit| nearest_of_all = nearest_of_all.min(hit.distance));
            assert_eq!(nearest_of_all, hit.distance);
            assert!(!world.blocked(origin, surface.position), "ray {index}");
            assert!(world.blocked(origin, surface.position + 0.01 * direction), "ray {index}");
        }
    }
    assert!(met > 2000, "only {met} rays hit anything");
}

#[test]
fn rays_along_the_axes_meet_what_is_there() {
    let mut scene = Scene::default();
    add(&mut scene, sphere(0.5, 32), Material::default(), DAffine3::from_translation(dvec3(10.0, 0.0, 0.0)));
    add(
        &mut scene,
        cuboid(Vec3::NEG_ONE, Vec3::ONE, 2.0, |_| true).reversed(),
        Material::default(),
        DAffine3::IDENTITY,
    );
    let world = World::new(&scene);
    for direction in [DVec3::X, DVec3::Y, DVec3::Z] {
        for direction in [direction, -direction, direction * dvec3(1.0, -1.0, -1.0), direction * dvec3(-1.0, -1.0, 1.0)]
        {
            let hit = world.nearest(DVec3::ZERO, direction, Sides::Both).expect("a wall");
            assert_eq!(hit.distance, 1.0, "{direction:?}");
            assert!(world.blocked_within(DVec3::ZERO, direction, f64::INFINITY), "{direction:?}");
        }
    }
}

/// Rays that start at 1e-6 to 1e-3 of the scene's radius in front of a surface, towards it and nearly along it, and
/// rays from far outside.
#[test]
fn rays_meet_what_is_close_and_what_is_far() {
    let mut random = Random(11);
    let mut scene = Scene::default();
    for i in 0..300 {
        let size = 10.0_f64.powf(-3.0 * random.next());
        let [at, mut u, mut v] = [1.0, size, size].map(|scale| (2.0 * random.point() - DVec3::ONE) * scale);
        // Most rectangles lie in planes along the axes, as walls and floors do.
        if i % 4 < 3 {
            (u[i % 4], v[i % 4]) = (0.0, 0.0);
        }
        add(&mut scene, quad(at.as_vec3(), u.as_vec3(), v.as_vec3(), 2.0), Material::default(), DAffine3::IDENTITY);
    }
    let world = World::new(&scene);
    let all: Vec<_> = triangles(&scene).into_iter().map(|(triangle, _)| triangle).collect();
    let mut lost = [0; 3];
    for slope in [1.0, 0.1, 1e-2, 1e-3] {
        for i in 0..4000 {
            let [a, b, c] = all[i % all.len()].positions;
            let (second, third) = (0.1 + 0.3 * random.next(), 0.1 + 0.3 * random.next());
            let target = a + second * (b - a) + third * (c - a);
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let along = (2.0 * random.point() - DVec3::ONE).reject_from(normal).normalize();
            let direction = (along + slope * side * normal).normalize();
            let close = world.radius * 10.0_f64.powf(-6.0 + 3.0 * random.next()) + 2e-6 * world.radius;
            for distance in [close, 1e3 * world.radius] {
                let origin = target - distance * direction;
                let Some(expected) = nearest(&all, origin, direction) else { panic!("ray {i} must hit a triangle") };
                if expected.distance < 1.5e-6 * world.radius {
                    continue; // too close for a sure result
                }
                let tolerance = 1e-9 * distance.max(world.radius);
                let is_it = |found: f64| (found - expected.distance).abs() < tolerance;
                let mut nearest_of_all = f64::INFINITY;
                world.all(origin, direction, |hit| nearest_of_all = nearest_of_all.min(hit.distance));
                let hit = world.nearest(origin, direction, Sides::Both);
                lost[0] += usize::from(!hit.is_some_and(|hit| is_it(hit.distance)));
                lost[1] += usize::from(!is_it(nearest_of_all));
                lost[2] += usize::from(!world.blocked_within(origin, direction, expected.distance + tolerance));
            }
        }
        println!("slope {slope}: rays lost so far by nearest, all and blocked: {lost:?}");
    }
    assert_eq!(lost, [0; 3]);
}

#[test]
fn one_bounce_without_visibility_is_what_rays_of_the_light_bring() {
    let scene = cornell(CornellSurface::Diffuse, 2.0);
    let size = [16, 16];
    let trace = traced(&scene, &PathTraceSettings::unshadowed(size), 8192);
    let all: Vec<_> = triangles(&scene).into_iter().map(|(triangle, _)| triangle).collect();
    let (surfaces, diffuse) = (trace.surfaces(), trace.diffuse());
    // Points on the ceiling, the green wall and the back wall, all without direct light.
    for pixel in [2 * 16 + 10, 7 * 16 + 14, 4 * 16 + 8] {
        let s = surfaces[pixel].expect("a wall");
        let irradiance = Vec3::from(diffuse[pixel]).as_dvec3() * PI / s.reflection.diffuse(1.0).as_dvec3();
        let paths = one_bounce_irradiance(s.position, s.normal, &all, &scene.lights[0], 400_000, 3);
        let off = irradiance.distance(paths) / paths.length();
        println!("{}: {irradiance} lx, paths {paths} lx: relative error {off:.4}", s.position);
        assert!(off < 0.01 && paths.min_element() > 0.0, "at {}: {irradiance} lx instead of {paths}", s.position);
    }
}

/// Mean radiance of both lobes, by brute force on the device and by paths without visibility on the CPU.
fn against_brute_force(scene: &Scene, size: [u32; 2], rsm: u32, samples: u32) -> [f64; 4] {
    let gpu = gpu();
    let shot = shoot(
        &gpu,
        scene,
        None,
        &Knobs { size, gi: Gi::BruteForce, rsm, light_shadows: LightShadows::Maps(1024), ..small() },
    );
    let trace = traced(scene, &PathTraceSettings::unshadowed(size), samples);
    let device = |layer: &[DVec3]| layer.iter().map(|v| v.element_sum()).sum::<f64>() / (3 * layer.len()).max(1) as f64;
    [device(&shot.diffuse), mean(&trace.diffuse()), device(&shot.glossy), mean(&trace.glossy())]
}

#[test]
fn brute_force_and_the_path_tracer_agree_on_the_cornell_box() {
    let scene = cornell(CornellSurface::Glossy, 0.5);
    let [diffuse, traced_diffuse, glossy, traced_glossy] = against_brute_force(&scene, [64, 64], 128, 256);
    println!("diffuse {diffuse} and {traced_diffuse}, glossy {glossy} and {traced_glossy} cd/m^2");
    assert!((diffuse / traced_diffuse - 1.0).abs() < 0.01, "{diffuse} and {traced_diffuse}");
    assert!((glossy / traced_glossy - 1.0).abs() < 0.02, "{glossy} and {traced_glossy}");
}

#[test]
fn brute_force_and_the_path_tracer_agree_on_sponza() {
    let Some(data) = data() else { return };
    let mut scene = gltf::load(&data.join("scenes/sponza/Sponza.gltf")).expect("Sponza");
    defaults::complete(&mut scene, Ground::Auto);
    // The sun alone, which shines along the nave.
    scene.lights.truncate(1);
    scene.sky = None;
    scene.lights[0].direction = -vec3(0.4226, 0.9063, 0.0);
    let [diffuse, traced_diffuse, glossy, traced_glossy] = against_brute_force(&scene, [128, 72], 128, 32);
    println!("diffuse {diffuse} and {traced_diffuse}, glossy {glossy} and {traced_glossy} cd/m^2");
    let (all, truth) = (diffuse + glossy, traced_diffuse + traced_glossy);
    assert!((all / truth - 1.0).abs() < 0.02, "{all} and {truth}");
}

#[test]
fn visibility_only_takes_light_away() {
    let scene = cornell(CornellSurface::Diffuse, 2.0);
    let settings = PathTraceSettings::engine([24, 24], 1);
    let open = traced(&scene, &PathTraceSettings::unshadowed([24, 24]), 256).diffuse();
    let shut = traced(&scene, &settings, 256).diffuse();
    let (open, shut) = (mean(&open), mean(&shut));
    assert!(shut < 0.95 * open, "the blocks must hide light: {shut} and {open}");
    let more = mean(&traced(&scene, &PathTraceSettings::engine([24, 24], 4), 256).diffuse());
    assert!(more > 1.1 * shut, "further bounces must add light: {more} and {shut}");
}

#[test]
fn the_noise_estimate_is_the_noise() {
    let scene = cornell(CornellSurface::Diffuse, 2.0);
    let settings = PathTraceSettings::engine([48, 48], 1);
    let (one, other) = (traced(&scene, &settings, 64), traced(&scene, &PathTraceSettings { seed: 1, ..settings }, 64));
    let (a, b) = (one.diffuse(), other.diffuse());
    assert_ne!(a, b);
    // The mean absolute difference of two pictures with standard deviation s each is 2 s / sqrt(pi).
    let measured = metrics(&a, &b).mare * PI.sqrt() / 2.0;
    let (estimate, again) = (one.noise(), other.noise());
    println!("estimated {estimate:.4} and {again:.4}, measured {measured:.4}");
    assert!((measured / estimate - 1.0).abs() < 0.15, "{measured} instead of {estimate}");
    let finer = traced(&scene, &settings, 256).noise();
    assert!(finer < 0.6 * estimate, "four times the samples leave {finer} of {estimate}");
}

#[test]
fn kept_samples_go_on_bit_by_bit() {
    let scene = cornell(CornellSurface::Glossy, 2.0);
    let settings = PathTraceSettings::engine([16, 16], 1);
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("kept samples");
    let first = traced(&scene, &settings, 32);
    let file = first.kept_in(&folder);
    first.save(&file).expect("saved");

    let mut second = PathTrace::new(&scene, &scene.cameras[0], &settings);
    assert!(second.resume(&file));
    assert_eq!(second.samples(), 32);
    second.pass();
    let straight = traced(&scene, &settings, 48);
    assert_eq!(second.diffuse(), straight.diffuse());
    assert_eq!(second.glossy(), straight.glossy());
    assert_eq!(second.noise(), straight.noise());

    // Another picture has another file, and rejects this one.
    let other_settings = PathTraceSettings { seed: 1, ..settings };
    let mut other = PathTrace::new(&scene, &scene.cameras[0], &other_settings);
    assert_ne!(other.kept_in(&folder), file);
    assert!(!other.resume(&file));
    // A damaged file is rejected, too.
    let mut bytes = std::fs::read(&file).expect("kept");
    bytes[60] ^= 1;
    std::fs::write(&file, &bytes).expect("written");
    assert!(!second.resume(&file) && second.samples() == 48);
    std::fs::write(&file, &bytes[..40]).expect("written");
    assert!(!second.resume(&file));
}

/// Compares the surfaces that rays hit with the device's G-buffer. Returns the median difference of normals, the bias
/// of albedo, and the number of pixels that only one of them covers, relative to those that both cover.
fn gbuffers_agree(scene: &Scene, size: [u32; 2]) -> (f64, f64, f64) {
    let gpu = gpu();
    let buffers = frame::World::new(&gpu, scene, None).expect("upload");
    let settings = Knobs { gi: Gi::Off, light_shadows: LightShadows::Maps(64), ..Knobs::plain(size) };
    let mut frame = Frame::new(&gpu, scene, &buffers, &settings).expect("frame");
    let camera: &Camera = &scene.cameras[0];
    let view = View::new(camera, size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &buffers, &view);
        Ok(())
    });
    gpu.times(&drawn.expect("frame")).expect("times");
    let normals: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.normal).expect("normals");
    let albedo: Vec<[u16; 4]> = gpu.read_image(&frame.picture.surface.albedo).expect("albedo");
    let depth: Vec<f32> = gpu.read_image(&frame.picture.surface.depth).expect("depth");
    let surfaces = PathTrace::new(scene, camera, &PathTraceSettings::of(size)).surfaces();
    let (mut tilt, mut albedos, mut other, mut both) = (Vec::new(), [0.0; 2], 0.0, 0.0);
    for (i, surface) in surfaces.iter().enumerate() {
        match surface {
            Some(s) if depth[i] > 0.0 => {
                both += 1.0;
                let n = Vec3::new(normals[i][0], normals[i][1], normals[i][2]).as_dvec3();
                tilt.push(n.distance(s.normal));
                let value = |c: usize| half::f16::from_bits(albedo[i][c]).to_f64();
                albedos[0] += value(0) + value(1) + value(2);
                let (_, direction) = camera_ray(camera, size, i);
                albedos[1] += f64::from(s.reflection.diffuse(-s.normal.dot(direction)).element_sum());
            }
            None if depth[i] == 0.0 => {}
            _ => other += 1.0,
        }
    }
    tilt.sort_by(f64::total_cmp);
    (tilt[tilt.len() / 2], albedos[0] / albedos[1] - 1.0, other / both)
}

#[test]
fn rays_see_the_surfaces_that_the_device_draws() {
    let Some(data) = data() else { return };
    for (file, size) in [
        ("normalmap/NormalTangentTest.glb", [320, 320]),
        ("materials/TwoSidedPlane.glb", [64, 64]),
        ("textures/TextureSettingsTest/TextureSettingsTest.gltf", [256, 256]),
        ("materials/AlphaBlendModeTest.glb", [256, 256]),
        ("multiuv/orm_two_uvmaps/12_orm_two_uvmaps.gltf", [256, 256]),
        ("skin/CesiumMan.glb", [256, 256]),
    ] {
        let mut scene = gltf::load(&data.join("scenes/features").join(file)).expect(file);
        defaults::complete(&mut scene, Ground::Auto);
        let (tilt, albedo, other) = gbuffers_agree(&scene, size);
        println!("{file}: normals {tilt:.5}, albedo {albedo:.5}, covered by one alone {other:.5}");
        // The device filters textures with mip levels, rays do not. Pixels on edges may differ.
        assert!(tilt < 0.02 && albedo.abs() < 0.01 && other < 0.01, "{file}: {tilt} {albedo} {other}");
    }
}
