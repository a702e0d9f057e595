//! Invariants on the device for all weights (METHOD 4): whole frames compared with each other.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::frame::Interpolation;
use lightskin::lab::hard_cases::difference;
use lightskin::lab::knobs::Knobs;
use lightskin::lab::worlds::one_cache;
use lightskin::reference::gather::{Gathered, Lobe};
use lightskin::reference::phong::cos_power;
use lightskin::scene::build::quad;
use lightskin::scene::{LightKind, Scene};

use crate::common::frames::{SPOT, Shot, add, baked, camera, corner, lamp, phong, placed, shoot, small};
use crate::common::{gpu, rounding};
use crate::gather::WEIGHTS;

const SCHEMES: [Interpolation; 2] = [Interpolation::Facing, Interpolation::Printed];

/// Knobs with every proxy weight and every interpolation.
fn variants() -> impl Iterator<Item = Knobs> {
    let of = |(weight, _)| SCHEMES.map(|s| Knobs { proxy_weight: weight, interpolation: s, ..small() });
    WEIGHTS.into_iter().flat_map(of)
}

/// Sums in another order move proxies by 1e-6 of their distance. A lobe of exponent 40 amplifies this by up to k tan, a
/// hundredfold and more where it is dark. Reflectances are 16-bit floats: the last bit is 1e-3 of the number and may
/// flip.
const ROUNDED: [f64; 5] = [1e-3, 1e-3, 1e-3, 1e-4, 2e-5];

fn lobes(gathered: &Gathered) -> [&Lobe; 2] {
    [&gathered.diffuse, &gathered.glossy]
}

/// Largest relative differences between two frames, where the second should have `factor` times the radiance of the
/// first: the three images, facing irradiances, and positions of proxies relative to their distance. `place` maps the
/// second frame's positions to the first's.
fn differences(a: &Shot, b: &Shot, factor: f64, place: impl Fn(DVec3) -> DVec3) -> [f64; 5] {
    let (mut brighter, mut moved) = (0.0_f64, 0.0_f64);
    assert_eq!(a.caches.len(), b.caches.len());
    for ((a, b), cache) in a.proxies.iter().zip(&b.proxies).zip(&a.caches) {
        for (a, b) in lobes(a).into_iter().zip(lobes(b)) {
            assert_eq!(a.lit, b.lit);
            if a.lit {
                let light = a.facing_irradiance.length().max(1e-12);
                brighter = brighter.max((b.facing_irradiance / factor).distance(a.facing_irradiance) / light);
                moved = moved.max(place(b.position).distance(a.position) / a.position.distance(cache.position));
            }
        }
    }
    let image = |of: fn(&Shot) -> &[DVec3]| {
        assert!(of(a).iter().any(|p| *p != DVec3::ZERO), "the image is dark");
        difference(of(a), of(b), factor)
    };
    [image(|s| &s.direct), image(|s| &s.diffuse), image(|s| &s.glossy), brighter, moved]
}

#[track_caller]
fn assert_below(differences: [f64; 5], bounds: [f64; 5], what: &str) {
    eprintln!("{what}: {differences:?}");
    assert!(differences.iter().zip(bounds).all(|(d, bound)| *d <= bound), "{what}: {differences:?}, not {bounds:?}");
}

#[test]
fn one_val_alone_is_reproduced_exactly() {
    let gpu = gpu();
    for (settings, k) in variants().flat_map(|s| [(s, 1.0), (s, 40.0)]) {
        let scene = corner(&[SPOT], k);
        let shot = shoot(&gpu, &scene, Some(&baked(&scene, 0.5, 8)), &Knobs { rsm: 1, ..settings });
        let [val] = shot.vals[..] else { panic!("one VAL") };
        let mut lit = 0;
        for (cache, proxies) in shot.caches.iter().zip(&shot.proxies) {
            let d = val.position - cache.position;
            let cosine = cache.normal.dot(d.normalize());
            let sent = val.normal.dot(-d.normalize());
            if sent.min(cosine).abs() > 1e-5 {
                assert_eq!(proxies.diffuse.lit, sent > 0.0 && cosine > 0.0, "a cache at {}", cache.position);
            }
            let emitted = sent.max(0.0) / val.area.max(0.5 * TAU * d.length_squared());
            // Below 1e-30 the lobe is too small to divide by, and it reflects no light, either.
            let lobe = cos_power(k.into(), proxies.mirrored_view.dot(d.normalize()));
            let glossy = proxies.glossy.lit && lobe > 1e-29;
            for lobe in lobes(proxies).into_iter().filter(|l| l.lit).take(1 + usize::from(glossy)) {
                lit += 1;
                // The quotient of the sums is the VAL's position. Both cosines cancel, except for rounding.
                assert!(lobe.position.distance(val.position) <= 1e-6 * d.length(), "{lobe:?} is not at {val:?}");
                let facing = val.flux * emitted;
                // The VAL's cosine is in both, each with its own rounding.
                let bound = (2e-6 + 4e-7 / cosine + 4e-7 / sent + 2e-6 * f64::from(k)) * facing.length();
                assert!(lobe.facing_irradiance.distance(facing) <= bound, "{lobe:?} instead of {facing}");
            }
        }
        println!("{lit} lit lobes at {} caches", shot.caches.len());
        assert!(lit > 50, "{lit} lit lobes");
    }
}

#[test]
fn brighter_lights_move_no_proxy() {
    let gpu = gpu();
    let scene = corner(&[SPOT, LightKind::Point], 40.0);
    let caches = baked(&scene, 0.5, 8);
    for settings in variants() {
        let once = shoot(&gpu, &scene, Some(&caches), &settings);
        // A factor of two does not change rounding. A factor of a million changes nothing but rounding.
        for (factor, bounds) in [(2.0_f32, [0.0; 5]), (1e6, ROUNDED), (1e-6, ROUNDED)] {
            let mut brighter = scene.clone();
            brighter.lights.iter_mut().for_each(|light| light.intensity *= factor);
            let shot = shoot(&gpu, &brighter, Some(&caches), &settings);
            // Dark lobes multiply what a GPU rounds.
            let mut bounds: [f64; 5] = bounds;
            bounds[3] *= if rounding(&gpu) > 1.0 { 100.0 } else { 1.0 };
            assert_below(differences(&once, &shot, factor.into(), |p| p), bounds, &format!("times {factor}"));
        }
    }
}

fn all_lights() -> Scene {
    let mut scene = corner(&[SPOT, LightKind::Point, LightKind::Directional], 40.0);
    scene.lights[1].range = Some(6.0);
    scene
}

#[test]
fn scaling_the_scene_changes_no_pixel() {
    let gpu = gpu();
    let scene = all_lights();
    let caches = baked(&scene, 0.5, 8);
    for settings in variants() {
        let one = shoot(&gpu, &scene, Some(&caches), &settings);
        // Powers of two round alike, so any constant with a unit shows.
        let exact = [1e-6; 5];
        for (scale, bounds) in [(2_f64.powi(-10), exact), (2_f64.powi(10), exact), (1e-3, ROUNDED), (1e3, ROUNDED)] {
            let shot = shoot(&gpu, &placed(&scene, scale, DVec3::ZERO), Some(&caches), &settings);
            assert_below(differences(&one, &shot, 1.0, |p| p / scale), bounds, &format!("scale {scale}"));
        }
    }
}

#[test]
fn moving_the_scene_by_ten_kilometres_changes_no_pixel() {
    let gpu = gpu();
    let scene = all_lights();
    let caches = baked(&scene, 0.5, 8);
    let shift = dvec3(1e4, -1e4, 1e4);
    for settings in variants() {
        let here = shoot(&gpu, &scene, Some(&caches), &settings);
        let there = shoot(&gpu, &placed(&scene, 1.0, shift), Some(&caches), &settings);
        // f64 rounds 17 km at 2e-12 m, which may change the last bit of an f32.
        assert_below(differences(&here, &there, 1.0, |p| p - shift), ROUNDED, "10 km");
    }
}

#[test]
fn order_of_lights_changes_nothing_but_rounding() {
    let gpu = gpu();
    let scene = corner(&[SPOT, LightKind::Point], 40.0);
    let mut other = scene.clone();
    other.lights.reverse();
    let caches = baked(&scene, 0.5, 8);
    for settings in variants() {
        let [a, b] = [&scene, &other].map(|scene| shoot(&gpu, scene, Some(&caches), &settings));
        assert_below(differences(&a, &b, 1.0, |p| p), ROUNDED, "two lights");
    }
}

/// A lit floor with nothing above it, turned so that no axis is special.
fn bare_floor() -> Scene {
    let mut scene = Scene::default();
    let turn = DAffine3::from_axis_angle(dvec3(0.3, 0.2, 1.0).normalize(), 0.4);
    let surface = quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 0.5);
    add(&mut scene, surface, phong([0.7; 3], [0.2; 3], 20.0), turn);
    scene.lights.push(lamp(LightKind::Point));
    scene.cameras.push(camera(dvec3(1.0, 2.0, 2.0), DVec3::ZERO, 0.9));
    scene
}

#[track_caller]
fn assert_dark(shot: &Shot) {
    assert!(!shot.caches.is_empty() && shot.vals.iter().any(|val| val.flux != DVec3::ZERO));
    for lobe in shot.proxies.iter().flat_map(lobes) {
        assert!(!lobe.lit, "{lobe:?} is lit");
        assert!(lobe.facing_irradiance == DVec3::ZERO && lobe.position.is_finite(), "{lobe:?}");
    }
    assert!(shot.diffuse.iter().chain(&shot.glossy).all(|radiance| *radiance == DVec3::ZERO));
    assert!(shot.direct.iter().any(|radiance| *radiance != DVec3::ZERO));
}

#[test]
fn a_flat_surface_is_not_lit_by_itself() {
    let gpu = gpu();
    let scene = bare_floor();
    for settings in variants() {
        assert_dark(&shoot(&gpu, &scene, Some(&baked(&scene, 0.5, 8)), &settings));
    }
}

#[test]
fn caches_with_all_vals_behind_them_are_dark() {
    let gpu = gpu();
    // The lit floor is below the floor with the caches, and both face up.
    let mut scene = bare_floor();
    scene.instances[0].world_from_model = DAffine3::IDENTITY;
    let surface = quad(vec3(1.5, 0.5, -1.0), Vec3::Z * 2.0, Vec3::X * 0.5, 0.5);
    add(&mut scene, surface, phong([0.7; 3], [0.2; 3], 20.0), DAffine3::IDENTITY);
    for settings in variants() {
        assert_dark(&shoot(&gpu, &scene, Some(&baked(&scene, 0.5, 8)), &settings));
    }
}

#[test]
fn one_cache_lights_its_whole_surface_and_no_other() {
    let gpu = gpu();
    let scene = corner(&[SPOT], 10.0);
    for (settings, references) in variants().flat_map(|s| [8, 16].map(|references| (s, references))) {
        // In the middle of a face, and on a vertex, where the farthest cache has the distance 0.
        for position in [vec3(0.1, 0.0, 0.2), vec3(0.0, 0.0, 0.0)] {
            let shot = shoot(&gpu, &scene, Some(&one_cache(&scene, references, position, Vec3::Y)), &settings);
            assert!(shot.caches.len() == 1 && shot.proxies[0].diffuse.lit);
            assert!(shot.diffuse.iter().chain(&shot.glossy).all(|r| r.is_finite() && r.min_element() >= 0.0));
            let lit = shot.diffuse.iter().filter(|r| **r != DVec3::ZERO).count();
            assert!(lit > 200 && lit < shot.diffuse.len() / 2, "{lit} pixels lit");
        }
    }
}

#[test]
fn a_cache_that_lies_on_a_val_is_lit_by_the_others() {
    let gpu = gpu();
    // One texel looks straight down and hits the floor at the cache: the distance is exactly 0. The scene in
    // millimetres also has small VALs. Another texel hits the wall.
    let narrow = LightKind::Spot { inner: 0.01, outer: 0.02 };
    for scale in [1.0, 2_f64.powi(-10)] {
        let mut scene = corner(&[narrow, narrow], 10.0);
        scene.lights.iter_mut().for_each(|light| light.position = dvec3(0.625, 1.0, 0.375));
        scene.lights[0].direction = Vec3::NEG_Y;
        scene.lights[1].direction = Vec3::NEG_X;
        let scene = placed(&scene, scale, DVec3::ZERO);
        for settings in variants().map(|settings| Knobs { rsm: 1, ..settings }) {
            // Put the cache where the device found the VAL.
            let caches = |position: DVec3| one_cache(&scene, 8, (position / scale).as_vec3(), Vec3::Y);
            let under = shoot(&gpu, &scene, Some(&caches(DVec3::ZERO)), &settings).vals[0].position;
            let shot = shoot(&gpu, &scene, Some(&caches(under)), &settings);
            assert_eq!(shot.vals[0].position, shot.caches[0].position);
            let lobe = shot.proxies[0].diffuse;
            let off = lobe.position.distance(shot.vals[1].position);
            assert!(lobe.lit && off < 1e-5 * scale, "{lobe:?} instead of one at {:?}", shot.vals[1]);
        }
    }
}
