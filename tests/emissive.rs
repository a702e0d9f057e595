//! Emissive surfaces that are not area lights. As VALs they light caches, and pixels in brute force. Tests absolute
//! irradiance in closed form, energy and one-sidedness, and compares with the path tracer.

use glam::{Affine2, DAffine3, DVec3, Vec2, Vec3, dvec3, vec3};
use lightskin::frame::{ClusterRule, World};
use lightskin::lab::knobs::{Gi, Knobs, Path};
use lightskin::reference::disc::polygon_form_factor;
use lightskin::reference::path_trace::{self, PathTrace};
use lightskin::scene::build::{CornellSurface, Surface, cornell, quad, sphere};
use lightskin::scene::defaults::Ground;
use lightskin::scene::write::write_glb;
use lightskin::scene::{Image, Material, Sampler, Scene, Texture, defaults};
use std::f64::consts::PI;

use crate::cli::{folder, works};
use crate::common::frames::{add, baked, camera, phong, shoot, small};
use crate::common::gpu;

/// Corners of the squares that form the lamp: an L, which is not a rectangle.
const SQUARES: [[f32; 2]; 5] = [[-0.375, -0.375], [-0.125, -0.375], [0.125, -0.375], [-0.375, -0.125], [-0.375, 0.125]];

/// Side of each square [m].
const SIDE: f32 = 0.25;

/// Area of all squares [m^2].
const AREA: f32 = 5.0 * SIDE * SIDE;

fn lamp(edge: f32) -> Surface {
    let square = |[x, z]: [f32; 2]| quad(vec3(x, 0.8, z), Vec3::X * SIDE, Vec3::Z * SIDE, edge);
    SQUARES.into_iter().map(square).reduce(Surface::and).expect("squares")
}

/// A floor of 2 m below a lamp that shines downwards with this radiance [cd/m^2].
fn lamp_over_floor(radiance: Vec3) -> Scene {
    let mut scene = Scene { name: "lamp over floor".into(), ..Scene::default() };
    let floor = quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 0.1);
    add(&mut scene, floor, phong([0.7, 0.5, 0.3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    add(&mut scene, lamp(0.4), Material { emissive: radiance, ..phong([0.0; 3], [0.0; 3], 1.0) }, DAffine3::IDENTITY);
    scene.cameras.push(camera(dvec3(0.0, 0.75, 0.9), DVec3::ZERO, 1.2));
    scene
}

#[test]
fn a_lamps_irradiance_is_the_closed_form() {
    let gpu = gpu();
    let radiance = vec3(30.0, 20.0, 10.0);
    let scene = lamp_over_floor(radiance);
    let caches = baked(&scene, 0.2, 8);
    let corners = |[x, z]: [f32; 2]| {
        let at = |i: f32, j: f32| vec3(x + i * SIDE, 0.8, z + j * SIDE).as_dvec3();
        [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]
    };
    let exact = |p: DVec3, n: DVec3| {
        PI * radiance.as_dvec3() * SQUARES.iter().map(|s| polygon_form_factor(&corners(*s), p, n)).sum::<f64>()
    };
    // Caches receive only emitted light, nothing reflected.
    let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { bounces: 0, ..small() });
    assert_eq!(shot.vals.len(), World::new(&gpu, &scene, None).expect("upload").emitters.len());
    let mut worst = 0.0_f64;
    for (cache, sum) in shot.caches.iter().zip(&shot.sums[0]) {
        if cache.position.y > 0.1 {
            assert_eq!(*sum, DVec3::ZERO, "the lamp must not light itself");
            continue;
        }
        let exact = exact(cache.position, cache.normal);
        worst = worst.max(sum.distance(exact) / exact.length());
    }
    eprintln!("caches: largest error {worst:.5}");
    assert!(worst < 2e-3, "{worst}");
    for (gi, bound) in [(Gi::BruteForce, 2e-3), (Gi::LightSkin, 0.02)] {
        let bounces = u32::from(gi == Gi::BruteForce);
        let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { gi, bounces, ..small() });
        let (mut off, mut sum) = (0.0, 0.0);
        for s in lightskin::lab::shot::seen(&scene, small().size).iter().filter(|s| s.instance == 0) {
            let exact = exact(s.position, s.normal) * dvec3(0.7, 0.5, 0.3) / PI;
            off += exact.distance(shot.diffuse[s.pixel]);
            sum += exact.length();
        }
        eprintln!("{gi:?}: mean error {:.5} of the mean", off / sum);
        assert!(sum > 0.0 && off / sum < bound, "{gi:?}: {}", off / sum);
    }
}

#[test]
fn patches_carry_all_the_light_of_textures_many_triangles_and_mirrored_instances() {
    let gpu = gpu();
    let mut scene = lamp_over_floor(Vec3::splat(10.0));
    // Half of the lamp is red, in stripes. A mirrored instance shines downwards from another place.
    let rgba = [[255, 0, 0, 255], [0, 0, 0, 255]].concat();
    scene.images.push(Image { name: "stripes".into(), width: 2, height: 1, rgba });
    scene.materials[1].emissive_texture = Some(Texture {
        image: 0,
        uv_set: 0,
        transform: Affine2::from_scale(Vec2::splat(4.0)),
        sampler: Sampler { nearest: true, ..Sampler::default() },
    });
    let mesh = scene.instances[1].mesh;
    for vertex in &mut scene.meshes[mesh].vertices {
        vertex.uv0 = Vec2::new((vertex.position.x + 0.375) / SIDE, 0.5);
    }
    let mut mirrored = scene.instances[1].clone();
    mirrored.world_from_model = DAffine3::from_scale(dvec3(-2.0, 1.0, 1.0)) * mirrored.world_from_model;
    scene.instances.push(mirrored);
    let buffers = World::new(&gpu, &scene, None).expect("upload");
    let flux: Vec3 = buffers.emitters.iter().map(|v| v.flux).sum();
    let exact = PI as f32 * 10.0 * 0.5 * AREA * 3.0;
    eprintln!("{} patches, {flux} lm, expected {exact}", buffers.emitters.len());
    assert!((flux.x / exact - 1.0).abs() < 0.01 && flux.y == 0.0);
    assert!(buffers.emitters.iter().filter(|v| v.flux.x > 0.0).all(|v| v.normal.distance(Vec3::NEG_Y) < 1e-6));

    // With more triangles than patches, fewer patches carry all of the light.
    let mut scene = lamp_over_floor(Vec3::splat(10.0));
    let fine = lamp(0.004);
    let shining = scene.materials[1].clone();
    scene.instances.pop();
    add(&mut scene, fine, shining, DAffine3::IDENTITY);
    let triangles = scene.meshes[2].triangle_count();
    let buffers = World::new(&gpu, &scene, None).expect("upload");
    let flux: f32 = buffers.emitters.iter().map(|v| v.flux.x).sum();
    let middle: Vec3 = buffers.emitters.iter().map(|v| v.position * v.flux.x).sum::<Vec3>() / flux;
    let middle = middle.as_dvec3() + buffers.origin;
    eprintln!("{triangles} triangles, {} patches: {flux} lm, centred at {middle}", buffers.emitters.len());
    assert!(triangles > 16_384 && buffers.emitters.len() <= 16_384);
    assert!((flux / (PI as f32 * 10.0 * AREA) - 1.0).abs() < 1e-3);
    assert!(middle.distance(dvec3(-0.1, 0.8, -0.1)) < 0.01);
}

/// A double-sided ball gives the light of its outside alone, unless it is as large as a room that someone may be in.
#[test]
fn insides_of_small_bodies_give_no_light() {
    let gpu = gpu();
    for (radius, sides) in [(0.03, 1.0), (0.5, 2.0)] {
        let mut scene = lamp_over_floor(Vec3::ZERO);
        let outside = sphere(radius, 16);
        let mut inside = outside.clone();
        inside.vertices.iter_mut().for_each(|vertex| vertex.normal = -vertex.normal);
        inside.indices.as_chunks_mut::<3>().0.iter_mut().for_each(|corners| corners.swap(1, 2));
        let material = Material { emissive: Vec3::splat(10.0), double_sided: true, ..phong([0.0; 3], [0.0; 3], 1.0) };
        let area: f64 = outside.indices.as_chunks::<3>().0.iter().map(|c| area(&outside, *c)).sum();
        add(&mut scene, outside.and(inside), material, DAffine3::from_translation(dvec3(0.0, 0.4, 0.0)));
        let world = World::new(&gpu, &scene, None).expect("upload");
        let of_patches: f32 = world.emitters.iter().map(|val| val.flux.x).sum();
        let of_lamps: f64 = world.bodies.iter().map(|body| 4.0 * PI * body.intensity.x).sum();
        let flux = f64::from(of_patches) + of_lamps;
        let wanted = sides * PI * 10.0 * area;
        assert!((flux / wanted - 1.0).abs() < 1e-3, "{radius} m: {flux} lm, expected {wanted}");
    }
}

/// Area of a triangle [m^2].
fn area(surface: &Surface, corners: [u32; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| surface.vertices[corner as usize].position.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

/// The Cornell box with its lamp, and an emissive ball below the ceiling.
fn ball_in_a_box() -> Scene {
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    scene.instances.truncate(1);
    let shining = Material { emissive: Vec3::splat(100.0), ..phong([0.0; 3], [0.0; 3], 1.0) };
    add(&mut scene, sphere(0.2, 12), shining, DAffine3::from_translation(dvec3(0.0, 1.5, 0.0)));
    scene
}

#[test]
fn emitters_light_a_room_as_paths_do() {
    let gpu = gpu();
    let mut scene = ball_in_a_box();
    scene.lights.clear();
    defaults::complete(&mut scene, Ground::Auto);
    assert!(scene.lights.is_empty());
    let settings = Knobs { size: [32, 32], ..small() };
    let caches = baked(&scene, 0.2, 8);
    for bounces in [0, 1, 3] {
        let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { bounces, ..settings });
        let paths = path_trace::PathTraceSettings::engine(settings.size, bounces);
        let mut paths = PathTrace::new(&scene, &scene.cameras[0], &paths);
        (0..8).for_each(|_| paths.pass());
        let (mut off, mut sum, mut own) = (0.0, 0.0, 0.0);
        for (((direct, indirect), diffuse), shown) in
            paths.direct().iter().zip(paths.diffuse()).zip(&shot.diffuse).zip(&shot.direct)
        {
            let (path, shown) = (f64::from(direct[1]) + f64::from(indirect[1]), diffuse.y + shown.y);
            // Pixels of the lamp are the same in both, so they are left out.
            if shown < 90.0 {
                off += (path - shown).abs();
                sum += path;
                own += shown;
            }
        }
        let (error, bias) = (off / sum, own / sum - 1.0);
        eprintln!("{bounces} bounces: mean error {error:.4} of the mean, bias {bias:+.4}");
        assert!(error < 0.12 && bias.abs() < 0.08, "{bounces}: {error}, {bias}");
    }
}

#[test]
fn the_command_shows_light_of_emitters_that_no_surface_has_reflected() {
    let at = folder("emitters");
    let mut scene = ball_in_a_box();
    scene.lights.clear();
    write_glb(&scene, &at.join("ball.glb")).expect("written");
    let ev = |args: &[&str]| -> f64 {
        let render = ["render", "ball.glb", "-o", "a.png", "--size", "64x64", "--caches", "300", "--bounces", "0"];
        let out = works(&at, &[&render[..], args].concat());
        let line = out.lines().find_map(|l| l.strip_prefix("exposure  EV ")).expect("an exposure");
        line.trim().parse().expect("a number")
    };
    let (drawn, traced) = (ev(&[]), ev(&["--gi", "path-trace", "--spp", "16"]));
    println!("drawn EV {drawn}, traced EV {traced}");
    assert!((drawn - traced).abs() < 0.2, "drawn EV {drawn}, traced EV {traced}");
}

#[test]
fn light_of_lamps_and_of_emitters_adds_up_after_every_bounce() {
    // Light that a lamp sends to caches through VALs has bounced once. Light of an emitter has not bounced.
    let gpu = gpu();
    let both = ball_in_a_box();
    let (mut lamp, mut ball) = (both.clone(), both.clone());
    lamp.materials.iter_mut().for_each(|material| material.emissive = Vec3::ZERO);
    ball.lights.clear();
    let caches = baked(&both, 0.3, 8);
    for bounces in [1, 3] {
        let settings = Knobs { bounces, cull: false, ..small() };
        let [both, lamp, ball] =
            [&both, &lamp, &ball].map(|scene| shoot(&gpu, scene, Some(&caches), &settings).sums[0].clone());
        let light = |sums: &[DVec3]| sums.iter().map(|sum| sum.length()).sum::<f64>();
        let apart = lamp.iter().zip(&ball).map(|(a, b)| *a + *b);
        let off: f64 = both.iter().zip(apart).map(|(both, apart)| both.distance(apart)).sum();
        eprintln!(
            "{bounces} bounces: difference {:e}, light of lamps {} and of emitters {}",
            off / light(&both),
            light(&lamp),
            light(&ball)
        );
        assert!(light(&lamp) > 0.1 * light(&ball) && light(&ball) > 0.1 * light(&lamp));
        assert!(off < 1e-5 * light(&both), "{bounces}");
    }
}

#[test]
fn clusters_hold_emitters_too() {
    let gpu = gpu();
    let scene = lamp_over_floor(vec3(30.0, 20.0, 10.0));
    let caches = baked(&scene, 0.3, 8);
    // Clusters gather emitted light and do not reflect it further, like a gather of every VAL without bounces.
    let all = shoot(&gpu, &scene, Some(&caches), &Knobs { bounces: 0, ..small() });
    let by = shoot(&gpu, &scene, Some(&caches), &Knobs { path: Path::Clusters(ClusterRule::Distance(8.0)), ..small() });
    let off: f64 = all.sums[0].iter().zip(&by.sums[0]).map(|(a, b)| a.distance(*b)).sum();
    let sum: f64 = all.sums[0].iter().map(|a| a.length()).sum();
    eprintln!("clusters: relative error {:.5}", off / sum);
    assert!(sum > 0.0 && off / sum < 0.005);
}
