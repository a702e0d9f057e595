//! Nodes and skins: the rig's nodes, and the scene's objects attached to them.

use super::{Document, FLOAT};
use crate::scene::animation::{Hold, Local, Rig, Skin, Target, beam, rigid};
use crate::scene::{Instance, LightKind, Scene};
use glam::{DAffine3, DQuat, DVec3};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// The nodes of the file: those of the rig at the same indices, then nodes that only hold an object.
pub(super) struct Tree<'a> {
    rig: Option<&'a Rig>,
    pub nodes: Vec<Value>,
    /// Nodes without a parent.
    pub roots: Vec<usize>,
    /// By instance of the scene, the node that draws it.
    pub instances: Vec<usize>,
}

impl<'a> Tree<'a> {
    /// All nodes of a scene at rest.
    pub(super) fn new(document: &mut Document, scene: &'a Scene) -> Result<Self, String> {
        let rig = scene.rig.as_ref();
        let mut tree = Self { rig, nodes: Vec::new(), roots: Vec::new(), instances: Vec::new() };
        if let Some(rig) = rig {
            tree.grow(document, rig);
        }
        for (index, instance) in scene.instances.iter().enumerate() {
            let node = tree.instance(document, scene, index, instance)?;
            tree.instances.push(node);
        }
        let parts = rig.map(Rig::parts);
        for (index, light) in scene.lights.iter().enumerate() {
            let turn = DQuat::from_rotation_arc(DVec3::NEG_Z, light.direction.as_dvec3().normalize_or(DVec3::NEG_Z));
            let position = if light.kind == LightKind::Directional { DVec3::ZERO } else { light.position };
            let mut place = DAffine3::from_rotation_translation(turn, position);
            let on = parts.and_then(|parts| parts.lights.get(index)).copied();
            // A light shines along its node's -Z; rotation about that axis does not matter.
            if let Some(world) = on.and_then(|node| rig.map(|rig| rig.world(node))) {
                let (at, along) = beam(world);
                let is_there = light.kind == LightKind::Directional || near(at, light.position);
                let is_turned = light.kind == LightKind::Point || along.distance(light.direction) < 1e-6;
                if is_there && is_turned {
                    place = world;
                }
            }
            let reference = json!({ "KHR_lights_punctual": { "light": index } });
            tree.hang(&light.name, on, DAffine3::IDENTITY, place, [("extensions", reference)])?;
            document.extensions.insert("KHR_lights_punctual");
        }
        for (index, camera) in scene.cameras.iter().enumerate() {
            let on = parts.and_then(|parts| parts.cameras.get(index)).copied();
            let mut place = camera.world_from_camera;
            if let Some(world) = on.and_then(|node| rig.map(|rig| rig.world(node)))
                && same(rigid(world), place)
            {
                place = world;
            }
            tree.hang(&camera.name, on, DAffine3::IDENTITY, place, [("camera", json!(index))])?;
        }
        Ok(tree)
    }

    /// Adds the rig's nodes, still without objects.
    fn grow(&mut self, document: &mut Document, rig: &Rig) {
        let parts = rig.parts();
        for node in &parts.nodes {
            let mut value = json!({});
            write_local(&mut value, node.rest);
            if node.hidden {
                hide(document, &mut value, true);
            }
            self.nodes.push(value);
        }
        for (index, node) in parts.nodes.iter().enumerate() {
            self.adopt(node.parent, index);
        }
        // An animation pointer may only name an existing field.
        for channel in parts.animations.iter().flat_map(|animation| &animation.channels) {
            if let Target::Visible(node) = channel.target {
                hide(document, &mut self.nodes[node], parts.nodes[node].hidden);
            }
        }
    }

    fn adopt(&mut self, parent: Option<usize>, child: usize) {
        let Some(parent) = parent else { return self.roots.push(child) };
        match self.nodes[parent].get_mut("children").and_then(Value::as_array_mut) {
            Some(children) => children.push(json!(child)),
            None => self.nodes[parent]["children"] = json!([child]),
        }
    }

    fn instance(
        &mut self,
        document: &mut Document,
        scene: &Scene,
        index: usize,
        instance: &Instance,
    ) -> Result<usize, String> {
        let placed = self.rig.and_then(|rig| rig.parts().instances.get(index));
        let hold = placed.map_or(Hold::World, |placed| placed.hold);
        let refused = |why: &str| Err(format!("instance '{}' {why}", instance.name));
        let mut members = Map::new();
        members.insert("mesh".into(), json!(instance.mesh));
        let bends = scene.meshes[instance.mesh].deform.is_some();
        if let Some(pose) = instance.pose.as_ref().filter(|_| bends) {
            if !pose.weights.is_empty() {
                members.insert("weights".into(), json!(pose.weights));
            }
            if pose.joints.iter().any(|joint| joint.matrix3.determinant() < 0.0) {
                return refused("is mirrored by its skin, which cannot be written; mirror its mesh instead");
            }
            if !pose.joints.is_empty() && !matches!(hold, Hold::Skin(_)) {
                return refused("is deformed by joints without a rig; write the frozen scene");
            }
        }
        if bends != instance.pose.is_some() {
            return refused("needs both a deforming mesh and a pose, or neither of them");
        }
        let mut on = placed.map(|placed| placed.node);
        let (mut offset, mut place) = (DAffine3::IDENTITY, instance.world_from_model);
        match (hold, on.zip(self.rig)) {
            (Hold::Skin(skin), Some((node, rig))) => {
                members.insert("skin".into(), json!(skin));
                place = rig.world(node);
            }
            (Hold::Node(own), _) => offset = own,
            // The instance is fixed in the world, whatever its node does.
            (_, Some((node, rig))) if rig.moves_node(node) => {
                if rig.fades_node(node) {
                    return refused("is fixed, but a moving node hides it; hide it by a fixed node");
                }
                on = None;
            }
            _ => {}
        }
        if !instance.hidden || on.zip(self.rig).is_some_and(|(node, rig)| !rig.is_shown(node)) {
            return self.hang(&instance.name, on, offset, place, members);
        }
        // Hidden by itself: other objects on its node stay visible.
        let local = self.local(&instance.name, on, offset, place)?;
        let node = self.push(on, &instance.name, local, members);
        hide(document, &mut self.nodes[node], true);
        Ok(node)
    }

    /// Transform relative to its node of an object at `place`. `offset` is the expected value; if the two disagree,
    /// `place` is used.
    fn local(&self, name: &str, on: Option<usize>, offset: DAffine3, place: DAffine3) -> Result<DAffine3, String> {
        let Some((node, rig)) = on.zip(self.rig) else { return Ok(place) };
        let world = rig.world(node);
        let local = if same(world * offset, place) { offset } else { world.inverse() * place };
        if !local.is_finite() {
            return Err(format!("'{name}' is on a node without volume (scale 0); give the node a scale"));
        }
        Ok(local)
    }

    /// Attaches an object to a node, or to none (see `local`). Returns the node that holds it: the given node if it is
    /// free.
    fn hang<K: Into<String>>(
        &mut self,
        name: &str,
        on: Option<usize>,
        offset: DAffine3,
        place: DAffine3,
        members: impl IntoIterator<Item = (K, Value)>,
    ) -> Result<usize, String> {
        let local = self.local(name, on, offset, place)?;
        let Some(parent) = on else { return Ok(self.push(None, name, local, members)) };
        if local != DAffine3::IDENTITY || self.nodes[parent].get("name").is_some() {
            return Ok(self.push(Some(parent), name, local, members));
        }
        self.nodes[parent]["name"] = json!(name);
        fill(&mut self.nodes[parent], members);
        Ok(parent)
    }

    /// Adds a node.
    fn push<K: Into<String>>(
        &mut self,
        parent: Option<usize>,
        name: &str,
        local: DAffine3,
        members: impl IntoIterator<Item = (K, Value)>,
    ) -> usize {
        let mut node = json!({ "name": name });
        fill(&mut node, members);
        let (scale, rotation, translation) = local.to_scale_rotation_translation();
        let again = DAffine3::from_scale_rotation_translation(scale, rotation, translation);
        let is_told = again.matrix3.abs_diff_eq(local.matrix3, 1e-9 * scale.abs().max_element());
        let scale = if scale.abs_diff_eq(DVec3::ONE, 1e-9) { DVec3::ONE } else { scale };
        let rotation = if rotation.angle_between(DQuat::IDENTITY) > 0.0 { rotation } else { DQuat::IDENTITY };
        let parts = Local::Parts { translation, rotation, scale };
        write_local(&mut node, if is_told { parts } else { Local::Matrix(local) });
        self.nodes.push(node);
        self.adopt(parent, self.nodes.len() - 1);
        self.nodes.len() - 1
    }
}

/// Adds members to a node; extensions are merged with the existing ones.
fn fill<K: Into<String>>(node: &mut Value, members: impl IntoIterator<Item = (K, Value)>) {
    for (key, value) in members {
        let key = key.into();
        match (node.get_mut(&key).and_then(Value::as_object_mut), value) {
            (Some(there), Value::Object(more)) => there.extend(more),
            (_, value) => node[key] = value,
        }
    }
}

/// Writes KHR_node_visibility.
fn hide(document: &mut Document, node: &mut Value, hidden: bool) {
    document.extensions.insert("KHR_node_visibility");
    node["extensions"]["KHR_node_visibility"] = json!({ "visible": !hidden });
}

/// Writes translation, rotation and scale, or the matrix of a matrix node.
fn write_local(node: &mut Value, local: Local) {
    let (translation, rotation, scale) = match local {
        Local::Parts { translation, rotation, scale } => (translation, rotation, scale),
        Local::Matrix(matrix) => {
            node["matrix"] = json!(glam::DMat4::from(matrix).to_cols_array());
            return;
        }
    };
    if translation != DVec3::ZERO {
        node["translation"] = json!(translation.to_array());
    }
    if rotation != DQuat::IDENTITY {
        node["rotation"] = json!(rotation.to_array());
    }
    if scale != DVec3::ONE {
        node["scale"] = json!(scale.to_array());
    }
}

/// The rig's skins.
pub(super) fn skins(document: &mut Document, scene: &Scene) -> Vec<Value> {
    // Skins of several instances of a mesh have the same matrices.
    let mut known = BTreeMap::new();
    let mut write = |skin: &Skin| {
        let column = |bind: &DAffine3| glam::DMat4::from(*bind).as_mat4().to_cols_array();
        let matrices: Vec<f32> = skin.inverse_bind.iter().flat_map(column).collect();
        let bytes: Vec<u8> = bytemuck::cast_slice(&matrices).to_vec();
        let accessor = *known.entry(bytes).or_insert_with_key(|bytes| {
            let view = document.view(bytes);
            let count = skin.inverse_bind.len();
            let accessor = json!({ "bufferView": view, "componentType": FLOAT, "count": count, "type": "MAT4" });
            document.accessors.push(accessor);
            document.accessors.len() - 1
        });
        json!({ "joints": skin.joints, "inverseBindMatrices": accessor })
    };
    scene.rig.iter().flat_map(|rig| &rig.parts().skins).map(&mut write).collect()
}

/// Whether two positions are equal up to rounding.
fn near(a: DVec3, b: DVec3) -> bool {
    a.distance(b) <= 1e-9 * (1.0 + a.length())
}

/// Whether two transforms are equal up to rounding.
fn same(a: DAffine3, b: DAffine3) -> bool {
    let size = a.matrix3.to_cols_array().iter().fold(0.0_f64, |size, x| size.max(x.abs()));
    near(a.translation, b.translation) && a.matrix3.abs_diff_eq(b.matrix3, 1e-9 * size)
}
