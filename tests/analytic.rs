//! The f64 references against closed forms: VALs, reflection, lights, tone maps, and one whole bounce.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3, dvec3};
use lightskin::reference::brute_force;
use lightskin::reference::form_factor::{disc_form_factor, disc_form_factor_integral, val_irradiance};
use lightskin::reference::light::{direct_irradiance, intensity, range_window, spot_falloff};
use lightskin::reference::monte_carlo::one_bounce_irradiance;
use lightskin::reference::phong::{phong_lobe, reflect};
use lightskin::reference::rsm::{Val, cast, cast_view, solid_angle, texel_area, texel_solid_angle, views};
use lightskin::reference::tonemap;
use lightskin::reference::triangle::Triangle;
use lightskin::scene::{Light, LightKind};

/// Rounding error of a few hundred f64 operations.
pub(crate) const ROUNDING: f64 = 1e-10;

/// Fails unless `actual` differs from `expected` by at most `bound` times `expected`. NaN fails.
#[track_caller]
fn assert_near(actual: f64, expected: f64, bound: f64) {
    let error = (actual - expected).abs();
    assert!(
        error <= bound * expected.abs(),
        "{actual} instead of {expected}: relative error {}",
        error / expected.abs()
    );
}

/// Like `assert_near`, for vectors. The error is relative to the length of `expected`.
#[track_caller]
pub(crate) fn assert_near3(actual: DVec3, expected: DVec3, bound: f64) {
    let error = actual.distance(expected);
    assert!(error <= bound * expected.length(), "{actual} instead of {expected}");
}

fn light(kind: LightKind) -> Light {
    Light {
        name: "light".into(),
        kind,
        color: Vec3::new(1.0, 0.5, 0.25),
        intensity: 100.0,
        range: None,
        radius: 0.0,
        position: DVec3::ZERO,
        direction: Vec3::NEG_Y,
    }
}

/// Pseudorandom numbers in [0, 1).
pub(crate) fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

// Form factor and VAL (METHOD 2).

#[test]
fn form_factor_is_the_integral_on_the_axis() {
    for (distance, tilt) in [(0.5, 0.0), (1.0, 0.3), (2.0, 0.9), (10.0, 1.2)] {
        let area = PI;
        // The tilted point sees the whole disc if the rim of the disc is above the point's horizon.
        assert!(f64::atan(1.0 / distance) + tilt < PI / 2.0 || tilt == 0.0);
        let normal = dvec3(f64::sin(tilt), 0.0, f64::cos(tilt));
        let integral = disc_form_factor_integral(area, distance * DVec3::Z, DVec3::NEG_Z, DVec3::ZERO, normal, 400);
        // Error of the midpoint rule: (1/400)^2 times the integrand's slope between rim and centre.
        assert_near(disc_form_factor(area, 1.0, normal.z, distance * distance), integral, 3e-5);
    }
}

#[test]
fn form_factor_is_within_a_tenth_from_five_radii_at_60_degrees() {
    let from_disc = dvec3(f64::sqrt(3.0) / 2.0, 0.0, -0.5);
    for turn in 0..8 {
        let (tangent, bitangent) = from_disc.any_orthonormal_pair();
        let (sin, cos) = (f64::from(turn) * TAU / 8.0).sin_cos();
        let normal = -0.5 * from_disc + f64::sqrt(3.0) / 2.0 * (cos * tangent + sin * bitangent);
        let integral = disc_form_factor_integral(PI, DVec3::ZERO, DVec3::NEG_Z, 5.0 * from_disc, normal, 200);
        assert_near(disc_form_factor(PI, 0.5, 0.5, 25.0), integral, 0.1);
    }
}

#[test]
fn form_factor_is_at_most_one_however_near() {
    assert_near(disc_form_factor(2.0, 1.0, 1.0, 1e-20), 1.0, 1e-15);
    assert_eq!(disc_form_factor(2.0, -0.1, 1.0, 1.0), 0.0);
    assert_eq!(disc_form_factor(2.0, 1.0, -0.1, 1.0), 0.0);
}

/// In the mean over its place, a point above an evenly lit surface gets the surface's own brightness from its VALs, as
/// long as it is farther away than a tile's radius; with eq. 5.20 it would get 70 % there.
#[test]
fn tiles_of_a_surface_give_all_its_light() {
    const SIDE: i32 = 60;
    let radius = (1.0 / PI).sqrt(); // of a tile with a side of 1 m
    let at = |height: f64| {
        let (mut sum, mut places) = (0.0, 0.0);
        for place in 0..64 {
            let place = [place % 8, place / 8].map(|i| (f64::from(i) + 0.5) / 8.0);
            for tile in 0..SIDE * SIDE {
                let [x, z] = [tile % SIDE, tile / SIDE].map(|i| f64::from(i - SIDE / 2));
                let d2 = (x + place[0]).powi(2) + (z + place[1]).powi(2) + height * height;
                let cosine = height / d2.sqrt();
                sum += val_irradiance(1.0, 1.0, cosine, cosine, d2);
            }
            places += 1.0;
        }
        sum / places
    };
    // The square that the tiles cover gives almost all the light of a plane.
    let seen = |height: f64| 1.0 - (height / f64::from(SIDE / 2)).powi(2);
    for height in [radius, 1.5 * radius, 2.0, 4.0] {
        println!("height {height:.2} m: {:.4}", at(height) / seen(height));
        assert_near(at(height), seen(height), 0.01);
    }
    assert!(at(0.25 * radius) < 0.5, "light from within a tile's radius is left to short rays");
}

#[test]
fn irradiance_of_a_small_val_falls_with_the_square_of_the_distance() {
    for distance in [1.0, 2.0, 8.0] {
        // Eq. 5.1: a diffuse emitter of flux phi sends phi/pi candela along its normal.
        let expected = 7.0 / PI / (distance * distance);
        assert_near(val_irradiance(7.0, 1e-8, 1.0, 1.0, distance * distance), expected, 1e-8);
    }
}

#[test]
fn texel_solid_angles_sum_to_the_sphere_and_to_a_square_frustum() {
    let sum = |n, tan_half| -> f64 { (0..n * n).map(|i| texel_solid_angle(i % n, i / n, n, tan_half)).sum() };
    assert_near(6.0 * sum(37, 1.0), 4.0 * PI, 1e-9);
    for half_angle in [0.01, 0.5, 1.2, 1.5] {
        assert_near(sum(32, f64::tan(half_angle)), 4.0 * (half_angle.sin() * half_angle.sin()).asin(), 1e-9);
    }
}

#[test]
fn solid_angle_of_a_tiny_texel_keeps_its_digits() {
    let side = 1e-7;
    let corner = |i: f64, j: f64| dvec3(1.0 + side * i, side * j, 1.0);
    let omega = solid_angle(corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0));
    // Expected: cosine cubed at 45 degrees. The angle changes by 1e-7 across the texel, and the corners round at 1e-9.
    assert_near(omega, side * side * 0.5_f64.sqrt().powi(3), 1e-6);
}

#[test]
fn texel_areas_of_a_facing_plane_sum_to_the_footprint() {
    let lamp = Light { position: dvec3(0.0, 3.0, 0.0), ..light(LightKind::Point) };
    let triangles = floor(100.0, 0.0, 1.0);
    let down = views(&triangles, &lamp).into_iter().find(|view| view.forward == DVec3::NEG_Y).expect("a cube's face");
    let area: f64 = cast_view(&triangles, &lamp, &down, 16).iter().map(|val| val.area).sum();
    assert_near(area, 6.0 * 6.0, ROUNDING);
    assert_near(texel_area(3.0, 16, 0.5) * 256.0, 3.0 * 3.0, ROUNDING);
}

/// A square floor centred at the origin and tilted about the x axis.
fn floor(size: f64, tilt: f64, albedo: f64) -> Vec<Triangle> {
    let back = dvec3(0.0, f64::sin(tilt), -f64::cos(tilt)) * size;
    let corner = -0.5 * (size * DVec3::X + back);
    Triangle::parallelogram(corner, size * DVec3::X, back, DVec3::splat(albedo)).to_vec()
}

#[test]
fn flux_of_a_hard_spot_is_its_cone_whatever_the_tilt() {
    let (outer, albedo) = (f64::from(0.6_f32), 0.7);
    let spot = Light { position: dvec3(0.0, 3.0, 0.0), ..light(LightKind::Spot { inner: 0.6, outer: 0.6 }) };
    // The falloff is a squared ramp just inside the edge. It is 0.001 wide in the cosine.
    let cone = TAU * (1.0 - outer.cos() - 0.001 + 0.001 / 3.0);
    let expected = albedo * intensity(&spot, DVec3::NEG_Y) * cone;
    // With n = 64 there are 256 sub-samples across. The rim crosses 800 of 51000, each with a random error of half its
    // value. With n = 8 it crosses 100 of 800. Without sub-samples it would cross 25 of 50 texels, an error of 5 %.
    for (tilt, (n, bound)) in [0.0, 0.4, 0.8].into_iter().flat_map(|tilt| [(64, 3e-4), (8, 6e-3)].map(|n| (tilt, n))) {
        let flux: DVec3 = cast(&floor(100.0, tilt, albedo), &spot, n).iter().map(|val| val.flux).sum();
        assert_near3(flux, expected, bound);
    }
}

#[test]
fn flux_of_a_point_light_in_a_closed_box_is_the_sphere() {
    let lamp = Light { position: dvec3(0.21, 0.13, -0.34), ..light(LightKind::Point) };
    let flux: DVec3 = cast(&cornell(), &lamp, 8).iter().map(|val| val.flux / albedo_at(val.position)).sum();
    assert_near3(flux, 4.0 * PI * intensity(&lamp, DVec3::X), 1e-9);
}

#[test]
fn flux_of_parallel_light_is_what_the_projected_area_catches() {
    let sun = light(LightKind::Directional);
    for tilt in [0.0, 0.7] {
        let flux: DVec3 = cast(&floor(2.0, tilt, 0.5), &sun, 16).iter().map(|val| val.flux).sum();
        // The frustum fits the floor exactly because both have the same axes.
        assert_near3(flux, 0.5 * 4.0 * f64::cos(tilt) * intensity(&sun, DVec3::NEG_Y), ROUNDING);
    }
}

#[test]
fn flux_of_a_val_is_windowed_by_the_lights_range() {
    let lamp = |range| Light { position: dvec3(0.0, 1.0, 0.0), range, ..light(LightKind::Point) };
    let [all, windowed] = [None, Some(2.0)].map(|range| cast(&floor(8.0, 0.0, 0.5), &lamp(range), 8));
    for (all, windowed) in all.iter().zip(&windowed).filter(|(all, _)| all.area > 0.0) {
        let share = range_window(all.position.distance(DVec3::Y), Some(2.0));
        assert_eq!(*windowed, if share > 0.0 { Val { flux: windowed.flux, ..*all } } else { Val::NOTHING });
        assert!((windowed.flux - share * all.flux).length() <= ROUNDING * all.flux.length());
    }
}

#[test]
fn vals_face_the_light_and_misses_are_nothing() {
    let lamp = Light { position: dvec3(0.0, -3.0, 0.0), ..light(LightKind::Point) };
    let vals = cast(&floor(4.0, 0.3, 0.5), &lamp, 8);
    assert_eq!(vals.len(), 6 * 64);
    let (hits, misses): (Vec<_>, Vec<_>) = vals.into_iter().partition(|val| val.flux != DVec3::ZERO);
    assert!(!hits.is_empty() && hits.iter().all(|val| val.normal.dot(lamp.position - val.position) > 0.0));
    assert!(misses.iter().all(|val| *val == Val::NOTHING));
}

// Reflection (METHOD 3).

#[test]
fn phong_lobe_reflects_all_at_normal_incidence_and_less_when_tilted() {
    const STEPS: [usize; 2] = [4000, 80]; // in height and azimuth; the lobe varies most in height
    // E12: albedo for k = 100, given with two digits.
    for (degrees, expected) in [(0.0_f64, 1.0), (30.0, 0.87), (60.0, 0.50), (75.0, 0.26)] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let mirrored = reflect(dvec3(-sin, 0.0, -cos), DVec3::Z);
        let mut albedo = 0.0;
        for i in 0..STEPS[0] * STEPS[1] {
            let z = ((i / STEPS[1]) as f64 + 0.5) / STEPS[0] as f64;
            let (y, x) = (TAU * ((i % STEPS[1]) as f64 + 0.5) / STEPS[1] as f64).sin_cos();
            let direction = dvec3(x, y, 0.0) * (1.0 - z * z).sqrt() + z * DVec3::Z;
            albedo += phong_lobe(100.0, mirrored.dot(direction)) * z * TAU / (STEPS[0] * STEPS[1]) as f64;
        }
        assert!((albedo - expected).abs() < 0.005 + 1e-4, "{degrees} degrees: {albedo}");
        if degrees == 0.0 {
            assert_near(albedo, 1.0, 1e-4);
        }
    }
    assert_eq!(phong_lobe(4.0, -0.9), 0.0);
}

// Punctual lights and tone maps.

#[test]
fn spot_falls_off_between_its_angles() {
    let (inner, outer) = (0.3_f64, 0.7_f64);
    let halfway = 0.5 * (inner.cos() + outer.cos());
    for (cos, expected) in [(1.0, 1.0), (inner.cos(), 1.0), (halfway, 0.25), (outer.cos(), 0.0), (-1.0, 0.0)] {
        assert!((spot_falloff(inner, outer, cos) - expected).abs() < 1e-12);
    }
    // Equal angles give a hard edge and no division by zero.
    assert_eq!([0.49, 0.51].map(|angle| spot_falloff(0.5, 0.5, f64::cos(angle))), [1.0, 0.0]);
    let spot = light(LightKind::Spot { inner: 0.3, outer: 0.7 });
    assert_near3(intensity(&spot, DVec3::NEG_Y), dvec3(100.0, 50.0, 25.0), ROUNDING);
}

#[test]
fn range_windows_the_light_to_zero() {
    let cases = [(0.0, 1.0), (1.0, 1.0 - 1.0 / 16.0), (2.0, 0.0), (3.0, 0.0)];
    assert!(cases.iter().all(|&(distance, expected)| (range_window(distance, Some(2.0)) - expected).abs() < 1e-12));
    assert_eq!(range_window(1e9, None), 1.0);
}

#[test]
fn direct_light_is_candela_over_distance_squared_or_lux() {
    let lamp = Light { position: dvec3(0.0, 2.0, 0.0), range: Some(4.0), ..light(LightKind::Point) };
    let tilted = dvec3(0.6, 0.8, 0.0);
    let expected = dvec3(100.0, 50.0, 25.0) / 4.0 * 0.8;
    assert_near3(direct_irradiance(&lamp, DVec3::ZERO, tilted), expected * (1.0 - 1.0 / 16.0), ROUNDING);
    assert_eq!(direct_irradiance(&lamp, DVec3::ZERO, DVec3::NEG_Y), DVec3::ZERO);
    assert_eq!(direct_irradiance(&lamp, lamp.position, DVec3::Y), DVec3::ZERO);
    let sun = light(LightKind::Directional);
    assert_near3(direct_irradiance(&sun, dvec3(5.0, -1e3, 0.0), tilted), 4.0 * expected, ROUNDING);
}

#[test]
fn pbr_neutral_keeps_base_colours_and_can_be_undone() {
    assert_near3(tonemap::pbr_neutral(dvec3(0.1, 0.3, 0.8)), dvec3(0.06, 0.26, 0.76), ROUNDING);
    let mut next = numbers(5);
    for reach in [0.05, 0.5, 2.0, 50.0] {
        for _ in 0..200 {
            let color = reach * dvec3(next(), next(), next());
            let shown = tonemap::pbr_neutral(color);
            assert!(shown.min_element() >= -1e-15 && shown.max_element() < 1.0);
            // Near white, the inverse multiplies rounding errors by (peak / 0.24)^2.
            assert_near3(tonemap::pbr_neutral_inverse(shown), color, 1e-8);
        }
    }
}

#[test]
fn tone_maps_keep_grey_grey_and_rise() {
    // Middle grey. ACES uses its rational fit. AgX maps it to half of the display's code range, within the error of its
    // polynomial.
    assert_near(tonemap::aces(DVec3::splat(0.18)).y, 0.1056, 2e-3);
    assert_near(tonemap::agx(DVec3::splat(0.18)).y, 0.5_f64.powf(2.2), 0.02);
    for map in [tonemap::linear, tonemap::pbr_neutral, tonemap::aces, tonemap::agx] {
        let mut last = -1.0;
        for stop in -60..60 {
            let shown = map(DVec3::splat(f64::from(stop / 6).exp2()));
            assert!(shown.is_finite() && shown.min_element() >= last && shown.max_element() <= 1.0);
            assert!(shown.max_element() - shown.min_element() < 1e-3, "{shown} is not grey");
            last = shown.min_element();
        }
        assert!(map(DVec3::ZERO).abs().max_element() < 1e-4);
    }
}

#[test]
fn srgb_round_trips_and_joins() {
    for i in 0..=1000 {
        let color = DVec3::splat(f64::from(i) / 1000.0);
        let back = tonemap::linear_from_srgb(tonemap::srgb_from_linear(color));
        assert!((back - color).abs().max_element() < 1e-7); // the standard's two curve pieces differ by 1e-8
    }
    assert_near(tonemap::srgb_from_linear(DVec3::splat(0.5)).x, 0.735357, 1e-6);
}

// One whole bounce (METHOD 2).

const WALLS: [DVec3; 3] = [dvec3(0.7, 0.2, 0.1), dvec3(0.2, 0.6, 0.2), dvec3(0.7, 0.7, 0.6)];

/// A closed 2 m box centred at the origin with walls of three colours.
fn cornell() -> Vec<Triangle> {
    let mut triangles = Vec::new();
    let (x, y, z) = (2.0 * DVec3::X, 2.0 * DVec3::Y, 2.0 * DVec3::Z);
    let low = DVec3::NEG_ONE;
    for (corner, u, v) in [(low, y, z), (low + x, z, y), (low, z, x), (low + y, x, z), (low, x, y), (low + z, y, x)] {
        triangles.extend(Triangle::parallelogram(corner, u, v, albedo_at(corner + 0.5 * (u + v))));
    }
    triangles
}

fn block() -> Vec<Triangle> {
    let (low, white) = (dvec3(-0.4, -1.0, -0.3), DVec3::splat(0.5));
    let (x, y, z) = (0.5 * DVec3::X, 0.5 * DVec3::Y, 0.5 * DVec3::Z);
    let faces = [(low, y, z), (low + x, z, y), (low + y, x, z), (low, x, y), (low + z, y, x)];
    faces.into_iter().flat_map(|(corner, u, v)| Triangle::parallelogram(corner, u, v, white)).collect()
}

fn albedo_at(position: DVec3) -> DVec3 {
    let axis = position.abs().max_position();
    if axis == 0 && position.x > 0.0 { WALLS[1] } else { WALLS[2 * usize::from(axis != 0)] }
}

#[test]
fn vals_bring_the_irradiance_that_random_paths_bring() {
    let scene = [cornell(), block()].concat();
    let spot = Light { position: dvec3(0.1, 0.9, 0.0), ..light(LightKind::Spot { inner: 0.2, outer: 0.6 }) };
    let lamp = Light { position: dvec3(0.3, 0.4, 0.2), range: Some(5.0), ..light(LightKind::Point) };
    let sun = Light { direction: Vec3::new(0.2, -1.0, 0.3).normalize(), ..light(LightKind::Directional) };
    for (light, triangles) in [(spot, &scene), (lamp, &scene), (sun, &[floor(2.0, 0.0, 0.7), raised(block())].concat())]
    {
        let vals = cast(triangles, &light, 64);
        for (point, normal) in [(dvec3(0.3, 1.0, 0.2), DVec3::NEG_Y), (dvec3(1.0, 0.2, 0.1), DVec3::NEG_X)] {
            let sum = brute_force::irradiance(point, normal, &vals);
            let truth = one_bounce_irradiance(point, normal, triangles, &light, 200_000, 1);
            // Measured: up to 0.8 %. Nearly all of it is the noise of 200 000 paths.
            assert_near3(sum, truth, 0.02);
        }
    }
}

/// Moves the block up so that it stands on a floor at height 0.
fn raised(block: Vec<Triangle>) -> Vec<Triangle> {
    block.into_iter().map(|t| Triangle { positions: t.positions.map(|p| p + DVec3::Y), ..t }).collect()
}

#[test]
fn random_paths_depend_on_the_seed_and_not_on_the_threads() {
    let lamp = light(LightKind::Point);
    let run = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        pool.install(|| one_bounce_irradiance(dvec3(0.0, 1.0, 0.0), DVec3::NEG_Y, &cornell(), &lamp, 20_000, seed))
    };
    assert_eq!(run(1, 9), run(3, 9));
    assert_ne!(run(1, 9), run(1, 10));
}
