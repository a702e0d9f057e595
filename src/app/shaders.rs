//! Shaders that the window compiles again when their files change, with `--dev`.

use super::watch::Watch;
use lightskin::gpu::{Gpu, ShaderFolder};
use std::path::{Path, PathBuf};

/// The folder of the shaders, and what is wrong with them.
pub(super) struct Shaders {
    folder: ShaderFolder,
    watch: Watch,
    /// Why the present files are not in use.
    pub(super) error: Option<String>,
}

impl Shaders {
    /// Watches a folder with the shaders from which this program was built.
    ///
    /// # Errors
    /// Fails with a message if they are not there.
    pub(super) fn new(folder: &Path) -> Result<Self, String> {
        let watch = Watch::of(folder, files);
        let folder = ShaderFolder::new(folder).map_err(|error| format!("--dev: {error}"))?;
        Ok(Self { folder, watch, error: None })
    }

    /// Compiles what has changed. Returns whether new shaders are in use: all must compile, and the device must take
    /// them.
    pub(super) fn reload(&mut self, gpu: &Gpu) -> bool {
        if !self.watch.has_changed() {
            return false;
        }
        match self.folder.reload(gpu) {
            Ok(names) => {
                self.error = None;
                if !names.is_empty() {
                    log::warn!("compiled {}", names.join(", "));
                }
                !names.is_empty()
            }
            Err(error) => {
                log::error!("{}", error.trim());
                self.error = Some(error);
                false
            }
        }
    }
}

/// The files of a folder and its `lib`.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = [folder.to_owned(), folder.join("lib")].map(std::fs::read_dir);
    entries.into_iter().flatten().flatten().flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect()
}
