//! The camera of the window: a free camera with a target, or a camera of the scene.

use crate::cli::camera::{look_at, parts};
use glam::{DMat3, DVec3, Vec2, Vec4};
use lightskin::frame::View;
use lightskin::scene::{Camera, Projection};

/// A camera that looks at a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Free {
    pub(super) eye: DVec3,
    pub(super) target: DVec3,
    /// Up direction of the command line, or +Y once the camera has been turned.
    up: DVec3,
    /// Vertical field of view [degrees].
    pub(super) fov: f32,
}

/// The camera of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Seen {
    /// A camera of the scene, by its index. Animations move it.
    OfScene(usize),
    /// The free camera of the user.
    Free(Free),
}

/// Largest angle of the view above or below the horizon [rad].
const STEEPEST: f64 = 89.0 * std::f64::consts::PI / 180.0;

impl Free {
    /// A free camera at the place of a camera of the scene, with its target at this distance [m].
    pub(super) fn of(camera: &Camera, distance: f64) -> Self {
        let eye = camera.world_from_camera.translation;
        let forward = -camera.world_from_camera.matrix3.z_axis.normalize();
        let fov = match camera.projection {
            Projection::Perspective { yfov } => yfov.to_degrees(),
            Projection::Orthographic { ymag } => 2.0 * (ymag / distance as f32).atan().to_degrees(),
        };
        Self { eye, target: eye + forward * distance, up: camera.world_from_camera.matrix3.y_axis, fov }
    }

    /// Parses "eye;target;up;fov". `None` for other values of `--camera`.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let ([eye, target, up], fov) = parts(text).ok()?;
        Some(Self { eye, target, up, fov })
    }

    pub(super) fn camera(&self) -> Option<Camera> {
        look_at(self.eye, self.target, self.up, self.fov)
    }

    /// The value of `--camera` that gives this camera.
    pub(super) fn argument(&self) -> String {
        let v = |v: DVec3| format!("{},{},{}", v.x, v.y, v.z);
        format!("{};{};{};{}", v(self.eye), v(self.target), v(self.up), self.fov)
    }

    fn distance(&self) -> f64 {
        self.eye.distance(self.target)
    }

    /// Direction from the target to the eye: its angle about +Y and its elevation above the horizon [rad].
    fn angles(&self) -> (f64, f64) {
        let towards = (self.eye - self.target).normalize_or(DVec3::Z);
        (towards.x.atan2(towards.z), towards.y.clamp(-1.0, 1.0).asin())
    }

    fn direction(yaw: f64, pitch: f64) -> DVec3 {
        let pitch = pitch.clamp(-STEEPEST, STEEPEST);
        DVec3::new(yaw.sin() * pitch.cos(), pitch.sin(), yaw.cos() * pitch.cos())
    }

    /// Orbits around the target. `by` is the movement of the pointer in heights of the picture.
    pub(super) fn orbit(&mut self, by: Vec2) {
        let (yaw, pitch) = self.angles();
        let turn = std::f64::consts::PI;
        let towards = Self::direction(yaw - turn * f64::from(by.x), pitch + turn * f64::from(by.y));
        (self.eye, self.up) = (self.target + self.distance() * towards, DVec3::Y);
    }

    /// Turns in place. `by` is the movement of the pointer in heights of the picture.
    pub(super) fn look(&mut self, by: Vec2) {
        let (yaw, pitch) = self.angles();
        let (turn, distance) = (f64::from(self.fov).to_radians(), self.distance());
        let towards = Self::direction(yaw - turn * f64::from(by.x), pitch + turn * f64::from(by.y));
        (self.target, self.up) = (self.eye - distance * towards, DVec3::Y);
    }

    /// The axes of the camera: right, up and backward.
    fn axes(&self) -> DMat3 {
        let backward = (self.eye - self.target).normalize_or(DVec3::Z);
        let right = self.up.cross(backward).normalize_or(DVec3::X);
        DMat3::from_cols(right, backward.cross(right), backward)
    }

    /// Moves sideways, so that a point at the target's distance stays under the pointer. `by` is the movement of the
    /// pointer in heights of the picture.
    pub(super) fn pan(&mut self, by: Vec2) {
        let height = 2.0 * self.distance() * (0.5 * f64::from(self.fov).to_radians()).tan();
        self.shift(self.axes() * DVec3::new(-f64::from(by.x) * height, f64::from(by.y) * height, 0.0));
    }

    /// Moves towards the target by this number of wheel steps.
    pub(super) fn zoom(&mut self, steps: f32) {
        let distance = self.distance() * 0.9_f64.powf(steps.into());
        self.eye = self.target + (self.eye - self.target).normalize_or(DVec3::Z) * distance.clamp(1e-9, 1e12);
    }

    /// Moves along the camera's own axes [m]: right, up, forward.
    pub(super) fn fly(&mut self, by: DVec3) {
        self.shift(self.axes() * DVec3::new(by.x, by.y, -by.z));
    }

    /// Moves the target to a point. Distance and direction stay.
    pub(super) fn centre(&mut self, on: DVec3) {
        self.shift(on - self.target);
    }

    fn shift(&mut self, by: DVec3) {
        self.eye += by;
        self.target += by;
    }
}

/// The point of the scene, relative to its origin, at a position in the picture. x and y go from 0 to 1, from the top
/// left. `depth` is the depth in the G-buffer there. `None` if there is no surface.
pub(super) fn point_at(view: &View, [x, y]: [f32; 2], depth: f32) -> Option<DVec3> {
    let clip = Vec4::new(2.0 * x - 1.0, 2.0 * y - 1.0, depth, 1.0);
    let world = view.world_from_clip * clip;
    (depth > 0.0).then(|| (world.truncate() / world.w).as_dvec3()).filter(|point| point.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn free() -> Free {
        Free { eye: DVec3::new(1.0, 2.0, 5.0), target: DVec3::new(0.5, 1.0, -1.0), up: DVec3::Y, fov: 40.0 }
    }

    #[test]
    fn orbits_keep_their_distance_and_end_below_the_pole() {
        let mut camera = free();
        for _ in 0..50 {
            camera.orbit(Vec2::new(0.13, 0.07));
        }
        assert!((camera.distance() - free().distance()).abs() < 1e-9);
        assert!((camera.angles().1 - STEEPEST).abs() < 1e-9);
        assert!(camera.camera().is_some());
    }

    #[test]
    fn what_is_panned_stays_under_the_pointer() {
        let view = |camera: &Free| View::new(&camera.camera().expect("a camera"), [100, 100], DVec3::ZERO, 10.0);
        let (before, mut after) = (free(), free());
        after.pan(Vec2::new(0.2, -0.1));
        let on = |camera: &Free| {
            let clip = view(camera).clip_from_world * before.target.as_vec3().extend(1.0);
            Vec2::new(clip.x, clip.y) / clip.w / 2.0
        };
        assert!((on(&after) - on(&before) - Vec2::new(0.2, -0.1)).length() < 1e-5, "{} {}", on(&after), on(&before));
    }

    #[test]
    fn points_come_back_from_their_depth() {
        let view = View::new(&free().camera().expect("a camera"), [200, 100], DVec3::ZERO, 10.0);
        let clip = view.clip_from_world * free().target.as_vec3().extend(1.0);
        let found = point_at(&view, [0.5, 0.5], clip.z / clip.w).expect("a point");
        assert!((found - free().target).length() < 1e-3, "{found}");
        assert_eq!(point_at(&view, [0.5, 0.5], 0.0), None);
    }
}
