//! More bounces: energy in closed boxes against the geometric series, the device against the twin and the path tracer.

use glam::{DAffine3, DVec3, Vec3, dvec3};
use lightskin::bake::CacheSet;
use lightskin::reference::bounce::{self, Patch};
use lightskin::reference::gather::Cache;
use lightskin::scene::build::quad;
use lightskin::scene::{Light, LightKind, Scene};

use crate::common::frames::{add, baked, camera, phong};

/// A closed cube of 2 m around the origin, walls facing inwards, with a small light in it that shines all around.
fn cube(albedo: f32, light: DVec3) -> Scene {
    let mut scene = Scene { name: "cube".into(), ..Scene::default() };
    let wall = phong([albedo; 3], [0.0; 3], 1.0);
    for axis in 0..3 {
        for side in [-1.0_f32, 1.0] {
            let (mut n, mut u, mut v) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            n[axis] = side;
            u[(axis + 1) % 3] = 2.0;
            v[(axis + 2) % 3] = 2.0;
            let (n, u, v) = (Vec3::from(n), Vec3::from(u), Vec3::from(v));
            let corner = n - 0.5 * (u + v);
            let (u, v) = if side > 0.0 { (v, u) } else { (u, v) };
            add(&mut scene, quad(corner, u, v, 0.25), wall.clone(), DAffine3::IDENTITY);
        }
    }
    scene.lights.push(Light {
        name: "lamp".into(),
        kind: LightKind::Point,
        color: Vec3::ONE,
        intensity: 100.0,
        range: None,
        position: light,
        direction: Vec3::NEG_Y,
    });
    scene.cameras.push(camera(dvec3(0.0, 0.0, 0.9), DVec3::ZERO, 1.2));
    scene
}

fn patches(scene: &Scene, caches: &CacheSet, albedo: f64) -> Vec<Patch> {
    let of = |(i, model): (usize, &usize)| {
        let place = scene.instances[i].world_from_model;
        caches.models[*model].caches.iter().map(move |c| Patch {
            cache: Cache { position: place.transform_point3(c.position.as_dvec3()), normal: c.normal.as_dvec3(), exponent: 1.0 },
            area: c.area.into(),
            albedo: DVec3::splat(albedo),
        }).collect::<Vec<_>>()
    };
    caches.instance_model.iter().enumerate().flat_map(of).collect()
}

#[test]
fn experiment() {
    for spacing in [0.8, 0.5, 0.3, 0.2, 0.1] {
        let scene = cube(0.5, DVec3::ZERO);
        let caches = baked(&scene, spacing, 8);
        let all = patches(&scene, &caches, 0.5);
        let area: f64 = all.iter().map(|p| p.area).sum();
        let rows: Vec<f64> = all.iter().map(|p| bounce::form_factors(&p.cache, &all)).collect();
        let mean = all.iter().zip(&rows).map(|(p, r)| p.area * r).sum::<f64>() / area;
        let mut sorted = rows.clone();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        eprintln!("spacing {spacing}: {n} caches, area {area:.4} of 24; rows mean {mean:.4}, min {:.3} 5% {:.3} 50% {:.3} 95% {:.3} max {:.3}", sorted[0], sorted[n/20], sorted[n/2], sorted[n*19/20], sorted[n-1]);
        // by distance from the nearest edge
        for i in (0..n).step_by((n / 12).max(1)) {
            let p = all[i].cache.position.abs().to_array();
            let mut p = p; p.sort_by(f64::total_cmp);
            eprintln!("   to edge {:.3} {:.3}: {:.3} area {:.4}", 1.0 - p[1], 1.0 - p[0], rows[i], all[i].area);
        }
    }
}
