//! A sky on the device: as it is seen, and as surfaces receive it.

use crate::error::Result;
use crate::gpu::{Buffer, Gpu};
use crate::scene::sky::Sky;
use crate::scene::sky_filter;
use crate::shared::{DIRECTION_SIDE, DIRECTIONS, SkyLevel};
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::PI;

/// A sky that is seen.
pub struct SkyBuffer {
    /// Radiances, row by row.
    pub texels: Buffer,
    pub(in crate::frame) width: u32,
    pub(in crate::frame) height: u32,
    pub(in crate::frame) turn: f32,
}

impl SkyBuffer {
    /// Uploads a sky.
    ///
    /// # Errors
    /// What the device has no memory for.
    pub fn new(gpu: &Gpu, sky: &Sky) -> Result<Self> {
        let texels = gpu.buffer_from("scene.sky", &sky.texels)?;
        Ok(Self { texels, width: sky.width, height: sky.height, turn: sky.turn as f32 })
    }
}

/// A sky that lights surfaces, as grids: irradiance by normal, the sky itself, and what ever wider lobes take of it.
pub struct SkyLight {
    /// Where each grid is.
    pub levels: Buffer,
    /// Texels of all.
    pub texels: Buffer,
    /// Mean radiance [cd/m^2] of each of the directions that short rays ask for; a little where there is none, since it weighs.
    pub directions: Buffer,
    /// Part of the light that comes from all around, below which a cache's own share of it says nothing \[lx\].
    pub(in crate::frame) least: f32,
}

/// Most columns of the sky itself, as mirrors show it.
const MOST_COLUMNS: u32 = 2048;

impl SkyLight {
    /// Works out the grids, and uploads them.
    ///
    /// # Errors
    /// What the device has no memory for.
    pub fn new(gpu: &Gpu, sky: &Sky) -> Result<Self> {
        let mut grids = vec![sky_filter::irradiance(sky), sky_filter::halved(sky, MOST_COLUMNS)];
        grids.extend(sky_filter::lobes(sky));
        let (mut levels, mut texels) = (Vec::new(), Vec::new());
        for grid in &grids {
            let first = texels.len() as u32;
            levels.push(SkyLevel { first, width: grid.width, height: grid.height, turn: grid.turn as f32 });
            texels.extend_from_slice(&grid.texels);
        }
        Ok(Self {
            levels: gpu.buffer_from("scene.sky_levels", &levels)?,
            texels: gpu.buffer_from("scene.sky_light", &texels)?,
            directions: gpu.buffer_from("scene.sky_directions", &by_directions(sky))?,
            least: (1e-4 * sky.illuminance().max_element() / 4.0) as f32,
        })
    }
}

/// The mean radiance of each direction, of the texels that lie there.
fn by_directions(sky: &Sky) -> Vec<Vec3> {
    let grid = sky_filter::halved(sky, 256);
    let mut sums = vec![(DVec3::ZERO, 0.0); DIRECTIONS as usize];
    for (i, texel) in grid.texels.iter().enumerate() {
        let (column, row) = (i % grid.width as usize, i / grid.width as usize);
        let (sum, whole) = &mut sums[direction_index(grid.direction(column, row).as_vec3())];
        *sum += grid.solid_angle(row) * texel.as_dvec3();
        *whole += grid.solid_angle(row);
    }
    let least = 1e-4 * sky.illuminance() / (4.0 * PI);
    let mean = |(index, (sum, whole)): (usize, &(DVec3, f64))| {
        // A grid of few texels has none in some directions.
        let mean = if *whole > 0.0 { *sum / *whole } else { sky.radiance(direction(index)) };
        (mean + least).as_vec3()
    };
    sums.iter().enumerate().map(mean).collect()
}

/// Which direction a unit vector is; twin of glsl/lib/directions.glsl.
fn direction_index(way: Vec3) -> usize {
    let on = way / way.abs().element_sum();
    let folded = (1.0 - Vec2::new(on.y, on.x).abs()) * Vec2::new(1f32.copysign(on.x), 1f32.copysign(on.y));
    let at = if on.z < 0.0 { folded } else { on.truncate() };
    let texel = ((at * 0.5 + 0.5) * DIRECTION_SIDE as f32).clamp(Vec2::ZERO, Vec2::splat(DIRECTION_SIDE as f32 - 0.5));
    (texel.y as u32 * DIRECTION_SIDE + texel.x as u32) as usize
}

/// The middle of a direction.
fn direction(index: usize) -> DVec3 {
    let side = DIRECTION_SIDE as usize;
    let at = (DVec2::new((index % side) as f64, (index / side) as f64) + 0.5) * 2.0 / side as f64 - 1.0;
    let on = at.extend(1.0 - at.x.abs() - at.y.abs());
    let below = (-on.z).max(0.0);
    (on - DVec3::new(below.copysign(on.x), below.copysign(on.y), 0.0)).normalize()
}
