//! Masonry: arches, vaults and steps. Metres, +Y up.

use super::shapes::{Surface, patch, segments, sheet, spans};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// The wall between a semicircle around the origin and the half square around it, in the plane z = 0, facing +Z.
///
/// `count` is the number of pieces along the circle, a multiple of four so that they meet the square's corners.
pub fn ring(radius: f32, half: f32, count: usize, edge: f32) -> Surface {
    assert!(count.is_multiple_of(4), "ring: {count} pieces do not meet the corners");
    let rows = segments(half * 1.2 - radius, edge) + 1;
    patch([rows, count + 1], [false; 2], |column, row| {
        let (inner, outer) = (circle(row, count) * radius, ring_outside(half, row, count));
        (inner.lerp(outer, column as f32 / (rows - 1) as f32), Vec3::Z)
    })
}

/// Point `k` of `count` along the upper half of the unit circle, from +X to -X.
fn circle(k: usize, count: usize) -> Vec3 {
    let angle = PI * k as f32 / count as f32;
    let cosine = if 2 * k == count { 0.0 } else { angle.cos() };
    let sine = if k == 0 || k == count { 0.0 } else { angle.sin() };
    Vec3::new(cosine, sine, 0.0)
}

/// Point of the surrounding square in the direction of point `k` of the circle.
fn ring_outside(half: f32, k: usize, count: usize) -> Vec3 {
    let direction = circle(k, count);
    if 4 * k == count || 4 * k == 3 * count {
        return Vec3::new(half * direction.x.signum(), half, 0.0);
    }
    let scaled = direction * (half / direction.x.abs().max(direction.y));
    if scaled.y.abs() > scaled.x.abs() { scaled.with_y(half) } else { scaled.with_x(half * direction.x.signum()) }
}

/// Grid lines that continue a ring: the x of its points at the top of the square, and the y of its points at the sides,
/// both increasing.
pub(super) fn ring_lines(half: f32, count: usize) -> (Vec<f32>, Vec<f32>) {
    let top = (count / 4..=3 * count / 4).rev().map(|k| ring_outside(half, k, count).x).collect();
    let side = (0..=count / 4).map(|k| ring_outside(half, k, count).y).collect();
    (top, side)
}

/// Dimensions of one bay of an arcade (metres); the springing line is at y = 0, the opening is centred at x = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArchShape {
    /// Distance from column axis to column axis.
    pub pitch: f32,
    /// Radius of the opening.
    pub radius: f32,
    /// Thickness of the wall.
    pub thickness: f32,
    /// Top of the wall on the +Z side and on the -Z side, above the springing line; at least half the pitch.
    pub height: [f32; 2],
    /// Width of the raised band around the opening, and its depth in front of the wall.
    pub band: [f32; 2],
}

/// One bay of an arcade: a wall along x with a semicircular opening, a raised band around the opening on both sides,
/// and the barrel vault in the opening. Adjacent bays at distance `pitch` join vertex to vertex.
pub fn arch(shape: ArchShape, edge: f32) -> Surface {
    let ArchShape { pitch, radius, thickness, height, band } = shape;
    let half = 0.5 * pitch;
    let count = 4 * segments(PI * radius / 4.0, edge).next_multiple_of(2);
    let [band_width, band_depth] = band;
    let (front, outer) = (0.5 * thickness + band_depth, radius + band_width);
    let (lines, _) = ring_lines(half, count);
    let turn = glam::Affine3A::from_rotation_y(PI);

    let mut surface = Surface::default();
    for (side, top) in height.into_iter().enumerate() {
        let mut face = ring(outer, half, count, edge).shifted(0.0, 0.0, 0.5 * thickness);
        if top > half {
            let origin = Vec3::new(0.0, 0.0, 0.5 * thickness);
            face = face.and(sheet(origin, [Vec3::X, Vec3::Y], &lines, &spans(&[half, top], edge), |_, _| true));
        }
        let flat = patch([3, count + 1], [false; 2], |column, row| {
            let r = radius + band_width * column as f32 / 2.0;
            ((circle(row, count) * r).with_z(front), Vec3::Z)
        });
        let rim = patch([count + 1, 2], [false; 2], |column, row| {
            let z = 0.5 * thickness + band_depth * row as f32;
            ((circle(column, count) * outer).with_z(z), circle(column, count))
        });
        let face = face.and(flat).and(rim);
        surface = surface.and(if side == 0 { face } else { face.moved(turn) });
    }
    let depth = spans(&[-front, front], edge);
    surface.and(patch([count + 1, depth.len()], [false; 2], |column, row| {
        ((circle(column, count) * radius).with_z(depth[row]), -circle(column, count))
    }))
}

/// The inside of a niche behind a wall at z = 0, towards -Z: half a cylinder from y = -`height` to 0 under a quarter
/// sphere. Its front edge joins a `ring` of the same radius and `count` vertex to vertex.
pub fn vault_dome(radius: f32, height: f32, count: usize, edge: f32) -> Surface {
    let levels = spans(&[-height, 0.0], edge);
    let plan = |k: usize| {
        let p = circle(k, count);
        Vec3::new(p.x, 0.0, -p.y)
    };
    let walls = patch([count + 1, levels.len()], [false; 2], |column, row| {
        ((plan(column) * radius).with_y(levels[row]), -plan(column))
    });
    let rows = count / 2;
    let dome = patch([count + 1, rows + 1], [false; 2], |column, row| {
        let (p, angle) = (circle(column, count), FRAC_PI_2 * row as f32 / rows as f32);
        let cosine = if row == rows { 0.0 } else { angle.cos() };
        let direction = Vec3::new(p.x, p.y * cosine, -p.y * angle.sin());
        (direction * radius, -direction.normalize())
    });
    walls.and(dome)
}

/// A flight of steps centred at x = 0 that rises towards -Z from z = 0, open below and behind. It has `count` steps of
/// height `rise` (metres). All steps except the last are `tread` (metres) deep; the last, a landing, is `landing`
/// (metres) deep.
pub fn steps(width: f32, rise: f32, [tread, landing]: [f32; 2], count: usize, edge: f32) -> Surface {
    let across = spans(&[-0.5 * width, 0.5 * width], edge);
    let mut surface = Surface::default();
    for step in 0..count {
        let (bottom, top) = (rise * step as f32, rise * (step + 1) as f32);
        let front = -tread * step as f32;
        let back = front - if step + 1 == count { landing } else { tread };
        let rise_lines = spans(&[bottom, top], edge);
        let deep = spans(&[back, front], edge);
        let riser = sheet(Vec3::new(0.0, 0.0, front), [Vec3::X, Vec3::Y], &across, &rise_lines, |_, _| true);
        let top_face = sheet(Vec3::new(0.0, top, 0.0), [Vec3::Z, Vec3::X], &deep, &across, |_, _| true);
        surface = surface.and(riser).and(top_face);
        let up: Vec<f32> = (0..=step + 1).map(|k| rise * k as f32).collect();
        let right = Vec3::new(0.5 * width, 0.0, 0.0);
        surface = surface.and(sheet(right, [Vec3::Y, Vec3::Z], &up, &deep, |_, _| true));
        surface = surface.and(sheet(-right, [Vec3::Z, Vec3::Y], &deep, &up, |_, _| true));
    }
    surface
}
