//! Poses of animated scenes agree at any time with a second reader that works in f64. Malformed animations are refused.

mod built;
mod files;
mod malformed;
mod second;
mod written;

use crate::common::data;
use glam::{DVec3, Vec3};
use lightskin::bake::{BakeSettings, CacheSet, Density, bake};
use lightskin::reference::world::{Sides, World};
use lightskin::scene::{Instance, Mesh, Scene, gltf, tessellate};
use second::{File, Triangle};
use std::path::{Path, PathBuf};

/// Number of times at which each animation is compared.
const TIMES: usize = 20;

/// World-space positions and normals of an instance's vertices. The transforms are f64; the model's vertices are f32.
fn placed(scene: &Scene, instance: &Instance) -> (Vec<DVec3>, Vec<DVec3>) {
    let mesh = &scene.meshes[instance.mesh];
    let vertices = match &instance.pose {
        Some(pose) => mesh.posed(pose),
        None => mesh.vertices.clone(),
    };
    let place = instance.world_from_model;
    let normals = place.matrix3.inverse().transpose();
    let position = |v: &lightskin::scene::Vertex| place.transform_point3(v.position.as_dvec3());
    let normal = |v: &lightskin::scene::Vertex| (normals * v.normal.as_dvec3()).normalize();
    (vertices.iter().map(position).collect(), vertices.iter().map(normal).collect())
}

/// Largest differences that a comparison found.
#[derive(Default)]
struct Off {
    /// Largest distance between corresponding vertices, as a fraction of the model's size.
    position: f64,
    /// Largest angle [rad] between corresponding normals.
    normal: f64,
    /// Largest distance between corresponding caches, as a fraction of the model's size.
    cache: f64,
}

impl Off {
    fn compare(&mut self, scene: &Scene, caches: &CacheSet, drawn: &[Vec<Triangle>], size: f64) {
        assert_eq!(scene.instances.len(), drawn.len());
        for (index, (instance, expected)) in scene.instances.iter().zip(drawn).enumerate() {
            let mesh = &scene.meshes[instance.mesh];
            assert_eq!(mesh.triangle_count(), expected.len(), "{}: {}", scene.name, mesh.name);
            let (positions, normals) = placed(scene, instance);
            for (t, (corners, directions)) in expected.iter().enumerate() {
                let own = mesh.triangle(t);
                for (vertex, corner) in own.iter().zip(corners) {
                    self.position = self.position.max(positions[*vertex].distance(*corner) / size);
                }
                let flat = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let directions = directions.unwrap_or([flat.normalize_or_zero(); 3]);
                for (vertex, direction) in own.iter().zip(directions).filter(|(_, d)| d.is_finite() && d.length() > 0.5)
                {
                    self.normal = self.normal.max(normals[*vertex].angle_between(direction));
                }
            }
            for cache in &caches.models[caches.instance_model[index]].caches {
                let [second, third] = cache.barycentric.map(f64::from);
                let on = |[a, b, c]: [DVec3; 3]| a + (b - a) * second + (c - a) * third;
                let found = on(mesh.triangle(cache.triangle as usize).map(|v| positions[v]));
                let wanted = on(expected[cache.triangle as usize].0);
                self.cache = self.cache.max(found.distance(wanted) / size);
            }
        }
    }
}

/// Removes triangles without area at rest. The loader drops them from meshes that do not bend.
fn without_flat(mut drawn: Vec<Vec<Triangle>>, scene: &Scene, rest: &[Vec<Triangle>]) -> Vec<Vec<Triangle>> {
    for ((drawn, rest), instance) in drawn.iter_mut().zip(rest).zip(&scene.instances) {
        if instance.pose.is_none() {
            let mut rest = rest.iter();
            drawn.retain(|_| {
                let ([a, b, c], _) = rest.next().expect("one rest triangle for each drawn triangle");
                (*b - *a).cross(*c - *a).length() > 1e-10 * (*b - *a).length_squared().max((*c - *a).length_squared())
            });
        }
    }
    drawn
}

fn animated(data: &Path) -> Vec<PathBuf> {
    let all = crate::common::gltf_files(&data.join("scenes"));
    all.into_iter().filter(|path| gltf::load(path).is_ok_and(|scene| scene.rig.is_some())).collect()
}

const FEW: BakeSettings = BakeSettings { density: Density::Count(60), angle: 0.8, references: 8 };

#[test]
fn every_animated_file_stands_as_a_second_reader_has_it() {
    let Some(data) = data() else { return };
    let files = animated(&data);
    for path in &files {
        let mut scene = gltf::load(path).expect("is valid");
        let file = File::open(path);
        assert_eq!(scene.animations().count(), file.animations());
        let (low, high) = Scene { extent: None, ..scene.clone() }.bounds().expect("is not empty");
        let size = low.distance(high);
        let caches = bake(&scene, &FEW, &|_, _| {}).expect("bakes");
        let rest = file.drawn(None);
        let mut off = Off::default();
        off.compare(&scene, &caches, &without_flat(rest.clone(), &scene, &rest), size);
        let extent = scene.extent.expect("has one");
        for animation in 0..file.animations() {
            let (begin, end) = file.span(animation);
            let (_, first, last) = scene.animations().nth(animation).expect("is there");
            assert!(first >= begin && last <= end);
            for i in 0..TIMES {
                // Includes times before the first key and after the last.
                let time = begin + (end - begin) * (1.2 * i as f64 / (TIMES - 1) as f64 - 0.1);
                scene.pose(animation, time);
                let drawn = without_flat(file.drawn(Some((animation, time))), &scene, &rest);
                off.compare(&scene, &caches, &drawn, size);
                for corner in drawn.iter().flatten().flat_map(|(corners, _)| corners) {
                    let inside = corner.cmpge(extent.0).all() && corner.cmple(extent.1).all();
                    assert!(inside, "{}: {corner} leaves {extent:?} at {time} s", scene.name);
                }
            }
        }
        let bend = scene.instances.iter().filter(|i| i.pose.is_some()).count();
        println!(
            "{:<28} {} animations, {bend:>2} of {:>2} instances bend: largest differences: vertices {:.1e} and caches {:.1e} of the size, normals {:.1e} rad",
            scene.name,
            file.animations(),
            scene.instances.len(),
            off.position,
            off.cache,
            off.normal
        );
        assert!(off.position < 1e-4 && off.cache < 1e-4, "{}", path.display());
        assert!(off.normal < 2e-3, "{}: {}", path.display(), off.normal);
    }
    println!("{} files", files.len());
    assert!(files.len() >= 27, "{}", files.len());
}

#[test]
fn a_pose_depends_on_animation_and_time_alone() {
    let Some(data) = data() else { return };
    let fresh = gltf::load(&data.join("scenes/features/skin/Fox.glb")).expect("is valid");
    let mut used = fresh.clone();
    used.pose(0, 0.3);
    used.pose(2, 0.7);
    let mut other = fresh.clone();
    other.pose(2, 0.7);
    assert_eq!(format!("{:?}", used.instances), format!("{:?}", other.instances));
    assert_ne!(format!("{:?}", used.instances), format!("{:?}", fresh.instances));
    used.rest();
    assert_eq!(format!("{:?}", used.instances), format!("{:?}", fresh.instances));
    let animation = &fresh.rig.as_ref().expect("moves").parts().animations[1];
    let (begin, end) = animation.span();
    assert_eq!(animation.looped(0.0), begin);
    assert!((animation.looped(2.25 * (end - begin)) - begin - 0.25 * (end - begin)).abs() < 1e-12);
}

/// World-space positions of all vertices of the first instance.
fn at(scene: &mut Scene, animation: usize, time: f64) -> Vec<Vec3> {
    scene.pose(animation, time);
    placed(scene, &scene.instances[0]).0.iter().map(|p| p.as_vec3()).collect()
}

fn has(found: &[Vec3], wanted: Vec3) -> bool {
    found.iter().any(|p| p.distance(wanted) < 1e-4)
}

/// Expected positions in closed form, from the figures in the files' descriptions.
#[test]
fn the_simple_ones_stand_where_they_should() {
    let Some(data) = data() else { return };
    let load = |name: &str| gltf::load(&data.join("scenes").join(name)).expect("is valid");
    let mut skin = load("features/skin/SimpleSkin/SimpleSkin.gltf");
    // The second joint at (0, 1) makes a quarter turn. The top (0.5, 2) is at (0.5, 1) relative to the joint.
    let found = at(&mut skin, 0, 1.0);
    assert!(has(&found, Vec3::new(-1.0, 1.5, 0.0)) && has(&found, Vec3::new(-0.5, 0.0, 0.0)), "{found:?}");
    let mut morph = load("features/morph/SimpleMorph/SimpleMorph.gltf");
    // Half of (0, 1), then all of (1, 1).
    assert!(has(&at(&mut morph, 0, 0.5), Vec3::new(1.0, 1.0, 0.0)));
    assert!(has(&at(&mut morph, 0, 2.0), Vec3::new(0.5, 2.5, 0.0)));
    // The same rotation is stored as floats, bytes and shorts.
    let turn = |n: u32, time: f64| {
        let mut scene = load(&format!("asset_generator/Animation_SamplerType/Animation_SamplerType_0{n}.gltf"));
        scene.pose(0, time);
        scene.instances[0].world_from_model
    };
    for time in [0.0, 0.7, 1.9, 3.4] {
        assert!(turn(1, time).abs_diff_eq(turn(0, time), 0.02) && turn(2, time).abs_diff_eq(turn(0, time), 1e-4));
    }
}

#[test]
fn dividing_leaves_meshes_that_bend_without_cracks() {
    let Some(data) = data() else { return };
    for name in
        ["skin/CesiumMan.glb", "morph/AnimatedMorphCube/AnimatedMorphCube.gltf", "skin/SimpleSkin/SimpleSkin.gltf"]
    {
        let mut coarse = gltf::load(&data.join("scenes/features").join(name)).expect("is valid");
        let mut fine = coarse.clone();
        let (low, high) = coarse.bounds().expect("is not empty");
        let added = tessellate::tessellate(&mut fine, 0.02 * low.distance(high), 1_000_000);
        // Divides the divided mesh once more.
        let again = tessellate::tessellate(&mut fine, 0.011 * low.distance(high), 1_000_000);
        assert!(added > 100 && again > 100, "{name}: {added} {again}");
        let at_rest = fine.meshes[0].posed(fine.instances[0].pose.as_ref().expect("bends"));
        for (kept, posed) in fine.meshes[0].vertices.iter().zip(&at_rest) {
            assert!(kept.position.distance(posed.position) < 1e-5 * low.distance(high) as f32);
            assert!(kept.normal.distance(posed.normal) < 1e-3, "{name}: {} {}", kept.normal, posed.normal);
        }
        let end = coarse.animations().next().expect("has one").2;
        for part in [0.0, 0.3, 0.8] {
            coarse.pose(0, part * end);
            fine.pose(0, part * end);
            let of = |scene: &Scene| -> (Mesh, f64) {
                let frozen = scene.frozen();
                (frozen.meshes[0].clone(), tessellate::area(&frozen))
            };
            let ((coarse_mesh, coarse_area), (fine_mesh, fine_area)) = (of(&coarse), of(&fine));
            // Flat triangles are divided into flat pieces, whose edges meet where the edges in the file meet.
            assert!((fine_area / coarse_area - 1.0).abs() < 1e-4, "{name}: {fine_area} for {coarse_area}");
            let (was, is) = (open_edges(&coarse_mesh), open_edges(&fine_mesh));
            println!("{name}: {was} m of open edges before the division, {is} m after");
            assert!((was - is).abs() <= 1e-3 * was + 1e-9, "{name}: {was} m of open edges became {is} m");
        }
    }
}

/// Total length of edges that have a triangle on one side only. Edges are identified by vertex indices.
fn open_edges(mesh: &Mesh) -> f64 {
    let mut count = std::collections::BTreeMap::new();
    for corners in mesh.indices.chunks_exact(3) {
        for i in 0..3 {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            *count.entry((a.min(b), a.max(b))).or_insert(0) += 1;
        }
    }
    let length = |&(a, b): &(u32, u32)| {
        f64::from(mesh.vertices[a as usize].position.distance(mesh.vertices[b as usize].position))
    };
    count.iter().filter(|(_, n)| **n == 1).map(|(edge, _)| length(edge)).sum()
}

#[test]
fn a_frozen_scene_is_met_by_rays_where_it_stands() {
    let Some(data) = data() else { return };
    let mut scene = gltf::load(&data.join("scenes/features/skin/SimpleSkin/SimpleSkin.gltf")).expect("is valid");
    scene.pose(0, 1.0);
    let frozen = scene.frozen();
    assert!(frozen.rig.is_none() && frozen.instances.iter().all(|i| i.pose.is_none()));
    assert!(frozen.meshes.iter().all(|mesh| mesh.deform.is_none()));
    let world = World::new(&frozen);
    // The upper end has swung to the left.
    let hit = |x: f64, y: f64| world.nearest(DVec3::new(x, y, 1.0), DVec3::NEG_Z, Sides::Both).is_some();
    assert!(hit(-0.9, 1.0) && !hit(0.4, 1.9), "{} {}", hit(-0.9, 1.0), hit(0.4, 1.9));
}
