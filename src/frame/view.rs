//! A camera in the form that shaders use: relative to the scene's origin, reversed depth, no far plane.

use super::settings::SUPERSAMPLES;
use crate::scene::{Camera, Projection};
use glam::{DAffine3, DMat4, DVec3, DVec4, Mat4, Vec2, Vec4};
use std::f32::consts::TAU;

/// Multiples of the golden ratio, modulo 1, lie far apart; so do those of every fourth or eighth number.
const GOLDEN: f32 = 0.618_034;

/// Matrices of one camera for one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// World space (relative to the scene's origin) to clip space; y points down, z is reversed.
    pub clip_from_world: Mat4,
    /// Inverse of `clip_from_world`.
    pub world_from_clip: Mat4,
    /// Position and 1. For parallel projection, the unit direction towards the viewer and 0.
    pub eye: Vec4,
    /// Plane through the camera. Its dot product with a world position and 1 is the distance in front of the camera
    /// \[m\].
    pub plane: Vec4,
    /// Angle by which the pattern of short rays is turned about normals \[rad\].
    pub turn: f32,
}

impl View {
    /// This view shifted so that each pixel's centre shows the point at this offset \[pixels\] from it. For drawing
    /// only: `world_from_clip` stays that of the original view.
    pub(super) fn moved(&self, offset: Vec2, size: [u32; 2]) -> Self {
        let by = 2.0 * offset / Vec2::new(size[0] as f32, size[1] as f32);
        let moved = Mat4::from_translation((-by).extend(0.0));
        Self { clip_from_world: moved * self.clip_from_world, ..*self }
    }

    /// Size of the pictures of `sample` for a picture of this size \[pixels\].
    pub fn size_of_samples([width, height]: [u32; 2]) -> [u32; 2] {
        [width + SUPERSAMPLES, height + SUPERSAMPLES]
    }

    /// The view through one of `SUPERSAMPLES`^2 points of every pixel, and a shift in columns and rows. `size`: of the
    /// picture that this view belongs to. A larger picture of the returned view, of `size_of_samples`, shows the point of
    /// pixel `p` at pixel `p` + shift. Directions of rays follow patterns over pixels. Each view turns them by another angle;
    /// because of the shift, other directions also differ between points of a pixel.
    pub fn sample(&self, number: u32, size: [u32; 2]) -> (Self, [u32; 2]) {
        let shift = [number % SUPERSAMPLES, number / SUPERSAMPLES % SUPERSAMPLES];
        let offset = shift.map(|i| (i as f32 + 0.5) / SUPERSAMPLES as f32 - 0.5);
        let [small, large] = [size, Self::size_of_samples(size)].map(|[w, h]| Vec2::new(w as f32, h as f32));
        let moved = 2.0 * (Vec2::from(shift.map(|i| i as f32)) - Vec2::from(offset));
        let (scale, by) = (small / large, (small - large + moved) / large);
        let window =
            |scale: Vec2, by: Vec2| Mat4::from_translation(by.extend(0.0)) * Mat4::from_scale(scale.extend(1.0));
        let view = Self {
            clip_from_world: window(scale, by) * self.clip_from_world,
            world_from_clip: self.world_from_clip * window(1.0 / scale, -by / scale),
            turn: TAU * (number as f32 * GOLDEN).fract(),
            ..*self
        };
        (view, shift)
    }

    /// A camera's view of a scene around `origin` with this radius \[m\].
    pub fn new(camera: &Camera, size: [u32; 2], origin: DVec3, radius: f64) -> Self {
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let mut pose = camera.world_from_camera;
        pose.translation -= origin;
        let camera_from_world: DAffine3 = pose.inverse();
        let backward = pose.matrix3.z_axis.normalize();
        let (projection, eye) = match camera.projection {
            Projection::Perspective { yfov } => {
                let f = 1.0 / (f64::from(yfov) * 0.5).tan();
                let near = super::world::lights::NEAREST * radius;
                let projection = DMat4::from_cols(
                    DVec4::new(f / aspect, 0.0, 0.0, 0.0),
                    DVec4::new(0.0, -f, 0.0, 0.0),
                    DVec4::new(0.0, 0.0, 0.0, -1.0),
                    DVec4::new(0.0, 0.0, near, 0.0),
                );
                (projection, pose.translation.as_vec3().extend(1.0))
            }
            Projection::Orthographic { ymag } => {
                // Depth is 1 one radius in front of the scene's nearest point and 0 behind its farthest. The origin is
                // the scene's centre.
                let (half_height, middle) = (f64::from(ymag), camera_from_world.translation.z);
                let (near, far) = (middle + 2.0 * radius, middle - 2.0 * radius);
                let depth = near - far;
                let projection = DMat4::from_cols(
                    DVec4::new(1.0 / (half_height * aspect), 0.0, 0.0, 0.0),
                    DVec4::new(0.0, -1.0 / half_height, 0.0, 0.0),
                    DVec4::new(0.0, 0.0, 1.0 / depth, 0.0),
                    DVec4::new(0.0, 0.0, -far / depth, 1.0),
                );
                (projection, backward.as_vec3().extend(0.0))
            }
        };
        let plane = (-backward).extend(backward.dot(pose.translation)).as_vec4();
        let clip_from_world = projection * DMat4::from(camera_from_world);
        Self {
            clip_from_world: clip_from_world.as_mat4(),
            world_from_clip: clip_from_world.inverse().as_mat4(),
            eye,
            plane,
            turn: 0.0,
        }
    }
}
