//! Stage 8 at texel level: pixels look up their caches in cells of the models' surfaces (METHOD 5, thesis 6.1.4).

use glam::{DVec3, Vec3, dvec3, vec3};
use lightskin::bake::CacheSet;
use lightskin::frame::Interpolation;
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Knobs, Path};
use lightskin::lab::worlds::placed;
use lightskin::metrics::metrics;
use lightskin::reference::gather::{Cache, Gathered};
use lightskin::reference::interpolate::{Scheme, interpolate_within, shade};
use lightskin::reference::phong::{Material as Reflection, mirrored_view};
use lightskin::scene::build::{CornellSurface, atrium, cornell, quad};
use lightskin::scene::{LightKind, Scene};
use lightskin::shared::NO_REFERENCES;

use crate::common::frames::{
    SPOT, Shot, add, baked, camera, corner, drawn, indirect, lamp, phong, reflection, seen, shoot, small,
};
use crate::common::{assert_clean, gpu};

fn with_cells(scene: &Scene, spacing: f64) -> CacheSet {
    baked(scene, spacing, 8).with_cells(scene).expect("cells")
}

/// Expected radiance of both lobes in every pixel, from all caches of its model without cells. Pixels for which no
/// cache within reach faces the same way are left out and counted.
fn twins(scene: &Scene, caches: &CacheSet, shot: &Shot, scheme: Scheme) -> ([Vec<(usize, DVec3)>; 2], usize) {
    let reach = caches.cells.as_ref().expect("cells").reach;
    let eye = scene.cameras[0].world_from_camera.translation;
    let count = |i: usize| caches.models[caches.instance_model[i]].caches.len();
    let (mut diffuse, mut glossy, mut left_out) = (Vec::new(), Vec::new(), 0);
    for s in seen(scene, small().size) {
        let instance = &scene.instances[s.instance];
        let base: usize = (0..s.instance).map(count).sum();
        let own = base..base + count(s.instance);
        let references: Vec<(Cache, Gathered)> = own.map(|i| (shot.caches[i], shot.proxies[i])).collect();
        let within = |c: &Cache| c.position.distance(s.position) < reach && c.normal.dot(s.normal) > 0.0;
        if !references.iter().any(|(cache, _)| within(cache)) {
            left_out += 1;
            continue;
        }
        let normals = instance.world_from_model.matrix3.inverse().transpose();
        let of = |i: usize| normals * scene.meshes[instance.mesh].vertices[s.vertices[i]].normal.as_dvec3();
        let normal = (0..3).map(|i| s.weights[i] * of(i).normalize()).sum::<DVec3>().normalize();
        let near: Vec<_> = references.into_iter().filter(|(cache, _)| within(cache)).collect();
        let mirrored = mirrored_view(s.position, normal, eye);
        let light = interpolate_within(s.position, normal, mirrored, &near, scheme, reach);
        let material = Reflection {
            diffuse: shot.albedo[s.pixel],
            specular: shot.specular[s.pixel],
            ..reflection(scene, s.material)
        };
        let normal = shot.normals[s.pixel];
        let mirrored = mirrored_view(s.position, normal, eye);
        let shaded = shade(&light, s.position, normal, mirrored, &material);
        diffuse.push((s.pixel, shaded.0));
        glossy.push((s.pixel, shaded.1));
    }
    ([diffuse, glossy], left_out)
}

#[test]
fn pictures_are_those_of_all_caches_within_reach() {
    let gpu = gpu();
    for (k, spacing) in [(1.0, 0.4), (30.0, 0.25)] {
        let scene = corner(&[LightKind::Spot { inner: 0.1, outer: 0.25 }, SPOT], k);
        let caches = with_cells(&scene, spacing);
        for (interpolation, scheme) in
            [(Interpolation::Facing, Scheme::Facing), (Interpolation::Printed, Scheme::Printed)]
        {
            let settings = Knobs { interpolation, ..small() };
            let shot = shoot(&gpu, &scene, Some(&caches), &settings);
            let ([diffuse, glossy], left_out) = twins(&scene, &caches, &shot, scheme);
            assert!(left_out * 100 < diffuse.len(), "{left_out} pixels have no cache within reach");
            crate::interpolate::assert_picture(&shot.diffuse, &diffuse, 2e-4, &format!("diffuse, {scheme:?}, k {k}"));
            crate::interpolate::assert_picture(&shot.glossy, &glossy, 2e-4, &format!("glossy, {scheme:?}, k {k}"));
        }
    }
}

/// A floor of two triangles, or of squares with this edge, in front of a wall that a spot lights. Figure 6.4.
fn floor(edge: f32) -> Scene {
    let mut scene = Scene { name: "floor".into(), ..Scene::default() };
    let white = || phong([0.8, 0.8, 0.8], [0.3, 0.3, 0.3], 20.0);
    add(&mut scene, quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, edge), white(), Default::default());
    add(&mut scene, quad(vec3(-1.0, 0.0, -1.0), Vec3::X * 2.0, Vec3::Y * 2.0, 0.1), white(), Default::default());
    let mut spot = lamp(LightKind::Spot { inner: 0.1, outer: 0.3 });
    spot.position = dvec3(0.2, 1.5, 1.0);
    spot.direction = (vec3(-0.3, 0.4, -1.0) - spot.position.as_vec3()).normalize();
    scene.lights.push(spot);
    scene.cameras.push(camera(dvec3(0.0, 1.8, 1.6), dvec3(0.0, 0.0, -0.1), 0.8));
    scene
}

#[test]
fn two_triangles_are_as_good_as_many() {
    let gpu = gpu();
    let picture = |edge: f32, cells: bool| {
        let scene = floor(edge);
        let caches = if cells { with_cells(&scene, 0.25) } else { baked(&scene, 0.25, 8) };
        let settings = Knobs { size: [96, 96], rsm: 48, ..small() };
        let shot = shoot(&gpu, &scene, Some(&caches), &settings);
        eprintln!("{} caches on {} triangles", caches.models[0].caches.len(), scene.meshes[0].triangle_count());
        [shot.diffuse, shot.glossy].map(|layer| layer.iter().map(|c| c.as_vec3().to_array()).collect::<Vec<_>>())
    };
    let (two, many) = (picture(9.0, true), picture(0.05, true));
    let (two_by_vertex, many_by_vertex) = (picture(9.0, false), picture(0.05, false));
    for (lobe, name) in ["diffuse", "glossy"].iter().enumerate() {
        let texel = metrics(&two[lobe], &many[lobe]).relmse;
        let vertex = metrics(&two_by_vertex[lobe], &many_by_vertex[lobe]).relmse;
        eprintln!("{name}: two triangles against many: relMSE {texel:.2e} at texel level, {vertex:.2e} at vertices");
        assert!(texel < 0.005, "{name}: {texel}");
        assert!(vertex > 0.005, "{name}: vertices alone must not do as well: {vertex}");
    }
}

/// Indirect layers as raw bits, the number of lit caches, and the number of surface pixels that find no cell.
fn layers(gpu: &Gpu, scene: &Scene, caches: &CacheSet, settings: &Knobs) -> (Vec<Vec<[u32; 4]>>, u32, usize) {
    let frame = drawn(gpu, scene, caches, settings);
    let all = indirect(gpu, &frame);
    let depth: Vec<f32> = gpu.read_image(&frame.picture.surface.depth).expect("read");
    let rows: Vec<u32> = gpu.read(&frame.picture.visible.as_ref().expect("visible").slots).expect("read");
    let lost = depth.iter().zip(&rows).filter(|(depth, row)| **depth > 0.0 && **row == NO_REFERENCES).count();
    (all, frame.light.counts(gpu).expect("counts").caches, lost)
}

#[test]
fn culling_changes_no_bit_and_leaves_caches_out() {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 40.0);
    scene.cameras[0] = camera(dvec3(0.43, 0.71, 0.52), dvec3(-0.1, 0.5, -0.1), 0.4);
    let caches = with_cells(&scene, 0.12);
    for path in [Path::DRAWS, Path::Compute] {
        let settings = Knobs { path, size: [96, 64], ..small() };
        let (all, every, _) = layers(&gpu, &scene, &caches, &settings);
        let (culled, live, _) = layers(&gpu, &scene, &caches, &Knobs { cull: true, ..settings });
        eprintln!("{path:?}: {live} of {every} caches");
        assert!(live > 0 && 2 * live < every);
        assert!(all == culled, "{path:?}: pictures differ");
    }
    assert_clean(&gpu);
}

#[test]
fn every_pixel_finds_its_cell() {
    let gpu = gpu();
    let worlds = [
        (corner(&[SPOT], 20.0), 0.1),
        (placed(&corner(&[SPOT], 20.0), 1e-3, dvec3(3.0, -2.0, 1.0)), 1e-4),
        (placed(&corner(&[SPOT], 20.0), 1e3, dvec3(5e4, 0.0, -2e4)), 1e2),
        (cornell(CornellSurface::Glossy, 9.0), 0.2),
        (atrium(), 0.6),
    ];
    for (scene, spacing) in worlds {
        let caches = with_cells(&scene, spacing);
        let cells = caches.cells.as_ref().expect("cells");
        let bytes: usize = cells.models.iter().map(|m| 2 * m.references.len() + 24 * m.cells.len()).sum();
        let settings = Knobs { size: [160, 120], rsm: 32, ..small() };
        let (_, _, lost) = layers(&gpu, &scene, &caches, &settings);
        let count: usize = caches.models.iter().map(|m| m.caches.len()).sum();
        eprintln!("{}: rows of {}, {} bytes per cache, {count} caches", scene.name, cells.row, bytes / count);
        assert_eq!(lost, 0, "{}", scene.name);
    }
    assert_clean(&gpu);
}
