//! Skies: the energy of the lights that stand for them, an open plane, the background, and files that are not skies.

use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::frame::World;
use lightskin::image::{Layer, read_radiance, write_exr};
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::reference::brdf::around;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings, camera_ray};
use lightskin::scene::build::quad;
use lightskin::scene::sky::Sky;
use lightskin::scene::{LightKind, Scene, luminance};
use std::f64::consts::{PI, TAU};

use crate::common::frames::{SPOT, add, camera, corner, phong, shoot, small};
use crate::common::{data, gpu, one_line, written};

/// A sky whose radiance is a function of the direction.
fn sky(width: u32, height: u32, turn: f64, radiance: impl Fn(DVec3) -> DVec3) -> Sky {
    let texel = |i: u32| {
        let (x, y) = (f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
        let (latitude, longitude) = (PI * y / f64::from(height), TAU * (x / f64::from(width) - 0.5));
        let direction = dvec3(latitude.sin() * longitude.sin(), latitude.cos(), -latitude.sin() * longitude.cos());
        radiance(direction).as_vec3()
    };
    Sky::new(width, height, (0..width * height).map(texel), turn)
}

/// A sun of 5 degrees in a blue sky over dark ground.
fn sunny(direction: DVec3) -> DVec3 {
    let sun = if direction.dot(dvec3(0.6, 0.64, -0.48)) > 0.9962 { 1e5 } else { 0.0 };
    let blue = if direction.y > 0.0 { dvec3(1000.0, 2000.0, 4000.0) } else { DVec3::splat(100.0) };
    blue + DVec3::splat(sun)
}

#[test]
fn lights_have_the_energy_of_the_sky() {
    let mut skies = vec![("sunny", sky(256, 128, 0.0, sunny)), ("even", Sky::even(vec3(1.0, 2.0, 3.0)))];
    if let Some(data) = data() {
        for name in ["venice_sunset_1k.hdr", "studio_small_03_1k.hdr"] {
            let picture = read_radiance(&data.join("env").join(name)).expect("a light probe");
            assert_eq!((picture.width, picture.height), (1024, 512));
            skies.push((name, Sky::new(1024, 512, picture.rgb.into_iter().map(Vec3::from), 0.3)));
        }
    }
    for (name, sky) in skies {
        let whole = sky.illuminance();
        if name == "even" {
            assert!(whole.distance(4.0 * PI * dvec3(1.0, 2.0, 3.0)) < 1e-5, "{whole}");
        }
        for count in [1, 5, 16, 64] {
            let mut scene = Scene::default();
            sky.clone().put_over(&mut scene, count);
            let suns = scene.lights.iter().filter(|light| light.name == "sun").count();
            assert_eq!(scene.lights.len(), count + suns);
            assert_eq!(suns == 1, scene.sky.as_ref().is_some_and(|sky| sky.shown.is_some()), "{name}");
            let light = |l: &lightskin::scene::Light| l.color.as_dvec3() * f64::from(l.intensity);
            let sum: DVec3 = scene.lights.iter().map(light).sum();
            assert!(sum.distance(whole) < 1e-6 * whole.length(), "{name}, {count}: {sum} of {whole}");
            assert!(scene.lights.iter().all(|l| l.kind == LightKind::Directional && l.direction.is_normalized()));
            let brightest = scene.lights.iter().map(|l| light(l).length()).fold(0.0, f64::max);
            eprintln!(
                "{name}: {count} lights, the brightest has {:.2} times the mean",
                brightest / sum.length() * count as f64
            );
        }
    }
    // The sun has a light of its own, in its own direction.
    let mut scene = Scene::default();
    sky(256, 128, 0.0, sunny).put_over(&mut scene, 16);
    let to_sun = scene.lights.iter().map(|l| -l.direction.as_dvec3().dot(dvec3(0.6, 0.64, -0.48))).fold(-1.0, f64::max);
    assert!(to_sun > 0.995, "{to_sun}");
}

#[test]
fn lights_give_open_surfaces_the_irradiance_of_the_sky() {
    let viewer = dvec3(0.43, 0.0, 0.85);
    let mut skies = vec![("studio", Sky::studio(viewer, true), 0.03), ("sunny", sky(256, 128, 0.0, sunny), 0.04)];
    skies.push(("even", Sky::even(vec3(1.0, 2.0, 3.0)), 0.06));
    if let Some(data) = data() {
        for name in ["venice_sunset_1k.hdr", "studio_small_03_1k.hdr"] {
            let picture = read_radiance(&data.join("env").join(name)).expect("a light probe");
            skies.push((name, Sky::new(1024, 512, picture.rgb.into_iter().map(Vec3::from), 0.3), 0.05));
        }
    }
    for (name, sky, most) in skies {
        let mut scene = Scene::default();
        sky.put_over(&mut scene, 16);
        let sky = scene.sky.as_ref().expect("a sky");
        let given = |n: DVec3| -> f64 {
            let of = |light: &lightskin::scene::Light| {
                let towards = -light.direction.as_dvec3();
                luminance(light.color.as_dvec3()) * f64::from(light.intensity) * n.dot(towards).max(0.0)
            };
            scene.lights[sky.lights.clone()].iter().map(of).sum()
        };
        let (mut squares, mut exact, mut sum) = (0.0, 0.0, 0.0);
        const COUNT: usize = 50;
        for i in 0..COUNT {
            let z = 1.0 - (2 * i + 1) as f64 / COUNT as f64;
            let normal = around(DVec3::Z, z, 0.754_877_666 * i as f64);
            let irradiance = luminance(sky.received(normal));
            squares += (given(normal) - irradiance).powi(2);
            exact += irradiance;
            sum += given(normal);
        }
        let (error, bias) = ((squares * COUNT as f64).sqrt() / exact, sum / exact - 1.0);
        println!("{name}: irradiance by 16 lights has an RMSE of {error:.4} of the mean, bias {bias:+.4}");
        assert!(error < most && bias.abs() < 0.01, "{name}: {error} {bias}");
    }
}

fn plane() -> Scene {
    let mut scene = Scene { name: "plane".into(), ..Scene::default() };
    let floor = quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 0.5);
    add(&mut scene, floor, phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.0, 2.0, 0.01), DVec3::ZERO, 0.6));
    scene
}

#[test]
fn an_open_plane_under_an_even_sky_receives_pi_l() {
    let gpu = gpu();
    let mut before = f64::INFINITY;
    for count in [4, 16, 64, 256] {
        let mut scene = plane();
        Sky::even(Vec3::splat(100.0)).put_over(&mut scene, count);
        let facing = |l: &lightskin::scene::Light| f64::from(l.intensity) * f64::from(-l.direction.y).max(0.0);
        let error = scene.lights.iter().map(facing).sum::<f64>() / (PI * 100.0) - 1.0;
        eprintln!("{count} lights: {:+.2} %", 100.0 * error);
        // Light from the centre of a region arrives more steeply than light from the whole region.
        assert!(error > -1e-6 && error < before && error < 1.2 / (count as f64).sqrt(), "{count}: {error}");
        before = error;
        if count == 16 {
            let shot = shoot(&gpu, &scene, None, &Knobs { gi: Gi::Off, ..small() });
            let expected = 0.5 * 100.0 * (1.0 + error);
            let middle = shot.direct[24 * 48 + 24].x;
            // The plane may hide a light near the horizon from itself.
            let bound = if shot.subpixels.is_some() { 1e-3 } else { 1e-4 };
            assert!((middle / expected - 1.0).abs() < bound, "{middle} instead of {expected}");
        }
    }
}

#[test]
fn the_background_shows_the_sky_from_every_side() {
    let gpu = gpu();
    let radiance = |d: DVec3| dvec3(1.1 + d.x, 1.1 + d.y, 1.1 + d.z);
    for (turn, eye) in [(0.7, dvec3(4.0, -2.0, 1.0)), (-2.0, dvec3(-3.0, 3.0, -2.0))] {
        let mut scene = corner(&[SPOT], 10.0);
        sky(128, 64, turn, radiance).put_over(&mut scene, 2);
        scene.cameras = vec![camera(eye, DVec3::ZERO, 1.4)];
        let shot = shoot(&gpu, &scene, None, &Knobs { gi: Gi::Off, ..small() });
        let mut shown = 0;
        for pixel in (0..shot.direct.len()).filter(|pixel| !shot.covered[*pixel]) {
            let (_, direction) = camera_ray(&scene.cameras[0], small().size, pixel);
            // The sky is turned, so turn the direction back.
            let expected = radiance(glam::DMat3::from_rotation_y(-turn) * direction);
            assert!(
                shot.direct[pixel].distance(expected) < 4e-3,
                "{}: {} instead of {expected}",
                pixel,
                shot.direct[pixel]
            );
            shown += 1;
        }
        assert!(shown > 500, "{shown}");
    }
}

#[test]
fn the_path_tracer_shows_the_sky_as_the_device_does() {
    let mut scene = corner(&[SPOT], 10.0);
    sky(128, 64, 0.7, |d| dvec3(1.1 + d.x, 1.1 + d.y, 1.1 + d.z)).put_over(&mut scene, 2);
    let knobs = Knobs { gi: Gi::Off, ..small() };
    let shot = shoot(&gpu(), &scene, None, &knobs);
    let settings = PathTraceSettings::engine(knobs.size, 0);
    let mut trace = PathTrace::new(&scene, &scene.cameras[0], &settings);
    trace.pass();
    let mut behind = 0;
    for (pixel, (traced, covered)) in trace.direct().into_iter().zip(trace.covered()).enumerate() {
        if !covered && !shot.covered[pixel] {
            behind += 1;
            let (traced, drawn) = (DVec3::from(traced.map(f64::from)), shot.direct[pixel]);
            assert!(traced.distance(drawn) < 1e-3, "{traced} and {drawn}");
        }
    }
    assert!(behind > 100, "{behind}");
}

#[test]
fn a_skys_lights_share_the_virtual_lights_of_one() {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 10.0);
    sky(128, 64, 0.0, sunny).put_over(&mut scene, 16);
    let settings = Knobs { rsm: 64, gi: Gi::BruteForce, ..small() };
    let shot = shoot(&gpu, &scene, None, &settings);
    assert_eq!(shot.vals.len(), 64 * 64 + 16 * 16 * 16);
    assert!(shot.diffuse.iter().any(|light| light.x > 0.0));
    let buffers = World::new(&gpu, &scene, None).expect("upload");
    assert_eq!(buffers.lights().iter().map(|l| l.sharing).sum::<f64>(), 1.0 + 16.0 * 16.0);
}

#[test]
fn pictures_that_are_no_skies_are_refused_in_one_line() {
    let texels: Vec<[f32; 4]> = (0..8).map(|i| [i as f32, 2.0, 3.0, 1.0]).collect();
    let path = written("sky.exr", b"");
    write_exr(&path, 4, 2, &[Layer::rgb("", &texels)], "").expect("written");
    assert_eq!(read_radiance(&path).expect("read").rgb[5], [5.0, 2.0, 3.0]);
    for (name, bytes, part) in [
        ("sky.png", &b"x"[..], ".hdr or .exr"),
        ("empty.hdr", b"", "image"),
        ("text.hdr", b"no picture\nat all\n", "image"),
        ("cut.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n", "image"),
        ("text.exr", b"no picture", "image"),
    ] {
        let message = one_line(read_radiance(&written(name, bytes)).expect_err("refused"));
        eprintln!("{message}");
        assert!(message.contains(part) && message.contains(name), "{message}");
    }
    if let Some(data) = data() {
        let mangled = data.join("malformed/utf8_mangled/spot1Lux.hdr");
        eprintln!("{}", one_line(read_radiance(&mangled).expect_err("refused")));
    }
}
