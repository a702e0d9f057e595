//! Places the caches on the surfaces of a scene, once. METHOD 8, thesis 5.6.

use glam::Vec3;

/// What the bake is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How densely caches stand.
    pub density: Density,
    /// `theta_eps`: largest angle [rad] between a surface's normal and its cache's.
    pub angle: f32,
    /// References per vertex, 8 or 16.
    pub references: usize,
}

/// How densely caches stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// About this many caches over all instances of the scene; the bake searches the spacing.
    Count(usize),
    /// `d_eps` [m in world space]: largest distance of a surface point to a cache.
    Spacing(f64),
}

/// The caches of a scene and which of them each vertex refers to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CacheSet {
    /// `d_eps` [m] that was used or found.
    pub spacing: f64,
    /// One per mesh and stretch: instances that differ only by rotation, mirroring and translation share one.
    pub models: Vec<ModelCaches>,
    /// For each of `Scene::instances`, the index into `models`.
    pub instance_model: Vec<usize>,
}

/// The caches of one mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelCaches {
    /// Index into `Scene::meshes`.
    pub mesh: usize,
    /// The caches, in a space-filling order.
    pub caches: Vec<Cache>,
    /// For each vertex of the mesh, `Settings::references` indices into `caches`, best first; `NO_CACHE` pads.
    pub references: Vec<u16>,
    /// What was found when every piece of surface was checked against its caches.
    pub coverage: Coverage,
}

/// A cache: a point on a triangle. Position and normal are the triangle's, interpolated in the mesh's model space.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Cache {
    /// Model-space position.
    pub position: Vec3,
    /// Unit model-space shading normal: the triangle's vertex normals, interpolated at the cache.
    pub normal: Vec3,
    /// Share of the surface that this cache stands for [m^2 in world space]; METHOD 6, eq. 5.58.
    pub area: f32,
    /// Triangle of the mesh the cache lies on.
    pub triangle: u32,
    /// Barycentric weights of the triangle's second and third corner.
    pub barycentric: [f32; 2],
}

/// The proof that every surface point has its cache.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Largest distance [m] of a surface point to the cache that covers it; at most `d_eps`.
    pub distance: f64,
    /// Largest angle [rad] between a surface's geometric normal and that of the covering cache's triangle.
    pub angle: f64,
}

/// Pads reference lists of models with fewer caches than references.
pub const NO_CACHE: u16 = u16::MAX;
