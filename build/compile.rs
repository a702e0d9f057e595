//! Compiles `glsl/` with glslang, for feature `glsl`: the build embeds the SPIR-V, and a window with `--dev` compiles what has
//! changed since. Errors name file and line.

use super::variants;
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::{fs, thread};

/// Source text before every entry shader.
const PREAMBLE: &str =
    "#version 460\n#extension GL_GOOGLE_include_directive : require\n#extension GL_EXT_scalar_block_layout : require\n";

/// An entry shader: a file `*.{vert,frag,comp}`, or a variant of one.
#[derive(Clone, PartialEq)]
pub(crate) struct Source {
    /// Name of the shader.
    pub(crate) name: String,
    /// Name of its file in the folder.
    file: String,
    kind: shaderc::ShaderKind,
    /// Its text, which includes other files.
    pub(crate) text: String,
}

/// All entry shaders of a folder.
pub(crate) fn sources(folder: &Path) -> Result<Vec<Source>, String> {
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if let (Some(_), Some(name)) = (kind(&path), path.file_name().and_then(|name| name.to_str())) {
            files.push((name.to_owned(), read(&path)?));
        }
    }
    let text_of = |file: &str| files.iter().find(|(name, _)| name == file).map_or("", |(_, text)| text.as_str());
    let source = |(name, entry): (String, variants::Entry)| {
        let defines: String = entry.defines.iter().map(|define| format!("#define {define}\n")).collect();
        let text = format!("{PREAMBLE}{defines}#line 1\n{}", text_of(&entry.file));
        Some(Source { name, kind: kind(Path::new(&entry.file))?, file: entry.file, text })
    };
    Ok(variants::entries(&files)?.into_iter().filter_map(source).collect())
}

/// Compiles shaders of a folder on all cores. Returns name and SPIR-V of each, or the error of the first that fails.
pub(crate) fn compile<'a>(
    folder: &Path,
    sources: impl Iterator<Item = &'a Source>,
) -> Result<Vec<(String, Vec<u8>)>, String> {
    let sources: Vec<&Source> = sources.collect();
    let next = AtomicUsize::new(0);
    let work = || -> Result<Vec<_>, String> {
        let mut done = Vec::new();
        let compile = compiler(folder)?;
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(source) = sources.get(index) else { return Ok(done) };
            done.push((index, compile(source)));
        }
    };
    let threads = thread::available_parallelism().map_or(1, usize::from).min(sources.len());
    let all = thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        let join = |thread: thread::ScopedJoinHandle<'_, _>| thread.join().unwrap_or_else(|panic| resume_unwind(panic));
        threads.into_iter().map(join).collect::<Result<Vec<_>, String>>()
    })?;
    let mut done: Vec<_> = all.into_iter().flatten().collect();
    done.sort_unstable_by_key(|(index, _)| *index);
    let named = |(index, code): (usize, Result<_, String>)| Ok((sources[index].name.clone(), code?));
    done.into_iter().map(named).collect()
}

/// A function that compiles a shader of this folder, for one thread.
fn compiler(folder: &Path) -> Result<impl Fn(&Source) -> Result<Vec<u8>, String>, String> {
    let missing = |error: shaderc::Error| format!("shaderc: {error}; run ./scripts/setup");
    let compiler = shaderc::Compiler::new().map_err(missing)?;
    let mut options = shaderc::CompileOptions::new().map_err(missing)?;
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_optimization_level(shaderc::OptimizationLevel::Performance);
    options.set_generate_debug_info();
    options.set_warnings_as_errors();
    options.set_include_callback(|name, _kind, _from, _depth| {
        Ok(shaderc::ResolvedInclude { resolved_name: format!("glsl/{name}"), content: read(&folder.join(name))? })
    });
    Ok(move |source: &Source| {
        let file = format!("glsl/{}", source.file);
        match compiler.compile_into_spirv(&source.text, source.kind, &file, "main", Some(&options)) {
            Ok(artifact) => Ok(artifact.as_binary_u8().to_vec()),
            Err(error) => Err(format!("{}: {error}", source.name)),
        }
    })
}

fn read(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
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
