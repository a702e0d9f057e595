//! Scenes for measuring indirect light: each with its own lights and fixed cameras, without emitting surfaces. Metres.

use super::Shadowed;
use super::shadowed::{EDGE, add, rod, room, spot};
use crate::scene::build::{Surface, add_material, atrium, camera, cuboid, phong, quad, rough, steps};
use crate::scene::{Light, LightKind, Scene};
use glam::{DVec3, Vec3};

/// All generated scenes with their names; the atrium itself is not included.
pub fn measured() -> Vec<(String, Scene)> {
    let shadowed = [Shadowed::Cornell, Shadowed::Columns, Shadowed::Gap];
    let mut scenes: Vec<_> = shadowed.map(|which| (which.name().to_owned(), which.scene())).into();
    for (thickness, size) in [(0.01, "1cm"), (0.2, "20cm")] {
        scenes.push((format!("dark_{size}_shared"), dark(thickness, true)));
        scenes.push((format!("dark_{size}_separate"), dark(thickness, false)));
    }
    scenes.push(("corridor".into(), corridor()));
    scenes.push(("furnished".into(), furnished()));
    scenes.push(("stairs".into(), stairs()));
    scenes.push(("metal15".into(), metal(0.15)));
    scenes.push(("metal30".into(), metal(0.3)));
    scenes
}

/// The atrium with a floor of metal tiles.
fn metal(roughness: f32) -> Scene {
    let mut scene = atrium();
    scene.name = format!("atrium with metal of roughness {roughness}");
    for (name, color) in [("light marble", [0.85, 0.8, 0.72]), ("dark marble", [0.55, 0.48, 0.42])] {
        let tile = scene.materials.iter_mut().find(|material| material.name == name).expect("a tile of the atrium");
        *tile = rough("metal tile", color, 1.0, roughness);
    }
    scene
}

/// A lit room at low x and a sealed dark one next to it, separated by a wall. They share one floor and one shell, or
/// each has its own shell. Two mirrored cameras: "dark" and "lit".
fn dark(thickness: f32, is_shared: bool) -> Scene {
    let mut scene = Scene { name: "dark room".into(), ..Scene::default() };
    let grey = add_material(&mut scene, phong("wall", [0.7; 3], [0.0; 3], 1.0));
    let (near, far) = (0.5 * thickness, 0.5 * thickness + 4.0);
    let shell =
        |from: f32, to: f32| cuboid(Vec3::new(from, 0.0, -1.5), Vec3::new(to, 2.5, 1.5), EDGE, |_| true).reversed();
    if is_shared {
        add(&mut scene, "both rooms", shell(-far, far), grey);
        let (low, high) = (Vec3::new(-near, 0.0, -1.5), Vec3::new(near, 2.5, 1.5));
        add(&mut scene, "wall between", cuboid(low, high, EDGE, |n| n.x != 0.0), grey);
    } else {
        add(&mut scene, "lit room", shell(-far, -near), grey);
        add(&mut scene, "dark room", shell(near, far), grey);
    }
    lamp(&mut scene, [-1.2, 2.3, 0.4], 200.0);
    let half = f64::from(near);
    for (name, side) in [("dark", 1.0), ("lit", -1.0)] {
        let (eye, target) = (DVec3::new(side * (half + 3.8), 1.7, 1.3), DVec3::new(side * half, 1.0, -0.7));
        scene.cameras.push(camera(name, eye, target, 1.1));
    }
    scene
}

/// A point light of this many candela.
fn lamp(scene: &mut Scene, position: [f64; 3], intensity: f32) {
    scene.lights.push(Light {
        name: "lamp".into(),
        kind: LightKind::Point,
        color: Vec3::ONE,
        intensity,
        range: None,
        radius: 0.0,
        position: DVec3::from(position),
        direction: Vec3::NEG_Y,
    });
}

/// A corridor around a bend: a lit leg along x, a dark one along z. Cameras: "leg" looks from the bend down the dark
/// leg, "end" stands before its end, "bend" looks back from its end.
fn corridor() -> Scene {
    let mut scene = Scene { name: "corridor".into(), ..Scene::default() };
    let grey = add_material(&mut scene, phong("wall", [0.7; 3], [0.0; 3], 1.0));
    let warm = add_material(&mut scene, phong("floor", [0.6, 0.5, 0.4], [0.0; 3], 1.0));
    let (left, half, end, height) = (-6.0, 0.8, 7.0, 2.4);
    let up = Vec3::Y * height;
    let flat = |y: f32| {
        let at = Vec3::new(left, y, -half);
        let lit = quad(at, Vec3::Z * 2.0 * half, Vec3::X * (half - left), EDGE);
        lit.and(quad(Vec3::new(-half, y, half), Vec3::Z * (end - half), Vec3::X * 2.0 * half, EDGE))
    };
    let walls = [
        (Vec3::new(left, 0.0, -half), Vec3::X * (half - left), up),
        (Vec3::new(half, 0.0, -half), Vec3::Z * (end + half), up),
        (Vec3::new(half, 0.0, end), Vec3::NEG_X * 2.0 * half, up),
        (Vec3::new(-half, 0.0, end), Vec3::NEG_Z * (end - half), up),
        (Vec3::new(-half, 0.0, half), Vec3::X * (left + half), up),
        (Vec3::new(left, 0.0, half), Vec3::NEG_Z * 2.0 * half, up),
    ];
    let walls = walls.map(|(at, along, up)| quad(at, along, up, EDGE));
    let walls = walls.into_iter().fold(Surface::default(), Surface::and);
    add(&mut scene, "walls and ceiling", walls.and(flat(height).reversed()), grey);
    add(&mut scene, "floor", flat(0.0), warm);
    spot(&mut scene, [-3.5, 2.2, 0.0], [-6.0, 0.9, 0.0], [20.0, 30.0]);
    let cameras = [
        ("leg", [0.5, 1.7, -0.5], [-0.1, 1.1, 7.0]),
        ("end", [0.5, 1.6, 4.2], [-0.2, 1.1, 7.0]),
        ("bend", [0.5, 1.6, 6.8], [-0.3, 1.1, 0.0]),
    ];
    for (name, eye, target) in cameras {
        scene.cameras.push(camera(name, DVec3::from(eye), DVec3::from(target), 1.05));
    }
    scene
}

/// A box between two corners, without its bottom face if it stands on the floor.
fn block(low: [f32; 3], high: [f32; 3]) -> Surface {
    cuboid(low.into(), high.into(), EDGE, |n| low[1] > 0.0 || n != Vec3::NEG_Y)
}

/// A board on four legs, each 4 cm wide.
fn table(low: [f32; 2], high: [f32; 2], height: f32, board: f32) -> Surface {
    let top = block([low[0], height - board, low[1]], [high[0], height, high[1]]);
    let corners =
        [[low[0], low[1]], [high[0] - 0.04, low[1]], [low[0], high[1] - 0.04], [high[0] - 0.04, high[1] - 0.04]];
    let legs = corners.map(|[x, z]| {
        let (low, high) = (Vec3::new(x, 0.0, z), Vec3::new(x + 0.04, height - board, z + 0.04));
        cuboid(low, high, EDGE, |n| n.y == 0.0)
    });
    legs.into_iter().fold(top, Surface::and)
}

/// A room of 5 m by 4 m with furniture a few centimetres away from its walls.
fn furnished() -> Scene {
    let mut scene = room(Vec3::new(-2.5, 0.0, -2.0), Vec3::new(2.5, 2.6, 2.0), [0.0; 3]);
    scene.name = "furnished".into();
    let [oak, white, cloth, green] =
        [("oak", [0.45, 0.3, 0.18]), ("white", [0.8; 3]), ("cloth", [0.55, 0.2, 0.16]), ("green", [0.2, 0.4, 0.25])]
            .map(|(name, albedo)| add_material(&mut scene, phong(name, albedo, [0.0; 3], 1.0)));
    add(&mut scene, "wardrobe", block([-2.48, 0.0, -1.9], [-1.9, 2.0, -0.7]), white);
    // A back panel 1 cm from the wall, sides, boards, and books of several heights.
    let mut shelf = block([-1.2, 0.0, -1.99], [0.4, 1.9, -1.97]);
    let mut books = Surface::default();
    for x in [-1.2, 0.38] {
        shelf = shelf.and(block([x, 0.0, -1.97], [x + 0.02, 1.9, -1.69]));
    }
    for i in 0..6 {
        let y = 0.08 + 0.36 * i as f32;
        shelf = shelf.and(block([-1.18, y, -1.97], [0.38, y + 0.02, -1.69]));
        for k in 0..9 * usize::from(i < 5) {
            let (x, tall) = (-1.1 + 0.16 * k as f32, 0.18 + 0.02 * ((3 * i + 5 * k) % 7) as f32);
            books = books.and(block([x, y + 0.021, -1.94], [x + 0.05 + 0.01 * (k % 3) as f32, y + tall, -1.74]));
        }
    }
    add(&mut scene, "shelf", shelf, oak);
    add(&mut scene, "books", books, green);
    add(&mut scene, "table", table([-0.2, -0.3], [1.0, 0.5], 0.75, 0.03), oak);
    for (name, z) in [("chair", -0.75), ("chair", 0.55)] {
        let back = if z < 0.0 { z } else { z + 0.36 };
        let chair = table([0.2, z], [0.6, z + 0.4], 0.45, 0.03);
        add(&mut scene, name, chair.and(block([0.2, 0.45, back], [0.6, 0.9, back + 0.04])), oak);
    }
    let sofa = block([1.5, 0.0, -1.9], [2.45, 0.4, -0.1]).and(block([2.2, 0.401, -1.9], [2.45, 0.85, -0.1]));
    add(&mut scene, "sofa", sofa, cloth);
    add(&mut scene, "picture", block([2.465, 1.3, -1.4], [2.49, 1.95, -0.5]), oak);
    let fins = (0..12).map(|i| 0.9 + 0.08 * i as f32).map(|x| block([x, 0.15, -1.96], [x + 0.05, 0.75, -1.86]));
    add(&mut scene, "radiator", fins.fold(Surface::default(), Surface::and), white);
    let skirting =
        block([-2.499, 0.0, -0.6], [-2.485, 0.08, 1.99]).and(block([-2.48, 0.0, 1.985], [2.48, 0.08, 1.999]));
    add(&mut scene, "skirting boards", skirting, white);
    add(&mut scene, "stool", rod(0.18, 0.45, 24, EDGE).shifted(-2.25, 0.0, 0.5), cloth);
    spot(&mut scene, [2.2, 2.3, 1.6], [-2.5, 1.0, 0.7], [18.0, 28.0]);
    lamp(&mut scene, [0.4, 2.2, 0.1], 60.0);
    scene.cameras.push(camera("inside", DVec3::new(2.2, 1.65, 1.8), DVec3::new(-1.1, 0.8, -1.2), 1.1));
    scene
}

/// A hall with a gallery over its far half and stairs up to it; a light shines on the gallery's wall.
fn stairs() -> Scene {
    let mut scene = room(Vec3::new(-2.0, 0.0, -3.0), Vec3::new(2.0, 5.4, 4.0), [0.2; 3]);
    scene.name = "stairs".into();
    let white = add_material(&mut scene, phong("plaster", [0.75, 0.73, 0.7], [0.0; 3], 1.0));
    let oak = add_material(&mut scene, phong("oak", [0.45, 0.3, 0.18], [0.1; 3], 20.0));
    let gallery = cuboid(Vec3::new(-2.0, 2.6, -3.0), Vec3::new(2.0, 2.8, 0.3), EDGE, |n| n.y != 0.0 || n.z > 0.0);
    add(&mut scene, "gallery", gallery, white);
    add(&mut scene, "steps", steps(1.0, 0.2, [0.25, 0.04], 14, EDGE).shifted(1.45, 0.0, 3.6), oak);
    let mut rail = block([-1.99, 3.7, 0.2], [0.9, 3.75, 0.26]);
    for i in 0..20 {
        rail = rail.and(rod(0.012, 0.9, 8, EDGE).shifted(-1.9 + 0.145 * i as f32, 2.8, 0.23));
    }
    add(&mut scene, "rail", rail, oak);
    add(&mut scene, "bench", table([-1.97, -2.6], [-1.5, -1.0], 0.45, 0.05), oak);
    add(&mut scene, "column", rod(0.12, 2.6, 24, EDGE).shifted(-0.6, 0.0, 0.1), white);
    spot(&mut scene, [0.0, 5.2, -0.6], [-0.3, 3.9, -3.0], [22.0, 34.0]);
    scene.cameras.push(camera("hall", DVec3::new(-1.6, 1.65, 3.7), DVec3::new(0.5, 1.5, -1.5), 1.15));
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::path_trace::{PathTrace, PathTraceSettings};

    #[test]
    fn every_scene_has_a_camera_and_punctual_lights_alone() {
        let scenes = measured();
        for (name, scene) in &scenes {
            assert!(!scene.cameras.is_empty() && !scene.lights.is_empty() && !scene.emits(), "{name}");
            let named = |other: &&(String, Scene)| other.0 == *name;
            assert_eq!(scenes.iter().filter(named).count(), 1, "{name}");
        }
    }

    #[test]
    fn no_path_of_light_leads_into_the_dark_room() {
        for (thickness, is_shared) in [(0.01, true), (0.01, false), (0.2, true), (0.2, false)] {
            let scene = dark(thickness, is_shared);
            let mean = |camera: usize| {
                let settings = PathTraceSettings::engine([32, 18], 4);
                let mut trace = PathTrace::new(&scene, &scene.cameras[camera], &settings);
                trace.pass();
                crate::metrics::mean(&trace.diffuse()) + crate::metrics::mean(&trace.direct())
            };
            assert_eq!(mean(0), 0.0, "{thickness} m, shared floor: {is_shared}");
            assert!(mean(1) > 0.0, "the other room is lit");
        }
    }
}
