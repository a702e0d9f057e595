//! Analyses a scene's space and decides whether it is an object or a room, with rays from points in free space near the
//! middle.

use super::super::Scene;
use super::super::rays::{Hit, Rays};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Horizontal directions in the order in which an open side is searched, front first.
pub(super) const SIDES: [DVec3; 4] = [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::NEG_X];

/// Points along each axis, in the middle half of the bounds.
const POINTS: usize = 5;

/// Directions of rays from each point.
const DIRECTIONS: usize = 160;

/// A room hides at least this share of the directions at `STEEPEST` degrees or more from straight up; its top may be
/// open.
const ROOM: f64 = 0.8;
const STEEPEST: f64 = 70.0;

/// In a room, at least this share of the downward directions within 45 degrees hits one level.
const FLOOR: f64 = 0.25;

/// Least cosine between the vertical and the normal of a level surface.
const LEVEL: f64 = 0.95;

/// Poses per animation that are examined, and the most vertices in total.
const MOMENTS: usize = 8;
const MOST_VERTICES: usize = 1 << 22;

/// A scene, analysed for placing cameras and lights.
pub(super) struct Space {
    pub(super) rays: Rays,
    /// Visible vertices \[m\], including those at some times of each animation.
    pub(super) points: Vec<DVec3>,
    /// Smallest and largest coordinates of these.
    pub(super) low: DVec3,
    pub(super) high: DVec3,
    /// Points in free space near the middle \[m\], nearest to it first, with their ray hits.
    pub(super) free: Vec<Place>,
    /// Mean share of directions from these points, except steep upward ones, in which surfaces block the view.
    pub(super) enclosure: f64,
    /// Share of their downward directions that hits the most common level.
    pub(super) floor: f64,
}

/// A point in free space.
pub(super) struct Place {
    pub(super) position: DVec3,
    /// Hit by direction of [`directions`].
    hits: Vec<Option<Hit>>,
}

impl Space {
    /// Analyses a scene; `None` if nothing is visible.
    pub(super) fn new(scene: &mut Scene) -> Option<Self> {
        let rays = Rays::new(scene);
        let mut points = Vec::new();
        add_vertices(scene, &mut points);
        let spans: Vec<(f64, f64)> = scene.animations().map(|(_, begin, end)| (begin, end)).collect();
        let moments = (MOST_VERTICES / (points.len() * spans.len()).max(1)).min(MOMENTS);
        for (animation, (begin, end)) in spans.into_iter().enumerate() {
            for moment in 0..moments {
                scene.pose(animation, begin + (end - begin) * (moment as f64 + 0.5) / moments as f64);
                add_vertices(scene, &mut points);
            }
        }
        scene.rest();
        let low = points.iter().copied().reduce(DVec3::min)?;
        let high = points.iter().copied().reduce(DVec3::max)?;
        let mut space = Self { rays, points, low, high, free: Vec::new(), enclosure: 0.0, floor: 0.0 };
        space.look_around();
        Some(space)
    }

    pub(super) fn centre(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    /// Half of the bounds' diagonal \[m\].
    pub(super) fn radius(&self) -> f64 {
        0.5 * self.low.distance(self.high)
    }

    /// Whether the scene surrounds the free space in its middle and has a floor.
    pub(super) fn is_room(&self) -> bool {
        self.enclosure >= ROOM && self.floor >= FLOOR
    }

    /// Whether the scene surrounds the free space in its middle, with or without a floor.
    pub(super) fn encloses(&self) -> bool {
        self.enclosure >= ROOM
    }

    /// Share of the directions within 30 degrees of `axis`, from the free points, that lead out.
    pub(super) fn openness(&self, axis: DVec3) -> f64 {
        self.share(30.0, axis, |hit| hit.is_none())
    }

    fn share(&self, degrees: f64, axis: DVec3, is: impl Fn(&Option<Hit>) -> bool) -> f64 {
        let least = degrees.to_radians().cos();
        let within: Vec<usize> =
            directions().enumerate().filter(|(_, d)| d.dot(axis) >= least).map(|(index, _)| index).collect();
        let count = self.free.iter().flat_map(|place| within.iter().map(|&i| &place.hits[i])).filter(|h| is(h)).count();
        count as f64 / (within.len() * self.free.len()).max(1) as f64
    }

    fn look_around(&mut self) {
        let half = 0.5 * (self.high - self.low);
        let step = |digit: usize| (digit % POINTS) as f64 / (POINTS - 1) as f64 - 0.5;
        // Slightly off centre, since walls are often exactly in the middle.
        let at = |i: usize| {
            DVec3::new(step(i), step(i / POINTS), step(i / POINTS / POINTS)) + DVec3::new(0.011, 0.017, 0.013)
        };
        let mut offsets: Vec<DVec3> = (0..POINTS.pow(3)).map(at).collect();
        offsets.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        let look = |offset: DVec3| {
            let position = self.centre() + half * offset;
            let hits: Vec<_> = directions().map(|direction| self.rays.nearest(position, direction)).collect();
            let backs = hits.iter().flatten().filter(|hit| !hit.front).count();
            let fronts = hits.iter().flatten().count() - backs;
            // Points inside a solid or behind a room's walls see back sides.
            (4 * backs <= fronts).then_some(Place { position, hits })
        };
        self.free = offsets.into_par_iter().filter_map(look).collect();
        if self.free.is_empty() {
            return;
        }
        self.enclosure = 1.0 - self.share(180.0 - STEEPEST, DVec3::NEG_Y, |hit| hit.is_none());
        self.floor = self.level_share();
    }

    /// Share of downward directions from the free points that hits the most common level.
    fn level_share(&self) -> f64 {
        let (mut heights, mut all) = (Vec::new(), 0);
        for place in &self.free {
            for (direction, hit) in directions().zip(&place.hits).filter(|(d, _)| d.y < -0.7) {
                all += 1;
                if let Some(hit) = hit.filter(|hit| hit.front && hit.normal.y > LEVEL) {
                    heights.push(place.position.y + hit.distance * direction.y);
                }
            }
        }
        heights.sort_by(f64::total_cmp);
        let tolerance = 0.03 * (self.high.y - self.low.y);
        let within = |first: usize| heights.partition_point(|height| *height <= heights[first] + tolerance) - first;
        let most = (0..heights.len()).map(within).max().unwrap_or(0);
        most as f64 / all.max(1) as f64
    }

    /// Distance to the nearest surface around a point, and whether the point is in free space.
    pub(super) fn clearance(&self, position: DVec3) -> (f64, bool) {
        let hits: Vec<Hit> = directions().filter_map(|direction| self.rays.nearest(position, direction)).collect();
        let nearest = hits.iter().map(|hit| hit.distance).fold(f64::INFINITY, f64::min);
        let backs = hits.iter().filter(|hit| !hit.front).count();
        (nearest, 5 * backs <= hits.len())
    }

    /// Whether an upward-facing surface near the lowest point covers most of the footprint.
    pub(super) fn has_floor(&self) -> bool {
        const CELLS: usize = 24;
        let size = self.high - self.low;
        let from = self.low.y + (0.05 * size.y).max(1e-3 * self.radius());
        let covered = |cell: &usize| {
            let share = |n: usize| (n as f64 + 0.5) / CELLS as f64;
            let at = DVec3::new(size.x * share(cell % CELLS), 0.0, size.z * share(cell / CELLS));
            let origin = DVec3::new(self.low.x + at.x, from, self.low.z + at.z);
            self.rays.nearest(origin, DVec3::NEG_Y).is_some_and(|hit| hit.front && hit.normal.y > LEVEL)
        };
        let lies = size.y < 0.03 * size.x.max(size.z);
        lies || (0..CELLS * CELLS).filter(covered).count() as f64 > 0.6 * (CELLS * CELLS) as f64
    }
}

/// Evenly distributed unit directions: a Fibonacci spiral.
pub(super) fn directions() -> impl Iterator<Item = DVec3> {
    (0..DIRECTIONS).map(|index| {
        let y = 1.0 - (2 * index + 1) as f64 / DIRECTIONS as f64;
        let around = TAU * (index as f64 * 0.618_033_988_749_895).fract();
        let across = (1.0 - y * y).sqrt();
        DVec3::new(across * around.cos(), y, across * around.sin())
    })
}

/// Adds the visible vertices in the current pose.
fn add_vertices(scene: &Scene, points: &mut Vec<DVec3>) {
    for instance in scene.instances.iter().filter(|instance| !instance.hidden) {
        let mesh = &scene.meshes[instance.mesh];
        let posed = instance.pose.as_ref().map(|pose| mesh.posed(pose));
        let vertices = posed.as_ref().unwrap_or(&mesh.vertices);
        let mut used = vec![false; vertices.len()];
        mesh.indices.iter().for_each(|&index| used[index as usize] = true);
        let drawn = vertices.iter().zip(used).filter(|(_, used)| *used);
        let place = instance.world_from_model;
        points.extend(drawn.map(|(v, _)| place.transform_point3(v.position.as_dvec3())).filter(|p| p.is_finite()));
    }
}
