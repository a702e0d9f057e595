//! Each pixel's short rays, against f64 rays.

use glam::{DAffine3, DVec3, Vec3};
use lightskin::bake::CacheSet;
use lightskin::frame::near::SEEN_LIFT;
use lightskin::frame::{LightShadows, Near, Shadows, View, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::Knobs;
use lightskin::reference::gather;
use lightskin::reference::hit_caches::Around;
use lightskin::reference::near::{FarLight, reflected_direct};
use lightskin::reference::world::{Hit, Sides, Surface, World as Placed};
use lightskin::scene::build::{CornellSurface, cornell, cuboid};
use lightskin::scene::{Light, LightKind, Scene};
use lightskin::shared::{NEAR_SIDE, NearPixel, Val};

use crate::common::frames::{add, baked, drawn_turned, lamp, phong, references_at, shoot, small};
use crate::common::{assert_clean, gpu};

/// Rays about the normal of a pixel.
const EACH: u32 = 8;

fn knobs(size: [u32; 2], near: Near) -> Knobs {
    Knobs { size, near, shadows: Shadows::PerLight, rsm: 96, light_shadows: LightShadows::Maps(1024), ..small() }
}

fn short(every: u32) -> Near {
    Near::Rays { per_pixel: EACH, every }
}

/// What a picture's rays have found, and what caches know of far light.
struct Traced {
    pixels: Vec<NearPixel>,
    width: u32,
    radiances: Vec<u32>,
    guides: Vec<u32>,
    /// The caches as VALs, if there are several bounces.
    vals: Vec<Val>,
    caches: Vec<gather::Cache>,
    /// Length of the rays \[m\], and the angle by which they are turned about normals \[rad\].
    reach_and_turn: [f64; 2],
}

fn traced(gpu: &Gpu, scene: &Scene, world: &World, caches: &CacheSet, knobs: &Knobs, turn: f32) -> Traced {
    let frame = drawn_turned(gpu, scene, world, knobs, turn);
    let reach = if matches!(knobs.near, Near::Endless { .. }) { f64::INFINITY } else { caches.spacing };
    let near = frame.picture.near.as_ref().expect("rays");
    let light = &frame.light.caches().expect("caches").gather;
    let vals = if knobs.bounces > 1 {
        gpu.read(&crate::common::frames::traced(&frame).0.bounces.as_ref().expect("bounces").vals).expect("read")
    } else {
        Vec::new()
    };
    Traced {
        pixels: gpu.read(&near.pixels).expect("read"),
        width: near.size[0],
        radiances: gpu.read(light.radiances().expect("directions")).expect("read"),
        guides: gpu.read(light.guides().expect("directions")).expect("read"),
        vals,
        caches: shoot(gpu, scene, Some(caches), &Knobs { size: [8, 8], ..*knobs }).caches,
        reach_and_turn: [reach, f64::from(turn)],
    }
}

/// What a pixel's rays find in f64.
#[derive(Default)]
struct Found {
    irradiance: DVec3,
    far: DVec3,
    all: DVec3,
    /// Rays about the normal that hit nothing.
    open: u32,
    rays: u32,
    guided: u32,
    endless: u32,
}

/// Traces the rays of pixel `i`. `light` tells the radiance that a surface sends back along a ray, by its hit, the ray's
/// unit direction and weight.
fn in_f64(
    scene: &Scene,
    caches: &CacheSet,
    around: &Around<'_>,
    origin: DVec3,
    (traced, i): (&Traced, usize),
    mut light: impl FnMut(&Hit, &Surface, DVec3, f64) -> DVec3,
) -> Found {
    let pixel = &traced.pixels[i];
    let place = [i as u32 % traced.width, i as u32 / traced.width];
    let (position, normal) = (pixel.position.as_dvec3() + origin, pixel.normal.as_dvec3());
    let hit = around.world.nearest(position + 1e-3 * normal, -normal, Sides::Both).expect("the pixel's surface");
    let surface = around.world.surface(&hit);
    let mut sorted = around.sorted(&surface, &references_at(scene, caches, &hit).concat());
    sorted.truncate(3);
    let sum: f64 = sorted.iter().map(|cache| around.weight(&surface, *cache)).sum();
    let about: Vec<_> = sorted.iter().map(|cache| (*cache, around.weight(&surface, *cache) / sum)).collect();
    let far = FarLight { radiances: &traced.radiances, guides: &traced.guides };
    let rays = far.rays(&about, [normal; 2], ([EACH, EACH / 4], place), traced.reach_and_turn);
    let mut found = Found { rays: rays.len() as u32, guided: rays.len() as u32 - EACH, ..Found::default() };
    for (number, ray) in (0..).zip(rays) {
        // All surfaces are flat. Positions are rounded, so rays start slightly above the surface.
        let hit = around.world.nearest(position + normal * 2e-5, ray.way, Sides::Both);
        found.all += ray.weight * ray.far;
        found.endless += u32::from(ray.reach.is_infinite());
        match hit.filter(|hit| hit.distance < ray.reach) {
            Some(hit) => found.irradiance += ray.weight * light(&hit, &around.world.surface(&hit), ray.way, ray.weight),
            None => {
                found.open += u32::from(number < EACH && traced.reach_and_turn[0].is_finite());
                found.far += if ray.reach.is_finite() { ray.weight * ray.far } else { DVec3::ZERO };
            }
        }
    }
    found
}

#[test]
fn rays_find_what_f64_finds() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Glossy, 0.1);
    let caches = baked(&scene, 0.4, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let placed = Placed::new(&scene);
    // The rays of the second picture are traced in two parts; the second part begins within the rows that are compared.
    // The rays of the third are endless and turned.
    let third = Near::Endless { per_pixel: EACH, every: 2 };
    let pictures = [([96, 64], short(2), 0, 0.0), ([448, 288], short(1), 224, 0.0), ([96, 64], third, 0, 0.7)];
    for (size, near, first_row, turn) in pictures {
        let traced = traced(&gpu, &scene, &world, &caches, &knobs(size, near), turn);
        let around = Around { world: &placed, caches: &traced.caches, reach: caches.spacing, lift: 0.0 };
        let [mut rays, mut guided, mut endless, mut closed, mut differ] = [0; 5];
        let (mut off, mut sum) = ([0.0; 3], [0.0; 3]);
        let compared = traced.pixels.iter().enumerate().skip((first_row * traced.width) as usize);
        for (i, pixel) in compared.filter(|(_, pixel)| pixel.geometric > 0.0) {
            let wanted = in_f64(&scene, &caches, &around, world.origin, (&traced, i), |_, surface, way, _| {
                surface.emission + reflected_direct(&placed, surface, way)
            });
            rays += wanted.rays;
            guided += wanted.guided;
            endless += wanted.endless;
            closed += EACH - wanted.open;
            differ += (pixel.open * EACH as f32 - wanted.open as f32).abs().round() as u32;
            let pairs = [(pixel.irradiance, wanted.irradiance), (pixel.far, wanted.far), (pixel.all, wanted.all)];
            for (k, (found, wanted)) in pairs.into_iter().enumerate() {
                off[k] += (wanted - found.as_dvec3()).length();
                sum[k] += wanted.length();
            }
        }
        let off = [0, 1, 2].map(|k| off[k] / f64::max(sum[k], 1e-30));
        println!(
            "{rays} rays, {guided} guided, {endless} endless, {closed} hit a surface, {differ} differ; relative error of \
             irradiance from hits {:.5}, from far surfaces by open rays {:.5}, by all {:.5}",
            off[0], off[1], off[2]
        );
        assert!(rays > 8000 && closed * 8 > rays - guided, "{closed} of {rays} rays hit a surface");
        assert!(guided * 7 > rays && endless * 50 > rays, "{guided} of {rays} rays are guided, {endless} endless");
        assert!(differ * 500 < rays, "{differ} of {rays} rays differ");
        assert!(off.iter().all(|off| *off < 0.005), "{off:?}");
    }
    assert_clean(&gpu);
}

/// Thin walls stand on a floor whose triangles continue on both of their sides.
#[test]
fn hits_send_on_the_light_of_caches_that_they_see() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Diffuse, 0.5);
    for x in [-0.8, -0.6, -0.4, 0.75] {
        let wall = cuboid(Vec3::new(x - 0.02, 0.0, -0.1), Vec3::new(x + 0.02, 0.4, 0.9), 0.2, |_| true);
        add(&mut scene, wall, phong([0.8; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    }
    let caches = baked(&scene, 0.4, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let traced = traced(&gpu, &scene, &world, &caches, &Knobs { bounces: 2, ..knobs([96, 64], short(2)) }, 0.0);
    let placed = Placed::new(&scene);
    let spacing = caches.spacing;
    let around = Around { world: &placed, caches: &traced.caches, reach: spacing, lift: SEEN_LIFT * spacing };
    let [mut pixels, mut rays, mut aside, mut differ, mut differ_by_largest] = [0; 5];
    for (i, pixel) in traced.pixels.iter().enumerate().filter(|(_, pixel)| pixel.geometric > 0.0) {
        // What the light of the cache of largest weight would add.
        let mut by_largest = DVec3::ZERO;
        let wanted = in_f64(&scene, &caches, &around, world.origin, (&traced, i), |hit, surface, way, weight| {
            let direct = surface.emission + reflected_direct(&placed, surface, way);
            let w = [1.0 - hit.weights.x - hit.weights.y, hit.weights.x, hit.weights.y];
            let nearest = (1..3).fold(0, |nearest, i| if w[i] > w[nearest] { i } else { nearest });
            let sorted = around.sorted(surface, &references_at(&scene, &caches, hit)[nearest]);
            let Some(cache) = around.first_seen(surface, &sorted) else { return direct };
            let sent = |cache: usize| {
                let val = traced.vals[cache];
                { val.flux }.as_dvec3() / (std::f64::consts::PI * f64::from(val.area))
            };
            by_largest += weight * (sent(sorted[0]) - sent(cache));
            rays += 1;
            aside += usize::from(cache != sorted[0]);
            direct + sent(cache)
        });
        let got = { pixel.irradiance }.as_dvec3();
        let is_off = |wanted: DVec3| usize::from(got.distance(wanted) > 0.01 * wanted.length());
        pixels += 1;
        differ += is_off(wanted.irradiance);
        differ_by_largest += is_off(wanted.irradiance + by_largest);
    }
    println!(
        "{aside} of {rays} hits do not see the cache of largest weight; {differ} of {pixels} pixels differ, by that \
         {differ_by_largest}"
    );
    // A hit just within the reach in f32 may be just beyond it in f64.
    assert!(aside > 10 && differ * 500 < pixels && differ_by_largest > 10, "{differ}, {differ_by_largest} of {pixels}");
    assert_clean(&gpu);
}

/// Directions repeat every four pixels, and the pictures of a supersample are shifted by whole pixels. Those that show a pixel
/// with the same directions must turn them apart.
#[test]
fn samples_of_a_pixel_have_their_own_rays() {
    let scene = cornell(CornellSurface::Diffuse, 0.1);
    let view = View::new(&scene.cameras[0], [64, 48], DVec3::ZERO, 1.0);
    let samples: Vec<(View, [u32; 2])> = (0..64).map(|number| view.sample(number, [64, 48])).collect();
    let alike = |a: [u32; 2], b: [u32; 2]| a.map(|i| i % NEAR_SIDE) == b.map(|i| i % NEAR_SIDE);
    let mut least = f32::MAX;
    for (i, (a, shift)) in samples.iter().enumerate() {
        for (b, _) in samples[..i].iter().filter(|(_, other)| alike(*shift, *other)) {
            let apart = (a.turn - b.turn).rem_euclid(std::f32::consts::TAU);
            least = least.min(apart.min(std::f32::consts::TAU - apart));
        }
    }
    println!("turns of the same directions are {least:.2} apart at least");
    assert!(least > 0.5, "{least}");
}

/// A hit asks one light, of a red and a blue one at the same place. The mean of many pictures needs both.
#[test]
fn views_of_a_reference_ask_other_lights() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    let at = |color: Vec3| Light { color, position: DVec3::new(0.0, 1.6, 0.6), ..lamp(LightKind::Point) };
    scene.lights = vec![at(Vec3::X), at(Vec3::Z)];
    let world = World::new(&gpu, &scene, Some(&baked(&scene, 0.4, 8))).expect("uploaded");
    let knobs = knobs([96, 64], Near::Endless { per_pixel: 1, every: 2 });
    let views: Vec<Vec<NearPixel>> = (0..8)
        .map(|turn| {
            let frame = drawn_turned(&gpu, &scene, &world, &knobs, turn as f32 * 0.7);
            gpu.read(&frame.picture.near.as_ref().expect("rays").pixels).expect("read")
        })
        .collect();
    let [mut one, mut both] = [0; 2];
    for pixel in 0..views[0].len() {
        let lit = |channel: usize| views.iter().filter(|view| { view[pixel].irradiance }[channel] > 0.0).count();
        let counts = [lit(0), lit(2)];
        one += usize::from(counts[0] + counts[1] >= 5);
        both += usize::from(counts[0] + counts[1] >= 5 && counts.into_iter().all(|count| count > 0));
    }
    println!("{both} of {one} pixels have light of both lamps");
    assert!(one > 300 && both * 5 > one * 4, "{both} of {one} pixels");
    assert_clean(&gpu);
}
