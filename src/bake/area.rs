//! Computes the share of the surface that each cache represents: its area (METHOD 6, thesis 5.4.2, eq. 5.58) and an
//! equivalent rectangle.
//!
//! A cache's tangent plane within its Voronoi region is a convex polygon. The cache's area is the part of the polygon
//! that the surface inside the region covers when projected onto the plane. This union of projections is approximated
//! by their sum, capped by the polygon's area: stacked layers within one region (a sheet close to a wall, a model with
//! inner faces) together count up to the whole polygon, whereas the union would count the area they cover once.
//!
//! The rectangle lies in a plane perpendicular to the cache's normal. It has the mean, principal axes and variances of
//! the connected part of the share around the cache's triangle. Walls of rectangles therefore have almost no holes,
//! narrow parts have little overhang, and no rectangle spans the gap between two mouldings. For the rectangle, unlike
//! for the area, surface that faces another cache better belongs to that cache beyond the bisector, whichever way the
//! two caches face. Otherwise the shares on a thin rod, whose caches face all ways, would be as wide as the rod, where
//! the area has its cap. If a corner lies in the middle of another triangle's edge, the two triangles are not
//! connected, and a rectangle is smaller than it could be.

use super::grid::Grid;
use super::seeds::Seed;
use super::surface::Surface;
use super::voxel::{Piece, Voxels, area_and_centroid, split};
use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;
use std::collections::HashSet;

/// Cosine of 84 degrees. Two caches divide a plane between them only if their directions differ by less than that, and
/// surface is projected onto a cache's plane under the same condition. Without the bound, the two sides of a sheet
/// would share their area. At right angles, at the edges of a box, the bisector of a pair would take area from one side
/// that does not project onto the other.
const SAME_WAY: f64 = 0.1;

/// Distance of a rectangle behind its cache's plane, in mean depths of the share. On a cylinder of radius R divided
/// into shares of half angle a, rectangles as wide as the arcs meet at their edges and have the cylinder's mean
/// silhouette at depth `R (1 - a cot a)`: 2 mean depths for narrow shares, 2.4 at 45 degrees, 2.7 at 60.
const SUNK: f64 = 2.5;

/// A cache's share of the surface.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Share {
    /// Area [m^2].
    pub(super) area: f64,
    /// From the cache to the centre of the rectangle \[m\].
    pub(super) middle: DVec3,
    /// From the centre to the middle of an edge \[m\], perpendicular to the cache's normal.
    pub(super) axis: DVec3,
    /// From the centre to the adjacent edge \[m\], perpendicular to both.
    pub(super) breadth: f64,
}

/// The bisecting plane between a cache and a neighbour.
struct Bisector {
    /// Unit direction to the neighbour.
    direction: DVec3,
    /// Half of the distance to the neighbour.
    half: f64,
    /// Normal of the neighbour.
    normal: DVec3,
}

/// The share of each cache. `normals` are the caches' final unit normals.
pub(super) fn shares(
    surface: &Surface,
    voxels: &Voxels,
    seeds: &[Seed],
    normals: &[DVec3],
    spacing: f64,
) -> Vec<Share> {
    let positions: Vec<DVec3> = seeds.iter().map(|s| s.position).collect();
    let grid = Grid::new(&positions, spacing);
    let centres: Vec<DVec3> = voxels.cells.iter().map(|cell| cell.centre).collect();
    let cells = Grid::new(&centres, spacing);
    let share = |index: usize| {
        let seed = &seeds[index];
        let (bisectors, others) = bisectors(seeds, index, &grid, spacing);
        let cap = area_and_centroid(&plane_polygon(seed, &bisectors, spacing)).0;
        let mut sum = 0.0;
        let mut parts = Vec::new();
        let mut add = |piece: &Piece| {
            let facing = surface.triangles[piece.triangle as usize].normal;
            let cos = facing.dot(seed.normal);
            if cos > SAME_WAY {
                let corners = voxels.corners(piece).iter().map(|c| *c - seed.position).collect();
                let own = within(corners, piece, seed, bisectors.iter());
                sum += cos * area(&own);
                let better = others.iter().filter(|other| facing.dot(other.normal) > cos);
                parts.push((piece.triangle, within(own, piece, seed, better)));
            }
        };
        // Surface that faces the same way and is farther than d_eps from this cache has a nearer one. Half of a voxel's
        // diagonal is less than half of d_eps.
        cells.near(seed.position, 1.5 * spacing, |index| {
            let cell = &voxels.cells[index];
            if meets(&bisectors, cell.centre - seed.position, cell.radius, spacing) {
                for piece in &voxels.pieces[cell.pieces.start as usize..cell.pieces.end as usize] {
                    if meets(&bisectors, piece.centroid - seed.position, piece.radius, spacing) {
                        add(piece);
                    }
                }
            }
        });
        parts.retain(|(_, polygon)| !polygon.is_empty());
        let mut moments = Moments::new(normals[index]);
        connected(surface, seed.triangle, &parts).for_each(|polygon| moments.add(polygon));
        Share { area: sum.min(cap), ..moments.rectangle() }
    };
    (0..seeds.len()).into_par_iter().with_min_len(4).map(share).collect()
}

/// The polygons of those parts whose triangles are connected to the given triangle by shared vertices.
fn connected<'a>(
    surface: &Surface,
    triangle: u32,
    parts: &'a [(u32, Vec<DVec3>)],
) -> impl Iterator<Item = &'a Vec<DVec3>> {
    let vertices = |triangle: u32| {
        let of_triangle = surface.triangles[triangle as usize].vertices;
        of_triangle.map(|v| surface.welded[v as usize])
    };
    // The parts at each vertex.
    let corners = |(part, (triangle, _)): (usize, &(u32, Vec<DVec3>))| vertices(*triangle).map(|vertex| (vertex, part));
    let mut at: Vec<(u32, usize)> = parts.iter().enumerate().flat_map(corners).collect();
    at.sort_unstable();
    let mut reached = HashSet::from(vertices(triangle));
    let mut open: Vec<u32> = reached.iter().copied().collect();
    let mut is_in = vec![false; parts.len()];
    while let Some(vertex) = open.pop() {
        let first = at.partition_point(|(v, _)| *v < vertex);
        for &(_, part) in at[first..].iter().take_while(|(v, _)| *v == vertex) {
            if !std::mem::replace(&mut is_in[part], true) {
                open.extend(vertices(parts[part].0).into_iter().filter(|v| reached.insert(*v)));
            }
        }
    }
    parts.iter().zip(is_in).filter(|(_, is_in)| *is_in).map(|((_, polygon), _)| polygon)
}

/// The planes that bound a cache's Voronoi region, nearest first, and the planes towards caches that face another way.
fn bisectors(seeds: &[Seed], index: usize, grid: &Grid, spacing: f64) -> (Vec<Bisector>, Vec<Bisector>) {
    let seed = &seeds[index];
    let (mut bisectors, mut others) = (Vec::new(), Vec::new());
    grid.near(seed.position, 4.0 * spacing, |other| {
        let to = seeds[other].position - seed.position;
        let distance = to.length();
        // Position cannot separate caches at one place with different normals.
        if other != index && distance > 1e-9 * spacing && distance <= 4.0 * spacing {
            let normal = seeds[other].normal;
            let side = if normal.dot(seed.normal) > SAME_WAY { &mut bisectors } else { &mut others };
            side.push(Bisector { direction: to / distance, half: distance / 2.0, normal });
        }
    });
    for side in [&mut bisectors, &mut others] {
        side.sort_by(|a, b| a.half.total_cmp(&b.half));
    }
    (bisectors, others)
}

/// The cache's tangent plane within its Voronoi region, with the cache as origin.
fn plane_polygon(seed: &Seed, bisectors: &[Bisector], spacing: f64) -> Vec<DVec3> {
    let (x, y) = seed.normal.any_orthonormal_pair();
    let side = 2.0 * spacing;
    let mut polygon = vec![(x + y) * side, (y - x) * side, (-x - y) * side, (x - y) * side];
    let (mut below, mut above) = (Vec::new(), Vec::new());
    for bisector in bisectors {
        // The remaining planes are too far away to reach a corner.
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

/// Whether a sphere around `centre`, relative to the cache, may reach into the Voronoi region within `d_eps`.
fn meets(bisectors: &[Bisector], centre: DVec3, radius: f64, spacing: f64) -> bool {
    let distance = centre.length();
    distance - radius < spacing
        && (bisectors.iter().take_while(|b| b.half < distance + radius))
            .all(|b| centre.dot(b.direction) - b.half < radius)
}

/// The part of a piece's polygon on the cache's side of the bisectors, which come nearest first; empty if there is
/// none.
fn within<'a>(
    mut polygon: Vec<DVec3>,
    piece: &Piece,
    seed: &Seed,
    bisectors: impl Iterator<Item = &'a Bisector>,
) -> Vec<DVec3> {
    let centre = piece.centroid - seed.position;
    for bisector in bisectors.take_while(|b| b.half < centre.length() + piece.radius) {
        if centre.dot(bisector.direction) - bisector.half > -piece.radius {
            let mut kept = Vec::with_capacity(polygon.len() + 1);
            split(&polygon, |p| p.dot(bisector.direction) - bisector.half, &mut kept, &mut Vec::new());
            polygon = kept;
            if polygon.len() < 3 {
                return Vec::new();
            }
        }
    }
    polygon
}

fn area(polygon: &[DVec3]) -> f64 {
    if polygon.is_empty() { 0.0 } else { area_and_centroid(polygon).0 }
}

/// Integrals over the projections of polygons onto the plane perpendicular to a normal.
struct Moments {
    normal: DVec3,
    axes: [DVec3; 2],
    area: f64,
    position: DVec2,
    squares: DMat2,
    depth: f64,
}

impl Moments {
    fn new(normal: DVec3) -> Self {
        let (x, y) = normal.any_orthonormal_pair();
        Self { normal, axes: [x, y], area: 0.0, position: DVec2::ZERO, squares: DMat2::ZERO, depth: 0.0 }
    }

    fn add(&mut self, polygon: &[DVec3]) {
        let flat = |p: DVec3| DVec2::from(self.axes.map(|axis| p.dot(axis)));
        for i in 2..polygon.len() {
            let corners = [polygon[0], polygon[i - 1], polygon[i]];
            let [a, b, c] = corners.map(flat);
            let area = 0.5 * (b - a).perp_dot(c - a).abs();
            let sum = a + b + c;
            self.area += area;
            self.position += area / 3.0 * sum;
            self.squares += (square(a) + square(b) + square(c) + square(sum)) * (area / 12.0);
            self.depth += area / 3.0 * corners.iter().sum::<DVec3>().dot(self.normal);
        }
    }

    /// The rectangle of equal mean and variances; a point for a share without area.
    fn rectangle(&self) -> Share {
        if self.area <= 0.0 {
            return Share::default();
        }
        let mean = self.position / self.area;
        let variance = self.squares * (1.0 / self.area) - square(mean);
        let skew = 2.0 * variance.x_axis.y;
        let main = DVec2::from_angle(0.5 * skew.atan2(variance.x_axis.x - variance.y_axis.y));
        // The variance along an edge is a third of the square of half its length.
        let half = |along: DVec2| (3.0 * along.dot(variance * along).max(0.0)).sqrt();
        let lift = |p: DVec2| self.axes[0] * p.x + self.axes[1] * p.y;
        Share {
            area: 0.0,
            middle: lift(mean) + self.normal * (SUNK * self.depth / self.area),
            axis: lift(main) * half(main),
            breadth: half(main.perp()),
        }
    }
}

fn square(p: DVec2) -> DMat2 {
    DMat2::from_cols(p * p.x, p * p.y)
}
