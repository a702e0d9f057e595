//! Proxies and their interpolation: the invariants of METHOD section 4 for all weights, and the cases of section 5.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, dvec3};
use lightskin::reference::brute_force;
use lightskin::reference::gather::{Cache, Gathered, LEAST_COSINE, Lobe, ProxyWeight, gather, val_geometry};
use lightskin::reference::interpolate::{Scheme, falloff, interpolate, kernel, shade};
use lightskin::reference::phong::{Material, mirrored_view};
use lightskin::reference::rsm::Val;

use crate::analytic::{ROUNDING, assert_near3, numbers};

const WEIGHTS: [ProxyWeight; 2] = [ProxyWeight::Irradiance, ProxyWeight::FormFactor];
const SCHEMES: [Scheme; 2] = [Scheme::Facing, Scheme::Printed];

/// Coloured VALs above the plane z = 0.3, with different areas, facing roughly down.
fn some_vals(count: usize) -> Vec<Val> {
    let mut next = numbers(7);
    let mut val = || Val {
        position: dvec3(4.0 * next() - 2.0, 4.0 * next() - 2.0, 0.3 + 2.0 * next()),
        area: 0.001 + 0.1 * next(),
        normal: dvec3(next() - 0.5, next() - 0.5, -1.0).normalize(),
        flux: dvec3(next(), next(), next()) * 10.0,
    };
    (0..count).map(|_| val()).collect()
}

const EYE: DVec3 = dvec3(-1.5, 0.4, 2.0);

/// Caches near the origin with normals around +z. The last cache faces down and gets no light.
fn some_caches() -> Vec<Cache> {
    let mut caches: Vec<Cache> = [(0.0, 0.0), (0.3, 0.1), (-0.2, 0.3), (0.1, -0.4)]
        .map(|(x, y)| Cache { position: dvec3(x, y, 0.0), normal: dvec3(x, y, 2.0).normalize(), exponent: 30.0 })
        .to_vec();
    caches.push(Cache { position: dvec3(0.2, 0.2, -0.1), normal: DVec3::NEG_Z, exponent: 30.0 });
    caches
}

const MATERIAL: Material = Material { diffuse: dvec3(0.8, 0.4, 0.0), specular: dvec3(0.1, 0.0, 0.3), exponent: 30.0 };

/// Radiance at `x`, interpolated from `caches` after a gather.
fn render(x: DVec3, caches: &[Cache], vals: &[Val], eye: DVec3, weight: ProxyWeight, scheme: Scheme) -> (DVec3, DVec3) {
    let references: Vec<(Cache, Gathered)> =
        caches.iter().map(|cache| (*cache, gather(cache, vals, Some(eye), weight))).collect();
    let mirrored = mirrored_view(x, DVec3::Z, eye);
    shade(&interpolate(x, DVec3::Z, mirrored, &references, scheme), x, DVec3::Z, mirrored, &MATERIAL)
}

/// Every combination of proxy weight and interpolation scheme.
fn variants() -> impl Iterator<Item = (ProxyWeight, Scheme)> {
    WEIGHTS.into_iter().flat_map(|weight| SCHEMES.map(|scheme| (weight, scheme)))
}

// Proxies (METHOD 4).

#[test]
fn one_val_alone_is_reproduced_exactly_by_a_proxy_on_it() {
    for (val, weight) in some_vals(40).into_iter().flat_map(|val| WEIGHTS.map(|weight| (val, weight))) {
        let cache = some_caches()[1];
        let gathered = gather(&cache, &[val], Some(EYE), weight);
        if !gathered.diffuse.lit {
            continue;
        }
        assert_near3(gathered.diffuse.position, val.position, ROUNDING);
        let light =
            interpolate(cache.position, cache.normal, gathered.mirrored_view, &[(cache, gathered)], Scheme::Facing);
        let (diffuse, glossy) = shade(&light, cache.position, cache.normal, gathered.mirrored_view, &MATERIAL);
        let (true_diffuse, true_glossy) =
            brute_force::radiance(cache.position, cache.normal, gathered.mirrored_view, &MATERIAL, &[val]);
        assert_near3(diffuse, true_diffuse, ROUNDING);
        assert_near3(glossy, true_glossy, ROUNDING);
        if gathered.glossy.lit {
            assert_near3(gathered.glossy.position, val.position, ROUNDING);
        }
    }
}

#[test]
fn proxies_of_many_vals_reproduce_the_radiance_at_their_cache() {
    let vals = some_vals(500);
    for (cache, weight) in some_caches()[..4].iter().flat_map(|cache| WEIGHTS.map(|weight| (cache, weight))) {
        let gathered = gather(cache, &vals, Some(EYE), weight);
        for scheme in SCHEMES {
            let light =
                interpolate(cache.position, cache.normal, gathered.mirrored_view, &[(*cache, gathered)], scheme);
            let shaded = shade(&light, cache.position, cache.normal, gathered.mirrored_view, &MATERIAL);
            let truth = brute_force::radiance(cache.position, cache.normal, gathered.mirrored_view, &MATERIAL, &vals);
            assert_near3(shaded.0, truth.0, ROUNDING);
            assert_near3(shaded.1, truth.1, ROUNDING);
        }
    }
}

#[test]
fn doubling_the_light_doubles_flux_and_moves_no_proxy() {
    let vals = some_vals(100);
    let doubled: Vec<Val> = vals.iter().map(|val| Val { flux: 2.0 * val.flux, ..*val }).collect();
    let cache = some_caches()[0];
    for weight in WEIGHTS {
        let (once, twice) = (gather(&cache, &vals, Some(EYE), weight), gather(&cache, &doubled, Some(EYE), weight));
        for (once, twice) in [(once.diffuse, twice.diffuse), (once.glossy, twice.glossy)] {
            assert_eq!(once.position, twice.position); // exact: a factor of two does not change rounding
            assert_eq!(2.0 * once.flux(&cache), twice.flux(&cache));
        }
    }
}

#[test]
fn scaling_the_scene_changes_no_pixel() {
    let (vals, caches, x) = (some_vals(100), some_caches(), dvec3(0.07, 0.05, 0.0));
    for ((weight, scheme), s) in variants().flat_map(|variant| [(variant, 1e-3), (variant, 1e3)]) {
        let scale =
            |val: &Val| Val { position: s * val.position, area: s * s * val.area, flux: s * s * val.flux, ..*val };
        let scaled_vals: Vec<Val> = vals.iter().map(scale).collect();
        let scaled_caches: Vec<Cache> =
            caches.iter().map(|cache| Cache { position: s * cache.position, ..*cache }).collect();
        let expected = render(x, &caches, &vals, EYE, weight, scheme);
        let actual = render(s * x, &scaled_caches, &scaled_vals, s * EYE, weight, scheme);
        assert_near3(actual.0, expected.0, ROUNDING);
        assert_near3(actual.1, expected.1, ROUNDING);
    }
}

#[test]
fn moving_the_scene_by_10_km_changes_no_pixel() {
    let (vals, caches, x) = (some_vals(100), some_caches(), dvec3(0.07, 0.05, 0.0));
    let far = dvec3(1e4, -7e3, 3e3);
    let moved_vals: Vec<Val> = vals.iter().map(|val| Val { position: val.position + far, ..*val }).collect();
    let moved_caches: Vec<Cache> =
        caches.iter().map(|cache| Cache { position: cache.position + far, ..*cache }).collect();
    for (weight, scheme) in variants() {
        let expected = render(x, &caches, &vals, EYE, weight, scheme);
        let actual = render(x + far, &moved_caches, &moved_vals, EYE + far, weight, scheme);
        // Positions round at 1e-12 m, which is 3e-12 of the shortest distances. The exponent multiplies this by 30.
        assert_near3(actual.0, expected.0, ROUNDING);
        assert_near3(actual.1, expected.1, ROUNDING);
    }
}

#[test]
fn an_unlit_cache_is_dark_finite_and_drags_no_position() {
    let (vals, caches) = (some_vals(100), some_caches());
    let (lit, unlit) = (caches[0], caches[4]);
    for (weight, scheme) in variants() {
        let [a, b] = [lit, unlit].map(|cache| (cache, gather(&cache, &vals, Some(EYE), weight)));
        let position = unlit.position + unlit.normal;
        let dark = Lobe { position, facing_irradiance: DVec3::ZERO, lit: false, distance2: 0.0 };
        assert_eq!((b.1.diffuse, b.1.glossy), (dark, dark));
        // A point halfway, with a normal that gives both caches weight. A third cache far away only sets the scale.
        let x = 0.5 * (lit.position + unlit.position);
        let normal = dvec3(1.0, 1.0, 0.0).normalize();
        let far = Cache { position: dvec3(0.0, 3.0, 0.0), ..unlit };
        let references = [a, b, (far, gather(&far, &vals, Some(EYE), weight))];
        let light = interpolate(x, normal, mirrored_view(x, normal, EYE), &references, scheme);
        assert!(light.has_diffuse && light.has_glossy);
        assert_near3(light.diffuse_position, a.1.diffuse.position, ROUNDING);
        assert_near3(light.glossy_position, a.1.glossy.position, ROUNDING);
        let only_dark = interpolate(x, normal, DVec3::X, &references[1..], scheme);
        assert!(!only_dark.has_diffuse && !only_dark.has_glossy && only_dark.diffuse_position.is_finite());
        assert_eq!(shade(&only_dark, x, normal, DVec3::X, &MATERIAL), (DVec3::ZERO, DVec3::ZERO));
    }
}

#[test]
fn an_unlit_cache_darkens_the_diffuse_lobe_but_not_the_glossy_one() {
    let (vals, caches) = (some_vals(100), some_caches());
    let lit = (caches[0], gather(&caches[0], &vals, Some(EYE), ProxyWeight::Irradiance));
    let mut unlit = lit;
    unlit.0.position += 0.2 * DVec3::X;
    unlit.1.diffuse = Lobe { facing_irradiance: DVec3::ZERO, lit: false, ..lit.1.diffuse };
    unlit.1.glossy = Lobe { facing_irradiance: DVec3::ZERO, lit: false, ..lit.1.glossy };
    // Both references are at the same distance. All other weights vanish, so both have equal weight by distance alone.
    let x = lit.0.position + 0.1 * DVec3::X;
    let light = interpolate(x, DVec3::Z, lit.1.mirrored_view, &[lit, unlit], Scheme::Facing);
    let Lobe { position, facing_irradiance, distance2, .. } = lit.1.diffuse;
    let left = falloff(distance2, position.distance_squared(lit.0.position), position.distance_squared(x));
    assert_near3(light.diffuse_irradiance, 0.5 * left * facing_irradiance, ROUNDING);
    assert_near3(light.glossy_irradiance, lit.1.glossy.facing_irradiance, ROUNDING);
}

#[test]
fn light_falls_off_as_the_root_of_the_mean_squared_distance_of_its_vals() {
    let (cache, vals) = (some_caches()[0], some_vals(30));
    let lobe = gather(&cache, &vals, None, ProxyWeight::FormFactor).diffuse;
    let mean_squared = |point: DVec3| {
        let weight = |val: &Val| val.area * val_geometry(cache.position, cache.normal, val).0;
        let sum: f64 = vals.iter().map(|val| weight(val) * val.position.distance_squared(point)).sum();
        sum / vals.iter().map(weight).sum::<f64>()
    };
    for x in [cache.position, dvec3(0.5, 0.2, 0.0), dvec3(-3.0, 1.0, 2.0)] {
        let there = lobe.position.distance_squared(cache.position);
        let left = falloff(lobe.distance2, there, lobe.position.distance_squared(x));
        let expected = (mean_squared(cache.position) / mean_squared(x)).sqrt();
        assert!((left - expected).abs() < ROUNDING * expected, "{left} instead of {expected}");
    }
    assert_eq!(falloff(1.0, 1.0, 0.0), 4.0); // at the position of a single VAL
}

#[test]
fn proxies_that_the_lobe_does_not_see_neither_drag_nor_brighten_the_glossy_light() {
    // Two caches far apart with one VAL each. The point between them looks at the first VAL.
    let caches = [-1.0, 1.0].map(|x| Cache { position: dvec3(x, 0.0, 0.0), normal: DVec3::Z, exponent: 80.0 });
    let places = [dvec3(0.0, 0.0, 2.0), dvec3(2.5, 0.0, 1.0)];
    let val =
        |i: usize| Val { position: places[i], area: 0.01, normal: DVec3::NEG_Z, flux: DVec3::splat([1.0, 50.0][i]) };
    let [seen, unseen] = [0, 1].map(|i| {
        // The mirrored direction of this eye points at the VAL.
        let eye = 2.0 * caches[i].position - places[i] + 2.0 * places[i].z * DVec3::Z;
        (caches[i], gather(&caches[i], &[val(i)], Some(eye), ProxyWeight::Irradiance))
    });
    let light = interpolate(DVec3::ZERO, DVec3::Z, DVec3::Z, &[seen, unseen], Scheme::Facing);
    assert_near3(light.glossy_position, places[0], 1e-9);
    let (bright, other) = (seen.1.glossy.facing_irradiance, unseen.1.glossy.facing_irradiance);
    assert!(other.min_element() > bright.max_element(), "the unseen light must be the brighter one");
    let share = (0.5 * light.glossy_irradiance / (0.25 * bright)).x;
    assert!((1.0..1.1).contains(&share), "{share} of the seen light's half");
    // If the lobe sees neither, the light lies between them and is no brighter than their mean.
    let behind = interpolate(DVec3::ZERO, DVec3::Z, DVec3::NEG_Z, &[seen, unseen], Scheme::Facing);
    assert_near3(behind.glossy_position, 0.5 * (places[0] + places[1]), ROUNDING);
    assert_near3(behind.glossy_irradiance, 0.5 * (bright + other), ROUNDING);
}

#[test]
fn what_is_no_val_has_no_weight() {
    let (vals, cache) = (some_vals(20), some_caches()[0]);
    for weight in WEIGHTS {
        let with = gather(&cache, &[vals.clone(), vec![Val::NOTHING; 9]].concat(), Some(EYE), weight);
        assert_eq!(with, gather(&cache, &vals, Some(EYE), weight));
        let nothing = gather(&Cache { position: DVec3::ZERO, ..cache }, &[Val::NOTHING], Some(EYE), weight);
        assert!(!nothing.diffuse.lit && !nothing.glossy.lit);
    }
}

#[test]
fn a_cache_on_a_val_gets_nothing_from_it_and_just_above_no_more_than_it_sends() {
    let cache = some_caches()[0];
    let vals = some_vals(20);
    let under = Val { position: cache.position, area: 0.01, normal: cache.normal, flux: DVec3::splat(5.0) };
    for weight in WEIGHTS {
        let without = gather(&cache, &vals, Some(EYE), weight);
        let with = gather(&cache, &[vals.clone(), vec![under]].concat(), Some(EYE), weight);
        assert_eq!(with, without);
        for height in [1e-3, 1e-6, 1e-9, 1e-12, 1e-300] {
            let facing = Val { position: cache.position + height * DVec3::Z, normal: DVec3::NEG_Z, ..under };
            let gathered = gather(&cache, &[facing], Some(EYE), weight);
            for lobe in [gathered.diffuse, gathered.glossy] {
                assert!(lobe.position.is_finite() && lobe.flux(&cache).is_finite());
                let bound = facing.flux / facing.area * (1.0 + ROUNDING);
                assert!(lobe.facing_irradiance.cmple(bound).all(), "{height} m: {lobe:?}");
            }
        }
        // A VAL at the same position without area: 0/0 twice.
        let point = Val { area: 0.0, normal: DVec3::NEG_Z, ..under };
        assert!(!gather(&cache, &[point], Some(EYE), weight).diffuse.lit);
    }
}

#[test]
fn permuting_vals_moves_proxies_only_within_rounding() {
    let (vals, cache) = (some_vals(1000), some_caches()[2]);
    let mut permuted = vals.clone();
    permuted.reverse();
    permuted.rotate_left(313);
    for weight in WEIGHTS {
        let (a, b) = (gather(&cache, &vals, Some(EYE), weight), gather(&cache, &permuted, Some(EYE), weight));
        for (a, b) in [(a.diffuse, b.diffuse), (a.glossy, b.glossy)] {
            assert_near3(a.position, b.position, ROUNDING);
            assert_near3(a.facing_irradiance, b.facing_irradiance, ROUNDING);
        }
    }
}

#[test]
fn grazing_vals_leave_flux_finite_and_bounded() {
    let cache = some_caches()[0];
    let mut next = numbers(3);
    for (height, weight) in [1e-2, 1e-5, 1e-9, 1e-300].into_iter().flat_map(|h| WEIGHTS.map(|weight| (h, weight))) {
        let mut ring = |_| {
            let (sin, cos) = (TAU * next()).sin_cos();
            let out = dvec3(cos, sin, 0.0);
            Val { position: out + height * DVec3::Z, area: 0.01, normal: -out, flux: DVec3::splat(10.0 * next()) }
        };
        let vals: Vec<Val> = (0..50).map(&mut ring).collect();
        let gathered = gather(&cache, &vals, Some(EYE), weight);
        let bound = brute_force::irradiance(cache.position, cache.normal, &vals) / LEAST_COSINE * (1.0 + ROUNDING);
        for lobe in [gathered.diffuse, gathered.glossy] {
            assert!(lobe.position.is_finite() && lobe.flux(&cache).is_finite());
            assert!(lobe.facing_irradiance.cmple(bound).all());
        }
        // A single VAL is exact, unless its cosine is below the smallest cosine.
        let one = gather(&cache, &vals[..1], None, weight).diffuse;
        if height > LEAST_COSINE {
            let facing = vals[0].flux * (1.0 / (1.0 + height * height).sqrt()) / (PI * (1.0 + height * height));
            assert_near3(one.facing_irradiance, facing, ROUNDING);
        }
    }
}

#[test]
fn glossy_flux_is_bounded_by_all_the_light_that_arrives() {
    // A tiny bright VAL in the middle of the lobe, and a wide black one 30 degrees off. With form-factor weights the
    // proxy lies on the black VAL, where cos^k is 0.056. Without the bound, 18 times the light would leave.
    let cache = Cache { position: DVec3::ZERO, normal: DVec3::Z, exponent: 20.0 };
    let aside = dvec3(0.5, 0.0, f64::sqrt(3.0) / 2.0);
    let bright = Val { position: DVec3::Z, area: 1e-6, normal: DVec3::NEG_Z, flux: DVec3::splat(10.0) };
    let black = Val { position: aside, area: 1.0, normal: -aside, flux: DVec3::ZERO };
    let gathered = gather(&cache, &[bright, black], Some(2.0 * DVec3::Z), ProxyWeight::FormFactor);
    let arriving = brute_force::irradiance(cache.position, cache.normal, &[bright]);
    assert!(gathered.glossy.position.distance(aside) < 1e-3);
    assert_near3(gathered.glossy.facing_irradiance, arriving / aside.z, 1e-3);
    // The bound also holds for a sharp lobe without a VAL near its axis.
    for (weight, exponent) in WEIGHTS.into_iter().flat_map(|weight| [30.0, 300.0, 2048.0].map(|k| (weight, k))) {
        let (cache, vals) = (Cache { exponent, ..cache }, some_vals(200));
        let lobe = gather(&cache, &vals, Some(dvec3(9.0, 0.0, 0.1)), weight).glossy;
        let bound = brute_force::irradiance(cache.position, cache.normal, &vals) / LEAST_COSINE;
        assert!(lobe.position.is_finite() && lobe.facing_irradiance.cmple(bound).all());
    }
}

#[test]
fn black_channels_stay_black() {
    let cache = some_caches()[0];
    let red: Vec<Val> = some_vals(50).into_iter().map(|val| Val { flux: val.flux.x * DVec3::X, ..val }).collect();
    for (weight, scheme) in variants() {
        let (diffuse, glossy) = render(cache.position, &[cache], &red, EYE, weight, scheme);
        assert!(diffuse.x > 0.0 && glossy.x > 0.0);
        assert_eq!([diffuse.y, diffuse.z, glossy.y, glossy.z], [0.0; 4]);
    }
}

// Interpolation (METHOD 5).

#[test]
fn at_a_cache_of_its_own_the_radiance_is_the_caches() {
    let vals = some_vals(100);
    let gathered = |cache: &Cache| (*cache, gather(cache, &vals, Some(EYE), ProxyWeight::Irradiance));
    let own = gathered(&some_caches()[1]);
    let radiance = |references: &[(Cache, Gathered)], scheme| {
        let (x, normal, mirrored) = (own.0.position, own.0.normal, own.1.mirrored_view);
        shade(&interpolate(x, normal, mirrored, references, scheme), x, normal, mirrored, &MATERIAL)
    };
    let truth = brute_force::radiance(own.0.position, own.0.normal, own.1.mirrored_view, &MATERIAL, &vals);
    for scheme in SCHEMES {
        // The farthest reference has no weight. With two references this is the other one.
        let (diffuse, glossy) = radiance(&[own, gathered(&some_caches()[2])], scheme);
        assert_near3(diffuse, truth.0, ROUNDING);
        assert_near3(glossy, truth.1, ROUNDING);
    }
    // Nearer references keep about 1e-3 / t^2 of the kernel's weight. At half of the farthest distance this is a
    // thousandth each.
    let others: Vec<_> = [own].into_iter().chain(some_caches().iter().map(gathered).filter(|c| c.0 != own.0)).collect();
    let (diffuse, glossy) = radiance(&others, Scheme::Facing);
    assert_near3(diffuse, truth.0, 3e-3);
    assert_near3(glossy, truth.1, 1e-2);
}

#[test]
fn kernels_are_the_ones_given() {
    for (t, cos) in [(0.0, 1.0), (0.5, 0.3), (0.9, 0.9), (1.0, 1.0), (0.2, -0.5)] {
        let c = f64::max(cos, 0.0);
        let facing = (1.0 - t) * (1.0 - t) * c * c * c * c / (t * t + 1e-3);
        assert!((kernel(Scheme::Facing, t, cos) - facing).abs() <= ROUNDING * facing);
        assert!((kernel(Scheme::Printed, t, cos) - (1.0 - t) * f64::sqrt(c)).abs() <= ROUNDING);
    }
}

#[test]
fn where_all_weights_vanish_distance_alone_decides() {
    let vals = some_vals(100);
    let one = some_caches()[0];
    let gathered = gather(&one, &vals, Some(EYE), ProxyWeight::Irradiance);
    for scheme in SCHEMES {
        // A single cache is its own farthest reference. Perpendicular normals make all weights vanish as well.
        for (x, normal) in
            [(dvec3(0.1, 0.0, 0.0), DVec3::Z), (dvec3(0.1, 0.0, 0.0), DVec3::X), (one.position, DVec3::X)]
        {
            let light = interpolate(x, normal, -gathered.mirrored_view, &[(one, gathered); 3], scheme);
            assert_near3(light.diffuse_position, gathered.diffuse.position, ROUNDING);
            assert!(light.diffuse_irradiance.is_finite() && light.glossy_irradiance.is_finite());
            assert!(light.diffuse_irradiance.min_element() > 0.0);
            if scheme == Scheme::Facing {
                let Lobe { position, facing_irradiance, distance2, .. } = gathered.diffuse;
                let left = falloff(distance2, position.distance_squared(one.position), position.distance_squared(x));
                assert_near3(light.diffuse_irradiance, left * facing_irradiance, ROUNDING);
            }
        }
        let none = interpolate(DVec3::ZERO, DVec3::Z, DVec3::Z, &[], scheme);
        assert!(!none.has_diffuse && !none.has_glossy && none.diffuse_irradiance == DVec3::ZERO);
    }
}
