//! Exact integrals over a flat, homogeneous patch at a point: the truth behind a VAL's formulas. METHOD 2-3.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::phong::cos_power;

/// Corners of the polygon that replaces a disc cut by the point's horizon. At equal area its form factor is within 1e-3
/// of the disc's (tests/sources.rs).
pub const RIM: usize = 128;

/// Form factor from a point to a true disc of `area` [m^2]. Uses the closed form of a disc's vector irradiance (Gershun
/// 1936, by way of Snyder 1996) if the whole disc is above the point's horizon, else [`polygon_form_factor`].
pub fn disc_form_factor(area: f64, centre: DVec3, disc_normal: DVec3, point: DVec3, point_normal: DVec3) -> f64 {
    let offset = centre - point;
    let height = -disc_normal.dot(offset);
    if height <= 0.0 || area <= 0.0 {
        return 0.0;
    }
    let a2 = area / PI;
    // Extent of the rim above and below the centre along the point's normal.
    let reach = (a2 * (1.0 - point_normal.dot(disc_normal).powi(2)).max(0.0)).sqrt();
    let middle = point_normal.dot(offset);
    if middle <= -reach {
        return 0.0;
    }
    if middle < reach {
        return polygon_form_factor(&regular_polygon::<RIM>(area, centre, disc_normal), point, point_normal);
    }
    let aside = offset + height * disc_normal;
    let x = height * height + aside.length_squared() + a2;
    let y = x - 2.0 * a2;
    let s = (y * y + 4.0 * a2 * height * height).sqrt();
    // 1/2 (1 - y/s): rearranged far away to avoid cancellation, as it stands close to the disc.
    let facing = if y > 0.0 { 2.0 * a2 * height * height / (s * (s + y)) } else { 0.5 * (s - y) / s };
    let per_aside = 2.0 * a2 * height / (s * (x + s));
    point_normal.dot(per_aside * aside - facing * disc_normal)
}

/// Corners above the horizon by less than this share of their distance count as on it. Otherwise rounding could make a
/// polygon in the point's plane, which gives no light, fill the whole view.
const ON_HORIZON: f64 = 1e-9;

/// Form factor from a point to a convex flat polygon that faces the point, clipped at the point's horizon: Lambert's
/// contour integral `1/(2 pi) sum gamma_i (N . e_i)`.
pub fn polygon_form_factor(corners: &[DVec3], point: DVec3, point_normal: DVec3) -> f64 {
    let mut contour = Contour { normal: point_normal, first: None, last: DVec3::ZERO, sum: 0.0 };
    let height = |corner: DVec3| {
        let height = point_normal.dot(corner);
        if height.abs() <= ON_HORIZON * corner.length() { 0.0 } else { height }
    };
    let Some(last) = corners.last() else { return 0.0 };
    let mut before = *last - point;
    let mut before_height = height(before);
    for corner in corners {
        let here = *corner - point;
        let height = height(here);
        if (before_height > 0.0) != (height > 0.0) {
            contour.add(before + (here - before) * (before_height / (before_height - height)));
        }
        if height > 0.0 {
            contour.add(here);
        }
        (before, before_height) = (here, height);
    }
    if let Some(first) = contour.first {
        contour.add(first);
    }
    contour.sum.abs() / TAU
}

/// A contour under construction.
struct Contour {
    normal: DVec3,
    first: Option<DVec3>,
    last: DVec3,
    sum: f64,
}

impl Contour {
    fn add(&mut self, corner: DVec3) {
        if self.first.is_none() {
            self.first = Some(corner);
        } else {
            let across = self.last.cross(corner);
            let length = across.length();
            if length > 0.0 {
                self.sum += length.atan2(self.last.dot(corner)) * self.normal.dot(across) / length;
            }
        }
        self.last = corner;
    }
}

/// A regular polygon of this area [m^2].
pub fn regular_polygon<const N: usize>(area: f64, centre: DVec3, normal: DVec3) -> [DVec3; N] {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let n = N as f64;
    let radius = (2.0 * area / (n * (TAU / n).sin())).sqrt();
    std::array::from_fn(|i| {
        let (sin, cos) = (TAU * i as f64 / n).sin_cos();
        centre + radius * (cos * tangent + sin * bitangent)
    })
}

/// [`lobe_integral`], or the lobe towards the patch's centre where the two differ by less than 1e-3.
pub fn lobe_mean(corners: &[DVec3], area: f64, point: DVec3, point_normal: DVec3, mirrored: DVec3, k: f64) -> f64 {
    let centre = middle(corners) - point;
    let cosine = mirrored.dot(centre.normalize_or_zero());
    let sums = Sums { point_normal, mirrored, k, weight: 0.0, lobe: 0.0 };
    if sums.is_large(area, centre.length_squared(), cosine, 0.01) {
        lobe_integral(corners, point, point_normal, mirrored, k)
    } else {
        cos_power(k, cosine)
    }
}

/// Mean of the lobe `cos^k` about the unit direction `mirrored` over a convex flat polygon, weighted by the irradiance
/// from each of its points: the factor on [`polygon_form_factor`] if the lobe is not held constant. Triangles are
/// subdivided until they are small relative to their distance and the lobe; relative error 1e-3.
pub fn lobe_integral(corners: &[DVec3], point: DVec3, point_normal: DVec3, mirrored: DVec3, k: f64) -> f64 {
    let centre = middle(corners) - point;
    let mut sums = Sums { point_normal, mirrored, k, weight: 0.0, lobe: 0.0 };
    for (i, corner) in corners.iter().enumerate() {
        let next = corners[(i + 1) % corners.len()];
        sums.add([centre, *corner - point, next - point], 0);
    }
    // Without a sample above the horizon the patch gives almost no light.
    if sums.weight > 0.0 { sums.lobe / sums.weight } else { cos_power(k, mirrored.dot(centre.normalize_or_zero())) }
}

fn middle(corners: &[DVec3]) -> DVec3 {
    corners.iter().sum::<DVec3>() / corners.len() as f64
}

/// Sums over sample points of a patch.
struct Sums {
    point_normal: DVec3,
    mirrored: DVec3,
    k: f64,
    weight: f64,
    lobe: f64,
}

/// Largest subdivision depth; each level splits a triangle into four.
const DEEPEST: usize = 9;

impl Sums {
    /// Whether lobe or irradiance vary by more than about `change` over a patch of squared size `size2` at squared
    /// distance `d2`. The second derivative of `cos^k` is `k (k tan^2 - 1)` times its value.
    fn is_large(&self, size2: f64, d2: f64, cosine: f64, change: f64) -> bool {
        let c2 = cosine.max(0.1).powi(2);
        let bend = 3.0 + self.k * (1.0 + self.k * (1.0 - c2).max(0.0) / c2);
        size2 * bend > change * d2 && !self.is_dark(size2, d2, cosine)
    }

    /// Whether the lobe is almost 0 on the whole patch, and the patch small enough to tell.
    fn is_dark(&self, size2: f64, d2: f64, cosine: f64) -> bool {
        let angle = (size2 / d2).sqrt();
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let nearest = if cosine > 0.0 && sine < angle { 1.0 } else { cosine + sine * angle };
        angle < 0.5 && cos_power(self.k, nearest) < 1e-6
    }

    /// Adds a triangle, relative to the point.
    fn add(&mut self, [a, b, c]: [DVec3; 3], depth: usize) {
        let middle = (a + b + c) / 3.0;
        let d2 = middle.length_squared();
        let size2 = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        let cosine = self.mirrored.dot(middle) / d2.sqrt().max(f64::MIN_POSITIVE);
        if depth < DEEPEST && self.is_large(size2, d2, cosine, 0.3) {
            let [ab, bc, ca] = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)];
            for triangle in [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]] {
                self.add(triangle, depth + 1);
            }
            return;
        }
        let area = (b - a).cross(c - a).length();
        for corner in [a, b, c] {
            let sample = 0.5 * (middle + corner);
            let d2 = sample.length_squared();
            // The cosine at the patch is its plane's distance divided by d: constant, except for d.
            let weight = area * self.point_normal.dot(sample).max(0.0) / (d2 * d2);
            if weight > 0.0 {
                self.weight += weight;
                self.lobe += weight * cos_power(self.k, self.mirrored.dot(sample) / d2.sqrt());
            }
        }
    }
}
