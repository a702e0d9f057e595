//! Two-level hierarchies: rays hit moving instances at their current place, exactly as after a rebuild, and every box
//! encloses its content.

use super::{
    Asked, Count, Met, RAYS, Tracer, bodies, check, compared, direction, needs_its_stack, numbers, random_rays,
};
use crate::common::data;
use crate::common::frames::{add, phong};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, dvec3, vec3};
use lightskin::frame::world::rays::RayBuffers;
use lightskin::lab::scenes::{crowd, moving};
use lightskin::reference::world::{self, Sides};
use lightskin::scene::build::quad;
use lightskin::scene::{Scene, gltf};
use lightskin::shared::{RAY_STILL, RefitBox};

/// Bodies of which most may move. Some share a mesh.
fn movable() -> Scene {
    let mut scene = bodies();
    for i in 0..20 {
        let mut twin = scene.instances[i].clone();
        twin.world_from_model.translation = -twin.world_from_model.translation;
        twin.world_from_model.matrix3 *= DMat3::from_diagonal(dvec3(1.0, -0.7, 1.2));
        scene.instances.push(twin);
    }
    for (i, instance) in scene.instances.iter_mut().enumerate() {
        instance.moves = i % 4 != 3;
    }
    // The centre of this mesh is far from its own origin.
    let at = vec3(30.0, -20.0, 10.0);
    let mesh = scene.instances[5].mesh;
    scene.meshes[mesh].vertices.iter_mut().for_each(|v| v.position += at);
    for instance in scene.instances.iter_mut().filter(|instance| instance.mesh == mesh) {
        instance.world_from_model *= DAffine3::from_translation(-at.as_dvec3());
    }
    scene
}

/// Moves, rotates, mirrors, hides and shows instances.
fn stir(scene: &mut Scene, step: usize) {
    let mut next = numbers(100 + step as u64);
    for (i, instance) in scene.instances.iter_mut().enumerate().filter(|(_, instance)| instance.moves) {
        let turn = DMat3::from_quat(DQuat::from_axis_angle(direction(&mut next), 3.0 * next()));
        let flip = if i % 3 == step % 3 { -1.0 } else { 1.0 };
        let size = dvec3(flip, 0.7 + 0.5 * next(), 0.7 + 0.5 * next());
        let middle = instance.world_from_model.translation;
        let about = DAffine3::from_mat3_translation(turn * DMat3::from_diagonal(size), middle)
            * DAffine3::from_translation(-middle);
        instance.world_from_model = about * instance.world_from_model;
        instance.world_from_model.translation += 0.5 * direction(&mut next);
        instance.hidden = i % 7 == step % 7;
    }
}

#[track_caller]
fn is_right(count: &Count) {
    println!("{count:?}");
    assert!(count.wrong == 0 && count.holes == 0 && count.differ <= 3 && count.met > 1000, "{count:?}");
    assert!(count.distance < 2e-5 && count.position < 2e-5, "{count:?}");
    assert!(count.geometric < 1e-3 && count.normal < 1e-2 && count.emission < 1e-5, "{count:?}");
}

#[test]
fn rays_meet_what_may_move_turned_and_mirrored() {
    let scene = movable();
    let count = check("movable", &scene, RAYS);
    assert!(count.holes == 0 && count.glow > 1000, "{count:?}");
    let tracer = Tracer::new(&scene);
    needs_its_stack(&tracer, &scene, 2);
    let [_, levels, ..] = tracer.world.rays().expect("rays").constants(&tracer.gpu);
    assert_eq!(levels, 2);
}

#[test]
fn all_that_moves_is_met_as_from_scratch() {
    let mut scene = movable();
    scene.extent = scene.bounds();
    let mut tracer = Tracer::new(&scene);
    for step in 0..4 {
        stir(&mut scene, step);
        tracer.world.update(&tracer.gpu, &scene).expect("the same scene");
        tracer.draw(&scene);
        let rays = random_rays(&tracer, &scene, 20_000);
        let found = tracer.trace(&rays, Asked::default());
        is_right(&compared(&tracer, &scene, &rays, &found));
        assert_boxes(&tracer, &scene);
        // Which of the bodies are lamps was decided when the first scene was uploaded: lamps do not emit at hits.
        let dark =
            |found: Vec<Met>| found.into_iter().map(|met| Met { emission: Vec3::ZERO, ..met }).collect::<Vec<_>>();
        let anew = Tracer::new(&scene).trace(&rays, Asked::default());
        assert_eq!(dark(found), dark(anew), "step {step}");
    }
}

#[test]
fn all_that_bends_is_met_as_from_scratch() {
    for mut scene in [moving(0.1), crowd(12)] {
        let mut tracer = Tracer::new(&scene);
        for time in [0.4, 1.3, 2.9] {
            scene.pose(0, time);
            tracer.world.update(&tracer.gpu, &scene).expect("the same scene");
            tracer.draw(&scene);
            let rays = random_rays(&tracer, &scene, 20_000);
            let found = tracer.trace(&rays, Asked::default());
            is_right(&compared(&tracer, &scene, &rays, &found));
            assert_eq!(found, Tracer::new(&scene).trace(&rays, Asked::default()), "{}, {time}", scene.name);
            assert_boxes(&tracer, &scene);
        }
    }
}

#[test]
fn animated_files_are_met_where_they_are() {
    let Some(data) = data() else { return };
    for name in ["skin/CesiumMan.glb", "skin/Fox.glb", "morph/MorphStressTest.glb", "anim/CesiumMilkTruck.glb"] {
        let mut scene = gltf::load(&data.join("scenes/features").join(name)).expect(name);
        let (_, begin, end) = scene.animations().next().expect("an animation");
        let mut tracer = Tracer::new(&scene);
        for share in [0.3, 0.9] {
            scene.pose(0, begin + share * (end - begin));
            tracer.world.update(&tracer.gpu, &scene).expect("the same scene");
            tracer.draw(&scene);
            let rays = random_rays(&tracer, &scene, 20_000);
            let count = compared(&tracer, &scene, &rays, &tracer.trace(&rays, Asked::default()));
            println!("{name}: {count:?}");
            assert!(count.wrong == 0 && count.holes == 0 && count.differ <= 3 && count.met > 500, "{name}: {count:?}");
            assert!(count.distance < 2e-5 && count.geometric < 1e-3, "{name}: {count:?}");
            assert_boxes(&tracer, &scene);
        }
    }
}

/// Rays hit instances that an animation scales flat, and do not hit instances that it scales to zero.
#[test]
fn flat_bodies_are_met() {
    let mut scene = movable();
    let mut tracer = Tracer::new(&scene);
    for i in [0, 1, 2, 4] {
        let turn = DMat3::from_rotation_y(0.3 * f64::from(i)) * DMat3::from_rotation_x(0.5);
        let size = 3.0 * if i == 4 { DVec3::ZERO } else { dvec3(1.0, 1.0, 0.0) };
        scene.instances[i as usize].world_from_model.matrix3 = turn * DMat3::from_diagonal(size);
    }
    tracer.world.update(&tracer.gpu, &scene).expect("the same scene");
    tracer.draw(&scene);
    let rays = random_rays(&tracer, &scene, 50_000);
    let found = tracer.trace(&rays, Asked::default());
    let hits = |instance| found.iter().filter(|met| met.instance == instance).count();
    assert!(
        hits(0) > 50 && hits(1) > 50 && hits(2) > 50 && hits(4) == 0,
        "hits per flat body: {} {} {}, and of the one without extent: {}",
        hits(0),
        hits(1),
        hits(2),
        hits(4)
    );
    // A flat body has two sides at one place, and rays may hit either. Both tracers must agree on the distance.
    let frozen = scene.frozen();
    let truth = world::World::new(&frozen);
    let flat = rays.iter().zip(&found).filter(|(_, met)| met.instance < 3);
    for (ray, met) in flat {
        let origin = tracer.world.origin + ray.origin.as_dvec3();
        let expected = truth.nearest(origin, ray.direction.as_dvec3(), Sides::Both);
        let distance = expected.expect("a flat body").distance;
        let off = (distance - f64::from(met.distance)).abs() / tracer.world.radius;
        assert!(off < 1e-4, "the distance is off by {off}: {ray:?} {met:?}");
    }
}

/// Instances of one mesh. The largest become area lights. Rays that hit the smaller ones see their emission.
#[test]
fn only_area_lights_do_not_shine_where_they_are_met() {
    let mut scene = Scene { name: "lamps".into(), ..Scene::default() };
    let mut glow = phong([0.5; 3], [0.0; 3], 1.0);
    glow.emissive = vec3(3.0, 2.0, 1.0);
    add(&mut scene, quad(vec3(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y, 0.5), glow, DAffine3::IDENTITY);
    scene.instances[0].moves = true;
    for i in 1..20 {
        let mut lamp = scene.instances[0].clone();
        let size = DMat3::from_diagonal(DVec3::splat(1.0 - 0.02 * f64::from(i)));
        lamp.world_from_model = DAffine3::from_mat3_translation(size, dvec3(1.1 * f64::from(i), 0.0, 0.0));
        scene.instances.push(lamp);
    }
    let tracer = Tracer::new(&scene);
    assert_eq!(tracer.world.areas.len(), 16);
    assert_eq!(tracer.world.rays().expect("rays").triangle_count, 2 * scene.meshes[0].triangle_count());
    let toward = |i: usize| {
        let at = scene.instances[i].world_from_model.translation - tracer.world.origin + dvec3(0.1, 0.13, 1.0);
        super::Ray::new(at.as_vec3(), Vec3::NEG_Z)
    };
    let found = tracer.trace(&(0..20).map(toward).collect::<Vec<_>>(), Asked::default());
    for (i, met) in found.iter().enumerate() {
        assert_eq!(met.instance, i as u32);
        assert_eq!(met.emission != Vec3::ZERO, i >= 16, "{i}: {met:?}");
    }
}

/// The first movement of an instance that was not declared to move rebuilds the hierarchy. From then on it may move.
#[test]
fn what_moves_for_the_first_time_may_move_from_then_on() {
    let mut scene = bodies();
    let mut tracer = Tracer::new(&scene);
    let levels = |tracer: &Tracer| tracer.world.rays().expect("rays").constants(&tracer.gpu)[1];
    assert_eq!(levels(&tracer), 1);
    for step in 0..3 {
        scene.instances[4].world_from_model.translation.x += 0.3;
        scene.instances[9].hidden = step == 1;
        tracer.world.update(&tracer.gpu, &scene).expect("the same scene");
        tracer.draw(&scene);
        assert_eq!(levels(&tracer), 2);
        let rays = random_rays(&tracer, &scene, 20_000);
        is_right(&compared(&tracer, &scene, &rays, &tracer.trace(&rays, Asked::default())));
    }
    let before = tracer.gpu.counters();
    scene.instances[4].world_from_model.translation.y += 0.3;
    tracer.world.update(&tracer.gpu, &scene).expect("the same scene");
    assert_eq!(tracer.gpu.counters(), before, "only the first movement may create objects");
}

/// All nodes and triangles of a world's hierarchy.
struct Boxes {
    nodes: Vec<[u32; 20]>,
    triangles: Vec<[f32; 12]>,
    /// Number of triangles visited so far.
    met: usize,
}

impl Boxes {
    fn byte(node: &[u32; 20], word: usize, child: usize) -> u32 {
        node[word + child / 4] >> (8 * (child % 4)) & 0xff
    }

    /// Children of a node: for each its box, its index if it is a node, its first triangle and its number of triangles.
    fn children(&self, at: u32) -> Vec<([DVec3; 2], Option<u32>, u32, u32)> {
        let node = &self.nodes[at as usize];
        let corner = Vec3::from_slice(&[0, 1, 2].map(|axis| f32::from_bits(node[axis]))).as_dvec3();
        let size = |axis: u32| f64::from(f32::from_bits((node[3] >> (8 * axis) & 0xff) << 23));
        let size = dvec3(size(0), size(1), size(2));
        let mut inner = 0;
        let mut all = Vec::new();
        for child in 0..8 {
            let meta = Self::byte(node, 6, child);
            if meta == 0 {
                continue;
            }
            let plane = |words: [usize; 3]| DVec3::from(words.map(|word| f64::from(Self::byte(node, word, child))));
            let bounds = [plane([8, 12, 16]), plane([10, 14, 18])].map(|planes| corner + size * planes);
            if node[3] >> (24 + child) & 1 == 1 {
                inner += 1;
                all.push((bounds, Some(node[4] + inner - 1), 0, 0));
            } else {
                all.push((bounds, None, node[5] + (meta & 0x1f), (meta >> 5).count_ones()));
            }
        }
        all
    }

    /// The exact box of the triangles below a node. Panics if content leaves its box by more than `slack` [box size
    /// plus distance from the origin].
    fn walk(&mut self, at: u32, slack: f64) -> RefitBox {
        let mut whole = RefitBox { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };
        for ([low, high], node, first, count) in self.children(at) {
            let mut own = RefitBox { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };
            if let Some(node) = node {
                own = self.walk(node, slack);
            }
            for triangle in first..first + count {
                self.met += 1;
                for corner in self.triangles[triangle as usize].chunks(4).map(Vec3::from_slice) {
                    own = RefitBox { low: { own.low }.min(corner), high: { own.high }.max(corner) };
                }
            }
            let (a, b) = ({ own.low }.as_dvec3(), { own.high }.as_dvec3());
            let slack = slack * (low.abs().max(high.abs()) + high - low);
            assert!((low - slack).cmple(a).all() && (high + slack).cmpge(b).all(), "{low} {high}: {a} {b}");
            whole = RefitBox { low: { whole.low }.min(own.low), high: { whole.high }.max(own.high) };
        }
        whole
    }
}

/// Asserts that every box encloses its content: exactly for refitted boxes, elsewhere up to the slack that rays add.
/// Boxes of the top level must enclose the posed triangles in world space.
fn assert_boxes(tracer: &Tracer, scene: &Scene) {
    let RayBuffers { nodes, triangles, instances, .. } = tracer.world.rays().expect("rays");
    let gpu = &tracer.gpu;
    let instances: Vec<[f32; 16]> = gpu.read(instances).expect("read");
    let mut boxes =
        Boxes { nodes: gpu.read(nodes).expect("read"), triangles: gpu.read(triangles).expect("read"), met: 0 };
    let mut open = vec![0];
    let mut seen = 0;
    while let Some(at) = open.pop() {
        for ([low, high], node, first, count) in boxes.children(at) {
            open.extend(node);
            for words in &instances[first as usize..(first + count) as usize] {
                let [root, number] = [words[12], words[13]].map(f32::to_bits);
                seen += 1;
                if number == RAY_STILL {
                    boxes.walk(root, 2.4e-7);
                    continue;
                }
                let instance = &scene.instances[number as usize];
                let mesh = &scene.meshes[instance.mesh];
                boxes.walk(root, if mesh.deform.is_some() { 0.0 } else { 2.4e-7 });
                let posed = instance.pose.as_ref().map_or_else(|| mesh.vertices.clone(), |pose| mesh.posed(pose));
                for vertex in mesh.indices.iter().map(|i| &posed[*i as usize]) {
                    let p = instance.world_from_model.transform_point3(vertex.position.as_dvec3());
                    let p = p - tracer.world.origin;
                    assert!(low.cmple(p).all() && high.cmpge(p).all(), "{}: {low} {high} {p}", instance.name);
                }
            }
        }
    }
    let shown = || (0..scene.instances.len()).filter(|&i| !scene.instances[i].hidden);
    let movers = shown().filter(|&i| scene.may_move(i)).count();
    assert_eq!(seen, movers + usize::from(shown().count() > movers), "the top level must have each entry once");
    assert!(boxes.met > 0);
}

/// CPU time per frame for the top level over 299 moving instances. It is printed, since times depend on the machine.
#[test]
fn a_top_level_over_299_is_soon_made() {
    let mut next = numbers(3);
    let mut one = || {
        let low = Vec3::from([0; 3].map(|_| next() as f32));
        obvhs::aabb::Aabb::new(low.into(), (low + 0.1 * next() as f32).into())
    };
    let boxes: Vec<obvhs::aabb::Aabb> = (0..299).map(|_| one()).collect();
    let mut times: Vec<f64> = (0..201)
        .map(|_| {
            let start = std::time::Instant::now();
            assert_eq!(lightskin::bake::bvh::shallow(&boxes).primitive_indices.len(), 299);
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("299 boxes: {:.3} ms", times[100]);
    assert!(times[100] < 20.0);
}
