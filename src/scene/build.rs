//! Scenes made in code: the contents of `assets/`, and small scenes for tests and measurements.
//!
//! Every builder is a pure function of its arguments. Light is interpolated per vertex, so large flat faces are grids
//! with a given edge length.

mod atrium;
mod cornell;
mod fabric;
mod masonry;
mod shapes;
mod showpiece;

pub use atrium::atrium;
pub use cornell::{CornellSurface, cornell};
pub use fabric::{drape, torus_knot};
pub use masonry::{ArchShape, arch, ring, steps, vault_dome};
pub use shapes::{Surface, cuboid, lathe, loft_square, patch, quad, sheet, spans, sphere};
pub use showpiece::{Fineness, showpiece};

use super::{Camera, Instance, Material, Mesh, Phong, Primitive, Projection, Scene};
use glam::{DAffine3, DMat3, DVec3, Vec3};

/// Adds a mesh made of surfaces and their materials, one primitive each. Returns the index of the mesh.
///
/// With a double-sided material each triangle is followed by the same one seen from its back.
pub(crate) fn add_mesh(scene: &mut Scene, name: &str, parts: Vec<(Surface, usize)>) -> usize {
    let mut mesh = Mesh { name: name.into(), ..Mesh::default() };
    for (surface, material) in parts {
        let sides = if scene.materials[material].double_sided { surface.two_sided() } else { surface };
        push_primitive(&mut mesh, sides, material);
    }
    scene.meshes.push(mesh);
    scene.meshes.len() - 1
}

fn push_primitive(mesh: &mut Mesh, surface: Surface, material: usize) {
    let base = mesh.vertices.len() as u32;
    let first_index = mesh.indices.len() as u32;
    mesh.vertices.extend(surface.vertices);
    mesh.indices.extend(surface.indices.iter().map(|index| base + index));
    mesh.primitives.push(Primitive { first_index, index_count: surface.indices.len() as u32, material });
}

/// Adds a material. Returns its index.
pub(crate) fn add_material(scene: &mut Scene, material: Material) -> usize {
    scene.materials.push(material);
    scene.materials.len() - 1
}

/// A material with an exact Phong lobe; with `specular` zero it is diffuse only.
pub(crate) fn phong(name: &str, diffuse: [f32; 3], specular: [f32; 3], exponent: f32) -> Material {
    Material {
        name: name.into(),
        base_color: Vec3::from(diffuse).extend(1.0),
        metallic: 0.0,
        phong: Some(Phong { specular: Vec3::from(specular), exponent }),
        ..Material::default()
    }
}

/// A metallic-roughness material.
pub(crate) fn rough(name: &str, base_color: [f32; 3], metallic: f32, roughness: f32) -> Material {
    Material {
        name: name.into(),
        base_color: Vec3::from(base_color).extend(1.0),
        metallic,
        roughness,
        ..Material::default()
    }
}

/// Adds an instance of a mesh.
pub(crate) fn place(scene: &mut Scene, name: &str, mesh: usize, world_from_model: DAffine3) {
    scene.instances.push(Instance { name: name.into(), mesh, world_from_model, ..Instance::default() });
}

/// Exact quarter turns about +Y, then a translation; one turn takes +Z to +X.
pub(crate) fn turned(quarters: i32, translation: DVec3) -> DAffine3 {
    let (sine, cosine) = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarters.rem_euclid(4) as usize];
    let x = DVec3::new(cosine, 0.0, -sine);
    let z = DVec3::new(sine, 0.0, cosine);
    DAffine3::from_mat3_translation(DMat3::from_cols(x, DVec3::Y, z), translation)
}

/// A pinhole camera at `eye` that looks at `target`, +Y up in the picture.
pub(crate) fn camera(name: &str, eye: DVec3, target: DVec3, yfov: f32) -> Camera {
    let back = (eye - target).normalize();
    let right = DVec3::Y.cross(back).normalize();
    let rotation = DMat3::from_cols(right, back.cross(right), back);
    Camera {
        name: name.into(),
        world_from_camera: DAffine3::from_mat3_translation(rotation, eye),
        projection: Projection::Perspective { yfov },
    }
}
