//! Sky light at a cache, in f64. Twin of `glsl/sky_seen.comp`. METHOD 12.

use super::depth_image::tangents;
use super::near::direction_index;
use super::world::{Sides, World};
use crate::scene::sky::Sky;
use crate::shared::{DEPTH_IMAGE_SIDE, DIRECTION_SIDE, DIRECTIONS};
use glam::{DVec2, DVec3};

/// Visibility of a sky from a cache.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Arriving light relative to an open surface, without occluders near enough for short rays.
    pub share: DVec3,
    /// Irradiance of all sky light that arrives \[lx\].
    pub irradiance: DVec3,
    /// Open share of each direction that short rays look up.
    pub open: Vec<f64>,
}

/// Traces the sky from a point `lift` \[m\] above a surface with a unit normal: one ray per texel of an image of the
/// unit disc. Occluders nearer than `reach` \[m\] do not reduce the share. `smooth` is the sky that rays look up; `sky`
/// gives the irradiance of an open surface. Light below `least` \[lx\] does not define shares.
pub fn seen(
    world: &World<'_>,
    [sky, smooth]: [&Sky; 2],
    (position, normal): (DVec3, DVec3),
    [lift, reach, least]: [f64; 3],
) -> Seen {
    let side = DEPTH_IMAGE_SIDE as usize;
    let half = side as f64 / 2.0;
    let [right, up] = tangents(normal);
    let start = position + lift * normal;
    let mut is_open = vec![false; side * side];
    let (mut open, mut lit, mut all) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    let (mut open_texels, mut texels) = (0.0, 0.0);
    for row in 0..side {
        for column in 0..side {
            let p = (DVec2::new(column as f64, row as f64) + 0.5) / half - 1.0;
            if p.length_squared() < 1.0 {
                let direction = right * p.x + up * p.y + normal * (1.0 - p.length_squared()).sqrt();
                let far = world.nearest(start + reach * direction, direction, Sides::Both).is_none();
                let near = world.blocked_within(start, direction, reach);
                let radiance = smooth.radiance(direction);
                is_open[row * side + column] = far;
                texels += 1.0;
                all += radiance;
                if far {
                    open += radiance;
                    open_texels += 1.0;
                }
                if far && !near {
                    lit += radiance;
                }
            }
        }
    }
    let least = least * texels / std::f64::consts::PI;
    let mut parts = vec![0.0; DIRECTIONS as usize];
    let fine = 2 * DIRECTION_SIDE as usize;
    for part in 0..fine * fine {
        // The octahedron |x| + |y| + |z| = 1, whose lower half is folded out around the upper one.
        let at = (DVec2::new((part % fine) as f64, (part / fine) as f64) + 0.5) * 2.0 / fine as f64 - 1.0;
        let z = 1.0 - at.x.abs() - at.y.abs();
        let side_of = |a: f64| if a < 0.0 { -1.0 } else { 1.0 };
        let on = match z < 0.0 {
            true => DVec3::new((1.0 - at.y.abs()) * side_of(at.x), (1.0 - at.x.abs()) * side_of(at.y), z),
            false => at.extend(z),
        };
        let way = on.normalize();
        // Below the horizon directions are as open as those mirrored above it, and near it as in the last whole texel.
        let p = DVec2::new(right.dot(way), up.dot(way));
        let p = (p.clamp_length_max(1.0 - 0.5_f64.sqrt() / half) * half + half).as_uvec2();
        if is_open[p.y as usize * side + p.x as usize] {
            parts[direction_index(way)] += 0.25;
        }
    }
    Seen {
        share: (open + least * open_texels / texels) / (all + least),
        irradiance: sky.received(normal) * lit / all.max(DVec3::splat(1e-37)),
        open: parts,
    }
}
