//! Five scenes whose indirect light depends mostly on occlusion. Metres. In each a spot light hits one wall or floor,
//! which lights almost everything else.

use crate::scene::build::{
    CornellSurface, Surface, add_material, add_mesh, camera, cornell, cuboid, lathe, patch, phong, place, spans, sphere,
};
use crate::scene::{Light, LightKind, Scene};
use glam::{Affine3A, DAffine3, DVec3, Quat, Vec2, Vec3};
use std::f32::consts::TAU;

/// A scene in which indirect light is shadowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shadowed {
    /// The diffuse Cornell box.
    Cornell,
    /// A ball above a floor, next to a lit wall.
    Ball,
    /// Two rooms with a gap between them and a light in one.
    Gap,
    /// A row of columns on a glossy floor, in front of a lit wall.
    Columns,
    /// Thin bones, a few centimetres thick, in front of a lit wall.
    Skeleton,
}

impl Shadowed {
    /// All scenes.
    pub const ALL: [Self; 5] = [Self::Cornell, Self::Ball, Self::Gap, Self::Columns, Self::Skeleton];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cornell => "cornell",
            Self::Ball => "ball",
            Self::Gap => "gap",
            Self::Columns => "columns",
            Self::Skeleton => "skeleton",
        }
    }

    /// The scene, with one camera.
    pub fn scene(self) -> Scene {
        let mut scene = match self {
            Self::Cornell => cornell(CornellSurface::Diffuse, 0.05),
            Self::Ball => ball(),
            Self::Gap => gap(),
            Self::Columns => columns(),
            Self::Skeleton => skeleton(),
        };
        scene.name = self.name().into();
        scene
    }
}

/// Longest edge of walls and floors \[m\].
pub(super) const EDGE: f32 = 0.1;

fn ball() -> Scene {
    let (low, high) = (Vec3::new(-1.5, 0.0, -1.5), Vec3::new(1.5, 2.4, 1.5));
    let mut scene = room(low, high, [0.0; 3]);
    let grey = add_material(&mut scene, phong("ball", [0.6; 3], [0.0; 3], 1.0));
    add(&mut scene, "ball", sphere(0.45, 20).shifted(-0.1, 0.6, 0.0), grey);
    spot(&mut scene, [-0.7, 2.2, 0.0], [-1.5, 1.1, 0.0], [12.0, 20.0]);
    scene.cameras.push(camera("inside", DVec3::new(0.9, 1.9, 1.4), DVec3::new(0.2, 0.4, -0.1), 1.05));
    scene
}

fn gap() -> Scene {
    let (low, high) = (Vec3::new(-2.0, 0.0, -1.4), Vec3::new(2.0, 2.4, 1.4));
    let mut scene = room(low, high, [0.0; 3]);
    let grey = add_material(&mut scene, phong("partition", [0.7; 3], [0.0; 3], 1.0));
    // Faces that touch the room's own are left out: no light reaches them.
    for (name, from, to) in [("left of the gap", -1.4, -0.35), ("right of the gap", 0.35, 1.4)] {
        let hidden = if from < -1.0 { Vec3::NEG_Z } else { Vec3::Z };
        let wall = cuboid(Vec3::new(-0.1, 0.0, from), Vec3::new(0.1, 2.4, to), EDGE, |n| n.y == 0.0 && n != hidden);
        add(&mut scene, name, wall, grey);
    }
    spot(&mut scene, [-0.7, 2.2, 0.5], [-2.0, 1.0, -0.2], [30.0, 42.0]);
    scene.cameras.push(camera("dark room", DVec3::new(1.85, 1.7, 1.25), DVec3::new(0.2, 0.75, -0.35), 1.2));
    scene
}

fn columns() -> Scene {
    let (low, high) = (Vec3::new(-2.0, 0.0, -1.6), Vec3::new(2.0, 2.2, 1.8));
    let mut scene = room(low, high, [0.25; 3]);
    let stone = add_material(&mut scene, phong("column", [0.65, 0.6, 0.5], [0.0; 3], 1.0));
    for i in 0..6 {
        let x = 0.6 * i as f32 - 1.5;
        add(&mut scene, "column", rod(0.13, 2.2, 20, EDGE).shifted(x, 0.0, -0.3), stone);
    }
    spot(&mut scene, [0.0, 2.1, -0.55], [0.0, 0.9, -1.6], [45.0, 58.0]);
    scene.cameras.push(camera("hall", DVec3::new(0.9, 1.75, 1.7), DVec3::new(-0.15, 0.45, -0.2), 1.05));
    scene
}

fn skeleton() -> Scene {
    let (low, high) = (Vec3::new(-1.3, 0.0, -1.5), Vec3::new(1.3, 2.2, 0.7));
    let mut scene = room(low, high, [0.0; 3]);
    let bone = add_material(&mut scene, phong("bone", [0.75, 0.7, 0.6], [0.0; 3], 1.0));
    let mut bones = sphere(0.1, 12).shifted(0.0, 1.62, 0.0);
    let mut add_bone = |from: [f32; 3], to: [f32; 3], radius: f32| {
        bones = std::mem::take(&mut bones).and(between(from.into(), to.into(), radius));
    };
    add_bone([0.0, 0.92, -0.08], [0.0, 1.55, -0.05], 0.025);
    add_bone([-0.2, 1.42, -0.03], [0.2, 1.42, -0.03], 0.015);
    for side in [-1.0, 1.0] {
        add_bone([0.12 * side, 0.92, -0.02], [0.14 * side, 0.48, 0.02], 0.025);
        add_bone([0.14 * side, 0.48, 0.02], [0.14 * side, 0.06, -0.02], 0.018);
        add_bone([0.21 * side, 1.42, -0.03], [0.3 * side, 1.12, -0.03], 0.02);
        add_bone([0.3 * side, 1.12, -0.03], [0.42 * side, 0.86, 0.1], 0.015);
    }
    for i in 0..7 {
        let way = i as f32 / 6.0;
        let wide = 0.13 + 0.05 * (1.0 - (2.0 * way - 1.0).powi(2));
        bones = bones.and(rib(wide, 0.11, 0.012).shifted(0.0, 1.06 + 0.28 * way, 0.02));
    }
    let pelvis = cuboid(Vec3::new(-0.15, 0.9, -0.07), Vec3::new(0.15, 0.98, 0.03), 0.05, |_| true);
    let feet = [-0.14, 0.14]
        .map(|x| cuboid(Vec3::new(x - 0.04, 0.0, -0.06), Vec3::new(x + 0.04, 0.05, 0.16), 0.05, |n| n != Vec3::NEG_Y));
    let all = feet.into_iter().fold(bones.and(pelvis), Surface::and);
    add(&mut scene, "skeleton", all, bone);
    spot(&mut scene, [0.0, 2.1, -0.8], [0.0, 1.2, -1.5], [12.0, 20.0]);
    scene.cameras.push(camera("behind", DVec3::new(-1.1, 1.6, -1.3), DVec3::new(0.15, 0.8, 0.4), 1.05));
    scene
}

/// A closed room seen from inside: grey, with a warm wall at low x, a cool one at low z, and a glossy lobe on the
/// floor.
pub(super) fn room(low: Vec3, high: Vec3, floor: [f32; 3]) -> Scene {
    let mut scene = Scene::default();
    let paints = [
        phong("wall", [0.7; 3], [0.0; 3], 1.0),
        phong("warm wall", [0.75, 0.5, 0.35], [0.0; 3], 1.0),
        phong("cool wall", [0.45, 0.6, 0.75], [0.0; 3], 1.0),
        phong("floor", [0.6; 3], floor, 30.0),
    ];
    let faces: [fn(Vec3) -> bool; 4] =
        [|n| n.x > 0.0 || n.y > 0.0 || n.z > 0.0, |n| n.x < 0.0, |n| n.z < 0.0, |n| n.y < 0.0];
    let parts = paints
        .into_iter()
        .zip(faces)
        .map(|(paint, keep)| (cuboid(low, high, EDGE, keep).reversed(), add_material(&mut scene, paint)));
    let parts = parts.collect();
    let mesh = add_mesh(&mut scene, "room", parts);
    place(&mut scene, "room", mesh, DAffine3::IDENTITY);
    scene
}

pub(super) fn add(scene: &mut Scene, name: &str, surface: Surface, material: usize) {
    let mesh = add_mesh(scene, name, vec![(surface, material)]);
    place(scene, name, mesh, DAffine3::IDENTITY);
}

/// A spot light of 500 cd; cone angles in degrees.
pub(super) fn spot(scene: &mut Scene, position: [f64; 3], target: [f64; 3], [inner, outer]: [f32; 2]) {
    let (position, target) = (DVec3::from(position), DVec3::from(target));
    scene.lights.push(Light {
        name: "spot".into(),
        kind: LightKind::Spot { inner: inner.to_radians(), outer: outer.to_radians() },
        color: Vec3::ONE,
        intensity: 500.0,
        range: None,
        radius: 0.0,
        position,
        direction: (target - position).as_vec3().normalize(),
    });
}

/// A closed cylinder along +Y from the origin.
pub(super) fn rod(radius: f32, length: f32, sides: usize, edge: f32) -> Surface {
    let heights = spans(&[0.0, length], edge);
    let mut profile = vec![Vec2::ZERO];
    profile.extend(heights.into_iter().map(|height| Vec2::new(radius, height)));
    profile.push(Vec2::new(0.0, length));
    lathe(&profile, sides)
}

/// A closed cylinder between two points.
fn between(from: Vec3, to: Vec3, radius: f32) -> Surface {
    let turn = Quat::from_rotation_arc(Vec3::Y, (to - from).normalize());
    rod(radius, from.distance(to), 8, 0.04).moved(Affine3A::from_rotation_translation(turn, from))
}

/// A horizontal ring of tube with half axes `wide` and `deep`.
fn rib(wide: f32, deep: f32, tube: f32) -> Surface {
    let (around, along) = (6, 28);
    patch([around, along], [true; 2], |column, row| {
        let (sine, cosine) = (TAU * row as f32 / along as f32).sin_cos();
        let outward = Vec3::new(cosine / wide, 0.0, sine / deep).normalize();
        let (up, out) = (TAU * column as f32 / around as f32).sin_cos();
        let normal = outward * out + Vec3::Y * up;
        (Vec3::new(wide * cosine, 0.0, deep * sine) + tube * normal, normal)
    })
}
