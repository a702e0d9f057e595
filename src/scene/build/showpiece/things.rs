//! Objects in the court: the fountain with the statue, vessels, plants, benches, curtains, banners.

use super::super::{Surface, add_mesh, drape, lathe, patch, place, turned};
use super::building::{COURT, FLOOR};
use super::noise::random;
use super::solids::{arc, block, boxed, wrapped};
use super::{Palette, statue};
use crate::scene::Scene;
use glam::{Affine3A, DAffine3, DQuat, DVec3, Quat, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Adds all objects; the statue is made with cells of this side \[m\].
pub(super) fn furnish(scene: &mut Scene, palette: &Palette, cell: f32) {
    fountain(scene, palette, cell);
    vessels(scene, palette);
    plants(scene, palette);
    benches(scene, palette);
    cloths(scene, palette);
}

/// Transform to a position \[m\], turned about +Y \[degrees\].
fn at(x: f64, y: f64, z: f64, degrees: f64) -> DAffine3 {
    DAffine3::from_rotation_translation(DQuat::from_rotation_y(degrees.to_radians()), DVec3::new(x, y, z))
}

fn points(profile: &[[f32; 2]]) -> Vec<Vec2> {
    profile.iter().map(|p| Vec2::from(*p)).collect()
}

/// A basin with still water, a drum in its middle, and the statue on the drum.
fn fountain(scene: &mut Scene, palette: &Palette, cell: f32) {
    let mut foot = points(&[[1.86, -0.01], [1.86, 0.05]]);
    foot.extend(arc(Vec2::new(1.82, 0.06), 0.04, 0.0, 90.0, 4));
    foot.extend(points(&[[1.74, 0.105]]));
    let mut rim = points(&[[1.70, 0.52]]);
    rim.extend(arc(Vec2::new(1.76, 0.585), 0.045, -100.0, 95.0, 8));
    rim.extend(arc(Vec2::new(1.50, 0.595), 0.04, 85.0, 180.0, 5));
    rim.extend(points(&[[1.46, 0.2]]));
    let band = [Vec2::new(1.70, 0.04), Vec2::new(1.70, 0.525)];
    let drum = {
        let mut drum = points(&[[0.70, 0.2], [0.70, 0.55]]);
        drum.extend(arc(Vec2::new(0.66, 0.58), 0.045, -20.0, 80.0, 5));
        drum.extend(arc(Vec2::new(0.665, 0.73), 0.10, 265.0, 185.0, 6));
        drum.extend(points(&[[0.565, 0.75], [0.555, 1.16]]));
        drum.extend(arc(Vec2::new(0.60, 1.19), 0.035, 200.0, 100.0, 4));
        drum.extend(arc(Vec2::new(0.625, 1.28), 0.05, -70.0, 90.0, 7));
        drum.extend(points(&[[0.30, 1.335], [0.0, 1.335]]));
        drum
    };
    // Eleven repeats of a pattern of tesserae around the basin, twelve columns of 4 cm each.
    let mosaic = wrapped(lathe(&band, 96), 0.96 * 11.0);
    let stone = wrapped(lathe(&foot, 96), 12.0).and(wrapped(lathe(&rim, 96), 10.5)).and(wrapped(lathe(&drum, 72), 4.5));
    let surface = patch([96, 6], [true, false], |column, row| {
        let (sine, cosine) = (TAU * column as f32 / 96.0).sin_cos();
        (Vec3::new(cosine, 0.0, -sine) * (0.60 + 0.90 * row as f32 / 5.0) + Vec3::Y * 0.47, Vec3::Y)
    });
    let parts = vec![(stone, palette.marble), (mosaic, palette.mosaic), (boxed(surface), palette.water)];
    let basin = add_mesh(scene, "fountain", parts);
    place(scene, "fountain", basin, turned(0, DVec3::ZERO));
    let statue = boxed(statue::statue(cell));
    let statue = add_mesh(scene, "statue", vec![(statue, palette.statue)]);
    place(scene, "statue", statue, at(0.0, 1.335 + 0.012, 0.0, 6.0));
}

/// Jars and bowls of metal and clay.
fn vessels(scene: &mut Scene, palette: &Palette) {
    let jar = [
        [0.0, 0.0],
        [0.15, 0.0],
        [0.165, 0.012],
        [0.165, 0.035],
        [0.135, 0.06],
        [0.15, 0.12],
        [0.21, 0.24],
        [0.27, 0.38],
        [0.305, 0.52],
        [0.315, 0.64],
        [0.295, 0.75],
        [0.245, 0.84],
        [0.175, 0.90],
        [0.125, 0.945],
        [0.108, 0.99],
        [0.106, 1.05],
        [0.12, 1.09],
        [0.155, 1.115],
        [0.175, 1.125],
        [0.18, 1.14],
        [0.165, 1.15],
        [0.135, 1.13],
        [0.10, 1.06],
        [0.10, 0.95],
        [0.0, 0.85],
    ];
    let bowl = [
        [0.0, 0.0],
        [0.14, 0.0],
        [0.15, 0.015],
        [0.10, 0.05],
        [0.085, 0.10],
        [0.12, 0.125],
        [0.23, 0.165],
        [0.33, 0.23],
        [0.395, 0.31],
        [0.43, 0.40],
        [0.45, 0.415],
        [0.45, 0.435],
        [0.425, 0.43],
        [0.38, 0.33],
        [0.31, 0.25],
        [0.20, 0.195],
        [0.0, 0.165],
    ];
    let smooth = |profile: &[[f32; 2]], sides: usize, around: f32| {
        let points = points(profile);
        // A Catmull-Rom curve through the points, four pieces per segment.
        let at = |k: isize| points[k.clamp(0, points.len() as isize - 1) as usize];
        let mut fine = vec![points[0]];
        for k in 0..points.len() as isize - 1 {
            let [a, b, c, d] = [at(k - 1), at(k), at(k + 1), at(k + 2)];
            for step in 1..=4 {
                let t = step as f32 / 4.0;
                let p = 0.5
                    * (2.0 * b
                        + (c - a) * t
                        + (2.0 * a - 5.0 * b + 4.0 * c - d) * t * t
                        + (3.0 * b - a - 3.0 * c + d) * t * t * t);
                fine.push(p.max(Vec2::new(0.0, -0.002)));
            }
        }
        wrapped(lathe(&fine, sides), around)
    };
    let handle = |turn: f32| {
        let curve = |t: f32| {
            let angle = PI * (t * 1.15 - 0.08);
            Vec3::new(0.16 + 0.14 * angle.sin(), 0.95 - 0.14 * angle.cos(), 0.0)
        };
        let tube = patch([10, 25], [true, false], |column, row| {
            let t = row as f32 / 24.0;
            let (along, side) = ((curve(t + 0.01) - curve(t - 0.01)).normalize(), Vec3::Z);
            let (sine, cosine) = (TAU * column as f32 / 10.0).sin_cos();
            let normal = along.cross(side) * cosine + side * sine;
            (curve(t) + normal * 0.017, normal)
        });
        boxed(tube.moved(Affine3A::from_rotation_y(turn)))
    };
    let jar_body = smooth(&jar, 64, 1.8).and(handle(0.0)).and(handle(PI));
    let plain_jar = smooth(&jar, 64, 2.0);
    let bowl = smooth(&bowl, 72, 2.4);
    let bronze = add_mesh(scene, "bronze jar", vec![(jar_body.clone(), palette.bronze)]);
    let copper = add_mesh(scene, "copper jar", vec![(jar_body, palette.copper)]);
    let clay = add_mesh(scene, "clay jar", vec![(plain_jar, palette.clay)]);
    let brass = add_mesh(scene, "brass bowl", vec![(bowl, palette.brass)]);
    let scaled = |place: DAffine3, size: f64| place * DAffine3::from_scale(DVec3::splat(size));
    let stands = [
        (bronze, scaled(at(-2.05, 0.0, 2.25, 30.0), 1.0)),
        (copper, scaled(at(-2.62, 0.0, 1.72, -50.0), 0.72)),
        (brass, scaled(at(-1.62, 0.0, 2.82, 0.0), 0.8)),
        (clay, scaled(at(3.45, 0.0, -4.9, 0.0), 1.15)),
        (clay, scaled(at(2.75, 0.0, -5.15, 0.0), 0.8)),
        (copper, scaled(at(-3.5, 0.0, -5.0, 20.0), 0.9)),
        (bronze, scaled(at(6.75, 0.16, 3.0, 70.0), 0.9)),
        (clay, scaled(at(6.72, 0.16, 2.35, 0.0), 0.75)),
        (clay, scaled(at(-6.7, 0.16, -3.1, 0.0), 1.0)),
        (brass, scaled(at(2.35, 0.0, 3.6, 0.0), 0.7)),
    ];
    for (mesh, stand) in stands {
        place(scene, "vessel", mesh, stand);
    }
}

/// A leaf that rises from the origin towards +X and bends over; visible from both sides.
fn blade(long: f32, wide: f32, rise: f32, bend: f32) -> Surface {
    let shape = |s: f32, t: f32| {
        let angle = rise - bend * t * t;
        let reach = long * t * (1.0 - 0.12 * bend * t);
        let half = wide * (PI * (0.06 + 0.94 * t).powf(0.75)).sin().max(0.0).powf(0.8);
        Vec3::new(reach * angle.cos(), reach * angle.sin() + 0.35 * half * s.abs(), half * s)
    };
    let point = |column: usize, row: usize| {
        let (s, t) = (0.5 * (column as f32 - 2.0), (row as f32 / 12.0).min(0.985));
        let across = shape(s + 0.02, t) - shape(s - 0.02, t);
        let along = shape(s, t + 0.01) - shape(s, t - 0.01);
        (shape(s, t), across.cross(along).normalize_or(Vec3::Y))
    };
    patch([5, 13], [false; 2], point)
}

/// Large pots with leaf plants.
fn plants(scene: &mut Scene, palette: &Palette) {
    let mut pot = points(&[[0.0, 0.0], [0.20, 0.0], [0.215, 0.015]]);
    pot.extend(points(&[[0.24, 0.15], [0.28, 0.32], [0.305, 0.46]]));
    pot.extend(arc(Vec2::new(0.315, 0.50), 0.035, -70.0, 100.0, 8));
    pot.extend(points(&[[0.275, 0.53], [0.27, 0.47], [0.0, 0.465]]));
    let pot = wrapped(lathe(&pot, 56), 2.0);
    for kind in 0..2 {
        let mut leaves = Surface::default();
        let count = [46, 34][kind as usize];
        for k in 0..count {
            let own = |n: i32| random(k, n, 900 + kind as u32);
            let inner = k as f32 / count as f32;
            let (long, wide) = [(0.95, 0.034), (0.80, 0.075)][kind as usize];
            let rise = 0.55 + 0.9 * inner + 0.2 * (own(1) - 0.5);
            let leaf = blade(
                long * (0.8 + 0.4 * own(2)),
                wide * (0.85 + 0.3 * own(3)),
                rise,
                1.0 - 0.5 * inner + 0.4 * own(4),
            );
            let angle = TAU * (k as f32 * 0.618_034).fract();
            let turn = Quat::from_rotation_y(angle);
            let root = turn * Vec3::new(0.10 * (1.0 - inner), 0.0, 0.0) + Vec3::Y * 0.46;
            leaves = leaves.and(leaf.moved(Affine3A::from_rotation_translation(turn, root)));
        }
        let mesh = add_mesh(scene, "plant", vec![(pot.clone(), palette.clay), (leaves, palette.leaf)]);
        let x = f64::from(COURT.x) - 0.95;
        let stands: &[[f64; 3]] = if kind == 0 {
            &[[-x, -4.5, 1.15], [x, 1.5, 1.1], [-x, 4.6, 1.15], [x, -4.6, 1.2]]
        } else {
            &[[-x, -1.5, 1.15], [x, -1.5, 1.15], [-x, 1.5, 1.2], [1.5, -5.05, 1.0], [-1.5, -5.05, 1.1]]
        };
        for (k, [x, z, size]) in stands.iter().enumerate() {
            let stand = at(*x, 0.0, *z, 71.0 * k as f64) * DAffine3::from_scale(DVec3::splat(*size));
            place(scene, "plant", mesh, stand);
        }
    }
}

/// Stone benches with wooden seats.
fn benches(scene: &mut Scene, palette: &Palette) {
    let part = |low: [f32; 3], high: [f32; 3], round| block(Vec3::from(low), Vec3::from(high), round, 0.5);
    let mut stone = Surface::default();
    for x in [-0.72_f32, 0.72] {
        stone = stone.and(part([x - 0.12, 0.0, -0.19], [x + 0.12, 0.06, 0.19], 0.02));
        stone = stone.and(part([x - 0.085, 0.05, -0.15], [x + 0.085, 0.38, 0.15], 0.03));
        stone = stone.and(part([x - 0.12, 0.37, -0.20], [x + 0.12, 0.43, 0.20], 0.02));
    }
    let mut wood = Surface::default();
    for k in 0..3 {
        let z = 0.145 * (k as f32 - 1.0);
        let board = part([-0.065, 0.43, -1.02], [0.065, 0.475, 1.02], 0.012);
        wood = wood.and(board.moved(Affine3A::from_rotation_y(0.5 * PI)).shifted(0.0, 0.0, z));
    }
    let bench = add_mesh(scene, "bench", vec![(stone, palette.marble), (wood, palette.wood)]);
    let floor = f64::from(FLOOR[0]);
    for stand in [
        at(6.75, floor, -1.5, -90.0),
        at(6.75, floor, 4.6, -90.0),
        at(-6.75, floor, 1.5, 90.0),
        at(-1.5, floor, -8.3, 0.0),
    ] {
        place(scene, "bench", bench, stand);
    }
}

/// Cloth with texture coordinates in metres; its vertices form a grid.
fn cloth(size: [f32; 2], folds: f32, depth: f32) -> Surface {
    let mut cloth = drape(size, folds, depth, 0.08);
    // Folds take more cloth than the width shows.
    let full = (1.0 + (3.0 * depth * folds / size[0]).powi(2)).sqrt();
    cloth.vertices.iter_mut().for_each(|vertex| {
        vertex.uv0 = Vec2::new(vertex.position.x * full, -vertex.position.y);
    });
    cloth
}

/// Curtains in arches of the lower storey, banners on the upper one, and the rods that hold them.
fn cloths(scene: &mut Scene, palette: &Palette) {
    let rod = |half: f32| {
        let bar =
            [[0.0, -half - 0.05], [0.03, -half - 0.05], [0.03, -half], [0.016, -half + 0.01], [0.016, half - 0.01]];
        let end = [[0.03, half], [0.03, half + 0.05], [0.0, half + 0.05]];
        let bar: Vec<Vec2> = bar.iter().chain(&end).map(|p| Vec2::from(*p)).collect();
        boxed(lathe(&bar, 14).moved(Affine3A::from_rotation_z(0.5 * PI)))
    };
    let rod = add_mesh(scene, "rod", vec![(rod(1.12), palette.brass)]);
    scene.meshes[rod].place_apart(4.0);
    let wide = cloth([1.95, 2.62], 8.5, 0.075);
    let narrow = cloth([0.72, 2.62], 5.5, 0.085);
    let banner = cloth([1.35, 2.35], 3.5, 0.045);
    let mut add = |kind: &str, surface: &Surface| {
        palette.cloths.map(|material| add_mesh(scene, kind, vec![(surface.clone(), material)]))
    };
    let (wide, narrow, banner) = (add("curtain", &wide), add("curtain", &narrow), add("banner", &banner));
    let [red, teal, ochre] = [0, 1, 2];
    let hung = f64::from(2.86_f32);
    let (x, z) = (f64::from(COURT.x), f64::from(COURT.y));
    let mut hang = |mesh: usize, quarter: i32, along: f64, shift: f64, height: f64, out: f64| {
        let far = if quarter % 2 == 0 { z } else { x };
        let at = turned(quarter, DVec3::ZERO).transform_point3(DVec3::new(along + shift, height, -far + out));
        place(scene, "cloth", mesh, turned(quarter, at));
        if shift >= 0.0 {
            let at = turned(quarter, DVec3::ZERO).transform_point3(DVec3::new(along, height + 0.01, -far + out));
            place(scene, "rod", rod, turned(quarter, at));
        }
    };
    // The sunlit side, on the left of the view.
    hang(wide[red], 1, 1.5, 0.0, hung, 0.0);
    hang(narrow[red], 1, -1.5, -0.72, hung, 0.0);
    hang(narrow[red], 1, -1.5, 0.72, hung, 0.0);
    hang(wide[teal], 1, 4.5, 0.0, hung, 0.0);
    // The far end.
    hang(narrow[ochre], 0, -3.0, -0.72, hung, 0.0);
    hang(narrow[ochre], 0, -3.0, 0.72, hung, 0.0);
    hang(narrow[ochre], 0, 3.0, -0.72, hung, 0.0);
    hang(narrow[ochre], 0, 3.0, 0.72, hung, 0.0);
    // The shaded side.
    hang(wide[ochre], 3, -1.5, 0.0, hung, 0.0);
    hang(narrow[teal], 3, 1.5, 0.72, hung, 0.0);
    hang(narrow[teal], 3, 1.5, -0.72, hung, 0.0);
    // Banners over the rail of the upper gallery.
    let banners = [(0, -3.0, red), (0, 3.0, red), (1, -1.5, ochre), (1, 1.5, teal), (3, 1.5, red), (3, -1.5, ochre)];
    for (quarter, along, colour) in banners {
        hang(banner[colour], quarter, along, 0.0, 5.42, 0.50);
    }
}
