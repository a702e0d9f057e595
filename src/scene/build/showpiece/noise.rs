//! Noise from an integer hash, identical on every machine. Noise for textures is periodic, so that they tile.

use glam::{IVec3, Vec2, Vec3};

/// A hash of a lattice point.
pub(super) fn hash(x: i32, y: i32, seed: u32) -> u32 {
    let h =
        (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed.wrapping_mul(0xc2b2_ae3d);
    let h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    let h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// A random number in [0, 1) for a lattice point.
pub(super) fn random(x: i32, y: i32, seed: u32) -> f32 {
    (hash(x, y, seed) >> 8) as f32 / (1 << 24) as f32
}

fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Rises smoothly from 0 to 1 while `x` goes from `low` to `high`.
pub(super) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Gradient noise in about [-1, 1] at `at` \[cells\], with a period of `period` cells.
fn gradient(at: Vec2, period: [i32; 2], seed: u32) -> f32 {
    const GRADIENTS: [[f32; 2]; 8] = [
        [1.0, 0.0],
        [0.707, 0.707],
        [0.0, 1.0],
        [-0.707, 0.707],
        [-1.0, 0.0],
        [-0.707, -0.707],
        [0.0, -1.0],
        [0.707, -0.707],
    ];
    let corner = at.floor();
    let t = at - corner;
    let (x, y) = (corner.x as i32, corner.y as i32);
    let value = |dx: i32, dy: i32| {
        let h = hash((x + dx).rem_euclid(period[0]), (y + dy).rem_euclid(period[1]), seed);
        let [gx, gy] = GRADIENTS[(h >> 29) as usize];
        gx * (t.x - dx as f32) + gy * (t.y - dy as f32)
    };
    let (u, v) = (fade(t.x), fade(t.y));
    1.5 * mix(mix(value(0, 0), value(1, 0), u), mix(value(0, 1), value(1, 1), u), v)
}

/// Sum of octaves of noise in about [-1, 1] over a texture, with coordinates from 0 to 1; the first octave has `cells`
/// across and down.
pub(super) fn clouds(at: Vec2, cells: [i32; 2], octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut weight) = (0.0, 1.0);
    for octave in 0..octaves {
        let period = cells.map(|n| n << octave);
        sum += weight * gradient(at * Vec2::new(period[0] as f32, period[1] as f32), period, seed + octave);
        weight *= 0.5;
    }
    sum
}

/// Nearest random points to a position in a texture, with one random point per cell.
pub(super) struct Scattered {
    /// Distances to the nearest and to the second-nearest point \[cells\].
    pub(super) distances: [f32; 2],
    /// Identifier of the nearest point.
    pub(super) id: u32,
}

/// Finds the nearest random points, with `cells` across and down the texture.
pub(super) fn scattered(at: Vec2, cells: [i32; 2], seed: u32) -> Scattered {
    let at = at * Vec2::new(cells[0] as f32, cells[1] as f32);
    let (x, y) = (at.x.floor() as i32, at.y.floor() as i32);
    let mut found = Scattered { distances: [9.0; 2], id: 0 };
    for dy in -1..=1 {
        for dx in -1..=1 {
            let id = hash((x + dx).rem_euclid(cells[0]), (y + dy).rem_euclid(cells[1]), seed);
            let inside = Vec2::new((id & 0xffff) as f32, (id >> 16) as f32) / 65536.0;
            let distance = at.distance(Vec2::new((x + dx) as f32, (y + dy) as f32) + inside);
            if distance < found.distances[0] {
                found = Scattered { distances: [distance, found.distances[0]], id };
            } else if distance < found.distances[1] {
                found.distances[1] = distance;
            }
        }
    }
    found
}

/// Value noise in [-1, 1] in space, with cells of unit size.
fn value_in_space(at: Vec3, seed: u32) -> f32 {
    let corner = at.floor();
    let t = at - corner;
    let cell = IVec3::new(corner.x as i32, corner.y as i32, corner.z as i32);
    let value = |dx: i32, dy: i32, dz: i32| {
        let layer = hash(cell.z + dz, 0, seed);
        2.0 * random(cell.x + dx, cell.y + dy, layer) - 1.0
    };
    let (u, v, w) = (fade(t.x), fade(t.y), fade(t.z));
    let layer = |dz| mix(mix(value(0, 0, dz), value(1, 0, dz), u), mix(value(0, 1, dz), value(1, 1, dz), u), v);
    mix(layer(0), layer(1), w)
}

/// Sum of octaves of noise in space in about [-1, 1]; the first has cells of unit size.
pub(super) fn clouds_in_space(at: Vec3, octaves: u32, seed: u32) -> f32 {
    (0..octaves).map(|o| value_in_space(at * (1 << o) as f32, seed + o) / (1 << o) as f32).sum::<f32>() / 1.6
}
