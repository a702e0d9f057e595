//! Stage 7: occlusion of proxy lights by discs, against the f64 twin and against invariants.

use glam::{DVec3, Vec3, dvec3, vec3};
use lightskin::bake::{self, CacheSet, Density};
use lightskin::frame::atlas::Atlas;
use lightskin::frame::live::{Items, Live};
use lightskin::frame::occlude::Occlude;
use lightskin::frame::proxies::Proxies;
use lightskin::frame::{ClusterRule, Shadows, View, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Knobs, Path};
use lightskin::lab::scenes::{Shadowed, valley};
use lightskin::lab::shadows;
use lightskin::reference::brute_force;
use lightskin::reference::gather::{self, Cache, Lobe, luminance};
use lightskin::reference::occlude::{Disc, occlude};
use lightskin::reference::phong::{Material, mirrored_view};
use lightskin::scene::build::{CornellSurface, cornell};
use lightskin::scene::{LightKind, Scene};
use lightskin::shared::{self, Proxy};

use crate::analytic::numbers;
use crate::common::frames::{SPOT, baked, corner, drawn, indirect, placed, shoot, small};
use crate::common::{assert_clean, gpu, rounding};

/// Dims proxies by discs on the device. Each lobe has irradiance 1 before. Returns the remaining irradiance of both
/// lobes. `list`: a list names the live caches (here all). `skip`: groups of discs that cannot matter are skipped.
fn left(gpu: &Gpu, caches: &[shared::Cache], proxies: &[Proxy], list: bool, skip: bool) -> Vec<[f32; 2]> {
    timed(gpu, caches, proxies, list, skip).0
}

/// Like `left`, and the time that it took [ms].
fn timed(gpu: &Gpu, caches: &[shared::Cache], proxies: &[Proxy], list: bool, skip: bool) -> (Vec<[f32; 2]>, f64) {
    let count = caches.len() as u32;
    let atlas = Atlas::of(gpu, caches).expect("caches");
    let mut on_device = Proxies::new(gpu, count, true, 1).expect("proxies");
    on_device.buffer = gpu.buffer_from("gather.proxies", proxies).expect("proxies");
    let items = Items { caches: count, group: 1, per_workgroup: count, lights: 1, split: 64 };
    let live = list.then(|| Live::new(gpu, items).expect("a list"));
    let new = if skip { Occlude::new } else { Occlude::without_skipping };
    let stage = new(gpu, count, true, u32::from(list)).expect("stage 7");
    let drawn = gpu.timed_frame(|cmd| {
        let _zone = cmd.zone("occlude");
        stage.record(cmd, &atlas, live.as_ref(), &on_device, 1);
        Ok(())
    });
    let ms = gpu.times(&drawn.expect("drawn")).expect("times").gpu_ms().unwrap_or_default();
    let dimmed: Vec<Proxy> = gpu.read(&on_device.buffer).expect("proxies");
    for (before, after) in proxies.iter().zip(&dimmed) {
        let kept = |p: &Proxy| (p.diffuse_position, p.diffuse_distance2, p.glossy_position, p.glossy_distance2);
        assert_eq!(kept(before), kept(after), "only irradiances may change");
    }
    (dimmed.iter().map(|p| [p.diffuse_irradiance.x, p.glossy_irradiance.x]).collect(), ms)
}

/// A proxy with irradiance 1 in both lobes, from offsets [m] and variances [m^2].
fn proxy(cache: &shared::Cache, offsets: [Vec3; 2], variances: [f32; 2]) -> Proxy {
    let place = |offset: Vec3| cache.position + offset;
    let distance2 = |lobe: usize| {
        let offset = place(offsets[lobe]) - cache.position;
        offset.length_squared() + variances[lobe]
    };
    Proxy {
        diffuse_position: place(offsets[0]),
        diffuse_distance2: distance2(0),
        diffuse_irradiance: Vec3::ONE,
        glossy_position: place(offsets[1]),
        glossy_distance2: distance2(1),
        glossy_irradiance: Vec3::ONE,
    }
}

/// Caches with random normals in a cube of side `side` [m] around `place`, and proxies above them.
fn random(seed: u64, count: usize, side: f32, place: Vec3) -> (Vec<shared::Cache>, Vec<Proxy>) {
    let mut next = numbers(seed);
    let mut number = || next() as f32;
    let mut direction = move || loop {
        let v = vec3(number(), number(), number()) * 2.0 - 1.0;
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    };
    let mut next = numbers(seed + 1);
    let mut number = move || next() as f32;
    let caches: Vec<_> = (0..count)
        .map(|_| shared::Cache {
            position: place + side * (vec3(number(), number(), number()) - 0.5),
            exponent: 1.0,
            normal: direction(),
            area: side * side * 0.02 * number(),
            ..Default::default()
        })
        .collect();
    let proxies = caches
        .iter()
        .map(|cache| {
            let offsets = [(); 2].map(|()| {
                let d = direction();
                let normal = cache.normal;
                side * (0.1 + number()) * (d * normal.dot(d).signum())
            });
            proxy(cache, offsets, [0.1, 0.01].map(|share| side * side * share * number()))
        })
        .collect();
    (caches, proxies)
}

/// Remaining irradiance by the twin.
fn twin(caches: &[shared::Cache], proxies: &[Proxy]) -> Vec<[f64; 2]> {
    let discs: Vec<Disc> = caches
        .iter()
        .map(|c| Disc { position: c.position.as_dvec3(), normal: c.normal.as_dvec3(), area: c.area.into() })
        .collect();
    let at = |(cache, p): (&shared::Cache, &Proxy)| {
        let cache = Cache { position: cache.position.as_dvec3(), normal: cache.normal.as_dvec3(), exponent: 1.0 };
        let lobes = [(p.diffuse_position, p.diffuse_distance2), (p.glossy_position, p.glossy_distance2)];
        lobes.map(|(position, distance2)| {
            let lobe = Lobe {
                position: position.as_dvec3(),
                facing_irradiance: DVec3::ONE,
                lit: distance2 > 0.0,
                distance2: distance2.into(),
            };
            occlude(&cache, &lobe, &discs).facing_irradiance.x
        })
    };
    caches.iter().zip(proxies).map(at).collect()
}

/// Whether two pipelines find the same. llvmpipe gives the same bits; other compilers may fuse other operations in each.
fn alike(gpu: &Gpu, a: &[[f32; 2]], b: &[[f32; 2]]) -> bool {
    let bound = if rounding(gpu) > 1.0 { 1e-4 } else { 0.0 };
    a.len() == b.len() && a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() <= bound)
}

/// Asserts that device and twin agree, that both paths agree, and that skipping changes no bit.
#[track_caller]
fn assert_twin(gpu: &Gpu, caches: &[shared::Cache], proxies: &[Proxy], bound: f64, what: &str) -> Vec<[f32; 2]> {
    let found = left(gpu, caches, proxies, true, true);
    assert!(alike(gpu, &found, &left(gpu, caches, proxies, true, false)), "{what}: skipping changes the result");
    assert!(alike(gpu, &found, &left(gpu, caches, proxies, false, true)), "{what}: the result differs without a list");
    let mut worst = 0.0_f64;
    for (i, (found, twin)) in found.iter().zip(twin(caches, proxies)).enumerate() {
        for (found, twin) in found.iter().zip(twin) {
            assert!((0.0..=1.0).contains(found), "{what}, cache {i}: {found}");
            worst = worst.max((f64::from(*found) - twin).abs());
            assert!(worst <= bound, "{what}, cache {i}: {found} instead of {twin}");
        }
    }
    let blocked = found.iter().flatten().filter(|share| **share < 0.99).count();
    eprintln!("{what}: {blocked} of {} lobes dimmed, largest error {worst:.1e}", 2 * found.len());
    found
}

#[test]
fn discs_leave_what_the_twin_says() {
    let gpu = gpu();
    for (i, count) in [1, 7, 32, 33, 500].into_iter().enumerate() {
        let (caches, proxies) = random(10 * i as u64 + 1, count, 1.0, Vec3::ZERO);
        let found = assert_twin(&gpu, &caches, &proxies, 2e-4, &format!("{count} caches"));
        let dimmed = found.iter().flatten().filter(|share| **share < 0.9).count();
        assert!(count < 100 || dimmed > count / 10, "{dimmed} of {count} are dimmed");
    }
    assert_clean(&gpu);
}

#[test]
fn size_and_place_of_the_world_do_not_matter() {
    let gpu = gpu();
    for (side, place, bound) in [
        (1e-4, Vec3::ZERO, 2e-4),
        (1e5, Vec3::ZERO, 2e-4),
        // So far from the origin, both twin and device round positions to a thousandth of the cube.
        (1.0, vec3(8e3, -3e3, 5e3), 2e-3),
    ] {
        let (caches, proxies) = random(77, 300, side, place);
        assert_twin(&gpu, &caches, &proxies, bound, &format!("{side} m about {place}"));
    }
    assert_clean(&gpu);
}

#[test]
fn what_is_degenerate_leaves_finite_light() {
    let gpu = gpu();
    let (mut caches, mut proxies) = random(5, 200, 1.0, Vec3::ZERO);
    // Lights without extent, coincident discs, a disc at the receiver, a light at the receiver, unlit lobes, discs
    // without area.
    for i in 0..200 {
        match i % 8 {
            0 => proxies[i] = proxy(&caches[i], [caches[i].normal * 0.5, caches[i].normal * 0.2], [0.0; 2]),
            1 => caches[i] = caches[i - 1],
            2 => caches[i] = shared::Cache { normal: -caches[i - 1].normal, ..caches[i - 1] },
            3 => caches[i].area = 0.0,
            4 => proxies[i].diffuse_distance2 = 0.0,
            5 => proxies[i].diffuse_position = caches[i].position,
            6 => proxies[i] = proxy(&caches[i], [-caches[i].normal, caches[i].normal * 1e-6], [1e3, 1e3]),
            _ => {}
        }
    }
    for skip in [true, false] {
        let found = left(&gpu, &caches, &proxies, true, skip);
        assert!(found.iter().flatten().all(|share| (0.0..=1.0).contains(share)), "{found:?}");
        let unlit = (0..200).filter(|i| i % 8 == 4).all(|i| found[i][0] == 1.0);
        assert!(unlit, "an unlit lobe must not change");
    }
    assert_clean(&gpu);
}

/// A cache at the origin that faces up, its light two metres above, and a disc.
fn one_disc(position: Vec3, normal: Vec3, area: f32) -> (Vec<shared::Cache>, Vec<Proxy>) {
    let receiver =
        shared::Cache { position: Vec3::ZERO, exponent: 1.0, normal: Vec3::Y, area: 1e-3, ..Default::default() };
    let disc = shared::Cache { position, exponent: 1.0, normal, area, ..Default::default() };
    let light = proxy(&receiver, [Vec3::Y * 2.0; 2], [0.02; 2]);
    let dark = Proxy { diffuse_distance2: 0.0, glossy_distance2: 0.0, ..light };
    (vec![receiver, disc], vec![light, dark])
}

#[test]
fn a_disc_blocks_where_it_stands_between_cache_and_light_alone() {
    let gpu = gpu();
    let share = |position, normal, area| {
        let (caches, proxies) = one_disc(position, normal, area);
        assert_twin(&gpu, &caches, &proxies, 1e-5, &format!("{area} m^2 at {position}"))[0]
    };
    let down = Vec3::NEG_Y;
    let rest = if rounding(&gpu) > 1.0 { 1e-6 } else { 0.0 };
    let is_blocked = |share: [f32; 2]| share.iter().all(|part| *part <= rest);
    assert!(is_blocked(share(Vec3::Y, down, 1.0)), "a large disc in front of the light blocks it");
    assert!(is_blocked(share(Vec3::Y, Vec3::Y, 1.0)), "from either side");
    assert_eq!(share(Vec3::Y, Vec3::X, 1.0), [1.0; 2], "but not edge-on");
    assert_eq!(share(Vec3::Y * 2.5, down, 1.0), [1.0; 2], "behind the light");
    assert_eq!(share(Vec3::NEG_Y, Vec3::Y, 1.0), [1.0; 2], "behind the cache");
    assert_eq!(share(Vec3::Y + Vec3::X, down, 0.1), [1.0; 2], "beside the line to the light");
    let inside = share(Vec3::Y * 1.9, down, 1.0)[0];
    assert!(inside > 0.0 && inside < 1.0, "inside the light's sphere a disc blocks a part: {inside}");
    let mut before = 1.0;
    for i in 0..40 {
        let now = share(vec3(0.03, 1.0, -0.02), down, 0.001 * 1.2_f32.powi(i))[0];
        assert!(now <= before + rest, "a larger disc must not leave more light: {now} after {before}");
        before = now;
    }
    assert!(before <= rest);
    assert_clean(&gpu);
}

/// Indirect layers of a frame as raw bits, and the names of its stages.
fn layers(gpu: &Gpu, scene: &Scene, caches: &CacheSet, settings: &Knobs) -> (Vec<Vec<[u32; 4]>>, Vec<String>) {
    let buffers = World::new(gpu, scene, Some(caches)).expect("uploaded");
    let mut frame = Frame::new(gpu, scene, &buffers, settings).expect("made");
    let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &buffers, &view);
        Ok(())
    });
    let drawn = drawn.expect("drawn");
    let zones = gpu.times(&drawn).expect("times").zones.iter().map(|zone| zone.name.to_string()).collect();
    assert_eq!(drawn.problems, [""; 0]);
    (indirect(gpu, &frame), zones)
}

#[test]
fn shadows_that_are_off_cost_nothing_and_discs_without_area_change_no_bit() {
    let gpu = gpu();
    let scene = corner(&[SPOT, LightKind::Point], 40.0);
    let caches = baked(&scene, 0.2, 8);
    let mut thin = caches.clone();
    thin.models.iter_mut().flat_map(|model| &mut model.caches).for_each(|cache| cache.area = 0.0);
    for path in [Path::Compute, Path::DRAWS] {
        let off = Knobs { path, ..small() };
        let on = Knobs { shadows: Shadows::Proxy, ..off };
        let (without, stages) = layers(&gpu, &scene, &caches, &off);
        assert!(!stages.iter().any(|stage| stage == "occlude"), "{stages:?}");
        assert!(drawn(&gpu, &scene, &caches, &off).light.caches().expect("caches").occlude.is_none());
        let (with, stages) = layers(&gpu, &scene, &caches, &on);
        let at = |name| stages.iter().position(|stage| stage == name);
        assert!(at("gather") < at("occlude") && at("occlude") < at("interpolate"), "{stages:?}");
        assert!(with != without, "something must be occluded");
        assert!(layers(&gpu, &scene, &thin, &on).0 == without, "nothing may be occluded");
    }
    assert_clean(&gpu);
}

#[test]
fn culling_and_clusters_leave_what_all_caches_leave() {
    let gpu = gpu();
    let scene = corner(&[SPOT], 40.0);
    let caches = baked(&scene, 0.12, 8);
    let mut by_path = Vec::new();
    for path in [Path::Compute, Path::DRAWS, Path::Clusters(ClusterRule::Distance(64.0))] {
        let all = Knobs { path, shadows: Shadows::Proxy, ..small() };
        let (without, _) = layers(&gpu, &scene, &caches, &all);
        let (with, _) = layers(&gpu, &scene, &caches, &Knobs { cull: true, ..all });
        assert!(with == without, "{path:?}: pictures differ");
        by_path.push(without);
    }
    let values = |layers: &Vec<Vec<[u32; 4]>>| -> Vec<f32> {
        layers.iter().flatten().flat_map(|texel| texel.map(f32::from_bits)).collect()
    };
    let [compute, fragment, clusters] = [0, 1, 2].map(|i| values(&by_path[i]));
    let most = compute.iter().copied().fold(0.0, f32::max);
    for (other, bound) in [(fragment, 1e-4), (clusters, 2e-2)] {
        let worst = compute.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst <= bound * most, "{worst} of {most}");
    }
    assert_clean(&gpu);
}

/// Asserts that a frame's occluded proxies match the twins', which are computed from the same VALs.
#[track_caller]
fn assert_frame(gpu: &Gpu, scene: &Scene, caches: &CacheSet) {
    let shot = shoot(gpu, scene, Some(caches), &Knobs { shadows: Shadows::Proxy, ..small() });
    let areas = caches.instance_model.iter().flat_map(|model| &caches.models[*model].caches);
    let disc = |(at, cache): (&Cache, &bake::Cache)| Disc {
        position: at.position,
        normal: at.normal,
        area: cache.area.into(),
    };
    let discs: Vec<Disc> = shot.caches.iter().zip(areas).map(disc).collect();
    let eye = scene.cameras[0].world_from_camera.translation;
    let (mut worst, mut dimmed) = ([0.0_f64; 2], 0);
    for (cache, found) in shot.caches.iter().zip(&shot.proxies) {
        let twin = gather::gather(cache, &shot.vals, Some(eye), gather::ProxyWeight::Irradiance);
        let lobe = Material { diffuse: DVec3::ZERO, specular: DVec3::ONE, exponent: cache.exponent };
        let mirrored = mirrored_view(cache.position, cache.normal, eye);
        let reaches = brute_force::radiance(cache.position, cache.normal, mirrored, &lobe, &shot.vals).1;
        for (i, (found, before)) in [(found.diffuse, twin.diffuse), (found.glossy, twin.glossy)].into_iter().enumerate()
        {
            // Skip lobes that are so dark that the device may call them unlit, or limit them differently.
            if i == 1 && luminance(reaches) < if rounding(gpu) > 1.0 { 1e-10 } else { 1e-20 } {
                continue;
            }
            let twin = occlude(cache, &before, &discs);
            dimmed += usize::from(luminance(twin.facing_irradiance) < 0.9 * luminance(before.facing_irradiance));
            let length = before.facing_irradiance.length().max(f64::MIN_POSITIVE);
            let off = found.facing_irradiance.distance(twin.facing_irradiance) / length;
            worst[i] = worst[i].max(off);
        }
    }
    eprintln!("{}: {} caches, {dimmed} lobes dimmed, largest errors {worst:?}", scene.name, discs.len());
    assert!(
        dimmed > discs.len() / 20 && worst[0] < 1e-3 && worst[1] < 1e-2,
        "{dimmed} dimmed, largest errors {worst:?}"
    );
}

#[test]
fn frames_leave_what_the_twin_says() {
    let gpu = gpu();
    let scene = corner(&[SPOT, LightKind::Directional], 40.0);
    assert_frame(&gpu, &scene, &baked(&scene, 0.15, 8));
    let shifted = placed(&scene, 1.0, dvec3(1e4, -2e3, 5e3));
    assert_frame(&gpu, &shifted, &baked(&shifted, 0.15, 8));
    let scene = cornell(CornellSurface::Glossy, 0.2);
    assert_frame(&gpu, &scene, &baked(&scene, 0.15, 8));
}

#[test]
fn indirect_light_comes_nearer_to_light_paths() {
    let gpu = gpu();
    for which in Shadowed::ALL {
        let scene = which.scene();
        let settings = shadows::ShadowsSettings { size: [48, 27], caches: 500, rsm: 48, samples: 64, frames: 1 };
        let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("shadows");
        std::fs::create_dir_all(&folder).expect("the target folder is writable");
        let compared = shadows::compare(&gpu, &scene, &settings, &folder, &|_| ()).expect("compared");
        assert_eq!(compared.problems, [""; 0]);
        let errors = |kind| {
            let row = compared.rows.iter().find(|row| row.shadows == kind).expect("a row");
            row.errors.as_ref().expect("errors").clone()
        };
        for ((layer, off), (_, on)) in errors(Shadows::Off).iter().zip(errors(Shadows::Proxy)) {
            let [off, on] = [off, &on].map(|errors| errors.metrics);
            eprintln!(
                "{}, {layer}: relMSE {} -> {}, bias {} -> {}",
                scene.name, off.relmse, on.relmse, off.bias, on.bias
            );
            assert!(on.relmse < off.relmse, "{}, {layer}: {off:?}, with shadows {on:?}", scene.name);
        }
    }
    assert_clean(&gpu);
}

#[test]
fn skipping_changes_no_bit_of_whole_scenes() {
    let gpu = gpu();
    for (scene, count) in
        [(valley(12_800, true), 4000), (Shadowed::Columns.scene(), 4000), (Shadowed::Columns.scene(), 500)]
    {
        let density = Density::Count(count);
        let caches =
            bake::bake(&scene, &bake::BakeSettings { density, angle: 1.0, references: 8 }, &|_, _| ()).expect("bakes");
        let settings = Knobs { shadows: Shadows::Proxy, ..small() };
        let frame = drawn(&gpu, &scene, &caches, &settings);
        let light = frame.light.caches().expect("caches");
        let atlas: Vec<shared::Cache> = gpu.read(&light.atlas.caches).expect("atlas");
        let mut proxies: Vec<Proxy> = gpu.read(&light.proxies.buffer).expect("proxies");
        proxies.iter_mut().for_each(|p| (p.diffuse_irradiance, p.glossy_irradiance) = (Vec3::ONE, Vec3::ONE));
        let [all, skipping] = [false, true].map(|skip| timed(&gpu, &atlas, &proxies, true, skip));
        println!(
            "{}: {} caches, {:.1} ms with every disc, {:.1} ms with skipping",
            scene.name,
            atlas.len(),
            all.1,
            skipping.1
        );
        assert!(alike(&gpu, &all.0, &skipping.0), "skipping changes the result");
        assert!(all.0.iter().flatten().any(|share| *share < 0.95), "something must be occluded");
    }
}
