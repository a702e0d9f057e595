//! A hall around an open roof, lit by a slanting sun and one spot, almost entirely indirectly.

use super::masonry::{ArchShape, ring_lines};
use super::{Surface, add_material, add_mesh, camera, cuboid, lathe, loft_square, phong, place, rough, sheet};
use super::{arch, drape, quad, ring, spans, sphere, steps, torus_knot, turned, vault_dome};
use crate::scene::{Light, LightKind, Material, Scene};
use glam::{Affine3A, DAffine3, DQuat, DVec3, Quat, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI};

// Dimensions of the building [m]. The hall lies along z; the nave is between the colonnades, the aisles behind them.
const END: f32 = 8.0;
const WALL: f32 = 5.6;
const COLONNADE: f32 = 3.2;
const PITCH: f32 = 2.0 * END / 6.0;
const SPRING: f32 = 3.3;
const AISLE_TOP: f32 = SPRING + 0.5 * PITCH;
const TOP: f32 = 7.0;
const THICKNESS: f32 = 0.56;
const NAVE: f32 = COLONNADE - 0.5 * THICKNESS;
// Extent of the open roof in x and z.
const OPENING: [[f32; 2]; 2] = [[-2.1, 2.1], [-5.8, 1.4]];
// The niche in the far wall, above a dais of three steps.
const NICHE: f32 = 1.25;
const NICHE_HALF: f32 = 1.9;
const NICHE_PIECES: usize = 32;
const DAIS: f32 = 0.48;
const NICHE_SPRING: f32 = DAIS + 2.5;
const EDGE: f32 = 0.22;
const ROOF: f32 = 0.3;

struct Palette {
    plaster: usize,
    stone: usize,
    light_tile: usize,
    dark_tile: usize,
    slate: usize,
    wood: usize,
    brass: usize,
    bronze: usize,
    clay: usize,
    cloths: [usize; 3],
}

/// A hall of 16 m by 11.2 m and 7 m high, with two colonnades with arches, aisles behind them, an open roof over the
/// middle, coloured drapes between the columns, a polished floor, a bronze knot on a pedestal, and a niche above steps
/// at the far end.
///
/// A warm sun (directional) slants through the roof; a spot lights a drape in the shaded right aisle. Repeated parts
/// are instances of one mesh. Cameras: "Hero", down the hall, and "Detail", near the knot.
pub fn atrium() -> Scene {
    let mut scene = Scene { name: "atrium".into(), ..Scene::default() };
    let palette = palette(&mut scene);
    floor(&mut scene, &palette);
    walls(&mut scene, &palette);
    roof(&mut scene, &palette);
    colonnades(&mut scene, &palette);
    drapes(&mut scene, &palette);
    statues(&mut scene, &palette);
    lights(&mut scene);
    let (eye, target) = (DVec3::new(-0.7, 1.62, 7.2), DVec3::new(0.35, 1.50, -3.0));
    scene.cameras.push(camera("Hero", eye, target, 46_f32.to_radians()));
    let (eye, target) = (DVec3::new(-0.7, 1.75, 3.6), DVec3::new(0.8, 1.5, 1.2));
    scene.cameras.push(camera("Detail", eye, target, 40_f32.to_radians()));
    scene
}

fn palette(scene: &mut Scene) -> Palette {
    let cloth = |name: &str, albedo| Material { double_sided: true, ..phong(name, albedo, [0.0; 3], 1.0) };
    let materials = [
        phong("plaster", [0.74, 0.70, 0.63], [0.0; 3], 1.0),
        rough("stone", [0.70, 0.65, 0.57], 0.0, 0.8),
        phong("light marble", [0.64, 0.59, 0.52], [0.25; 3], 80.0),
        phong("dark marble", [0.34, 0.28, 0.24], [0.25; 3], 80.0),
        phong("slate", [0.05, 0.05, 0.055], [0.0; 3], 1.0),
        rough("oak", [0.30, 0.19, 0.11], 0.0, 0.7),
        rough("brass", [0.80, 0.58, 0.30], 1.0, 0.4),
        phong("bronze", [0.34, 0.21, 0.11], [0.46, 0.34, 0.22], 40.0),
        rough("glazed clay", [0.48, 0.20, 0.10], 0.0, 0.35),
        cloth("red cloth", [0.70, 0.045, 0.035]),
        cloth("teal cloth", [0.03, 0.42, 0.38]),
        cloth("ochre cloth", [0.80, 0.44, 0.06]),
    ];
    let [plaster, stone, light_tile, dark_tile, slate, wood, brass, bronze, clay, red, teal, ochre] =
        materials.map(|material| add_material(scene, material));
    let cloths = [red, teal, ochre];
    Palette { plaster, stone, light_tile, dark_tile, slate, wood, brass, bronze, clay, cloths }
}

/// The floor: tiles of 0.8 m, of two marbles in the nave and of the light one in the aisles.
fn floor(scene: &mut Scene, palette: &Palette) {
    let (xs, zs) = (spans(&[-WALL, WALL], 0.2), spans(&[-END, END], 0.2));
    let is_dark = |x: f32, z: f32| {
        let tile = |v: f32| (v / 0.8).floor() as i32;
        x.abs() < 2.4 && (tile(x) + tile(z)).rem_euclid(2) == 1
    };
    let [light, dark] =
        [false, true].map(|dark| sheet(Vec3::ZERO, [Vec3::Z, Vec3::X], &zs, &xs, |z, x| is_dark(x, z) == dark));
    let mesh = add_mesh(scene, "floor", vec![(light, palette.light_tile), (dark, palette.dark_tile)]);
    place(scene, "floor", mesh, turned(0, DVec3::ZERO));
}

/// The outer walls with pilasters, the end walls with the niche, mouldings along the nave.
fn walls(scene: &mut Scene, palette: &Palette) {
    let aisle = quad(Vec3::new(-END, 0.0, 0.0), Vec3::X * 2.0 * END, Vec3::Y * AISLE_TOP, EDGE);
    let aisle = add_mesh(scene, "aisle wall", vec![(aisle, palette.plaster)]);
    place(scene, "aisle wall left", aisle, turned(1, DVec3::new(f64::from(-WALL), 0.0, 0.0)));
    place(scene, "aisle wall right", aisle, turned(-1, DVec3::new(f64::from(WALL), 0.0, 0.0)));

    let end = end_wall(None);
    let end = add_mesh(scene, "near wall", vec![(end, palette.plaster)]);
    place(scene, "near wall", end, turned(2, DVec3::new(0.0, 0.0, f64::from(END))));
    let (top_lines, side_lines) = ring_lines(NICHE_HALF, NICHE_PIECES);
    let far = end_wall(Some((top_lines, side_lines)));
    let surround = ring(NICHE, NICHE_HALF, NICHE_PIECES, EDGE).shifted(0.0, NICHE_SPRING, 0.0);
    let dome = vault_dome(NICHE, NICHE_SPRING - DAIS, NICHE_PIECES, EDGE).shifted(0.0, NICHE_SPRING, 0.0);
    let parts = vec![(far.and(surround), palette.plaster), (dome, palette.stone)];
    let far = add_mesh(scene, "far wall", parts);
    place(scene, "far wall", far, turned(0, DVec3::new(0.0, 0.0, f64::from(-END))));

    // The landing extends to the back of the niche.
    let landing = 0.9 + NICHE;
    let flight = steps(2.0 * NICHE_HALF, DAIS / 3.0, [0.36, landing], 3, 0.2);
    let flight = add_mesh(scene, "steps", vec![(flight, palette.stone)]);
    place(scene, "steps", flight, turned(0, DVec3::new(0.0, 0.0, f64::from(-END + 0.72 + 0.9))));

    let shown = |normal: Vec3| normal.z >= 0.0 && normal.y == 0.0;
    let pilaster = cuboid(Vec3::new(-0.25, 0.0, 0.0), Vec3::new(0.25, AISLE_TOP, 0.12), EDGE, shown);
    let base = cuboid(Vec3::new(-0.31, 0.0, 0.0), Vec3::new(0.31, 0.25, 0.18), EDGE, |n| n.z >= 0.0 && n.y >= 0.0);
    let pilaster = add_mesh(scene, "pilaster", vec![(pilaster.and(base), palette.stone)]);
    for k in -2..=2 {
        let z = f64::from(PITCH) * f64::from(k);
        place(scene, "pilaster left", pilaster, turned(1, DVec3::new(f64::from(-WALL), 0.0, z)));
        place(scene, "pilaster right", pilaster, turned(-1, DVec3::new(f64::from(WALL), 0.0, z)));
    }
    let moulding = |low: f32, high: f32, depth: f32| {
        let (from, to) = (Vec3::new(-END, low, 0.0), Vec3::new(END, high, depth));
        cuboid(from, to, EDGE, |n| n.z >= 0.0 && n.x == 0.0)
    };
    let across = cuboid(Vec3::new(-NAVE, 5.3, 0.0), Vec3::new(NAVE, 5.45, 0.16), EDGE, |n| n.z >= 0.0 && n.x == 0.0);
    let across = add_mesh(scene, "ledge", vec![(across, palette.stone)]);
    place(scene, "ledge far", across, turned(0, DVec3::new(0.0, 0.0, f64::from(-END))));
    let mouldings = moulding(4.78, 4.92, 0.10).and(moulding(6.55, 6.78, 0.10)).and(moulding(6.78, TOP, 0.2));
    let mouldings = add_mesh(scene, "mouldings", vec![(mouldings, palette.stone)]);
    place(scene, "mouldings left", mouldings, turned(1, DVec3::new(f64::from(-NAVE), 0.0, 0.0)));
    place(scene, "mouldings right", mouldings, turned(-1, DVec3::new(f64::from(NAVE), 0.0, 0.0)));
}

/// A wall across nave and aisles at z = 0, facing +Z. If the niche's grid lines are given, it has a hole for the niche
/// and the dais.
fn end_wall(niche: Option<(Vec<f32>, Vec<f32>)>) -> Surface {
    let has_niche = niche.is_some();
    let (top_lines, side_lines) = niche.unwrap_or((vec![-NICHE_HALF, NICHE_HALF], vec![0.0, NICHE_HALF]));
    let mut xs = spans(&[-WALL, -NAVE, -NICHE_HALF], EDGE);
    xs.extend(if has_niche { top_lines } else { spans(&top_lines, EDGE) }.into_iter().skip(1));
    xs.extend(spans(&[NICHE_HALF, NAVE, WALL], EDGE).into_iter().skip(1));
    // Below the springing line the jambs of the niche need their own grid line.
    let jambs = spans(&[-NICHE_HALF, -NICHE], EDGE);
    let mut ys = spans(&[0.0, DAIS, NICHE_SPRING], EDGE);
    let below = ys.clone();
    ys.extend(side_lines.into_iter().skip(1).map(|y| NICHE_SPRING + y));
    ys.extend(spans(&[NICHE_SPRING + NICHE_HALF, TOP], EDGE).into_iter().skip(1));
    // The row that crosses the aisles' ceiling is moved to end there.
    let nearest = (0..ys.len()).min_by(|&a, &b| (ys[a] - AISLE_TOP).abs().total_cmp(&(ys[b] - AISLE_TOP).abs()));
    ys[nearest.expect("rows")] = AISLE_TOP;
    let wall = sheet(Vec3::ZERO, [Vec3::X, Vec3::Y], &xs, &ys, |x, y| {
        let in_hall = x.abs() < NAVE || y < AISLE_TOP;
        let in_niche = has_niche && x.abs() < NICHE_HALF && y < NICHE_SPRING + NICHE_HALF;
        in_hall && !in_niche
    });
    if !has_niche {
        return wall;
    }
    let left = sheet(Vec3::ZERO, [Vec3::X, Vec3::Y], &jambs, &below, |_, y| y > DAIS);
    let mirrored: Vec<f32> = jambs.iter().rev().map(|x| -x).collect();
    let right = sheet(Vec3::ZERO, [Vec3::X, Vec3::Y], &mirrored, &below, |_, y| y > DAIS);
    wall.and(left).and(right)
}

/// Ceilings, the opening with its beams, and only those outer faces that keep the sun out.
fn roof(scene: &mut Scene, palette: &Palette) {
    let [[left, right], [far, near]] = OPENING;
    let is_closed = |x: f32, z: f32| !(x > left && x < right && z > far && z < near);
    let (xs, zs) = (spans(&[-NAVE, left, right, NAVE], EDGE), spans(&[-END, far, near, END], EDGE));
    let ceiling = sheet(Vec3::Y * TOP, [Vec3::X, Vec3::Z], &xs, &zs, is_closed);
    let aisles = [-WALL, NAVE + THICKNESS].map(|x| {
        let width = WALL - NAVE - THICKNESS;
        quad(Vec3::new(x, AISLE_TOP, -END), Vec3::X * width, Vec3::Z * 2.0 * END, EDGE)
    });
    let (low, high) = (Vec3::new(left, TOP, far), Vec3::new(right, TOP + ROOF, near));
    let mut reveal = cuboid(low, high, EDGE, |normal| normal.y == 0.0).reversed();
    for surface in aisles {
        reveal = reveal.and(surface);
    }
    let ceiling = add_mesh(scene, "ceiling", vec![(ceiling.and(reveal), palette.plaster)]);
    place(scene, "ceiling", ceiling, turned(0, DVec3::ZERO));

    let (x, front, back, coarse) = (WALL + ROOF, END + ROOF, -END - NICHE - ROOF, 1.2);
    let (xs, zs) = (spans(&[-x, left, right, x], coarse), spans(&[back, far, near, front], coarse));
    let top = sheet(Vec3::Y * (TOP + ROOF), [Vec3::Z, Vec3::X], &zs, &xs, |z, x| is_closed(x, z));
    let height = Vec3::Y * (TOP + ROOF);
    let sunny = quad(Vec3::new(x, 0.0, back), height, Vec3::Z * (front - back), coarse);
    let behind = quad(Vec3::new(-x, 0.0, back), height, Vec3::X * 2.0 * x, coarse);
    let outside = add_mesh(scene, "outside", vec![(top.and(sunny).and(behind), palette.slate)]);
    place(scene, "outside", outside, turned(0, DVec3::ZERO));

    let reach = right - left;
    let beam = cuboid(Vec3::new(-0.5 * reach, 0.0, -0.12), Vec3::new(0.5 * reach, 0.3, 0.12), 0.2, |n| n.x == 0.0);
    let beam = add_mesh(scene, "beam", vec![(beam, palette.wood)]);
    for k in 1..=4 {
        let z = f64::from(far) + f64::from(near - far) * f64::from(k) / 5.0;
        place(scene, "beam", beam, turned(0, DVec3::new(0.0, f64::from(TOP) - 0.02, z)));
    }
}

fn colonnades(scene: &mut Scene, palette: &Palette) {
    let shape = ArchShape {
        pitch: PITCH,
        radius: 0.95,
        thickness: THICKNESS,
        height: [TOP - SPRING, AISLE_TOP - SPRING],
        band: [0.17, 0.05],
    };
    let bay = add_mesh(scene, "bay", vec![(arch(shape, EDGE), palette.stone)]);
    let column = add_mesh(scene, "column", vec![(column(), palette.stone)]);
    let pier = cuboid(Vec3::new(-0.36, 0.0, 0.0), Vec3::new(0.36, SPRING, 0.3), EDGE, |n| n.y == 0.0 && n.z >= 0.0);
    let cap = cuboid(Vec3::new(-0.39, SPRING - 0.14, 0.0), Vec3::new(0.39, SPRING, 0.38), EDGE, |n| n.z >= 0.0);
    let pier = add_mesh(scene, "pier", vec![(pier.and(cap), palette.stone)]);
    let disc = [[0.33, 0.0], [0.33, 0.05], [0.30, 0.08], [0.27, 0.05], [0.24, 0.035], [0.0, 0.09]];
    let disc = disc.map(Vec2::from);
    let disc = lathe(&disc, 40).moved(Affine3A::from_rotation_x(FRAC_PI_2));
    let roundel = add_mesh(scene, "roundel", vec![(disc, palette.stone)]);
    for (side, x, quarters) in [("left", -COLONNADE, 1), ("right", COLONNADE, -1)] {
        let at = |z: f64, y: f32| DVec3::new(f64::from(x), f64::from(y), z);
        for k in 0..6 {
            place(scene, &format!("bay {side}"), bay, turned(quarters, at(bay_z(k), SPRING)));
        }
        for k in -2..=2 {
            let z = f64::from(PITCH) * f64::from(k);
            place(scene, &format!("column {side}"), column, turned(0, at(z, 0.0)));
            let on_wall = at(z, 4.28).with_x(f64::from(x.signum() * NAVE));
            place(scene, &format!("roundel {side}"), roundel, turned(quarters, on_wall));
        }
        place(scene, &format!("pier {side}"), pier, turned(0, at(f64::from(-END), 0.0)));
        place(scene, &format!("pier {side}"), pier, turned(2, at(f64::from(END), 0.0)));
    }
}

/// z of a bay's middle, counted from the far end.
fn bay_z(bay: i32) -> f64 {
    f64::from(PITCH) * (f64::from(bay) - 2.5)
}

/// A column, 3.3 m high: plinth, base, shaft with entasis, necking, echinus and abacus.
fn column() -> Surface {
    let mut profile = vec![];
    let mut roll = |centre: Vec2, radius: f32, count: usize| {
        for k in 0..=count {
            let angle = PI * (k as f32 / count as f32 - 0.5);
            profile.push(centre + radius * Vec2::new(angle.cos(), angle.sin()));
        }
    };
    roll(Vec2::new(0.285, 0.195), 0.055, 6);
    roll(Vec2::new(0.265, 0.285), 0.03, 4);
    let shaft = |t: f32| Vec2::new(0.235 - 0.042 * t.powf(1.8), 0.33 + 2.42 * t);
    let shaft: Vec<Vec2> = (0..=12).map(|k| shaft(k as f32 / 12.0)).collect();
    profile.extend(&shaft);
    let roll_at = Vec2::new(0.193, 2.78);
    profile.extend((0..=4).map(|k| {
        let angle = PI * (k as f32 / 4.0 - 0.5);
        roll_at + 0.03 * Vec2::new(angle.cos(), angle.sin())
    }));
    profile.push(Vec2::new(0.193, 2.9));
    profile.extend((0..=6).map(|k| {
        let t = k as f32 / 6.0;
        Vec2::new(0.205 + 0.16 * (t * FRAC_PI_2).sin().powf(0.9), 2.92 + 0.22 * t * t.sqrt())
    }));
    profile.push(Vec2::new(0.365, 3.16));
    let plinth = loft_square(&[Vec2::new(0.36, 0.0), Vec2::new(0.36, 0.14), Vec2::new(0.0, 0.14)], 0.18);
    let abacus = [
        Vec2::new(0.0, 3.16),
        Vec2::new(0.37, 3.16),
        Vec2::new(0.39, 3.19),
        Vec2::new(0.39, SPRING),
        Vec2::new(0.0, SPRING),
    ];
    lathe(&profile, 32).and(plinth).and(loft_square(&abacus, 0.2))
}

/// Middle of the rod that holds the drape lit by the spot.
const CURTAIN: DVec3 = DVec3::new(4.53, 3.3, -4.0);

/// The cloth in each bay of the left and of the right colonnade, counted from the far end.
const HUNG: [[Option<usize>; 6]; 2] =
    [[None, Some(1), Some(0), Some(2), None, Some(1)], [None, None, None, Some(0), None, Some(2)]];

fn drapes(scene: &mut Scene, palette: &Palette) {
    // Long enough to end inside the capitals.
    let rod_length = 1.0;
    let rod = [
        Vec2::new(0.0, -rod_length),
        Vec2::new(0.022, -rod_length),
        Vec2::new(0.022, 0.0),
        Vec2::new(0.022, rod_length),
        Vec2::new(0.0, rod_length),
    ];
    let rod = lathe(&rod, 12).moved(Affine3A::from_rotation_z(FRAC_PI_2));
    let rod = add_mesh(scene, "rod", vec![(rod, palette.brass)]);
    let cloth = drape([1.72, 2.35], 6.5, 0.07, 0.1);
    let meshes = palette.cloths.map(|material| {
        let name = scene.materials[material].name.replace("cloth", "drape");
        add_mesh(scene, &name, vec![(cloth.clone(), material)])
    });
    let banner = drape([0.8, 3.0], 3.0, 0.05, 0.1);
    let banner = add_mesh(scene, "banner", vec![(banner, palette.cloths[2])]);
    for x in [-2.4, 2.4] {
        place(scene, "banner", banner, turned(0, DVec3::new(x, 5.3, f64::from(-END) + 0.12)));
    }
    let hang = |scene: &mut Scene, cloth: usize, position: DVec3, quarters: i32| {
        place(scene, "rod", rod, turned(quarters, position));
        place(scene, "drape", meshes[cloth], turned(quarters, position));
    };
    for (side, row) in HUNG.iter().enumerate() {
        let (x, quarters) = if side == 0 { (-COLONNADE, 1) } else { (COLONNADE, -1) };
        for (bay, cloth) in row.iter().enumerate() {
            if let Some(cloth) = cloth {
                hang(scene, *cloth, DVec3::new(f64::from(x), 3.12, bay_z(bay as i32)), quarters);
            }
        }
    }
    // Across the right aisle, where the spot shines; visible through the open bay in front of it.
    hang(scene, 1, CURTAIN, 0);
    let wire = [Vec2::new(0.012, 0.0), Vec2::new(0.012, AISLE_TOP - CURTAIN.y as f32)];
    let wire = add_mesh(scene, "wire", vec![(lathe(&wire, 8), palette.brass)]);
    for x in [-0.8, 0.8] {
        place(scene, "wire", wire, turned(0, CURTAIN + DVec3::X * x));
    }
}

fn statues(scene: &mut Scene, palette: &Palette) {
    let pedestal = [
        [0.46, 0.0],
        [0.46, 0.14],
        [0.42, 0.18],
        [0.36, 0.22],
        [0.34, 0.74],
        [0.40, 0.80],
        [0.42, 0.82],
        [0.42, 0.92],
        [0.0, 0.92],
    ];
    let pedestal = loft_square(&pedestal.map(Vec2::from), 0.12);
    let pedestal = add_mesh(scene, "pedestal", vec![(pedestal, palette.stone)]);
    let foot = [[0.26, 0.0], [0.26, 0.03], [0.2, 0.05], [0.07, 0.09], [0.05, 0.16], [0.0, 0.16]];
    let foot = lathe(&foot.map(Vec2::from), 48);
    // A trefoil stands on one of its three loops if turned by a sixth.
    let knot = torus_knot([2, 3], [0.36, 0.17, 0.1], [320, 28]);
    let knot = knot.moved(Affine3A::from_rotation_translation(Quat::from_rotation_z(FRAC_PI_2), Vec3::Y * 0.68));
    let knot = add_mesh(scene, "knot", vec![(knot.and(foot), palette.bronze)]);
    let stand = DVec3::new(1.0, 0.0, 1.6);
    place(scene, "pedestal", pedestal, turned(0, stand));
    let turn = DQuat::from_rotation_y(-20_f64.to_radians());
    place(scene, "knot", knot, DAffine3::from_rotation_translation(turn, stand + DVec3::Y * 0.92));

    let jar = [
        [0.0, 0.0],
        [0.15, 0.0],
        [0.16, 0.03],
        [0.13, 0.07],
        [0.17, 0.18],
        [0.27, 0.42],
        [0.33, 0.66],
        [0.34, 0.80],
        [0.31, 0.94],
        [0.22, 1.06],
        [0.13, 1.14],
        [0.11, 1.24],
        [0.12, 1.32],
        [0.17, 1.37],
        [0.18, 1.39],
        [0.15, 1.39],
        [0.09, 1.30],
        [0.0, 1.26],
    ];
    let jar = add_mesh(scene, "jar", vec![(lathe(&jar.map(Vec2::from), 40), palette.clay)]);
    place(scene, "jar", jar, turned(0, DVec3::new(0.0, f64::from(DAIS), f64::from(-END) - 0.25)));

    let ball = add_mesh(scene, "ball", vec![(sphere(0.32, 20).shifted(0.0, 0.32, 0.0), palette.stone)]);
    for x in [-2.35, 2.35] {
        place(scene, "ball", ball, turned(0, DVec3::new(x, 0.0, f64::from(-END) + 1.2)));
    }
}

fn lights(scene: &mut Scene) {
    let sun = Light {
        name: "sun".into(),
        kind: LightKind::Directional,
        color: Vec3::new(1.0, 0.90, 0.76),
        intensity: 64_000.0,
        range: None,
        radius: 0.0,
        position: DVec3::ZERO,
        direction: Vec3::new(-0.28, -1.0, 0.14).normalize(),
    };
    let position = DVec3::new(4.5, 4.45, -0.7);
    let target = CURTAIN - DVec3::Y * 1.2;
    let spot = Light {
        name: "spot".into(),
        kind: LightKind::Spot { inner: 16_f32.to_radians(), outer: 28_f32.to_radians() },
        color: Vec3::new(1.0, 0.95, 0.88),
        intensity: 60_000.0,
        range: None,
        radius: 0.0,
        position,
        direction: (target - position).normalize().as_vec3().normalize(),
    };
    scene.lights.extend([sun, spot]);
}
