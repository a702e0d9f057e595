//! Tiling textures of surfaces: base colour, normals and roughness, computed from a height and a colour at every point.

use super::noise::{clouds, hash, random, scattered, smoothstep};
use crate::scene::Image;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Surface properties at a point of a texture.
struct Texel {
    /// Height above the mean surface \[m\].
    height: f32,
    /// Base colour, linear.
    color: Vec3,
    /// Perceptual roughness.
    roughness: f32,
}

/// A kind of surface with procedural textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Paint {
    /// Courses of sawn limestone.
    Ashlar,
    /// Polished slabs of two marbles.
    Slabs,
    /// Lime plaster.
    Plaster,
    /// Woven cloth with a pattern; white, to be dyed.
    Cloth,
    /// Planed oak, grain along v.
    Wood,
    /// Hammered metal; white, to be coloured.
    Hammered,
    /// Fired clay.
    Clay,
    /// Square clay tiles.
    ClayTiles,
    /// Old marble.
    Marble,
    /// Glazed mosaic.
    Mosaic,
}

impl Paint {
    /// All kinds, in the order of the scene's materials.
    pub(super) const ALL: [Self; 10] = [
        Self::Ashlar,
        Self::Slabs,
        Self::Plaster,
        Self::Cloth,
        Self::Wood,
        Self::Hammered,
        Self::Clay,
        Self::ClayTiles,
        Self::Marble,
        Self::Mosaic,
    ];

    /// Name of the textures.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ashlar => "ashlar",
            Self::Slabs => "slabs",
            Self::Plaster => "plaster",
            Self::Cloth => "cloth",
            Self::Wood => "wood",
            Self::Hammered => "hammered",
            Self::Clay => "clay",
            Self::ClayTiles => "clay tiles",
            Self::Marble => "marble",
            Self::Mosaic => "mosaic",
        }
    }

    /// Side of the area that a texture covers \[m\].
    pub(super) fn size(self) -> f32 {
        match self {
            Self::Ashlar | Self::Slabs | Self::Plaster => 3.0,
            Self::Cloth => 0.5,
            Self::Wood => 1.2,
            Self::Hammered => 0.6,
            Self::Clay => 1.0,
            Self::ClayTiles => 1.2,
            Self::Marble => 1.5,
            Self::Mosaic => 0.96,
        }
    }

    /// Divisor of the largest textures' side for this kind.
    fn share(self) -> u32 {
        match self {
            Self::Ashlar | Self::Slabs | Self::Plaster | Self::ClayTiles => 1,
            _ => 2,
        }
    }

    fn texel(self, at: Vec2) -> Texel {
        match self {
            Self::Ashlar => ashlar(at),
            Self::Slabs => slabs(at),
            Self::Plaster => plaster(at),
            Self::Cloth => cloth(at),
            Self::Wood => wood(at),
            Self::Hammered => hammered(at),
            Self::Clay => clay(at),
            Self::ClayTiles => clay_tiles(at),
            Self::Marble => marble(at),
            Self::Mosaic => mosaic(at),
        }
    }

    /// The textures: base colour, normals, and roughness with metalness; the largest textures have `side` texels
    /// across.
    pub(super) fn images(self, side: u32) -> [Image; 3] {
        let side = side / self.share();
        let count = side as usize;
        let place = |index: usize| Vec2::new((index % count) as f32 + 0.5, (index / count) as f32 + 0.5) / side as f32;
        let texels: Vec<Texel> = (0..count * count).into_par_iter().map(|index| self.texel(place(index))).collect();
        let height = |x: usize, y: usize| texels[(y % count) * count + x % count].height;
        let step = 2.0 * self.size() / side as f32;
        let normal = |index: usize| {
            let (x, y) = (index % count, index / count);
            let across = height(x + 1, y) - height(x + count - 1, y);
            let down = height(x, y + 1) - height(x, y + count - 1);
            // Green points up in the picture, but rows go down.
            let normal = Vec3::new(-across, down, step).normalize();
            let [x, y, z] = normal.to_array().map(|c| (c.mul_add(0.5, 0.5) * 255.0 + 0.5) as u8);
            [x, y, z, 255]
        };
        let srgb = srgb_table();
        let color = |texel: &Texel| {
            let [r, g, b] = texel.color.to_array().map(|c| srgb[(c.clamp(0.0, 1.0) * 4095.0 + 0.5) as usize]);
            [r, g, b, 255]
        };
        let rough = |texel: &Texel| [255, (texel.roughness.clamp(0.0, 1.0) * 255.0 + 0.5) as u8, 255, 255];
        let image = |what: &str, rgba: Vec<[u8; 4]>| Image {
            name: format!("{} {what}", self.name()),
            width: side,
            height: side,
            rgba: rgba.into_flattened(),
        };
        [
            image("colour", texels.par_iter().map(color).collect()),
            image("normal", (0..texels.len()).into_par_iter().map(normal).collect()),
            image("roughness", texels.par_iter().map(rough).collect()),
        ]
    }
}

/// sRGB codes of 4096 linear values.
fn srgb_table() -> Vec<u8> {
    let code = |x: f32| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (0..4096).map(|k| (code(k as f32 / 4095.0) * 255.0 + 0.5) as u8).collect()
}

/// Profile of a block from joint to face: 0 in the joint, 1 on the face. `edge` is the distance to the block's edge
/// \[m\].
fn face(edge: f32, joint: f32, bevel: f32) -> f32 {
    smoothstep(joint, joint + bevel, edge)
}

/// Eight courses of blocks of about 0.75 m by 0.375 m.
fn ashlar(at: Vec2) -> Texel {
    let (course, v) = ((at.y * 8.0).floor(), (at.y * 8.0).fract());
    let row = course as i32;
    let shift = if row % 2 == 0 { 0.0 } else { 0.5 } + 0.16 * (random(row, 7, 3) - 0.5);
    let along = (at.x * 4.0 + shift).rem_euclid(4.0);
    let (block, u) = (along.floor() as i32, along.fract());
    let edge = (0.375 * v.min(1.0 - v)).min(0.75 * u.min(1.0 - u));
    let face = face(edge + 0.0015 * clouds(at, [48, 48], 2, 21), 0.004, 0.011);
    let own = random(block, row, 5);
    let coarse = clouds(at, [6, 6], 5, 11);
    let grain = clouds(at, [64, 64], 2, 31);
    let warm = Vec3::new(0.47, 0.385, 0.28).lerp(Vec3::new(0.54, 0.475, 0.38), own);
    let stain = 1.0 + 0.10 * coarse + 0.05 * grain - 0.10 * smoothstep(0.25, 0.8, clouds(at, [3, 9], 3, 77));
    let color = warm * (0.93 + 0.14 * random(block, row, 6)) * stain;
    Texel {
        height: 0.006 * face + 0.0012 * coarse + 0.00015 * grain + 0.002 * (own - 0.5),
        color: (color * 0.62).lerp(color, face),
        roughness: 0.78 + 0.08 * coarse + 0.1 * (1.0 - face),
    }
}

/// Marble veins: 1 in the middle of a vein.
fn veins(at: Vec2, cells: i32, width: f32, seed: u32) -> f32 {
    let warp = Vec2::new(clouds(at, [cells, cells], 3, seed), clouds(at, [cells, cells], 3, seed + 9));
    let line = clouds(at + 0.35 / cells as f32 * warp, [cells, cells], 4, seed + 20).abs();
    1.0 - smoothstep(0.0, width, line)
}

/// Four by four slabs of 0.75 m, every other one of a darker stone, each with its own veins.
fn slabs(at: Vec2) -> Texel {
    let cell = (at * 4.0).floor();
    let (x, y) = (cell.x as i32, cell.y as i32);
    let inside = at * 4.0 - cell;
    let edge = 0.75 * inside.min(1.0 - inside).min_element();
    let face = face(edge, 0.0015, 0.0035);
    let seed = hash(x, y, 91) % 1000;
    // Each slab is cut from another part of the stone.
    let cut = (at + Vec2::new(random(x, y, 92), random(x, y, 93))).fract();
    let thin = veins(cut, 5, 0.07, seed % 5);
    let broad = smoothstep(0.0, 0.9, clouds(cut, [4, 4], 4, 17 + seed % 3));
    let tone = 0.94 + 0.12 * random(x, y, 94);
    let dark = (x + y) % 2 == 0;
    let color = if dark {
        let stone = Vec3::new(0.155, 0.085, 0.062).lerp(Vec3::new(0.25, 0.145, 0.105), broad);
        stone.lerp(Vec3::new(0.52, 0.42, 0.35), 0.55 * thin)
    } else {
        let stone = Vec3::new(0.56, 0.505, 0.42).lerp(Vec3::new(0.46, 0.405, 0.33), broad);
        stone.lerp(Vec3::new(0.36, 0.31, 0.26), 0.40 * thin)
    };
    let worn = clouds(at, [5, 5], 4, 41);
    Texel {
        height: 0.0012 * face + 0.0004 * (random(x, y, 95) - 0.5),
        color: (Vec3::splat(0.13)).lerp(color * tone, face),
        roughness: (0.13 + 0.07 * worn + 0.05 * thin).max(0.06) + 0.4 * (1.0 - face),
    }
}

fn plaster(at: Vec2) -> Texel {
    let broad = clouds(at, [4, 4], 5, 51);
    let strokes = clouds(at + 0.02 * clouds(at, [6, 6], 2, 61), [10, 22], 3, 52);
    let grain = clouds(at, [96, 96], 2, 53);
    let color = Vec3::new(0.62, 0.45, 0.27).lerp(Vec3::new(0.68, 0.55, 0.39), 0.5 + 0.5 * broad);
    Texel {
        height: 0.0025 * broad + 0.0006 * strokes + 0.00008 * grain,
        color: color * (1.0 + 0.05 * strokes + 0.02 * grain),
        roughness: 0.88 + 0.06 * strokes,
    }
}

/// A twill with threads of 6 mm and a smoother woven ornament of leaves.
fn cloth(at: Vec2) -> Texel {
    let threads = 80.0;
    let (x, y) = (at.x * threads, at.y * threads);
    let over = ((x.floor() as i32) + (y.floor() as i32)).rem_euclid(4) < 2;
    let round = |t: f32| 1.0 - (2.0 * t.fract() - 1.0).powi(2);
    let weave = if over { round(x) } else { 0.85 * round(y) };
    // Ogees of leaves, two across and two down, every other row shifted.
    let row = (at.y * 2.0).floor();
    let shifted = Vec2::new((at.x * 2.0 + 0.5 * row).fract() - 0.5, (at.y * 2.0).fract() - 0.5);
    let p = Vec2::new(shifted.x.abs(), shifted.y);
    let leaf = p.x - 0.30 * (1.0 - (2.0 * p.y).powi(2)).max(0.0) * (1.0 - 0.35 * (14.0 * p.y).sin().abs());
    let heart = p.length() - 0.085;
    let frame = (p.x - 0.42 * (0.5 + 0.5 * (p.y * std::f32::consts::TAU).cos())).abs() - 0.025;
    let ornament = 1.0 - smoothstep(-0.012, 0.012, leaf.max(-heart + 0.03).min(heart).min(frame));
    let fuzz = clouds(at, [24, 24], 3, 71);
    Texel {
        height: 0.0006 * weave + 0.0004 * ornament,
        color: Vec3::splat((0.80 + 0.10 * weave + 0.05 * fuzz) * (1.0 - 0.34 * ornament)),
        roughness: 0.92 - 0.25 * ornament,
    }
}

/// Boards of 0.2 m, grain along v.
fn wood(at: Vec2) -> Texel {
    let board = (at.x * 6.0).floor() as i32;
    let across = (at.x * 6.0).fract();
    let edge = 0.2 * across.min(1.0 - across);
    let face = face(edge, 0.001, 0.004);
    let own = random(board, 3, 81);
    let moved = Vec2::new(at.x, (at.y + own).fract());
    let rings = clouds(moved + 0.01 * clouds(moved, [6, 2], 2, 83), [12, 1], 3, 82 + board as u32);
    let lines = (rings * 26.0).sin() * 0.5 + 0.5;
    let pores = smoothstep(0.2, 0.9, clouds(moved, [128, 6], 2, 84));
    let light = Vec3::new(0.34, 0.195, 0.095).lerp(Vec3::new(0.205, 0.105, 0.046), lines);
    Texel {
        height: 0.003 * face + 0.0004 * lines - 0.0006 * pores,
        color: (light * (0.8 + 0.4 * own) * (1.0 - 0.4 * pores)) * (0.35 + 0.65 * face),
        roughness: 0.55 + 0.15 * lines + 0.2 * pores,
    }
}

/// Dents of a round hammer, 3 cm across.
fn hammered(at: Vec2) -> Texel {
    let dents = scattered(at, [18, 18], 101);
    let [near, next] = dents.distances;
    let dent = near.min(0.75).powi(2);
    let patina = clouds(at, [5, 5], 4, 103);
    let crease = 1.0 - smoothstep(0.0, 0.25, next - near);
    let tone = 0.92 + 0.1 * (dents.id % 256) as f32 / 255.0 - 0.10 * smoothstep(0.1, 0.7, patina);
    Texel {
        height: 0.0042 * dent,
        color: Vec3::splat(tone * (1.0 - 0.12 * crease)),
        roughness: 0.24 + 0.10 * patina.abs() + 0.12 * crease,
    }
}

fn clay(at: Vec2) -> Texel {
    let throwing = clouds(at, [3, 40], 2, 111);
    let blotch = clouds(at, [5, 5], 4, 112);
    let lime = smoothstep(0.35, 0.9, clouds(at, [7, 5], 4, 113));
    let color = Vec3::new(0.46, 0.185, 0.092) * (1.0 + 0.16 * blotch + 0.05 * throwing);
    Texel {
        height: 0.0007 * throwing + 0.0005 * blotch,
        color: color.lerp(Vec3::new(0.55, 0.42, 0.33), 0.5 * lime),
        roughness: 0.82 + 0.1 * lime,
    }
}

/// Four by four tiles of 0.3 m.
fn clay_tiles(at: Vec2) -> Texel {
    let cell = (at * 4.0).floor();
    let (x, y) = (cell.x as i32, cell.y as i32);
    let inside = at * 4.0 - cell;
    let wobble = 0.0012 * clouds(at, [24, 24], 2, 121);
    let edge = 0.3 * inside.min(1.0 - inside).min_element() + wobble;
    let face = face(edge, 0.004, 0.006);
    let own = random(x, y, 122);
    let blotch = clouds(at, [6, 6], 5, 123);
    let clay = Vec3::new(0.40, 0.155, 0.08).lerp(Vec3::new(0.50, 0.25, 0.135), own);
    let color = clay * (1.0 + 0.18 * blotch);
    let dish = 0.0012 * (inside - 0.5).length_squared();
    Texel {
        height: 0.0025 * face + 0.001 * (own - 0.5) + dish + 0.0004 * blotch,
        color: Vec3::new(0.36, 0.31, 0.25).lerp(color, face),
        roughness: (0.42 + 0.14 * blotch + 0.12 * own).clamp(0.3, 1.0) + 0.4 * (1.0 - face),
    }
}

fn marble(at: Vec2) -> Texel {
    let broad = clouds(at, [3, 3], 5, 131);
    let vein = veins(at, 4, 0.09, 132);
    let pits = smoothstep(0.45, 0.9, clouds(at, [40, 40], 2, 133));
    let color = Vec3::new(0.60, 0.55, 0.47).lerp(Vec3::new(0.50, 0.44, 0.355), smoothstep(-0.2, 0.9, broad));
    Texel {
        height: 0.0008 * broad - 0.0007 * pits,
        color: color.lerp(Vec3::new(0.48, 0.44, 0.39), 0.35 * vein) * (1.0 - 0.12 * pits),
        roughness: 0.46 + 0.12 * broad.abs() + 0.25 * pits,
    }
}

/// 24 by 24 tesserae of 4 cm: a running key between two bands, on white.
fn mosaic(at: Vec2) -> Texel {
    const KEY: [&[u8; 12]; 12] = [
        b"bbbbbbbbbbbb",
        b"oooooooooooo",
        b"wwwwwwwwwwww",
        b"bbbbbbbbbwww",
        b"bwwwwwwwbwww",
        b"bwwbbbbwbwww",
        b"bwwbwwbwbwwb",
        b"bwwbbwwwbwwb",
        b"bwwwwwwwbbbb",
        b"wwwwwwwwwwww",
        b"oooooooooooo",
        b"bbbbbbbbbbbb",
    ];
    let cell = (at * 24.0).floor();
    let (x, y) = (cell.x as i32, cell.y as i32);
    let jitter = Vec2::new(random(x, y, 141), random(x, y, 142)) - 0.5;
    let inside = at * 24.0 - cell;
    let edge = 0.04 * (inside + 0.05 * jitter).min(1.0 - inside - 0.05 * jitter).min_element();
    let face = face(edge, 0.0022, 0.003);
    let glass = match KEY[(y % 12) as usize][(x % 12) as usize] {
        b'b' => Vec3::new(0.018, 0.09, 0.21),
        b'o' => Vec3::new(0.62, 0.33, 0.06),
        _ => Vec3::new(0.66, 0.66, 0.60),
    };
    let own = random(x, y, 143);
    Texel {
        height: 0.002 * face + 0.0006 * own,
        color: Vec3::new(0.30, 0.27, 0.23).lerp(glass * (0.72 + 0.5 * own), face),
        roughness: 0.16 + 0.12 * own + 0.55 * (1.0 - face),
    }
}
