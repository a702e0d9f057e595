//! Broken and hostile input ends in an error of one line: no panic, no hang, no huge allocation.

use std::panic::catch_unwind;
use std::path::Path;

use crate::common::{Builder, PNG, data, glb, gltf_files, one_line, written};
use lightskin::Result;
use lightskin::scene::{Scene, gltf};
use serde_json::{Value, json};

/// Loads a file and, if that works, checks everything that indices in the scene refer to.
pub(crate) fn load_safely(path: &Path) -> Result<Scene> {
    let result =
        catch_unwind(|| gltf::load(path)).unwrap_or_else(|_| panic!("the loader panicked on {}", path.display()));
    if let Ok(scene) = &result {
        check(scene, path);
    }
    result
}

/// Invariants that the rest of the program relies on.
pub(crate) fn check(scene: &Scene, path: &Path) {
    for instance in &scene.instances {
        assert!(instance.mesh < scene.meshes.len() && instance.world_from_model.is_finite(), "{}", path.display());
    }
    for mesh in &scene.meshes {
        let mut next = 0;
        for primitive in &mesh.primitives {
            assert_eq!((primitive.first_index, primitive.index_count % 3), (next, 0), "{}", path.display());
            assert!(primitive.material < scene.materials.len());
            next += primitive.index_count;
        }
        assert_eq!(next as usize, mesh.indices.len());
        assert!(mesh.indices.iter().all(|&index| (index as usize) < mesh.vertices.len()));
        for vertex in &mesh.vertices {
            assert!(vertex.position.is_finite() && vertex.uv0.is_finite() && vertex.uv1.is_finite());
        }
        for triangle in 0..mesh.triangle_count() {
            for vertex in mesh.triangle(triangle).map(|corner| mesh.vertices[corner]) {
                let tangent: f32 = vertex.tangent[..3].iter().map(|x| x * x).sum();
                assert!((vertex.normal.length() - 1.0).abs() < 1e-4, "{}: {}", path.display(), vertex.normal);
                assert!(tangent == 0.0 || (tangent - 1.0).abs() < 1e-4, "{}: {:?}", path.display(), vertex.tangent);
            }
        }
    }
    for material in &scene.materials {
        for texture in [material.base_color_texture, material.normal_texture, material.emissive_texture] {
            assert!(texture.is_none_or(|t| t.image < scene.images.len() && t.uv_set < 2));
        }
    }
    for image in &scene.images {
        assert_eq!(image.rgba.len(), image.width as usize * image.height as usize * 4);
    }
    for note in &scene.notes {
        assert!(!note.contains('\n'), "{note:?}");
    }
}

#[test]
fn every_malformed_file_loads_or_is_refused_in_one_line() {
    let Some(data) = data() else { return };
    let (mut loaded, mut refused) = (0, 0);
    for path in gltf_files(&data.join("malformed")) {
        match load_safely(&path) {
            Ok(_) => loaded += 1,
            Err(error) => {
                let message = one_line(error);
                println!("{}", message.strip_prefix(&data.display().to_string()).unwrap_or(&message));
                refused += 1;
            }
        }
    }
    println!("{loaded} loaded, {refused} refused");
    assert!(refused > 100);
}

/// Errors found by the reference validator that would make an unchecked loader access wrong memory.
const UNSAFE: [&str; 14] = [
    "ACCESSOR_INDEX_OOB",
    "ACCESSOR_JOINTS_INDEX_OOB",
    "ACCESSOR_SMALL_BYTESTRIDE",
    "ACCESSOR_SPARSE_COUNT_OUT_OF_RANGE",
    "ACCESSOR_TOO_LONG",
    "BUFFER_BYTE_LENGTH_MISMATCH",
    "BUFFER_MISSING_GLB_DATA",
    "BUFFER_VIEW_TOO_LONG",
    "GLB_UNEXPECTED_END_OF_HEADER",
    "INVALID_IBM_ACCESSOR_COUNT",
    "INVALID_JSON",
    "NODE_LOOP",
    "NODE_PARENT_OVERRIDE",
    "UNSATISFIED_DEPENDENCY",
];

#[test]
fn what_the_validator_finds_unsafe_is_refused() {
    let Some(data) = data() else { return };
    let mut seen = 0;
    for path in gltf_files(&data.join("malformed/gltf_validator")) {
        let report = format!("{}.report.json", path.display());
        let Ok(report) = std::fs::read(&report) else { continue };
        let report: Value = serde_json::from_slice(&report).expect("reports are JSON");
        let messages = report["issues"]["messages"].as_array().cloned().unwrap_or_default();
        let fault = messages
            .iter()
            .filter(|message| message["severity"] == 0)
            .find(|message| UNSAFE.iter().any(|code| message["code"] == *code));
        if let Some(fault) = fault {
            seen += 1;
            assert!(load_safely(&path).is_err(), "{} was accepted despite {}", path.display(), fault["code"]);
        }
    }
    assert!(seen > 10, "only {seen} reports have such an error");
}

/// A scene with a bit of everything: texture, light, camera, skin, morph target, sparse accessor.
pub(crate) fn rich() -> Builder {
    let mut b = Builder::triangle();
    b.attribute("NORMAL", "VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    b.attribute("TEXCOORD_0", "VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    b.attribute("WEIGHTS_0", "VEC4", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let joints = b.accessor(5121, "VEC4", 3, &[0; 12]);
    b.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    let (indices, values) = (b.view(&[1]), b.view(&[0; 12]));
    let sparse = json!({"count": 1, "indices": {"bufferView": indices, "componentType": 5121},
        "values": {"bufferView": values}});
    let delta = b.push("accessors", json!({"componentType": 5126, "type": "VEC3", "count": 3, "sparse": sparse}));
    b.primitive()["targets"] = json!([{"POSITION": delta}]);
    b.primitive()["material"] = json!(0);
    let image = b.view(PNG);
    b.json["images"] = json!([{"bufferView": image, "mimeType": "image/png"}]);
    b.json["textures"] = json!([{"source": 0, "sampler": 0}]);
    b.json["samplers"] = json!([{"wrapS": 33071, "magFilter": 9728}]);
    b.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0,
        "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}}, "doubleSided": true, "alphaMode": "MASK"}]);
    b.json["skins"] = json!([{"joints": [1]}]);
    b.json["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}}]}});
    b.json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "weights": [0.5], "children": [1]},
        {"camera": 0, "rotation": [0, 0, 0, 1], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"mesh": 0, "scale": [1, 1, -1]},
    ]);
    b.json["scenes"] = json!([{"nodes": [0, 2]}]);
    b
}

#[test]
fn every_truncation_ends_in_an_error() {
    let rich = rich();
    let good = glb(&rich.json, &rich.binary);
    let scene = gltf::load(&written("truncated.glb", &good)).expect("the original is valid");
    assert_eq!((scene.triangle_count(), scene.lights.len(), scene.cameras.len(), scene.images.len()), (4, 1, 1, 1));
    for length in (0..good.len()).step_by(7) {
        one_line(load_safely(&written("truncated.glb", &good[..length])).expect_err("is truncated"));
    }
}

#[test]
fn files_that_are_no_files_are_told_apart() {
    let error = |path: &Path| one_line(load_safely(path).expect_err("is no glTF"));
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    assert!(error(&folder.join("missing.glb")).contains("does not exist"));
    assert!(error(folder).contains("is a folder"));
    assert!(error(&written("empty.gltf", b"")).contains("is empty"));
    assert!(error(&written("text.gltf", b"solid cube")).contains("not glTF"));
    assert!(error(&written("json.gltf", b"{\"a\": ")).contains("JSON is broken"));
    assert!(error(&written("old.gltf", br#"{"asset": {"version": "1.0"}, "meshes": {}}"#)).contains("2.0 is needed"));
    assert!(error(&written("old2.gltf", br#"{"meshes": {}}"#)).contains("glTF 1.0"));
    assert!(error(&written("none.gltf", br#"{"asset": {"version": "2.0"}}"#)).contains("no triangles"));
    let deep = [b"{\"asset\":{\"version\":\"2.0\"},\"extras\":".to_vec(), vec![b'['; 100_000]].concat();
    assert!(error(&written("deep.gltf", &deep)).contains("JSON is broken"));
}

#[test]
fn accessors_are_bounded() {
    let mut b = Builder::triangle();
    b.json["accessors"][0]["count"] = json!(100);
    let message = b.error("bounds");
    let told = "accessor 0 (POSITION of mesh 0 'Wall'): needs 1200 bytes but buffer view 0 holds 36; the file is \
                truncated or its counts are wrong: export it again";
    assert!(message.ends_with(told), "{message}");

    let changes: [(&str, Value, &str); 12] = [
        ("/accessors/0/count", json!(4294967295_u64), "needs"),
        ("/accessors/0/count", json!(u64::MAX), "elements"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "needs"),
        ("/accessors/0/byteOffset", json!(-1), "whole number"),
        ("/bufferViews/0/byteLength", json!(u64::MAX), "truncated"),
        ("/bufferViews/0/byteStride", json!(4), "byteStride"),
        ("/bufferViews/0/byteStride", json!(253), "byteStride"),
        ("/bufferViews/0/buffer", json!(1), "1 buffer"),
        ("/buffers/0/byteLength", json!(1000), "truncated"),
        ("/accessors/0/componentType", json!(5125), "cannot be"),
        ("/accessors/1/type", json!("VEC2"), "cannot be"),
        ("/meshes/0/primitives/0/indices", json!(4294967296_u64), "refers to"),
    ];
    for (at, value, told) in changes {
        let mut b = Builder::triangle();
        let (parent, key) = at.rsplit_once('/').expect("is a pointer");
        b.json.pointer_mut(parent).expect("is there")[key] = value;
        let message = b.error("bounds");
        assert!(message.contains(told), "{at}: {message}");
    }
}

#[test]
fn small_files_cannot_ask_for_much_memory() {
    let mut b = Builder::new();
    b.push("accessors", json!({"componentType": 5126, "type": "VEC3", "count": 4294967294_u64}));
    b.primitive()["attributes"]["POSITION"] = json!(0);
    assert!(b.error("zeros").contains("no bufferView"));

    // A thousand primitives that share an accessor of a million indices.
    let mut b = Builder::triangle();
    let indices = b.accessor(5121, "SCALAR", 1_000_000, &vec![0; 1_000_000]);
    b.primitive()["indices"] = json!(indices);
    b.primitive()["mode"] = json!(5);
    let primitive = b.primitive().clone();
    b.json["meshes"][0]["primitives"] = Value::Array(vec![primitive; 1000]);
    assert!(b.error("shared").contains("simplify"));
}

#[test]
fn indices_positions_and_weights_are_checked() {
    let mut b = Builder::triangle();
    let at = b.binary.len() - 2;
    b.binary[at] = 3;
    assert!(
        b.error("indices").contains("accessor 1 (indices of mesh 0 'Wall'): element 2 is 3, but there are 3 vertices")
    );
    b.binary[at..].fill(0xFF);
    assert!(b.error("indices").contains("primitive restart"));

    let mut b = Builder::triangle();
    b.binary[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(b.error("nan").contains("accessor 0 (POSITION of mesh 0 'Wall'): element 0 is not finite"));

    let mut b = rich();
    b.json["nodes"][0]["weights"] = json!([0.5, 0.5]);
    assert!(b.error("weights").contains("1 morph target for 2 weights"));
}

#[test]
fn node_graphs_are_trees() {
    let mut b = Builder::triangle();
    b.json["nodes"] = json!([{"mesh": 0}, {"children": [2]}, {"children": [1]}]);
    assert!(b.error("cycle").contains("its own ancestor"));
    b.json["nodes"] = json!([{"mesh": 0, "children": [0]}]);
    assert!(b.error("self").contains("its own ancestor"));
    b.json["nodes"] = json!([{"mesh": 0, "children": [2]}, {"children": [2]}, {}]);
    assert!(b.error("parents").contains("tree"));
    b.json["nodes"] = json!([{"mesh": 0, "children": [7]}]);
    assert!(b.error("child").contains("refers to node 7, but the file has 1 node"));

    let mut nodes: Vec<Value> = (1..50_000).map(|child| json!({"children": [child]})).collect();
    nodes.push(json!({"mesh": 0}));
    b.json["nodes"] = Value::Array(nodes);
    assert_eq!(b.load("chain").expect("a deep tree is valid").triangle_count(), 1);
}

#[test]
fn unused_buffers_may_be_placeholders() {
    let mut b = Builder::triangle();
    b.push("buffers", json!({"byteLength": 100}));
    assert_eq!(b.load("placeholder").expect("is valid").triangle_count(), 1);
    b.json["bufferViews"][0]["buffer"] = json!(1);
    assert!(b.error("placeholder").contains("buffer 1: has no uri"));
}

#[test]
fn uris_stay_in_the_folder() {
    for uri in ["../secret.bin", "%2E%2E/secret.bin", "/etc/hostname", "http://localhost/a.bin", "file:///etc/hostname"]
    {
        let mut b = Builder::triangle();
        b.json["buffers"][0]["uri"] = json!(uri);
        let message = b.error("uri");
        assert!(
            message.contains("buffer 0") && (message.contains("folder") || message.contains("relative")),
            "{message}"
        );
    }
}

#[test]
fn what_a_small_file_asks_for_is_bounded() {
    // A strip of six million triangles without normals. No buffer has its positions, so all are zero. The scene would
    // need 18 million vertices of 60 bytes.
    let mut b = Builder::new();
    let positions = b.push("accessors", json!({"componentType": 5126, "type": "VEC3", "count": 6_000_000}));
    *b.primitive() = json!({"attributes": {"POSITION": positions}, "mode": 5});
    assert!(b.error("huge").contains("--max-memory"));
}

#[test]
fn texture_coordinates_stay_in_range() {
    let mut b = rich();
    b.attribute("TEXCOORD_0", "VEC2", &[3e38, 0.0, -1e7, 0.5, 0.0, f32::NAN]);
    let texture = &mut b.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    texture["extensions"]["KHR_texture_transform"] = json!({"scale": [3e38, 1], "offset": [0, -3e38], "rotation": 1});
    let scene = b.load("texture_range").expect("is valid");
    let texture = scene.materials.iter().find_map(|material| material.base_color_texture).expect("a texture");
    let seen = scene.meshes.iter().flat_map(|mesh| &mesh.vertices).map(|v| texture.transform.transform_point2(v.uv0));
    assert!(seen.clone().count() > 0 && seen.into_iter().all(|uv| uv.abs().max_element() < 1e13));
    let notes = scene.notes.join(" ");
    assert!(
        notes.contains("beyond a million set to zero: 6") && notes.contains("offset and scale are clamped"),
        "{notes}"
    );
}

#[test]
fn what_stands_farther_off_than_numbers_reach_is_refused() {
    for distance in [1e19, 1e37] {
        let mut b = Builder::triangle();
        b.json["nodes"][0]["translation"] = json!([0.0, distance, 0.0]);
        let error = b.load("far_off").expect_err("too far");
        assert!(error.to_string().contains("its transform overflows"), "{error}");
    }
}

#[test]
fn what_is_larger_than_sums_of_areas_hold_is_refused() {
    let mut b = Builder::triangle();
    b.json["nodes"][0]["scale"] = json!([1e30, 1e30, 1e30]);
    let error = b.load("too_large").expect_err("too large");
    assert!(error.to_string().contains("is larger than 1e15 m"), "{error}");
    let mut b = Builder::triangle();
    b.json["nodes"][0]["scale"] = json!([1e12, 1e12, 1e12]);
    b.load("large").expect("a planet's orbit fits");
}
