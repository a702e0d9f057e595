//! Rays and rounding: edges, corners, directions along axes, sizes, triangles without area, many triangles at a place.

use super::{Asked, NOTHING, Ray, Tracer, still};
use crate::common::frames::{add, phong};
use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::reference::world::{self, Sides};
use lightskin::scene::build::{Surface, quad};
use lightskin::scene::{Scene, Vertex};

/// A surface of triangles that share no vertices.
fn surface(triangles: impl IntoIterator<Item = [Vec3; 3]>) -> Surface {
    let mut surface = Surface::default();
    for corners in triangles {
        let [a, b, c] = corners.map(|corner| corner.as_dvec3());
        let normal = (b - a).cross(c - a).normalize_or(DVec3::Y).as_vec3();
        for position in corners {
            surface.indices.push(surface.vertices.len() as u32);
            surface.vertices.push(Vertex { position, normal, color: [255; 4], ..Vertex::default() });
        }
    }
    surface
}

/// The triangles of a closed ball.
fn ball(level: u32, radius: f64, at: DVec3) -> Vec<[Vec3; 3]> {
    let mut all: Vec<[DVec3; 3]> = Vec::new();
    for octant in 0..8 {
        let side = |bit: usize| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let [x, y, z] = [DVec3::X * side(0), DVec3::Y * side(1), DVec3::Z * side(2)];
        all.push(if side(0) * side(1) * side(2) > 0.0 { [x, y, z] } else { [x, z, y] });
    }
    for _ in 0..level {
        all = (all.into_iter())
            .flat_map(|[a, b, c]| {
                let [d, e, f] = [(a + b).normalize(), (b + c).normalize(), (c + a).normalize()];
                [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
            })
            .collect();
    }
    // Rotated, so that no edge is parallel to an axis.
    let turn = glam::DQuat::from_axis_angle(dvec3(0.3, 0.5, 0.8).normalize(), 0.7);
    all.into_iter().map(|t| t.map(|p| (at + turn * p * radius).as_vec3())).collect()
}

fn of(triangles: impl IntoIterator<Item = [Vec3; 3]>) -> Scene {
    let mut scene = Scene { name: "triangles".into(), ..Scene::default() };
    add(&mut scene, surface(triangles), phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene
}

#[test]
fn no_ray_leaves_a_closed_ball_at_edges_or_corners() {
    for (radius, far) in [(1e-6, 0.0), (1e-3, 0.0), (1.0, 0.0), (1e5, 0.0), (1e9, 0.0), (1.0, 1e4), (0.1, 1e5)] {
        let at = far * dvec3(1.0, 0.7, -0.3);
        let triangles = ball(4, radius, at);
        let mut all = triangles.clone();
        if far > 0.0 {
            // A second ball on the other side, so that the scene's centre is far from both.
            all.extend(ball(0, radius, -at));
        }
        let scene = of(all);
        let tracer = Tracer::new(&scene);
        let origin = tracer.world.origin;
        let relative = |p: Vec3| (p.as_dvec3() - origin).as_vec3();
        let inside = relative((at + radius * dvec3(0.013, -0.021, 0.008)).as_vec3());
        let edges = triangles.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]);
        let on_edges = edges.flat_map(|(p, q)| [0.5, 0.25, 0.9].map(|s| p.lerp(q, s)));
        let edges: Vec<Ray> = on_edges.map(|p| Ray::towards(inside, relative(p))).collect();
        let corners: Vec<Ray> = triangles.iter().flatten().map(|p| Ray::towards(inside, relative(*p))).collect();
        let missed = [tracer.missed(&edges), tracer.missed(&corners)];
        println!(
            "radius {radius:e}, {far:e} m away: missed {} of {} at edges, {} of {} at corners",
            missed[0],
            edges.len(),
            missed[1],
            corners.len()
        );
        assert_eq!(missed, [0, 0], "radius {radius:e}, {far:e} m away");
        // Rays from outside that point away must hit nothing.
        let outside = |ray: &Ray| Ray { origin: ray.origin + ray.direction * (3.0 * radius) as f32, ..*ray };
        let away: Vec<Ray> = corners.iter().map(outside).collect();
        assert_eq!(tracer.missed(&away), away.len(), "radius {radius:e}, {far:e} m away");
    }
}

#[test]
fn no_ray_along_an_axis_is_lost() {
    // A cube whose faces are grids: rays run along edges, diagonals and the planes between boxes.
    let mut triangles = Vec::new();
    let n = 8;
    for (axis, side) in [0, 1, 2].into_iter().flat_map(|axis| [(axis, -1.0_f32), (axis, 1.0)]) {
        let at = |i: usize, j: usize| {
            let mut p = [side; 3];
            p[(axis + 1) % 3] = 2.0 * i as f32 / n as f32 - 1.0;
            p[(axis + 2) % 3] = 2.0 * j as f32 / n as f32 - 1.0;
            Vec3::from(p)
        };
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    let tracer = Tracer::new(&of(triangles));
    for zero in [0.0, -0.0, 1e-30, -1e-30] {
        let mut rays = Vec::new();
        for (axis, side) in [0, 1, 2].into_iter().flat_map(|axis| [(axis, -1.0_f32), (axis, 1.0)]) {
            for (i, j) in (0..17).flat_map(|i| (0..17).map(move |j| (i as f32 / 8.0 - 1.0, j as f32 / 8.0 - 1.0))) {
                let mut d = [zero; 3];
                d[axis] = side;
                // In the planes of edges, and next to them.
                for share in [0.875, 0.999] {
                    let clamped = |v: f32| if share == 0.875 { v.clamp(-0.875, 0.875) } else { v * share };
                    let mut o = [0.0; 3];
                    o[(axis + 1) % 3] = clamped(i);
                    o[(axis + 2) % 3] = clamped(j);
                    rays.push(Ray::new(o.into(), d.into()));
                    // Starting just in front of the wall.
                    o[axis] = side * (1.0 - 1e-6);
                    rays.push(Ray::new(o.into(), d.into()));
                }
            }
        }
        let found = tracer.trace(&rays, Asked::default());
        let missed = found.iter().filter(|met| met.triangle == NOTHING).count();
        println!("along axes, other components {zero:e}: missed {missed} of {}", rays.len());
        assert_eq!(missed, 0, "missed rays, other components {zero:e}");
        let far = |(ray, met): (&Ray, &super::Met)| {
            let along = 1.0 - ray.origin.dot(ray.direction);
            (met.distance - along).abs()
        };
        let worst = rays.iter().zip(&found).map(far).fold(0.0, f32::max);
        assert!(worst < 3e-7, "the distance is off by {worst}");
    }
}

#[test]
fn what_has_no_area_hides_nothing_and_is_not_met() {
    let good = ball(3, 1.0, DVec3::ZERO);
    let mut all = good.clone();
    for [a, b, c] in good.iter().step_by(3).copied() {
        // Lines and points outside, inside and on the ball, and the same triangle again.
        all.extend([[a, b, b], [a, a, a], [a * 0.5, a * 0.5, b * 0.5], [a * 0.25, a * 0.5, a * 0.75], [a, b, c]]);
    }
    let scene = of(all);
    let tracer = Tracer::new(&scene);
    let middles = good.iter().map(|[a, b, c]| (*a + *b + *c) / 3.0);
    let rays: Vec<Ray> = middles.map(|p| Ray::towards(vec3(0.01, 0.02, 0.03), p)).collect();
    let found = tracer.trace(&rays, Asked::default());
    for (ray, met) in rays.iter().zip(&found) {
        assert!(met.triangle != NOTHING && met.distance > 0.9, "{ray:?}: {met:?}");
        assert!(met.geometric.is_finite() && met.normal.is_finite() && met.geometric.dot(ray.direction) < 0.0);
    }
    // A scene of points and lines only: rays hit nothing.
    let lines = of(good.iter().flat_map(|[a, b, _]| [[*a, *b, *b], [*a, *a, *a]]));
    let tracer = Tracer::new(&lines);
    assert_eq!(tracer.missed(&rays), rays.len());
}

#[test]
fn one_triangle_is_met_from_both_sides() {
    let corners = [vec3(-1.0, 0.0, -1.0), vec3(1.0, 0.0, -1.0), vec3(0.0, 0.0, 1.0)];
    let scene = of([corners]);
    let tracer = Tracer::new(&scene);
    let origin = tracer.world.origin.as_vec3();
    let rays = [1.0, -1.0].map(|y| Ray::new(vec3(0.1, y, -0.5) - origin, -Vec3::Y * y));
    for (ray, met) in rays.iter().zip(tracer.trace(&rays, Asked::default())) {
        assert!((met.distance - 1.0).abs() < 1e-6 && met.triangle == 0, "{met:?}");
        assert!((met.weights[0] - 0.425).abs() < 1e-6 && (met.weights[1] - 0.25).abs() < 1e-6, "{met:?}");
        assert!(met.geometric.distance(-ray.direction) < 1e-6 && met.normal.distance(-ray.direction) < 1e-6);
    }
    let past = [vec3(0.9, 1.0, 0.5), vec3(-1.1, 1.0, -0.9), vec3(0.0, 1.0, 1.1)];
    assert_eq!(tracer.missed(&past.map(|p| Ray::new(p - origin, -Vec3::Y))), past.len());
    // One ray ends before the triangle, one starts behind it.
    let short = [Ray { to: 0.99, ..rays[0] }, Ray { from: 1.01, ..rays[0] }];
    assert_eq!(tracer.missed(&short), 2);
}

#[test]
fn the_stack_is_enough_for_many_in_one_place() {
    let once = of([[Vec3::ZERO, Vec3::X, Vec3::Y]]);
    let mut same = once.clone();
    let mesh = &mut same.meshes[0];
    mesh.indices = mesh.indices.repeat(20_000);
    mesh.primitives[0].index_count = mesh.indices.len() as u32;
    // Pairs of triangles that shrink by half towards a corner.
    let shrinking = (0..100).flat_map(|i| {
        let size = 0.5_f32.powi(i);
        [[Vec3::X, Vec3::Y, Vec3::Z], [Vec3::X, Vec3::Z, Vec3::Y + Vec3::Z]].map(|t| t.map(|p| p * size))
    });
    let shrinking = of(shrinking);
    // Many small triangles next to a few large ones.
    let mut apart = of([]);
    let grey = || phong([0.5; 3], [0.0; 3], 1.0);
    add(&mut apart, quad(Vec3::ZERO, Vec3::X, Vec3::Y, 0.01), grey(), DAffine3::IDENTITY);
    let big = DAffine3::from_translation(dvec3(0.0, 0.0, 1e5)) * DAffine3::from_scale(DVec3::splat(1e5));
    add(&mut apart, quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0), grey(), big);
    // Nested triangles of growing size in one plane: the last one covers all.
    let grown = |i: i32| [-Vec3::ONE, vec3(1.0, -1.0, 1.0), Vec3::Y].map(|p| p * i as f32 * 5e-5);
    let nested = of((1..=20_000).map(grown));
    let largest = of([grown(20_000)]);
    // The f64 tracer cannot handle many triangles at one place, so it gets an equivalent scene.
    let scenes = [
        ("same", &same, &once),
        ("shrinking", &shrinking, &shrinking),
        ("apart", &apart, &apart),
        ("nested", &nested, &largest),
    ];
    for (what, scene, truth) in scenes {
        let tracer = Tracer::new(scene);
        let [stack, ..] = tracer.world.rays().expect("rays").constants(&tracer.gpu);
        println!("{what}: {} triangles, {stack} stack entries", scene.triangle_count());
        assert!(stack <= 48, "{what}: {stack} stack entries");
        // Rays towards the corner where most triangles are.
        let mut next = crate::analytic::numbers(3);
        let mut rays = Vec::new();
        for _ in 0..2000 {
            let size = 0.5_f64.powf(10.0 * next());
            let target = size * dvec3(next(), next(), next()) - tracer.world.origin;
            let origin = 3.0 * dvec3(next(), next(), next()) - tracer.world.origin;
            rays.push(Ray::new(origin.as_vec3(), (target - origin).normalize().as_vec3()));
        }
        let found = tracer.trace(&rays, Asked::default());
        assert_eq!(found, tracer.trace(&rays, Asked { stack: Some(4 * stack), ..Asked::default() }), "{what}");
        let (frozen, _) = still(truth);
        let truth = world::World::new(&frozen);
        let (mut met, mut differ) = (0, 0);
        // Near edges rounding decides.
        let inside = |second: f64, third: f64| second.min(third).min(1.0 - second - third) > 1e-3;
        for (ray, found) in rays.iter().zip(&found) {
            let origin = tracer.world.origin + ray.origin.as_dvec3();
            let expected = truth.nearest(origin, ray.direction.as_dvec3(), Sides::Both);
            let [second, third] = found.weights.map(f64::from);
            if !expected.is_none_or(|e| inside(e.weights.x, e.weights.y))
                || !(found.triangle == NOTHING || inside(second, third))
            {
                continue;
            }
            met += usize::from(expected.is_some());
            // Distance along the normal: along a grazing ray the rounding error is larger by 1 / cosine.
            let slope = f64::from(found.geometric.dot(ray.direction).abs());
            let near = |d: f64| (d - f64::from(found.distance)).abs() * slope < 2e-6 * tracer.world.radius;
            differ += usize::from(match expected {
                Some(expected) => found.triangle == NOTHING || !near(expected.distance),
                None => found.triangle != NOTHING,
            });
        }
        println!("{what}: {met} of {} rays hit a triangle, {differ} differ", rays.len());
        assert!(met > 100 && differ <= 2, "{what}: {met} hits, {differ} differ");
    }
}
