//! One side of a comparison: the source of its picture and its progress.

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

/// Source of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// Lightskin's picture, which the window shows without a comparison.
    Lightskin,
    /// The path tracer with all light paths.
    PathTrace,
    /// The path tracer with the engine's number of bounces, of which only the last is glossy.
    SameBounces,
    /// Brute force: every virtual light at every pixel.
    BruteForce,
    /// A file.
    File,
}

/// A reference picture.
pub(super) struct Reference {
    size: [u32; 2],
    pub(super) rgb: Vec<[f32; 3]>,
    pub(super) values: Values,
    /// Whether it was rendered at a smaller size and enlarged.
    coarse: bool,
    /// Samples per pixel of a path trace.
    samples: Option<u32>,
    noise: f64,
}

/// The inputs of a reference. It is discarded when they change.
#[derive(Clone, PartialEq)]
struct Key {
    source: Source,
    view: View,
    size: [u32; 2],
    changes: u64,
    spread: bool,
    bounces: u32,
    /// Settings of brute force. `None` for other sources, which do not depend on them.
    settings: Option<Settings>,
}

/// A side of the comparison.
pub(super) struct Side {
    pub(super) source: Source,
    /// Samples per pixel at which the path tracer stops.
    most: u32,
    file: Option<(PathBuf, Arc<Reference>)>,
    loading: Option<(PathBuf, JoinHandle<Result<Reference>>)>,
    key: Option<Key>,
    trace: Option<Trace>,
    brute_force: Option<BruteForce>,
    reference: Option<Arc<Reference>>,
    image: Option<Image>,
    /// Number of references so far.
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

    /// Reads a picture in the background and shows it when it is loaded.
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

    /// Whether the source is a file, but none has been given.
    pub(super) fn waits_for_file(&self) -> bool {
        self.source == Source::File && self.file.is_none() && self.loading.is_none()
    }

    pub(super) fn file_size(&self) -> Option<[u32; 2]> {
        self.file.as_ref().filter(|_| self.source == Source::File).map(|(_, file)| file.size)
    }

    /// The reference that is shown. `None` for lightskin's picture.
    pub(super) fn reference(&self) -> Option<Arc<Reference>> {
        self.reference.clone()
    }

    /// The image of the reference, and how to show it: a `LAYER_*`.
    pub(super) fn image(&self) -> Option<(&Image, u32)> {
        let reference = self.reference.as_ref()?;
        let how = if reference.values == Values::Radiance { LAYER_RADIANCE } else { LAYER_REFLECTANCE };
        Some((self.image.as_ref()?, how))
    }

    /// Whether there is a picture.
    pub(super) fn is_there(&self) -> bool {
        self.source == Source::Lightskin || self.reference.is_some()
    }

    /// Whether there is a picture at full size.
    pub(super) fn is_whole(&self) -> bool {
        self.source == Source::Lightskin || self.reference.as_ref().is_some_and(|reference| !reference.coarse)
    }

    /// Whether a reference is being loaded or computed.
    pub(super) fn works(&self) -> bool {
        self.loading.is_some() || self.trace.is_some() || self.brute_force.is_some()
    }

    /// Whether a reference is needed and not yet started.
    pub(super) fn waits(&self) -> bool {
        self.source != Source::Lightskin && self.key.is_none()
    }

    /// Whether each frame advances the reference.
    pub(super) fn hurries(&self) -> bool {
        self.brute_force.as_ref().is_some_and(BruteForce::hurries)
    }

    /// A description of the side.
    pub(super) fn state(&self) -> String {
        let of = match (&self.reference, self.source) {
            (_, Source::Lightskin) => "lightskin".into(),
            _ if self.loading.is_some() => "reading the file".into(),
            (_, Source::File) => match &self.file {
                None => "drop a PNG here, or an EXR while the reference is shown".into(),
                Some((path, _)) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            },
            (None, _) if self.trace.is_some() => "path trace".into(),
            (_, Source::BruteForce) if self.works() => "brute force".into(),
            (None, _) => "starts when nothing moves".into(),
            (Some(_), Source::BruteForce) => "brute force".into(),
            (Some(reference), _) => match reference.samples {
                None => "path trace, coarse preview".into(),
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

    /// Drops everything on the device. The next step uploads the reference to another.
    pub(super) fn leave_device(&mut self) {
        self.image = None;
        if self.brute_force.take().is_some() {
            self.key = None;
        }
    }

    /// Discards the reference and stops its computation.
    pub(super) fn forget(&mut self) {
        (self.key, self.reference, self.image, self.brute_force) = (None, None, None, None);
        if let Some(trace) = &self.trace {
            trace.stop();
        }
    }

    /// Advances by one step after each frame: takes over new results, and starts or continues work if `may` allows it.
    /// Returns the size that the picture needs for a newly loaded file.
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
            changes: now.changes,
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
        // Another upload of the scene leaves the key as it is, but not what the light was created for.
        let fits = self.brute_force.as_ref().is_none_or(|brute_force| brute_force.fits(now.engine));
        if !fits || self.key.as_ref().is_some_and(|made| *made != key) {
            self.forget();
        }
        if let (Some(reference), None) = (self.reference.clone(), &self.image) {
            self.take(gpu, reference)?;
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
                self.brute_force = Some(BruteForce::new(gpu, now, &settings, rest)?);
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
