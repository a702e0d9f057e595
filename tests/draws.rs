//! Optimised drawing changes no bit: runs of triangles outside a view are skipped, and pipelines are specialised for
//! the materials that they draw.

use crate::analytic::numbers;
use crate::common::frames::{baked, drawn, drawn_of, small};
use crate::common::gpu;
use glam::{Affine2, DAffine3, DVec3, Vec3, dvec3};
use lightskin::frame::{Antialiasing, Picture, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::lab::worlds::{SPOT, add, camera, corner, phong};
use lightskin::scene::build::{quad, sphere};
use lightskin::scene::deform::{Bind, Deform, Influence, Pose};
use lightskin::scene::{Image, LightKind, Material, Sampler, Scene, Texture};

/// Everything that stage 1 writes, as raw bits.
fn surfaces(gpu: &Gpu, Picture { surface, .. }: &Picture) -> Vec<Vec<u32>> {
    let mut all: Vec<Vec<u32>> = vec![gpu.read_image(&surface.depth).expect("read")];
    for image in surface.element.iter().chain([&surface.normal, &surface.radiance]) {
        all.push(gpu.read_image(image).expect("read"));
    }
    for image in [&surface.albedo, &surface.specular] {
        let halves: Vec<u16> = gpu.read_image(image).expect("read");
        all.push(halves.into_iter().map(u32::from).collect());
    }
    all
}

/// Balls with many triangles around the corner: one nearby, one mirrored, one far away, and one that covers a few
/// pixels.
fn balls() -> Scene {
    let mut scene = corner(&[SPOT, LightKind::Point], 20.0);
    let places = [
        DAffine3::from_scale_rotation_translation(DVec3::splat(0.8), Default::default(), dvec3(0.3, 0.5, 0.2)),
        DAffine3::from_scale_rotation_translation(dvec3(-0.3, 0.4, 0.2), Default::default(), dvec3(-0.7, 0.4, 0.5)),
        DAffine3::from_translation(dvec3(-30.0, 1.0, -50.0)),
        DAffine3::from_scale_rotation_translation(DVec3::splat(0.02), Default::default(), dvec3(0.1, 1.2, 0.6)),
    ];
    for place in places {
        add(&mut scene, sphere(1.0, 40), phong([0.3, 0.7, 0.3], [0.1; 3], 20.0), place);
    }
    scene
}

/// The same scene with every mesh bound to a joint in rest pose. Meshes that bend have no bounds, so all of them are
/// drawn.
fn unbounded(mut scene: Scene) -> Scene {
    for mesh in &mut scene.meshes {
        let mut deform = Deform::default();
        for (i, vertex) in mesh.vertices.iter().enumerate() {
            deform.bind.push(Bind {
                position: vertex.position,
                normal: vertex.normal,
                tangent: vertex.tangent,
                first_influence: i as u32,
                influence_count: 1,
            });
            deform.influences.push(Influence { joint: 0, weight: 1.0 });
        }
        mesh.deform = Some(deform);
    }
    for instance in &mut scene.instances {
        instance.pose = Some(Pose { joints: vec![DAffine3::IDENTITY], weights: Vec::new() });
    }
    scene
}

#[test]
fn triangles_outside_a_view_are_left_out_without_a_change() {
    let gpu = gpu();
    let mut scene = balls();
    assert!(
        scene.meshes.iter().any(|mesh| mesh.indices.len() > 3 * 4096),
        "meshes must have several runs of triangles"
    );
    let mut next = numbers(7);
    for turn in 0..6 {
        let eye = dvec3(next(), 0.2 + next(), next()) * if turn == 5 { 8.0 } else { 1.0 };
        let at = dvec3(next() - 0.5, next(), next() - 0.5);
        scene.cameras = vec![camera(eye, at, 0.3 + 0.7 * next() as f32)];
        let knobs = Knobs { size: [72, 54], gi: Gi::Off, ..small() };
        let all = unbounded(scene.clone());
        let [few, every] = [&scene, &all].map(|scene| {
            let world = World::new(&gpu, scene, None).expect("upload");
            surfaces(&gpu, &drawn_of(&gpu, scene, &world, &knobs).picture)
        });
        assert_eq!(few[0], every[0], "depth differs from {eye}");
        assert!(few[0].iter().any(|depth| *depth != 0));
        // Posing recomputes the normals, so direct light differs by rounding.
        let radiance = |of: &[Vec<u32>]| -> Vec<f32> { of[2].iter().map(|bits| f32::from_bits(*bits)).collect() };
        let (few, every) = (radiance(&few), radiance(&every));
        let off = few.iter().zip(&every).filter(|(a, b)| (*a - *b).abs() > 1e-3 * a.abs().max(1.0));
        let off: Vec<_> = off.collect();
        assert!(off.len() <= 12, "direct light differs from {eye}: {off:?}");
    }
}

#[test]
fn triangles_keep_their_numbers_in_runs() {
    let gpu = gpu();
    let mut scene = balls();
    scene.cameras = vec![camera(dvec3(0.9, 0.9, 1.2), dvec3(0.5, 0.6, 0.2), 0.5)];
    let (caches, of_all) = (baked(&scene, 0.7, 8), unbounded(scene.clone()));
    let knobs = Knobs { size: [72, 54], ..small() };
    let elements = |frame: &Frame| -> Vec<[u32; 2]> {
        gpu.read_image(frame.picture.surface.element.as_ref().expect("elements")).expect("read")
    };
    let few = elements(&drawn(&gpu, &scene, &caches, &knobs));
    let every = elements(&drawn(&gpu, &of_all, &baked(&of_all, 0.7, 8), &knobs));
    assert!(few == every, "draw and triangle numbers must be the same");
    assert!(few.iter().any(|element| element[1] > 2048), "some triangles must be in later runs");
}

/// Squares with all kinds of textured materials, side by side.
fn textured(more: usize) -> Scene {
    let mut scene = corner(&[SPOT], 20.0);
    let mut next = numbers(3);
    let rgba = (0..4 * 16 * 16).map(|_| (256.0 * next()) as u8).collect();
    scene.images.push(Image { name: "noise".into(), width: 16, height: 16, rgba });
    let texture = Some(Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler: Sampler::default() });
    let bit = |kind: usize, i: usize| texture.filter(|_| kind >> i & 1 != 0);
    let kind = |kind: usize| Material {
        base_color_texture: bit(kind, 0),
        metallic_roughness_texture: bit(kind, 1),
        normal_texture: bit(kind, 2),
        emissive_texture: bit(kind, 3),
        specular_texture: bit(kind, 4),
        specular_color_texture: bit(kind, 5),
        emissive: Vec3::splat(3.0),
        alpha_cutoff: (kind == 45).then_some(0.5),
        ..Material::default()
    };
    // Kinds with larger numbers share a pipeline sooner.
    for (i, number) in [0, 1, 7, 45, 63].into_iter().enumerate() {
        let mut surface = quad(Vec3::ZERO, 0.5 * Vec3::X, 0.5 * Vec3::Y, 0.1);
        for vertex in &mut surface.vertices {
            vertex.uv0 = 3.0 * vertex.position.truncate();
        }
        let place = dvec3(-0.9 + 0.35 * i as f64, 0.2 + 0.1 * i as f64, -0.5 + 0.1 * i as f64);
        add(&mut scene, surface, kind(number), DAffine3::from_translation(place));
    }
    // These squares are hidden behind the floor.
    for number in (2..63).filter(|number| ![7, 45].contains(number)).take(more) {
        let place = DAffine3::from_translation(dvec3(0.0, -0.5, 0.0));
        // They emit no light.
        let dark = Material { emissive: Vec3::ZERO, ..kind(number) };
        add(&mut scene, quad(Vec3::ZERO, 0.01 * Vec3::X, 0.01 * Vec3::Y, 0.1), dark, place);
    }
    add(
        &mut scene,
        quad(Vec3::ZERO, Vec3::X, Vec3::Y, 0.5),
        kind(0),
        DAffine3::from_translation(dvec3(-0.5, -1.5, -0.5)),
    );
    scene
}

#[test]
fn pipelines_that_know_their_materials_draw_what_others_draw() {
    let gpu = gpu();
    for antialiasing in [Antialiasing::Off, Antialiasing::Fast, Antialiasing::Four] {
        let knobs = Knobs { size: [72, 54], gi: Gi::Off, antialiasing, ..small() };
        // Each of few kinds has its own pipelines. Of many kinds, the last ones share pipelines.
        let [few, many] = [0, 40].map(|more| {
            let scene = textured(more);
            let world = World::new(&gpu, &scene, None).expect("upload");
            surfaces(&gpu, &drawn_of(&gpu, &scene, &world, &knobs).picture)
        });
        assert!(few[0] == many[0], "depth differs: {antialiasing:?}");
        // Compilers may round differently in specialised pipelines.
        let floats = few[1..3].iter().flatten().zip(many[1..3].iter().flatten());
        let floats =
            floats.map(|(a, b)| [*a, *b].map(f32::from_bits)).filter(|[a, b]| (a - b).abs() > 1e-5 * a.abs().max(1.0));
        let floats: Vec<_> = floats.collect();
        assert!(
            floats.is_empty(),
            "{antialiasing:?}: {} of {}: {:?}",
            floats.len(),
            few[1].len(),
            &floats[..floats.len().min(9)]
        );
        let halves = few[3..].iter().flatten().zip(many[3..].iter().flatten()).filter(|(a, b)| a.abs_diff(**b) > 1);
        assert_eq!(halves.count(), 0, "{antialiasing:?}");
    }
}
