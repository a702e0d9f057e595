//! A grid of spheres: roughness by metallic.

use crate::scene::build::{add_material, add_mesh, camera, place, rough, sphere};
use crate::scene::{Light, LightKind, Scene};
use glam::{DAffine3, DVec3, Vec3};

/// Six spheres of 1 m in a row with roughness 0 to 1 in steps of 1/5, and the same as metals above, under a sun of 1000
/// lx from the upper left behind the viewer.
pub fn spheres() -> Scene {
    let mut scene = Scene { name: "spheres".into(), ..Scene::default() };
    for (row, (color, metallic)) in [([0.6, 0.1, 0.08], 0.0), ([0.95, 0.72, 0.4], 1.0)].into_iter().enumerate() {
        for column in 0..6_u8 {
            let name = format!("metallic {metallic}, roughness {:.1}", f32::from(column) / 5.0);
            let material = rough(&name, color, metallic, f32::from(column) / 5.0);
            let material = add_material(&mut scene, material);
            let mesh = add_mesh(&mut scene, &name, vec![(sphere(0.5, 96), material)]);
            let at = DVec3::new(1.15 * (f64::from(column) - 2.5), 1.15 * (row as f64 - 0.5), 0.0);
            place(&mut scene, &name, mesh, DAffine3::from_translation(at));
        }
    }
    scene.lights.push(Light {
        name: "sun".into(),
        kind: LightKind::Directional,
        color: Vec3::ONE,
        intensity: 1000.0,
        range: None,
        radius: 0.0,
        position: DVec3::ZERO,
        direction: Vec3::new(0.5, -0.6, -1.0).normalize(),
    });
    scene.cameras.push(camera("front", DVec3::new(0.0, 0.0, 11.0), DVec3::ZERO, 0.23));
    scene
}
