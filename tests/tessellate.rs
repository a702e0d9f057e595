//! Dividing large triangles refines the tessellation of a surface and changes nothing else.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use lightskin::scene::build::{CornellSurface, cornell};
use lightskin::scene::tessellate::{area, tessellate};
use lightskin::scene::{Instance, Mesh, Primitive, Scene, Vertex};
use std::collections::HashMap;

/// Number of triangles at each edge, in either direction. Vertices at the same position count as one.
fn edges(mesh: &Mesh) -> HashMap<[[u32; 3]; 2], usize> {
    let place = |i: u32| mesh.vertices[i as usize].position.to_array().map(f32::to_bits);
    let mut count = HashMap::new();
    for corners in mesh.indices.chunks_exact(3) {
        for i in 0..3 {
            let mut ends = [place(corners[i]), place(corners[(i + 1) % 3])];
            ends.sort_unstable();
            *count.entry(ends).or_insert(0) += 1;
        }
    }
    count
}

fn longest(scene: &Scene) -> f64 {
    let mut longest = 0.0_f64;
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh];
        for corners in mesh.indices.chunks_exact(3) {
            for i in 0..3 {
                let at =
                    |i: u32| instance.world_from_model.transform_point3(mesh.vertices[i as usize].position.as_dvec3());
                longest = longest.max(at(corners[i]).distance(at(corners[(i + 1) % 3])));
            }
        }
    }
    longest
}

/// An octahedron, which is a closed mesh, as two instances with different scales.
fn octahedra() -> Scene {
    let tips = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let vertices = tips.map(|position| Vertex { position, normal: position, ..Vertex::default() }).to_vec();
    let indices: Vec<u32> = vec![0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5];
    let index_count = indices.len() as u32;
    let primitives = vec![Primitive { first_index: 0, index_count, material: 0 }];
    let stretch = DAffine3::from_scale_rotation_translation(
        DVec3::new(1.0, 3.0, 0.5),
        DQuat::from_rotation_x(0.7),
        DVec3::new(5.0, 0.0, 0.0),
    );
    let instance =
        |world_from_model| Instance { name: "octahedron".into(), mesh: 0, world_from_model, ..Instance::default() };
    Scene {
        meshes: vec![Mesh { name: "octahedron".into(), vertices, indices, primitives, ..Mesh::default() }],
        instances: vec![instance(DAffine3::IDENTITY), instance(stretch)],
        ..Scene::default()
    }
}

#[test]
fn no_edge_stays_longer_and_no_crack_opens() {
    let mut scene = octahedra();
    let (before, surface) = (scene.meshes[0].triangle_count(), area(&scene));
    assert!(edges(&scene.meshes[0]).values().all(|n| *n == 2), "the mesh must be closed at the start");
    let added = tessellate(&mut scene, 0.3, 1_000_000);
    assert_eq!(scene.meshes[0].triangle_count(), before + added);
    assert!(longest(&scene) <= 0.3, "an edge of {} m is left", longest(&scene));
    assert!(
        edges(&scene.meshes[0]).values().all(|n| *n == 2),
        "every edge must still have two triangles, without T-junctions"
    );
    assert!((area(&scene) / surface - 1.0).abs() < 1e-6, "flat triangles must keep their area");
    assert!(scene.meshes[0].vertices.iter().all(|v| (v.normal.length() - 1.0).abs() < 1e-5));
}

#[test]
fn fine_meshes_stay_as_they_are_and_materials_keep_their_triangles() {
    let coarse = cornell(CornellSurface::Diffuse, 0.5);
    let mut scene = coarse.clone();
    assert_eq!(tessellate(&mut scene, 10.0, 1_000_000), 0);
    assert_eq!(scene.meshes[0].vertices, coarse.meshes[0].vertices);
    tessellate(&mut scene, 0.1, 1_000_000);
    let surface_of = |scene: &Scene, material: usize| -> f64 {
        let mesh = &scene.meshes[0];
        let of = mesh.triangle_materials();
        let triangle = |t: usize| {
            let [a, b, c] = mesh.triangle(t).map(|i| mesh.vertices[i].position.as_dvec3());
            0.5 * (b - a).cross(c - a).length()
        };
        (0..mesh.triangle_count()).filter(|t| of[*t] == material).map(triangle).sum()
    };
    for material in 0..coarse.materials.len() {
        let (was, is) = (surface_of(&coarse, material), surface_of(&scene, material));
        assert!((was - is).abs() <= 1e-5 * was, "material {material}: {was} m^2 became {is} m^2");
    }
}

#[test]
fn a_mesh_never_grows_beyond_the_bound() {
    let mut scene = octahedra();
    tessellate(&mut scene, 1e-6, 5000);
    assert!(scene.meshes[0].triangle_count() <= 5000);
}
