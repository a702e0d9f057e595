//! Invalid but common surfaces and materials: inverted, degenerate, black, white.

use super::oracle::{brute_force_picture, cast_vals, difference, largest, layers};
use super::{Case, Outcome};
use crate::bake::{Cache, CacheSet};
use crate::error::Result;
use crate::frame::ProxyWeight;
use crate::gpu::Gpu;
use crate::lab::knobs::{Gi, Knobs};
use crate::lab::shot::{Shot, shoot, small};
use crate::lab::worlds::{SPOT, add, baked, camera, corner, lamp, phong};
use crate::scene::build::sphere;
use crate::scene::{Instance, LightKind, Mesh, Scene, Vertex};
use glam::{DAffine3, DQuat, DVec3, Vec3, dvec3, vec3};
use std::f64::consts::{PI, TAU};

/// Settings of a brute-force frame.
fn brute_force() -> Knobs {
    Knobs { gi: Gi::BruteForce, ..small() }
}

pub(super) fn cases() -> Vec<Case> {
    let halves = "the same pictures as with the nodes' transforms applied to the vertices, within 1e-3";
    let oracle = "f64 brute force at the pixels within 1e-3";
    let mut all = vec![
        Case::new("nodes", "every node mirrored", halves, |gpu| nodes(gpu, dvec3(-1.0, 1.0, 1.0))),
        Case::new("nodes", "every node scaled by 0.02, 5, 1", halves, |gpu| nodes(gpu, dvec3(0.02, 5.0, 1.0))),
        Case::new("nodes", "every node mirrored twice and scaled unevenly", halves, |gpu| {
            nodes(gpu, dvec3(-0.5, 1.5, -1.0))
        }),
        Case::new(
            "triangles",
            "300 degenerate triangles on the corners of others",
            "exactly the same caches, VALs and pictures as without",
            without_area,
        ),
        Case::new(
            "triangles",
            "300 slivers 1e-7 m wide within the surfaces",
            "the same picture by brute force within 1e-3",
            slivers,
        ),
        Case::new("normals", "normals of the wall oppose its winding", "f64 rays' VALs, f64 brute force", opposed),
        Case::new("normals", "all normals are zero", "no broken value, direct light as with flat normals", zero),
        Case::new("black", "every albedo 0", "exactly no indirect light", black),
        Case::new("white", "lamp in a sphere of albedo 1", "Ulbricht: L = I / (pi r^2) within 2 %", white),
        Case::new("white", "VALs of that sphere", "flux 4 pi I within 1e-4", furnace_flux),
    ];
    for k in [1.0, 8.0, 64.0, 512.0, 2048.0] {
        all.push(Case::new("exponent", format!("a frame by brute force, k = {k}"), oracle, move |gpu| {
            let scene = corner(&[SPOT], k);
            let shot = shoot(gpu, &scene, None, &brute_force())?;
            let [diffuse, glossy] = brute_force_picture(&scene, &shot);
            let lit = largest(&shot.glossy) > 0.0;
            Ok(Outcome::all([("diffuse", diffuse, 1e-3), ("glossy", glossy, 1e-3)]).of(&[&shot]).provided(lit, "dark"))
        }));
    }
    all
}

/// The scene with each node's transform applied to its vertices. Normals keep the lengths that the transform gives
/// them, because they are interpolated in model space.
fn flattened(scene: &Scene) -> Scene {
    let mut flat = Scene { meshes: Vec::new(), instances: Vec::new(), ..scene.clone() };
    for instance in &scene.instances {
        let (placed, mut mesh) = (instance.world_from_model, scene.meshes[instance.mesh].clone());
        let normals = placed.matrix3.inverse().transpose();
        for vertex in &mut mesh.vertices {
            vertex.position = placed.transform_point3(vertex.position.as_dvec3()).as_vec3();
            vertex.normal = (normals * vertex.normal.as_dvec3()).as_vec3();
        }
        if placed.matrix3.determinant() < 0.0 {
            mesh.indices.chunks_exact_mut(3).for_each(|triangle| triangle.swap(1, 2));
        }
        let mesh_index = flat.meshes.len();
        flat.instances.push(Instance { mesh: mesh_index, world_from_model: DAffine3::IDENTITY, ..instance.clone() });
        flat.meshes.push(mesh);
    }
    flat
}

/// The caches of a scene for its flattened twin.
fn flattened_caches(scene: &Scene, caches: &CacheSet) -> CacheSet {
    let mut flat = CacheSet { spacing: caches.spacing, ..CacheSet::default() };
    for (i, (instance, &model)) in scene.instances.iter().zip(&caches.instance_model).enumerate() {
        let (placed, mut model) = (instance.world_from_model, caches.models[model].clone());
        let normals = placed.matrix3.inverse().transpose();
        for cache in &mut model.caches {
            let position = placed.transform_point3(cache.position.as_dvec3()).as_vec3();
            let normal = (normals * cache.normal.as_dvec3()).normalize().as_vec3();
            *cache = Cache { position, normal, ..*cache };
        }
        model.mesh = i;
        flat.instance_model.push(flat.models.len());
        flat.models.push(model);
    }
    flat
}

/// A scene whose nodes undo a deformation applied to their meshes.
fn nodes(gpu: &Gpu, stretch: DVec3) -> Result<Outcome> {
    let mut scene = corner(&[SPOT, LightKind::Point], 40.0);
    let stretch = DAffine3::from_scale(stretch);
    for i in 0..scene.instances.len() {
        // Floor and wall keep their shape in the world; the ball is stretched once more.
        let undo = if i < 2 { stretch.inverse() } else { DAffine3::IDENTITY };
        let mesh: &mut Mesh = &mut scene.meshes[i];
        let normals = undo.matrix3.inverse().transpose();
        for vertex in &mut mesh.vertices {
            vertex.position = undo.transform_point3(vertex.position.as_dvec3()).as_vec3();
            vertex.normal = (normals * vertex.normal.as_dvec3()).normalize().as_vec3();
        }
        if undo.matrix3.determinant() < 0.0 {
            mesh.indices.chunks_exact_mut(3).for_each(|triangle| triangle.swap(1, 2));
        }
        scene.instances[i].world_from_model *= stretch;
    }
    let caches = baked(&scene, 0.5, 8)?;
    let flat = flattened(&scene);
    let a = shoot(gpu, &scene, Some(&caches), &small())?;
    let b = shoot(gpu, &flat, Some(&flattened_caches(&scene, &caches)), &small())?;
    let [c, d] = [shoot(gpu, &scene, None, &brute_force())?, shoot(gpu, &flat, None, &brute_force())?];
    let lit = largest(&a.direct).min(largest(&a.diffuse)).min(largest(&a.glossy)) > 0.0;
    let errors = [("caches", layers(&b, &a, 1.0), 1e-3), ("brute force", layers(&d, &c, 1.0), 1e-3)];
    Ok(Outcome::all(errors).of(&[&a, &b, &c, &d]).provided(lit, "a layer is dark"))
}

/// Adds triangles to each mesh, made by `shape` from the corners of its own triangles.
fn with_triangles(scene: &Scene, shape: impl Fn(&mut Mesh, [u32; 3], usize) -> [u32; 3]) -> Scene {
    let mut scene = scene.clone();
    for mesh in &mut scene.meshes {
        let corners: Vec<[u32; 3]> =
            (0..100).map(|i| mesh.triangle(i % mesh.triangle_count()).map(|v| v as u32)).collect();
        for (i, corners) in corners.into_iter().enumerate() {
            let added = shape(mesh, corners, i);
            mesh.indices.extend(added);
        }
        mesh.primitives[0].index_count = mesh.indices.len() as u32;
    }
    scene
}

fn without_area(gpu: &Gpu) -> Result<Outcome> {
    let scene = corner(&[SPOT], 40.0);
    // Three equal corners, two equal corners, and an edge traversed back and forth.
    let degenerate = |_: &mut Mesh, [a, b, c]: [u32; 3], i: usize| [[a, a, a], [b, b, c], [c, a, c]][i % 3];
    let other = with_triangles(&scene, degenerate);
    let caches = [baked(&scene, 0.5, 8)?, baked(&other, 0.5, 8)?];
    let a = shoot(gpu, &scene, Some(&caches[0]), &small())?;
    let b = shoot(gpu, &other, Some(&caches[1]), &small())?;
    let changed = |of: fn(&Shot) -> &[DVec3]| of(&a).iter().zip(of(&b)).filter(|(a, b)| a != b).count() as f64;
    let pixels = changed(|s| &s.direct) + changed(|s| &s.diffuse) + changed(|s| &s.glossy);
    let vals = a.vals.iter().zip(&b.vals).filter(|(a, b)| a != b).count() as f64;
    let moved =
        a.caches.iter().zip(&b.caches).filter(|(a, b)| a != b).count() + a.caches.len().abs_diff(b.caches.len());
    let outcome = Outcome::all([("caches", moved as f64, 0.0), ("VALs", vals, 0.0), ("pixels", pixels, 0.0)]);
    Ok(outcome.of(&[&a, &b]))
}

fn slivers(gpu: &Gpu) -> Result<Outcome> {
    let scene = corner(&[SPOT], 40.0);
    let sliver = |mesh: &mut Mesh, [a, b, _]: [u32; 3], _: usize| {
        let [va, vb] = [a, b].map(|v| mesh.vertices[v as usize]);
        let aside = (vb.position - va.position).cross(va.normal).normalize_or_zero() * -1e-7;
        mesh.vertices.push(Vertex { position: va.position + aside, ..va });
        [a, b, mesh.vertices.len() as u32 - 1]
    };
    let other = with_triangles(&scene, sliver);
    let [a, b] = [shoot(gpu, &scene, None, &brute_force())?, shoot(gpu, &other, None, &brute_force())?];
    // Caches are placed by area, and slivers have some: their picture only must not have broken values.
    let c = shoot(gpu, &other, Some(&baked(&other, 0.5, 8)?), &small())?;
    Ok(Outcome::bounded(layers(&a, &b, 1.0), 1e-3).of(&[&a, &b, &c]))
}

fn opposed(gpu: &Gpu) -> Result<Outcome> {
    let mut scene = corner(&[SPOT], 10.0);
    scene.meshes[1].vertices.iter_mut().for_each(|v| v.normal = -v.normal);
    let shot = shoot(gpu, &scene, None, &brute_force())?;
    let [elsewhere, turned, brighter] = cast_vals(&scene, &shot);
    let [diffuse, glossy] = brute_force_picture(&scene, &shot);
    let caches = shoot(gpu, &scene, Some(&baked(&scene, 0.5, 8)?), &small())?;
    let errors = [
        ("VALs elsewhere", elsewhere, 5e-3),
        ("normals", turned, 1e-5),
        ("flux", brighter, 1e-4),
        ("diffuse", diffuse, 1e-3),
        ("glossy", glossy, 1e-3),
    ];
    Ok(Outcome::all(errors).of(&[&shot, &caches]))
}

/// Without vertex normals geometric ones are used: floor and wall are flat, so that nothing else changes.
fn zero(gpu: &Gpu) -> Result<Outcome> {
    let mut scene = corner(&[SPOT], 10.0);
    scene.instances.truncate(2);
    let a = shoot(gpu, &scene, None, &brute_force())?;
    scene.meshes.iter_mut().flat_map(|m| &mut m.vertices).for_each(|v| v.normal = Vec3::ZERO);
    let b = shoot(gpu, &scene, None, &brute_force())?;
    let c = shoot(gpu, &scene, Some(&baked(&scene, 0.5, 8)?), &small())?;
    Ok(Outcome::bounded(difference(&a.direct, &b.direct, 1.0), 1e-3).of(&[&a, &b, &c]))
}

fn black(gpu: &Gpu) -> Result<Outcome> {
    let mut scene = corner(&[SPOT, LightKind::Point], 10.0);
    scene.materials.iter_mut().for_each(|m| *m = phong([0.0; 3], [0.0; 3], 10.0));
    let caches = baked(&scene, 0.5, 8)?;
    let (mut shots, mut most) = (Vec::new(), 0.0_f64);
    for proxy_weight in [ProxyWeight::Irradiance, ProxyWeight::FormFactor] {
        shots.push(shoot(gpu, &scene, Some(&caches), &Knobs { proxy_weight, ..small() })?);
    }
    shots.push(shoot(gpu, &scene, None, &brute_force())?);
    for shot in &shots {
        most = most.max(largest(&shot.diffuse)).max(largest(&shot.glossy));
    }
    Ok(Outcome::bounded(most, 0.0).of(&shots.iter().collect::<Vec<_>>()))
}

/// Radius \[m\] of the white sphere.
const RADIUS: f32 = 2.0;

/// A white sphere seen from inside, with a lamp at its centre.
fn furnace() -> Scene {
    let mut scene = Scene { name: "furnace".into(), ..Scene::default() };
    let turn = DAffine3::from_quat(DQuat::from_axis_angle(dvec3(1.0, 2.0, 3.0).normalize(), 1.0));
    add(&mut scene, sphere(RADIUS, 48).reversed(), phong([1.0; 3], [0.0; 3], 1.0), turn);
    scene.lights.push(lamp(LightKind::Point));
    scene.lights[0].position = DVec3::ZERO;
    scene.cameras.push(camera(dvec3(0.0, 0.0, 1.0), dvec3(0.0, 0.3, -1.0), 1.2));
    scene
}

/// An integrating sphere receives the first bounce uniformly: `E = rho I / r^2`.
fn white(gpu: &Gpu) -> Result<Outcome> {
    let scene = furnace();
    let settings = Knobs { rsm: 96, ..small() };
    let truth = shoot(gpu, &scene, None, &Knobs { gi: Gi::BruteForce, ..settings })?;
    let caches = shoot(gpu, &scene, Some(&baked(&scene, 0.8, 8)?), &settings)?;
    let light = &scene.lights[0];
    let radiance = light.color.as_dvec3() * f64::from(light.intensity / (RADIUS * RADIUS)) / PI;
    let off = |shot: &Shot| {
        let worst = shot.diffuse.iter().map(|p| p.distance(radiance) / radiance.length()).fold(0.0, f64::max);
        let mean = shot.diffuse.iter().sum::<DVec3>() / shot.diffuse.len() as f64;
        (worst, mean.distance(radiance) / radiance.length())
    };
    let ((worst, mean), (cache_worst, cache_mean)) = (off(&truth), off(&caches));
    let outcome = Outcome::all([
        ("brute force: mean", mean, 0.02),
        ("worst pixel", worst, 0.1),
        ("caches: mean", cache_mean, 0.02),
        ("worst pixel", cache_worst, 0.1),
    ]);
    Ok(outcome.of(&[&truth, &caches]))
}

fn furnace_flux(gpu: &Gpu) -> Result<Outcome> {
    let scene = furnace();
    let shot = shoot(gpu, &scene, None, &brute_force())?;
    let flux: DVec3 = shot.vals.iter().map(|v| v.flux).sum();
    let light = &scene.lights[0];
    let all = light.color.as_dvec3() * f64::from(light.intensity) * 2.0 * TAU;
    let middle = vec3(0.0, 0.0, 0.0);
    let inwards = shot.vals.iter().all(|v| v.normal.dot(middle.as_dvec3() - v.position) > 0.0);
    Ok(Outcome::bounded(flux.distance(all) / all.length(), 1e-4).of(&[&shot]).provided(inwards, "normals look out"))
}
