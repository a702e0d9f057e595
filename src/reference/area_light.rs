//! Light from a rectangle of uniform radiance at a point, by numerical integration: the reference for the contour
//! integrals of the shaders.

use super::phong::cos_power;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// A rectangle that emits uniform radiance from its front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Centre \[m\].
    pub middle: DVec3,
    /// From the centre to an edge \[m\]; the front faces `right` x `up`.
    pub right: DVec3,
    /// Likewise, perpendicular to `right`.
    pub up: DVec3,
}

/// Largest size of a part, as a share of the distance times the lobe's width.
const FINE: f64 = 0.05;

/// Most parts per side.
const MOST: usize = 4000;

impl Rectangle {
    /// Integral of `weight` over the solid angle \[sr\] that the rectangle's front subtends at a point.
    fn integral(&self, point: DVec3, width: f64, weight: impl Fn(DVec3) -> f64) -> f64 {
        let area = self.right.cross(self.up) * 4.0;
        let nearest = {
            let offset = point - self.middle;
            let along = |side: DVec3| (offset.dot(side) / side.length_squared()).clamp(-1.0, 1.0) * side;
            (offset - along(self.right) - along(self.up)).length()
        };
        let parts = |side: DVec3| ((2.0 * side.length() / (FINE * width * nearest)).ceil() as usize).clamp(8, MOST);
        let (columns, rows) = (parts(self.right), parts(self.up));
        let place = |i: usize, n: usize| (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
        let mut sum = 0.0;
        for i in 0..columns * rows {
            let at =
                self.middle + place(i % columns, columns) * self.right + place(i / columns, rows) * self.up - point;
            let distance = at.length();
            let towards = at / distance;
            sum += weight(towards) * (-area.dot(towards)).max(0.0) / (distance * distance);
        }
        sum / (columns * rows) as f64
    }

    /// Form factor: irradiance at a point, divided by pi times the radiance.
    pub fn form_factor(&self, point: DVec3, normal: DVec3) -> f64 {
        self.integral(point, 1.0, |towards| normal.dot(towards).max(0.0)) / PI
    }

    /// Radiance reflected by a normalised Phong lobe of exponent `k` about the unit vector `mirrored`, divided by the
    /// rectangle's radiance; Lensing 2014, eq. 5.30.
    pub fn lobe(&self, point: DVec3, normal: DVec3, mirrored: DVec3, k: f64) -> f64 {
        let width = (1.0 / (k + 1.0).sqrt()).min(1.0);
        let lobe = |towards: DVec3| cos_power(k, mirrored.dot(towards)) * normal.dot(towards).max(0.0);
        self.integral(point, width, lobe) * (k + 2.0) / TAU
    }
}
