//! Compiles `glsl/` to SPIR-V with glslang and turns `glsl/shared.glsl` with what it includes into Rust, so that both sides
//! read one file. A shader error is a build error with file and line.

#[path = "build/variants.rs"]
mod variants;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-changed=glsl");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=build");
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    let read = |name: &str| fs::read_to_string(Path::new("glsl").join(name)).expect(name);
    let shared =
        read("shared.glsl") + &read("shared_material.glsl") + &read("shared_rays.glsl") + &read("shared_inside.glsl");
    fs::write(out.join("shared.rs"), rust_from_glsl(&shared)).expect("write shared.rs");
    compile_shaders(&out);
}

/// Stands before every entry shader.
const PREAMBLE: &str =
    "#version 460\n#extension GL_GOOGLE_include_directive : require\n#extension GL_EXT_scalar_block_layout : require\n";

/// Compiles every `glsl/*.{vert,frag,comp}` with all variants of it, and writes `shaders.rs`: a table of name and words.
fn compile_shaders(out: &Path) {
    let compiler = shaderc::Compiler::new().expect("shaderc; run ./scripts/setup");
    let mut options = shaderc::CompileOptions::new().expect("shaderc options");
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_optimization_level(shaderc::OptimizationLevel::Performance);
    options.set_generate_debug_info();
    options.set_warnings_as_errors();
    options.set_include_callback(|name, _kind, _from, _depth| {
        let path = Path::new("glsl").join(name);
        let content = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(shaderc::ResolvedInclude { resolved_name: path.display().to_string(), content })
    });

    let paths = fs::read_dir("glsl").expect("glsl").map(|e| e.expect("glsl entry").path());
    let files: Vec<(String, String)> = paths
        .filter(|path| kind(path).is_some())
        .map(|path| {
            let name = path.file_name().and_then(|n| n.to_str()).expect("shader file name").to_owned();
            (name, fs::read_to_string(&path).expect("shader source"))
        })
        .collect();
    let entries = variants::entries(&files).unwrap_or_else(|error| fail(&error));
    let sources: BTreeMap<_, _> = files.into_iter().collect();
    let mut table = String::from(
        "/// Every entry shader: file name and SPIR-V.\npub(crate) static SHADERS: &[(&str, &[u8])] = &[\n",
    );
    for (name, entry) in entries {
        let path = Path::new("glsl").join(&entry.file);
        let defines: String = entry.defines.iter().map(|define| format!("#define {define}\n")).collect();
        let source = format!("{PREAMBLE}{defines}#line 1\n{}", sources[&entry.file]);
        let kind = kind(&path).expect("an entry shader");
        match compiler.compile_into_spirv(&source, kind, &path.display().to_string(), "main", Some(&options)) {
            Ok(artifact) => {
                fs::write(out.join(format!("{name}.spv")), artifact.as_binary_u8()).expect("write SPIR-V");
                writeln!(table, "    ({name:?}, include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{name}.spv\"))),")
                    .expect("string");
            }
            Err(error) => fail(&format!("{name}: {error}")),
        }
    }
    table.push_str("];\n");
    fs::write(out.join("shaders.rs"), table).expect("write shaders.rs");
}

/// Stage of an entry shader; other files are included by these.
fn kind(path: &Path) -> Option<shaderc::ShaderKind> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("vert") => Some(shaderc::ShaderKind::Vertex),
        Some("frag") => Some(shaderc::ShaderKind::Fragment),
        Some("comp") => Some(shaderc::ShaderKind::Compute),
        _ => None,
    }
}

/// A shader's error is the build's.
fn fail(error: &str) -> ! {
    eprintln!("{error}");
    std::process::exit(1);
}

/// Reads `struct`s and `const`s of `shared.glsl`, one member a line, and writes their Rust twins. The size of each
/// is asserted, and `Pod` refuses padding, so a layout that differs from `scalar` does not compile. Packed to 4 bytes, as
/// `scalar` packs: glam aligns its four-component types to 16.
fn rust_from_glsl(glsl: &str) -> String {
    let types: BTreeMap<&str, (&str, usize)> = BTreeMap::from([
        ("float", ("f32", 4)),
        ("uint", ("u32", 4)),
        ("int", ("i32", 4)),
        ("vec2", ("glam::Vec2", 8)),
        ("vec3", ("glam::Vec3", 12)),
        ("vec4", ("glam::Vec4", 16)),
        ("mat4", ("glam::Mat4", 64)),
        ("uvec2", ("glam::UVec2", 8)),
        ("uvec4", ("[u32; 4]", 16)),
    ]);
    let mut rust = String::from("// Made by build.rs from glsl/shared.glsl.\n\n");
    let mut docs: Vec<String> = Vec::new();
    let mut open: Option<(String, usize)> = None;
    for (number, line) in glsl.lines().enumerate() {
        let place = format!("glsl/shared.glsl:{}", number + 1);
        let line = line.trim();
        let (code, comment) = line.split_once("//").map_or((line, None), |(c, d)| (c.trim(), Some(d.trim())));
        if code.is_empty() {
            match comment {
                Some(text) => docs.push(text.to_owned()),
                None => docs.clear(),
            }
            continue;
        }
        let indent = if open.is_some() { "    " } else { "" };
        let mut doc: Vec<String> = std::mem::take(&mut docs);
        doc.extend(comment.map(str::to_owned));
        // Units in brackets are no links.
        let doc: String = doc.iter().map(|d| format!("{indent}/// {}\n", d.replace('[', "\\["))).collect();
        if let Some(name) = code.strip_prefix("struct ") {
            let name = name.trim_end_matches('{').trim();
            writeln!(rust, "{doc}#[repr(C, packed(4))]\n#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]\npub struct {name} {{").expect("string");
            open = Some((name.to_owned(), 0));
        } else if code == "};" {
            let (name, size) = open.take().unwrap_or_else(|| panic!("{place}: no struct is open"));
            writeln!(rust, "}}\nconst _: () = assert!(size_of::<{name}>() == {size});\n").expect("string");
        } else if let Some((_, size)) = &mut open {
            let (kind, field) =
                code.trim_end_matches(';').split_once(' ').unwrap_or_else(|| panic!("{place}: one member a line"));
            let (kind, bytes) = types.get(kind).unwrap_or_else(|| panic!("{place}: type {kind} has no Rust twin here"));
            *size += bytes;
            writeln!(rust, "{doc}    pub {field}: {kind},").expect("string");
        } else if let Some(rest) = code.strip_prefix("const ") {
            let (kind, rest) = rest.split_once(' ').unwrap_or_else(|| panic!("{place}: const TYPE NAME = VALUE;"));
            let (name, value) =
                rest.trim_end_matches(';').split_once('=').unwrap_or_else(|| panic!("{place}: const without a value"));
            let (kind, _) = types.get(kind).unwrap_or_else(|| panic!("{place}: type {kind} has no Rust twin here"));
            let value = value.trim().trim_end_matches('u');
            writeln!(rust, "{doc}pub const {}: {kind} = {value};\n", name.trim()).expect("string");
        } else if !code.starts_with('#') {
            panic!("{place}: neither struct, member, const nor preprocessor line: {code}");
        }
    }
    rust
}
