//! Maps the targets of a file's animations to those of the scene.

use std::collections::BTreeMap;
use std::ops::Range;

use super::animations::{Aim, Played};
use super::pointer::TEXTURES;
use super::{Graph, Hung};
use crate::Result;
use crate::scene::animation::{Animation, Channel, Node, Parts, Property, Quantity, Rig, Skin, Target};
use crate::scene::json::{Document, Object};
use crate::scene::{LightKind, Projection, Scene};

/// The rig of a scene whose instances, lights, cameras and materials are complete and at rest; `None` if no animation
/// reaches any of them. `materials` maps the file's materials to the scene's.
pub(super) fn rig(
    document: &Document,
    graph: &Graph,
    played: Vec<Played>,
    hung: Hung,
    skins: Vec<Skin>,
    materials: &BTreeMap<Option<usize>, usize>,
    scene: &Scene,
) -> Result<Option<Rig>> {
    let mut instances: BTreeMap<usize, Range<usize>> = BTreeMap::new();
    for (index, placed) in hung.instances.iter().enumerate() {
        instances.entry(placed.node).or_insert(index..index).end = index + 1;
    }
    let properties = Vec::new();
    let known = BTreeMap::new();
    let mut made = Maker { document, graph, hung: &hung, instances, materials, scene, properties, known };
    let mut animations = Vec::new();
    for Played { name, tracks } in played {
        let mut channels = Vec::new();
        for track in tracks {
            for target in made.targets(track.aim)? {
                channels.push(Channel { sampler: track.sampler.clone(), target });
            }
        }
        animations.push(Animation { name, channels });
    }
    made.intensities(&animations)?;
    let properties = made.properties;
    let node =
        |index: usize| Node { parent: graph.parents[index], rest: graph.locals[index], hidden: graph.hides[index] };
    let rig = Rig::new(Parts {
        nodes: (0..graph.nodes.len()).map(node).collect(),
        skins,
        instances: hung.instances,
        lights: hung.lights.iter().map(|&(node, _)| node).collect(),
        cameras: hung.cameras.iter().map(|&(node, _)| node).collect(),
        properties,
        animations,
    });
    Ok(rig.reaches().then_some(rig))
}

struct Maker<'a> {
    document: &'a Document,
    graph: &'a Graph<'a>,
    hung: &'a Hung,
    /// By node, its instances, which are adjacent.
    instances: BTreeMap<usize, Range<usize>>,
    materials: &'a BTreeMap<Option<usize>, usize>,
    scene: &'a Scene,
    properties: Vec<Property>,
    /// Properties created so far, by quantity and the file's index; `None` if the scene has no such object.
    known: BTreeMap<(Quantity, usize), Option<usize>>,
}

impl Maker<'_> {
    /// Scene targets of a file target.
    fn targets(&mut self, aim: Aim) -> Result<Vec<Target>> {
        let (quantity, index, part) = match aim {
            Aim::Translation(node) => return Ok(vec![Target::Translation(node)]),
            Aim::Rotation(node) => return Ok(vec![Target::Rotation(node)]),
            Aim::Scale(node) => return Ok(vec![Target::Scale(node)]),
            Aim::Visible(node) => return Ok(vec![Target::Visible(node)]),
            Aim::Weights(node, element) => return Ok(self.weights(&[node], element)),
            Aim::MeshWeights(mesh, element) => {
                let mut nodes = Vec::new();
                for &node in &self.graph.drawn {
                    let object = &self.graph.nodes[node];
                    if object.index("mesh")? == Some(mesh) && object.value("weights").is_none() {
                        nodes.push(node);
                    }
                }
                return Ok(self.weights(&nodes, element));
            }
            Aim::Light(light, quantity, part) => (quantity, light, part),
            Aim::Camera(camera, quantity) => (quantity, camera, 0),
            Aim::Material(material, quantity, part) => (quantity, material, part),
        };
        Ok(self.property(quantity, index)?.map(|property| Target::Property { property, part }).into_iter().collect())
    }

    fn weights(&self, nodes: &[usize], element: Option<usize>) -> Vec<Target> {
        let of = |node: &usize| {
            let instances = self.instances.get(node)?.clone();
            Some(Target::Weights { instances, first: element.unwrap_or(0) })
        };
        nodes.iter().filter_map(of).collect()
    }

    fn property(&mut self, quantity: Quantity, index: usize) -> Result<Option<usize>> {
        if let Some(&known) = self.known.get(&(quantity, index)) {
            return Ok(known);
        }
        let made = self.make(quantity, index)?;
        let known = made.map(|property| {
            self.properties.push(property);
            self.properties.len() - 1
        });
        self.known.insert((quantity, index), known);
        Ok(known)
    }

    /// A property of the scene's objects; `None` if the scene has no such object.
    fn make(&self, quantity: Quantity, index: usize) -> Result<Option<Property>> {
        let users = |hung: &[(usize, usize)]| -> Vec<usize> {
            let of = |(at, &(_, file)): (usize, &(usize, usize))| (file == index).then_some(at);
            hung.iter().enumerate().filter_map(of).collect()
        };
        let (of, rest) = match quantity {
            Quantity::LightColor | Quantity::LightIntensity | Quantity::LightRange | Quantity::Cone => {
                let of = users(&self.hung.lights);
                let Some(light) = of.first().map(|&light| &self.scene.lights[light]) else { return Ok(None) };
                let rest = match (quantity, light.kind) {
                    (Quantity::LightColor, _) => [numbers(&light.color.to_array()), [0.0; 4], [0.0; 4]],
                    (Quantity::LightIntensity, _) => one(light.intensity),
                    (Quantity::LightRange, _) => one(light.range.unwrap_or(0.0)),
                    (_, LightKind::Spot { inner, outer }) => [numbers(&[inner]), numbers(&[outer]), [0.0; 4]],
                    _ => return Ok(None),
                };
                (of, rest)
            }
            Quantity::Yfov | Quantity::Ymag => {
                let of = users(&self.hung.cameras);
                let Some(camera) = of.first().map(|&camera| &self.scene.cameras[camera]) else { return Ok(None) };
                let rest = match (quantity, camera.projection) {
                    (Quantity::Yfov, Projection::Perspective { yfov }) => one(yfov),
                    (Quantity::Ymag, Projection::Orthographic { ymag }) => one(ymag),
                    _ => return Ok(None),
                };
                (of, rest)
            }
            _ => {
                let Some(&of) = self.materials.get(&Some(index)) else { return Ok(None) };
                let Some(rest) = self.material(quantity, index, of)? else { return Ok(None) };
                (vec![of], rest)
            }
        };
        Ok(Some(Property::new(quantity, of, rest)))
    }

    fn material(&self, quantity: Quantity, index: usize, of: usize) -> Result<Option<[[f64; 4]; 3]>> {
        let material = &self.scene.materials[of];
        let object = self.document.item("materials", index, &self.document.object())?;
        Ok(Some(match quantity {
            Quantity::BaseColor => [numbers(&material.base_color.to_array()), [0.0; 4], [0.0; 4]],
            Quantity::Metallic => one(material.metallic),
            Quantity::Roughness => one(material.roughness),
            Quantity::Emission => {
                let [x, y, z] = object.vector::<3>("emissiveFactor")?.unwrap_or_default();
                let extension = object.extension("KHR_materials_emissive_strength")?;
                let strength = extension.map(|e| e.number("emissiveStrength")).transpose()?.flatten().unwrap_or(1.0);
                [[x, y, z, 0.0], [strength, 0.0, 0.0, 0.0], [0.0; 4]]
            }
            Quantity::AlphaCutoff => match (object.text("alphaMode")?, material.alpha_cutoff) {
                (Some("MASK"), Some(cutoff)) => one(cutoff),
                _ => return Ok(None),
            },
            Quantity::NormalScale => one(material.normal_scale),
            Quantity::Ior => one(material.ior),
            Quantity::Specular => one(material.specular),
            Quantity::SpecularColor => [numbers(&material.specular_color.to_array()), [0.0; 4], [0.0; 4]],
            Quantity::TextureTransform(place) => {
                let mut texture = Some(object);
                for word in TEXTURES[place].split('/').chain(["extensions", "KHR_texture_transform"]) {
                    texture = texture.map(|object: Object| object.object(word)).transpose()?.flatten();
                }
                let (mut offset, mut rotation, mut scale) = ([0.0; 2], 0.0, [1.0; 2]);
                if let Some(transform) = texture {
                    offset = transform.vector::<2>("offset")?.unwrap_or(offset);
                    rotation = transform.number("rotation")?.unwrap_or(rotation);
                    scale = transform.vector::<2>("scale")?.unwrap_or(scale);
                }
                let pair = |[x, y]: [f64; 2]| [x, y, 0.0, 0.0];
                [pair(offset), [rotation, 0.0, 0.0, 0.0], pair(scale)]
            }
            _ => return Ok(None),
        }))
    }

    /// Records the intensity of lights that animations may hide, to restore it later.
    fn intensities(&mut self, animations: &[Animation]) -> Result<()> {
        let hides = |channel: &Channel| matches!(channel.target, Target::Visible(_));
        if animations.iter().flat_map(|animation| &animation.channels).any(hides) {
            for &(_, light) in &self.hung.lights {
                self.property(Quantity::LightIntensity, light)?;
            }
        }
        Ok(())
    }
}

fn numbers(values: &[f32]) -> [f64; 4] {
    let mut numbers = [0.0; 4];
    numbers.iter_mut().zip(values).for_each(|(number, &value)| *number = f64::from(value));
    numbers
}

fn one(value: f32) -> [[f64; 4]; 3] {
    [numbers(&[value]), [0.0; 4], [0.0; 4]]
}
