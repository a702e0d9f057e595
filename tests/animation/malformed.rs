//! Errors in animations end in one line that names the place.

use crate::common::{Builder, data, gltf_files, one_line};
use lightskin::scene::gltf;
use serde_json::{Value, json};

/// A moving triangle with one morph target.
fn moving() -> Builder {
    let mut b = Builder::triangle();
    let target = b.floats("VEC3", &[0.0; 9]);
    b.primitive()["targets"] = json!([{"POSITION": target}]);
    b.channel(
        json!({"node": 0, "path": "rotation"}),
        &[0.0, 0.5, 1.0],
        "VEC4",
        &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    );
    b.channel(json!({"node": 0, "path": "weights"}), &[0.0, 1.0], "SCALAR", &[0.0, 1.0]);
    b
}

#[test]
fn faults_are_refused_where_they_are() {
    assert!(moving().load("animated").expect("is valid").rig.is_some());
    let animation = "/animations/0";
    let pointer = |text: &str| json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": text}}});
    let faults: [(&str, Value, &str); 24] = [
        ("/samplers", json!([]), "animation 0 'Play': has no samplers"),
        ("/channels", json!([]), "has no channels"),
        ("/channels/0/sampler", json!(7), "refers to sampler 7, but the animation has 2 samplers"),
        ("/channels/0/sampler", Value::Null, "has no sampler"),
        ("/channels/0/target", Value::Null, "has no target"),
        ("/channels/0/target/path", Value::Null, "has no path"),
        ("/channels/0/target/node", json!(9), "refers to node 9, but the file has 1 node"),
        ("/channels/0/target/path", json!("scale"), "cannot be F32 VEC4"),
        ("/channels/1/target/path", json!("rotation"), "sets the same target as another channel"),
        ("/samplers/0/interpolation", json!("BEZIER"), "unknown interpolation BEZIER"),
        ("/samplers/0/interpolation", json!("CUBICSPLINE"), "has 3 elements, but 3 keys of"),
        ("/samplers/0/input", json!(99), "refers to accessor 99"),
        ("/samplers/0/output", json!(99), "refers to accessor 99"),
        ("/samplers/0/output", Value::Null, "has no output"),
        ("/samplers/0/input", json!(0), "has no min and max"),
        ("/samplers/1/output", json!(3), "has 3 elements, but 2 keys of"),
        ("/channels/0/target", pointer("nodes/0/rotation"), "does not begin with /"),
        ("/channels/0/target", pointer("/nodes/5/rotation"), "refers to node 5"),
        ("/channels/0/target", pointer("/nodes/x/rotation"), "x is no index"),
        ("/channels/0/target", pointer("/materials/0/alphaCutoff"), "refers to material 0"),
        ("/channels/0/target", pointer("/extensions/KHR_lights_punctual/lights/0/color"), "has 0 lights"),
        ("/channels/1/target", pointer("/nodes/0/weights/1"), "has 1 morph target"),
        ("/channels/1/target", pointer("/meshes/3/weights"), "refers to mesh 3"),
        ("/channels/1/target", pointer("/nodes/0/rotation"), "sets the same target as another channel"),
    ];
    for (at, value, told) in faults {
        let mut b = moving();
        let (parent, key) = at.rsplit_once('/').expect("is a pointer");
        let parent = b.json.pointer_mut(&format!("{animation}{parent}")).expect("is there");
        match parent {
            Value::Array(list) => list[key.parse::<usize>().expect("is an index")] = value,
            other => other[key] = value,
        }
        let message = b.error("animated");
        assert!(message.contains(told), "{at}: {message}");
    }
    let mut b = moving();
    b.json["nodes"][0]["matrix"] = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    assert!(b.error("animated").contains("which has a matrix"));
    let mut b = moving();
    let view = b.json["accessors"][3]["bufferView"].as_u64().expect("has one") as usize;
    b.json["bufferViews"][view]["byteStride"] = json!(4);
    assert!(b.error("animated").contains("has a byteStride"));
}

#[test]
fn numbers_of_keys_are_checked() {
    let check = |accessor: usize, at: usize, value: f32, told: &str| {
        let mut b = moving();
        let view = b.json["accessors"][accessor]["bufferView"].as_u64().expect("has one") as usize;
        let offset = b.json["bufferViews"][view]["byteOffset"].as_u64().expect("has one") as usize;
        b.binary[offset + 4 * at..][..4].copy_from_slice(&value.to_le_bytes());
        let message = b.error("keys");
        assert!(message.contains(&format!("accessor {accessor} (")) && message.contains(told), "{message}");
    };
    check(3, 1, 0.0, "element 1 is 0, but times must increase");
    check(3, 2, 0.25, "element 2 is 0.25, but times must increase");
    check(3, 0, -1.0, "element 0 is -1, which is no valid time");
    check(3, 1, f32::NAN, "element 1 is NaN, which is no valid time");
    check(3, 2, f32::INFINITY, "element 2 is inf, which is no valid time");
    check(4, 3, f32::NAN, "element 0 is not finite");
    check(4, 3, 0.0, "element 0 has the length 0");
    check(4, 6, 3.0, "element 1 has the length 3");
    check(6, 1, f32::NAN, "element 1 is not finite");
}

/// The loader finds every error in animations that the reference validator reports.
#[test]
fn what_the_validator_finds_in_animations_is_refused() {
    let Some(data) = data() else { return };
    let mut seen = 0;
    for path in gltf_files(&data.join("malformed/gltf_validator")) {
        let Ok(report) = std::fs::read(format!("{}.report.json", path.display())) else { continue };
        let report: Value = serde_json::from_slice(&report).expect("reports are JSON");
        let messages = report["issues"]["messages"].as_array().cloned().unwrap_or_default();
        let of_one = |message: &&Value| {
            let pointer = message["pointer"].as_str().unwrap_or("");
            message["severity"] == 0
                && pointer.starts_with("/animations/")
                && message["code"] != "UNEXPECTED_EXTENSION_OBJECT"
        };
        if let Some(fault) = messages.iter().find(of_one) {
            seen += 1;
            let message = one_line(gltf::load(&path).expect_err("is malformed"));
            println!("{}: {message}", fault["code"]);
            // These files draw nothing, so each is refused anyway. The reason must be the animation.
            assert!(!message.contains("no triangles to draw"), "{}: {message}", fault["code"]);
        }
    }
    assert!(seen > 8, "{seen}");
}
