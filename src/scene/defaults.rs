//! Adds a camera, light and a ground to scenes that lack them. Rays tell an object from a room and find what a camera
//! would show. All sizes scale with the scene: files are in metres, millimetres or arbitrary units.

mod space;
mod view;

use super::rays::Hit;
use super::sky::Sky;
use super::studio::{self, Backdrop};
use super::{Camera, Light, LightKind, Projection, Scene};
use glam::{DVec3, Vec3};
use space::Space;

/// Illuminance \[lx\] of the sun through the open top of a room, and of a lamp on the floor below it.
const SUN: f64 = 1e5;
const LAMP: f64 = 500.0;

/// Wanted share of the picture in sunlight, and offset \[radii\] of the shadow rays from a surface.
const PATCH: f64 = 0.08;
const SLACK: f64 = 1e-4;

/// A lamp has enough clearance if nothing is nearer than this share of the scene's radius.
const FREE: f64 = 0.03;

/// A room counts as open at the top if at least this share of upward directions leads out.
const OPEN: f64 = 0.1;

/// Distance of an added ground below the object, as a share of the scene's radius, so that they do not share a plane.
const GAP: f64 = 5e-4;

/// Whether a scene gets a ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Ground {
    /// Under an object that has neither a light nor a floor.
    #[default]
    Auto,
    /// Never.
    Off,
    /// At this height \[m\].
    At(f64),
}

/// Adds what a scene lacks and notes each addition: a camera; light, if the scene has no punctual light, except in a
/// room with emissive surfaces; and the requested ground. Scenes without triangles stay unchanged.
pub fn complete(scene: &mut Scene, ground: Ground) {
    let wanted = matches!(ground, Ground::At(_));
    if !scene.cameras.is_empty() && !scene.lights.is_empty() && !wanted {
        return;
    }
    let Some(space) = Space::new(scene) else { return };
    let view = view::find(&space);
    if scene.cameras.is_empty() {
        let camera = view.camera;
        scene.notes.push(describe_camera(&camera));
        scene.cameras.push(camera);
    }
    let dark = scene.lights.is_empty();
    let inside = view.of_room;
    let height = match ground {
        Ground::At(height) => Some(height),
        Ground::Auto if dark && !inside && !space.has_floor() => Some(space.low.y - GAP * space.radius()),
        _ => None,
    };
    if let Some(height) = height {
        studio::put_ground(scene, space.centre(), space.radius(), height);
        scene.notes.push(format!("Added a ground at a height of {height:.4} m; --ground off leaves it out."));
    }
    match () {
        () if !dark => {}
        () if inside && scene.emits() => scene.notes.push("The scene's only light is its emissive surfaces.".into()),
        () if inside && space.openness(DVec3::Y) >= OPEN => put_day_over(scene, &space),
        () if inside => {
            let lamp = lamp(&space);
            let (at, intensity) = (format_point(lamp.position), lamp.intensity);
            scene.notes.push(format!("The scene has no lights: added a lamp of {intensity} cd at {at}."));
            scene.lights.push(lamp);
        }
        () => {
            let viewer = scene.cameras[0].world_from_camera;
            let towards = viewer.translation - space.centre();
            // For a camera that looks straight down, the lower edge of the picture is the front.
            let viewer =
                if towards.x.hypot(towards.z) > 1e-3 * towards.length() { towards } else { -viewer.matrix3.y_axis };
            Sky::studio(viewer, height.is_some()).put_over(scene, studio::LIGHTS);
            if let (Some(_), Some(sky)) = (height, &mut scene.sky) {
                // Rays past the edge of the ground meet more ground. No light has to represent that.
                sky.continue_ground();
            }
            scene.backdrop = Backdrop::Studio;
            scene.notes.push("The scene has no lights: added the soft light of a studio.".into());
        }
    }
}

/// Adds a sun that shines through the open top of a room, and a sky around it.
fn put_day_over(scene: &mut Scene, space: &Space) {
    let towards = |tilt: f64, turn: f64| {
        let (tilt, turn) = (tilt.to_radians(), turn.to_radians());
        DVec3::new(tilt.sin() * turn.sin(), tilt.cos(), tilt.sin() * turn.cos())
    };
    let suns = (0..12).flat_map(|turn| [20.0, 35.0, 50.0].map(|tilt| towards(tilt, 15.0 + 30.0 * f64::from(turn))));
    let shown = view::shown(space, &scene.cameras[0]);
    let reaches = |place: DVec3, sun: DVec3| space.rays.nearest(place, sun).is_none();
    // The sun must shine into the room, and the lit patch should neither fill the picture nor be missing.
    let unlike = |sun: DVec3| {
        let comes_in = space.free.iter().any(|place| reaches(place.position, sun));
        let lit = |(place, hit): &&(DVec3, Hit)| {
            hit.normal.dot(sun) > 0.0 && reaches(*place + SLACK * space.radius() * hit.normal, sun)
        };
        let lit = shown.iter().filter(lit).count() as f64 / shown.len().max(1) as f64;
        if comes_in { (lit - PATCH).abs() } else { 1.0 }
    };
    let judged = suns.map(|sun| (unlike(sun), sun)).min_by(|a, b| a.0.total_cmp(&b.0));
    let sun = judged.map_or(DVec3::Y, |(_, sun)| sun);
    scene.lights.push(Light {
        name: "added: sun".into(),
        kind: LightKind::Directional,
        intensity: SUN as f32,
        radius: Light::SUN_RADIUS,
        position: space.centre() + space.radius() * sun,
        direction: -sun.as_vec3(),
        ..white()
    });
    Sky::day().put_over(scene, studio::LIGHTS / 2);
    let from = format_point(sun);
    scene.notes.push(format!(
        "The scene has no lights: added a sky, and a sun of {SUN} lx that shines from {from} through the open top."
    ));
}

/// A lamp below the ceiling, in free space.
fn lamp(space: &Space) -> Light {
    let reach = |origin: DVec3, direction: DVec3, most: f64| {
        space.rays.nearest(origin, direction).map_or(most, |hit| hit.distance.min(most))
    };
    let mut best: Option<(f64, DVec3, f64)> = None;
    for place in &space.free {
        let up = reach(place.position, DVec3::Y, space.high.y - place.position.y);
        let down = reach(place.position, DVec3::NEG_Y, place.position.y - space.low.y);
        for share in [0.8, 0.6, 0.4, 0.0] {
            let position = place.position + share * up * DVec3::Y;
            let (clearance, free) = space.clearance(position);
            // The first place with enough clearance is near the middle.
            let clearance = clearance.min(FREE * space.radius());
            if free && best.is_none_or(|(most, ..)| clearance > most) {
                best = Some((clearance, position, down + share * up));
            }
        }
    }
    let (_, position, height) = best.unwrap_or((0.0, space.centre(), space.radius()));
    Light {
        name: "added: lamp".into(),
        kind: LightKind::Point,
        intensity: (LAMP * height * height) as f32,
        position,
        ..white()
    }
}

fn white() -> Light {
    Light {
        name: String::new(),
        kind: LightKind::Point,
        color: Vec3::ONE,
        intensity: 0.0,
        range: None,
        radius: 0.0,
        position: DVec3::ZERO,
        direction: Vec3::NEG_Y,
    }
}

fn format_point(v: DVec3) -> String {
    format!("({:.4}, {:.4}, {:.4})", v.x, v.y, v.z)
}

fn describe_camera(camera: &Camera) -> String {
    let (eye, back) = (camera.world_from_camera.translation, camera.world_from_camera.matrix3.z_axis);
    let yfov = match camera.projection {
        Projection::Perspective { yfov } => f64::from(yfov).to_degrees(),
        Projection::Orthographic { .. } => 0.0,
    };
    let (eye, view) = (format_point(eye), format_point(-back));
    format!(
        "No camera in the scene; {} from {eye} along {view}, vertical field of view {yfov:.0} degrees.",
        camera.name
    )
}
