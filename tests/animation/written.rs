//! Animated scenes have the same poses after writing and loading, at any time.

use super::second::File;
use super::{animated, placed};
use crate::common::{Builder, data};
use glam::{DAffine3, DVec3};
use lightskin::bake::{BakeSettings, Density, bake};
use lightskin::lab::scenes::{crowd, moving};
use lightskin::scene::deform::Pose;
use lightskin::scene::write::write_glb;
use lightskin::scene::{Instance, Scene, gltf, tessellate};
use serde_json::json;
use std::path::PathBuf;

fn scratch(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("written-{name}.glb"))
}

/// Writes the scene twice and loads it. Returns the loaded scene and the file's bytes, which must be equal both times.
fn again(scene: &Scene, name: &str) -> (Scene, Vec<u8>) {
    let [first, second] = ["", "-twice"].map(|run| {
        let path = scratch(&format!("{name}{run}"));
        write_glb(scene, &path).unwrap_or_else(|error| panic!("{name}: {error}"));
        path
    });
    let bytes = std::fs::read(&first).expect("is there");
    assert!(bytes == std::fs::read(second).expect("is there"), "{name}: written twice, the files differ");
    (gltf::load(&first).unwrap_or_else(|error| panic!("{name}: {error}")), bytes)
}

/// Largest difference of two scenes, as a fraction of their size: vertices of visible instances, lights, cameras. Items
/// with names are matched by name.
fn apart(a: &Scene, b: &Scene, size: f64) -> f64 {
    let shown = |scene: &Scene| -> Vec<Instance> {
        let mut shown: Vec<_> = scene.instances.iter().filter(|i| !i.hidden).cloned().collect();
        shown.sort_by_key(|i| i.name.clone());
        shown
    };
    let corners = |scene: &Scene, instance: &Instance| -> Vec<DVec3> {
        let (positions, _) = placed(scene, instance);
        scene.meshes[instance.mesh].indices.iter().map(|&index| positions[index as usize]).collect()
    };
    let (of_a, of_b) = (shown(a), shown(b));
    assert_eq!(of_a.len(), of_b.len(), "{}", a.name);
    let mut off = 0.0_f64;
    for (i, j) in of_a.iter().zip(&of_b) {
        let (i, j) = (corners(a, i), corners(b, j));
        assert_eq!(i.len(), j.len(), "{}", a.name);
        off = i.iter().zip(&j).fold(off, |off, (p, q)| off.max(p.distance(*q) / size));
    }
    assert_eq!((a.lights.len(), a.cameras.len()), (b.lights.len(), b.cameras.len()), "{}", a.name);
    let (mut lights_a, mut lights_b) = (a.lights.clone(), b.lights.clone());
    lights_a.sort_by(|a, b| a.name.cmp(&b.name));
    lights_b.sort_by(|a, b| a.name.cmp(&b.name));
    for (i, j) in lights_a.iter().zip(&lights_b) {
        assert_eq!((i.kind, i.color, i.range), (j.kind, j.color, j.range), "{}", i.name);
        assert!((i.intensity - j.intensity).abs() <= 1e-6 * i.intensity, "{}", i.name);
        // A directional light's position and a point light's direction have no meaning.
        if i.kind != lightskin::scene::LightKind::Directional {
            off = off.max(i.position.distance(j.position) / size);
        }
        if i.kind != lightskin::scene::LightKind::Point {
            off = off.max(f64::from(i.direction.distance(j.direction)));
        }
    }
    let (mut cameras_a, mut cameras_b) = (a.cameras.clone(), b.cameras.clone());
    cameras_a.sort_by(|a, b| a.name.cmp(&b.name));
    cameras_b.sort_by(|a, b| a.name.cmp(&b.name));
    for (i, j) in cameras_a.iter().zip(&cameras_b) {
        assert_eq!(i.projection, j.projection);
        let (i, j) = (i.world_from_camera, j.world_from_camera);
        assert!(i.matrix3.abs_diff_eq(j.matrix3, 1e-6));
        off = off.max(i.translation.distance(j.translation) / size);
    }
    off
}

/// Writes and loads a scene, and compares both at rest and during all animations. Returns the loaded scene, the file's
/// bytes and the largest difference.
fn compare(scene: &mut Scene, name: &str) -> (Scene, Vec<u8>, f64) {
    let (low, high) = scene.bounds().expect("is not empty");
    let size = low.distance(high);
    let (mut loaded, bytes) = again(scene, name);
    let mut off = apart(scene, &loaded, size);
    let spans: Vec<(String, f64, f64)> = scene.animations().map(|(n, a, b)| (n.to_owned(), a, b)).collect();
    let moves = |(n, a, b): &(String, f64, f64)| loaded.animations().any(|(m, c, d)| (m, c, d) == (n, *a, *b));
    assert!(spans.iter().all(moves), "{name}");
    for (animation, (_, begin, end)) in spans.iter().enumerate() {
        for part in [-0.1, 0.0, 0.13, 0.4, 0.5, 0.77, 1.0, 1.2] {
            let time = begin + (end - begin) * part;
            scene.pose(animation, time);
            loaded.pose(animation, time);
            off = off.max(apart(scene, &loaded, size));
        }
    }
    scene.rest();
    loaded.rest();
    (loaded, bytes, off)
}

#[test]
fn the_moving_room_and_the_crowd_move_as_before() {
    let mut crowd = crowd(1000);
    let (loaded, bytes, off) = compare(&mut crowd, "crowd");
    println!("crowd of 1000: {} bytes, largest difference {off:.1e} of the size", bytes.len());
    assert!(bytes.len() < 3_000_000 && off < 1e-5);
    // All crowd members share one mesh and one bake; each has its own pose.
    assert_eq!((loaded.meshes.len(), loaded.instances.len()), (2, 1001));
    assert_eq!(loaded.meshes.iter().filter(|mesh| mesh.deform.is_some()).count(), 1);
    assert_eq!(loaded.instances.iter().filter(|instance| instance.pose.is_some()).count(), 1000);
    let settings = BakeSettings { density: Density::Count(20_000), angle: 0.8, references: 8 };
    assert_eq!(bake(&loaded, &settings, &|_, _| {}).expect("bakes").models.len(), 2);
    let file = ::gltf::Gltf::from_slice(&bytes).expect("is valid glTF");
    assert_eq!((file.skins().count(), file.animations().count()), (1000, 1));
    // All channels share one set of key times, and all skins share their bind matrices.
    let inputs = file.animations().flat_map(|a| a.samplers().map(|s| s.input().index()).collect::<Vec<_>>());
    assert_eq!(inputs.collect::<std::collections::BTreeSet<_>>().len(), 1);

    let mut room = moving(0.25);
    let (mut loaded, bytes, off) = compare(&mut room, "moving");
    println!("moving room: {} bytes, largest difference {off:.1e} of the size", bytes.len());
    assert!(off < 1e-5);
    assert_eq!(loaded.meshes.iter().filter(|mesh| mesh.deform.is_some()).count(), 2);
    let valid = ::gltf::Gltf::from_slice(&bytes).expect("is valid glTF");
    let channels: usize = valid.animations().map(|animation| animation.channels().count()).sum();
    assert_eq!((channels, valid.skins().count()), (12, 1));

    // The second reader finds the triangles where the scene has them.
    let file = File::open(&scratch("moving"));
    for time in [0.0, 0.6, 1.3, 3.9] {
        room.pose(0, time);
        let drawn = file.drawn(Some((0, time)));
        assert_eq!(drawn.len(), room.instances.len());
        for (instance, triangles) in room.instances.iter().zip(&drawn) {
            let (mesh, (positions, _)) = (&room.meshes[instance.mesh], placed(&room, instance));
            assert_eq!(mesh.triangle_count(), triangles.len());
            for (t, (corners, _)) in triangles.iter().enumerate() {
                let own = mesh.triangle(t).map(|vertex| positions[vertex]);
                assert!(own.iter().zip(corners).all(|(p, q)| p.distance(*q) < 1e-5), "{}", instance.name);
            }
        }
    }

    // A scene written in some pose gives the same file. The loaded scene has a different pose at a different time.
    room.pose(0, 1.3);
    loaded.pose(0, 1.4);
    assert!(apart(&room, &loaded, 2.0) > 1e-3);
    let (_, posed) = again(&room, "posed");
    assert!(posed == bytes);
}

#[test]
fn animated_files_move_as_before() {
    let Some(data) = data() else { return };
    let mut written = 0;
    for path in animated(&data) {
        let mut scene = gltf::load(&path).expect("is valid");
        // Images are not written. The scene moves the same without them.
        scene.images.clear();
        scene.materials.iter_mut().flat_map(|m| m.textures_mut()).for_each(|texture| *texture = None);
        let name = path.file_stem().expect("has a name").to_string_lossy().into_owned();
        let parts = scene.rig.as_ref().expect("moves").parts();
        if parts
            .properties
            .iter()
            .any(|p| matches!(p.quantity(), lightskin::scene::animation::Quantity::TextureTransform(_)))
        {
            let error = write_glb(&scene, &scratch(&name)).expect_err("no texture to move").to_string();
            println!("{name}: {error}");
            continue;
        }
        let (_, bytes, off) = compare(&mut scene, &name);
        println!("{name}: {} bytes, largest difference {off:.1e} of the size", bytes.len());
        assert!(off < 1e-5, "{name}: {off}");
        written += 1;
    }
    println!("{written} files");
    assert!(written >= 20, "{written}");
}

/// A triangle, a hidden triangle as its child, and a node with a light and a camera. Pointers animate their properties.
#[test]
fn what_pointers_set_is_set_as_before() {
    let mut b = Builder::triangle();
    b.attribute("NORMAL", "VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    b.json["materials"] = json!([{"alphaMode": "MASK", "emissiveFactor": [0.5, 1, 1],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3}}}]);
    b.primitive()["material"] = json!(0);
    b.json["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]);
    b.json["extensions"] =
        json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}, "intensity": 5, "range": 9}]}});
    let off = json!({"KHR_node_visibility": {"visible": false}});
    b.json["nodes"] = json!([{"mesh": 0, "children": [1, 2], "scale": [2, 3, 2], "rotation": [0.6, 0, 0, 0.8]},
        {"camera": 0, "translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 0},
            "KHR_node_visibility": {"visible": false}}}, {"mesh": 0, "extensions": off}]);
    let light = "/extensions/KHR_lights_punctual/lights/0";
    b.pointer(&format!("{light}/color"), "VEC3", &[0.0, 0.0, 0.0, 1.0, 0.5, 0.25]);
    b.pointer(&format!("{light}/intensity"), "SCALAR", &[1.0, 8.0]);
    b.pointer(&format!("{light}/range"), "SCALAR", &[2.0, 4.0]);
    b.pointer(&format!("{light}/spot/innerConeAngle"), "SCALAR", &[0.0, 0.4]);
    b.pointer(&format!("{light}/spot/outerConeAngle"), "SCALAR", &[0.5, 1.0]);
    b.pointer("/cameras/0/perspective/yfov", "SCALAR", &[0.5, 1.0]);
    let material = "/materials/0";
    b.pointer(&format!("{material}/pbrMetallicRoughness/baseColorFactor"), "VEC4", &[0.1; 8]);
    b.pointer(&format!("{material}/pbrMetallicRoughness/metallicFactor"), "SCALAR", &[0.0, 1.0]);
    b.pointer(&format!("{material}/pbrMetallicRoughness/roughnessFactor"), "SCALAR", &[1.0, 0.0]);
    b.pointer(&format!("{material}/alphaCutoff"), "SCALAR", &[0.1, 0.9]);
    let extensions = format!("{material}/extensions");
    b.pointer(&format!("{extensions}/KHR_materials_emissive_strength/emissiveStrength"), "SCALAR", &[1.0, 9.0]);
    b.pointer(&format!("{extensions}/KHR_materials_ior/ior"), "SCALAR", &[1.0, 2.0]);
    b.pointer(&format!("{extensions}/KHR_materials_specular/specularFactor"), "SCALAR", &[0.0, 1.0]);
    b.pointer(&format!("{extensions}/KHR_materials_specular/specularColorFactor"), "VEC3", &[0.5; 6]);
    let visible = |node: u32| {
        let pointer = format!("/nodes/{node}/extensions/KHR_node_visibility/visible");
        json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}})
    };
    let view = b.view(&[0, 1]);
    b.push("accessors", json!({"bufferView": view, "componentType": 5121, "count": 2, "type": "SCALAR"}));
    let flags = b.json["accessors"].as_array().expect("is a list").len() - 1;
    let times = b.times(&[0.0, 0.5]);
    b.keyed(visible(1), times, flags, "STEP");
    b.keyed(visible(2), times, flags, "STEP");
    let mut scene = b.load("written-pointers").expect("is valid");
    let kept = ["ior", "specular", "emissive_strength"].map(|name| format!("KHR_materials_{name}"));
    let (mut loaded, bytes, off) = compare(&mut scene, "pointers");
    let text = String::from_utf8_lossy(&bytes);
    assert!(kept.iter().all(|name| text.contains(name)), "{text}");
    assert!(off < 1e-6);
    for time in [0.0, 0.2, 0.5, 0.9] {
        scene.pose(0, time);
        loaded.pose(0, time);
        assert_eq!(format!("{:?}", scene.materials), format!("{:?}", loaded.materials), "{time}");
        let hidden = |scene: &Scene| scene.instances.iter().map(|i| i.hidden).collect::<Vec<_>>();
        assert_eq!(hidden(&scene), hidden(&loaded), "{time}");
        assert_eq!(hidden(&scene)[1], time < 0.5);
    }
    scene.rest();
    loaded.rest();
    assert_eq!(format!("{:?}", scene.materials), format!("{:?}", loaded.materials));
}

#[test]
fn what_gltf_cannot_say_is_refused() {
    let refused = |scene: &Scene, why: &str| {
        let error = write_glb(scene, &scratch("refused")).expect_err(why).to_string();
        println!("{error}");
        assert!(error.contains(why) && !error.contains('\n'), "{error}");
        assert!(!scratch("refused").exists());
    };
    let mut divided = moving(0.5);
    assert!(tessellate::tessellate(&mut divided, 0.02, 1_000_000) > 0);
    refused(&divided, "write the scene before subdivision");
    let mut loose = moving(0.5);
    loose.rig = None;
    refused(&loose, "write the frozen scene");
    let mut mirrored = moving(0.5);
    mirrored.rig = None;
    let joints = vec![DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)); 4];
    mirrored.instances[2].pose = Some(Pose { joints, weights: Vec::new() });
    refused(&mirrored, "is mirrored by its skin");
    let mut stiff = moving(0.5);
    stiff.instances[3].pose = None;
    refused(&stiff, "or neither of them");
    // A pose without joints needs no rig.
    let mut still = moving(0.5);
    still.rig = None;
    still.instances.remove(2);
    still.instances[2].pose = Some(Pose { joints: Vec::new(), weights: vec![0.5] });
    let (loaded, _) = again(&still, "still");
    let ball = loaded.instances.iter().find(|instance| instance.name == "ball").expect("is there");
    let high = placed(&loaded, ball).0.iter().map(|p| p.as_vec3().y).fold(0.0, f32::max);
    assert!((high - 0.35 - 0.2 * 1.35).abs() < 1e-6, "{high}");
}
