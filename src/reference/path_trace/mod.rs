//! Path tracer: the engine's ground truth, with the same scene, materials, lights and camera, but without caches, VALs,
//! proxies or interpolation. METHOD 0, Veach 1997.
//!
//! Each vertex of a path samples a direction from its surface's lobes, a point from the lights' own rays, a point on an
//! emitting surface and a direction of the sky, combined by multiple importance sampling with the balance heuristic.
//! Samples are spread over pixels or go through pixel centres only. Sequences are Owen-scrambled Sobol points, two per
//! pixel, for even and odd passes: their difference gives the noise.

mod emitters;
mod file;
mod inside;
mod scatter;
mod seen;
mod sky;

use std::borrow::Cow;
use std::f64::consts::PI;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use sobol_burley::sample_4d;

use super::gather::luminance;
use super::world::{Sides, Surface, World};
use crate::scene::sky::Sky;
use crate::scene::{Camera, Projection, Scene};
use emitters::{Emitters, Which};
use scatter::Scatter;
use seen::{Left, Seen};
use sky::SkyLight;

/// Samples per pixel and pass.
pub const PASS_SAMPLES: u32 = 16;

/// Length of a Sobol sequence; a new scramble follows.
const SEQUENCE: u32 = 1 << 16;

/// Bounces after which Russian roulette ends paths.
const ROULETTE: u32 = 4;

/// Upper bound of the survival probability, even for paths that have lost no light.
const LIKELIEST: f64 = 0.95;

/// Light paths to follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathTraceSettings {
    /// Picture size \[pixels\].
    pub size: [u32; 2],
    /// Most indirect bounces: 0 for direct light only; `None` for all.
    pub bounces: Option<u32>,
    /// Whether indirect light is shadowed; if not, one bounce is the limit of infinitely many VALs.
    pub visibility: bool,
    /// Whether bounces before the last one also reflect glossily; the engine's do not.
    pub glossy_bounces: bool,
    /// Light sources.
    pub sources: Sources,
    /// Whether samples are spread over pixels; if not, all go through pixel centres.
    pub spread: bool,
    /// Random seed.
    pub seed: u32,
}

/// Light sources that count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sources {
    /// Punctual lights. Emitting surfaces and the sky are visible but light nothing. Without visibility the lights that
    /// stand for the sky are included.
    Punctual,
    /// Emitting surfaces.
    Surfaces,
    /// The sky.
    Sky,
    /// All of them.
    All,
}

impl Default for PathTraceSettings {
    fn default() -> Self {
        Self::of([1280, 720])
    }
}

impl PathTraceSettings {
    /// All light.
    pub fn of(size: [u32; 2]) -> Self {
        Self {
            size,
            bounces: None,
            visibility: true,
            glossy_bounces: true,
            sources: Sources::All,
            spread: false,
            seed: 0,
        }
    }

    /// Light paths of the engine without short rays: this number of bounces, of which only the last reflects glossily.
    pub fn engine(size: [u32; 2], bounces: u32) -> Self {
        Self { bounces: Some(bounces), glossy_bounces: false, ..Self::of(size) }
    }

    /// The limit of brute force: one unshadowed bounce of punctual lights.
    pub fn unshadowed(size: [u32; 2]) -> Self {
        Self { visibility: false, sources: Sources::Punctual, ..Self::engine(size, 1) }
    }
}

/// A picture that is refined pass by pass.
pub struct PathTrace<'a> {
    world: World<'a>,
    emitters: Emitters,
    sky: Option<SkyLight<'a>>,
    /// Shown where there is no surface.
    backdrop: Option<Cow<'a, Sky>>,
    settings: PathTraceSettings,
    camera: &'a Camera,
    /// Hash of everything that the samples depend on.
    key: [u8; 32],
    pixels: Vec<Pixel>,
    samples: u32,
}

/// Sums of one pixel.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Pixel {
    /// Sum over samples of directly reflected radiance from emitting surfaces and the sky.
    direct: [f64; 3],
    /// Sum over samples of the diffuse lobe's indirect radiance.
    diffuse: [f64; 3],
    /// The same for the glossy lobe.
    glossy: [f64; 3],
    /// Sum of luminance over even passes.
    half: f64,
    /// Sum over samples of the backdrop's radiance; part of `direct`.
    behind: [f64; 3],
    /// Samples that show the backdrop.
    missed: f64,
}

/// Radiance [cd/m^2] of one or more samples.
#[derive(Clone, Copy, Default)]
struct Radiance {
    direct: DVec3,
    diffuse: DVec3,
    glossy: DVec3,
    /// Radiance of the backdrop; part of `direct`.
    behind: DVec3,
    /// Samples that show the backdrop.
    missed: f64,
}

impl<'a> PathTrace<'a> {
    /// Prepares a picture without samples. Panics on meaningless settings: without visibility there may be at most one
    /// bounce, and only punctual lights.
    pub fn new(scene: &'a Scene, camera: &'a Camera, settings: &PathTraceSettings) -> Self {
        assert!(
            settings.visibility
                || (settings.bounces.is_some_and(|bounces| bounces <= 1) && settings.sources == Sources::Punctual),
            "without visibility there is one bounce of punctual lights"
        );
        let world = World::new(scene);
        let has = |sources| settings.sources == sources || settings.sources == Sources::All;
        // VALs know the sky only through the lights that stand for it.
        let stand_ins = scene.sky.as_ref().filter(|_| settings.visibility).map_or(0..0, |sky| sky.lights.clone());
        let lights = scene.lights.iter().enumerate().filter(|(index, _)| !stand_ins.contains(index));
        let lights = lights.map(|(_, light)| light).filter(|_| has(Sources::Punctual));
        let emitters = Emitters::new(&world, lights, has(Sources::Surfaces));
        let sky = scene.sky.as_ref().filter(|_| has(Sources::Sky)).and_then(SkyLight::new);
        let pixels = vec![Pixel::default(); settings.size[0] as usize * settings.size[1] as usize];
        let key = file::key(scene, camera, settings);
        Self { world, emitters, sky, backdrop: scene.behind(), settings: *settings, camera, key, pixels, samples: 0 }
    }

    /// Whether the picture has no noise at any number of samples: direct light of punctual lights.
    pub fn is_exact(&self) -> bool {
        let sampled = self.emitters.has_surfaces() || self.emitters.has_soft() || self.sky.is_some();
        let below = self.world.scene().materials.iter().any(|material| material.subsurface.is_some());
        !self.settings.spread && self.settings.bounces == Some(0) && !sampled && !below
    }

    /// Adds [`PASS_SAMPLES`] samples to every pixel, on all cores.
    pub fn pass(&mut self) {
        self.pass_unless(&AtomicBool::new(false));
    }

    /// [`Self::pass`], unless the flag is set before its end; the flag stays set and nothing is added. Returns whether
    /// it completed.
    pub fn pass_unless(&mut self, stop: &AtomicBool) -> bool {
        self.pass_while(&|| !stop.load(Ordering::Relaxed))
    }

    /// [`Self::pass`] while `goes_on` returns true; it is called before each pixel and may block. Once it returns
    /// false, nothing is added. Returns whether the pass completed.
    pub fn pass_while(&mut self, goes_on: &(dyn Fn() -> bool + Sync)) -> bool {
        let stop = AtomicBool::new(false);
        let stopped = || stop.load(Ordering::Relaxed);
        let pass = self.samples / PASS_SAMPLES;
        let (half, first) = (pass % 2, pass / 2 * PASS_SAMPLES);
        let mut pixels = self.pixels.clone();
        pixels.par_iter_mut().enumerate().with_min_len(64).for_each(|(index, pixel)| {
            if stopped() || !goes_on() {
                stop.store(true, Ordering::Relaxed);
                return;
            }
            let mut sum = Radiance::default();
            let seed = mix(index as u32 ^ mix(half));
            if self.settings.spread {
                for sample in first..first + PASS_SAMPLES {
                    sum.add(DVec3::ONE, &self.sample_within(index, seed, sample));
                }
            } else {
                let (origin, direction) = camera_ray(self.camera, self.settings.size, index);
                for Seen { surface, direction, share, .. } in self.seen(origin, direction).0 {
                    let scatter = self.scatter(&surface, direction);
                    for sample in first..first + PASS_SAMPLES {
                        sum.add(share, &self.sample((&scatter, &surface), direction, seed, sample));
                    }
                }
            }
            let add = |to: &mut [f64; 3], sum: DVec3| *to = (DVec3::from(*to) + sum).to_array();
            add(&mut pixel.direct, sum.direct);
            add(&mut pixel.diffuse, sum.diffuse);
            add(&mut pixel.glossy, sum.glossy);
            add(&mut pixel.behind, sum.behind);
            pixel.missed += sum.missed;
            if half == 0 {
                pixel.half += luminance(sum.direct + sum.diffuse + sum.glossy);
            }
        });
        if stopped() {
            return false;
        }
        self.pixels = pixels;
        self.samples += PASS_SAMPLES;
        true
    }

    /// Samples per pixel so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Relative standard error of the sampled radiance, averaged over lit pixels, from the difference of even and odd
    /// passes, whose sequences are independent. 1 % of the mean is added to each pixel's radiance, so that almost black
    /// pixels do not count as noise. Infinite before the second pass.
    pub fn noise(&self) -> f64 {
        let passes = self.samples / PASS_SAMPLES;
        if passes < 2 {
            return f64::INFINITY;
        }
        let (even, odd) = (f64::from(passes.div_ceil(2)), f64::from(passes / 2));
        let total = |p: &Pixel| luminance(DVec3::from(p.direct) + DVec3::from(p.diffuse) + DVec3::from(p.glossy));
        let lit: Vec<(f64, f64)> = self.pixels.iter().map(|p| (total(p), p.half)).filter(|p| p.0 > 0.0).collect();
        let floor = 0.01 * lit.iter().map(|p| p.0).sum::<f64>() / lit.len().max(1) as f64;
        // For two normal variates of deviation s the mean absolute difference is 2 s / sqrt(pi), and the deviation of
        // their mean is s / sqrt(2).
        let error = |(total, half): &(f64, f64)| {
            let difference = (half / even - (total - half) / odd).abs();
            (PI / 8.0).sqrt() * difference * f64::from(passes) / (total + floor)
        };
        lit.iter().map(error).sum::<f64>() / lit.len().max(1) as f64
    }

    /// Emitted and directly reflected radiance [cd/m^2], row by row from the top; the backdrop's where there is no
    /// surface.
    pub fn direct(&self) -> Vec<[f32; 3]> {
        let sampled = self.mean(|pixel| pixel.direct);
        if self.settings.spread {
            return sampled;
        }
        let exact = |(index, sampled): (usize, [f32; 3])| {
            let (origin, direction) = camera_ray(self.camera, self.settings.size, index);
            let (surfaces, left) = self.seen(origin, direction);
            let at_once = |seen: &Seen| seen.share * self.at_once(&seen.surface, seen.direction);
            let exact = surfaces.iter().map(at_once).fold(self.behind(left), |sum, light| sum + light);
            (exact + DVec3::from(sampled.map(f64::from))).as_vec3().to_array()
        };
        sampled.into_par_iter().enumerate().map(exact).collect()
    }

    /// Radiance of a surface that needs no sampling: emission and reflected light of punctual lights without a size.
    fn at_once(&self, surface: &Surface, direction: DVec3) -> DVec3 {
        let scatter = self.scatter(surface, direction);
        let reflected = |towards| scatter.reflected(towards);
        let which = (None, Which::Sharp);
        let (light, _) =
            self.emitters.direct(&self.world, surface.position, surface.geometric, which, DVec2::ZERO, reflected);
        surface.emission * scatter.uncoated() + light
    }

    /// Radiance of the backdrop that arrives at the camera.
    fn behind(&self, (share, direction): Left) -> DVec3 {
        let backdrop = self.backdrop.as_ref().filter(|_| share != DVec3::ZERO);
        backdrop.map_or(DVec3::ZERO, |sky| share * sky.radiance(direction))
    }

    /// Indirect radiance [cd/m^2] of the diffuse lobe, row by row from the top.
    pub fn diffuse(&self) -> Vec<[f32; 3]> {
        self.mean(|pixel| pixel.diffuse)
    }

    /// Indirect radiance [cd/m^2] of the glossy lobe, row by row from the top.
    pub fn glossy(&self) -> Vec<[f32; 3]> {
        self.mean(|pixel| pixel.glossy)
    }

    /// The backdrop's part of [`Self::direct`], and the share of each pixel covered by surfaces.
    pub fn backdrop(&self) -> (Vec<[f32; 3]>, Vec<f32>) {
        if self.settings.spread {
            let share = |pixel: &Pixel| 1.0 - (pixel.missed / f64::from(self.samples.max(1))) as f32;
            return (self.mean(|pixel| pixel.behind), self.pixels.iter().map(share).collect());
        }
        let pixel = |index| {
            let (origin, direction) = camera_ray(self.camera, self.settings.size, index);
            match self.world.nearest(origin, direction, Sides::Front) {
                Some(_) => ([0.0; 3], 1.0),
                None => (self.behind((DVec3::ONE, direction)).as_vec3().to_array(), 0.0),
            }
        };
        (0..self.pixels.len()).into_par_iter().map(pixel).unzip()
    }

    /// The opaque surface at each pixel's centre, row by row from the top.
    pub fn surfaces(&self) -> Vec<Option<Surface>> {
        let opaque = |index| {
            let (origin, direction) = camera_ray(self.camera, self.settings.size, index);
            self.seen(origin, direction).0.last().filter(|last| !last.is_clear).map(|last| last.surface)
        };
        (0..self.pixels.len()).into_par_iter().map(opaque).collect()
    }

    /// Whether each pixel's centre shows an opaque surface.
    pub fn covered(&self) -> Vec<bool> {
        self.surfaces().iter().map(Option::is_some).collect()
    }

    fn mean(&self, sum: impl Fn(&Pixel) -> [f64; 3]) -> Vec<[f32; 3]> {
        let share = 1.0 / f64::from(self.samples.max(1));
        self.pixels.iter().map(|pixel| sum(pixel).map(|s| (s * share) as f32)).collect()
    }

    /// All light of a sample at a random place in a pixel.
    fn sample_within(&self, index: usize, seed: u32, sample: u32) -> Radiance {
        let own = mix(seed ^ mix(self.settings.seed ^ mix(sample / SEQUENCE)) ^ 0x9e37_79b9);
        let [x, y, ..] = sample_4d(sample % SEQUENCE, 0, own).map(f64::from);
        let (origin, direction) = camera_ray_at(self.camera, self.settings.size, index, DVec2::new(x, y));
        let (surfaces, left) = self.seen(origin, direction);
        let mut radiance = Radiance { direct: self.behind(left), ..Radiance::default() };
        if surfaces.is_empty() {
            (radiance.behind, radiance.missed) = (radiance.direct, 1.0);
        }
        for Seen { surface, direction, share, .. } in surfaces {
            radiance.add(share, &self.sample((&self.scatter(&surface, direction), &surface), direction, seed, sample));
            radiance.direct += share * self.at_once(&surface, direction);
        }
        radiance
    }

    /// All light of a sample of a surface; `seen` is its scattering towards the camera.
    fn sample(&self, (seen, surface): (&Scatter, &Surface), direction: DVec3, seed: u32, sample: u32) -> Radiance {
        let mut radiance = Radiance::default();
        let seed = mix(seed ^ mix(self.settings.seed ^ mix(sample / SEQUENCE)));
        if self.looks_inside(surface) {
            radiance.direct += self.light_inside(surface, direction, seed, sample);
        }
        if self.emitters.has_soft() {
            let [x, y, ..] = sample_4d(sample % SEQUENCE, 4, seed).map(f64::from);
            let reflected = |towards| seen.reflected(towards);
            let (which, u) = ((None, Which::Soft), DVec2::new(x, y));
            radiance.direct += self.emitters.direct(&self.world, seen.position, seen.geometric, which, u, reflected).0;
        }
        for (lobe, seed, indirect) in [
            (seen.diffuse(), seed, &mut radiance.diffuse),
            (seen.glossy(), mix(seed ^ 0x5bd1_e995), &mut radiance.glossy),
        ] {
            if !lobe.is_black() {
                radiance.direct += self.path(lobe, seed, sample % SEQUENCE, indirect);
            }
        }
        radiance
    }

    /// Follows one path from a lobe of the visible surface. Adds its indirect radiance; returns the direct radiance
    /// from emitting surfaces and the sky.
    fn path(&self, mut at: Scatter, seed: u32, sample: u32, indirect: &mut DVec3) -> DVec3 {
        let (world, settings) = (&self.world, &self.settings);
        let from_surfaces = self.emitters.has_surfaces();
        let mut direct = DVec3::ZERO;
        let mut throughput = DVec3::ONE;
        for depth in 0.. {
            let random = |set| sample_4d(sample, set, mix(seed.wrapping_add(depth))).map(f64::from);
            let is_last = settings.bounces == Some(depth);
            if is_last && !from_surfaces && self.sky.is_none() {
                break;
            }
            let layer = if depth == 0 { &mut direct } else { &mut *indirect };
            if from_surfaces {
                *layer += throughput * self.by_surface_point(&at, random(1));
            }
            if let Some(sky) = &self.sky {
                *layer += throughput * self.by_sky(sky, &at, random(3));
            }
            if !is_last {
                *indirect += throughput * self.by_lit_surface(&at, random(2));
            }

            let [x, y, chance, _] = random(0);
            let direction = at.sample(DVec2::new(x, y));
            let density = at.density(direction);
            let share = at.reflected(direction) / density;
            if !(share.max_element() > 0.0 && share.is_finite()) {
                break;
            }
            if !settings.visibility {
                world.all(at.position, direction, |hit| {
                    let next = self.bounce(&world.surface(&hit), direction);
                    *indirect += throughput * share * self.lit(&next, direction, density, hit.distance, random(4));
                });
                break;
            }
            if at.geometric.dot(direction) <= 0.0 {
                break;
            }
            let Some(hit) = world.nearest(at.position, direction, Sides::Both) else {
                if let Some(sky) = &self.sky {
                    let layer = if depth == 0 { &mut direct } else { &mut *indirect };
                    let weight = density / (density + sky.density(direction));
                    *layer += throughput * share * sky.radiance(direction) * weight;
                }
                break;
            };
            let surface = world.surface(&hit);
            if from_surfaces {
                let other = self.emitters.surface_density(world, &hit) * hit.distance.powi(2)
                    / -surface.geometric.dot(direction);
                let layer = if depth == 0 { &mut direct } else { &mut *indirect };
                *layer += throughput * share * surface.emission * (density / (density + other));
            }
            if is_last {
                break;
            }
            let next = self.bounce(&surface, direction);
            *indirect += throughput * share * self.lit(&next, direction, density, hit.distance, random(4));
            throughput *= share;
            if depth >= ROULETTE {
                let survives = throughput.max_element().min(LIKELIEST);
                if chance >= survives {
                    break;
                }
                throughput /= survives;
            }
            at = next;
        }
        direct
    }

    /// Scattering at a surface where a path continues.
    fn bounce(&self, surface: &Surface, direction: DVec3) -> Scatter {
        if self.settings.glossy_bounces {
            return Scatter::new(surface, direction);
        }
        Scatter::sending_on(surface)
    }

    /// Radiance of punctual lights reflected at `next` back along the unit `direction`, weighted by the balance
    /// heuristic: a lobe sample of this `density` [1/sr] found the surface `distance` \[m\] away.
    fn lit(&self, next: &Scatter, direction: DVec3, density: f64, distance: f64, random: [f64; 4]) -> DVec3 {
        let reflected = |towards| next.reflected(towards);
        let (which, u) = ((None, Which::All), DVec2::new(random[0], random[1]));
        let (light, other) = self.emitters.direct(&self.world, next.position, next.geometric, which, u, reflected);
        let other = other * distance * distance / -next.geometric.dot(direction);
        light * (density / (density + other))
    }

    /// Radiance through a surface found by a light's own ray.
    fn by_lit_surface(&self, at: &Scatter, random: [f64; 4]) -> DVec3 {
        let world = &self.world;
        let drawn = self.emitters.lit_surface(world, DVec3::new(random[0], random[1], random[2]));
        let Some((light, surface)) = drawn else { return DVec3::ZERO };
        let Some((towards, distance, cosine)) = facing(at.position, surface.position, surface.geometric) else {
            return DVec3::ZERO;
        };
        let reflected = at.reflected(towards);
        if reflected == DVec3::ZERO || (self.settings.visibility && at.geometric.dot(towards) <= 0.0) {
            return DVec3::ZERO;
        }
        let next = self.bounce(&surface, towards);
        let reflected_on = |towards| next.reflected(towards);
        let (which, u) = ((Some(light), Which::All), DVec2::new(random[3], random[1]));
        let (radiance, density) = self.emitters.direct(world, next.position, next.geometric, which, u, reflected_on);
        let own = density * distance * distance / cosine;
        if own == 0.0 || (self.settings.visibility && world.blocked(at.position, surface.position)) {
            return DVec3::ZERO;
        }
        reflected * radiance / (own + at.density(towards))
    }

    /// Radiance from a sampled point on an emitting surface.
    fn by_surface_point(&self, at: &Scatter, random: [f64; 4]) -> DVec3 {
        let drawn = self.emitters.surface_point(&self.world, DVec3::new(random[0], random[1], random[2]));
        let Some((surface, density)) = drawn else { return DVec3::ZERO };
        let Some((towards, distance, cosine)) = facing(at.position, surface.position, surface.geometric) else {
            return DVec3::ZERO;
        };
        let reflected = at.reflected(towards);
        let behind = at.geometric.dot(towards) <= 0.0;
        if reflected == DVec3::ZERO || behind || self.world.blocked(at.position, surface.position) {
            return DVec3::ZERO;
        }
        let own = density * distance * distance / cosine;
        reflected * surface.emission / (own + at.density(towards))
    }

    /// Radiance from a sampled direction of the sky.
    fn by_sky(&self, sky: &SkyLight<'_>, at: &Scatter, random: [f64; 4]) -> DVec3 {
        let (towards, own) = sky.sample(DVec2::new(random[0], random[1]));
        let reflected = at.reflected(towards);
        let behind = at.geometric.dot(towards) <= 0.0;
        if reflected == DVec3::ZERO || behind || self.world.blocked_within(at.position, towards, f64::INFINITY) {
            return DVec3::ZERO;
        }
        reflected * sky.radiance(towards) / (own + at.density(towards))
    }
}

impl Radiance {
    fn add(&mut self, share: DVec3, other: &Self) {
        self.direct += share * other.direct;
        self.diffuse += share * other.diffuse;
        self.glossy += share * other.glossy;
        self.behind += other.behind;
        self.missed += other.missed;
    }
}

/// Unit direction and distance \[m\] to a point, and the cosine at its surface; `None` if it faces away or the points
/// coincide.
fn facing(from: DVec3, to: DVec3, normal: DVec3) -> Option<(DVec3, f64, f64)> {
    let distance = from.distance(to);
    let towards = (to - from) / distance;
    let cosine = -normal.dot(towards);
    (cosine > 0.0).then_some((towards, distance, cosine))
}

/// Origin \[m\] and unit direction of the ray through a pixel's centre; rows from the top.
pub fn camera_ray(camera: &Camera, size: [u32; 2], index: usize) -> (DVec3, DVec3) {
    camera_ray_at(camera, size, index, DVec2::splat(0.5))
}

/// The same through a point within the pixel, from (0, 0) at its upper left corner to (1, 1).
fn camera_ray_at(camera: &Camera, size: [u32; 2], index: usize, within: DVec2) -> (DVec3, DVec3) {
    let (w, h) = (size[0] as usize, f64::from(size[1]));
    let at = DVec2::new((index % w) as f64, (index / w) as f64) + within;
    let place = DVec2::new((2.0 * at.x - w as f64) / h, 1.0 - 2.0 * at.y / h);
    let pose = camera.world_from_camera;
    let world = |v: DVec3| (pose.matrix3 * v).normalize();
    match camera.projection {
        Projection::Perspective { yfov } => {
            let half = (0.5 * f64::from(yfov)).tan();
            (pose.translation, world(DVec3::new(place.x * half, place.y * half, -1.0)))
        }
        Projection::Orthographic { ymag } => {
            let half = f64::from(ymag);
            (pose.transform_point3(DVec3::new(place.x * half, place.y * half, 0.0)), world(DVec3::NEG_Z))
        }
    }
}

/// A well-mixing permutation of 32 bits (Wang's hash as improved by Chris Wellons' search, `lowbias32`).
fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
