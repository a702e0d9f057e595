//! Bodies of glass, which bend light: rays through them against closed forms and the path tracer.

use glam::{Affine2, DAffine3, DMat3, DVec2, DVec3, Vec2, Vec3, Vec3Swizzles, Vec4, dvec3, vec3};
use lightskin::frame::{Antialiasing, LightShadows, Near, Shadows};
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::metrics::metrics;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::{cuboid, quad, sphere};
use lightskin::scene::gltf::load;
use lightskin::scene::sky::Sky;
use lightskin::scene::write::write_glb;
use lightskin::scene::{Image, LightKind, Material, Sampler, Scene, Texture};

use crate::common::frames::{add, baked, camera, lamp, phong, shoot, small};
use crate::common::gpu;

/// Glass without highlights.
fn glass(ior: f32, thickness: f32, attenuation: Vec3) -> Material {
    Material {
        metallic: 0.0,
        roughness: 0.05,
        specular: 0.0,
        transmission: 1.0,
        alpha_cutoff: Some(f32::INFINITY),
        ior,
        thickness,
        attenuation,
        ..Material::default()
    }
}

/// A wall behind a slab that the camera looks through at an angle. The wall emits `(1, 2, 3)`.
fn slab(double_sided: bool) -> (Scene, DVec3, DVec3) {
    let mut scene = Scene::default();
    let wall = quad(vec3(-9.0, -9.0, -2.0), Vec3::X * 18.0, Vec3::Y * 18.0, 18.0);
    add(
        &mut scene,
        wall,
        Material { emissive: vec3(1.0, 2.0, 3.0), ..phong([0.0; 3], [0.0; 3], 1.0) },
        DAffine3::IDENTITY,
    );
    let body = cuboid(vec3(-5.0, -5.0, -0.5), vec3(5.0, 5.0, 0.5), 10.0, |_| true);
    add(&mut scene, body, Material { double_sided, ..glass(1.5, 1.0, vec3(0.0, 0.5, 2.0)) }, DAffine3::IDENTITY);
    let (eye, target) = (dvec3(2.0, 1.0, 3.0), dvec3(0.4, 0.2, 0.5));
    scene.cameras.push(camera(eye, target, 0.01));
    (scene, eye, target)
}

#[test]
fn a_slab_shifts_and_dims_by_the_closed_form() {
    let (scene, eye, target) = slab(false);
    let size = [1, 1];
    let paths = PathTrace::new(
        &scene,
        &scene.cameras[0],
        &PathTraceSettings { bounces: Some(0), ..PathTraceSettings::of(size) },
    );
    let met = paths.surfaces()[0].expect("the wall").position;
    // Snell: sin inside = sin outside / 1.5. The ray crosses 1 m of glass and 1.5 m of air behind.
    let way = (target - eye).normalize();
    let outside = DVec2::new(way.x, way.y);
    let inside = outside / 1.5;
    let cosine = (1.0 - inside.length_squared()).sqrt();
    let expected = DVec2::new(target.x, target.y) + inside / cosine + 1.5 * outside / -way.z;
    println!("met at {met}, in closed form {expected}");
    assert!(DVec2::new(met.x, met.y).abs_diff_eq(expected, 1e-5));
    let left = DVec3::new(1.0, (-0.5 / cosine).exp(), (-2.0 / cosine).exp()) * dvec3(1.0, 2.0, 3.0);
    let shown = shoot(&gpu(), &scene, None, &Knobs { gi: Gi::Off, size, ..small() }).direct[0];
    println!("shown {shown}, in closed form {left}");
    assert!(shown.abs_diff_eq(left, 2e-3) && DVec3::from(paths.direct()[0].map(f64::from)).abs_diff_eq(left, 1e-5));
}

/// Two balls and a box of glass on a floor with a pattern, and bodies and a film behind them.
fn table() -> Scene {
    let mut scene = Scene::default();
    let pattern = |i: usize| if (i + i / 8).is_multiple_of(2) { [230, 230, 230, 255] } else { [80, 60, 150, 255] };
    let rgba = (0..64).flat_map(pattern).collect();
    scene.images.push(Image { name: "pattern".into(), width: 8, height: 8, rgba });
    let sampler = Sampler { nearest: true, ..Sampler::default() };
    let texture = Texture { image: 0, uv_set: 0, transform: Affine2::from_scale(Vec2::splat(0.25)), sampler };
    let floor = Material { base_color_texture: Some(texture), ..phong([1.0; 3], [0.0; 3], 1.0) };
    let mut plane = quad(vec3(-4.0, 0.0, 3.0), Vec3::X * 8.0, Vec3::NEG_Z * 6.0, 0.5);
    plane.vertices.iter_mut().for_each(|vertex| vertex.uv0 = vertex.position.xz());
    add(&mut scene, plane, floor, DAffine3::IDENTITY);
    let at = |x: f64, y: f64, z: f64| DAffine3::from_translation(dvec3(x, y, z));
    add(&mut scene, sphere(0.6, 48), glass(1.5, 1.0, Vec3::ZERO), at(-1.3, 0.65, 0.0));
    let tinted = Material { base_color: Vec4::new(0.8, 1.0, 0.9, 1.0), ..glass(1.33, 1.0, Vec3::ZERO) };
    add(&mut scene, sphere(0.6, 48), tinted, at(1.3, 0.65, -0.2));
    let body = cuboid(vec3(-0.4, 0.0, -0.4), vec3(0.4, 0.8, 0.4), 1.0, |_| true);
    let turned = at(0.0, 0.02, 0.2) * DAffine3::from_rotation_y(0.6);
    add(&mut scene, body, glass(1.5, 0.8, vec3(0.2, 1.8, 3.2)), turned);
    let red = cuboid(vec3(-0.4, 0.0, -0.4), vec3(0.4, 0.8, 0.4), 1.0, |_| true);
    add(&mut scene, red, phong([0.8, 0.1, 0.1], [0.0; 3], 1.0), at(-0.7, 0.0, -1.6));
    add(&mut scene, sphere(0.5, 32), phong([0.1, 0.5, 0.2], [0.0; 3], 1.0), at(0.9, 0.5, -1.9));
    let back = quad(vec3(-4.0, 0.0, -3.0), Vec3::X * 8.0, Vec3::Y * 4.0, 0.5);
    add(&mut scene, back, phong([0.6; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    // Seen straight on and through the box.
    let film = Material {
        base_color: Vec4::new(0.2, 0.7, 0.3, 0.4),
        blend: true,
        alpha_cutoff: Some(0.5),
        ..phong([1.0; 3], [0.0; 3], 1.0)
    };
    add(&mut scene, quad(vec3(-0.9, 0.1, -1.0), Vec3::X * 1.2, Vec3::Y * 0.7, 0.5), film, DAffine3::IDENTITY);
    let mut bulb = lamp(LightKind::Point);
    bulb.position = dvec3(1.0, 3.0, 2.0);
    scene.lights = vec![bulb];
    scene.cameras.push(camera(dvec3(0.0, 1.6, 4.2), dvec3(0.0, 0.5, 0.0), 0.6));
    scene
}

#[test]
fn bodies_show_what_paths_find() {
    let mut moving = table();
    let glass = (0..moving.instances.len()).filter(|i| moving.materials[*i].is_solid()).collect::<Vec<_>>();
    for i in glass {
        moving.instances[i].moves = true;
        moving.instances[i].world_from_model.matrix3 *= DMat3::from_diagonal(dvec3(-1.0, 1.1, 1.0));
    }
    for (name, scene) in [("still", table()), ("moving and mirrored", moving)] {
        let size = [160, 120];
        let settings = PathTraceSettings { bounces: Some(0), ..PathTraceSettings::of(size) };
        let truth = PathTrace::new(&scene, &scene.cameras[0], &settings).direct();
        let knobs = Knobs { gi: Gi::Off, size, light_shadows: LightShadows::Rays, ..small() };
        let shown = shoot(&gpu(), &scene, None, &knobs).direct;
        let differs = |(shown, truth): (&DVec3, &[f32; 3])| {
            let truth = DVec3::from(truth.map(f64::from));
            shown.distance(truth) > 0.02 * truth.max_element() + 1e-3
        };
        let count = shown.iter().zip(&truth).filter(|pair| differs(*pair)).count();
        println!("{name}: {count} of {} pixels differ by more than 2 %", shown.len());
        assert!(count < shown.len() / 500);
    }
}

#[test]
fn a_double_sided_body_bends_like_a_single_sided_one() {
    let [one, two] = [false, true].map(|double_sided| {
        let (scene, ..) = slab(double_sided);
        let path = std::env::temp_dir().join(format!("lightskin_slab_{double_sided}_{}.glb", std::process::id()));
        write_glb(&scene, &path).expect("written");
        // Reading adds the second sides.
        let read = load(&path).expect("read");
        std::fs::remove_file(&path).expect("was there");
        shoot(&gpu(), &read, None, &Knobs { gi: Gi::Off, size: [1, 1], ..small() }).direct[0]
    });
    assert!(one.y > 1.0 && one.abs_diff_eq(two, 1e-6), "{one} is not {two}");
}

#[test]
fn a_thickness_texture_makes_a_sheet_where_it_is_0() {
    let (mut scene, eye, target) = slab(false);
    scene.images.push(Image { name: "thin".into(), width: 1, height: 1, rgba: vec![255, 0, 255, 255] });
    let texture = Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler: Sampler::default() };
    scene.materials.iter_mut().filter(|m| m.is_solid()).for_each(|m| m.thickness_texture = Some(texture));
    let size = [1, 1];
    let settings = PathTraceSettings { bounces: Some(0), ..PathTraceSettings::of(size) };
    let paths = PathTrace::new(&scene, &scene.cameras[0], &settings);
    let met = paths.surfaces()[0].expect("the wall").position;
    let straight = eye + (target - eye) * ((eye.z + 2.0) / (eye.z - target.z));
    let shown = shoot(&gpu(), &scene, None, &Knobs { gi: Gi::Off, size, ..small() }).direct[0];
    assert!(met.abs_diff_eq(straight, 1e-5), "{met} is not {straight}");
    assert!(shown.abs_diff_eq(dvec3(1.0, 2.0, 3.0), 5e-3), "{shown}");
}

/// A sky that is brighter at the top.
fn under_a_sky(mut scene: Scene) -> Scene {
    let row = |i: usize| Vec3::new(60.0, 80.0, 100.0) * (8 - i / 16) as f32;
    Sky::new(16, 8, (0..128).map(row), 0.0).put_over(&mut scene, 16);
    scene
}

#[test]
fn surfaces_behind_glass_have_the_light_of_paths() {
    for (kind, scene, limits) in [
        ("lamp", table(), [[0.01, 0.01], [0.1, 0.1]]),
        ("sky", under_a_sky(Scene { lights: Vec::new(), ..table() }), [[0.1, 0.1], [0.1, 0.1]]),
    ] {
        let size = [120, 90];
        let mut paths = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::of(size));
        (0..10).for_each(|_| paths.pass());
        let knobs = Knobs {
            size,
            bounces: 4,
            shadows: Shadows::PerLight,
            near: Near::Rays { per_pixel: 8, every: 2 },
            light_shadows: LightShadows::Rays,
            rsm: 64,
            ..small()
        };
        let shot = shoot(&gpu(), &scene, Some(&baked(&scene, 0.4, 8)), &knobs);
        let settings = PathTraceSettings { bounces: Some(0), ..PathTraceSettings::of(size) };
        let materials = scene.materials.iter().map(|m| Material { transmission: 0.0, ..m.clone() }).collect();
        let opaque = Scene { materials, ..scene.clone() };
        let covers = PathTrace::new(&opaque, &scene.cameras[0], &settings).surfaces();
        let is_glass =
            |i: &usize| covers[*i].is_some_and(|s| s.reflection.base.min_element() >= 0.8 && s.position.y > 0.01);
        let pixels: Vec<usize> = (0..covers.len()).filter(is_glass).collect();
        assert!(pixels.len() > 500);
        let layers = [("direct", &shot.direct, paths.direct()), ("diffuse", &shot.diffuse, paths.diffuse())];
        for ((name, shown, truth), [bias, error]) in layers.into_iter().zip(limits) {
            let shown: Vec<[f32; 3]> = pixels.iter().map(|&i| shown[i].as_vec3().to_array()).collect();
            let truth: Vec<[f32; 3]> = pixels.iter().map(|&i| truth[i]).collect();
            let m = metrics(&shown, &truth);
            let (count, relmse) = (pixels.len(), m.relmse_trimmed);
            println!("{kind}, {name} in {count} pixels of glass: bias {:+.4}, trimmed relMSE {relmse:.4}", m.bias);
            assert!(m.bias.abs() < bias && relmse < error, "{kind}, {name}: {m:?}");
        }
    }
}

#[test]
fn every_kind_of_frame_with_bodies_is_clean() {
    for scene in [table(), under_a_sky(table())] {
        let caches = baked(&scene, 0.8, 8);
        for antialiasing in [Antialiasing::Off, Antialiasing::Four] {
            for gi in [Gi::Off, Gi::BruteForce, Gi::LightSkin] {
                for (near, shadows, bounces) in
                    [(Near::Off, Shadows::Off, 1), (Near::Rays { per_pixel: 8, every: 2 }, Shadows::PerLight, 3)]
                {
                    let knobs = Knobs { gi, antialiasing, near, shadows, bounces, size: [24, 18], ..small() };
                    if knobs.go_together() {
                        shoot(&gpu(), &scene, Some(&caches), &knobs);
                    }
                }
            }
        }
    }
}
