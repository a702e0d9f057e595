//! A grid of spheres: clear coats by share and roughness, sheen by colour and roughness.

use crate::scene::build::{add_material, add_mesh, camera, place, rough, sphere};
use crate::scene::{Light, LightKind, Material, Scene};
use glam::{DAffine3, DVec3, Vec3};

/// Three rows of six spheres of 1 m with a coat of roughness 0 to 1 in steps of 1/5 on a rough red body; the coat
/// covers a third, two thirds or all of it. Below are three rows of cloth with sheen of the same roughnesses: white,
/// red on black, and blue on orange. A lamp of 20 000 cd lights them from the upper left behind the viewer.
pub fn coats() -> Scene {
    let mut scene = Scene { name: "coats".into(), ..Scene::default() };
    for row in 0..6_u8 {
        for column in 0..6_u8 {
            let roughness = f32::from(column) / 5.0;
            let (name, material) = if row < 3 {
                let share = f32::from(row + 1) / 3.0;
                let name = format!("coat {share:.2}, roughness {roughness:.1}");
                let body = rough(&name, [0.6, 0.05, 0.04], 0.0, 0.7);
                (name, Material { coat: share, coat_roughness: roughness, ..body })
            } else {
                let (body, sheen_color) = [
                    ([0.3, 0.3, 0.3], Vec3::ONE),
                    ([0.0, 0.0, 0.0], Vec3::new(0.9, 0.1, 0.1)),
                    ([0.5, 0.2, 0.05], Vec3::new(0.1, 0.3, 1.0)),
                ][usize::from(row) - 3];
                let name = format!("sheen {sheen_color}, roughness {roughness:.1}");
                let body = rough(&name, body, 0.0, 1.0);
                (name, Material { sheen_color, sheen_roughness: roughness, ..body })
            };
            let material = add_material(&mut scene, material);
            let mesh = add_mesh(&mut scene, &name, vec![(sphere(0.5, 40), material)]);
            let at = DVec3::new(1.15 * (f64::from(column) - 2.5), 1.15 * (2.5 - f64::from(row)), 0.0);
            place(&mut scene, &name, mesh, DAffine3::from_translation(at));
        }
    }
    scene.lights.push(Light {
        name: "lamp".into(),
        kind: LightKind::Point,
        color: Vec3::ONE,
        intensity: 20_000.0,
        range: None,
        radius: 0.0,
        position: DVec3::new(-5.0, 6.0, 8.0),
        direction: Vec3::NEG_Z,
    });
    scene.cameras.push(camera("front", DVec3::new(0.0, 0.0, 14.0), DVec3::ZERO, 0.52));
    scene
}
