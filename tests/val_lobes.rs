//! Lobes of virtual lights: a surface that is lit at a grazing angle sends much of its light onwards, and caches receive it.

use glam::{DAffine3, Vec3, Vec4, dvec3, vec3};
use lightskin::frame::atlas::Atlas;
use lightskin::frame::gather::{Compute, ComputeKind, Gather, Lit};
use lightskin::frame::proxies::Proxies;
use lightskin::frame::settings::Ways;
use lightskin::frame::vals::Vals;
use lightskin::frame::{LightShadows, Near, Shadows};
use lightskin::lab::knobs::Knobs;
use lightskin::lab::shot::gather_sums;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::quad;
use lightskin::scene::{LightKind, Material, Scene};
use lightskin::shared;

use crate::common::frames::{add, baked, camera, lamp, phong, shoot, small};
use crate::common::{assert_clean, gpu};

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

/// A lobe is never brighter than GGX can be, where light comes and goes along the surface and its cosines are bounded.
#[test]
fn lobes_along_a_surface_are_finite() {
    const CACHES: u32 = 4000;
    let gpu = gpu();
    // Light arrives at a floor almost along +X. Caches stand where it leaves the floor again, at the same small height.
    const HEIGHT: f32 = 0.005;
    let caches: Vec<shared::Cache> = (0..CACHES)
        .map(|i| {
            let angle = 0.03 * i as f32 / CACHES as f32;
            let position = vec3(angle.cos(), angle.sin(), HEIGHT);
            shared::Cache { position, normal: -Vec3::X, exponent: 1.0, area: 1.0, ..shared::Cache::default() }
        })
        .collect();
    let to_light = vec3(-1.0, 0.0, HEIGHT).normalize();
    let on = to_light / to_light.abs().element_sum();
    let [x, y] = [on.x, on.y].map(|e| ((e * 0.5 + 0.5) * 511.0 + 0.5) as u32);
    let atlas = Atlas::of(&gpu, &caches).expect("caches");
    let lit_by = |roughness_step: u32| {
        let shape = (64 + 15) << 23 | roughness_step << 18 | y << 9 | x; // F0 of 1
        let flux = f32::from_bits(129 << 23 | 127 << 16 | 128 << 8 | 128); // 1 lm in red
        let val = shared::Val { area: 1e-6, normal: Vec3::Z, kind: shape, weight: flux, ..shared::Val::default() };
        let vals = Vals::of(&gpu, &[val]).expect("VALs");
        let proxies = Proxies::new(&gpu, CACHES, true, 1).expect("proxies");
        let kind = ComputeKind { near: 0.1, lobes: true, ..ComputeKind::plain(true) };
        let stage = Compute::new(&gpu, CACHES, 1, &Ways::default(), kind).expect("stage 6");
        let stage = Gather::Compute(Box::new(stage));
        let eyes = [Vec4::new(0.0, 0.0, 9.0, 1.0)];
        let lit = Lit { vals: &vals, atlas: &atlas, proxies: &proxies, eyes: &eyes, albedos: None, sky: None };
        let drawn = gpu.frame(|cmd| {
            stage.record(cmd, &lit);
            Ok(())
        });
        assert_eq!(drawn.expect("drawn").problems, [""; 0]);
        gather_sums(&gpu, &stage, CACHES).expect("sums")
    };
    for step in 11..=31 {
        let alpha2 = (f64::from(step) / 31.0).max(0.35).powi(4);
        let cosine = 0.01_f64; // the least that the shader takes
        let seen = 2.0 * cosine * (alpha2 + (1.0 - alpha2) * cosine * cosine).sqrt();
        let most = 0.5 / (alpha2 * seen) * f64::from(HEIGHT) / std::f64::consts::PI;
        let found: Vec<f64> = lit_by(step).iter().map(|sum| f64::from(sum.diffuse_irradiance.x)).collect();
        let largest = found.iter().copied().fold(0.0, f64::max);
        println!("roughness {:.2}: at most {largest:.3} lx, bound {most:.3} lx", f64::from(step) / 31.0);
        assert!(found.iter().all(|e| e.is_finite() && *e > 0.0 && *e < 1.01 * most), "{largest} of {most} lx");
        assert!(largest > 0.1 * most, "{largest} of {most} lx");
    }
    assert_clean(&gpu);
}
