//! Helpers that several test modules use.

pub(crate) mod frames;
mod gpu;
#[cfg(feature = "app")]
pub(crate) mod window;

pub(crate) use gpu::{Turn, apart, assert_clean, compile, frame_of, from_spirv, gpu, map_on_gpu, open, rounding};

use std::fs;
use std::path::{Path, PathBuf};

use lightskin::scene::{self, Scene};
use serde_json::{Value, json};

/// The folder of test data from `LIGHTSKIN_DATA`. Without it, tests that need the data return and print that they were
/// skipped.
pub(crate) fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("LIGHTSKIN_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: LIGHTSKIN_DATA does not name the folder of test data");
    }
    folder
}

/// All .gltf and .glb files below a folder, sorted.
pub(crate) fn gltf_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("test data is readable") {
            let path = entry.expect("test data is readable").path();
            match path.extension().and_then(|e| e.to_str()) {
                _ if path.is_dir() => folders.push(path),
                Some("gltf" | "glb") => files.push(path),
                _ => {}
            }
        }
    }
    files.sort();
    files
}

/// A GLB file from JSON and a binary chunk.
pub(crate) fn glb(json: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut bytes = b"glTF".to_vec();
    for word in [2, (28 + json.len() + binary.len()) as u32, json.len() as u32] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

/// Writes a file for one test. No other test may use this name.
pub(crate) fn written(name: &str, bytes: &[u8]) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::create_dir_all(path.parent().expect("has a folder")).expect("the target folder is writable");
    fs::write(&path, bytes).expect("the target folder is writable");
    path
}

/// Loads a scene from JSON and one binary buffer.
pub(crate) fn load(name: &str, json: &Value, binary: &[u8]) -> lightskin::Result<Scene> {
    scene::gltf::load(&written(&format!("{name}.glb"), &glb(json, binary)))
}

/// Builds a GLB file from JSON and a binary chunk.
pub(crate) struct Builder {
    pub(crate) json: Value,
    pub(crate) binary: Vec<u8>,
}

impl Builder {
    /// A file with one node, one mesh and one primitive without attributes.
    pub(crate) fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"name": "Wall", "primitives": [{"attributes": {}}]}],
            "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}],
        });
        Self { json, binary: Vec::new() }
    }

    /// An indexed triangle (0,0,0) (1,0,0) (0,1,0).
    pub(crate) fn triangle() -> Self {
        let mut builder = Self::new();
        let positions = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        builder.attribute("POSITION", "VEC3", &positions);
        let indices = builder.accessor(5123, "SCALAR", 3, &[0, 0, 1, 0, 2, 0]);
        builder.primitive()["indices"] = json!(indices);
        builder
    }

    pub(crate) fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()});
        self.binary.extend(bytes);
        self.json["buffers"][0]["byteLength"] = json!(self.binary.len());
        self.push("bufferViews", view)
    }

    pub(crate) fn push(&mut self, list: &str, value: Value) -> usize {
        if self.json[list].is_null() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().expect("is a list");
        list.push(value);
        list.len() - 1
    }

    pub(crate) fn accessor(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "componentType": component, "type": kind, "count": count});
        self.push("accessors", accessor)
    }

    pub(crate) fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(5126, kind, values.len() / width, &bytes)
    }

    pub(crate) fn attribute(&mut self, name: &str, kind: &str, values: &[f32]) -> usize {
        let accessor = self.floats(kind, values);
        self.primitive()["attributes"][name] = json!(accessor);
        accessor
    }

    pub(crate) fn load(&self, name: &str) -> lightskin::Result<Scene> {
        load(name, &self.json, &self.binary)
    }

    /// Loads the file, which must fail with a message of one line, and returns the message.
    pub(crate) fn error(&self, name: &str) -> String {
        one_line(self.load(name).expect_err("should be refused"))
    }
}

/// An error's message, which must be one line.
pub(crate) fn one_line(error: lightskin::Error) -> String {
    let message = error.to_string();
    assert!(!message.contains(['\n', '\r']), "more than one line: {message:?}");
    message
}

/// A PNG with one black and one white texel.
pub(crate) const PNG: &[u8] = b"\x89PNG\x0D\x0A\x1A\x0A\x00\x00\x00\x0DIHDR\x00\x00\x00\x02\x00\x00\x00\x01\x08\x06\x00\x00\x00\xF4\x22\x7F\x8A\x00\x00\x00\x0EIDATx\x9Cc```\xF8\x0F\x02\x00\x0E\xFA\x04\xFCE\xB0\x1D\x8B\x00\x00\x00\x00IEND\xAEB`\x82";
