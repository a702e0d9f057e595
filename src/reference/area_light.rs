//! Light from a rectangle of uniform radiance at a point, by numerical integration: the reference for the contour
//! integrals of the shaders; and the VALs of its rays.

use super::brdf::Lobe;
use super::disc::polygon_form_factor;
use super::rsm::Val;
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
    fn integral(&self, point: DVec3, width: f64, weight: impl Fn(DVec3) -> DVec3) -> DVec3 {
        let area = self.right.cross(self.up) * 4.0;
        let nearest = {
            let offset = point - self.middle;
            let along = |side: DVec3| (offset.dot(side) / side.length_squared()).clamp(-1.0, 1.0) * side;
            (offset - along(self.right) - along(self.up)).length()
        };
        let parts = |side: DVec3| ((2.0 * side.length() / (FINE * width * nearest)).ceil() as usize).clamp(8, MOST);
        let (columns, rows) = (parts(self.right), parts(self.up));
        let place = |i: usize, n: usize| (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
        let mut sum = DVec3::ZERO;
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
        self.integral(point, 1.0, |towards| DVec3::splat(normal.dot(towards).max(0.0))).x / PI
    }

    /// Ray `i` of `count` that carry equal parts of the rectangle's light, as origin \[m\] and unit direction. Twin of
    /// `glsl/area_vals.comp`.
    pub fn ray(&self, i: u32, count: u32) -> (DVec3, DVec3) {
        // The fractional parts of i times three irrational numbers.
        let spread = |step: f64| i.wrapping_mul((step * 2.0_f64.powi(32)).round() as u32) as f64 / 2.0_f64.powi(32);
        let [x, y, turn] = [0.8191725134, 0.6710436067, 0.5497004779].map(spread);
        let origin = self.middle + (2.0 * x - 1.0) * self.right + (2.0 * y - 1.0) * self.up;
        let square = (f64::from(i) + 0.5) / f64::from(count);
        let (sin, cos) = (TAU * turn).sin_cos();
        let [right, up] = [self.right, self.up].map(DVec3::normalize);
        let across = cos * right + sin * up;
        (origin, square.sqrt() * across + (1.0 - square).sqrt() * right.cross(up))
    }

    /// The VAL where one of `count` rays meets a surface. It is as large, square to the light, as the surface that
    /// receives the ray's part of the light. The rectangle hides surfaces that it faces from less than `close` \[m\], and
    /// takes back light of surfaces of whose view it fills more than 95 %. Twin of `glsl/area_vals.comp`.
    pub fn val(
        &self,
        radiance: DVec3,
        count: u32,
        (position, normal, albedo): (DVec3, DVec3, DVec3),
        close: f64,
    ) -> Val {
        let (right, up) = (self.right, self.up);
        let corners = [-right - up, right - up, right + up, up - right].map(|corner| self.middle + corner);
        let to = self.middle - position;
        let part = 4.0 * right.cross(up).length() / f64::from(count);
        let area = part / polygon_form_factor(&corners, position, to.normalize()).max(1e-6);
        let mut past = ((1.0 - polygon_form_factor(&corners, position, normal)) / 0.05).min(1.0);
        if [right, up].iter().all(|side| to.dot(*side).abs() < side.length_squared()) {
            past *= (-to.dot(right.cross(up).normalize()) / close).min(1.0);
        }
        Val { position, area, normal, flux: albedo * radiance * (PI * part * past) }
    }

    /// Radiance reflected by a glossy lobe at a point, divided by the rectangle's radiance.
    pub fn reflected(&self, point: DVec3, normal: DVec3, lobe: &Lobe) -> DVec3 {
        let width = match *lobe {
            Lobe::Phong { exponent, .. } => (1.0 / (exponent + 1.0).sqrt()).min(1.0),
            Lobe::Ggx { roughness, .. } => roughness * roughness,
        };
        self.integral(point, width, |towards| lobe.brdf(towards) * normal.dot(towards).max(0.0))
    }
}
