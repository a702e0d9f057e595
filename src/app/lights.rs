//! Adding, removing and naming lights in the window.

use super::document::Document;
use crate::cli::lights::{dark, direction};
use glam::DVec3;
use lightskin::frame::Engine;
use lightskin::gpu::Gpu;
use lightskin::scene::{Light, LightKind};

impl Document {
    /// Adds a light of this kind in front of what the middle of the picture shows, and makes it as bright as the exposure
    /// suggests: a white surface there has the luminance that becomes white.
    pub(super) fn add_light(&mut self, gpu: &Gpu, kind: LightKind) {
        let Some(camera) = self.camera() else { return };
        let eye = camera.world_from_camera.translation;
        let forward = -camera.world_from_camera.matrix3.z_axis.normalize_or(DVec3::Z);
        let surface = self.surface_at(gpu, [0.5, 0.5]).map(|(_, point)| point);
        let on = surface.unwrap_or(eye + self.radius() * forward);
        // Above the view's axis, so that the handle of a spot does not lie behind the light itself.
        let position = on.lerp(eye, 0.35)
            + 0.1 * on.distance(eye) * camera.world_from_camera.matrix3.y_axis.normalize_or(DVec3::Y);
        let sun = direction([45.0, 50.0]);
        let illuminance = std::f64::consts::PI * 1.2 * f64::from(self.ev(gpu)).exp2();
        let (intensity, direction) = match kind {
            LightKind::Directional => (illuminance, -sun),
            _ => (illuminance * position.distance_squared(on), (on - position).normalize_or(DVec3::NEG_Y).as_vec3()),
        };
        let intensity = (intensity as f32).clamp(0.0, 1e9);
        self.lights.add(Light { intensity, position, direction, ..dark(kind) });
        self.light(gpu);
    }

    /// Removes the chosen light, if the user has added it.
    pub(super) fn remove_light(&mut self, gpu: &Gpu) {
        if self.lights.remove_chosen() {
            self.gizmo.clear();
            self.light(gpu);
        }
    }
}

/// Number, from 1, and name of one of `World::lights`.
pub(super) fn light_name(engine: &Engine, index: usize) -> String {
    let name = match engine.scene().lights.get(index) {
        Some(light) if light.name.is_empty() => match light.kind {
            LightKind::Directional => "sun",
            LightKind::Point => "point",
            LightKind::Spot { .. } => "spot",
        },
        Some(light) => &light.name,
        None => "emissive surface",
    };
    format!("{} {name}", index + 1)
}
