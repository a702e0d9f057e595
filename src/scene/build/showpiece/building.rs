//! The building: two storeys of arcades around an open courtyard, with galleries behind them and roofs.
//!
//! Repeated parts are made once, around the middle of a bay at z = 0 with the court towards +Z, and are instanced in
//! all bays.

use super::super::masonry::ring_lines;
use super::super::{Surface, add_mesh, lathe, patch, place, quad, ring, sheet, spans, sphere, turned};
use super::Palette;
use super::solids::{arc, block, block_without, boxed, half_ring, moulding, wrapped};
use crate::scene::Scene;
use glam::{Affine3A, DVec3, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

// Dimensions [m].
/// Distance between columns, and number of bays along x and z.
const PITCH: f32 = 3.0;
const BAYS: [u32; 2] = [3, 4];
/// Half sizes of the court, from axis to axis of the columns.
pub(super) const COURT: Vec2 = Vec2::new(0.5 * PITCH * BAYS[0] as f32, 0.5 * PITCH * BAYS[1] as f32);
/// Depth of the galleries, from the columns' axis.
pub(super) const DEPTH: f32 = 2.7;
const HALF: f32 = 0.5 * PITCH;
const THICK: f32 = 0.5;
const RADIUS: f32 = 1.14;
const BAND: f32 = 1.37;
const PIECES: usize = 48;
/// Heights: floors of the lower and the upper gallery, springing lines, ceilings, top of the wall.
pub(super) const FLOOR: [f32; 2] = [0.16, 4.6];
const SPRING: [f32; 2] = [2.85, 6.75];
const CEILING: [f32; 2] = [4.38, 8.3];
const TOP: f32 = 8.66;
/// Grid spacing of plain faces.
const EDGE: f32 = 0.5;
/// Edge of the roof: distance beyond the columns' axis and height there; and the roof's slope.
const EAVE: [f32; 2] = [0.85, 8.80];
const SLOPE: f32 = 0.27;

/// Middles of all bays: the quarter turn that takes +Z to the court, and the position.
fn bays() -> Vec<(i32, DVec3)> {
    let mut all = Vec::new();
    for quarter in 0..4 {
        let (count, far) = if quarter % 2 == 0 { (BAYS[0], COURT.y) } else { (BAYS[1], COURT.x) };
        for k in 0..count {
            let along = PITCH * (k as f32 - 0.5 * (count - 1) as f32);
            all.push((quarter, turned(quarter, DVec3::ZERO).transform_point3(Vec3::new(along, 0.0, -far).as_dvec3())));
        }
    }
    all
}

/// The four sides: quarter turn, half length between the corners' axes, distance from the centre.
fn sides() -> [(i32, f32, f32); 4] {
    [(0, COURT.x, COURT.y), (1, COURT.y, COURT.x), (2, COURT.x, COURT.y), (3, COURT.y, COURT.x)]
}

/// Adds the building to the scene.
pub(super) fn build(scene: &mut Scene, palette: &Palette) {
    let parts = vec![(arcade(0), palette.ashlar), (arcade(1), palette.plaster), (trims(), palette.marble)];
    let bay = add_mesh(scene, "bay", parts);
    let balusters = add_mesh(scene, "balusters", vec![(balusters(), palette.marble)]);
    let beams = add_mesh(scene, "beams", vec![(beams(), palette.wood)]);
    for (quarter, middle) in bays() {
        for (name, mesh) in [("bay", bay), ("balusters", balusters), ("beams", beams)] {
            place(scene, name, mesh, turned(quarter, middle));
        }
    }
    columns(scene, palette);
    floors(scene, palette);
    walls(scene, palette);
    roofs(scene, palette);
}

/// The wall with its arch, for one storey.
fn arcade(storey: usize) -> Surface {
    let spring = SPRING[storey];
    let tops = [[FLOOR[1] - 0.1, CEILING[0]], [TOP, CEILING[1]]][storey];
    let (lines, _) = ring_lines(HALF, PIECES);
    let mut wall = Surface::default();
    for (side, top) in tops.into_iter().enumerate() {
        let above = spans(&[HALF, top - spring], EDGE);
        let mut face = ring(BAND, HALF, PIECES, EDGE).shifted(0.0, 0.0, 0.5 * THICK);
        if above.len() > 1 && top - spring > HALF + 0.01 {
            face = face.and(sheet(Vec3::Z * 0.5 * THICK, [Vec3::X, Vec3::Y], &lines, &above, |_, _| true));
        }
        wall = wall.and(if side == 0 { face } else { face.moved(Affine3A::from_rotation_y(PI)) });
    }
    boxed(wall.shifted(0.0, spring, 0.0))
}

/// Archivolts, keystones, string courses and the kerb.
fn trims() -> Surface {
    let front = 0.5 * THICK;
    let side: Vec<Vec2> = [Vec2::new(BAND, front)]
        .into_iter()
        .chain(arc(Vec2::new(BAND - 0.025, front + 0.03), 0.025, 0.0, 90.0, 3))
        .chain(arc(Vec2::new(RADIUS + 0.155, front + 0.045), 0.01, 90.0, 180.0, 2))
        .chain(arc(Vec2::new(RADIUS + 0.03, front + 0.0), 0.03, 90.0, 180.0, 4))
        .collect();
    let profile: Vec<Vec2> = side.iter().copied().chain(side.iter().rev().map(|p| Vec2::new(p.x, -p.y))).collect();
    let mut trims = Surface::default();
    for spring in SPRING {
        trims = trims.and(half_ring(&profile, PIECES).shifted(0.0, spring, 0.0));
        let key = block(
            Vec3::new(-0.115, RADIUS - 0.03, -front - 0.085),
            Vec3::new(0.115, BAND + 0.07, front + 0.085),
            0.02,
            EDGE,
        );
        trims = trims.and(key.shifted(0.0, spring, 0.0));
    }
    // Between the storeys, and below the roof.
    let course: Vec<Vec2> = [Vec2::new(front, 4.30)]
        .into_iter()
        .chain(arc(Vec2::new(front + 0.02, 4.34), 0.03, -60.0, 30.0, 3))
        .chain(arc(Vec2::new(front + 0.11, 4.46), 0.07, 200.0, 130.0, 4))
        .chain(arc(Vec2::new(front + 0.15, 4.60), 0.045, -60.0, 90.0, 5))
        .chain([Vec2::new(front - 0.05, 4.655)])
        .collect();
    let cornice: Vec<Vec2> = [Vec2::new(front, 8.28)]
        .into_iter()
        .chain(arc(Vec2::new(front + 0.03, 8.33), 0.035, -60.0, 60.0, 3))
        .chain([Vec2::new(front + 0.06, 8.38), Vec2::new(front + 0.06, 8.50)])
        .chain(arc(Vec2::new(front + 0.22, 8.56), 0.06, -90.0, 30.0, 4))
        .chain(arc(Vec2::new(front + 0.30, 8.66), 0.05, -60.0, 90.0, 4))
        .chain([Vec2::new(front - 0.05, 8.72)])
        .collect();
    trims = trims.and(moulding(&course, HALF, EDGE)).and(moulding(&cornice, HALF, EDGE));
    for k in 0..15 {
        let x = -HALF + 0.1 + 0.2 * k as f32;
        let low = Vec3::new(x - 0.055, 8.385, front + 0.03);
        let high = Vec3::new(x + 0.055, 8.495, front + 0.15);
        trims = trims.and(block_without(low, high, 0.012, EDGE, &[Vec3::Y, Vec3::NEG_Z]));
    }
    let ends = [Vec3::X, Vec3::NEG_X, Vec3::NEG_Y];
    let kerb = block_without(Vec3::new(-HALF, -0.05, -0.42), Vec3::new(HALF, FLOOR[0], 0.42), 0.03, EDGE, &ends);
    let sill =
        block_without(Vec3::new(-1.4, FLOOR[1], -0.14), Vec3::new(1.4, FLOOR[1] + 0.14, 0.14), 0.02, EDGE, &ends);
    let rail = block_without(
        Vec3::new(-1.4, FLOOR[1] + 0.80, -0.15),
        Vec3::new(1.4, FLOOR[1] + 0.93, 0.15),
        0.045,
        EDGE,
        &ends[..2],
    );
    trims.and(kerb).and(sill).and(rail)
}

fn balusters() -> Surface {
    let (low, high) = (FLOOR[1] + 0.13, FLOOR[1] + 0.81);
    let shape = [
        [0.070, 0.0],
        [0.070, 0.05],
        [0.050, 0.065],
        [0.040, 0.085],
        [0.052, 0.115],
        [0.070, 0.17],
        [0.077, 0.22],
        [0.072, 0.27],
        [0.055, 0.34],
        [0.040, 0.42],
        [0.034, 0.50],
        [0.034, 0.535],
        [0.050, 0.55],
        [0.050, 0.575],
        [0.036, 0.59],
        [0.046, 0.615],
        [0.066, 0.63],
        [0.066, 0.68],
    ];
    let profile: Vec<Vec2> = shape.iter().map(|p| Vec2::new(p[0], low + p[1] / 0.68 * (high - low))).collect();
    let one = wrapped(lathe(&profile, 16), 0.5);
    (0..9).fold(Surface::default(), |all, k| all.and(one.clone().shifted(0.25 * (k as f32 - 4.0), 0.0, 0.0)))
}

/// Beams below both ceilings of a bay.
fn beams() -> Surface {
    let mut beams = Surface::default();
    for ceiling in CEILING {
        for k in 0..3 {
            let x = k as f32 - 1.0;
            let low = Vec3::new(x - 0.11, ceiling - 0.24, -DEPTH - 0.05);
            let high = Vec3::new(x + 0.11, ceiling + 0.05, -0.2);
            beams = beams.and(block_without(low, high, 0.02, 0.8, &[Vec3::Y, Vec3::Z, Vec3::NEG_Z]));
        }
    }
    beams
}

/// A column with its capital, `height` \[m\] high and `r` \[m\] thick below.
fn column(height: f32, r: f32) -> Surface {
    let bell = height - 0.30 - 2.3 * r;
    let base = 0.15;
    let mut profile = vec![Vec2::new(1.40 * r, base - 0.01)];
    profile.extend(arc(Vec2::new(1.28 * r, base + 0.17 * r), 0.17 * r, -80.0, 80.0, 8));
    profile.extend(arc(Vec2::new(1.27 * r, base + 0.52 * r), 0.13 * r, 250.0, 110.0, 6));
    profile.extend(arc(Vec2::new(1.12 * r, base + 0.80 * r), 0.11 * r, -80.0, 80.0, 6));
    let foot = base + 1.0 * r;
    for k in 0..=12 {
        let t = k as f32 / 12.0;
        // A swelling shaft that narrows upwards, with a flare at the foot.
        let radius = r * (1.0 - 0.16 * t.powf(1.7) + 0.06 * (1.0 - t).powi(24));
        profile.push(Vec2::new(radius, foot + t * (bell - 0.10 - foot)));
    }
    profile.extend(arc(Vec2::new(0.86 * r, bell - 0.055), 0.03, -80.0, 80.0, 6));
    for k in 0..=8 {
        let t = k as f32 / 8.0;
        profile.push(Vec2::new(r * (0.84 + 0.42 * t * t * t), bell + t * 2.3 * r));
    }
    let mut column = wrapped(lathe(&profile, 32), 1.5);
    for (count, rise, long, turn) in [(8, 0.05 * r, 1.15 * r, 0.0), (8, 0.35 * r, 1.75 * r, 0.5)] {
        for k in 0..count {
            let angle = TAU * (k as f32 + turn) / count as f32;
            column = column.and(leaf(r, bell, rise, long).moved(Affine3A::from_rotation_y(angle)));
        }
    }
    for k in 0..4 {
        let angle = 0.25 * PI + 0.5 * PI * k as f32;
        let curl = sphere(0.24 * r, 10).moved(Affine3A::from_translation(Vec3::new(1.42 * r, bell + 2.05 * r, 0.0)));
        column = column.and(boxed(curl.moved(Affine3A::from_rotation_y(angle))));
    }
    let square = |half: f32, depth: f32, low: f32, high: f32, round: f32| {
        block(Vec3::new(-half, low, -depth), Vec3::new(half, high, depth), round, EDGE)
    };
    column
        .and(square(1.5 * r, 1.5 * r, -0.02, base, 0.015))
        .and(square(1.52 * r, 1.52 * r, height - 0.30, height - 0.2, 0.025))
        .and(square(0.385, 0.335, height - 0.21, height + 0.005, 0.02))
}

/// An acanthus leaf on the bell of a capital, towards +X, visible from both sides.
fn leaf(r: f32, bell: f32, rise: f32, long: f32) -> Surface {
    let (columns, rows) = (7, 9);
    let shape = |s: f32, t: f32| {
        let up = t.min(0.72);
        let at = ((rise + long * up) / (2.3 * r)).clamp(0.0, 1.0);
        let curl = (t - 0.72).max(0.0) / 0.28 * 1.9;
        let radius = 0.26 * r;
        let out = r * (0.87 + 0.42 * at * at * at) + 0.02 * r + 0.22 * r * t * t + radius * (1.0 - curl.cos());
        let high = bell + rise + long * up + radius * curl.sin();
        let lobes = 0.84 + 0.16 * (5.5 * PI * t + 0.6).sin().abs();
        let half = 0.40 * r * lobes * (1.0 - 0.5 * t * t * t);
        let groove = 0.05 * r * (1.0 - (2.5 * PI * s).cos()) * 0.5 - 0.10 * r * s * s;
        Vec3::new(out + groove, high, half * s)
    };
    let point = |column: usize, row: usize| {
        let (s, t) = (2.0 * column as f32 / (columns - 1) as f32 - 1.0, row as f32 / (rows - 1) as f32);
        let step = 0.01;
        let across = shape(s + step, t) - shape(s - step, t);
        let along = shape(s, t + step) - shape(s, t - step);
        (shape(s, t), along.cross(across).normalize())
    };
    let front = boxed(patch([columns, rows], [false; 2], point));
    let back = front.reversed();
    front.and(back)
}

/// Columns between the bays of both storeys, and piers at the corners.
fn columns(scene: &mut Scene, palette: &Palette) {
    let tall = SPRING[0] - FLOOR[0];
    let short = SPRING[1] - FLOOR[1];
    let meshes = [column(tall, 0.21), column(short, 0.175)];
    let meshes = meshes.map(|column| add_mesh(scene, "column", vec![(column, palette.marble)]));
    let pier = |low: f32, high: f32, half: f32, round: f32| {
        block(Vec3::new(-half, low, -half), Vec3::new(half, high, half), round, EDGE)
    };
    let shaft = pier(0.0, TOP, 0.36, 0.025);
    let mut trim = pier(0.0, 0.5, 0.42, 0.03).and(pier(FLOOR[1], FLOOR[1] + 0.4, 0.41, 0.03));
    trim = trim.and(pier(-0.05, FLOOR[0], 0.46, 0.03));
    for spring in SPRING {
        trim = trim.and(pier(spring - 0.22, spring, 0.40, 0.02)).and(pier(spring - 0.34, spring - 0.26, 0.385, 0.03));
    }
    let pier = add_mesh(scene, "pier", vec![(shaft, palette.ashlar), (trim, palette.marble)]);
    for (quarter, half, far) in sides() {
        let count = (2.0 * half / PITCH).round() as u32;
        for k in 0..count {
            let at = Vec3::new(PITCH * k as f32 - half, 0.0, -far).as_dvec3();
            let at = turned(quarter, DVec3::ZERO).transform_point3(at);
            if k == 0 {
                place(scene, "pier", pier, turned(quarter, at));
                continue;
            }
            for (mesh, floor) in meshes.into_iter().zip(FLOOR) {
                place(scene, "column", mesh, turned(quarter, at + DVec3::Y * f64::from(floor)));
            }
        }
    }
}

/// A horizontal rectangle at a height, facing up or down.
fn level(x: [f32; 2], z: [f32; 2], y: f32, up: bool) -> Surface {
    let (along_x, along_z) = (Vec3::X * (x[1] - x[0]), Vec3::Z * (z[1] - z[0]));
    let origin = Vec3::new(x[0], y, z[0]);
    boxed(if up { quad(origin, along_z, along_x, EDGE) } else { quad(origin, along_x, along_z, EDGE) })
}

/// The four rectangles between two rectangles around the origin.
fn frame(inner: Vec2, outer: Vec2, y: f32, up: bool) -> Surface {
    let ends = [[-outer.y, -inner.y], [inner.y, outer.y]];
    let flanks = [[-outer.x, -inner.x], [inner.x, outer.x]];
    let whole = ends.iter().fold(Surface::default(), |all, z| all.and(level([-outer.x, outer.x], *z, y, up)));
    flanks.iter().fold(whole, |all, x| all.and(level(*x, [-inner.y, inner.y], y, up)))
}

/// The court's slab floor with a band of mosaic, tiles in the galleries, and ceilings.
fn floors(scene: &mut Scene, palette: &Palette) {
    let (inner, band) = (Vec2::new(3.0, 4.5), 0.48);
    let edge = COURT - 0.40;
    let slabs = level([-inner.x, inner.x], [-inner.y, inner.y], 0.0, true).and(frame(inner + band, edge, 0.0, true));
    let mut mosaic = Surface::default();
    let mut corners = Surface::default();
    for turn in 0..4 {
        let (half, far) = if turn % 2 == 0 { (inner.x, inner.y) } else { (inner.y, inner.x) };
        let strip = quad(Vec3::new(-half, 0.0, far), Vec3::Z * band, Vec3::X * 2.0 * half, EDGE);
        let mut strip = boxed(strip);
        strip.vertices.iter_mut().for_each(|vertex| vertex.uv0.y -= far);
        mosaic = mosaic.and(strip.moved(Affine3A::from_rotation_y(0.5 * PI * turn as f32)));
        let (x, z) = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)][turn];
        let low = Vec2::new(x, z) * (inner + 0.5 * band) - 0.5 * band;
        corners = corners.and(level([low.x, low.x + band], [low.y, low.y + band], 0.0, true));
    }
    let outer = COURT + DEPTH;
    let inside = COURT + 0.40;
    let tiles = frame(inside, outer, FLOOR[0], true).and(frame(COURT - 0.2, outer, FLOOR[1], true));
    let ceilings = frame(COURT + 0.2, outer, CEILING[0], false).and(frame(COURT + 0.2, outer, CEILING[1], false));
    let parts = vec![
        (slabs, palette.slabs),
        (mosaic.and(corners), palette.mosaic),
        (tiles, palette.clay_tiles),
        (ceilings, palette.plaster),
    ];
    let mesh = add_mesh(scene, "floors", parts);
    place(scene, "floors", mesh, turned(0, DVec3::ZERO));
}

/// The galleries' outer walls with a dado, and doors in the middle of some bays.
fn walls(scene: &mut Scene, palette: &Palette) {
    let dado = 1.15;
    for (quarter, half, far) in sides() {
        let half = half + DEPTH;
        let face = |low: f32, high: f32| {
            boxed(quad(Vec3::new(-half, low, 0.0), Vec3::X * 2.0 * half, Vec3::Y * (high - low), EDGE))
        };
        let rail: Vec<Vec2> = [Vec2::new(0.0, dado - 0.08)]
            .into_iter()
            .chain(arc(Vec2::new(0.03, dado - 0.03), 0.03, -60.0, 90.0, 5))
            .chain([Vec2::new(-0.01, dado + 0.005)])
            .collect();
        let foot: Vec<Vec2> = [Vec2::new(0.05, FLOOR[0] - 0.01)]
            .into_iter()
            .chain(arc(Vec2::new(0.03, FLOOR[0] + 0.16), 0.02, 0.0, 90.0, 3))
            .chain([Vec2::new(-0.01, FLOOR[0] + 0.185)])
            .collect();
        let parts = vec![
            (face(FLOOR[0], dado), palette.ashlar),
            (face(dado, CEILING[0]).and(face(FLOOR[1], CEILING[1])), palette.plaster),
            (moulding(&rail, half, EDGE).and(moulding(&foot, half, EDGE)), palette.marble),
        ];
        let mesh = add_mesh(scene, "wall", parts);
        let at = turned(quarter, DVec3::ZERO).transform_point3(DVec3::new(0.0, 0.0, -f64::from(far + DEPTH)));
        place(scene, "wall", mesh, turned(quarter, at));
    }
    let door = door(scene, palette);
    for (quarter, middle) in bays() {
        let back = turned(quarter, DVec3::ZERO).transform_vector3(DVec3::Z * f64::from(-DEPTH));
        let along = if quarter % 2 == 0 { middle.x } else { middle.z };
        if along.abs() < 2.0 {
            place(scene, "door", door, turned(quarter, middle + back + DVec3::Y * f64::from(FLOOR[0])));
        }
        place(scene, "shutters", door, turned(quarter, middle + back + DVec3::Y * f64::from(FLOOR[1])));
    }
}

/// A double door with panels in a stone frame, on a wall at z = 0.
fn door(scene: &mut Scene, palette: &Palette) -> usize {
    let bar = |x: [f32; 2], y: [f32; 2], z: f32, round: f32| {
        block_without(Vec3::new(x[0], y[0], -0.05), Vec3::new(x[1], y[1], z), round, 0.8, &[Vec3::NEG_Z])
    };
    let frame = bar([-0.78, -0.62], [-0.02, 2.45], 0.10, 0.02)
        .and(bar([0.62, 0.78], [-0.02, 2.45], 0.10, 0.02))
        .and(bar([-0.84, 0.84], [2.44, 2.62], 0.13, 0.02))
        .and(bar([-0.92, 0.92], [2.61, 2.68], 0.19, 0.025));
    let mut leaves = bar([-0.62, 0.62], [0.0, 2.45], 0.02, 0.005);
    let mut knobs = Surface::default();
    for side in [-1.0_f32, 1.0] {
        let span = |a: f32, b: f32| [(side * a).min(side * b), (side * a).max(side * b)];
        leaves = leaves.and(bar(span(0.01, 0.11), [0.02, 2.44], 0.05, 0.01));
        leaves = leaves.and(bar(span(0.52, 0.615), [0.02, 2.44], 0.05, 0.01));
        for [low, high] in [[0.02, 0.18], [0.92, 1.06], [1.72, 1.84], [2.30, 2.44]] {
            leaves = leaves.and(bar(span(0.10, 0.53), [low, high], 0.048, 0.01));
        }
        for [low, high] in [[0.24, 0.86], [1.12, 1.66], [1.90, 2.24]] {
            leaves = leaves.and(bar(span(0.16, 0.47), [low, high], 0.038, 0.015));
        }
        knobs = knobs.and(boxed(sphere(0.032, 14).shifted(side * 0.06, 1.0, 0.085)));
    }
    add_mesh(scene, "door", vec![(frame, palette.marble), (leaves, palette.wood), (knobs, palette.brass)])
}

/// Tiled roofs that slope to the court, the boards below their eaves, and the outside, which only keeps light out.
fn roofs(scene: &mut Scene, palette: &Palette) {
    let [eave, height] = EAVE;
    let deep = eave + DEPTH + 0.3;
    let roof_at = |z: f32| height + SLOPE * (eave - z);
    for (quarter, half, far) in sides() {
        let long = half + DEPTH + 0.3;
        let covers = (2.0 * long / 0.24) as usize;
        let mut tiles = Surface::default();
        for k in 0..covers {
            let x = 0.24 * (k as f32 - 0.5 * (covers - 1) as f32);
            tiles = tiles.and(cover(deep).shifted(x, 0.0, 0.0));
        }
        let slope = Vec3::new(0.0, roof_at(eave - deep) - height, -deep);
        let pans = boxed(quad(Vec3::new(-long, height, eave), Vec3::X * 2.0 * long, slope, EDGE));
        let low = Vec3::new(-long, height - 0.06, 0.2);
        let mut boards = boxed(quad(low, Vec3::X * 2.0 * long, Vec3::Z * (eave - 0.2), EDGE));
        boards = boards.and(block(
            Vec3::new(-long, height - 0.09, eave - 0.05),
            Vec3::new(long, height + 0.015, eave - 0.01),
            0.012,
            1.0,
        ));
        let rafters = (2.0 * half / 0.5) as usize;
        for k in 0..rafters {
            let x = 0.5 * (k as f32 - 0.5 * (rafters - 1) as f32);
            let (low, high) =
                (Vec3::new(x - 0.05, height - 0.17, 0.2), Vec3::new(x + 0.05, height - 0.05, eave - 0.08));
            boards = boards.and(block(low, high, 0.012, EDGE));
        }
        let mesh = add_mesh(scene, "roof", vec![(tiles.and(pans), palette.clay), (boards, palette.wood)]);
        let to = |z: f32| turned(quarter, DVec3::ZERO).transform_point3(DVec3::new(0.0, 0.0, f64::from(z)));
        scene.meshes[mesh].place_apart(3.0);
        place(scene, "roof", mesh, turned(quarter, to(-far)));
        let top = roof_at(eave - deep);
        let shell = quad(Vec3::new(long, -0.1, 0.0), Vec3::NEG_X * 2.0 * long, Vec3::Y * (top + 0.1), 2.0);
        let shell = add_mesh(scene, "outside", vec![(boxed(shell), palette.clay)]);
        scene.meshes[shell].place_apart(4.0);
        place(scene, "outside", shell, turned(quarter, to(-far - DEPTH - 0.3)));
    }
}

/// A row of cover tiles up the roof, each with its lower end on the tile below.
fn cover(deep: f32) -> Surface {
    let [eave, height] = EAVE;
    let (around, count) = (9, 8);
    let long = deep / count as f32;
    (0..count).fold(Surface::default(), |all, tile| {
        let start = eave + 0.04 - long * tile as f32;
        let profile = [(0.0, 0.084), (0.0, 0.102), (1.06, 0.084)];
        let part = patch([around, profile.len()], [false; 2], |column, row| {
            let (sine, cosine) = (PI * column as f32 / (around - 1) as f32).sin_cos();
            let (t, radius) = profile[row];
            let z = start - long * t;
            let y = height + SLOPE * (eave - z) + 0.02 * (1.0 - t);
            let normal = Vec3::new(cosine, sine, if row == 0 { 1.5 } else { 0.2 });
            (Vec3::new(radius * cosine, y + radius * sine, z), normal.normalize())
        });
        all.and(boxed(part))
    })
}
