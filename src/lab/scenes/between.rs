//! A body between two lit walls: thesis figure 5.18.

use crate::scene::build::{add_material, add_mesh, camera, phong, place, quad, sphere};
use crate::scene::{Light, LightKind, Scene};
use glam::{DAffine3, DVec3, Vec3};

/// A ball of 0.8 m between two walls of 2 m, 2.4 m apart. Each wall is lit by a spot of 400 cd from above the ball,
/// which gets no direct light. Indirect light comes from two opposite sides; where the two meet, averaged lights lie
/// inside the ball.
///
/// `edge` \[m\]: longest side of the walls' grid cells.
pub fn between_walls(edge: f32) -> Scene {
    let mut scene = Scene { name: "between walls".into(), ..Scene::default() };
    let body = add_material(&mut scene, phong("body", [0.7; 3], [0.0; 3], 1.0));
    let wall = add_material(&mut scene, phong("wall", [0.8, 0.75, 0.7], [0.0; 3], 1.0));
    let (y, z) = (Vec3::Y * 2.0, Vec3::Z * 2.0);
    let left = quad(Vec3::new(-1.2, -1.0, -1.0), y, z, edge);
    let right = quad(Vec3::new(1.2, -1.0, -1.0), z, y, edge);
    let ball = add_mesh(&mut scene, "ball", vec![(sphere(0.4, 48), body)]);
    place(&mut scene, "ball", ball, DAffine3::IDENTITY);
    for (name, surface) in [("left wall", left), ("right wall", right)] {
        let mesh = add_mesh(&mut scene, name, vec![(surface, wall)]);
        place(&mut scene, name, mesh, DAffine3::IDENTITY);
    }
    for side in [-1.0, 1.0] {
        let (position, target) = (DVec3::new(0.0, 1.3, 0.0), DVec3::new(1.2 * side, 0.2, 0.0));
        scene.lights.push(Light {
            name: "spot".into(),
            kind: LightKind::Spot { inner: 15_f32.to_radians(), outer: 25_f32.to_radians() },
            color: Vec3::ONE,
            intensity: 400.0,
            range: None,
            radius: 0.0,
            position,
            direction: (target - position).as_vec3().normalize(),
        });
    }
    scene.cameras.push(camera("front", DVec3::new(0.0, 0.0, 3.5), DVec3::ZERO, 0.28));
    scene
}
