//! A marble statue of a winged victory in the antique manner, without head and arms. A field that approximates the
//! distance to its surface is turned into triangles.

use super::super::Surface;
use super::nets;
use super::noise::{clouds_in_space, smoothstep};
use glam::{Vec2, Vec3, Vec3Swizzles};
use rayon::prelude::*;

const LOW: Vec3 = Vec3::new(-1.06, -0.12, -1.16);
const HIGH: Vec3 = Vec3::new(1.06, 2.76, 0.62);

/// The statue, 2.6 m high on its base at y = 0, facing +Z, made with cells of side `cell` \[m\]. Vertex colours darken
/// the folds.
pub(super) fn statue(cell: f32) -> Surface {
    let wing = Wing::new();
    let field = |at: Vec3| figure(at, &wing);
    let mut statue = nets::surface(&field, LOW, HIGH, cell);
    statue.vertices.par_iter_mut().for_each(|vertex| {
        let open =
            [0.02_f32, 0.05, 0.1].map(|far| (field(vertex.position + far * vertex.normal) / far).clamp(0.0, 1.0));
        let open = open.iter().sum::<f32>() / 3.0;
        let stain = clouds_in_space(6.0 * vertex.position, 4, 7);
        let light = (0.45 + 0.55 * open.powf(0.7)) * (0.95 + 0.08 * stain);
        let color = Vec3::new(0.98, 0.94, 0.87).lerp(Vec3::ONE, open) * light;
        let [r, g, b] = color.to_array().map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        vertex.color = [r, g, b, 255];
    });
    statue
}

/// Smooth union, with a fillet within `k` \[m\] of both surfaces.
fn join(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * k * h * h
}

/// Smooth intersection.
fn common(a: f32, b: f32, k: f32) -> f32 {
    -join(-a, -b, k)
}

/// A capsule with different radii at its ends.
fn limb(at: Vec3, a: Vec3, b: Vec3, radii: [f32; 2]) -> f32 {
    let t = ((at - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    at.distance(a.lerp(b, t)) - (radii[0] + (radii[1] - radii[0]) * t)
}

fn ellipsoid(at: Vec3, middle: Vec3, radii: Vec3) -> f32 {
    let p = at - middle;
    let (k0, k1) = ((p / radii).length(), (p / (radii * radii)).length());
    if k1 > 0.0 { k0 * (k0 - 1.0) / k1 } else { -radii.min_element() }
}

fn v(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// Profile of cloth folds by phase, from 0 to 1: broad backs, sharp valleys.
fn folds(phase: f32) -> f32 {
    (phase.sin().powi(2) + 0.015).sqrt()
}

/// Field of the whole statue: negative inside.
fn figure(at: Vec3, wing: &Wing) -> f32 {
    // The torso is turned against the hips.
    let turn = -0.22 * smoothstep(0.95, 1.5, at.y);
    let (sin, cos) = turn.sin_cos();
    let up = v(cos * at.x - sin * at.z, at.y, sin * at.x + cos * at.z);
    let body = if at.y > 0.25 { join(breast(up), robe(at), 0.03) } else { 0.3 };
    let feathers = wing.distance(up);
    let wings = body.min(feathers).min(join(body, wing.arm(up), 0.07));
    wings.min(base(at))
}

/// The base: the bow of a ship, roughly hewn.
fn base(at: Vec3) -> f32 {
    let p = at - v(0.0, 0.16, -0.06);
    let narrow = 1.0 - 0.55 * smoothstep(0.1, 0.6, p.z) + 0.2 * p.y;
    let q = v(p.x / narrow, p.y, p.z).abs() - v(0.27, 0.15, 0.48);
    let block = q.max(Vec3::ZERO).length() + q.max_element().min(0.0) - 0.025;
    let keel = folds(8.0 * p.y + 0.6) * 0.012;
    0.8 * block - keel - 0.006 * clouds_in_space(9.0 * at, 3, 40)
}

/// Breast, belly and the stumps of neck and arms, in a thin robe.
fn breast(at: Vec3) -> f32 {
    if at.y < 0.7 || at.y > 2.0 {
        return (at - v(0.0, 1.35, 0.0)).length() - 0.5;
    }
    let mut d = ellipsoid(at, v(0.0, 1.02, -0.01), v(0.175, 0.15, 0.145));
    d = join(d, limb(at, v(0.0, 1.08, 0.0), v(0.0, 1.33, 0.04), [0.128, 0.132]), 0.09);
    d = join(d, ellipsoid(at, v(0.0, 1.43, 0.04), v(0.18, 0.155, 0.125)), 0.08);
    for side in [-1.0, 1.0] {
        d = join(d, (at - v(0.082 * side, 1.425, 0.135)).length() - 0.068, 0.05);
    }
    d = join(d, limb(at, v(-0.175, 1.54, 0.01), v(0.175, 1.54, 0.01), [0.062, 0.062]), 0.09);
    let thin = d;
    // Pleats run from the shoulders between the breasts, and down from the belt.
    let above = smoothstep(1.24, 1.36, at.y);
    let spread = at.x * (1.0 + 1.6 * (1.56 - at.y).max(0.0) * above);
    let around = spread.atan2(0.35 + 0.5 * at.z.abs());
    let pleats = folds(58.0 * around + 2.0 * (7.0 * at.y).sin()) * (0.006 + 0.004 * (1.0 - above));
    d -= pleats * smoothstep(1.60, 1.50, at.y);
    // A belt below the breast.
    d = join(d, Vec2::new(thin - 0.004, at.y - 1.275 + 0.05 * at.z).length() - 0.016, 0.012);
    // Straps over the shoulders.
    for side in [-1.0, 1.0] {
        let strap = (at.x - side * (0.12 - 0.10 * (1.56 - at.y))).abs();
        if at.y > 1.30 {
            d = join(d, Vec2::new(thin - 0.002, strap).length() - 0.012, 0.012);
        }
    }
    let neck = limb(at, v(0.0, 1.56, 0.02), v(0.0, 1.78, 0.06), [0.062, 0.056]);
    let broken = (at - v(0.0, 1.675, 0.05)).dot(v(0.2, 0.92, 0.33)) + 0.012 * clouds_in_space(22.0 * at, 2, 50);
    d = join(d, common(neck, broken, 0.012), 0.05);
    let arms =
        [(v(0.19, 1.545, 0.01), v(0.42, 1.46, 0.07), 0.30), (v(-0.19, 1.545, 0.01), v(-0.40, 1.40, -0.03), 0.26)];
    for (a, b, reach) in arms {
        let arm = limb(at, a, b, [0.062, 0.054]);
        let cut = (at - a).dot((b - a).normalize()) - 0.5 * reach + 0.012 * clouds_in_space(22.0 * at, 2, 51);
        d = join(d, common(arm, cut, 0.012), 0.05);
    }
    d
}

/// Hips and legs in a robe that the wind presses against the forward leg and blows back behind.
fn robe(at: Vec3) -> f32 {
    if at.y > 1.35 {
        return at.y - 1.15;
    }
    let t = ((1.04 - at.y) / 0.7).clamp(-0.2, 1.1);
    let down = t.max(0.0);
    let middle = Vec2::new(-0.02 * down, -0.015 - 0.17 * down * down.sqrt());
    let wide = Vec2::new(0.165 + 0.085 * down, 0.14 + 0.20 * down);
    let p = at.xz() - middle;
    let around = p.y.atan2(p.x);
    let flow = 0.55 * down * (2.0 * around + 1.0).sin() + 0.25 * (9.0 * at.y + 3.0 * around.cos()).sin() * down;
    let broad = folds(5.5 * around + flow) * (0.008 + 0.045 * down);
    let fine = folds(12.5 * around + 2.2 * flow + 1.0) * (0.006 + 0.012 * down);
    let mut d = ((p / wide).length() - 1.0) * wide.min_element();
    // Cloth blown back behind the left leg.
    let tail = limb(at, v(-0.07, 0.98, -0.05), v(-0.16, 0.42, -0.47), [0.10, 0.09]);
    d = join(d, tail, 0.16);
    d = 0.85 * (d + 0.4 * (0.05 * down) - broad - fine);
    // The forward leg, then the other.
    let thigh = limb(at, v(0.085, 0.97, 0.03), v(0.105, 0.665, 0.215), [0.118, 0.082]);
    let shin = limb(at, v(0.105, 0.665, 0.215), v(0.105, 0.40, 0.16), [0.078, 0.052]);
    let leg = join(thigh, shin, 0.04) - 0.006 * folds(46.0 * (at.y + 0.7 * at.x) + 3.0 * at.z);
    d = join(d, leg, 0.05);
    // A mantle around the hips, with its end between the legs.
    let ends = [
        v(-0.21, 1.10, -0.03),
        v(-0.06, 0.99, 0.155),
        v(0.13, 0.86, 0.165),
        v(0.015, 0.60, 0.225),
        v(-0.03, 0.42, 0.17),
    ];
    let mut mantle = f32::MAX;
    for (k, pair) in ends.windows(2).enumerate() {
        let radii = [[0.05, 0.06], [0.06, 0.055], [0.055, 0.045], [0.045, 0.06]][k];
        mantle = join(mantle, limb(at, pair[0], pair[1], radii), 0.06);
    }
    mantle -= 0.014 * folds(38.0 * (0.6 * at.x + at.y * 0.5 + 0.4 * at.z) + 5.0 * at.x);
    d = join(d, mantle, 0.025);
    // The hem is above the base; the feet stand on the base.
    let hem = 0.325 + 0.02 * (3.0 * around).sin();
    d = common(d, hem - at.y, 0.02);
    let foot = ellipsoid(at, v(0.105, 0.345, 0.24), v(0.05, 0.04, 0.115));
    let heel = limb(at, v(0.105, 0.42, 0.15), v(0.105, 0.34, 0.16), [0.05, 0.05]);
    join(d, join(foot, heel, 0.04), 0.02).max(at.y - 1.25)
}

/// A feather in the plane of the wing.
struct Feather {
    /// End of its quill \[m\].
    root: Vec2,
    /// Unit vector along the feather.
    along: Vec2,
    /// Length and half width \[m\].
    size: [f32; 2],
    /// Distance in front of the wing's middle plane \[m\].
    layer: f32,
    /// Half of its thickness \[m\].
    thickness: f32,
}

/// The right wing; the left one is its mirror image.
struct Wing {
    feathers: Vec<Feather>,
}

/// Shoulder, elbow, wrist and end of the hand, in the plane of the wing \[m\].
const ARM: [Vec2; 4] = [Vec2::new(0.0, 0.0), Vec2::new(0.13, 0.17), Vec2::new(0.33, 0.44), Vec2::new(0.49, 0.54)];

/// A place on the arm: 0 at the shoulder, 1 at the end of the hand.
fn on_arm(s: f32) -> Vec2 {
    let s = 3.0 * s.clamp(0.0, 1.0);
    let bone = (s as usize).min(2);
    ARM[bone].lerp(ARM[bone + 1], s - bone as f32)
}

/// Direction of the feathers at a place on the arm [degrees above the horizontal].
fn spread(s: f32) -> f32 {
    let s = s.clamp(0.0, 1.0);
    -84.0 + 54.0 * smoothstep(-0.1, 0.7, s) + 106.0 * smoothstep(0.35, 1.08, s)
}

impl Wing {
    fn new() -> Self {
        let mut feathers = Vec::new();
        let mut row = |count: usize, from: f32, layer: f32, thickness: f32, size: &dyn Fn(f32) -> [f32; 2]| {
            for k in 0..count {
                let s = from + (1.0 - from) * k as f32 / (count - 1) as f32;
                let along = Vec2::from_angle(spread(s).to_radians());
                feathers.push(Feather { root: on_arm(s), along, size: size(s), layer, thickness });
            }
        };
        row(21, 0.0, 0.0, 0.0095, &|s| [0.34 + 0.36 * smoothstep(0.25, 0.85, s), 0.052]);
        row(19, 0.0, 0.018, 0.0085, &|s| [0.20 + 0.10 * s, 0.040]);
        row(17, 0.0, 0.030, 0.0085, &|s| [0.135 + 0.05 * s, 0.034]);
        row(15, 0.02, 0.040, 0.0085, &|s| [0.085 + 0.02 * s, 0.030]);
        Self { feathers }
    }

    /// Coordinates of the wing: outwards and back, up, and to the front; the wing is bent backwards.
    fn own(at: Vec3) -> Vec3 {
        let p = v(at.x.abs(), at.y, at.z) - v(0.085, 1.46, -0.10);
        let (out, front) = (0.80 * p.x - 0.60 * p.z, 0.60 * p.x + 0.80 * p.z);
        v(out, p.y, front + 0.28 * out * out)
    }

    /// Shoulder, arm and hand.
    fn arm(&self, at: Vec3) -> f32 {
        let p = Self::own(at);
        let joint = |k: usize| ARM[k].extend(0.0);
        let radii = [0.075, 0.066, 0.05, 0.028];
        let bone = |k: usize| limb(p, joint(k), joint(k + 1), [radii[k], radii[k + 1]]);
        join(join(bone(0), bone(1), 0.03), bone(2), 0.03)
    }

    fn distance(&self, at: Vec3) -> f32 {
        let p = Self::own(at);
        let (plane, front) = (p.xy(), p.z.abs());
        let mut nearest = ((plane - Vec2::new(0.42, 0.38)).length() - 0.95).max(front - 0.12);
        if nearest > 0.1 {
            return 0.8 * nearest;
        }
        nearest = f32::MAX;
        for feather in &self.feathers {
            let q = plane - feather.root;
            let (a, b) = (q.dot(feather.along), q.perp_dot(feather.along));
            let [length, half] = feather.size;
            let inside = Vec2::new(a - a.clamp(0.0, length - half), b).length() - half;
            let from_middle = front - feather.layer;
            // This feather cannot be nearer than the nearest so far.
            if inside.max(from_middle.abs() - 0.03) > nearest {
                continue;
            }
            // Each feather overlaps the next with one edge; the quill stands out.
            let own = if feather.layer == 0.0 { p.z } else { from_middle };
            let off = (own - 0.16 * b + 0.03 * (a / length) * a).abs();
            let quill = 0.0035 * (1.0 - smoothstep(0.003, 0.011, b.abs()));
            let barbs = 0.0012 * folds(150.0 * (b.abs() + 0.8 * a)) * smoothstep(0.01, 0.02, b.abs());
            let round = 1.0 - 0.6 * (b / half).powi(2).min(1.0);
            let thick = feather.thickness * round + quill + barbs;
            nearest = nearest.min(common(inside, off - thick, 0.008));
        }
        0.8 * nearest
    }
}
