//! A mesh in bake space: in world metres, oriented as in the world, relative to the mesh's own centre. Vertices lie at
//! their placing positions ([`Mesh::placing`]). METHOD 8.

use super::seeds;
use crate::scene::Mesh;
use glam::{DMat3, DVec3};
use std::collections::HashMap;

/// A mesh under the linear part of a transform.
pub(super) struct Surface {
    /// Centre of the mesh in model space; the origin of bake space.
    pub(super) centre: DVec3,
    /// Linear part of `world_from_model`, as in the world.
    pub(super) linear: DMat3,
    /// Transforms model-space normals to bake space, unnormalised: the cofactor matrix, which exists for flattening
    /// scales too.
    pub(super) normal_matrix: DMat3,
    /// All vertices of the mesh, in bake space.
    pub(super) positions: Vec<DVec3>,
    /// Their shading normals in bake space: unit, or zero if neither the mesh nor a triangle gives one.
    pub(super) normals: Vec<DVec3>,
    /// For each vertex, the first vertex at its position.
    pub(super) welded: Vec<u32>,
    /// The triangles with non-zero area.
    pub(super) triangles: Vec<Triangle>,
    /// Smallest coordinates of `triangles`.
    pub(super) low: DVec3,
    /// Largest coordinates of `triangles`.
    pub(super) high: DVec3,
    /// Sum of the triangles' areas [m^2].
    pub(super) area: f64,
    /// Whether the mesh deforms; rest normals then say little about other poses.
    pub(super) bends: bool,
}

/// A triangle with non-zero area.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    /// Index in the mesh.
    pub(super) index: u32,
    /// Vertex indices.
    pub(super) vertices: [u32; 3],
    /// Unit geometric normal of the shaded side.
    pub(super) normal: DVec3,
    /// Area [m^2].
    pub(super) area: f64,
    /// Bin of the normal.
    pub(super) bin: u16,
}

/// Twice the area over the square of the longest side, below which a triangle counts as degenerate. Its normal would be
/// known to 1e-6 at best in f64, and it is a thousand million times longer than wide.
const DEGENERATE: f64 = 1e-9;

impl Surface {
    /// Transforms a mesh to bake space.
    pub(super) fn new(mesh: &Mesh, linear: DMat3) -> Self {
        let centre = centre(mesh);
        let columns = [linear.x_axis, linear.y_axis, linear.z_axis];
        // det(L) L^-T: a mirroring transform reverses the winding but not the shaded side.
        let mirror = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
        let normal_matrix = DMat3::from_cols(
            columns[1].cross(columns[2]) * mirror,
            columns[2].cross(columns[0]) * mirror,
            columns[0].cross(columns[1]) * mirror,
        );
        // The centre is subtracted first: differences of f32 positions are exact enough in f64 wherever the mesh lies.
        let place = |v: usize| linear * (mesh.placing_at(v).as_dvec3() - centre);
        let positions: Vec<_> = (0..mesh.vertices.len()).map(place).collect();
        let mut normals: Vec<_> =
            mesh.vertices.iter().map(|v| (normal_matrix * v.normal.as_dvec3()).normalize_or_zero()).collect();

        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut triangles = Vec::with_capacity(mesh.triangle_count());
        for index in 0..mesh.triangle_count() {
            let vertices = mesh.triangle(index);
            let [a, b, c] = vertices.map(|v| positions[v]);
            let cross = (b - a).cross(c - a) * mirror;
            let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
            let double_area = cross.length();
            if !double_area.is_finite() || double_area <= DEGENERATE * longest {
                continue;
            }
            let shading: DVec3 = vertices.iter().map(|&v| normals[v]).sum();
            let normal = cross / double_area * if shading.dot(cross) < 0.0 { -1.0 } else { 1.0 };
            let bin = seeds::normal_bin(normal) as u16;
            let vertices = vertices.map(|v| v as u32);
            triangles.push(Triangle { index: index as u32, vertices, normal, area: 0.5 * double_area, bin });
            low = low.min(a).min(b).min(c);
            high = high.max(a).max(b).max(c);
        }
        let missing: Vec<bool> = normals.iter().map(|n| *n == DVec3::ZERO).collect();
        if missing.contains(&true) {
            for triangle in &triangles {
                for vertex in triangle.vertices.map(|v| v as usize).into_iter().filter(|&v| missing[v]) {
                    normals[vertex] += triangle.normal * triangle.area;
                }
            }
            normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
        }
        let area = triangles.iter().map(|t| t.area).sum();
        let bends = mesh.deform.is_some();
        let welded = welded(mesh);
        Self { centre, linear, normal_matrix, positions, normals, welded, triangles, low, high, area, bends }
    }

    /// Corners of a triangle.
    pub(super) fn corners(&self, triangle: &Triangle) -> [DVec3; 3] {
        triangle.vertices.map(|v| self.positions[v as usize])
    }

    /// A point of a triangle as weights of its second and third corners, rounded to a cache's precision.
    pub(super) fn weights(&self, triangle: &Triangle, point: DVec3) -> [f32; 2] {
        let [a, b, c] = self.corners(triangle);
        let normal = (b - a).cross(c - a);
        let second = (point - a).cross(c - a).dot(normal) / normal.length_squared();
        let third = (b - a).cross(point - a).dot(normal) / normal.length_squared();
        let second = (second as f32).clamp(0.0, 1.0);
        [second, (third as f32).clamp(0.0, 1.0 - second)]
    }

    /// The point with the given weights.
    pub(super) fn point(&self, triangle: &Triangle, weights: [f32; 2]) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        a + (b - a) * f64::from(weights[0]) + (c - a) * f64::from(weights[1])
    }
}

/// For each vertex, the first vertex at its position, within about a 100 000th of the mesh. Vertices are duplicated for
/// different normals or texture coordinates, and in some meshes the corners of adjacent triangles differ by rounding.
fn welded(mesh: &Mesh) -> Vec<u32> {
    let [low, high] = bounds(mesh);
    let step = (1e-5 * (high - low).max_element()).max(f64::MIN_POSITIVE);
    // The offset avoids round coordinates, which are common.
    let place = |v: u32| {
        let position = mesh.placing_at(v as usize).as_dvec3();
        ((position - low) / step + 0.317).to_array().map(|x| x.floor() as i64)
    };
    let mut first = HashMap::with_capacity(mesh.vertices.len());
    (0..mesh.vertices.len() as u32).map(|vertex| *first.entry(place(vertex)).or_insert(vertex)).collect()
}

/// Middle of the vertices that triangles use, in model space.
fn centre(mesh: &Mesh) -> DVec3 {
    let [low, high] = bounds(mesh);
    if low.is_finite() { (low + high) * 0.5 } else { DVec3::ZERO }
}

/// Smallest and largest coordinates of the vertices that triangles use, in model space.
fn bounds(mesh: &Mesh) -> [DVec3; 2] {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &index in &mesh.indices {
        let position = mesh.placing_at(index as usize).as_dvec3();
        if position.is_finite() {
            low = low.min(position);
            high = high.max(position);
        }
    }
    [low, high]
}
