//! VALs and proxies of whole frames against the f64 references.

use glam::{DAffine3, DVec3, Vec3, dvec3};
use lightskin::frame::atlas::Atlas;
use lightskin::frame::gather::{Compute, ComputeKind, Gather, Lit};
use lightskin::frame::gather_draws::Draws;
use lightskin::frame::proxies::Proxies;
use lightskin::frame::vals::Vals;
use lightskin::frame::{DrawSource, ProxyWeight, View, Ways, World, tune};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Knobs};
use lightskin::lab::shot;
use lightskin::reference::gather::{self, Lobe, luminance, val_geometry};
use lightskin::reference::phong::{Material, cos_power, mirrored_view};
use lightskin::reference::rsm::{Val, cast_view};
use lightskin::reference::{brute_force, gather::Gathered};
use lightskin::scene::{Instance, LightKind, Scene};
use lightskin::shared;
use rayon::prelude::*;

use crate::common::frames::{SPOT, Shot, baked, corner, shoot, small, triangles};
use crate::common::{assert_clean, gpu, rounding};

/// Both weights, as the frame's and as the reference's type.
pub(crate) const WEIGHTS: [(ProxyWeight, gather::ProxyWeight); 2] = [
    (ProxyWeight::Irradiance, gather::ProxyWeight::Irradiance),
    (ProxyWeight::FormFactor, gather::ProxyWeight::FormFactor),
];

// Stage 4 (METHOD 2).

/// The reference's VALs for the device's own frusta, in the device's order: rows from the top.
fn cast(scene: &Scene, shot: &Shot) -> Vec<Val> {
    let triangles: Vec<_> = triangles(scene).into_iter().map(|(triangle, _)| triangle).collect();
    let n = (shot.vals.len() / shot.views.len()).isqrt();
    let rows = |vals: Vec<Val>| vals.chunks(n).rev().flatten().copied().collect::<Vec<_>>();
    shot.views.iter().flat_map(|view| rows(cast_view(&triangles, &scene.lights[0], view, n))).collect()
}

#[test]
fn vals_of_every_kind_of_light_are_the_references() {
    let gpu = gpu();
    // With form-factor weights, a wrong VAL shows by its weight.
    let settings = Knobs { rsm: 40, proxy_weight: ProxyWeight::FormFactor, ..small() };
    let wide = LightKind::Spot { inner: 1.2, outer: 1.4 }; // six views
    for kind in [SPOT, LightKind::Spot { inner: 0.5, outer: 0.5 }, wide, LightKind::Point, LightKind::Directional] {
        let mut scene = corner(&[kind], 40.0);
        scene.lights[0].range = (kind != LightKind::Directional).then_some(2.3);
        let caches = baked(&scene, 0.8, 8);
        let shot = shoot(&gpu, &scene, Some(&caches), &settings);
        let expected = cast(&scene, &shot);
        let brightest = expected.iter().map(|val| val.flux.length()).fold(0.0, f64::max);
        let mut elsewhere = 0;
        for (val, twin) in shot.vals.iter().zip(&expected) {
            // A texel's centre on the edge of a triangle may hit a surface behind the triangle.
            let moved = val.position.distance(twin.position);
            if moved > shot.most_moved(twin) {
                elsewhere += 1;
                continue;
            }
            // A ball's normals turn as the place moves.
            let bound = (1e-5 + 20.0 * moved) * twin.area;
            assert!((val.area - twin.area).abs() <= bound, "{kind:?}: {val:?} instead of {twin:?}");
            let bound = 1e-5 + 4.0 * moved;
            assert!(val.normal.distance(twin.normal) < bound, "{kind:?}: {val:?} instead of {twin:?}");
            // Mesa's arc tangent has an error of 2.1e-5. A sharp cone's ramp is 0.001 wide, so one of the 16
            // sub-samples of a VAL on the cone's edge may differ by its rounding of 1e-4.
            let bound = (4e-5 + 4.0 * moved) * twin.flux.length() + (1e-5 + 10.0 * moved) * brightest;
            assert!(val.flux.distance(twin.flux) <= bound, "{kind:?}: {val:?} instead of {twin:?}");
        }
        let (sum, twins) = (flux(&shot.vals), flux(&expected));
        eprintln!("{kind:?}: {elsewhere} of {} elsewhere, {sum} lm instead of {twins}", expected.len());
        assert!(elsewhere * 200 <= expected.len(), "{kind:?}: {elsewhere} of {} texels elsewhere", expected.len());
        let bound = if shot.subpixels.is_some() { 5e-4 } else { 1e-4 };
        assert!(sum.distance(twins) < bound * twins.length(), "{kind:?}: {sum} lm instead of {twins}");
        assert!(shot.vals.iter().any(|val| val.flux != DVec3::ZERO));
    }
}

fn flux(vals: &[Val]) -> DVec3 {
    vals.iter().map(|val| val.flux).sum()
}

// Stage 3.

#[test]
fn caches_stand_where_their_instances_put_them() {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 40.0);
    // The wall a second time, mirrored and scaled.
    let turned = DAffine3::from_rotation_y(0.8) * DAffine3::from_scale(dvec3(-1.0, 0.5, 2.0));
    scene.instances.push(Instance { world_from_model: turned, ..scene.instances[1].clone() });
    let baked = baked(&scene, 0.5, 8);
    let shot = shoot(&gpu, &scene, Some(&baked), &small());
    let mut caches = shot.caches.iter();
    for (instance, &model) in scene.instances.iter().zip(&baked.instance_model) {
        let placed = instance.world_from_model;
        let normals = placed.matrix3.inverse().transpose();
        for (of_model, cache) in baked.models[model].caches.iter().zip(&mut caches) {
            let position = placed.transform_point3(of_model.position.as_dvec3());
            let normal = (normals * of_model.normal.as_dvec3()).normalize();
            assert!(cache.position.distance(position) < 1e-6, "{cache:?} instead of {position}");
            assert!(cache.normal.distance(normal) < 1e-6, "{cache:?} instead of {normal}");
            assert_eq!(cache.exponent, 40.0);
        }
    }
    assert!(caches.next().is_none());
}

// Stage 6 (METHOD 3-4).

/// Asserts that a proxy is the twin's. `bound` is relative to the proxy's irradiance and to its distance from the
/// cache.
#[track_caller]
fn assert_lobe(actual: &Lobe, twin: &Lobe, from: DVec3, bound: f64, what: &str) -> f64 {
    assert_eq!(actual.lit, twin.lit, "{what}: {actual:?} instead of {twin:?}");
    let moved = actual.position.distance(twin.position) / twin.position.distance(from);
    let off = actual.facing_irradiance.distance(twin.facing_irradiance);
    let off = if off == 0.0 { 0.0 } else { off / twin.facing_irradiance.length() };
    assert!(
        moved.max(off) <= bound,
        "{what}: {actual:?} instead of {twin:?}: moved {moved}, relative irradiance error {off}"
    );
    moved.max(off)
}

/// Compares every cache with the reference, which uses the device's own VALs.
#[track_caller]
fn assert_gathered(gpu: &Gpu, scene: &Scene, shot: &Shot, weight: gather::ProxyWeight) -> [f64; 2] {
    let eye = scene.cameras[0].world_from_camera.translation;
    let mut worst = [0.0_f64; 2];
    for (cache, proxies) in shot.caches.iter().zip(&shot.proxies) {
        let twin = gather::gather(cache, &shot.vals, Some(eye), weight);
        worst[0] = worst[0].max(assert_lobe(&proxies.diffuse, &twin.diffuse, cache.position, 1e-5, "diffuse"));
        // cos^k underflows in f32 before it does in f64. Below 1e-25 lm/m^2 the device may say unlit, and below 1e-30
        // it limits the quotient by another branch. Both cases are dark. Far from its axis a lobe multiplies errors.
        let lobe = Material { diffuse: DVec3::ZERO, specular: DVec3::ONE, exponent: cache.exponent };
        let mirrored = mirrored_view(cache.position, cache.normal, eye);
        let reaches = brute_force::radiance(cache.position, cache.normal, mirrored, &lobe, &shot.vals).1;
        if luminance(reaches) > if rounding(gpu) > 1.0 { 1e-10 } else { 1e-25 } {
            // The error of the device's cosine power grows with the exponent.
            let bound = (2e-5 + 1e-6 * cache.exponent) * rounding(gpu);
            worst[1] = worst[1].max(assert_lobe(&proxies.glossy, &twin.glossy, cache.position, bound, "glossy"));
        } else {
            assert!(proxies.glossy.position.is_finite() && proxies.glossy.facing_irradiance.is_finite());
        }
    }
    worst
}

#[test]
fn proxies_of_every_cache_are_the_references() {
    let gpu = gpu();
    for exponent in [1.0, 40.0, 500.0] {
        let scene = corner(&[SPOT, LightKind::Point, LightKind::Directional], exponent);
        let caches = baked(&scene, 0.5, 8);
        for (weight, twin) in WEIGHTS {
            let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { proxy_weight: weight, ..small() });
            let [diffuse, glossy] = assert_gathered(&gpu, &scene, &shot, twin);
            eprintln!(
                "k {exponent}, {twin:?}: {} caches, largest errors: diffuse {diffuse:e}, glossy {glossy:e}",
                shot.caches.len()
            );
            let lit = |lobe: fn(&Gathered) -> &Lobe| shot.proxies.iter().filter(|p| lobe(p).lit).count();
            assert!(lit(|p| &p.diffuse) * 2 > shot.caches.len() && lit(|p| &p.glossy) > 5);
        }
    }
}

#[test]
fn more_caches_than_a_row_of_the_atlas_holds_are_all_lit() {
    let gpu = gpu();
    let scene = corner(&[SPOT], 40.0);
    let shot = shoot(&gpu, &scene, Some(&baked(&scene, 0.15, 8)), &small());
    assert!(shot.caches.len() > 3 * 128, "{} caches", shot.caches.len());
    eprintln!(
        "{} caches: {:?}",
        shot.caches.len(),
        assert_gathered(&gpu, &scene, &shot, gather::ProxyWeight::Irradiance)
    );
}

#[test]
fn scenes_far_from_the_origin_are_drawn_around_their_own() {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 40.0);
    let shift = dvec3(1e4, -2e3, 5e3);
    scene.instances.iter_mut().for_each(|i| i.world_from_model.translation += shift);
    scene.lights[0].position += shift;
    scene.cameras[0].world_from_camera.translation += shift;
    let shot = shoot(&gpu, &scene, Some(&baked(&scene, 0.5, 8)), &small());
    assert_gathered(&gpu, &scene, &shot, gather::ProxyWeight::Irradiance);
    let expected = flux(&cast(&scene, &shot));
    assert!(flux(&shot.vals).distance(expected) < 1e-3 * expected.length());
}

#[test]
fn every_way_of_lighting_caches_agrees() {
    let gpu = gpu();
    // More VALs than the maximum number of loop rounds in older lavapipe, and a number of caches that is no multiple of
    // a group.
    let (caches, vals) = tune::world(141, 70_001);
    let eye = glam::Vec4::new(-1.5, 0.4, 2.0, 1.0);
    let (atlas, vals_on_device) = (Atlas::of(&gpu, &caches).expect("caches"), Vals::of(&gpu, &vals).expect("VALs"));
    // f64 sums of both lobes, and sums of the magnitudes of their terms.
    let twin = |c: &shared::Cache| -> [f64; 30] {
        let (position, normal) = (c.position.as_dvec3(), c.normal.as_dvec3());
        let mirrored = mirrored_view(position, normal, eye.truncate().as_dvec3());
        let mut sums = [0.0; 30];
        for v in &vals {
            let (g, direction) = val_geometry(position, normal, &shot::val(v, DVec3::ZERO));
            let (offset, w) = (v.position.as_dvec3() - position, g * f64::from(v.weight));
            let lobe = cos_power(c.exponent.into(), mirrored.dot(direction));
            let flux = v.flux.as_dvec3();
            let parts = [offset.x * w, offset.y * w, offset.z * w, w, flux.x * g, flux.y * g, flux.z * g];
            let all = parts.into_iter().chain([offset.length_squared() * w]).chain(parts.map(|part| part * lobe));
            for (i, part) in all.enumerate() {
                sums[i] += part;
                sums[15 + i] += part.abs();
            }
        }
        sums
    };
    let twins: Vec<[f64; 30]> = caches.par_iter().map(twin).collect();
    let mut stages = Vec::new();
    // The longest parts as well.
    let longest = Ways { split: 32_768, ..Ways::default() };
    for ways in [tune::candidates(true), tune::candidates(false), vec![longest]].concat() {
        let stage = Compute::new(&gpu, 141, 70_001, &ways, ComputeKind::plain(true)).expect("stage 6");
        stages.push((format!("{ways:?}"), Gather::Compute(Box::new(stage))));
    }
    for (source, tile) in [(DrawSource::Texels, 4096), (DrawSource::Storage, 4096), (DrawSource::Texels, 32_768)] {
        let stage = Draws::new(&gpu, 141, true, false, source, tile, false).expect("stage 6");
        stages.push((format!("{source:?}, {tile}"), Gather::Draws(Box::new(stage))));
    }
    for (way, stage) in stages {
        let proxies = Proxies::new(&gpu, 141, true, 1).expect("proxies");
        let lit =
            Lit { vals: &vals_on_device, atlas: &atlas, proxies: &proxies, eyes: &[eye], albedos: None, sky: None };
        let mut before: Option<Vec<shared::Proxy>> = None;
        for _ in 0..2 {
            let drawn = gpu.frame(|cmd| {
                stage.record(cmd, &lit);
                Ok(())
            });
            assert_eq!(drawn.expect("drawn").problems, [""; 0]);
            // Proxies must not depend on the thread that finishes a cache's last part, and nothing may be left for the
            // next frame.
            let proxies: Vec<shared::Proxy> = gpu.read(&proxies.buffer).expect("proxies");
            assert!(proxies.iter().all(|p| p.diffuse_distance2 > 0.0), "a dark cache: {way}");
            if let Some(before) = before.replace(proxies.clone()) {
                assert_eq!(before, proxies, "{way}");
            }
            if let Gather::Compute(by) = &stage {
                assert!(gpu.read::<u32>(&by.arrived).expect("counters").iter().all(|parts| *parts == 0));
            }
        }
        let found = shot::gather_sums(&gpu, &stage, 141).expect("sums");
        let mut worst = [0.0_f64; 2];
        for (found, twin) in found.iter().zip(&twins) {
            let found: [f32; 16] = bytemuck::cast(*found);
            for i in 0..15 {
                let error = (f64::from(found[i]) - twin[i]).abs() / twin[15 + i].max(1e-9 * twin[15 + i % 8]);
                worst[i / 8] = worst[i / 8].max(error);
            }
        }
        eprintln!("largest errors: diffuse {:.1e}, glossy {:.1e}: {way}", worst[0], worst[1]);
        assert!(worst[0] < 1e-5 && worst[1] < 1e-4, "{worst:?}: {way}");
    }
    assert_clean(&gpu);
}

#[test]
fn vals_without_light_are_closed_up() {
    let gpu = gpu();
    // A cone that leaves most texels dark, and a number of texels that is not a multiple of a block.
    let scene = corner(&[LightKind::Spot { inner: 0.2, outer: 0.3 }, LightKind::Point], 40.0);
    let ways = Ways { split: 256, ..Ways::default() };
    let settings = Knobs { rsm: 45, cull: false, ways, ..small() };
    let buffers = World::new(&gpu, &scene, Some(&baked(&scene, 0.5, 8))).expect("uploaded");
    let mut frame = Frame::new(&gpu, &scene, &buffers, &settings).expect("made");
    let camera = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &buffers, &camera);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    let vals = &frame.light.rsm.as_ref().expect("VALs").vals;
    let all: Vec<shared::Val> = gpu.read(&vals.all).expect("read");
    let live: Vec<shared::Val> = gpu.read(&vals.live).expect("read");
    let count = gpu.read::<u32>(&vals.live_count).expect("read")[0] as usize;
    let lit: Vec<shared::Val> = all.iter().filter(|v| v.weight != 0.0 || v.flux != Vec3::ZERO).copied().collect();
    assert!(lit.len() > 500 && 2 * lit.len() < all.len(), "{} of {}", lit.len(), all.len());
    assert_eq!(live[..count], lit[..], "lit VALs must keep their order");
    let dark = &live[count..count.next_multiple_of(shared::VAL_TILE as usize)];
    assert!(!dark.is_empty() && dark.iter().all(|v| v.flux == Vec3::ZERO && v.weight == 0.0 && v.area == 1.0));
    assert_eq!(frame.light.counts(&gpu).expect("counts").vals as usize, count);
    // Without culling, the gather's dispatch size depends on the number of lit VALs. Dark VALs take no part.
    let caches = frame.light.caches().expect("caches");
    let args = gpu.read::<shared::LiveArgs>(&caches.gather.live().expect("compute path").args).expect("read")[0];
    assert_eq!([args.cache_count, args.groups_y], [caches.atlas.count, count.div_ceil(256) as u32]);
    assert!(args.groups_y < all.len().div_ceil(256) as u32);
}
