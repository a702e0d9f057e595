//! Caches that bodies hide in this frame: found as by f64 rays, and without weight beside the bodies.

use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::bake::closed::GAP;
use lightskin::frame::{LightShadows, Near, Shadows, World};
use lightskin::lab::knobs::Knobs;
use lightskin::reference::hidden::open_rays;
use lightskin::reference::world::World as Placed;
use lightskin::scene::build::{cuboid, quad};
use lightskin::scene::sky::Sky;
use lightskin::scene::{Scene, tessellate};
use lightskin::shared::{Cache, HIDDEN_RAYS};
use std::f64::consts::TAU;

use crate::common::frames::{add, baked, camera, drawn_of, phong, seen, shoot, small};
use crate::common::{assert_clean, gpu};

const SPACING: f64 = 0.2;
const BOX: usize = 1;

fn knobs(size: [u32; 2]) -> Knobs {
    let near = Near::Rays { per_pixel: 8, every: 0 };
    Knobs { size, near, shadows: Shadows::PerLight, rsm: 64, light_shadows: LightShadows::Maps(512), ..small() }
}

/// A box on a floor under an even sky. It may move, so the bake does not know what it covers. `sunk`: how far it stands
/// in the floor [m].
fn box_on_a_floor(sunk: f32) -> Scene {
    let mut scene = Scene { name: "floor".into(), ..Scene::default() };
    let floor = quad(vec3(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, 0.2);
    add(&mut scene, floor, phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    let body = cuboid(vec3(-0.5, 0.001 - sunk, -0.5), vec3(0.5, 1.0 - sunk, 0.5), 0.2, |_| true);
    add(&mut scene, body, phong([0.6; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene.instances[BOX].moves = true;
    scene.meshes[0].place_apart(3.0); // as an added ground: fewer caches than short rays would need
    scene.cameras.push(camera(dvec3(1.2, 1.4, 2.6), dvec3(0.0, 0.2, 0.0), 0.7));
    tessellate::divide(&mut scene, SPACING, None);
    scene
}

#[test]
fn bodies_hide_the_caches_under_them_wherever_they_stand() {
    let gpu = gpu();
    let mut scene = box_on_a_floor(0.0);
    let caches = baked(&scene, SPACING, 8);
    Sky::even(Vec3::splat(100.0)).put_over(&mut scene, 16);
    let places = [DVec3::ZERO, dvec3(0.7, 0.0, -0.4), dvec3(0.3, -0.4, 0.3)];
    let mut world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    for (two_sided, place) in [false, true].into_iter().flat_map(|two_sided| places.map(|place| (two_sided, place))) {
        scene.instances[BOX].world_from_model.translation = place;
        if scene.materials[BOX].double_sided == two_sided {
            world.update(&gpu, &scene).expect("the same scene");
        } else {
            scene.materials[BOX].double_sided = two_sided;
            world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
        }
        // The inside of a two-sided body that is sunk in the floor may be a room.
        let is_room = two_sided && place.y < 0.0;
        let frame = drawn_of(&gpu, &scene, &world, &knobs([48, 27]));
        let found: Vec<Cache> = gpu.read(&frame.light.caches().expect("caches").atlas.caches).expect("read");
        let placed = Placed::new(&scene);
        let (mut hidden, mut differ) = (0, 0);
        // The floor comes first, and all its caches look up.
        let on_floor = caches.models[caches.instance_model[0]].caches.len();
        for cache in &found[..on_floor] {
            let position = cache.position.as_dvec3() + world.origin;
            let open = open_rays(&placed, (position, DVec3::Y), HIDDEN_RAYS, [1e-5, GAP * world.spacing()]);
            let is_hidden = cache.normal == Vec3::ZERO;
            assert!(is_hidden || cache.normal.distance(Vec3::Y) < 1e-5);
            // A ray along an edge may end on either side of it.
            differ += u32::from(is_hidden != (open <= 1) && open.abs_diff(1) > 1);
            hidden += u32::from(is_hidden);
            let aside = (position.x - place.x).abs().max((position.z - place.z).abs());
            let is_under = aside < 0.5 && !is_room;
            assert!(is_hidden == is_under || (aside - 0.5).abs() < 0.02, "{position}");
        }
        println!("at {place}, two-sided {two_sided}: {hidden} of {on_floor} caches hidden, {differ} unlike f64 rays");
        assert!((hidden > 4) != is_room && differ == 0);
    }
    assert_clean(&gpu);
}

/// Share of an even sky's light that arrives at a point of the floor beside the box. Of its sides, those that face the
/// point hide a share each: Lambert's sum over the edges of a polygon.
fn open_beside_box(point: DVec3, sunk: f32) -> f64 {
    let [low, high] = [0.001, 1.0].map(|y: f64| (y - f64::from(sunk)).max(0.0));
    let hidden = |normal: DVec3| {
        let along = normal.cross(DVec3::Y);
        let corner = |(side, y): (f64, f64)| (0.5 * (normal + side * along) + y * DVec3::Y - point).normalize();
        let corners = [(-1.0, low), (1.0, low), (1.0, high), (-1.0, high)].map(corner);
        let edge = |i: usize| {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            a.angle_between(b) * a.cross(b).normalize_or_zero().y
        };
        (0..4).map(edge).sum::<f64>().abs() / TAU
    };
    let sides = [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z];
    1.0 - sides.into_iter().filter(|side| point.dot(*side) > 0.5).map(hidden).sum::<f64>()
}

#[test]
fn caches_under_a_moving_body_do_not_darken_the_floor_around_it() {
    let gpu = gpu();
    for sunk in [0.0, 0.3] {
        let mut scene = box_on_a_floor(sunk);
        let caches = baked(&scene, SPACING, 8);
        Sky::even(Vec3::splat(100.0)).put_over(&mut scene, 16);
        let size = [192, 108];
        let shot = shoot(&gpu, &scene, Some(&caches), &knobs(size));
        let (mut whole, mut shown, mut off, mut count) = (0.0, 0.0, 0.0, 0);
        for at in seen(&scene, size) {
            // Floor within 15 cm of the box.
            if at.instance == 0 && at.position.x.abs().max(at.position.z.abs()) < 0.65 {
                let (a, b) = (shot.direct[at.pixel].y, 0.5 * 100.0 * open_beside_box(at.position, sunk));
                whole += b;
                shown += a;
                off += (a - b).powi(2);
                count += 1;
            }
        }
        let mean = whole / f64::from(count);
        let (bias, rmse) = (shown / whole - 1.0, (off / f64::from(count)).sqrt() / mean);
        println!(
            "{sunk} m in the floor: light of the sky beside the box, bias {bias:+.4}, RMSE over mean {rmse:.4}, {count} pixels"
        );
        assert!(count > 400 && bias.abs() < 0.075 && rmse < 0.11, "{bias}, {rmse}");
    }
}
