//! A cache's view of its surroundings. METHOD 6, "beyond the print", and 11.
//!
//! The image covers the unit disc, onto which a unit direction `w` maps by `Proj(w) = (w.T, w.B)`, eq. 5.60. A drawn
//! image shows the rectangles that represent all surfaces. Its texels store how far the cache sees through their
//! centre; of several rectangles the one that ends the view nearest counts, so that occluders in a row block once. A
//! traced image shows the surfaces themselves. Its texels store planes.

use std::f64::consts::PI;

use glam::DVec3;

use super::gather::{Cache, Gathered, ProxyWeight, gather_received, receive, val_geometry};
use super::occlude::Disc;
use super::phong::mirrored_view;
use super::rsm::Val;
use super::world::{Sides, World};
use crate::shared::DEPTH_IMAGE_SIDE;

/// A cache as an occluder: the rectangle that represents its share of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plate {
    /// The cache itself and the area of its share.
    pub disc: Disc,
    /// Centre \[m\].
    pub middle: DVec3,
    /// From the centre to the middle of an edge \[m\], perpendicular to the normal.
    pub axis: DVec3,
    /// Half the size perpendicular to axis and normal \[m\].
    pub breadth: f64,
}

/// Side of a drawn image \[texels\].
const SIDE: usize = DEPTH_IMAGE_SIDE as usize;

/// Distance behind an occluder within which points are still visible: surfaces are not flat. \[radii of the circle of a
/// share's area\]
const MARGIN: f64 = 2.0;

/// Smallest distance of a cache from an occluder's plane; nearer caches are neighbours on its surface. At least one of the
/// two caches must also lie this far in front of the other's plane. \[radii of the circle of a share's area\]
const PLANE: f64 = 0.15;

/// An occluder as a cache sees it.
struct VisibleRectangle {
    /// From the cache to the occluder's centre \[m\].
    offset: DVec3,
    /// Unit normal away from the cache.
    normal: DVec3,
    /// Distance of the cache from the occluder's plane \[m\].
    height: f64,
    /// Duals of the half axes: coordinates are below 1 inside.
    duals: [DVec3; 2],
    /// Radius of the circle of the share's area \[m\].
    share: f64,
}

impl VisibleRectangle {
    /// `None` if the occluder cannot block anything.
    fn new(cache: &Cache, plate: &Plate) -> Option<Self> {
        let Plate { disc, middle, axis, breadth } = *plate;
        let share = (disc.area / PI).sqrt();
        let along = axis.normalize_or_zero();
        let axes = [axis, disc.normal.cross(along) * breadth];
        let offset = middle - cache.position;
        let height = offset.dot(disc.normal);
        // Two sides of one body: neither cache lies in front of the other, so their rectangles do not occlude.
        let other = disc.position - cache.position;
        let is_behind = -other.dot(disc.normal) < PLANE * share && other.dot(cache.normal) <= PLANE * share;
        let is_away = height.abs() > PLANE * share && !is_behind;
        let highest = offset.dot(cache.normal) + axes.iter().map(|a| a.dot(cache.normal).abs()).sum::<f64>();
        let has_area = axes.iter().all(|a| a.length_squared() > 0.0);
        (is_away && highest > 0.0 && has_area).then(|| Self {
            offset,
            normal: disc.normal * height.signum(),
            height: height.abs(),
            duals: axes.map(|a| a / a.length_squared()),
            share,
        })
    }

    /// Whether a ray in a unit direction hits it; `along` is the direction's component along the normal.
    fn is_met(&self, direction: DVec3, along: f64) -> bool {
        let place = direction * (self.height / along) - self.offset;
        let [a, b] = self.duals.map(|dual| place.dot(dual).abs());
        along > 0.0 && a.max(b) < 1.0
    }
}

/// Lower bound of the cosine at the cache for a texel's slope, which is infinite at the horizon.
const LEAST_Z: f64 = 0.2;

/// The view of one cache, drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthImage {
    position: DVec3,
    tangents: [DVec3; 2],
    /// Reciprocal of the distance at which the view ends [1/m], row by row; 0 if unobstructed.
    pub ends: Vec<f64>,
}

/// An orthonormal frame about a unit normal. Duff et al. 2017.
pub fn tangents(n: DVec3) -> [DVec3; 2] {
    let side = if n.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (side + n.z);
    let b = n.x * n.y * a;
    [DVec3::new(1.0 + side * n.x * n.x * a, side * b, -side * n.x), DVec3::new(b, side + n.y * n.y * a, -n.y)]
}

impl DepthImage {
    /// Draws the occluders of all caches.
    pub fn new(cache: &Cache, plates: &[Plate]) -> Self {
        let tangents = tangents(cache.normal);
        let mut ends = vec![0.0; SIDE * SIDE];
        // Skip occluders that cannot block once, not per texel.
        let seen: Vec<VisibleRectangle> =
            plates.iter().filter_map(|plate| VisibleRectangle::new(cache, plate)).collect();
        for (index, end) in ends.iter_mut().enumerate() {
            let step = 2.0 / SIDE as f64;
            let [x, y] = [index % SIDE, index / SIDE].map(|i| (i as f64 + 0.5) * step - 1.0);
            let z2 = 1.0 - x * x - y * y;
            if z2 <= 0.0 {
                continue;
            }
            let z = z2.sqrt();
            let direction = x * tangents[0] + y * tangents[1] + z * cache.normal;
            for met in &seen {
                let &VisibleRectangle { normal, height, share, .. } = met;
                // The ray meets the plane at `height / along`.
                let along = direction.dot(normal);
                if !met.is_met(direction, along) {
                    continue;
                }
                // Along a texel's edges w changes by the tangent minus the loss in z. The farthest corner sees the
                // plane under the smallest cosine.
                let change = |tangent: DVec3, place: f64| {
                    let w = tangent - cache.normal * (place / z.max(LEAST_Z));
                    (0.5 * step * normal.dot(w)).abs()
                };
                let least = along - change(tangents[0], x) - change(tangents[1], y);
                if least > 0.0 {
                    *end = f64::max(*end, 1.0 / (height / least + MARGIN * share));
                }
            }
        }
        Self { position: cache.position, tangents, ends }
    }

    /// Whether the cache sees a point above its horizon \[m\].
    pub fn sees(&self, point: DVec3) -> bool {
        let offset = point - self.position;
        self.ends[texel(self.tangents, SIDE, offset)] * offset.length() <= 1.0
    }

    /// Whether the cache sees the one of these VALs that would light it most.
    fn sees_most_lit(&self, cache: &Cache, vals: &[Val]) -> bool {
        most_lit(cache, vals).is_some_and(|val| self.sees(val.position))
    }
}

/// The texel of an image of `side`^2 texels that contains the direction of a vector from the cache.
fn texel(tangents: [DVec3; 2], side: usize, offset: DVec3) -> usize {
    let way = offset.normalize_or_zero();
    let place = tangents.map(|tangent| (((tangent.dot(way) + 1.0) * 0.5 * side as f64) as usize).min(side - 1));
    place[1] * side + place[0]
}

/// The VAL that would light a cache most if all were visible.
pub fn most_lit<'a>(cache: &Cache, vals: &'a [Val]) -> Option<&'a Val> {
    let share = |val: &Val| val_geometry(cache.position, cache.normal, val).0;
    vals.iter().fold(None, |most, val| Some(most.filter(|most| share(most) >= share(val)).unwrap_or(val)))
}

/// How far behind its plane points are still visible at least, as a share of their distance: surfaces are not flat.
const PLANE_MARGIN: f64 = 0.01;

/// Margins are at most this share: farther points are hardly of the same surface.
const MOST_MARGIN: f64 = 1.0;

/// The view of one cache as rays find it. METHOD 11.
pub struct TracedImage {
    position: DVec3,
    tangents: [DVec3; 2],
    side: usize,
    /// For each texel, row by row, the plane of the surface that its ray meets, moved back: the unit normal away from
    /// the cache, divided by the plane's distance \[1/m\]. Zero without a surface.
    pub planes: Vec<DVec3>,
}

impl TracedImage {
    /// Traces an image of `side`^2 texels. Rays begin at a distance \[m\] from the cache. Where a texel's middle lies
    /// outside the unit disc its ray passes just above the horizon.
    pub fn new(world: &World<'_>, cache: &Cache, side: usize, start: f64) -> Self {
        let tangents = tangents(cache.normal);
        // The point that the ray of a texel meets, relative to the cache, and the plane there.
        let met = |index: usize| {
            let [left, low] = [index % side, index / side].map(|i| i as f64 * 2.0 / side as f64 - 1.0);
            let step = 2.0 / side as f64;
            let nearest = |from: f64| 0.0_f64.clamp(from, from + step);
            if nearest(left).hypot(nearest(low)) >= 1.0 {
                return None;
            }
            let (x, y) = (left + 0.5 * step, low + 0.5 * step);
            let shrink = (0.9995 / x.hypot(y)).min(1.0);
            let (x, y) = (shrink * x, shrink * y);
            let way = x * tangents[0] + y * tangents[1] + (1.0 - x * x - y * y).sqrt() * cache.normal;
            let hit = world.nearest(cache.position + start * way, way, Sides::Both)?;
            let (normal, point) = (-world.surface(&hit).geometric, (start + hit.distance) * way);
            Some((point, normal / normal.dot(point)))
        };
        let all: Vec<Option<(DVec3, DVec3)>> = (0..side * side).map(met).collect();
        // Around an edge of a body, and where a surface curves away, two neighbours lie behind each other's planes. A
        // texel's corners are half as far away in its row and in its column.
        let moved_back = |index: usize| {
            let Some((own, plane)) = all[index] else { return DVec3::ZERO };
            let (column, row) = (index % side, index / side);
            let behind = |before: Option<usize>, after: Option<usize>| {
                let met = [before, after].into_iter().flatten().filter_map(|other| all[other]);
                let bends = met.filter(|(_, other)| other.dot(own) >= 0.999);
                bends.map(|(point, _)| plane.dot(point) - 1.0).fold(0.0, f64::max)
            };
            let in_row = behind((column > 0).then(|| index - 1), (column + 1 < side).then_some(index + 1));
            let in_column = behind((row > 0).then(|| index - side), (row + 1 < side).then_some(index + side));
            plane / (1.0 + (PLANE_MARGIN + 0.5 * (in_row + in_column)).min(MOST_MARGIN))
        };
        Self { position: cache.position, tangents, side, planes: (0..side * side).map(moved_back).collect() }
    }

    /// Whether the cache sees a point above its horizon \[m\]: whether it lies in front of its texel's plane.
    pub fn sees(&self, point: DVec3) -> bool {
        let offset = point - self.position;
        self.planes[texel(self.tangents, self.side, offset)].dot(offset) <= 1.0
    }
}

/// [`super::gather::gather`] without the VALs that the cache does not see. `vals` must be the lit VALs in the device's
/// order: `together` consecutive ones share the visibility of the one that lights the cache most.
pub fn gather_seen(
    cache: &Cache,
    image: &DepthImage,
    vals: &[Val],
    eye: Option<DVec3>,
    weight: ProxyWeight,
    together: usize,
) -> Gathered {
    let mirrored = eye.map(|eye| mirrored_view(cache.position, cache.normal, eye));
    let seen = vals.chunks(together).flat_map(|vals| {
        let seen = image.sees_most_lit(cache, vals);
        vals.iter().filter(move |_| seen)
    });
    let received = seen.map(|val| receive(cache, mirrored, val, weight.of(val)));
    gather_received(cache, mirrored.unwrap_or_default(), received)
}
