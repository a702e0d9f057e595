//! The 2 m Cornell box with a spot light aimed at its red wall.

use super::{add_material, add_mesh, camera, cuboid, phong, place, quad};
use crate::scene::{Light, LightKind, Material, Scene};
use glam::{DAffine3, DQuat, DVec3, Vec3};

/// Material of the Cornell box's surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CornellSurface {
    /// Diffuse only.
    Diffuse,
    /// A glossy lobe of albedo 0.2 and exponent 40 over a diffuse base that is darker by the same fifth.
    Glossy,
}

/// The Cornell box: a room of exactly 2 m, x in [-1, 1], y in [0, 2], z in [-1, 1], open towards +Z, with the two
/// classic blocks. The left wall is red, the right wall green, everything else white. A spot light of 1000 cd under the
/// ceiling is aimed at the red wall. It also reaches the tall block and the floor between, but never the green wall.
///
/// `edge` (metres) is the longest side of the grid cells of all faces. The blocks have no underside.
pub fn cornell(surface: CornellSurface, edge: f32) -> Scene {
    let mut scene = Scene { name: "cornell".into(), ..Scene::default() };
    let [white, red, green] =
        [("white", [0.73, 0.73, 0.73]), ("red", [0.63, 0.065, 0.05]), ("green", [0.14, 0.45, 0.09])]
            .map(|(name, albedo)| add_material(&mut scene, wall(surface, name, albedo)));

    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let corner = Vec3::new(-1.0, 0.0, -1.0);
    let floor = quad(corner, z, x, edge);
    let ceiling = quad(corner + y, x, z, edge);
    let back = quad(corner, x, y, edge);
    let left = quad(corner, y, z, edge);
    let right = quad(corner + x, z, y, edge);
    let shell = vec![(floor.and(ceiling).and(back), white), (left, red), (right, green)];
    let shell = add_mesh(&mut scene, "room", shell);
    place(&mut scene, "room", shell, DAffine3::IDENTITY);

    for (name, height, turn, position) in [
        ("tall block", 1.2, 18.0_f64, DVec3::new(-0.326, 0.0, -0.256)),
        ("short block", 0.6, -17.0, DVec3::new(0.333, 0.0, 0.396)),
    ] {
        let (low, high) = (Vec3::new(-0.3, 0.0, -0.3), Vec3::new(0.3, height, 0.3));
        let block = cuboid(low, high, edge, |normal| normal != Vec3::NEG_Y);
        let mesh = add_mesh(&mut scene, name, vec![(block, white)]);
        let turn = DQuat::from_rotation_y(turn.to_radians());
        place(&mut scene, name, mesh, DAffine3::from_rotation_translation(turn, position));
    }

    let (position, target) = (DVec3::new(0.4, 1.9, 0.2), DVec3::new(-1.0, 0.9, -0.1));
    scene.lights.push(Light {
        name: "spot".into(),
        kind: LightKind::Spot { inner: 20_f32.to_radians(), outer: 35_f32.to_radians() },
        color: Vec3::ONE,
        intensity: 1000.0,
        range: None,
        radius: 0.0,
        position,
        direction: (target - position).normalize().as_vec3().normalize(),
    });
    // The opening, 2 m high and 2.6 m away, fills the picture's height.
    let yfov = 2.0 * (1.0_f32 / 2.6).atan();
    scene.cameras.push(camera("front", DVec3::new(0.0, 1.0, 3.6), DVec3::new(0.0, 1.0, 0.0), yfov));
    scene
}

fn wall(surface: CornellSurface, name: &str, albedo: [f32; 3]) -> Material {
    match surface {
        CornellSurface::Diffuse => phong(name, albedo, [0.0; 3], 1.0),
        CornellSurface::Glossy => phong(name, albedo.map(|channel| 0.8 * channel), [0.2; 3], 40.0),
    }
}
