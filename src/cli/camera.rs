//! The camera of a picture: one of the scene, or one given by position and target.

use anyhow::{Context, Result, bail};
use glam::{DAffine3, DMat3, DVec3};
use lightskin::scene::{Camera, Projection, Scene};

/// The camera that `--camera` requests, or the first of the scene.
pub(super) fn camera(scene: &Scene, wanted: Option<&str>) -> Result<Camera> {
    let names = || {
        let all: Vec<_> = scene.cameras.iter().enumerate().map(|(i, c)| format!("{i} '{}'", c.name)).collect();
        all.join(", ")
    };
    let Some(wanted) = wanted else {
        return scene.cameras.first().cloned().context("the scene has no camera");
    };
    if wanted.contains(';') {
        return free_camera(wanted);
    }
    let found = match wanted.parse::<usize>() {
        Ok(index) => scene.cameras.get(index),
        Err(_) => scene.cameras.iter().find(|c| c.name == wanted),
    };
    found.cloned().with_context(|| format!("--camera {wanted}: the scene has no such camera; it has {}", names()))
}

/// Checks the value of `--camera`: a name, an index, or a valid "eye;target;up;fov".
pub(crate) fn readable(text: &str) -> std::result::Result<String, String> {
    if text.contains(';') {
        free_camera(text).map_err(|error| format!("{error:#}"))?;
    }
    Ok(text.to_owned())
}

/// Makes a camera from "eye;target;up;fov".
fn free_camera(text: &str) -> Result<Camera> {
    let ([eye, target, up], fov) = parts(text)?;
    look_at(eye, target, up, fov).context("eye and target coincide, or up points along the view")
}

/// Parses "eye;target;up;fov" to eye, target and up, and the vertical field of view [degrees].
pub(crate) fn parts(text: &str) -> Result<([DVec3; 3], f32)> {
    let form = || "needs 'eye;target;up;fov' like '0,1,4;0,1,0;0,1,0;40'";
    let parts: Vec<&str> = text.split(';').collect();
    let [eye, target, up, fov] = parts[..] else { bail!(form()) };
    let vector = |text: &str| -> Result<DVec3> {
        let numbers: Vec<f64> =
            text.split(',').map(|n| n.trim().parse()).collect::<std::result::Result<_, _>>().with_context(form)?;
        match numbers[..] {
            [x, y, z] if DVec3::new(x, y, z).is_finite() => Ok(DVec3::new(x, y, z)),
            _ => bail!(form()),
        }
    };
    let (eye, target, up) = (vector(eye)?, vector(target)?, vector(up)?);
    let fov: f32 = fov.trim().parse().with_context(form)?;
    if !(0.1..=179.0).contains(&fov) {
        bail!("the vertical field of view must be from 0.1 to 179 degrees");
    }
    Ok(([eye, target, up], fov))
}

/// A camera at `eye` that looks at `target`; `fov` is the vertical field of view [degrees]. `None` if eye and target
/// coincide, or if `up` is parallel to the view direction.
pub(crate) fn look_at(eye: DVec3, target: DVec3, up: DVec3, fov: f32) -> Option<Camera> {
    let backward = (eye - target).normalize_or_zero();
    let right = up.cross(backward).normalize_or_zero();
    if right == DVec3::ZERO {
        return None;
    }
    let world_from_camera =
        DAffine3::from_mat3_translation(DMat3::from_cols(right, backward.cross(right), backward), eye);
    Some(Camera {
        name: "--camera".into(),
        world_from_camera,
        projection: Projection::Perspective { yfov: fov.to_radians() },
    })
}
