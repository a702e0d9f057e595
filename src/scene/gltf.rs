//! glTF 2.0 -> `Scene`. Reads the JSON itself and validates everything: an invalid file gives an error that names the
//! place; skipped content gives a note.

mod animations;
mod bend;
mod draco;
mod files;
mod geometry;
mod instancing;
mod lights;
mod materials;
mod meshopt;
mod pointer;
mod pose;
mod rig;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{DAffine3, DQuat, DVec3};

use super::accessor::{Accessors, Contents};
use super::animation::{AnimatedInstance, Hold, Local, Skin};
use super::json::{Document, Object, error_at, plural, printable};
use super::{Group, Instance, Mesh, Primitive, Scene};
use crate::Result;
use animations::{Aim, Played};
use bend::Bent;
use geometry::Geometry;
use materials::Materials;
use pose::Pose;

/// Largest distance \[m\] from the origin; squares of larger distances would overflow f32.
const FARTHEST: f64 = 1e18;

/// Largest size \[m\] of a surface; the ray code sums areas of millions of surfaces in f32.
const LARGEST: f64 = 1e15;

/// Loads a .gltf or .glb in its rest pose. Skins and morph targets that no animation reaches are posed here, once.
///
/// # Errors
///
/// Fails with a one-line `Error::Input` for every fault of the file.
pub fn load(path: &Path) -> Result<Scene> {
    let (document, binary) = files::open(path)?;
    let mut notes = Notes::default();
    notes.lines.extend(files::check_extensions(&document)?);
    let mut contents = Contents { buffers: files::buffers(&document, binary)?, ..Contents::default() };
    meshopt::unpack(&document, &mut contents)?;
    draco::unpack(&document, &mut contents)?;
    let accessors = Accessors::new(&document, &contents);
    let graph = Graph::read(&document, &mut notes)?;
    let played = animations::read(&document, &accessors, &mut notes)?;
    let reached = Reached::by(&document, &played, &graph)?;

    let mut scene = Scene {
        name: path.file_stem().map_or_else(|| "scene".into(), |stem| printable(&stem.to_string_lossy())),
        ..Scene::default()
    };
    let mut builder = Builder {
        document: &document,
        accessors: &accessors,
        graph: &graph,
        reached: &reached,
        geometry: Geometry { accessors: &accessors, vertices: 0, indices: 0 },
        materials: Materials::new(&document),
        shared: BTreeMap::new(),
        bent: BTreeMap::new(),
        skins: Vec::new(),
        known_skins: BTreeMap::new(),
        joints: 0,
        hung: Hung::default(),
    };
    let mut groups = Vec::new();
    let mut open: Vec<(usize, usize)> = Vec::new();
    for &node in &graph.drawn {
        while open.last().is_some_and(|(parent, _)| graph.parents[node] != Some(*parent)) {
            close(&mut open, &mut groups, &scene);
        }
        open.push((node, groups.len()));
        let (name, first) = (graph.nodes[node].name(|| format!("node {node}")), scene.instances.len());
        groups.push(Group { name, instances: first..first });
        builder.node(node, &mut scene, &mut notes)?;
    }
    while !open.is_empty() {
        close(&mut open, &mut groups, &scene);
    }
    let mut outer = 0..scene.instances.len();
    groups.retain(|group| {
        let is_kept = group.instances.len() > 1 && group.instances != outer;
        if is_kept {
            outer = group.instances.clone();
        }
        is_kept
    });
    scene.groups = groups;
    if scene.triangle_count() == 0 {
        let why = if graph.drawn.is_empty() { "its scene has no nodes" } else { "none of its nodes draws any" };
        let left_out: Vec<String> = notes.finish();
        let told = left_out.iter().map(|note| format!(" {note}")).collect::<String>();
        return Err(error_at(
            path,
            "file",
            format!("no triangles to draw: {why}; export the file with its meshes.{told}").trim_end_matches('.'),
        ));
    }
    let reaches: Vec<f64> = scene.meshes.iter().map(reach).collect();
    for Instance { name, mesh, world_from_model, .. } in &scene.instances {
        let columns = world_from_model.matrix3.to_cols_array();
        let stretch = columns.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        if stretch * reaches[*mesh] > LARGEST {
            let why = format!("\"{name}\" is larger than {LARGEST:e} m: export the file again, in metres");
            return Err(error_at(path, "nodes", why.as_str()));
        }
    }
    let used = std::mem::take(&mut builder.materials.indices);
    (scene.materials, scene.images) = builder.materials.finish(&accessors, &mut notes)?;
    if !played.is_empty() {
        scene.rig = rig::rig(&document, &graph, played, builder.hung, builder.skins, &used, &scene)?;
        if scene.rig.is_some() {
            scene.extent = scene.sweep();
        } else {
            notes.add("The file's animations move nothing that is drawn.".into());
        }
    }
    scene.notes = notes.finish();
    Ok(scene)
}

/// Ends the innermost open group, given by its node and its index, at the scene's last instance.
fn close(open: &mut Vec<(usize, usize)>, groups: &mut [Group], scene: &Scene) {
    if let Some((_, group)) = open.pop() {
        groups[group].instances.end = scene.instances.len();
    }
}

/// Largest coordinate of a mesh's vertices in model space, along any axis.
fn reach(mesh: &Mesh) -> f64 {
    mesh.vertices.iter().fold(0.0, |most, vertex| most.max(f64::from(vertex.position.abs().max_element())))
}

/// Notes for the user, without duplicates.
#[derive(Default)]
struct Notes {
    lines: Vec<String>,
    counts: BTreeMap<&'static str, usize>,
}

impl Notes {
    /// Most lines, for files with thousands of unusual materials.
    const MOST: usize = 64;

    fn add(&mut self, line: String) {
        if self.lines.len() < Self::MOST && !self.lines.contains(&line) {
            self.lines.push(line);
        }
    }

    /// Counts cases that are reported together in one line.
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

/// The node tree and its world transforms.
struct Graph<'a> {
    nodes: Vec<Object<'a>>,
    parents: Vec<Option<usize>>,
    /// All nodes, parents first.
    order: Vec<usize>,
    locals: Vec<Local>,
    /// KHR_node_visibility: nodes that hide themselves (`hides`), and these with their descendants (`hidden`).
    hides: Vec<bool>,
    hidden: Vec<bool>,
    /// World transforms of all nodes, including nodes outside the scene, which may be joints.
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
            // Each node has at most one parent, so a node that no root reaches is on or below a cycle.
            let mut reached = vec![false; nodes.len()];
            order.iter().for_each(|&node| reached[node] = true);
            let lost = reached.iter().position(|&reached| !reached).unwrap_or(0);
            return Err(nodes[lost].error("is its own ancestor, or below a node that is: export the file again"));
        }
        let mut worlds = vec![DAffine3::IDENTITY; nodes.len()];
        let mut locals = vec![Local::default(); nodes.len()];
        let (mut hides, mut hidden) = (vec![false; nodes.len()], vec![false; nodes.len()]);
        for &node in &order {
            locals[node] = local_transform(&nodes[node], notes)?;
            let local = locals[node].affine();
            worlds[node] = parents[node].map_or(local, |parent| worlds[parent] * local);
            let visibility = nodes[node].extension("KHR_node_visibility")?;
            hides[node] = !visibility.map_or(Ok(true), |visibility| visibility.flag_or("visible", true))?;
            hidden[node] = hides[node] || parents[node].is_some_and(|parent| hidden[parent]);
            if !(worlds[node].is_finite() && worlds[node].translation.abs().max_element() <= FARTHEST) {
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
                        return Err(scene.error(format!(
                            "lists node {node}, which is a child of node {parent}: export the file again"
                        )));
                    }
                    if std::mem::replace(&mut listed[node], true) {
                        return Err(scene.error(format!("lists node {node} twice: export the file again")));
                    }
                }
                top
            }
            None => roots,
        };
        let drawn = descend(&top, &children);
        Ok(Self { nodes, parents, order, locals, hides, hidden, worlds, drawn })
    }
}

/// The nodes in and below `top`, parents first. Each node appears once, since parents are unique.
fn descend(top: &[usize], children: &[Vec<usize>]) -> Vec<usize> {
    let mut stack: Vec<usize> = top.iter().rev().copied().collect();
    let mut order = Vec::new();
    while let Some(node) = stack.pop() {
        order.push(node);
        stack.extend(children[node].iter().rev());
    }
    order
}

fn local_transform(node: &Object, notes: &mut Notes) -> Result<Local> {
    if let Some(m) = node.vector::<16>("matrix")? {
        let last_row = [m[3], m[7], m[11], m[15] - 1.0];
        if last_row.iter().any(|x| x.abs() > 1e-5) {
            return Err(node.error("its matrix has a last row other than 0 0 0 1: export the file again"));
        }
        let column = |c: usize| DVec3::new(m[4 * c], m[4 * c + 1], m[4 * c + 2]);
        return Ok(Local::Matrix(DAffine3::from_cols(column(0), column(1), column(2), column(3))));
    }
    let translation = DVec3::from(node.vector::<3>("translation")?.unwrap_or_default());
    let scale = DVec3::from(node.vector::<3>("scale")?.unwrap_or([1.0; 3]));
    let rotation = DQuat::from_array(node.vector::<4>("rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let length = rotation.length();
    if !(length > 1e-6 && length.is_finite()) {
        return Err(node.error("its rotation has no length: export the file again"));
    }
    if (length - 1.0).abs() > 0.01 {
        notes.count("Node rotations normalised", 1);
    }
    Ok(Local::Parts { translation, rotation: rotation / length, scale })
}

/// Nodes and meshes that animations reach.
struct Reached {
    /// By node: whether an animation moves it or an ancestor.
    moved: Vec<bool>,
    /// By node: whether an animation may hide it or an ancestor.
    fades: Vec<bool>,
    /// By node: whether an animation sets morph weights of its mesh.
    weighed: Vec<bool>,
    /// Meshes deformed by an animated skin, and whether their morph weights change too.
    skinned: BTreeMap<usize, bool>,
    /// Meshes of nodes without a skin whose morph weights change.
    morphed: BTreeSet<usize>,
}

impl Reached {
    fn by(document: &Document, played: &[Played], graph: &Graph) -> Result<Self> {
        let none = vec![false; graph.nodes.len()];
        let (mut moved, mut fades, mut weighed) = (none.clone(), none.clone(), none);
        let mut meshes = BTreeSet::new();
        for track in played.iter().flat_map(|played| &played.tracks) {
            match track.aim {
                Aim::Translation(node) | Aim::Rotation(node) | Aim::Scale(node) => moved[node] = true,
                Aim::Weights(node, _) => weighed[node] = true,
                Aim::MeshWeights(mesh, _) => _ = meshes.insert(mesh),
                Aim::Visible(node) => fades[node] = true,
                Aim::Light(..) | Aim::Camera(..) | Aim::Material(..) => {}
            }
        }
        for &node in &graph.order {
            if let Some(parent) = graph.parents[node] {
                moved[node] |= moved[parent];
                fades[node] |= fades[parent];
            }
        }
        let mut reached = Self { moved, fades, weighed, skinned: BTreeMap::new(), morphed: BTreeSet::new() };
        for &node in &graph.drawn {
            let object = &graph.nodes[node];
            let Some(mesh) = object.index("mesh")? else { continue };
            reached.weighed[node] |= meshes.contains(&mesh) && object.value("weights").is_none();
            let weighed = reached.weighed[node];
            let Some(skin) = object.index("skin")? else {
                if weighed {
                    reached.morphed.insert(mesh);
                }
                continue;
            };
            let joints = document.item("skins", skin, object)?.indices("joints")?;
            let bends = joints.iter().any(|&joint| reached.moved.get(joint) == Some(&true));
            if bends || weighed {
                *reached.skinned.entry(mesh).or_default() |= weighed;
            }
        }
        Ok(reached)
    }
}

/// Mesh index and the bits of its morph weights. Nodes that agree in both share a mesh.
type MeshKey = (usize, Vec<u64>);

/// The nodes that the scene's objects belong to.
#[derive(Default)]
struct Hung {
    /// By instance.
    instances: Vec<AnimatedInstance>,
    /// By light: its node and its index in the file.
    lights: Vec<(usize, usize)>,
    /// By camera: its node and its index in the file.
    cameras: Vec<(usize, usize)>,
}

/// Turns nodes into instances, lights and cameras.
struct Builder<'a> {
    document: &'a Document,
    accessors: &'a Accessors<'a>,
    graph: &'a Graph<'a>,
    reached: &'a Reached,
    geometry: Geometry<'a>,
    materials: Materials<'a>,
    /// Scene mesh for each key already built; `None` for meshes without triangles.
    shared: BTreeMap<MeshKey, Option<usize>>,
    /// Deforming meshes, which poses may share.
    bent: BTreeMap<bend::Key, Vec<Bent>>,
    /// The skins in use, and the index of each by its index in the file.
    skins: Vec<Skin>,
    known_skins: BTreeMap<usize, usize>,
    /// Number of joints of all poses together.
    joints: usize,
    hung: Hung,
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
            scene.cameras.push(lights::read_camera(&object, name, world, notes)?);
            self.hung.cameras.push((index, camera));
        }
        if let Some(reference) = node.extension("KHR_lights_punctual")? {
            let light =
                reference.index("light")?.ok_or_else(|| reference.error("names no light: export the file again"))?;
            let root = self.document.object().extension("KHR_lights_punctual")?;
            let lights = root.map(|root| root.objects("lights", "light")).transpose()?.unwrap_or_default();
            let object = lights.get(light).ok_or_else(|| {
                reference.error(format!(
                    "refers to light {light}, but the file has {}: export the file again",
                    plural(lights.len(), "light")
                ))
            })?;
            let name = node.name(|| object.name(|| format!("light {light}")));
            let read = lights::read_light(object, name, world, notes)?;
            if self.graph.hidden[index] && !self.reached.fades[index] {
                notes.count("Lights of hidden nodes left out", 1);
            } else {
                scene.lights.push(read);
                self.hung.lights.push((index, light));
            }
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
        let hidden = self.graph.hidden[index];
        if let Some(skin) = node.index("skin")? {
            if node.extension("EXT_mesh_gpu_instancing")?.is_some() {
                notes.count("Instances of skinned nodes left out, except the first", 1);
            }
            if let Some(&weighed) = self.reached.skinned.get(&mesh) {
                let instance = Instance { name, hidden, ..Instance::default() };
                return self.bend_skin(index, &object, mesh, skin, (weights, weighed), instance, scene, notes);
            }
            // The joints alone place the skin: its vertices become world-space vertices.
            let skin = self.skin(skin, node)?;
            let joints = pose::joints(&self.skins[skin], &self.graph.worlds);
            if let Some(made) = self.mesh(&object, mesh, Pose { weights, joints: Some(joints) }, scene, notes)? {
                self.stand(index, Hold::World, Instance { name, mesh: made, hidden, ..Instance::default() }, scene);
            }
            return Ok(());
        }
        let bends = self.reached.morphed.contains(&mesh);
        let offsets = instancing::offsets(self.accessors, node, scene.instances.len(), notes)?;
        for (at, &offset) in offsets.iter().enumerate() {
            let world_from_model = self.graph.worlds[index] * offset;
            // A node flattened at rest may get a volume when it is animated.
            let is_flat = |transform: DAffine3| !transform.inverse().is_finite();
            if is_flat(world_from_model) && (is_flat(offset) || !self.reached.moved[index]) {
                notes.count("Nodes of no volume (scale 0) left out", 1);
                continue;
            }
            let name = if offsets.len() > 1 { format!("{name} {at}") } else { name.clone() };
            let instance = Instance { name, world_from_model, hidden, ..Instance::default() };
            if bends {
                self.bend_morph(index, &object, mesh, offset, weights.clone(), instance, scene, notes)?;
                continue;
            }
            let key = (mesh, weights.iter().map(|w| w.to_bits()).collect());
            let made = match self.shared.get(&key) {
                Some(&made) => made,
                None => {
                    let pose = Pose { weights: weights.clone(), joints: None };
                    let made = self.mesh(&object, mesh, pose, scene, notes)?;
                    self.shared.insert(key, made);
                    made
                }
            };
            if let Some(mesh) = made {
                self.stand(index, Hold::Node(offset), Instance { mesh, ..instance }, scene);
            }
        }
        Ok(())
    }

    /// Adds an instance to the scene.
    fn stand(&mut self, node: usize, hold: Hold, instance: Instance, scene: &mut Scene) {
        self.hung.instances.push(AnimatedInstance { node, hold, weights: Vec::new() });
        scene.instances.push(instance);
    }

    /// Adds a mesh with all its primitives to the scene; `None` if it has no triangles.
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
            pose::check_weights(&primitive, &pose.weights)?;
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
