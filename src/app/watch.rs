//! Detects changes of the files of the open scene.

use lightskin::files;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// Time between two checks.
pub(super) const EVERY: Duration = Duration::from_millis(400);

/// Time of the last write to a file, and its size. `None` if the file does not exist.
type Stamp = Option<(SystemTime, u64)>;

/// The files of a scene, or of a folder of shaders.
pub(super) struct Watch {
    of: PathBuf,
    /// Lists the files of a scene or folder.
    list: fn(&Path) -> Vec<PathBuf>,
    files: Vec<PathBuf>,
    /// Stamps when they were loaded.
    loaded: Vec<Stamp>,
    /// Stamps at the last check. Files whose stamps still change are still being written.
    seen: Vec<Stamp>,
    looked: Instant,
}

impl Watch {
    /// Watches the files of a scene.
    pub(super) fn new(scene: &Path) -> Self {
        Self::of(scene, files_of)
    }

    /// Watches the files that `list` finds in a folder.
    pub(super) fn of(folder: &Path, list: fn(&Path) -> Vec<PathBuf>) -> Self {
        let files = list(folder);
        let loaded = stamps(&files);
        Self { of: folder.to_owned(), list, seen: loaded.clone(), files, loaded, looked: Instant::now() }
    }

    /// Whether this watches the files of `scene`.
    pub(super) fn is_of(&self, scene: &Path) -> bool {
        self.of == scene
    }

    /// Whether a file has changed and then stayed the same between two checks. Reports each change once.
    pub(super) fn has_changed(&mut self) -> bool {
        if self.looked.elapsed() < EVERY {
            return false;
        }
        self.looked = Instant::now();
        let mut now = stamps(&self.files);
        if now.contains(&None) {
            // A file was renamed or removed.
            self.files = (self.list)(&self.of);
            now = stamps(&self.files);
        }
        let rests = now == self.seen;
        self.seen = now;
        let changed = rests && self.seen != self.loaded && self.seen.iter().all(Option::is_some);
        if changed {
            *self = Self::of(&self.of, self.list);
        }
        changed
    }
}

fn stamps(files: &[PathBuf]) -> Vec<Stamp> {
    let stamp = |path: &PathBuf| {
        let about = std::fs::metadata(path).ok()?;
        Some((about.modified().ok()?, about.len()))
    };
    files.iter().map(stamp).collect()
}

/// The scene's own file, or the glTF files of its folder, and the files to which they refer.
fn files_of(scene: &Path) -> Vec<PathBuf> {
    let ends = |path: &Path, ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let mut all = match std::fs::read_dir(scene) {
        Err(_) => vec![scene.to_owned()],
        Ok(entries) => {
            let entries = entries.filter_map(|entry| entry.ok().map(|entry| entry.path()));
            entries.filter(|path| ends(path, "gltf") || ends(path, "glb")).collect()
        }
    };
    for file in all.clone().into_iter().filter(|file| ends(file, "gltf")) {
        let Some(json) =
            files::read(&file).ok().and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok())
        else {
            continue;
        };
        let folder = file.parent().unwrap_or(Path::new(""));
        let lists = ["buffers", "images"].into_iter().filter_map(|list| json[list].as_array());
        let named = lists.flatten().filter_map(|entry| entry["uri"].as_str()).filter(|uri| !uri.starts_with("data:"));
        all.extend(named.map(|uri| folder.join(uri.replace("%20", " "))));
    }
    all
}
