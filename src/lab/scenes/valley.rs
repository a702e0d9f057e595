//! An open valley with any number of triangles, for benchmarks.

use crate::scene::build::{add_material, add_mesh, camera, patch, phong, place};
use crate::scene::{Light, LightKind, Scene};
use glam::{DAffine3, DVec3, Vec3};

/// Half the valley's extent \[m\] along x and z: fits a 16 : 9 picture.
const HALF: [f32; 2] = [1.6, 0.9];

/// A rolling valley of 3.2 m by 1.8 m with `triangles` triangles under parallel light of 1000 lx from straight above.
/// All texels of RSMs up to 512 x 512 hit it and are lit, and each slope lights the opposite one.
///
/// It is a grid of cells with two triangles each, as square as the count can be divided; an odd triangle is left out.
/// With `glossy` the material has a lobe of albedo 0.2 and exponent 40.
pub fn valley(triangles: usize, glossy: bool) -> Scene {
    let [columns, rows] = grid(triangles / 2);
    let mut scene = Scene { name: format!("valley of {triangles} triangles"), ..Scene::default() };
    let ground = if glossy {
        phong("ground", [0.5, 0.4, 0.3], [0.2; 3], 40.0)
    } else {
        phong("ground", [0.6, 0.5, 0.4], [0.0; 3], 1.0)
    };
    let ground = add_material(&mut scene, ground);
    let surface = patch([columns + 1, rows + 1], [false; 2], |column, row| {
        let x = HALF[0] * (2.0 * column as f32 / columns as f32 - 1.0);
        let z = HALF[1] * (1.0 - 2.0 * row as f32 / rows as f32);
        let (height, [along_x, along_z]) = height(x, z);
        (Vec3::new(x, height, z), Vec3::new(-along_x, 1.0, -along_z).normalize())
    });
    let mesh = add_mesh(&mut scene, "valley", vec![(surface, ground)]);
    place(&mut scene, "valley", mesh, DAffine3::IDENTITY);
    scene.lights.push(Light {
        name: "sun".into(),
        kind: LightKind::Directional,
        color: Vec3::ONE,
        intensity: 1000.0,
        range: None,
        radius: 0.0,
        position: DVec3::ZERO,
        direction: Vec3::NEG_Y,
    });
    scene.cameras.push(camera("above", DVec3::new(0.0, 4.2, 0.6), DVec3::new(0.0, 0.3, 0.02), 0.56));
    scene
}

/// Height \[m\] of the valley and its slopes.
fn height(x: f32, z: f32) -> (f32, [f32; 2]) {
    let (a, b) = (5.0 * x + 1.0, 6.0 * z);
    let height = 0.25 * x * x + 0.4 * z * z + 0.06 * a.sin() * b.cos();
    (height, [0.5 * x + 0.3 * a.cos() * b.cos(), 0.8 * z - 0.36 * a.sin() * b.sin()])
}

/// Columns and rows of this many cells, as close to a square as possible, with at least as many columns as rows.
fn grid(cells: usize) -> [usize; 2] {
    let rows = (1..=cells.isqrt()).rev().find(|rows| cells.is_multiple_of(*rows)).unwrap_or(1);
    [cells.max(1) / rows, rows]
}
