//! Triangulates the zero surface of a field: surface nets (Gibson 1998), with one vertex per crossed cell.

use super::super::Surface;
use crate::scene::Vertex;
use glam::{UVec3, Vec3};
use rayon::prelude::*;

/// Side of a block in cells; a block far from the surface is skipped as a whole.
const BLOCK: u32 = 8;

/// Largest gradient of a field, relative to a distance field.
const STEEPEST: f32 = 1.5;

/// The gradient of a field at a point, by central differences over twice `step` \[m\].
fn gradient(field: &impl Fn(Vec3) -> f32, at: Vec3, step: f32) -> Vec3 {
    let along = |axis: Vec3| field(at + step * axis) - field(at - step * axis);
    Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z)) / (2.0 * step)
}

/// The closed surface of the region with negative `field` between `low` and `high` \[m\], by cells of side `cell`
/// \[m\]. The field is approximately the distance to the surface \[m\] and positive on the bounds. Normals are the
/// field's gradient.
pub(super) fn surface(field: &(impl Fn(Vec3) -> f32 + Sync), low: Vec3, high: Vec3, cell: f32) -> Surface {
    let blocks = ((high - low) / (cell * BLOCK as f32)).ceil().as_uvec3();
    let size = blocks * BLOCK;
    let place = |at: UVec3| low + cell * at.as_vec3();
    let block_index = |b: UVec3| ((b.z * blocks.y + b.y) * blocks.x + b.x) as usize;
    let reach = STEEPEST * cell * BLOCK as f32 * 0.5 * 3_f32.sqrt();
    let middles: Vec<f32> = (0..blocks.element_product())
        .into_par_iter()
        .map(|i| {
            let block = UVec3::new(i % blocks.x, i / blocks.x % blocks.y, i / blocks.x / blocks.y);
            field(place(block * BLOCK + BLOCK / 2))
        })
        .collect();
    let index = |at: UVec3| ((at.z * size.y + at.y) * size.x + at.x) as usize;
    let values: Vec<f32> = (0..size.element_product())
        .into_par_iter()
        .with_min_len(4096)
        .map(|i| {
            let at = UVec3::new(i % size.x, i / size.x % size.y, i / size.x / size.y);
            let middle = middles[block_index(at / BLOCK)];
            if middle.abs() > reach { middle } else { field(place(at)) }
        })
        .collect();

    // A vertex in each cell whose corners are on different sides: the mean of the points where the surface crosses its
    // edges.
    let corners: [UVec3; 8] = std::array::from_fn(|k| UVec3::new(k as u32 & 1, k as u32 >> 1 & 1, k as u32 >> 2));
    let cells = size - 1;
    let vertex = |at: UVec3| {
        let value: [f32; 8] = corners.map(|corner| values[index(at + corner)]);
        let inside = value.iter().filter(|value| **value < 0.0).count();
        if inside == 0 || inside == 8 {
            return None;
        }
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for a in 0..8 {
            for b in [1, 2, 4].map(|axis| a | axis).into_iter().filter(|b| *b != a) {
                if (value[a] < 0.0) != (value[b] < 0.0) {
                    let t = value[a] / (value[a] - value[b]);
                    sum += corners[a].as_vec3().lerp(corners[b].as_vec3(), t);
                    count += 1.0;
                }
            }
        }
        let start = low + cell * (at.as_vec3() + sum / count);
        Some(settled(field, start, place(at), cell))
    };
    let found: Vec<(usize, Vertex)> = (0..cells.z)
        .into_par_iter()
        .flat_map_iter(|z| {
            let layer = (0..cells.y).flat_map(move |y| (0..cells.x).map(move |x| UVec3::new(x, y, z)));
            layer.filter_map(|at| vertex(at).map(|vertex| (index(at), vertex))).collect::<Vec<_>>()
        })
        .collect();
    let mut numbers = vec![u32::MAX; values.len()];
    for (number, (cell, _)) in found.iter().enumerate() {
        numbers[*cell] = number as u32;
    }
    let mut vertices: Vec<Vertex> = found.into_iter().map(|(_, vertex)| vertex).collect();

    // Two triangles across each crossed edge, between the vertices of the four cells around it.
    let mut indices = Vec::with_capacity(12 * vertices.len());
    let axes = [UVec3::X, UVec3::Y, UVec3::Z];
    for z in 1..cells.z {
        for y in 1..cells.y {
            for x in 1..cells.x {
                let at = UVec3::new(x, y, z);
                let here = values[index(at)] < 0.0;
                for axis in 0..3 {
                    if here == (values[index(at + axes[axis])] < 0.0) {
                        continue;
                    }
                    let (u, v) = (axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
                    let mut around = [at - u - v, at - v, at, at - u].map(|cell| numbers[index(cell)]);
                    if !here {
                        around.reverse();
                    }
                    let [a, b, c, d] = around;
                    let far =
                        |a: u32, b: u32| vertices[a as usize].position.distance_squared(vertices[b as usize].position);
                    indices.extend(if far(a, c) <= far(b, d) { [a, b, c, a, c, d] } else { [a, b, d, b, c, d] });
                }
            }
        }
    }
    face_out(&mut vertices, &indices);
    Surface { vertices, indices }
}

/// Replaces normals that differ much from those of their triangles: in gaps narrower than a cell the field is
/// unreliable.
fn face_out(vertices: &mut [Vertex], indices: &[u32]) {
    let mut sums = vec![Vec3::ZERO; vertices.len()];
    for triangle in indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|k| vertices[triangle[k] as usize].position);
        triangle.iter().for_each(|index| sums[*index as usize] += (b - a).cross(c - a));
    }
    for (vertex, sum) in vertices.iter_mut().zip(sums) {
        if let Some(facing) = sum.try_normalize().filter(|facing| facing.dot(vertex.normal) < 0.5) {
            vertex.normal = facing;
        }
    }
}

/// Moves a vertex near the surface onto it, but not out of its cell, which starts at `low`.
fn settled(field: &impl Fn(Vec3) -> f32, start: Vec3, low: Vec3, cell: f32) -> Vertex {
    let mut at = start;
    for _ in 0..2 {
        let slope = gradient(field, at, 0.1 * cell);
        let step = slope * (field(at) / slope.length_squared().max(1e-6));
        at = (at - step.clamp_length_max(0.3 * cell)).clamp(low, low + cell);
    }
    let normal = gradient(field, at, 0.35 * cell).try_normalize().unwrap_or(Vec3::Y);
    Vertex { position: at, normal, color: [255; 4], ..Vertex::default() }
}
