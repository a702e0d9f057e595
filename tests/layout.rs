//! Host and shaders agree on every struct of `glsl/shared.glsl`. The offsets that glslang gives to members are the
//! running sums of the members' sizes. The Rust twins have the same layout: they are packed, and their total size is
//! asserted.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::Path;

/// Structs of the file: name, and members in order with their sizes [bytes].
fn structs(source: &str) -> BTreeMap<String, Vec<(String, u32)>> {
    let sizes = HashMap::from([("float", 4), ("uint", 4), ("vec2", 8), ("vec3", 12), ("vec4", 16), ("mat4", 64)]);
    let mut found = BTreeMap::new();
    let mut open: Option<(String, Vec<(String, u32)>)> = None;
    for line in source.lines() {
        let code = line.split("//").next().unwrap_or_default().trim();
        if let Some(name) = code.strip_prefix("struct ") {
            open = Some((name.trim_end_matches('{').trim().to_owned(), Vec::new()));
        } else if code == "};" {
            found.extend(open.take());
        } else if let (Some((_, members)), Some((kind, name))) = (&mut open, code.trim_end_matches(';').split_once(' '))
        {
            members.push((name.to_owned(), sizes[kind]));
        }
    }
    found
}

/// Offsets of the members of the struct `wanted` in a module.
fn offsets(spirv: &[u32], wanted: &str) -> Vec<u32> {
    // Numbers of instructions and a decoration in the SPIR-V specification.
    const NAME: u32 = 5;
    const MEMBER_DECORATE: u32 = 72;
    const OFFSET: u32 = 35;
    let (mut id, mut found) = (None, BTreeMap::new());
    let mut at = 5;
    while at < spirv.len() {
        let (count, op) = ((spirv[at] >> 16) as usize, spirv[at] & 0xffff);
        let words = &spirv[at + 1..at + count];
        match op {
            NAME => {
                let bytes: Vec<u8> = words[1..].iter().flat_map(|w| w.to_le_bytes()).take_while(|b| *b != 0).collect();
                if bytes == wanted.as_bytes() {
                    id = Some(words[0]);
                }
            }
            MEMBER_DECORATE if Some(words[0]) == id && words[2] == OFFSET => {
                found.insert(words[1], words[3]);
            }
            _ => {}
        }
        at += count;
    }
    found.into_values().collect()
}

/// The file with its included files, which are in the same folder.
fn both(path: &Path) -> String {
    let text = fs::read_to_string(path).expect("shared.glsl");
    ["shared_material.glsl", "shared_rays.glsl", "shared_inside.glsl", "shared_window.glsl"].into_iter().fold(
        text,
        |text, name| {
            let part = fs::read_to_string(path.with_file_name(name)).expect(name);
            text.replace(&format!("#include \"{name}\""), &part)
        },
    )
}

#[test]
fn glslang_places_members_as_rust_does() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl/shared.glsl");
    let source = both(&path);
    let compiler = shaderc::Compiler::new().expect("shaderc");
    let mut options = shaderc::CompileOptions::new().expect("options");
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_optimization_level(shaderc::OptimizationLevel::Zero);
    options.set_generate_debug_info();
    let structs = structs(&source);
    assert!(structs.len() >= 12, "too few structs were found: {:?}", structs.keys());
    for (name, members) in &structs {
        let first = &members[0].0;
        let shader = format!(
            "#version 460\n#extension GL_EXT_scalar_block_layout : require\n{source}\n\
             layout(binding = 0, scalar) buffer A {{ {name} a[2]; }};\n\
             void main() {{ a[0].{first} = a[1].{first}; }}\n"
        );
        let module = compiler
            .compile_into_spirv(&shader, shaderc::ShaderKind::Compute, "layout.comp", "main", Some(&options))
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let before = |i: usize| members[..i].iter().map(|(_, size)| size).sum();
        let expected: Vec<u32> = (0..members.len()).map(before).collect();
        assert_eq!(offsets(module.as_binary(), name), expected, "{name}: {members:?}");
    }
}

#[test]
fn rust_sizes_are_the_sums_of_their_members() {
    use lightskin::shared;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl/shared.glsl");
    let structs = structs(&both(&path));
    let sizes = [
        ("Val", size_of::<shared::Val>()),
        ("Cache", size_of::<shared::Cache>()),
        ("ModelCache", size_of::<shared::ModelCache>()),
        ("Proxy", size_of::<shared::Proxy>()),
        ("Light", size_of::<shared::Light>()),
        ("LightView", size_of::<shared::LightView>()),
        ("Material", size_of::<shared::Material>()),
        ("DrawPush", size_of::<shared::DrawPush>()),
    ];
    for (name, size) in sizes {
        let sum: u32 = structs[name].iter().map(|(_, bytes)| bytes).sum();
        assert_eq!(size, sum as usize, "{name}");
    }
    assert_eq!(std::mem::offset_of!(shared::Val, flux), 32);
    assert_eq!(std::mem::offset_of!(shared::Proxy, glossy_irradiance), 44);
}

/// Every comment within a struct documents a member of its Rust twin.
#[test]
fn members_keep_their_comments() {
    let rust = include_str!(concat!(env!("OUT_DIR"), "/shared.rs"));
    let glsl = both(&Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl/shared.glsl"));
    let (mut inside, mut lines) = (false, 0);
    for line in glsl.lines() {
        inside = (inside || line.starts_with("struct ")) && !line.starts_with("};");
        let Some((_, comment)) = line.split_once("//").filter(|_| inside) else { continue };
        let doc = format!("    /// {}\n", comment.trim().replace('[', "\\["));
        assert!(rust.contains(&doc), "shared.rs lacks the comment of: {line}");
        lines += 1;
    }
    assert!(lines > 50, "{lines} comments");
}
