//! Scenes that were opened before, newest first, in a file of the user's.

use lightskin::files;
use std::path::{Path, PathBuf};

/// How many are kept.
const MOST: usize = 10;

/// `lightskin/recent` under `$XDG_STATE_HOME`, or else under `$HOME/.local/state`; none with neither.
fn file() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let states = set("XDG_STATE_HOME").or_else(|| set("HOME").map(|home| home.join(".local/state")));
    states.map(|folder| folder.join("lightskin/recent"))
}

/// Whether the window has been open before; from now on it has.
pub(super) fn is_first() -> bool {
    let Some(path) = file().map(|file| file.with_file_name("seen")) else { return false };
    let first = !path.exists();
    if first && path.parent().is_some_and(|folder| std::fs::create_dir_all(folder).is_ok()) {
        // Where that cannot be written the hint comes again.
        let _ = files::write(&path, b"");
    }
    first
}

/// All of them that are there, one path a line.
pub(super) fn all() -> Vec<PathBuf> {
    let text = file().and_then(|file| files::read(&file).ok()).and_then(|bytes| String::from_utf8(bytes).ok());
    text.unwrap_or_default().lines().map(PathBuf::from).filter(|path| path.exists()).take(MOST).collect()
}

/// Puts one at the top. Where that cannot be written nothing is lost but the list.
pub(super) fn add(path: &Path) {
    let (Some(file), Ok(path)) = (file(), std::path::absolute(path)) else { return };
    let before = all().into_iter().filter(|other| *other != path);
    let lines = [path.clone()].into_iter().chain(before).take(MOST).map(|path| format!("{}\n", path.display()));
    let text: String = lines.collect();
    let folder = file.parent().map_or(Ok(()), |folder| std::fs::create_dir_all(folder).map_err(anyhow::Error::from));
    if let Err(error) = folder.and_then(|()| Ok(files::write(&file, text.as_bytes())?)) {
        log::debug!("the list of recent scenes is not kept: {error}");
    }
}
