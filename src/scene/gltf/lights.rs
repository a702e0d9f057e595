//! Cameras and lights.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use glam::{DAffine3, Vec3};

use super::Notes;
use crate::Result;
use crate::scene::animation::{beam, rigid};
use crate::scene::json::Object;
use crate::scene::{Camera, Light, LightKind, Projection};

pub(super) fn read_camera(object: &Object, name: String, world: DAffine3, notes: &mut Notes) -> Result<Camera> {
    let needed =
        |key: &str| object.object(key)?.ok_or_else(|| object.error(format!("has no {key}: export the file again")));
    let projection = match object.text("type")? {
        Some("perspective") => {
            let perspective = needed("perspective")?;
            let yfov =
                perspective.number("yfov")?.ok_or_else(|| perspective.error("has no yfov: export the file again"))?;
            if !(yfov > 0.0 && yfov < PI) {
                return Err(perspective.error(format!("yfov is {yfov}; it must be between 0 and pi radians")));
            }
            Projection::Perspective { yfov: yfov as f32 }
        }
        Some("orthographic") => {
            let orthographic = needed("orthographic")?;
            let ymag =
                orthographic.number("ymag")?.ok_or_else(|| orthographic.error("has no ymag: export the file again"))?;
            if ymag == 0.0 {
                return Err(orthographic.error("ymag is 0, so the picture has no height: export the file again"));
            }
            if ymag < 0.0 {
                notes.add(format!("{}: ymag is {ymag}, its sign is ignored.", orthographic.place));
            }
            Projection::Orthographic { ymag: ymag.abs() as f32 }
        }
        _ => return Err(object.error("its type is neither perspective nor orthographic: export the file again")),
    };
    Ok(Camera { name, world_from_camera: rigid(world), projection })
}

pub(super) fn read_light(object: &Object, name: String, world: DAffine3, notes: &mut Notes) -> Result<Light> {
    let mut at_least_zero = |key: &str, value: f64| {
        let used = value.clamp(0.0, Light::BRIGHTEST);
        if used != value {
            notes.add(format!("{}: {key} is {value}, taken as {used}.", object.place));
        }
        used as f32
    };
    let color = object.vector::<3>("color")?.unwrap_or([1.0; 3]).map(|c| at_least_zero("color", c));
    let intensity = at_least_zero("intensity", object.number("intensity")?.unwrap_or(1.0));
    let range = object.number("range")?.map(|range| at_least_zero("range", range)).filter(|&range| range > 0.0);
    let (radius, angle) = size(object)?;
    let (radius, angle) = (at_least_zero("radius", radius), at_least_zero("angle", angle));
    let kind = match object.text("type")? {
        Some("directional") => LightKind::Directional,
        Some("point") => LightKind::Point,
        Some("spot") => {
            let spot = object.object("spot")?;
            let angle = |key: &str, default: f64| match &spot {
                Some(spot) => Ok(spot.number(key)?.unwrap_or(default)),
                None => Ok(default),
            };
            let (inner, outer) = (angle("innerConeAngle", 0.0)?, angle("outerConeAngle", FRAC_PI_4)?);
            if outer <= 0.0 {
                return Err(object.error(format!("outerConeAngle is {outer}; it must be above 0")));
            }
            // Single precision may round pi/2 up; accept that.
            let outer_used = outer.min(FRAC_PI_2);
            let inner_used = inner.clamp(0.0, outer_used);
            if outer - outer_used > 1e-6 || (inner - inner_used).abs() > 1e-6 {
                notes.add(format!(
                    "{}: cone angles {inner} and {outer} taken as {inner_used} and {outer_used}.",
                    object.place
                ));
            }
            LightKind::Spot { inner: inner_used as f32, outer: outer_used as f32 }
        }
        _ => return Err(object.error("its type is none of directional, point and spot: export the file again")),
    };
    let radius =
        if kind == LightKind::Directional { (0.5 * angle).to_radians().min(Light::WIDEST_SUN) } else { radius };
    let (position, direction) = beam(world);
    Ok(Light { name, kind, color: Vec3::from(color), intensity, range, radius, position, direction })
}

/// Radius \[m\] of a lamp and angle \[degrees\] of a sun, from `extras.lightskin`. Other extras may hold anything; only
/// the entry under our own name is checked.
fn size(object: &Object) -> Result<(f64, f64)> {
    if object.value("extras").and_then(|extras| extras.get("lightskin")).is_none() {
        return Ok((0.0, 0.0));
    }
    let own = object.object("extras")?.and_then(|extras| extras.object("lightskin").transpose()).transpose()?;
    let number = |key: &str| own.as_ref().map_or(Ok(None), |own| own.number(key));
    Ok((number("radius")?.unwrap_or(0.0), number("angle")?.unwrap_or(0.0)))
}
