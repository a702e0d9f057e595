//! Removes superfluous caches as long as the guarantee holds, and measures the guarantee. METHOD 8, thesis 5.6.3.

use super::Coverage;
use super::grid::Grid;
use super::seeds::{Bounds, Seed};
use super::surface::Surface;
use super::voxel::{Piece, Voxels};
use glam::DVec3;
use rayon::prelude::*;

/// Caches closer than this part of both bounds are duplicates (line 2326).
const ALIKE: f64 = 0.15;

/// A cache whose area is less than this part of the area of each cache that can replace it is a splinter: a voxel cut a
/// corner off the surface and formed a cache next to its neighbour's. Measured for 400 caches on a slanted plane, a
/// sphere and a torus, and for 3000 in Sponza: with 0.25, 0.5 and 1 the areas' standard deviation is 0.18, 0.13, 0.22
/// of the mean; 0.14, 0.15, 0.21; 0.13, 0.12, 0.28; 0.74, 0.65, 0.94. With 1 caches are twice as far apart for the same
/// bound, but no longer evenly spread.
const SPLINTER: f64 = 0.5;

/// Removes the smaller of duplicate caches, and splinters, smallest area first, if every piece they cover lies within
/// both bounds of a remaining cache.
pub(super) fn prune(surface: &Surface, voxels: &Voxels, mut seeds: Vec<Seed>, bounds: Bounds) -> Vec<Seed> {
    let positions: Vec<DVec3> = seeds.iter().map(|s| s.position).collect();
    let grid = Grid::new(&positions, bounds.distance);
    let alike_cos = (ALIKE * bounds.angle).min(std::f64::consts::PI).cos().min(1.0 - 1e-12);
    let mut order: Vec<usize> = (0..seeds.len()).collect();
    order.sort_by(|&a, &b| seeds[a].area.total_cmp(&seeds[b].area));
    let mut dropped = vec![false; seeds.len()];
    let mut others = Vec::new();

    for index in order {
        let seed = &seeds[index];
        // A seed that covers one of this seed's pieces is within d_eps of a point that is within d_eps of this seed.
        others.clear();
        let mut alike = false;
        grid.near(seed.position, 2.0 * bounds.distance, |other| {
            let distance = positions[other].distance(seed.position);
            if other != index && !dropped[other] && distance <= 2.0 * bounds.distance {
                let cos = seeds[other].normal.dot(seed.normal);
                alike |= distance < ALIKE * bounds.distance && cos > alike_cos && seeds[other].area >= seed.area;
                others.push((distance, other));
            }
        });
        if !alike {
            others.retain(|&(_, other)| seed.area < SPLINTER * seeds[other].area);
        }
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));

        let stand_in = |&piece: &u32| {
            let covers = |&(_, other): &(f64, usize)| {
                covering_distance(surface, voxels, &voxels.pieces[piece as usize], &seeds[other], bounds).is_some()
            };
            others.iter().find(|other| covers(other)).map(|&(_, other)| other)
        };
        if let Some(stand_ins) = seed.pieces.iter().map(stand_in).collect::<Option<Vec<usize>>>() {
            dropped[index] = true;
            let pieces = std::mem::take(&mut seeds[index].pieces);
            for (piece, other) in pieces.into_iter().zip(stand_ins) {
                seeds[other].pieces.push(piece);
            }
        }
    }
    let mut dropped = dropped.into_iter();
    seeds.retain(|_| dropped.next() == Some(false));
    seeds
}

/// Largest distance \[m\] from a cache to a piece, if the whole piece lies within both bounds of the cache. A piece is
/// convex, so its corners decide.
fn covering_distance(surface: &Surface, voxels: &Voxels, piece: &Piece, seed: &Seed, bounds: Bounds) -> Option<f64> {
    let normal = surface.triangles[piece.triangle as usize].normal;
    if normal.dot(seed.normal) < bounds.cos {
        return None;
    }
    let distance = farthest(voxels.corners(piece), seed.position);
    (distance <= bounds.distance).then_some(distance)
}

fn farthest(corners: &[DVec3], point: DVec3) -> f64 {
    corners.iter().map(|c| c.distance_squared(point)).fold(0.0, f64::max).sqrt()
}

fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b)) // exact for small angles, where acos is not
}

/// Finds for every piece of surface the nearest cache that covers it; returns the worst values. Independent of how the
/// caches were made: an uncovered piece, which would be a bug, shows as a value out of bounds.
pub(super) fn measure(surface: &Surface, voxels: &Voxels, seeds: &[Seed], bounds: Bounds) -> Coverage {
    let positions: Vec<DVec3> = seeds.iter().map(|s| s.position).collect();
    let grid = Grid::new(&positions, bounds.distance);
    let worst =
        |a: Coverage, b: Coverage| Coverage { distance: a.distance.max(b.distance), angle: a.angle.max(b.angle) };
    (voxels.cells.par_iter().with_min_len(8))
        .map_init(Vec::new, |near, cell| {
            let pieces = &voxels.pieces[cell.pieces.start as usize..cell.pieces.end as usize];
            near.clear();
            let reach = bounds.distance * (1.0 + 1e-9) + cell.radius;
            grid.near(cell.centre, reach, |index| {
                if positions[index].distance(cell.centre) <= reach {
                    near.push(index);
                }
            });
            let cover = |piece: &Piece| {
                let normal = surface.triangles[piece.triangle as usize].normal;
                let mut covering: Option<(f64, &Seed)> = None;
                for seed in near.iter().map(|&index| &seeds[index]) {
                    // A piece's farthest corner is never nearer than its centroid.
                    let least = seed.position.distance_squared(piece.centroid);
                    if covering.is_none_or(|(distance, _)| least < distance * distance)
                        && let Some(distance) = covering_distance(surface, voxels, piece, seed, bounds)
                        && covering.is_none_or(|best| distance < best.0)
                    {
                        covering = Some((distance, seed));
                    }
                }
                let (distance, seed) = covering.unwrap_or_else(|| {
                    let candidates = seeds.iter().map(|seed| (farthest(voxels.corners(piece), seed.position), seed));
                    let excess = |c: &(f64, &Seed)| {
                        (c.0 / bounds.distance).max(angle(normal, c.1.normal) / bounds.angle.max(f64::MIN_POSITIVE))
                    };
                    candidates.min_by(|a, b| excess(a).total_cmp(&excess(b))).expect("a voxel has a cache")
                });
                Coverage { distance, angle: angle(normal, seed.normal) }
            };
            pieces.iter().map(cover).fold(Coverage::default(), worst)
        })
        .reduce(Coverage::default, worst)
}
