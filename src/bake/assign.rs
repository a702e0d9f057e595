//! Assigns each vertex its references: the caches of least error. METHOD 8, thesis 5.6.2.

use super::grid::{self, Grid};
use super::seeds::error;
use super::surface::Surface;
use super::{Cache, NO_CACHE};
use glam::DVec3;
use rayon::prelude::*;

/// The `count` caches of least error (5.95, corrected) for each vertex of the mesh, best first, ties ordered by index;
/// exact. `positions` are the caches' positions in bake space. For deforming meshes the error is the distance alone,
/// plus one spacing for caches on the other side of the surface.
pub(super) fn assign(surface: &Surface, caches: &[Cache], positions: &[DVec3], count: usize, spacing: f64) -> Vec<u16> {
    let normal = |cache: &Cache| (surface.normal_matrix * cache.normal.as_dvec3()).normalize_or_zero();
    let points: Vec<(DVec3, DVec3)> = positions.iter().copied().zip(caches.iter().map(normal)).collect();
    // Cells have a voxel's side: where many normals meet, a cell holds many caches.
    let grid = Grid::new(positions, 0.5 * spacing);
    let mut references = vec![NO_CACHE; surface.positions.len() * count];
    references.par_chunks_mut(count).enumerate().with_min_len(256).for_each_init(
        || Vec::<(f64, u32)>::with_capacity(count + 1),
        |best, (vertex, references)| {
            let (position, normal) = (surface.positions[vertex], surface.normals[vertex]);
            let mut offer = |index: u32| {
                let (cache_position, cache_normal) = points[index as usize];
                let worst = best.get(count - 1).map_or(f64::INFINITY, |worst| worst.0);
                let distance_squared = position.distance_squared(cache_position);
                if distance_squared > (worst * spacing).powi(2) * (1.0 + 1e-12) {
                    return worst;
                }
                // A vertex with NaN coordinates, which no triangle with an area has, gets the first caches.
                let distance = if distance_squared.is_nan() { f64::INFINITY } else { distance_squared.sqrt() };
                let cos = normal.dot(cache_normal);
                let cos = if surface.bends && cos > 0.0 { 1.0 } else { cos };
                let entry = (error(distance, cos, spacing), index);
                let place = best.partition_point(|&other: &(f64, u32)| other < entry);
                if place < count {
                    best.truncate(count - 1);
                    best.insert(place, entry);
                }
                best.get(count - 1).map_or(f64::INFINITY, |worst| worst.0)
            };
            search(&grid, position, spacing, &mut offer);
            references.iter_mut().zip(best.drain(..)).for_each(|(reference, (_, index))| *reference = index as u16);
        },
    );
    references
}

/// Offers points ring by ring around a position, until no point outside can have an error as small as the worst that
/// `offer` returns; the error is at least the distance in spacings. Offers all points at once if rings would take
/// longer.
fn search(grid: &Grid, place: DVec3, spacing: f64, offer: &mut impl FnMut(u32) -> f64) {
    let home = grid::cell(place, grid.side);
    let (low, high) = grid.bounds;
    // All points are offered if the position is far away, where rings would start empty, or if cell numbers saturate.
    let saturate = |cell: i32| cell.unsigned_abs() >= 1 << 30;
    let inside = (0..3).all(|axis| {
        !saturate(low[axis]) && !saturate(high[axis]) && (low[axis] - 2..=high[axis] + 2).contains(&home[axis])
    });
    let margin = (0..3)
        .map(|axis| {
            let within = place[axis] - f64::from(home[axis]) * grid.side;
            within.min(grid.side - within)
        })
        .fold(f64::INFINITY, f64::min);
    let mut worst = f64::INFINITY;
    let mut volume = 1;
    for ring in 0.. {
        if !inside || volume > 4 * grid.cell_count() {
            // Points in earlier rings must not be offered twice.
            let before = |i: i32, axis: usize| (i - home[axis]).abs() < ring;
            for &index in grid.all() {
                let cell = grid.cell_of(index);
                if !(inside && (0..3).all(|axis| before(cell[axis], axis))) {
                    offer(index);
                }
            }
            return;
        }
        for x in -ring..=ring {
            for y in -ring..=ring {
                let step = if x.abs() == ring || y.abs() == ring { 1 } else { 2 * ring.max(1) };
                for z in (-ring..=ring).step_by(step as usize) {
                    let cell = [home[0] + x, home[1] + y, home[2] + z];
                    if grid.distance(cell, place) <= worst * spacing * (1.0 + 1e-12) {
                        for &index in grid.at(cell) {
                            worst = offer(index);
                        }
                    }
                }
            }
        }
        if worst < (margin + f64::from(ring) * grid.side) / spacing * (1.0 - 1e-12) {
            return;
        }
        volume = (2 * ring as usize + 3).pow(3);
    }
}
