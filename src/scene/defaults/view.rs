//! Cameras for scenes without one: candidates in a fixed order, judged by rays that find what each would show.

use super::super::rays::Hit;
use super::super::{Camera, Projection};
use super::space::{SIDES, Space};
use glam::{DAffine3, DMat3, DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Vertical field of view \[rad\] of a camera outside, and the aspect ratio it is placed for.
const OUTSIDE_YFOV: f64 = 40.0 * PI / 180.0;
const ASPECT: f64 = 16.0 / 9.0;

/// Vertical field of view \[rad\] of a camera inside a room.
const INSIDE_YFOV: f64 = 60.0 * PI / 180.0;

/// Share of the picture's height and width that an object seen from outside fills.
const FILLED: f64 = 0.9;

/// Number of steps that centre the object in the picture.
const CENTRINGS: usize = 5;

/// Rays per candidate picture, across and down.
const ACROSS: usize = 48;
const DOWN: usize = 27;

/// A side is open if at least this share of its directions leads out.
const OPEN: f64 = 0.5;

/// An object thinner than this share of its other sizes is a sheet; one longer than this multiple of the next size is a
/// row.
const SHEET: f64 = 0.3;
const ROW: f64 = 3.0;

/// What the rays through a picture hit first, as shares of all rays.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    fronts: f64,
    backs: f64,
    /// Mean distance of front-side hits \[m\].
    far: f64,
}

impl Seen {
    /// Score from 0 to 1: high if surfaces are visible, and from their fronts.
    fn worth(&self) -> f64 {
        let all = self.fronts + self.backs;
        if all > 0.0 { self.fronts / all * (self.fronts / 0.02).min(1.0) } else { 0.0 }
    }
}

/// The camera that shows a scene best.
pub(super) struct Found {
    pub(super) camera: Camera,
    /// The scene is a room, and the camera stands in it or looks into it.
    pub(super) of_room: bool,
}

/// Decides between object and room, and finds a camera for it.
pub(super) fn find(space: &Space) -> Found {
    let room = |camera| Found { camera, of_room: true };
    log::debug!("{} free places, {:.2} enclosed, {:.2} on a floor", space.free.len(), space.enclosure, space.floor);
    if space.is_room() {
        let open = SIDES.into_iter().filter(|&side| space.openness(side) >= OPEN);
        let mut through = open.map(|side| outside("added: view through the open side", space, side));
        if let Some(camera) = through.find(|camera| seen(space, camera).worth() > 0.8) {
            return room(camera);
        }
    }
    let outside = from_outside(space);
    // Without a floor, it is a room only if it cannot be seen from outside.
    let enclosed = space.is_room() || (space.encloses() && seen(space, &outside).worth() < 0.5);
    match from_inside(space).filter(|_| enclosed) {
        Some(camera) => room(camera),
        None => Found { camera: outside, of_room: false },
    }
}

/// A camera outside. Sheets and rows are seen from their front, other objects from above and to the right of the front;
/// from elsewhere if that shows little or back sides.
fn from_outside(space: &Space) -> Camera {
    let mut directions: Vec<DVec3> = Vec::new();
    let [x, y, z] = (space.high - space.low).to_array();
    let wide = |a: f64, b: f64, c: f64| a < SHEET * b.min(c);
    if wide(z, x, y) || x > ROW * y.max(z) {
        directions.push(DVec3::new(0.0, 0.12, 1.0));
        directions.push(DVec3::new(0.0, 0.12, -1.0));
    } else if wide(x, y, z) || z > ROW * x.max(y) {
        directions.push(DVec3::new(1.0, 0.12, 0.0));
        directions.push(DVec3::new(-1.0, 0.12, 0.0));
    }
    let heights = [0.35, 1.5, -0.5];
    let sides = [(0.5, 1.0), (-0.5, 1.0), (1.0, 0.3), (-1.0, 0.3), (0.5, -1.0), (-0.5, -1.0)];
    directions.extend(heights.into_iter().flat_map(|up| sides.map(|(x, z)| DVec3::new(x, up, z))));
    let mut best: Option<(f64, Camera)> = None;
    for direction in directions {
        let camera = outside("added: view", space, direction.normalize());
        let worth = seen(space, &camera).worth();
        if best.as_ref().is_none_or(|(most, _)| worth > 1.25 * most) {
            best = Some((worth, camera));
        }
        if best.as_ref().is_some_and(|(most, _)| *most > 0.8) {
            break;
        }
    }
    best.map_or_else(|| outside("added: view", space, DVec3::Z), |(_, camera)| camera)
}

/// A camera inside a room, at eye height for a hall, with its back to a wall, along the longest free view.
fn from_inside(space: &Space) -> Option<Camera> {
    let reach = |origin: DVec3, direction: DVec3| {
        let bounds = direction.dot(space.high - origin).max(direction.dot(space.low - origin));
        space.rays.nearest(origin, direction).map_or(bounds, |hit| hit.distance.min(bounds))
    };
    let mut best: Option<(f64, Camera)> = None;
    for place in space.free.iter().take(30) {
        let (up, down) = (reach(place.position, DVec3::Y), reach(place.position, DVec3::NEG_Y));
        let middle = place.position + (0.15 * (up + down) - down) * DVec3::Y;
        let free = SIDES.map(|side| reach(middle, side));
        let along_z = free[0] + free[1] > free[2] + free[3];
        let (one, other) = if along_z { (0, 1) } else { (2, 3) };
        let side = if free[one] >= free[other] { one } else { other };
        let eye = middle + 0.7 * free[side] * SIDES[side];
        if !space.clearance(eye).1 {
            continue;
        }
        let camera = Camera {
            name: "added: view along the room".into(),
            world_from_camera: look(eye, SIDES[side]),
            projection: Projection::Perspective { yfov: INSIDE_YFOV as f32 },
        };
        let seen = seen(space, &camera);
        let worth = seen.worth() * seen.far;
        // Prefers the place nearest to the middle, unless another sees much farther.
        if best.as_ref().is_none_or(|(most, _)| worth > 1.3 * most) {
            best = Some((worth, camera));
        }
    }
    best.filter(|(worth, _)| *worth > 0.0).map(|(_, camera)| camera)
}

/// A camera in the unit `direction` from the scene, looking at it, as near as its vertices fit into the picture.
fn outside(name: &str, space: &Space, direction: DVec3) -> Camera {
    let frame = look(DVec3::ZERO, direction).matrix3;
    let slope = FILLED * (0.5 * OUTSIDE_YFOV).tan();
    let slopes = [slope * ASPECT, slope];
    // The planes of the frustum that touch the vertices: right, left, top, bottom.
    let touch = |mut farthest: [f64; 4], point: &DVec3| {
        let p = frame.transpose() * (*point - space.centre());
        for (side, at) in [p.x, -p.x, p.y, -p.y].into_iter().enumerate() {
            farthest[side] = farthest[side].max(at + slopes[side / 2] * p.z);
        }
        farthest
    };
    let larger = |a: [f64; 4], b: [f64; 4]| std::array::from_fn(|i| a[i].max(b[i]));
    let none = || [f64::NEG_INFINITY; 4];
    let [right, left, top, bottom] = space.points.par_iter().fold(none, touch).reduce(none, larger);
    let distance = ((right + left) / (2.0 * slopes[0])).max((top + bottom) / (2.0 * slopes[1]));
    let nearest = space.points.iter().map(|point| direction.dot(*point - space.centre())).fold(0.0, f64::max);
    let mut eye = DVec3::new(0.5 * (right - left), 0.5 * (top - bottom), distance.max(nearest + 0.05 * space.radius()));
    // Centres the object along the axis with room to spare.
    for _ in 0..CENTRINGS {
        let shown = |bounds: [DVec2; 2], point: &DVec3| {
            let p = frame.transpose() * (*point - space.centre()) - eye;
            let at = p.truncate() / -p.z;
            [bounds[0].min(at), bounds[1].max(at)]
        };
        let none = || [DVec2::INFINITY, DVec2::NEG_INFINITY];
        let union = |a: [DVec2; 2], b: [DVec2; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let [low, high] = space.points.par_iter().fold(none, shown).reduce(none, union);
        eye += (0.5 * eye.z * (low + high)).extend(0.0);
    }
    Camera {
        name: name.into(),
        world_from_camera: look(space.centre() + frame * eye, direction),
        projection: Projection::Perspective { yfov: OUTSIDE_YFOV as f32 },
    }
}

/// Transform of an upright camera at `eye` that looks against the unit vector `back`.
fn look(eye: DVec3, back: DVec3) -> DAffine3 {
    let right = DVec3::Y.cross(back).try_normalize().unwrap_or(DVec3::X);
    DAffine3::from_mat3_translation(DMat3::from_cols(right, back.cross(right), back), eye)
}

/// Hits of a grid of rays through a camera's picture, with their positions. Empty for a camera without perspective.
pub(super) fn shown(space: &Space, camera: &Camera) -> Vec<(DVec3, Hit)> {
    let Projection::Perspective { yfov } = camera.projection else { return Vec::new() };
    let slope = (0.5 * f64::from(yfov)).tan();
    let pose = camera.world_from_camera;
    let ray = |index: usize| {
        let at = |n: usize, of: usize| 2.0 * (n as f64 + 0.5) / of as f64 - 1.0;
        let (x, y) = (at(index % ACROSS, ACROSS), at(index / ACROSS, DOWN));
        let direction = pose.matrix3 * DVec3::new(slope * ASPECT * x, slope * y, -1.0).normalize();
        let hit = space.rays.nearest(pose.translation, direction)?;
        Some((pose.translation + hit.distance * direction, hit))
    };
    (0..ACROSS * DOWN).into_par_iter().filter_map(ray).collect()
}

/// Statistics of what a camera would show.
fn seen(space: &Space, camera: &Camera) -> Seen {
    let (hits, count) = (shown(space, camera), (ACROSS * DOWN) as f64);
    let fronts: Vec<f64> = hits.iter().filter(|(_, hit)| hit.front).map(|(_, hit)| hit.distance).collect();
    Seen {
        fronts: fronts.len() as f64 / count,
        backs: (hits.len() - fronts.len()) as f64 / count,
        far: fronts.iter().sum::<f64>() / fronts.len().max(1) as f64,
    }
}
