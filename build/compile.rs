//! Compiles `glsl/` with glslang, for feature `glsl`. A shader error is a build error with file and line.

use super::{fail, variants};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Source text before every entry shader.
const PREAMBLE: &str =
    "#version 460\n#extension GL_GOOGLE_include_directive : require\n#extension GL_EXT_scalar_block_layout : require\n";

/// Compiles every `glsl/*.{vert,frag,comp}` and all its variants. Returns name and SPIR-V of each.
pub(crate) fn shaders() -> Vec<(String, Vec<u8>)> {
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
    let compile = |(name, entry): (String, variants::Entry)| {
        let path = Path::new("glsl").join(&entry.file);
        let defines: String = entry.defines.iter().map(|define| format!("#define {define}\n")).collect();
        let source = format!("{PREAMBLE}{defines}#line 1\n{}", sources[&entry.file]);
        let kind = kind(&path).expect("an entry shader");
        match compiler.compile_into_spirv(&source, kind, &path.display().to_string(), "main", Some(&options)) {
            Ok(artifact) => (name, artifact.as_binary_u8().to_vec()),
            Err(error) => fail(&format!("{name}: {error}")),
        }
    };
    entries.into_iter().map(compile).collect()
}

/// Stage of an entry shader; `None` for files that entry shaders include.
fn kind(path: &Path) -> Option<shaderc::ShaderKind> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("vert") => Some(shaderc::ShaderKind::Vertex),
        Some("frag") => Some(shaderc::ShaderKind::Fragment),
        Some("comp") => Some(shaderc::ShaderKind::Compute),
        _ => None,
    }
}
