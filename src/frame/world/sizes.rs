//! Limits of the indices that shaders use.

use crate::error::{Error, Result};
use crate::scene::{Instance, Mesh, Scene};

/// Maximum number of vertices of all meshes and all deformed instances. Shaders count their words in 32 bits.
const MOST_VERTICES: usize = u32::MAX as usize / 16;

/// Maximum number of triangles of a deformed mesh. Their numbers are stored in floats.
const MOST_BENT: usize = 1 << 24;

/// Rejects scenes that shaders cannot number, before anything is copied.
pub(super) fn check(scene: &Scene) -> Result<()> {
    let bent = |m: &&Mesh| m.deform.is_some() && m.triangle_count() > MOST_BENT;
    if let Some(mesh) = scene.meshes.iter().find(bent) {
        let name = &mesh.name;
        return Err(Error::TooLarge(format!(
            "mesh '{name}' is deformed and has more than {MOST_BENT} triangles; simplify it"
        )));
    }
    let posed = scene.instances.iter().map(|i| &scene.meshes[i.mesh]).filter(|mesh| mesh.deform.is_some());
    let placing = scene.meshes.iter().filter(|mesh| mesh.placing.is_some());
    let all: usize = scene.meshes.iter().chain(posed).chain(placing).map(|mesh| mesh.vertices.len()).sum();
    if all > MOST_VERTICES {
        return Err(Error::TooLarge(format!(
            "{all} vertices of all meshes and deformed instances exceed the limit of {MOST_VERTICES}; simplify \
             meshes or use fewer instances"
        )));
    }
    let lacks_pose = |i: &&Instance| scene.meshes[i.mesh].deform.is_some() && i.pose.is_none();
    match scene.instances.iter().find(lacks_pose) {
        Some(instance) => Err(Error::Nothing(format!("'{}' is deformed but has no pose: give it one", instance.name))),
        None => Ok(()),
    }
}
