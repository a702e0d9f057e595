//! Importance sampling of the sky by its luminance.

use glam::{DVec2, DVec3};

use super::emitters::{choose, running_shares};
use crate::reference::gather::luminance;
use crate::scene::sky::Sky;

/// Share of directions sampled uniformly over the sphere.
const EVEN: f64 = 0.05;

/// A sky prepared for sampling: density by the mean luminance of each texel, uniform within a texel.
pub(super) struct SkyLight<'a> {
    sky: &'a Sky,
    /// Running sums of the rows' light shares.
    rows: Vec<f64>,
    /// For each row: running sums of its texels' shares of the row's light.
    columns: Vec<Vec<f64>>,
    /// Probability density of each texel [1/sr].
    density: Vec<f64>,
}

impl<'a> SkyLight<'a> {
    /// `None` for a black sky.
    pub(super) fn new(sky: &'a Sky) -> Option<Self> {
        let (width, height) = (sky.width as usize, sky.height as usize);
        let shown: Vec<f64> = sky.texels.iter().map(|texel| luminance(texel.as_dvec3())).collect();
        // Mean of the interpolated radiance over a texel: neighbours blend into it.
        let tent = |before: f64, own: f64, after: f64| 0.125 * before + 0.75 * own + 0.125 * after;
        let across = |row: usize, column: usize| {
            let at = |column: usize| shown[row * width + column % width];
            tent(at(column + width - 1), at(column), at(column + 1))
        };
        let mut power = Vec::with_capacity(shown.len());
        for row in 0..height {
            let (above, below) = (row.saturating_sub(1), (row + 1).min(height - 1));
            let mean = |column| tent(across(above, column), across(row, column), across(below, column));
            power.extend((0..width).map(|column| mean(column) * sky.solid_angle(row)));
        }
        let total: f64 = power.iter().sum();
        if total <= 0.0 {
            return None;
        }
        let whole: f64 = (0..height).map(|row| sky.solid_angle(row) * width as f64).sum();
        let share = |texel: usize| {
            let solid_angle = sky.solid_angle(texel / width);
            (1.0 - EVEN) * power[texel] / total + EVEN * solid_angle / whole
        };
        let shares: Vec<f64> = (0..power.len()).map(share).collect();
        let by_row = || shares.chunks_exact(width);
        Some(Self {
            sky,
            rows: running_shares(&by_row().map(|row| row.iter().sum()).collect::<Vec<f64>>()),
            columns: by_row().map(running_shares).collect(),
            density: shares.iter().enumerate().map(|(i, share)| share / sky.solid_angle(i / width)).collect(),
        })
    }

    /// A unit direction and its density [1/sr]; `u` is uniform in the unit square.
    pub(super) fn sample(&self, u: DVec2) -> (DVec3, f64) {
        let (row, down) = within(&self.rows, u.y);
        let (column, across) = within(&self.columns[row], u.x);
        // Uniform in solid angle.
        let edge = |row: usize| (std::f64::consts::PI * row as f64 / f64::from(self.sky.height)).cos();
        let height = edge(row) + down * (edge(row + 1) - edge(row));
        let y = height.clamp(-1.0, 1.0).acos() / std::f64::consts::PI * f64::from(self.sky.height);
        let direction = self.sky.direction_at(DVec2::new(column as f64 + across, y));
        (direction, self.density[row * self.sky.width as usize + column])
    }

    /// Density [1/sr] of a unit direction in [`Self::sample`].
    pub(super) fn density(&self, direction: DVec3) -> f64 {
        let (width, height) = (self.sky.width as usize, self.sky.height as usize);
        let place = self.sky.place(direction);
        let (column, row) = ((place.x as usize).min(width - 1), (place.y as usize).min(height - 1));
        self.density[row * width + column]
    }

    /// Radiance [cd/m^2] from a unit direction.
    pub(super) fn radiance(&self, direction: DVec3) -> DVec3 {
        self.sky.radiance(direction)
    }
}

/// The index whose share `u` in [0, 1) falls into, and the position within that share, 0 to 1.
fn within(sums: &[f64], u: f64) -> (usize, f64) {
    let index = choose(sums, u).unwrap_or(0);
    let before = if index > 0 { sums[index - 1] } else { 0.0 };
    let share = (sums[index] - before).max(f64::MIN_POSITIVE);
    (index, ((u * sums[sums.len() - 1] - before) / share).clamp(0.0, 1.0))
}
