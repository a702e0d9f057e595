//! glTF 2.0 -> `Scene`. Reads the JSON itself and trusts nothing in it: what is wrong ends in an error that names the
//! place, what is left out ends in a note.

mod files;
mod geometry;
mod materials;
mod pose;

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::path::Path;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};

use super::accessor::Accessors;
use super::json::{Document, Object, error_at, plural, printable};
use super::{Camera, Instance, Light, LightKind, Mesh, Primitive, Projection, Scene};
use crate::Result;
use geometry::Geometry;
use materials::Materials;
use pose::Pose;

/// Loads a .gltf or .glb, at rest: animations are ignored, skins and morph targets posed as the file stores them.
///
/// # Errors
///
/// `Error::Input` for everything that the file does wrong, in one line.
pub fn load(path: &Path) -> Result<Scene> {
    let (document, binary) = files::open(path)?;
    let mut notes = Notes::default();
    notes.lines.extend(files::check_extensions(&document)?);
    let buffers = files::buffers(&document, binary)?;
    let accessors = Accessors::new(&document, &buffers);
    let graph = Graph::read(&document, &mut notes)?;

    let mut scene = Scene {
        name: path.file_stem().map_or_else(|| "scene".into(), |stem| printable(&stem.to_string_lossy())),
        ..Scene::default()
    };
    let mut builder = Builder {
        document: &document,
        accessors: &accessors,
        graph: &graph,
        geometry: Geometry { accessors: &accessors, vertices: 0, indices: 0 },
        materials: Materials::new(&document),
        shared: BTreeMap::new(),
    };
    for &node in &graph.drawn {
        builder.node(node, &mut scene, &mut notes)?;
    }
    if scene.triangle_count() == 0 {
        let why = if graph.drawn.is_empty() { "its scene has no nodes" } else { "none of its nodes draws any" };
        let left_out: Vec<String> = notes.finish();
        let told = left_out.iter().map(|note| format!(" {note}")).collect::<String>();
        return Err(error_at(path, "file", format!("no triangles to draw: {why}.{told}").trim_end_matches('.')));
    }
    (scene.materials, scene.images) = builder.materials.finish(&accessors, &mut notes)?;
    scene.notes = notes.finish();
    Ok(scene)
}

/// What the user should know, each thing once.
#[derive(Default)]
struct Notes {
    lines: Vec<String>,
    counts: BTreeMap<&'static str, usize>,
}

impl Notes {
    /// Most lines: a file with thousands of odd materials needs no thousands of lines.
    const MOST: usize = 64;

    fn add(&mut self, line: String) {
        if self.lines.len() < Self::MOST && !self.lines.contains(&line) {
            self.lines.push(line);
        }
    }

    /// Counts cases of something that is told in one line.
    fn count(&mut self, what: &'static str, cases: usize) {
        if cases > 0 {
            *self.counts.entry(what).or_default() += cases;
        }
    }

    fn finish(mut self) -> Vec<String> {
        self.lines.extend(self.counts.iter().map(|(what, cases)| format!("{what}: {cases}.")));
        self.lines
    }
}

/// The nodes and their places in the world.
struct Graph<'a> {
    nodes: Vec<Object<'a>>,
    /// World transforms of all nodes, also of those outside the scene: joints may be there.
    worlds: Vec<DAffine3>,
    /// Nodes of the scene, parents first.
    drawn: Vec<usize>,
}

impl<'a> Graph<'a> {
    fn read(document: &'a Document, notes: &mut Notes) -> Result<Self> {
        let nodes = document.items("nodes")?;
        let mut parents = vec![None; nodes.len()];
        let mut children = Vec::with_capacity(nodes.len());
        for (index, node) in nodes.iter().enumerate() {
            let list = node.indices("children")?;
            for &child in &list {
                document.item("nodes", child, node)?;
                if let Some(other) = parents[child].replace(index) {
                    return Err(nodes[child].error(format!(
                        "is a child of node {other} and again of node {index}, but nodes form a tree: export the file again"
                    )));
                }
            }
            children.push(list);
        }

        let roots: Vec<usize> = (0..nodes.len()).filter(|&node| parents[node].is_none()).collect();
        let order = descend(&roots, &children);
        if order.len() < nodes.len() {
            // With one parent each, what no root reaches hangs on a cycle.
            let mut reached = vec![false; nodes.len()];
            order.iter().for_each(|&node| reached[node] = true);
            let lost = reached.iter().position(|&reached| !reached).unwrap_or(0);
            return Err(nodes[lost].error("is its own ancestor, or below a node that is: export the file again"));
        }
        let mut worlds = vec![DAffine3::IDENTITY; nodes.len()];
        for &node in &order {
            let parent = parents[node].map_or(DAffine3::IDENTITY, |parent| worlds[parent]);
            worlds[node] = parent * local_transform(&nodes[node], notes)?;
            if !worlds[node].is_finite() {
                return Err(nodes[node].error("its transform overflows: export the file again"));
            }
        }

        let scene = match document.object().index("scene")? {
            Some(index) => Some(document.item("scenes", index, &document.object())?),
            None if document.count("scenes") > 0 => Some(document.item("scenes", 0, &document.object())?),
            None => None,
        };
        let top = match scene {
            Some(scene) => {
                let top = scene.indices("nodes")?;
                let mut listed = vec![false; nodes.len()];
                for &node in &top {
                    document.item("nodes", node, &scene)?;
                    if let Some(parent) = parents[node] {
                        return Err(scene.error(format!("lists node {node}, which is a child of node {parent}")));
                    }
                    if std::mem::replace(&mut listed[node], true) {
                        return Err(scene.error(format!("lists node {node} twice")));
                    }
                }
                top
            }
            None => roots,
        };
        let drawn = descend(&top, &children);
        Ok(Self { nodes, worlds, drawn })
    }
}

/// Nodes below and including `top`, parents first. Each node is met once: parents are unique.
fn descend(top: &[usize], children: &[Vec<usize>]) -> Vec<usize> {
    let mut stack: Vec<usize> = top.iter().rev().copied().collect();
    let mut order = Vec::new();
    while let Some(node) = stack.pop() {
        order.push(node);
        stack.extend(children[node].iter().rev());
    }
    order
}

fn local_transform(node: &Object, notes: &mut Notes) -> Result<DAffine3> {
    if let Some(m) = node.vector::<16>("matrix")? {
        let last_row = [m[3], m[7], m[11], m[15] - 1.0];
        if last_row.iter().any(|x| x.abs() > 1e-5) {
            return Err(node.error("its matrix has a last row other than 0 0 0 1: export the file again"));
        }
        let column = |c: usize| DVec3::new(m[4 * c], m[4 * c + 1], m[4 * c + 2]);
        return Ok(DAffine3::from_cols(column(0), column(1), column(2), column(3)));
    }
    let translation = DVec3::from(node.vector::<3>("translation")?.unwrap_or_default());
    let scale = DVec3::from(node.vector::<3>("scale")?.unwrap_or([1.0; 3]));
    let rotation = DQuat::from_array(node.vector::<4>("rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let length = rotation.length();
    if !(length > 1e-6 && length.is_finite()) {
        return Err(node.error("its rotation has no length: export the file again"));
    }
    if (length - 1.0).abs() > 0.01 {
        notes.count("Node rotations brought to unit length", 1);
    }
    Ok(DAffine3::from_scale_rotation_translation(scale, rotation / length, translation))
}

/// Which mesh, and which morph weights by their bits: nodes that agree in both share the result.
type MeshKey = (usize, Vec<u64>);

/// Turns nodes into instances, lights and cameras.
struct Builder<'a> {
    document: &'a Document,
    accessors: &'a Accessors<'a>,
    graph: &'a Graph<'a>,
    geometry: Geometry<'a>,
    materials: Materials<'a>,
    /// The scene's mesh for each one already made; `None` for those without triangles.
    shared: BTreeMap<MeshKey, Option<usize>>,
}

impl Builder<'_> {
    fn node(&mut self, index: usize, scene: &mut Scene, notes: &mut Notes) -> Result<()> {
        let node = &self.graph.nodes[index];
        let world = self.graph.worlds[index];
        if let Some(mesh) = node.index("mesh")? {
            self.instance(index, mesh, scene, notes)?;
        }
        if let Some(camera) = node.index("camera")? {
            let object = self.document.item("cameras", camera, node)?;
            let name = node.name(|| object.name(|| format!("camera {camera}")));
            scene.cameras.push(read_camera(&object, name, world, notes)?);
        }
        if let Some(reference) = node.extension("KHR_lights_punctual")? {
            let light = reference.index("light")?.ok_or_else(|| reference.error("names no light"))?;
            let root = self.document.object().extension("KHR_lights_punctual")?;
            let lights = root.map(|root| root.objects("lights", "light")).transpose()?.unwrap_or_default();
            let object = lights.get(light).ok_or_else(|| {
                reference.error(format!("refers to light {light}, but the file has {}", plural(lights.len(), "light")))
            })?;
            let name = node.name(|| object.name(|| format!("light {light}")));
            scene.lights.push(read_light(object, name, world, notes)?);
        }
        Ok(())
    }

    fn instance(&mut self, index: usize, mesh: usize, scene: &mut Scene, notes: &mut Notes) -> Result<()> {
        let node = &self.graph.nodes[index];
        let object = self.document.item("meshes", mesh, node)?;
        let weights = match node.numbers("weights")? {
            Some(weights) => weights,
            None => object.numbers("weights")?.unwrap_or_default(),
        };
        let name = node.name(|| format!("node {index}"));
        if let Some(skin) = node.index("skin")? {
            // The joints alone say where the skin is: its vertices become the world's.
            let skin = self.document.item("skins", skin, node)?;
            let joints = pose::joints(self.document, self.accessors, &skin, &self.graph.worlds)?;
            if let Some(made) = self.mesh(&object, mesh, Pose { weights, joints: Some(joints) }, scene, notes)? {
                scene.instances.push(Instance { name, mesh: made, ..Instance::default() });
            }
            return Ok(());
        }
        let world_from_model = self.graph.worlds[index];
        if !world_from_model.inverse().is_finite() {
            notes.count("Nodes of no volume (scale 0) left out", 1);
            return Ok(());
        }
        let key = (mesh, weights.iter().map(|w| w.to_bits()).collect());
        let made = match self.shared.get(&key) {
            Some(&made) => made,
            None => {
                let made = self.mesh(&object, mesh, Pose { weights, joints: None }, scene, notes)?;
                self.shared.insert(key, made);
                made
            }
        };
        if let Some(mesh) = made {
            scene.instances.push(Instance { name, mesh, world_from_model, ..Instance::default() });
        }
        Ok(())
    }

    /// Adds a mesh to the scene, all its primitives merged; `None` when it has no triangles.
    fn mesh(
        &mut self,
        object: &Object,
        index: usize,
        pose: Pose,
        scene: &mut Scene,
        notes: &mut Notes,
    ) -> Result<Option<usize>> {
        let mut mesh = Mesh { name: object.name(|| format!("mesh {index}")), ..Mesh::default() };
        for primitive in object.objects("primitives", "primitive")? {
            let targets = primitive.objects("targets", "morph target")?.len();
            if !pose.weights.is_empty() && pose.weights.len() != targets {
                return Err(primitive.error(format!(
                    "has {} for {}: export the file again",
                    plural(targets, "morph target"),
                    plural(pose.weights.len(), "weight")
                )));
            }
            let material = self.materials.index(&primitive, notes)?;
            let double_sided = self.materials.list[material].double_sided;
            let Some(surface) = self.geometry.surface(&primitive, &object.place, &pose, double_sided, notes)? else {
                continue;
            };
            let base = mesh.vertices.len() as u32;
            let first_index = mesh.indices.len() as u32;
            let index_count = surface.indices.len() as u32;
            mesh.vertices.extend(surface.vertices);
            mesh.indices.extend(surface.indices.into_iter().map(|index| base + index));
            match mesh.primitives.last_mut() {
                Some(last) if last.material == material => last.index_count += index_count,
                _ => mesh.primitives.push(Primitive { first_index, index_count, material }),
            }
        }
        if mesh.indices.is_empty() {
            return Ok(None);
        }
        scene.meshes.push(mesh);
        Ok(Some(scene.meshes.len() - 1))
    }
}

/// Orientation and place of a node without its scale: a camera cannot be stretched.
fn rigid(world: DAffine3) -> DAffine3 {
    let back = world.matrix3.z_axis.try_normalize().unwrap_or(DVec3::Z);
    let up = world.matrix3.y_axis.reject_from_normalized(back).try_normalize();
    let up = up.unwrap_or_else(|| back.any_orthonormal_vector());
    DAffine3::from_mat3_translation(DMat3::from_cols(up.cross(back), up, back), world.translation)
}

fn read_camera(object: &Object, name: String, world: DAffine3, notes: &mut Notes) -> Result<Camera> {
    let needed = |key: &str| object.object(key)?.ok_or_else(|| object.error(format!("has no {key}")));
    let projection = match object.text("type")? {
        Some("perspective") => {
            let perspective = needed("perspective")?;
            let yfov = perspective.number("yfov")?.ok_or_else(|| perspective.error("has no yfov"))?;
            if !(yfov > 0.0 && yfov < PI) {
                return Err(perspective.error(format!("yfov is {yfov}; it must be between 0 and pi radians")));
            }
            Projection::Perspective { yfov: yfov as f32 }
        }
        Some("orthographic") => {
            let orthographic = needed("orthographic")?;
            let ymag = orthographic.number("ymag")?.ok_or_else(|| orthographic.error("has no ymag"))?;
            if ymag == 0.0 {
                return Err(orthographic.error("ymag is 0: the picture would have no height"));
            }
            if ymag < 0.0 {
                notes.add(format!("{}: ymag is {ymag}, its sign is ignored.", orthographic.place));
            }
            Projection::Orthographic { ymag: ymag.abs() as f32 }
        }
        _ => return Err(object.error("its type is neither perspective nor orthographic")),
    };
    Ok(Camera { name, world_from_camera: rigid(world), projection })
}

/// Largest number a light may have: its products with colour, inverse squares of distances and one another must stay
/// within single precision. Far beyond any lamp.
const BRIGHTEST: f64 = 1e15;

fn read_light(object: &Object, name: String, world: DAffine3, notes: &mut Notes) -> Result<Light> {
    let mut at_least_zero = |key: &str, value: f64| {
        let used = value.clamp(0.0, BRIGHTEST);
        if used != value {
            notes.add(format!("{}: {key} is {value}, taken as {used}.", object.place));
        }
        used as f32
    };
    let color = object.vector::<3>("color")?.unwrap_or([1.0; 3]).map(|c| at_least_zero("color", c));
    let intensity = at_least_zero("intensity", object.number("intensity")?.unwrap_or(1.0));
    let range = object.number("range")?.map(|range| at_least_zero("range", range)).filter(|&range| range > 0.0);
    let kind = match object.text("type")? {
        Some("directional") => LightKind::Directional,
        Some("point") => LightKind::Point,
        Some("spot") => {
            let spot = object.object("spot")?;
            let angle = |key: &str, default: f64| match &spot {
                Some(spot) => Ok(spot.number(key)?.unwrap_or(default)),
                None => Ok(default),
            };
            let (inner, outer) = (angle("innerConeAngle", 0.0)?, angle("outerConeAngle", FRAC_PI_4)?);
            if outer <= 0.0 {
                return Err(object.error(format!("outerConeAngle is {outer}; it must be above 0")));
            }
            // Single precision may round pi/2 up; what is meant is clear.
            let outer_used = outer.min(FRAC_PI_2);
            let inner_used = inner.clamp(0.0, outer_used);
            if outer - outer_used > 1e-6 || (inner - inner_used).abs() > 1e-6 {
                notes.add(format!(
                    "{}: cone angles {inner} and {outer} taken as {inner_used} and {outer_used}.",
                    object.place
                ));
            }
            LightKind::Spot { inner: inner_used as f32, outer: outer_used as f32 }
        }
        _ => return Err(object.error("its type is none of directional, point and spot")),
    };
    let direction = world.transform_vector3(DVec3::NEG_Z).try_normalize().unwrap_or(DVec3::NEG_Z).as_vec3();
    let position = world.translation;
    Ok(Light { name, kind, color: Vec3::from(color), intensity, range, position, direction })
}
