//! Meshes that bend: skins and morph targets as glTF defines them, applied from the rest shape for every pose.
//!
//! A mesh that bends keeps in `Mesh::vertices` how it stands at rest, which caches are placed on; `Deform` holds what its
//! pose is made of. Both the device (`frame/deform.rs`) and `Mesh::posed` here read it.

use super::{Instance, Mesh, Scene, Vertex};
use glam::{DAffine3, DMat3, DVec3, Vec3};

/// What the poses of a mesh are made of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deform {
    /// The mesh's first vertices before morphing and skinning. Vertices after them are followers.
    pub bind: Vec<Bind>,
    /// Joints of all of `bind`, run by run; weights of a run sum to 1.
    pub influences: Vec<Influence>,
    /// For each morph target, what it adds to each of `bind`.
    pub targets: Vec<Vec<Displacement>>,
    /// Vertices that go with a triangle of `bind`: those made by dividing it, and the corners of flat ones, whose normals are
    /// those of the posed triangle.
    pub followers: Vec<Follower>,
}

/// A vertex as the file stores it; two sides of a double-sided surface are two of them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Bind {
    /// Position [m in the skin's bind space, or in model space without one].
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// As in `Vertex`.
    pub tangent: [f32; 4],
    /// First of its influences.
    pub first_influence: u32,
    /// How many; none where the mesh has no skin.
    pub influence_count: u32,
}

/// How strongly a joint moves a vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Influence {
    /// Index into `Pose::joints`.
    pub joint: u32,
    /// Share of the vertex that moves with it.
    pub weight: f32,
}

/// What a morph target of weight 1 adds to a vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Displacement {
    /// Of the position \[m\].
    pub position: Vec3,
    /// Of the normal.
    pub normal: Vec3,
    /// Of the tangent's direction.
    pub tangent: Vec3,
}

/// A vertex that is carried along by a triangle of `Deform::bind`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Follower {
    /// Which vertex of the mesh; one of `bind` only if it is flat, at its own corner.
    pub vertex: u32,
    /// The triangle, counter-clockwise: vertices of `bind`.
    pub corners: [u32; 3],
    /// Barycentric weights of the second and third corner.
    pub weights: [f32; 2],
    /// 1: the normal is the posed triangle's own, and there is no tangent. 0: normal and tangent are interpolated.
    pub flat: u32,
}

/// How an instance of a mesh that bends stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// For each joint of the skin, bind space to model space. Empty without a skin.
    pub joints: Vec<DAffine3>,
    /// Weight of each morph target.
    pub weights: Vec<f32>,
}

/// A vertex of `Deform::bind` as it stands.
#[derive(Clone, Copy)]
struct Posed {
    position: DVec3,
    normal: DVec3,
    tangent: DVec3,
    /// Bitangent sign.
    sign: f32,
}

impl Mesh {
    /// The vertices as they stand in a pose, in model space; those at rest for meshes that do not bend. In f64 up to the
    /// result: what the device computes is held against it.
    pub fn posed(&self, pose: &Pose) -> Vec<Vertex> {
        let mut vertices = self.vertices.clone();
        let Some(deform) = &self.deform else { return vertices };
        let corners: Vec<Posed> = (0..deform.bind.len()).map(|at| deform.corner(at, pose)).collect();
        for (vertex, corner) in vertices.iter_mut().zip(&corners) {
            vertex.position = corner.position.as_vec3();
            vertex.normal = corner.normal.as_vec3();
            vertex.tangent = corner.tangent.as_vec3().extend(corner.sign).into();
        }
        for follower in &deform.followers {
            let own = vertices[follower.vertex as usize].tangent;
            let (position, normal, tangent) = deform.follow(follower, |corner| corners[corner], own);
            let vertex = &mut vertices[follower.vertex as usize];
            *vertex = Vertex { position, normal, tangent, ..*vertex };
        }
        vertices
    }

    /// Puts a follower where its corners are, of which `vertices` are some pose.
    pub(super) fn settle(&self, follower: &Follower, vertices: &mut [Vertex]) {
        let Some(deform) = &self.deform else { return };
        let corner = |at: usize| {
            let Vertex { position, normal, tangent: [x, y, z, sign], .. } = vertices[at];
            let tangent = Vec3::new(x, y, z).as_dvec3();
            Posed { position: position.as_dvec3(), normal: normal.as_dvec3(), tangent, sign }
        };
        let own = vertices[follower.vertex as usize].tangent;
        let (position, normal, tangent) = deform.follow(follower, corner, own);
        let vertex = &mut vertices[follower.vertex as usize];
        *vertex = Vertex { position, normal, tangent, ..*vertex };
    }
}

impl Deform {
    /// A vertex of `bind`: targets added, then moved with its joints.
    fn corner(&self, at: usize, pose: &Pose) -> Posed {
        let bind = &self.bind[at];
        let [x, y, z, sign] = bind.tangent;
        let mut position = bind.position.as_dvec3();
        let mut normal = bind.normal.as_dvec3();
        let mut tangent = Vec3::new(x, y, z).as_dvec3();
        let has_tangent = tangent != DVec3::ZERO;
        for (target, &weight) in self.targets.iter().zip(&pose.weights).filter(|(_, weight)| **weight != 0.0) {
            let weight = f64::from(weight);
            position += weight * target[at].position.as_dvec3();
            normal += weight * target[at].normal.as_dvec3();
            tangent += weight * target[at].tangent.as_dvec3();
        }
        let mut blend = DAffine3::IDENTITY;
        if bind.influence_count > 0 && !pose.joints.is_empty() {
            let first = bind.first_influence as usize;
            blend = self.blend(first..first + bind.influence_count as usize, &pose.joints);
        }
        let m = blend.matrix3;
        let mirrored = m.determinant() < 0.0;
        let turned = direction(cofactors(m) * normal);
        let along = if has_tangent { direction(m * tangent) } else { DVec3::ZERO };
        Posed {
            position: blend.transform_point3(position),
            // Where a pose leaves no normal, that of the file is as good as any.
            normal: if turned == DVec3::ZERO { bind.normal.as_dvec3() } else { turned },
            tangent: along,
            // Without a length the sign says which side this is, and mirroring does not change that.
            sign: if mirrored && along != DVec3::ZERO { -sign } else { sign },
        }
    }

    /// The mean of some joints' matrices.
    pub(super) fn blend(&self, influences: std::ops::Range<usize>, joints: &[DAffine3]) -> DAffine3 {
        let mut blend = DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::ZERO };
        for influence in &self.influences[influences] {
            let (matrix, weight) = (&joints[influence.joint as usize], f64::from(influence.weight));
            blend.matrix3 += matrix.matrix3 * weight;
            blend.translation += matrix.translation * weight;
        }
        blend
    }

    /// Position, normal and tangent of a follower; `own` is the tangent of a flat one.
    fn follow(&self, follower: &Follower, corner: impl Fn(usize) -> Posed, own: [f32; 4]) -> (Vec3, Vec3, [f32; 4]) {
        let [a, b, c] = follower.corners.map(|at| corner(at as usize));
        let [second, third] = follower.weights.map(f64::from);
        let between = |a: DVec3, b: DVec3, c: DVec3| a * (1.0 - second - third) + b * second + c * third;
        let position = between(a.position, b.position, c.position).as_vec3();
        if follower.flat == 1 {
            let normal = direction((b.position - a.position).cross(c.position - a.position));
            // A triangle that has become a line has no normal of its own.
            let bind = self.bind[follower.corners[0] as usize].normal.as_dvec3();
            return (position, if normal == DVec3::ZERO { bind } else { normal }.as_vec3(), own);
        }
        let normal = direction(between(a.normal, b.normal, c.normal));
        let tangent = direction(between(a.tangent, b.tangent, c.tangent));
        let normal = if normal == DVec3::ZERO { a.normal } else { normal };
        (position, normal.as_vec3(), tangent.as_vec3().extend(a.sign).into())
    }
}

impl Scene {
    /// The scene as it stands: every instance that bends has a mesh of its own that does not, nothing is animated, and what
    /// is hidden is gone.
    pub fn frozen(&self) -> Self {
        let mut frozen = Self { meshes: Vec::new(), instances: Vec::new(), rig: None, ..self.clone() };
        let mut kept = vec![None; self.meshes.len()];
        for instance in self.instances.iter().filter(|instance| !instance.hidden) {
            let mesh = &self.meshes[instance.mesh];
            let index = match &instance.pose {
                Some(pose) => {
                    frozen.meshes.push(Mesh { vertices: mesh.posed(pose), deform: None, ..mesh.clone() });
                    frozen.meshes.len() - 1
                }
                None => *kept[instance.mesh].get_or_insert_with(|| {
                    frozen.meshes.push(Mesh { deform: None, ..mesh.clone() });
                    frozen.meshes.len() - 1
                }),
            };
            frozen.instances.push(Instance { mesh: index, pose: None, ..instance.clone() });
        }
        frozen
    }
}

/// What takes normals along with a linear map, unnormalised: its cofactors, which exist for flattening ones too. The side
/// that is shaded stays the same under mirroring.
fn cofactors(m: DMat3) -> DMat3 {
    let side = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis)) * side
}

/// Unit length; zero where there is none.
fn direction(v: DVec3) -> DVec3 {
    v.try_normalize().unwrap_or(DVec3::ZERO)
}
