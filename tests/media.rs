//! Media inside bodies: the dipole's integral and its shader against their f64 twins, and random walks.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3, dvec3, vec3};
use lightskin::reference::dipole::{
    MOST_BRIGHTER, ProxyDipole, brought, diffuse_reflectance, interpolate, on_same_side,
};
use lightskin::reference::volume::{Volume, refracted, walk};
use lightskin::scene::medium::{Medium, SOURCES, Shape, Subsurface, fresnel, inner_reflectance, source};

use crate::bake::meshes::Random;
use crate::shaders::{check4, random};
use crate::subsurface::of;

const DIPOLE: &[&str] = &["shared.glsl", "lib/dipole.glsl"];

// Formulas.

#[test]
fn what_leaves_is_the_dipoles_integral() {
    for name in Subsurface::presets() {
        let medium = Subsurface::preset(name).expect("a preset").medium();
        for i in 0..3 {
            // Sources that are widened by nothing, and by as much as large texels widen them.
            let path = medium.extinction[i].recip();
            for widest in [0.0, 0.3 * path, 10.0 * path] {
                // Integrate in steps of the logarithm of the distance. The parts that are left out at both ends are
                // less than 1e-5.
                let (low, high, steps) = (1e-4 * path, 1e5 * (path + widest), 4000);
                let ratio = f64::powf(high / low, 1.0 / f64::from(steps));
                let ring = |step: i32| {
                    let r = low * ratio.powf(f64::from(step) + 0.5);
                    TAU * r * r * ratio.ln() * diffuse_reflectance(&medium, r, widest)[i]
                };
                let sum: f64 = (0..steps).map(ring).sum();
                let whole = medium.diffuse_albedo()[i];
                assert!((sum / whole - 1.0).abs() < 1e-3, "{name} {i}: {sum} instead of {whole}");
            }
        }
    }
}

#[test]
fn colours_come_back() {
    let (color, radius) = (vec3(0.9, 0.5, 0.02), vec3(0.01, 0.002, 3.0));
    for ior in [1.0, 1.3, 2.5] {
        let medium = Subsurface::of_color(color, radius, ior).medium();
        assert!((medium.diffuse_albedo() - color.as_dvec3()).abs().max_element() < 1e-4, "{medium:?}");
        assert!((medium.extinction.recip() / radius.as_dvec3() - 1.0).abs().max_element() < 1e-4, "{medium:?}");
    }
}

#[test]
fn shaders_are_the_twins() {
    // Distance, texel width, distance of the near source [m], effective extinction [1/m], index of refraction.
    let mut inputs = random(91, 4000, [(0.0, 1.0), (0.0, 1.0), (1e-3, 0.03), (0.0, 300.0), (1.0, 2.5)]);
    for x in &mut inputs {
        (x[0], x[1]) = (0.1 * x[0].powi(4), 0.05 * x[1].powi(4));
    }
    inputs.extend([[0.0, 0.0, 1e-3, 0.0, 1.3], [1e3, 0.0, 1e-3, 1e3, 1.3], [0.0, 0.0, 1e-8, 1e4, 1.5]]);
    let medium = |x: &[f64; 5]| Medium {
        depths: [DVec3::splat(x[2]), DVec3::splat(7.0 * x[2])],
        sigma_tr: DVec3::splat(x[3]),
        strength: DVec3::splat(1.5),
        ..of(1.0, 1.0, 0.0, x[4] as f32).medium()
    };
    // In a frame the host computes the numbers of a filled body. Here the shader does.
    let of_source = |share: f64, depth: &str| format!("vec3({share:?} * exp(-x[3] * {depth}))");
    let [near, far] = [of_source(1.5 * SOURCES[0], "x[2]"), of_source(1.5 * SOURCES[1], "7.0 * x[2]")];
    let o = "vec3(0.0)";
    let made =
        format!("Filled(vec3(x[2]), 1.0, vec3(7.0 * x[2]), x[4], vec3(x[3]), {near}, {far}, {o}, vec3(1.0), 1.0)");
    let expression =
        format!("vec4(diffuse_reflectance({made}, vec3(x[0] * x[0]), vec3(x[1])), dielectric_fresnel(x[1], x[4]))");
    // An exponent of 100 has a rounding error of 1e-5.
    check4(
        DIPOLE,
        &expression,
        &inputs,
        |_| (3e-4, 2e-6),
        |x| {
            let r = diffuse_reflectance(&medium(x), x[0], x[1]);
            [r.x, r.y, r.z, fresnel(x[1], x[4])]
        },
    );
}

// Walks.

/// Random walks that start below the plane z = 0 in a layer of this thickness \[m\]. Returns the fractions that leave
/// at the top and at the bottom. An infinitely thick layer has no bottom.
fn layer(volume: &Volume, thickness: f64, begin: impl Fn(&mut Random) -> DVec3, walks: u32) -> [f64; 2] {
    let mut source = Random(7);
    let mut counts = [0.0; 2];
    for _ in 0..walks {
        let direction = begin(&mut source);
        let mut random = || source.next();
        let exit = walk(volume, DVec3::ZERO, direction, &mut random, |p, d| {
            let up = d.z > 0.0;
            let distance = if up { -p.z / d.z } else { (-thickness - p.z) / d.z };
            let normal = if up { DVec3::Z } else { DVec3::NEG_Z };
            distance.is_finite().then_some((distance.max(0.0), normal, usize::from(!up)))
        });
        if let Some(exit) = exit {
            counts[exit.surface] += 1.0 / f64::from(walks);
        }
    }
    counts
}

/// The fraction of vertical light that returns from a half space with isotropic scattering, by Chandrasekhar's H: `1 -
/// H(1) sqrt(1 - albedo)`.
fn comes_back(albedo: f64) -> f64 {
    const N: usize = 200;
    let mu = |i: usize| (i as f64 + 0.5) / N as f64;
    let mut h = vec![1.0; N];
    let root = (1.0 - albedo).sqrt();
    let at = |h: &[f64], x: f64| {
        let sum: f64 = (0..N).map(|j| mu(j) * h[j] / (x + mu(j))).sum::<f64>() / N as f64;
        1.0 / (root + 0.5 * albedo * sum)
    };
    for _ in 0..200 {
        h = (0..N).map(|i| at(&h, mu(i))).collect();
    }
    1.0 - at(&h, 1.0) * root
}

#[test]
fn points_have_bounds_on_their_brightness() {
    // Distance of the light from the point and from the only cache, distance of the near source [m], effective extinction
    // [1/m], irradiance at the cache [lx].
    let inputs = random(92, 4000, [(0.0, 0.05), (0.0, 0.05), (1e-3, 0.01), (0.0, 1000.0), (0.1, 1e4)]);
    let medium = |x: &[f64; 5]| Medium {
        depths: [DVec3::splat(x[2]), DVec3::splat(7.0 * x[2])],
        sigma_tr: DVec3::splat(x[3]),
        strength: DVec3::ONE,
        returned: DVec3::ONE,
        close_by: DVec3::splat(0.3),
        around: 1e-4,
        ..of(1.0, 1.0, 0.0, 1.3).medium()
    };
    let of_source = |share: f64, depth: &str| format!("vec3({share:?} * exp(-x[3] * {depth}))");
    let [near, far] = [of_source(SOURCES[0], "x[2]"), of_source(SOURCES[1], "7.0 * x[2]")];
    let o = "vec3(0.0)";
    let window = "vec3(0.3), vec3(0.7), 1e-4";
    let made = format!("Filled(vec3(x[2]), 1.0, vec3(7.0 * x[2]), 1.3, vec3(x[3]), {near}, {far}, {window})");
    let half = "vec3(0.5)";
    let mean = format!(
        "Dipoles(1.0, {o}, 0.0, vec3(sqrt(sqrt(x[4]))), vec3(1.0), {o}, {o}, {o}, vec3(x[0] * x[0]), {o}, {o}, {half}, {o})"
    );
    let at = "vec3(x[1], 0.0, 0.0)";
    let proxy = format!("ProxyDipole(vec3(x[4]), 0u, {at}, {at}, {at}, {o}, {o}, {half})");
    let expression = format!("vec4(irradiance_below({made}, {mean}, own_scale({made}, {mean}, {proxy})), 0.0)");
    let twin = |x: &[f64; 5]| {
        let place = [dvec3(x[1], 0.0, 0.0); 3];
        let (irradiance, facing) = (DVec3::splat(x[4]), DVec3::splat(0.5));
        let proxy = ProxyDipole { irradiance, place, facing, ..ProxyDipole::default() };
        interpolate(&medium(x), DVec3::ZERO, &[(dvec3(x[0] - x[1], 0.0, 0.0), 1.0, proxy)])
    };
    let at_bound =
        inputs.iter().map(|x| x.map(f64::from)).filter(|x| twin(x).x > (MOST_BRIGHTER - 1e-6) * x[4]).count();
    assert!((100..3900).contains(&at_bound), "{at_bound}");
    // Logarithms of up to 100 have a rounding error of 1e-5.
    check4(DIPOLE, &expression, &inputs, |_| (3e-4, 1e-30), |x| twin(x).extend(0.0).to_array());
}

#[test]
fn hidden_caches_are_on_both_sides() {
    let mut inputs = random(93, 400, [(-1.0, 1.0); 6]);
    inputs.push([0.0, 0.0, 0.0, 0.0, -1.0, 0.0]);
    check4(
        DIPOLE,
        "vec4(on_same_side(vec3(x[0], x[1], x[2]), vec3(x[3], x[4], x[5])), 0.0, 0.0, 0.0)",
        &inputs,
        |_| (1e-5, 1e-6),
        |x| [on_same_side(dvec3(x[0], x[1], x[2]), dvec3(x[3], x[4], x[5])), 0.0, 0.0, 0.0],
    );
}

/// On a plane pixels and caches together return all light once, however large texels are.
#[test]
fn pixels_and_caches_share_all_light() {
    for path in [1e-4, 1e-3, 1e-2] {
        let flat = Subsurface::of_color(vec3(0.9, 0.7, 0.3), Vec3::splat(path), 1.4).medium();
        let medium = Medium { close_by: flat.within(0.01), around: 1e-4, ..flat };
        for wide in [0.0, 0.003, 0.01, 0.03] {
            let mut sum = medium.close_by * medium.returned;
            let (mut inner, step) = (0.0, 1.005_f64);
            while inner < 100.0 {
                let outer = (inner * step).max(1e-6);
                let r = 0.5 * (inner + outer);
                let ring = PI * (outer * outer - inner * inner);
                sum += ring * diffuse_reflectance(&medium, r, wide) * brought(&medium, r * r, wide, 1.0);
                inner = outer;
            }
            let off = sum / medium.returned - 1.0;
            println!("mean free path {path} m, texels of {wide} m: {off:+.3} too much light");
            assert!(off.abs().max_element() < 0.01, "{path}, {wide}: {off}");
        }
    }
}

#[test]
fn walks_come_back_as_often_as_theory_says() {
    for albedo in [0.5, 0.9, 0.99] {
        let volume = Volume { sigma_t: 100.0, albedo, g: 0.0, ior: 1.0 };
        let [back, _] = layer(&volume, f64::INFINITY, |_| DVec3::NEG_Z, 60_000);
        let expected = comes_back(albedo);
        println!("half space of albedo {albedo}: {back:.4} returns, {expected:.4} by Chandrasekhar's H");
        assert!((back - expected).abs() < 0.008, "{back} instead of {expected}");
    }
    // Without absorption all light leaves on one of the sides, for any scattering.
    for (g, ior) in [(0.0, 1.0), (0.9, 1.5), (-0.7, 2.5)] {
        let volume = Volume { sigma_t: 10.0, albedo: 1.0, g, ior };
        let [back, through] = layer(&volume, 0.3, |_| refracted(dvec3(0.6, 0.0, -0.8), DVec3::Z, ior), 3000);
        assert!((back + through - 1.0).abs() < 1e-9 && through > 0.05, "{back} + {through}");
    }
}

#[test]
fn dipoles_send_back_what_walks_do() {
    for (albedo, ior) in [(0.8, 1.3), (0.95, 1.3), (0.99, 1.5), (0.999, 1.3), (0.97, 1.0)] {
        let volume = Volume { sigma_t: 1.0, albedo, g: 0.0, ior };
        let [back, _] = layer(&volume, f64::INFINITY, |random| entered(random, ior), 20_000);
        let dipole = of(albedo as f32, (1.0 - albedo) as f32, 0.0, ior as f32).medium().diffuse_albedo().x;
        let error = dipole / back - 1.0;
        println!(
            "half space of albedo {albedo}, index {ior}: {back:.4} by walks, {dipole:.4} by dipoles, {:+.1} %",
            100.0 * error
        );
        assert!(error.abs() < 0.05, "{dipole} instead of {back}");
    }
}

/// Direction of uniform light that has entered through a surface with the normal +Z.
fn entered(random: &mut Random, ior: f64) -> DVec3 {
    loop {
        let (cosine, turn) = (random.next().sqrt(), TAU * random.next());
        if random.next() >= fresnel(cosine, ior) {
            let sine = (1.0 - cosine * cosine).sqrt();
            return refracted(dvec3(sine * turn.cos(), sine * turn.sin(), -cosine), DVec3::Z, ior);
        }
    }
}

/// `R_d` of Jensen et al. 2001 for a mean free path of 1.
fn jensen(r: f64, albedo: f64, ior: f64) -> f64 {
    let boundary = (1.0 + inner_reflectance(ior)) / (1.0 - inner_reflectance(ior));
    let sigma_tr = (3.0 * (1.0 - albedo)).sqrt();
    0.5 * albedo * (source(r, 1.0, sigma_tr, 0.0) + source(r, 1.0 + 4.0 / 3.0 * boundary, sigma_tr, 0.0))
}

/// Sides of a plate that are farther apart than light travels, but closer than the points of its surface, do not meet.
#[test]
fn plates_return_what_half_spaces_do() {
    const SIDE: usize = 16;
    let thickness = 0.02;
    let point = |i: usize| {
        let [x, y] = [i % SIDE, i / SIDE % SIDE].map(|i| (i as f64 + 0.5) / SIDE as f64);
        let up = if i < SIDE * SIDE { 1.0 } else { -1.0 };
        [dvec3(x, y, 0.5 * up * thickness), up * DVec3::Z]
    };
    let area = 1.0 / (SIDE * SIDE) as f64;
    let shape = Shape { points: (0..2 * SIDE * SIDE).map(point).collect(), area, volume: Some(thickness) };
    for path in [1e-5, 1e-4] {
        let flat = of(0.99 / path, 0.01 / path, 0.0, 1.3).medium();
        let plate = flat.in_body(&shape);
        let stronger = plate.strength.x / flat.strength.x;
        println!("mean free path {path} m: {stronger:.4} of a half space's strength, returned {:.4}", plate.returned.x);
        assert!((stronger - 1.0).abs() < 0.02, "{stronger}");
    }
}

/// Where light leaves: a ball of so many mean free paths, by angle from the place where it entered, and a half space.
#[test]
fn light_leaves_where_walks_do() {
    const BANDS: usize = 9;
    for (albedo, ior, radius, bounds) in [
        (0.97, 1.3, 15.0, [0.03, 0.06]),
        (0.995, 1.5, 15.0, [0.03, 0.06]),
        (0.9996, 1.4, 17.0, [0.03, 0.1]),
        (0.995, 1.4, 170.0, [0.03, 0.06]),
        (0.995, 1.3, 5.0, [0.03, 0.12]),
    ] {
        let volume = Volume { sigma_t: 1.0, albedo, g: 0.0, ior };
        let walks = 20_000;
        let (mut source, mut bands) = (Random(5), [0.0; BANDS]);
        let top = radius * DVec3::Z;
        for _ in 0..walks {
            let direction = entered(&mut source, ior);
            let mut random = || source.next();
            let exit = walk(&volume, top, direction, &mut random, |p, d| {
                let along = p.dot(d);
                let distance = (along * along - p.length_squared() + radius * radius).max(0.0).sqrt() - along;
                let at = p + distance * d;
                Some((distance, at / radius, at))
            });
            if let Some(exit) = exit {
                let angle = exit.surface.normalize().z.clamp(-1.0, 1.0).acos();
                bands[((angle / PI * BANDS as f64) as usize).min(BANDS - 1)] += 1.0 / f64::from(walks);
            }
        }
        // Points of equal area on the ball.
        let point = |i: usize| {
            let (z, turn) = (1.0 - (2.0 * i as f64 + 1.0) / 512.0, 2.399_963_229_728_653 * i as f64);
            let sine = (1.0 - z * z).sqrt();
            let normal = dvec3(sine * turn.cos(), sine * turn.sin(), z);
            [radius * normal, normal]
        };
        let shape = Shape {
            points: (0..512).map(point).collect(),
            area: 2.0 * TAU * radius * radius / 512.0,
            volume: Some(2.0 / 3.0 * TAU * radius.powi(3)),
        };
        let medium = of(albedo as f32, (1.0 - albedo) as f32, 0.0, ior as f32).medium();
        let by = |reflectance: &dyn Fn(f64) -> f64| -> [f64; BANDS] {
            const STEPS: usize = 2000;
            std::array::from_fn(|band| {
                let ring = |step: usize| {
                    let each = PI / BANDS as f64 / STEPS as f64;
                    let angle = (band * STEPS + step) as f64 * each + 0.5 * each;
                    let area = TAU * radius * radius * angle.sin() * each;
                    area * reflectance(2.0 * radius * (0.5 * angle).sin())
                };
                (0..STEPS).map(ring).sum()
            })
        };
        let in_body = medium.in_body(&shape);
        let body = by(&|r| diffuse_reflectance(&in_body, r, 0.0).x);
        let flat = by(&|r| diffuse_reflectance(&medium, r, 0.0).x);
        let jensen = by(&|r| jensen(r, albedo, ior));
        let sum = |bands: &[f64; BANDS]| bands.iter().sum::<f64>();
        let apart = |other: &[f64; BANDS]| -> f64 {
            bands.iter().zip(other).map(|(walks, dipole)| (walks - dipole).abs()).sum::<f64>() / sum(&bands)
        };
        println!(
            "ball of radius {radius} mean free paths, albedo {albedo}, index {ior}: {:.4} by walks, {:.4} by dipoles; \
             misplaced {:.3}, without in_body {:.3}, by Jensen's dipole {:.3}",
            sum(&bands),
            sum(&body),
            apart(&body),
            apart(&flat),
            apart(&jensen)
        );
        assert!((sum(&body) / sum(&bands) - 1.0).abs() < bounds[0] && apart(&body) < bounds[1], "{bands:?} {body:?}");
    }
}
