//! Scenes with very different sizes cost no more than others. Triangles, caches and memory are bounded over the whole
//! scene, counting every instance.

use crate::bake::meshes::sphere_mesh;
use crate::cli::{folder, keeping, text, works};
use glam::{DAffine3, DVec3, Vec3};
use lightskin::bake::{BakeSettings, CacheSet, Density, bake};
use lightskin::scene::tessellate::{divide, divide_if_few, expected_spacing};
use lightskin::scene::write::write_glb;
use lightskin::scene::{Instance, Material, Mesh, Primitive, Scene, Vertex};
use std::fs;
use std::process::Command;

/// A scene whose only mesh has these triangles, with one instance at each place.
fn scene(triangles: &[[Vec3; 3]], places: impl IntoIterator<Item = DAffine3>) -> Scene {
    let corners = |[a, b, c]: &[Vec3; 3]| {
        let normal = (*b - *a).cross(*c - *a).normalize();
        [*a, *b, *c].map(|position| Vertex { position, normal, ..Vertex::default() })
    };
    let vertices: Vec<Vertex> = triangles.iter().flat_map(corners).collect();
    let index_count = vertices.len() as u32;
    let primitives = vec![Primitive { first_index: 0, index_count, material: 0 }];
    let mesh =
        Mesh { name: "mesh".into(), vertices, indices: (0..index_count).collect(), primitives, ..Mesh::default() };
    let instance = |world_from_model| Instance { name: "instance".into(), world_from_model, ..Instance::default() };
    Scene {
        name: "bounded".into(),
        meshes: vec![mesh],
        materials: vec![Material::default()],
        instances: places.into_iter().map(instance).collect(),
        ..Scene::default()
    }
}

/// A rectangle with one corner at `at` and the edges `x` and `y`.
fn rectangle(at: Vec3, x: Vec3, y: Vec3) -> [[Vec3; 3]; 2] {
    [[at, at + x, at + x + y], [at, at + x + y, at + y]]
}

/// Cubes of about half a metre, and a large cube below them as the floor.
fn cubes_on_a_cube(count: usize) -> Scene {
    let (low, high) = (Vec3::splat(-0.5), Vec3::splat(0.5));
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
    let faces = [(low, y, x), (low, x, z), (low, z, y), (high, -x, -y), (high, -z, -x), (high, -y, -z)];
    let triangles: Vec<_> = faces.into_iter().flat_map(|(at, x, y)| rectangle(at, x, y)).collect();
    let small = (0..count).map(|i| {
        let (across, along) = (i % 32, i / 32);
        let size = 0.4 + 0.2 * (i as f64 * 0.618).fract();
        let at = DVec3::new(3.0 * across as f64 - 48.0, 0.5, 3.0 * along as f64 - 48.0);
        DAffine3::from_translation(at) * DAffine3::from_scale(DVec3::splat(size))
    });
    let floor = DAffine3::from_translation(DVec3::Y * -50.0) * DAffine3::from_scale(DVec3::splat(100.0));
    scene(&triangles, small.chain([floor]))
}

/// Very long and very thin strips, side by side.
fn strips(count: usize, length: f32) -> Scene {
    let strip = |i: usize| rectangle(Vec3::Z * (i as f32 * 0.1), Vec3::Z * 0.05, Vec3::X * length);
    scene(&(0..count).flat_map(strip).collect::<Vec<_>>(), [DAffine3::IDENTITY])
}

fn baked(scene: &Scene, count: usize) -> CacheSet {
    let settings = BakeSettings { density: Density::Count(count), angle: 60_f32.to_radians(), references: 8 };
    bake(scene, &settings, &|_, _| {}).expect("bakes")
}

/// Number of caches over all instances.
fn count(set: &CacheSet) -> usize {
    set.instance_model.iter().map(|model| set.models[*model].caches.len()).sum()
}

#[test]
fn small_instances_are_not_divided_for_a_large_one() {
    let cubes = cubes_on_a_cube(1000);
    let spacing = expected_spacing(&cubes, 2000);
    let (mut few, mut asked) = (cubes.clone(), cubes.clone());
    divide(&mut asked, spacing, None);
    assert!(divide_if_few(&mut few, spacing), "the floor alone must not need many triangles");
    for scene in [few, asked] {
        let triangles = scene.triangle_count();
        assert!((20_000..128_000).contains(&triangles), "{triangles} triangles of {}", cubes.triangle_count());
        assert_eq!(scene.meshes[scene.instances[0].mesh].triangle_count(), 12);
    }
}

#[test]
fn what_would_take_very_many_triangles_stays_as_it_is() {
    let many = strips(100, 1e5);
    let spacing = expected_spacing(&many, 2000);
    let mut scene = many.clone();
    assert!(!divide_if_few(&mut scene, spacing));
    assert_eq!((scene.triangle_count(), scene.instances.len()), (200, 1));
    // Even a forced division makes at most two million triangles over all instances.
    scene.instances = vec![scene.instances[0].clone(); 300];
    let spacing = expected_spacing(&scene, 2000);
    divide(&mut scene, spacing, None);
    assert!((200_000..=2_000_000).contains(&scene.triangle_count()), "{} triangles", scene.triangle_count());
}

#[test]
fn a_count_is_a_budget_over_all_instances() {
    let cubes = cubes_on_a_cube(999);
    for (asked, most) in [(2000, 5000), (1500, 3750), (1000, 2500), (10_000, 10_300)] {
        let set = baked(&cubes, asked);
        assert!((asked / 2..=most).contains(&count(&set)), "{} caches where {asked} were asked for", count(&set));
        assert!(set.models.iter().all(|model| !model.caches.is_empty() && model.coverage.distance <= set.spacing));
    }
}

#[test]
fn many_small_bodies_leave_caches_for_the_floor() {
    let floor = rectangle(Vec3::ZERO, Vec3::Z * 20.0, Vec3::X * 20.0);
    let with_balls = |balls: usize| {
        let mut scene = scene(&floor, [DAffine3::IDENTITY]);
        scene.meshes.push(sphere_mesh(0.2, 16));
        let place = |i: usize| DVec3::new(1.0 + 2.0 * (i % 10) as f64, 0.3, 1.0 + 2.0 * (i / 10) as f64);
        let ball =
            |i| Instance { mesh: 1, world_from_model: DAffine3::from_translation(place(i)), ..Instance::default() };
        scene.instances.extend((0..balls).map(ball));
        let set = baked(&scene, 700);
        assert!((630..=735).contains(&count(&set)), "{} caches", count(&set));
        let angle = |model: usize| set.models[model].coverage.angle.to_degrees();
        (set.models[0].caches.len(), angle(0), angle(1))
    };
    let (on_floor, floor_angle, ball_angle) = with_balls(90);
    println!("90 balls: {on_floor} caches on the floor; a ball's are {ball_angle:.0} degrees from its surface");
    assert!(
        on_floor > 200 && floor_angle < 1e-3 && (60.0..=75.0).contains(&ball_angle),
        "{on_floor} {floor_angle} {ball_angle}"
    );
    // Few bodies keep to the angle.
    assert!(with_balls(30).2 <= 60.0);
}

#[test]
fn what_lies_more_cells_from_its_origin_than_are_counted_bakes() {
    let far = Vec3::X * (1 << 30) as f32;
    let set = baked(&scene(&[[far, far + Vec3::Y, far + Vec3::Z]], [DAffine3::IDENTITY]), 100);
    assert!((50..=250).contains(&count(&set)), "{} caches", count(&set));
    assert!(set.models[0].references.iter().all(|reference| usize::from(*reference) < count(&set)));
}

#[test]
fn small_parts_far_apart_are_a_scene() {
    let part = |x: f32| rectangle(Vec3::X * x, Vec3::X * 0.01, Vec3::Y * 0.01);
    let far = scene(&[part(0.0), part(1000.0)].concat(), [DAffine3::IDENTITY]);
    let set = baked(&far, 2000);
    assert!((1900..=2100).contains(&count(&set)), "{} caches", count(&set));
    assert!(set.models[0].coverage.distance <= set.spacing);
}

/// Runs the tool on one thread with at most `kib` KiB of address space.
fn bounded(name: &str, scene: &Scene, kib: u32, args: &[&str]) -> String {
    let at = folder(name);
    write_glb(scene, &at.join("scene.glb")).expect("writes");
    let mut shell = Command::new("sh");
    let limit = format!("ulimit -v {kib}; exec \"$0\" \"$@\"");
    let out = keeping(shell.args(["-c", &limit, env!("CARGO_BIN_EXE_lightskin")]).args(args), &at)
        .env("RAYON_NUM_THREADS", "1")
        .output()
        .expect("the tool runs");
    assert!(out.status.success(), "{args:?}: {}{}", text(&out.stdout), text(&out.stderr));
    text(&out.stdout) + &text(&out.stderr)
}

#[test]
fn long_thin_scenes_take_little_memory() {
    let out = bounded("bounded-thin", &strips(60, 1e6), 512 << 10, &["bake", "scene.glb"]);
    assert!(out.contains("(120 triangles)"), "{out}");
}

#[test]
fn undivided_scenes_are_lit_at_pixels() {
    let at = folder("bounded-pixels");
    write_glb(&strips(100, 1e5), &at.join("scene.glb")).expect("writes");
    let interp = |more: &[&str]| {
        let args = [
            "render",
            "scene.glb",
            "-o",
            "a.png",
            "--size",
            "32x32",
            "--rsm",
            "16",
            "--shadows",
            "off",
            "--near",
            "off",
        ];
        works(&at, &[&args[..], &["--timings", "t.jsonl"], more].concat());
        let times = fs::read_to_string(at.join("t.jsonl")).expect("timings");
        let frame: serde_json::Value = serde_json::from_str(times.lines().next().expect("a frame")).expect("JSON");
        frame["interp"].as_str().expect("interp").to_owned()
    };
    assert_eq!(interp(&["--caches", "2000"]), "texel");
    assert_eq!(interp(&["--caches", "2000", "--max-edge", "0"]), "vertex");
}
