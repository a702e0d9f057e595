//! House rules that no compiler checks: dependencies of modules, the place of unsafe code, file lengths, and that our
//! own code makes the committed scenes.

use lightskin::scene::build::{CornellSurface, atrium, cornell};
use lightskin::scene::{Scene, gltf};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn files(folder: &str, extensions: &[&str]) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("source folder") {
            let path = entry.expect("entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().and_then(|e| e.to_str()).is_some_and(|e| extensions.contains(&e)) {
                let content = fs::read_to_string(&path).expect("source file");
                found.push((path, content));
            }
        }
    }
    assert!(!found.is_empty(), "{folder} must hold sources");
    found
}

#[test]
fn modules_depend_one_way() {
    let rules: [(&str, &[&str]); 6] = [
        ("src/gpu", &["crate::frame", "crate::scene", "crate::bake", "crate::shared"]),
        ("src/scene", &["crate::gpu", "crate::frame", "crate::bake", "ash::vk"]),
        ("src/bake", &["crate::gpu", "crate::frame", "ash::vk"]),
        ("src/frame", &[]),
        ("src/reference", &["crate::gpu", "crate::frame", "crate::bake", "ash::vk"]),
        ("src/metrics", &["crate::gpu", "crate::frame", "crate::bake", "crate::scene", "ash::vk"]),
    ];
    // Modules that measure the engine or show it to users are above it.
    let tools = ["crate::app", "crate::lab", "crate::cli", "crate::metrics", "crate::reference"];
    let engine = ["src/gpu", "src/scene", "src/bake", "src/frame"];
    for (folder, forbidden) in rules {
        for (path, content) in files(folder, &["rs"]) {
            let above = tools.iter().filter(|_| engine.contains(&folder));
            for word in forbidden.iter().chain(above) {
                assert!(!content.contains(word), "{} must not use {word}", path.display());
            }
        }
    }
}

/// Files of the frame import each other by name, without cycles and never through `mod.rs`. The files of `world` count
/// as one.
#[test]
fn nothing_in_the_frame_imports_upwards() {
    let mut imports: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (path, content) in files("src/frame", &["rs"]) {
        let in_world = path.components().any(|c| c.as_os_str() == "world");
        let name = path.file_stem().and_then(|s| s.to_str()).expect("a name");
        if name == "mod" && !in_world {
            continue;
        }
        let own = imports.entry(if in_world { "world" } else { name }.to_owned()).or_default();
        // Within `world`, `super` is `world` itself, except in its `mod.rs`.
        let from = if in_world && name != "mod" { "use crate::frame::" } else { "use super::" };
        for rest in content.lines().filter_map(|line| line.trim().trim_start_matches("pub ").strip_prefix(from)) {
            let other = rest.split(|c: char| !(c.is_lowercase() || c == '_')).next().expect("a name");
            assert!(!other.is_empty(), "{}: `{from}{rest}` goes through mod.rs", path.display());
            own.insert(other.to_owned());
        }
    }
    // In each round, add the files that import only files below them. If there are none, the remaining files form a
    // cycle.
    let mut below: BTreeSet<String> = BTreeSet::new();
    while below.len() < imports.len() {
        let next: Vec<_> = imports.iter().filter(|(name, of)| !below.contains(*name) && of.is_subset(&below)).collect();
        let left: Vec<_> = imports.keys().filter(|name| !below.contains(*name)).collect();
        assert!(!next.is_empty(), "these import each other: {left:?}");
        below.extend(next.into_iter().map(|(name, _)| name.clone()).collect::<Vec<_>>());
    }
}

/// Dependencies of a program that uses the library without default features.
#[test]
fn the_engine_alone_needs_no_tools() {
    let tree = ["tree", "--offline", "--no-default-features", "--edges", "normal", "--prefix", "none"];
    let folder = env!("CARGO_MANIFEST_DIR");
    let output = std::process::Command::new(env!("CARGO")).args(tree).current_dir(folder).output().expect("cargo");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let listed = String::from_utf8(output.stdout).expect("names");
    assert!(listed.lines().any(|line| line.starts_with("ash ")), "{listed}");
    for tool in
        ["anyhow", "clap", "egui", "indicatif", "nv-flip", "pulp", "raw-cpuid", "rfd", "signal-hook", "toml", "winit"]
    {
        let needed = listed.lines().any(|line| line.split(' ').next() == Some(tool));
        assert!(!needed, "the engine compiles {tool}; `cargo tree --no-default-features -i {tool}` shows why");
    }
}

#[test]
fn unsafe_code_lies_in_gpu_alone() {
    for (path, content) in files("src", &["rs"]) {
        let in_gpu = path.components().any(|c| c.as_os_str() == "gpu");
        assert!(in_gpu || !content.contains("unsafe {"), "{} contains unsafe code", path.display());
    }
}

#[test]
fn files_stay_readable() {
    let rust = ["src", "tests", "build", "examples"].into_iter().flat_map(|folder| files(folder, &["rs"]));
    for (path, content) in rust.chain(files("glsl", &["glsl", "vert", "frag", "comp"])) {
        let lines = content.lines().count();
        assert!(lines <= 600, "{} has {lines} lines: can it be divided?", path.display());
    }
}

/// Compares up to rounding, because the sine of another C library may differ in its last bit.
fn assert_same(file: &str, made: &Scene) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets").join(file);
    let kept = gltf::load(&path).expect("the committed scene loads");
    assert_eq!(kept.triangle_count(), made.triangle_count(), "{file}: run `lightskin assets`");
    assert_eq!(kept.instances.len(), made.instances.len());
    assert_eq!((kept.lights.len(), kept.cameras.len()), (made.lights.len(), made.cameras.len()));
    for (k, m) in kept.instances.iter().zip(&made.instances) {
        assert!(k.world_from_model.abs_diff_eq(m.world_from_model, 1e-5), "{file}: {}", k.name);
        let (k, m) = (&kept.meshes[k.mesh], &made.meshes[m.mesh]);
        assert_eq!(k.vertices.len(), m.vertices.len(), "{file}: {}", k.name);
        let near = k.vertices.iter().zip(&m.vertices).all(|(k, m)| k.position.abs_diff_eq(m.position, 1e-4));
        assert!(near, "{file}: {} differs; run `lightskin assets`", k.name);
    }
}

#[test]
fn committed_scenes_are_made_by_our_code() {
    assert_same("atrium.glb", &atrium());
    assert_same("cornell_diffuse.glb", &cornell(CornellSurface::Diffuse, 0.05));
    assert_same("cornell_glossy.glb", &cornell(CornellSurface::Glossy, 0.05));
}
