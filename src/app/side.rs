//! One side of a comparison: where its picture comes from, and what there is of it.

use super::background::Rest;
use super::compare::Now;
use super::reference::{BruteForce, Trace};
use anyhow::{Result, anyhow};
use lightskin::frame::{Antialiasing, Indirect, Settings, View};
use lightskin::gpu::{Format, Gpu, Image};
use lightskin::image::{is_exr, read_picture};
use lightskin::metrics::display::Values;
use lightskin::reference::path_trace::PathTraceSettings;
use lightskin::shared::{LAYER_RADIANCE, LAYER_REFLECTANCE};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Where a picture comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// What the window shows without a comparison.
    Lightskin,
    /// The path tracer, all light.
    PathTrace,
    /// The path tracer with the engine's number of bounces, diffuse but for the last.
    SameBounces,
    /// Every virtual light onto every pixel.
    BruteForce,
    /// A file.
    File,
}

/// A reference.
pub(super) struct Reference {
    size: [u32; 2],
    pub(super) rgb: Vec<[f32; 3]>,
    pub(super) values: Values,
    /// Whether it is smaller than the picture yet, and shown enlarged.
    coarse: bool,
    /// Samples per pixel of a path trace.
    samples: Option<u32>,
    noise: f64,
}

/// What a reference was made of.
#[derive(Clone, PartialEq)]
struct Key {
    source: Source,
    view: View,
    size: [u32; 2],
    edits: u64,
    spread: bool,
    bounces: u32,
    /// Where they matter.
    settings: Option<Settings>,
}

/// A side.
pub(super) struct Side {
    pub(super) source: Source,
    /// Most samples per pixel.
    most: u32,
    file: Option<(PathBuf, Arc<Reference>)>,
    loading: Option<(PathBuf, JoinHandle<Result<Reference>>)>,
    key: Option<Key>,
    trace: Option<Trace>,
    brute_force: Option<BruteForce>,
    reference: Option<Arc<Reference>>,
    image: Option<Image>,
    /// Counts references.
    pub(super) made: u64,
}

impl Side {
    pub(super) fn new(source: Source, most: u32) -> Self {
        Self {
            source,
            most,
            file: None,
            loading: None,
            key: None,
            trace: None,
            brute_force: None,
            reference: None,
            image: None,
            made: 0,
        }
    }

    /// Reads a picture in the background, and shows it then.
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

    /// Whether it is to show a file and there is none.
    pub(super) fn waits_for_file(&self) -> bool {
        self.source == Source::File && self.file.is_none() && self.loading.is_none()
    }

    pub(super) fn file_size(&self) -> Option<[u32; 2]> {
        self.file.as_ref().filter(|_| self.source == Source::File).map(|(_, file)| file.size)
    }

    /// What is shown; none for lightskin's picture.
    pub(super) fn reference(&self) -> Option<Arc<Reference>> {
        self.reference.clone()
    }

    /// The same as an image, and how it is shown: a `LAYER_*`.
    pub(super) fn image(&self) -> Option<(&Image, u32)> {
        let reference = self.reference.as_ref()?;
        let how = if reference.values == Values::Radiance { LAYER_RADIANCE } else { LAYER_REFLECTANCE };
        Some((self.image.as_ref()?, how))
    }

    /// Whether there is a picture.
    pub(super) fn is_there(&self) -> bool {
        self.source == Source::Lightskin || self.reference.is_some()
    }

    /// Whether there is a picture of all its pixels.
    pub(super) fn is_whole(&self) -> bool {
        self.source == Source::Lightskin || self.reference.as_ref().is_some_and(|reference| !reference.coarse)
    }

    /// Whether something is under way.
    pub(super) fn works(&self) -> bool {
        self.loading.is_some() || self.trace.is_some() || self.brute_force.is_some()
    }

    /// Whether something has to begin.
    pub(super) fn waits(&self) -> bool {
        self.source != Source::Lightskin && self.key.is_none()
    }

    /// Whether it goes on with each frame.
    pub(super) fn hurries(&self) -> bool {
        self.brute_force.is_some()
    }

    /// What it is, in words.
    pub(super) fn state(&self) -> String {
        let of = match (&self.reference, self.source) {
            (_, Source::Lightskin) => "lightskin".into(),
            _ if self.loading.is_some() => "reading the file".into(),
            (_, Source::File) => match &self.file {
                None => "drop a PNG here, or an EXR while the reference shows".into(),
                Some((path, _)) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            },
            (None, _) if self.trace.is_some() => "path trace".into(),
            (_, Source::BruteForce) if self.works() => "brute force".into(),
            (None, _) => "waits until nothing moves".into(),
            (Some(_), Source::BruteForce) => "brute force".into(),
            (Some(reference), _) => match reference.samples {
                None => "path trace, coarse at first".into(),
                Some(samples) if reference.noise.is_finite() => {
                    format!("path trace, {samples} samples, noise {:.1} %", 100.0 * reference.noise)
                }
                Some(samples) => format!("path trace, {samples} samples"),
            },
        };
        let progress = self.trace.as_ref().map(Trace::progress).or(self.brute_force.as_ref().map(BruteForce::progress));
        match progress {
            Some(done) => format!("{of}; next pass {:.0} %", 100.0 * done),
            None => of,
        }
    }

    /// Forgets what it shows: that is of something else.
    pub(super) fn forget(&mut self) {
        (self.key, self.reference, self.image, self.brute_force) = (None, None, None, None);
        if let Some(trace) = &self.trace {
            trace.stop();
        }
    }

    /// One step after each frame: takes over what is new, and begins or goes on where it may. Comes back with the size that a
    /// new file needs the picture to have.
    pub(super) fn step(
        &mut self,
        gpu: &Gpu,
        now: &Now<'_>,
        (may, rest): (bool, &Rest),
        problems: &mut Vec<String>,
    ) -> Result<Option<[u32; 2]>> {
        let size = self.take_file();
        let Settings { antialiasing, indirect, .. } = *now.engine.settings();
        let key = Key {
            source: self.source,
            view: now.view,
            size: now.picture.size(),
            edits: now.edits,
            spread: antialiasing != Antialiasing::Off,
            bounces: match indirect {
                Indirect::Caches(caches) if self.source == Source::SameBounces => caches.gather.bounces(),
                _ => 1,
            },
            settings: (self.source == Source::BruteForce).then(|| Settings {
                indirect: Indirect::BruteForce,
                reuse: true,
                ..*now.engine.settings()
            }),
        };
        if self.key.as_ref().is_some_and(|made| *made != key) {
            self.forget();
        }
        if self.trace.as_ref().is_some_and(Trace::is_over) {
            self.take_trace(gpu)?;
            self.trace = None;
        }
        if may && self.waits() && self.trace.is_none() {
            self.begin(gpu, now, key, rest)?;
        } else if let Some(brute_force) = self.brute_force.as_mut().filter(|_| may)
            && let Some(rgb) = brute_force.step(gpu, now, problems)?
        {
            let (size, values) = (now.picture.size(), Values::Radiance);
            self.brute_force = None;
            self.take(gpu, Arc::new(Reference { size, rgb, values, coarse: false, samples: None, noise: 0.0 }))?;
        }
        self.take_trace(gpu)?;
        Ok(size)
    }

    fn take_file(&mut self) -> Option<[u32; 2]> {
        let (path, thread) = self.loading.take_if(|(_, thread)| thread.is_finished())?;
        match thread.join().unwrap_or_else(|_| Err(anyhow!("{}: reading it failed", path.display()))) {
            Ok(reference) => {
                let size = reference.size;
                self.file = Some((path, Arc::new(reference)));
                self.forget();
                self.source = Source::File;
                Some(size)
            }
            Err(error) => {
                log::error!("{error:#}");
                None
            }
        }
    }

    fn begin(&mut self, gpu: &Gpu, now: &Now<'_>, key: Key, rest: &Rest) -> Result<()> {
        let settings = match key.source {
            Source::SameBounces => PathTraceSettings::engine(key.size, key.bounces),
            _ => PathTraceSettings::of(key.size),
        };
        match key.source {
            Source::Lightskin => {}
            Source::File => {
                let fits = |(_, file): &&(PathBuf, Arc<Reference>)| file.size == key.size;
                if let Some((_, file)) = self.file.as_ref().filter(fits) {
                    self.take(gpu, file.clone())?;
                }
            }
            Source::BruteForce => {
                let settings = key.settings.unwrap_or(*now.engine.settings());
                self.brute_force = Some(BruteForce::new(gpu, now, &settings)?);
            }
            Source::PathTrace | Source::SameBounces => {
                let settings = PathTraceSettings { spread: key.spread, ..settings };
                let (scene, camera) = (now.engine.scene().clone(), now.camera.clone());
                self.trace = Some(Trace::start(scene, camera, settings, self.most, rest.clone()));
            }
        }
        self.key = Some(key);
        Ok(())
    }

    fn take_trace(&mut self, gpu: &Gpu) -> Result<()> {
        let (Some(trace), Some(key)) = (&self.trace, &self.key) else { return Ok(()) };
        let Some(traced) = trace.newest() else { return Ok(()) };
        let (size, values) = (key.size, Values::Radiance);
        let (rgb, samples, noise) = (traced.rgb, traced.samples, traced.noise);
        self.take(gpu, Arc::new(Reference { size, rgb, values, coarse: samples.is_none(), samples, noise }))
    }

    fn take(&mut self, gpu: &Gpu, reference: Arc<Reference>) -> Result<()> {
        let texels: Vec<[f32; 4]> = reference.rgb.iter().map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
        let [width, height] = reference.size;
        let bytes = bytemuck::cast_slice(&texels).to_vec();
        self.image = Some(gpu.texture("window.reference", Format::R32G32B32A32_SFLOAT, width, height, &[bytes])?);
        self.reference = Some(reference);
        self.made += 1;
        Ok(())
    }
}
