//! The light of a sky on surfaces: its grids against integrals, the sky that caches see against f64 rays, pictures
//! against the path tracer, and no traces of an earlier sky.

use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::bake::CacheSet;
use lightskin::frame::engine::Loaded;
use lightskin::frame::near::CACHE_REACH;
use lightskin::frame::{Engine, LightShadows, Look, Near, Picture, Shadows, World};
use lightskin::gpu::Buffer;
use lightskin::lab::knobs::Knobs;
use lightskin::metrics::metrics;
use lightskin::reference::bounce::{Met, exchange};
use lightskin::reference::depth_image::tangents;
use lightskin::reference::hit_caches::Around;
use lightskin::reference::near::{
    FarLight, direction_index, middle_of, open_share, part_counts, sky_along, unpack_radiance,
};
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::reference::sky::seen;
use lightskin::reference::world::{Sides, World as Placed};
use lightskin::scene::build::{cuboid, quad, sphere};
use lightskin::scene::medium::Subsurface;
use lightskin::scene::sky::Sky;
use lightskin::scene::sky_filter::{LOBES, irradiance, lobes};
use lightskin::scene::{Camera, Material, Projection, Scene, luminance, tessellate};
use lightskin::shared::{
    Cache, DEPTH_IMAGE_SIDE, DIRECTIONS, GUIDE_WORDS, GUIDES, GatherSums, NearPixel, SKY_ITSELF, SKY_OF_CACHES,
    SkySeen, Val,
};
use std::f64::consts::PI;

use crate::common::frames::{add, baked, camera, drawn_of, phong, references_at, shoot, small, traced};
use crate::common::{assert_clean, gpu};

const RAYS: Near = Near::Rays { per_pixel: 8, every: 2 };

/// A coloured sky that is brighter on one side and at the top.
fn uneven() -> Sky {
    let radiance = |direction: DVec3| {
        let warm = (direction.dot(dvec3(0.6, 0.5, 0.62)).max(0.0)).powi(12);
        dvec3(300.0, 500.0, 900.0) * (0.3 + 0.7 * direction.y.max(0.0)) + dvec3(4000.0, 2500.0, 1000.0) * warm
    };
    let plain = Sky::new(128, 64, std::iter::repeat_n(Vec3::ZERO, 128 * 64), 0.4);
    let place = |i: usize| glam::DVec2::new((i % 128) as f64 + 0.5, (i / 128) as f64 + 0.5);
    let texels: Vec<Vec3> = (0..128 * 64).map(|i| radiance(plain.direction_at(place(i))).as_vec3()).collect();
    Sky::new(128, 64, texels.into_iter(), 0.4)
}

/// A ball and a box on a floor. `lobe` gives the specular part and the exponent of the ball.
fn on_a_floor(lobe: Option<(f32, f32)>) -> Scene {
    let mut scene = Scene { name: "floor".into(), ..Scene::default() };
    let floor = quad(vec3(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, 0.5);
    add(&mut scene, floor, phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    let ball = match lobe {
        Some((specular, exponent)) => phong([0.0; 3], [specular; 3], exponent),
        None => phong([0.8; 3], [0.0; 3], 1.0),
    };
    let place = DAffine3::from_translation(dvec3(-0.7, 0.5, 0.0));
    add(&mut scene, sphere(0.5, 32), ball, place);
    let body = cuboid(vec3(0.3, 0.0, -0.5), vec3(1.1, 0.9, 0.4), 0.3, |_| true);
    add(&mut scene, body, phong([0.8, 0.5, 0.3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.0, 1.6, 3.6), dvec3(0.0, 0.4, 0.0), 0.6));
    scene
}

fn knobs(size: [u32; 2], near: Near) -> Knobs {
    Knobs { size, near, shadows: Shadows::PerLight, rsm: 64, light_shadows: LightShadows::Maps(512), ..small() }
}

fn divided(scene: &Scene, spacing: f64) -> (Scene, CacheSet) {
    let mut scene = scene.clone();
    tessellate::divide(&mut scene, spacing, None);
    let caches = baked(&scene, spacing, 8);
    (scene, caches)
}

#[test]
fn grids_have_the_skys_integrals() {
    let sky = uneven();
    let received = irradiance(&sky);
    let blurred = lobes(&sky);
    assert_eq!(blurred.len(), LOBES as usize);
    let mut off = vec![0.0_f64; 1 + blurred.len()];
    for i in 0..=60 {
        // The directions include the poles.
        let y = 1.0 - f64::from(i) / 30.0;
        let (sine, cosine) = (f64::from(i) * 2.4).sin_cos();
        let axis = dvec3(cosine, 0.0, sine) * (1.0 - y * y).sqrt() + DVec3::Y * y;
        let whole = sky.received(axis);
        off[0] = off[0].max(received.radiance(axis).distance(whole) / whole.length());
        for (lobe, grid) in blurred.iter().enumerate() {
            let exponent = f64::from(2048 >> lobe);
            // The mean over directions that are as dense as the lobe, in rings of equal weight.
            let (right, up) = axis.any_orthonormal_pair();
            let mut mean = DVec3::ZERO;
            for ring in 0..64 {
                let cosine = ((f64::from(ring) + 0.5) / 64.0).powf(1.0 / (exponent + 1.0));
                for turn in 0..64 {
                    let (y, x) = (f64::from(turn) * PI / 32.0).sin_cos();
                    let aside = (1.0 - cosine * cosine).sqrt();
                    mean += sky.radiance(axis * cosine + (right * x + up * y) * aside) / 4096.0;
                }
            }
            off[1 + lobe] = off[1 + lobe].max(grid.radiance(axis).distance(mean) / mean.length());
        }
    }
    println!("largest relative error of irradiance {:.4}, of lobes from narrow to wide {:.4?}", off[0], &off[1..]);
    assert!(off[0] < 0.01, "{off:?}");
    assert!(off[1..].iter().all(|off| *off < 0.03), "{off:?}");
}

#[test]
fn caches_see_of_the_sky_what_f64_rays_see() {
    let gpu = gpu();
    let (mut scene, caches) = divided(&on_a_floor(None), 0.5);
    uneven().put_over(&mut scene, 16);
    let sky = scene.sky.as_ref().expect("a sky");
    let smooth = &lobes(sky)[(SKY_OF_CACHES - SKY_ITSELF - 1) as usize];
    let placed = Placed::new(&scene);
    let mut by_rays = Vec::new();
    // With bounces, the pass reads what the rays of depth images have met.
    for (near, bounces) in [(RAYS, 1), (RAYS, 2), (Near::Off, 1)] {
        let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
        let frame = drawn_of(&gpu, &scene, &world, &Knobs { bounces, ..knobs([48, 27], near) });
        let light = frame.light.caches().expect("caches");
        let (of_caches, _) = light.sky.as_ref().expect("a sky");
        let found: Vec<SkySeen> = gpu.read(&of_caches.seen).expect("read");
        let parts: Vec<u32> = gpu.read(&of_caches.open).expect("read");
        if near != Near::Off {
            by_rays.push((bytemuck::cast_slice::<SkySeen, u32>(&found).to_vec(), parts.clone()));
        }
        let places: Vec<Cache> = gpu.read(&light.atlas.caches).expect("read");
        let reach = if near == Near::Off { 0.0 } else { CACHE_REACH * world.spacing() };
        let least = 1e-4 * sky.illuminance().max_element() / 4.0;
        let (mut share, mut irradiance, mut differ, mut closed) = (0.0, 0.0, 0.0, 0.0);
        for (i, (cache, found)) in places.iter().zip(&found).enumerate() {
            let (position, normal) = ({ cache.position }.as_dvec3() + world.origin, { cache.normal }.as_dvec3());
            let expected = seen(&placed, [sky, smooth], (position, normal), [2e-5, reach, least]);
            share += ({ found.share }.as_dvec3() - expected.share).length();
            irradiance += ({ found.irradiance }.as_dvec3() - expected.irradiance).length() / sky.illuminance().length();
            for (direction, open) in expected.open.iter().enumerate() {
                let part = parts[(i * DIRECTIONS as usize + direction) / 4] >> (8 * (direction % 4)) & 0xff;
                differ += (f64::from(part) / 4.0 - open).abs();
                closed += 1.0 - open;
            }
        }
        let count = places.len() as f64;
        let directions = count * f64::from(DIRECTIONS);
        println!(
            "{near:?}: {count} caches, error of shares {:.5}, of irradiance {:.5}, of open directions {:.5}",
            share / count,
            irradiance / count,
            differ / directions
        );
        assert!(count > 100.0 && closed > 5.0 * count);
        assert!(share / count < 2e-3 && irradiance / count < 1e-3 && differ / directions < 1e-3);
    }
    assert!(by_rays[0] == by_rays[1], "both ways trace the same rays");
    assert_clean(&gpu);
}

/// Caches far apart call many directions partly open. There each pixel's own rays decide, some of which follow the open
/// sky. Endless rays decide alone.
#[test]
fn pixels_see_of_the_sky_what_f64_rays_see() {
    let gpu = gpu();
    let endless = Near::Endless { per_pixel: 8, every: 2 };
    for (near, spacing, least) in [(RAYS, 1.0, 86), (endless, 0.3, 8)] {
        let (mut scene, caches) = divided(&on_a_floor(None), spacing);
        uneven().put_over(&mut scene, 16);
        let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
        let frame = drawn_of(&gpu, &scene, &world, &knobs([96, 54], near));
        let found = frame.picture.near.as_ref().expect("rays");
        let pixels: Vec<NearPixel> = gpu.read(&found.pixels).expect("read");
        let light = frame.light.caches().expect("caches");
        let parts: Vec<u32> = gpu.read(&light.sky.as_ref().expect("a sky").0.open).expect("read");
        let part = |cache: usize, at: usize| parts[(cache * DIRECTIONS as usize + at) / 4] >> (8 * (at % 4)) & 0xff;
        let words = |buffer: Option<&Buffer>| -> Vec<u32> { gpu.read(buffer.expect("directions")).expect("read") };
        let (radiances, guides) = (words(light.gather.radiances()), words(light.gather.guides()));
        let whole = scene.sky.as_ref().expect("a sky");
        let (received, smooth) = (irradiance(whole), &lobes(whole)[(SKY_OF_CACHES - SKY_ITSELF - 1) as usize]);
        let places = shoot(&gpu, &scene, Some(&caches), &knobs([8, 8], RAYS)).caches;
        let placed = Placed::new(&scene);
        let spacing = caches.spacing;
        let around = Around { world: &placed, caches: &places, reach: spacing, lift: 0.0 };
        let live: Vec<u32> = gpu.read(&light.gather.live().expect("a list").list).expect("read");
        let live_count = light.gather.live().expect("a list").lit(&gpu).expect("read") as usize;
        let (mut elsewhere, mut to_sky) = (0, 0);
        for cache in live[..live_count].iter().map(|cache| *cache as usize) {
            let [first, first_guide] = [DIRECTIONS, GUIDE_WORDS].map(|each| cache * each as usize);
            let of_sky = |at| open_share(at, |at| part(cache, at)) * luminance(smooth.radiance(middle_of(at)));
            let of_caches = |at: usize| luminance(unpack_radiance(radiances[first + at]));
            let all: Vec<f64> = (0..DIRECTIONS as usize).map(|at| of_caches(at) + of_sky(at)).collect();
            let counts = guides[first_guide..].iter().map(|word| word & 0xff);
            let wanted = part_counts(&all, places[cache].normal);
            elsewhere += wanted.iter().zip(counts.clone()).map(|(wanted, count)| wanted.abs_diff(count)).sum::<u32>();
            to_sky +=
                counts.take(all.len()).enumerate().filter(|(at, _)| part(cache, *at) > 0).map(|(_, n)| n).sum::<u32>();
        }
        let all_parts = GUIDES * live_count as u32;
        println!("{live_count} caches: {elsewhere} of {all_parts} parts are elsewhere, {to_sky} lead to the sky");
        assert!(elsewhere < all_parts / 20 && to_sky > all_parts / 4, "{elsewhere}, {to_sky} of {all_parts}");
        let far = FarLight { radiances: &radiances, guides: &guides };
        let (mut shown, mut differ, mut by_caches, mut most) = (0, 0, 0, 0.0_f64);
        for (i, pixel) in pixels.iter().enumerate().filter(|(_, pixel)| pixel.geometric > 0.0) {
            let (x, y) = (i as u32 % found.size[0], i as u32 / found.size[0]);
            let (position, normal) = (pixel.position.as_dvec3() + world.origin, pixel.normal.as_dvec3());
            let hit = placed.nearest(position + 1e-3 * normal, -normal, Sides::Both).expect("the pixel's surface");
            let surface = placed.surface(&hit);
            let mut sorted = around.sorted(&surface, &references_at(&scene, &caches, &hit).concat());
            sorted.truncate(3);
            let all: f64 = sorted.iter().map(|cache| around.weight(&surface, *cache)).sum();
            let about: Vec<_> = sorted.iter().map(|c| (*c, around.weight(&surface, *c) / all)).collect();
            let sky = |way: DVec3| {
                let direction = direction_index(way);
                let open = about.iter().map(|(c, share)| share * f64::from(part(*c, direction)) / 4.0).sum();
                (open, smooth.radiance(way) + 1e-4 / PI * luminance(received.radiance(normal)))
            };
            let start = surface.position + 2e-5 * surface.geometric;
            let normals = [surface.geometric, normal];
            let [rays, short] = [if near == endless { f64::INFINITY } else { spacing }, spacing]
                .map(|reach| far.rays(&about, normals, ([8, 4], [x, y]), [reach, 0.0]));
            let wanted = sky_along(&placed, start, (&rays, 8), |way| {
                let (open, radiance) = sky(way);
                (if near == endless { 0.5 } else { open }, radiance)
            });
            let by_opinion = sky_along(&placed, start, (&short, 8), |way| {
                let (open, radiance) = sky(way);
                (if near == endless { open } else { f64::from(u8::from(open > 0.5)) }, radiance)
            });
            let [open, all] = [pixel.open_sky, pixel.all_sky].map(|sum| sum.as_dvec3());
            shown += 1;
            differ += usize::from(
                open.distance(wanted.open) > 1e-3 * wanted.all.length() || { pixel.hidden_sky }
                    .as_dvec2()
                    .distance(wanted.hidden)
                    > 1e-3 * wanted.hidden.length() + 1e-3,
            );
            by_caches += usize::from(by_opinion.open.distance(wanted.open) > 1e-3 * wanted.all.length());
            most = most.max((all / wanted.all - 1.0).abs().max_element());
        }
        println!(
            "{shown} pixels, {differ} differ from f64, {by_caches} from the caches' opinion; all light by {most:.1e}"
        );
        assert!(shown > 800 && differ * 100 < shown && by_caches > least.max(2 * differ) && most < 1e-3);
    }
    assert_clean(&gpu);
}

#[test]
fn a_white_ball_under_an_even_sky_is_as_bright_as_the_sky() {
    let gpu = gpu();
    let mut scene = Scene { name: "ball".into(), ..Scene::default() };
    add(&mut scene, sphere(0.5, 24), phong([1.0; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.0, 0.3, 2.0), DVec3::ZERO, 0.5));
    for spacing in [0.9, 0.2] {
        let (mut scene, caches) = divided(&scene, spacing);
        Sky::even(Vec3::splat(100.0)).put_over(&mut scene, 16);
        for (near, shadows) in
            [(RAYS, Shadows::PerLight), (RAYS, Shadows::Off), (Near::Off, Shadows::Off), (Near::Off, Shadows::Proxy)]
        {
            let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { shadows, ..knobs([48, 27], near) });
            let on_ball = |(pixel, covered): (usize, &bool)| covered.then_some(shot.direct[pixel].y);
            let worst = shot
                .covered
                .iter()
                .enumerate()
                .filter_map(on_ball)
                .fold(0.0, |worst: f64, y| worst.max((y / 100.0 - 1.0).abs()));
            println!("cache spacing {spacing} m, {near:?}, {shadows:?}: largest error {worst:.4}");
            assert!(worst < 0.01, "{spacing} m, {near:?}, {shadows:?}: {worst}");
        }
    }
}

#[test]
fn a_closed_room_under_a_bright_sky_stays_dark() {
    let gpu = gpu();
    let mut scene = Scene { name: "closed".into(), ..Scene::default() };
    let inside = cuboid(vec3(-1.0, 0.0, -1.0), vec3(1.0, 2.0, 1.0), 0.5, |_| true).reversed();
    add(&mut scene, inside, phong([0.8; 3], [0.3; 3], 30.0), DAffine3::IDENTITY);
    let outside = cuboid(vec3(-1.1, -0.1, -1.1), vec3(1.1, 2.1, 1.1), 0.5, |_| true);
    add(&mut scene, outside, phong([0.8; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene.cameras = vec![camera(dvec3(0.8, 1.6, 0.8), dvec3(-0.5, 0.4, -0.5), 1.2)];
    let (mut scene, caches) = divided(&scene, 0.3);
    Sky::even(Vec3::splat(10_000.0)).put_over(&mut scene, 16);
    for (near, shadows) in [(RAYS, Shadows::PerLight), (Near::Off, Shadows::Off)] {
        let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { shadows, ..knobs([48, 27], near) });
        assert!(shot.covered.iter().all(|covered| *covered));
        let brightest = shot.direct.iter().fold(0.0, |most: f64, light| most.max(light.max_element()));
        println!("{near:?}: {brightest} cd/m^2 at most");
        assert!(brightest < 1e-4 * 0.8 * 10_000.0, "{brightest}");
    }
}

/// Path-traced direct light, and the pixels that show a surface.
fn paths(scene: &Scene, size: [u32; 2], passes: usize) -> (Vec<[f32; 3]>, Vec<bool>) {
    let settings = PathTraceSettings::engine(size, 0);
    let mut paths = PathTrace::new(scene, &scene.cameras[0], &settings);
    (0..passes).for_each(|_| paths.pass());
    (paths.direct(), paths.covered())
}

#[test]
fn surfaces_have_the_skys_light_of_paths() {
    let gpu = gpu();
    // The error hardly depends on the spacing: where caches are unsure, pixels look for themselves.
    for (lobe, spacing, limits) in [
        (None, 0.15, [0.005, 0.03]),
        (None, 0.9, [0.005, 0.03]),
        (Some((0.9, 40.0)), 0.3, [0.01, 0.05]),
        (Some((0.9, 1000.0)), 0.4, [0.02, 0.1]),
    ] {
        let (mut scene, caches) = divided(&on_a_floor(lobe), spacing);
        uneven().put_over(&mut scene, 16);
        let size = [112, 63];
        let (truth, covered) = paths(&scene, size, 12);
        let near = Near::Rays { per_pixel: 8, every: 0 };
        let shot = shoot(&gpu, &scene, Some(&caches), &knobs(size, near));
        let of_surfaces = |all: &dyn Fn(usize) -> [f32; 3]| -> Vec<[f32; 3]> {
            (0..covered.len()).filter(|pixel| covered[*pixel]).map(all).collect()
        };
        let shown = of_surfaces(&|pixel| shot.direct[pixel].as_vec3().to_array());
        let truth = of_surfaces(&|pixel| truth[pixel]);
        let m = metrics(&shown, &truth);
        let mean = truth.iter().map(|p| f64::from(p.iter().sum::<f32>()) / 3.0).sum::<f64>() / truth.len() as f64;
        println!("{lobe:?}, {spacing} m: bias {:+.4}, RMSE over mean {:.4}", m.bias, m.rmse / mean);
        assert!(m.bias.abs() < limits[0] && m.rmse < limits[1] * mean, "{lobe:?}, {spacing} m: {m:?}");
    }
}

/// Caches receive the sky's light without virtual lights, and send it on once per bounce.
#[test]
fn caches_send_the_skys_light_on() {
    let gpu = gpu();
    let (mut scene, caches) = divided(&on_a_floor(None), 0.3);
    uneven().put_over(&mut scene, 4);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let sent = |bounces: u32| {
        let frame = drawn_of(&gpu, &scene, &world, &Knobs { bounces, ..knobs([48, 27], RAYS) });
        let light = frame.light.caches().expect("caches");
        assert_eq!(frame.light.counts(&gpu).expect("counts").vals, 0, "the sky needs no virtual lights");
        let (by, sent_on) = traced(&frame);
        let vals: Vec<Val> = gpu.read(&by.bounces.as_ref().expect("bounces").vals).expect("read");
        let [met, far] = [&sent_on.met, &sent_on.far_met].map(|met| gpu.read::<u32>(met).expect("read"));
        let sums: Vec<GatherSums> = gpu.read(&by.parts).expect("read");
        let radiances: Vec<u32> = gpu.read(light.gather.radiances().expect("directions")).expect("read");
        let places: Vec<Cache> = gpu.read(&light.atlas.caches).expect("read");
        let seen: Vec<SkySeen> = gpu.read(&light.sky.as_ref().expect("a sky").0.seen).expect("read");
        let count = world.cache_count as usize;
        let radiosities = vals[..count].iter().map(|val| { val.flux }.as_dvec3() / f64::from(val.area));
        (radiosities.collect::<Vec<_>>(), [met, far], seen, (sums, radiances, places))
    };
    let albedos: Vec<Vec3> = {
        sent(1);
        gpu.read(world.cache_albedos().expect("albedos")).expect("read")
    };
    let side = DEPTH_IMAGE_SIDE as usize;
    let middle = |i: usize| (i as f64 + 0.5) * 2.0 / side as f64 - 1.0;
    let inside: Vec<usize> =
        (0..side * side).filter(|texel| middle(texel % side).powi(2) + middle(texel / side).powi(2) < 1.0).collect();
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    let ways = (0..20_000).map(|i| {
        let (z, (sin, cos)) = (1.0 - (2.0 * f64::from(i) + 1.0) / 20_000.0, (f64::from(i) * golden).sin_cos());
        (1.0 - z * z).sqrt() * dvec3(cos, sin, 0.0) + z * DVec3::Z
    });
    let ways: Vec<DVec3> = ways.collect();
    let mut before: Option<Vec<DVec3>> = None;
    for bounces in 1..=3 {
        let (radiosities, [met, far], seen, (sums, radiances, places)) = sent(bounces);
        let (mut worst, mut most) = (0.0_f64, 0.0_f64);
        for (i, found) in radiosities.iter().enumerate() {
            let of_cache: Vec<Met> = inside.iter().map(|texel| Met::of(met[i * side * side + texel])).collect();
            let again = before.as_ref().map_or(DVec3::ZERO, |before| exchange(&of_cache, before));
            let wanted = albedos[i].as_dvec3() * ({ seen[i].irradiance }.as_dvec3() + again);
            worst = worst.max(found.distance(wanted) / wanted.length().max(1e-9));
            most = most.max(again.length() / { seen[i].irradiance }.as_dvec3().length().max(1e-9));
        }
        println!("{bounces} bounces: largest error {worst:.1e}; up to {most:.2} of the sky's light again");
        assert!(worst < 1e-5 && (most > 0.1) == (bounces > 1), "{bounces}: {worst}, {most}");
        // Pixels receive the same from beyond the range of short rays: as a proxy and by direction.
        let (mut off, mut all, mut aside, mut differ) = (0.0, 0.0, 0.0, 0);
        for i in 0..places.len() {
            let of_cache = |texel: usize| Met::of(far[i * side * side + texel]);
            let texels: Vec<Met> = inside.iter().map(|texel| of_cache(*texel)).collect();
            differ +=
                inside.iter().filter(|texel| met[i * side * side + **texel] != far[i * side * side + **texel]).count();
            let arrives = exchange(&texels, &radiosities);
            let from: Vec<usize> =
                texels.iter().filter_map(|met| if let Met::Cache(c) = met { Some(*c) } else { None }).collect();
            let weights = from.iter().map(|cache| luminance(radiosities[*cache]) as f32);
            let place: Vec3 =
                from.iter().zip(weights.clone()).map(|(c, w)| w * (places[*c].position - places[i].position)).sum();
            let weight = weights.sum::<f32>().max(1e-9);
            let sum = sums[i];
            off += { sum.diffuse_irradiance }.as_dvec3().distance(arrives);
            all += arrives.length();
            aside = f32::max(aside, ({ sum.diffuse_position } / sum.diffuse_weight.max(1e-9)).distance(place / weight));
        }
        println!(
            "far light of caches: relative error {:.1e}, centres {aside:.1e} m apart; {differ} other hits",
            off / all
        );
        assert!(off < 1e-5 * all && aside < 1e-3 && differ > 1000);
        let (mut off, mut whole, mut all) = (0.0, 0.0, 0.0);
        for (i, cache) in places.iter().enumerate() {
            let normal = { cache.normal }.as_dvec3();
            let [tangent, bitangent] = tangents(normal);
            let mut sums = vec![(DVec3::ZERO, 0.0); DIRECTIONS as usize];
            for way in &ways {
                let [x, y, z] = [tangent, bitangent, normal].map(|axis| axis.dot(*way));
                let texel = |a: f64| ((a + 1.0) / 2.0 * side as f64) as usize;
                let cell = &mut sums[direction_index(*way)];
                // Near the horizon there is no texel for some directions.
                let met =
                    if z < 0.3 { Met::Unknown } else { Met::of(far[i * side * side + texel(y) * side + texel(x)]) };
                match met {
                    Met::Cache(cache) => *cell = (cell.0 + radiosities[cache] / PI, cell.1 + 1.0),
                    Met::Nothing => cell.1 += 1.0,
                    Met::Unknown if z < 0.3 => cell.1 = f64::NAN,
                    Met::Unknown => {}
                }
            }
            for (direction, (sum, count)) in sums.into_iter().enumerate().filter(|(_, (_, count))| *count > 0.0) {
                let found = unpack_radiance(radiances[i * DIRECTIONS as usize + direction]);
                off += found.distance(sum / count);
                whole += found.length();
                all += (sum / count).length();
            }
        }
        let gained = whole / all - 1.0;
        println!("by direction: mean error {:.3} of the mean, bias {gained:+.4}", off / all);
        assert!(off < 0.1 * all && gained.abs() < 0.025, "{off} of {all}, {gained}");
        before = Some(radiosities);
    }
}

#[test]
fn every_number_of_bounces_is_the_path_tracers() {
    let (mut scene, caches) = divided(&on_a_floor(None), 0.15);
    uneven().put_over(&mut scene, 16);
    for bounces in [1, 4] {
        let size = [80, 45];
        let settings = PathTraceSettings::engine(size, bounces);
        let mut paths = PathTrace::new(&scene, &scene.cameras[0], &settings);
        (0..24).for_each(|_| paths.pass());
        let shot = shoot(&gpu(), &scene, Some(&caches), &Knobs { bounces, ..knobs(size, RAYS) });
        let shown: Vec<[f32; 3]> = shot.diffuse.iter().map(|p| p.as_vec3().to_array()).collect();
        let m = metrics(&shown, &paths.diffuse());
        println!("{bounces} bounces: bias {:+.4}, relMSE without the worst 1 % {:.4}", m.bias, m.relmse_trimmed);
        assert!(m.bias.abs() < 0.015 && m.relmse_trimmed < 0.02, "{bounces}: {m:?}");
    }
}

/// A wall hides half of the sky from the floor at its foot, and gets less light back from there. Caches are too far apart
/// to know: hits must ask the sky themselves.
#[test]
fn the_floor_is_dark_at_the_foot_of_a_wall() {
    const ALBEDO: f64 = 0.6;
    let mut scene = Scene { name: "foot".into(), ..Scene::default() };
    let grey = phong([ALBEDO as f32; 3], [0.0; 3], 1.0);
    const DEEP: f64 = 15.0;
    let floor = quad(vec3(-25.0, 0.0, 0.0), Vec3::Z * DEEP as f32, Vec3::X * 50.0, 0.5);
    let wall = quad(vec3(-25.0, 0.0, 0.0), Vec3::X * 50.0, Vec3::Y, 0.5);
    add(&mut scene, floor, grey.clone(), DAffine3::IDENTITY);
    add(&mut scene, wall, grey, DAffine3::IDENTITY);
    let projection = Projection::Orthographic { ymag: 0.5 };
    scene.cameras.push(Camera { projection, ..camera(dvec3(0.0, 0.5, 4.0), dvec3(0.0, 0.5, 0.0), 1.0) });
    let (mut scene, caches) = divided(&scene, 1.5);
    Sky::new(8, 4, std::iter::repeat_n(Vec3::ONE, 32), 0.0).put_over(&mut scene, 4);
    let size = [16_u32, 32];
    let near = Near::Rays { per_pixel: 16, every: 1 };
    let shot = shoot(&gpu(), &scene, Some(&caches), &Knobs { bounces: 1, ..knobs(size, near) });
    for (row, pixels) in shot.diffuse.chunks(size[0] as usize).enumerate() {
        let height = 1.0 - (row as f64 + 0.5) / f64::from(size[1]);
        let shown = pixels.iter().map(|light| light.y).sum::<f64>() / pixels.len() as f64;
        // The wall looks down at the floor at this angle; the floor sees the sky beside a wall of height 1.
        let reflected = |angle: f64| {
            let away = height / angle.tan();
            ALBEDO * 0.5 * (1.0 + away / (1.0 + away * away).sqrt()) * 0.5 * angle.cos()
        };
        let (least, steps) = ((height / DEEP).atan(), 1000);
        let step = (PI / 2.0 - least) / f64::from(steps);
        let wanted = ALBEDO * (0..steps).map(|i| reflected(least + (f64::from(i) + 0.5) * step)).sum::<f64>() * step;
        println!("{height:.2} m: {:.3} of the integral", shown / wanted);
        assert!((shown / wanted - 1.0).abs() < 0.1, "{height} m: {shown} instead of {wanted}");
    }
}

#[test]
fn the_sky_needs_no_bounce() {
    let gpu = gpu();
    let (mut scene, caches) = divided(&on_a_floor(None), 0.4);
    uneven().put_over(&mut scene, 16);
    let [none, one] =
        [0, 1].map(|bounces| shoot(&gpu, &scene, Some(&caches), &Knobs { bounces, ..knobs([48, 27], Near::Off) }));
    assert!(none.direct == one.direct, "direct light must be the same");
    assert!(none.diffuse.iter().all(|light| *light == DVec3::ZERO) && one.diffuse.iter().any(|light| light.y > 0.0));
}

#[test]
fn nothing_of_another_sky_is_left() {
    let gpu = gpu();
    let (bare, caches) = divided(&on_a_floor(Some((0.6, 20.0))), 0.4);
    let under = |sky: Sky| {
        let mut scene = bare.clone();
        sky.put_over(&mut scene, 8);
        scene
    };
    let turned = |turn: f64| Sky { turn, ..uneven() };
    let settings = Knobs { reuse: true, ..knobs([48, 27], RAYS) }.settings();
    let engine = |scene: Scene| {
        let loaded = Loaded { scene, caches: Some(caches.clone()) };
        let engine = Engine::new(&gpu, loaded, &settings).expect("made");
        let picture = engine.picture(&gpu, [48, 27]).expect("made");
        (engine, picture)
    };
    let picture = |(engine, picture): &mut (Engine, Picture)| {
        engine.fit(&gpu, &mut [(picture, [48, 27])]).expect("fits");
        let view = engine.view(&engine.scene().cameras[0].clone(), [48, 27]);
        let drawn = gpu.frame(|cmd| {
            engine.record(cmd, &mut [(view, picture)], &Look::default());
            Ok(())
        });
        assert_eq!(drawn.expect("drawn").problems, [""; 0]);
        gpu.read_image::<u32>(&picture.surface.radiance).expect("read")
    };
    let mut edited = engine(under(uneven()));
    let before = picture(&mut edited);
    edited.0.edit(&gpu, |scene| *scene = under(turned(1.5))).expect("edited");
    let after = picture(&mut edited);
    assert!(before != after, "the picture must change with the sky");
    assert!(after == picture(&mut engine(under(turned(1.5)))), "the picture must be that of a new engine");
    assert_clean(&gpu);
}

/// Caches send the sky's light on, but it enters bodies from the lights that represent it.
#[test]
fn the_sky_enters_bodies() {
    let gpu = gpu();
    let (sigma_s, sigma_a) = (Vec3::splat(2000.0), Vec3::splat(2.0));
    let medium = Subsurface { sigma_s, sigma_a, g: 0.0, ior: 1.3, scale: 1.0 };
    let mut filled = Material { roughness: 0.5, specular: 0.0, ..Material::default() };
    filled.fill(medium);
    let albedo = medium.medium().diffuse_albedo().as_vec3();
    let ball_of = |material: Material| {
        let mut scene = Scene { name: "ball".into(), ..Scene::default() };
        add(&mut scene, sphere(0.5, 32), material, DAffine3::from_translation(dvec3(0.0, 0.5, 0.0)));
        let floor = quad(vec3(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, 0.4);
        add(&mut scene, floor, phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
        scene.cameras.push(camera(dvec3(0.0, 0.8, 2.0), dvec3(0.0, 0.5, 0.0), 0.35));
        Sky::even(Vec3::splat(100.0)).put_over(&mut scene, 16);
        scene
    };
    let knobs = Knobs { size: [48, 27], bounces: 2, near: Near::Rays { per_pixel: 8, every: 2 }, ..small() };
    let knobs = Knobs { shadows: Shadows::PerLight, rsm: 96, ..knobs };
    let [inside, outside] = [filled, phong(albedo.to_array(), [0.0; 3], 1.0)].map(|material| {
        let scene = ball_of(material);
        let caches = baked(&scene, 0.2, 8);
        let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
        let frame = drawn_of(&gpu, &scene, &world, &knobs);
        assert_eq!(frame.light.counts(&gpu).expect("counts").vals, 0, "no virtual lights outside");
        let entered = frame.light.rsm.as_ref().and_then(|rsm| rsm.inside.as_ref()).map(|inside| {
            let count: Vec<u32> = gpu.read(&inside.vals.live_count).expect("read");
            count[0]
        });
        assert!(entered.is_none_or(|count| count > 100), "{entered:?} virtual lights inside");
        let shot = shoot(&gpu, &scene, Some(&caches), &knobs);
        let middle = |all: &[DVec3]| all[13 * 48 + 24];
        middle(&shot.direct) + middle(&shot.diffuse)
    });
    println!("the ball scatters {inside} and reflects {outside}");
    assert!((inside / outside - 1.0).abs().max_element() < 0.15, "{inside}, {outside}");
}
