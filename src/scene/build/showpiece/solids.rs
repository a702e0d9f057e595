//! Solids with rounded edges and texture coordinates in metres.

use super::super::{Surface, patch, spans};
use crate::scene::Vertex;
use glam::{Vec2, Vec3};
use std::collections::HashMap;
use std::f32::consts::{PI, TAU};

/// A box with edges rounded by this radius \[m\]; longer faces have grid lines `edge` \[m\] apart.
pub(super) fn block(low: Vec3, high: Vec3, radius: f32, edge: f32) -> Surface {
    block_without(low, high, radius, edge, &[])
}

/// The same without the faces with these outward normals, for faces that are never visible.
pub(super) fn block_without(low: Vec3, high: Vec3, radius: f32, edge: f32, hidden: &[Vec3]) -> Surface {
    // Number of pieces of half a rounded edge.
    let pieces = if radius > 0.028 { 2 } else { 1 };
    let lines = |low: f32, high: f32| {
        let bend = (0..=pieces).map(|k| radius * (1.0 - (0.25 * PI * k as f32 / pieces as f32).tan()));
        let bend: Vec<f32> = bend.collect();
        let mut lines: Vec<f32> = bend.iter().rev().map(|b| low + b).collect();
        let flat = spans(&[low + radius, high - radius], edge);
        lines.extend(&flat[1..flat.len() - 1]);
        lines.extend(bend.iter().map(|b| high - b));
        lines
    };
    let all = [lines(low.x, high.x), lines(low.y, high.y), lines(low.z, high.z)];
    let (inner_low, inner_high) = (low + radius, high - radius);
    let mut whole = Surface::default();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (end, sign) in [(low, -1.0), (high, 1.0)] {
            if hidden.iter().any(|normal| normal[axis] == sign) {
                continue;
            }
            whole = whole.and(patch([all[u].len(), all[v].len()], [false; 2], |column, row| {
                let mut at = Vec3::ZERO;
                (at[axis], at[u], at[v]) = (end[axis], all[u][column], all[v][row]);
                let core = at.clamp(inner_low, inner_high);
                let normal = (at - core).normalize();
                (core + radius * normal, normal)
            }));
        }
    }
    boxed(whole)
}

/// Adds texture coordinates \[m\] by projection along the axis that each triangle faces most.
pub(super) fn boxed(surface: Surface) -> Surface {
    let mut mapped = Surface::default();
    let mut known: HashMap<(u32, usize), u32> = HashMap::new();
    for triangle in surface.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|k| surface.vertices[triangle[k] as usize].position);
        let facing = (b - a).cross(c - a).abs();
        let axis = if facing.y >= facing.x.max(facing.z) { 1 } else { if facing.x > facing.z { 0 } else { 2 } };
        for &index in triangle {
            let number = *known.entry((index, axis)).or_insert_with(|| {
                let vertex = surface.vertices[index as usize];
                let p = vertex.position;
                let uv0 = [Vec2::new(p.z, -p.y), Vec2::new(p.x, p.z), Vec2::new(p.x, -p.y)][axis];
                mapped.vertices.push(Vertex { uv0, ..vertex });
                mapped.vertices.len() as u32 - 1
            });
            mapped.indices.push(number);
        }
    }
    mapped
}

/// Adds texture coordinates \[m\] to an upright surface: around +Y, `around` per turn, and along the profile.
pub(super) fn wrapped(mut surface: Surface, around: f32) -> Surface {
    let turn = |p: Vec3| (p.z.atan2(p.x) / TAU + 0.5) * around;
    for vertex in &mut surface.vertices {
        let p = vertex.position;
        vertex.uv0 = Vec2::new(turn(p), Vec2::new(p.x, p.z).length() - p.y);
    }
    // Vertices at the seam are duplicated, since the next turn starts where one ends.
    let mut next: HashMap<u32, u32> = HashMap::new();
    for triangle in surface.indices.chunks_exact_mut(3) {
        let us = [0, 1, 2].map(|k| surface.vertices[triangle[k] as usize].uv0.x);
        let most = us.into_iter().fold(0.0, f32::max);
        for (index, u) in triangle.iter_mut().zip(us) {
            if most - u > 0.5 * around {
                *index = *next.entry(*index).or_insert_with(|| {
                    let mut vertex = surface.vertices[*index as usize];
                    vertex.uv0.x += around;
                    surface.vertices.push(vertex);
                    surface.vertices.len() as u32 - 1
                });
            }
        }
    }
    surface
}

/// Parts of a profile between its corners, with their normals to the right along the profile; bends of less than 40
/// degrees are smooth.
fn smooth_runs(profile: &[Vec2]) -> Vec<(Vec<Vec2>, Vec<Vec2>)> {
    let normals: Vec<Vec2> = profile.windows(2).map(|pair| -(pair[1] - pair[0]).perp().normalize()).collect();
    let mut runs = Vec::new();
    let mut start = 0;
    for end in 1..profile.len() {
        if end < normals.len() && normals[end - 1].dot(normals[end]) > 40_f32.to_radians().cos() {
            continue;
        }
        let normal = |k: usize| {
            let before = if k > start { normals[k - 1] } else { Vec2::ZERO };
            let after = if k < end { normals[k] } else { Vec2::ZERO };
            (before + after).normalize()
        };
        runs.push((profile[start..=end].to_vec(), (start..=end).map(normal).collect()));
        start = end;
    }
    runs
}

/// Lengths along a polyline, from its start to each point.
fn lengths(points: &[Vec2]) -> Vec<f32> {
    let mut sum = 0.0;
    let steps = points.windows(2).map(|pair| {
        sum += pair[0].distance(pair[1]);
        sum
    });
    std::iter::once(0.0).chain(steps).collect()
}

/// A moulding: a profile of (z, y) points \[m\] along x from `-half` to `half`, with the outside to the right along the
/// profile.
pub(super) fn moulding(profile: &[Vec2], half: f32, edge: f32) -> Surface {
    let along = spans(&[-half, half], edge);
    let mut whole = Surface::default();
    for (points, normals) in smooth_runs(profile) {
        let way = lengths(&points);
        let mut part = patch([along.len(), points.len()], [false; 2], |column, row| {
            (Vec3::new(along[column], points[row].y, points[row].x), Vec3::new(0.0, normals[row].y, normals[row].x))
        });
        for (index, vertex) in part.vertices.iter_mut().enumerate() {
            vertex.uv0 = Vec2::new(vertex.position.x, -way[index / along.len()] - points[0].y);
        }
        whole = whole.and(part);
    }
    whole
}

/// A profile of (radius, z) points \[m\] swept around the z axis over the upper half circle, from +X to -X, in `count`
/// pieces.
pub(super) fn half_ring(profile: &[Vec2], count: usize) -> Surface {
    let mut whole = Surface::default();
    for (points, normals) in smooth_runs(profile) {
        let way = lengths(&points);
        let radius = points[0].x;
        let mut part = patch([count + 1, points.len()], [false; 2], |column, row| {
            let (sine, cosine) = (PI * column as f32 / count as f32).sin_cos();
            let out = Vec3::new(cosine, sine, 0.0);
            (out * points[row].x + Vec3::Z * points[row].y, out * normals[row].x + Vec3::Z * normals[row].y)
        });
        for (index, vertex) in part.vertices.iter_mut().enumerate() {
            let angle = PI * (index % (count + 1)) as f32 / count as f32;
            vertex.uv0 = Vec2::new(way[index / (count + 1)], angle * radius);
        }
        whole = whole.and(part);
    }
    whole
}

/// Points on a circular arc around `middle`, from one angle \[degrees\] to the other.
pub(super) fn arc(middle: Vec2, radius: f32, from: f32, to: f32, pieces: usize) -> Vec<Vec2> {
    let angle = |k: usize| (from + (to - from) * k as f32 / pieces as f32).to_radians();
    (0..=pieces).map(|k| middle + radius * Vec2::from_angle(angle(k))).collect()
}
