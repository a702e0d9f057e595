//! Stage 8, first part: short rays from the visible surfaces. METHOD 11.
//!
//! Caches cannot resolve surfaces within one cache spacing. A few rays from some of the pixels find these surfaces, and
//! the next pass combines the rays of neighbouring pixels. The surfaces that rays hit add their own light and block the
//! light of caches from that direction.

use super::gbuffer::Surface;
use super::plan::Plan;
use super::settings::Near;
use super::view::View;
use super::world::World;
use crate::error::{Error, Result};
use crate::gpu::{Bind, Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{NEAR_SIDE, NearFilterPush, NearLight, NearPixel, NearSpreadPush, TracePush};
use glam::Vec3;
use std::f32::consts::PI;

/// Traces short rays and combines those of neighbouring pixels.
pub struct NearRays {
    trace: Pipeline,
    filter: Pipeline,
    spread: Pipeline,
    glossy: bool,
    /// Whether the surfaces at hits reflect the lights.
    reflects: bool,
    /// Whether open rays see a sky.
    sky: bool,
    /// Directions about +z that neighbours share, one block per ray.
    directions: Buffer,
    near: Near,
    /// Length of the rays \[m\].
    pub reach: f32,
}

/// Results of the rays of a picture.
pub struct NearPixels {
    /// Results per traced pixel, row by row.
    pub pixels: Buffer,
    /// Results combined with those of neighbours.
    pub lights: Buffer,
    /// Second buffer for the spreading passes, which alternate between `lights` and this one.
    pub halfway: Buffer,
    /// Number of columns and rows of traced pixels.
    pub size: [u32; 2],
    /// Distance in columns and rows between them.
    pub every: u32,
}

/// Distance from a cache below which VALs and occluders are left to rays \[cache spacings\].
pub const CACHE_REACH: f64 = 0.5;

/// Length of rays \[cache spacings\].
pub const PIXEL_REACH: f64 = 1.0;

/// Distance from their surfaces of both ends of a ray between a hit and a cache \[cache spacings\].
pub const SEEN_LIFT: f64 = 0.01;

/// Step sizes of the spreading passes \[traced pixels\]. Their number must be even.
const SPREADS: [u32; 4] = [4, 8, 16, 32];

/// Directions about +z with a density proportional to the cosine: points on the unit disc along a spiral.
pub fn directions(count: u32) -> Vec<Vec3> {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    let direction = |i: u32| {
        let r2 = (i as f32 + 0.5) / count as f32;
        let (sin, cos) = (i as f32 * golden).sin_cos();
        Vec3::new(r2.sqrt() * cos, r2.sqrt() * sin, (1.0 - r2).sqrt())
    };
    (0..count).map(direction).collect()
}

/// Shaders by features: glossy materials (1), surfaces that reflect the light of caches (2), caches that see a sky (4).
const SHADERS: [&str; 8] = [
    "near.comp",
    "near_glossy.comp",
    "near_lit.comp",
    "near_glossy_lit.comp",
    "near_sky.comp",
    "near_glossy_sky.comp",
    "near_lit_sky.comp",
    "near_glossy_lit_sky.comp",
];

// Shaders also read them as whole texels.
const _: () = assert!(size_of::<NearPixel>() == 9 * 16 && size_of::<NearLight>() == 7 * 16);

/// Specialization constant of shaders that read results of rays, of pictures of any size: 1 to read them as texels.
pub(super) fn as_texels(gpu: &Device) -> u32 {
    u32::from(gpu.reads_texels(gpu.most_buffer_bytes()))
}

impl NearRays {
    /// Creates the passes that a plan needs. The world must have rays.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shader.
    pub(super) fn new(gpu: &Device, world: &World, plan: &Plan) -> Result<Option<Self>> {
        let near = plan.near;
        if near == Near::Off {
            return Ok(None);
        }
        let per_pixel = near.per_pixel();
        let rays = world.rays().ok_or_else(|| Error::Nothing("the world has no rays".into()))?;
        let [stack, levels, texels, holes] = rays.constants(gpu);
        let by_cells = u32::from(world.references_of_pixels().is_some());
        let (references, lit) = (world.references_each as u32, plan.bounces > 0);
        let constants = [stack, levels, texels, holes, per_pixel, references, by_cells];
        let shader = usize::from(plan.glossy) + 2 * usize::from(lit) + 4 * usize::from(plan.sky_light);
        let names = if plan.glossy {
            ["near_filter_glossy.comp", "near_spread_glossy.comp"]
        } else {
            ["near_filter.comp", "near_spread.comp"]
        };
        Ok(Some(Self {
            trace: gpu.compute(SHADERS[shader], &constants)?,
            filter: gpu.compute(names[0], &[as_texels(gpu)])?,
            spread: gpu.compute(names[1], &[as_texels(gpu)])?,
            glossy: plan.glossy,
            reflects: plan.reflects || plan.sends_sky,
            sky: plan.sky_light,
            directions: gpu.buffer_from("near.directions", &directions(per_pixel * NEAR_SIDE * NEAR_SIDE))?,
            near,
            reach: (PIXEL_REACH * world.spacing()) as f32,
        }))
    }

    /// Records the pass for views, their surfaces and results. `atlas` and `radiances` are the caches and their light
    /// by direction. `lit` is the caches as VALs, if surfaces also reflect their light. `sky` is the sky as caches see
    /// it. Without `waits`, an earlier barrier must have waited for all of these.
    pub(super) fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        (atlas, radiances): (&Buffer, &Buffer),
        (lit, sky): (Option<&Buffer>, Option<[&Buffer; 2]>),
        waits: bool,
        views: impl Iterator<Item = (&'a View, &'a Surface, &'a NearPixels)> + Clone,
    ) {
        let Some(rays) = world.rays() else { return };
        if waits {
            // Visible surfaces, caches and their light -> here and the next pass.
            cmd.barrier(Use::ColorWrite | Use::ComputeWrite, Use::ComputeRead | Use::IndirectRead);
        }
        for (view, surface, out) in views.clone() {
            let Some(element) = &surface.element else { continue };
            let mut resources = rays.binds(world).to_vec();
            resources.extend([Bind::from(&world.light_buffer), element.into()]);
            resources.extend([&world.draw_records, &self.directions, &out.pixels].map(Bind::from));
            let (grids, entries) = world.cells.as_ref().map_or((radiances, radiances), |c| (&c.grids, &c.entries));
            let of_caches = [radiances, atlas, &world.references, &world.instance_caches, grids, entries];
            resources.extend(of_caches.map(Bind::from));
            resources.push(Bind::SomeTexels(atlas));
            resources.extend([&surface.normal, &surface.specular].map(Bind::from).iter().filter(|_| self.glossy));
            resources.extend(lit.map(Bind::from));
            if let (Some([seen, open]), Some(sky)) = (sky, &world.sky_light) {
                resources.extend([seen, open, &sky.texels, &sky.levels].map(Bind::from));
                resources.extend(world.cache_albedos().filter(|_| lit.is_some()).map(Bind::from));
            }
            cmd.bind(&self.trace, &resources);
            let [width, height] = out.size;
            let sky_lights = if self.sky { world.sky_lights() } else { 0..0 };
            cmd.push(&TracePush {
                clip_from_world: view.clip_from_world,
                eye: view.eye,
                cache_reach: world.cells.as_ref().map_or(world.spacing(), |cells| cells.reach) as f32,
                reach: self.reach,
                seen_lift: (SEEN_LIFT * world.spacing()) as f32,
                root: rays.root,
                width,
                height,
                light_count: world.lights().len() as u32,
                reflects: u32::from(self.reflects),
                first_sky_light: sky_lights.start,
                sky_light_count: sky_lights.len() as u32,
                every: out.every,
            });
            // A workgroup has 8 x 8 pixels that share their directions.
            let block = NEAR_SIDE * 8;
            cmd.dispatch(width.div_ceil(block) * NEAR_SIDE * NEAR_SIDE * 64, height.div_ceil(block), 1);
        }
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        for (_, _, NearPixels { pixels, lights, size: [width, height], .. }) in views.clone() {
            let (width, height) = (*width, *height);
            cmd.bind(&self.filter, &[pixels.into(), Bind::SomeTexels(pixels), lights.into()]);
            cmd.push(&NearFilterPush { width, height });
            cmd.dispatch(width, height, 1);
        }
        for (i, step) in SPREADS.into_iter().enumerate() {
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            for (_, _, NearPixels { lights, halfway, size: [width, height], .. }) in views.clone() {
                let (width, height) = (*width, *height);
                let [from, to] = if i % 2 == 0 { [lights, halfway] } else { [halfway, lights] };
                cmd.bind(&self.spread, &[from.into(), Bind::SomeTexels(from), to.into()]);
                cmd.push(&NearSpreadPush { width, height, step });
                cmd.dispatch(width, height, 1);
            }
        }
    }
}

impl NearPixels {
    /// The bindings of `lib/near_lights.glsl`.
    pub(super) fn binds(&self) -> [Bind<'_>; 2] {
        [(&self.lights).into(), Bind::SomeTexels(&self.lights)]
    }

    /// Creates the buffers for a picture of this size.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub(super) fn new(gpu: &Device, rays: &NearRays, size: [u32; 2]) -> Result<Self> {
        let every = rays.near.every(size);
        let size = size.map(|side| side.div_ceil(every));
        let count = u64::from(size[0]) * u64::from(size[1]);
        Ok(Self {
            pixels: gpu.buffer("near.pixels", count * size_of::<NearPixel>() as u64)?,
            lights: gpu.buffer("near.lights", count * size_of::<NearLight>() as u64)?,
            halfway: gpu.buffer("near.halfway", count * size_of::<NearLight>() as u64)?,
            size,
            every,
        })
    }
}
