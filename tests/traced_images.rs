//! Depth images that rays trace: texels against the f64 twin, and the caches' light against rays to every VAL.

use glam::{DVec3, Vec3};
use lightskin::frame::near::CACHE_REACH;
use lightskin::frame::{Near, Shadows, World};
use lightskin::lab::knobs::Knobs;
use lightskin::lab::scenes::Shadowed;
use lightskin::reference::depth_image::{TracedImage, most_lit};
use lightskin::reference::gather::{Cache, val_geometry};
use lightskin::reference::rsm::Val;
use lightskin::reference::world::World as Placed;
use lightskin::shared::{self, DEPTH_IMAGE_SIDE, DEPTH_IMAGE_TEXELS};
use rayon::prelude::*;

use crate::common::frames::{baked, drawn_of, planes, shoot, small};
use crate::common::{assert_clean, gpu};

fn traced() -> Knobs {
    Knobs { near: Near::Rays { per_pixel: 8, every: 2 }, shadows: Shadows::PerLight, rsm: 96, ..small() }
}

#[test]
fn traced_images_are_the_references() {
    let gpu = gpu();
    let scene = Shadowed::Columns.scene();
    let caches = baked(&scene, 0.5, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let frame = drawn_of(&gpu, &scene, &world, &traced());
    let light = frame.light.caches().expect("caches");
    let images = planes(&gpu, light.gather.depth_images().expect("images"));
    let live = light.gather.live().expect("a list");
    let list: Vec<u32> = gpu.read(&live.list).expect("read");
    let count = live.lit(&gpu).expect("read") as usize;
    let places: Vec<shared::Cache> = gpu.read(&light.atlas.caches).expect("read");
    let placed = Placed::new(&scene);
    let start = CACHE_REACH * world.spacing();
    let image = |(slot, cache): (usize, &u32)| {
        let place = &places[*cache as usize];
        let position = place.position.as_dvec3() + world.origin;
        let cache = Cache { position, normal: place.normal.as_dvec3(), exponent: 1.0 };
        let twin = TracedImage::new(&placed, &cache, DEPTH_IMAGE_SIDE as usize, start);
        let texels = DEPTH_IMAGE_TEXELS as usize;
        let found = &images[slot * texels..][..texels];
        let differs = |(a, b): &(&DVec3, &DVec3)| a.distance(**b) > 2e-3 * b.length().max(0.1);
        let filled = twin.planes.iter().filter(|plane| **plane != DVec3::ZERO).count();
        [filled, found.iter().zip(&twin.planes).filter(differs).count()]
    };
    let counts: Vec<[usize; 2]> = list[..count].par_iter().enumerate().map(image).collect();
    let [filled, differ] = [0, 1].map(|i| counts.iter().map(|counts| counts[i]).sum::<usize>());
    println!(
        "{count} caches, {filled} of {} texels have a plane, {differ} differ",
        count * DEPTH_IMAGE_TEXELS as usize
    );
    assert!(count > 100 && filled > 250 * count, "{count} caches, {filled} texels");
    // Rays along edges may hit either side.
    assert!(differ * 500 < filled, "{differ} of {filled} texels differ");
    assert_clean(&gpu);
}

/// Light of VALs at a cache, from those beyond the range of short rays. `sees` tells which of them it sees.
fn irradiance(cache: &Cache, vals: &[Val], near: f64, sees: impl Fn(&Val) -> bool) -> f64 {
    let [begin, end] = [0.8, 1.2].map(|share| (share * near).powi(2));
    let light = |val: &Val| {
        let share = (cache.position.distance_squared(val.position) - begin) / (end - begin);
        let share = share.clamp(0.0, 1.0) * val_geometry(cache.position, cache.normal, val).0;
        if share > 0.0 && sees(val) { share * val.flux.y } else { 0.0 }
    };
    vals.iter().map(light).sum()
}

/// The caches' light is that of their planes by the twin, and near that of a ray to every VAL.
#[test]
fn caches_see_what_rays_see() {
    let gpu = gpu();
    for (which, spacing, limit) in
        [(Shadowed::Cornell, 0.25, 0.01), (Shadowed::Gap, 0.4, 0.008), (Shadowed::Columns, 0.5, 0.023)]
    {
        let mut scene = which.scene();
        // Without lobes a virtual light's flux says all.
        for phong in scene.materials.iter_mut().filter_map(|material| material.phong.as_mut()) {
            phong.specular = Vec3::ZERO;
        }
        let caches = baked(&scene, spacing, 8);
        let spacing = World::new(&gpu, &scene, Some(&caches)).expect("uploaded").spacing();
        let near = CACHE_REACH * spacing;
        let shot = shoot(&gpu, &scene, Some(&caches), &traced());
        let vals: Vec<Val> = shot.vals.iter().copied().filter(|val| *val != Val::NOTHING).collect();
        let placed = Placed::new(&scene);
        // Irradiance as the device finds it, by the twin, by rays, and without any shadows.
        let each = |(cache, found): (&Cache, &DVec3)| {
            let image = TracedImage::new(&placed, cache, DEPTH_IMAGE_SIDE as usize, near);
            // Four VALs in a row share a test.
            let seen = |vals: &[Val]| most_lit(cache, vals).is_some_and(|val| image.sees(val.position));
            let twin =
                vals.chunks(4).filter(|vals| seen(vals)).map(|vals| irradiance(cache, vals, near, |_| true)).sum();
            let start = cache.position + 1e-4 * spacing * cache.normal;
            let open = |val: &Val| {
                let end = val.position + 2e-4 * spacing * val.normal;
                let (way, distance) = ((end - start).normalize(), end.distance(start));
                !placed.blocked_within(start + near * way, way, distance - near - 1e-4 * spacing)
            };
            [found.y, twin, irradiance(cache, &vals, near, open), irradiance(cache, &vals, near, |_| true)]
        };
        // Caches that nothing can light have no normal.
        let lit = shot.caches.par_iter().zip(&shot.sums[0]).filter(|(cache, _)| cache.normal.is_finite());
        let all: Vec<[f64; 4]> = lit.map(each).collect();
        let light: f64 = all.iter().map(|e| e[2]).sum();
        let off = |a: usize, b: usize| all.iter().map(|e| (e[a] - e[b]).abs()).sum::<f64>() / light;
        let bias = all.iter().map(|e| e[0] - e[2]).sum::<f64>() / light;
        let [twin, error, hidden] = [off(0, 1), off(0, 2), off(3, 2)];
        println!("{}: off the twin {twin:.5}; off rays {error:.4}, bias {bias:+.4}; {hidden:.3} is hidden", scene.name);
        assert!(twin < 2e-3 && error < limit, "{}: {twin}, {error}", scene.name);
    }
    assert_clean(&gpu);
}
