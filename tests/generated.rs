//! Scenes made in code, and the GLB files written from them.

use glam::{DAffine3, DVec3, Vec2, Vec3};
use lightskin::scene::build::{self, ArchShape, CornellSurface, Surface, atrium, cornell};
use lightskin::scene::write::write_glb;
use lightskin::scene::{Camera, Image, Light, LightKind, Material, Projection, Scene};
use std::path::PathBuf;

fn scenes() -> Vec<Scene> {
    vec![cornell(CornellSurface::Diffuse, 0.08), cornell(CornellSurface::Glossy, 0.1), atrium()]
}

/// Path of a test's own file in cargo's folder for such files.
fn scratch(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name)
}

/// Checks that indices are in range, normals have unit length, no triangle is a sliver, and fronts face where their
/// normals point.
fn check_triangles(what: &str, positions: &[Vec3], normals: &[Vec3], indices: &[u32]) {
    assert!(indices.len().is_multiple_of(3) && !indices.is_empty(), "{what}");
    for normal in normals {
        assert!((normal.length() - 1.0).abs() < 1e-5, "{what}: normal {normal}");
    }
    for corners in indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|k| positions[corners[k] as usize]);
        let cross = (b - a).cross(c - a);
        let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
        assert!(cross.length() > 1e-3 * longest, "{what}: sliver {a} {b} {c}");
        for &corner in corners {
            let cosine = cross.normalize().dot(normals[corner as usize]);
            assert!(cosine > 0.0, "{what}: the normal contradicts the winding ({cosine}) at {a}");
        }
    }
}

fn check_surface(what: &str, surface: &Surface) {
    let positions: Vec<Vec3> = surface.vertices.iter().map(|v| v.position).collect();
    let normals: Vec<Vec3> = surface.vertices.iter().map(|v| v.normal).collect();
    check_triangles(what, &positions, &normals, &surface.indices);
    let mut used = vec![false; positions.len()];
    surface.indices.iter().for_each(|&index| used[index as usize] = true);
    assert!(used.iter().all(|used| *used), "{what}: unused vertices");
}

/// Enclosed volume. For a closed surface it does not depend on the origin.
fn volume(surface: &Surface) -> f32 {
    let at = |index: u32| surface.vertices[index as usize].position;
    surface.indices.chunks_exact(3).map(|t| at(t[0]).cross(at(t[1])).dot(at(t[2]))).sum::<f32>() / 6.0
}

fn longest_edge(scene: &Scene) -> f64 {
    let mut longest = 0.0_f64;
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh];
        for triangle in 0..mesh.triangle_count() {
            let [a, b, c] = mesh.triangle(triangle).map(|k| mesh.vertices[k].position.as_dvec3());
            // The longest side of half a grid cell is its diagonal. The other two sides are the cell's.
            let mut sides = [a.distance(b), b.distance(c), c.distance(a)];
            sides.sort_by(f64::total_cmp);
            longest = longest.max(sides[1]);
        }
    }
    longest
}

#[test]
fn every_triangle_faces_where_its_normals_point() {
    for scene in scenes() {
        for mesh in &scene.meshes {
            let positions: Vec<Vec3> = mesh.vertices.iter().map(|v| v.position).collect();
            let normals: Vec<Vec3> = mesh.vertices.iter().map(|v| v.normal).collect();
            check_triangles(&mesh.name, &positions, &normals, &mesh.indices);
            let mut next = 0;
            for primitive in &mesh.primitives {
                assert_eq!(primitive.first_index, next, "{}", mesh.name);
                assert!(primitive.material < scene.materials.len(), "{}", mesh.name);
                next += primitive.index_count;
            }
            assert_eq!(next as usize, mesh.indices.len(), "{}", mesh.name);
        }
    }
}

#[test]
fn shapes_are_sound_and_closed_ones_hold_their_volume() {
    let sphere = build::sphere(0.5, 32);
    let cuboid = build::cuboid(Vec3::new(-1.0, 0.0, 2.0), Vec3::new(1.0, 3.0, 3.5), 0.2, |_| true);
    let cone = build::lathe(&[Vec2::ZERO, Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0)], 64);
    let pyramid = build::loft_square(&[Vec2::ZERO, Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0)], 0.2);
    // By Pappus's theorem, a tube's volume is its cross-section times the length of its centre line.
    let knot = build::torus_knot([2, 3], [0.5, 0.2, 0.05], [600, 48]);
    let ring = build::torus_knot([1, 0], [0.5, 0.0, 0.1], [256, 64]);
    let pi = std::f32::consts::PI;
    for (what, surface, expected) in [
        ("sphere", &sphere, 4.0 / 3.0 * pi * 0.125),
        ("cuboid", &cuboid, 9.0),
        ("cone", &cone, pi / 3.0),
        ("pyramid", &pyramid, 4.0 / 3.0),
        ("ring", &ring, pi * 0.01 * 2.0 * pi * 0.5),
    ] {
        check_surface(what, surface);
        let found = volume(surface);
        // Chords instead of arcs change the volume by half a percent at these tessellations.
        assert!((found / expected - 1.0).abs() < 6e-3, "{what}: {found} instead of {expected}");
    }
    check_surface("knot", &knot);
    assert!(volume(&knot) > 0.0);
    let shape = ArchShape { pitch: 2.0, radius: 0.7, thickness: 0.4, height: [2.0, 1.0], band: [0.1, 0.05] };
    check_surface("arch", &build::arch(shape, 0.1));
    check_surface("ring", &build::ring(0.7, 1.0, 16, 0.1));
    check_surface("niche", &build::vault_dome(0.7, 1.5, 16, 0.1));
    check_surface("steps", &build::steps(3.0, 0.16, [0.3, 1.0], 4, 0.1));
    let drape = build::drape([1.7, 2.3], 6.5, 0.07, 0.08);
    check_surface("drape", &drape);
    check_surface("back of the drape", &drape.reversed());
}

#[test]
fn cornell_room_is_two_metres_and_its_grid_is_as_fine_as_asked() {
    for edge in [0.05, 0.08, 0.3] {
        let scene = cornell(CornellSurface::Diffuse, edge);
        assert_eq!(scene.bounds(), Some((DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 2.0, 1.0))));
        let longest = longest_edge(&scene);
        assert!(longest <= f64::from(edge) * 1.002, "{longest} > {edge}");
        assert_eq!((scene.meshes.len(), scene.instances.len()), (3, 3));
    }
}

#[test]
fn materials_never_return_more_light_than_they_get() {
    for scene in scenes() {
        for material in &scene.materials {
            assert!(material.base_color.max_element() <= 1.0 && material.base_color.w == 1.0);
            if let Some(phong) = material.phong {
                let albedo = material.base_color.truncate() + phong.specular;
                assert!(albedo.max_element() <= 1.0, "{} {}", scene.name, material.name);
            }
        }
    }
    let diffuse = cornell(CornellSurface::Diffuse, 0.2);
    assert!(diffuse.materials.iter().all(|m| m.phong.is_some_and(|p| p.specular == Vec3::ZERO)));
}

#[test]
fn cornell_spot_lights_the_red_wall_and_not_the_green() {
    let scene = cornell(CornellSurface::Diffuse, 0.1);
    let light = &scene.lights[0];
    let LightKind::Spot { outer, .. } = light.kind else { panic!("{:?}", light.kind) };
    let is_lit = |p: DVec3| {
        let way = (p - light.position).normalize();
        way.dot(light.direction.as_dvec3()) > f64::from(outer).cos()
    };
    assert!(is_lit(DVec3::new(-1.0, 0.9, -0.1)));
    for (k, l) in (0..=20).flat_map(|k| (0..=20).map(move |l| (k, l))) {
        let (a, b) = (f64::from(k) * 0.1, f64::from(l) * 0.1);
        assert!(!is_lit(DVec3::new(1.0, a, b - 1.0)), "green wall");
    }
}

#[test]
fn atrium_keeps_to_its_measures() {
    let scene = atrium();
    let (low, high) = scene.bounds().expect("a building");
    assert!(low.cmpge(DVec3::new(-6.0, 0.0, -9.6)).all() && high.cmple(DVec3::new(6.0, 7.4, 8.4)).all());
    let triangles = scene.triangle_count();
    assert!((80_000..200_000).contains(&triangles), "{triangles}");
    assert!(scene.instances.len() > 2 * scene.meshes.len(), "repeated parts must be instances");
    for instance in &scene.instances {
        let matrix = instance.world_from_model.matrix3;
        assert!((matrix.determinant() - 1.0).abs() < 1e-12, "{}: not a rotation", instance.name);
        assert!((matrix * matrix.transpose()).abs_diff_eq(glam::DMat3::IDENTITY, 1e-12), "{}", instance.name);
    }
    let names: Vec<&str> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["Hero", "Detail"]);
    // Triangles of double-sided materials come in pairs, front then back.
    for mesh in &scene.meshes {
        for run in mesh.primitives.iter().filter(|p| scene.materials[p.material].double_sided) {
            let range = run.first_index as usize..(run.first_index + run.index_count) as usize;
            let (triangles, _) = mesh.indices[range].as_chunks::<3>();
            assert!(triangles.chunks(2).all(|pair| mesh.are_twins(pair[0], pair[1])), "{}", mesh.name);
        }
    }
}

#[test]
fn written_file_is_valid_and_the_same_every_time() {
    for scene in scenes() {
        let paths = ["a", "b"].map(|run| scratch(&format!("same-{}-{}-{run}.glb", scene.name, scene.triangle_count())));
        paths.iter().for_each(|path| write_glb(&scene, path).expect("written"));
        let [bytes, again] = paths.map(|path| std::fs::read(path).expect("there"));
        assert_eq!(bytes, again);
        assert!(bytes.len() < 6_000_000, "{} bytes", bytes.len());

        let file = gltf::Gltf::from_slice(&bytes).expect("valid glTF");
        assert_eq!(file.meshes().count(), scene.meshes.len());
        assert_eq!(file.materials().count(), scene.materials.len());
        assert_eq!(file.cameras().count(), scene.cameras.len());
        assert_eq!(file.lights().expect("lights").count(), scene.lights.len());
        let nodes = scene.instances.len() + scene.lights.len() + scene.cameras.len();
        assert_eq!(file.nodes().count(), nodes);
        let triangles = |mesh: gltf::Mesh<'_>| -> usize {
            let sides = |p: &gltf::Primitive<'_>| if p.material().double_sided() { 2 } else { 1 };
            mesh.primitives().map(|p| sides(&p) * p.indices().expect("indexed").count() / 3).sum()
        };
        let total: usize = file.nodes().filter_map(|node| node.mesh()).map(triangles).sum();
        assert_eq!(total, scene.triangle_count());
    }
}

/// Every primitive of the file, read by a second reader, against the scene's: positions, normals and triangles, bit for
/// bit.
#[test]
fn written_vertices_are_the_scenes() {
    let scene = atrium();
    let path = scratch("vertices.glb");
    write_glb(&scene, &path).expect("written");
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(&std::fs::read(&path).expect("there")).expect("valid");
    let blob = blob.expect("binary chunk");
    for (mesh, written) in scene.meshes.iter().zip(document.meshes()) {
        assert_eq!(Some(mesh.name.as_str()), written.name());
        for (run, primitive) in mesh.primitives.iter().zip(written.primitives()) {
            assert_eq!(Some(run.material), primitive.material().index());
            let reader = primitive.reader(|_| Some(&blob));
            let positions: Vec<[f32; 3]> = reader.read_positions().expect("positions").collect();
            let normals: Vec<[f32; 3]> = reader.read_normals().expect("normals").collect();
            let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
            let range = run.first_index as usize..(run.first_index + run.index_count) as usize;
            let (triangles, _) = mesh.indices[range].as_chunks::<3>();
            let step = if scene.materials[run.material].double_sided { 2 } else { 1 };
            let fronts: Vec<u32> = triangles.iter().step_by(step).flatten().copied().collect();
            assert_eq!(indices.len(), fronts.len());
            for (&index, &expected) in indices.iter().zip(&fronts) {
                let vertex = mesh.vertices[expected as usize];
                assert_eq!(positions[index as usize], vertex.position.to_array());
                assert_eq!(normals[index as usize], vertex.normal.to_array());
            }
            let bounds = primitive.bounding_box();
            assert!(positions.iter().all(|p| (0..3).all(|k| bounds.min[k] <= p[k] && p[k] <= bounds.max[k])));
        }
    }
}

#[test]
fn written_lights_cameras_and_materials_are_the_scenes() {
    let mut scene = cornell(CornellSurface::Glossy, 0.5);
    scene.lights.push(Light {
        name: "up".into(),
        direction: Vec3::Z,
        kind: LightKind::Directional,
        range: Some(9.0),
        radius: 0.25,
        ..scene.lights[0].clone()
    });
    let lamp = Material {
        emissive: Vec3::new(5.0, 10.0, 0.0),
        alpha_cutoff: Some(0.3),
        ior: 1.3,
        specular: 0.5,
        ..Material::default()
    };
    scene.materials.push(lamp);
    let view = DAffine3::from_rotation_translation(glam::DQuat::from_rotation_x(0.3), DVec3::Y);
    scene.cameras.push(Camera {
        name: "plan".into(),
        world_from_camera: view,
        projection: Projection::Orthographic { ymag: 2.0 },
    });
    // A mirror image can be written as a scale. A shear needs a matrix.
    scene.instances[1].world_from_model *= DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let shear = glam::DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::Z);
    scene.instances[2].world_from_model = DAffine3::from_mat3_translation(shear, DVec3::X);
    scene.lights[0].radius = 0.1;
    let path = scratch("parts.glb");
    write_glb(&scene, &path).expect("written");
    let read = lightskin::scene::gltf::load(&path).expect("read");
    for (own, read) in scene.lights.iter().zip(&read.lights) {
        assert!((own.radius - read.radius).abs() < 1e-6, "{}: {}", own.name, read.radius);
    }
    let file = gltf::Gltf::from_slice(&std::fs::read(&path).expect("there")).expect("valid");

    let world = |node: &gltf::Node<'_>| {
        let columns = node.transform().matrix().map(|column| column.map(f64::from));
        glam::DMat4::from_cols_array_2d(&columns)
    };
    let nodes: Vec<_> = file.nodes().collect();
    for (instance, node) in scene.instances.iter().zip(&nodes) {
        assert!(world(node).abs_diff_eq(glam::DMat4::from(instance.world_from_model), 1e-6), "{}", instance.name);
    }
    let (mut lights, mut cameras) = (0, 0);
    for node in &nodes {
        if let Some(light) = node.light() {
            let expected = &scene.lights[light.index()];
            assert!((-world(node).z_axis.truncate()).abs_diff_eq(expected.direction.as_dvec3(), 1e-6));
            assert_eq!((light.intensity(), light.range()), (expected.intensity, expected.range));
            assert_eq!(light.color(), expected.color.to_array());
            lights += 1;
        }
        if let Some(camera) = node.camera() {
            let expected = &scene.cameras[camera.index()];
            assert!(world(node).abs_diff_eq(glam::DMat4::from(expected.world_from_camera), 1e-6));
            cameras += 1;
        }
    }
    assert_eq!((lights, cameras), (2, 2));
    let written: Vec<_> = file.materials().collect();
    let extras = written[0].extras().as_ref().expect("extras").get();
    assert!(extras.contains("\"lightskin\":{\"phong\":{\"exponent\":40.0"), "{extras}");
    let lamp = written.last().expect("the lamp");
    let emitted = lamp.emissive_factor().map(|c| c * lamp.emissive_strength().unwrap_or(1.0));
    assert_eq!((emitted, lamp.ior(), lamp.alpha_cutoff()), ([5.0, 10.0, 0.0], Some(1.3), Some(0.3)));
}

#[test]
fn what_cannot_be_written_leaves_nothing_behind() {
    let scene = cornell(CornellSurface::Diffuse, 0.5);
    let missing = scratch("no such folder").join("scene.glb");
    let error = write_glb(&scene, &missing).expect_err("no folder").to_string();
    assert!(error.contains("no such folder") && error.contains("cannot write"), "{error}");

    let folder = scratch("taken.glb");
    std::fs::create_dir_all(&folder).expect("a folder in the way");
    assert!(write_glb(&scene, &folder).is_err());
    let parts = std::fs::read_dir(folder.parent().expect("a parent")).expect("readable");
    assert!(parts.flatten().all(|entry| !entry.file_name().to_string_lossy().contains("taken.glb.")));

    let pictured = Scene { images: vec![Image::default()], ..scene };
    assert!(write_glb(&pictured, &scratch("pictured.glb")).is_err());
    assert!(!scratch("pictured.glb").exists());
}
