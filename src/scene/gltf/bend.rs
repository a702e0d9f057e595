//! Deforming meshes: reads their pose data, and shares meshes between instances.

use glam::{DAffine3, DMat3};

use super::geometry::{Geometry, Surface};
use super::pose::{self, Pose};
use super::{Builder, Notes};
use crate::Result;
use crate::scene::animation::{self, AnimatedInstance, Hold};
use crate::scene::deform::{self, Bind, Deform, Displacement, Follower};
use crate::scene::json::{Object, plural};
use crate::scene::{Instance, Mesh, Primitive, Scene};

/// Limit on the joints of all poses together, since any number of nodes may share a skin.
const MAX_JOINTS: usize = 1 << 24;

/// Skins whose sizes differ by less than this share a mesh \[octaves\], since caches placed for one suit the other.
const SAME_SIZE: f64 = 0.25;

/// Mesh, number of joints, and the bits of constant morph weights; instances share a mesh only if these agree.
pub(super) type Key = (usize, usize, Vec<u64>);

/// A deforming mesh.
pub(super) struct Bent {
    /// Size of the skin, as scaled by its joints.
    size: f64,
    mirrored: bool,
    /// The scene's mesh; `None` if it has no triangles.
    mesh: Option<usize>,
}

/// Deformation of a mesh.
pub(super) struct Bend<'a> {
    /// Joint matrices at rest.
    joints: Option<&'a [DAffine3]>,
    /// Morph weights at rest.
    weights: &'a [f64],
    /// Whether an animation changes the weights.
    weighed: bool,
}

impl Builder<'_> {
    /// Index in `skins` of a skin of the file, which is read once.
    pub(super) fn skin(&mut self, index: usize, node: &Object) -> Result<usize> {
        if let Some(&known) = self.known_skins.get(&index) {
            return Ok(known);
        }
        let object = self.document.item("skins", index, node)?;
        self.skins.push(pose::read_skin(self.document, self.accessors, &object)?);
        self.known_skins.insert(index, self.skins.len() - 1);
        Ok(self.skins.len() - 1)
    }

    /// Adds an instance deformed by a skin.
    #[expect(clippy::too_many_arguments, reason = "a node's parts, and where to report")]
    pub(super) fn bend_skin(
        &mut self,
        node: usize,
        object: &Object,
        mesh: usize,
        skin: usize,
        (weights, weighed): (Vec<f64>, bool),
        instance: Instance,
        scene: &mut Scene,
        notes: &mut Notes,
    ) -> Result<()> {
        let graph = self.graph;
        let skin = self.skin(skin, &graph.nodes[node])?;
        let (world_from_model, joints) = animation::joints(&self.skins[skin], &graph.worlds);
        let joints: Vec<DAffine3> = joints.collect();
        self.joints += joints.len();
        if self.joints > MAX_JOINTS {
            return Err(
                graph.nodes[node].error(format!("the scene's skins have more than {MAX_JOINTS} joints; simplify it"))
            );
        }
        let squares = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>() / 3.0;
        let size = (joints.iter().map(|joint| squares(joint.matrix3)).sum::<f64>() / joints.len() as f64).sqrt();
        let mirrored = joints[0].matrix3.determinant() < 0.0;
        let bits = if weighed { Vec::new() } else { weights.iter().map(|w| w.to_bits()).collect() };
        let key = (mesh, joints.len(), bits);
        let bend = Bend { joints: Some(&joints), weights: &weights, weighed };
        let Some(made) = self.bent_mesh(key, size, mirrored, object, &bend, scene, notes)? else { return Ok(()) };
        let weights = rest_weights(&scene.meshes[made], &weights);
        let pose = deform::Pose { joints, weights };
        let instance = Instance { mesh: made, world_from_model, pose: Some(pose), ..instance };
        self.stand_bent(node, Hold::Skin(skin), instance, scene);
        Ok(())
    }

    /// Adds an instance deformed by morph targets.
    #[expect(clippy::too_many_arguments, reason = "a node's parts, and where to report")]
    pub(super) fn bend_morph(
        &mut self,
        node: usize,
        object: &Object,
        mesh: usize,
        offset: DAffine3,
        weights: Vec<f64>,
        instance: Instance,
        scene: &mut Scene,
        notes: &mut Notes,
    ) -> Result<()> {
        let bend = Bend { joints: None, weights: &weights, weighed: true };
        let made = self.bent_mesh((mesh, 0, Vec::new()), 1.0, false, object, &bend, scene, notes)?;
        let Some(made) = made else { return Ok(()) };
        let pose = deform::Pose { joints: Vec::new(), weights: rest_weights(&scene.meshes[made], &weights) };
        self.stand_bent(node, Hold::Node(offset), Instance { mesh: made, pose: Some(pose), ..instance }, scene);
        Ok(())
    }

    fn stand_bent(&mut self, node: usize, hold: Hold, instance: Instance, scene: &mut Scene) {
        let weights = instance.pose.as_ref().filter(|_| self.reached.weighed[node]).map(|pose| pose.weights.clone());
        self.hung.instances.push(AnimatedInstance { node, hold, weights: weights.unwrap_or_default() });
        scene.instances.push(instance);
    }

    /// The scene's mesh for a key and a size; created if there is none.
    #[expect(clippy::too_many_arguments, reason = "what must agree, and where to report")]
    fn bent_mesh(
        &mut self,
        key: Key,
        size: f64,
        mirrored: bool,
        object: &Object,
        bend: &Bend,
        scene: &mut Scene,
        notes: &mut Notes,
    ) -> Result<Option<usize>> {
        let same = |bent: &&Bent| {
            let as_large = bent.size == size || (bent.size / size).log2().abs() <= SAME_SIZE;
            as_large && bent.mirrored == mirrored
        };
        if let Some(bent) = self.bent.get(&key).and_then(|all| all.iter().find(same)) {
            check_weights(object, bend.weights)?;
            return Ok(bent.mesh);
        }
        let mesh = self.make_bent(key.0, object, bend, scene, notes)?;
        self.bent.entry(key).or_default().push(Bent { size, mirrored, mesh });
        Ok(mesh)
    }

    /// Adds a deforming mesh to the scene; `None` if it has no triangles.
    fn make_bent(
        &mut self,
        index: usize,
        object: &Object,
        bend: &Bend,
        scene: &mut Scene,
        notes: &mut Notes,
    ) -> Result<Option<usize>> {
        check_weights(object, bend.weights)?;
        let mut mesh = Mesh { name: object.name(|| format!("mesh {index}")), ..Mesh::default() };
        let mut deform = Deform::default();
        let mut targets = None;
        for primitive in object.objects("primitives", "primitive")? {
            let count = primitive.objects("targets", "morph target")?.len();
            if bend.weighed && *targets.get_or_insert(count) != count {
                let count = plural(count, "morph target");
                return Err(primitive
                    .error(format!("has {count}, but other primitives have another number: export the file again")));
            }
            let material = self.materials.index(&primitive, notes)?;
            let double_sided = self.materials.list[material].double_sided;
            let Some((surface, own)) = self.geometry.bent(&primitive, &object.place, bend, double_sided, notes)? else {
                continue;
            };
            let (base, first_index) = (mesh.vertices.len() as u32, mesh.indices.len() as u32);
            let index_count = surface.indices.len() as u32;
            mesh.vertices.extend(surface.vertices);
            mesh.indices.extend(surface.indices.into_iter().map(|index| base + index));
            append(&mut deform, own, base);
            match mesh.primitives.last_mut() {
                Some(last) if last.material == material => last.index_count += index_count,
                _ => mesh.primitives.push(Primitive { first_index, index_count, material }),
            }
        }
        if mesh.indices.is_empty() {
            return Ok(None);
        }
        mesh.deform = Some(deform);
        let joints = bend.joints.map_or_else(Vec::new, <[DAffine3]>::to_vec);
        let rest = deform::Pose { joints, weights: rest_weights(&mesh, bend.weights) };
        mesh.vertices = mesh.posed(&rest);
        if let Some(vertex) = mesh.vertices.iter().find(|v| !v.position.is_finite()) {
            return Err(object.error(format!("its skin moves vertices to {}: export the file again", vertex.position)));
        }
        scene.meshes.push(mesh);
        Ok(Some(scene.meshes.len() - 1))
    }
}

/// Weights of all morph targets of a mesh; missing ones are 0.
fn rest_weights(mesh: &Mesh, weights: &[f64]) -> Vec<f32> {
    let targets = mesh.deform.as_ref().map_or(0, |deform| deform.targets.len());
    (0..targets).map(|at| weights.get(at).map_or(0.0, |&weight| weight as f32)).collect()
}

fn check_weights(mesh: &Object, weights: &[f64]) -> Result<()> {
    for primitive in mesh.objects("primitives", "primitive")? {
        pose::check_weights(&primitive, weights)?;
    }
    Ok(())
}

/// Appends a primitive's deformation to that of its mesh, where the primitive's vertices start at `base`.
fn append(deform: &mut Deform, mut own: Deform, base: u32) {
    let first = deform.influences.len() as u32;
    own.bind.iter_mut().for_each(|bind| bind.first_influence += first);
    for follower in &mut own.followers {
        follower.vertex += base;
        follower.corners = follower.corners.map(|corner| base + corner);
    }
    deform.bind.append(&mut own.bind);
    deform.influences.append(&mut own.influences);
    deform.followers.append(&mut own.followers);
    deform.targets.resize_with(deform.targets.len().max(own.targets.len()), Vec::new);
    deform.targets.iter_mut().zip(own.targets).for_each(|(to, mut from)| to.append(&mut from));
}

impl Geometry<'_> {
    /// The undeformed triangles of a primitive, and its deformation; `None` if it draws none. Triangles without area
    /// are kept, since a pose may give them one.
    fn bent(
        &mut self,
        primitive: &Object,
        mesh: &str,
        bend: &Bend,
        double_sided: bool,
        notes: &mut Notes,
    ) -> Result<Option<(Surface, Deform)>> {
        let Some((mut draft, attributes, used, count)) = self.draft(primitive, mesh, double_sided, notes)? else {
            return Ok(None);
        };
        let targets = primitive.objects("targets", "morph target")?;
        let mut displacements = Vec::new();
        if bend.weighed {
            self.take(targets.len().saturating_mul(used.len()), 0, primitive)?;
            displacements = pose::displacements(&used, count, &targets, self.accessors, mesh)?;
        } else {
            let pose = Pose { weights: bend.weights.to_vec(), joints: None };
            pose::morph(&mut draft.vertices, &used, count, &targets, &pose, self.accessors, mesh)?;
        }
        let mut deform = Deform::default();
        let mut ranges = vec![[0; 2]; used.len()];
        if let Some(joints) = bend.joints {
            (deform.influences, ranges) =
                pose::influences(&used, count, &attributes, joints.len(), self.accessors, mesh, notes)?;
            self.take(deform.influences.len() / 4, 0, primitive)?;
            let mirrored = |&[first, count]: &[u32; 2]| {
                deform.blend(first as usize..(first + count) as usize, joints).matrix3.determinant() < 0.0
            };
            let mirrored: Vec<bool> = ranges.iter().map(mirrored).collect();
            for triangle in draft.triangles.iter_mut().filter(|t| t.iter().all(|&corner| mirrored[corner as usize])) {
                triangle.swap(1, 2);
            }
        }
        draft.drop_repeated(notes);
        if draft.triangles.is_empty() {
            return Ok(None);
        }

        let is_flat = !draft.has_normals;
        // For each vertex of the surface, the index of its original vertex.
        let mut origins: Vec<u32> = match is_flat {
            true => draft.triangles.iter().flatten().copied().collect(),
            false => (0..draft.vertices.len() as u32).collect(),
        };
        let mut surface = if is_flat { draft.with_flat_normals() } else { draft.with_own_normals(notes) };
        let front = surface.vertices.len();
        if double_sided {
            self.take(front, surface.indices.len(), primitive)?;
            surface.add_back();
            origins.extend_from_within(..);
        }
        deform.bind = (surface.vertices.iter().zip(&origins))
            .map(|(vertex, &origin)| {
                let [first_influence, influence_count] = ranges[origin as usize];
                let (position, normal, tangent) = (vertex.position, vertex.normal, vertex.tangent);
                Bind { position, normal, tangent, first_influence, influence_count }
            })
            .collect();
        let side = |at: usize| if at < front { 1.0 } else { -1.0 };
        deform.targets = displacements
            .iter()
            .map(|target| {
                let displaced = |(at, &origin): (usize, &u32)| {
                    let Displacement { position, normal, tangent } = target[origin as usize];
                    Displacement { position, normal: normal * side(at), tangent: tangent * side(at) }
                };
                origins.iter().enumerate().map(displaced).collect()
            })
            .collect();
        if is_flat {
            for corners in surface.indices.as_chunks::<3>().0 {
                let at = |corner: usize| Follower {
                    vertex: corners[corner],
                    corners: *corners,
                    weights: [f32::from(corner == 1), f32::from(corner == 2)],
                    flat: 1,
                };
                deform.followers.extend([0, 1, 2].map(at));
            }
        }
        Ok(Some((surface, deform)))
    }
}
