//! Clear coats and sheen: shaders against their f64 twins, fits against integrals, furnace tests, and pictures against
//! the path tracer.

use std::f64::consts::TAU;

use glam::{Affine2, DAffine3, DVec3, Vec3, Vec4, dvec3, vec3};
use lightskin::frame::{Antialiasing, LightShadows, Near, Shadows, World};
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::lab::scenes::coats;
use lightskin::metrics::metrics;
use lightskin::reference::brdf::hemisphere;
use lightskin::reference::coat::{Coat, Sheen};
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::{quad, sphere};
use lightskin::scene::gltf::load;
use lightskin::scene::material::Over;
use lightskin::scene::sheen;
use lightskin::scene::sky::Sky;
use lightskin::scene::write::write_glb;
use lightskin::scene::{Image, LightKind, Material, Sampler, Scene, Texture, Wrap};

use crate::brdf::in_a_furnace;
use crate::common::frames::{add, baked, camera, lamp, phong, shoot, small};
use crate::common::gpu;
use crate::shaders::{FEW, check, check4, grid, random};

const COAT: &[&str] = &["shared.glsl", "lib/coat.glsl"];
const ROUGHNESSES: [f64; 7] = [0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0];
const RAYS: Near = Near::Rays { per_pixel: 8, every: 2 };

/// Unit vector above the xy plane with this cosine to +z and this azimuth \[rad\].
fn at(cosine: f64, turn: f64) -> DVec3 {
    let sine = (1.0 - cosine * cosine).sqrt();
    dvec3(sine * turn.cos(), sine * turn.sin(), cosine)
}

/// White sheen on a surface with the normal +z, seen at a cosine.
fn fibres(roughness: f64, cosine: f64) -> Sheen {
    Sheen { color: DVec3::ONE, roughness, normal: DVec3::Z, view: at(cosine, 0.0) }
}

fn body(color: [f32; 3], metallic: f32, roughness: f32) -> Material {
    Material { base_color: Vec3::from(color).extend(1.0), metallic, roughness, ..Material::default() }
}

fn coated(share: f32, roughness: f32, under: Material) -> Material {
    Material { coat: share, coat_roughness: roughness, ..under }
}

fn shiny(color: [f32; 3], roughness: f32, under: Material) -> Material {
    Material { sheen_color: color.into(), sheen_roughness: roughness, ..under }
}

// Shaders.

#[test]
fn sheen_is_the_twins() {
    let rough = ROUGHNESSES.map(|r| r as f32);
    let mut inputs = grid([&rough, &[0.02, 0.3, 0.5, 0.9, 0.999], &[0.02, 0.1, 0.49, 0.51, 1.0], &[0.0, 1.5, 3.1]]);
    inputs.extend(random(31, 3000, [(0.1, 1.0), (0.01, 1.0), (0.01, 1.0), (0.0, 6.3)]));
    let expression = "sheen_reflected(x[0], vec3(0.0, 0.0, 1.0), -vec3(sqrt(1.0 - x[1] * x[1]), 0.0, x[1]), \
                      vec3(sqrt(1.0 - x[2] * x[2]) * vec2(cos(x[3]), sin(x[3])), x[2]))";
    // The expression contains powers of up to 100.
    let twin = |x: &[f64; 4]| fibres(x[0], x[1]).reflected(at(x[2], x[3])).x;
    check(COAT, expression, &inputs, |x| 5e-5 + 2e-6 / (x[0] * x[0]), 1e-6, twin);
    let mut inputs = grid([&rough, &[-1.0, 0.01, 0.1, 0.5, 1.0]]);
    inputs.extend(random(32, 2000, [(0.1, 1.0), (0.0, 1.0)]));
    check(COAT, "sheen_whole(x[0], x[1])", &inputs, |_| 3e-5, 1e-6, |x| sheen::whole(x[0], x[1]));
}

#[test]
fn what_is_packed_is_read_again() {
    let unit = (0.0, 1.0);
    let inputs = random(33, 2000, [unit, unit, unit, unit, unit, unit, (-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0)]);
    let coat = "unpack_coat(pack_coat(Coat(normalize(v(6) + 1e-3), x[0], x[1], v(2), x[5])))";
    let half = |_: &_| (0.0, 0.6 / 65535.0);
    check4(COAT, &format!("vec4({coat}.share, {coat}.roughness, {coat}.sheen.xy)"), &inputs, half, |x| {
        [x[0], x[1], x[2], x[3]]
    });
    let expression = format!("vec4({coat}.sheen.z, {coat}.sheen_roughness, length({coat}.normal), 0.0)");
    check4(COAT, &expression, &inputs, half, |x| [x[4], x[5], 1.0, 0.0]);
    // Angle between the normals.
    let angle = format!("length(cross({coat}.normal, normalize(v(6) + 1e-3)))");
    check(COAT, &angle, &inputs, |_| 0.0, 6e-5, |_| 0.0);
}

#[test]
fn lobes_under_coats_have_their_share_of_the_light() {
    let unit = (0.0, 1.0);
    let inputs = random(34, 3000, [(0.2, 1.0), unit, (0.3, 1.0), (0.5, 1.0), (0.1, 1.0), (0.05, 1.0), (0.0, 6.3)]);
    // Remaining fraction of a coloured lobe, divided by the requested fraction. f0 is (x[1], 1, .3).
    let r = "Reflectance(vec3(0.5), vec3(x[1], 1.0, 0.3), coded_ggx(x[0], x[2]))";
    let lobe = |r: &str| {
        format!(
            "ggx_lobe({r}.glossy, coded_f90({r}.coded), coded_roughness({r}.coded), vec3(0.0, 0.0, 1.0), \
             -vec3(sqrt(1.0 - x[4] * x[4]), 0.0, x[4]), vec3(sqrt(1.0 - x[5] * x[5]) * vec2(cos(x[6]), sin(x[6])), x[5]))"
        )
    };
    let expression =
        format!("vec4({} / max({} * x[3], vec3(1e-9)), 0.0)", lobe(&format!("dimmed({r}, x[3], x[4])")), lobe(r));
    // The reflectance at the horizon has 8 bits, and three colours share it.
    check4(COAT, &expression, &inputs, |_| (0.0, 0.07), |_| [1.0, 1.0, 1.0, 0.0]);
    let expression = format!("vec4(dimmed({r}, x[3], x[4]).diffuse, 0.0)");
    check4(COAT, &expression, &inputs, |_| (FEW, 0.0), |x| [0.5 * x[3], 0.5 * x[3], 0.5 * x[3], 0.0]);
}

/// A coat over sheen over a surface with the normal +z, from the nine numbers that the shader gets, too.
fn over(x: &[f64; 9]) -> Coat {
    let over = Over {
        coat: x[0] as f32,
        coat_roughness: x[1] as f32,
        sheen: vec3(x[2] as f32, 0.5, 0.1),
        sheen_roughness: x[3] as f32,
    };
    Coat::new(&over, [DVec3::Z, normal_of(x)], -at(x[5], 0.0))
}

/// The coat's normal.
fn normal_of(x: &[f64; 9]) -> DVec3 {
    dvec3(0.2 * x[4], 0.0, (1.0 - 0.04 * x[4] * x[4]).sqrt())
}

#[test]
fn what_lies_over_a_surface_is_the_twins() {
    let unit = (0.0, 1.0);
    let rough = (0.1, 1.0);
    let inputs = random(35, 3000, [unit, rough, unit, rough, unit, (0.05, 1.0), (0.02, 1.0), (0.0, 6.3), unit]);
    let coat = "Coat(vec3(0.2 * x[4], 0.0, sqrt(1.0 - 0.04 * x[4] * x[4])), x[0], x[1], vec3(x[2], 0.5, 0.1), x[3])";
    let z = "vec3(0.0, 0.0, 1.0)";
    let looking = "-vec3(sqrt(1.0 - x[5] * x[5]), 0.0, x[5])";
    let albedo = format!("albedo_of({coat}, {z}, {looking})");
    let expression = format!("vec4({albedo}.coat, {albedo}.sheen.xy, {albedo}.under)");
    check4(
        COAT,
        &expression,
        &inputs,
        |_| (1e-4, 2e-5),
        |x| {
            let twin = over(x);
            let shone = (1.0 - twin.coated) * sheen::albedo(x[3], x[5]);
            [twin.coated, shone * x[2], shone * 0.5, twin.under]
        },
    );
    let towards = "vec3(sqrt(1.0 - x[6] * x[6]) * vec2(cos(x[7]), sin(x[7])), x[6])";
    let expression = format!("vec4(coat_reflected({coat}, {albedo}, {z}, {looking}, {towards}), 0.0)");
    check4(
        COAT,
        &expression,
        &inputs,
        |x| (1e-4 + 2e-6 / (x[1] * x[1] * x[1] * x[1]).min(x[3] * x[3]), 2e-5),
        |x| {
            let (twin, towards) = (over(x), at(x[6], x[7]));
            (twin.reflected(towards) + twin.shone(towards)).extend(0.0).to_array()
        },
    );
}

// Fits.

#[test]
fn sheens_albedo_is_the_integral() {
    let mut worst = 0.0_f64;
    for roughness in ROUGHNESSES {
        for cosine in [0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0] {
            let fibres = fibres(roughness, cosine);
            // Steps are uniform in the angle from the normal, where sheen changes fast. In azimuth they are dense
            // opposite the viewer.
            let (mut integral, steps) = (0.0, 300);
            for (i, j) in (0..steps).flat_map(|i| (0..steps).map(move |j| (i, j))) {
                let part = |i: i32| (f64::from(i) + 0.5) / f64::from(steps);
                let (angle, turn) = (part(i) * TAU / 4.0, part(j).powi(2) * TAU / 2.0);
                let area = angle.sin() * (TAU / 4.0) * part(j) * TAU / f64::from(steps).powi(2);
                integral += 2.0 * area * fibres.whole(at(angle.cos(), turn + TAU / 2.0));
            }
            let off = (sheen::whole(roughness, cosine) - integral) / integral.max(1.0);
            worst = worst.max(off.abs());
            assert!(
                off.abs() < 0.006,
                "roughness {roughness}, cosine {cosine}: relative error {off:.4}, integral {integral:.4}"
            );
        }
    }
    println!("largest error of the sheen's albedo: {worst:.4}");
}

#[test]
fn the_rings_of_the_hemisphere_are_the_same_integral() {
    let rings = hemisphere(DVec3::Z, 1.0, |way| fibres(0.6, 0.5).whole(way));
    assert!((rings - sheen::whole(0.6, 0.5)).abs() < 0.006, "{rings}");
}

#[test]
fn nothing_gives_more_light_than_it_gets() {
    let white = || body([1.0; 3], 0.0, 1.0);
    let all = [
        // A white body keeps all light under any coat or sheen.
        (coated(1.0, 0.0, white()), true),
        (coated(1.0, 0.5, body([1.0; 3], 1.0, 0.4)), true),
        (coated(0.5, 1.0, white()), true),
        (shiny([1.0; 3], 0.1, white()), true),
        (shiny([1.0; 3], 0.5, body([1.0; 3], 1.0, 0.8)), true),
        (coated(1.0, 0.2, shiny([1.0; 3], 1.0, white())), true),
        (shiny([1.0, 0.2, 0.0], 0.0, white()), false),
        (shiny([1.0; 3], 0.3, body([0.0; 3], 0.0, 1.0)), false),
    ];
    for (material, keeps) in all {
        for cosine in [1.0, 0.4, 0.1] {
            let radiance = in_a_furnace(material.clone(), cosine);
            let (coat, rough) = (material.coat, [material.coat_roughness, material.sheen_roughness]);
            println!("coat {coat}, sheen {}, {rough:?}, cosine {cosine}: {radiance:.4}", material.sheen_color);
            assert!(radiance < 1.01 && (!keeps || radiance > 0.99), "{radiance}: {material:?}");
        }
    }
}

// Pictures.

/// Bias of a picture, and the median of the pixels' relative errors.
fn against(shown: &[DVec3], truth: &[[f32; 3]], of: impl Fn(usize) -> bool) -> [f64; 2] {
    let (mut own, mut other, mut off) = (0.0, 0.0, Vec::new());
    for (pixel, (shown, truth)) in shown.iter().zip(truth).enumerate().filter(|(pixel, _)| of(*pixel)) {
        let (shown, truth) = (shown.element_sum(), truth.iter().map(|c| f64::from(*c)).sum::<f64>());
        assert!(shown.is_finite(), "{pixel}");
        own += shown;
        other += truth;
        off.push((shown - truth).abs() / (truth + 0.1));
    }
    off.sort_by(f64::total_cmp);
    [own / other - 1.0, off[off.len() / 2]]
}

#[test]
fn spheres_under_a_lamp_are_the_path_tracers() {
    let gpu = gpu();
    let scene = coats();
    let size = [150, 150];
    let trace = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::of(size));
    let (truth, surfaces) = (trace.direct(), trace.surfaces());
    // For visual inspection with `render` and `render --gi path-trace`.
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    write_glb(&scene, &folder.join("coats.glb")).expect("written");
    for light_shadows in [LightShadows::Rays, LightShadows::Maps(4096)] {
        let knobs = Knobs { gi: Gi::Off, light_shadows, ..Knobs::plain(size) };
        let shot = shoot(&gpu, &scene, None, &knobs);
        let mut worst = [0.0_f64; 2];
        for (row, column) in (0..6).flat_map(|row| (0..6).map(move |column| (row, column))) {
            let middle = dvec3(1.15 * (f64::from(column) - 2.5), 1.15 * (2.5 - f64::from(row)), 0.0);
            let is_own = |pixel: usize| surfaces[pixel].is_some_and(|s| s.position.distance(middle) < 0.51);
            let [bias, median] = against(&shot.direct, &truth, is_own);
            worst = [worst[0].max(bias.abs()), worst[1].max(median)];
            // Shadow maps are coarse where the lamp is near the horizon.
            let most = if light_shadows == LightShadows::Rays { 0.002 } else { 0.01 };
            assert!(bias.abs() < most && median < 2e-3, "{row} {column}: {bias:+.5} {median:.5}");
        }
        println!("{light_shadows:?}: bias at most {:.5}, median error at most {:.6}", worst[0], worst[1]);
    }
}

/// A row of balls, one for each material.
fn balls(materials: &[Material]) -> Scene {
    let mut scene = Scene { name: "balls".into(), ..Scene::default() };
    for (i, material) in materials.iter().enumerate() {
        let x = 1.2 * (i as f64 - 0.5 * (materials.len() - 1) as f64);
        add(&mut scene, sphere(0.5, 24), material.clone(), DAffine3::from_translation(dvec3(x, 0.0, 0.0)));
    }
    scene.cameras.push(camera(dvec3(0.0, 1.0, 4.3), DVec3::ZERO, 0.3));
    scene
}

fn various() -> [Material; 4] {
    [
        coated(1.0, 0.05, body([0.6, 0.1, 0.05], 0.0, 0.8)),
        coated(0.8, 0.4, body([0.9, 0.7, 0.3], 1.0, 0.5)),
        shiny([0.9, 0.3, 0.8], 0.3, body([0.02, 0.02, 0.05], 0.0, 0.9)),
        coated(0.5, 0.2, shiny([0.2, 0.5, 1.0], 0.8, body([0.5, 0.3, 0.2], 0.0, 1.0))),
    ]
}

/// Path-traced direct light, and the ball that each pixel shows.
fn paths(scene: &Scene, size: [u32; 2], passes: usize) -> (Vec<[f32; 3]>, Vec<Option<usize>>) {
    let mut paths = PathTrace::new(scene, &scene.cameras[0], &PathTraceSettings::engine(size, 0));
    (0..passes).for_each(|_| paths.pass());
    let places: Vec<DVec3> = scene.instances.iter().map(|i| i.world_from_model.translation).collect();
    let ball = |at: DVec3| places.iter().position(|middle| at.distance(*middle) < 0.51);
    let shown = paths.surfaces().iter().map(|surface| surface.and_then(|s| ball(s.position))).collect();
    (paths.direct(), shown)
}

#[test]
fn spheres_under_an_even_sky_are_the_path_tracers() {
    let gpu = gpu();
    // A single ball that nothing occludes reflects uniform light.
    for (i, material) in various().into_iter().enumerate() {
        let mut scene = balls(&[material]);
        Sky::even(Vec3::splat(1000.0)).put_over(&mut scene, 4);
        let size = [32, 32];
        let (truth, ball) = paths(&scene, size, 8);
        let caches = baked(&scene, 0.5, 8);
        for (near, shadows) in [(RAYS, Shadows::PerLight), (Near::Off, Shadows::Off)] {
            let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { size, near, shadows, bounces: 0, ..small() });
            let [bias, median] = against(&shot.direct, &truth, |pixel| ball[pixel].is_some());
            println!("{near:?}, ball {i}: bias {bias:+.4}, median error {median:.4}");
            assert!(bias.abs() < 0.02 && median < 0.02, "{near:?} {i}: {bias} {median}");
        }
    }
}

#[test]
fn area_lights_are_the_path_tracers() {
    let gpu = gpu();
    // Only coats and sheen have lobes here.
    let matt = |color| Material { specular: 0.0, ..body(color, 0.0, 1.0) };
    let mut scene = balls(&[
        coated(1.0, 0.1, matt([0.2; 3])),
        coated(0.8, 0.4, matt([0.0; 3])),
        shiny([0.9, 0.3, 0.8], 0.3, matt([0.0; 3])),
        coated(0.5, 0.2, shiny([0.2, 0.5, 1.0], 0.8, matt([0.5, 0.3, 0.2]))),
    ]);
    let lamp = quad(vec3(-1.5, 2.5, 1.0), Vec3::X * 3.0, vec3(0.0, 1.5, 2.0), 10.0);
    add(
        &mut scene,
        lamp,
        Material { emissive: Vec3::splat(100.0), ..phong([0.0; 3], [0.0; 3], 1.0) },
        DAffine3::IDENTITY,
    );
    let size = [128, 32];
    let (truth, balls) = paths(&scene, size, 8);
    for light_shadows in [LightShadows::Rays, LightShadows::Maps(1024)] {
        let shot = shoot(&gpu, &scene, None, &Knobs { size, light_shadows, gi: Gi::Off, ..small() });
        for ball in 0..4 {
            let [bias, median] = against(&shot.direct, &truth, |pixel| balls[pixel] == Some(ball));
            println!("{light_shadows:?}, ball {ball}: bias {bias:+.4}, median error {median:.4}");
            assert!(bias.abs() < 0.03 && median < 0.08, "{light_shadows:?} {ball}: {bias} {median}");
        }
    }
}

#[test]
fn textures_say_where_coats_and_sheen_are() {
    let gpu = gpu();
    let rgba = vec![255, 0, 40, 255, 128, 255, 200, 128, 0, 80, 255, 30, 200, 30, 90, 200];
    let image = Image { name: "four".into(), width: 2, height: 2, rgba };
    let sampler = Sampler { wrap_u: Wrap::Clamp, wrap_v: Wrap::Clamp, nearest: true };
    let texture = Some(Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler });
    let plain = shiny([0.9, 0.8, 1.0], 0.9, coated(0.9, 0.8, body([0.5, 0.3, 0.1], 0.0, 0.6)));
    let all = [
        Material { coat_texture: texture, ..plain.clone() },
        Material { coat_roughness_texture: texture, ..plain.clone() },
        Material { sheen_color_texture: texture, ..plain.clone() },
        Material { sheen_roughness_texture: texture, ..plain.clone() },
    ];
    let mut pictures = Vec::new();
    for material in [plain].into_iter().chain(all) {
        let mut scene = Scene { images: vec![image.clone()], ..Scene::default() };
        let mut floor = quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 2.0);
        floor.vertices.iter_mut().for_each(|v| v.uv0 = glam::vec2(v.position.x, v.position.z) * 0.5 + 0.5);
        add(&mut scene, floor, material, DAffine3::IDENTITY);
        scene.lights.push(lamp(LightKind::Directional));
        scene.cameras.push(camera(dvec3(-1.5, 1.2, -0.6), DVec3::ZERO, 0.7));
        let shown = shoot(&gpu, &scene, None, &Knobs { gi: Gi::Off, ..small() });
        let trace = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::of([48, 48]));
        let [bias, median] = against(&shown.direct, &trace.direct(), |pixel| shown.covered[pixel]);
        println!("bias {bias:+.5}, median error {median:.6}");
        assert!(bias.abs() < 0.005 && median < 2e-3, "{bias} {median}");
        pictures.push(shown.direct);
    }
    assert!(pictures[1..].iter().all(|picture| *picture != pictures[0]), "each texture must change the picture");
}

#[test]
fn every_kind_of_frame_is_clean() {
    let gpu = gpu();
    let mut scene = balls(&various());
    let glass = Material { transmission: 0.6, ..coated(1.0, 0.1, body([0.9, 0.5, 0.4], 0.0, 0.2)) };
    add(&mut scene, quad(vec3(-2.0, -0.6, 0.7), Vec3::X * 2.0, Vec3::Y, 0.5), glass, DAffine3::IDENTITY);
    let floor = quad(vec3(-3.0, -0.5, -2.0), Vec3::Z * 4.0, Vec3::X * 6.0, 1.0);
    add(&mut scene, floor, phong([0.5; 3], [0.2; 3], 20.0), DAffine3::IDENTITY);
    scene.lights.push(lamp(LightKind::Point));
    let caches = baked(&scene, 0.8, 8);
    let mut under_sky = scene.clone();
    Sky::even(Vec3::splat(100.0)).put_over(&mut under_sky, 4);
    let by_cells = caches.clone().with_cells(&under_sky).expect("cells");
    let (maps, rays) = (LightShadows::Maps(64), LightShadows::Rays);
    let (off, four) = (Antialiasing::Off, Antialiasing::Four);
    for (scene, caches, gi, near, light_shadows, antialiasing) in [
        (&scene, &caches, Gi::Off, Near::Off, maps, four),
        (&scene, &caches, Gi::BruteForce, Near::Off, rays, off),
        (&under_sky, &caches, Gi::LightSkin, RAYS, rays, four),
        (&under_sky, &caches, Gi::LightSkin, Near::Off, maps, off),
        (&under_sky, &by_cells, Gi::LightSkin, RAYS, rays, off),
    ] {
        let (size, shadows) = ([40, 14], Shadows::PerLight);
        let knobs = Knobs { gi, near, shadows, light_shadows, antialiasing, size, layers: 1, ..small() };
        let shot = shoot(&gpu, scene, Some(caches), &knobs);
        assert!(shot.direct.iter().any(|p| *p != DVec3::ZERO), "{knobs:?}");
    }
}

#[test]
fn glass_under_a_coat_lets_the_light_of_paths_through() {
    let gpu = gpu();
    let mut scene = Scene::default();
    let base = || body([0.9, 0.6, 0.4], 0.0, 0.3);
    let glass = Material { transmission: 0.8, alpha_cutoff: Some(f32::INFINITY), ..base() };
    let pane = shiny([0.3, 0.2, 0.6], 0.6, coated(0.7, 0.5, glass));
    add(&mut scene, quad(vec3(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, 2.0), pane, DAffine3::IDENTITY);
    let wall = Material { emissive: vec3(50.0, 60.0, 70.0), ..phong([0.0; 3], [0.0; 3], 1.0) };
    add(&mut scene, quad(vec3(-2.0, -2.0, -1.0), Vec3::X * 4.0, Vec3::Y * 4.0, 2.0), wall, DAffine3::IDENTITY);
    scene.lights.push(lamp(LightKind::Point));
    scene.cameras.push(camera(dvec3(1.5, 0.4, 2.0), DVec3::ZERO, 0.5));
    let size = [24, 24];
    let knobs = Knobs { gi: Gi::Off, size, light_shadows: LightShadows::Rays, ..small() };
    let shown = shoot(&gpu, &scene, None, &knobs).direct;
    let settings = PathTraceSettings {
        sources: lightskin::reference::path_trace::Sources::Punctual,
        ..PathTraceSettings::of(size)
    };
    let truth = PathTrace::new(&scene, &scene.cameras[0], &settings).direct();
    let shown: Vec<[f32; 3]> = shown.iter().map(|p| p.as_vec3().to_array()).collect();
    let m = metrics(&shown, &truth);
    println!("bias {:+.5}", m.bias);
    assert!(m.bias.abs() < 0.005, "{m:?}");
}

#[test]
fn scenes_without_have_nothing_of_it() {
    let gpu = gpu();
    let mut scene = balls(&[body([0.5; 3], 0.0, 0.5)]);
    scene.lights.push(lamp(LightKind::Point));
    let has = |scene: &Scene| {
        let world = World::new(&gpu, scene, None).expect("upload");
        let frame = Frame::new(&gpu, scene, &world, &Knobs { gi: Gi::Off, ..small() }).expect("made");
        frame.picture.surface.coat.is_some()
    };
    assert!(!has(&scene));
    scene.materials[0].sheen_color = Vec3::X;
    assert!(has(&scene));
}

/// Light of one bounce that a floor receives from a lit wall of this material, by diffuse bounces only or, with
/// `whole`, by glossy bounces, too.
fn bounced(material: &Material, whole: bool) -> f64 {
    let mut scene = Scene::default();
    let matt = Material { specular: 0.0, ..body([1.0; 3], 0.0, 1.0) };
    add(&mut scene, quad(vec3(0.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 2.0), matt, DAffine3::IDENTITY);
    let wall = quad(vec3(0.0, 0.0, -1.0), Vec3::Y * 2.0, Vec3::Z * 2.0, 2.0);
    add(&mut scene, wall, material.clone(), DAffine3::IDENTITY);
    let mut sun = lamp(LightKind::Directional);
    sun.direction = vec3(-1.0, -0.2, 0.3).normalize();
    scene.lights.push(sun);
    scene.cameras.push(camera(dvec3(1.0, 3.0, 0.01), dvec3(1.0, 0.0, 0.0), 0.6));
    let settings = PathTraceSettings { glossy_bounces: whole, ..PathTraceSettings::engine([16, 16], 1) };
    let mut paths = PathTrace::new(&scene, &scene.cameras[0], &settings);
    (0..16).for_each(|_| paths.pass());
    paths.diffuse().iter().flatten().map(|c| f64::from(*c)).sum()
}

#[test]
fn light_that_is_sent_on_lacks_what_lies_over_a_surface() {
    let matt = |color| Material { specular: 0.0, ..body(color, 0.0, 1.0) };
    let white = bounced(&matt([1.0; 3]), false);
    for (name, material, most) in [
        ("coat over white", coated(1.0, 0.3, matt([1.0; 3])), 0.05),
        ("coat over red", coated(1.0, 0.3, matt([0.6, 0.05, 0.04])), 0.1),
        ("coat over black", coated(1.0, 0.3, matt([0.0; 3])), 0.15),
        ("sheen over white", shiny([1.0; 3], 0.5, matt([1.0; 3])), 0.2),
        ("sheen over grey", shiny([0.5; 3], 0.5, matt([0.3; 3])), 0.2),
        ("sheen over black", shiny([1.0; 3], 0.5, matt([0.0; 3])), 0.3),
    ] {
        let off = (bounced(&material, false) - bounced(&material, true)) / white;
        println!("{name}: error {off:+.3} relative to a white surface");
        assert!(off.abs() < most, "{name}: {off}");
    }
}

// Files.

#[test]
fn files_have_coats_and_sheen() {
    let rgba = vec![255; 16];
    let mut scene = balls(&various());
    scene.images.push(Image { name: "white".into(), width: 2, height: 2, rgba });
    let texture = |u: f32| {
        let transform = Affine2::from_translation(glam::vec2(u, 0.0));
        Some(Texture { image: 0, uv_set: 0, transform, sampler: Sampler::default() })
    };
    scene.materials[3].coat_texture = texture(0.1);
    scene.materials[3].coat_roughness_texture = texture(0.2);
    scene.materials[3].sheen_color_texture = texture(0.3);
    scene.materials[3].sheen_roughness_texture = texture(0.4);
    let path = std::env::temp_dir().join(format!("lightskin_coat_{}.glb", std::process::id()));
    write_glb(&scene, &path).expect("written");
    let told = |scene: &Scene| format!("{:?}", scene.materials).replace("-0.0", "0.0");
    let read = load(&path).expect("read");
    std::fs::remove_file(&path).expect("was there");
    assert_eq!(told(&read), told(&scene));
    assert_eq!(read.notes, [""; 0]);
}

#[test]
fn required_extensions_are_read_and_what_is_left_out_is_told() {
    let folder = crate::cli::folder("coat-required");
    let path = folder.join("a.gltf");
    let triangle = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    let text = serde_json::json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_materials_clearcoat", "KHR_materials_sheen"],
        "extensionsRequired": ["KHR_materials_clearcoat", "KHR_materials_sheen"],
        "buffers": [{ "byteLength": 36, "uri": format!("data:application/octet-stream;base64,{triangle}") }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] }],
        "materials": [{ "extensions": {
            "KHR_materials_clearcoat": { "clearcoatFactor": 2.0, "clearcoatNormalTexture": { "index": 7 } },
            "KHR_materials_sheen": { "sheenColorFactor": [0.5, 0.25, 1.0] },
        } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "nodes": [{ "mesh": 0 }],
        "scenes": [{ "nodes": [0] }],
    });
    std::fs::write(&path, text.to_string()).expect("written");
    let scene = load(&path).expect("read");
    let m = &scene.materials[0];
    assert_eq!((m.coat, m.coat_roughness, m.sheen_color, m.sheen_roughness), (1.0, 0.0, vec3(0.5, 0.25, 1.0), 0.0));
    let notes = scene.notes.join("\n");
    assert!(notes.contains("Normal textures of clear coats") && notes.contains("clearcoatFactor"), "{notes}");
    assert!(!notes.contains("Ignored extensions"), "{notes}");
    let over = m.reflectance(&scene, Default::default(), Vec4::ONE).over;
    assert_eq!((over.coat, f64::from(over.sheen_roughness)), (1.0, f64::from(sheen::LEAST_ROUGHNESS as f32)));
}
