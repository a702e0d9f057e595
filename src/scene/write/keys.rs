//! Animations. Equal keys are written once and shared by channels.

use super::rig::Tree;
use super::{Document, FLOAT};
use crate::scene::animation::{Animation, Channel, Interpolation, Local, Quantity, Sampler, Target};
use crate::scene::{LightKind, Projection, Scene};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Identity of a key accessor: whether it holds times, its component type, its type, and its bytes.
pub(super) type Known = (bool, u32, &'static str, Vec<u8>);

/// All animations that have channels. `tree` holds the nodes that they target.
pub(super) fn animations(document: &mut Document, scene: &Scene, tree: &Tree) -> Result<Vec<Value>, String> {
    let mut animations = Vec::new();
    let all = scene.rig.iter().flat_map(|rig| &rig.parts().animations);
    for animation in all.filter(|animation| !animation.channels.is_empty()) {
        animations.push(write(document, scene, tree, animation)?);
    }
    // No other view was added in between, so all key accessors use this one.
    let keys = std::mem::take(&mut document.keys);
    if !keys.is_empty() {
        document.view(&keys);
    }
    Ok(animations)
}

fn write(document: &mut Document, scene: &Scene, tree: &Tree, animation: &Animation) -> Result<Value, String> {
    let (mut samplers, mut channels) = (Vec::new(), Vec::new());
    let mut known = BTreeMap::new();
    for channel in &animation.channels {
        let targets = targets(scene, tree, channel).map_err(|why| format!("animation '{}' {why}", animation.name))?;
        if targets.iter().any(|target| target["path"] == "pointer") {
            document.extensions.insert("KHR_animation_pointer");
        }
        let Channel { sampler, target } = channel;
        let input = document.times(&sampler.times);
        let output = document.values(sampler, target);
        let interpolation = match sampler.interpolation {
            Interpolation::Step => "STEP",
            Interpolation::Linear => "LINEAR",
            Interpolation::Cubic => "CUBICSPLINE",
        };
        let sampler = *known.entry((input, output, interpolation)).or_insert_with(|| {
            samplers.push(json!({ "input": input, "output": output, "interpolation": interpolation }));
            samplers.len() - 1
        });
        channels.extend(targets.into_iter().map(|target| json!({ "sampler": sampler, "target": target })));
    }
    Ok(json!({ "name": animation.name, "samplers": samplers, "channels": channels }))
}

/// The glTF targets of a channel.
fn targets(scene: &Scene, tree: &Tree, channel: &Channel) -> Result<Vec<Value>, String> {
    let Some(rig) = &scene.rig else { return Ok(Vec::new()) };
    let parts = rig.parts();
    let node = |node: usize, path: &str| match parts.nodes[node].rest {
        Local::Parts { .. } => Ok(vec![json!({ "node": node, "path": path })]),
        Local::Matrix(_) => {
            Err(format!("moves node {node}, which has a matrix; use translation, rotation and scale instead"))
        }
    };
    match &channel.target {
        Target::Translation(index) => node(*index, "translation"),
        Target::Rotation(index) => node(*index, "rotation"),
        Target::Scale(index) => node(*index, "scale"),
        Target::Weights { instances, first } => {
            let width = channel.sampler.width;
            let of = |instance: usize| {
                let node = tree.instances[instance];
                let count = scene.instances[instance].pose.as_ref().map_or(0, |pose| pose.weights.len());
                match (*first, width) {
                    (0, _) if width == count => Ok(json!({ "node": node, "path": "weights" })),
                    (_, 1) => Ok(pointer(format!("/nodes/{node}/weights/{first}"))),
                    _ => Err(format!("sets {width} of {count} weights; set all of them or one at a time")),
                }
            };
            instances.clone().map(of).collect()
        }
        Target::Visible(node) => Ok(vec![pointer(format!("/nodes/{node}/extensions/KHR_node_visibility/visible"))]),
        Target::Property { property, part } => {
            let property = &parts.properties[*property];
            let of = |&index: &usize| named(scene, property.quantity(), *part, index).map(pointer);
            property
                .of()
                .iter()
                .map(of)
                .collect::<Option<_>>()
                .ok_or_else(|| format!("targets a missing {:?}; leave this channel out", property.quantity()))
        }
    }
}

fn pointer(pointer: String) -> Value {
    json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": pointer } } })
}

/// The JSON pointer to a part of a property; `None` if the file has no such object.
fn named(scene: &Scene, quantity: Quantity, part: usize, index: usize) -> Option<String> {
    let light = |field: &str| Some(format!("/extensions/KHR_lights_punctual/lights/{index}/{field}"));
    let material = |field: &str| Some(format!("/materials/{index}/{field}"));
    match quantity {
        Quantity::LightColor => light("color"),
        Quantity::LightIntensity => light("intensity"),
        Quantity::LightRange => light("range"),
        Quantity::Cone => match scene.lights.get(index)?.kind {
            LightKind::Spot { .. } => light(["spot/innerConeAngle", "spot/outerConeAngle"][part]),
            _ => None,
        },
        Quantity::Yfov | Quantity::Ymag => match scene.cameras.get(index)?.projection {
            Projection::Perspective { .. } => Some(format!("/cameras/{index}/perspective/yfov")),
            Projection::Orthographic { .. } => Some(format!("/cameras/{index}/orthographic/ymag")),
        },
        Quantity::BaseColor => material("pbrMetallicRoughness/baseColorFactor"),
        Quantity::Metallic => material("pbrMetallicRoughness/metallicFactor"),
        Quantity::Roughness => material("pbrMetallicRoughness/roughnessFactor"),
        Quantity::Emission if part == 0 => material("emissiveFactor"),
        Quantity::Emission => material("extensions/KHR_materials_emissive_strength/emissiveStrength"),
        Quantity::AlphaCutoff => scene.materials.get(index)?.alpha_cutoff.and_then(|_| material("alphaCutoff")),
        Quantity::Ior => material("extensions/KHR_materials_ior/ior"),
        Quantity::Specular => material("extensions/KHR_materials_specular/specularFactor"),
        Quantity::SpecularColor => material("extensions/KHR_materials_specular/specularColorFactor"),
        // Pointers into texture references are not written.
        Quantity::NormalScale | Quantity::TextureTransform(_) => None,
    }
}

impl Document {
    /// An accessor of key times, with the bounds that glTF requires.
    fn times(&mut self, times: &[f32]) -> usize {
        let accessor = self.shared((true, FLOAT, "SCALAR", bytemuck::cast_slice(times).to_vec()), times.len());
        self.accessors[accessor]["min"] = json!(times.first().map(|time| [time]));
        self.accessors[accessor]["max"] = json!(times.last().map(|time| [time]));
        accessor
    }

    /// An accessor of key values.
    fn values(&mut self, sampler: &Sampler, target: &Target) -> usize {
        let values = &sampler.values;
        if matches!(target, Target::Visible(_)) {
            let flags = values.iter().map(|&value| u8::from(value != 0.0)).collect();
            return self.shared((false, 5121, "SCALAR", flags), values.len());
        }
        let kind = match (target, sampler.width) {
            (Target::Weights { .. }, _) | (_, 1) => "SCALAR",
            (_, 2) => "VEC2",
            (_, 3) => "VEC3",
            _ => "VEC4",
        };
        let count = if kind == "SCALAR" { values.len() } else { values.len() / sampler.width };
        self.shared((false, FLOAT, kind, bytemuck::cast_slice(values).to_vec()), count)
    }

    /// The accessor for keys with these bytes.
    fn shared(&mut self, known: Known, count: usize) -> usize {
        if let Some(&accessor) = self.known_keys.get(&known) {
            return accessor;
        }
        self.keys.resize(self.keys.len().next_multiple_of(4), 0);
        let (_, component, kind, data) = &known;
        self.accessors.push(json!({
            "bufferView": self.views.len(),
            "byteOffset": self.keys.len(),
            "componentType": component,
            "count": count,
            "type": kind,
        }));
        self.keys.extend_from_slice(data);
        self.known_keys.insert(known, self.accessors.len() - 1);
        self.accessors.len() - 1
    }
}
