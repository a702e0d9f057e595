//! Embeds the shaders' SPIR-V in the library, and translates `glsl/shared.glsl` and its includes to Rust, so that both sides
//! read one file. With feature `glsl` it compiles the shaders; otherwise it takes the SPIR-V shipped with the sources.

#[cfg(feature = "glsl")]
#[path = "build/compile.rs"]
mod compile;
#[cfg(not(feature = "glsl"))]
#[path = "build/shipped.rs"]
mod shipped;
#[cfg(feature = "glsl")]
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
        ["shared.glsl", "shared_material.glsl", "shared_rays.glsl", "shared_inside.glsl", "shared_window.glsl"];
    let shared: String = shared.into_iter().map(read).collect();
    fs::write(out.join("shared.rs"), rust_from_glsl(&shared)).expect("write shared.rs");
    write_shaders(&out, &shaders());
}

#[cfg(feature = "glsl")]
fn shaders() -> Vec<(String, Vec<u8>)> {
    let folder = Path::new("glsl");
    let compiled = compile::sources(folder).and_then(|sources| compile::compile(folder, sources.iter()));
    compiled.unwrap_or_else(|error| fail(&error))
}

#[cfg(not(feature = "glsl"))]
fn shaders() -> Vec<(String, Vec<u8>)> {
    let shipped = shipped::read().unwrap_or_else(|error| fail(&format!("{}: {error}", shipped::FILE)));
    if shipped.sources != shipped::sources().unwrap_or_else(|error| fail(&format!("glsl: {error}"))) {
        fail(&format!(
            "{} was built from other sources than glsl/: build with `--features glsl`, which takes ./scripts/setup; \
             `LIGHTSKIN_BLESS=1 cargo test --features glsl -- shipped` renews the file",
            shipped::FILE
        ));
    }
    shipped.shaders
}

/// Writes every shader, and `shaders.rs`: a table of names and SPIR-V.
fn write_shaders(out: &Path, shaders: &[(String, Vec<u8>)]) {
    let mut table = String::from(
        "/// Every entry shader: file name and SPIR-V.\npub(crate) static SHADERS: &[(&str, &[u8])] = &[\n",
    );
    for (name, spirv) in shaders {
        fs::write(out.join(format!("{name}.spv")), spirv).expect("write SPIR-V");
        writeln!(table, "    ({name:?}, include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{name}.spv\"))),")
            .expect("string");
    }
    table.push_str("];\n");
    fs::write(out.join("shaders.rs"), table).expect("write shaders.rs");
}

/// Prints an error in the sources and ends the build.
fn fail(error: &str) -> ! {
    eprintln!("{error}");
    std::process::exit(1);
}

/// Translates the `struct`s and `const`s of `shared.glsl` to Rust, one member a line. The size of each struct is asserted,
/// and `Pod` refuses padding, so a layout other than `scalar` does not compile. Structs are packed to 4 bytes like
/// `scalar`, because glam aligns its four-component types to 16.
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
    // Where the last member begins, behind its documentation.
    let mut member = 0;
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
        // Escape units in brackets: they are not links.
        let doc: String = doc.iter().map(|d| format!("{indent}/// {}\n", d.replace('[', "\\["))).collect();
        if let Some(name) = code.strip_prefix("struct ") {
            let name = name.trim_end_matches('{').trim();
            writeln!(rust, "{doc}#[repr(C, packed(4))]\n#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]\npub struct {name} {{").expect("string");
            open = Some((name.to_owned(), 0));
        } else if code == "};" {
            // Comments behind the last member continue its own.
            rust.insert_str(member, &doc);
            let (name, size) = open.take().unwrap_or_else(|| panic!("{place}: no struct is open"));
            writeln!(rust, "}}\nconst _: () = assert!(size_of::<{name}>() == {size});\n").expect("string");
        } else if let Some((_, size)) = &mut open {
            let (kind, field) =
                code.trim_end_matches(';').split_once(' ').unwrap_or_else(|| panic!("{place}: one member a line"));
            let (kind, bytes) = types.get(kind).unwrap_or_else(|| panic!("{place}: type {kind} has no Rust twin here"));
            *size += bytes;
            rust.push_str(&doc);
            member = rust.len();
            writeln!(rust, "    pub {field}: {kind},").expect("string");
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
