//! Valid files become the scene that they describe. Scenes without a camera or a light get one.

use std::f32::consts::FRAC_1_SQRT_2;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3, Vec4};
use lightskin::scene::defaults::Ground;
use lightskin::scene::material::Lobe;
use lightskin::scene::{Camera, LightKind, Projection, Scene, Wrap, defaults, gltf};
use serde_json::{Value, json};

use crate::common::{Builder, PNG, data, glb, gltf_files, one_line, written};
use crate::malformed::check;

fn load(data: &Path, name: &str) -> Scene {
    let scene = gltf::load(&data.join("scenes").join(name)).unwrap_or_else(|error| panic!("{error}"));
    check(&scene, Path::new(name));
    scene
}

fn positions(scene: &Scene) -> Vec<Vec3> {
    scene.meshes[0].vertices.iter().map(|v| v.position).collect()
}

fn assert_near(a: Vec3, b: Vec3) {
    assert!((a - b).abs().max_element() < 1e-5, "{a} is not {b}");
}

#[test]
fn every_valid_file_loads() {
    let Some(data) = data() else { return };
    // These files test a refusal, or contain only points and lines.
    let refused = [("Compatibility_04", "minVersion"), ("Compatibility_05", "requires the extension")];
    let without_triangles: Vec<String> =
        [0, 1, 2, 3, 7, 8, 9, 10].map(|n| format!("Mesh_PrimitiveMode_{n:02}")).to_vec();
    let mut loaded = 0;
    for path in gltf_files(&data.join("scenes")) {
        let stem = path.file_stem().expect("has a name").to_string_lossy();
        let reason = refused.iter().find(|(name, _)| stem == *name).map(|(_, reason)| *reason);
        let reason = reason.or(without_triangles.iter().any(|name| stem == **name).then_some("no triangles"));
        match (gltf::load(&path), reason) {
            (Ok(mut scene), None) => {
                check(&scene, &path);
                if scene.triangle_count() < 200_000 {
                    complete_and_check(&mut scene);
                }
                loaded += 1;
            }
            (Err(error), Some(reason)) => {
                let message = one_line(error);
                assert!(message.contains(reason), "{message}");
            }
            (Ok(_), Some(_)) => panic!("{} should be refused", path.display()),
            (Err(error), None) => panic!("{error}"),
        }
    }
    println!("{loaded} files loaded");
    assert!(loaded > 70);
}

/// Adds camera and light and checks that both are valid.
fn complete_and_check(scene: &mut Scene) {
    defaults::complete(scene, Ground::Auto);
    let name = &scene.name;
    assert!(!scene.cameras.is_empty() && (scene.emits() || !scene.lights.is_empty()), "{name}");
    assert!(scene.cameras.iter().all(|camera| camera.world_from_camera.is_finite()), "{name}");
    for light in &scene.lights {
        assert!(light.position.is_finite() && light.intensity.is_finite() && light.intensity >= 0.0, "{name}");
        assert!((light.direction.length() - 1.0).abs() < 1e-5, "{name}");
    }
}

#[test]
fn sponza_has_its_triangles_and_a_view_along_the_atrium() {
    let Some(data) = data() else { return };
    let mut scene = load(&data, "sponza/Sponza.gltf");
    let source: usize = scene
        .instances
        .iter()
        .flat_map(|instance| &scene.meshes[instance.mesh].primitives)
        .map(|p| p.index_count as usize / if scene.materials[p.material].double_sided { 6 } else { 3 })
        .sum();
    let dropped: usize = scene
        .notes
        .iter()
        .find_map(|note| note.strip_prefix("Degenerate triangles left out (no area or not finite): "))
        .map_or(0, |n| n.trim_end_matches('.').parse().expect("is a count"));
    assert_eq!(source + dropped, 262_267, "{:?}", scene.notes);
    assert!(scene.materials.iter().any(|m| m.double_sided && m.alpha_cutoff.is_some()));
    defaults::complete(&mut scene, Ground::Auto);
    println!("{:#?}", scene.notes);
    let (low, high) = scene.bounds().expect("is not empty");
    let camera = scene.cameras[0].world_from_camera;
    assert!(camera.translation.cmpgt(low).all() && camera.translation.cmplt(high).all());
    assert!(camera.matrix3.z_axis.x.abs() > 0.99, "{}", camera.matrix3.z_axis);
    assert_eq!(scene.lights[0].kind, LightKind::Directional);
}

#[test]
fn objects_and_boxes_are_seen_from_outside() {
    let Some(data) = data() else { return };
    for (name, light) in [
        ("thesis/stanford_bunny.glb", "studio"),
        ("thesis/happy_buddha_100k.glb", "studio"),
        ("cornell/cornell_box_original.glb", "lamp"),
        ("cornell/CornellBox.glb", "emissive surface"),
    ] {
        let mut scene = load(&data, name);
        scene.cameras.clear();
        scene.lights.clear();
        defaults::complete(&mut scene, Ground::Auto);
        println!("{name}: {:#?}", scene.notes);
        assert!(scene.notes.iter().any(|note| note.contains(light)), "{name}: {:?}", scene.notes);
        assert_sees(&scene, &scene.cameras[0]);
        assert_eq!(scene.lights.is_empty(), light == "emissive surface");
    }
}

/// Asserts that all vertices except the ground's are in a 16:9 picture and fill its height or width.
fn assert_sees(scene: &Scene, camera: &Camera) {
    let Projection::Perspective { yfov } = camera.projection else { panic!("is a perspective camera") };
    let slope = f64::from(yfov / 2.0).tan();
    let mut extent = 0.0_f64;
    for instance in scene.instances.iter().filter(|instance| instance.name != "ground") {
        for vertex in &scene.meshes[instance.mesh].vertices {
            let world = instance.world_from_model.transform_point3(vertex.position.as_dvec3());
            let p = camera.world_from_camera.inverse().transform_point3(world);
            assert!(p.z < 0.0);
            extent = extent.max((p.y / p.z / slope).abs()).max((p.x / p.z / slope * 9.0 / 16.0).abs());
        }
    }
    assert!(extent < 0.95 && extent > 0.85, "{extent}");
}

/// A closed room and one without a ceiling, at several scales. Heuristics must not depend on the unit.
#[test]
fn rooms_get_a_camera_and_a_light_inside() {
    for scale in [0.001_f32, 1.0, 1000.0] {
        for (sky, expected) in [(false, "lamp"), (true, "sun")] {
            let size = Vec3::new(4.0, 3.0, 8.0) * scale;
            let mut scene = gltf::load(&written("room.glb", &room(size, sky))).expect("is a scene");
            defaults::complete(&mut scene, Ground::Auto);
            let camera = scene.cameras[0].world_from_camera;
            let size = size.as_dvec3();
            assert!(camera.translation.cmpgt(DVec3::ZERO).all() && camera.translation.cmplt(size).all());
            assert!(camera.matrix3.z_axis.z.abs() > 0.99);
            let light = &scene.lights[0];
            assert!(light.name.contains(expected), "{}", light.name);
            if sky {
                assert!(light.direction.y < -0.6 && light.intensity == 1e5);
                assert!(scene.sky.is_some() && scene.lights.len() > 4, "{} lights", scene.lights.len());
            } else {
                let from_middle = (light.position / size - DVec3::new(0.5, 0.85, 0.5)).abs();
                assert!(from_middle.max_element() < 0.1, "{}", light.position);
            }
            assert_eq!(scene.notes.len(), 2, "{:?}", scene.notes);
            let before = scene.clone();
            defaults::complete(&mut scene, Ground::Auto);
            assert_eq!((before.cameras.len(), before.notes.len()), (scene.cameras.len(), scene.notes.len()));
        }
    }
}

/// A box seen from inside, with or without its top.
fn room(size: Vec3, sky: bool) -> Vec<u8> {
    let corner = |i: usize| size * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32);
    let mut b = Builder::new();
    let values: Vec<f32> = (0..8).flat_map(|i| corner(i).to_array()).collect();
    b.attribute("POSITION", "VEC3", &values);
    let mut sides = vec![[0, 1, 3, 2], [4, 6, 7, 5], [0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1]];
    if !sky {
        sides.push([2, 3, 7, 6]);
    }
    let indices: Vec<u8> = sides.iter().flat_map(|&[a, b, c, d]| [a, b, c, a, c, d]).collect();
    let indices = b.accessor(5121, "SCALAR", indices.len(), &indices);
    b.primitive()["indices"] = json!(indices);
    glb(&b.json, &b.binary)
}

#[test]
fn simple_skin_is_posed() {
    let Some(data) = data() else { return };
    let path = data.join("scenes/features/skin/SimpleSkin/SimpleSkin.gltf");
    let scene = gltf::load(&path).expect("is valid");
    // Both inverse bind matrices move by (-0.5, -1, 0), and the joints are at (0, 1, 0).
    let place = scene.instances[0].world_from_model;
    assert_eq!(place, glam::DAffine3::from_translation(DVec3::Y), "the model must be at its first joint");
    let still = Scene { extent: None, ..scene };
    let (low, high) = still.bounds().expect("is not empty");
    assert_eq!((low, high), (DVec3::new(-0.5, 0.0, 0.0), DVec3::new(0.5, 2.0, 0.0)));

    let mut json: Value = serde_json::from_slice(&std::fs::read(&path).expect("is there")).expect("is JSON");
    json["nodes"][2]["rotation"] = json!([0, 0, FRAC_1_SQRT_2, FRAC_1_SQRT_2]);
    let scene = gltf::load(&written("bent.gltf", json.to_string().as_bytes())).expect("is valid");
    let found: Vec<Vec3> = positions(&scene).iter().map(|p| *p + Vec3::Y).collect();
    // Only the second joint moves the top: (1, 2) -> (0.5, 1) -> turned (-1, 0.5) -> (-1, 1.5).
    assert!(found.iter().any(|p| (*p - Vec3::new(-1.0, 1.5, 0.0)).length() < 1e-5), "{found:?}");
    assert!(found.iter().any(|p| (*p - Vec3::new(-0.5, 0.0, 0.0)).length() < 1e-5), "{found:?}");
}

#[test]
fn figures_stand_as_their_joints_say() {
    let Some(data) = data() else { return };
    for (name, height) in [("CesiumMan.glb", 1.5), ("Fox.glb", 80.0)] {
        // Bounds of the current pose, without the extent of the animations.
        let scene = Scene { extent: None, ..load(&data, &format!("features/skin/{name}")) };
        let (low, high) = scene.bounds().expect("is not empty");
        println!("{name}: {low} to {high}");
        assert!(((high.y - low.y) / height - 1.0).abs() < 0.1 && low.y.abs() < 0.05 * height, "{name}: {low} {high}");
    }
}

#[test]
fn simple_morph_has_its_default_weights() {
    let Some(data) = data() else { return };
    let scene = load(&data, "features/morph/SimpleMorph/SimpleMorph.gltf");
    // (0.5, 0.5) + 0.5 (-1, 1) + 0.5 (1, 1)
    assert_near(positions(&scene)[2], Vec3::new(0.5, 1.5, 0.0));
}

#[test]
fn sparse_accessors_replace_elements() {
    let Some(data) = data() else { return };
    let scene = load(&data, "features/sparse/SimpleSparseAccessor/SimpleSparseAccessor.gltf");
    let found = positions(&scene);
    for replaced in [Vec3::new(1.0, 2.0, 0.0), Vec3::new(3.0, 3.0, 0.0), Vec3::new(5.0, 4.0, 0.0)] {
        assert!(found.iter().any(|p| p.distance(replaced) < 1e-5), "{found:?}");
    }
}

#[test]
fn names_and_uris_may_hold_anything() {
    let Some(data) = data() else { return };
    for name in ["Unicode ❤♻ Test.gltf", "CubeImageUriSpaces/CubeImageUriSpaces.gltf"] {
        let scene = load(&data, &format!("features/names/{name}"));
        assert!(!scene.images.is_empty(), "{:?}", scene.notes);
    }
}

#[test]
fn texture_transforms_are_read() {
    let Some(data) = data() else { return };
    let scene = load(&data, "features/textures/TextureTransformTest/TextureTransformTest.gltf");
    let transforms: Vec<_> = scene.materials.iter().filter_map(|m| m.base_color_texture).map(|t| t.transform).collect();
    assert!(transforms.iter().any(|t| t.translation == Vec2::new(0.5, 0.0)), "{transforms:?}");
    assert!(transforms.iter().any(|t| (t.matrix2.x_axis.x - 1.5).abs() < 1e-6), "{transforms:?}");
}

#[test]
fn lights_keep_the_extensions_units() {
    let mut b = Builder::triangle();
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 12.5, "color": [1, 0.5, 0.25], "range": 3},
        {"type": "directional", "intensity": 1e5},
        {"type": "spot", "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}, "name": "lamp"},
        {"type": "spot", "spot": {"innerConeAngle": 2, "outerConeAngle": 9}, "intensity": -1},
    ]}});
    let light = |i: u32| json!({"KHR_lights_punctual": {"light": i}});
    b.json["nodes"] = json!([
        {"mesh": 0, "scale": [10, 10, 10], "children": [1, 2, 3, 4]},
        {"extensions": light(0), "translation": [0, 0, 1]},
        {"extensions": light(1), "rotation": [-FRAC_1_SQRT_2, 0, 0, FRAC_1_SQRT_2]},
        {"extensions": light(2)},
        {"extensions": light(3)},
    ]);
    let scene = b.load("lights").expect("is valid");
    let [point, sun, spot, odd] = &scene.lights[..] else { panic!("there are four lights") };
    assert_eq!((point.intensity, point.range, point.position), (12.5, Some(3.0), DVec3::new(0.0, 0.0, 10.0)));
    assert_eq!(point.color, Vec3::new(1.0, 0.5, 0.25));
    assert_eq!((sun.kind, sun.intensity), (LightKind::Directional, 1e5));
    assert_near(sun.direction, Vec3::NEG_Y);
    assert_eq!((spot.kind, spot.intensity), (LightKind::Spot { inner: 0.25, outer: 0.5 }, 1.0));
    assert_eq!((&*spot.name, spot.direction), ("lamp", Vec3::NEG_Z));
    assert_eq!(odd.intensity, 0.0);
    assert_eq!(scene.notes.len(), 2, "{:?}", scene.notes);
}

#[test]
fn cameras_have_no_scale() {
    let mut b = Builder::triangle();
    b.json["cameras"] = json!([
        {"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 3, "znear": 0, "zfar": 9}, "name": "plan"},
    ]);
    b.json["nodes"] = json!([{"mesh": 0, "scale": [2, 3, 4], "children": [1, 2]}, {"camera": 0, "translation": [1, 1, 1]},
        {"camera": 1}]);
    let scene = b.load("cameras").expect("is valid");
    let [one, two] = &scene.cameras[..] else { panic!("there are two cameras") };
    assert_eq!(one.projection, Projection::Perspective { yfov: 0.5 });
    assert_eq!(two.projection, Projection::Orthographic { ymag: 3.0 });
    assert_eq!(one.world_from_camera.translation, DVec3::new(2.0, 3.0, 4.0));
    assert!(one.world_from_camera.matrix3.abs_diff_eq(glam::DMat3::IDENTITY, 1e-12));
    b.json["cameras"][0]["perspective"]["yfov"] = json!(4);
    assert!(b.error("cameras").contains("camera 0: perspective: yfov is 4"));
}

#[test]
fn quantised_attributes_are_decoded() {
    let mut b = Builder::new();
    let positions = b.accessor(5122, "VEC3", 3, &[0, 0, 0, 0, 0, 0, 0xFF, 0x7F, 0, 0, 0, 0, 0, 0, 0x01, 0x80, 0, 0]);
    let normals = b.accessor(5120, "VEC3", 3, &[0, 0, 127, 0, 0, 127, 0, 0, 127]);
    let tangents = b.accessor(5120, "VEC4", 3, &[127, 0, 0, 129, 127, 0, 0, 129, 127, 0, 0, 129]);
    let uv0 = b.accessor(5121, "VEC2", 3, &[0, 255, 51, 102, 1, 2]);
    let uv1 = b.accessor(5122, "VEC2", 3, &[0, 0, 0xFE, 0xFF, 7, 0, 1, 0, 2, 0, 3, 0]);
    let colors = b.accessor(5123, "VEC3", 3, &[0xFF; 18]);
    for accessor in [positions, normals, tangents, uv0, colors] {
        b.json["accessors"][accessor]["normalized"] = json!(true);
    }
    b.primitive()["attributes"] = json!({"POSITION": positions, "NORMAL": normals, "TANGENT": tangents,
        "TEXCOORD_0": uv0, "TEXCOORD_1": uv1, "COLOR_0": colors});
    b.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let scene = b.load("quantised").expect("is valid");
    let v = &scene.meshes[0].vertices;
    assert_eq!(v.iter().map(|v| v.position).collect::<Vec<_>>(), [Vec3::ZERO, Vec3::X, Vec3::NEG_Y]);
    assert_eq!((v[0].normal, v[0].tangent), (Vec3::Z, [1.0, 0.0, 0.0, -1.0]));
    assert_eq!((v[1].uv0, v[1].uv1), (Vec2::new(0.2, 0.4), Vec2::new(7.0, 1.0)));
    assert_eq!((v[0].uv1, v[2].color), (Vec2::new(0.0, -2.0), [255; 4]));
}

#[test]
fn strips_and_fans_become_triangles() {
    for (mode, expected) in [(5, [[0, 1, 2], [1, 3, 2]]), (6, [[1, 2, 0], [2, 3, 0]])] {
        let mut b = Builder::new();
        let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
        b.attribute("POSITION", "VEC3", &corners);
        b.primitive()["mode"] = json!(mode);
        let scene = b.load("strip").expect("is valid");
        // Flat normals separate the triangles, so compare positions.
        let found: Vec<Vec3> = positions(&scene);
        let wanted: Vec<Vec3> =
            expected.iter().flatten().map(|&i: &usize| Vec3::from_slice(&corners[3 * i..])).collect();
        assert_eq!(found, wanted);
    }
}

#[test]
fn degenerate_triangles_and_bad_normals_are_mended() {
    let mut b = Builder::triangle();
    b.attribute("NORMAL", "VEC3", &[0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0, 0.0, 0.0, 5.0]);
    let indices = b.accessor(5121, "SCALAR", 9, &[0, 1, 2, 0, 0, 1, 2, 1, 1]);
    b.primitive()["indices"] = json!(indices);
    let scene = b.load("degenerate").expect("is valid");
    assert_eq!(scene.triangle_count(), 1);
    assert!(scene.meshes[0].vertices.iter().all(|v| v.normal == Vec3::Z));
    let notes = [
        "Degenerate triangles left out (no area or not finite): 2.",
        "Normals of no length or not finite replaced by geometric ones: 2.",
    ];
    assert_eq!(scene.notes, notes);
    let indices = b.accessor(5121, "SCALAR", 3, &[0, 0, 1]);
    b.primitive()["indices"] = json!(indices);
    assert!(b.error("degenerate").contains("no triangles"));
}

/// An octahedron, or its flat square alone, with triangles and normals that face outwards (up) or not.
fn octahedron(is_flat: bool, outward_triangles: bool, outward_normals: bool, double_sided: bool) -> Scene {
    let places = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let normals = places.map(|p| if is_flat { Vec3::Z } else { p } * if outward_normals { 1.0 } else { -1.0 });
    let around = [[0, 1], [1, 2], [2, 3], [3, 0]];
    let triangles: Vec<[u8; 3]> = match is_flat {
        true => vec![[0, 1, 2], [0, 2, 3]],
        false => around.iter().flat_map(|&[a, b]| [[a, b, 4], [b, a, 5]]).collect(),
    };
    let turned = triangles.into_iter().flat_map(|[a, b, c]| if outward_triangles { [a, b, c] } else { [a, c, b] });
    let mut b = Builder::new();
    b.attribute("POSITION", "VEC3", &places.map(|p| p.to_array()).concat());
    b.attribute("NORMAL", "VEC3", &normals.map(|n| n.to_array()).concat());
    let turned: Vec<u8> = turned.collect();
    let indices = b.accessor(5121, "SCALAR", turned.len(), &turned);
    b.primitive()["indices"] = json!(indices);
    b.json["materials"] = json!([{ "doubleSided": double_sided }]);
    b.primitive()["material"] = json!(0);
    b.load("octahedron").expect("is valid")
}

#[test]
fn bodies_that_are_inside_out_are_turned_over() {
    for case in (0..16).map(|case| [1, 2, 4, 8].map(|bit| case & bit != 0)) {
        let [is_flat, triangles, normals, double_sided] = case;
        let scene = octahedron(is_flat, triangles, normals, double_sided);
        let is_turned = if double_sided { triangles != normals } else { !is_flat && !triangles && normals };
        let mesh = &scene.meshes[0];
        let sides = if double_sided { 2 } else { 1 };
        let all = mesh.indices.as_chunks::<3>().0;
        for corners in all.iter().step_by(sides) {
            let [a, b, c] = corners.map(|c| mesh.vertices[c as usize].position);
            let outwards = if is_flat { Vec3::Z } else { a + b + c };
            assert_eq!((b - a).cross(c - a).dot(outwards) > 0.0, triangles != is_turned, "{case:?}");
        }
        let notes = if is_turned {
            vec!["Primitives turned over (their triangles faced against their normals): 1."]
        } else {
            vec![]
        };
        assert_eq!(scene.notes, notes);
    }
}

/// Nodes with several objects become groups, without those that hold all objects or the same ones as another.
#[test]
fn nodes_become_groups_of_what_they_hold() {
    let mut b = Builder::triangle();
    b.json["nodes"] = json!([
        {"name": "root", "children": [1, 2]}, {"name": "house", "children": [3]}, {"name": "tree", "mesh": 0},
        {"name": "floor", "children": [4, 5, 6]}, {"name": "chair", "mesh": 0, "children": [7]},
        {"name": "lamp", "mesh": 0}, {"name": "empty"}, {"name": "cushion", "mesh": 0},
    ]);
    let scene = b.load("groups").expect("is valid");
    let names: Vec<&str> = scene.instances.iter().map(|instance| instance.name.as_str()).collect();
    assert_eq!(names, ["chair", "cushion", "lamp", "tree"]);
    let groups: Vec<_> = scene.groups.iter().map(|group| (group.name.as_str(), group.instances.clone())).collect();
    assert_eq!(groups, [("house", 0..3), ("chair", 0..2)]);
}

#[test]
fn double_sided_materials_get_a_second_side() {
    let mut b = Builder::triangle();
    b.attribute("NORMAL", "VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    b.attribute("TANGENT", "VEC4", &[1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]);
    b.json["materials"] = json!([{"doubleSided": true}]);
    b.primitive()["material"] = json!(0);
    let scene = b.load("double").expect("is valid");
    let mesh = &scene.meshes[0];
    assert_eq!(mesh.indices, [0, 1, 2, 3, 5, 4]);
    assert_eq!((mesh.vertices[3].normal, mesh.vertices[3].tangent), (Vec3::NEG_Z, [-1.0, 0.0, 0.0, -1.0]));
    // The whole tangent frame is reversed: n, t and b = w (n x t).
    let bitangent = |i: usize| {
        let v = &mesh.vertices[i];
        v.tangent[3] * v.normal.cross(Vec3::from_slice(&v.tangent[..3]))
    };
    assert_eq!(bitangent(3), -bitangent(0));
    assert_eq!((mesh.primitives.len(), mesh.primitives[0].index_count), (1, 6));
}

#[test]
fn materials_are_read_in_full() {
    let mut b = Builder::triangle();
    let image = b.view(PNG);
    b.json["images"] =
        json!([{"bufferView": image}, {"uri": "missing.png", "name": "gone"}, {"uri": "never/used.png"}]);
    b.json["samplers"] = json!([{"wrapS": 33648, "wrapT": 33071, "magFilter": 9728}]);
    b.json["textures"] = json!([{"source": 0, "sampler": 0}, {"source": 1}, {"source": 2}]);
    b.json["materials"] = json!([{
        "name": "all",
        "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 2, 1], "metallicFactor": 0.5, "roughnessFactor": 0.75,
            "baseColorTexture": {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1}}},
            "metallicRoughnessTexture": {"index": 1}},
        "normalTexture": {"index": 0, "scale": 0.5},
        "emissiveFactor": [1, 0.5, 0], "alphaMode": "BLEND",
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10}, "KHR_materials_ior": {"ior": 1.33},
            "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [2, 1, 1],
                "specularTexture": {"index": 0}},
            "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": {"index": 0}},
            "KHR_materials_volume": {"thicknessFactor": 2, "attenuationDistance": 4, "attenuationColor": [0.25, 1, 1]}},
        "extras": {"lightskin": {"phong": {"specular": [0.1, 0.2, 0.3], "exponent": 40}}},
    }, {"normalTexture": {"index": 2}}]);
    b.primitive()["material"] = json!(0);
    b.json["extensionsUsed"] = json!(["KHR_materials_ior", "KHR_materials_anisotropy", "VENDOR_x"]);
    let scene = b.load("materials").expect("is valid");
    let m = &scene.materials[0];
    assert_eq!((m.base_color, m.metallic, m.roughness), (Vec4::new(0.5, 0.25, 1.0, 1.0), 0.5, 0.75));
    assert_eq!((m.emissive, m.ior, m.specular), (Vec3::new(10.0, 5.0, 0.0), 1.33, 0.5));
    assert_eq!((m.specular_color, m.alpha_cutoff, m.normal_scale), (Vec3::new(2.0, 1.0, 1.0), Some(0.5), 0.5));
    assert!(m.blend && m.transmission_texture.is_some() && m.thickness_texture.is_none());
    assert_eq!((m.transmission, m.thickness), (0.75, 2.0));
    assert!((-m.attenuation * 4.0).exp().abs_diff_eq(Vec3::new(0.25, 1.0, 1.0), 1e-6));
    let texture = m.base_color_texture.expect("is there");
    assert_eq!((texture.uv_set, texture.sampler.wrap_u, texture.sampler.wrap_v), (1, Wrap::Mirror, Wrap::Clamp));
    assert!(texture.sampler.nearest && m.specular_texture.is_some() && m.metallic_roughness_texture.is_none());
    assert_eq!(m.phong.expect("is there").exponent, 40.0);
    assert_eq!((scene.materials.len(), scene.images.len()), (1, 1));
    assert_eq!(scene.images[0].rgba, [0, 0, 0, 255, 255, 255, 255, 255]);
    let notes = scene.notes.join("\n");
    for told in ["KHR_materials_anisotropy, VENDOR_x", "baseColorFactor", "'gone' is not used", "BLEND"] {
        assert!(notes.contains(told), "{told}: {notes}");
    }
    b.json["materials"][0]["extras"]["lightskin"]["phong"]["exponent"] = json!("high");
    assert!(b.error("materials").contains("material 0 'all': extras: lightskin: phong: exponent"));
}

#[test]
fn specular_glossiness_is_converted_where_there_is_nothing_else() {
    let mut b = Builder::triangle();
    b.primitive()["material"] = json!(0);
    b.json["extensionsRequired"] = json!(["KHR_materials_pbrSpecularGlossiness"]);
    b.json["materials"] = json!([{"extensions": {"KHR_materials_pbrSpecularGlossiness":
        {"diffuseFactor": [0.5, 0.5, 0.5, 1], "specularFactor": [0.25, 0.125, 0], "glossinessFactor": 0.5}}}]);
    let scene = b.load("glossy").expect("is valid");
    let r = scene.materials[0].reflectance(&scene, [Vec2::ZERO; 2], Vec4::ONE);
    let Lobe::Ggx { f0, .. } = r.lobe else { panic!("{r:?}") };
    assert_eq!((r.base, f0, r.cache_exponent()), (Vec3::splat(0.5), Vec3::new(0.25, 0.125, 0.0), 7.5));
}

/// With a mirroring joint, the front of a surface still faces along its normal.
#[test]
fn mirrored_joints_keep_front_and_normal_together() {
    let mut b = Builder::triangle();
    b.attribute("NORMAL", "VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    b.attribute("WEIGHTS_0", "VEC4", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let joints = b.accessor(5121, "VEC4", 3, &[0; 12]);
    b.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    b.json["skins"] = json!([{"joints": [1]}]);
    b.json["nodes"] = json!([{"mesh": 0, "skin": 0}, {"scale": [-1, 2, 1]}]);
    let scene = b.load("mirrored").expect("is valid");
    let [a, b, c] = scene.meshes[0].triangle(0).map(|corner| scene.meshes[0].vertices[corner]);
    assert_near((b.position - a.position).cross(c.position - a.position).normalize(), a.normal);
    assert_near(a.normal, Vec3::Z);
    assert!([b, c].iter().any(|v| v.position == Vec3::NEG_X));
}

#[test]
fn meshes_are_shared_between_nodes() {
    let mut b = Builder::triangle();
    b.json["nodes"] = json!([{"mesh": 0, "children": [1, 2]}, {"mesh": 0, "translation": [1e7, 0, 0.25]},
        {"mesh": 0, "scale": [0, 1, 1]}]);
    let scene = b.load("instances").expect("is valid");
    assert_eq!((scene.meshes.len(), scene.instances.len(), scene.triangle_count()), (1, 2, 2));
    assert_eq!(scene.instances[1].world_from_model.translation, DVec3::new(1e7, 0.0, 0.25));
    assert_eq!(scene.notes, ["Nodes of no volume (scale 0) left out: 1."]);
}

#[test]
fn required_extensions_are_refused_with_a_remedy() {
    for (name, remedy) in [("EXT_texture_avif", "with PNG, JPEG"), ("VENDOR_unknown", "export without it")] {
        let mut b = Builder::triangle();
        b.json["extensionsRequired"] = json!([name]);
        let message = b.error("required");
        assert!(message.contains(name) && message.contains(remedy), "{message}");
    }
}
