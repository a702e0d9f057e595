//! Meshes that bend: skins and morph targets as glTF defines them, applied anew for every pose.
//!
//! A mesh that bends keeps in `Mesh::vertices` how it stands at rest, which caches are placed on; `Deform` holds what its
//! pose is made of. Both the device (`frame/deform.rs`) and `Mesh::posed` here read it.

use glam::{DAffine3, Vec3};

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
    /// Of the position [m].
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
