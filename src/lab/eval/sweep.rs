//! The points of a sweep: one knob at a time around a default, with and without shadows of indirect light, and a grid
//! of caches by VALs.

use crate::frame::{ClusterRule, Interpolation, Near, ProxyWeight, Quality, Shadows};
use crate::lab::knobs::{Gi, Knobs, Path};

/// Everything that a measurement depends on besides scene, camera and device.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The frame's settings.
    pub frame: Knobs,
    /// Caches requested; 0 for brute force.
    pub caches: usize,
    /// References per vertex.
    pub references: usize,
    /// `theta_eps` of the bake \[rad\].
    pub angle: f32,
    /// Longest edge \[m\] of a triangle; `None` to follow the caches' spacing, 0 to leave triangles undivided.
    pub max_edge: Option<f64>,
}

impl Point {
    /// Brute force with this RSM side \[texels\].
    pub fn brute_force(size: [u32; 2], rsm: u32) -> Self {
        let frame = Knobs { gi: Gi::BruteForce, rsm, ..Knobs::plain(size) };
        Self { frame, caches: 0, references: 8, angle: 0.0, max_edge: Some(0.0) }
    }
}

/// A setting that is varied while all others stay at the default.
pub struct Knob {
    /// Name of its column in tables.
    pub name: &'static str,
    /// Description in lower case, for plot axes.
    pub title: &'static str,
    /// Its values in plotting order.
    pub values: Vec<Value>,
}

/// Applies a value of a knob.
type Turn = fn(&mut Point);

/// One value of a knob.
pub struct Value {
    /// The value as a user would type it.
    pub label: String,
    apply: Box<dyn Fn(&mut Point)>,
}

impl Knob {
    fn numbers(name: &'static str, title: &'static str, values: &[u32], apply: fn(&mut Point, u32)) -> Self {
        let mut values = values.to_vec();
        values.sort_unstable();
        values.dedup();
        let value = |n: u32| Value { label: n.to_string(), apply: Box::new(move |point| apply(point, n)) };
        Self { name, title, values: values.into_iter().map(value).collect() }
    }

    fn choices(name: &'static str, title: &'static str, values: &[(&str, Turn)]) -> Self {
        let value = |(label, apply): &(&str, Turn)| Value { label: (*label).into(), apply: Box::new(*apply) };
        Self { name, title, values: values.iter().map(value).collect() }
    }

    /// A point with this knob set to one of its values.
    pub fn set(&self, point: &Point, value: usize) -> Point {
        let mut point = point.clone();
        (self.values[value].apply)(&mut point);
        point
    }

    /// Index of the knob's value at a point.
    pub fn of(&self, point: &Point) -> Option<usize> {
        (0..self.values.len()).find(|value| self.set(point, *value) == *point)
    }

    /// Whether the values are numbers.
    pub fn is_numeric(&self) -> bool {
        self.values.iter().all(|value| value.label.parse::<f64>().is_ok())
    }
}

/// Size of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// All knobs, and the grid of caches and VALs.
    Full,
    /// Fewer and cheaper points.
    Quick,
}

/// The points to measure.
pub struct Sweep {
    /// The default of `render`, around which knobs are varied.
    pub base: Point,
    /// The same with one bounce and without shadows of indirect light. Knobs are varied around it, too, for comparison with
    /// references of that light.
    pub bare: Point,
    /// Varied knobs; the first two also span the grid.
    pub knobs: Vec<Knob>,
    /// The defaults, single knobs and the grid, each point once.
    pub points: Vec<Point>,
    /// Frames of which the median time is taken.
    pub frames: usize,
    /// Samples per pixel of the path tracer.
    pub samples: u32,
}

impl Sweep {
    /// All points around a default.
    pub fn new(base: Point, extent: Extent, frames: usize, samples: u32) -> Self {
        let knobs = knobs(&base, extent);
        let mut bare = base.clone();
        bare.frame.shadows = Shadows::Off;
        bare.frame.near = Near::Off;
        bare.frame.bounces = 1;
        let bases = [base, bare];
        // Consecutive points with the same caches share a bake.
        let mut points = bases.to_vec();
        for knob in &knobs {
            points.extend((0..knob.values.len()).flat_map(|value| bases.each_ref().map(|base| knob.set(base, value))));
        }
        let [caches, vals] = [&knobs[0], &knobs[1]];
        for row in 0..caches.values.len() {
            for base in bases.each_ref().map(|base| caches.set(base, row)) {
                points.extend((0..vals.values.len()).map(|column| vals.set(&base, column)));
            }
        }
        let mut unique: Vec<Point> = Vec::new();
        for point in points {
            if !unique.contains(&point) {
                unique.push(point);
            }
        }
        let [base, bare] = bases;
        Self { base, bare, knobs, points: unique, frames: frames.max(1), samples: samples.max(1) }
    }

    /// Whether a point differs from a default in at most one knob: such points get pictures.
    pub fn is_pictured(&self, point: &Point) -> bool {
        let is_set = |base, knob: &Knob| (0..knob.values.len()).any(|value| knob.set(base, value) == *point);
        [&self.base, &self.bare].into_iter().any(|base| self.knobs.iter().any(|knob| is_set(base, knob)))
    }

    /// RSM sides \[texels\], ascending; each has its own brute-force reference, the last is the finest.
    pub fn rsm_sides(&self) -> Vec<u32> {
        let mut sides: Vec<u32> = self.points.iter().map(|point| point.frame.rsm).collect();
        sides.sort_unstable();
        sides.dedup();
        sides
    }
}

/// Clusters stand for VALs if they are farther away than this many of their radii; with one bounce and without shadows, as
/// in `render`.
fn cluster(point: &mut Point, radii: f32) {
    point.frame.path = Path::Clusters(ClusterRule::Distance(radii));
    point.frame.shadows = Shadows::Off;
    point.frame.near = Near::Off;
    point.frame.bounces = 1;
}

/// Shadows of indirect light. References without shadows have one bounce; those with shadows have all.
fn shadows(point: &mut Point, shadows: Shadows) {
    if point.frame.shadows == Shadows::Off && point.frame.bounces == 1 {
        point.frame.bounces = BOUNCES;
    }
    point.frame.shadows = shadows;
}

/// Short rays, which require shadows: unshadowed references do not include nearby occlusion.
fn near(point: &mut Point, per_pixel: u32, every: u32) {
    point.frame.near = Near::Rays { per_pixel, every };
    if point.frame.shadows == Shadows::Off {
        shadows(point, Shadows::PerLight);
    }
}

/// Bounces. One without shadows stays so; more require the default's shadows and short rays.
fn bounces(point: &mut Point, bounces: u32) {
    if bounces > 1 && point.frame.bounces == 1 && point.frame.shadows == Shadows::Off {
        near(point, 8, 0);
    }
    point.frame.bounces = bounces;
}

/// The default of `render`.
const BOUNCES: u32 = Quality::High.bounces();

/// All knobs; add an entry to add one. Numeric knobs include the default's value.
fn knobs(base: &Point, extent: Extent) -> Vec<Knob> {
    let quick = extent == Extent::Quick;
    let caches: &[u32] = if quick { &[50, 250, 1000] } else { &[50, 250, 1000, 4000] };
    let sides: &[u32] = if quick { &[32, 64, 128] } else { &[32, 64, 128, 256] };
    let references: &[u32] = &[8, 16];
    let clusters: &[(&str, Turn)] = &[
        ("none", |point| point.frame.path = Path::Compute),
        ("8", |point| cluster(point, 8.0)),
        ("4", |point| cluster(point, 4.0)),
        ("16", |point| cluster(point, 16.0)),
        ("2", |point| cluster(point, 2.0)),
    ];
    let near_kinds: &[(&str, Turn)] = &[
        ("8/auto", |point| near(point, 8, 0)),
        ("off", |point| point.frame.near = Near::Off),
        ("8/1", |point| near(point, 8, 1)),
        ("8/2", |point| near(point, 8, 2)),
        ("32/1", |point| near(point, 32, 1)),
    ];
    vec![
        Knob::numbers("caches", "caches requested", &[caches, &[base.caches as u32]].concat(), |point, n| {
            point.caches = n as usize;
        }),
        Knob::numbers("rsm", "RSM side in texels", &[sides, &[base.frame.rsm]].concat(), |point, n| {
            point.frame.rsm = n;
        }),
        Knob::numbers("refs", "references per vertex", references, |point, n| point.references = n as usize),
        Knob::choices(
            "interpolation",
            "averaging between caches",
            &[
                ("facing", |point| point.frame.interpolation = Interpolation::Facing),
                ("printed", |point| point.frame.interpolation = Interpolation::Printed),
            ],
        ),
        Knob::choices(
            "proxy-weight",
            "weights of a proxy light's position",
            &[
                ("irradiance", |point| point.frame.proxy_weight = ProxyWeight::Irradiance),
                ("form-factor", |point| point.frame.proxy_weight = ProxyWeight::FormFactor),
            ],
        ),
        Knob::choices(
            "shadows",
            "shadows of indirect light",
            &[
                ("per-light", |point| shadows(point, Shadows::PerLight)),
                ("proxy", |point| shadows(point, Shadows::Proxy)),
                ("off", |point| {
                    point.frame.shadows = Shadows::Off;
                    point.frame.near = Near::Off;
                }),
            ],
        ),
        Knob::numbers("bounces", "bounces", if quick { &[1, BOUNCES] } else { &[1, 2, 4, BOUNCES] }, bounces),
        Knob::choices(
            "near",
            "short rays per pixel / distance between pixels with rays",
            &near_kinds[..if quick { 2 } else { 5 }],
        ),
        Knob::choices(
            "cluster",
            "least distance of clusters in radii, one bounce without shadows",
            &clusters[..if quick { 3 } else { 5 }],
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn base() -> Point {
        Point {
            frame: Knobs { bounces: BOUNCES, ..Knobs::at(Quality::High, 2000, [64, 36]) },
            caches: 2000,
            references: 8,
            angle: 1.0,
            max_edge: None,
        }
    }

    #[test]
    fn every_point_comes_once_and_every_knob_is_turned_alone() {
        let sweep = Sweep::new(base(), Extent::Full, 5, 64);
        for (i, point) in sweep.points.iter().enumerate() {
            assert!(!sweep.points[..i].contains(point), "{point:?} comes twice");
        }
        // The default and one bounce without shadows: 5 cache counts (four and the default) by 4 RSMs, and one
        // alternative each of three other knobs. Two further kinds of shadows, one of them also without rays. Three
        // numbers of bounces, four variants of rays, four cluster distances.
        assert_eq!(sweep.points.len(), 2 * (5 * 4 + 3) + 3 + 3 + 4 + 4);
        let pictured = sweep.points.iter().filter(|point| sweep.is_pictured(point)).count();
        assert_eq!(pictured, 2 * (1 + 4 + 3 + 3) + 3 + 3 + 4 + 4);
        assert_eq!(sweep.rsm_sides(), [32, 64, 128, 256]);
    }

    #[test]
    fn knobs_know_where_they_stand() {
        let sweep = Sweep::new(base(), Extent::Full, 5, 64);
        for knob in &sweep.knobs {
            for value in 0..knob.values.len() {
                for base in [&sweep.base, &sweep.bare] {
                    assert_eq!(knob.of(&knob.set(base, value)), Some(value), "{}", knob.name);
                }
            }
        }
        assert_eq!(sweep.knobs[0].of(&Point { caches: 7, ..base() }), None);
    }
}
