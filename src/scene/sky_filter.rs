//! Prefiltered skies: irradiance by normal, and radiance filtered by Phong lobes, each as a grid of directions.

use super::sky::Sky;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Number of lobes in [`lobes`]: exponents are powers of two, from 2048 down to 1.
pub const LOBES: u32 = 12;

/// Columns of the irradiance grid and of the grids of the widest lobes.
const COARSE: u32 = 64;

/// Smallest weight of a lobe that counts, as a share of its peak.
const LEAST: f64 = 1e-4;

/// Irradiance \[lx\] by normal, on a grid with the layout of a sky.
pub fn irradiance(sky: &Sky) -> Sky {
    let mut received = convolved(&halved(sky, 2 * COARSE), COARSE, |cosine| cosine.max(0.0), 0.0);
    // `convolved` gives the cosine-weighted mean over a hemisphere, where the cosine integrates to pi.
    received.texels.iter_mut().for_each(|texel| *texel *= std::f32::consts::PI);
    received
}

/// Mean radiance [cd/m^2] around each direction, weighted by Phong lobes with exponents 2048, 1024, .. 1.
pub fn lobes(sky: &Sky) -> Vec<Sky> {
    let lobe = |i: u32| {
        let squarings = LOBES - 1 - i;
        let exponent = f64::from(1_u32 << squarings);
        // Texels are narrower than the lobe.
        let columns = (1.4 * TAU * exponent.sqrt()).log2().ceil().exp2().clamp(64.0, 256.0) as u32;
        let least = LEAST.powf(1.0 / exponent);
        let weight = |cosine: f64| (0..squarings).fold(cosine.max(0.0), |power, _| power * power);
        convolved(&halved(sky, 2 * columns), columns, weight, least)
    };
    (0..LOBES).map(lobe).collect()
}

/// A sky with at most this many columns; each texel is the mean of the texels that it replaces.
pub fn halved(sky: &Sky, most: u32) -> Sky {
    let texels = sky.texels.clone();
    let mut now = Sky { texels, shown: None, lights: 0..0, ..*sky };
    while now.width > most && now.width.is_multiple_of(2) && now.height.is_multiple_of(2) {
        let (width, height) = (now.width / 2, now.height / 2);
        let mean = |texel: usize| {
            let (column, row) = (texel % width as usize, texel / width as usize);
            let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
            for part in 0..4 {
                let (column, row) = (2 * column + part % 2, 2 * row + part / 2);
                let angle = now.solid_angle(row);
                sum += angle * now.texels[row * now.width as usize + column].as_dvec3();
                whole += angle;
            }
            (sum / whole).as_vec3()
        };
        now.texels = (0..(width * height) as usize).map(mean).collect();
        (now.width, now.height) = (width, height);
    }
    now
}

/// The weighted mean around each direction, on a grid with this many columns. `weight` is a function of the cosine;
/// cosines below `least` are ignored.
fn convolved(sky: &Sky, columns: u32, weight: impl Fn(f64) -> f64 + Sync, least: f64) -> Sky {
    let (width, height) = (columns, columns / 2);
    if let Some(&even) = sky.texels.first()
        && sky.texels.iter().all(|&texel| texel == even)
    {
        // The mean of a constant is the constant.
        return Sky::new(width, height, std::iter::repeat_n(even, (width * height) as usize), 0.0);
    }
    let source: Vec<Row> = (0..sky.height as usize).map(|row| Row::of(sky, row)).collect();
    let mut grid = Sky::new(width, height, std::iter::repeat_n(Vec3::ZERO, (width * height) as usize), 0.0);
    let mean = |i: usize| {
        let axis = grid.direction(i % width as usize, i / width as usize);
        let middle = sky.place(axis).x - 0.5;
        let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
        for row in &source {
            for texels in row.within(axis, middle, least) {
                for (direction, radiance) in texels {
                    let cosine = axis.dot(*direction);
                    if cosine >= least {
                        let share = weight(cosine) * row.angle;
                        sum += share * *radiance;
                        whole += share;
                    }
                }
            }
        }
        // A lobe that falls between texel centres takes the sky's radiance at its axis.
        if whole > 0.0 { (sum / whole).as_vec3() } else { sky.radiance(axis).as_vec3() }
    };
    grid.texels = (0..(width * height) as usize).into_par_iter().map(mean).collect();
    grid
}

/// A row of a sky: directions and radiance of its texels.
struct Row {
    texels: Vec<(DVec3, DVec3)>,
    /// Solid angle of each texel \[sr\].
    angle: f64,
}

impl Row {
    fn of(sky: &Sky, row: usize) -> Self {
        let texel = |column| (sky.direction(column, row), sky.texels[row * sky.width as usize + column].as_dvec3());
        Self { texels: (0..sky.width as usize).map(texel).collect(), angle: sky.solid_angle(row) }
    }

    /// All texels whose direction has at least this cosine to an axis, and few others. `middle` is the axis' column.
    fn within(&self, axis: DVec3, middle: f64, least: f64) -> [&[(DVec3, DVec3)]; 2] {
        let count = self.texels.len();
        let height = self.texels[0].0.y;
        let across = ((1.0 - height * height) * (1.0 - axis.y * axis.y)).max(0.0).sqrt();
        let cosine = (least - height * axis.y) / across.max(1e-12);
        // Rounding may put the cosine of the nearest texel above 1.
        if cosine > 1.0 + 1e-9 {
            return [&[], &[]];
        }
        // One column more than needed on both sides.
        let reach = cosine.clamp(-1.0, 1.0).acos() / TAU * count as f64 + 1.0;
        if 2.0 * reach + 2.0 > count as f64 {
            return [&self.texels, &[]];
        }
        let begin = (middle - reach).floor().rem_euclid(count as f64) as usize;
        let end = begin + (2.0 * reach) as usize + 2;
        if end <= count {
            [&self.texels[begin..end], &[]]
        } else {
            [&self.texels[begin..], &self.texels[..end - count]]
        }
    }
}
