//! Free-form shapes: hanging cloth and torus knots. Metres, +Y up.

use super::shapes::{Surface, patch, segments};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// A hanging sheet of cloth from y = 0 down to -`height`, centred at x = 0, facing +Z; one side only.
///
/// It has `folds` across the width, `depth` (metres) deep at the hem and shallower where the cloth is held. `edge`
/// (metres) is the distance of vertices down the cloth; across, there are at least eight per fold.
pub fn drape([width, height]: [f32; 2], folds: f32, depth: f32, edge: f32) -> Surface {
    let columns = segments(width, edge).max((8.0 * folds) as usize);
    let rows = segments(height, edge);
    // Sines without a common period make every fold different. Each row drifts a little, and the sides draw in below
    // the rod.
    let shape = |s: f32, t: f32| {
        let phase = TAU * folds * s + 0.5 * (2.3 * t + 4.0 * s).sin();
        let wave = phase.sin() + 0.3 * (0.57 * phase + 1.1 + 0.8 * t).sin() + 0.14 * (1.73 * phase + 2.0).sin();
        let held = 0.45 + 0.55 * t.sqrt();
        let drawn_in = 1.0 - 0.05 * (PI * t.powf(0.7)).sin();
        let hem = 0.025 * height * t * (TAU * 0.5 * (s - 0.2)).cos();
        Vec3::new(
            width * (s - 0.5) * drawn_in + 0.12 * depth * (2.0 * phase).sin(),
            hem - height * t,
            depth * wave * held,
        )
    };
    patch([columns + 1, rows + 1], [false; 2], |column, row| {
        let (s, t) = (column as f32 / columns as f32, row as f32 / rows as f32);
        let step = 1e-3;
        let along = shape(s + step, t) - shape(s - step, t);
        let down = shape(s, t + step) - shape(s, (t - step).max(0.0));
        (shape(s, t), down.cross(along).normalize())
    })
}

/// A closed tube along a torus knot around the +Z axis. `windings` are the turns about the axis and about the core
/// circle (coprime), `radii` those of the core circle, of the torus and of the tube (metres), `pieces` the segments
/// along the tube and around it.
pub fn torus_knot(windings: [u32; 2], radii: [f32; 3], pieces: [usize; 2]) -> Surface {
    let [about_axis, about_core] = windings.map(f64::from);
    let [core, torus, tube] = radii.map(f64::from);
    let curve = |t: f64| {
        let (a, b) = (about_axis * t, about_core * t);
        let r = core + torus * b.cos();
        glam::DVec3::new(r * a.cos(), r * a.sin(), torus * b.sin())
    };
    patch(pieces, [true, true], |column, row| {
        let t = std::f64::consts::TAU * column as f64 / pieces[0] as f64;
        let around = std::f64::consts::TAU * row as f64 / pieces[1] as f64;
        // The torus's normal along the curve is never parallel to the curve and closes with it.
        let (a, b) = (about_axis * t, about_core * t);
        let tangent = (curve(t + 1e-5) - curve(t - 1e-5)).normalize();
        let outward = glam::DVec3::new(b.cos() * a.cos(), b.cos() * a.sin(), b.sin());
        let side = tangent.cross(outward).normalize();
        let up = side.cross(tangent);
        let normal = up * around.cos() + side * around.sin();
        ((curve(t) + normal * tube).as_vec3(), normal.as_vec3().normalize())
    })
}
