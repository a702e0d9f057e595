//! Scene -> GLB: glTF 2.0 in one binary file, positions and normals as plain floats, the same bytes every time.

use super::{Camera, Light, LightKind, Material, Mesh, Primitive, Projection, Scene, Vertex};
use crate::error::{Error, Result};
use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3, Vec4};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Writes the scene as a GLB file, first under a temporary name beside it.
///
/// A double-sided material's triangles are written once, its second side is what `doubleSided` says. Scenes with
/// images are refused: scenes made in code have none.
pub fn write_glb(scene: &Scene, path: &Path) -> Result<()> {
    let failed = |reason: String| Error::Output { file: path.to_path_buf(), reason };
    let bytes = glb_bytes(scene).map_err(failed)?;
    let temporary = temporary_name(path).ok_or_else(|| failed("it names no file; give a file name".into()))?;
    std::fs::write(&temporary, bytes).and_then(|()| std::fs::rename(&temporary, path)).map_err(|error| {
        // What was written so far is of no use; if it cannot be removed either, the first error still tells why.
        let _ = std::fs::remove_file(&temporary);
        failed(format!("{error}; is the folder there and writable?"))
    })
}

fn temporary_name(path: &Path) -> Option<PathBuf> {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name()?);
    name.push(format!(".{}.part", std::process::id()));
    Some(path.with_file_name(name))
}

/// The JSON lists and the binary chunk as they grow.
#[derive(Default)]
struct Document {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    extensions: BTreeSet<&'static str>,
}

fn glb_bytes(scene: &Scene) -> std::result::Result<Vec<u8>, String> {
    if !scene.images.is_empty() {
        return Err("the scene has images, which this writer does not know; write it with a glTF tool".into());
    }
    let mut document = Document::default();
    let materials: Vec<Value> = scene.materials.iter().map(|m| material(&mut document, m)).collect();
    let mut meshes = Vec::new();
    for mesh in &scene.meshes {
        let runs = written_runs(scene, mesh);
        let primitives: Vec<Value> = runs.into_iter().map(|run| primitive(&mut document, mesh, run)).collect();
        meshes.push(json!({ "name": mesh.name, "primitives": primitives }));
    }

    let mut nodes: Vec<Value> = scene
        .instances
        .iter()
        .map(|instance| node(&instance.name, instance.world_from_model, [("mesh", json!(instance.mesh))]))
        .collect();
    for (index, light) in scene.lights.iter().enumerate() {
        let turn = DQuat::from_rotation_arc(DVec3::NEG_Z, light.direction.as_dvec3().normalize_or(DVec3::NEG_Z));
        let position = if light.kind == LightKind::Directional { DVec3::ZERO } else { light.position };
        let place = DAffine3::from_rotation_translation(turn, position);
        let reference = json!({ "KHR_lights_punctual": { "light": index } });
        nodes.push(node(&light.name, place, [("extensions", reference)]));
        document.extensions.insert("KHR_lights_punctual");
    }
    for (index, camera) in scene.cameras.iter().enumerate() {
        nodes.push(node(&camera.name, camera.world_from_camera, [("camera", json!(index))]));
    }

    if u32::try_from(document.binary.len()).is_err() {
        return Err("more than 4 GiB of vertices, which GLB cannot hold; split the scene".into());
    }
    let mut root = Map::new();
    root.insert("asset".into(), json!({ "version": "2.0", "generator": "lightskin" }));
    root.insert("scene".into(), json!(0));
    let roots: Vec<usize> = (0..nodes.len()).collect();
    let mut only_scene = json!({ "name": scene.name });
    if !roots.is_empty() {
        only_scene["nodes"] = json!(roots);
    }
    root.insert("scenes".into(), json!([only_scene]));
    if !scene.lights.is_empty() {
        let lights: Vec<Value> = scene.lights.iter().map(light).collect();
        root.insert("extensions".into(), json!({ "KHR_lights_punctual": { "lights": lights } }));
    }
    let lists = [
        ("nodes", nodes),
        ("meshes", meshes),
        ("materials", materials),
        ("cameras", scene.cameras.iter().map(camera).collect()),
        ("accessors", document.accessors),
        ("bufferViews", document.views),
        ("extensionsUsed", document.extensions.into_iter().map(Value::from).collect()),
    ];
    for (key, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
        root.insert(key.into(), list.into());
    }
    if !document.binary.is_empty() {
        root.insert("buffers".into(), json!([{ "byteLength": document.binary.len() }]));
    }
    Ok(container(Value::Object(root).to_string().into_bytes(), document.binary))
}

/// The two chunks of a GLB file behind its header; lengths are padded to four bytes.
fn container(mut text: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    text.resize(text.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let chunks: Vec<_> = [(*b"JSON", text), (*b"BIN\0", binary)].into_iter().filter(|c| !c.1.is_empty()).collect();
    let length: usize = 12 + chunks.iter().map(|(_, data)| 8 + data.len()).sum::<usize>();
    let mut bytes = b"glTF".to_vec();
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend((length as u32).to_le_bytes());
    for (kind, data) in chunks {
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(data);
    }
    bytes
}

/// What of a mesh goes into the file: all of it but the second sides of double-sided materials.
///
/// A second side is either the primitive right after its first side or the second half of a primitive.
fn written_runs(scene: &Scene, mesh: &Mesh) -> Vec<Primitive> {
    let mut runs = Vec::new();
    let mut rest = mesh.primitives.as_slice();
    while let [run, following @ ..] = rest {
        rest = following;
        let mut run = *run;
        let indices = |p: &Primitive| &mesh.indices[p.first_index as usize..(p.first_index + p.index_count) as usize];
        if scene.materials[run.material].double_sided {
            let (first, second) = indices(&run).split_at(indices(&run).len() / 6 * 3);
            if following
                .first()
                .is_some_and(|next| next.material == run.material && is_back(mesh, indices(&run), indices(next)))
            {
                rest = &following[1..];
            } else if is_back(mesh, first, second) {
                run.index_count /= 2;
            }
        }
        if run.index_count > 0 {
            runs.push(run);
        }
    }
    runs
}

/// Whether `back` holds the triangles of `front` in the same order, each wound the other way round.
fn is_back(mesh: &Mesh, front: &[u32], back: &[u32]) -> bool {
    let at = |index: u32| mesh.vertices[index as usize].position;
    front.len() == back.len()
        && front.chunks_exact(3).zip(back.chunks_exact(3)).all(|(f, b)| {
            let reversed = [at(f[0]), at(f[2]), at(f[1])];
            (0..3).any(|turn| (0..3).all(|corner| at(b[corner]) == reversed[(corner + turn) % 3]))
        })
}

/// A primitive with vertices of its own: those it uses, in their order.
fn primitive(document: &mut Document, mesh: &Mesh, run: Primitive) -> Value {
    let indices = &mesh.indices[run.first_index as usize..(run.first_index + run.index_count) as usize];
    let used: Vec<u32> = indices.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    let vertices: Vec<Vertex> = used.iter().map(|&index| mesh.vertices[index as usize]).collect();
    let local = |index: &u32| used.binary_search(index).expect("collected above");

    let low = vertices.iter().fold(Vec3::INFINITY, |low, v| low.min(v.position));
    let high = vertices.iter().fold(Vec3::NEG_INFINITY, |high, v| high.max(v.position));
    let mut attributes = Map::new();
    let mut attribute = |document: &mut Document, name: &str, kind: &str, data: &[u8]| {
        let byte = name == "COLOR_0";
        let component = if byte { 5121 } else { 5126 };
        let accessor = document.accessor(data, 34962, component, kind, vertices.len());
        if name == "POSITION" {
            document.accessors[accessor]["min"] = json!(low.to_array());
            document.accessors[accessor]["max"] = json!(high.to_array());
        }
        if byte {
            document.accessors[accessor]["normalized"] = json!(true);
        }
        attributes.insert(name.into(), json!(accessor));
    };
    let vec3 = |get: fn(&Vertex) -> Vec3| vertices.iter().map(get).collect::<Vec<_>>();
    let vec2 = |get: fn(&Vertex) -> Vec2| vertices.iter().map(get).collect::<Vec<_>>();
    attribute(document, "POSITION", "VEC3", bytemuck::cast_slice(&vec3(|v| v.position)));
    attribute(document, "NORMAL", "VEC3", bytemuck::cast_slice(&vec3(|v| v.normal)));
    if vertices.iter().any(|v| v.tangent != [0.0; 4]) {
        let tangents: Vec<[f32; 4]> = vertices.iter().map(|v| v.tangent).collect();
        attribute(document, "TANGENT", "VEC4", bytemuck::cast_slice(&tangents));
    }
    let has_second = vertices.iter().any(|v| v.uv1 != Vec2::ZERO);
    if has_second || vertices.iter().any(|v| v.uv0 != Vec2::ZERO) {
        attribute(document, "TEXCOORD_0", "VEC2", bytemuck::cast_slice(&vec2(|v| v.uv0)));
    }
    if has_second {
        attribute(document, "TEXCOORD_1", "VEC2", bytemuck::cast_slice(&vec2(|v| v.uv1)));
    }
    if vertices.iter().any(|v| v.color != [255; 4]) {
        let colors: Vec<[u8; 4]> = vertices.iter().map(|v| v.color).collect();
        attribute(document, "COLOR_0", "VEC4", bytemuck::cast_slice(&colors));
    }

    // 65535 itself is the restart index and not allowed.
    let index_accessor = if vertices.len() <= 65535 {
        let short: Vec<u16> = indices.iter().map(|index| local(index) as u16).collect();
        document.accessor(bytemuck::cast_slice(&short), 34963, 5123, "SCALAR", indices.len())
    } else {
        let long: Vec<u32> = indices.iter().map(|index| local(index) as u32).collect();
        document.accessor(bytemuck::cast_slice(&long), 34963, 5125, "SCALAR", indices.len())
    };
    json!({ "attributes": attributes, "indices": index_accessor, "material": run.material })
}

impl Document {
    fn accessor(&mut self, data: &[u8], target: u32, component: u32, kind: &str, count: usize) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let (offset, length) = (self.binary.len(), data.len());
        self.binary.extend_from_slice(data);
        let view = self.views.len();
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length, "target": target }));
        self.accessors.push(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }));
        self.accessors.len() - 1
    }
}

/// A root node; translation, rotation and scale where they say it all, a matrix where they do not.
fn node<const N: usize>(name: &str, world: DAffine3, members: [(&str, Value); N]) -> Value {
    let mut node = json!({ "name": name });
    for (key, value) in members {
        node[key] = value;
    }
    let (scale, rotation, translation) = world.to_scale_rotation_translation();
    let again = DAffine3::from_scale_rotation_translation(scale, rotation, translation);
    if !again.matrix3.abs_diff_eq(world.matrix3, 1e-9 * scale.abs().max_element()) {
        let matrix = glam::DMat4::from(world);
        node["matrix"] = json!(matrix.to_cols_array());
        return node;
    }
    if translation != DVec3::ZERO {
        node["translation"] = json!(translation.to_array());
    }
    if rotation.angle_between(DQuat::IDENTITY) > 0.0 {
        node["rotation"] = json!(rotation.to_array());
    }
    if !scale.abs_diff_eq(DVec3::ONE, 1e-9) {
        node["scale"] = json!(scale.to_array());
    }
    node
}

fn material(document: &mut Document, material: &Material) -> Value {
    let mut value = json!({
        "name": material.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": material.base_color.to_array(),
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        },
    });
    if material.base_color == Vec4::ONE {
        value["pbrMetallicRoughness"].as_object_mut().expect("made above").remove("baseColorFactor");
    }
    if material.double_sided {
        value["doubleSided"] = json!(true);
    }
    if let Some(cutoff) = material.alpha_cutoff {
        value["alphaMode"] = json!("MASK");
        value["alphaCutoff"] = json!(cutoff);
    }
    let mut extend = |name: &'static str, members: Value| {
        document.extensions.insert(name);
        value["extensions"][name] = members;
    };
    // The core's factor ends at 1; what is brighter is told by its largest channel.
    let strength = material.emissive.max_element().max(1.0);
    if strength > 1.0 {
        extend("KHR_materials_emissive_strength", json!({ "emissiveStrength": strength }));
    }
    if material.ior != 1.5 {
        extend("KHR_materials_ior", json!({ "ior": material.ior }));
    }
    if material.specular != 1.0 || material.specular_color != Vec3::ONE {
        let factors = json!({
            "specularFactor": material.specular,
            "specularColorFactor": material.specular_color.to_array(),
        });
        extend("KHR_materials_specular", factors);
    }
    if material.emissive != Vec3::ZERO {
        value["emissiveFactor"] = json!((material.emissive / strength).to_array());
    }
    if let Some(phong) = material.phong {
        let lobe = json!({ "specular": phong.specular.to_array(), "exponent": phong.exponent });
        value["extras"] = json!({ "lightskin": { "phong": lobe } });
    }
    value
}

fn light(light: &Light) -> Value {
    let kind = match light.kind {
        LightKind::Directional => "directional",
        LightKind::Point => "point",
        LightKind::Spot { .. } => "spot",
    };
    let mut value = json!({
        "name": light.name,
        "type": kind,
        "color": light.color.to_array(),
        "intensity": light.intensity,
    });
    if let LightKind::Spot { inner, outer } = light.kind {
        value["spot"] = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
    }
    if let Some(range) = light.range {
        value["range"] = json!(range);
    }
    value
}

/// The engine takes the near plane from the scene, not from here; glTF wants one all the same.
fn camera(camera: &Camera) -> Value {
    let mut value = match camera.projection {
        Projection::Perspective { yfov } => {
            json!({ "type": "perspective", "perspective": { "yfov": yfov, "znear": 0.05 } })
        }
        Projection::Orthographic { ymag } => json!({
            "type": "orthographic",
            "orthographic": { "xmag": ymag, "ymag": ymag, "znear": 0.0, "zfar": 1000.0 },
        }),
    };
    value["name"] = json!(camera.name);
    value
}
