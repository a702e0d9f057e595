//! Divides triangles that are large against the distance of caches, since light is interpolated per vertex.
//!
//! An edge is halved by its own length alone, so that both triangles beside it agree and no crack opens.

mod carried;

use super::{Mesh, Primitive, Scene, Vertex};
use carried::Carried;
use glam::{DMat3, Vec4};
use std::collections::HashMap;

/// Rounds of halving: an edge a thousand times too long is left long.
const ROUNDS: usize = 10;

/// About as many triangles may be made by dividing.
const MOST_TRIANGLES: usize = 2_000_000;

/// Surface [m^2 in world space] over all instances.
pub fn area(scene: &Scene) -> f64 {
    let triangle = |mesh: &Mesh, linear: DMat3, t: usize| {
        let [a, b, c] = mesh.triangle(t).map(|i| mesh.vertices[i].position.as_dvec3());
        0.5 * (linear * (b - a)).cross(linear * (c - a)).length()
    };
    let instance = |i: &super::Instance| {
        let mesh = &scene.meshes[i.mesh];
        (0..mesh.triangle_count()).map(|t| triangle(mesh, i.stretch(), t)).filter(|a| a.is_finite()).sum::<f64>()
    };
    scene.instances.iter().map(instance).sum()
}

/// Distance \[m\] between caches that a count of them can be expected to have: the bake needs about five caches for the
/// square of their spacing.
pub fn expected_spacing(scene: &Scene, caches: usize) -> f64 {
    (5.0 * area(scene) / caches.max(1) as f64).sqrt()
}

/// Divides for caches that stand `spacing` \[m\] apart: no edge is to be longer than a quarter of it, or than `max_edge`
/// \[m\] where that is given; 0 leaves all as they are.
pub fn divide(scene: &mut Scene, spacing: f64, max_edge: Option<f64>) {
    if max_edge == Some(0.0) {
        return;
    }
    // However fine is asked for: halved edges leave about two triangles for the square of the longest.
    let finest = (2.0 * area(scene) / MOST_TRIANGLES as f64).sqrt();
    let longest = max_edge.unwrap_or(0.25 * spacing).max(finest);
    let added = tessellate(scene, longest, MOST_TRIANGLES);
    log::info!("{added} triangles added by halving edges longer than {longest:.4} m");
}

/// Halves edges longer than `longest` [m in world space] until none is left, or until a mesh would have more than
/// `most` triangles. Gives the number of triangles that were added.
pub fn tessellate(scene: &mut Scene, longest: f64, most: usize) -> usize {
    let mut added = 0;
    for index in 0..scene.meshes.len() {
        // Instances that differ by rotation alone have the same metric.
        let mut metrics: Vec<DMat3> = Vec::new();
        for instance in scene.instances.iter().filter(|i| i.mesh == index) {
            let linear = instance.stretch();
            let metric = linear.transpose() * linear;
            let size = metric.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            if !metrics.iter().any(|m| m.abs_diff_eq(metric, 1e-3 * size)) {
                metrics.push(metric);
            }
        }
        let mesh = &mut scene.meshes[index];
        let before = mesh.triangle_count();
        for _ in 0..ROUNDS {
            let Some(finer) = halve(mesh, &metrics, longest * longest).filter(|finer| finer.triangle_count() <= most)
            else {
                break;
            };
            *mesh = finer;
        }
        if mesh.triangle_count() > before {
            carried::settle(mesh);
        }
        added += mesh.triangle_count() - before;
    }
    added
}

/// The mesh with every edge whose squared length exceeds `longest2` halved; `None` if there is none.
fn halve(mesh: &Mesh, metrics: &[DMat3], longest2: f64) -> Option<Mesh> {
    let is_long = |a: u32, b: u32| {
        let d = (mesh.vertices[a as usize].position - mesh.vertices[b as usize].position).as_dvec3();
        metrics.iter().any(|m| d.dot(*m * d) > longest2)
    };
    let mut vertices = mesh.vertices.clone();
    let mut deform = mesh.deform.clone();
    let carried = deform.as_ref().map(Carried::new);
    let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
    let mut middle = |a: u32, b: u32, triangle: &[u32]| {
        is_long(a, b).then(|| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let new = vertices.len() as u32;
                vertices.push(between(&mesh.vertices[a as usize], &mesh.vertices[b as usize]));
                if let (Some(deform), Some(carried)) = (&mut deform, &carried) {
                    deform.followers.push(carried.middle(new, [a, b], triangle));
                }
                new
            })
        })
    };
    let mut indices = Vec::with_capacity(2 * mesh.indices.len());
    let mut primitives = Vec::with_capacity(mesh.primitives.len());
    for primitive in &mesh.primitives {
        let first = indices.len();
        let range = primitive.first_index as usize..(primitive.first_index + primitive.index_count) as usize;
        for corners in mesh.indices[range].chunks_exact(3) {
            let [a, b, c] = [corners[0], corners[1], corners[2]];
            match [middle(a, b, corners), middle(b, c, corners), middle(c, a, corners)] {
                [None, None, None] => indices.extend([a, b, c]),
                [Some(m), None, None] => indices.extend([a, m, c, m, b, c]),
                [None, Some(m), None] => indices.extend([b, m, a, m, c, a]),
                [None, None, Some(m)] => indices.extend([c, m, b, m, a, b]),
                [Some(m), Some(n), None] => indices.extend([m, b, n, a, m, n, a, n, c]),
                [None, Some(m), Some(n)] => indices.extend([m, c, n, b, m, n, b, n, a]),
                [Some(n), None, Some(m)] => indices.extend([m, a, n, c, m, n, c, n, b]),
                [Some(m), Some(n), Some(o)] => indices.extend([a, m, o, m, b, n, o, n, c, m, n, o]),
            }
        }
        let (first_index, index_count) = (first as u32, (indices.len() - first) as u32);
        primitives.push(Primitive { first_index, index_count, ..*primitive });
    }
    (!middles.is_empty()).then(|| Mesh { name: mesh.name.clone(), vertices, indices, primitives, deform })
}

/// The vertex halfway.
fn between(a: &Vertex, b: &Vertex) -> Vertex {
    let tangent = (Vec4::from_array(a.tangent).truncate() + Vec4::from_array(b.tangent).truncate()).normalize_or_zero();
    let color = std::array::from_fn(|i| ((u16::from(a.color[i]) + u16::from(b.color[i])).div_ceil(2)) as u8);
    Vertex {
        position: (a.position + b.position) * 0.5,
        normal: (a.normal + b.normal).try_normalize().unwrap_or(a.normal),
        tangent: tangent.extend(a.tangent[3]).to_array(),
        uv0: (a.uv0 + b.uv0) * 0.5,
        uv1: (a.uv1 + b.uv1) * 0.5,
        color,
    }
}
