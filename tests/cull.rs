//! Stage 5, culling: it lights exactly the caches that visible triangles refer to. The fragment path also lights the
//! other caches of a texel, and clusters light the others of a group. Culling changes no picture.

use std::collections::BTreeSet;

use glam::{DVec3, dvec3};
use lightskin::bake::{CacheSet, NO_CACHE};
use lightskin::frame::caches::CacheLight;
use lightskin::frame::gather::Gather;
use lightskin::frame::{ClusterRule, Light, Picture, View, World, record};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Knobs, Path};
use lightskin::lab::shot::{seen, small};
use lightskin::lab::worlds::{SPOT, baked, camera, corner};
use lightskin::scene::build::{CornellSurface, atrium, cornell};
use lightskin::scene::{LightKind, Scene};
use lightskin::shared::{CLUSTER_GROUP, LiveArgs, TEXEL_CACHES};

use crate::common::frames::{drawn, indirect};
use crate::common::{assert_clean, gpu};

const PATHS: [Path; 3] = [Path::DRAWS, Path::Compute, Path::Clusters(ClusterRule::Distance(4.0))];

fn settings(path: Path) -> Knobs {
    Knobs { cull: true, path, ..small() }
}

/// Atlas indices of the caches that the last frame has lit.
fn live(gpu: &Gpu, caches: &CacheLight) -> BTreeSet<usize> {
    if let Some(live) = caches.gather.live() {
        let count = gpu.read::<LiveArgs>(&live.args).expect("arguments")[0].cache_count as usize;
        let list: Vec<u32> = gpu.read(&live.list).expect("list");
        assert!(list[..count].is_sorted_by(|a, b| a < b), "the list must keep the atlas's order");
        let lit = list[..count].iter().flat_map(|item| item * live.group..(item + 1) * live.group);
        return lit.filter(|c| *c < caches.atlas.count).map(|c| c as usize).collect();
    }
    let Gather::Draws(draws) = &caches.gather else { panic!("a gather with draws") };
    let places = &draws.texels;
    let mask: Vec<f32> = gpu.read_image(&draws.mask.as_ref().expect("culled").image).expect("mask");
    let lit: BTreeSet<_> = (0..places.caches as usize).filter(|c| mask[places.texel(*c as u32)] == 1.0).collect();
    let texels: BTreeSet<_> = lit.iter().map(|c| c / TEXEL_CACHES as usize).collect();
    let [left, _, width, _] = places.area().map(|n| n as usize);
    let marked = mask.chunks(left + width).flat_map(|row| &row[left..]).filter(|depth| **depth != 0.0).count();
    assert_eq!(marked, texels.len(), "every marked texel must have a needed cache");
    lit
}

/// Number of consecutive caches in the atlas that are lit together when one of them is needed.
fn together(path: Path) -> usize {
    match path {
        Path::Draws(..) => TEXEL_CACHES as usize,
        Path::Clusters(_) => CLUSTER_GROUP as usize,
        Path::Compute => 1,
    }
}

/// The needed caches and all caches that are lit `together` with them. The atlas has `count` caches.
fn with_neighbours(needed: &BTreeSet<usize>, together: usize, count: usize) -> BTreeSet<usize> {
    needed.iter().flat_map(|c| c / together * together..(c / together + 1) * together).filter(|c| *c < count).collect()
}

/// The needed caches: all references of all corners of the triangles that the pixels' centres show. Also the number of
/// them on faces that are turned away from the camera.
fn needed(scene: &Scene, caches: &CacheSet, size: [u32; 2]) -> (BTreeSet<usize>, usize) {
    let mut base = Vec::new();
    let mut count = 0;
    for model in &caches.instance_model {
        base.push(count);
        count += caches.models[*model].caches.len();
    }
    let eye = scene.cameras[0].world_from_camera.translation;
    let (mut referred, mut hidden) = (BTreeSet::new(), BTreeSet::new());
    for s in seen(scene, size) {
        let model = &caches.models[caches.instance_model[s.instance]];
        let mesh = &scene.meshes[scene.instances[s.instance].mesh];
        let each = model.references.len() / mesh.vertices.len();
        for vertex in s.vertices {
            let row = &model.references[vertex * each..(vertex + 1) * each];
            for reference in row.iter().filter(|r| **r != NO_CACHE).map(|r| *r as usize) {
                referred.insert(base[s.instance] + reference);
                let (place, cache) = (scene.instances[s.instance].world_from_model, &model.caches[reference]);
                let normal = place.matrix3.inverse().transpose() * cache.normal.as_dvec3();
                if normal.dot(eye - place.transform_point3(cache.position.as_dvec3())) < 0.0 {
                    hidden.insert(base[s.instance] + reference);
                }
            }
        }
    }
    (referred, hidden.len())
}

#[test]
fn what_visible_triangles_refer_to_is_lit_alone_by_texels_or_by_groups() {
    let gpu = gpu();
    for (references, eye) in [(8, dvec3(1.41, 1.53, 2.07)), (16, dvec3(0.43, 0.71, 0.52))] {
        let mut scene = corner(&[SPOT], 40.0);
        let caches = baked(&scene, 0.12, references).expect("bakes");
        // Both cameras are drawn in turn. Nothing of the first frame may affect the second.
        let cameras = [dvec3(-0.1, 0.5, -0.1), dvec3(-0.4, 0.2, 0.3)].map(|target| camera(eye, target, 0.5));
        let seen = cameras.map(|camera| {
            scene.cameras[0] = camera.clone();
            (camera, needed(&scene, &caches, small().size))
        });
        let [first, second] = seen.each_ref().map(|(_, (needed, _))| needed);
        assert!(
            !first.is_subset(second) && !second.is_subset(first),
            "each camera must need caches that the other does not"
        );
        assert!(seen.iter().any(|(_, (_, hidden))| *hidden > 0), "some needed caches must lie on hidden faces");
        for path in PATHS {
            let settings = settings(path);
            let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
            let mut frame = Frame::new(&gpu, &scene, &world, &settings).expect("made");
            let (all, together) = (world.cache_count as usize, together(path));
            for (camera, (needed, hidden)) in &seen {
                let expected = match together {
                    1 => needed.clone(),
                    _ => with_neighbours(needed, together, all),
                };
                let view = View::new(camera, settings.size, world.origin, world.radius);
                let drawn = gpu.frame(|cmd| {
                    frame.record(cmd, &world, &view);
                    Ok(())
                });
                assert_eq!(drawn.expect("drawn").problems, [""; 0]);
                let found = live(&gpu, frame.light.caches().expect("caches"));
                let apart: Vec<_> = found.symmetric_difference(&expected).collect();
                assert!(
                    apart.is_empty(),
                    "{together} together, {references} references: {apart:?} are only lit or only expected"
                );
                assert_eq!(frame.light.counts(&gpu).expect("counts").caches as usize, expected.len());
                let (lit, needed) = (expected.len(), needed.len());
                eprintln!("{together} together: {lit} of {all} caches for {needed}, {hidden} of them on hidden faces");
                assert!(lit < all && (lit > needed) == (together > 1));
            }
        }
    }
    assert_clean(&gpu);
}

/// Both indirect layers as raw bits, and the numbers of lit caches and of all caches.
fn layers(gpu: &Gpu, scene: &Scene, caches: &CacheSet, settings: &Knobs) -> (Vec<Vec<[u32; 4]>>, [usize; 2]) {
    let frame = drawn(gpu, scene, caches, settings);
    let all = indirect(gpu, &frame);
    let count = frame.light.caches().expect("caches").atlas.count as usize;
    (all, [frame.light.counts(gpu).expect("counts").caches as usize, count])
}

#[test]
fn culling_changes_no_bit_of_a_picture() {
    let gpu = gpu();
    let near = |mut scene: Scene, eye: DVec3, target: DVec3| {
        scene.cameras[0] = camera(eye, target, 0.3);
        scene
    };
    let worlds = [
        (corner(&[SPOT, LightKind::Directional], 40.0), 0.12),
        (near(cornell(CornellSurface::Glossy, 0.1), dvec3(0.1, 0.4, 1.5), dvec3(0.4, 0.1, -0.4)), 0.12),
        (near(atrium(), dvec3(1.0, 1.6, 0.5), dvec3(4.0, 1.0, 2.0)), 0.6),
    ];
    for (scene, spacing) in worlds {
        let caches = baked(&scene, spacing, 8).expect("bakes");
        for path in PATHS {
            let culled = Knobs { size: [96, 64], ..settings(path) };
            let (with, [lit, all]) = layers(&gpu, &scene, &caches, &culled);
            let (without, _) = layers(&gpu, &scene, &caches, &Knobs { cull: false, ..culled });
            eprintln!("{} by {path:?}: {lit} of {all} caches", scene.name);
            assert!(lit < all, "some caches must be culled");
            assert!(with == without, "{} by {path:?}: pictures differ", scene.name);
            assert!(with.iter().flatten().any(|p| p[0] != 0), "there must be light");
        }
    }
    assert_clean(&gpu);
}

#[test]
fn of_several_views_every_one_is_served() {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 40.0);
    scene.cameras[0] = camera(dvec3(0.7, 0.9, 0.6), dvec3(-0.3, 0.0, -0.6), 0.3);
    scene.cameras.push(camera(dvec3(0.6, 1.2, 0.9), dvec3(-1.0, 1.6, 0.6), 0.2));
    let caches = baked(&scene, 0.12, 8).expect("bakes");
    let of_views: Vec<_> = (0..2)
        .map(|i| {
            let mut alone = scene.clone();
            alone.cameras = vec![scene.cameras[i].clone()];
            needed(&alone, &caches, small().size).0
        })
        .collect();
    let [first, second] = [&of_views[0], &of_views[1]];
    assert!(!first.is_subset(second) && !second.is_subset(first), "each view must need caches that the other does not");
    for path in PATHS {
        let settings = settings(path);
        let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
        let mut light = Light::new(&gpu, &scene, &world, &settings.settings(), 2).expect("made");
        let mut pictures = [(); 2].map(|()| Picture::new(&gpu, &world, &light, settings.size).expect("made"));
        let drawn = gpu.frame(|cmd| {
            let of = |(camera, picture)| (View::new(camera, settings.size, world.origin, world.radius), picture);
            let mut views: Vec<_> = scene.cameras.iter().zip(&mut pictures).map(of).collect();
            record(cmd, &world, &mut light, &mut views, &settings.look());
            Ok(())
        });
        assert_eq!(drawn.expect("drawn").problems, [""; 0]);
        let both = first.union(second).copied().collect();
        let expected = with_neighbours(&both, together(path), world.cache_count as usize);
        assert_eq!(live(&gpu, light.caches().expect("caches")), expected, "{path:?}");
    }
    assert_clean(&gpu);
}
