//! What is too large for shaders to number.

use crate::error::{Error, Result};
use crate::scene::{Instance, Mesh, Scene};

/// Most vertices of all meshes and all instances that bend: shaders count their words in 32 bits.
const MOST_VERTICES: usize = u32::MAX as usize / 16;

/// Most triangles of a mesh that bends: their numbers are kept in floats.
const MOST_BENT: usize = 1 << 24;

/// Refuses what shaders cannot number, before anything of it is copied.
pub(super) fn check(scene: &Scene) -> Result<()> {
    let bent = |m: &&Mesh| m.deform.is_some() && m.triangle_count() > MOST_BENT;
    if let Some(mesh) = scene.meshes.iter().find(bent) {
        let name = &mesh.name;
        return Err(Error::TooLarge(format!(
            "mesh '{name}' bends and has more than {MOST_BENT} triangles; simplify it"
        )));
    }
    let posed = scene.instances.iter().map(|i| &scene.meshes[i.mesh]).filter(|mesh| mesh.deform.is_some());
    let all: usize = scene.meshes.iter().chain(posed).map(|mesh| mesh.vertices.len()).sum();
    if all > MOST_VERTICES {
        return Err(Error::TooLarge(format!(
            "{all} vertices of all meshes, and of all instances that bend, but {MOST_VERTICES} can be held; simplify \
             meshes or take fewer instances"
        )));
    }
    let lacks_pose = |i: &&Instance| scene.meshes[i.mesh].deform.is_some() && i.pose.is_none();
    match scene.instances.iter().find(lacks_pose) {
        Some(instance) => Err(Error::Nothing(format!("'{}' bends and has no pose: give it one", instance.name))),
        None => Ok(()),
    }
}
