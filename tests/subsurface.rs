//! Subsurface scattering: files, whole frames against brute force and random walks, and physical limits.

use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::bake::NO_CACHE;
use lightskin::frame::check::Check;
use lightskin::frame::{Antialiasing, ClusterRule, LightShadows, Near, Settings, Shadows, View, World};
use lightskin::lab::knobs::{Frame, Gi, Knobs, Path};
use lightskin::metrics::metrics;
use lightskin::reference::dipole::{
    InnerVal, ProxyDipole, brought, diffuse_reflectance, gather, interpolate, on_same_side, widest,
};
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::{CornellSurface, cuboid, quad, sphere};
use lightskin::scene::medium::{Medium, Subsurface};
use lightskin::scene::write::write_glb;
use lightskin::scene::{Light, LightKind, Material, Scene};
use lightskin::shared::{self, HOLLOW};
use serde_json::{Value, json};

use crate::common::frames::{add, baked, camera, lamp, phong, shoot, small};
use crate::common::{Builder, assert_clean, gpu};
use crate::moving;
use crate::views::{compare, plain, room};

pub(crate) fn of(sigma_s: f32, sigma_a: f32, g: f32, ior: f32) -> Subsurface {
    Subsurface { sigma_s: Vec3::splat(sigma_s), sigma_a: Vec3::splat(sigma_a), g, ior, scale: 1.0 }
}

fn filled(inside: Subsurface) -> Material {
    let mut material = Material { roughness: 0.5, specular: 0.0, ..Material::default() };
    material.fill(inside);
    material
}

// Files.

fn file_of(own: &Value) -> Builder {
    let mut file = Builder::triangle();
    file.primitive()["material"] = json!(0);
    file.json["materials"] = json!([{ "name": "body", "extras": { "lightskin": { "subsurface": own } } }]);
    file
}

#[test]
fn files_say_what_is_inside() {
    let loaded = |own: Value| file_of(&own).load("inside").expect("loads").materials[0].clone();
    let marble = loaded(json!({ "preset": "marble", "scale": 10 }));
    assert_eq!(marble.subsurface, Some(Subsurface { scale: 10.0, ..Subsurface::preset("marble").expect("marble") }));
    assert_eq!(marble.metallic, 0.0);
    let own = loaded(json!({ "sigma_s": [1, 2, 3], "sigma_a": [0, 0.5, 1], "g": 0.8, "ior": 1.4 }));
    let expected =
        Subsurface { sigma_s: vec3(1.0, 2.0, 3.0), sigma_a: vec3(0.0, 0.5, 1.0), g: 0.8, ior: 1.4, scale: 1.0 };
    assert_eq!(own.subsurface, Some(expected));
    let color = loaded(json!({ "color": [0.9, 0.5, 0.1], "radius": 0.01 }));
    assert!((color.base_color.truncate() - vec3(0.9, 0.5, 0.1)).abs().max_element() < 1e-4, "{color:?}");
    // Write the scene and read it again.
    let mut scene = file_of(&json!({ "preset": "skin" })).load("inside").expect("loads");
    let path = std::env::temp_dir().join(format!("lightskin-inside-{}.glb", std::process::id()));
    write_glb(&scene, &path).expect("written");
    let again = lightskin::scene::gltf::load(&path).expect("read");
    std::fs::remove_file(&path).expect("removed");
    assert_eq!(again.materials[0].subsurface, scene.materials[0].subsurface);
    scene.materials[0].subsurface = None;
    assert_ne!(again.fingerprint(), scene.fingerprint());
}

#[test]
fn what_is_wrong_inside_is_named() {
    for (own, reason) in [
        (json!({}), "needs one of preset, color with radius, or sigma_s with sigma_a"),
        (json!({ "preset": "glass" }), "has the unknown preset glass; use one of apple, chicken1"),
        (json!({ "preset": "skin", "color": [1, 1, 1] }), "needs one of"),
        (json!({ "preset": 3 }), "preset"),
        (json!({ "color": [0.5, 0.5, 0.5] }), "has a color but no radius"),
        (json!({ "color": [0.5, 0.5, 1.5], "radius": 1 }), "color holds 1.5; 0 to 1 is needed"),
        (json!({ "color": [0.5, 0.5, 0.5], "radius": 0 }), "radius is 0"),
        (json!({ "sigma_s": [1, 1, 1] }), "has sigma_s but no sigma_a"),
        (json!({ "sigma_s": [1, 0, 1], "sigma_a": [1, 0, 1] }), "both 0 in a channel"),
        (json!({ "sigma_s": [1, -1, 1], "sigma_a": [1, 0, 1] }), "sigma_s holds -1"),
        (json!({ "sigma_s": [1, 1], "sigma_a": [1, 0, 1] }), "has 2 numbers where 3 are needed"),
        (json!({ "sigma_s": [1, 1, 1], "sigma_a": [1, 1, 1], "g": 1 }), "g is 1"),
        (json!({ "preset": "skin", "g": 0.5 }), "g needs sigma_s"),
        (json!({ "preset": "skin", "ior": 0.5 }), "ior is 0.5"),
        (json!({ "preset": "skin", "scale": 0 }), "scale is 0"),
        (json!("skin"), "subsurface"),
    ] {
        let error = file_of(&own).error("inside");
        assert!(error.contains(reason), "{own}: {error}");
    }
}

// Frames.

/// A ball of 10 cm in front of a wall, lit from the side and above.
fn ball(inside: Subsurface, kind: LightKind) -> Scene {
    let mut scene = Scene { name: "ball".into(), ..Scene::default() };
    add(&mut scene, sphere(0.05, 16), filled(inside), DAffine3::IDENTITY);
    let wall = quad(vec3(-0.2, -0.2, -0.12), Vec3::X * 0.4, Vec3::Y * 0.4, 0.05);
    add(&mut scene, wall, phong([0.6, 0.5, 0.4], [0.0; 3], 1.0), DAffine3::IDENTITY);
    let position = dvec3(0.2, 0.25, 0.02);
    let direction = (-position).as_vec3().normalize();
    scene.lights.push(Light { position, direction, intensity: 30.0, ..lamp(kind) });
    scene.cameras.push(camera(dvec3(0.05, 0.05, 0.3), DVec3::ZERO, 0.5));
    scene
}

fn wide() -> LightKind {
    LightKind::Spot { inner: 0.2, outer: 0.35 }
}

fn knobs() -> Knobs {
    Knobs { rsm: 64, size: [48, 36], ..small() }
}

/// Results of a frame.
#[derive(Default)]
struct Drawn {
    radiance: Vec<DVec3>,
    dipoles: Vec<shared::ProxyDipole>,
    inner: Vec<shared::Val>,
    caches: Vec<shared::Cache>,
    /// Medium of the first filled body.
    medium: Option<Medium>,
    /// For each visible vertex: position, references, and irradiance from below the surface.
    vertices: Vec<(DVec3, Vec<usize>, DVec3)>,
}

/// Draws a frame and reads its results. References are only correct in a scene with one model.
fn drawn(scene: &Scene, spacing: f64, knobs: &Knobs) -> Drawn {
    let gpu = gpu();
    let caches = baked(scene, spacing, 8);
    let world = World::new(&gpu, scene, Some(&caches)).expect("world");
    let mut frame = Frame::new(&gpu, scene, &world, knobs).expect("made");
    let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
    let recorded = gpu.frame(|cmd| {
        frame.record(cmd, &world, &view);
        Ok(())
    });
    assert_eq!(recorded.expect("drawn").problems, [""; 0]);
    assert_clean(&gpu);
    for found in Check::new(&gpu).expect("check").count(&gpu, &frame.light, &frame.picture).expect("counted") {
        assert_eq!(found.broken, 0, "{}", found.target);
    }
    let picture = &frame.picture;
    let medium = world.filled.as_ref().map(|filled| filled.media[0]);
    let read: Vec<[f32; 4]> = gpu.read_image(&picture.surface.radiance).expect("radiance");
    let mut made = Drawn {
        radiance: read.iter().map(|p| dvec3(p[0].into(), p[1].into(), p[2].into())).collect(),
        medium,
        ..Drawn::default()
    };
    if let Some(inside) = frame.light.rsm.as_ref().and_then(|rsm| rsm.inside.as_ref()) {
        let count = gpu.read::<u32>(&inside.vals.live_count).expect("count")[0] as usize;
        made.inner = gpu.read::<shared::Val>(&inside.vals.live).expect("VALs")[..count].to_vec();
    }
    if let Some(of_light) = frame.light.caches() {
        made.caches = gpu.read(&of_light.atlas.caches).expect("caches");
        made.dipoles = of_light.inside.as_ref().map_or(Vec::new(), |inside| gpu.read(&inside.buffer).expect("dipoles"));
    }
    if let Some((visible, below)) = picture.visible.as_ref().and_then(|list| Some((list, list.below.as_ref()?))) {
        let count = gpu.read::<shared::VisibleArgs>(&visible.args).expect("count")[0].count as usize;
        let list: Vec<shared::VisibleVertex> = gpu.read(&visible.list).expect("vertices");
        let lights: Vec<shared::VertexLight> = gpu.read(&visible.lights).expect("places");
        let below: Vec<Vec3> = gpu.read(below).expect("irradiance");
        for i in 0..count {
            let own = &caches.models[0].references[8 * list[i].vertex as usize..][..8];
            let own = own.iter().filter(|cache| **cache != NO_CACHE).map(|cache| usize::from(*cache)).collect();
            made.vertices.push(({ lights[i].position }.as_dvec3(), own, below[i].as_dvec3()));
        }
    }
    made
}

fn proxy(of: &shared::ProxyDipole) -> ProxyDipole {
    ProxyDipole {
        irradiance: { of.irradiance }.as_dvec3(),
        place: [of.place_r, of.place_g, of.place_b].map(Vec3::as_dvec3),
        variance: { of.variance }.as_dvec3(),
        widest: { of.widest }.as_dvec3(),
        facing: { of.facing }.as_dvec3(),
    }
}

fn lit(val: &shared::Val) -> InnerVal {
    let (position, normal, flux) = (val.position, val.normal, val.flux);
    InnerVal { position: position.as_dvec3(), normal: normal.as_dvec3(), area: val.area.into(), flux: flux.as_dvec3() }
}

/// Dipoles of caches that are all on one body, in f64.
fn twins(medium: &Medium, caches: &[shared::Cache], vals: &[InnerVal]) -> Vec<ProxyDipole> {
    let bodies: Vec<(DVec3, f64)> = caches.iter().map(|c| ({ c.position }.as_dvec3(), f64::from(c.area))).collect();
    let of = |c: &shared::Cache| gather(medium, [c.position, c.normal].map(Vec3::as_dvec3), vals, &bodies);
    caches.iter().map(of).collect()
}

#[test]
fn dipoles_of_caches_are_the_twins_and_no_more_leaves_than_entered() {
    for path in [0.0005, 0.005, 0.05] {
        let inside = Subsurface { scale: 1.0, ..Subsurface::of_color(vec3(0.9, 0.7, 0.3), Vec3::splat(path), 1.4) };
        // The ball alone. Light from the wall would enter around caches, which the twin does not include.
        let mut scene = ball(inside, wide());
        scene.instances.truncate(1);
        let Drawn { dipoles, inner, caches, vertices, medium, .. } = drawn(&scene, 0.012, &knobs());
        let medium = medium.expect("a medium");
        let vals: Vec<InnerVal> = inner.iter().map(lit).collect();
        let bodies: Vec<(DVec3, f64)> = caches.iter().map(|c| ({ c.position }.as_dvec3(), f64::from(c.area))).collect();
        assert!(dipoles.len() > 50 && vals.len() > 100);
        let (mut worst, mut leaves) = (0.0_f64, DVec3::ZERO);
        let twins = twins(&medium, &caches, &vals);
        let most = twins.iter().map(|twin| twin.irradiance.max_element()).fold(0.0, f64::max);
        for ((dipole, twin), (_, area)) in dipoles.iter().zip(&twins).zip(&bodies) {
            assert_eq!({ dipole.filled }, 0);
            let irradiance = { dipole.irradiance }.as_dvec3();
            // The device's dipoles also contain light that the body reflects onto itself.
            worst = worst.max((irradiance - twin.irradiance).abs().max_element() / most);
            leaves += irradiance * *area;
        }
        // The irradiance at vertices follows from the caches' dipoles.
        let proxies: Vec<ProxyDipole> = dipoles.iter().map(proxy).collect();
        let (mut worst_vertex, mut brightest) = (0.0_f64, 0.0_f64);
        for (at, references, below) in &vertices {
            let d_max = references.iter().map(|c| bodies[*c].0.distance(*at)).fold(1e-15, f64::max);
            let weighed = |c: &usize| (bodies[*c].0, (1.0 - bodies[*c].0.distance(*at) / d_max).max(1e-6), proxies[*c]);
            let twin = interpolate(&medium, *at, &references.iter().map(weighed).collect::<Vec<_>>());
            worst_vertex = worst_vertex.max((*below - twin).abs().max_element());
            brightest = brightest.max(twin.max_element());
        }
        assert!(vertices.len() > 50 && worst_vertex < 1e-3 * brightest, "{worst_vertex} of {brightest}");
        let entered: DVec3 = vals.iter().map(|val| val.flux).sum();
        println!(
            "mean free path {path} m: {:.3} of the light inside leaves, largest error of a cache {worst:.1e}",
            leaves / entered
        );
        assert!(worst < 1e-4, "{worst}");
        assert!((leaves / entered).max_element() < 1.02, "{leaves} of {entered}");
    }
}

#[test]
fn pixels_are_what_brute_force_says() {
    let narrow = LightKind::Spot { inner: 0.02, outer: 0.04 };
    for (what, kind, path, bound) in [
        ("5 %, broad", wide(), 0.005, 0.001),
        ("1 %, broad", wide(), 0.001, 0.01),
        ("5 %, narrow", narrow, 0.005, 0.01),
    ] {
        let inside = Subsurface::of_color(vec3(0.9, 0.7, 0.3), Vec3::splat(path), 1.4);
        let mut scene = ball(inside, kind);
        scene.instances.truncate(1);
        // Finer texels, since pixels see the light itself.
        let truth = drawn(&scene, 0.012, &Knobs { gi: Gi::BruteForce, rsm: 160, ..knobs() }).radiance;
        let Drawn { radiance: picture, dipoles, .. } = drawn(&scene, 0.012, &knobs());
        let error = |picture: &[DVec3]| {
            let of = |p: &[DVec3]| p.iter().map(|p| p.as_vec3().to_array()).collect::<Vec<_>>();
            metrics(&of(picture), &of(&truth)).relmse
        };
        let found = error(&picture);
        println!("mean free path {what}, {} caches: relMSE {found:.5}", dipoles.len());
        assert!(found < bound, "{what}: {found}");
    }
}

/// The thesis's figures 5.36 to 5.38, at visible vertices: dipoles compared with irradiance interpolated between caches,
/// all of it or the part that pixels do not reflect themselves.
#[test]
fn dipoles_find_light_between_caches() {
    let narrow = LightKind::Spot { inner: 0.02, outer: 0.04 };
    for (what, kind, path) in
        [("broad", wide(), 0.001), ("broad", wide(), 0.005), ("narrow", narrow, 0.001), ("narrow", narrow, 0.005)]
    {
        for spacing in [0.05, 0.028, 0.014] {
            let inside = Subsurface::of_color(vec3(0.9, 0.7, 0.3), Vec3::splat(path), 1.4);
            let mut scene = ball(inside, kind);
            scene.instances.truncate(1);
            let Drawn { dipoles, inner, caches, vertices, medium, .. } = drawn(&scene, spacing, &knobs());
            let (medium, vals) = (medium.expect("a medium"), inner.iter().map(lit).collect::<Vec<_>>());
            // All light from below at a point of the ball, and the part that caches bring.
            let truth = |at: DVec3| {
                vals.iter().fold([DVec3::ZERO; 2], |[all, part], val| {
                    let (d, wide) = (val.position.distance(at), widest(val.area));
                    let facing = on_same_side(at.normalize(), val.normal);
                    let given = val.flux * diffuse_reflectance(&medium, d, wide);
                    [all + given, part + given * brought(&medium, d * d, wide, facing)]
                })
            };
            let place = |c: usize| { caches[c].position }.as_dvec3();
            let at_caches: Vec<DVec3> = (0..caches.len()).map(|c| truth(place(c))[0]).collect();
            let (mut errors, mut squares) = ([0.0; 3], 0.0);
            for (at, references, below) in &vertices {
                let d_max = references.iter().map(|c| place(*c).distance(*at)).fold(1e-15, f64::max);
                let weight = |c: usize| (1.0 - place(c).distance(*at) / d_max).max(1e-6);
                let weights: f64 = references.iter().map(|c| weight(*c)).sum();
                let mean = |of: &dyn Fn(usize) -> DVec3| {
                    references.iter().map(|c| weight(*c) * of(*c)).sum::<DVec3>() / weights
                };
                let [all, part] = truth(*at);
                squares += all.length_squared();
                errors[0] += (*below - part).length_squared();
                errors[1] += (mean(&|c| { dipoles[c].irradiance }.as_dvec3()) - part).length_squared();
                errors[2] += (mean(&|c| at_caches[c]) - all).length_squared();
            }
            let [by_dipoles, directly, all] = errors.map(|error| (error / squares).sqrt());
            let count = caches.len();
            println!(
                "{what}, mean free path {path} m, {count} caches: RMSE {by_dipoles:.4} by dipoles, {directly:.4} by interpolating \
                 their irradiance, {all:.4} by interpolating all irradiance"
            );
            let bound = if what == "narrow" && count < 100 { 1.0 } else { 1.25 };
            assert!(by_dipoles < bound * directly, "{what}, {path}, {spacing}: {by_dipoles} against {directly}");
            assert!(by_dipoles < all, "{what}, {path}, {spacing}: {by_dipoles} against {all}");
        }
    }
}

/// A plate of 2 mm, lit from the front. Its caches are farther apart than that, so light at the back leaves close to where it
/// entered, but no pixel of the back reflects it.
#[test]
fn light_crosses_thin_bodies() {
    let inside = Subsurface::of_color(vec3(0.9, 0.7, 0.3), Vec3::splat(0.001), 1.4);
    let mut scene = ball(inside, LightKind::Point);
    scene.instances.clear();
    let plate = cuboid(vec3(-0.05, -0.05, -0.002), vec3(0.05, 0.05, 0.0), 0.01, |_| true);
    add(&mut scene, plate, filled(inside), DAffine3::IDENTITY);
    scene.lights[0].position = dvec3(0.02, 0.01, 0.2);
    let Drawn { dipoles, inner, caches, medium, .. } = drawn(&scene, 0.03, &knobs());
    let medium = medium.expect("a medium");
    let vals: Vec<InnerVal> = inner.iter().map(lit).collect();
    let twins = twins(&medium, &caches, &vals);
    let most = twins.iter().map(|twin| twin.irradiance.max_element()).fold(0.0, f64::max);
    let (mut worst, mut behind) = (0.0_f64, 0.0);
    for ((dipole, twin), cache) in dipoles.iter().zip(&twins).zip(&caches) {
        let irradiance = { dipole.irradiance }.as_dvec3();
        worst = worst.max((irradiance - twin.irradiance).abs().max_element() / most);
        behind += if { cache.normal }.z < -0.5 { irradiance.x * f64::from(cache.area) } else { 0.0 };
    }
    let entered: f64 = vals.iter().map(|val| val.flux.x).sum();
    println!(
        "{} caches: {:.3} of the red light leaves at the back, largest error {worst:.1e}",
        caches.len(),
        behind / entered
    );
    assert!(worst < 1e-4, "{worst}");
    assert!((0.1..1.0).contains(&(behind / entered)), "{behind} of {entered}");
}

#[test]
fn light_that_a_wall_reflects_goes_on_inside() {
    let mut scene = ball(Subsurface::preset("skin").expect("a preset"), LightKind::Spot { inner: 0.1, outer: 0.15 });
    // The light shines past the ball onto the wall behind it.
    scene.lights[0].position = dvec3(0.14, 0.1, 0.2);
    scene.lights[0].direction = Vec3::NEG_Z;
    let Drawn { inner, dipoles, caches, .. } = drawn(&scene, 0.03, &knobs());
    assert!(inner.is_empty(), "{} texels hit the ball", inner.len());
    let at = |front: bool| -> f32 {
        let own =
            dipoles.iter().zip(&caches).filter(|(d, c)| { d.filled } != HOLLOW && ({ c.normal }.z < 0.0) != front);
        own.map(|(d, _)| { d.irradiance }.x).sum()
    };
    println!("{} at the back, {} at the front", at(false), at(true));
    assert!(at(false) > 3.0 * at(true) && at(true) >= 0.0, "{} at the back, {} at the front", at(false), at(true));
}

#[test]
fn pictures_are_finite_whatever_is_inside() {
    for (path, g, ior, absorbed, scale) in [
        (1e-6, 0.0, 1.3, 0.0, 1.0),
        (1.0, 0.95, 2.5, 0.5, 1.0),
        (1e-3, -0.95, 1.0, 0.0, 1e-3),
        (1e-3, 0.0, 1.5, 1.0, 1e3),
    ] {
        let inside = Subsurface { scale, ..of((1.0 - absorbed) / path, absorbed / path, g, ior) };
        let scene = ball(inside, LightKind::Point);
        // `drawn` fails on invalid values.
        let Drawn { radiance: picture, dipoles, .. } =
            drawn(&scene, 0.03, &Knobs { size: [24, 18], rsm: 16, ..small() });
        assert!(picture.iter().all(|p| p.is_finite() && p.min_element() >= 0.0));
        assert!(dipoles.iter().all(|d| { d.irradiance }.is_finite() && { d.variance }.is_finite()));
        assert!(dipoles.iter().any(|d| { d.filled } == HOLLOW), "the wall must have caches, too");
    }
}

#[test]
fn scenes_without_filled_bodies_have_no_stages_for_them() {
    let gpu = gpu();
    let mut scene = ball(of(1e3, 1.0, 0.0, 1.3), wide());
    let caches = baked(&scene, 0.03, 8);
    let plan = |scene: &Scene, knobs: &Knobs| {
        let world = World::new(&gpu, scene, Some(&caches)).expect("world");
        let settings: Settings = knobs.settings();
        world
            .plan(&settings)
            .stages()
            .map(|stage| stage.name)
            .filter(|name| ["dipole gather", "scatter"].contains(name))
            .collect::<Vec<_>>()
    };
    assert_eq!(plan(&scene, &knobs()), ["dipole gather", "scatter"]);
    assert_eq!(plan(&scene, &Knobs { gi: Gi::BruteForce, ..knobs() }), ["scatter"]);
    assert_eq!(plan(&scene, &Knobs { gi: Gi::Off, ..knobs() }), [""; 0]);
    scene.materials[0].subsurface = None;
    assert_eq!(plan(&scene, &knobs()), [""; 0]);
    // Without indirect light a filled body reflects as if light left at the point where it entered.
    scene.materials[0].fill(of(1e3, 1.0, 0.0, 1.3));
    let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { gi: Gi::Off, ..knobs() });
    assert!(shot.direct.iter().any(|p| p.max_element() > 0.0));
}

/// Many files mark closed bodies as double-sided. Their inner side neither receives nor sends light.
#[test]
fn double_sided_bodies_are_like_others() {
    let picture = |double_sided: bool| {
        let mut scene = Scene { name: "ball".into(), ..Scene::default() };
        let inside = Subsurface::of_color(vec3(0.9, 0.7, 0.3), Vec3::splat(0.003), 1.4);
        let mut body = sphere(0.05, 16);
        if double_sided {
            let (back, front) = (body.reversed(), body.vertices.len() as u32);
            body.vertices.extend(back.vertices);
            body.indices.extend(back.indices.iter().map(|i| front + i));
        }
        add(&mut scene, body, Material { double_sided, ..filled(inside) }, DAffine3::IDENTITY);
        let like = ball(inside, wide());
        (scene.lights, scene.cameras) = (like.lights, like.cameras);
        drawn(&scene, 0.01, &knobs()).radiance.into_iter().sum::<DVec3>()
    };
    let ratio = picture(true) / picture(false);
    println!("light of a double-sided ball over that of a single-sided one: {ratio:.3}");
    assert!((ratio - 1.0).abs().max_element() < 0.02, "{ratio}");
}

/// With mean free paths far below the distance of caches, light leaves where it entered; without Fresnel, all of it.
#[test]
fn bodies_of_short_paths_are_diffuse_surfaces() {
    let picture = |is_filled: bool| {
        let mut scene = ball(Subsurface::of_color(vec3(0.9, 0.7, 0.3), Vec3::splat(1e-7), 1.0), wide());
        if !is_filled {
            scene.materials[0].subsurface = None;
        }
        drawn(&scene, 0.03, &knobs()).radiance
    };
    let (filled, diffuse) = (picture(true), picture(false));
    let apart: DVec3 = filled.iter().zip(&diffuse).map(|(a, b)| (*a - *b).abs()).sum();
    let share = apart / diffuse.iter().copied().sum::<DVec3>();
    println!("difference from a diffuse surface: {share:.6}");
    assert!(share.max_element() < 0.003, "{share}");
}

/// Against random walks.
#[test]
fn pictures_are_near_the_path_tracers() {
    for path in [0.0003, 0.003] {
        let mut scene = ball(Subsurface::of_color(vec3(0.9, 0.7, 0.3), Vec3::splat(path), 1.4), wide());
        scene.instances.truncate(1);
        let knobs = Knobs { rsm: 96, ..knobs() };
        let picture = drawn(&scene, 0.01, &knobs).radiance;
        let mut trace = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::engine(knobs.size, 1));
        while trace.samples() < 64 {
            trace.pass();
        }
        let truth = trace.direct();
        let mean: DVec3 = truth.iter().map(|p| Vec3::from(*p).as_dvec3()).sum();
        let bias = picture.iter().copied().sum::<DVec3>() / mean - 1.0;
        println!("ball of 10 cm, mean free path {path} m: bias against walks {bias:+.3}");
        assert!(bias.abs().max_element() < 0.04, "{bias}");
    }
}

#[test]
fn frames_of_every_kind_have_filled_bodies_in_every_view() {
    let gpu = gpu();
    let mut scene = room(CornellSurface::Glossy);
    for material in scene.materials.iter_mut().rev().take(2) {
        material.fill(Subsurface::of_color(vec3(0.8, 0.7, 0.4), Vec3::splat(0.03), 1.4));
    }
    let by_vertices = baked(&scene, 0.3, 8);
    let by_texels = by_vertices.clone().with_cells(&scene).expect("cells");
    let near = Near::Rays { per_pixel: 4, every: 2 };
    let antialiasing = Antialiasing::Four;
    let knobs = || Knobs { rsm: 16, ..plain() };
    for (caches, knobs) in [
        (&by_vertices, knobs()),
        (&by_vertices, Knobs { path: Path::DRAWS, cull: true, ..knobs() }),
        (&by_vertices, Knobs { path: Path::Clusters(ClusterRule::Distance(4.0)), shadows: Shadows::Proxy, ..knobs() }),
        (
            &by_vertices,
            Knobs {
                near,
                bounces: 2,
                shadows: Shadows::PerLight,
                light_shadows: LightShadows::Rays,
                antialiasing,
                ..knobs()
            },
        ),
        (&by_texels, Knobs { cull: true, antialiasing, ..knobs() }),
        (&by_texels, Knobs { near, ..knobs() }),
    ] {
        compare(&gpu, &scene, caches, &knobs);
    }
    assert_clean(&gpu);
}

#[test]
fn edits_leave_nothing_stale_inside() {
    let mut scene = moving::world();
    for body in [2, 3] {
        scene.materials[body].fill(Subsurface::of_color(vec3(0.8, 0.7, 0.4), Vec3::splat(0.03), 1.4));
    }
    let near = Near::Rays { per_pixel: 4, every: 2 };
    let with = moving::with;
    moving::walk_of(scene.clone(), with(Shadows::Off), false, 5, 21);
    moving::walk_of(scene.clone(), with(Shadows::Off), true, 5, 22);
    moving::walk_of(
        scene.clone(),
        Knobs { near, antialiasing: Antialiasing::Four, ..with(Shadows::PerLight) },
        false,
        4,
        23,
    );
    moving::walk_of(scene, Knobs { gi: Gi::BruteForce, ..with(Shadows::Off) }, false, 4, 24);
}

/// A medium that is the same for all channels has no colour, however few the samples are.
#[test]
fn few_walks_have_no_tint() {
    let mut scene = ball(of(300.0, 0.0, 0.0, 1.3), wide());
    scene.instances.truncate(1);
    scene.lights[0].color = Vec3::ONE;
    let mut trace = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::engine([48, 48], 1));
    trace.pass();
    let sum: DVec3 = trace.direct().iter().map(|p| Vec3::from(*p).as_dvec3()).sum();
    let tint = sum / (sum.element_sum() / 3.0) - 1.0;
    println!("{} samples: channels differ from their mean by {tint:+.3}", trace.samples());
    assert!(tint.abs().max_element() < 0.04, "{tint}");
}
