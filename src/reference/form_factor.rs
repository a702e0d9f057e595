//! Light of a VAL at a point, and the form factor between a point and a disc: closed form, and the integral to check
//! it. METHOD 2, thesis 5.2.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// Geometry term `G = cos+_l cos+_x / max(A, pi d^2)` [1/m^2] between a point and a VAL of `area` [m^2] whose centre is
/// `sqrt(d2)` \[m\] away; `cos_l` at the VAL, `cos_x` at the point.
///
/// Eq. 5.20 has `A + pi d^2`, as for a single disc. But VALs are the tiles of a surface: a point at height `h` above an
/// even surface would get, in the mean over its position, `ln(1 + a) / a` of the light, with `a = A / (pi h^2)`. With the
/// maximum it gets all of it from farther than a tile's radius, and never more than the tile's own brightness gives.
pub fn val_geometry(area: f64, cos_l: f64, cos_x: f64, d2: f64) -> f64 {
    cos_l.max(0.0) * cos_x.max(0.0) / area.max(PI * d2)
}

/// Form factor from a point to a disc, eq. 5.7: `A cos+_l cos+_x / (A + pi d^2)`; at most 1 at any distance.
///
/// Exact for points on the disc's axis that see the whole disc; an approximation elsewhere.
pub fn disc_form_factor(area: f64, cos_l: f64, cos_x: f64, d2: f64) -> f64 {
    area * cos_l.max(0.0) * cos_x.max(0.0) / (area + PI * d2)
}

/// Irradiance \[lx\] at a point from a VAL that emits `flux` \[lm\] diffusely; eq. 5.8 without its surplus `1/pi`.
pub fn val_irradiance(flux: f64, area: f64, cos_l: f64, cos_x: f64, d2: f64) -> f64 {
    flux * val_geometry(area, cos_l, cos_x, d2)
}

/// The form factor that 5.7 approximates: `integral cos+_l cos+_x / (pi d^2) dA` over the true disc about `centre`, by
/// the midpoint rule on `steps` rings of equal area with `steps` sectors each. Error of order `steps^-2`.
pub fn disc_form_factor_integral(
    area: f64,
    centre: DVec3,
    disc_normal: DVec3,
    point: DVec3,
    point_normal: DVec3,
    steps: usize,
) -> f64 {
    let (tangent, bitangent) = disc_normal.any_orthonormal_pair();
    let piece = area / (steps * steps) as f64;
    let mut sum = 0.0;
    for ring in 0..steps {
        let radius = (area / PI * (ring as f64 + 0.5) / steps as f64).sqrt();
        for sector in 0..steps {
            let (sin, cos) = (TAU * (sector as f64 + 0.5) / steps as f64).sin_cos();
            let offset = centre + radius * (cos * tangent + sin * bitangent) - point;
            let d2 = offset.length_squared();
            sum += (-disc_normal.dot(offset)).max(0.0) * point_normal.dot(offset).max(0.0) / (PI * d2 * d2) * piece;
        }
    }
    sum
}
