//! Caches -> the share of the surface each stands for. METHOD 6, thesis 5.4.2 (eq. 5.58).
//!
//! A cache's plane cut with its Voronoi region is a convex polygon; the area of what the surface within the region
//! covers of it, projected on the plane, is the cache's. That union of projections is taken as the sum of them,
//! capped by the polygon: layers that lie above each other within one region (a sheet close to a wall, a model with
//! faces inside) count together up to the whole polygon, where the union would count what they cover once.

use super::cluster::Seed;
use super::grid::Grid;
use super::surface::Surface;
use super::voxel::{Piece, Voxels, area_and_centroid, split};
use glam::DVec3;
use rayon::prelude::*;

/// Cosine of 84 degrees. Only caches that face the same way within that divide a plane between them, and only
/// surface that does is projected on it. Without the bound the two sides of a sheet would share; at right angles, at
/// the edges of a box, the bisector of a pair would take from the one side what is nothing projected on the other.
const SAME_WAY: f64 = 0.1;

/// Half way between a cache and a neighbour.
struct Bisector {
    /// Unit direction to the neighbour.
    direction: DVec3,
    /// Half of its distance.
    half: f64,
}

/// Area [m^2] of each cache.
pub(super) fn areas(surface: &Surface, voxels: &Voxels, seeds: &[Seed], spacing: f64) -> Vec<f64> {
    let positions: Vec<DVec3> = seeds.iter().map(|s| s.position).collect();
    let grid = Grid::new(&positions, spacing);
    let centres: Vec<DVec3> = voxels.cells.iter().map(|cell| cell.centre).collect();
    let cells = Grid::new(&centres, spacing);
    let area = |index: usize| {
        let seed = &seeds[index];
        let bisectors = bisectors(seeds, index, &grid, spacing);
        let cap = area_and_centroid(&plane_polygon(seed, &bisectors, spacing)).0;
        let mut sum = 0.0;
        // What faces the same way and is farther than d_eps from this cache has a nearer one. A voxel's half diagonal
        // is less than half of d_eps.
        cells.near(seed.position, 1.5 * spacing, |index| {
            let cell = &voxels.cells[index];
            if meets(&bisectors, cell.centre - seed.position, cell.radius, spacing) {
                for piece in &voxels.pieces[cell.pieces.start as usize..cell.pieces.end as usize] {
                    if meets(&bisectors, piece.centroid - seed.position, piece.radius, spacing) {
                        sum += projected(surface, voxels, piece, seed, &bisectors);
                    }
                }
            }
        });
        sum.min(cap)
    };
    (0..seeds.len()).into_par_iter().with_min_len(4).map(area).collect()
}

/// The planes that bound a cache's Voronoi region, nearest first.
fn bisectors(seeds: &[Seed], index: usize, grid: &Grid, spacing: f64) -> Vec<Bisector> {
    let seed = &seeds[index];
    let mut bisectors = Vec::new();
    grid.near(seed.position, 4.0 * spacing, |other| {
        let to = seeds[other].position - seed.position;
        let distance = to.length();
        // Caches in one place but with other normals cannot be parted by position.
        let apart = other != index && distance > 1e-9 * spacing && distance <= 4.0 * spacing;
        if apart && seeds[other].normal.dot(seed.normal) > SAME_WAY {
            bisectors.push(Bisector { direction: to / distance, half: distance / 2.0 });
        }
    });
    bisectors.sort_by(|a, b| a.half.total_cmp(&b.half));
    bisectors
}

/// The cache's plane within its Voronoi region, around the cache as origin.
fn plane_polygon(seed: &Seed, bisectors: &[Bisector], spacing: f64) -> Vec<DVec3> {
    let (x, y) = seed.normal.any_orthonormal_pair();
    let side = 2.0 * spacing;
    let mut polygon = vec![(x + y) * side, (y - x) * side, (-x - y) * side, (x - y) * side];
    let (mut below, mut above) = (Vec::new(), Vec::new());
    for bisector in bisectors {
        // The rest is too far away to reach any corner.
        if polygon.iter().all(|p| p.length() < bisector.half) {
            break;
        }
        below.clear();
        above.clear();
        split(&polygon, |p| p.dot(bisector.direction) - bisector.half, &mut below, &mut above);
        std::mem::swap(&mut polygon, &mut below);
    }
    polygon
}

/// Whether a ball around `centre`, as seen from the cache, may reach into the Voronoi region, within `d_eps`.
fn meets(bisectors: &[Bisector], centre: DVec3, radius: f64, spacing: f64) -> bool {
    let distance = centre.length();
    distance - radius < spacing
        && (bisectors.iter().take_while(|b| b.half < distance + radius))
            .all(|b| centre.dot(b.direction) - b.half < radius)
}

/// Area of the part of a piece within the cache's Voronoi region, projected on its plane.
fn projected(surface: &Surface, voxels: &Voxels, piece: &Piece, seed: &Seed, bisectors: &[Bisector]) -> f64 {
    let cos = surface.triangles[piece.triangle as usize].normal.dot(seed.normal);
    if cos <= SAME_WAY {
        return 0.0;
    }
    let centre = piece.centroid - seed.position;
    let cuts = |b: &&Bisector| centre.dot(b.direction) - b.half > -piece.radius;
    let mut polygon: Option<Vec<DVec3>> = None;
    for bisector in bisectors.iter().take_while(|b| b.half < centre.length() + piece.radius).filter(cuts) {
        let whole = polygon.unwrap_or_else(|| voxels.corners(piece).iter().map(|c| *c - seed.position).collect());
        let mut kept = Vec::with_capacity(whole.len() + 1);
        split(&whole, |p| p.dot(bisector.direction) - bisector.half, &mut kept, &mut Vec::new());
        if kept.len() < 3 {
            return 0.0;
        }
        polygon = Some(kept);
    }
    cos * polygon.map_or(piece.area, |polygon| area_and_centroid(&polygon).0)
}
