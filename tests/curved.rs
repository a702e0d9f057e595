//! Bodies whose surface curves strongly within one cache spacing keep their glossy light, and closed bodies of few
//! triangles keep what is in them.

use glam::{DAffine3, DVec3, Vec3};
use lightskin::bake::{BakeSettings, CacheSet, Density, bake};
use lightskin::frame::{Near, Quality, Shadows};
use lightskin::lab::knobs::Knobs;
use lightskin::metrics::metrics;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::{CornellSurface, Surface, cornell, sphere};
use lightskin::scene::tessellate::divide;
use lightskin::scene::{Light, LightKind, Scene};

use crate::common::frames::{add, camera, lamp, phong, shoot};
use crate::common::gpu;

fn caches(scene: &Scene, count: usize) -> CacheSet {
    let settings = BakeSettings { density: Density::Count(count), angle: 30f32.to_radians(), references: 8 };
    bake(scene, &settings, &|_, _| ()).expect("baked")
}

fn spot_at(intensity: f32, position: DVec3, direction: Vec3) -> Light {
    let kind = LightKind::Spot { inner: 0.4, outer: 0.7 };
    Light { intensity, position, direction: direction.normalize(), ..lamp(kind) }
}

/// A ball of this radius with a wavy surface.
fn blob(radius: f32) -> Surface {
    let mut surface = sphere(radius, 96);
    let swell = |d: Vec3| 1.0 + 0.2 * (4.0 * d.x).sin() * (4.0 * d.y).sin() * (4.0 * d.z).cos();
    for vertex in &mut surface.vertices {
        let d = vertex.normal;
        let across = d.any_orthonormal_vector();
        let around = d.cross(across);
        let at = |d: Vec3| radius * d.normalize() * swell(d.normalize());
        let slope = |t: Vec3| at(d + 1e-3 * t) - at(d - 1e-3 * t);
        vertex.position = at(d);
        vertex.normal = slope(across).cross(slope(around)).normalize();
    }
    surface
}

/// A glossy body in a Cornell box of 10 m without blocks.
fn room_with(body: Surface) -> Scene {
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    scene.meshes.truncate(1);
    scene.instances.truncate(1);
    scene.instances[0].world_from_model = DAffine3::from_scale(DVec3::splat(5.0));
    scene.lights.clear();
    scene.lights.push(spot_at(3e4, DVec3::new(2.0, 9.5, 1.0), Vec3::new(-0.8, -0.5, -0.2)));
    add(&mut scene, body, phong([0.1; 3], [0.6; 3], 30.0), DAffine3::from_translation(DVec3::new(0.0, 3.0, 0.0)));
    scene.cameras = vec![camera(DVec3::new(0.0, 3.5, 4.0), DVec3::new(0.0, 3.0, 0.0), 0.5)];
    scene
}

#[test]
fn glossy_bodies_keep_their_light() {
    let size = [96, 72];
    for (name, body) in [("ball", sphere(0.62, 64)), ("blob", blob(0.62))] {
        let scene = room_with(body);
        let caches = caches(&scene, 1000);
        let mut paths = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::engine(size, 1));
        (0..10).for_each(|_| paths.pass());
        let shot = shoot(&gpu(), &scene, Some(&caches), &Knobs::at(Quality::High, 1000, size));
        let shown: Vec<[f32; 3]> = shot.glossy.iter().map(|p| p.as_vec3().to_array()).collect();
        let of_body = metrics(&shown, &paths.glossy());
        println!("{name}, cache spacing {:.2} m: glossy bias {:+.4}", caches.spacing, of_body.bias);
        assert!(of_body.bias.abs() < 0.05, "{name}: {of_body:?}");
    }
}

/// Vertex normals of large facets lean over their edges. Caches must not see what lies behind their triangle.
#[test]
fn a_lamp_in_a_closed_ball_of_few_facets_lights_nothing_outside() {
    let mut scene = Scene::default();
    for side in [sphere(1.0, 5), sphere(1.0, 5).reversed()] {
        add(&mut scene, side, phong([0.8; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    }
    divide(&mut scene, 0.3, None);
    scene.lights = vec![Light { position: DVec3::ZERO, ..lamp(LightKind::Point) }];
    let views = [(DVec3::new(1.3, 1.0, 2.7), DVec3::ZERO, 0.7), (DVec3::new(0.1, 0.0, 0.2), DVec3::NEG_Z, 1.2)];
    let caches = caches(&scene, 500);
    let mut leaning = caches.clone();
    for cache in leaning.models.iter_mut().flat_map(|model| &mut model.caches) {
        cache.normal = cache.position.normalize() * cache.normal.dot(cache.position).signum();
    }
    for (near, bounces) in [(Near::Off, 1), (Quality::High.near(), 1), (Quality::High.near(), 3)] {
        let knobs = Knobs { near, bounces, shadows: Shadows::PerLight, ..Knobs::at(Quality::High, 500, [64, 64]) };
        let mut light = |(eye, target, yfov), caches| {
            scene.cameras = vec![camera(eye, target, yfov)];
            shoot(&gpu(), &scene, Some(caches), &knobs).diffuse.iter().map(|light| light.element_sum()).sum::<f64>()
        };
        let [outside, inside] = views.map(|view| light(view, &caches));
        let leaned = light(views[0], &leaning);
        println!("{near:?}, {bounces} bounces: {:.1e} of the light inside is outside", outside / inside);
        println!("with vertex normals {:.1e}", leaned / inside);
        // Where caches disagree, rays find that most of what leaks is not there.
        let limit = if near == Near::Off { 1e-4 } else { 1e-6 };
        assert!(outside < limit * inside, "{near:?}, {bounces} bounces: {outside} of {inside}");
        assert!(leaned > limit * inside, "{near:?}, {bounces} bounces: vertex normals would leak, too");
    }
}

/// A hollow ball of few triangles with round vertex normals, lit by a narrow spot. Everything in a ball receives the same
/// light from any part of it. Few rays hit the small lit part, so neighbouring pixels must share theirs.
#[test]
fn round_walls_of_few_triangles_are_lit_evenly() {
    let mut scene = Scene::default();
    let narrow = LightKind::Spot { inner: 0.1, outer: 0.15 };
    scene.lights = vec![Light { intensity: 1e3, position: DVec3::ZERO, direction: Vec3::NEG_Y, ..lamp(narrow) }];
    add(&mut scene, sphere(1.0, 6).reversed(), phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene.cameras = vec![camera(DVec3::new(0.0, 0.0, 0.3), DVec3::new(1.0, 0.4, 0.0), 0.9)];
    let caches = caches(&scene, 200);
    for every in [1, 2] {
        let near = Near::Endless { per_pixel: 8, every };
        let shot = shoot(&gpu(), &scene, Some(&caches), &Knobs { near, ..Knobs::at(Quality::Medium, 200, [96, 72]) });
        let light: Vec<f64> = shot.diffuse.iter().map(|pixel| pixel.x).collect();
        let mean = light.iter().sum::<f64>() / light.len() as f64;
        let steps = light.chunks(96).flat_map(|row| row.windows(2).map(|pair| (pair[1] - pair[0]).abs()));
        let rough = steps.sum::<f64>() / light.len() as f64 / mean;
        println!("rays at every {every}. pixel: mean step between pixels {rough:.4} of the mean {mean:.3} cd/m^2");
        assert!(shot.covered.iter().all(|covered| *covered) && rough < 0.1, "{rough} of {mean}");
    }
}
