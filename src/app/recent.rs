//! The list of recent scenes, newest first, in a file of the user.

use lightskin::files;
use std::path::{Path, PathBuf};

/// Maximum number of scenes in the list.
const MOST: usize = 10;

/// Path of the list: `lightskin/recent` under `$XDG_STATE_HOME`, or else under `$HOME/.local/state`. `None` if neither
/// is set.
fn file() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let states = set("XDG_STATE_HOME").or_else(|| set("HOME").map(|home| home.join(".local/state")));
    states.map(|folder| folder.join("lightskin/recent"))
}

/// Whether the window is opened for the first time. Creates a marker file, so that later calls return false.
pub(super) fn is_first() -> bool {
    let Some(path) = file().map(|file| file.with_file_name("seen")) else { return false };
    let first = !path.exists();
    if first && path.parent().is_some_and(|folder| std::fs::create_dir_all(folder).is_ok()) {
        // If this file cannot be written, the hint appears again at the next start.
        let _ = files::write(&path, b"");
    }
    first
}

/// The scenes of the list whose files exist. The file has one path per line.
pub(super) fn all() -> Vec<PathBuf> {
    let text = file().and_then(|file| files::read(&file).ok()).and_then(|bytes| String::from_utf8(bytes).ok());
    text.unwrap_or_default().lines().map(PathBuf::from).filter(|path| path.exists()).take(MOST).collect()
}

/// A list with this scene at its top.
pub(super) fn with(path: &Path, list: Vec<PathBuf>) -> Vec<PathBuf> {
    let Ok(path) = std::path::absolute(path) else { return list };
    let before = list.into_iter().filter(|other| *other != path);
    [path.clone()].into_iter().chain(before).take(MOST).collect()
}

/// Puts a scene at the top of the file's list. If the file cannot be written, only a debug message is logged.
pub(super) fn add(path: &Path) {
    let Some(file) = file() else { return };
    let text: String = with(path, all()).iter().map(|path| format!("{}\n", path.display())).collect();
    let folder = file.parent().map_or(Ok(()), |folder| std::fs::create_dir_all(folder).map_err(anyhow::Error::from));
    if let Err(error) = folder.and_then(|()| Ok(files::write(&file, text.as_bytes())?)) {
        log::debug!("the list of recent scenes cannot be saved: {error}");
    }
}
