//! Small emissive bodies as lamps: their light against the integral over their triangles, and pictures against the path
//! tracer.

use std::f64::consts::PI;

use glam::{DAffine3, DQuat, DVec3, Vec3, dvec3};
use lightskin::frame::{LightShadows, Near, Shadows, World};
use lightskin::lab::knobs::Knobs;
use lightskin::reference::light::body_falloff;
use lightskin::scene::Scene;
use lightskin::scene::build::{CornellSurface, Surface, cornell, cuboid, quad, sphere};

use crate::area_lights::{against_paths, shining};
use crate::common::frames::{add, small};
use crate::common::gpu;
use crate::sources::directions;

/// The triangles of a surface whose centres are below this height.
pub(crate) fn below(mut surface: Surface, height: f32) -> Surface {
    let middle = |t: &[u32]| t.iter().map(|&i| surface.vertices[i as usize].position.y).sum::<f32>() / 3.0;
    surface.indices = surface.indices.chunks(3).filter(|t| middle(t) < height).flatten().copied().collect();
    surface
}

/// A body in a large room.
fn shown(body: Surface, world_from_body: DAffine3) -> Scene {
    let mut scene = cornell(CornellSurface::Diffuse, 0.5);
    scene.lights.clear();
    add(&mut scene, body, shining(Vec3::new(300.0, 200.0, 100.0)), world_from_body);
    scene
}

#[test]
fn small_bodies_shine_as_the_integral_over_their_triangles() {
    let gpu = gpu();
    let turned = DQuat::from_axis_angle(dvec3(0.3, -0.5, 0.8).normalize(), 1.1);
    let placed = |stretch: DVec3| DAffine3::from_scale_rotation_translation(stretch, turned, dvec3(0.2, 1.1, 0.3));
    let ball = || sphere(0.03, 24);
    let cube = cuboid(Vec3::splat(-0.03), Vec3::splat(0.03), 0.1, |_| true);
    let bodies = [
        ("ball", ball(), DVec3::ONE, 0.002),
        ("flame", ball(), dvec3(0.4, 1.5, 0.4), 0.005),
        ("pill", ball(), dvec3(1.0, 0.4, 1.0), 0.005),
        ("pebble", ball(), dvec3(1.0, 0.6, 0.3), 0.005),
        ("bulb with a socket", below(ball(), 0.02), DVec3::ONE, 0.01),
        ("bowl", below(ball(), 0.0), DVec3::ONE, 0.01),
    ];
    // A box is six area lights.
    assert_eq!(World::new(&gpu, &shown(cube, placed(DVec3::ONE)), None).expect("upload").bodies, []);
    for (name, body, stretch, most) in bodies {
        let scene = shown(body, placed(stretch));
        let world = World::new(&gpu, &scene, None).expect("upload");
        let [light] = &world.bodies[..] else { panic!("{name}: {:?}", world.bodies) };
        let instance = scene.instances.last().expect("the body");
        let mesh = &scene.meshes[instance.mesh];
        let faces: Vec<DVec3> = (0..mesh.triangle_count())
            .map(|t| {
                let [a, b, c] = mesh
                    .triangle(t)
                    .map(|v| instance.world_from_model.transform_point3(mesh.vertices[v].position.as_dvec3()));
                0.5 * (b - a).cross(c - a)
            })
            .collect();
        let (mut off, mut sum) = (0.0, 0.0);
        for d in directions(500) {
            let exact: f64 = 200.0 * faces.iter().map(|face| face.dot(d).max(0.0)).sum::<f64>();
            let fitted = light.intensity.y * body_falloff(d, light.q, light.lean);
            off += (fitted - exact).abs();
            sum += exact;
        }
        println!("{name}: mean error {:.4} of the mean, radius {:.4} m", off / sum, light.radius);
        assert!(off / sum < most, "{name}: {}", off / sum);
        assert!((light.intensity.x / light.intensity.y - 1.5).abs() < 1e-6);
    }
}

#[test]
fn light_of_a_hollow_leaves_through_its_opening() {
    let (gpu, radius) = (gpu(), 0.04);
    let scene = shown(below(sphere(radius, 48), 0.0).reversed(), DAffine3::from_translation(DVec3::Y));
    let world = World::new(&gpu, &scene, None).expect("upload");
    let [light] = &world.bodies[..] else { panic!("{:?}", world.bodies) };
    // The mean of a falloff that leans is that of its silhouette, 1.
    let (flux, opening) = (4.0 * PI * light.intensity.y, PI * f64::from(radius).powi(2));
    println!("{flux:.4} lm of {:.4}", 200.0 * PI * opening);
    assert!((flux / (200.0 * PI * opening) - 1.0).abs() < 0.03);
}

#[test]
fn a_room_with_a_lamp_is_the_path_tracers() {
    let near = Near::Rays { per_pixel: 8, every: 2 };
    let light_shadows = LightShadows::Rays;
    let rays = Knobs { size: [48, 36], rsm: 96, shadows: Shadows::PerLight, near, light_shadows, ..small() };
    let maps = Knobs { light_shadows: LightShadows::Maps(1024), near: Near::Off, ..rays };
    // The half shines to the side and down, so that no direction is like another. From nearby its light comes from elsewhere
    // than the middle of its surface, which the lamp does not know.
    let half = DAffine3::from_scale_rotation_translation(
        dvec3(1.3, 1.0, 0.6),
        DQuat::from_rotation_z(-0.9),
        dvec3(0.35, 1.3, 0.3),
    );
    let ball = DAffine3::from_translation(half.translation);
    for (what, body, world_from_body, knobs, biases) in [
        ("ball, rays", sphere(0.06, 24), ball, rays, [0.01, 0.03]),
        ("half, rays", below(sphere(0.06, 24), 0.0), half, rays, [0.02, 0.02]),
        ("half, maps", below(sphere(0.06, 24), 0.0), half, maps, [0.02, 0.02]),
    ] {
        let mut scene = shown(body, world_from_body);
        scene.materials.last_mut().expect("the lamp's").emissive = Vec3::splat(400.0);
        let board = quad(Vec3::new(-0.5, 0.9, -0.2), Vec3::X * 0.6, Vec3::NEG_Z * 0.5, 0.2);
        let white = scene.materials[0].clone();
        add(&mut scene, board.clone().and(board.reversed()), white, DAffine3::IDENTITY);
        for ((bounces, most), bias) in [(0, 0.05), (2, 0.065)].into_iter().zip(biases) {
            let [error, own] = against_paths(&scene, &Knobs { bounces, ..knobs }, 32);
            println!("{what}, {bounces} bounces: mean error {error:.4} of the mean, bias {own:+.4}");
            assert!(error < most && own.abs() < bias, "{what}, {bounces}: {error}, {own}");
        }
    }
}
