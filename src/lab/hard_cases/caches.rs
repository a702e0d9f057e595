//! Few and many caches and VALs, and VALs in difficult positions: the gather's f32 sums against f64. METHOD 3-4.

use super::oracle::{largest, material, sums_against_twins};
use super::{Case, Outcome, oracle};
use crate::bake::{self, Density};
use crate::error::Result;
use crate::frame::Ways;
use crate::frame::atlas::Atlas;
use crate::frame::gather::{Compute, ComputeKind, Gather, Lit};
use crate::frame::proxies::Proxies;
use crate::frame::vals::Vals;
use crate::gpu::Gpu;
use crate::lab::knobs::Knobs;
use crate::lab::shot::{cache, gather_sums, seen, sent_on, shoot, small, val};
use crate::lab::worlds::{SPOT, baked, corner, one_cache};
use crate::reference::gather::{LEAST_COSINE, ProxyWeight, gather, luminance, val_geometry};
use crate::reference::interpolate::{Interpolated, Scheme, interpolate, shade};
use crate::reference::phong::{cos_power, mirrored_view};
use crate::scene::LightKind;
use crate::shared::{Cache, GatherSums, Proxy, Val};
use glam::{DVec3, Vec3, dvec3, vec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Viewer for the glossy lobes of the caches below.
const EYE: Vec3 = vec3(-1.5, 0.4, 2.0);

/// Sums and proxies from stage 6 for given VALs and caches, per cache.
struct Gathered {
    sums: Vec<GatherSums>,
    proxies: Vec<Proxy>,
    complaints: Vec<String>,
}

/// Runs stage 6 alone, with both lobes.
fn gather_alone(gpu: &Gpu, vals: &[Val], caches: &[Cache]) -> Result<Gathered> {
    let said = gpu.messages().len();
    let (vals, atlas) = (Vals::of(gpu, vals)?, Atlas::of(gpu, caches)?);
    let proxies = Proxies::new(gpu, atlas.count, true, 1)?;
    let stage = Compute::new(gpu, atlas.count, vals.count, &Ways::default(), ComputeKind::plain(true))?;
    let stage = Gather::Compute(Box::new(stage));
    let drawn = gpu.frame(|cmd| {
        let _zone = cmd.zone("gather");
        let eyes = [EYE.extend(1.0)];
        stage
            .record(cmd, &Lit { vals: &vals, atlas: &atlas, proxies: &proxies, eyes: &eyes, albedos: None, sky: None });
        Ok(())
    })?;
    let (sums, proxies) = (gather_sums(gpu, &stage, atlas.count)?, gpu.read::<Proxy>(&proxies.buffer)?);
    let mut complaints = drawn.problems;
    let positive = |v: Vec3| v.is_finite() && v.min_element() >= 0.0;
    let sound = |p: &Proxy| {
        let (diffuse, glossy) = (p.diffuse_irradiance, p.glossy_irradiance);
        let (from, glossy_from) = (p.diffuse_position, p.glossy_position);
        positive(diffuse) && positive(glossy) && from.is_finite() && glossy_from.is_finite()
    };
    let broken = proxies.iter().filter(|p| !sound(p)).count();
    if broken > 0 {
        complaints.push(format!("{broken} proxies are broken"));
    }
    complaints.extend(gpu.messages().into_iter().skip(said));
    Ok(Gathered { sums, proxies, complaints })
}

/// Largest errors of the sums against f64 over all caches, relative to the sum of the terms' magnitudes; diffuse and
/// glossy.
fn sum_errors(vals: &[Val], caches: &[Cache], found: &Gathered) -> [f64; 2] {
    let vals: Vec<_> = vals.iter().map(|v| (val(v, DVec3::ZERO), f64::from(v.weight))).collect();
    let at =
        |i: usize| {
            let cache = cache(&caches[i], DVec3::ZERO);
            let mirrored = mirrored_view(cache.position, cache.normal, EYE.as_dvec3());
            // For each lobe: position and its terms' magnitudes, weight, irradiance.
            let mut twins = [(DVec3::ZERO, 0.0, 0.0, DVec3::ZERO); 2];
            for (val, weight) in &vals {
                let (geometry, direction) = val_geometry(cache.position, cache.normal, val);
                let offset = val.position - cache.position;
                for (twin, lobe) in twins.iter_mut().zip([1.0, cos_power(cache.exponent, mirrored.dot(direction))]) {
                    let pull = weight * geometry * lobe;
                    twin.0 += pull * offset;
                    twin.1 += pull * offset.length();
                    twin.2 += pull;
                    twin.3 += val.flux * (geometry * lobe);
                }
            }
            // Below this share of all light f32 does not resolve cos^k.
            let floor = [0.0, 1e-9];
            let all = twins[0];
            [0, 1].map(|l| {
                let s = &found.sums[i];
                let (position, weight, irradiance) = match l {
                    0 => (s.diffuse_position.as_dvec3(), f64::from(s.diffuse_weight), s.diffuse_irradiance.as_dvec3()),
                    _ => (s.glossy_position.as_dvec3(), f64::from(s.glossy_weight), s.glossy_irradiance.as_dvec3()),
                };
                let twin = twins[l];
                let part = |apart: f64, terms: f64, all: f64| {
                    if apart == 0.0 { 0.0 } else { apart / terms.max(floor[l] * all) }
                };
                part(position.distance(twin.0), twin.1, all.1)
                    .max(part((weight - twin.2).abs(), twin.2, all.2))
                    .max(part(irradiance.distance(twin.3), twin.3.length(), all.3.length()))
            })
        };
    (0..caches.len()).into_par_iter().map(at).reduce(|| [0.0; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])])
}

/// Uniform numbers in [0, 1): splitmix64.
fn numbers(mut state: u64) -> impl FnMut() -> f32 {
    move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / 16_777_216.0
    }
}

/// A VAL weighted by its irradiance.
fn disc(position: Vec3, normal: Vec3, area: f32, flux: Vec3) -> Val {
    Val { position, area, normal, kind: 0, flux, weight: luminance(flux.as_dvec3()) as f32 }
}

/// VALs above the plane z = 0 that face roughly down; their fluxes span three decades.
fn some_vals(count: usize) -> Vec<Val> {
    let mut next = numbers(7);
    let mut one = |_| {
        let position = vec3(4.0 * next() - 2.0, 4.0 * next() - 2.0, 0.1 + 2.0 * next());
        let normal = vec3(next() - 0.5, next() - 0.5, -1.0).normalize();
        let flux = vec3(next(), next(), next()) * 10_f32.powf(3.0 * next());
        disc(position, normal, 10.0 / count as f32, flux)
    };
    (0..count).map(&mut one).collect()
}

/// Caches near the plane z = 0 with normals around +z.
fn some_caches(count: usize, exponent: f32) -> Vec<Cache> {
    let mut next = numbers(3);
    let mut one = |_| {
        let position = vec3(2.0 * next() - 1.0, 2.0 * next() - 1.0, 0.05 * next());
        let normal = vec3(next() - 0.5, next() - 0.5, 1.0).normalize();
        Cache { position, exponent, normal, ..CACHE }
    };
    (0..count).map(&mut one).collect()
}

/// A cache at the origin that faces up.
const CACHE: Cache = Cache {
    position: Vec3::ZERO,
    exponent: 10.0,
    normal: Vec3::Z,
    area: 0.01,
    middle: Vec3::ZERO,
    breadth: 0.0,
    axis: Vec3::ZERO,
    radius: 0.0,
};

pub(super) fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    for n in (0..9).map(|i| 4_usize.pow(i)) {
        let expected = "f64 sums within 1e-5 of the sum of terms";
        all.push(Case::new("f32 sums", format!("{n} VALs, 64 caches, k = 10"), expected, move |gpu| {
            let (vals, caches) = (some_vals(n), some_caches(64, 10.0));
            let found = gather_alone(gpu, &vals, &caches)?;
            let [diffuse, glossy] = sum_errors(&vals, &caches, &found);
            let mut outcome = Outcome::all([("diffuse", diffuse, 1e-5), ("glossy", glossy, 1e-5)]);
            outcome.complaints = found.complaints;
            Ok(outcome)
        }));
    }
    for k in [1.0, 8.0, 64.0, 512.0, 2048.0] {
        // The device's exp2(k log2 cos) errs by k rounding errors of the cosine and of the logarithm.
        let bound = 1e-5 + 1e-6 * f64::from(k);
        let (input, expected) = (format!("1024 VALs, 64 caches, k = {k}"), format!("f64 sums within {bound:.1e}"));
        all.push(Case::new("exponent", input, expected, move |gpu| {
            let (vals, caches) = (some_vals(1024), some_caches(64, k));
            let found = gather_alone(gpu, &vals, &caches)?;
            let [diffuse, glossy] = sum_errors(&vals, &caches, &found);
            let mut outcome = Outcome::all([("diffuse", diffuse, 1e-5), ("glossy", glossy, bound)]);
            outcome.complaints = found.complaints;
            Ok(outcome)
        }));
    }
    all.push(Case::new("caches", "30 000 caches, 256 VALs, k = 10", "f64 sums within 1e-5", |gpu| {
        let (vals, caches) = (some_vals(256), some_caches(30_000, 10.0));
        let found = gather_alone(gpu, &vals, &caches)?;
        let [diffuse, glossy] = sum_errors(&vals, &caches, &found);
        let mut outcome = Outcome::all([("diffuse", diffuse, 1e-5), ("glossy", glossy, 1e-5)]);
        outcome.complaints = found.complaints;
        Ok(outcome)
    }));
    all.push(Case::new("caches", "a whole frame with about 30 000 baked caches", "f64 sums within 5e-5", many_caches));
    all.push(Case::new("caches", "one cache for a whole scene", "f64 shading by its one proxy within 1e-3", one));
    all.push(Case::new("VALs", "a whole frame with one VAL", "its phi G at every cache within 1e-5", one_val));
    let expected = "flux rho I 2 pi (1 - cos - ramp) within 3e-4, f64 sums within 5e-5";
    all.push(Case::new("VALs", "a whole frame with 65 536 VALs of a sharp cone", expected, many_vals));
    for height in [1.0, 1e-2, 1e-4, 1e-6, 1e-12, 0.0] {
        let expected = if height > 0.0 { "phi / max(A, pi h^2) within 1e-6" } else { "no light from it, and no NaN" };
        all.push(Case::new("touching VAL", format!("VAL {height:e} m above a cache"), expected, move |gpu| {
            touching(gpu, height)
        }));
    }
    for sine in [1e-1, 1e-2, 1e-3, 1e-4, 1e-6] {
        let input = format!("VALs around a cache, {sine:e} of their distance above its plane");
        let expected = "f64 sums within 1e-5, proxy at most 1e4 E";
        all.push(Case::new("grazing VALs", input, expected, move |gpu| grazing(gpu, sine)));
    }
    all.push(Case::new("VALs behind", "1000 VALs below 64 caches that face up", "exactly no light", behind));
    all
}

fn many_caches(gpu: &Gpu) -> Result<Outcome> {
    let scene = corner(&[SPOT], 10.0);
    let settings = bake::BakeSettings { density: Density::Count(30_000), angle: 1.0, references: 8 };
    let caches = bake::bake(&scene, &settings, &|_, _| ())?;
    let shot = shoot(gpu, &scene, Some(&caches), &small())?;
    let [diffuse, glossy] = sums_against_twins(&scene, &shot);
    let outcome = Outcome::all([("diffuse", diffuse, 5e-5), ("glossy", glossy, 5e-5)]).of(&[&shot]);
    Ok(outcome.provided(shot.caches.len() > 25_000, &format!("{} caches", shot.caches.len())))
}

/// One cache on the floor lights the whole floor.
fn one(gpu: &Gpu) -> Result<Outcome> {
    let scene = corner(&[SPOT], 10.0);
    let shot = shoot(gpu, &scene, Some(&one_cache(&scene, 8, vec3(0.1, 0.0, 0.2), Vec3::Y)), &small())?;
    let eye = scene.cameras[0].world_from_camera.translation;
    let twin = gather(&shot.caches[0], &shot.vals, Some(eye), ProxyWeight::Irradiance);
    let mesh = &scene.meshes[scene.instances[0].mesh];
    let at_vertex = |v: usize| {
        let (position, normal) = (mesh.vertices[v].position.as_dvec3(), mesh.vertices[v].normal.as_dvec3());
        let references = [(shot.caches[0], twin)];
        interpolate(position, normal, mirrored_view(position, normal, eye), &references, Scheme::Facing)
    };
    let (mut twins, mut pictures) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    for s in seen(&scene, small().size).iter().filter(|s| s.instance == 0) {
        let mirrored = mirrored_view(s.position, s.normal, eye);
        let corners = s.vertices.map(at_vertex);
        let mean = |of: fn(&Interpolated) -> DVec3| {
            corners.iter().zip(s.weights).map(|(light, share)| share * of(light)).sum::<DVec3>()
        };
        let light = Interpolated {
            diffuse_position: mean(|l| l.diffuse_position),
            diffuse_irradiance: mean(|l| l.diffuse_irradiance),
            has_diffuse: twin.diffuse.lit,
            glossy_position: mean(|l| l.glossy_position),
            glossy_irradiance: mean(|l| l.glossy_irradiance),
            has_glossy: twin.glossy.lit,
        };
        let (diffuse, glossy) = shade(&light, s.position, s.normal, mirrored, &material(s, &scene, &shot));
        twins[0].push(diffuse);
        twins[1].push(glossy);
        pictures[0].push(shot.diffuse[s.pixel]);
        pictures[1].push(shot.glossy[s.pixel]);
    }
    let [diffuse, glossy] = [0, 1].map(|i| oracle::difference(&twins[i], &pictures[i], 1.0));
    let outcome = Outcome::all([("diffuse", diffuse, 1e-3), ("glossy", glossy, 1e-3)]).of(&[&shot]);
    Ok(outcome.provided(largest(&twins[0]).min(largest(&twins[1])) > 0.0, "the floor is dark"))
}

fn one_val(gpu: &Gpu) -> Result<Outcome> {
    let scene = corner(&[SPOT], 10.0);
    let shot = shoot(gpu, &scene, Some(&baked(&scene, 0.5, 8)?), &Knobs { rsm: 1, ..small() })?;
    let [val] = shot.vals[..] else { return Ok(Outcome::bounded(f64::NAN, 0.0)) };
    let (mut worst, mut lit) = (0.0_f64, 0);
    for (cache, proxies) in shot.caches.iter().zip(&shot.proxies).filter(|(_, p)| p.diffuse.lit) {
        let (geometry, direction) = val_geometry(cache.position, cache.normal, &val);
        let irradiance = proxies.diffuse.facing_irradiance * cache.normal.dot(direction);
        worst = worst.max(irradiance.distance(val.flux * geometry) / (val.flux * geometry).length());
        lit += 1;
    }
    Ok(Outcome::bounded(worst, 1e-5).of(&[&shot]).provided(lit > 10, "few caches are lit"))
}

fn many_vals(gpu: &Gpu) -> Result<Outcome> {
    // The whole cone hits the floor; the ball is removed.
    let mut scene = corner(&[LightKind::Spot { inner: 0.3, outer: 0.3 }], 10.0);
    scene.instances.truncate(2);
    (scene.lights[0].position, scene.lights[0].direction) = (dvec3(0.1, 1.5, 0.2), Vec3::NEG_Y);
    let albedo = sent_on(&scene, 0);
    let shot = shoot(gpu, &scene, Some(&baked(&scene, 0.5, 8)?), &Knobs { rsm: 256, ..small() })?;
    let flux: DVec3 = shot.vals.iter().map(|v| v.flux).sum();
    let light = &scene.lights[0];
    // For a sharp cone the squared ramp of KHR_lights_punctual is 0.001 wide in the cosine: two thirds of it are lost.
    let cone = TAU * (1.0 - f64::from(0.3_f32).cos() - 0.001 * 2.0 / 3.0);
    let entering = light.color.as_dvec3() * f64::from(light.intensity) * cone;
    let off = flux.distance(albedo * entering) / flux.length();
    let [diffuse, glossy] = sums_against_twins(&scene, &shot);
    let errors = [("flux", off, 3e-4), ("diffuse", diffuse, 5e-5), ("glossy", glossy, 5e-5)];
    Ok(Outcome::all(errors).of(&[&shot]).provided(shot.vals.len() == 65_536, "another count of VALs"))
}

/// A VAL straight above the cache and facing it. If it lies on the cache, another one provides the light.
fn touching(gpu: &Gpu, height: f64) -> Result<Outcome> {
    let (area, flux) = (0.01, vec3(5.0, 3.0, 1.0));
    let near = disc(vec3(0.0, 0.0, height as f32), Vec3::NEG_Z, area, flux);
    let far = disc(vec3(0.5, 0.0, 1.0), Vec3::NEG_Z, area, flux);
    let vals = if height > 0.0 { vec![near] } else { vec![near, far] };
    let found = gather_alone(gpu, &vals, &[CACHE])?;
    let geometry = match height > 0.0 {
        true => 1.0 / f64::from(area).max(PI * height * height),
        false => 1.0 / (1.25 * f64::from(area).max(PI * 1.25)),
    };
    let expected = flux.as_dvec3() * geometry;
    let error = { found.sums[0].diffuse_irradiance }.as_dvec3().distance(expected) / expected.length();
    let mut outcome =
        Outcome::bounded(error, 1e-6).provided(found.proxies[0].diffuse_distance2 > 0.0, "the cache is unlit");
    outcome.complaints.extend(found.complaints);
    Ok(outcome)
}

fn grazing(gpu: &Gpu, sine: f32) -> Result<Outcome> {
    let mut next = numbers(5);
    let mut one = |_| {
        let (sin, cos) = (TAU as f32 * next()).sin_cos();
        let out = vec3(cos, sin, 0.0);
        disc(out + sine * Vec3::Z, -out, 0.01, Vec3::splat(10.0 * next()))
    };
    let vals: Vec<Val> = (0..50).map(&mut one).collect();
    let found = gather_alone(gpu, &vals, &[CACHE])?;
    let [diffuse, glossy] = sum_errors(&vals, &[CACHE], &found);
    let (all, proxy) = (found.sums[0].diffuse_irradiance, found.proxies[0]);
    let most = all.as_dvec3() / LEAST_COSINE * (1.0 + 1e-6);
    let bounded = [proxy.diffuse_irradiance, proxy.glossy_irradiance].map(|i| i.as_dvec3().cmple(most).all());
    let mut outcome = Outcome::all([("diffuse", diffuse, 1e-5), ("glossy", glossy, 1e-5)]);
    outcome.pass &= bounded == [true; 2];
    outcome.complaints = found.complaints;
    Ok(outcome.provided(all.min_element() > 0.0, "no light"))
}

fn behind(gpu: &Gpu) -> Result<Outcome> {
    let mut vals = some_vals(1000);
    for val in &mut vals {
        let Vec3 { x, y, z } = val.position;
        // Below all of them and their planes, which are tilted by up to 35 degrees.
        (val.position, val.normal) = (vec3(x, y, -z - 4.0), Vec3::Z);
    }
    let found = gather_alone(gpu, &vals, &some_caches(64, 10.0))?;
    let parts = |s: &GatherSums| -> [f32; 16] { bytemuck::cast(*s) };
    let light = found.sums.iter().flat_map(parts).map(|part| f64::from(part.abs())).fold(0.0, f64::max);
    let lit = found.proxies.iter().filter(|p| p.diffuse_distance2 + p.glossy_distance2 > 0.0).count();
    let mut outcome = Outcome::all([("largest sum", light, 0.0), ("lit proxies", lit as f64, 0.0)]);
    outcome.complaints = found.complaints;
    Ok(outcome)
}
