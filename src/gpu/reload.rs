//! Shaders that are compiled again while the program runs, for those who change them.

#[path = "../../build/compile.rs"]
mod compile;
#[path = "../../build/variants.rs"]
mod variants;

use super::Gpu;
use super::graveyard::lock;
use super::pipeline::{shader_names, spirv};
use super::reflect::{self, Interface};
use compile::Source;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// SPIR-V that replaces embedded shaders, by name.
static REPLACED: Mutex<Replaced> = Mutex::new(BTreeMap::new());

type Replaced = BTreeMap<String, Vec<u32>>;

/// The SPIR-V that replaces the embedded shader of this name, if any.
pub(super) fn replaced(name: &str) -> Option<Vec<u32>> {
    lock(&REPLACED).get(name).cloned()
}

/// A folder of shaders, whose changes replace the embedded ones.
pub struct ShaderFolder {
    folder: PathBuf,
    /// The texts of each shader with all that it includes, as far as they are in use.
    used: BTreeMap<String, String>,
    /// The declarations that the host shares.
    shared: String,
}

impl ShaderFolder {
    /// Takes the present shaders of a folder for those that are embedded.
    ///
    /// # Errors
    /// Fails with a message if the folder cannot be read.
    pub fn new(folder: &Path) -> Result<Self, String> {
        let sources = compile::sources(folder)?;
        let used = sources.iter().map(|source| Ok((source.name.clone(), whole(folder, source)?)));
        Ok(Self { used: used.collect::<Result<_, String>>()?, shared: shared(folder)?, folder: folder.to_owned() })
    }

    /// Compiles the shaders that have changed. Pipelines that are made from now on use them, on all devices. Returns their
    /// names. If one does not compile, or `gpu` refuses it in a pipeline that is in use, all stay as they are.
    ///
    /// # Errors
    /// Fails with file, line and reason if a shader does not compile, or if structs have changed that the host shares.
    /// Fails with shader and reason if the device refuses it.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<Vec<String>, String> {
        if shared(&self.folder)? != self.shared {
            return Err("glsl/shared*.glsl: the host shares these structs; build lightskin again to change them".into());
        }
        let mut changed = Vec::new();
        for source in compile::sources(&self.folder)? {
            let text = whole(&self.folder, &source)?;
            if self.used.get(&source.name) != Some(&text) {
                changed.push((source, text));
            }
        }
        let compiled = compile::compile(&self.folder, changed.iter().map(|(source, _)| source))?;
        let compiled: Vec<(String, Vec<u32>)> =
            compiled.into_iter().map(|(name, code)| (name, bytemuck::pod_collect_to_vec(&code))).collect();
        for (name, code) in &compiled {
            check_interface(name, code)?;
        }
        let names: Vec<String> = changed.iter().map(|(source, _)| source.name.clone()).collect();
        let before = lock(&REPLACED).clone();
        lock(&REPLACED).extend(compiled);
        if let Err(error) = gpu.try_again(&names.iter().map(String::as_str).collect::<Vec<_>>()) {
            *lock(&REPLACED) = before;
            return Err(format!("the device refuses it: {error}"));
        }
        self.used.extend(changed.into_iter().map(|(source, text)| (source.name, text)));
        Ok(names)
    }
}

/// Fails if a shader has other bindings, push constants or inputs than the one that it replaces: the host fills those.
fn check_interface(name: &str, code: &[u32]) -> Result<(), String> {
    if !shader_names().any(|known| known == name) {
        return Ok(());
    }
    let stage = &name[name.rfind('.').unwrap_or(0)..];
    let [now, before] = [code, &spirv(name, stage)].map(|code| reflect::interface(code, &[]));
    let places = |interface: &Interface| {
        interface.bindings.iter().map(|b| (b.binding, b.kind, b.view, b.format)).collect::<Vec<_>>()
    };
    if places(&now) != places(&before) || now.push_bytes != before.push_bytes || now.inputs != before.inputs {
        return Err(format!(
            "{name}: has other bindings, push constants or inputs; build lightskin again to change them"
        ));
    }
    Ok(())
}

/// The text of a shader, followed by that of all files that it includes.
fn whole(folder: &Path, source: &Source) -> Result<String, String> {
    let (mut text, mut seen, mut begin) = (source.text.clone(), BTreeSet::new(), 0);
    // Files are appended while the text is searched, so that their own includes are found as well.
    while let Some(at) = text[begin..].find("#include \"") {
        begin += at + "#include \"".len();
        let name = text[begin..].split('"').next().unwrap_or_default().to_owned();
        if seen.insert(name.clone()) {
            let path = folder.join(&name);
            text += &fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        }
    }
    Ok(text)
}

/// The text of all files that declare structs of the host.
fn shared(folder: &Path) -> Result<String, String> {
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    let entries = fs::read_dir(folder).map_err(failed)?.flatten().map(|entry| entry.path());
    let is_shared = |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with("shared"));
    let mut files: Vec<PathBuf> = entries.filter(is_shared).collect();
    files.sort();
    files.iter().map(|file| fs::read_to_string(file).map_err(failed)).collect()
}
