//! References that points are compared with: brute force and the path tracer. Kept as EXR files because they take long.

use super::measure::Layers;
use crate::error::{Error, Result};
use crate::files;
use crate::frame::Shadows;
use crate::image::{Layer, read_picture, write_exr};
use crate::lab::knobs::Knobs;
use crate::reference::path_trace::{PathTrace, PathTraceSettings};
use crate::scene::{Camera, Scene};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A reference that points are compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Truth {
    /// Brute force with the point's own VALs: isolates the error of caches and interpolation.
    SameVals,
    /// Brute force with the most VALs of the sweep: adds the error of too few VALs.
    FinestVals,
    /// Path tracer, one bounce, indirect light unshadowed: adds the error of VALs as such.
    Unshadowed,
    /// Path tracer with all bounces and shadows: the whole error, as a user sees it.
    AllLight,
}

impl Truth {
    /// The user's view first, then the unshadowed references from the most to the least forgiving.
    pub const ALL: [Self; 4] = [Self::AllLight, Self::SameVals, Self::FinestVals, Self::Unshadowed];

    /// Whether points with these settings are compared with it. References of one bounce without shadows fit only such
    /// points, and those fit nothing else: correct shadows and further bounces would count as errors.
    pub fn fits(self, frame: &Knobs) -> bool {
        (self == Self::AllLight) != (frame.shadows == Shadows::Off && frame.bounces <= 1)
    }

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::SameVals => "same-vals",
            Self::FinestVals => "finest-vals",
            Self::Unshadowed => "path-traced-unshadowed",
            Self::AllLight => "path-traced",
        }
    }

    /// Name in plot legends.
    pub fn short(self) -> &'static str {
        match self {
            Self::SameVals => "same VALs, no shadows",
            Self::FinestVals => "most VALs, no shadows",
            Self::Unshadowed => "paths, no shadows",
            Self::AllLight => "paths, all light",
        }
    }

    /// Readable name.
    pub fn title(self) -> &'static str {
        match self {
            Self::SameVals => "brute force, same virtual lights, no shadows",
            Self::FinestVals => "brute force, most virtual lights, no shadows",
            Self::Unshadowed => "path traced, no shadows",
            Self::AllLight => "path traced, all light",
        }
    }
}

/// A reference image and its metadata.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The picture.
    pub layers: Layers,
    /// Metadata: an object with `name`, and for path-traced references `samples` and `noise` (mean relative standard
    /// error).
    pub about: Value,
}

impl Reference {
    /// Hash of everything that it depends on.
    pub fn key(&self) -> &str {
        self.about["key"].as_str().unwrap_or_default()
    }
}

/// The folder of reference images.
pub struct Library {
    /// Path of the folder.
    pub folder: PathBuf,
}

impl Library {
    /// Creates the folder if it is missing.
    ///
    /// # Errors
    /// Fails if a folder or file cannot be read or written.
    pub fn open(folder: PathBuf) -> Result<Self> {
        make_folder(&folder)?;
        Ok(Self { folder })
    }

    fn path(&self, name: &str, key: &str) -> PathBuf {
        self.folder.join(format!("{name}-{}.exr", &key[..16.min(key.len())]))
    }

    /// Finds a kept reference. `None` if there is none or it cannot be read; the latter is logged as a warning.
    pub fn find(&self, name: &str, key: &str) -> Option<Reference> {
        let path = self.path(name, key);
        let about: Value = serde_json::from_slice(&files::read(&path.with_extension("json")).ok()?).ok()?;
        if about.get("key")?.as_str()? != key {
            return None;
        }
        let has_glossy = about.get("glossy")?.as_bool()?;
        match read(&path, has_glossy) {
            Ok(layers) => Some(Reference { layers, about }),
            Err(error) => {
                log::warn!("{error}; the reference is computed again");
                None
            }
        }
    }

    /// Stores a reference; `about` must be an object.
    ///
    /// # Errors
    /// Fails if a folder or file cannot be read or written.
    pub fn keep(&self, name: &str, key: &str, layers: Layers, mut about: Value) -> Result<Reference> {
        let path = self.path(name, key);
        let rgba = |image: &[[f32; 3]]| -> Vec<[f32; 4]> { image.iter().map(|p| [p[0], p[1], p[2], 1.0]).collect() };
        let covered: Vec<[f32; 4]> = layers.covered.iter().map(|c| [f32::from(u8::from(*c)); 4]).collect();
        let mut all = vec![
            Layer::rgb("", &rgba(&layers.sum())),
            Layer::rgb("indirect.diffuse", &rgba(&layers.diffuse)),
            Layer::of("", &["covered"], &covered),
        ];
        all.extend(layers.glossy.iter().map(|glossy| Layer::rgb("indirect.glossy", &rgba(glossy))));
        about["name"] = name.into();
        about["key"] = key.into();
        about["glossy"] = layers.glossy.is_some().into();
        write_exr(&path, layers.size[0], layers.size[1], &all, &about.to_string())?;
        // Written second: a picture without it is ignored.
        files::write(&path.with_extension("json"), format!("{about}\n").as_bytes())?;
        Ok(Reference { layers, about })
    }
}

fn read(path: &Path, has_glossy: bool) -> Result<Layers> {
    let diffuse = read_picture(path, Some("indirect.diffuse"))?;
    let glossy = has_glossy.then(|| read_picture(path, Some("indirect.glossy"))).transpose()?;
    let covered = read_picture(path, Some("covered"))?;
    Ok(Layers {
        size: [diffuse.width, diffuse.height],
        diffuse: diffuse.rgb,
        glossy: glossy.map(|g| g.rgb),
        covered: covered.rgb.iter().map(|c| c[0] > 0.5).collect(),
    })
}

/// Creates a folder and its parents.
pub(crate) fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|error| {
        let what =
            if path.exists() { "it is a file; name a folder".into() } else { format!("{error}; choose another place") };
        Error::Output { file: path.to_owned(), reason: what }
    })
}

/// Parameters of a path-traced reference.
#[derive(Clone, Copy, Debug)]
pub struct PathTraced {
    /// Picture and light.
    pub settings: PathTraceSettings,
    /// Minimum samples per pixel.
    pub samples: u32,
    /// Whether a material has a glossy lobe.
    pub glossy: bool,
}

/// Interval between saves of the samples: limits what an interruption can lose.
const SAVE_EVERY: Duration = Duration::from_secs(20);

/// Path-traces; returns the layers and their metadata. Samples are kept in `folder`, so that an interrupted
/// picture continues and more samples refine it. `progress` receives the completed share, 0 to 1.
pub fn path_traced(
    scene: &Scene,
    camera: &Camera,
    wanted: &PathTraced,
    folder: &Path,
    progress: &dyn Fn(f32),
) -> (Layers, Value) {
    let PathTraced { settings, samples, glossy } = *wanted;
    let mut trace = PathTrace::new(scene, camera, &settings);
    let file = trace.kept_in(folder);
    if trace.resume(&file) {
        log::info!("{}: {} samples per pixel were kept", file.display(), trace.samples());
    }
    let save = |trace: &PathTrace<'_>| {
        if let Err(error) = trace.save(&file) {
            log::warn!("{}: the samples cannot be kept: {error}", file.display());
        }
    };
    let mut saved = Instant::now();
    while trace.samples() < samples {
        progress(trace.samples() as f32 / samples as f32);
        trace.pass();
        if saved.elapsed() > SAVE_EVERY {
            save(&trace);
            saved = Instant::now();
        }
    }
    save(&trace);
    let layers = Layers {
        size: settings.size,
        diffuse: trace.diffuse(),
        glossy: glossy.then(|| trace.glossy()),
        covered: trace.covered(),
    };
    (layers, json!({ "samples": trace.samples(), "noise": trace.noise() }))
}
