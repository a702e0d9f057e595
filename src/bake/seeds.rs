//! Forms caches from the pieces of each voxel: bins normals, averages a group, snaps it onto a triangle. METHOD 8,
//! thesis 5.6.3.

use super::closed::OPEN;
use super::surface::Surface;
use super::voxel::{Piece, Voxels};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Bins along u and along theta; each of the 18 x 18 bins covers about 20 degrees (line 2308).
pub const BINS: usize = 18;

/// Bin of a unit normal. Bins have equal areas: they divide `u = n_z` in [-1, 1] and theta in [0, 2 pi) evenly (eq.
/// 5.96; the printed range of u, [0, 1], covers only the upper hemisphere).
pub fn normal_bin(normal: DVec3) -> usize {
    let u = (normal.z + 1.0) * 0.5;
    let theta = normal.y.atan2(normal.x).rem_euclid(TAU) / TAU;
    let [row, column] = [u, theta].map(|x| ((x * BINS as f64) as usize).min(BINS - 1));
    row * BINS + column
}

/// Unit normal in the middle of a bin.
pub fn bin_normal(bin: usize) -> DVec3 {
    let u = ((bin / BINS) as f64 + 0.5) / BINS as f64 * 2.0 - 1.0;
    let theta = ((bin % BINS) as f64 + 0.5) / BINS as f64 * TAU;
    let radius = (1.0 - u * u).sqrt();
    DVec3::new(radius * theta.cos(), radius * theta.sin(), u)
}

/// Limits on the distance and angle between a cache and the surface it represents.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    /// `d_eps` \[m\].
    pub(super) distance: f64,
    /// `theta_eps` \[rad\].
    pub(super) angle: f64,
    /// Cosine of `angle`, slightly below 1 at most, so that rounding cannot put a normal outside of its own bound.
    pub(super) cos: f64,
}

impl Bounds {
    pub(super) fn new(distance: f64, angle: f64) -> Self {
        Self { distance, angle, cos: angle.min(std::f64::consts::PI).cos().min(1.0 - 1e-12) }
    }
}

/// A surface point: index into `Surface::triangles`, and weights of the triangle's second and third corners.
pub(super) type Place = (u32, [f32; 2]);

/// Most pieces of a group that are tried, from outermost to innermost, if the group's best place is closed in.
const TRIED: usize = 16;

/// A cache under construction.
#[derive(Clone)]
pub(super) struct Seed {
    /// Index into `Surface::triangles`.
    pub(super) triangle: u32,
    /// Weights of the triangle's second and third corners.
    pub(super) weights: [f32; 2],
    /// Position in bake space.
    pub(super) position: DVec3,
    /// The triangle's geometric normal.
    pub(super) normal: DVec3,
    /// Area [m^2] of the pieces it was formed from.
    pub(super) area: f64,
    /// Pieces it covers, each within both bounds.
    pub(super) pieces: Vec<u32>,
    /// Whether it is in the open, so that light can reach it.
    pub(super) open: bool,
}

/// Error of a cache (5.95): `|x - c| / d_eps + sqrt(1 - (N(x) . N(c))+)`. The printed product would be smallest for
/// perpendicular normals.
pub(crate) fn error(distance: f64, cos: f64, spacing: f64) -> f64 {
    distance / spacing + (1.0 - cos.clamp(0.0, 1.0)).sqrt()
}

/// Forms the caches of every voxel, preferring open places. Voxels are independent, so the order of work does not
/// matter.
pub(super) fn form(
    surface: &Surface,
    voxels: &Voxels,
    bounds: Bounds,
    openness: &(dyn Fn(Place) -> u32 + Sync),
) -> Vec<Seed> {
    let per_voxel: Vec<Vec<Seed>> = voxels
        .cells
        .par_iter()
        .with_min_len(8)
        .map_init(
            || vec![0.0; BINS * BINS],
            |bins, cell| form_in((surface, voxels), cell.pieces.clone(), bounds, openness, bins),
        )
        .collect();
    per_voxel.into_iter().flatten().collect()
}

fn form_in(
    (surface, voxels): (&Surface, &Voxels),
    cell: std::ops::Range<u32>,
    bounds: Bounds,
    openness: &(dyn Fn(Place) -> u32 + Sync),
    bins: &mut [f64],
) -> Vec<Seed> {
    let triangle = |piece: &Piece| &surface.triangles[piece.triangle as usize];
    let mut left: Vec<u32> = cell.collect();
    let mut seeds = Vec::new();
    while !left.is_empty() {
        let pieces = || left.iter().map(|&index| (index, &voxels.pieces[index as usize]));

        // The normal of the fullest bin, and the pieces close to it.
        bins.fill(0.0);
        pieces().for_each(|(_, p)| bins[triangle(p).bin as usize] += p.area);
        let fullest = (0..bins.len()).fold(0, |best, bin| if bins[bin] > bins[best] { bin } else { best });
        let mut normal = bin_normal(fullest);
        if !pieces().any(|(_, p)| triangle(p).normal.dot(normal) >= bounds.cos) {
            // All pieces of the bin are outside theta_eps of its middle: use its largest piece's normal. In a voxel of
            // vanishing areas the fullest bin may be empty: then use the largest piece of all.
            let in_bin = pieces().filter(|(_, p)| triangle(p).bin as usize == fullest);
            let largest = in_bin.max_by(|a, b| a.1.area.total_cmp(&b.1.area)).or_else(|| pieces().next());
            normal = largest.map_or(normal, |(_, p)| triangle(p).normal);
        }
        let near = |p: &Piece| triangle(p).normal.dot(normal) >= bounds.cos;

        // Their normalised mean (5.97).
        let (mut mean_position, mut mean_normal, mut area) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for (_, piece) in pieces().filter(|(_, p)| near(p)) {
            mean_position += piece.centroid * piece.area;
            mean_normal += triangle(piece).normal * piece.area;
            area += piece.area;
        }
        let mean_position = mean_position / area;
        let mean_normal = mean_normal.try_normalize().unwrap_or(normal);

        // The most similar point on the group's own surface.
        let mut best = (f64::INFINITY, 0, DVec3::ZERO);
        for (index, piece) in pieces().filter(|(_, p)| near(p)) {
            let facing = triangle(piece).normal;
            let cos = facing.dot(mean_normal);
            if error(0.0, cos, bounds.distance) < best.0 {
                let point = nearest_point(voxels.corners(piece), facing, mean_position);
                let similarity = error(point.distance(mean_position), cos, bounds.distance);
                if similarity < best.0 {
                    best = (similarity, index, point);
                }
            }
        }
        let place = |snapped: u32, point: DVec3| {
            let index = voxels.pieces[snapped as usize].triangle;
            (snapped, (index, surface.weights(&surface.triangles[index as usize], point)))
        };
        let mut found = place(best.1, best.2);
        // A door's face may be in the open while the shelves behind it, which face the same way, are not.
        let mut open = openness(found.1);
        if open < OPEN {
            let mut group: Vec<u32> = pieces().filter(|(_, p)| near(p)).map(|(index, _)| index).collect();
            let height = |index: u32| voxels.pieces[index as usize].centroid.dot(mean_normal);
            group.sort_by(|&a, &b| height(b).total_cmp(&height(a)).then(a.cmp(&b)));
            let mut similarity = f64::INFINITY;
            for &index in group.iter().step_by(group.len().div_ceil(TRIED)) {
                let centroid = voxels.pieces[index as usize].centroid;
                let other = place(index, centroid);
                let (more, distance) = (openness(other.1).min(OPEN), centroid.distance(mean_position));
                if more > open || (more == open && distance < similarity) {
                    (found, open, similarity) = (other, more, distance);
                }
            }
        }
        let (snapped, (index, weights)) = found;
        let snapped_to = &surface.triangles[index as usize];

        // Only covered pieces are removed; the others stay for the next round. The snapped piece is always removed.
        let goes =
            |i: u32| i == snapped || triangle(&voxels.pieces[i as usize]).normal.dot(snapped_to.normal) >= bounds.cos;
        let (gone, stays): (Vec<u32>, Vec<u32>) = left.iter().partition(|&&i| goes(i));
        seeds.push(Seed {
            triangle: index,
            weights,
            position: surface.point(snapped_to, weights),
            normal: snapped_to.normal,
            area: gone.iter().map(|&i| voxels.pieces[i as usize].area).sum(),
            pieces: gone,
            open: open > 0,
        });
        left = stays;
    }
    seeds
}

/// Nearest point of a flat convex polygon with either winding.
fn nearest_point(polygon: &[DVec3], normal: DVec3, point: DVec3) -> DVec3 {
    let flat = point - normal * (point - polygon[0]).dot(normal);
    let (mut lefts, mut rights) = (0, 0);
    let mut best = (f64::INFINITY, flat);
    for (i, &a) in polygon.iter().enumerate() {
        let edge = polygon[(i + 1) % polygon.len()] - a;
        let turn = edge.cross(flat - a).dot(normal);
        lefts += usize::from(turn >= 0.0);
        rights += usize::from(turn <= 0.0);
        let along = ((flat - a).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let on_edge = a + edge * along;
        let distance = on_edge.distance_squared(flat);
        if distance < best.0 {
            best = (distance, on_edge);
        }
    }
    if lefts == polygon.len() || rights == polygon.len() { flat } else { best.1 }
}
