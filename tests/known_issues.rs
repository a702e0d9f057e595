//! Known errors. Each test passes as long as its error exists. A failing test means that an error was fixed. Then turn
//! it into a test of the correct behaviour, next to similar tests, and remove the line from the list of limits in
//! docs/guide.md.

use glam::{DAffine3, DVec3, dvec3, vec3};
use lightskin::frame::Shadows;
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::reference::path_trace::{self, PathTrace};
use lightskin::scene::build::{CornellSurface, cornell, cuboid};
use lightskin::scene::{LightKind, Scene};

use crate::common::frames::{add, baked, camera, lamp, phong, shoot, small};
use crate::common::gpu;

/// Fails once the error is fixed.
#[track_caller]
fn assert_still_wrong(wrong: bool, what: &str) {
    assert!(
        wrong,
        "fixed: {what}. Test that it stays so, and remove it from this list and from the limits in docs/guide.md"
    );
}

fn traced<'a>(scene: &'a Scene, settings: &path_trace::PathTraceSettings) -> PathTrace<'a> {
    let mut trace = PathTrace::new(scene, &scene.cameras[0], settings);
    trace.pass();
    trace
}

fn sum(pixels: &[DVec3]) -> f64 {
    pixels.iter().map(|p| p.element_sum()).sum()
}

#[test]
fn light_leaks_through_a_wall_where_caches_are_as_far_apart_as_rooms_are_wide() {
    // Two rooms of 2 m with a wall of 10 cm between them, a lamp in the first and a camera in the second.
    let mut scene = Scene::default();
    let white = || phong([0.7; 3], [0.0; 3], 1.0);
    for low in [0.0, 2.1] {
        let room = cuboid(vec3(low, 0.0, 0.0), vec3(low + 2.0, 2.0, 2.0), 0.25, |_| true).reversed();
        add(&mut scene, room, white(), DAffine3::IDENTITY);
    }
    scene.lights = vec![lamp(LightKind::Point)];
    scene.cameras.push(camera(dvec3(3.9, 1.8, 1.8), dvec3(2.1, 0.8, 0.2), 1.2));
    let settings = Knobs { size: [16, 16], shadows: Shadows::PerLight, ..small() };
    let gpu = gpu();
    let caches = baked(&scene, 3.0, 8);
    let dark = sum(&shoot(&gpu, &scene, Some(&caches), &settings).diffuse);
    let traced = traced(&scene, &path_trace::PathTraceSettings::engine(settings.size, 1)).diffuse();
    assert!(traced.iter().flatten().all(|v| *v == 0.0), "no path may lead into the dark room");
    scene.cameras[0] = camera(dvec3(1.8, 1.8, 1.8), dvec3(0.0, 0.8, 0.2), 1.2);
    let lit = sum(&shoot(&gpu, &scene, Some(&caches), &settings).diffuse);
    println!("the dark room has {:.5} of the lit one's indirect light", dark / lit);
    assert_still_wrong(dark > 0.01 * lit, "no light leaks through a wall, however far apart caches are");
}

#[test]
fn sharp_lobes_lose_light_where_caches_are_few() {
    let scene = cornell(CornellSurface::Glossy, 0.1);
    let settings = Knobs { size: [32, 32], ..small() };
    let gpu = gpu();
    let caches = shoot(&gpu, &scene, Some(&baked(&scene, 2.0, 8)), &settings).glossy;
    let exact = shoot(&gpu, &scene, None, &Knobs { gi: Gi::BruteForce, ..settings }).glossy;
    println!("the lobe has {:.3} of brute force's light", sum(&caches) / sum(&exact));
    assert_still_wrong(sum(&caches) < 0.7 * sum(&exact), "few caches lose no light of a glossy lobe");
}
