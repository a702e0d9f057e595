//! Optimised drawing changes no bit: runs of triangles outside a view are skipped, and pipelines are specialised for
//! the materials that they draw.

use crate::analytic::numbers;
use crate::common::frames::{baked, drawn, drawn_of, small};
use crate::common::{apart, gpu, open};
use glam::{Affine2, DAffine3, DMat4, DVec2, DVec3, Vec3, dvec3};
use lightskin::frame::{Antialiasing, Picture, View, World};
use lightskin::gpu::{Gpu, Validation};
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::lab::worlds::{SPOT, add, camera, corner, phong, placed};
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

/// Triangles of a view in drawing order, by an independent calculation in f64: whether a pixel's centre lies in them, and
/// they face the viewer.
fn seen_triangles(scene: &Scene, world: &World, view: &View, size: [u32; 2]) -> Vec<bool> {
    let clip_from_world = DMat4::from_cols_array(&view.clip_from_world.to_cols_array().map(f64::from));
    let mut draws: Vec<_> = (scene.instances.iter().enumerate())
        .flat_map(|(i, instance)| scene.meshes[instance.mesh].primitives.iter().map(move |p| (p.material, i, p)))
        .collect();
    draws.sort_by_key(|(material, i, primitive)| (*material, *i, primitive.first_index));
    let mut all = Vec::new();
    for (_, i, primitive) in draws {
        let (instance, first) = (&scene.instances[i], primitive.first_index as usize);
        let mesh = &scene.meshes[instance.mesh];
        for corners in mesh.indices[first..first + primitive.index_count as usize].chunks(3) {
            let corner = |k: usize| {
                let model = mesh.vertices[corners[k] as usize].position.as_dvec3();
                let place = instance.world_from_model.transform_point3(model) - world.origin;
                clip_from_world * place.extend(1.0)
            };
            let clip = [0, 1, 2].map(corner);
            if clip.iter().any(|c| c.w <= 0.0) {
                all.push(false); // its picture is not a triangle; only clearly visible triangles are asked for
                continue;
            }
            let half = DVec2::new(f64::from(size[0]), f64::from(size[1])) / 2.0;
            let [a, b, c] = clip.map(|c| (c.truncate().truncate() / c.w + 1.0) * half);
            let mirrored = instance.world_from_model.matrix3.determinant() < 0.0;
            let area = (b - a).perp_dot(c - a) * if mirrored { 1.0 } else { -1.0 };
            let low = a.min(b).min(c).max(DVec2::ZERO).floor().as_uvec2();
            let high = a.max(b).max(c).min(2.0 * half).ceil().as_uvec2();
            let pixels = (low.y..high.y.max(low.y))
                .flat_map(|y| (low.x..high.x).map(move |x| DVec2::new(x.into(), y.into()) + 0.5));
            let inside = |p: DVec2| {
                let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| (to - from).perp_dot(p - from));
                sides.iter().all(|side| *side > 1e-3) || sides.iter().all(|side| *side < -1e-3)
            };
            all.push(area > 1e-3 && pixels.into_iter().any(inside));
        }
    }
    all
}

#[test]
fn triangles_that_a_view_cannot_show_are_culled_without_a_change() {
    if apart() {
        return;
    }
    let (culls, draws_all) = (open(Validation::Sync), open(Validation::Sync).without_triangle_culling());
    let mut next = numbers(11);
    let mut shares = Vec::new();
    for turn in 0..8 {
        let mut scene = balls();
        // Far from the origin, tiny, and deforming scenes.
        let shift = if turn == 3 { dvec3(4e4, -2e4, 6e4) } else { DVec3::ZERO };
        let scale = if turn == 4 { 1e-3 } else { 1.0 };
        scene = placed(&scene, scale, shift);
        if turn == 5 {
            scene = unbounded(scene);
        }
        let eye = dvec3(next(), 0.2 + next(), next()) * if turn == 7 { 8.0 } else { 1.0 };
        let at = dvec3(next() - 0.5, next(), next() - 0.5);
        scene.cameras = vec![camera(eye * scale + shift, at * scale + shift, 0.3 + 0.7 * next() as f32)];
        let antialiasing = if turn % 2 == 0 { Antialiasing::Off } else { Antialiasing::Four };
        let knobs = Knobs { size: [240, 180], antialiasing, ..small() };
        let caches = baked(&scene, 0.7 * scale, 8);
        let [few, every] = [&culls, &draws_all].map(|gpu| {
            let world = World::new(gpu, &scene, Some(&caches)).expect("upload");
            let frame = drawn_of(gpu, &scene, &world, &knobs);
            let vals: Vec<u8> = gpu.read(&frame.light.vals().expect("VALs").all).expect("read");
            let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
            let shown = frame.picture.shown_triangles().map(|shown| gpu.read::<[u32; 3]>(shown).expect("read"));
            (surfaces(gpu, &frame.picture), vals, shown, seen_triangles(&scene, &world, &view, knobs.size))
        });
        assert!(few.0 == every.0, "pixels differ from {eye}");
        assert!(few.1 == every.1, "VALs differ from {eye}");
        let (Some(shown), None) = (few.2, every.2) else { panic!("one device culls") };
        if antialiasing == Antialiasing::Off {
            assert_eq!(shown.len(), few.3.len());
            let kept = |[a, b, c]: &[u32; 3]| a != b || b != c;
            let lost = shown.iter().zip(&few.3).filter(|(triangle, seen)| **seen && !kept(triangle)).count();
            assert_eq!(lost, 0, "visible triangles were culled from {eye}");
            let of = |count: usize| count as f64 / shown.len() as f64;
            shares.push((of(shown.iter().filter(|t| kept(t)).count()), of(few.3.iter().filter(|seen| **seen).count())));
        }
    }
    println!("kept and visible shares of the triangles: {shares:.3?}");
    assert!(shares.iter().all(|(kept, seen)| *kept < 0.03 + 2.0 * seen), "few others are kept: {shares:?}");
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
    for antialiasing in [Antialiasing::Off, Antialiasing::Four] {
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
