//! Multiple bounces: energy in closed boxes against the geometric series, the device against the f64 twin and the path
//! tracer.

use glam::{DAffine3, DVec3, Vec3, dvec3};
use lightskin::bake::{CacheSet, NO_CACHE};
use lightskin::frame::near::SEEN_LIFT;
use lightskin::frame::{LightShadows, Near, Shadows, World};
use lightskin::lab::knobs::{Frame, Knobs};
use lightskin::reference::bounce::{self, Met, Patch};
use lightskin::reference::depth_image::tangents;
use lightskin::reference::gather::Cache;
use lightskin::reference::hit_caches::Around;
use lightskin::reference::path_trace::{self, PathTrace};
use lightskin::reference::world::{Sides, World as Truth};
use lightskin::scene::build::{cuboid, quad};
use lightskin::scene::ggx::{MEAN_PHONG_COSINE, phong_albedo};
use lightskin::scene::{Image, Instance, Light, LightKind, Material, Scene, Texture, tessellate};
use lightskin::shared::{DEPTH_IMAGE_SIDE, DEPTH_IMAGE_TEXELS, UNKNOWN_CACHE, Val};
use serde_json::json;
use std::f64::consts::PI;

use crate::common::frames::{
    SPOT, Shot, add, baked, camera, corner, drawn_of, phong, references_at, sent_on, shoot, small, traced,
};
use crate::common::{gpu, load};

/// A closed 2 m cube centred at the origin. Its walls face inwards, and a point light shines inside.
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
        radius: 0.0,
        position: light,
        direction: Vec3::NEG_Y,
    });
    scene.cameras.push(camera(dvec3(0.0, 0.0, 0.9), DVec3::ZERO, 1.2));
    scene
}

/// The caches of a shot with their areas and the albedos of their untextured materials.
fn patches(scene: &Scene, caches: &CacheSet, shot: &Shot) -> Vec<Patch> {
    let of_instance = |(i, model): (usize, &usize)| {
        let materials = scene.meshes[scene.instances[i].mesh].triangle_materials();
        let patch = |c: &lightskin::bake::Cache| (f64::from(c.area), sent_on(scene, materials[c.triangle as usize]));
        caches.models[*model].caches.iter().map(patch).collect::<Vec<_>>()
    };
    let surfaces = caches.instance_model.iter().enumerate().flat_map(of_instance);
    shot.caches.iter().zip(surfaces).map(|(cache, (area, albedo))| Patch { cache: *cache, area, albedo }).collect()
}

/// Flux [lm] that arrives at all caches, first channel.
fn arriving(patches: &[Patch], irradiances: &[DVec3]) -> f64 {
    patches.iter().zip(irradiances).map(|(patch, irradiance)| patch.area * irradiance.x).sum()
}

#[test]
fn form_factors_of_a_closed_box_are_nearly_one() {
    for (spacing, off) in [(0.8, 0.06), (0.4, 0.03), (0.2, 0.016)] {
        let scene = cube(0.5, DVec3::ZERO);
        let caches = baked(&scene, spacing, 8);
        let patch = |c: &lightskin::bake::Cache| Patch {
            cache: Cache { position: c.position.as_dvec3(), normal: c.normal.as_dvec3(), exponent: 1.0 },
            area: c.area.into(),
            albedo: DVec3::ONE,
        };
        let models = caches.instance_model.iter().map(|model| &caches.models[*model]);
        let all: Vec<Patch> = models.flat_map(|model| model.caches.iter().map(patch)).collect();
        let area: f64 = all.iter().map(|p| p.area).sum();
        let factors: Vec<f64> = all.iter().map(|p| bounce::form_factors(&p.cache, &all)).collect();
        let mean = all.iter().zip(&factors).map(|(p, f)| p.area * f).sum::<f64>() / area;
        let (least, most) = factors.iter().fold((9.0_f64, 0.0_f64), |(a, b), f| (a.min(*f), b.max(*f)));
        eprintln!(
            "{} caches of {area:.3} m^2: form factors have the mean {mean:.4} and range from {least:.3} to {most:.3}",
            all.len()
        );
        assert!((area - 24.0).abs() < 0.01 && (mean - 1.0).abs() < off && least > 0.6 && most < 1.3);
    }
}

#[test]
fn bounces_are_the_twins() {
    let gpu = gpu();
    let scene = corner(&[SPOT, LightKind::Point, LightKind::Directional], 40.0);
    let caches = baked(&scene, 0.3, 8);
    for bounces in [2, 3, 5] {
        let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { bounces, ..small() });
        let all = patches(&scene, &caches, &shot);
        let twins = bounce::irradiances(&all, &shot.vals, bounces);
        let first = bounce::irradiances(&all, &shot.vals, 1);
        let worst = twins.iter().zip(&shot.sums[0]).map(|(t, s)| t.distance(*s) / t.length()).fold(0.0, f64::max);
        let more = arriving(&all, &twins) / arriving(&all, &first);
        eprintln!(
            "{bounces} bounces: {} caches, {more:.3} times the light of one bounce, largest error {worst:e}",
            all.len()
        );
        assert!(worst < 1e-5, "{bounces}: {worst}");
        assert!(more > 1.05);
        // The glossy lobe receives the last bounce.
        assert!(shot.sums[1].iter().any(|sum| sum.x > 0.0));
    }
}

#[test]
fn light_in_a_closed_box_is_the_geometric_series() {
    let gpu = gpu();
    for albedo in [0.5, 0.8] {
        let scene = cube(albedo, dvec3(0.11, 0.23, -0.17));
        let phi = 4.0 * PI * f64::from(scene.lights[0].intensity);
        for (spacing, bound) in [(0.4, 0.08), (0.2, 0.05)] {
            let caches = baked(&scene, spacing, 8);
            for bounces in [1, 2, 8] {
                let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { bounces, rsm: 96, ..small() });
                let all = patches(&scene, &caches, &shot);
                let series: f64 = (1..=bounces).map(|k| f64::from(albedo).powi(k as i32)).sum();
                let share = arriving(&all, &shot.sums[0]) / (phi * series);
                let factors: f64 = all.iter().map(|p| p.area * bounce::form_factors(&p.cache, &all)).sum();
                let factors = factors / all.iter().map(|p| p.area).sum::<f64>();
                eprintln!(
                    "albedo {albedo}, {} caches, {bounces} bounces: {share:.4} of the series; form factors {factors:.4}",
                    all.len()
                );
                assert!((share - 1.0).abs() < bound, "albedo {albedo}, {spacing} m, {bounces} bounces: {share}");
            }
        }
    }
}

#[test]
fn white_walls_never_make_light() {
    let gpu = gpu();
    // The light is in a corner, where discs approximate the surface worst.
    let scene = cube(1.0, dvec3(0.9, 0.9, 0.9));
    let phi = 4.0 * PI * f64::from(scene.lights[0].intensity);
    let caches = baked(&scene, 0.4, 8);
    let brightest = |bounces: u32| {
        let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { bounces, ..small() });
        let all = patches(&scene, &caches, &shot);
        let sum = arriving(&all, &shot.sums[0]);
        (shot.sums[0].iter().map(|e| e.x).fold(0.0, f64::max), sum)
    };
    let (first, _) = brightest(1);
    for bounces in [2, 16] {
        let (most, sum) = brightest(bounces);
        eprintln!(
            "{bounces} bounces: {:.3} of the bound, {:.3} of the light",
            most / first / f64::from(bounces),
            sum / phi
        );
        // A bounce adds at most as much light to a cache as the brightest cache of the previous bounce sends.
        assert!(most <= first * f64::from(bounces) * 1.00001);
        assert!(sum < 1.05 * phi * f64::from(bounces));
    }
}

#[test]
fn pictures_converge_to_paths_of_as_many_bounces() {
    let gpu = gpu();
    let scene = cube(0.6, dvec3(0.11, 0.23, -0.17));
    let settings = Knobs { size: [32, 32], rsm: 96, ..small() };
    let caches = baked(&scene, 0.2, 8);
    for bounces in [1, 2, 4] {
        let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { bounces, ..settings });
        let paths = path_trace::PathTraceSettings::engine(settings.size, bounces);
        let mut paths = PathTrace::new(&scene, &scene.cameras[0], &paths);
        (0..8).for_each(|_| paths.pass());
        let (mut off, mut sum, mut own) = (0.0, 0.0, 0.0);
        for (path, shown) in paths.diffuse().iter().zip(&shot.diffuse) {
            off += (f64::from(path[0]) - shown.x).abs();
            sum += f64::from(path[0]);
            own += shown.x;
        }
        let (error, bias) = (off / sum, own / sum - 1.0);
        eprintln!("{bounces} bounces: mean error {error:.4} of the mean, bias {bias:+.4}, noise {:.4}", paths.noise());
        assert!(error < 0.04 && bias.abs() < 0.03, "{bounces}: {error}, {bias}");
    }
}

#[test]
fn albedos_are_means_of_what_a_cache_stands_for() {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 40.0);
    // One white texel and seven black ones repeat many times along the floor. The wall is half metallic.
    let texels: Vec<u8> = (0..8).flat_map(|i| [if i == 0 { 255 } else { 0 }; 3].into_iter().chain([255])).collect();
    scene.images.push(Image { name: "stripes".into(), width: 8, height: 1, rgba: texels });
    let texture = Texture {
        image: 0,
        uv_set: 0,
        transform: glam::Affine2::from_scale(glam::Vec2::splat(23.0)),
        sampler: lightskin::scene::Sampler { nearest: true, ..Default::default() },
    };
    let floor = scene.instances[0].mesh;
    for vertex in &mut scene.meshes[floor].vertices {
        vertex.uv0 = glam::Vec2::new(vertex.position.x, vertex.position.z);
    }
    scene.materials[0].base_color_texture = Some(texture);
    scene.materials[1] =
        Material { metallic: 0.5, base_color: glam::Vec4::splat(0.4), ior: 1.0, ..Material::default() };
    let caches = baked(&scene, 0.5, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("upload");
    Frame::new(&gpu, &scene, &world, &small()).expect("one bounce");
    assert!(world.cache_albedos().is_none(), "one bounce must not need albedos");
    Frame::new(&gpu, &scene, &world, &Knobs { bounces: 2, ..small() }).expect("two bounces");
    let all: Vec<Vec3> = gpu.read(world.cache_albedos().expect("made")).expect("read");
    let floor = &all[..caches.models[caches.instance_model[0]].caches.len()];
    let wall = &all[floor.len()..][..caches.models[caches.instance_model[1]].caches.len()];
    let mean = floor.iter().sum::<Vec3>() / floor.len() as f32;
    eprintln!(
        "floor {mean}, from {:?} to {:?}",
        floor.iter().map(|a| a.x).fold(1.0, f32::min),
        floor.iter().map(|a| a.x).fold(0.0, f32::max)
    );
    // The lobe has no texture, so it adds the same amount everywhere.
    let glossy = scene.materials[0].phong.expect("a lobe").specular * phong_albedo(40.0, MEAN_PHONG_COSINE) as f32;
    let diffuse = mean - glossy;
    assert!(diffuse.distance(Vec3::new(0.7, 0.5, 0.3) / 8.0) < 0.02 * diffuse.length(), "{mean}");
    assert!(floor.iter().all(|a| ((a.x - glossy.x) / diffuse.x - 1.0).abs() < 0.6));
    let half_metal = scene.materials[1].reflectance(&scene, Default::default(), glam::Vec4::ONE).sent_on();
    assert!(
        half_metal.x > 0.3 && half_metal.x < 0.4,
        "a diffuse half and a rough metallic half that loses a little light: {half_metal}"
    );
    assert!(wall.iter().all(|a| a.distance(half_metal) < 1e-5), "{wall:?}");
}

#[test]
fn caches_exchange_light_by_what_their_rays_meet() {
    let found = exchange_in(&cube(0.8, dvec3(0.11, 0.23, -0.17)), None);
    assert!(found == [0, 0], "in a convex room every point sees its caches: {found:?}");
}

/// A thin wall stands on a floor whose triangles continue on both of its sides.
#[test]
fn caches_take_light_from_this_side_of_a_wall() {
    let mut scene = cube(0.8, dvec3(0.11, 0.23, -0.17));
    let wall = cuboid(Vec3::new(-0.9, -1.0, -0.03), Vec3::new(0.5, -0.2, 0.03), 0.2, |_| true);
    add(&mut scene, wall, phong([0.8; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    let [aside, _] = exchange_in(&scene, None);
    assert!(aside > 300, "{aside}");
}

/// Rays that meet a body without caches count as the mean of the others.
#[test]
fn caches_take_unknown_surfaces_as_the_mean_of_all_others() {
    let mut scene = cube(0.8, dvec3(0.11, 0.23, -0.17));
    let body = cuboid(Vec3::new(-0.7, -0.5, -0.6), Vec3::new(-0.2, 0.1, -0.1), 0.5, |_| true);
    add(&mut scene, body, phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    let body = scene.instances.len() - 1;
    exchange_in(&scene, Some(body));
}

/// Caches trace rays.
fn by_rays() -> Knobs {
    let (near, light_shadows) = (Near::Rays { per_pixel: 8, every: 2 }, LightShadows::Maps(1024));
    Knobs { near, shadows: Shadows::PerLight, light_shadows, ..small() }
}

/// Holds one exchange of light in a cube against f64. `unknown`: an instance that loses its caches. Returns how many rays
/// take another cache than that of the largest weight, which their hits do not see, and how many differ from f64.
fn exchange_in(scene: &Scene, unknown: Option<usize>) -> [u32; 2] {
    let gpu = gpu();
    let mut caches = baked(scene, 0.4, 8);
    if let Some(instance) = unknown {
        let model = &mut caches.models[caches.instance_model[instance]];
        model.caches.clear();
        model.references.fill(NO_CACHE);
    }
    let caches = caches;
    let world = World::new(&gpu, scene, Some(&caches)).expect("uploaded");
    let knobs = Knobs { rsm: 96, ..by_rays() };
    // Radiosities before and after one exchange, and the caches that rays hit.
    let sent = |bounces: u32| {
        let frame = drawn_of(&gpu, scene, &world, &Knobs { bounces, ..knobs });
        let (by, sent_on) = traced(&frame);
        let vals: Vec<Val> = gpu.read(&by.bounces.as_ref().expect("bounces").vals).expect("read");
        let met: Vec<u32> = gpu.read(&sent_on.met).expect("read");
        (vals.iter().map(|val| { val.flux }.as_dvec3() / f64::from(val.area)).collect::<Vec<_>>(), met)
    };
    let ((first, met), (second, _)) = (sent(2), sent(3));
    let places = shoot(&gpu, scene, Some(&caches), &knobs).caches;
    let side = DEPTH_IMAGE_SIDE as usize;
    let middle = |i: usize| (i as f64 + 0.5) * 2.0 / side as f64 - 1.0;
    let inside: Vec<usize> =
        (0..side * side).filter(|texel| middle(texel % side).powi(2) + middle(texel / side).powi(2) < 1.0).collect();
    let truth = Truth::new(scene);
    let around = Around { world: &truth, caches: &places, reach: caches.spacing, lift: SEEN_LIFT * caches.spacing };
    let (mut worst, mut far, mut none, mut wrong, mut aside) = (0.0_f64, 0.0_f64, 0, 0, 0);
    for (i, cache) in places.iter().enumerate() {
        let [tangent, bitangent] = tangents(cache.normal);
        let of_cache = inside.iter().map(|texel| met[i * side * side + texel]);
        let met: Vec<Met> = of_cache.map(Met::of).collect();
        none += met.iter().filter(|met| **met == Met::Unknown).count();
        for (texel, met) in inside.iter().zip(&met) {
            let (x, y) = (middle(texel % side), middle(texel / side));
            let way = tangent * x + bitangent * y + cache.normal * (1.0 - x * x - y * y).sqrt();
            // The exit point of the ray from the cube.
            let end = (0..3).map(|axis| (way[axis].signum() - cache.position[axis]) / way[axis]);
            let hit = cache.position + way * end.fold(f64::INFINITY, f64::min);
            // Hits near edges are skipped, because f32 rays may hit the other wall.
            let start = cache.position + cache.normal * 1e-5;
            if hit.to_array().iter().filter(|x| x.abs() > 0.9999).count() > 1 {
                continue;
            }
            let Some(triangle) = truth.nearest(start, way, Sides::Both) else { continue };
            let &Met::Cache(met) = met else {
                wrong += u32::from(*met == Met::Nothing || Some(triangle.instance) != unknown);
                continue;
            };
            let surface = truth.surface(&triangle);
            let among = references_at(scene, &caches, &triangle);
            // The ray should choose among the references of all corners.
            let sorted = around.sorted(&surface, &among.concat());
            let Some(wanted) = around.first_seen(&surface, &sorted) else {
                wrong += 1;
                continue;
            };
            aside += u32::from(wanted != sorted[0]);
            // Rays in f32 end at slightly different points, where two caches may change their order.
            let alike = || around.weight(&surface, met) > 0.99 * around.weight(&surface, wanted);
            let right = met == wanted || sorted.contains(&met) && around.sees(&surface, met) && alike();
            match right {
                true => far = far.max(places[met].position.distance(surface.position)),
                false => wrong += 1,
            }
        }
        let wanted = first[i] + 0.8 * bounce::exchange(&met, &first);
        worst = worst.max(second[i].distance(wanted) / wanted.length());
    }
    let rays = places.len() * inside.len();
    println!(
        "{} caches: largest error {worst:.1e}; of {rays} rays {none} find no cache, the others find one within {far:.2} m",
        places.len()
    );
    assert!(worst < 1e-5 && (none > 0) == unknown.is_some(), "{worst}, {none}");
    // At a body's outline f32 rays may pass it.
    println!("{aside} hits do not see the cache of largest weight; {wrong} rays take another cache than in f64");
    assert!(wrong as usize * 2000 < rays, "{wrong}");
    // A cell is d_eps / 2 wide, and its nearest cache lies within d_eps of it.
    assert!(far < 1.5 * caches.spacing, "{far} m");
    [aside, wrong]
}

/// glTF's buffer views for parts of a buffer that follow each other.
fn views(parts: &[&[u8]]) -> Vec<serde_json::Value> {
    let view = |i: usize| {
        let before: usize = parts[..i].iter().map(|part| part.len()).sum();
        json!({"buffer": 0, "byteOffset": before, "byteLength": parts[i].len()})
    };
    (0..parts.len()).map(view).collect()
}

/// A scene within the walls, light and camera of a cube.
fn with_cube(mut scene: Scene) -> Scene {
    let room = cube(0.8, dvec3(0.11, 0.73, -0.17));
    for instance in &room.instances {
        let wall = &room.meshes[instance.mesh];
        let walls = scene.materials.len();
        scene.materials.push(room.materials[wall.primitives[0].material].clone());
        let mut wall = wall.clone();
        wall.primitives[0].material = walls;
        scene.instances.push(Instance { mesh: scene.meshes.len(), ..instance.clone() });
        scene.meshes.push(wall);
    }
    scene.lights = room.lights;
    scene.cameras = room.cameras;
    scene
}

/// Both sides of a bending two-sided surface lie in the same place, with caches of their own.
#[test]
fn rays_meet_the_near_side_of_surfaces_that_bend() {
    let surface = cuboid(Vec3::splat(-0.4), Vec3::splat(0.4), 0.2, |_| true);
    let (places, normals): (Vec<Vec3>, Vec<Vec3>) = surface.vertices.iter().map(|v| (v.position, v.normal)).unzip();
    let higher: Vec<Vec3> = places.iter().map(|p| Vec3::Y * (0.2 * p.y)).collect();
    let (count, indices) = (places.len(), surface.indices.len());
    let parts: [&[u8]; 6] = [
        bytemuck::cast_slice(&places),
        bytemuck::cast_slice(&normals),
        bytemuck::cast_slice(&higher),
        bytemuck::cast_slice(&surface.indices),
        bytemuck::bytes_of(&[0.0_f32, 1.0]),
        bytemuck::bytes_of(&[0.5_f32, 1.0]),
    ];
    let binary = parts.concat();
    let vectors = |view: usize, low: f32, high: f32| json!({"bufferView": view, "componentType": 5126, "count": count, "type": "VEC3", "min": [low, low, low], "max": [high, high, high]});
    let pair = |view: usize| json!({"bufferView": view, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1]});
    let numbers = json!({"bufferView": 3, "componentType": 5125, "count": indices, "type": "SCALAR"});
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "weights": [0.5]}],
        "materials": [{"doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0}}],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1}, "targets": [{"POSITION": 2}], "indices": 3, "material": 0
        }]}],
        "accessors": [vectors(0, -0.4, 0.4), vectors(1, -1.0, 1.0), vectors(2, -0.08, 0.08), numbers, pair(4), pair(5)],
        "animations": [{"samplers": [{"input": 4, "output": 5}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}],
        "bufferViews": views(&parts), "buffers": [{"byteLength": binary.len()}],
    });
    let mut scene = load("bends", &document, &binary).expect("loads");
    assert!(scene.materials[0].double_sided && scene.meshes[0].deform.is_some());
    scene.lights.clear();
    let scene = with_cube(scene);
    let gpu = gpu();
    let caches = baked(&scene, 0.25, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let frame = drawn_of(&gpu, &scene, &world, &Knobs { bounces: 2, ..by_rays() });
    let met: Vec<u32> = gpu.read(&traced(&frame).1.met).expect("read");
    // The body's caches come first. What the walls' caches hit is either the body or another wall.
    let on_body = caches.models[caches.instance_model[0]].caches.len();
    let of_walls = &met[on_body * DEPTH_IMAGE_TEXELS as usize..];
    let known = of_walls.iter().filter(|cache| (**cache as usize) < on_body).count();
    let unknown = of_walls.iter().filter(|cache| **cache == UNKNOWN_CACHE).count();
    println!("{known} rays find a cache of the body, {unknown} of all rays find none");
    assert!(known > 1000 && unknown * 50 < known, "{known}, {unknown}");
}

/// Rays that hit the second side of a two-sided surface find the caches of that side, also where triangles were divided.
#[test]
fn rays_meet_the_side_of_a_sheet_that_they_hit() {
    let sheet = quad(Vec3::new(-0.5, -0.4, 0.1), Vec3::X, 0.8 * Vec3::Y, 0.7);
    let (places, normals): (Vec<Vec3>, Vec<Vec3>) = sheet.vertices.iter().map(|v| (v.position, v.normal)).unzip();
    let (count, indices) = (places.len(), sheet.indices.len());
    let parts: [&[u8]; 3] =
        [bytemuck::cast_slice(&places), bytemuck::cast_slice(&normals), bytemuck::cast_slice(&sheet.indices)];
    let binary = parts.concat();
    let vectors = |view: usize| json!({"bufferView": view, "componentType": 5126, "count": count, "type": "VEC3", "min": [-0.5, -0.4, 0.1], "max": [0.5, 0.4, 0.1]});
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "materials": [{"doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
        "accessors": [vectors(0), vectors(1),
            {"bufferView": 2, "componentType": 5125, "count": indices, "type": "SCALAR"}],
        "bufferViews": views(&parts), "buffers": [{"byteLength": binary.len()}],
    });
    let mut scene = load("sheet", &document, &binary).expect("loads");
    scene.lights.clear();
    tessellate::tessellate(&mut scene, 0.3, 100_000);
    let of_sheet = &scene.meshes[0];
    let (triangles, _) = of_sheet.indices.as_chunks::<3>();
    assert!(triangles.len() > indices / 3 * 4, "{} triangles", triangles.len());
    assert!(triangles.chunks(2).all(|pair| of_sheet.are_twins(pair[0], pair[1])), "sides must be divided alike");
    let scene = with_cube(scene);

    let gpu = gpu();
    let caches = baked(&scene, 0.25, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let frame = drawn_of(&gpu, &scene, &world, &Knobs { bounces: 2, ..by_rays() });
    let met: Vec<u32> = gpu.read(&traced(&frame).1.met).expect("read");
    let places = shoot(&gpu, &scene, Some(&caches), &by_rays()).caches;
    let on_sheet = caches.models[caches.instance_model[0]].caches.len();
    let (mut sides, mut wrong) = ([0, 0], 0);
    for (texel, cache) in met.iter().enumerate().skip(on_sheet * DEPTH_IMAGE_TEXELS as usize) {
        if (*cache as usize) < on_sheet {
            let (from, to) = (&places[texel / DEPTH_IMAGE_TEXELS as usize], &places[*cache as usize]);
            let side = usize::from(from.position.z < 0.1);
            sides[side] += 1;
            wrong += u32::from(to.normal.z * (from.position.z - 0.1) < 0.0);
        }
    }
    let unknown = met.iter().filter(|cache| **cache == UNKNOWN_CACHE).count();
    println!("rays to the front and the back: {sides:?}; {wrong} find the other side's caches, {unknown} of all none");
    assert!(sides.iter().all(|count| *count > 1000) && wrong == 0 && unknown < 20, "{sides:?} {wrong} {unknown}");
}
