//! Area lights, which are the largest flat emissive surfaces: against the closed form, soft shadows and bounces against
//! the path tracer, and which surfaces become area lights.

use glam::{DAffine3, DQuat, DVec3, Vec3, Vec4, dvec3, vec3, vec4};
use lightskin::frame::{LightShadows, Near, Shadows, World};
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::reference::area_light::Rectangle;
use lightskin::reference::brdf::Lobe;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::reference::rsm::Val;
use lightskin::reference::world::{Sides, World as Placed};
use lightskin::scene::build::{CornellSurface, cornell, cuboid, quad};
use lightskin::scene::{Material, Scene};

use crate::common::frames::{add, baked, camera, phong, reflection, seen, sent_on, shoot, small};
use crate::common::gpu;

pub(crate) fn shining(radiance: Vec3) -> Material {
    Material { emissive: radiance, ..phong([0.0; 3], [0.0; 3], 1.0) }
}

/// A 2 m floor with a Phong lobe below a lamp of 0.6 m by 0.4 m that shines downwards.
fn lamp_over_floor(exponent: f32, world_from_lamp: DAffine3) -> Scene {
    let mut scene = Scene { name: "lamp over floor".into(), ..Scene::default() };
    let floor = quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 0.5);
    add(&mut scene, floor, phong([0.4, 0.3, 0.2], [0.3, 0.4, 0.5], exponent), DAffine3::IDENTITY);
    let lamp = quad(vec3(-0.3, 0.0, -0.2), Vec3::X * 0.6, Vec3::Z * 0.4, 0.13);
    add(&mut scene, lamp, shining(vec3(30.0, 20.0, 10.0)), world_from_lamp);
    scene.cameras.push(camera(dvec3(0.0, 0.9, 1.1), dvec3(0.0, 0.0, -0.1), 1.2));
    scene
}

#[test]
fn an_open_lamp_is_the_integral_over_it() {
    let gpu = gpu();
    let tilt = DQuat::from_axis_angle(dvec3(1.0, 0.3, 0.7).normalize(), 0.6);
    let places = [(DQuat::IDENTITY, 0.8), (tilt, 0.7), (DQuat::from_rotation_x(1.5), 0.25)];
    for (exponent, (turn, height)) in [1.0, 8.0, 60.0, 1500.0].into_iter().flat_map(|k| places.map(|p| (k, p))) {
        let world_from_lamp = DAffine3::from_rotation_translation(turn, dvec3(0.05, height, -0.3));
        let scene = lamp_over_floor(exponent, world_from_lamp);
        let settings = Knobs { gi: Gi::Off, ..small() };
        let shot = shoot(&gpu, &scene, None, &settings);
        let lamp = Rectangle {
            middle: world_from_lamp.translation,
            right: turn * (DVec3::X * 0.3),
            up: turn * (DVec3::Z * 0.2),
        };
        let (mut worst, mut off, mut sum, mut brightest) = (0.0_f64, 0.0, 0.0, 0.0_f64);
        let floor: Vec<_> = seen(&scene, settings.size).into_iter().filter(|s| s.instance == 0).collect();
        let exact = |s: &lightskin::lab::shot::PixelSurface| {
            let r = reflection(&scene, s.material);
            let view = (s.position - scene.cameras[0].world_from_camera.translation).normalize();
            let mirrored = view - 2.0 * view.dot(s.normal) * s.normal;
            let lobe = Lobe::Phong { albedo: r.specular, exponent: r.exponent, mirrored };
            let lobe = lamp.reflected(s.position, s.normal, &lobe);
            dvec3(30.0, 20.0, 10.0) * (r.diffuse * lamp.form_factor(s.position, s.normal) + lobe)
        };
        for s in floor.iter().step_by(23) {
            let (exact, shown) = (exact(s), shot.direct[s.pixel]);
            worst = worst.max(exact.distance(shown));
            brightest = brightest.max(exact.length());
            off += exact.distance(shown);
            sum += exact.length();
        }
        println!("k {exponent}, height {height}: mean error {:.5}, largest {:.5}", off / sum, worst / brightest);
        assert!(sum > 0.0 && off / sum < 2e-3 && worst < 0.02 * brightest, "{exponent}: {off} of {sum}, {worst}");
    }
}

/// RMSE over the mean and bias of a lamp's light on a floor of a glTF material, against its integral.
fn against_integral(material: &Material, eye: DVec3) -> [f64; 2] {
    let lamp = Rectangle { middle: dvec3(0.05, 0.6, -0.5), right: DVec3::X * 0.3, up: DVec3::Z * 0.2 };
    let mut scene = lamp_over_floor(1.0, DAffine3::from_translation(lamp.middle));
    let own = material.reflectance(&scene, Default::default(), Vec4::ONE);
    scene.materials[0] = material.clone();
    scene.cameras = vec![camera(eye, dvec3(0.0, 0.0, 0.1), 0.6)];
    let settings = Knobs { gi: Gi::Off, ..small() };
    let shot = shoot(&gpu(), &scene, None, &settings);
    let (mut squares, mut exact, mut shown, mut count) = (0.0, 0.0, 0.0, 0.0);
    for s in seen(&scene, settings.size).iter().filter(|s| s.instance == 0).step_by(41) {
        let direction = (s.position - eye).normalize();
        let diffuse = f64::from(own.diffuse(-s.normal.dot(direction)).y);
        let lobe = Lobe::new(&own, s.normal, direction);
        let integral = diffuse * lamp.form_factor(s.position, s.normal) + lamp.reflected(s.position, s.normal, &lobe).y;
        squares += (shot.direct[s.pixel].y - 20.0 * integral).powi(2);
        exact += 20.0 * integral;
        shown += shot.direct[s.pixel].y;
        count += 1.0;
    }
    [(squares * count).sqrt() / exact, shown / exact - 1.0]
}

#[test]
fn gltf_materials_reflect_a_lamp_as_its_integral() {
    for metallic in [0.0, 1.0] {
        for roughness in [0.15, 0.3, 0.5, 0.7, 1.0] {
            let material =
                Material { metallic, roughness, base_color: vec4(0.9, 0.6, 0.3, 1.0), ..Material::default() };
            // At cosines of about .9 and .3.
            let [above, aside] =
                [dvec3(0.0, 2.0, 0.9), dvec3(0.0, 0.4, 1.2)].map(|eye| against_integral(&material, eye));
            println!(
                "metallic {metallic}, roughness {roughness}: RMSE and bias {above:.4?} from above, {aside:.4?} aside"
            );
            assert!(above[0] < 0.012 && above[1].abs() < 0.005, "{metallic}, {roughness}: {above:?} from above");
            assert!(aside[0] < 0.055 && aside[1].abs() < 0.02, "{metallic}, {roughness}: {aside:?} aside");
        }
    }
}

/// Relative error and bias of the sum of all layers against the path tracer. Pixels that show the lamps are left out.
pub(crate) fn against_paths(scene: &Scene, settings: &Knobs, passes: usize) -> [f64; 2] {
    let gpu = gpu();
    let caches = baked(scene, 0.2, 8);
    let shot = shoot(&gpu, scene, Some(&caches), settings);
    let paths = PathTraceSettings::engine(settings.size, settings.bounces);
    let mut paths = PathTrace::new(scene, &scene.cameras[0], &paths);
    (0..passes).for_each(|_| paths.pass());
    let (mut off, mut sum, mut own) = (0.0, 0.0, 0.0);
    for (i, (direct, diffuse)) in paths.direct().iter().zip(paths.diffuse()).enumerate() {
        let path = f64::from(direct[1]) + f64::from(diffuse[1]);
        let shown = shot.direct[i].y + shot.diffuse.get(i).map_or(0.0, |d| d.y);
        if path < 90.0 {
            off += (path - shown).abs();
            sum += path;
            own += shown;
        }
    }
    [off / sum, own / sum - 1.0]
}

/// The Cornell box with an emissive surface as its lamp. It hangs 5 mm below the ceiling and shines to both sides.
fn lit_box() -> Scene {
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    scene.lights.clear();
    let lamp = quad(vec3(-0.3, 1.995, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6, 0.6);
    let both = lamp.clone().and(lamp.reversed());
    add(&mut scene, both, shining(Vec3::splat(100.0)), DAffine3::IDENTITY);
    scene
}

#[test]
fn soft_shadows_and_bounces_are_the_path_tracers() {
    let scene = lit_box();
    let settings = Knobs {
        size: [48, 36],
        rsm: 96,
        light_shadows: LightShadows::Maps(1024),
        shadows: Shadows::PerLight,
        ..small()
    };
    for (bounces, most, bias) in [(0, 0.05, 0.01), (1, 0.08, 0.03), (3, 0.12, 0.08)] {
        let [error, own] = against_paths(&scene, &Knobs { bounces, ..settings }, 32);
        println!("{bounces} bounces: mean error {error:.4} of the mean, bias {own:+.4}");
        assert!(error < most && own.abs() < bias, "{bounces}: {error}, {own}");
    }
}

#[test]
fn vals_of_area_lights_are_f64_rays() {
    let gpu = gpu();
    let scene = lit_box();
    let near = Near::Rays { per_pixel: 8, every: 2 };
    let settings = Knobs { near, shadows: Shadows::PerLight, rsm: 96, ..small() };
    let shot = shoot(&gpu, &scene, Some(&baked(&scene, 0.4, 8)), &settings);
    let World { areas, radius, .. } = World::new(&gpu, &scene, None).expect("upload");
    assert_eq!(areas.len(), 2, "a lamp with two sides");
    let world = Placed::new(&scene);
    let count = shot.vals.len() / 2;
    let (mut differ, mut flux, mut expected, mut worst) = (0, 0.0, 0.0, 0.0_f64);
    for (light, vals) in areas.iter().zip(shot.vals.chunks(count)) {
        let lamp = Rectangle { middle: light.middle, right: light.right, up: light.up };
        for (i, val) in vals.iter().enumerate() {
            let (origin, direction) = lamp.ray(i as u32, count as u32);
            let twin = world.nearest(origin, direction, Sides::Both).map_or(Val::NOTHING, |hit| {
                let s = world.surface(&hit);
                let normal = if s.geometric.dot(direction) < 0.0 { s.geometric } else { -s.geometric };
                let place = (origin + hit.distance * direction, normal, sent_on(&scene, hit.material));
                lamp.val(light.radiance, count as u32, place, 0.01 * radius)
            });
            flux += val.flux.y;
            expected += twin.flux.y;
            if twin.flux == DVec3::ZERO || val.position.distance(twin.position) > 1e-4 {
                differ += u32::from(twin.flux != val.flux);
                continue;
            }
            let off = (val.flux.y / twin.flux.y - 1.0).abs().max((val.area / twin.area - 1.0).abs());
            worst = worst.max(off.max(val.normal.distance(twin.normal)));
        }
    }
    println!("{count} VALs a side, {differ} elsewhere, largest relative error {worst:e}, flux {flux} for {expected}");
    assert!(count > 1000 && differ * 500 < count as u32 && worst < 5e-3, "{differ}, {worst}");
    assert!((flux / expected - 1.0).abs() < 1e-5);
}

/// A lattice hides most of a lamp. The few points from which the lamp's maps are drawn lie between its bars.
#[test]
fn bars_close_to_a_lamp_take_their_share() {
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    scene.lights.clear();
    let lamp = quad(vec3(-0.6, 1.98, -0.6), Vec3::X * 1.2, Vec3::Z * 1.2, 0.6);
    add(&mut scene, lamp, shining(Vec3::splat(100.0)), DAffine3::IDENTITY);
    for at in [-0.6_f32, 0.0, 0.6] {
        for (x, z) in [(0.6, 0.09), (0.09, 0.6)] {
            let [dx, dz] = if x > z { [0.0, at] } else { [at, 0.0] };
            let bar = cuboid(vec3(dx - x, 1.9, dz - z), vec3(dx + x, 1.95, dz + z), 0.6, |_| true);
            add(&mut scene, bar, phong([0.1; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
        }
    }
    let settings = Knobs {
        size: [48, 36],
        rsm: 96,
        light_shadows: LightShadows::Rays,
        shadows: Shadows::PerLight,
        near: Near::Rays { per_pixel: 8, every: 2 },
        bounces: 1,
        ..small()
    };
    let shot = shoot(&gpu(), &scene, Some(&baked(&scene, 0.2, 8)), &settings);
    let mut paths = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::engine(settings.size, 1));
    (0..32).for_each(|_| paths.pass());
    let shown: f64 = shot.diffuse.iter().map(|diffuse| diffuse.y).sum();
    let path: f64 = paths.diffuse().iter().map(|diffuse| f64::from(diffuse[1])).sum();
    println!("indirect light {:+.4} against paths", shown / path - 1.0);
    assert!((shown / path - 1.0).abs() < 0.05, "{shown} instead of {path}");
}

#[test]
fn what_a_lamp_lights_reflects_all_of_its_light() {
    // The lamp is near the floor. Below its centre it fills 0.87 of the floor's view.
    let gpu = gpu();
    let scene = lamp_over_floor(1.0, DAffine3::from_translation(DVec3::Y * 0.1));
    let settings = Knobs { gi: Gi::BruteForce, rsm: 96, ..small() };
    let shot = shoot(&gpu, &scene, None, &settings);
    let reflected: f64 = shot.vals.iter().map(|val| val.flux.x).sum();
    let lamp = Rectangle { middle: DVec3::Y * 0.1, right: DVec3::X * 0.3, up: DVec3::Z * 0.2 };
    let n = 200;
    let at = |i: u32| (f64::from(i) + 0.5) * 2.0 / f64::from(n) - 1.0;
    let factors = (0..n * n).map(|i| lamp.form_factor(dvec3(at(i % n), 0.0, at(i / n)), DVec3::Y));
    let arriving = std::f64::consts::PI * 30.0 * factors.sum::<f64>() * (2.0 / f64::from(n)).powi(2);
    let share = reflected / (sent_on(&scene, 0).x * arriving);
    println!("{reflected:.4} lm reflected of {arriving:.4}: {share:.4} of the expected flux");
    assert!((share - 1.0).abs() < 0.01, "{share}");
}

#[test]
fn light_between_a_lamp_and_its_ceiling_stays_there() {
    // The lamp shines only upwards, 5 mm below the ceiling. The room gets only the light that leaks at the rim.
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    scene.lights.clear();
    let lamp = quad(vec3(-0.3, 1.995, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6, 0.6);
    let down = Knobs { size: [48, 48], ..small() };
    let light = |surface| {
        let mut scene = scene.clone();
        add(&mut scene, surface, shining(Vec3::splat(100.0)), DAffine3::IDENTITY);
        let shot = shoot(&gpu(), &scene, Some(&baked(&scene, 0.25, 8)), &down);
        shot.diffuse.iter().map(|d| d.y).sum::<f64>()
    };
    let (up, down) = (light(lamp.reversed()), light(lamp.clone()));
    println!("upwards: {:.4} of the indirect light of the lamp that shines downwards", up / down);
    assert!(down > 0.0 && up < 0.1 * down);
}

#[test]
fn the_largest_flat_surfaces_are_area_lights_and_the_rest_are_not_lost() {
    let gpu = gpu();
    let mut scene = Scene::default();
    let floor = quad(vec3(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, 0.5);
    add(&mut scene, floor, phong([0.7; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    // One mesh with twenty lamps of increasing size, and later a box. Each face of the box is an area light.
    let lamp = |i: usize| {
        let side = 0.05 * (1.0 + i as f32);
        quad(vec3(-2.5 + i as f32 * 0.25, 1.0, -1.0), Vec3::X * 0.2, Vec3::Z * side, 0.07)
    };
    let all = (0..20).map(lamp).reduce(lightskin::scene::build::Surface::and).expect("lamps");
    add(&mut scene, all, shining(Vec3::splat(10.0)), DAffine3::IDENTITY);
    let world = World::new(&gpu, &scene, None).expect("upload");
    assert_eq!(world.areas.len(), 16);
    let area = |light: &lightskin::frame::AreaLight| 4.0 * light.right.length() * light.up.length();
    let smallest = world.areas.iter().map(area).fold(f64::INFINITY, f64::min);
    assert!((smallest - 0.2 * 0.25).abs() < 1e-6, "the four smallest must be left out: {smallest}");
    for light in &world.areas {
        assert!(light.normal.distance(DVec3::NEG_Y) < 1e-6 && light.right.cross(light.up).dot(light.normal) > 0.0);
        assert!((light.radiance - 10.0).abs().max_element() < 1e-4);
    }
    let flat: f64 = world.areas.iter().map(|light| std::f64::consts::PI * light.radiance.x * area(light)).sum();
    let rest: f64 = world.emitters.iter().map(|val| f64::from(val.flux.x)).sum();
    let total = std::f64::consts::PI * 10.0 * (0..20).map(|i| 0.2 * 0.05 * (1.0 + f64::from(i))).sum::<f64>();
    println!("area lights {flat} lm, patches {rest} lm, expected sum {total} lm");
    assert!(((flat + rest) / total - 1.0).abs() < 1e-3 && rest > 0.0);

    scene.instances.truncate(1);
    let body = cuboid(vec3(0.0, 0.5, 0.0), vec3(0.4, 0.7, 0.2), 0.1, |_| true);
    let turn = DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 1.0);
    add(&mut scene, body, shining(Vec3::ONE), turn);
    let world = World::new(&gpu, &scene, None).expect("upload");
    assert_eq!(world.areas.len(), 6, "faces of a box");
    let middle = turn.transform_point3(dvec3(0.2, 0.6, 0.1));
    for light in &world.areas {
        let out = light.middle - middle;
        assert!(out.normalize().dot(light.normal) > 1.0 - 1e-5, "each must shine outwards");
    }
    assert!(world.emitters.is_empty());
}
