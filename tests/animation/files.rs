//! Small files written here: animation pointers, visibility, instances, shared skeletons, degenerate poses.

use crate::common::Builder;
use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3, Vec4};
use lightskin::bake::{BakeSettings, Cache, Density, NO_CACHE, bake};
use lightskin::reference::world::{Sides, World};
use lightskin::scene::{LightKind, Projection, Scene};
use serde_json::{Value, json};

impl Builder {
    /// Adds an accessor with key times and returns its index.
    pub(super) fn times(&mut self, times: &[f32]) -> usize {
        let accessor = self.floats("SCALAR", times);
        let bounds = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(0.0));
        self.json["accessors"][accessor]["min"] = json!([bounds.0]);
        self.json["accessors"][accessor]["max"] = json!([bounds.1]);
        accessor
    }

    /// Adds a channel to the only animation.
    pub(super) fn channel(&mut self, target: Value, times: &[f32], kind: &str, values: &[f32]) {
        let (input, output) = (self.times(times), self.floats(kind, values));
        self.keyed(target, input, output, "LINEAR");
    }

    pub(super) fn keyed(&mut self, target: Value, input: usize, output: usize, interpolation: &str) {
        if self.json["animations"].is_null() {
            self.json["animations"] = json!([{"name": "Play", "channels": [], "samplers": []}]);
        }
        let animation = &mut self.json["animations"][0];
        let samplers = animation["samplers"].as_array_mut().expect("is a list");
        samplers.push(json!({"input": input, "output": output, "interpolation": interpolation}));
        let sampler = samplers.len() - 1;
        let channels = animation["channels"].as_array_mut().expect("is a list");
        channels.push(json!({"sampler": sampler, "target": target}));
    }

    pub(super) fn pointer(&mut self, pointer: &str, kind: &str, values: &[f32]) {
        let target = json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}});
        self.channel(target, &[0.0, 1.0], kind, values);
    }
}

/// A triangle with a textured material, two lights and two cameras.
fn rich() -> Builder {
    let mut b = Builder::triangle();
    b.attribute("NORMAL", "VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    b.attribute("TEXCOORD_0", "VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let image = b.view(crate::common::PNG);
    b.json["images"] = json!([{"bufferView": image, "mimeType": "image/png"}]);
    b.json["textures"] = json!([{"source": 0}]);
    b.json["materials"] = json!([{"alphaMode": "MASK", "normalTexture": {"index": 0}, "emissiveFactor": [1, 1, 1],
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform":
            {"scale": [2, 2]}}}},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3}}}]);
    b.primitive()["material"] = json!(0);
    b.json["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}}]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "spot": {}, "intensity": 5, "range": 9}, {"type": "point", "intensity": 7}]}});
    let light = |i: u32| json!({"KHR_lights_punctual": {"light": i}});
    b.json["nodes"] = json!([{"mesh": 0, "children": [1, 2, 3]}, {"camera": 0, "extensions": light(0)},
        {"camera": 1, "extensions": light(1)}, {"extensions": light(0)}]);
    b
}

#[test]
fn pointers_set_what_they_name() {
    let mut b = rich();
    let light = "/extensions/KHR_lights_punctual/lights/0";
    b.pointer(&format!("{light}/color"), "VEC3", &[0.0, 0.0, 0.0, 1.0, 0.5, 0.25]);
    b.pointer(&format!("{light}/intensity"), "SCALAR", &[0.0, 8.0]);
    b.pointer(&format!("{light}/range"), "SCALAR", &[2.0, 4.0]);
    b.pointer(&format!("{light}/spot/innerConeAngle"), "SCALAR", &[0.0, 0.4]);
    b.pointer(&format!("{light}/spot/outerConeAngle"), "SCALAR", &[0.2, 1.0]);
    let material = "/materials/0";
    let base = format!("{material}/pbrMetallicRoughness");
    b.pointer(&format!("{base}/baseColorFactor"), "VEC4", &[0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 0.25, 1.0]);
    b.pointer(&format!("{base}/metallicFactor"), "SCALAR", &[0.0, 1.0]);
    b.pointer(&format!("{base}/roughnessFactor"), "SCALAR", &[1.0, 0.0]);
    b.pointer(&format!("{material}/emissiveFactor"), "VEC3", &[0.0, 0.0, 0.0, 1.0, 0.5, 0.25]);
    b.pointer(
        &format!("{material}/extensions/KHR_materials_emissive_strength/emissiveStrength"),
        "SCALAR",
        &[0.0, 20.0],
    );
    b.pointer(&format!("{material}/alphaCutoff"), "SCALAR", &[0.0, 1.0]);
    b.pointer(&format!("{material}/normalTexture/scale"), "SCALAR", &[0.0, 3.0]);
    b.pointer(&format!("{material}/extensions/KHR_materials_ior/ior"), "SCALAR", &[1.0, 2.0]);
    b.pointer(&format!("{material}/extensions/KHR_materials_specular/specularFactor"), "SCALAR", &[0.0, 1.0]);
    b.pointer(
        &format!("{material}/extensions/KHR_materials_specular/specularColorFactor"),
        "VEC3",
        &[0.0, 0.0, 0.0, 2.0, 1.0, 0.5],
    );
    let transform = format!("{base}/baseColorTexture/extensions/KHR_texture_transform");
    b.pointer(&format!("{transform}/offset"), "VEC2", &[0.0, 0.0, 1.0, 2.0]);
    b.pointer(&format!("{transform}/rotation"), "SCALAR", &[0.0, std::f32::consts::PI]);
    b.pointer("/cameras/0/perspective/yfov", "SCALAR", &[0.5, 1.5]);
    b.pointer("/cameras/1/orthographic/ymag", "SCALAR", &[1.0, 3.0]);
    b.pointer("/nodes/3/translation", "VEC3", &[0.0, 0.0, 0.0, 2.0, 4.0, 6.0]);
    b.pointer("/materials/0/occlusionTexture/strength", "SCALAR", &[0.0, 1.0]);
    let mut scene = b.load("pointers").expect("is valid");
    assert!(scene.notes.iter().any(|n| n.contains("occlusionTexture/strength")), "{:?}", scene.notes);
    let fresh = format!("{:?}{:?}{:?}", scene.materials, scene.lights, scene.cameras);
    scene.pose(0, 0.5);
    // Two nodes refer to this light.
    for light in [&scene.lights[0], &scene.lights[2]] {
        assert_eq!((light.color, light.intensity, light.range), (Vec3::new(0.5, 0.25, 0.125), 4.0, Some(3.0)));
        let LightKind::Spot { inner, outer } = light.kind else { panic!("is a spot light") };
        assert!((inner - 0.2).abs() < 1e-6 && (outer - 0.6).abs() < 1e-6, "{inner} {outer}");
    }
    assert_eq!((scene.lights[1].intensity, scene.lights[2].position), (7.0, DVec3::new(1.0, 2.0, 3.0)));
    let material = &scene.materials[0];
    assert_eq!(material.base_color, Vec4::new(0.5, 0.25, 0.125, 0.5));
    assert_eq!((material.metallic, material.roughness, material.alpha_cutoff), (0.5, 0.5, Some(0.5)));
    // Half of the factor times half of the strength.
    assert_eq!(material.emissive, Vec3::new(5.0, 2.5, 1.25));
    assert_eq!((material.normal_scale, material.ior, material.specular), (1.5, 1.5, 0.5));
    assert_eq!(material.specular_color, Vec3::new(1.0, 0.5, 0.25));
    let texture = material.base_color_texture.expect("has one").transform;
    // Scaled by two and turned by a quarter, u becomes -v. The offset is halfway.
    assert!((texture.transform_point2(Vec2::new(1.0, 0.0)) - Vec2::new(0.5, 1.0 - 2.0)).length() < 1e-6, "{texture:?}");
    assert_eq!(scene.cameras[0].projection, Projection::Perspective { yfov: 1.0 });
    assert_eq!(scene.cameras[1].projection, Projection::Orthographic { ymag: 2.0 });
    scene.rest();
    assert_eq!(fresh, format!("{:?}{:?}{:?}", scene.materials, scene.lights, scene.cameras));
}

#[test]
fn hidden_nodes_hide_what_is_below_them() {
    let mut b = rich();
    b.json["nodes"][0]["extensions"] = json!({"KHR_node_visibility": {"visible": false}});
    let scene = b.load("hidden").expect("is valid");
    assert!(scene.instances[0].hidden && scene.lights.is_empty() && scene.cameras.len() == 2);
    let (input, output) = (b.times(&[0.0, 1.0]), b.accessor(5121, "SCALAR", 2, &[0, 1]));
    let pointer = "/nodes/0/extensions/KHR_node_visibility/visible";
    let target = json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}});
    b.keyed(target, input, output, "STEP");
    let mut scene = b.load("hidden").expect("is valid");
    let seen =
        |scene: &Scene| (!scene.instances[0].hidden, scene.lights.iter().map(|l| l.intensity).collect::<Vec<_>>());
    assert_eq!(seen(&scene), (false, vec![0.0; 3]));
    scene.pose(0, 0.99);
    assert_eq!(seen(&scene), (false, vec![0.0; 3]));
    scene.pose(0, 1.0);
    assert_eq!(seen(&scene), (true, vec![5.0, 7.0, 5.0]));
    assert_eq!(scene.frozen().instances.len(), 1);
    scene.rest();
    assert_eq!(seen(&scene), (false, vec![0.0; 3]));
    assert!(scene.frozen().instances.is_empty());
    b.json["animations"][0]["samplers"][0]["interpolation"] = json!("LINEAR");
    assert!(b.error("hidden").contains("needs STEP"));
}

/// A triangle that one node draws three times.
fn instanced() -> Builder {
    let mut b = Builder::triangle();
    let translation = b.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    let quarter = [0, 0, 0, 127, 0, 0, 90, 90, 0, 0, 0, 127];
    let rotation = b.accessor(5120, "VEC4", 3, &quarter);
    b.json["accessors"][rotation]["normalized"] = json!(true);
    let scale = b.floats("VEC3", &[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0]);
    b.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    b.json["nodes"][0] = json!({"mesh": 0, "name": "tree", "translation": [10, 0, 0],
        "extensions": {"EXT_mesh_gpu_instancing":
            {"attributes": {"TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale}}}});
    b
}

#[test]
fn instances_of_a_node_share_its_mesh_and_move_with_it() {
    let mut b = instanced();
    let values = [10.0, 0.0, 0.0, 10.0, 0.0, 4.0];
    b.channel(json!({"node": 0, "path": "translation"}), &[0.0, 1.0], "VEC3", &values);
    let mut scene = b.load("instanced").expect("is valid");
    assert_eq!((scene.meshes.len(), scene.instances.len()), (1, 3));
    scene.pose(0, 0.5);
    let corner = |i: usize| scene.instances[i].world_from_model.transform_point3(DVec3::X);
    assert!(corner(0).distance(DVec3::new(11.0, 0.0, 2.0)) < 1e-9);
    assert!(corner(1).distance(DVec3::new(11.0, 1.0, 2.0)) < 1e-6, "{}", corner(1));
    assert!(corner(2).distance(DVec3::new(13.0, 2.0, 2.0)) < 1e-9);
    assert_eq!(scene.instances[2].name, "tree 2");

    let broken: [(&str, Value, &str); 5] = [
        ("/accessors/2/count", json!(2), "other attributes of the instances have"),
        ("/accessors/2/type", json!("SCALAR"), "cannot be"),
        ("/accessors/3/componentType", json!(5121), "cannot be"),
        ("/accessors/3/normalized", json!(false), "cannot be"),
        ("/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes/SCALE", json!(99), "refers to accessor 99"),
    ];
    for (at, value, told) in broken {
        let mut b = instanced();
        let (parent, key) = at.rsplit_once('/').expect("is a pointer");
        b.json.pointer_mut(parent).expect("is there")[key] = value;
        let message = b.error("instanced");
        assert!(message.contains(told), "{at}: {message}");
    }
}

/// A strip of two triangles with two joints. Each of `count` nodes draws it with its own skeleton; the skeletons stand
/// apart.
fn crowd(count: usize, scale: impl Fn(usize) -> f64, far: f64) -> Builder {
    let mut b = Builder::new();
    b.attribute("POSITION", "VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
    b.attribute("NORMAL", "VEC3", &[0.0, 0.0, 1.0].repeat(4));
    b.attribute("WEIGHTS_0", "VEC4", &[1.0, 0.0, 0.0, 0.0].repeat(4));
    let joints = b.accessor(5121, "VEC4", 4, &[0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]);
    b.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    let indices = b.accessor(5121, "SCALAR", 6, &[0, 1, 2, 2, 1, 3]);
    b.primitive()["indices"] = json!(indices);
    b.json["materials"] = json!([{"doubleSided": true}]);
    b.primitive()["material"] = json!(0);
    b.json["nodes"] = json!([]);
    b.json["skins"] = json!([]);
    let mut top = Vec::new();
    for i in 0..count {
        let size = scale(i);
        let root = b.push(
            "nodes",
            json!({"children": [3 * i + 1], "scale": [size, size, size],
            "translation": [far + 3.0 * i as f64, 0, 0]}),
        );
        b.push("nodes", json!({}));
        b.push("nodes", json!({"mesh": 0, "skin": i}));
        b.push("skins", json!({"joints": [root, root + 1]}));
        top.extend([root, root + 2]);
        let (low, high) = (0.1 * i as f32, 1.0 + 0.1 * i as f32);
        let target = json!({"node": root + 1, "path": "translation"});
        b.channel(target, &[0.0, 1.0], "VEC3", &[0.0, low, 0.0, 0.0, high, 0.0]);
    }
    b.json["scenes"] = json!([{"nodes": top}]);
    b
}

#[test]
fn a_crowd_has_one_mesh_and_a_pose_each() {
    let mut scene = crowd(100, |_| 1.0, 0.0).load("crowd").expect("is valid");
    assert_eq!((scene.meshes.len(), scene.instances.len()), (1, 100));
    scene.pose(0, 0.5);
    for (i, instance) in scene.instances.iter().enumerate() {
        let pose = instance.pose.as_ref().expect("bends");
        let up = 0.5 + 0.1 * i as f32;
        let top = scene.meshes[0].posed(pose)[3];
        assert!(top.position.distance(Vec3::new(1.0, 1.0 + up, 0.0)) < 1e-4, "{i}: {}", top.position);
        assert!((instance.world_from_model.translation - DVec3::new(3.0 * i as f64, 0.0, 0.0)).length() < 1e-9);
        // The back side faces the opposite way.
        assert_eq!((top.normal, scene.meshes[0].posed(pose)[7].normal), (Vec3::Z, Vec3::NEG_Z));
    }
    let caches = bake(&scene, &BakeSettings { density: Density::Count(4000), angle: 0.8, references: 8 }, &|_, _| {});
    let caches = caches.expect("bakes");
    assert_eq!(caches.models.len(), 1);
    // References are chosen by distance alone, with one spacing added for caches on the opposite side.
    let model = &caches.models[0];
    for (vertex, references) in scene.meshes[0].vertices.iter().zip(model.references.chunks_exact(8)) {
        let far = |cache: &Cache| {
            let behind = if cache.normal.dot(vertex.normal) > 0.0 { 0.0 } else { caches.spacing as f32 };
            cache.position.distance(vertex.position) + behind
        };
        let mut distances: Vec<f32> = model.caches.iter().map(far).collect();
        distances.sort_by(f32::total_cmp);
        let found = references.iter().filter(|r| **r != NO_CACHE).map(|r| &model.caches[usize::from(*r)]);
        for (cache, nearest) in found.zip(distances) {
            assert!((far(cache) - nearest).abs() < 1e-5);
        }
    }
    // The bake treats sizes an octave apart as different meshes, but not sizes that differ by a tenth.
    assert_eq!(crowd(4, |i| 1.0 + 0.03 * i as f64, 0.0).load("crowd").expect("is valid").meshes.len(), 1);
    assert_eq!(crowd(4, |i| f64::from(1 << i), 0.0).load("crowd").expect("is valid").meshes.len(), 4);
}

#[test]
fn skins_far_away_lose_nothing() {
    // This number has no exact f32 representation.
    let far = 1e7 / 3.0;
    let mut near = crowd(1, |_| 1.0, 0.0).load("near").expect("is valid");
    let mut away = crowd(1, |_| 1.0, far).load("away").expect("is valid");
    for time in [0.0, 0.3, 0.9] {
        near.pose(0, time);
        away.pose(0, time);
        let posed = |scene: &Scene| scene.meshes[0].posed(scene.instances[0].pose.as_ref().expect("bends"));
        assert_eq!(posed(&near), posed(&away));
        assert_eq!(away.instances[0].world_from_model.translation, DVec3::new(far, 0.0, 0.0));
    }
}

/// A node and a joint with scale 0 at rest. Nothing is visible at first, and nothing becomes NaN.
#[test]
fn what_has_no_volume_at_rest_may_get_one() {
    let grow = [0.0, 0.0, 0.0, 2.0, 2.0, 2.0];
    let mut rigid = Builder::triangle();
    rigid.json["nodes"][0] = json!({"mesh": 0, "scale": [0, 0, 0]});
    assert!(rigid.error("no volume").contains("no triangles"));
    rigid.channel(json!({"node": 0, "path": "scale"}), &[0.0, 1.0], "VEC3", &grow);
    let mut skinned = crowd(1, |_| 0.0, 0.0);
    skinned.channel(json!({"node": 0, "path": "scale"}), &[0.0, 1.0], "VEC3", &grow);
    for (mut builder, bends) in [(rigid, false), (skinned, true)] {
        // The scene needs some other visible triangle.
        let plain = json!({"primitives": [{"attributes": {"POSITION": 0}, "indices": builder.primitive()["indices"]}]});
        let mesh = builder.push("meshes", plain);
        let node = builder.push("nodes", json!({"mesh": mesh, "translation": [0, 0, -5]}));
        builder.json["scenes"][0]["nodes"].as_array_mut().expect("is a list").push(json!(node));
        let mut scene = builder.load("no volume").expect("is valid");
        assert_eq!((scene.instances.len(), scene.instances[0].pose.is_some()), (2, bends));
        let settings = BakeSettings { density: Density::Count(100), angle: 0.8, references: 8 };
        let caches = bake(&scene, &settings, &|_, _| {}).expect("bakes");
        let of = &caches.models[caches.instance_model[0]];
        assert!(of.caches.iter().all(|c| c.position.is_finite() && c.normal.is_finite() && c.area.is_finite()));
        if !bends {
            assert!(!of.caches.is_empty() && of.references[0] != NO_CACHE);
        }
        for time in [0.0, 0.5] {
            scene.pose(0, time);
            for vertex in scene.instances[0].pose.iter().flat_map(|pose| scene.meshes[0].posed(pose)) {
                assert!(vertex.position.is_finite() && (vertex.normal.length() - 1.0).abs() < 1e-5);
            }
            let frozen = scene.frozen();
            let world = World::new(&frozen);
            let hit = world.nearest(DVec3::new(0.2, 0.2, 1.0), DVec3::NEG_Z, Sides::Both);
            let hit = hit.expect("the triangle behind is always there");
            assert_eq!(hit.instance, usize::from(time == 0.0), "at {time} s");
            let surface = world.surface(&hit);
            assert!(surface.normal.is_finite() && surface.position.is_finite(), "{surface:?}");
        }
    }
}

#[test]
fn cubic_splines_and_steps_are_those_of_the_specification() {
    let mut b = Builder::triangle();
    let input = b.times(&[1.0, 3.0]);
    // In-tangent, value and out-tangent of each of the two keys.
    let output = b.floats(
        "VEC3",
        &[
            9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, //
            0.0, 3.0, 0.0, 4.0, 0.0, 0.0, 9.0, 9.0, 9.0,
        ],
    );
    b.keyed(json!({"node": 0, "path": "translation"}), input, output, "CUBICSPLINE");
    let rotation = b.floats("VEC4", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0]);
    b.keyed(json!({"node": 0, "path": "rotation"}), input, rotation, "LINEAR");
    let scale = b.floats("VEC3", &[1.0, 1.0, 1.0, 5.0, 5.0, 5.0]);
    b.keyed(json!({"node": 0, "path": "scale"}), input, scale, "STEP");
    let mut scene = b.load("spline").expect("is valid");
    assert_eq!(scene.animations().next(), Some(("Play", 1.0, 3.0)));
    scene.pose(0, 2.0);
    // Halfway: half of the sum of the values, plus an eighth of the span times the difference of the tangents.
    let translation = DVec3::new(2.0 + 0.25, -0.75, 0.0);
    // A quaternion and its negative are the same rotation, so the shortest path between them is no rotation.
    let wanted = DAffine3::from_scale_rotation_translation(DVec3::ONE, DQuat::IDENTITY, translation);
    assert!(scene.instances[0].world_from_model.abs_diff_eq(wanted, 1e-12), "{:?}", scene.instances[0]);
    scene.pose(0, 99.0);
    let wanted = DAffine3::from_scale_rotation_translation(DVec3::splat(5.0), DQuat::IDENTITY, DVec3::X * 4.0);
    assert!(scene.instances[0].world_from_model.abs_diff_eq(wanted, 1e-12), "{:?}", scene.instances[0]);
}
