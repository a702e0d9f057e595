//! Rays on the device against the f64 tracer: which surface they hit and where. No ray slips through an edge, at any
//! scale.

mod closed;
mod levels;
mod lit;
mod textures;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, dvec3};
use lightskin::frame::{BodyLight, View, World};
use lightskin::gpu::{Bind, Buffer, Pipeline};
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::lab::scenes::moving;
use lightskin::reference::world::{self, Sides};
use lightskin::scene::build::{atrium, cuboid, sphere, torus_knot};
use lightskin::scene::{Scene, gltf};
use rayon::prelude::*;
use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::LazyLock;

use crate::analytic::numbers;
use crate::common::frames::{add, phong, placed, small};
use crate::common::{Turn, assert_clean, compile, data, from_spirv, gpu};

/// Number of rays per scene.
const RAYS: usize = 100_000;

/// A ray, limited to an interval of distances.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Ray {
    origin: Vec3,
    from: f32,
    direction: Vec3,
    to: f32,
}

impl Ray {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, from: 0.0, direction, to: 3e38 }
    }

    /// A ray from `origin` through a point.
    fn towards(origin: Vec3, point: Vec3) -> Self {
        Self::new(origin, (point - origin).as_dvec3().normalize().as_vec3())
    }
}

/// Result of a ray.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct Met {
    distance: f32,
    weights: [f32; 2],
    /// Index in its mesh; `NOTHING` if the ray hits nothing.
    triangle: u32,
    instance: u32,
    material: u32,
    geometric: Vec3,
    normal: Vec3,
    diffuse: Vec3,
    emission: Vec3,
    /// Direct light that the point reflects: mean over all `chances`.
    direct: Vec3,
}

const NOTHING: u32 = u32::MAX;

const SHADER: &str = "#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#include \"lib/hit_light.glsl\"
layout(local_size_x = 64) in;
struct Ray { vec3 origin; float from; vec3 direction; float to; };
struct Met {
    float distance; vec2 weights; uint triangle; uint instance; uint material;
    vec3 geometric; vec3 normal; vec3 diffuse; vec3 emission; vec3 direct;
};
layout(push_constant, scalar) uniform Push { uint root; float spread; uint lights; uint chances; uint times; uint more; } push;
layout(binding = 13, scalar) readonly buffer Rays { Ray rays[]; };
layout(binding = 14, scalar) writeonly buffer All { Met all[]; };
void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= rays.length()) {
        return;
    }
    Ray ray = rays[at];
    Hit hit = trace(ray.origin, ray.direction, ray.from, ray.to, push.root, 0u, false);
    Met met = Met(hit.distance, hit.weights, NO_HIT, NO_HIT, NO_HIT, vec3(0), vec3(0), vec3(0), vec3(0), vec3(0));
    if (hit.triangle != NO_HIT) {
        uint first = floatBitsToUint(ray_triangle(3u * hit.triangle).w);
        met.triangle = (first - hit_instances[hit.instance].first_index) / 3u;
        met.instance = hit.instance;
        met.material = floatBitsToUint(ray_triangle(3u * hit.triangle + 1u).w);
        HitSurface s = surface_at(hit, ray.origin, ray.direction, push.spread);
        met.geometric = s.geometric;
        met.normal = s.normal;
        met.diffuse = s.diffuse;
        met.emission = s.emission;
        // More rays of the same thread, so that lookups run inside a loop, as in the frame's shaders.
        for (uint i = 0u; i < push.more; ++i) {
            vec3 direction = ray.direction + 0.1 * float(i + 1u) * vec3(1, -0.5, 0);
            Hit further = trace(ray.origin, direction, ray.from, ray.to, push.root, 0u, false);
            if (further.triangle != NO_HIT) {
                met.direct += surface_at(further, ray.origin, direction, push.spread).diffuse;
            }
        }
        for (uint i = 0u; i < push.chances; ++i) {
            uint number = at % push.times * push.chances + i;
            vec3 chance = fract(0.5 + float(number) * vec3(0.8191725134, 0.6710436067, 0.5497004779));
            LightRay to_light = ray_to_some(s, normalize(ray.direction), push.lights, 0u, 0u, chance);
            met.direct += reflected_along(to_light, s, push.root) / float(push.chances);
        }
    }
    all[at] = met;
}
";

/// Options for tracing rays.
#[derive(Clone, Copy, Debug, Default)]
struct Asked {
    /// Width of a ray's cone, by distance.
    spread: f32,
    /// Light samples per ray.
    chances: u32,
    /// Number of consecutive rays that are equal and take different light samples. 0 acts as 1.
    times: u32,
    /// Number of further rays per thread, in other directions; `direct` also sums up the albedos that they find.
    more: u32,
    /// Number of stack entries, if not the number needed.
    stack: Option<u32>,
    /// Read nodes and triangles the way the other kind of device does.
    other_way: bool,
}

/// A scene on the device.
struct Tracer {
    world: World,
    /// By specialisation constants.
    pipelines: RefCell<HashMap<[u32; 4], Pipeline>>,
    gpu: Turn,
}

impl Tracer {
    fn new(scene: &Scene) -> Self {
        let gpu = gpu();
        let world = World::new(&gpu, scene, None).expect("uploaded");
        world.make_rays(&gpu, scene).expect("hierarchy");
        let tracer = Self { world, pipelines: RefCell::default(), gpu };
        tracer.draw(scene);
        tracer
    }

    /// Draws a frame: this copies changes to the device and poses deforming meshes.
    fn draw(&self, scene: &Scene) {
        let settings = Knobs { gi: Gi::Off, ..small() };
        let mut frame = Frame::new(&self.gpu, scene, &self.world, &settings).expect("made");
        let camera = scene.cameras.first().cloned().unwrap_or_else(|| {
            crate::common::frames::camera(self.world.origin + 2.0 * self.world.radius, self.world.origin, 0.8)
        });
        let view = View::new(&camera, settings.size, self.world.origin, self.world.radius);
        let drawn = self.gpu.frame(|cmd| {
            frame.record(cmd, &self.world, &view);
            Ok(())
        });
        assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    }

    /// The shader, compiled once for all tests, in a pipeline that is made once for each scene.
    fn pipeline(&self, constants: [u32; 4]) -> Pipeline {
        static CODE: LazyLock<Vec<u32>> = LazyLock::new(|| compile(SHADER).unwrap_or_else(|error| panic!("{error}")));
        let make = || from_spirv(&self.gpu, "test.rays", &CODE, &constants).expect("pipeline");
        self.pipelines.borrow_mut().entry(constants).or_insert_with(make).clone()
    }

    fn trace(&self, rays: &[Ray], asked: Asked) -> Vec<Met> {
        let buffers = self.world.rays().expect("rays");
        let [stack, levels, texels, holes] = buffers.constants(&self.gpu);
        let constants =
            [asked.stack.unwrap_or(stack), levels, if asked.other_way { 1 - texels } else { texels }, holes];
        let pipeline = self.pipeline(constants);
        let from: Buffer = self.gpu.buffer_from("test.asked", rays).expect("rays");
        let to = self.gpu.buffer("test.met", (size_of::<Met>() * rays.len()) as u64).expect("hits");
        let mut binds: Vec<Bind<'_>> = buffers.binds(&self.world).to_vec();
        binds.extend([&self.world.light_buffer, &from, &to].map(Bind::from));
        let lights = self.world.lights().len() as u32;
        let run = self.gpu.run_once("test.rays", |cmd| {
            cmd.bind(&pipeline, &binds);
            cmd.push(&[buffers.root, asked.spread.to_bits(), lights, asked.chances, asked.times.max(1), asked.more]);
            cmd.dispatch(rays.len() as u32, 1, 1);
        });
        run.expect("run");
        assert_clean(&self.gpu);
        self.gpu.read(&to).expect("hits")
    }

    /// Number of rays that hit nothing.
    fn missed(&self, rays: &[Ray]) -> usize {
        self.trace(rays, Asked::default()).iter().filter(|met| met.triangle == NOTHING).count()
    }
}

/// A random unit vector, uniform over all directions.
fn direction(next: &mut impl FnMut() -> f64) -> DVec3 {
    let (z, (sine, cosine)) = (2.0 * next() - 1.0, (std::f64::consts::TAU * next()).sin_cos());
    let across = (1.0 - z * z).max(0.0).sqrt();
    dvec3(across * cosine, across * sine, z)
}

/// Rays from random points within the bounds of a scene and slightly outside.
fn random_rays(tracer: &Tracer, scene: &Scene, count: usize) -> Vec<Ray> {
    let (low, high) = scene.bounds().expect("bounds");
    let (low, size) = (low - tracer.world.origin - 0.05 * (high - low), 1.1 * (high - low));
    let mut next = numbers(17);
    // The f64 tracer finds no hits nearer than this.
    let from = (1e-6 * tracer.world.radius) as f32;
    let ray = |_| {
        let origin = low + size * dvec3(next(), next(), next());
        Ray { from, ..Ray::new(origin.as_vec3(), direction(&mut next).as_vec3()) }
    };
    (0..count).map(ray).collect()
}

/// A static copy of a scene for the f64 tracer, and for each of its instances the index in the original scene.
fn still(scene: &Scene) -> (Scene, Vec<usize>) {
    let shown = scene.instances.iter().enumerate().filter(|(_, instance)| !instance.hidden);
    (scene.frozen(), shown.map(|(i, _)| i).collect())
}

/// Intersection of a ray with the plane of a triangle.
#[derive(Clone, Copy, Debug)]
struct OnPlane {
    distance: f64,
    /// Smallest absolute barycentric weight.
    weight: f64,
    /// Distance between the ray and the nearest edge \[m\].
    edge: f64,
}

fn on_plane(scene: &Scene, [instance, triangle]: [usize; 2], origin: DVec3, direction: DVec3) -> OnPlane {
    let instance = &scene.instances[instance];
    let mesh = &scene.meshes[instance.mesh];
    let place = |v: usize| instance.world_from_model.transform_point3(mesh.vertices[v].position.as_dvec3()) - origin;
    let [a, b, c] = mesh.triangle(triangle).map(place);
    let (u, v) = (b - a, c - a);
    let p = direction.cross(v);
    let inverse = 1.0 / u.dot(p);
    let q = (-a).cross(u);
    let (second, third) = ((-a).dot(p) * inverse, direction.dot(q) * inverse);
    let across = [a, b, c].map(|p| p - p.dot(direction) * direction);
    let from_edge = |i: usize| {
        let (p, along) = (across[i], across[(i + 1) % 3] - across[i]);
        let share = (-p.dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (p + share * along).length()
    };
    OnPlane {
        distance: v.dot(q) * inverse,
        weight: [1.0 - second - third, second, third].into_iter().fold(f64::INFINITY, |m, w| m.min(w.abs())),
        edge: [0, 1, 2].map(from_edge).into_iter().fold(f64::INFINITY, f64::min),
    }
}

/// Comparison of both tracers' hits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Count {
    /// Rays that hit a surface.
    met: usize,
    /// Rays that hit different surfaces at the same place: f64 cannot tell these apart either.
    same_place: usize,
    /// Rays whose hits differ.
    differ: usize,
    /// Of `differ`: rays within 1e-5 of an edge [weights], or within 1e-6 radii.
    at_edges: usize,
    /// Of the remaining ones: rays whose two hits are less than 1e-5 radii apart.
    close: usize,
    /// Of the remaining ones: rays that one tracer lets through a hole of an alpha mask.
    holes: usize,
    /// All remaining ones.
    wrong: usize,
    /// Largest error of the distance for equal hits that do not graze [radii].
    distance: f64,
    /// Largest error of the point given by the weights [radii].
    position: f64,
    /// Largest errors of normals.
    geometric: f64,
    normal: f64,
    /// Hits that emit light, and the largest relative error of the emission.
    glow: usize,
    emission: f64,
}

impl Count {
    fn and(self, b: Self) -> Self {
        let a = self;
        Self {
            met: a.met + b.met,
            same_place: a.same_place + b.same_place,
            differ: a.differ + b.differ,
            glow: a.glow + b.glow,
            at_edges: a.at_edges + b.at_edges,
            close: a.close + b.close,
            holes: a.holes + b.holes,
            wrong: a.wrong + b.wrong,
            distance: a.distance.max(b.distance),
            position: a.position.max(b.position),
            geometric: a.geometric.max(b.geometric),
            normal: a.normal.max(b.normal),
            emission: a.emission.max(b.emission),
        }
    }
}

/// Compares the device's hits with the f64 tracer's.
fn compared(tracer: &Tracer, scene: &Scene, rays: &[Ray], found: &[Met]) -> Count {
    let (frozen, numbers) = still(scene);
    let truth = world::World::new(&frozen);
    let (middle, radius, areas) = (tracer.world.origin, tracer.world.radius, tracer.world.areas.len());
    let bodies = &tracer.world.bodies;
    let one = |(ray, met): (&Ray, &Met)| {
        let mut count = Count::default();
        let (origin, direction) = (middle + ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let expected = truth.nearest(origin, direction, Sides::Both);
        let hit = (met.triangle != NOTHING).then(|| {
            let instance = numbers.iter().position(|&i| i == met.instance as usize).expect("an instance that is shown");
            [instance, met.triangle as usize]
        });
        count.met = usize::from(expected.is_some());
        // The device has one triangle for both sides of a two-sided surface.
        let two_sided = expected.is_some_and(|e| frozen.materials[e.material].double_sided);
        let same = match (expected, hit) {
            (None, None) => return count,
            (Some(e), Some([instance, triangle])) => {
                let here = (f64::from(met.distance) - e.distance).abs() < 1e-5 * radius;
                let triangles = if two_sided { here } else { triangle == e.triangle };
                e.instance == instance && e.material == met.material as usize && triangles
            }
            _ => false,
        };
        if let (true, Some(e), Some(hit)) = (same, expected, hit) {
            let surface = truth.surface(&e);
            let exact = on_plane(&frozen, hit, origin, direction).distance;
            if surface.geometric.dot(direction).abs() > 0.01 {
                count.distance = (f64::from(met.distance) - exact).abs() / radius;
            }
            let instance = &frozen.instances[hit[0]];
            let mesh = &frozen.meshes[instance.mesh];
            let corners = mesh
                .triangle(hit[1])
                .map(|v| instance.world_from_model.transform_point3(mesh.vertices[v].position.as_dvec3()));
            let [second, third] = met.weights.map(f64::from);
            let point = corners[0] + second * (corners[1] - corners[0]) + third * (corners[2] - corners[0]);
            // Measured across the ray: along it, grazing angles magnify any error.
            let off = point - surface.position;
            count.position = (off - off.dot(direction) * direction).length() / radius;
            count.geometric = surface.geometric.distance(met.geometric.as_dvec3());
            let normal = surface.vertex_normal;
            let side = if normal.dot(surface.geometric) < 0.0 { -1.0 } else { 1.0 };
            if normal.dot(surface.geometric).abs() > 1e-4 {
                count.normal = (side * normal).distance(met.normal.as_dvec3());
            }
            // Area lights and small bodies do not emit at hits.
            let is_body = |b: &BodyLight| surface.position.distance(b.middle) < 1.0001 * b.clear;
            if areas == 0 && frozen.materials[e.material].emissive_texture.is_none() {
                let largest = frozen.materials[e.material].emissive.length().max(1e-30);
                let emission = if bodies.iter().any(is_body) { DVec3::ZERO } else { surface.emission };
                count.glow = usize::from(emission != DVec3::ZERO);
                count.emission = emission.distance(met.emission.as_dvec3()) / f64::from(largest);
            }
            return count;
        }
        let of_hit = hit.map(|hit| on_plane(&frozen, hit, origin, direction));
        let of_expected = expected.map(|e| on_plane(&frozen, [e.instance, e.triangle], origin, direction));
        let apart = of_hit.zip(of_expected).map_or(f64::INFINITY, |(a, b)| (a.distance - b.distance).abs() / radius);
        if apart < 1e-9 {
            count.same_place = 1;
            return count;
        }
        count.differ = 1;
        let beside = |at: OnPlane| at.weight < 1e-5 || at.edge < 1e-6 * radius;
        let has_holes = |m: usize| frozen.materials[m].alpha_cutoff.is_some();
        if [of_hit, of_expected].into_iter().flatten().any(beside) {
            count.at_edges = 1;
        } else if apart < 1e-5 {
            count.close = 1;
        } else if expected.is_some_and(|e| has_holes(e.material)) || (hit.is_some() && has_holes(met.material as usize))
        {
            count.holes = 1;
        } else {
            count.wrong = 1;
            println!("{ray:?} hits {met:?} {of_hit:?} instead of {expected:?} {of_expected:?}");
        }
        count
    };
    rays.par_iter().zip(found).map(one).reduce(Count::default, Count::and)
}

/// Traces random rays through a scene and checks their hits against the f64 tracer's.
#[track_caller]
fn check(what: &str, scene: &Scene, count: usize) -> Count {
    let tracer = Tracer::new(scene);
    let rays = random_rays(&tracer, scene, count);
    let found = tracer.trace(&rays, Asked::default());
    let result = compared(&tracer, scene, &rays, &found);
    println!("{what}: {} triangles, {count} rays: {result:?}", tracer.world.rays().expect("rays").triangle_count);
    assert!(result.met * 10 > count, "{what}: {result:?}");
    assert_eq!(result.wrong, 0, "{what}: {result:?}");
    let allowed = (2e-5 * count as f64).max(3.0);
    assert!(result.differ as f64 <= allowed, "{what}: {result:?}");
    assert!(result.distance < 2e-5 && result.position < 2e-5, "{what}: {result:?}");
    assert!(result.geometric < 1e-3 && result.normal < 1e-2 && result.emission < 1e-5, "{what}: {result:?}");
    result
}

/// Rotated, squeezed, sheared and mirrored bodies.
fn bodies() -> Scene {
    let mut scene = Scene { name: "bodies".into(), ..Scene::default() };
    let mut next = numbers(5);
    for i in 0..60 {
        let surface = match i % 3 {
            0 => sphere(1.0, 12),
            1 => cuboid(Vec3::splat(-1.0), Vec3::splat(1.0), 0.5, |_| true),
            _ => torus_knot([2, 3], [0.8, 0.3, 0.15], [90, 12]),
        };
        let axis = direction(&mut next);
        let turn = DMat3::from_quat(DQuat::from_axis_angle(axis, 6.0 * next()));
        let mut size = DVec3::splat(0.4) + 1.5 * dvec3(next(), next(), next());
        if i % 2 == 1 {
            size.x = -size.x;
        }
        let mut linear = turn * DMat3::from_diagonal(size);
        if i % 5 == 0 {
            linear.y_axis += 0.7 * linear.x_axis;
        }
        let at = 20.0 * (dvec3(next(), next(), next()) - 0.5);
        let place = DAffine3::from_mat3_translation(linear, at);
        let mut material = phong([0.2 + 0.01 * i as f32, 0.5, 0.9], [0.0; 3], 1.0);
        if i % 3 == 0 {
            // Balls do not become area lights, since they are not flat.
            material.emissive = Vec3::new(3.0, 2.0, i as f32);
        }
        add(&mut scene, surface, material, place);
    }
    scene
}

#[test]
fn rays_meet_what_the_f64_tracer_meets_in_the_atrium() {
    assert_eq!(check("atrium", &atrium(), RAYS).holes, 0);
}

/// Hits stay the same if data are read as on the other kind of device, and with a larger stack. A stack that is too
/// small loses hits: this shows that the comparison can fail.
fn needs_its_stack(tracer: &Tracer, scene: &Scene, too_small: u32) {
    let rays = random_rays(tracer, scene, 20_000);
    let plain = tracer.trace(&rays, Asked::default());
    assert_eq!(plain, tracer.trace(&rays, Asked { other_way: true, ..Asked::default() }));
    assert_eq!(plain, tracer.trace(&rays, Asked { stack: Some(64), ..Asked::default() }));
    assert_ne!(plain, tracer.trace(&rays, Asked { stack: Some(too_small), ..Asked::default() }));
}

#[test]
fn rays_meet_turned_and_mirrored_bodies() {
    let scene = bodies();
    let count = check("bodies", &scene, RAYS);
    assert!(count.holes == 0 && count.glow > 1000, "{count:?}");
    needs_its_stack(&Tracer::new(&scene), &scene, 1);
}

#[test]
fn rays_meet_what_is_cut_out_of_textures() {
    let Some(data) = data() else { return };
    let scene = gltf::load(&data.join("scenes/sponza/Sponza.gltf")).expect("Sponza");
    assert!(scene.materials.iter().any(|m| m.alpha_cutoff.is_some()));
    check("Sponza", &scene, RAYS);
}

#[test]
fn rays_meet_what_moves_and_bends_where_it_is() {
    let mut scene = moving(0.1);
    scene.pose(0, 1.3);
    assert_eq!(check("moving", &scene, RAYS).holes, 0);
}

#[test]
fn rays_meet_a_scene_far_from_the_worlds_origin() {
    assert_eq!(check("atrium, 10 km away", &placed(&atrium(), 1.0, dvec3(1e4, 7e3, -3e3)), RAYS).holes, 0);
}

#[test]
fn rays_follow_instances_that_move_and_meet_none_that_are_hidden() {
    let mut scene = bodies();
    let mut tracer = Tracer::new(&scene);
    let rays = random_rays(&tracer, &scene, 20_000);
    let before = tracer.trace(&rays, Asked::default());
    assert!(before.iter().any(|met| met.instance == 4) && before.iter().any(|met| met.instance == 9));
    scene.instances[4].world_from_model.translation += dvec3(1.0, -2.0, 0.5);
    scene.instances[7].world_from_model.matrix3 *= DMat3::from_diagonal(dvec3(-1.0, 1.0, 1.3));
    scene.instances[9].hidden = true;
    // The scene's bounds stay as they were at the upload.
    tracer.world.update(&tracer.gpu, &scene).expect("the same scene");
    tracer.draw(&scene);
    let found = tracer.trace(&rays, Asked::default());
    assert!(found.iter().all(|met| met.instance != 9));
    let count = compared(&tracer, &scene, &rays, &found);
    println!("{count:?}");
    assert!(count.wrong == 0 && count.holes == 0 && count.differ <= 2, "{count:?}");
    assert!(count.distance < 2e-5 && count.normal < 1e-2, "{count:?}");
    // Rays find the instances at their new places.
    assert!(before.iter().zip(&found).filter(|(a, b)| a.instance != b.instance).count() > 100);
    scene.instances[9].hidden = false;
    tracer.world.update(&tracer.gpu, &scene).expect("the same scene");
    tracer.draw(&scene);
    assert!(tracer.trace(&rays, Asked::default()).iter().any(|met| met.instance == 9));
}
