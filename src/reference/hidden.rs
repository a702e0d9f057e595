//! Caches that nothing lights and no eye sees, stage 3. METHOD 8.

use super::depth_image::tangents;
use super::world::{Sides, World};
use glam::DVec3;

/// Number of cosine-distributed rays above a cache, of `rays`, that end in the open: on nothing, or on the front of a
/// surface farther away than `gap` \[m\]. Rays start `lift` \[m\] above the cache. A cache with at most one is hidden.
pub fn open_rays(world: &World<'_>, (position, normal): (DVec3, DVec3), rays: u32, [lift, gap]: [f64; 2]) -> u32 {
    let [right, up] = tangents(normal);
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let is_open = |i: u32| {
        let square = (f64::from(i) + 0.5) / f64::from(rays);
        let (sine, cosine) = (f64::from(i) * golden).sin_cos();
        let direction = square.sqrt() * (cosine * right + sine * up) + (1.0 - square).sqrt() * normal;
        let hit = world.nearest(position + lift * normal, direction, Sides::Both);
        hit.is_none_or(|hit| hit.front && hit.distance > gap) // two-sided surfaces have fronts on both sides
    };
    (0..rays).map(|i| u32::from(is_open(i))).sum()
}
