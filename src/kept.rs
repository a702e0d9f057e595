//! Files that spare the next start work that this one has done: bakes and path-traced samples. All of them can be
//! deleted at any time.

use crate::files;
use std::io::Write;
use std::path::{Path, PathBuf};

/// `lightskin` under `$XDG_CACHE_HOME`, or else under `$HOME/.cache` (Windows: `%LOCALAPPDATA%`, macOS:
/// `$HOME/Library/Caches`); `None` with neither.
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

/// Writes a file whole or not at all. Makes the folder.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    files::replace(path, |file| file.write_all(bytes))
}
