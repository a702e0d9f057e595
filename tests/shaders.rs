//! Every function of `glsl/lib` against its f64 twin, on grids and on random numbers that include extremes.
//!
//! Bounds are relative unless stated otherwise. f32 rounds at 6e-8, and the device's square roots and quotients may
//! have errors of 2.5 ulp: `FEW` allows ten such operations. Twins get exactly the f32 inputs, so the rounding of
//! inputs does not count.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3, dvec2, dvec3, vec3};
use lightskin::reference::area_light::Rectangle;
use lightskin::reference::brdf::Lobe;
use lightskin::reference::form_factor::disc_form_factor;
use lightskin::reference::gather::{Cache, val_geometry};
use lightskin::reference::interpolate::{Scheme, kernel};
use lightskin::reference::light::{body_falloff, range_window, spot_falloff};
use lightskin::reference::near::alike;
use lightskin::reference::occlude;
use lightskin::reference::phong::{cos_power, phong_lobe};
use lightskin::reference::rsm::{Val, solid_angle};
use lightskin::reference::tonemap;

use crate::analytic::numbers;
use crate::common::{assert_clean, gpu, map_on_gpu};

/// Ten roundings of quotients and roots.
pub(crate) const FEW: f64 = 2e-6;

/// Smallest normal number of f32. Devices may give 0 for smaller numbers.
const TINY: f64 = 1.2e-38;

/// Evaluates an expression on the device and compares each result with the twin's number. `least` is the absolute error
/// that is always allowed.
#[track_caller]
pub(crate) fn check<const N: usize>(
    includes: &[&str],
    expression: &str,
    inputs: &[[f32; N]],
    bound: impl Fn(&[f64; N]) -> f64,
    least: f64,
    twin: impl Fn(&[f64; N]) -> f64,
) {
    check4(includes, &format!("vec4({expression})"), inputs, |x| (bound(x), least), |x| [twin(x); 4]);
}

/// Like `check`, for four components. `bound` gives the relative error and the absolute error that are allowed.
#[track_caller]
pub(crate) fn check4<const N: usize>(
    includes: &[&str],
    expression: &str,
    inputs: &[[f32; N]],
    bound: impl Fn(&[f64; N]) -> (f64, f64),
    twin: impl Fn(&[f64; N]) -> [f64; 4],
) {
    let gpu = gpu();
    let results = map_on_gpu(&gpu, includes, expression, inputs);
    let mut worst = (0.0, String::new());
    for (input, result) in inputs.iter().zip(results) {
        let input = input.map(f64::from);
        let (relative, least) = bound(&input);
        for (actual, expected) in result.map(f64::from).into_iter().zip(twin(&input)) {
            let error = (actual - expected).abs();
            let share = error / (relative * expected.abs() + least).max(f64::MIN_POSITIVE);
            let told =
                || format!("{expression} of {input:?} is {actual} instead of {expected}: {share:.3} of the bound");
            assert!(share <= 1.0, "{}", told());
            if share > worst.0 {
                worst = (share, told());
            }
        }
    }
    eprintln!("largest error: {}", worst.1);
    assert_clean(&gpu);
}

/// Every combination of one value from each list.
pub(crate) fn grid<const N: usize>(axes: [&[f32]; N]) -> Vec<[f32; N]> {
    let count: usize = axes.iter().map(|axis| axis.len()).product();
    let point = |mut index: usize| {
        axes.map(|axis| {
            let value = axis[index % axis.len()];
            index /= axis.len();
            value
        })
    };
    (0..count).map(point).collect()
}

/// Random numbers, each axis in its range. In a range of several decades the logarithm is uniform.
pub(crate) fn random<const N: usize>(seed: u64, count: usize, ranges: [(f32, f32); N]) -> Vec<[f32; N]> {
    let mut next = numbers(seed);
    let mut one = |(low, high): (f32, f32)| {
        let t = next() as f32;
        if low > 0.0 && high > 1e3 * low { low * (high / low).powf(t) } else { low + (high - low) * t }
    };
    (0..count).map(|_| ranges.map(&mut one)).collect()
}

const COSINES: [f32; 13] = [-1.0, -1e-7, 0.0, 1e-12, 1e-7, 1e-3, 0.1, 0.5, 0.7, 0.9, 0.999, 0.999_999_9, 1.0];
const EXPONENTS: [f32; 9] = [1.0, 1.5, 2.0, 10.0, 40.0, 99.5, 500.0, 1000.0, 2048.0];
const DISTANCES: [f32; 9] = [1e-6, 1e-4, 1e-2, 0.3, 1.0, 30.0, 1e2, 1e4, 1e6];

const FORM_FACTOR: &[&str] = &["lib/form_factor.glsl"];
const PHONG: &[&str] = &["lib/phong.glsl"];
const LIGHT: &[&str] = &["lib/light.glsl"];
const INTERPOLATION: &[&str] = &["lib/interpolation.glsl"];
const TONEMAP: &[&str] = &["lib/tonemap.glsl"];
const OVERLAP: &[&str] = &["lib/overlap.glsl"];

// Form factor.

#[test]
fn val_geometry_towards_is_the_twins() {
    let (light, normal) = (dvec3(0.6, 0.0, -0.8), dvec3(0.0, 0.6, 0.8));
    let mut inputs = random(2, 3000, [(-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), (1e-9, 1e4), (1e-6, 1e6)]);
    for distance in DISTANCES {
        inputs.extend([[0.0, 0.0, 1.0, 1e-4, distance], [-0.5, 0.5, 0.7, 1e-9, distance]]);
    }
    let expression = "vec4(val_geometry_towards(v(0) * x[4], vec3(0.6, 0.0, -0.8), vec3(0.0, 0.6, 0.8), x[3]))";
    let offset = |x: &[f64; 5]| dvec3(x[0], x[1], x[2]) * x[4];
    // Closer than a millionth of a VAL's side the twin limits the distance, but the shader does not: in f32 both
    // cosines are noise there.
    inputs.retain(|x| offset(&x.map(f64::from)).length_squared() > 2e-12 * f64::from(x[3]));
    // A cosine near 0 is a difference of products, so its error is relative to the length rather than to the cosine.
    let bound = |x: &[f64; 5]| {
        let d = offset(x);
        (FEW, FEW / x[3].max(PI * d.length_squared()) + TINY)
    };
    check4(FORM_FACTOR, expression, &inputs, bound, |x| {
        let val = Val { position: offset(x), area: x[3], normal: light, flux: DVec3::ONE };
        [val_geometry(DVec3::ZERO, normal, &val).0; 4]
    });
}

#[test]
fn a_point_on_a_val_of_any_size_gets_nothing_from_it() {
    // Products of squared small lengths underflow in f32, which must not lead to 0/0. All values are inputs, so the
    // compiler cannot fold constants.
    let zero: &[f32] = &[0.0];
    let inputs = grid([&[0.0, 1e-25, 1e-15, 1e-10], zero, zero, &[1.0], zero, &[0.0, 1e-20, 1e-12, 1e-9, 1e-6, 1.0]]);
    let expression = "vec4(val_geometry_towards(v(0), v(2), v(2), x[5]))";
    check4(FORM_FACTOR, expression, &inputs, |_| (0.0, TINY), |_| [0.0; 4]);
}

// Phong.

/// The logarithm's error is about 1e-7 and grows k-fold. The product itself is at most 128.
fn power_bound(k: f64) -> f64 {
    1e-5 + 2.5e-7 * k
}

#[test]
fn cosine_power_and_lobe_are_the_twins() {
    let mut inputs = grid([&EXPONENTS, &COSINES]);
    inputs.extend(random(3, 2000, [(1.0, 2048.0), (-1.0, 1.0)]));
    inputs.extend(random(4, 2000, [(1.0, 2048.0), (0.99, 1.0)]));
    // The shader limits the logarithm's argument to 1e-30. With k = 1, this is its result for 0.
    let least = 2e-30;
    check(PHONG, "cosine_power(x[1], x[0])", &inputs, |x| power_bound(x[0]), least, |x| cos_power(x[0], x[1]));
    check(PHONG, "phong_lobe(x[0], x[1])", &inputs, |x| power_bound(x[0]), 1e3 * least, |x| phong_lobe(x[0], x[1]));
}

#[test]
fn powers_of_quotients_are_right_by_either_way() {
    let exponents = [0.5, 1.0, 8.0, 20.0, 128.0, 1024.0];
    let mut inputs = grid([&[1e-3, 0.05, 0.3, 0.7, 0.9, 0.999, 1.0], &[1e-12, 1e-4, 0.3, 1.0, 37.0, 1e6], &exponents]);
    inputs.extend(random(5, 4000, [(0.0, 1.0), (1e-6, 1e4), (0.5, 1024.0)]));
    inputs.extend(random(6, 4000, [(0.99, 1.0), (1e-6, 1e4), (0.5, 1024.0)]));
    let inputs: Vec<[f32; 3]> = inputs.into_iter().map(|[cosine, b, k]| [cosine * cosine * b, b, k]).collect();
    let lanes = |[a, b, k]: &[f64; 3]| [1.0, 0.5, 0.25, 0.125].map(|part| (part * a / b).powf(*k));
    // Below 2^-110 both ways may give 0.
    let least = 2_f64.powi(-109);
    let expression =
        |by_hand: &str| format!("power_of(x[0] * vec4(1.0, 0.5, 0.25, 0.125), vec4(x[1]), x[2], {by_hand})");
    // By hand: error of the logarithm's fit and two roundings, all in proportion to the exponent, which is at most 110.
    let by_hand = |x: &[f64; 3]| (5e-7 + 3.2e-7 * (x[2] * (0.125 * x[0] / x[1]).log2()).abs().min(110.0), least);
    check4(&["lib/power.glsl"], &expression("true"), &inputs, by_hand, lanes);
    check4(&["lib/power.glsl"], &expression("false"), &inputs, |x| (power_bound(2.0 * x[2]), least), lanes);
    for by_hand in ["true", "false"] {
        let call = format!("power_of(vec4(x[0]), vec4(x[1]), x[2], {by_hand})");
        // Exactly 0, and never NaN, if no light comes from along the lobe.
        let dark = [[0.0, 1e-6, 20.0], [0.0, 1.0, 20.0], [0.0, 1e6, 1024.0]];
        check4(&["lib/power.glsl"], &call, &dark, |_| (0.0, 0.0), |_| [0.0; 4]);
        let results =
            map_on_gpu(&gpu(), &["lib/power.glsl"], &call, &[[0.0, 0.0, 20.0_f32], [0.0, 0.0, 0.0], [0.0, 9.0, 0.0]]);
        assert!(results.iter().flatten().all(|power| (0.0..=1.0).contains(power)), "{by_hand}: {results:?}");
    }
}

#[test]
fn view_direction_is_a_unit_vector_at_any_distance() {
    let mut inputs = random(6, 1000, [(-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), (1e-6, 1e6)]);
    inputs.extend(DISTANCES.map(|distance| [0.0, 1.0, 0.0, distance]));
    let direction = |x: &[f64; 4]| dvec3(x[0], x[1], x[2]).normalize();
    let eye = "vec4(view_direction(vec4(0.0, 0.0, 0.0, 1.0), v(0) * x[3]), 0.0)";
    check4(PHONG, eye, &inputs, |_| (FEW, 1e-7), |x| direction(x).extend(0.0).to_array());
    let parallel = "vec4(view_direction(vec4(normalize(v(0)), 0.0), vec3(x[3])), 0.0)";
    check4(PHONG, parallel, &inputs, |_| (FEW, 1e-7), |x| (-direction(x)).extend(0.0).to_array());
    // At the eye itself there is no direction, but no NaN either.
    let here = random(14, 50, [(-1.0, 1.0); 3]).into_iter().map(|[x, y, z]| [x, y, z, x, y, z]).collect::<Vec<_>>();
    check4(PHONG, "vec4(view_direction(vec4(v(0), 1.0), v(3)), 0.0)", &here, |_| (0.0, 0.0), |_| [0.0; 4]);
}

// Lights.

#[test]
fn spot_falloff_is_the_twins() {
    let mut inputs = grid([&COSINES, &[0.0, 0.3, 0.5], &[0.01, 0.5, 0.7, 1.2, 1.55]]);
    inputs.extend(random(7, 2000, [(-1.0, 1.0), (0.0, 0.7), (0.7, 1.57)]));
    inputs.retain(|x| x[1] <= x[2]);
    // The host computes scale and offset. The shader gets them as in a frame.
    let cone = |&[cos, inner, outer]: &[f32; 3]| {
        let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
        [cos, scale, -outer.cos() * scale, inner, outer]
    };
    let handed: Vec<[f32; 5]> = inputs.iter().map(cone).collect();
    // Product and offset cancel: up to `scale` roundings of a ramp from 0 to 1, which is then squared.
    let bound = |x: &[f64; 5]| (0.0, 6e-7 * x[1] + FEW);
    check4(LIGHT, "vec4(spot_falloff(x[0], x[1], x[2]))", &handed, bound, |x| [spot_falloff(x[3], x[4], x[0]); 4]);
}

#[test]
fn body_falloff_is_the_twins() {
    let numbers = [(-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), (0.1, 2.0), (0.1, 2.0), (-0.3, 0.3), (-0.7, 0.7)];
    let unit = |[x, y, z, squares, other, product, lean]: [f32; 7]| {
        let d = vec3(x, y, z).normalize_or(Vec3::X);
        [d.x, d.y, d.z, squares, other, product, lean]
    };
    let inputs: Vec<_> = random(9, 2000, numbers).into_iter().map(unit).collect();
    let expression = "body_falloff(v(0), vec3(x[3], 1.0, x[4]), vec3(x[5], 0.1, -x[5]), vec3(0.0, x[6], -0.2))";
    check(
        LIGHT,
        expression,
        &inputs,
        |_| FEW,
        1e-6,
        |x| {
            let half = 0.5 * x[5];
            let q = DMat3::from_cols(dvec3(x[3], -half, 0.05), dvec3(-half, 1.0, half), dvec3(0.05, half, x[4]));
            body_falloff(dvec3(x[0], x[1], x[2]), q, dvec3(0.0, x[6], -0.2))
        },
    );
}

#[test]
fn range_window_is_the_twins() {
    let mut inputs = grid([&DISTANCES, &[0.0, 1e-3, 1.0, 31.0, 1e4]]);
    inputs.extend(random(8, 2000, [(0.0, 2.0), (0.5, 2.0)]));
    // The window is a difference from 1, so its error is absolute. 0 stands for an infinite range.
    let twin = |x: &[f64; 2]| range_window(x[0], (x[1] > 0.0).then_some(x[1] as f32));
    check(LIGHT, "range_window(x[0] * x[0], x[1])", &inputs, |_| 0.0, FEW, twin);
}

#[test]
fn solid_angle_is_the_twins_down_to_tiny_texels() {
    let mut inputs = Vec::new();
    for (tan_half, n) in [0.1_f32, 0.5, 1.0, 2.7].into_iter().flat_map(|t| [1, 2, 16, 128, 1024, 4096].map(|n| (t, n)))
    {
        let step = 2.0 * tan_half / n as f32;
        for (i, j) in [(0, 0), (n / 2, n / 2), (n / 3, n - 1), (n - 1, n / 4)] {
            inputs.push([i as f32 * step - tan_half, j as f32 * step - tan_half, step, step]);
        }
    }
    let expression = "vec4(solid_angle(vec3(x[0], x[1], 1.0), vec3(x[0] + x[2], x[1], 1.0), \
                      vec3(x[0] + x[2], x[1] + x[3], 1.0), vec3(x[0], x[1] + x[3], 1.0)))";
    // Corners are f32 unit vectors, so the error of a texel's edge is a few roundings of 1 rather than of its length.
    // Mesa's arc tangent is 2.1e-5 too small for small angles. Vulkan allows ten times that.
    let bound = |x: &[f64; 4]| {
        let edge = x[2] / (1.0 + x[0] * x[0] + x[1] * x[1]);
        (3e-5 + 4.0 * 6e-8 / edge, 0.0)
    };
    check4(LIGHT, expression, &inputs, bound, |x| {
        let corner = |i: f64, j: f64| dvec3(x[0] + i * x[2], x[1] + j * x[3], 1.0);
        [solid_angle(corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)); 4]
    });
}

#[test]
fn cube_face_is_that_of_the_largest_component() {
    let mut inputs = random(9, 2000, [(-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0)]);
    inputs.extend([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]);
    inputs.extend([[0.0, 0.0, -1.0], [1e-6, -2e-6, 3e-6], [1e6, -2e6, -3e6]]);
    check4(
        LIGHT,
        "vec4(cube_face(v(0)))",
        &inputs,
        |_| (0.0, 0.0),
        |x| {
            let axis = dvec3(x[0], x[1], x[2]).abs().max_position();
            [(2 * axis + usize::from(x[axis] < 0.0)) as f64; 4]
        },
    );
}

// Interpolation kernels.

#[test]
fn interpolation_kernels_are_the_twins() {
    let mut inputs = grid([&[0.0, 1e-4, 0.1, 0.5, 0.9, 1.0], &DISTANCES, &COSINES]);
    inputs.extend(random(10, 2000, [(0.0, 1.0), (1e-6, 1e6), (-1.0, 1.0)]));
    // 1 - d / d_max is rounded at 1, so its relative error is large near the farthest cache.
    let close = |x: &[f64; 3], power: f64| FEW + power * 2e-7 / (1.0 - x[0]).max(1e-7);
    check(
        INTERPOLATION,
        "printed_weight(x[0] * x[1], x[1], x[2])",
        &inputs,
        |x| close(x, 1.0),
        2e-7,
        |x| kernel(Scheme::Printed, x[0], x[2]),
    );
    let facing = "facing_weight(x[0] * x[1], x[1], x[2])";
    check(INTERPOLATION, facing, &inputs, |x| close(x, 2.0), 1e-12, |x| kernel(Scheme::Facing, x[0], x[2]));
    let apart = "distance_weight(x[0] * x[1], x[1])";
    check(INTERPOLATION, apart, &inputs, |_| FEW, 0.0, |x| 1.0 / (x[0] * x[0] + 1e-3));
}

#[test]
fn weights_are_finite_where_all_caches_lie_on_the_point() {
    // The vertex shader's arguments if even the farthest of a vertex's caches has distance zero. With a light of 1e6 lx
    // and sixteen references, the sum must stay below 3.4e38.
    let expression = "vec4(facing_weight(x[0], x[1], 1.0), distance_weight(x[0], x[1]), 0.0, 0.0) * 16.0 * 1e6";
    let gpu = gpu();
    let result = map_on_gpu(&gpu, INTERPOLATION, expression, &[[0.0_f32, 1e-15]])[0];
    assert!(result.iter().all(|weight| weight.is_finite()), "{result:?}");
    assert_clean(&gpu);
}

// Tone maps.

#[test]
fn tone_maps_are_the_twins() {
    let values: [f32; 12] = [0.0, 1e-6, 0.01, 0.079, 0.081, 0.18, 0.5, 0.76, 0.8, 1.0, 16.0, 1e6];
    let mut inputs = grid([&values, &values, &values]);
    inputs.extend(random(11, 2000, [(1e-5, 1e5); 3]));
    inputs.push([-1.0, 0.5, -0.1]);
    let curves: [fn(DVec3) -> DVec3; 4] = [tonemap::pbr_neutral, tonemap::agx, tonemap::aces, tonemap::linear];
    for (kind, curve) in curves.into_iter().enumerate() {
        // One step of an 8-bit display is 4e-3. AgX sums terms of up to 40 and computes powers of 2.2 by logarithms.
        let least = if kind == 1 { 3e-5 } else { 2e-6 };
        check4(
            TONEMAP,
            &format!("vec4(tonemap(v(0), {kind}u), 0.0)"),
            &inputs,
            |_| (FEW, least),
            |x| {
                let shown = curve(dvec3(x[0], x[1], x[2]).max(DVec3::ZERO));
                shown.clamp(DVec3::ZERO, DVec3::ONE).extend(0.0).to_array()
            },
        );
    }
}

// Unit vectors as two numbers.

#[test]
fn octahedral_coding_round_trips_within_the_unit_square() {
    let mut inputs = random(13, 3000, [(-1.0, 1.0); 3]);
    let ends = [-1.0, -1e-6, 0.0, 1e-6, 1.0];
    inputs.extend(grid([&ends, &ends, &ends]));
    inputs.retain(|x| x.iter().any(|v| v.abs() >= 1.0) || x.iter().all(|v| v.abs() > 1e-3));
    let include = &["lib/octahedral.glsl"];
    let twin = |x: &[f64; 3]| dvec3(x[0], x[1], x[2]).normalize().extend(0.0).to_array();
    let both = "vec4(octahedral_decode(octahedral_encode(normalize(v(0)))), 0.0)";
    check4(include, both, &inputs, |_| (0.0, 5e-7), twin);
    let inside = "vec4(all(lessThanEqual(abs(octahedral_encode(normalize(v(0)))), vec2(1.0))))";
    check4(include, inside, &inputs, |_| (0.0, 0.0), |_| [1.0; 4]);
}

#[test]
fn surfaces_are_as_alike_as_the_twins() {
    // A unit vector or so, four normals about it, and points in planes close to it.
    let mut ranges = [(-0.25, 0.25); 18];
    (0..3).chain(15..18).for_each(|i| ranges[i] = (-1.0, 1.0));
    let mut inputs = random(14, 6000, ranges);
    inputs.retain(|x| dvec3(x[0].into(), x[1].into(), x[2].into()).length() > 0.6);
    let at = |x: &[f64; 18], i: usize| dvec3(x[i], x[i + 1], x[i + 2]);
    let normal = |x: &[f64; 18], i: usize| (at(x, 0) + at(x, i)).normalize();
    let facing = |i: usize| format!("Facing(normalize(v(0) + v({i})), normalize(v(0) + v({})))", i + 3);
    let expression = format!("near_alike(cross(v(0), v(15)), {}, {})", facing(3), facing(9));
    let twin = |x: &[f64; 18]| {
        let [a, b] = [3, 9].map(|i| [normal(x, i), normal(x, i + 3)]);
        alike(at(x, 0).cross(at(x, 15)), a, b)
    };
    check(&["lib/near_alike.glsl"], &expression, &inputs, |_| FEW, 2e-5, twin);
}

// Overlap.

#[test]
fn sphere_form_factor_is_the_twins() {
    let mut inputs = grid([&[0.0, 1e-12, 1e-4, 1.0, 1e6], &COSINES, &[1e-12, 1e-4, 1.0, 1e6]]);
    inputs.extend(random(60, 2000, [(1e-9, 1e4), (-1.0, 1.0), (1e-9, 1e6)]));
    let twin = |x: &[f64; 3]| occlude::sphere_form_factor(x[0], x[1], x[2]);
    check(OVERLAP, "sphere_form_factor(x[0], x[1], x[2])", &inputs, |_| FEW, TINY, twin);
    // A light without size at the cache itself.
    let inputs = [[0.0, 1.0, 0.0]];
    check(OVERLAP, "sphere_form_factor(x[0], x[1], x[2])", &inputs, |_| FEW, TINY, |_| 0.0);
}

#[test]
fn squares_overlap_as_the_twins_do() {
    let sides: &[f32] = &[0.0, 0.1, 0.5, 1.0];
    let places: &[f32] = &[-0.6, -0.05, 0.0, 0.3];
    let mut inputs = grid([places, places, sides, places, places, sides]);
    inputs.extend(random(61, 3000, [(-1.0, 1.0), (-1.0, 1.0), (0.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), (0.0, 1.0)]));
    let twin = |x: &[f64; 6]| {
        let corners = occlude::overlap(dvec2(x[0], x[1]), x[2], dvec2(x[3], x[4]), x[5]);
        corners.map_or(0.0, |[low, high]| (high - low).element_product())
    };
    let expression = "overlap_area(overlap(vec2(x[0], x[1]), 0.5 * x[2], vec2(x[3], x[4]), 0.5 * x[5]))";
    // The overlap of squares that barely touch is a difference of numbers up to 1.5.
    check(OVERLAP, expression, &inputs, |_| FEW, 1e-6, twin);
}

#[test]
fn discs_fade_as_the_twins_do() {
    let mut inputs = grid([&[-1e6, -1.0, 0.0, 1e-6, 0.5, 1.0, 1e6], &[1e-6, 1e-3, 1.0, 1e4]]);
    inputs.extend(random(62, 1000, [(-2.0, 2.0), (1e-3, 2.0)]));
    check(OVERLAP, "fade(x[0], x[1])", &inputs, |_| FEW, TINY, |x| occlude::fade(x[0], x[1]));
}

#[test]
fn squares_of_discs_are_those_of_their_form_factors() {
    let (disc, normal) = (dvec3(0.6, 0.0, -0.8), dvec3(0.0, 0.6, 0.8));
    let mut inputs = random(64, 3000, [(-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), (1e-6, 1e4), (1e-3, 1e3)]);
    // A disc of any size at the cache itself covers nothing.
    inputs.extend([[0.0, 0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1e-20, 1.0], [1e-25, 0.0, 0.0, 1e-20, 1.0]]);
    let offset = |x: &[f64; 5]| dvec3(x[0], x[1], x[2]) * x[4];
    // Both cosines are differences of products, so their errors are relative to the length.
    let bound = |_: &[f64; 5]| (FEW, 4.0 * FEW);
    let expression = "vec4(disc_side2(v(0) * x[4], vec3(0.6, 0.0, -0.8), vec3(0.0, 0.6, 0.8), x[3]))";
    check4(OVERLAP, expression, &inputs, bound, |x| {
        let (d, square) = (offset(x), occlude::SQUARE);
        let direction = d.normalize_or_zero();
        let (cos_l, cos_x) = (disc.dot(direction).abs(), normal.dot(direction));
        [if d.length() < 1e-20 { 0.0 } else { square * disc_form_factor(x[3], cos_l, cos_x, d.length_squared()) }; 4]
    });
}

#[test]
fn tangents_lie_on_the_surface_along_the_light() {
    let mut inputs = random(63, 3000, [(-1.0, 1.0); 6]);
    inputs.retain(|x| x[..3].iter().map(|c| c * c).sum::<f32>() > 1e-3);
    // Lights along the normal, one of them straight down, where the surface's own tangents have no direction.
    inputs.extend([[0.0, -1.0, 0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0, 0.0], [0.6, -0.8, 0.0, 0.6, -0.8, 0.0]]);
    let expression = "vec4(tangent_towards(normalize(v(3)), normalize(v(0))), 0.0)";
    check4(
        OVERLAP,
        expression,
        &inputs,
        |_| (0.0, 1e-3),
        |x| {
            let (normal, direction) = (dvec3(x[0], x[1], x[2]).normalize(), dvec3(x[3], x[4], x[5]).normalize());
            let cache = Cache { position: DVec3::ZERO, normal, exponent: 1.0 };
            let [tangent, bitangent] = occlude::Light::new(&cache, direction, 0.1).tangents();
            assert!((tangent.length() - 1.0).abs() < 1e-9 && tangent.dot(normal).abs() < 1e-9);
            assert!(bitangent.distance(normal.cross(tangent)) < 1e-9);
            [tangent.x, tangent.y, tangent.z, 0.0]
        },
    );
}

#[test]
fn rectangles_give_what_their_parts_give() {
    // Centre, and directions of the sides. The point is the origin and its normal is +Z.
    let mut inputs =
        random(71, 300, [(-1.0, 1.0), (-1.0, 1.0), (0.0, 1.5), (-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), (1.0, 500.0)]);
    // Includes rectangles that are small for their distance and rectangles that are as wide as their distance, but none
    // that touches the point.
    inputs.retain(|x| x[..3].iter().map(|c| c * c).sum::<f32>() > 0.3);
    let sides = |x: &[f64; 7]| {
        let right = 0.3 * dvec3(x[3], x[4], x[5]).normalize();
        let up = 0.2 * right.cross(dvec3(x[5], x[3], x[4])).normalize();
        (dvec3(x[0], x[1], x[2]), right, up)
    };
    let rectangle = |x: &[f64; 7]| {
        let (middle, right, up) = sides(x);
        // The shader's caller makes sure that the front faces the point.
        let up = if right.cross(up).dot(middle) > 0.0 { -up } else { up };
        Rectangle { middle, right, up }
    };
    inputs.retain(|x| {
        let (middle, right, up) = sides(&x.map(f64::from));
        // Edge-on rectangles give only rounding errors.
        right.cross(up).normalize().dot(middle.normalize()).abs() > 0.02
    });
    let part = "above_horizon(v(0), 0.3 * normalize(v(3)), 0.2 * normalize(cross(normalize(v(3)), vec3(x[5], x[3], x[4]))), \
                vec3(0.0, 0.0, 1.0))";
    const AREA: &[&str] = &["lib/area_light.glsl"];
    let expression = format!("polygon_form_factor({part}, vec3(0.0, 0.0, 1.0))");
    check(AREA, &expression, &inputs, |_| 1e-3, 1e-4, |x| rectangle(x).form_factor(DVec3::ZERO, DVec3::Z));
    let share = |x: &[f64; 7]| {
        let lobe = Lobe::Phong { albedo: DVec3::ONE, exponent: x[6], mirrored: dvec3(0.48, 0.6, 0.64) };
        rectangle(x).reflected(DVec3::ZERO, DVec3::Z, &lobe).x
    };
    let expression = format!("polygon_lobe({part}, vec3(0.0, 0.0, 1.0), vec3(0.48, 0.6, 0.64), x[6])");
    // The shader uses eight quadrature points on each edge.
    check(AREA, &expression, &inputs, |_| 0.01, 2e-3, share);
    // Narrow lobes across an edge: the error is k times the rounding error of cosines.
    let mut inputs =
        random(72, 24, [(0.2, 0.8), (0.3, 0.9), (0.4, 0.8), (-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0), (500.0, 1.2e5)]);
    inputs.retain(|x| {
        let (middle, right, up) = sides(&x.map(f64::from));
        right.cross(up).normalize().dot(middle.normalize()).abs() > 0.3
    });
    check(AREA, &expression, &inputs, |_| 0.03, 5e-3, share);
}
