//! Reflection of materials: shaders against their f64 twins, fits against integrals, furnace tests, and pictures
//! against the path tracer.

use std::f64::consts::PI;

use glam::{DAffine3, DVec2, DVec3, Vec3, Vec4, dvec3, vec3};
use lightskin::frame::LightShadows;
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::lab::scenes::spheres;
use lightskin::reference::brdf::{Lobe, fitted, hemisphere};
use lightskin::reference::light;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings, Sources};
use lightskin::reference::phong::{DIFFUSE_LOBE, phong_lobe};
use lightskin::scene::build::{cuboid, quad};
use lightskin::scene::ggx::{LEAST_COSINE, LEAST_ROUGHNESS, MEAN_PHONG_COSINE, albedo, phong_albedo, scattered_once};
use lightskin::scene::material::{self, Over, Reflectance};
use lightskin::scene::{LightKind, Material, Scene};

use crate::bake::meshes::Random;
use crate::common::frames::{SPOT, add, camera, lamp, phong, seen, shoot, small};
use crate::common::{gpu, rounding};
use crate::interpolate::assert_picture;
use crate::shaders::{FEW, check, check4, grid, random};

const BRDF: &[&str] = &["lib/brdf.glsl"];
const ROUGHNESSES: [f64; 12] = [LEAST_ROUGHNESS, 0.07, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];

/// Unit vector above the xy plane with this cosine to +z and this azimuth \[rad\].
fn at(cosine: f64, turn: f64) -> DVec3 {
    let sine = (1.0 - cosine * cosine).sqrt();
    dvec3(sine * turn.cos(), sine * turn.sin(), cosine)
}

/// A lobe with the normal +z, seen at a cosine.
fn lobe(f0: f64, f90: f64, roughness: f64, cosine: f64) -> Lobe {
    Lobe::Ggx { f0: DVec3::splat(f0), f90, roughness, normal: DVec3::Z, view: at(cosine, 0.0) }
}

/// Fraction of uniform light that a lobe reflects: the mean over an even grid of its own samples.
/// `samples_are_as_dense_as_they_say` compares this with sums over directions.
fn integrated(lobe: &Lobe) -> f64 {
    const SIDE: usize = 128;
    let number = |i: usize| (i as f64 + 0.5) / SIDE as f64;
    let sample = |i: usize| {
        let towards = lobe.sample(DVec2::new(number(i % SIDE), number(i / SIDE)));
        if towards.z > 0.0 { lobe.brdf(towards).x * towards.z / lobe.density(towards) } else { 0.0 }
    };
    (0..SIDE * SIDE).map(sample).sum::<f64>() / (SIDE * SIDE) as f64
}

// Shaders.

#[test]
fn metallic_roughness_is_the_materials_mapping() {
    let mut inputs = grid([
        &[0.0, 0.04, 1.0],
        &[0.0, 0.5, 1.0],
        &[0.0, 0.1, 1.0],
        &[0.0, 1.0, 1.2, 1.5, 3.0],
        &[0.0, 1.0],
        &[0.0, 9.0],
        &[0.0, 0.3, 1.0],
    ]);
    let unit = (0.0, 1.0);
    inputs.extend(random(12, 2000, [unit, unit, unit, (0.0, 4.0), unit, (0.0, 2.0), unit]));
    let call = "metallic_roughness(vec3(x[0], 1.0 - x[0], 0.5), x[1], x[2], x[3], x[4], vec3(x[5], 1.0, 0.2), x[6])";
    let twin = |x: &[f64; 7]| {
        let x = x.map(|v| v as f32);
        let material = Material {
            base_color: Vec4::new(x[0], 1.0 - x[0], 0.5, 1.0),
            metallic: x[1],
            roughness: x[2],
            ior: x[3],
            specular: x[4],
            specular_color: Vec3::new(x[5], 1.0, 0.2),
            ..Material::default()
        };
        material.reflectance(&Scene::default(), Default::default(), Vec4::ONE)
    };
    let numbers = |x: &[f64; 7]| match twin(x).lobe {
        material::Lobe::Ggx { f0, f90, roughness, .. } => (f0.as_dvec3(), f64::from(f90), f64::from(roughness)),
        material::Lobe::Phong { .. } => panic!("the material must not have a Phong lobe"),
    };
    let include = &["lib/material.glsl"];
    // Terms of up to 40 cancel each other.
    let diffuse = format!("vec4({call}.diffuse, 0.0)");
    check4(
        include,
        &diffuse,
        &inputs,
        |_| (2.0 * FEW, 3e-5),
        |x| twin(x).diffuse(x[6]).as_dvec3().extend(0.0).to_array(),
    );
    let glossy = format!("vec4({call}.glossy, 0.0)");
    check4(include, &glossy, &inputs, |_| (2.0 * FEW, 1e-6), |x| numbers(x).0.extend(0.0).to_array());
    // The reflectance at the horizon has 8 bits. The roughness has the other 24 of 32 bits.
    let coded = format!("vec4(coded_roughness({call}.coded), coded_f90({call}.coded), 0.0, 0.0)");
    let bound = |x: &[f64; 7]| {
        (if numbers(x).1 < 1.0 { 1e-3 } else { 1e-6 }, if numbers(x).1 < 1.0 { 0.5 / 255.0 } else { 1e-6 })
    };
    check4(include, &coded, &inputs, bound, |x| [numbers(x).2, numbers(x).1, 0.0, 0.0]);
}

#[test]
fn lobes_are_the_twins() {
    let cosines = [0.02, 0.1, 0.5, 0.9, 0.999, 1.0];
    let rough = ROUGHNESSES.map(|r| r as f32);
    let mut inputs = grid([&rough, &[0.0, 0.04, 1.0], &[0.0, 1.0], &cosines, &cosines, &[0.0, 3.1]]);
    let unit = (0.0, 1.0);
    inputs.extend(random(14, 4000, [(0.045, 1.0), unit, unit, (0.02, 1.0), (0.01, 1.0), (0.0, 6.3)]));
    // Samples around the mirror direction, where lobes are narrow.
    inputs.extend(random(15, 2000, [(0.045, 0.2), unit, unit, (0.3, 1.0), unit, (3.1, 3.2)]).map_cosines());
    let expression = "ggx_lobe(vec3(x[1]), x[2], x[0], vec3(0.0, 0.0, 1.0), \
                      -vec3(sqrt(1.0 - x[3] * x[3]), 0.0, x[3]), \
                      vec3(sqrt(1.0 - x[4] * x[4]) * vec2(cos(x[5]), sin(x[5])), x[4])).x";
    // Directions have rounding errors of 1e-7. The narrowest lobe is 2e-3 wide, so its slope amplifies them.
    let error = if rounding(&gpu()) > 1.0 { 2e-6 } else { 1e-6 };
    let bound = |x: &[f64; 6]| 2e-5 + error / (x[0] * x[0]);
    check(BRDF, expression, &inputs, bound, 1e-6, |x| lobe(x[1], x[2], x[0], x[3]).brdf(at(x[4], x[5])).x);
}

/// Moves the light's cosine near the viewer's.
trait MapCosines {
    fn map_cosines(self) -> Self;
}

impl MapCosines for Vec<[f32; 6]> {
    fn map_cosines(mut self) -> Self {
        self.iter_mut().for_each(|x| x[4] = (x[3] + (x[4] - 0.5) * x[0] * x[0]).clamp(0.01, 1.0));
        self
    }
}

#[test]
fn fits_are_the_twins() {
    let mut inputs = grid([&ROUGHNESSES.map(|r| r as f32), &[-1.0, 0.0, 0.01, 0.1, 0.5, 1.0]]);
    inputs.extend(random(16, 2000, [(0.045, 1.0), (0.0, 1.0)]));
    check4(
        BRDF,
        "vec4(scattered_once(x[0], x[1]), 0.0, 0.0)",
        &inputs,
        |_| (0.0, 2e-5),
        |x| {
            let [f0, f90] = scattered_once(x[0], x[1]);
            [f0, f90, 0.0, 0.0]
        },
    );
    let mut inputs = grid([&[0.25, 1.0, 7.5, 100.0, 2048.0, 1e5], &[0.01, 0.1, 0.5, 1.0]]);
    inputs.extend(random(17, 2000, [(0.25, 1e5), (0.01, 1.0)]));
    check(BRDF, "phong_albedo(x[0], x[1])", &inputs, |_| 1e-5, 1e-30, |x| phong_albedo(x[0], x[1]));
}

#[test]
fn lobes_are_about_their_mean_direction() {
    let inputs = grid([&[0.1, 0.3, 0.5, 0.7, 0.85, 1.0], &[0.3, 0.5, 0.7, 0.9]]);
    let axis = "lobe_axis(coded_ggx(x[0], 1.0), vec3(0.0, 0.0, 1.0), -vec3(sqrt(1.0 - x[1] * x[1]), 0.0, x[1]))";
    // Angle from the normal, positive away from the viewer.
    let angle = format!("vec4(atan(-{axis}.x, {axis}.z), 0.0, 0.0, 0.0)");
    let mean = |x: &[f64; 2]| {
        let ggx = lobe(1.0, 1.0, x[0], x[1]);
        let mirrored = dvec3(-(1.0 - x[1] * x[1]).sqrt(), 0.0, x[1]);
        let part = |of: fn(DVec3) -> f64| hemisphere(mirrored, x[0] * x[0], |way| ggx.brdf(way).x * way.z * of(way));
        [f64::atan2(-part(|way| way.x), part(|way| way.z)), 0.0, 0.0, 0.0]
    };
    // Three degrees.
    check4(BRDF, &angle, &inputs, |_| (0.0, 0.053), mean);
}

#[test]
fn fitted_lobes_are_the_twins_and_phong_stays_as_it_is() {
    let mut inputs = random(18, 2000, [(0.045, 1.0), (0.0, 1.0), (-0.1, 1.0)]);
    inputs.push([0.045, 1.0, 1.0]);
    let call = "fitted_lobe(vec3(x[1], 1.0, 0.5), coded_ggx(x[0], 1.0), x[2])";
    let expression = format!("vec4({call}.albedo, {call}.exponent)");
    let twin = |x: &[f64; 3]| {
        let lobe = material::Lobe::Ggx {
            f0: vec3(x[1] as f32, 1.0, 0.5),
            f90: 1.0,
            roughness: x[0] as f32,
            metallic: 1.0,
            dielectric: Vec3::ZERO,
            dielectric_f90: 1.0,
        };
        let material = fitted(&Reflectance { base: Vec3::ZERO, lobe, transmission: 0.0, over: Over::default() }, x[2]);
        material.specular.extend(material.exponent).to_array()
    };
    check4(BRDF, &expression, &inputs, |_| (1e-4, 1e-5), twin);
    let call = "fitted_lobe(vec3(x[0], x[1], 1.0), x[2], x[1])";
    let expression = format!("vec4({call}.albedo, {call}.exponent)");
    let inputs = random(19, 500, [(0.0, 1.0), (0.0, 1.0), (0.0, 1e5)]);
    check4(BRDF, &expression, &inputs, |_| (0.0, 0.0), |x| [x[0], x[1], 1.0, x[2]]);
}

// Fits.

#[test]
fn albedos_are_the_integrals_within_half_a_percent() {
    let (mut worst, mut worst_white) = (0.0_f64, 0.0_f64);
    for roughness in ROUGHNESSES {
        for cosine in [LEAST_COSINE, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 1.0] {
            let once = scattered_once(roughness, cosine);
            for (f0, f90) in [(0.02, 1.0), (0.04, 1.0), (0.5, 1.0), (1.0, 1.0), (0.0, 1.0), (0.04, 0.0)] {
                // The lobe's term for multiple scattering is the same on both sides.
                let lobe = lobe(f0, f90, roughness, cosine);
                let truth = integrated(&lobe);
                worst = worst.max((lobe.albedo().x - truth).abs());
                assert!((albedo(f0, f90, once) - lobe.albedo().x).abs() < 1e-12);
                if f0 == 1.0 {
                    worst_white = worst_white.max((truth - 1.0).abs());
                }
            }
        }
    }
    println!("largest albedo error {worst:.4}, of a white metal {worst_white:.4}");
    assert!(worst < 0.005 && worst_white < 0.005, "{worst} {worst_white}");
}

#[test]
fn what_is_sent_on_is_the_mean_over_the_hemisphere() {
    let mut worst = 0.0_f64;
    for (roughness, metallic) in ROUGHNESSES.into_iter().flat_map(|r| [(r, 0.0), (r, 1.0)]) {
        let roughness_of = roughness as f32;
        let base_color = Vec4::new(0.6, 0.6, 0.6, 1.0);
        let material = Material { base_color, metallic, roughness: roughness_of, ..Material::default() };
        let r = material.reflectance(&Scene::default(), Default::default(), Vec4::ONE);
        let mean = hemisphere(DVec3::Z, 1.0, |way| {
            let glossy = Lobe::new(&r, DVec3::Z, -way).albedo().x;
            (f64::from(r.diffuse(way.z).x) + glossy) * way.z
        }) / PI;
        let own = f64::from(r.sent_on().x);
        println!("roughness {roughness}, metallic {metallic}: {own:.4}, integral {mean:.4}");
        worst = worst.max((own / mean - 1.0).abs());
    }
    for exponent in [1.0, 4.0, 30.0, 1000.0] {
        let own = phong_albedo(exponent, MEAN_PHONG_COSINE);
        let mean = hemisphere(DVec3::Z, 1.0, |way| phong_albedo(exponent, way.z) * way.z) / PI;
        println!("exponent {exponent}: {own:.4}, integral {mean:.4}");
        worst = worst.max((own / mean - 1.0).abs());
    }
    assert!(worst < 0.03, "{worst}");
}

#[test]
fn samples_are_as_dense_as_they_say() {
    let mut random = Random(5);
    for (roughness, cosine) in [(0.1, 0.7), (0.3, 0.1), (0.5, 0.5), (1.0, 0.9), (1.0, 0.05)] {
        let lobe = lobe(0.3, 1.0, roughness, cosine);
        let (mut reflected, mut even) = (0.0, 0.0);
        const COUNT: usize = 200_000;
        for _ in 0..COUNT {
            let towards = lobe.sample(DVec2::new(random.next(), random.next()));
            let density = lobe.density(towards);
            assert!(density > 0.0);
            if towards.z > 0.0 {
                reflected += lobe.brdf(towards).x * towards.z / density / COUNT as f64;
                even += 1.0 / COUNT as f64;
            }
        }
        let axis = at(cosine, PI);
        let truth = hemisphere(axis, roughness * roughness, |towards| lobe.brdf(towards).x * towards.z);
        assert!((integrated(&lobe) / truth - 1.0).abs() < 0.003, "{} {truth}", integrated(&lobe));
        let above = hemisphere(axis, roughness * roughness, |towards| lobe.density(towards));
        println!(
            "roughness {roughness}, cosine {cosine}: reflected {reflected:.4}, integral {truth:.4}; above the horizon {even:.4}, integral {above:.4}"
        );
        assert!((reflected / truth - 1.0).abs() < 0.01 && (even / above - 1.0).abs() < 0.01);
    }
}

#[test]
fn fitted_lobes_have_the_energy_and_about_the_shape() {
    println!("roughness, k, energy error, relative L2 error at cosines 1, .8, .5, .3");
    let mut all = 0.0;
    for roughness in ROUGHNESSES.into_iter().skip(2) {
        let (mut energy, mut errors) = (0.0_f64, Vec::new());
        let lobe_of = material::Lobe::Ggx {
            f0: Vec3::ONE,
            f90: 1.0,
            roughness: roughness as f32,
            metallic: 1.0,
            dielectric: Vec3::ZERO,
            dielectric_f90: 1.0,
        };
        let mut exponent = 0.0;
        for cosine in [1.0, 0.8, 0.5, 0.3] {
            let ggx = lobe(1.0, 1.0, roughness, cosine);
            let fit = fitted(
                &Reflectance { base: Vec3::ZERO, lobe: lobe_of, transmission: 0.0, over: Over::default() },
                cosine,
            );
            // Only caches cap the exponent, so this is the fit without the cap.
            exponent = lightskin::scene::ggx::fitted_exponent(roughness);
            let axis = at(cosine, PI);
            let width = roughness * roughness;
            let error = |k: f64| {
                let rho = integrated(&ggx) / hemisphere(axis, width, |w| phong_lobe(k, axis.dot(w)) * w.z);
                let off =
                    hemisphere(axis, width, |w| ((ggx.brdf(w).x - rho * phong_lobe(k, axis.dot(w))) * w.z).powi(2));
                (off / hemisphere(axis, width, |w| (ggx.brdf(w).x * w.z).powi(2))).sqrt()
            };
            errors.push(error(exponent));
            let given = hemisphere(axis, (1.0 / (fit.exponent + 1.0)).sqrt(), |w| {
                fit.specular.x * phong_lobe(fit.exponent, axis.dot(w)) * w.z
            });
            energy = energy.max((given - integrated(&ggx)).abs());
        }
        let mean = |e: &[f64]| e.iter().sum::<f64>() / e.len() as f64;
        let shown: Vec<String> = errors.iter().map(|e| format!("{e:.3}")).collect();
        println!("{roughness:.2} {exponent:10.2} {energy:.4} {}", shown.join(" "));
        assert!(energy < 0.01, "{roughness}: {energy}");
        all += mean(&errors) / (ROUGHNESSES.len() - 2) as f64;
    }
    println!("mean {all:.3}");
    assert!(all < 0.45, "{all}");
}

// Pictures.

/// A uniformly glowing box with a floor of the material in it. Returns the floor's radiance over the box's, seen at
/// this cosine.
pub(crate) fn in_a_furnace(material: Material, cosine: f64) -> f64 {
    let mut scene = Scene::default();
    let inwards = cuboid(Vec3::NEG_ONE, Vec3::ONE, 2.0, |_| true).reversed();
    add(&mut scene, inwards, Material { emissive: Vec3::ONE, ..phong([0.0; 3], [0.0; 3], 1.0) }, DAffine3::IDENTITY);
    let floor = quad(vec3(-0.05, -0.9, -0.05), Vec3::Z * 0.1, Vec3::X * 0.1, 1.0);
    add(&mut scene, floor, material, DAffine3::IDENTITY);
    let from = dvec3((1.0 - cosine * cosine).sqrt(), cosine, 0.0) * 0.8;
    scene.cameras.push(camera(from - 0.9 * DVec3::Y, -0.9 * DVec3::Y, 0.001));
    let settings = PathTraceSettings {
        size: [2, 2],
        bounces: Some(0),
        sources: Sources::Surfaces,
        ..PathTraceSettings::default()
    };
    let mut trace = PathTrace::new(&scene, &scene.cameras[0], &settings);
    while trace.samples() < 8192 {
        trace.pass();
    }
    let direct = trace.direct();
    direct.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / (3 * direct.len()) as f64
}

#[test]
fn white_materials_vanish_in_a_furnace() {
    for metallic in [0.0, 0.5, 1.0] {
        for roughness in [0.0, 0.1, 0.3, 0.6, 0.8, 1.0] {
            for cosine in [1.0, 0.5, 0.15] {
                let material = Material { base_color: Vec4::ONE, metallic, roughness, ..Material::default() };
                let radiance = in_a_furnace(material, cosine);
                println!("metallic {metallic}, roughness {roughness}, cosine {cosine}: {radiance:.4}");
                assert!((radiance - 1.0).abs() < 0.01, "{metallic} {roughness} {cosine}: {radiance}");
            }
        }
    }
}

#[test]
fn direct_light_on_metallic_roughness_is_the_references() {
    let gpu = gpu();
    for kind in [SPOT, LightKind::Point, LightKind::Directional] {
        for (metallic, roughness, specular) in [
            (0.0, 0.0, 1.0),
            (0.0, 0.3, 0.6),
            (0.0, 1.0, 1.0),
            (0.5, 0.2, 1.0),
            (1.0, 0.08, 1.0),
            (1.0, 0.5, 1.0),
            (1.0, 1.0, 1.0),
        ] {
            let mut scene = Scene::default();
            let base_color = Vec4::new(0.7, 0.5, 0.3, 1.0);
            let tilt = DAffine3::from_rotation_x(0.2);
            let material = Material { base_color, metallic, roughness, specular, ..Material::default() };
            add(&mut scene, quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 1.0), material.clone(), tilt);
            scene.lights.push(lamp(kind));
            scene.cameras.push(camera(dvec3(0.5, 2.0, 1.5), DVec3::ZERO, 0.5));
            let settings = Knobs { gi: Gi::Off, ..small() };
            let shot = shoot(&gpu, &scene, None, &settings);
            let eye = scene.cameras[0].world_from_camera.translation;
            let own = material.reflectance(&scene, Default::default(), Vec4::ONE);
            let radiance = |s: &crate::common::frames::PixelSurface| {
                let direction = (s.position - eye).normalize();
                let towards = light::facing_irradiance(&scene.lights[0], s.position).1;
                // The G-buffer stores F0 and the diffuse albedo as 16-bit floats.
                let lobe = match Lobe::new(&own, s.normal, direction) {
                    Lobe::Ggx { f90, roughness, normal, view, .. } => {
                        Lobe::Ggx { f0: shot.specular[s.pixel], f90, roughness, normal, view }
                    }
                    phong @ Lobe::Phong { .. } => phong,
                };
                let diffuse = own.diffuse(-s.normal.dot(direction)).as_dvec3();
                assert!(shot.albedo[s.pixel].distance(diffuse) < 1e-3, "{} {diffuse}", shot.albedo[s.pixel]);
                (shot.albedo[s.pixel] * DIFFUSE_LOBE + lobe.brdf(towards))
                    * light::direct_irradiance(&scene.lights[0], s.position, s.normal)
            };
            let twins: Vec<_> = seen(&scene, settings.size).iter().map(|s| (s.pixel, radiance(s))).collect();
            assert_picture(
                &shot.direct,
                &twins,
                1e-3,
                &format!("{kind:?}, metallic {metallic}, roughness {roughness}"),
            );
        }
    }
}

#[test]
fn spheres_in_the_sun_are_the_path_tracers() {
    let gpu = gpu();
    let scene = spheres();
    let size = [768, 256];
    let shot = shoot(
        &gpu,
        &scene,
        None,
        &Knobs { gi: Gi::Off, light_shadows: LightShadows::Maps(2048), ..Knobs::plain(size) },
    );
    let trace = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings { size, ..PathTraceSettings::default() });
    let truth = trace.direct();
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    let rgb: Vec<[f32; 3]> = shot.direct.iter().map(|v| v.as_vec3().to_array()).chain(truth.iter().copied()).collect();
    let shown: Vec<u8> = rgb
        .iter()
        .flat_map(|c| c.map(|c| (255.0 * (c / 400.0).min(1.0).powf(1.0 / 2.2)) as u8).into_iter().chain([255]))
        .collect();
    lightskin::image::write_png(&folder.join("spheres.png"), size[0], 2 * size[1], &shown).expect("written");
    let surfaces = trace.surfaces();
    for (row, column) in (0..2).flat_map(|row| (0..6).map(move |column| (row, column))) {
        let middle = dvec3(1.15 * (f64::from(column) - 2.5), 1.15 * (f64::from(row) - 0.5), 0.0);
        let (mut own, mut other, mut off) = (0.0, 0.0, Vec::new());
        for (pixel, surface) in surfaces.iter().enumerate() {
            if surface.is_some_and(|s| s.position.distance(middle) < 0.51) {
                let (a, b) = (shot.direct[pixel].element_sum(), f64::from(truth[pixel].iter().sum::<f32>()));
                own += a;
                other += b;
                off.push((a - b).abs() / (b + 0.1));
            }
        }
        off.sort_by(f64::total_cmp);
        let (bias, median) = (own / other - 1.0, off[off.len() / 2]);
        let roughness = f64::from(column) / 5.0;
        println!("metallic {row}, roughness {roughness}: bias {bias:+.5}, median {median:.6} of {}", off.len());
        // The highlight of the smoothest metal is narrower than a pixel: a rasteriser's grid decides what of it shows.
        let bound = if shot.subpixels.is_some() && roughness < 0.1 { 0.03 } else { 0.01 };
        assert!(bias.abs() < bound && median < 1e-3, "{row} {column}: {bias} {median}");
    }
}
