//! What the picture is held against: a reference of the present view, made in the background or read from a file; how far the
//! picture is from it, in numbers and as a map.

use super::background::Rest;
use super::reference::Trace;
use crate::cli::view::print;
use anyhow::{Result, anyhow};
use lightskin::frame::{Engine, Indirect, Light, Look, Picture, Settings, View, record};
use lightskin::gpu::{Format, Gpu, Image};
use lightskin::image::{is_exr, read_picture};
use lightskin::metrics::display::Values;
use lightskin::metrics::flip::{PIXELS_PER_DEGREE, flip};
use lightskin::metrics::heat::{self, Scale};
use lightskin::metrics::{metrics, relative_squares};
use lightskin::reference::path_trace::PathTraceSettings;
use lightskin::scene::Camera;
use lightskin::shared::{LAYER_COLOR, LAYER_RADIANCE, LAYER_REFLECTANCE};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

/// What the picture is held against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Against {
    /// The path tracer, all light.
    PathTrace,
    /// The path tracer with the engine's number of bounces, diffuse but for the last.
    SameBounces,
    /// Every virtual light onto every pixel.
    BruteForce,
    /// A file.
    File,
}

/// What is shown of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Map {
    /// The reference itself.
    Reference,
    /// FLIP of each pixel.
    Flip,
    /// Relative squared error of each pixel.
    Relmse,
}

/// A picture in the place of the rest of lightskin's, from a share of the width on.
pub(super) struct Over<'a> {
    pub(super) image: &'a Image,
    /// How it is shown: a `LAYER_*`.
    pub(super) how: u32,
    pub(super) from: f32,
}

/// How far the picture is from the reference.
pub(super) struct Errors {
    pub(super) flip: f64,
    pub(super) relmse: f64,
    pub(super) bias: f64,
    /// Where the map is black and where light.
    pub(super) scale: Option<Scale>,
}

/// A reference.
struct Reference {
    size: [u32; 2],
    rgb: Vec<[f32; 3]>,
    values: Values,
    /// Whether it is smaller than the picture yet, and shown enlarged.
    coarse: bool,
    /// Samples per pixel of a path trace.
    samples: Option<u32>,
    noise: f64,
}

/// What a reference was made of.
#[derive(Clone, PartialEq)]
struct Key {
    against: Against,
    view: View,
    size: [u32; 2],
    edits: u64,
    spread: bool,
    bounces: u32,
    /// Where they matter.
    settings: Option<Settings>,
}

/// What is on the screen now.
pub(super) struct Now<'a> {
    pub(super) engine: &'a Engine,
    pub(super) picture: &'a Picture,
    pub(super) view: View,
    pub(super) camera: Camera,
    /// Counts changes of the scene.
    pub(super) edits: u64,
    /// Whether something else works in the background, or an animation plays.
    pub(super) busy: bool,
}

/// Pictures, references and map of what was measured.
pub(super) type Measured = (u64, u64, Map);

/// The thread that measures: errors, and the map as RGBA.
type Measuring = JoinHandle<(Errors, Vec<u8>)>;

/// The comparison.
pub(super) struct Compare {
    pub(super) against: Against,
    /// Whether the reference is shown.
    pub(super) shown: bool,
    /// Share of the picture's width that stays lightskin's.
    pub(super) wipe: f32,
    pub(super) map: Map,
    pub(super) errors: Option<Errors>,
    pub(super) rest: Rest,
    /// Most samples per pixel.
    most: u32,
    file: Option<(PathBuf, Arc<Reference>)>,
    loading: Option<(PathBuf, JoinHandle<Result<Reference>>)>,
    key: Option<Key>,
    trace: Option<Trace>,
    reference: Option<Arc<Reference>>,
    measuring: Option<(Measured, Measuring)>,
    /// Counts pictures and references.
    pictures: u64,
    references: u64,
    measured: Option<Measured>,
    /// Of reference and map.
    images: [Option<Image>; 2],
    /// What the barrier check has said of frames of its own.
    pub(super) problems: Vec<String>,
}

impl Compare {
    pub(super) fn new(most: u32) -> Self {
        Self {
            against: Against::PathTrace,
            shown: false,
            wipe: 0.0,
            map: Map::Reference,
            errors: None,
            rest: Rest::new(),
            most,
            file: None,
            loading: None,
            key: None,
            trace: None,
            reference: None,
            measuring: None,
            pictures: 0,
            references: 0,
            measured: None,
            images: [None, None],
            problems: Vec::new(),
        }
    }

    /// Reads a picture in the background, and holds the present one against it.
    pub(super) fn open(&mut self, path: &Path) {
        let of_thread = path.to_owned();
        let read = move || {
            let picture = read_picture(&of_thread, None)?;
            let values = if is_exr(&of_thread) { Values::Radiance } else { Values::Display };
            let size = [picture.width, picture.height];
            Ok(Reference { size, rgb: picture.rgb, values, coarse: false, samples: None, noise: 0.0 })
        };
        self.loading = Some((path.to_owned(), std::thread::spawn(read)));
    }

    /// Whether a file's name says that it is a picture to compare with, and nothing else.
    pub(super) fn is_picture(path: &Path) -> bool {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_lowercase);
        ending.is_some_and(|ending| ["png", "jpg", "jpeg"].contains(&ending.as_str()))
    }

    /// Size of the file, if there is one: what the picture's has to be.
    pub(super) fn file_size(&self) -> Option<[u32; 2]> {
        self.file.as_ref().filter(|_| self.against == Against::File).map(|(_, file)| file.size)
    }

    /// What to draw over the picture.
    pub(super) fn over(&self) -> Option<Over<'_>> {
        let reference = self.reference.as_ref().filter(|_| self.shown)?;
        let how = if reference.values == Values::Radiance { LAYER_RADIANCE } else { LAYER_REFLECTANCE };
        let [image, map] = &self.images;
        let (image, how) = match (self.map, map) {
            (Map::Reference, _) | (_, None) => (image.as_ref()?, how),
            (_, Some(map)) => (map, LAYER_COLOR),
        };
        Some(Over { image, how, from: self.wipe })
    }

    /// Changes with what there is to show.
    pub(super) fn version(&self) -> (u64, Option<Measured>, bool) {
        (self.references, self.measured, self.reference.is_some())
    }

    /// Whether it has something to do without input.
    pub(super) fn works(&self) -> bool {
        let waits = self.shown && self.key.is_none();
        self.loading.is_some() || self.trace.is_some() || self.measuring.is_some() || waits || self.is_unmeasured()
    }

    fn wanted(&self) -> Measured {
        (self.pictures, self.references, self.map)
    }

    fn is_unmeasured(&self) -> bool {
        let whole = self.reference.as_ref().is_some_and(|reference| !reference.coarse);
        self.shown && whole && self.measured != Some(self.wanted())
    }

    /// What it is and how far, in a line.
    pub(super) fn state(&self) -> String {
        let of = match (&self.reference, self.against) {
            _ if self.loading.is_some() => "reading the file".into(),
            (_, Against::File) => match &self.file {
                None => "drop a PNG here, or an EXR while the reference shows".into(),
                Some((path, _)) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            },
            (None, _) if self.trace.is_some() => "path trace".into(),
            (None, _) => "waits until nothing moves".into(),
            (Some(_), Against::BruteForce) => "brute force".into(),
            (Some(reference), _) => match reference.samples {
                None => "path trace, coarse at first".into(),
                Some(samples) if reference.noise.is_finite() => {
                    format!("path trace, {samples} samples, noise {:.1} %", 100.0 * reference.noise)
                }
                Some(samples) => format!("path trace, {samples} samples"),
            },
        };
        match &self.trace {
            Some(trace) => format!("{of}; next pass {:.0} %", 100.0 * trace.progress()),
            None => of,
        }
    }

    /// Shows the picture alone.
    pub(super) fn stop(&mut self) {
        self.shown = false;
        self.forget();
    }

    /// Forgets the reference: it is of something else.
    fn forget(&mut self) {
        (self.key, self.reference, self.errors, self.measured) = (None, None, None, None);
        self.images = [None, None];
        if let Some(trace) = &self.trace {
            trace.stop();
        }
    }

    /// One step after each frame: takes over what is new, begins what is missing, and waits for nothing but the device. `drew`
    /// says that the picture is another one. Comes back with the size that a file needs the picture to have.
    pub(super) fn step(&mut self, gpu: &Gpu, now: &Now<'_>, drew: bool) -> Result<Option<[u32; 2]>> {
        self.pictures += u64::from(drew);
        let size = self.take_file();
        let Settings { antialiasing, indirect, .. } = *now.engine.settings();
        let key = Key {
            against: self.against,
            view: now.view,
            size: now.picture.size(),
            edits: now.edits,
            spread: antialiasing != lightskin::frame::Antialiasing::Off,
            bounces: match indirect {
                Indirect::Caches(caches) if self.against == Against::SameBounces => caches.gather.bounces(),
                _ => 1,
            },
            settings: (self.against == Against::BruteForce)
                .then(|| Settings { indirect: Indirect::BruteForce, ..*now.engine.settings() }),
        };
        if self.key.as_ref().is_some_and(|made| *made != key) {
            self.forget();
        }
        if self.trace.as_ref().is_some_and(Trace::is_over) {
            self.take_trace(gpu)?;
            self.trace = None;
        }
        let rests = self.rest.is_over() && !now.busy;
        if self.shown && self.key.is_none() && self.trace.is_none() && rests {
            self.begin(gpu, now, key)?;
        }
        self.take_trace(gpu)?;
        self.measure(gpu, now, rests)?;
        Ok(size)
    }

    fn take_file(&mut self) -> Option<[u32; 2]> {
        let (path, thread) = self.loading.take_if(|(_, thread)| thread.is_finished())?;
        match thread.join().unwrap_or_else(|_| Err(anyhow!("{}: reading it failed", path.display()))) {
            Ok(reference) => {
                let size = reference.size;
                self.file = Some((path, Arc::new(reference)));
                self.forget();
                (self.against, self.shown) = (Against::File, true);
                Some(size)
            }
            Err(error) => {
                log::error!("{error:#}");
                None
            }
        }
    }

    fn begin(&mut self, gpu: &Gpu, now: &Now<'_>, key: Key) -> Result<()> {
        let of_engine = PathTraceSettings::engine(key.size, key.bounces);
        let settings = match key.against {
            Against::SameBounces => of_engine,
            _ => PathTraceSettings::of(key.size),
        };
        match key.against {
            Against::File => {
                let fits = |(_, file): &&(PathBuf, Arc<Reference>)| file.size == key.size;
                if let Some((_, file)) = self.file.as_ref().filter(fits) {
                    self.take(gpu, file.clone())?;
                }
            }
            Against::BruteForce => {
                let settings = key.settings.unwrap_or(*now.engine.settings());
                let (rgb, problems) = brute_force(gpu, now, &settings)?;
                self.problems.extend(problems);
                let values = Values::Radiance;
                let reference = Reference { size: key.size, rgb, values, coarse: false, samples: None, noise: 0.0 };
                self.take(gpu, Arc::new(reference))?;
            }
            Against::PathTrace | Against::SameBounces => {
                let settings = PathTraceSettings { spread: key.spread, ..settings };
                let (scene, camera) = (now.engine.scene().clone(), now.camera.clone());
                self.trace = Some(Trace::start(scene, camera, settings, self.most, self.rest.clone()));
            }
        }
        self.key = Some(key);
        Ok(())
    }

    fn take_trace(&mut self, gpu: &Gpu) -> Result<()> {
        let (Some(trace), Some(key)) = (&self.trace, &self.key) else { return Ok(()) };
        let Some(traced) = trace.newest() else { return Ok(()) };
        let values = Values::Radiance;
        let (rgb, samples, noise) = (traced.rgb, traced.samples, traced.noise);
        let coarse = samples.is_none();
        self.take(gpu, Arc::new(Reference { size: key.size, rgb, values, coarse, samples, noise }))
    }

    fn take(&mut self, gpu: &Gpu, reference: Arc<Reference>) -> Result<()> {
        let texels: Vec<[f32; 4]> = reference.rgb.iter().map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
        let [width, height] = reference.size;
        let bytes = bytemuck::cast_slice(&texels).to_vec();
        self.images[0] = Some(gpu.texture("window.reference", Format::R32G32B32A32_SFLOAT, width, height, &[bytes])?);
        self.reference = Some(reference);
        self.references += 1;
        Ok(())
    }

    fn measure(&mut self, gpu: &Gpu, now: &Now<'_>, rests: bool) -> Result<()> {
        if let Some((of, thread)) = self.measuring.take_if(|(_, thread)| thread.is_finished())
            && let (Ok((errors, map)), Some(reference)) = (thread.join(), self.reference.clone())
            && of.1 == self.references
        {
            let [width, height] = reference.size;
            self.images[1] = (of.2 != Map::Reference)
                .then(|| gpu.texture("window.map", Format::R8G8B8A8_UNORM, width, height, &[map]))
                .transpose()?;
            self.measured = Some(of);
            // Of a reference that does not change any more.
            if self.trace.is_none() && of == self.wanted() {
                let Errors { flip, relmse, bias, .. } = errors;
                print(&format!("errors    flip {flip:.6}, relmse {relmse:.6}, bias {bias:.6}: {}", self.state()));
            }
            self.errors = Some(errors);
        }
        if !rests || self.measuring.is_some() || !self.is_unmeasured() {
            return Ok(());
        }
        let Some(reference) = self.reference.clone() else { return Ok(()) };
        let image = match reference.values {
            Values::Radiance => radiance(gpu, now.picture)?,
            Values::Display => shown(gpu, now.picture)?,
        };
        let (map, rest) = (self.map, self.rest.clone());
        let thread = std::thread::spawn(move || rest.first(|| errors(&image, &reference, map)));
        self.measuring = Some((self.wanted(), thread));
        Ok(())
    }
}

/// Errors, and the map as RGBA.
fn errors(image: &[[f32; 3]], reference: &Reference, map: Map) -> (Errors, Vec<u8>) {
    let flips = flip(image, &reference.rgb, reference.size, reference.values, PIXELS_PER_DEGREE);
    let found = metrics(image, &reference.rgb);
    let mean = flips.iter().sum::<f64>() / flips.len() as f64;
    let (values, scale) = match map {
        Map::Reference => (Vec::new(), None),
        Map::Flip => (flips, Some(Scale::Linear(1.0))),
        Map::Relmse => (relative_squares(image, &reference.rgb), Some(Scale::Log(1e-6, 1.0))),
    };
    let colors = scale.map_or_else(Vec::new, |scale| heat::colors(&values, scale));
    (Errors { flip: mean, relmse: found.relmse, bias: found.bias, scale }, colors)
}

/// All radiance of a picture [cd/m^2].
fn radiance(gpu: &Gpu, picture: &Picture) -> Result<Vec<[f32; 3]>> {
    let indirect = picture.indirect.as_ref();
    let layers =
        [Some(&picture.surface.radiance), indirect.map(|i| &i.diffuse), indirect.and_then(|i| i.glossy.as_ref())];
    let [width, height] = picture.size().map(|side| side as usize);
    let mut all = vec![[0.0; 3]; width * height];
    for layer in layers.into_iter().flatten() {
        let texels: Vec<[f32; 4]> = gpu.read_image(layer)?;
        all.iter_mut().zip(texels).for_each(|(all, one)| (0..3).for_each(|c| all[c] += one[c]));
    }
    Ok(all)
}

/// The picture as a display shows it, linear.
fn shown(gpu: &Gpu, picture: &Picture) -> Result<Vec<[f32; 3]>> {
    let texels: Vec<[u8; 4]> = gpu.read_image(&picture.output.picture)?;
    let linear: Vec<f32> = (0..=255).map(lightskin::image::linear_from_srgb).collect();
    Ok(texels.iter().map(|t| [0, 1, 2].map(|c| linear[usize::from(t[c])])).collect())
}

/// One frame of the same view by other settings.
fn brute_force(gpu: &Gpu, now: &Now<'_>, settings: &Settings) -> Result<(Vec<[f32; 3]>, Vec<String>)> {
    let world = now.engine.world();
    let mut light = Light::new(gpu, now.engine.scene(), world, settings, 1)?;
    let mut picture = Picture::new(gpu, world, &light, now.picture.size())?;
    let frame = gpu.frame(|cmd| {
        record(cmd, world, &mut light, &mut [(now.view, &mut picture)], &Look::default());
        Ok(())
    })?;
    Ok((radiance(gpu, &picture)?, frame.problems))
}
