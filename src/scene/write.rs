//! Scene -> GLB: glTF 2.0 in one binary file, positions and normals as plain floats, with deterministic bytes.

mod keys;
mod rig;
mod surface;
mod values;

use super::Scene;
use crate::error::{Error, Result};
use crate::files;
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// glTF's codes for the float component type and for a vertex buffer.
const FLOAT: u32 = 5126;
const VERTICES: u32 = 34962;

/// Writes the scene as a GLB file.
///
/// Triangles of a double-sided material are written once; `doubleSided` implies the second side. An animated scene is
/// written at rest with its animations; animations without channels are left out. Images are embedded as PNG. glTF has
/// no skies, so a sky and the lights that represent it are left out. Deforming meshes with subdivided triangles are
/// refused.
///
/// # Errors
/// Fails if a file cannot be written, or an image has no texels.
pub fn write_glb(scene: &Scene, path: &Path) -> Result<()> {
    let failed = |reason: String| Error::Output { file: path.to_path_buf(), reason };
    let bytes = glb_bytes(scene).map_err(failed)?;
    files::write(path, &bytes)
}

/// The JSON lists and the binary chunk under construction.
#[derive(Default)]
struct Document {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    extensions: BTreeSet<&'static str>,
    /// Animation keys, which accessors may share, and these accessors by content.
    keys: Vec<u8>,
    known_keys: BTreeMap<keys::Known, usize>,
    textures: values::Textures,
}

fn glb_bytes(scene: &Scene) -> std::result::Result<Vec<u8>, String> {
    let mut at_rest = scene.clone();
    at_rest.rest();
    if let Some(sky) = at_rest.sky.take() {
        at_rest.lights.drain(sky.lights);
    }
    let scene = &at_rest;
    let mut document = Document::default();
    let rest = values::rest(scene);
    let indexed = scene.materials.iter().enumerate();
    let materials: Vec<Value> = indexed.map(|(i, m)| values::material(&mut document, i, m, &rest)).collect();
    let mut meshes = Vec::new();
    for mesh in &scene.meshes {
        meshes.push(surface::mesh(&mut document, scene, mesh)?);
    }
    let pictures: Vec<_> = scene.images.par_iter().map(|i| crate::image::png(i.width, i.height, &i.rgba)).collect();
    let mut images = Vec::new();
    for (image, png) in scene.images.iter().zip(pictures) {
        let view = document.view(&png.map_err(|reason| format!("image '{}': {reason}", image.name))?);
        images.push(json!({ "name": image.name, "mimeType": "image/png", "bufferView": view }));
    }
    let tree = rig::Tree::new(&mut document, scene)?;
    let skins = rig::skins(&mut document, scene);
    let animations = keys::animations(&mut document, scene, &tree)?;

    if u32::try_from(document.binary.len()).is_err() {
        return Err("vertices and images exceed 4 GiB, the limit of GLB; split the scene".into());
    }
    let mut root = Map::new();
    root.insert("asset".into(), json!({ "version": "2.0", "generator": "lightskin" }));
    root.insert("scene".into(), json!(0));
    let mut only_scene = json!({ "name": scene.name });
    if !tree.roots.is_empty() {
        only_scene["nodes"] = json!(tree.roots);
    }
    root.insert("scenes".into(), json!([only_scene]));
    if !scene.lights.is_empty() {
        let lights: Vec<Value> = scene.lights.iter().enumerate().map(|(i, l)| values::light(i, l, &rest)).collect();
        root.insert("extensions".into(), json!({ "KHR_lights_punctual": { "lights": lights } }));
    }
    let lists = [
        ("nodes", tree.nodes),
        ("meshes", meshes),
        ("skins", skins),
        ("animations", animations),
        ("materials", materials),
        ("images", images),
        ("textures", document.textures.list),
        ("samplers", document.textures.samplers),
        ("cameras", scene.cameras.iter().map(values::camera).collect()),
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

/// A GLB file: header and two chunks, each padded to four bytes.
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

impl Document {
    fn accessor(&mut self, data: &[u8], target: u32, component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(data);
        self.views[view]["target"] = json!(target);
        self.accessors.push(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }));
        self.accessors.len() - 1
    }

    /// Adds a buffer view for some bytes.
    fn view(&mut self, data: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let (offset, length) = (self.binary.len(), data.len());
        self.binary.extend_from_slice(data);
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length }));
        self.views.len() - 1
    }
}
