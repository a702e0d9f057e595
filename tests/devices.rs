//! Devices that lack features of others draw the same picture by other means.

use std::fs;
use std::process::Command;

use glam::{DAffine3, DQuat, DVec3, Vec3, vec3};
use lightskin::frame::{Antialiasing, LightShadows, Near, Shadows};
use lightskin::gpu::{Gpu, Validation};
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::scene::build::{quad, sphere};
use lightskin::scene::{Material, Scene};

use serde_json::json;

use crate::cli::{fails, folder, keeping, text, works};
use crate::common::frames::{Shot, add, baked, phong, shoot, small};
use crate::common::{apart, open};
use crate::moving;

const RAYS: Near = Near::Rays { per_pixel: 4, every: 2 };

/// All layers of a picture as raw bits.
fn bits(shot: &Shot) -> Vec<[u64; 3]> {
    let all = [&shot.albedo, &shot.specular, &shot.direct, &shot.diffuse, &shot.glossy];
    all.into_iter().flatten().map(|p: &DVec3| p.to_array().map(f64::to_bits)).collect()
}

/// A scene with bending bodies, mirrored and plain instances, glass in front of them, and a coated surface.
fn everything() -> Scene {
    let mut scene = moving::world();
    moving::bend(&mut scene, 0.4, 0.5);
    let coated = Material { coat: 0.8, coat_roughness: 0.3, ..phong([0.5; 3], [0.2; 3], 20.0) };
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    add(&mut scene, quad(vec3(-0.9, 0.1, 0.2), Vec3::X * 0.5, Vec3::Y * 0.5, 0.3), coated, mirror);
    let glass = Material { blend: true, alpha_cutoff: Some(0.5), ..phong([0.9, 0.5, 0.4], [0.1; 3], 20.0) };
    let glass = Material { base_color: glass.base_color.with_w(0.4), ..glass };
    add(&mut scene, quad(vec3(-0.5, 0.2, 0.8), Vec3::X, Vec3::Y, 0.5), glass, DAffine3::IDENTITY);
    scene
}

#[test]
fn vertices_can_number_triangles_where_fragments_cannot() {
    if apart() {
        return;
    }
    let all = everything();
    let plain = moving::world();
    let [cached, cached_plain] = [&all, &plain].map(|scene| baked(scene, 0.3, 8));
    let by_cells = cached.clone().with_cells(&all).expect("cells");
    let draw = |gpu: &Gpu| {
        let with = |near, antialiasing, layers| Knobs {
            size: [40, 30],
            near,
            antialiasing,
            layers,
            shadows: Shadows::PerLight,
            light_shadows: LightShadows::Rays,
            ..small()
        };
        vec![
            bits(&shoot(gpu, &all, Some(&cached), &with(RAYS, Antialiasing::Four, 2))),
            bits(&shoot(gpu, &all, Some(&by_cells), &with(Near::Off, Antialiasing::Fast, 1))),
            bits(&shoot(gpu, &plain, Some(&cached_plain), &with(Near::Off, Antialiasing::Off, 0))),
        ]
    };
    let numbered = open(Validation::Sync);
    let expected = draw(&numbered);
    assert!(expected[0].iter().any(|p| *p != [0; 3]));
    let pulled = numbered.without_triangle_numbers();
    assert!(draw(&pulled) == expected, "the picture must stay the same");
}

#[test]
fn what_has_too_many_texels_is_read_from_storage_buffers() {
    if apart() {
        return;
    }
    let mut scene = moving::world();
    // Rays meet a hierarchy of more than 65 536 texels: three for each triangle.
    let place = DAffine3::from_scale_rotation_translation(
        DVec3::splat(0.1),
        DQuat::IDENTITY,
        scene.bounds().expect("bounds").0,
    );
    add(&mut scene, sphere(1.0, 106), phong([0.7; 3], [0.0; 3], 1.0), place);
    assert!(scene.triangle_count() * 3 > 65_536);
    // The depth images of these caches have more than 65 536 texels, and there are more VALs than that, too.
    let caches = baked(&scene, 0.2, 8);
    let count = caches.models.iter().map(|model| model.caches.len()).sum::<usize>();
    assert!(count * 144 > 65_536, "{count} caches");
    let draw = |gpu: &Gpu| {
        let knobs = |near, bounces| Knobs {
            size: [24, 18],
            rsm: 110,
            gi: Gi::LightSkin,
            near,
            bounces,
            shadows: Shadows::PerLight,
            light_shadows: LightShadows::Rays,
            ..small()
        };
        [knobs(RAYS, 0), knobs(Near::Off, 1)].map(|knobs| bits(&shoot(gpu, &scene, Some(&caches), &knobs)))
    };
    let wide = open(Validation::Sync);
    let expected = draw(&wide);
    assert!(draw(&wide.with_few_texels()) == expected, "the picture must stay the same");
}

/// Runs the tool on SwiftShader and on the other tests' device. The pictures are the same, except for SwiftShader's
/// coarse placement of triangles.
#[test]
fn swiftshader_draws_what_other_devices_draw() {
    let Some(icd) = std::env::var_os("LIGHTSKIN_SWIFTSHADER").filter(|icd| !icd.is_empty()) else {
        println!("skipped: LIGHTSKIN_SWIFTSHADER does not name SwiftShader's ICD file");
        return;
    };
    let folder = folder("swiftshader");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/cornell_glossy.glb");
    let flags =
        ["render", scene, "--size", "64x48", "--caches", "300", "--rsm", "32", "--near", "off", "--ev", "4", "-o"];
    let out = keeping(Command::new(env!("CARGO_BIN_EXE_lightskin")).args(flags).arg("swift.exr"), &folder)
        .env("VK_ICD_FILENAMES", &icd)
        .env("VK_DRIVER_FILES", &icd)
        .output()
        .expect("runs");
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("SwiftShader"), "{}", text(&out.stdout));
    works(&folder, &[&flags[..], &["other.exr"]].concat());
    let told = works(&folder, &["compare", "swift.exr", "other.exr"]);
    println!("{told}");
    let figure = |name: &str| -> f64 {
        let line = told.lines().find(|line| line.split_whitespace().next() == Some(name)).expect("a figure");
        line.split_whitespace().nth(1).expect("a number").parse().expect("a number")
    };
    assert!(figure("flip") < 0.03 && figure("bias").abs() < 0.02, "{told}");
}

/// Uses Mesa's driver for AMD GPUs, which compiles shaders without a GPU.
#[test]
fn gathers_that_gpus_may_choose_do_not_spill() {
    let Some(icd) = fs::read_dir("/usr/share/vulkan/icd.d").into_iter().flatten().find_map(|entry| {
        let path = entry.ok()?.path();
        path.file_name()?.to_string_lossy().starts_with("radeon_icd").then_some(path)
    }) else {
        println!("skipped: Mesa's driver for AMD's GPUs is not here");
        return;
    };
    let folder = folder("codegen");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightskin"));
    let out = keeping(command.args(["lab", "codegen", "--only", "gather"]), &folder)
        .envs([("VK_ICD_FILENAMES", &icd), ("VK_DRIVER_FILES", &icd)])
        .env("RADV_FORCE_FAMILY", "navi21")
        .output()
        .expect("runs");
    if !out.status.success() {
        println!("skipped: {}", text(&out.stderr));
        return;
    }
    let table = text(&out.stdout);
    println!("{table}");
    let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let (mut fit, mut spill) = (0, 0);
    for cells in table.lines().map(cells).filter(|cells| cells.len() > 8 && cells[1].starts_with("gather")) {
        let Ok(spilled) = cells[5].parse::<f64>() else { continue };
        // Eight caches per thread with both lobes are never chosen. They are here to show that the test detects spills.
        if cells[2].contains("8 caches") {
            spill += usize::from(spilled > 0.0);
        } else {
            // Known: two views at once, with shadows and four caches, need two registers too many.
            let most = if cells[1] == "gather_shadowed_eyes.comp" { 2.0 } else { 0.0 };
            assert!(spilled <= most, "{} with {} spills {spilled}", cells[1], cells[2]);
            fit += 1;
        }
    }
    assert!(fit > 36 && spill > 0, "{fit} that fit and {spill} that spill");
}

#[test]
fn what_is_too_large_names_the_flag() {
    let folder = folder("many-lights");
    let lights: Vec<_> = (0..300)
        .map(|i| {
            let place = [0.01 * f64::from(i), 0.3, 0.5];
            json!({ "translation": place, "extensions": { "KHR_lights_punctual": { "light": 0 } } })
        })
        .collect();
    let nodes = [vec![json!({ "mesh": 0 })], lights].concat();
    let triangle = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    let file = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point" }] } },
        "scenes": [{ "nodes": (0..301).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": triangle }],
    });
    fs::write(folder.join("lights.gltf"), file.to_string()).expect("written");
    let told = works(&folder, &["info", "lights.gltf", "--caches", "20"]);
    if told.contains("more VALs than") {
        assert!(told.contains("at high, reference: lower --rsm"), "{told}");
        let flags = ["render", "lights.gltf", "--size", "16x12", "--caches", "20", "-o", "a.png"];
        fails(&folder, &flags, 1, &["rsm.vals", "lower --rsm"]);
    }
}
