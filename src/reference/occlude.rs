//! Stage 7, occlusion: the discs of caches x a cache -> what is left of its proxy lights. METHOD 6, thesis 5.4.
//!
//! A proxy light becomes a sphere as large as its VALs are spread, sphere and discs become axis-aligned squares on the
//! cache's unit disc, and what the squares of discs cover of the sphere's is lost. What the thesis leaves open, or prints
//! in a way that can be read in two, is a choice; the defaults are the engine's.

use glam::{DVec2, DVec3, dvec2};

use super::form_factor::disc_form_factor;
use super::gather::{Cache, Lobe};

/// A cache as something in the way: the share of the surface that is its own, as a disc about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// World position \[m\].
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Its share of the surface [m^2], eq. 5.58.
    pub area: f64,
}

/// Which side of a disc is in the way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Facing {
    /// The front: a closed body is in the way once.
    Front,
    /// Both: squares are smaller than what they stand for, and the back of a body fills the gaps.
    #[default]
    Both,
}

/// How large the sphere of a proxy light is, from the variance of its VALs' positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Radius {
    /// The longest of the standard deviations along the world's axes, as printed.
    LongestAxis,
    /// Twice that: the radius of an even disc that the axes lie in.
    TwiceLongestAxis,
    /// The standard deviation in space, which turns with the scene.
    Deviation,
    /// That times the root of two: the radius of an even disc, however it lies.
    #[default]
    Disc,
}

/// How the squares lie on the unit disc.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tangents {
    /// As the world's axes do, turned the shortest way from +Y to the normal: smooth but for one direction.
    Surface,
    /// Along the direction to the light: they turn with the scene.
    #[default]
    Light,
}

/// Against what is counted twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cap {
    /// Nothing.
    None,
    /// The bounding rectangle of the overlaps of discs that are in the way at all.
    #[default]
    InTheWay,
    /// That of all overlaps, those behind the light as well.
    All,
}

/// The share of light that is not blocked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choices {
    /// Area of a square over its form factor: 1 as printed; pi is what a form factor covers of the unit disc.
    pub square: f64,
    /// How far in front of the light a disc is in the way in full, in radii of the sphere; 1 as printed.
    pub fade: f64,
    /// Sides of discs.
    pub facing: Facing,
    /// Size of the light.
    pub radius: Radius,
    /// Frame of the squares.
    pub tangents: Tangents,
    /// Guard against double blocking.
    pub cap: Cap,
}

impl Default for Choices {
    fn default() -> Self {
        Self {
            square: 2.0,
            fade: 2.0,
            facing: Facing::default(),
            radius: Radius::default(),
            tangents: Tangents::default(),
            cap: Cap::default(),
        }
    }
}

/// Least radius of a proxy light in distances from the cache: a point has no area to cover, and in f32 variances below
/// this are rounding.
pub const LEAST_RADIUS: f64 = 1.0 / 64.0;

/// Sine between normal and light below which the light gives no direction to lay squares along.
pub const LEAST_SINE: f64 = 1e-3;

impl Radius {
    /// Radius \[m\] of the sphere for a variance [m^2] along each axis; its clamp is [`Light`]'s.
    pub fn of(self, variance: DVec3) -> f64 {
        let variance = variance.max(DVec3::ZERO);
        match self {
            Self::LongestAxis => variance.max_element().sqrt(),
            Self::TwiceLongestAxis => 2.0 * variance.max_element().sqrt(),
            Self::Deviation => variance.element_sum().sqrt(),
            Self::Disc => (2.0 * variance.element_sum()).sqrt(),
        }
    }
}

/// Variance [m^2] in space of the VALs of a lobe, from their mean squared distance and their mean.
pub fn variance(cache: &Cache, lobe: &Lobe) -> f64 {
    (lobe.distance2 - lobe.position.distance_squared(cache.position)).max(0.0)
}

/// Form factor of a sphere from a point, as a disc that faces it; eq. 5.59 left: `r^2 cos+ / (r^2 + d^2)`.
pub fn sphere_form_factor(radius2: f64, cosine: f64, d2: f64) -> f64 {
    radius2 * cosine.max(0.0) / (radius2 + d2)
}

/// Share of a disc that is in the way, eq. 5.61: from 1 where it stands `reach` \[m\] in front of the light or more, `along`
/// being how far, to 0 where it stands level with the light or behind.
pub fn fade(along: f64, reach: f64) -> f64 {
    (along / reach).clamp(0.0, 1.0)
}

/// Where two squares overlap, as its lower and upper corner; `None` where they do not.
pub fn overlap(centre: DVec2, side: f64, other: DVec2, other_side: f64) -> Option<[DVec2; 2]> {
    let low = (centre - 0.5 * side).max(other - 0.5 * other_side);
    let high = (centre + 0.5 * side).min(other + 0.5 * other_side);
    low.cmplt(high).all().then_some([low, high])
}

/// Tangent of a surface: +X, turned the shortest way from +Y to the normal.
pub fn surface_tangent(normal: DVec3) -> DVec3 {
    let scale = 1.0 + normal.y;
    if scale < 1e-6 { DVec3::X } else { DVec3::X - normal.x / scale * (normal + DVec3::Y) }
}

/// A proxy light as its cache sees it.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// From the cache to it \[m\].
    offset: DVec3,
    /// Radius of its sphere \[m\].
    radius: f64,
    /// Frame on the unit disc.
    tangents: [DVec3; 2],
    /// Middle of its square.
    centre: DVec2,
    /// Area of its square.
    area: f64,
}

impl Light {
    /// The light at `position` \[m\] as a sphere of at least this radius \[m\].
    pub fn new(cache: &Cache, position: DVec3, radius: f64, choices: &Choices) -> Self {
        let offset = position - cache.position;
        let distance = offset.length();
        let direction = offset / distance;
        let radius = radius.max(LEAST_RADIUS * distance);
        let aside = direction - cache.normal.dot(direction) * cache.normal;
        let tangent = match choices.tangents {
            Tangents::Light if aside.length() > LEAST_SINE => aside.normalize(),
            _ => surface_tangent(cache.normal),
        };
        let tangents = [tangent, cache.normal.cross(tangent)];
        let form_factor = sphere_form_factor(radius * radius, cache.normal.dot(direction), distance * distance);
        let centre = dvec2(tangents[0].dot(direction), tangents[1].dot(direction));
        Self { offset, radius, tangents, centre, area: choices.square * form_factor }
    }

    /// The frame in which its square and those of discs lie: unit, on the surface.
    pub fn tangents(&self) -> [DVec3; 2] {
        self.tangents
    }
}

/// Share of a light's sphere, 0 to 1, that discs leave to be seen from the cache; listing 5.3. The cache's own disc may be
/// among them: it is in its own plane.
pub fn visible(cache: &Cache, light: &Light, discs: &[Disc], choices: &Choices) -> f64 {
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
        let cosine = -disc.normal.dot(direction);
        let cosine = if choices.facing == Facing::Both { cosine.abs() } else { cosine };
        let area = choices.square * disc_form_factor(disc.area, cosine, cache.normal.dot(direction), d2);
        let centre = dvec2(light.tangents[0].dot(direction), light.tangents[1].dot(direction));
        let Some([from, to]) = overlap(light.centre, light.area.sqrt(), centre, area.sqrt()) else { continue };
        let share = fade((offset - light.offset).dot(towards_cache), choices.fade * light.radius);
        sum += share * (to - from).element_product();
        if share > 0.0 || choices.cap == Cap::All {
            (low, high) = (low.min(from), high.max(to));
        }
    }
    let most = if choices.cap == Cap::None || sum == 0.0 { sum } else { (high - low).element_product() };
    (1.0 - sum.min(most) / light.area).max(0.0)
}

/// A lobe dimmed by what is in the way, as the engine does it; unlit ones stay as they are.
pub fn occlude(cache: &Cache, lobe: &Lobe, discs: &[Disc], choices: &Choices) -> Lobe {
    if !lobe.lit {
        return *lobe;
    }
    let radius = choices.radius.of(DVec3::splat(variance(cache, lobe) / 3.0));
    let light = Light::new(cache, lobe.position, radius, choices);
    Lobe { facing_irradiance: lobe.facing_irradiance * visible(cache, &light, discs, choices), ..*lobe }
}
