//! Moving scenes: a crowd of bending tubes, and a room with one example of each kind of motion.

use crate::scene::animation::{
    AnimatedInstance, Animation, Channel, Hold, Interpolation, Local, Node, Parts, Rig, Sampler, Skin, Target,
};
use crate::scene::build::{Surface, add_material, add_mesh, camera, cuboid, lathe, phong, place, quad, rough, sphere};
use crate::scene::deform::{Bind, Deform, Displacement, Influence, Pose};
use crate::scene::{Instance, Light, LightKind, Scene};
use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3};
use std::f64::consts::TAU;
use std::ops::Range;

/// Joints of a tube.
const JOINTS: usize = 4;

/// Period of the animation \[s\], and keys per period.
const PERIOD: f64 = 4.0;
const KEYS: usize = 17;

/// Height and radius of a tube \[m\].
const HEIGHT: f32 = 1.0;
const RADIUS: f32 = 0.08;

/// A square of `count` tubes on a floor under a sun, 0.5 m apart. Each sways on four joints of its own, all with
/// different phases. They share one mesh of about 200 vertices.
pub fn crowd(count: usize) -> Scene {
    let mut scene = Scene { name: format!("crowd of {count}"), ..Scene::default() };
    let stone = add_material(&mut scene, rough("stone", [0.6, 0.57, 0.52], 0.0, 0.9));
    let reed = add_material(&mut scene, rough("reed", [0.25, 0.55, 0.2], 0.0, 0.6));
    let side = (count.max(1) as f64).sqrt().ceil();
    let half = (0.25 * side + 0.5) as f32;
    let floor = quad(Vec3::new(-half, 0.0, -half), Vec3::Z * 2.0 * half, Vec3::X * 2.0 * half, 0.25);
    let floor = add_mesh(&mut scene, "floor", vec![(floor, stone)]);
    let mut parts = Parts { nodes: vec![Node::default()], ..Parts::default() };
    stand(&mut scene, &mut parts, "floor", floor, 0);
    let mesh = tube(&mut scene, reed);
    let mut channels = Vec::new();
    for index in 0..count {
        let place = DVec3::new(index as f64 % side, 0.0, (index as f64 / side).floor()) - 0.5 * (side - 1.0);
        // The golden ratio spreads phases evenly for any count.
        let phase = (index as f64 * 0.618_033_988_749_895).fract();
        let at = DVec3::new(0.5 * place.x, 0.0, 0.5 * place.z);
        channels.extend(sway(&mut scene, &mut parts, &format!("reed {index}"), mesh, at, phase));
    }
    parts.animations = vec![Animation { name: "sway".into(), channels }];
    scene.lights.push(Light {
        name: "sun".into(),
        kind: LightKind::Directional,
        color: Vec3::new(1.0, 0.95, 0.85),
        intensity: 50_000.0,
        range: None,
        radius: 0.0,
        position: DVec3::ZERO,
        direction: Vec3::new(-0.5, -1.0, -0.3).normalize(),
    });
    let eye = DVec3::new(0.4, 0.45, 0.9) * (f64::from(half) + 1.5);
    scene.cameras.push(camera("above", eye, DVec3::new(0.0, 0.4, 0.0), 0.8));
    rigged(scene, parts)
}

/// A white room of 2 m, open towards +Z, with a rotating block, a swaying tube, a stretching ball, and a lamp of 100 cd
/// that circles below the ceiling; the period is 4 s. The first animation moves everything, each other one a single
/// object.
///
/// `edge` \[m\]: longest side of the walls' grid cells.
pub fn moving(edge: f32) -> Scene {
    let mut scene = Scene { name: "moving".into(), ..Scene::default() };
    let [white, red, green, blue] =
        [("white", [0.73; 3]), ("red", [0.63, 0.065, 0.05]), ("green", [0.14, 0.45, 0.09]), ("blue", [0.1, 0.2, 0.6])]
            .map(|(name, albedo)| add_material(&mut scene, phong(name, albedo, [0.0; 3], 1.0)));
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let corner = Vec3::new(-1.0, 0.0, -1.0);
    let shell = quad(corner, z, x, edge).and(quad(corner + y, x, z, edge)).and(quad(corner, x, y, edge));
    let shell = vec![(shell, white), (quad(corner, y, z, edge), red), (quad(corner + x, z, y, edge), green)];
    let shell = add_mesh(&mut scene, "room", shell);
    let mut parts = Parts { nodes: vec![Node::default()], ..Parts::default() };
    stand(&mut scene, &mut parts, "room", shell, 0);

    let block = cuboid(Vec3::splat(-0.2), Vec3::splat(0.2), edge.min(0.1), |_| true);
    let block = add_mesh(&mut scene, "block", vec![(block, white)]);
    let turning = node(&mut parts, None, DVec3::new(-0.5, 0.5, -0.3));
    stand(&mut scene, &mut parts, "block", block, turning);
    let turn = |time: f64| DQuat::from_rotation_y(TAU * time / PERIOD) * DQuat::from_rotation_x(0.6);
    let mut animations = vec![Animation { name: "block".into(), channels: vec![rotation(turning, turn)] }];

    let tube = tube(&mut scene, blue);
    let channels = sway(&mut scene, &mut parts, "tube", tube, DVec3::new(0.1, 0.0, 0.2), 0.0);
    animations.push(Animation { name: "tube".into(), channels });

    let ball = stretched_ball(&mut scene, white);
    let standing = node(&mut parts, None, DVec3::new(0.6, 0.35, -0.4));
    let instances = scene.instances.len()..scene.instances.len() + 1;
    stand(&mut scene, &mut parts, "ball", ball, standing);
    scene.instances[instances.start].pose = Some(Pose { joints: Vec::new(), weights: vec![0.0] });
    parts.instances[instances.start].weights = vec![0.0];
    animations.push(Animation { name: "ball".into(), channels: vec![stretching(instances)] });

    let lamp = node(&mut parts, None, DVec3::new(0.5, 1.7, 0.0));
    let circle = |time: f64| {
        let (sine, cosine) = (TAU * time / PERIOD).sin_cos();
        DVec3::new(0.5 * cosine, 1.7, 0.5 * sine)
    };
    let sampler = sampled(3, |time| circle(time).to_array().to_vec());
    let channels = vec![Channel { sampler, target: Target::Translation(lamp) }];
    animations.push(Animation { name: "lamp".into(), channels });
    parts.lights.push(lamp);
    scene.lights.push(Light {
        name: "lamp".into(),
        kind: LightKind::Point,
        color: Vec3::ONE,
        intensity: 100.0,
        range: None,
        radius: 0.0,
        position: circle(0.0),
        direction: Vec3::NEG_Z,
    });
    let channels = animations.iter().flat_map(|animation| animation.channels.clone()).collect();
    animations.insert(0, Animation { name: "all".into(), channels });
    parts.animations = animations;
    let yfov = 2.0 * (1.0_f32 / 2.6).atan();
    scene.cameras.push(camera("front", DVec3::new(0.0, 1.0, 3.6), DVec3::new(0.0, 1.0, 0.0), yfov));
    rigged(scene, parts)
}

/// The scene with its rig in the rest pose.
fn rigged(mut scene: Scene, parts: Parts) -> Scene {
    scene.rig = Some(Rig::new(parts));
    scene.extent = scene.sweep();
    scene
}

fn node(parts: &mut Parts, parent: Option<usize>, translation: DVec3) -> usize {
    let rest = Local::Parts { translation, rotation: DQuat::IDENTITY, scale: DVec3::ONE };
    parts.nodes.push(Node { parent, rest, hidden: false });
    parts.nodes.len() - 1
}

/// Places a mesh on a node.
fn stand(scene: &mut Scene, parts: &mut Parts, name: &str, mesh: usize, node: usize) {
    place(scene, name, mesh, parts.nodes[node].rest.affine());
    parts.instances.push(AnimatedInstance { node, hold: Hold::Node(DAffine3::IDENTITY), weights: Vec::new() });
}

/// Samples values at the keys of one period.
fn sampled(width: usize, value: impl Fn(f64) -> Vec<f64>) -> Sampler {
    let times: Vec<f32> = (0..KEYS).map(|key| (PERIOD * key as f64 / (KEYS - 1) as f64) as f32).collect();
    let values = times.iter().flat_map(|&time| value(f64::from(time))).map(|x| x as f32).collect();
    Sampler { times, values, width, interpolation: Interpolation::Linear }
}

fn rotation(node: usize, turn: impl Fn(f64) -> DQuat) -> Channel {
    let sampler = sampled(4, |time| turn(time).to_array().to_vec());
    Channel { sampler, target: Target::Rotation(node) }
}

/// A tube on a chain of joints; vertices between two joints are moved by both.
fn tube(scene: &mut Scene, material: usize) -> usize {
    let rings = 16;
    let mut profile: Vec<Vec2> = (0..=rings).map(|i| Vec2::new(RADIUS, HEIGHT * i as f32 / rings as f32)).collect();
    profile.push(Vec2::new(0.0, HEIGHT));
    let mesh = add_mesh(scene, "tube", vec![(lathe(&profile, 10), material)]);
    let mesh = &mut scene.meshes[mesh];
    let mut deform = Deform::default();
    for vertex in &mesh.vertices {
        let first_influence = deform.influences.len() as u32;
        let height = vertex.position.y / HEIGHT * JOINTS as f32 - 0.5;
        let lower = height.floor();
        let joint = |at: f32| at.clamp(0.0, (JOINTS - 1) as f32) as u32;
        let share = height - lower;
        let both = [(joint(lower), 1.0 - share), (joint(lower + 1.0), share)];
        let moved = both.iter().filter(|(_, weight)| *weight > 0.0);
        deform.influences.extend(moved.map(|&(joint, weight)| Influence { joint, weight }));
        let influence_count = deform.influences.len() as u32 - first_influence;
        let (position, normal, tangent) = (vertex.position, vertex.normal, vertex.tangent);
        deform.bind.push(Bind { position, normal, tangent, first_influence, influence_count });
    }
    mesh.deform = Some(deform);
    scene.meshes.len() - 1
}

/// Places a tube with its own skeleton and a swaying motion.
fn sway(scene: &mut Scene, parts: &mut Parts, name: &str, mesh: usize, at: DVec3, phase: f64) -> Vec<Channel> {
    let step = f64::from(HEIGHT) / JOINTS as f64;
    let mut joints = vec![node(parts, None, at)];
    for joint in 1..JOINTS {
        joints.push(node(parts, Some(joints[joint - 1]), DVec3::Y * step));
    }
    let lean = DQuat::from_rotation_y(TAU * phase) * DVec3::X;
    let turn = move |joint: usize, time: f64| {
        let beat = TAU * (time / PERIOD + phase) - 0.6 * joint as f64;
        DQuat::from_axis_angle(lean, 0.35 * beat.sin())
    };
    let channels = (1..JOINTS).map(|joint| rotation(joints[joint], |time| turn(joint, time))).collect();
    let inverse_bind =
        (0..JOINTS).map(|joint| DAffine3::from_translation(DVec3::NEG_Y * step * joint as f64)).collect();
    parts.instances.push(AnimatedInstance {
        node: joints[0],
        hold: Hold::Skin(parts.skins.len()),
        weights: Vec::new(),
    });
    parts.skins.push(Skin { joints, inverse_bind });
    scene.instances.push(Instance { name: name.into(), mesh, pose: Some(Pose::default()), ..Instance::default() });
    channels
}

/// A ball of 0.2 m with a morph target that makes it 1.7 times as high.
fn stretched_ball(scene: &mut Scene, material: usize) -> usize {
    let surface: Surface = sphere(0.2, 24);
    let mesh = add_mesh(scene, "ball", vec![(surface, material)]);
    let height = Vec3::new(1.0, 1.7, 1.0);
    let mesh = &mut scene.meshes[mesh];
    let bind = |vertex: &crate::scene::Vertex| {
        let (position, normal, tangent) = (vertex.position, vertex.normal, vertex.tangent);
        Bind { position, normal, tangent, ..Bind::default() }
    };
    let displaced = |vertex: &crate::scene::Vertex| Displacement {
        position: vertex.position * (height - 1.0),
        normal: (vertex.normal / height).normalize() - vertex.normal,
        tangent: Vec3::ZERO,
    };
    mesh.deform = Some(Deform {
        bind: mesh.vertices.iter().map(bind).collect(),
        targets: vec![mesh.vertices.iter().map(displaced).collect()],
        ..Deform::default()
    });
    scene.meshes.len() - 1
}

fn stretching(instances: Range<usize>) -> Channel {
    let sampler = sampled(1, |time| vec![0.5 - 0.5 * (TAU * time / PERIOD).cos()]);
    Channel { sampler, target: Target::Weights { instances, first: 0 } }
}
