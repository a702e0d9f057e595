//! What a camera ray shows: the surfaces along it, through sheets and bodies of glass. METHOD 15.

use super::PathTrace;
use crate::reference::world::{Hit, Sides, Surface};
use glam::DVec3;

/// Most surfaces along a ray, with those that it leaves a body through.
const MOST_SEEN: usize = 64;

/// A surface along a camera ray.
pub(super) struct Seen {
    pub(super) surface: Surface,
    /// Direction of the ray where it meets the surface.
    pub(super) direction: DVec3,
    /// Share of the surface's light that arrives at the camera.
    pub(super) share: DVec3,
    /// Whether light passes through it.
    pub(super) is_clear: bool,
}

/// What is behind all surfaces that a camera ray shows: its share, and the direction in which the ray leaves.
pub(super) type Left = (DVec3, DVec3);

/// A body of glass that a ray is in.
struct Body {
    material: usize,
    /// Size of its thickness in the world \[m\].
    thickness: f64,
}

impl PathTrace<'_> {
    /// Surfaces along a camera ray. A body bends it where it enters and leaves, and absorbs light on the way. All light
    /// that meets the surface of a body from inside passes, or is reflected where none can.
    pub(super) fn seen(&self, mut origin: DVec3, mut direction: DVec3) -> (Vec<Seen>, Left) {
        let (mut surfaces, mut share, mut body) = (Vec::new(), DVec3::ONE, None::<Body>);
        let materials = &self.world.scene().materials;
        for _ in 0..MOST_SEEN {
            let sides = body.as_ref().map_or(Sides::Front, |body| Sides::Within(body.material));
            let Some(hit) = self.world.nearest(origin, direction, sides) else { return (surfaces, (share, direction)) };
            let surface = self.world.surface(&hit);
            origin = surface.position;
            let inside = body.as_ref().map(|body| &materials[body.material]);
            let leaves = body.as_ref().is_some_and(|body| body.material == hit.material);
            if let (Some(body), Some(glass)) = (&body, inside) {
                // Behind a surface that has no other side, the body is as thick as the file says.
                let length = if leaves { hit.distance } else { hit.distance.min(body.thickness) };
                share *= (-glass.attenuation.as_dvec3() * length).exp();
            }
            let within = inside.map_or(1.0, |glass| f64::from(glass.ior).max(1.0));
            if leaves {
                if let Some(bent) = bent(direction, &surface, within) {
                    (direction, body) = (bent, None);
                } else {
                    direction = mirrored(direction, &surface);
                }
                continue;
            }
            let Some((own, behind, bends)) = self.world.seen_through(&hit, &surface, direction) else {
                surfaces.push(Seen { surface, direction, share, is_clear: false });
                return (surfaces, (DVec3::ZERO, direction));
            };
            surfaces.push(Seen { surface, direction, share: share * own, is_clear: true });
            share *= behind;
            if bends {
                let ratio = within / f64::from(materials[hit.material].ior).max(1.0);
                if let Some(bent) = bent(direction, &surface, ratio) {
                    (direction, body) = (bent, Some(self.body(&hit)));
                } else {
                    direction = mirrored(direction, &surface);
                }
            }
        }
        (surfaces, (DVec3::ZERO, direction))
    }

    fn body(&self, hit: &Hit) -> Body {
        let scene = self.world.scene();
        let scale = scene.instances[hit.instance].world_from_model.matrix3.determinant().abs().cbrt();
        Body { material: hit.material, thickness: scale * f64::from(scene.materials[hit.material].thickness) }
    }
}

/// Direction of light behind a surface between media with this ratio of indices; `None` if all is reflected. Where the
/// shading normal would bend it back, the triangle's normal counts.
fn bent(direction: DVec3, surface: &Surface, ratio: f64) -> Option<DVec3> {
    let by = |normal: DVec3| {
        let cosine = -direction.dot(normal);
        let left = 1.0 - ratio * ratio * (1.0 - cosine * cosine);
        (left > 0.0).then(|| (ratio * direction + (ratio * cosine - left.sqrt()) * normal).normalize())
    };
    if direction.dot(surface.normal) >= 0.0 {
        return by(surface.geometric);
    }
    let bent = by(surface.normal)?;
    if bent.dot(surface.geometric) < 0.0 { Some(bent) } else { by(surface.geometric) }
}

/// Direction of light that a surface reflects back into a body.
fn mirrored(direction: DVec3, surface: &Surface) -> DVec3 {
    let by = |normal: DVec3| direction - 2.0 * direction.dot(normal) * normal;
    let first = by(surface.normal);
    if first.dot(surface.geometric) > 0.0 { first } else { by(surface.geometric) }
}
