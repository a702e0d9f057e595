//! A sky on the device: as it is seen, and as surfaces receive it.

use crate::error::Result;
use crate::gpu::{Buffer, Gpu};
use crate::scene::sky::Sky;
use crate::scene::sky_filter;
use crate::shared::{DIRECTION_SIDE, DIRECTIONS, SkyLevel};
use glam::{DVec2, DVec3, Vec3};
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
    /// Fails if the device runs out of memory.
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
    /// Fails if the device runs out of memory.
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

/// The mean radiance of each direction: of this many points along both sides of its square of the octahedron
/// (glsl/lib/directions.glsl), of a sky of texels as wide as they are apart.
fn by_directions(sky: &Sky) -> Vec<Vec3> {
    const POINTS: usize = 4;
    let (grid, side) = (sky_filter::halved(sky, 128), DIRECTION_SIDE as usize);
    let least = 1e-4 * sky.illuminance() / (4.0 * PI);
    let mean = |index: usize| {
        let part = |part: usize| {
            let within = (DVec2::new((part % POINTS) as f64, (part / POINTS) as f64) + 0.5) / POINTS as f64;
            let at = (DVec2::new((index % side) as f64, (index / side) as f64) + within) * 2.0 / side as f64 - 1.0;
            let on = at.extend(1.0 - at.x.abs() - at.y.abs());
            let below = (-on.z).max(0.0);
            grid.radiance((on - DVec3::new(below.copysign(on.x), below.copysign(on.y), 0.0)).normalize())
        };
        let all = (0..POINTS * POINTS).map(part).sum::<DVec3>();
        (all / (POINTS * POINTS) as f64 + least).as_vec3()
    };
    (0..DIRECTIONS as usize).map(mean).collect()
}
