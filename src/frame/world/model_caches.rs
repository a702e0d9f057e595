//! Baked caches in the form that stage 3 reads (`atlas.comp`).

use super::update::normal_matrix;
use crate::bake::{Cache, CacheSet, ModelCaches};
use crate::scene::{Mesh, Scene};
use crate::shared::ModelCache;
use glam::{DMat3, DVec3, Vec2, Vec3, Vec4};

/// The surface that a cache lies on.
pub(super) struct CacheSurface {
    pub(super) triangle: usize,
    pub(super) material: usize,
    uv: [Vec2; 2],
}

impl CacheSurface {
    /// The surfaces of a model's caches.
    pub(super) fn all(scene: &Scene, mesh: usize, model: &ModelCaches) -> Vec<Self> {
        let mesh = &scene.meshes[mesh];
        let materials = mesh.triangle_materials();
        let surface = |cache: &Cache| {
            let [a, b, c] = mesh.triangle(cache.triangle as usize).map(|i| &mesh.vertices[i]);
            let [v, w] = cache.barycentric;
            let u = 1.0 - v - w;
            let uv = [u * a.uv0 + v * b.uv0 + w * c.uv0, u * a.uv1 + v * b.uv1 + w * c.uv1];
            let triangle = cache.triangle as usize;
            Self { triangle, material: materials[triangle], uv }
        };
        model.caches.iter().map(surface).collect()
    }

    /// Phong exponent at the cache.
    pub(super) fn exponent(&self, scene: &Scene) -> f32 {
        scene.materials[self.material].reflectance(scene, self.uv, Vec4::ONE).cache_exponent()
    }
}

/// The caches of a model, with the Phong exponent of their surfaces.
pub(super) fn place_caches(
    scene: &Scene,
    mesh: usize,
    model: &ModelCaches,
    instance: u32,
    cache_surfaces: &[CacheSurface],
) -> Vec<ModelCache> {
    let mesh = &scene.meshes[mesh];
    let (normals, _) = normal_matrix(model.linear);
    let place = |(c, surface): (&Cache, &CacheSurface)| {
        let area = f64::from(c.area);
        let length = (model.linear * c.axis.as_dvec3()).length();
        let over = |value: f64, by: f64| if by > 0.0 { (value / by) as f32 } else { 0.0 };
        let placed = ModelCache {
            position: c.position,
            exponent: surface.exponent(scene),
            normal: c.normal,
            // The shader multiplies by the transformed normal's length. Under the baked transform, that length is this
            // one.
            area: over(area, (normals * c.normal.as_dvec3()).length()),
            middle: c.middle,
            breadth: over(f64::from(c.breadth) * length, area),
            axis: c.axis,
            instance,
        };
        if mesh.deform.is_some() { on_triangle(mesh, model.linear, c, placed) } else { placed }
    };
    model.caches.iter().zip(cache_surfaces).map(place).collect()
}

/// Expresses a cache relative to its triangle, for a mesh at rest under this transform.
fn on_triangle(mesh: &Mesh, linear: DMat3, c: &Cache, placed: ModelCache) -> ModelCache {
    let corner = |i: usize| linear * mesh.vertices[i].position.as_dvec3();
    let [a, b, d] = mesh.triangle(c.triangle as usize).map(corner);
    let (e1, e2) = (b - a, d - a);
    let face = e1.cross(e2);
    let upward = face.normalize_or(DVec3::Y);
    let frame = DMat3::from_cols(e1, e2, upward);
    let within = |v: DVec3| {
        let parts = frame.inverse() * v;
        if parts.is_finite() { parts.as_vec3() } else { Vec3::ZERO }
    };
    let [second, third] = c.barycentric;
    let area = 0.5 * face.length();
    ModelCache {
        position: Vec3::new(second, third, c.triangle as f32),
        area: if area > 0.0 { (f64::from(c.area) / area) as f32 } else { 0.0 },
        middle: within(linear * (c.middle - c.position).as_dvec3()),
        axis: within(linear * c.axis.as_dvec3()),
        ..placed
    }
}

/// References per vertex, or per cell if pixels look them up.
pub(super) fn references_each(scene: &Scene, caches: Option<&CacheSet>) -> usize {
    let Some(caches) = caches else { return 8 };
    if let Some(cells) = &caches.cells {
        return cells.row;
    }
    let of_model = |model: &ModelCaches| model.references.len().checked_div(scene.meshes[model.mesh].vertices.len());
    caches.models.iter().find_map(of_model).unwrap_or(8)
}
