//! The stage of scenes that come without one: camera, lights, ground and background.

use std::collections::HashSet;

use glam::{DAffine3, DVec3, Vec2, Vec3, dvec3, vec3};
use lightskin::bake::{self, BakeSettings, Density};
use lightskin::frame::LightShadows;
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::reference::path_trace::camera_ray;
use lightskin::reference::world::{Sides, World};
use lightskin::scene::build::{Surface, cuboid, lathe, quad, sphere};
use lightskin::scene::defaults::{self, Ground};
use lightskin::scene::rays::Rays;
use lightskin::scene::studio::{Backdrop, GROUND_ALBEDO};
use lightskin::scene::{Instance, LightKind, Material, Scene, write};

use crate::cli::{folder, works};
use crate::common::frames::{add, baked, camera, corner, lamp, phong, shoot, small};
use crate::common::gpu;

const SIZE: [u32; 2] = [96, 54];

fn grey() -> Material {
    phong([0.5; 3], [0.0; 3], 1.0)
}

/// A scene with one grey surface.
fn of(surface: Surface) -> Scene {
    let mut scene = Scene { name: "stage".into(), ..Scene::default() };
    add(&mut scene, surface, grey(), DAffine3::IDENTITY);
    scene
}

fn completed(mut scene: Scene) -> Scene {
    defaults::complete(&mut scene, Ground::Auto);
    scene
}

fn ground(scene: &Scene) -> Option<&Instance> {
    scene.instances.iter().find(|instance| instance.name == "ground")
}

/// An upside-down bowl, as deep as a helmet, with an outside and an inside.
fn helmet() -> Scene {
    let at = |radius: f32, step: i32| {
        let (sine, cosine) = (0.09 * step as f32).sin_cos();
        Vec2::new(radius * sine, radius * cosine)
    };
    let outside = (0..=24).rev().map(|step| at(1.0, step));
    let inside = (0..=24).map(|step| at(0.93, step));
    let profile: Vec<Vec2> = outside.chain(inside).chain([at(1.0, 24)]).collect();
    of(lathe(&profile, 32))
}

/// Solids that intersect, so that the scene's centre is inside a solid.
fn statue() -> Scene {
    let base = cuboid(vec3(-0.6, 0.0, -0.6), vec3(0.6, 0.4, 0.6), 1.0, |_| true);
    let body = cuboid(vec3(-0.3, 0.3, -0.25), vec3(0.3, 2.0, 0.25), 1.0, |_| true);
    let arms = cuboid(vec3(-0.8, 1.5, -0.15), vec3(0.8, 1.7, 0.15), 1.0, |_| true);
    of(base.and(body).and(arms).and(sphere(0.35, 10).shifted(0.0, 2.2, 0.0)))
}

fn plane(origin: Vec3, u: Vec3, v: Vec3) -> Scene {
    of(quad(origin, u, v, 1.0))
}

/// 125 cubes that share one mesh.
fn grid() -> Scene {
    let mut scene = of(cuboid(Vec3::splat(-0.3), Vec3::splat(0.3), 1.0, |_| true));
    scene.instances.clear();
    for i in 0..125 {
        let at = dvec3(f64::from(i % 5), f64::from(i / 5 % 5), f64::from(i / 25));
        let world_from_model = DAffine3::from_translation(at);
        scene.instances.push(Instance { name: format!("cube {i}"), world_from_model, ..Instance::default() });
    }
    scene
}

/// Walls and a roof, seen from outside.
fn building() -> Scene {
    let walls = cuboid(vec3(-4.0, 0.0, -3.0), vec3(4.0, 5.0, 3.0), 8.0, |_| true);
    let roof = cuboid(vec3(-4.5, 5.0, -3.5), vec3(4.5, 5.6, 3.5), 9.0, |_| true);
    of(walls.and(roof))
}

/// Spheres next to emissive labels.
fn sheet() -> Scene {
    let mut scene = Scene { name: "sheet".into(), ..Scene::default() };
    for row in 0..4 {
        let y = row as f32;
        let label = quad(vec3(-3.0, y - 0.2, 0.0), Vec3::X * 1.5, Vec3::Y * 0.4, 2.0);
        let shining = Material { emissive: Vec3::ONE, ..phong([0.0; 3], [0.0; 3], 1.0) };
        add(&mut scene, label, shining, DAffine3::IDENTITY);
        for column in 0..4 {
            let at = dvec3(f64::from(column) - 1.0, y.into(), 0.0);
            add(&mut scene, sphere(0.4, 8), grey(), DAffine3::from_translation(at));
        }
    }
    scene
}

/// A room of 6 x 3 x 4 m. Its walls have only an inside, or with `thick` also an outside.
fn room(thick: bool) -> Scene {
    let inside = cuboid(Vec3::ZERO, vec3(6.0, 3.0, 4.0), 1.0, |_| true).reversed();
    let outside = cuboid(Vec3::splat(-0.2), vec3(6.2, 3.2, 4.2), 1.0, |_| true);
    let table = cuboid(vec3(2.5, 0.0, 1.5), vec3(3.5, 0.8, 2.5), 1.0, |_| true);
    of(if thick { inside.and(outside) } else { inside }.and(table))
}

/// Fractions of the picture whose rays first hit a front, and a back, of the scene's own surfaces.
fn met(scene: &Scene) -> (f64, f64) {
    let world = World::new(scene);
    let pixels = (SIZE[0] * SIZE[1]) as usize;
    let hits: Vec<_> = (0..pixels)
        .filter_map(|pixel| {
            let (origin, direction) = camera_ray(&scene.cameras[0], SIZE, pixel);
            world.nearest(origin, direction, Sides::Both)
        })
        .collect();
    let own = |instance: usize| scene.instances[instance].name != "ground";
    let share =
        |front: bool| hits.iter().filter(|hit| hit.front == front && own(hit.instance)).count() as f64 / pixels as f64;
    (share(true), share(false))
}

/// Whether a point sees many backs, because it is inside a solid or behind walls.
fn sees_backs(scene: &Scene, point: DVec3) -> bool {
    let world = World::new(scene);
    let directions = (0..200).map(|i| {
        let y = 1.0 - (2 * i + 1) as f64 / 200.0;
        let (sine, cosine) = (f64::from(i) * 2.399_963).sin_cos();
        dvec3((1.0 - y * y).sqrt() * cosine, y, (1.0 - y * y).sqrt() * sine)
    });
    let hits: Vec<_> = directions.filter_map(|d| world.nearest(point, d, Sides::Both)).collect();
    3 * hits.iter().filter(|hit| !hit.front).count() > hits.len()
}

/// Mean luminance [cd/m^2] by direct light of the pixels that show a material, and the number of these pixels.
fn luminance(scene: &Scene, of: impl Fn(&Material) -> bool) -> (f64, usize) {
    let shot = shoot(
        &gpu(),
        scene,
        None,
        &Knobs { size: SIZE, gi: Gi::Off, light_shadows: LightShadows::Maps(512), ..small() },
    );
    let world = World::new(scene);
    let shown: Vec<f64> = (0..shot.direct.len())
        .filter(|pixel| {
            let (origin, direction) = camera_ray(&scene.cameras[0], SIZE, *pixel);
            let hit = world.nearest(origin, direction, Sides::Front);
            shot.covered[*pixel] && hit.is_some_and(|hit| of(&scene.materials[hit.material]))
        })
        .map(|pixel| shot.direct[pixel].dot(dvec3(0.2126, 0.7152, 0.0722)))
        .collect();
    (shown.iter().sum::<f64>() / shown.len().max(1) as f64, shown.len())
}

#[test]
fn objects_are_seen_from_outside_in_the_light_of_a_studio() {
    let up = |n: f32| Vec3::Y * n;
    let (x, z) = (Vec3::X, Vec3::Z);
    let both = || of(sphere(1.0, 12).and(sphere(0.98, 12).reversed()));
    for (name, scene) in [
        ("helmet", helmet()),
        ("statue", statue()),
        ("ball", of(sphere(1.0, 12))),
        ("hollow ball", both()),
        ("upright plane", plane(Vec3::ZERO, x, up(1.0))),
        ("plane from its back", plane(Vec3::ZERO, up(1.0), x)),
        ("plane from its side", plane(Vec3::ZERO, z, up(1.0))),
        ("lying plane", plane(Vec3::ZERO, z, x)),
        ("lying plane from below", plane(Vec3::ZERO, x, z)),
        ("grid", grid()),
        ("building", building()),
        ("sheet", sheet()),
    ] {
        let (low, high) = scene.bounds().expect("is not empty");
        let scene = completed(scene);
        let eye = scene.cameras[0].world_from_camera.translation;
        let (fronts, backs) = met(&scene);
        let (light, _) = luminance(&scene, |material| material.name != "ground" && material.emissive == Vec3::ZERO);
        println!("{name}: eye {eye:.3}, fronts {fronts:.3}, backs {backs:.3}, {light:.3} cd/m^2");
        assert!((eye - eye.clamp(low, high)).length() > 0.01 * (high - low).length(), "{name}: {eye} is not outside");
        assert!(fronts > 0.08 && backs < 0.05 * fronts, "{name}: fronts on {fronts} of the picture, backs on {backs}");
        assert!((0.05..2.0).contains(&light), "{name}: {light} cd/m^2");
        assert!(scene.lights.iter().all(|l| l.kind == LightKind::Directional), "{name}: {:?}", scene.lights);
        assert_eq!(scene.backdrop, Backdrop::Studio, "{name}");
        assert!(scene.notes.iter().any(|note| note.contains("studio")), "{name}: {:?}", scene.notes);
    }
}

#[test]
fn rooms_are_seen_from_inside_by_a_lamp_in_free_space() {
    let seen_within = || of(sphere(1.0, 12).reversed());
    for (name, scene) in [("walls", room(false)), ("thick walls", room(true)), ("a ball's inside", seen_within())] {
        let scene = completed(scene);
        let (eye, lamp) = (scene.cameras[0].world_from_camera.translation, scene.lights[0].position);
        let (fronts, backs) = met(&scene);
        let (light, _) = luminance(&scene, |_| true);
        println!("{name}: eye {eye:.3}, lamp {lamp:.3}, fronts {fronts:.3}, backs {backs:.3}, {light:.1} cd/m^2");
        assert!(fronts > 0.99 && backs == 0.0 && light > 1.0, "{name}: {fronts}, {backs}, {light} cd/m^2");
        assert!(!sees_backs(&scene, eye) && !sees_backs(&scene, lamp), "{name}: {eye} and {lamp}");
        assert!(scene.lights.len() == 1 && ground(&scene).is_none() && scene.sky.is_none(), "{name}");
    }
}

#[test]
fn samples_show_beside_labels_that_emit() {
    let scene = completed(sheet());
    let (samples, of_samples) = luminance(&scene, |m| m.emissive == Vec3::ZERO && m.name != "ground");
    let (labels, of_labels) = luminance(&scene, |m| m.emissive != Vec3::ZERO);
    println!("samples {samples:.3} cd/m^2 ({of_samples} pixels), labels {labels:.3} ({of_labels})");
    assert!(of_samples > 100 && of_labels > 50);
    assert!(samples > 0.1 * labels, "{samples} beside {labels} cd/m^2");
}

#[test]
fn a_room_that_its_surfaces_light_gets_no_other_light() {
    let mut scene = room(false);
    let shining = Material { emissive: Vec3::splat(100.0), ..grey() };
    add(&mut scene, quad(vec3(2.0, 2.9, 1.0), Vec3::X * 2.0, Vec3::Z * 2.0, 2.0), shining, DAffine3::IDENTITY);
    let scene = completed(scene);
    assert!(scene.lights.is_empty() && ground(&scene).is_none() && scene.behind().is_none());
}

#[test]
fn white_in_the_studio_is_near_one_candela_for_a_square_metre() {
    let scene = completed(of(sphere(1.0, 12)));
    let sky = scene.sky.as_ref().expect("a studio");
    let lights = || &scene.lights[sky.lights.clone()];
    let sent: f64 = lights().iter().map(|l| f64::from(l.intensity) * f64::from((-l.direction.y).max(0.0))).sum();
    println!("{:.4} lx from the map, {sent:.4} lx from {} lights", sky.received(DVec3::Y).x, lights().len());
    assert!((sky.received(DVec3::Y).x / std::f64::consts::PI - 1.0).abs() < 1e-5);
    assert!((sent / std::f64::consts::PI - 1.0).abs() < 0.06, "{sent} lx");
}

#[test]
fn a_ground_is_put_under_what_has_none() {
    let floor = || quad(vec3(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, 1.0);
    let on_floor = of(floor().and(cuboid(vec3(-0.5, 0.0, -0.5), vec3(0.5, 1.0, 0.5), 1.0, |_| true)));
    let lit = |mut scene: Scene| {
        scene.lights.push(lamp(LightKind::Point));
        scene
    };
    for (name, scene, height) in [
        ("ball", of(sphere(1.0, 12)), Some(-1.0)),
        ("upright plane", plane(Vec3::ZERO, Vec3::X, Vec3::Y), Some(0.0)),
        ("lying plane", of(floor()), None),
        ("box on a floor", on_floor, None),
        ("ball with a light of its own", lit(of(sphere(1.0, 12))), None),
    ] {
        let radius = scene.bounds().map_or(0.0, |(low, high)| 0.5 * low.distance(high));
        let found = completed(scene.clone());
        let at = ground(&found).map(|ground| ground.world_from_model.translation.y);
        assert_eq!(at.is_some(), height.is_some(), "{name}: {at:?}");
        if let (Some(at), Some(height)) = (at, height) {
            assert!(at < height && at > height - 1e-3 * radius, "{name}: {at}");
        }
        for wanted in [Ground::Off, Ground::At(-3.5)] {
            let mut scene = scene.clone();
            defaults::complete(&mut scene, wanted);
            let at = ground(&scene).map(|ground| ground.world_from_model.translation.y);
            assert_eq!(at, if wanted == Ground::Off { None } else { Some(-3.5) }, "{name}");
        }
    }
}

#[test]
fn a_ground_takes_few_caches() {
    let settings = BakeSettings { density: Density::Count(600), angle: 1.0, references: 8 };
    let scene = completed(of(sphere(1.0, 24)));
    let caches = bake::bake(&scene, &settings, &|_, _| ()).expect("bakes");
    let [object, ground] = [0, 1].map(|instance| caches.models[caches.instance_model[instance]].caches.len());
    println!("{object} on the ball, {ground} on the ground");
    assert!(ground > 20 && ground < object / 2, "{object} and {ground}");
    // These caches stand for the whole ground.
    let model = &caches.models[caches.instance_model[1]];
    let share: f64 = model.caches.iter().map(|cache| f64::from(cache.area)).sum();
    assert!(scene.meshes[scene.instances[1].mesh].placing.is_some(), "is sparse");
    let radius = scene.instances[1].world_from_model.matrix3.x_axis.length();
    assert!((share / (std::f64::consts::PI * radius * radius) - 1.0).abs() < 0.1, "{share} m^2");
}

/// The edge of the ground is invisible, because the backdrop continues with its radiance.
#[test]
fn the_backdrop_is_the_grounds_below_the_horizon() {
    let mut scene = completed(of(sphere(1.0, 12)));
    scene.cameras = vec![camera(dvec3(0.0, 3.0, 9.0), dvec3(0.0, -1.0, 0.0), 1.2)];
    let caches = baked(&scene, 0.5, 8);
    let shot = shoot(&gpu(), &scene, Some(&caches), &Knobs { size: SIZE, ..small() });
    let sky = scene.sky.as_ref().expect("a studio");
    let expected = sky.received(DVec3::Y).x * f64::from(GROUND_ALBEDO) / std::f64::consts::PI;
    let world = World::new(&scene);
    let (mut on_ground, mut beyond) = (0, 0);
    for (pixel, shown) in shot.direct.iter().enumerate() {
        let (origin, direction) = camera_ray(&scene.cameras[0], SIZE, pixel);
        let hit = world.nearest(origin, direction, Sides::Front);
        let at = hit.map(|hit| origin + hit.distance * direction);
        // Near the edge of the ground, little of the sky is hidden.
        let is_ground = hit.is_some_and(|hit| hit.instance == 1) && at.is_some_and(|at| at.z > 2.5);
        let is_beyond = hit.is_none() && !shot.covered[pixel] && direction.y < -0.06;
        on_ground += usize::from(is_ground && (shown.x / expected - 1.0).abs() < 0.03);
        if is_beyond {
            beyond += 1;
            assert!((shown.x / expected - 1.0).abs() < 1e-4, "{} instead of {expected} cd/m^2", shown.x);
        }
    }
    println!("{on_ground} pixels of the ground and {beyond} beyond it at {expected:.4} cd/m^2");
    assert!(on_ground > 100 && beyond > 100, "{on_ground} and {beyond}");
}

#[test]
fn scenes_with_a_camera_and_lights_stay_as_they_are() {
    let mut scene = corner(&[LightKind::Point], 20.0);
    let before = (scene.fingerprint(), scene.bounds(), scene.backdrop);
    defaults::complete(&mut scene, Ground::Auto);
    assert_eq!((scene.fingerprint(), scene.bounds(), scene.backdrop), before);
    assert!(scene.notes.is_empty() && scene.sky.is_none() && scene.behind().is_none(), "{:?}", scene.notes);
}

#[test]
fn backgrounds_are_what_the_flags_say() {
    let folder = folder("backgrounds");
    let scene = of(sphere(1.0, 10));
    write::write_glb(&scene, &folder.join("ball.glb")).expect("is written");
    let mut flags = vec!["render", "ball.glb", "--size", "48x27", "--rsm", "16", "--shadow-map", "128"];
    flags.extend(["--caches", "40", "--ground", "off", "--near", "off", "--bounces", "1"]);
    let png = |name: &str, more: &[&str]| {
        works(&folder, &[&flags[..], &["-o", name], more].concat());
        image::open(folder.join(name)).expect("is a picture").into_rgba8()
    };
    for gi in ["lightskin", "path-trace"] {
        let gi = ["--gi", gi, "--spp", "16"];
        let with = |name: &str, background: &str| png(name, &[&gi[..], &["--background", background]].concat());
        let clear = with("clear.png", "transparent");
        let alphas: HashSet<u8> = clear.pixels().map(|p| p.0[3]).collect();
        assert!(alphas.len() > 4, "{alphas:?}: outlines must be smooth");
        let sharp = png("sharp.png", &[&gi[..], &["--background", "transparent", "--aa", "off"]].concat());
        assert_eq!(sharp.pixels().map(|p| p.0[3]).collect::<HashSet<u8>>(), HashSet::from([0, 255]));
        assert_eq!((clear.get_pixel(0, 0).0[3], clear.get_pixel(24, 13).0[3]), (0, 255));
        assert_eq!(with("colour.png", "1,0.4,0").get_pixel(0, 0).0, [255, 102, 0, 255]);
        let (studio, plain) = (with("studio.png", "studio"), png("plain.png", &gi));
        assert_eq!(studio, plain, "the studio must be the default");
        assert!(studio.get_pixel(0, 26).0[0] > 30, "{:?}", studio.get_pixel(0, 26));
        assert_ne!(with("sky.png", "sky"), studio);
    }
    works(&folder, &[&flags[..], &["-o", "clear.exr", "--background", "transparent"]].concat());
    let alpha = lightskin::image::read_picture(&folder.join("clear.exr"), Some("A")).expect("has alpha");
    assert_eq!((alpha.rgb[0][0], alpha.rgb[13 * 48 + 24][0]), (0.0, 1.0));
}

#[test]
fn very_many_triangles_in_one_place_are_no_work() {
    // In one scene a far rectangle makes all other triangles a point in comparison. In another the same triangles occur
    // very often.
    let sheet = of(quad(Vec3::ZERO, Vec3::X, Vec3::Y, 0.004));
    let mut apart = sheet.clone();
    let far = quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0);
    let place = DAffine3::from_translation(dvec3(0.0, 0.0, 1e17)) * DAffine3::from_scale(DVec3::splat(1e17));
    add(&mut apart, far, grey(), place);
    let mut same = of(quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0));
    let mesh = &mut same.meshes[0];
    mesh.indices = mesh.indices.repeat(100_000);
    mesh.primitives[0].index_count = mesh.indices.len() as u32;
    for (scene, distance) in [(sheet, 1.0), (apart, 1e17), (same, 1.0)] {
        assert!(scene.triangle_count() > 100_000);
        let met = Rays::new(&scene).nearest(distance * dvec3(0.6, 0.3, 2.0), DVec3::NEG_Z);
        assert!(met.is_some_and(|hit| hit.distance > 0.9 * distance), "{met:?}");
    }
}
