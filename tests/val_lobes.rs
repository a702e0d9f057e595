//! Lobes of virtual lights: a surface that is lit at a grazing angle sends much of its light onwards, and caches receive it.

use glam::{DAffine3, Vec3, dvec3, vec3};
use lightskin::frame::{LightShadows, Near, Shadows};
use lightskin::lab::knobs::Knobs;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::quad;
use lightskin::scene::{LightKind, Material, Scene};

use crate::common::frames::{add, baked, camera, lamp, phong, shoot, small};
use crate::common::gpu;

const SIZE: [u32; 2] = [48, 48];

/// A black floor beside a wall of a material, along which the sun shines, seen from above.
fn lit_wall(material: &Material) -> Scene {
    let mut scene = Scene::default();
    let matt = Material { specular: 0.0, roughness: 1.0, metallic: 0.0, ..Material::default() };
    add(&mut scene, quad(vec3(0.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 0.1), matt, DAffine3::IDENTITY);
    let wall = quad(vec3(0.0, 0.0, -1.0), Vec3::Y * 2.0, Vec3::Z * 2.0, 0.1);
    add(&mut scene, wall, material.clone(), DAffine3::IDENTITY);
    let mut sun = lamp(LightKind::Directional);
    sun.direction = vec3(-0.25, -0.6, -0.75).normalize();
    scene.lights.push(sun);
    scene.cameras.push(camera(dvec3(1.0, 3.0, 0.01), dvec3(1.0, 0.0, 0.0), 0.6));
    scene
}

/// Mean of a picture's green channel.
fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

#[test]
fn walls_lit_at_grazing_angles_light_the_floor_as_paths_do() {
    let gpu = gpu();
    let near = Near::Rays { per_pixel: 8, every: 2 };
    let maps = LightShadows::Maps(1024);
    let knobs = Knobs { size: SIZE, near, shadows: Shadows::PerLight, rsm: 128, light_shadows: maps, ..small() };
    let gltf = |color: f32, metallic, roughness| Material {
        base_color: vec3(color, color, color).extend(1.0),
        metallic,
        roughness,
        ..Material::default()
    };
    for (name, material, bound) in [
        ("matt", Material { specular: 0.0, ..gltf(0.5, 0.0, 1.0) }, 0.035),
        ("plaster", gltf(0.5, 0.0, 0.9), 0.05),
        ("stone", gltf(0.3, 0.0, 0.6), 0.08),
        ("paint", gltf(0.3, 0.0, 0.4), 0.06),
        ("black", gltf(0.02, 0.0, 0.5), 0.05),
        ("metal", gltf(0.8, 1.0, 0.5), 0.04),
        ("Phong", phong([0.3; 3], [0.3; 3], 15.0), 0.09),
    ] {
        let scene = lit_wall(&material);
        let caches = baked(&scene, 0.25, 8);
        let shot = shoot(&gpu, &scene, Some(&caches), &knobs);
        let found = mean(shot.diffuse.iter().map(|light| light.y));
        let [whole, diffuse] = [true, false].map(|glossy_bounces| {
            let settings = PathTraceSettings { glossy_bounces, ..PathTraceSettings::engine(SIZE, 1) };
            let mut paths = PathTrace::new(&scene, &scene.cameras[0], &settings);
            (0..8).for_each(|_| paths.pass());
            mean(paths.diffuse().iter().map(|light| f64::from(light[1])))
        });
        let [off, without] = [found, diffuse].map(|light| light / whole - 1.0);
        println!("{name}: {off:+.3} of the paths' light; a diffuse wall {without:+.3}");
        assert!(off.abs() < bound, "{name}: {off}");
        assert!(name == "matt" || without.abs() > 1.2 * off.abs(), "{name}: {off}, {without}");
    }
}
