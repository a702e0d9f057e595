//! Deforming meshes: skins and morph targets as glTF defines them, applied to the rest shape for every pose.
//!
//! `Mesh::vertices` of a deforming mesh hold the rest pose, on which caches are placed. `Deform` holds the data from
//! which poses are computed. Both the device (`frame/deform.rs`) and `Mesh::posed` here read it.

use super::{Instance, Mesh, Scene, Vertex};
use glam::{DAffine3, DMat3, DVec3, Vec3};

/// Data from which the poses of a mesh are computed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deform {
    /// The mesh's first vertices before morphing and skinning. All later vertices are followers.
    pub bind: Vec<Bind>,
    /// Joint influences of all of `bind`, one run per vertex; the weights of a run sum to 1.
    pub influences: Vec<Influence>,
    /// For each morph target, the displacement of each vertex of `bind`.
    pub targets: Vec<Vec<Displacement>>,
    /// Vertices that follow a triangle of `bind`: vertices made by subdivision, and corners of flat triangles, whose
    /// normals are those of the posed triangle.
    pub followers: Vec<Follower>,
}

/// A vertex as the file stores it. The two sides of a double-sided surface have separate vertices.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Bind {
    /// Position [m in the skin's bind space, or in model space without one].
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Tangent, as in `Vertex`.
    pub tangent: [f32; 4],
    /// Index of its first influence.
    pub first_influence: u32,
    /// Number of influences; 0 if the mesh has no skin.
    pub influence_count: u32,
}

/// Influence of a joint on a vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Influence {
    /// Index into `Pose::joints`.
    pub joint: u32,
    /// Weight of the joint.
    pub weight: f32,
}

/// Displacement of a vertex by a morph target of weight 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Displacement {
    /// Displacement of the position \[m\].
    pub position: Vec3,
    /// Displacement of the normal.
    pub normal: Vec3,
    /// Displacement of the tangent's direction.
    pub tangent: Vec3,
}

/// A vertex that follows a triangle of `Deform::bind`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Follower {
    /// Index of the mesh's vertex. A vertex of `bind` only if it is flat; it then follows its own corner.
    pub vertex: u32,
    /// The triangle, counter-clockwise, as vertices of `bind`.
    pub corners: [u32; 3],
    /// Barycentric weights of the second and third corners.
    pub weights: [f32; 2],
    /// 1: the normal is that of the posed triangle, and there is no tangent. 0: normal and tangent are interpolated.
    pub flat: u32,
}

/// Pose of an instance of a deforming mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// For each joint of the skin, bind space to model space. Empty without a skin.
    pub joints: Vec<DAffine3>,
    /// Weight of each morph target.
    pub weights: Vec<f32>,
}

/// A posed vertex of `Deform::bind`.
#[derive(Clone, Copy)]
struct Posed {
    position: DVec3,
    normal: DVec3,
    tangent: DVec3,
    /// Bitangent sign.
    sign: f32,
}

impl Mesh {
    /// The vertices in a pose, in model space; the rest vertices for meshes that do not deform. Computed in f64, as the
    /// reference for the device's results.
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

    /// Moves a follower to its triangle, whose corners are read from `vertices` in any pose.
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
    /// A posed vertex of `bind`: morph targets are added, then joints applied.
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
            // If a pose leaves no normal, use the file's.
            normal: if turned == DVec3::ZERO { bind.normal.as_dvec3() } else { turned },
            tangent: along,
            // For a tangent without length the sign marks the side; mirroring does not change it.
            sign: if mirrored && along != DVec3::ZERO { -sign } else { sign },
        }
    }

    /// The weighted mean of joint matrices.
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
            // A triangle that has collapsed to a line has no normal; use the rest normal.
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
    /// The scene frozen in its current pose: every deformed instance gets a static mesh of its own, animation is
    /// removed, and hidden instances are dropped.
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

/// Transforms normals for a linear map, unnormalised: the cofactor matrix, which exists for flattening maps too. The
/// shaded side stays the same under mirroring.
fn cofactors(m: DMat3) -> DMat3 {
    let side = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis)) * side
}

/// The unit vector; zero for a zero vector.
fn direction(v: DVec3) -> DVec3 {
    v.try_normalize().unwrap_or(DVec3::ZERO)
}
