//! Light that has passed through a body: random walks from the visible surface to the point where light enters.
//! METHOD 7.
//!
//! A walk starts in the refracted direction of the camera's ray; every boundary that it meets reflects by Fresnel.
//! Where it leaves the body, light from each direction counts by its Fresnel transmittance and continues inside as
//! uniform light would. Otherwise no walk could find a light without a size through a smooth boundary.

use glam::{DVec2, DVec3};
use sobol_burley::sample_4d;

use super::emitters::Which;
use super::scatter::Scatter;
use super::{PathTrace, mix};
use crate::reference::volume::{Volume, refracted, walk};
use crate::reference::world::{Sides, Surface};
use crate::scene::medium::fresnel;

impl PathTrace<'_> {
    /// Whether a surface seen by the camera needs light from inside.
    pub(super) fn looks_inside(&self, surface: &Surface) -> bool {
        surface.inside.is_some() && self.settings.visibility
    }

    /// Scattering at the surface itself, as seen by the camera.
    pub(super) fn scatter(&self, surface: &Surface, direction: DVec3) -> Scatter {
        let scatter = Scatter::new(surface, direction);
        if self.looks_inside(surface) { scatter.on_the_surface() } else { scatter }
    }

    /// Radiance of a sample that walks below a surface hit by a ray of unit `direction`; each sample uses the
    /// coefficients of one channel.
    pub(super) fn light_inside(&self, surface: &Surface, direction: DVec3, seed: u32, sample: u32) -> DVec3 {
        let Some((instance, material)) = surface.inside else { return DVec3::ZERO };
        let Some(inside) = self.world.scene().materials[material].subsurface else { return DVec3::ZERO };
        // Pixels begin with different channels: the samples of a pass are no multiple of three.
        let channel = (seed.wrapping_add(sample) % 3) as usize;
        let volume = Volume::of(&inside, channel);
        let cosine = -surface.vertex_normal.dot(direction);
        let entered = 1.0 - fresnel(cosine.max(0.0), volume.ior);
        let seed = mix(seed ^ mix(sample ^ 0x0b5e_ed5e));
        let mut state = seed;
        let mut random = || {
            state = state.wrapping_add(0x9e37_79b9);
            f64::from(mix(state)) / (f64::from(u32::MAX) + 1.0)
        };
        let below = refracted(direction, surface.vertex_normal, volume.ior);
        // A vertex normal may imply a direction that the triangle does not allow.
        let below = if surface.geometric.dot(below) < 0.0 { below } else { direction };
        let exit = walk(&volume, surface.position, below, &mut random, |position, direction| {
            let hit = self.world.nearest(position, direction, Sides::Any)?;
            (hit.instance == instance).then(|| {
                let met = self.world.surface(&hit);
                (hit.distance, -met.geometric, met)
            })
        });
        let Some(exit) = exit else { return DVec3::ZERO };
        let outside = exit.surface.turned();
        let at = Scatter::entering(&outside, inside.medium());
        let [x, y, ..] = sample_4d(sample % super::SEQUENCE, 5, seed).map(f64::from);
        let reflected = |towards| at.reflected(towards);
        let (which, u) = ((None, Which::All), DVec2::new(x, y));
        let lamps = self.emitters.direct(&self.world, at.position, at.geometric, which, u, reflected).0;
        let mut indirect = DVec3::ZERO;
        let direct = self.path(at, seed, sample % super::SEQUENCE, &mut indirect);
        let mut channels = DVec3::ZERO;
        channels[channel] = 3.0 * entered;
        channels * (lamps + direct + indirect)
    }
}
