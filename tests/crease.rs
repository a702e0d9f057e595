//! Light next to a crease, where many nearby caches lie on unlit surfaces: the backs of walls.

use glam::{DAffine3, DVec3, Vec3};
use lightskin::bake::{BakeSettings, Density, bake};
use lightskin::frame::{Antialiasing, Quality};
use lightskin::lab::knobs::Knobs;
use lightskin::metrics::metrics;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::cuboid;
use lightskin::scene::{Light, LightKind, Scene};

use crate::common::frames::{add, camera, lamp, phong, shoot};
use crate::common::gpu;

/// A floor, a wall of 10 cm, and a spot light that shines on the floor along the wall.
fn floor_and_wall() -> Scene {
    let mut scene = Scene::default();
    let slab = |low: [f32; 3], high: [f32; 3]| cuboid(low.into(), high.into(), 0.05, |_| true);
    let white = phong([0.7; 3], [0.0; 3], 1.0);
    add(&mut scene, slab([-4.0, -0.1, -4.0], [4.0, 0.0, 4.0]), white.clone(), DAffine3::IDENTITY);
    add(&mut scene, slab([-4.0, 0.0, -4.1], [4.0, 4.0, -4.0]), white, DAffine3::IDENTITY);
    let direction = Vec3::new(0.0, -1.0, -0.2).normalize();
    let kind = LightKind::Spot { inner: 0.3, outer: 0.5 };
    scene.lights = vec![Light { intensity: 1e3, position: DVec3::new(0.0, 4.0, -1.6), direction, ..lamp(kind) }];
    scene.cameras = vec![camera(DVec3::new(0.0, 1.5, 1.5), DVec3::new(0.0, 0.8, -4.0), 0.8)];
    scene
}

#[test]
fn more_caches_are_no_worse() {
    let scene = floor_and_wall();
    let size = [128, 96];
    let mut paths = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::engine(size, 1));
    (0..6).for_each(|_| paths.pass());
    let mut best = f64::INFINITY;
    for count in [1000, 4000] {
        let settings = BakeSettings { density: Density::Count(count), angle: 60f32.to_radians(), references: 8 };
        let caches = bake(&scene, &settings, &|_, _| ()).expect("baked");
        let knobs = Knobs { bounces: 1, antialiasing: Antialiasing::Off, ..Knobs::at(Quality::High, count, size) };
        let shot = shoot(&gpu(), &scene, Some(&caches), &knobs);
        let shown: Vec<[f32; 3]> = shot.diffuse.iter().map(|p| p.as_vec3().to_array()).collect();
        let errors = metrics(&shown, &paths.diffuse());
        println!("{count} caches, spacing {:.3} m: RMSE {:.4}, bias {:+.4}", caches.spacing, errors.rmse, errors.bias);
        assert!(errors.rmse < 1.05 * best && errors.bias.abs() < 0.02, "{count}: {errors:?}, best {best}");
        best = best.min(errors.rmse);
    }
}
