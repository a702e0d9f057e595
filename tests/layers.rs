//! Transparent surfaces: layers against sums in closed form and against the path tracer, whose rays pass through them.

use glam::{Affine2, DAffine3, DVec3, Vec3, Vec4, dvec3, vec3};
use lightskin::frame::{Antialiasing, LightShadows, Near, Shadows};
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::metrics::metrics;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::{CornellSurface, cornell, quad};
use lightskin::scene::gltf::load;
use lightskin::scene::write::write_glb;
use lightskin::scene::{Image, LightKind, Material, Sampler, Scene, Texture};

use crate::cli::{folder, works};
use crate::common::frames::{add, baked, camera, lamp, phong, shoot, small};
use crate::common::gpu;

/// Adds an emissive square in front of the camera that covers the fraction `alpha` of the light behind it.
fn pane(scene: &mut Scene, z: f32, color: Vec3, alpha: f32) {
    let square = quad(vec3(-1.0, -1.0, z), Vec3::X * 2.0, Vec3::Y * 2.0, 2.0);
    let dark = phong([0.0; 3], [0.0; 3], 1.0);
    let material = Material {
        emissive: color,
        blend: true,
        base_color: Vec4::new(0.0, 0.0, 0.0, alpha),
        alpha_cutoff: Some(0.5),
        ..dark
    };
    add(scene, square, material, DAffine3::IDENTITY);
}

/// Panes one behind another, and their colours and alphas from the farthest to the nearest.
fn panes(order: &[usize]) -> (Scene, Vec<(DVec3, f64)>) {
    let all: Vec<(Vec3, f32)> = (0..8_u8)
        .map(|i| (vec3(f32::from(i % 3), f32::from(i % 2) * 2.0, 3.0 - f32::from(i) / 3.0), 0.1 + 0.1 * f32::from(i)))
        .collect();
    let mut scene = Scene::default();
    for &i in order {
        let (color, alpha) = all[i];
        pane(&mut scene, 0.1 * i as f32, color, alpha);
    }
    // A pane behind a wall is not visible through other panes.
    pane(&mut scene, -2.0, Vec3::splat(50.0), 0.5);
    let wall = quad(vec3(-3.0, -3.0, -1.0), Vec3::X * 6.0, Vec3::Y * 6.0, 6.0);
    let wall_light = Material { emissive: vec3(5.0, 7.0, 9.0), ..phong([0.0; 3], [0.0; 3], 1.0) };
    add(&mut scene, wall, wall_light, DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.0, 0.0, 4.0), DVec3::ZERO, 0.5));
    (scene, all.into_iter().map(|(color, alpha)| (color.as_dvec3(), f64::from(alpha))).collect())
}

/// Direct light alone, at the centres of pixels.
fn direct(size: [u32; 2], layers: u32) -> Knobs {
    Knobs { gi: Gi::Off, size, layers, ..small() }
}

#[test]
fn eight_layers_are_laid_over_each_other_in_any_order() {
    for order in [[0, 1, 2, 3, 4, 5, 6, 7], [7, 6, 5, 4, 3, 2, 1, 0], [3, 0, 7, 1, 6, 2, 5, 4]] {
        let (scene, panes) = panes(&order);
        let expected = panes.iter().fold(dvec3(5.0, 7.0, 9.0), |behind, (color, alpha)| behind.lerp(*color, *alpha));
        let shown = shoot(&gpu(), &scene, None, &direct([9, 9], 8)).direct[40];
        println!("{order:?}: {shown:.5}, in closed form {expected:.5}");
        assert!(shown.abs_diff_eq(expected, 1e-3 * expected.max_element()), "{shown} is not {expected}");
    }
}

#[test]
fn the_nearest_layers_show_where_there_are_more() {
    let (scene, panes) = panes(&[0, 1, 2, 3, 4, 5, 6, 7]);
    for layers in [0, 1, 4, 12] {
        let over = |behind: DVec3, (color, alpha): &(DVec3, f64)| behind.lerp(*color, *alpha);
        let expected = panes[8 - layers.min(8) as usize..].iter().fold(dvec3(5.0, 7.0, 9.0), over);
        let shown = shoot(&gpu(), &scene, None, &direct([9, 9], layers)).direct[40];
        assert!(shown.abs_diff_eq(expected, 1e-3 * expected.max_element()), "{layers}: {shown} is not {expected}");
    }
}

/// The glossy Cornell box with a red glass pane, a blended pane, and another glass pane behind the boxes.
pub(crate) fn glazed() -> Scene {
    let mut scene = cornell(CornellSurface::Glossy, 0.1);
    let texel = [200, 150, 0, 255];
    scene.images.push(Image { name: "texel".into(), width: 1, height: 1, rgba: texel.to_vec() });
    let texture = Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler: Sampler::default() };
    let clear = Material {
        base_color: Vec4::new(1.0, 0.5, 0.4, 1.0),
        metallic: 0.0,
        roughness: 0.3,
        transmission: 0.9,
        alpha_cutoff: Some(f32::INFINITY),
        ..Material::default()
    };
    // Glass that is clear only in places blocks light.
    let glass = Material { transmission_texture: Some(texture), alpha_cutoff: None, ..clear.clone() };
    let film = Material {
        base_color: Vec4::new(0.2, 0.7, 0.3, 0.4),
        metallic: 0.0,
        roughness: 0.6,
        blend: true,
        alpha_cutoff: Some(0.5),
        ..Material::default()
    };
    let upright = |x: f32, z: f32| quad(vec3(x, 0.3, z), Vec3::X * 0.7, Vec3::Y * 1.1, 0.1);
    add(&mut scene, upright(-0.4, 0.45), glass, DAffine3::from_scale(DVec3::new(2.0, 1.0, 2.0)));
    add(&mut scene, upright(-0.4, 0.7), film, DAffine3::IDENTITY);
    add(&mut scene, upright(0.1, -0.95), clear, DAffine3::IDENTITY);
    scene
}

#[test]
fn glass_has_the_light_of_paths() {
    let scene = glazed();
    let size = [120, 90];
    let settings = PathTraceSettings { glossy_bounces: true, ..PathTraceSettings::engine(size, 1) };
    let mut paths = PathTrace::new(&scene, &scene.cameras[0], &settings);
    (0..10).for_each(|_| paths.pass());
    let knobs = Knobs {
        size,
        shadows: Shadows::PerLight,
        near: Near::Rays { per_pixel: 8, every: 2 },
        light_shadows: LightShadows::Rays,
        rsm: 128,
        ..small()
    };
    let shot = shoot(&gpu(), &scene, Some(&baked(&scene, 0.15, 8)), &knobs);
    let layers = [
        ("direct", shot.direct, paths.direct(), [0.001, 0.001]),
        ("diffuse", shot.diffuse, paths.diffuse(), [0.01, 0.03]),
        ("glossy", shot.glossy, paths.glossy(), [0.1, 0.4]),
    ];
    for (name, shown, truth, [bias, error]) in layers {
        let shown: Vec<[f32; 3]> = shown.iter().map(|p| p.as_vec3().to_array()).collect();
        let m = metrics(&shown, &truth);
        println!("{name}: bias {:+.4}, relMSE without the worst 1 % {:.4}", m.bias, m.relmse_trimmed);
        assert!(m.bias.abs() < bias && m.relmse_trimmed < error, "{name}: {m:?}");
    }
}

#[test]
fn every_kind_of_frame_is_clean() {
    let scene = glazed();
    let dark = Scene { lights: Vec::new(), ..glazed() };
    let caches = baked(&scene, 0.6, 8);
    for scene in [&scene, &dark] {
        for antialiasing in [Antialiasing::Off, Antialiasing::Fast, Antialiasing::Four] {
            for light_shadows in [LightShadows::Rays, LightShadows::Maps(64)] {
                for gi in [Gi::Off, Gi::BruteForce, Gi::LightSkin] {
                    let knobs = Knobs { gi, light_shadows, antialiasing, ..direct([20, 14], 2) };
                    let shot = shoot(&gpu(), scene, Some(&caches), &knobs);
                    assert!(scene.lights.is_empty() || shot.direct.iter().any(|p| *p != DVec3::ZERO), "{knobs:?}");
                }
            }
        }
    }
}

#[test]
fn light_goes_through_clear_glass() {
    // The sun shines through a pane onto a floor. The light under the pane is as bright as next to it.
    let mut scene = Scene::default();
    let white = || phong([0.7; 3], [0.0; 3], 1.0);
    add(&mut scene, quad(vec3(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, 0.5), white(), DAffine3::IDENTITY);
    let clear = Material { transmission: 1.0, alpha_cutoff: Some(f32::INFINITY), ..white() };
    add(&mut scene, quad(vec3(-0.5, 1.0, -0.5), Vec3::Z, Vec3::X, 0.5), clear, DAffine3::IDENTITY);
    let mut sun = lamp(LightKind::Directional);
    sun.direction = vec3(0.0, -1.0, 0.0);
    scene.lights = vec![sun];
    scene.cameras.push(camera(dvec3(0.0, 0.5, 3.0), dvec3(0.0, 0.0, 0.0), 0.3));
    for light_shadows in [LightShadows::Rays, LightShadows::Maps(256)] {
        let shown = shoot(&gpu(), &scene, None, &Knobs { light_shadows, ..direct([33, 9], 4) }).direct;
        let row: Vec<f64> = shown[33 * 5..33 * 6].iter().map(|p| p.y).collect();
        let brightest = row.iter().fold(0.0_f64, |most, y| most.max(*y));
        assert!(brightest > 0.0 && row.iter().all(|y| *y > 0.99 * brightest), "{light_shadows:?}: {row:?}");
    }
}

#[test]
fn glass_is_written_as_it_is_read() {
    let mut scene = glazed();
    let textured = scene.materials.iter().position(|m| m.transmission_texture.is_some()).expect("in the scene");
    let (texture, body) = (scene.materials[textured].transmission_texture, &mut scene.materials[textured]);
    (body.thickness, body.attenuation, body.thickness_texture) = (0.3, vec3(0.0, 0.2, 500.0), texture);
    let path = std::env::temp_dir().join(format!("lightskin_glass_{}.glb", std::process::id()));
    write_glb(&scene, &path).expect("written");
    let read = load(&path).expect("read");
    std::fs::remove_file(&path).expect("was there");
    let seen_through = |scene: &Scene| -> Vec<_> {
        let all = scene.materials.iter().filter(|material| material.is_seen_through());
        let of = |m: &Material| {
            let body = (m.thickness, (m.attenuation * 1e2).round(), m.thickness_texture.is_some());
            (m.blend, m.transmission, body, m.alpha_cutoff, m.base_color)
        };
        all.map(of).collect()
    };
    assert_eq!(seen_through(&scene), seen_through(&read));
}

#[test]
fn glass_before_nothing_shows_the_surroundings() {
    let mut scene = Scene::default();
    pane(&mut scene, 0.0, vec3(1.0, 1.0, 1.0), 0.5);
    scene.cameras.push(camera(dvec3(0.0, 0.0, 4.0), DVec3::ZERO, 0.8));
    let at = folder("layers-backdrop");
    write_glb(&scene, &at.join("pane.glb")).expect("written");
    for aa in ["off", "fast", "4"] {
        let args =
            ["render", "pane.glb", "-o", "a.png", "--size", "32x32", "--gi", "off", "--aa", aa, "--ground", "off"];
        works(&at, &[&args[..], &["--background", "transparent"]].concat());
        let picture = image::open(at.join("a.png")).expect("a PNG").to_rgba8();
        let alpha = |x: u32, y: u32| picture.get_pixel(x, y).0[3];
        assert_eq!((alpha(16, 16), alpha(1, 1)), (255, 0), "--aa {aa}");
    }
}
