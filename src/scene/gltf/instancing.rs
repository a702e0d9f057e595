//! EXT_mesh_gpu_instancing: one node, many instances.

use glam::{DAffine3, DQuat, DVec3};

use super::Notes;
use crate::Result;
use crate::scene::accessor::{Accessor, Accessors, Semantic};
use crate::scene::json::Object;

/// Limit on the instances of a scene, since any number of nodes may share a list.
const MAX_INSTANCES: usize = 1 << 20;

/// Transforms of a node's instances relative to the node; only the identity without the extension. `before` is the
/// number of instances that already exist.
pub(super) fn offsets(accessors: &Accessors, node: &Object, before: usize, notes: &mut Notes) -> Result<Vec<DAffine3>> {
    let Some(extension) = node.extension("EXT_mesh_gpu_instancing")? else { return Ok(vec![DAffine3::IDENTITY]) };
    let attributes =
        extension.object("attributes")?.ok_or_else(|| extension.error("has no attributes: export the file again"))?;
    let mut count = None;
    let mut open = |name: &str, semantic| -> Result<Option<Accessor>> {
        let Some(index) = attributes.index(name)? else { return Ok(None) };
        let accessor = accessors.open(index, &format!("{name} of {}", extension.place), semantic, &attributes)?;
        let first = *count.get_or_insert(accessor.count);
        if first != accessor.count {
            return Err(accessor.error(format!(
                "has {} elements, but other attributes of the instances have {first}: export the file again",
                accessor.count
            )));
        }
        Ok(Some(accessor))
    };
    let translations = open("TRANSLATION", Semantic::Vector)?;
    let rotations = open("ROTATION", Semantic::InstanceRotation)?;
    let scales = open("SCALE", Semantic::Vector)?;
    let Some(count) = count else {
        notes.count("Instanced nodes without transforms drawn once", 1);
        return Ok(vec![DAffine3::IDENTITY]);
    };
    if before.saturating_add(count) > MAX_INSTANCES {
        return Err(extension.error(format!("the scene has more than {MAX_INSTANCES} instances; simplify it")));
    }
    let vector = |accessor: &Option<Accessor>, at: usize, absent: DVec3| -> Result<DVec3> {
        let Some(accessor) = accessor else { return Ok(absent) };
        let vector = DVec3::from(accessor.floats::<3>(at).map(f64::from));
        if !vector.is_finite() {
            return Err(accessor.error(format!("element {at} is not finite: export the file again")));
        }
        Ok(vector)
    };
    let rotation = |at: usize| -> Result<DQuat> {
        let Some(accessor) = &rotations else { return Ok(DQuat::IDENTITY) };
        let rotation = DQuat::from_array(accessor.floats::<4>(at).map(f64::from));
        let length = rotation.length();
        if !(length > 1e-6 && length.is_finite()) {
            return Err(accessor.error(format!("element {at} has no length: export the file again")));
        }
        Ok(rotation / length)
    };
    let offset = |at: usize| -> Result<DAffine3> {
        let (translation, scale) = (vector(&translations, at, DVec3::ZERO)?, vector(&scales, at, DVec3::ONE)?);
        Ok(DAffine3::from_scale_rotation_translation(scale, rotation(at)?, translation))
    };
    (0..count).map(offset).collect()
}
