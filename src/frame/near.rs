//! Stage 8, first part: short rays from the visible surfaces. METHOD 11.
//!
//! Caches cannot resolve surfaces within one cache spacing. A few rays from some of the pixels find these surfaces, and
//! the next pass combines the rays of neighbouring pixels. The surfaces that rays hit add their own light and block the
//! light of caches from that direction.

use super::gbuffer::Surface;
use super::plan::Plan;
use super::settings::{Antialiasing, Near};
use super::view::View;
use super::world::World;
use crate::error::{Error, Result};
use crate::gpu::{Bind, Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{
    LOBE_RAYS, NEAR_SIDE, NearFilterPush, NearHitsPush, NearLight, NearPixel, NearRay, NearRaysPush, NearSpreadPush,
};
use glam::Vec3;
use std::f32::consts::PI;

/// Traces short rays and combines those of neighbouring pixels.
pub struct NearRays {
    trace: Pipeline,
    shade: Pipeline,
    sum: Pipeline,
    filter: Pipeline,
    /// Only for single pictures: the mean of many, each with other rays, needs no spreading.
    spread: Option<Pipeline>,
    /// Whether the surfaces at hits reflect the lights.
    reflects: bool,
    /// Whether open rays see a sky.
    sky: bool,
    /// Directions about +z that neighbours share, one block per ray.
    directions: Buffer,
    /// Rays on their way from one pass to the next: those of a part of the picture.
    rays: Buffer,
    /// Indices of rays whose hits are to be lit, per workgroup, and their numbers.
    lists: Buffer,
    counts: Buffer,
    /// Rays that a pixel may have, with those of its lobe.
    slots: u32,
    /// Rays of a pixel that follow the light of caches.
    guided: u32,
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
    /// Second buffer for the spreading passes, if there are any. They alternate between `lights` and this one.
    pub halfway: Option<Buffer>,
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

/// Step sizes of the spreading passes \[traced pixels\]. Their number must be even. A step of 2 removes
/// the pattern of squares that share directions, which repeats every 4; an odd step removes what repeats every 2.
const SPREADS: [u32; 4] = [2, 5, 13, 32];

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

/// Shaders by features: glossy materials (1), caches that see a sky (2).
const TRACE: [&str; 4] = ["near_rays.comp", "near_rays_glossy.comp", "near_rays_sky.comp", "near_rays_glossy_sky.comp"];
const SUM: [&str; 4] = ["near.comp", "near_glossy.comp", "near_sky.comp", "near_glossy_sky.comp"];

/// Shaders by features: surfaces that reflect the light of caches (1), caches that see a sky (2).
const SHADE: [&str; 4] = ["near_hits.comp", "near_hits_lit.comp", "near_hits_sky.comp", "near_hits_lit_sky.comp"];

/// Radius of the filter's window in pictures that are the mean of many \[traced pixels\].
const NARROW_FILTER: u32 = 1;

/// Memory for rays \[bytes\]. More parts of a picture would occupy a GPU less.
const RAYS_BYTES: u32 = 64 << 20;

/// Hits that a thread lights, at most.
const HITS_EACH: u32 = 4;

/// Pixels of a workgroup.
const GROUP: u32 = 64;

// Shaders also read them as whole texels.
const _: () = assert!(size_of::<NearPixel>() == 9 * 16 && size_of::<NearLight>() == 7 * 16);

/// Specialization constant of shaders that read results of rays, of pictures of any size: 1 to read them as texels.
pub(super) fn as_texels(gpu: &Device) -> u32 {
    u32::from(gpu.reads_texels(gpu.most_buffer_bytes()))
}

/// Guided rays of a pixel with this many rays about its normal. Under a sky there are more: some follow its light.
fn guided(rays: u32, sky: bool) -> u32 {
    rays.div_ceil(if sky { 2 } else { 4 })
}

/// Workgroups whose rays are kept at once: a multiple of those that have all directions.
fn groups_at_once(slots: u32) -> u32 {
    (RAYS_BYTES / (GROUP * slots * size_of::<NearRay>() as u32)).next_multiple_of(NEAR_SIDE * NEAR_SIDE)
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
        let endless = u32::from(matches!(near, Near::Endless { .. }));
        let guided = guided(per_pixel, plan.sky_light);
        let constants = [stack, levels, texels, holes, per_pixel, references, by_cells, endless, guided];
        let sky = 2 * usize::from(plan.sky_light);
        let slots = per_pixel + guided + if plan.glossy { LOBE_RAYS } else { 0 };
        let names = if plan.glossy {
            ["near_filter_glossy.comp", "near_spread_glossy.comp"]
        } else {
            ["near_filter.comp", "near_spread.comp"]
        };
        let rays_at_once = u64::from(groups_at_once(slots) * GROUP * slots);
        let single = plan.antialiasing != Antialiasing::Supersampled;
        let of_hits = [stack, levels, texels, holes, references, by_cells];
        let of_hits = &of_hits[..if lit || plan.sky_light { 6 } else { 4 }];
        Ok(Some(Self {
            trace: gpu.compute(TRACE[usize::from(plan.glossy) + sky], &constants)?,
            shade: gpu.compute(SHADE[usize::from(lit) + sky], of_hits)?,
            sum: gpu.compute(SUM[usize::from(plan.glossy) + sky], &constants)?,
            filter: gpu.compute(names[0], &[as_texels(gpu), if single { NEAR_SIDE / 2 } else { NARROW_FILTER }])?,
            spread: single.then(|| gpu.compute(names[1], &[as_texels(gpu)])).transpose()?,
            reflects: plan.reflects || plan.sends_sky,
            sky: plan.sky_light,
            directions: gpu.buffer_from("near.directions", &directions(per_pixel * NEAR_SIDE * NEAR_SIDE))?,
            rays: gpu.buffer("near.rays", rays_at_once * size_of::<NearRay>() as u64)?,
            lists: gpu.buffer("near.lists", rays_at_once * 4)?,
            counts: gpu.buffer("near.counts", u64::from(groups_at_once(slots)) * 4)?,
            slots,
            guided,
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
        (atlas, [radiances, guides]): (&Buffer, [&Buffer; 2]),
        (lit, sky): (Option<&Buffer>, Option<[&Buffer; 2]>),
        waits: bool,
        views: impl Iterator<Item = (&'a View, &'a Surface, &'a NearPixels)> + Clone,
    ) {
        let Some(rays) = world.rays() else { return };
        if waits {
            // Visible surfaces, caches and their light -> here and the next pass.
            cmd.barrier(Use::ColorWrite | Use::ComputeWrite, Use::ComputeRead | Use::IndirectRead);
        }
        let mut first = true;
        for (view, surface, out) in views.clone() {
            let Some(element) = &surface.element else { continue };
            let [width, height] = out.size;
            let cache_reach = world.cells.as_ref().map_or(world.spacing(), |cells| cells.reach) as f32;
            // Shaders declare some of these bindings.
            let none = Bind::from(radiances);
            let [b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11] = rays.binds(world);
            let cells = world.cells.as_ref().map(|c| [&c.grids, &c.entries].map(Bind::from));
            let [grids, entries] = cells.unwrap_or([none; 2]);
            let [seen, open] = sky.map_or([none; 2], |sky| sky.map(Bind::from));
            let of_sky = world.sky_light.as_ref().map(|sky| [&sky.texels, &sky.levels].map(Bind::from));
            let [texels, levels] = of_sky.unwrap_or([none; 2]);
            #[rustfmt::skip]
            let all: [Bind<'_>; 36] = [
                b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, // 0
                (&world.light_buffer).into(), element.into(), (&world.draw_records).into(), (&self.directions).into(), // 12
                (&out.pixels).into(), radiances.into(), atlas.into(), // 16
                (&world.references).into(), (&world.instance_caches).into(), grids, entries, Bind::SomeTexels(atlas), // 19
                (&surface.normal).into(), (&surface.specular).into(), lit.map_or(none, Bind::from), // 24
                seen, open, texels, levels, world.cache_albedos().map_or(none, Bind::from), // 27
                (&self.rays).into(), (&self.lists).into(), (&self.counts).into(), guides.into(), // 32
            ];
            let bind = |pipeline: &Pipeline| {
                let used: Vec<_> = pipeline.bindings().map(|i| all[i as usize]).collect();
                cmd.bind(pipeline, &used);
            };
            // A workgroup has 8 x 8 pixels that share their directions.
            let block = NEAR_SIDE * 8;
            let groups = width.div_ceil(block) * height.div_ceil(block) * NEAR_SIDE * NEAR_SIDE;
            let at_once = groups_at_once(self.slots);
            for first_group in (0..groups).step_by(at_once as usize) {
                let threads = (groups - first_group).min(at_once) * GROUP;
                let push = NearRaysPush {
                    clip_from_world: view.clip_from_world,
                    eye: view.eye,
                    cache_reach,
                    reach: self.reach,
                    root: rays.root,
                    width,
                    height,
                    every: out.every,
                    first_group,
                    turn: view.turn,
                };
                if !first {
                    // The part before has been read.
                    cmd.barrier(Use::ComputeRead, Use::ComputeWrite);
                }
                first = false;
                bind(&self.trace);
                cmd.push(&push);
                cmd.dispatch(threads, 1, 1);
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                bind(&self.shade);
                let sky_lights = if self.sky { world.sky_lights() } else { 0..0 };
                cmd.push(&NearHitsPush {
                    cache_reach,
                    seen_lift: (SEEN_LIFT * world.spacing()) as f32,
                    root: rays.root,
                    rays: self.near.per_pixel(),
                    guided: self.near.per_pixel() + self.guided,
                    slots: self.slots,
                    light_count: world.lights().len() as u32,
                    reflects: u32::from(self.reflects),
                    first_sky_light: sky_lights.start,
                    sky_light_count: sky_lights.len() as u32,
                    turn: view.turn,
                });
                cmd.dispatch(threads, self.slots.div_ceil(HITS_EACH), 1);
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
                bind(&self.sum);
                cmd.push(&push);
                cmd.dispatch(threads, 1, 1);
            }
        }
        cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        for (_, _, NearPixels { pixels, lights, size: [width, height], .. }) in views.clone() {
            let (width, height) = (*width, *height);
            cmd.bind(&self.filter, &[pixels.into(), Bind::SomeTexels(pixels), lights.into()]);
            cmd.push(&NearFilterPush { width, height });
            cmd.dispatch(width, height, 1);
        }
        let Some(spread) = &self.spread else { return };
        for (i, step) in SPREADS.into_iter().enumerate() {
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            for (_, _, NearPixels { lights, halfway, size: [width, height], .. }) in views.clone() {
                let (width, height) = (*width, *height);
                let Some(halfway) = halfway else { continue };
                let [from, to] = if i % 2 == 0 { [lights, halfway] } else { [halfway, lights] };
                cmd.bind(spread, &[from.into(), Bind::SomeTexels(from), to.into()]);
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
        let lights = |name| gpu.buffer(name, count * size_of::<NearLight>() as u64);
        Ok(Self {
            pixels: gpu.buffer("near.pixels", count * size_of::<NearPixel>() as u64)?,
            lights: lights("near.lights")?,
            halfway: rays.spread.is_some().then(|| lights("near.halfway")).transpose()?,
            size,
            every,
        })
    }
}
