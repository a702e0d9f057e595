//! Ray casting against a scene's triangles: nearest hit and its side, in f32, with a bounding volume hierarchy.

use super::Scene;
use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::ray::{Ray, RayHit};
use rayon::prelude::*;

/// Margin of the boxes around triangles, as a share of the scene's radius; more than the f32 rounding of rays.
const MARGIN: f32 = 2e-6;

/// Triangles no longer than this [radii] count as points; no ray hits them.
const LEAST: f32 = 1e-7;

/// Relative enlargement of triangles, so that a ray through a shared edge hits one of the two.
const OVERLAP: f32 = 1e-5;

/// A scene in its current pose, for ray casting. Alpha cutouts count as surface.
pub struct Rays {
    /// Centre of the scene's bounds \[m\]; stored positions are relative to it, in units of `radius`.
    centre: DVec3,
    /// Half of the bounds' diagonal \[m\].
    radius: f64,
    triangles: Vec<Triangle>,
    /// `None` for a scene without triangles.
    hierarchy: Option<CwBvh>,
}

/// A triangle; counter-clockwise seen from its front.
#[derive(Clone, Copy)]
struct Triangle {
    corner: Vec3A,
    edges: [Vec3A; 2],
    /// The triangle list also contains the other side.
    double_sided: bool,
}

/// A hit of a ray on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray \[m\].
    pub distance: f64,
    /// Unit normal of the front.
    pub normal: DVec3,
    /// Whether the ray hits the front side.
    pub front: bool,
}

/// Directions above a surface whose density is proportional to the cosine with its unit normal: a fixed spiral.
pub fn cosine_directions(normal: DVec3, count: u32) -> impl Iterator<Item = DVec3> {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let square = (f64::from(i) + 0.5) / f64::from(count);
        let (sin, cos) = (f64::from(i) * golden).sin_cos();
        (tangent * cos + bitangent * sin) * square.sqrt() + normal * (1.0 - square).sqrt()
    })
}

impl Rays {
    /// Collects all visible triangles in their current pose and builds the hierarchy, on all cores.
    pub fn new(scene: &Scene) -> Self {
        Self::of(scene, |_| true)
    }

    /// The same, only for instances for which `among` is true.
    pub fn of(scene: &Scene, among: impl Fn(usize) -> bool + Sync) -> Self {
        let placed: Vec<([DVec3; 3], bool)> = (scene.instances.par_iter().enumerate())
            .filter(|(index, instance)| !instance.hidden && among(*index))
            .flat_map_iter(|(_, instance)| {
                let mesh = &scene.meshes[instance.mesh];
                let posed = instance.pose.as_ref().map(|pose| mesh.posed(pose));
                let place = instance.world_from_model;
                let mirrored = place.matrix3.determinant() < 0.0;
                let materials = mesh.triangle_materials().into_iter().enumerate();
                materials.map(move |(triangle, material)| {
                    let vertices = posed.as_ref().unwrap_or(&mesh.vertices);
                    let [a, b, c] =
                        mesh.triangle(triangle).map(|v| place.transform_point3(vertices[v].position.as_dvec3()));
                    (if mirrored { [a, c, b] } else { [a, b, c] }, scene.materials[material].double_sided)
                })
            })
            .collect();
        Self::of_triangles(placed)
    }

    /// The same for triangles in the world, counter-clockwise seen from the front, and whether each is double-sided.
    pub fn of_triangles(mut placed: Vec<([DVec3; 3], bool)>) -> Self {
        placed.retain(|(corners, _)| corners.iter().all(|corner| corner.is_finite()));
        let corners = || placed.iter().flat_map(|(corners, _)| corners);
        let low = corners().copied().reduce(DVec3::min).unwrap_or_default();
        let high = corners().copied().reduce(DVec3::max).unwrap_or_default();
        let centre = 0.5 * (low + high);
        let radius = Some(0.5 * low.distance(high)).filter(|radius| *radius > 0.0).unwrap_or(1.0);
        let mut triangles: Vec<Triangle> = (placed.par_iter())
            .map(|&(corners, double_sided)| {
                let [a, b, c] = corners.map(|corner| Vec3A::from(((corner - centre) / radius).as_vec3()));
                Triangle { corner: a, edges: [b - a, c - a], double_sided }
            })
            .filter(|t| t.edges.iter().any(|edge| edge.abs().max_element() > LEAST))
            .collect();
        // Many identical triangles would make the hierarchy as deep as their number.
        triangles.par_sort_unstable_by_key(Triangle::bits);
        triangles.dedup_by_key(|t| t.bits());
        let boxes: Vec<Aabb> = (triangles.par_iter())
            .map(|t| {
                let corners = [t.corner, t.corner + t.edges[0], t.corner + t.edges[1]];
                let low = corners[0].min(corners[1]).min(corners[2]);
                let high = corners[0].max(corners[1]).max(corners[2]);
                Aabb::new(low - MARGIN, high + MARGIN)
            })
            .collect();
        let build = || build_cwbvh(&boxes, BvhBuildParams::fast_build(), &mut std::time::Duration::default());
        let hierarchy = (!boxes.is_empty()).then(build);
        Self { centre, radius, triangles, hierarchy }
    }

    /// The nearest hit of the ray from `origin` \[m\] in the unit `direction`. A double-sided surface is hit on the
    /// side that faces the origin.
    pub fn nearest(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        self.within(origin, direction, f64::INFINITY)
    }

    /// The nearest hit within a distance \[m\].
    pub fn within(&self, origin: DVec3, direction: DVec3, distance: f64) -> Option<Hit> {
        let hierarchy = self.hierarchy.as_ref()?;
        // The traversal misses everything along a direction with a negative zero; adding 0 makes the zero positive.
        let unit = |v: DVec3| Vec3A::from(v.as_vec3()) + Vec3A::ZERO;
        let (origin, towards) = (unit((origin - self.centre) / self.radius), unit(direction));
        if !(origin.is_finite() && towards.is_finite()) {
            // An origin beyond the range of single precision hits nothing.
            return None;
        }
        let end = (distance / self.radius).min(f64::from(f32::MAX)) as f32;
        let ray = Ray::new(origin, towards, 0.0, end);
        let mut found = RayHit::none();
        hierarchy.ray_traverse(ray, &mut found, |ray, slot| {
            let triangle = &self.triangles[hierarchy.primitive_indices[slot] as usize];
            triangle.distance(ray.origin, ray.direction).filter(|t| *t < ray.tmax).unwrap_or(f32::INFINITY)
        });
        if found.t >= end {
            return None;
        }
        let triangle = &self.triangles[hierarchy.primitive_indices[found.primitive_id as usize] as usize];
        let normal = triangle.edges[0].cross(triangle.edges[1]).as_dvec3().normalize_or_zero();
        Some(Hit { distance: f64::from(found.t) * self.radius, normal, front: normal.dot(direction) < 0.0 })
    }
}

impl Triangle {
    /// Sort key: equal for identical triangles.
    fn bits(&self) -> [u32; 10] {
        let [[a, b, c], [d, e, f], [g, h, i]] = [self.corner, self.edges[0], self.edges[1]].map(|v| v.to_array());
        let [a, b, c, d, e, f, g, h, i] = [a, b, c, d, e, f, g, h, i].map(f32::to_bits);
        [a, b, c, d, e, f, g, h, i, self.double_sided.into()]
    }

    /// Moeller-Trumbore intersection.
    fn distance(&self, origin: Vec3A, direction: Vec3A) -> Option<f32> {
        let [u, v] = self.edges;
        let p = direction.cross(v);
        let determinant = u.dot(p);
        if self.double_sided && determinant < 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let offset = origin - self.corner;
        let second = offset.dot(p) * inverse;
        let q = offset.cross(u);
        let third = direction.dot(q) * inverse;
        let distance = v.dot(q) * inverse;
        // Comparisons with NaN are false: triangles seen edge-on are missed.
        let inside = second >= -OVERLAP && third >= -OVERLAP && second + third <= 1.0 + OVERLAP;
        (inside && distance > 0.0 && distance.is_finite()).then_some(distance)
    }
}
