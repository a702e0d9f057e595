//! Cache placement: the coverage guarantee, cache counts, areas and references against brute force, and the kept bake
//! file.

pub(crate) mod meshes;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use lightskin::Error;
use lightskin::bake::{self, BakeSettings, Cache, CacheSet, Density, ModelCaches, NO_CACHE, seeds, voxel};
use lightskin::scene::{Instance, Material, Mesh, Primitive, Scene, Vertex};
use meshes::{Random, box_mesh, flat_mesh, grid_mesh, soup, sphere_mesh, torus_mesh};
use std::f64::consts::{PI, TAU};

fn scene(parts: Vec<(Mesh, DAffine3)>) -> Scene {
    let mut scene = Scene::default();
    for (mesh, world_from_model) in parts {
        scene.instances.push(Instance {
            name: String::new(),
            mesh: scene.meshes.len(),
            world_from_model,
            ..Instance::default()
        });
        scene.meshes.push(mesh);
    }
    scene
}

fn spacing(spacing: f64) -> BakeSettings {
    BakeSettings { density: Density::Spacing(spacing), angle: 30f32.to_radians(), references: 8 }
}

fn count(count: usize) -> BakeSettings {
    BakeSettings { density: Density::Count(count), ..spacing(1.0) }
}

fn run(scene: &Scene, settings: &BakeSettings) -> CacheSet {
    bake::bake(scene, settings, &|_, _| {}).expect("bakes")
}

/// Corners in world space without translation, and the normal of the shaded side. `None` if the triangle has no area.
fn triangle(mesh: &Mesh, linear: DMat3, index: usize) -> Option<([DVec3; 3], DVec3)> {
    let corners = mesh.triangle(index).map(|v| mesh.vertices[v].position.as_dvec3());
    let shading: DVec3 = mesh.triangle(index).iter().map(|&v| mesh.vertices[v].normal.as_dvec3()).sum();
    let [a, b, c] = corners;
    let cross = (b - a).cross(c - a);
    let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
    // Twice the bake's limit, because the bake tests the transformed triangle.
    if !cross.is_finite() || cross.length() <= 2e-9 * longest {
        return None;
    }
    let front = if shading.dot(cross) < 0.0 { -cross } else { cross };
    Some((corners.map(|p| linear * p), (linear.inverse().transpose() * front).normalize()))
}

/// Position of a cache in world space without translation, computed from its triangle.
fn place(mesh: &Mesh, linear: DMat3, cache: &Cache) -> DVec3 {
    let [a, b, c] = mesh.triangle(cache.triangle as usize).map(|v| mesh.vertices[v].position.as_dvec3());
    let [second, third] = cache.barycentric.map(f64::from);
    linear * (a + (b - a) * second + (c - a) * third)
}

/// Checks for random points on all triangles that a cache lies within both bounds. Returns the caches.
fn check_guarantee(scene: &Scene, settings: &BakeSettings, random: &mut Random) -> CacheSet {
    let set = run(scene, settings);
    let angle = f64::from(settings.angle);
    for (instance, &model) in scene.instances.iter().zip(&set.instance_model) {
        let (mesh, model) = (&scene.meshes[instance.mesh], &set.models[model]);
        assert!(model.coverage.distance <= set.spacing, "{:?} at {}", model.coverage, set.spacing);
        assert!(model.coverage.angle <= angle * (1.0 + 1e-9), "{:?}", model.coverage);
        let linear = instance.world_from_model.matrix3;
        let caches: Vec<(DVec3, DVec3)> = (model.caches.iter())
            .map(|c| (place(mesh, linear, c), triangle(mesh, linear, c.triangle as usize).expect("has an area").1))
            .collect();
        // The mesh has f32 positions; everything computed from them is f64.
        let rounding = 1e-9 * set.spacing + 1e-13 * caches.iter().map(|c| c.0.length()).fold(0.0, f64::max);
        for index in 0..mesh.triangle_count() {
            let Some(([a, b, c], normal)) = triangle(mesh, linear, index) else { continue };
            for sample in 0..8 {
                let (u, v) = (random.next(), random.next());
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let point = [a, b, c].get(sample).copied().unwrap_or(a + (b - a) * u + (c - a) * v);
                let covers = |&(position, facing): &(DVec3, DVec3)| {
                    point.distance(position) <= set.spacing + rounding
                        && normal.cross(facing).length().atan2(normal.dot(facing)) <= angle + 1e-5
                };
                assert!(caches.iter().any(covers), "triangle {index} at {point} normal {normal} is not covered");
            }
        }
    }
    set
}

#[test]
fn every_surface_point_has_a_cache() {
    let mut random = Random(1);
    for round in 0..6 {
        let size = [0.1, 1.0, 8.0][round % 3];
        let soup = soup(&mut random, 300, size);
        let spacing = spacing(if size > 1.0 { 2.5 } else { 0.7 });
        check_guarantee(&scene(vec![(soup, DAffine3::IDENTITY)]), &spacing, &mut random);
    }
    for mesh in [sphere_mesh(1.0, 24), torus_mesh(1.0, 0.3, 24), box_mesh(DVec3::new(1.0, 2.0, 3.0), 2)] {
        let mesh = scene(vec![(mesh, DAffine3::IDENTITY)]);
        for (distance, degrees) in [(0.2, 30f32), (0.5, 10.0), (1.0, 60.0), (100.0, 120.0)] {
            let settings = BakeSettings { angle: degrees.to_radians(), ..spacing(distance) };
            let set = check_guarantee(&mesh, &settings, &mut random);
            assert!(!set.models[0].caches.is_empty());
        }
    }
}

#[test]
fn the_guarantee_holds_far_away_and_at_any_scale() {
    let mut random = Random(2);
    for offset in [DVec3::ZERO, DVec3::new(1e5, -1e5, 1e5)] {
        let plane = grid_mesh(7, 5, |u, v| (offset + DVec3::new(9.0 * u, 0.0, -6.0 * v), DVec3::Y));
        let set = check_guarantee(&scene(vec![(plane, DAffine3::IDENTITY)]), &spacing(1.0), &mut random);
        // The plane lies in one layer of 18 x 12 voxels. Some get no cache because their piece of the edge is a
        // splinter.
        assert!((150..=260).contains(&set.models[0].caches.len()), "{}", set.models[0].caches.len());
    }
    for scale in [1e-3, 1.0, 1e3] {
        let transform = DAffine3::from_scale(DVec3::splat(scale));
        let meshes = scene(vec![(torus_mesh(1.0, 0.4, 16), transform), (soup(&mut random, 100, 1.0), transform)]);
        check_guarantee(&meshes, &spacing(0.4 * scale), &mut random);
    }
}

#[test]
fn slivers_are_covered_and_degenerate_triangles_skipped() {
    let mut random = Random(3);
    let mut triangles: Vec<[DVec3; 3]> = (1..7)
        .map(|power| {
            let start = random.point() * 3.0;
            [start, start + DVec3::X * 5.0, start + DVec3::new(5.0, 0.1f64.powi(power), 0.0)]
        })
        .collect();
    let p = DVec3::ONE;
    triangles.extend([[p; 3], [p, p, DVec3::ZERO], [DVec3::ZERO, p, p * 2.0], [p, DVec3::NAN, DVec3::ZERO]]);
    let mesh = scene(vec![(flat_mesh(&triangles), DAffine3::IDENTITY)]);
    let set = check_guarantee(&mesh, &spacing(0.5), &mut random);
    assert!(set.models[0].caches.iter().all(|c| c.triangle < 6));
    // Vertices without surface, even those with NaN positions, still get references.
    assert!(set.models[0].references.iter().all(|&reference| reference != NO_CACHE));

    let nothing = scene(vec![(flat_mesh(&[[p; 3]]), DAffine3::IDENTITY)]);
    for settings in [spacing(0.5), count(10)] {
        let set = run(&nothing, &settings);
        assert!(set.models[0].caches.is_empty());
        assert_eq!(set.models[0].references, [NO_CACHE; 24]);
    }
    assert_eq!(run(&Scene::default(), &count(10)).models.len(), 0);
}

#[test]
fn vertex_normals_decide_which_side_is_the_surface() {
    let even = grid_mesh(10, 10, |u, v| (DVec3::new(u, 0.0, -v), DVec3::Y));
    let mut mixed = even.clone();
    mixed.indices.chunks_mut(6).for_each(|quad| quad.swap(0, 1));
    let mut bare = even.clone();
    bare.vertices.iter_mut().for_each(|v| v.normal = Vec3::ZERO);
    let run = |mesh| run(&scene(vec![(mesh, DAffine3::IDENTITY)]), &spacing(0.3)).models.remove(0);
    let (even, mixed, bare) = (run(even), run(mixed), run(bare));
    // The diagonals differ, so rounding differs, but the plane is the same.
    assert_eq!(even.caches.len(), mixed.caches.len());
    for (a, b) in even.caches.iter().zip(&mixed.caches) {
        assert!(a.position.distance(b.position) < 1e-5 && (a.area - b.area).abs() < 1e-5 && b.normal == Vec3::Y);
    }
    // Without normals the winding decides, both for caches and for vertices.
    assert_eq!(even, bare);
}

#[test]
fn bins_have_equal_areas_and_cover_the_sphere() {
    let mut random = Random(4);
    let mut hits = vec![0u32; seeds::BINS * seeds::BINS];
    let samples = 324 * 400;
    for _ in 0..samples {
        let (u, theta) = (2.0 * random.next() - 1.0, TAU * random.next());
        let radius = (1.0 - u * u).sqrt();
        hits[seeds::normal_bin(DVec3::new(radius * theta.cos(), radius * theta.sin(), u))] += 1;
    }
    // Expected: 400 in each bin, standard deviation 20. One bin in 5000 runs deviates by more than 5 standard
    // deviations.
    assert!(hits.iter().all(|&h| (300..=500).contains(&h)), "{hits:?}");
    for bin in 0..hits.len() {
        assert_eq!(seeds::normal_bin(seeds::bin_normal(bin)), bin);
        assert!((seeds::bin_normal(bin).length() - 1.0).abs() < 1e-12);
    }
    for pole in [DVec3::Z, -DVec3::Z, DVec3::X, -DVec3::X, DVec3::NEG_Y, DVec3::new(1.0, -0.0, 0.0)] {
        assert!(seeds::normal_bin(pole) < hits.len());
    }
}

#[test]
fn clipped_pieces_add_up() {
    let mut random = Random(5);
    for round in 0..200 {
        let mut corners = [(); 3].map(|()| (random.point() - 0.5) * 10.0);
        if round % 4 == 0 {
            corners.iter_mut().for_each(|corner| corner.y = 1.0); // in a grid plane
        }
        let [a, b, c] = corners;
        let (mut sum, mut voxels) = (0.0, std::collections::HashSet::new());
        voxel::clip([a, b, c], DVec3::splat(-20.0), 0.5, &mut |voxel, polygon| {
            let area = polygon.windows(2).map(|p| (p[0] - polygon[0]).cross(p[1] - polygon[0])).sum::<DVec3>();
            sum += 0.5 * area.length();
            assert!(voxels.insert(voxel), "a triangle has one piece per voxel");
            for corner in polygon {
                let inside = (*corner + 20.0) / 0.5 - DVec3::from_array(voxel.map(|x| x as f64));
                assert!(inside.min_element() > -1e-9 && inside.max_element() < 1.0 + 1e-9);
            }
            assert!(round % 4 != 0 || voxel[1] == 42);
        });
        let area = 0.5 * (b - a).cross(c - a).length();
        assert!((sum - area).abs() < 1e-12 * area.max(1.0), "{sum} of {area}");
    }
}

#[test]
fn counts_are_met() {
    let cube = scene(vec![(box_mesh(DVec3::new(4.0, 3.0, 5.0), 8), DAffine3::IDENTITY)]);
    // Each voxel layer adds its caches together, so small counts change in steps.
    for (target, percent) in [(1, 500.0), (6, 0.0), (50, 10.0), (250, 6.0), (1000, 3.0), (4000, 2.0)] {
        let set = run(&cube, &count(target));
        let off = 100.0 * (set.models[0].caches.len() as f64 - target as f64).abs() / target as f64;
        assert!(off <= percent, "{} for {target}", set.models[0].caches.len());
    }
    // An instanced mesh counts once per instance.
    let mut twins = scene(vec![(torus_mesh(1.0, 0.4, 32), DAffine3::IDENTITY)]);
    twins.instances = vec![twins.instances[0].clone(); 3];
    let set = run(&twins, &count(900));
    assert_eq!((set.models.len(), set.instance_model), (1, vec![0; 3]));
    assert!((set.models[0].caches.len() as f64 / 300.0 - 1.0).abs() < 0.03, "{}", set.models[0].caches.len());
}

fn total_area(model: &ModelCaches) -> f64 {
    model.caches.iter().map(|c| f64::from(c.area)).sum()
}

/// Centre and half axes of a cache's rectangle in world space, computed as in the atlas.
fn rectangle(cache: &Cache, world: &DAffine3) -> (DVec3, [DVec3; 2]) {
    let normal = (world.matrix3.inverse().transpose() * cache.normal.as_dvec3()).normalize();
    let axis = world.transform_vector3(cache.axis.as_dvec3());
    let across = normal.cross(axis.normalize()) * f64::from(cache.breadth);
    (world.transform_point3(cache.middle.as_dvec3()), [axis, across])
}

#[test]
fn rectangles_are_like_the_shares() {
    // The only cache of a flat rectangle covers all of it, even when it is stretched, turned and mirrored.
    let plane = grid_mesh(5, 5, |u, v| (DVec3::new(u, 0.0, -v), DVec3::Y));
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 0.5).normalize(), 0.7);
    let world = DAffine3::from_scale_rotation_translation(DVec3::new(2.0, 5.0, -3.0), turn, DVec3::new(7.0, 8.0, 9.0));
    let set = run(&scene(vec![(plane, world)]), &spacing(50.0));
    let [cache] = set.models[0].caches[..] else { panic!("{} caches", set.models[0].caches.len()) };
    let (middle, axes) = rectangle(&cache, &world);
    let [x, z] = [DVec3::X, DVec3::NEG_Z].map(|edge| world.transform_vector3(edge) * 0.5);
    assert!(middle.distance(world.transform_point3(DVec3::new(0.5, 0.0, -0.5))) < 1e-4, "{middle}");
    assert!(axes[0].cross(z).length() < 1e-4 && (axes[0].length() - 1.5).abs() < 1e-4, "{} along {z}", axes[0]);
    assert!(axes[1].cross(x).length() < 1e-4 && (axes[1].length() - 1.0).abs() < 1e-4, "{} along {x}", axes[1]);

    // In a mesh of two strips, a cache's rectangle covers only the strip below the cache, without the gap. This also
    // holds if triangles share no vertices and their corners differ by rounding.
    let mut strips = grid_mesh(6, 3, |u, v| (DVec3::new(2.0 * u, 0.0, -v), DVec3::Y));
    strips.indices.drain(36..72);
    let mut soup = strips.clone();
    soup.vertices = strips.indices.iter().map(|v| strips.vertices[*v as usize]).collect();
    soup.indices = (0..soup.vertices.len() as u32).collect();
    soup.vertices.iter_mut().step_by(2).for_each(|v| v.position *= 1.0 + f32::EPSILON);
    for mesh in [strips, soup] {
        let set = run(&scene(vec![(mesh, DAffine3::IDENTITY)]), &spacing(50.0));
        let [cache] = set.models[0].caches[..] else { panic!("{} caches", set.models[0].caches.len()) };
        let (middle, [along, across]) = rectangle(&cache, &DAffine3::IDENTITY);
        assert!((f64::from(cache.area) - 4.0 / 3.0).abs() < 1e-5, "{}", cache.area);
        assert!((along.length() - 1.0).abs() < 1e-4 && (across.length() - 1.0 / 6.0).abs() < 1e-4, "{along}, {across}");
        assert!(((middle.z + 0.5).abs() - 1.0 / 3.0).abs() < 1e-4, "{middle}");
    }

    // The rectangles on a thin rod together cover its circumference and protrude only slightly.
    let radius = 0.1;
    let rod = grid_mesh(24, 24, |u, v| {
        let normal = DVec3::new((TAU * u).cos(), 0.0, -(TAU * u).sin());
        (radius * normal + DVec3::Y * 2.0 * v, normal)
    });
    let settings = BakeSettings { angle: 60f32.to_radians(), ..spacing(0.4) };
    let set = run(&scene(vec![(rod, DAffine3::IDENTITY)]), &settings);
    let caches = &set.models[0].caches;
    let lateral = TAU * radius * 2.0;
    let mut area = 0.0;
    for cache in caches {
        let (middle, [a, b]) = rectangle(cache, &DAffine3::IDENTITY);
        area += 4.0 * a.length() * b.length();
        for corner in [a + b, a - b, b - a, -a - b] {
            let from_axis = (middle + corner).with_y(0.0).length();
            assert!(from_axis < 1.25 * radius, "{from_axis} of {radius}");
        }
    }
    let (rectangles, shares) = (area / lateral, total_area(&set.models[0]) / lateral);
    println!("{} caches: rectangles cover {rectangles:.3} of the rod, shares {shares:.3}", caches.len());
    assert!((0.8..1.1).contains(&rectangles), "{rectangles}");
}

#[test]
fn areas_add_up_to_the_surface() {
    let plane = |_: f64| grid_mesh(5, 5, |u, v| (DVec3::new(u, 0.0, -v), DVec3::Y));
    let square = run(&scene(vec![(plane(0.0), DAffine3::from_scale(DVec3::splat(2.0)))]), &spacing(50.0));
    assert_eq!(square.models[0].caches.len(), 1);
    assert!((total_area(&square.models[0]) - 4.0).abs() < 1e-5);

    // On planes and boxes, areas are exact: bisectors on one face ignore the other faces.
    let cases = [
        (plane(0.0), 1.0, 1e-5),
        (box_mesh(DVec3::new(1.0, 2.0, 3.0), 3), 22.0, 1e-5),
        // Caches see curved surfaces foreshortened: 0.4 % and 1 % of the area are lost here.
        (sphere_mesh(1.0, 48), 4.0 * PI, 0.01),
        (torus_mesh(1.0, 0.4, 48), 4.0 * PI * PI * 0.4, 0.02),
    ];
    for (mesh, area, within) in cases {
        let set = run(&scene(vec![(mesh, DAffine3::IDENTITY)]), &spacing(0.3));
        let ratio = total_area(&set.models[0]) / area;
        assert!((ratio - 1.0).abs() < within, "{ratio} of {area}");
        assert!(set.models[0].caches.iter().all(|c| c.area > 0.0));
    }

    // The two sides of a sheet share no area.
    let mut sheet = plane(0.0);
    let back: Vec<Vertex> = sheet.vertices.iter().map(|v| Vertex { normal: -Vec3::Y, ..*v }).collect();
    let first = sheet.vertices.len() as u32;
    let turned: Vec<u32> = sheet.indices.chunks(3).flat_map(|t| [first + t[0], first + t[2], first + t[1]]).collect();
    sheet.vertices.extend(back);
    sheet.indices.extend(turned);
    let set = run(&scene(vec![(sheet, DAffine3::IDENTITY)]), &spacing(0.3));
    assert!((total_area(&set.models[0]) - 2.0).abs() < 1e-5);
}

#[test]
fn references_equal_brute_force() {
    let mut random = Random(6);
    let uneven = DAffine3::from_scale(DVec3::new(-2.0, 0.5, 1.0));
    for (mesh, transform, spacing, references) in [
        (soup(&mut random, 400, 1.0), DAffine3::IDENTITY, 0.5, 8),
        (torus_mesh(1.0, 0.4, 32), uneven, 0.3, 16),
        (box_mesh(DVec3::new(1.0, 2.0, 30.0), 8), DAffine3::IDENTITY, 0.6, 16),
        (sphere_mesh(1.0, 8), DAffine3::IDENTITY, 50.0, 16),
    ] {
        let settings = BakeSettings { density: Density::Spacing(spacing), angle: 0.4, references };
        let scene = scene(vec![(mesh, transform)]);
        let set = run(&scene, &settings);
        let (mesh, model, linear) = (&scene.meshes[0], &set.models[0], transform.matrix3);
        let shading = |normal: Vec3| (linear.inverse().transpose() * normal.as_dvec3()).normalize();
        let caches: Vec<_> = model.caches.iter().map(|c| (place(mesh, linear, c), shading(c.normal))).collect();
        for (vertex, list) in mesh.vertices.iter().zip(model.references.chunks(references)) {
            let (position, normal) = (linear * vertex.position.as_dvec3(), shading(vertex.normal));
            let error = |index: usize| {
                let (place, facing) = caches[index];
                place.distance(position) / spacing + (1.0 - normal.dot(facing).clamp(0.0, 1.0)).sqrt()
            };
            let mut all: Vec<f64> = (0..caches.len()).map(error).collect();
            all.sort_by(f64::total_cmp);
            for (rank, &reference) in list.iter().enumerate() {
                match all.get(rank) {
                    // Equal errors may differ in order: the square root of 1 - 1 amplifies errors in the last bit.
                    Some(least) => assert!((error(usize::from(reference)) - least).abs() < 1e-7, "rank {rank}"),
                    None => assert_eq!(reference, NO_CACHE),
                }
            }
            let given = list.iter().filter(|&&r| r != NO_CACHE).collect::<std::collections::HashSet<_>>().len();
            assert_eq!(given, references.min(caches.len()), "each cache must appear once");
        }
    }
}

#[test]
fn caches_lie_on_their_triangles() {
    let scene = scene(vec![(torus_mesh(1.0, 0.4, 24), DAffine3::from_scale(DVec3::new(1.0, 3.0, 1.0)))]);
    let (mesh, set) = (&scene.meshes[0], run(&scene, &spacing(0.4)));
    for cache in &set.models[0].caches {
        let [second, third] = cache.barycentric;
        assert!(second >= 0.0 && third >= 0.0 && second + third <= 1.0 + 1e-6);
        assert!(place(mesh, DMat3::IDENTITY, cache).distance(cache.position.as_dvec3()) < 1e-6);
        let [a, b, c] = mesh.triangle(cache.triangle as usize).map(|v| &mesh.vertices[v]);
        let normal = (b.position - a.position).cross(c.position - a.position).normalize();
        let side = (a.normal + b.normal + c.normal).dot(normal).signum();
        assert!(cache.normal.distance(side * normal) < 1e-5);
    }
}

#[test]
fn threads_and_runs_change_nothing() {
    let mut random = Random(7);
    let meshes = vec![(soup(&mut random, 500, 1.0), DAffine3::IDENTITY), (sphere_mesh(2.0, 32), DAffine3::IDENTITY)];
    let scene = scene(meshes);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| run(&scene, &count(700)))
    };
    let one = with(1);
    assert_eq!(one, with(4));
    assert_eq!(one, with(4));
    assert_eq!(one, run(&scene, &count(700)));
}

#[test]
fn stretches_make_models() {
    let mesh = torus_mesh(1.0, 0.4, 24);
    let turn = DQuat::from_rotation_x(0.7) * DQuat::from_rotation_z(2.0);
    let transforms = [
        DAffine3::IDENTITY,
        DAffine3::from_rotation_translation(turn, DVec3::new(1e6, 5.0, -3.0)),
        DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
        DAffine3::from_scale(DVec3::splat(2.0)),
        DAffine3::from_scale_rotation_translation(DVec3::new(1.0, 4.0, -0.5), turn, DVec3::ZERO),
    ];
    let mut scene = scene(vec![(mesh, DAffine3::IDENTITY)]);
    let place = |world_from_model| Instance { name: String::new(), mesh: 0, world_from_model, ..Instance::default() };
    scene.instances = transforms.map(place).to_vec();
    let set = check_guarantee(&scene, &spacing(0.3), &mut Random(8));
    assert_eq!(set.instance_model, [0, 0, 0, 1, 2]);
    // Transforms that are not finite leave no caches, and nothing crashes.
    for scale in [DVec3::NAN, DVec3::splat(f64::INFINITY)] {
        scene.instances[3].world_from_model = DAffine3::from_scale(scale);
        let odd = run(&scene, &spacing(0.3));
        assert!(odd.models[1].caches.is_empty(), "{scale}");
    }
    // An instance without volume may get one later, so the bake assumes unit size.
    for scale in [DVec3::new(1.0, 0.0, 1.0), DVec3::ZERO] {
        scene.instances[3].world_from_model = DAffine3::from_scale(scale);
        assert_eq!(run(&scene, &spacing(0.3)).instance_model, [0, 0, 0, 0, 1], "{scale}");
    }
    // The second model is twice as large with the same spacing: four times the caches, except for effects of the tube's
    // curvature.
    let ratio = set.models[1].caches.len() as f64 / set.models[0].caches.len() as f64;
    assert!((2.5..5.0).contains(&ratio), "{ratio}");
    assert!((total_area(&set.models[1]) / total_area(&set.models[0]) - 4.0).abs() < 0.3);
}

#[test]
fn too_much_is_refused() {
    let large = box_mesh(DVec3::splat(100.0), 1);
    // A small neighbour raises the scene's limit, but not the large box's.
    let boxes = scene(vec![(large, DAffine3::IDENTITY), (box_mesh(DVec3::ONE, 1), DAffine3::IDENTITY)]);
    for settings in [spacing(1e-9), spacing(1e-3), spacing(1.5), count(100_000), count(200_000)] {
        match bake::bake(&boxes, &settings, &|_, _| {}) {
            Err(Error::TooLarge(message)) => {
                assert!(["ask for", "use a larger"].iter().any(|remedy| message.contains(remedy)), "{message}")
            }
            other => panic!("{:?}", other.map(|set| set.models[0].caches.len())),
        }
    }
}

#[test]
fn a_kept_bake_is_found_again() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("kept bakes");
    std::fs::remove_dir_all(&folder).ok();
    let mut random = Random(9);
    let mut scene = scene(vec![(box_mesh(DVec3::ONE, 4), DAffine3::IDENTITY)]);
    let settings = spacing(0.3);
    let kept = |scene: &Scene, settings: &BakeSettings| {
        bake::bake_kept_in(&folder, scene, settings, &|_, _| {}).expect("bakes")
    };
    let (first, was_kept) = kept(&scene, &settings);
    assert!(!was_kept);
    assert_eq!(kept(&scene, &settings), (first.clone(), true));

    // After any changed byte or cut, the bake runs again and rewrites the whole file.
    let files: Vec<_> = std::fs::read_dir(&folder).expect("folder").map(|e| e.expect("entry").path()).collect();
    assert_eq!(files.len(), 1, "temporary files must not stay: {files:?}");
    let whole = std::fs::read(&files[0]).expect("file");
    for _ in 0..40 {
        let mut damaged = whole.clone();
        let place = (random.next() * whole.len() as f64) as usize;
        if random.next() < 0.5 {
            damaged[place] ^= 1 << (place % 8)
        } else {
            damaged.truncate(place)
        }
        std::fs::write(&files[0], &damaged).expect("written");
        assert_eq!(kept(&scene, &settings), (first.clone(), false));
        assert_eq!(std::fs::read(&files[0]).expect("file"), whole);
    }

    // Every input that affects the result is part of the key.
    for other in
        [spacing(0.31), BakeSettings { references: 16, ..settings }, BakeSettings { angle: 0.5, ..settings }, count(50)]
    {
        assert!(!kept(&scene, &other).1);
        assert!(kept(&scene, &other).1);
    }
    scene.instances[0].world_from_model = DAffine3::from_translation(DVec3::X);
    assert!(kept(&scene, &settings).1, "translation must not matter");
    scene.instances[0].world_from_model = DAffine3::from_scale(DVec3::splat(1.5));
    assert!(!kept(&scene, &settings).1);
    scene
        .instances
        .push(Instance { world_from_model: DAffine3::from_translation(DVec3::Z), ..scene.instances[0].clone() });
    assert!(!kept(&scene, &settings).1);
    scene.instances[1].world_from_model.translation.x += 0.5;
    assert!(!kept(&scene, &settings).1, "neighbours can enclose caches, so their distance matters");
    scene.meshes[0].vertices[0].position.x -= 0.1;
    assert!(!kept(&scene, &settings).1);

    // An unusable folder path is no error.
    let blocked = bake::bake_kept_in(&files[0], &scene, &settings, &|_, _| {}).expect("bakes");
    assert!(!blocked.1);
}

/// Square panels of edge length `edge` \[m\], perpendicular to z at the `places` \[m\]. They face +z, or with `both`
/// also -z.
fn panels(edge: f64, places: &[f64], both: bool) -> Mesh {
    let at = |i: i32, j: i32, z: f64| DVec3::new(f64::from(i), f64::from(j), 0.0) * edge / 8.0 + DVec3::Z * z;
    let mut triangles = Vec::new();
    for (&z, (i, j)) in places.iter().flat_map(|z| (0..64).map(move |n| (z, (n % 8 - 4, n / 8 - 4)))) {
        let [a, b, c, d] = [at(i, j, z), at(i + 1, j, z), at(i + 1, j + 1, z), at(i, j + 1, z)];
        triangles.extend([[a, b, c], [a, c, d]]);
        triangles.extend([[a, c, b], [a, d, c]].iter().filter(|_| both));
    }
    let mut mesh = flat_mesh(&triangles);
    mesh.primitives = vec![Primitive { first_index: 0, index_count: mesh.indices.len() as u32, material: 0 }];
    mesh
}

#[test]
fn gaps_have_no_caches() {
    // A wall, and a thin two-sided board 5 mm in front of it.
    let mut scene = scene(vec![
        (panels(4.0, &[0.0], false), DAffine3::IDENTITY),
        (panels(1.0, &[0.0], true), DAffine3::from_translation(DVec3::Z * 0.005)),
    ]);
    scene.materials.push(Material::default());
    let behind = |set: &CacheSet| {
        let [wall, board] = [0, 1].map(|i| &set.models[set.instance_model[i]]);
        let in_gap = wall.caches.iter().filter(|c| c.position.truncate().abs().max_element() < 0.35).count();
        assert!(wall.caches.len() > 40 && board.caches.iter().any(|c| c.normal.z > 0.5), "{}", wall.caches.len());
        // Every vertex still has at least one reference.
        let first = |model: &ModelCaches| model.references.chunks(8).all(|row| row[0] != NO_CACHE);
        assert!(first(wall) && first(board));
        (in_gap, board.caches.iter().filter(|c| c.normal.z < -0.5).count())
    };
    assert_eq!(behind(&run(&scene, &spacing(0.5))), (0, 0));
    // A moving board may leave, so it closes no gap. Its own surface may come into the open, so all of it gets caches.
    scene.instances[1].moves = true;
    let (in_gap, on_back) = behind(&run(&scene, &spacing(0.5)));
    assert!(in_gap > 0 && on_back > 0, "{in_gap} {on_back}");
}

#[test]
fn caches_lie_on_what_is_seen_of_layers() {
    // A door and three layers behind it. All face the same way, and most of the surface is hidden.
    let mut scene = scene(vec![(panels(1.0, &[0.0, -0.02, -0.04, -0.06], false), DAffine3::IDENTITY)]);
    scene.materials.push(Material::default());
    let set = run(&scene, &spacing(1.0));
    let caches = &set.models[set.instance_model[0]].caches;
    assert!(!caches.is_empty() && caches.iter().all(|c| c.position.z == 0.0), "{caches:?}");
}

#[test]
fn progress_goes_from_nothing_to_all() {
    let told = std::sync::Mutex::new(Vec::new());
    let scene = scene(vec![(box_mesh(DVec3::ONE, 2), DAffine3::IDENTITY)]);
    bake::bake(&scene, &count(100), &|fraction, what| told.lock().expect("lock").push((fraction, what.to_owned())))
        .expect("bakes");
    let told = told.into_inner().expect("lock");
    assert!(told.windows(2).all(|pair| pair[0].0 <= pair[1].0), "{told:?}");
    assert_eq!((told[0].0, told[told.len() - 1].0), (0.0, 1.0));
}

/// A measurement rather than a test, on a mesh of Sponza's size: `cargo test --release -- --ignored --nocapture speed`.
#[test]
#[ignore = "takes seconds and is of interest in release only"]
fn speed() {
    let mut parts = vec![(box_mesh(DVec3::new(30.0, 13.0, 18.0), 60), DAffine3::IDENTITY)];
    for column in 0..44 {
        let stand = DVec3::new(f64::from(column % 11) * 2.7 + 1.0, 5.0, f64::from(column / 11) * 4.0 + 2.0);
        parts.push((torus_mesh(1.0, 0.3, 36), DAffine3::from_translation(stand)));
    }
    // All parts become one mesh, like most large models.
    let mut mesh = Mesh { name: "hall".into(), ..Default::default() };
    for (part, transform) in parts {
        let first = mesh.vertices.len() as u32;
        let moved = |v: &Vertex| transform.transform_point3(v.position.as_dvec3()).as_vec3();
        mesh.vertices.extend(part.vertices.iter().map(|v| Vertex { position: moved(v), ..*v }));
        mesh.indices.extend(part.indices.iter().map(|i| first + i));
    }
    let scene = scene(vec![(mesh, DAffine3::IDENTITY)]);
    for settings in [count(3000), BakeSettings { references: 16, ..count(12_000) }] {
        let start = std::time::Instant::now();
        let set = run(&scene, &settings);
        let (triangles, caches) = (scene.triangle_count(), set.models[0].caches.len());
        eprintln!(
            "{triangles} triangles, {} vertices -> {caches} caches, {} references each: {:.2} s on {} threads, {:?} of {:.3} m",
            scene.meshes[0].vertices.len(),
            settings.references,
            start.elapsed().as_secs_f64(),
            rayon::current_num_threads(),
            set.models[0].coverage,
            set.spacing
        );
    }
}
