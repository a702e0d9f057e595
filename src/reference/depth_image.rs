//! What a cache sees of the rectangles that stand for all surfaces. METHOD 6, "beyond the print".
//!
//! The image covers the unit disc on which a unit direction `w` lies at `Proj(w) = (w.T, w.B)`, eq. 5.60. A texel holds
//! how far the cache sees through its centre; of several rectangles the one that ends the view nearest counts, so that what
//! stands in a row blocks once.

use std::f64::consts::PI;

use glam::DVec3;

use super::gather::{Cache, Gathered, ProxyWeight, gather_received, receive};
use super::occlude::Disc;
use super::phong::mirrored_view;
use super::rsm::Val;

/// A cache as something in the way: the rectangle that stands for its share of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plate {
    /// The cache itself and the area of its share.
    pub disc: Disc,
    /// Middle \[m\].
    pub middle: DVec3,
    /// From there to the middle of an edge \[m\], square to the normal.
    pub axis: DVec3,
    /// From there to the next edge, square to both \[m\].
    pub breadth: f64,
}

/// What is drawn for a cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A disc about it: its radius in that of the circle of its area.
    Disc(f64),
    /// The ellipse of the same variances as its rectangle, this many times as large.
    Ellipse(f64),
    /// Its rectangle, this many times as large.
    Rectangle(f64),
}

/// How they are drawn. Lengths are in radii of the circle of a share's area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// Texels of an image's side.
    pub side: usize,
    /// What is drawn.
    pub shape: Shape,
    /// How far behind it things are still seen: surfaces are not flat.
    pub margin: f64,
    /// How far out of its plane a cache must lie for it to be in the way, the others being neighbours on its surface; and how
    /// far before the other's plane one of the two caches must lie.
    pub plane: f64,
    /// Whether it blocks from behind, too.
    pub two_sided: bool,
    /// Share of the slope that it has within a texel by which it is moved away: at 1 no point of a plane hides another.
    pub slope: f64,
    /// VALs in a row that are seen or hidden together, as the first of them.
    pub together: usize,
}

impl Default for Rule {
    fn default() -> Self {
        let shape = Shape::Rectangle(1.0);
        Self { side: 24, shape, margin: 2.0, plane: 0.15, two_sided: true, slope: 1.0, together: 4 }
    }
}

/// What is drawn, as a cache sees it.
struct VisibleRectangle {
    /// From the cache to its middle \[m\].
    offset: DVec3,
    /// Unit normal away from the cache.
    normal: DVec3,
    /// How far the cache is from its plane \[m\].
    height: f64,
    /// Duals of its half axes: what lies within has coordinates below 1.
    duals: [DVec3; 2],
    is_round: bool,
    /// Radius of the circle of the share's area \[m\].
    share: f64,
}

impl VisibleRectangle {
    /// `None` where it cannot be in the way.
    fn new(cache: &Cache, plate: &Plate, rule: &Rule) -> Option<Self> {
        let Plate { disc, middle, axis, breadth } = *plate;
        let share = (disc.area / PI).sqrt();
        let along = axis.normalize_or_zero();
        let axes = [axis, disc.normal.cross(along) * breadth];
        let (middle, axes) = match rule.shape {
            Shape::Disc(radius) => (disc.position, tangents(disc.normal).map(|t| t * radius * share)),
            Shape::Ellipse(size) => (middle, axes.map(|a| a * size * 2.0 / 3_f64.sqrt())),
            Shape::Rectangle(size) => (middle, axes.map(|a| a * size)),
        };
        let offset = middle - cache.position;
        let height = offset.dot(disc.normal);
        // Two sides of one thing: neither cache is before the other, whatever their rectangles are.
        let other = disc.position - cache.position;
        let is_behind = -other.dot(disc.normal) < rule.plane * share && other.dot(cache.normal) <= rule.plane * share;
        let is_away = height.abs() > rule.plane * share && !is_behind && (rule.two_sided || height < 0.0);
        let highest = offset.dot(cache.normal) + axes.iter().map(|a| a.dot(cache.normal).abs()).sum::<f64>();
        let has_area = axes.iter().all(|a| a.length_squared() > 0.0);
        (is_away && highest > 0.0 && has_area).then(|| Self {
            offset,
            normal: disc.normal * height.signum(),
            height: height.abs(),
            duals: axes.map(|a| a / a.length_squared()),
            is_round: !matches!(rule.shape, Shape::Rectangle(_)),
            share,
        })
    }

    /// Whether a ray in a unit direction, of which this much is along the normal, goes through it.
    fn is_met(&self, direction: DVec3, along: f64) -> bool {
        let place = direction * (self.height / along) - self.offset;
        let [a, b] = self.duals.map(|dual| place.dot(dual).abs());
        along > 0.0 && if self.is_round { a * a + b * b < 1.0 } else { a.max(b) < 1.0 }
    }
}

/// Cosine at the cache below which a texel's slope is taken from here: at the horizon it has no end.
const LEAST_Z: f64 = 0.2;

/// The view of one cache.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthImage {
    position: DVec3,
    tangents: [DVec3; 2],
    side: usize,
    /// Reciprocal of the distance at which the view ends [1/m], row by row; 0 where it does not.
    pub ends: Vec<f64>,
}

/// A frame about a unit normal. Duff et al. 2017.
pub fn tangents(n: DVec3) -> [DVec3; 2] {
    let side = if n.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (side + n.z);
    let b = n.x * n.y * a;
    [DVec3::new(1.0 + side * n.x * n.x * a, side * b, -side * n.x), DVec3::new(b, side + n.y * n.y * a, -n.y)]
}

impl DepthImage {
    /// Draws what stands for all caches.
    pub fn new(cache: &Cache, plates: &[Plate], rule: &Rule) -> Self {
        let tangents = tangents(cache.normal);
        let side = rule.side;
        let mut ends = vec![0.0; side * side];
        // What cannot be in the way is left out once, not once a texel.
        let seen: Vec<VisibleRectangle> =
            plates.iter().filter_map(|plate| VisibleRectangle::new(cache, plate, rule)).collect();
        for (index, end) in ends.iter_mut().enumerate() {
            let step = 2.0 / side as f64;
            let [x, y] = [index % side, index / side].map(|i| (i as f64 + 0.5) * step - 1.0);
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
                // Along a texel's edges w changes by the tangent less what z loses; the farthest corner is where the plane is
                // seen at the least cosine.
                let change = |tangent: DVec3, place: f64| {
                    let w = tangent - cache.normal * (place / z.max(LEAST_Z));
                    (0.5 * step * normal.dot(w)).abs()
                };
                let least = along - rule.slope * (change(tangents[0], x) + change(tangents[1], y));
                if least > 0.0 {
                    *end = f64::max(*end, 1.0 / (height / least + rule.margin * share));
                }
            }
        }
        Self { position: cache.position, tangents, side, ends }
    }

    /// Whether the cache sees a point above its horizon \[m\].
    pub fn sees(&self, point: DVec3) -> bool {
        let offset = point - self.position;
        let distance = offset.length();
        let place = self.tangents.map(|tangent| {
            let at = (tangent.dot(offset) / distance.max(f64::MIN_POSITIVE) + 1.0) * 0.5 * self.side as f64;
            (at as usize).min(self.side - 1)
        });
        self.ends[place[1] * self.side + place[0]] * distance <= 1.0
    }
}

/// What [`super::gather::gather`] gives with VALs that the cache does not see left out; VALs are those that carry light,
/// in the device's order, so that the same ones are taken together.
pub fn gather_seen(
    cache: &Cache,
    image: &DepthImage,
    vals: &[Val],
    eye: Option<DVec3>,
    weight: ProxyWeight,
    rule: &Rule,
) -> Gathered {
    let mirrored = eye.map(|eye| mirrored_view(cache.position, cache.normal, eye));
    let seen = vals.chunks(rule.together).flat_map(|vals| {
        let seen = image.sees(vals[0].position);
        vals.iter().filter(move |_| seen)
    });
    let received = seen.map(|val| receive(cache, mirrored, val, weight.of(val)));
    gather_received(cache, mirrored.unwrap_or_default(), received)
}
