//! Direct light of lamps and the sun by rays, against the path tracer, which shares no code with the device.

use glam::{Affine2, DAffine3, DQuat, DVec3, Vec3, dvec3, vec2, vec3};
use lightskin::frame::{Antialiasing, LightShadows};
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::{CornellSurface, cornell, cuboid, quad, sphere};
use lightskin::scene::{Image, Light, LightKind, Material, Sampler, Scene, Texture};

use crate::common::frames::{SPOT, add, camera, corner, lamp, phong, placed, shoot, small};
use crate::common::gpu;

/// Direct light alone, with shadows by rays.
fn rays(size: [u32; 2], antialiasing: Antialiasing) -> Knobs {
    Knobs { gi: Gi::Off, light_shadows: LightShadows::Rays, size, antialiasing, ..small() }
}

/// The path tracer's direct light, at the centres of pixels or spread over them.
fn paths(scene: &Scene, size: [u32; 2], spread: bool, passes: usize) -> Vec<f64> {
    let settings = PathTraceSettings { spread, ..PathTraceSettings::engine(size, 0) };
    let mut paths = PathTrace::new(scene, &scene.cameras[0], &settings);
    (0..passes).for_each(|_| paths.pass());
    paths.direct().iter().map(|path| f64::from(path[1])).collect()
}

/// Direct light at the centres of pixels: the device's and the path tracer's.
fn against_paths(scene: &Scene, knobs: &Knobs, passes: usize) -> Vec<(f64, f64)> {
    let shown = shoot(&gpu(), scene, None, knobs).direct;
    shown.iter().map(|own| own.y).zip(paths(scene, knobs.size, false, passes)).collect()
}

#[test]
fn lamps_are_hidden_where_the_path_tracer_says() {
    let lights = [SPOT, LightKind::Point, LightKind::Directional];
    let places = [(1.0, DVec3::ZERO), (1e-3, DVec3::ZERO), (1e3, DVec3::ZERO), (1.0, dvec3(1e4, -2e4, 3e4))];
    for (scale, shift) in places {
        let scene = placed(&corner(&lights, 20.0), scale, shift);
        let pixels = against_paths(&scene, &rays([96, 72], Antialiasing::Off), 1);
        let mean = pixels.iter().map(|(_, path)| path).sum::<f64>() / pixels.len() as f64;
        let wrong = pixels.iter().filter(|(own, path)| (own - path).abs() > 0.01 * path.max(mean)).count();
        let lit = pixels.iter().filter(|(_, path)| *path > 0.0).count();
        println!("scale {scale}, {shift}: {wrong} of {} pixels differ, {lit} are lit", pixels.len());
        assert!(lit > pixels.len() / 2 && mean > 0.0, "{lit} are lit");
        // At edges an f32 ray may pass where an f64 ray does not.
        assert!(wrong <= pixels.len() / 500, "{wrong} pixels differ in shadow");
    }
}

#[test]
fn edges_of_shadows_are_smooth() {
    let scene = corner(&[LightKind::Directional], 20.0);
    let [middle, four] = [Antialiasing::Off, Antialiasing::Four].map(|antialiasing| {
        // Both are compared with the mean over whole pixels.
        let shown = shoot(&gpu(), &scene, None, &rays([96, 72], antialiasing)).direct;
        let truth = paths(&scene, [96, 72], true, 16);
        shown.iter().zip(&truth).map(|(own, path)| (own.y - path).powi(2)).sum::<f64>().sqrt()
            / truth.iter().sum::<f64>()
    });
    println!("four more points: {:.3} of the error with pixels' centres alone", four / middle);
    assert!(four < 0.55 * middle, "{four} against {middle}");
}

/// The Cornell box with an emissive surface as its lamp, 5 mm below the ceiling.
fn lit_box(surface: CornellSurface) -> Scene {
    let mut scene = cornell(surface, 0.1);
    scene.lights.clear();
    let lamp = quad(vec3(-0.3, 1.995, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6, 0.6);
    let shining = Material { emissive: Vec3::splat(100.0), ..phong([0.0; 3], [0.0; 3], 1.0) };
    add(&mut scene, lamp, shining, DAffine3::IDENTITY);
    scene
}

#[test]
fn soft_shadows_of_a_surface_that_emits_are_the_path_tracers() {
    let size = [128, 96];
    for surface in [CornellSurface::Diffuse, CornellSurface::Glossy] {
        let scene = lit_box(surface);
        let pixels = against_paths(&scene, &rays(size, Antialiasing::Off), 16);
        // Errors are relative to the light on surfaces other than the lamp. The lamp's own pixels are compared as well.
        let mean = pixels.iter().map(|(_, path)| path).filter(|path| **path < 90.0).sum::<f64>();
        let sum = |of: fn(f64) -> f64| pixels.iter().map(|(own, path)| of(own - path)).sum::<f64>();
        let squares = sum(|error| error * error) * pixels.len() as f64;
        let [error, rms, bias] = [sum(f64::abs), squares.sqrt(), sum(|error| error)].map(|error| error / mean);
        println!("{surface:?}: mean error {error:.4} of the mean, RMSE {rms:.4}, bias {bias:+.4}");
        assert!(error < 0.0195 && rms < 0.1 && bias.abs() < 0.003, "{error}, {rms}, {bias}");
    }
}

/// A floor, and objects above it that block a light: a ball, a grid of bars, and a square with an alpha mask in the
/// shape of a leaf.
fn hiding(light: Light) -> Scene {
    let mut scene = Scene::default();
    let white = || phong([0.7; 3], [0.0; 3], 1.0);
    add(&mut scene, quad(vec3(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, 0.5), white(), DAffine3::IDENTITY);
    let over = |x: f64, z: f64| DAffine3::from_translation(dvec3(x, 0.6, z));
    add(&mut scene, sphere(0.25, 16), white(), over(-0.9, 0.0));
    for i in 0..4_u8 {
        let bar = cuboid(vec3(-0.03, 0.0, -0.35), vec3(0.03, 0.04, 0.35), 0.2, |_| true);
        add(&mut scene, bar, white(), over(-0.25 + 0.17 * f64::from(i), 0.0));
    }
    scene.images.push(leaf());
    let texture = Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler: Sampler::default() };
    let cut = Material { base_color_texture: Some(texture), alpha_cutoff: Some(0.5), ..white() };
    let mut square = quad(vec3(-0.3, 0.0, -0.3), Vec3::Z * 0.6, Vec3::X * 0.6, 0.6);
    for vertex in &mut square.vertices {
        vertex.uv0 = vec2(vertex.position.x, vertex.position.z) / 0.6 + 0.5;
    }
    add(&mut scene, square, cut, over(0.95, 0.0));
    scene.lights = vec![light];
    scene.cameras.push(camera(dvec3(0.0, 1.9, 1.6), dvec3(0.0, 0.0, -0.1), 0.75));
    scene
}

/// A pointed oval in the alpha channel.
fn leaf() -> Image {
    let side = 64_u32;
    let texel = |i: u32| {
        let at = |k: u32| (k as f32 + 0.5) / side as f32 * 2.0 - 1.0;
        let (x, y) = (at(i % side), at(i / side));
        [255, 255, 255, if x.abs() < 0.5 * (1.0 - y * y) { 255 } else { 0 }]
    };
    Image { name: "leaf".into(), width: side, height: side, rgba: (0..side * side).flat_map(texel).collect() }
}

#[test]
fn penumbrae_of_lamps_and_suns_are_the_path_tracers() {
    let size = [128, 80];
    let mut point = lamp(LightKind::Point);
    (point.position, point.radius) = (dvec3(0.3, 2.5, -0.4), 0.15);
    let mut spot = Light { kind: LightKind::Spot { inner: 0.7, outer: 0.9 }, ..point.clone() };
    (spot.direction, spot.radius) = (vec3(-0.1, -1.0, 0.1).normalize(), 0.05);
    let mut sun = lamp(LightKind::Directional);
    (sun.direction, sun.radius) = (vec3(-0.2, -1.0, 0.1).normalize(), 0.06);
    let narrow = Light { radius: Light::SUN_RADIUS, ..sun.clone() };
    for (name, light) in [("point", point), ("spot", spot), ("sun of 7 degrees", sun), ("sun", narrow)] {
        let scene = hiding(light);
        let bare = Scene { instances: scene.instances[..1].to_vec(), ..scene.clone() };
        let shown = shoot(&gpu(), &scene, None, &rays(size, Antialiasing::Off));
        let truth = paths(&scene, size, false, 12);
        // The light on the floor without any objects, to compute the fraction that arrives.
        let whole = paths(&bare, size, false, 1);
        let (mut soft, mut soft_of_paths, mut error, mut lit, mut sum) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for ((own, path), whole) in shown.direct.iter().zip(&truth).zip(&whole) {
            error += (own.y - path).abs();
            lit += path;
            sum += own.y;
            let between = |light: f64| (light / whole.max(1e-9)).clamp(0.0, 1.0);
            soft += between(own.y) * (1.0 - between(own.y));
            soft_of_paths += between(*path) * (1.0 - between(*path));
        }
        let [error, bias, width] = [error / lit, sum / lit - 1.0, soft / soft_of_paths - 1.0];
        println!("{name}: mean error {error:.4} of the mean, bias {bias:+.4}, penumbra width {width:+.3}");
        assert!(error < 0.02 && bias.abs() < 0.005 && width.abs() < 0.15, "{name}: {error}, {bias}, {width}");
    }
}

#[test]
fn light_of_a_lamp_in_a_closed_housing_stays_in() {
    // Shadow maps let light through in a ring of texels where the housing is close.
    let mut scene = Scene::default();
    let white = || phong([0.7; 3], [0.0; 3], 1.0);
    let floor = quad(vec3(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, 0.5);
    add(&mut scene, floor, white(), DAffine3::IDENTITY);
    let housing = DAffine3::from_scale_rotation_translation(DVec3::splat(0.3), DQuat::IDENTITY, dvec3(0.0, 0.6, 0.0));
    add(&mut scene, sphere(1.0, 12), white(), housing);
    let mut light = lamp(LightKind::Point);
    light.position = dvec3(0.05, 0.62, 0.0);
    scene.lights = vec![light];
    scene.cameras.push(camera(dvec3(1.5, 1.2, 2.0), dvec3(0.0, 0.4, 0.0), 0.8));
    for antialiasing in [Antialiasing::Off, Antialiasing::Fast, Antialiasing::Four] {
        let shown = shoot(&gpu(), &scene, None, &rays([160, 120], antialiasing)).direct;
        let lit = shown.iter().filter(|pixel| **pixel != DVec3::ZERO).count();
        assert_eq!(lit, 0, "{antialiasing:?}: pixels outside must be dark");
    }
}

#[test]
fn surfaces_do_not_hide_the_sun_from_themselves() {
    // The sun shines nearly along a floor. No pixel of the floor may be dark.
    for (scale, shift) in [(1.0, DVec3::ZERO), (1e-3, DVec3::ZERO), (1e3, dvec3(1e6, 0.0, -1e6))] {
        let mut scene = Scene::default();
        let floor = quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 0.1);
        add(&mut scene, floor, phong([0.7; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
        let mut sun = lamp(LightKind::Directional);
        sun.direction = vec3(0.9, -0.03, 0.2).normalize();
        scene.lights = vec![sun];
        scene.cameras.push(camera(dvec3(0.2, 0.5, 1.6), dvec3(0.0, 0.0, 0.1), 0.7));
        let scene = placed(&scene, scale, shift);
        for antialiasing in [Antialiasing::Off, Antialiasing::Eight] {
            let shot = shoot(&gpu(), &scene, None, &rays([120, 90], antialiasing));
            let dark = shot.covered.iter().zip(&shot.direct).filter(|(covered, light)| **covered && light.y == 0.0);
            assert_eq!(
                dark.count(),
                0,
                "scale {scale}, {shift}, {antialiasing:?}: the floor hides the sun from itself"
            );
        }
    }
}

#[test]
fn corners_in_the_sun_are_not_dark() {
    // The sun lights a floor and a wall equally. Some points of a pixel on one of them lie behind the other.
    let mut scene = Scene::default();
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let low = vec3(-1.0, 0.0, -1.0);
    let white = || phong([0.7; 3], [0.0; 3], 1.0);
    add(&mut scene, quad(low, z, x, 2.0), white(), DAffine3::IDENTITY);
    add(&mut scene, quad(low, x, y, 2.0), white(), DAffine3::IDENTITY);
    let mut sun = lamp(LightKind::Directional);
    sun.direction = vec3(0.1, -1.0, -1.0).normalize();
    scene.lights = vec![sun];
    scene.cameras.push(camera(dvec3(0.3, 0.8, 0.4), dvec3(0.1, 0.0, -1.0), 0.6));
    for antialiasing in [Antialiasing::Four, Antialiasing::Eight] {
        let shown = shoot(&gpu(), &scene, None, &rays([120, 90], antialiasing)).direct;
        let brightest = shown.iter().fold(0.0_f64, |most, pixel| most.max(pixel.y));
        let darkest = shown.iter().fold(brightest, |least, pixel| least.min(pixel.y));
        println!("{antialiasing:?}: from {darkest:.4} to {brightest:.4} cd/m^2");
        assert!(darkest > 0.999 * brightest, "{antialiasing:?}: the corner is dark");
    }
}
