//! Files that save the next start from repeating work: bakes and path-traced samples. All of them can be deleted at any
//! time.

use crate::files;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Folder of the kept files: `lightskin` under `$XDG_CACHE_HOME`, otherwise under `$HOME/.cache` (Windows:
/// `%LOCALAPPDATA%`, macOS: `$HOME/Library/Caches`). `None` if none of these is set.
pub fn folder() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let usual = || match std::env::consts::OS {
        "windows" => set("LOCALAPPDATA"),
        "macos" => set("HOME").map(|home| home.join("Library/Caches")),
        _ => set("HOME").map(|home| home.join(".cache")),
    };
    let caches = set("XDG_CACHE_HOME").or_else(usual);
    caches.map(|folder| folder.join("lightskin"))
}

/// Writes a file atomically. Creates the folder if needed.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    files::replace(path, |file| file.write_all(bytes))
}
