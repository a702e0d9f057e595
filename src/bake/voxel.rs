//! Cuts triangles into pieces, each within one voxel of side `d_eps / 2`. METHOD 8, thesis 5.6.3.
//!
//! Voxels are stored sparsely, as runs of pieces sorted by Morton key. They are built once and then only traversed, so
//! an octree has no advantage, and the caches come out in a space-filling order.

use super::surface::Surface;
use crate::error::{Error, Result};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// A part of a triangle within one voxel.
pub(super) struct Piece {
    /// Morton key of the voxel.
    key: u128,
    /// Index into `Surface::triangles`.
    pub(super) triangle: u32,
    /// Index of its first corner in `Voxels::corners`.
    first: u32,
    /// Number of corners.
    count: u32,
    /// Area [m^2].
    pub(super) area: f64,
    /// Centre of mass.
    pub(super) centroid: DVec3,
    /// Largest distance \[m\] from the centroid to a corner.
    pub(super) radius: f64,
}

/// A voxel that contains surface.
pub(super) struct Cell {
    /// Its pieces.
    pub(super) pieces: Range<u32>,
    /// Centre of a bounding sphere of its pieces.
    pub(super) centre: DVec3,
    /// Radius of the sphere \[m\], at most half of a voxel's diagonal.
    pub(super) radius: f64,
}

/// A surface cut into voxels.
pub(super) struct Voxels {
    /// Pieces, grouped by voxel.
    pub(super) pieces: Vec<Piece>,
    /// Voxels that contain pieces, in Morton order.
    pub(super) cells: Vec<Cell>,
    /// Corners of all pieces.
    corners: Vec<DVec3>,
}

/// Most voxels along an axis: other code numbers cells of the same size with 32 bits.
const AXIS_LIMIT: f64 = (1 << 30) as f64;

/// Most pieces beyond two per triangle, about 3 GiB. A model with 65 534 caches has about 200 000 such voxels.
pub(super) const PIECE_LIMIT: f64 = 16e6;

/// Pieces smaller than this part of their triangle are rounding errors of a cut through a corner or an edge.
const NOTHING: f64 = 1e-14;

impl Voxels {
    /// Corners of a piece.
    pub(super) fn corners(&self, piece: &Piece) -> &[DVec3] {
        &self.corners[piece.first as usize..(piece.first + piece.count) as usize]
    }

    /// Estimated number of pieces into which voxels of the given side \[m\] cut a surface.
    pub(super) fn estimate(surface: &Surface, side: f64) -> f64 {
        surface.triangles.iter().map(|t| estimate(surface.corners(t), t.normal, t.area, side)).sum()
    }

    /// Cuts a surface into voxels of the given side \[m\].
    pub(super) fn new(surface: &Surface, side: f64, name: &str) -> Result<Self> {
        let layers = ((surface.high - surface.low) / side).max_element() + 2.0;
        if layers.is_nan() || layers >= AXIS_LIMIT {
            return Err(Error::TooLarge(format!(
                "mesh '{name}' is too large for caches {:.1e} m apart: use a larger --spacing or fewer --caches",
                2.0 * side
            )));
        }
        let pieces = Self::estimate(surface, side);
        if pieces.is_nan() || pieces >= PIECE_LIMIT + 2.0 * surface.triangles.len() as f64 {
            return Err(Error::TooLarge(format!(
                "mesh '{name}' is too large for caches {:.1e} m apart (about {pieces:.1e} pieces): use a larger --spacing or \
                 fewer --caches",
                2.0 * side
            )));
        }

        let origin = origin(surface, side);
        let chunks: Vec<(Vec<Piece>, Vec<DVec3>)> = surface
            .triangles
            .par_chunks(2048)
            .enumerate()
            .map(|(chunk, triangles)| {
                let (mut pieces, mut corners) = (Vec::with_capacity(2048), Vec::with_capacity(3 * 2048));
                for (index, triangle) in triangles.iter().enumerate() {
                    clip(surface.corners(triangle), origin, side, &mut |voxel, polygon| {
                        let (area, centroid) = area_and_centroid(polygon);
                        if area > NOTHING * triangle.area {
                            pieces.push(Piece {
                                key: morton(voxel),
                                triangle: (chunk * 2048 + index) as u32,
                                first: corners.len() as u32,
                                count: polygon.len() as u32,
                                area,
                                centroid,
                                radius: polygon.iter().map(|p| p.distance(centroid)).fold(0.0, f64::max),
                            });
                            corners.extend_from_slice(polygon);
                        }
                    });
                }
                (pieces, corners)
            })
            .collect();
        let (mut pieces, mut corners) = (Vec::new(), Vec::new());
        for (chunk_pieces, chunk_corners) in chunks {
            let first = corners.len() as u32;
            pieces.extend(chunk_pieces.into_iter().map(|p| Piece { first: first + p.first, ..p }));
            corners.extend(chunk_corners);
        }
        // A triangle has one piece per voxel, so the order is total.
        pieces.par_sort_unstable_by_key(|p| (p.key, p.triangle));
        let mut ranges: Vec<Range<u32>> = Vec::new();
        for chunk in pieces.chunk_by(|a, b| a.key == b.key) {
            let start = ranges.last().map_or(0, |c| c.end);
            ranges.push(start..start + chunk.len() as u32);
        }
        let mut voxels = Self { pieces, cells: Vec::new(), corners };
        voxels.cells = ranges.into_par_iter().map(|pieces| voxels.cell(pieces)).collect();
        Ok(voxels)
    }

    fn cell(&self, pieces: Range<u32>) -> Cell {
        let within = &self.pieces[pieces.start as usize..pieces.end as usize];
        let corners = || within.iter().flat_map(|piece| self.corners(piece));
        let low = corners().fold(DVec3::INFINITY, |low, c| low.min(*c));
        let high = corners().fold(DVec3::NEG_INFINITY, |high, c| high.max(*c));
        let centre = (low + high) * 0.5;
        Cell { pieces, centre, radius: corners().map(|c| c.distance_squared(centre)).fold(0.0, f64::max).sqrt() }
    }
}

/// Cuts a triangle into its parts in the voxels of a grid with a corner at `origin`, and passes each part to `emit`
/// with its voxel. Sutherland-Hodgman (SH74), slab by slab, so that each plane cuts once and the parts add up. Voxels
/// own their lower faces: surface in a plane of the grid belongs to one voxel, not to two.
pub fn clip(triangle: [DVec3; 3], origin: DVec3, side: f64, emit: &mut impl FnMut([i64; 3], &[DVec3])) {
    slabs(&triangle, 0, origin, side, &mut [0; 3], emit);
}

fn slabs(
    polygon: &[DVec3],
    axis: usize,
    origin: DVec3,
    side: f64,
    voxel: &mut [i64; 3],
    emit: &mut impl FnMut([i64; 3], &[DVec3]),
) {
    if axis == 3 {
        return emit(*voxel, polygon);
    }
    let layer = |x: f64| ((x - origin[axis]) / side).floor();
    let low = polygon.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
    let high = polygon.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
    let (first, last) = (layer(low) as i64, layer(high) as i64);
    if first == last {
        voxel[axis] = first;
        return slabs(polygon, axis + 1, origin, side, voxel, emit);
    }
    let mut rest = polygon.to_vec();
    for index in first..=last {
        let (mut below, mut above) = (Vec::with_capacity(rest.len() + 1), Vec::with_capacity(rest.len() + 1));
        let plane = origin[axis] + (index + 1) as f64 * side;
        if index == last {
            below = rest;
            rest = Vec::new();
        } else {
            split(&rest, |p| p[axis] - plane, &mut below, &mut above);
            rest = above;
        }
        if below.len() > 2 {
            voxel[axis] = index;
            slabs(&below, axis + 1, origin, side, voxel, emit);
        }
    }
}

/// Appends the part of a convex polygon with negative `distance` to `below` and the other part to `above`.
pub(super) fn split(
    polygon: &[DVec3],
    distance: impl Fn(DVec3) -> f64,
    below: &mut Vec<DVec3>,
    above: &mut Vec<DVec3>,
) {
    let Some(&(mut from)) = polygon.last() else { return };
    let mut from_distance = distance(from);
    for &to in polygon {
        let to_distance = distance(to);
        if from_distance * to_distance < 0.0 {
            let cut = from + (to - from) * (from_distance / (from_distance - to_distance));
            below.push(cut);
            above.push(cut);
        }
        if to_distance <= 0.0 {
            below.push(to);
        }
        if to_distance >= 0.0 {
            above.push(to);
        }
        (from, from_distance) = (to, to_distance);
    }
}

/// Area and centre of mass of a flat convex polygon.
pub(super) fn area_and_centroid(polygon: &[DVec3]) -> (f64, DVec3) {
    let (mut area, mut moment) = (0.0, DVec3::ZERO);
    for pair in polygon[1..].windows(2) {
        let (b, c) = (pair[0] - polygon[0], pair[1] - polygon[0]);
        let part = 0.5 * b.cross(c).length();
        area += part;
        moment += (b + c) * (part / 3.0);
    }
    (area, if area > 0.0 { polygon[0] + moment / area } else { polygon[0] })
}

/// Estimated number of voxels that a triangle touches: those crossed by its interior, those crossed by its outline, and
/// one.
fn estimate([a, b, c]: [DVec3; 3], normal: DVec3, area: f64, side: f64) -> f64 {
    let extent = a.max(b).max(c) - a.min(b).min(c);
    area * normal.abs().element_sum() / (side * side) + extent.element_sum() / side + 1.0
}

/// Origin of the grid. A wall or floor in a plane between two layers of voxels would be split between both by rounding
/// or by a minimal slope, and so would a model that fits into one voxel. Of several phases per axis, the one with the
/// least area near such planes is chosen; an additional layer costs the share that it adds.
fn origin(surface: &Surface, side: f64) -> DVec3 {
    const PHASES: usize = 32;
    const NEAR: f64 = 0.1; // of a side
    const FLAT: f64 = 0.985; // cosine of 10 degrees: such a surface leaves the near zone only after a voxel's side
    let mut areas = [[0.0; 4 * PHASES]; 3];
    for triangle in &surface.triangles {
        if let Some(axis) = (0..3).find(|&axis| triangle.normal[axis].abs() > FLAT) {
            let height = (surface.positions[triangle.vertices[0] as usize][axis] - surface.low[axis]) / side;
            areas[axis][(height.fract() * (4 * PHASES) as f64) as usize % (4 * PHASES)] += triangle.area;
        }
    }
    let shift = |axis: usize| {
        let extent = (surface.high[axis] - surface.low[axis]) / side;
        let fewest = extent.floor() + 1.0;
        let cost = |phase: f64| {
            let more = (extent + phase).floor() + 1.0 - fewest;
            let near: f64 = (areas[axis].iter().enumerate())
                .map(|(bin, area)| {
                    let height = ((bin as f64 + 0.5) / (4 * PHASES) as f64 + phase).fract();
                    area * (1.0 - height.min(1.0 - height) / NEAR).max(0.0)
                })
                .sum();
            near + surface.area * more / fewest
        };
        // The first phase is the middle of the range with the fewest layers.
        let phases = (0..=PHASES).map(|i| if i == 0 { (fewest - extent) / 2.0 } else { i as f64 / PHASES as f64 });
        phases.map(|phase| (cost(phase), phase)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |best| best.1)
    };
    surface.low - DVec3::new(shift(0), shift(1), shift(2)) * side
}

/// Interleaves the low 32 bits of the coordinates: neighbours in space are mostly neighbours in the order.
fn morton(voxel: [i64; 3]) -> u128 {
    let spread = |x: i64| {
        let mut x = u128::from(x as u32);
        for (shift, mask) in [
            (32, 0x0000_0000_0000_0000_ffff_0000_0000_ffff),
            (16, 0x0000_0000_0000_ff00_00ff_0000_ff00_00ff),
            (8, 0x0000_0000_00f0_0f00_f00f_00f0_0f00_f00f),
            (4, 0x0000_0000_0c30_c30c_30c3_0c30_c30c_30c3),
            (2, 0x0000_0000_2492_4924_9249_2492_4924_9249),
        ] {
            x = (x | x << shift) & mask;
        }
        x
    };
    spread(voxel[0]) | spread(voxel[1]) << 1 | spread(voxel[2]) << 2
}
