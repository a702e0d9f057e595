//! Leaves out emissive triangles that shine into the inside of a small closed emissive body. METHOD 2.
//!
//! Files often make closed bodies double-sided. Nobody sees their insides, but VALs there would shine out: the depth
//! images of caches cannot tell the inside of a far wall from the outside of the near wall right before it.

use super::emitters::Emitter;
use crate::scene::Scene;
use crate::scene::rays::{Rays, cosine_directions};
use glam::DVec3;
use rayon::prelude::*;

/// Number of rays from the centre of a triangle. It is enclosed if all but `ESCAPE` of them hit emissive triangles of its
/// own instance. Other surfaces do not count: one may see through a shade of glass.
const RAYS: u32 = 16;
const ESCAPE: usize = 1;

/// Length of the rays, and offset of their starts, in radii of the scene. A room is larger.
const FAR: f64 = 0.05;
const LIFT: f64 = 1e-5;

/// The triangles that are not enclosed. Triangles of an instance must be neighbours.
pub(super) fn outer<'a>(scene: &Scene, triangles: Vec<Emitter<'a>>) -> Vec<Emitter<'a>> {
    let radius = scene.bounds().map_or(0.0, |(low, high)| 0.5 * low.distance(high));
    let enclosed: Vec<bool> = triangles
        .chunk_by(|a, b| a.instance == b.instance)
        .flat_map(|body| {
            let rays = Rays::of_triangles(body.iter().map(|triangle| (triangle.corners_in_world, false)).collect());
            body.par_iter().map(|triangle| is_enclosed(&rays, triangle, radius)).collect::<Vec<_>>()
        })
        .collect();
    let count = enclosed.iter().filter(|enclosed| **enclosed).count();
    if count == 0 {
        return triangles;
    }
    log::info!("{count} of {} emissive triangles shine into closed bodies and give no light", triangles.len());
    triangles.into_iter().zip(enclosed).filter(|(_, enclosed)| !enclosed).map(|(triangle, _)| triangle).collect()
}

fn is_enclosed(rays: &Rays, triangle: &Emitter<'_>, radius: f64) -> bool {
    let normal = triangle.face.normalize_or(DVec3::Y);
    let middle = triangle.corners_in_world.iter().sum::<DVec3>() / 3.0;
    let start = middle + LIFT * radius * normal;
    let escapes = |direction: &DVec3| rays.within(start, *direction, FAR * radius).is_none();
    cosine_directions(normal, RAYS).filter(escapes).take(ESCAPE + 1).count() <= ESCAPE
}
