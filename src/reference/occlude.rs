//! Stage 7, occlusion: dims a cache's proxy lights by the discs of all caches. METHOD 6, thesis 5.4.
//!
//! A proxy light becomes a sphere as large as the spread of its VALs. Sphere and discs become axis-aligned squares on
//! the cache's unit disc; the part of the sphere's square that discs cover is lost. docs/choices.md compares the
//! choices that the thesis leaves open.

use glam::{DVec2, DVec3, dvec2};

use super::form_factor::disc_form_factor;
use super::gather::{Cache, Lobe};

/// A cache as an occluder: its share of the surface as a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// World position \[m\].
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Its share of the surface [m^2], eq. 5.58.
    pub area: f64,
}

/// Area of a square relative to its form factor. The thesis prints 1; pi is what a form factor covers on the unit disc.
pub const SQUARE: f64 = 2.0;

/// Distance in front of the light at which a disc occludes fully, in radii of the light's sphere; 1 as printed.
const FADE: f64 = 2.0;

/// Lower bound of a proxy light's radius, relative to its distance from the cache: a point has no area to cover, and
/// smaller f32 variances are rounding errors.
const LEAST_RADIUS: f64 = 1.0 / 64.0;

/// Sine between normal and light below which the light gives no direction for the squares.
const LEAST_SINE: f64 = 1e-3;

/// Variance [m^2] in space of a lobe's VALs, from their mean squared distance and mean position.
fn variance(cache: &Cache, lobe: &Lobe) -> f64 {
    (lobe.distance2 - lobe.position.distance_squared(cache.position)).max(0.0)
}

/// Form factor from a point to a sphere, taken as a disc that faces the point; eq. 5.59 left: `r^2 cos+ / (r^2 + d^2)`.
pub fn sphere_form_factor(radius2: f64, cosine: f64, d2: f64) -> f64 {
    radius2 * cosine.max(0.0) / (radius2 + d2)
}

/// Occluding share of a disc, eq. 5.61, at the distance `along` \[m\] in front of the light: 1 from `reach` \[m\] on, 0
/// at the sides of the light and behind it.
pub fn fade(along: f64, reach: f64) -> f64 {
    (along / reach).clamp(0.0, 1.0)
}

/// Overlap of two squares: lower and upper corner; `None` if they do not overlap.
pub fn overlap(centre: DVec2, side: f64, other: DVec2, other_side: f64) -> Option<[DVec2; 2]> {
    let low = (centre - 0.5 * side).max(other - 0.5 * other_side);
    let high = (centre + 0.5 * side).min(other + 0.5 * other_side);
    low.cmplt(high).all().then_some([low, high])
}

/// Tangent of a surface: +X, rotated by the shortest rotation from +Y to the normal.
fn surface_tangent(normal: DVec3) -> DVec3 {
    let scale = 1.0 + normal.y;
    if scale < 1e-6 { DVec3::X } else { DVec3::X - normal.x / scale * (normal + DVec3::Y) }
}

/// A proxy light as its cache sees it.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// From the cache to the light \[m\].
    offset: DVec3,
    /// Radius of its sphere \[m\].
    radius: f64,
    /// Frame on the unit disc.
    tangents: [DVec3; 2],
    /// Centre of its square.
    centre: DVec2,
    /// Area of its square.
    area: f64,
}

impl Light {
    /// The light at `position` \[m\] as a sphere of at least this radius \[m\].
    pub fn new(cache: &Cache, position: DVec3, radius: f64) -> Self {
        let offset = position - cache.position;
        let distance = offset.length();
        let direction = offset / distance;
        let radius = radius.max(LEAST_RADIUS * distance);
        let aside = direction - cache.normal.dot(direction) * cache.normal;
        let tangent = if aside.length() > LEAST_SINE { aside.normalize() } else { surface_tangent(cache.normal) };
        let tangents = [tangent, cache.normal.cross(tangent)];
        let form_factor = sphere_form_factor(radius * radius, cache.normal.dot(direction), distance * distance);
        let centre = dvec2(tangents[0].dot(direction), tangents[1].dot(direction));
        Self { offset, radius, tangents, centre, area: SQUARE * form_factor }
    }

    /// Frame of its square and those of discs: unit tangents of the surface.
    pub fn tangents(&self) -> [DVec3; 2] {
        self.tangents
    }
}

/// Visible share of a light's sphere from the cache, 0 to 1; listing 5.3. The cache's own disc may be in the list: it
/// lies in the cache's plane.
fn visible(cache: &Cache, light: &Light, discs: &[Disc]) -> f64 {
    if light.area <= 0.0 {
        return 1.0;
    }
    let towards_cache = -light.offset.normalize();
    let (mut sum, mut low, mut high) = (0.0, DVec2::INFINITY, DVec2::NEG_INFINITY);
    for disc in discs {
        let offset = disc.position - cache.position;
        let d2 = offset.length_squared();
        if d2 == 0.0 {
            continue;
        }
        let direction = offset / d2.sqrt();
        // Both sides occlude: squares are smaller than the surfaces they stand for, and the back of a body fills the gaps.
        let cosine = disc.normal.dot(direction).abs();
        let area = SQUARE * disc_form_factor(disc.area, cosine, cache.normal.dot(direction), d2);
        let centre = dvec2(light.tangents[0].dot(direction), light.tangents[1].dot(direction));
        let Some([from, to]) = overlap(light.centre, light.area.sqrt(), centre, area.sqrt()) else { continue };
        let share = fade((offset - light.offset).dot(towards_cache), FADE * light.radius);
        sum += share * (to - from).element_product();
        if share > 0.0 {
            (low, high) = (low.min(from), high.max(to));
        }
    }
    // Limit of double counting: the bounding rectangle of the overlaps of discs that occlude at all.
    let most = if sum == 0.0 { 0.0 } else { (high - low).element_product() };
    (1.0 - sum.min(most) / light.area).max(0.0)
}

/// Dims a lobe by its occluders, as the engine does; unlit lobes stay unchanged.
pub fn occlude(cache: &Cache, lobe: &Lobe, discs: &[Disc]) -> Lobe {
    if !lobe.lit {
        return *lobe;
    }
    // The radius of a uniform disc in any orientation with this variance.
    let light = Light::new(cache, lobe.position, (2.0 * variance(cache, lobe)).sqrt());
    Lobe { facing_irradiance: lobe.facing_irradiance * visible(cache, &light, discs), ..*lobe }
}
