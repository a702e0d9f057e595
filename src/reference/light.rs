//! Stage 2, direct light: punctual lights of KHR_lights_punctual, unshadowed. METHOD 1-2.

use glam::{DMat3, DVec3};

use crate::scene::{Light, LightKind};

/// Intensity \[cd\] of `light` in the unit direction `direction`, which points away from the light. For directional
/// lights: illuminance \[lx\] on a plane perpendicular to them, whatever `direction` is.
pub fn intensity(light: &Light, direction: DVec3) -> DVec3 {
    let full = light.color.as_dvec3() * f64::from(light.intensity);
    match light.kind {
        LightKind::Directional | LightKind::Point => full,
        LightKind::Spot { inner, outer } => {
            full * spot_falloff(inner.into(), outer.into(), shine(light).dot(direction))
        }
    }
}

/// Cone of KHR_lights_punctual: 1 inside the half angle `inner`, 0 outside `outer` \[rad\], a squared ramp in the
/// cosine `cos` between. The ramp is at least 0.001 wide, which avoids division by zero at hard edges.
pub fn spot_falloff(inner: f64, outer: f64, cos: f64) -> f64 {
    let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
    let offset = -outer.cos() * scale;
    (cos * scale + offset).clamp(0.0, 1.0).powi(2)
}

/// Factor on the intensity of a small emissive body in the unit direction `d`: an ellipsoid whose squared silhouette is
/// `d.q d`, of which a part may be missing; `lean` points to the side that shines more. METHOD 2.
pub fn body_falloff(d: DVec3, q: DMat3, lean: DVec3) -> f64 {
    (d.dot(q * d).max(0.0).sqrt() + lean.dot(d)).max(0.0)
}

/// Window of KHR_lights_punctual that fades light to zero at `range` \[m\]: `max(min(1 - (d/r)^4, 1), 0)`.
pub fn range_window(distance: f64, range: Option<f32>) -> f64 {
    range.map_or(1.0, |range| (1.0 - (distance / f64::from(range)).powi(4)).clamp(0.0, 1.0))
}

/// Unoccluded irradiance \[lx\] from `light` on a plane at `point` that faces it, and the unit direction to the light.
/// This is the `E` of eq. 5.9, without the receiver's cosine.
pub fn facing_irradiance(light: &Light, point: DVec3) -> (DVec3, DVec3) {
    if light.kind == LightKind::Directional {
        return (intensity(light, shine(light)), -shine(light));
    }
    let offset = light.position - point;
    let d2 = offset.length_squared();
    if d2 == 0.0 {
        return (DVec3::ZERO, DVec3::ZERO);
    }
    let to_light = offset / d2.sqrt();
    (intensity(light, -to_light) * range_window(d2.sqrt(), light.range) / d2, to_light)
}

/// Unoccluded irradiance \[lx\] from `light` at `point` with unit `normal`.
pub fn direct_irradiance(light: &Light, point: DVec3, normal: DVec3) -> DVec3 {
    let (facing, to_light) = facing_irradiance(light, point);
    facing * normal.dot(to_light).max(0.0)
}

/// Unit direction of the light's axis in f64; f32 unit vectors are unit only to 1e-7.
pub fn shine(light: &Light) -> DVec3 {
    light.direction.as_dvec3().normalize()
}
