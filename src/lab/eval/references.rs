//! What points are compared with: every VAL on every pixel, and the path tracer. Kept as EXR files, for they take long.

use super::measure::Layers;
use crate::error::{Error, Result};
use crate::files;
use crate::frame::Shadows;
use crate::image::{Layer, read_picture, write_exr};
use crate::reference::path_trace::{PathTrace, PathTraceSettings};
use crate::scene::{Camera, Scene};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What a point is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Truth {
    /// Brute force with the point's own VALs: the error of caches and interpolation alone.
    SameVals,
    /// Brute force with the most VALs of the sweep: the error of too few VALs as well.
    FinestVals,
    /// The path tracer, one bounce, nothing in the way of reflected light: the error of VALs as such as well.
    Unshadowed,
    /// The path tracer, one bounce, with its shadows: all of the error of one bounce, which is what a user sees.
    Shadowed,
}

impl Truth {
    /// First what a user sees. Then those without shadows, from the one that forgives most to the one that forgives least.
    pub const ALL: [Self; 4] = [Self::Shadowed, Self::SameVals, Self::FinestVals, Self::Unshadowed];

    /// Whether points with such shadows are compared with it. References without shadows tell nothing of points with
    /// shadows: what those are right about would count as their error.
    pub fn fits(self, shadows: Shadows) -> bool {
        self == Self::Shadowed || shadows == Shadows::Off
    }

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::SameVals => "same-vals",
            Self::FinestVals => "finest-vals",
            Self::Unshadowed => "path-traced-unshadowed",
            Self::Shadowed => "path-traced",
        }
    }

    /// Name in legends.
    pub fn short(self) -> &'static str {
        match self {
            Self::SameVals => "same VALs, no shadows",
            Self::FinestVals => "most VALs, no shadows",
            Self::Unshadowed => "paths, no shadows",
            Self::Shadowed => "paths, with shadows",
        }
    }

    /// Name for people.
    pub fn title(self) -> &'static str {
        match self {
            Self::SameVals => "brute force, same virtual lights, no shadows",
            Self::FinestVals => "brute force, most virtual lights, no shadows",
            Self::Unshadowed => "path traced, no shadows",
            Self::Shadowed => "path traced, with shadows",
        }
    }
}

/// A reference image and what is known of it.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The picture.
    pub layers: Layers,
    /// How it was made: an object with `name`, and with `samples` and `noise` (relative standard error, mean over the
    /// picture) where it was path traced.
    pub about: Value,
}

impl Reference {
    /// Hash of all that it depends on.
    pub fn key(&self) -> &str {
        self.about["key"].as_str().unwrap_or_default()
    }
}

/// The folder of reference images.
pub struct Library {
    /// Where they lie.
    pub folder: PathBuf,
}

impl Library {
    /// Makes the folder if it is missing.
    ///
    /// # Errors
    /// A folder or file that cannot be read or written.
    pub fn open(folder: PathBuf) -> Result<Self> {
        make_folder(&folder)?;
        Ok(Self { folder })
    }

    fn path(&self, name: &str, key: &str) -> PathBuf {
        self.folder.join(format!("{name}-{}.exr", &key[..16.min(key.len())]))
    }

    /// A kept reference. `None` if there is none or it cannot be read; the latter is a warning.
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
                log::warn!("{error}; it is made again");
                None
            }
        }
    }

    /// Keeps a reference; `about` is an object.
    ///
    /// # Errors
    /// A folder or file that cannot be read or written.
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
        // Second: a picture without it is not found.
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

/// Makes a folder and those above it.
pub(crate) fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|error| {
        let what =
            if path.exists() { "it is a file; name a folder".into() } else { format!("{error}; choose another place") };
        Error::Output { file: path.to_owned(), reason: what }
    })
}

/// What the path tracer is asked for.
#[derive(Clone, Copy, Debug)]
pub struct PathTraced {
    /// Picture \[pixels\].
    pub size: [u32; 2],
    /// Whether reflected light is shadowed.
    pub visibility: bool,
    /// Samples per pixel, at least.
    pub samples: u32,
    /// Whether a material has a glossy lobe.
    pub glossy: bool,
}

/// How often samples are kept: what an interruption can cost.
const SAVE_EVERY: Duration = Duration::from_secs(20);

/// One bounce by path tracing, and what is to be known of it. Samples are kept in `folder`: an interrupted picture goes
/// on, and more samples refine it. `progress` is told how much is done, from 0 to 1.
pub fn path_traced(
    scene: &Scene,
    camera: &Camera,
    wanted: &PathTraced,
    folder: &Path,
    progress: &dyn Fn(f32),
) -> (Layers, Value) {
    let PathTraced { size, visibility, samples, glossy } = *wanted;
    let settings = if visibility { PathTraceSettings::engine(size, 1) } else { PathTraceSettings::unshadowed(size) };
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
    let layers =
        Layers { size, diffuse: trace.diffuse(), glossy: glossy.then(|| trace.glossy()), covered: trace.covered() };
    (layers, json!({ "samples": trace.samples(), "noise": trace.noise() }))
}
