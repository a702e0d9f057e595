//! Loading of scenes in the background: from the file to caches on one thread, then onto the device on another. The old
//! scene stays visible, and can be edited, until the new one is complete.

use super::background::{Thread, joined};
use super::camera::{Free, Seen};
use super::document::{Document, copy_edits};
use super::recent;
use super::session::{self, Opened};
use super::undo::History;
use super::window::lost;
use crate::cli::lights::Lights;
use crate::cli::thousands;
use crate::cli::view::{View as Args, print};
use anyhow::Result;
use lightskin::frame::engine::{Loaded, Progress};
use lightskin::frame::{Engine, Picture, Settings};
use lightskin::gpu::{Gpu, trim_memory};
use lightskin::scene::{Material, Scene};
use std::collections::BTreeSet;
use std::path::Path;
use std::thread::JoinHandle;

/// What is being loaded, if anything is.
#[derive(Default)]
pub(super) struct Loading {
    job: Option<Job>,
    /// Another upload of the present scene, for edits or settings that need it.
    again: Option<Thread<Uploaded>>,
    /// Makes the pipelines that settings need.
    pipelines: Option<Thread<()>>,
    /// The settings for which pipelines were made last.
    made_for: Option<Settings>,
    /// `Document::changes` when such an upload failed and nothing could be taken back.
    refused: Option<u64>,
    /// Uploads whose results are no longer wanted. They cannot be stopped.
    replaced: Vec<Thread<Uploaded>>,
    /// Threads that drop scenes or write the list of recent scenes. Either can take longer than a frame.
    aside: Vec<Thread<()>>,
}

/// A scene that is being loaded, rebaked or uploaded.
struct Job {
    step: Step,
    progress: Progress,
    args: Args,
    /// Whether the state of the file replaces the current state. Otherwise edits are kept.
    anew: bool,
    /// The session to apply after loading.
    session: Option<Opened>,
}

enum Step {
    Load(JoinHandle<Result<Loaded>>),
    Upload(Thread<Uploaded>, Box<Prepared>),
}

/// A scene on the device.
struct Uploaded {
    engine: Engine,
    picture: Option<Picture>,
    /// Settings of its light.
    fitted: Settings,
}

/// What goes with a scene that is being uploaded.
struct Prepared {
    /// Whether the settings of its light were those of the window, which may have changed since.
    keeps_settings: bool,
    /// Number of caches.
    count: usize,
    lights: Lights,
    /// The lights as the file has them.
    of_file: Lights,
    /// The materials as the file has them.
    materials: Vec<Material>,
    /// `Document::changes` when the edits were copied to the scene.
    changes: u64,
}

impl Loading {
    /// Whether a scene is being loaded.
    pub(super) fn works(&self) -> bool {
        self.job.is_some()
    }

    /// Drops scenes on a thread that nobody waits for.
    fn drop_aside<T: Send + 'static>(&mut self, scenes: T) {
        self.put_aside(|| {
            drop(scenes);
            trim_memory();
        });
    }

    /// Does work on a thread that nobody waits for, until the device is closed.
    fn put_aside(&mut self, work: impl FnOnce() + Send + 'static) {
        self.aside.retain(|thread| !thread.is_finished());
        let work = move || {
            work();
            Ok(())
        };
        self.aside.push(Thread::start(work));
    }

    /// Replaces the job. Returns the old one; its upload, if it has begun, ends for nothing.
    fn replace(&mut self, job: Option<Job>) -> Option<Job> {
        let mut old = std::mem::replace(&mut self.job, job)?;
        if let Step::Upload(thread, _) = &mut old.step {
            self.replaced.push(std::mem::take(thread));
        }
        Some(old)
    }
}

impl Document {
    /// Starts to load a scene in the background. The old scene stays visible until then. A later call replaces the job.
    pub(super) fn open(&mut self, args: Args, anew: bool) {
        // Edits of a scene that is still being loaded go with the job that replaces its own.
        let (before, session) = self.loading.replace(None).map_or((false, None), |job| (job.anew, job.session));
        self.start(args, anew || before, session.filter(|_| !anew));
    }

    /// Opens a session in the background, like `open`.
    ///
    /// # Errors
    /// Fails if the file is not a valid session.
    pub(super) fn open_session(&mut self, file: &Path) -> Result<()> {
        let (args, session) = session::load(file, &self.args)?;
        self.start(args, true, Some(session));
        Ok(())
    }

    pub(super) fn start(&mut self, args: Args, anew: bool, session: Option<Opened>) {
        let progress = Progress::default();
        let (told, of_job, rest) = (progress.clone(), args.clone(), self.rest.clone());
        // The first scene is loaded on all cores. Later ones use one core, which pauses while the user moves something.
        let thread = match self.engine {
            None => std::thread::spawn(move || of_job.load(&|done, what| told.set(done, what))),
            Some(_) => std::thread::spawn(move || {
                rest.first(|| {
                    of_job.load(&|done, what| {
                        rest.pause();
                        told.set(done, what);
                    })
                })
            }),
        };
        self.loading.replace(Some(Job { step: Step::Load(thread), progress, args, anew, session }));
    }

    /// Waits for threads that use the device. A scene that is being uploaded is loaded again. The present one is not: it
    /// will be uploaded to the next device.
    pub(super) fn load_again(&mut self) {
        if matches!(&self.loading.job, Some(Job { step: Step::Upload(..), .. }))
            && let Some(job) = self.loading.replace(None)
        {
            self.start(job.args, job.anew, job.session);
        }
        (self.loading.again, self.loading.pipelines, self.loading.made_for) = (None, None, None);
        self.loading.replaced.clear();
        self.loading.aside.clear();
    }

    /// The arguments of the scene that is being loaded, or of the present one.
    pub(super) fn wanted(&self) -> &Args {
        self.loading.job.as_ref().map_or(&self.args, |job| &job.args)
    }

    /// Whether edits or settings are not visible yet, because something is made for them on another thread.
    pub(super) fn is_behind(&self) -> bool {
        self.needs_upload() || self.loading.pipelines.is_some()
    }

    /// Whether edits or settings need another upload of the scene.
    pub(super) fn needs_upload(&self) -> bool {
        self.engine.as_ref().is_some_and(|engine| engine.is_behind() || !engine.is_ready_for(&self.settings))
    }

    /// Progress of the job from 0 to 1, and its current step. `None` without a job.
    pub(super) fn progress(&self) -> Option<(f32, String)> {
        let again = || self.loading.again.as_ref().map(|_| (1.0, "upload".to_owned()));
        let pipelines = || self.loading.pipelines.as_ref().map(|_| (1.0, "compile shaders".to_owned()));
        self.loading.job.as_ref().map(|job| job.progress.get()).or_else(again).or_else(pipelines)
    }

    /// Continues with the result of a finished step. Returns whether a scene was loaded. Never waits. If a scene does not
    /// load, or does not fit in memory beside the old one, the old one stays.
    ///
    /// # Errors
    /// Fails if the first scene does not load, because there is nothing to show. Also fails if the device is lost; then
    /// the job starts again.
    pub(super) fn poll(&mut self, gpu: &Gpu) -> Result<bool> {
        let replaced: Vec<_> = self.loading.replaced.extract_if(.., |thread| thread.is_finished()).collect();
        if !replaced.is_empty() {
            self.loading.drop_aside(replaced);
        }
        if let Some(thread) = self.loading.again.take_if(|thread| thread.is_finished()) {
            match thread.join().and_then(|uploaded| self.take_again(gpu, uploaded)) {
                Err(error) if lost::is_loss(&error) => return Err(error),
                Err(error) => self.refuse(gpu, &error),
                Ok(()) => {}
            }
        }
        let is_finished = |job: &mut Job| match &job.step {
            Step::Load(thread) => thread.is_finished(),
            Step::Upload(thread, _) => thread.is_finished(),
        };
        let Some(Job { step, progress, args, anew, session }) = self.loading.job.take_if(is_finished) else {
            return Ok(false);
        };
        let done = match step {
            Step::Load(thread) => joined(thread)
                .and_then(|loaded| self.upload(gpu, loaded, (&args, anew, session.as_ref()), &progress))
                .map(Some),
            Step::Upload(thread, prepared) => thread
                .join()
                .and_then(|uploaded| self.take(gpu, uploaded, *prepared, (&args, anew, session.as_ref())))
                .map(|()| None),
        };
        match (done, &self.engine) {
            (Ok(Some(step)), _) => self.loading.job = Some(Job { step, progress, args, anew, session }),
            (Ok(None), _) => return Ok(true),
            (Err(error), _) if lost::is_loss(&error) => {
                self.start(args, anew, session);
                return Err(error);
            }
            (Err(error), Some(_)) => log::error!("{error:#}; the scene stays as it was"),
            (Err(error), None) => return Err(error),
        }
        Ok(false)
    }

    /// Takes back what needed another upload that has failed: the last edit, or else the settings.
    fn refuse(&mut self, gpu: &Gpu, error: &anyhow::Error) {
        if self.engine.as_ref().is_some_and(|engine| !engine.is_behind()) {
            log::error!("{error:#}; the previous settings are restored");
            self.settings = self.fitted;
        } else if self.history.can_undo() {
            log::error!("{error:#}; the last edit is undone");
            self.undo(gpu, false);
        } else {
            log::error!("{error:#}; the picture lacks the last edits");
            self.loading.refused = Some(self.changes);
        }
    }

    /// Copies edits to a loaded scene, and starts to upload it.
    fn upload(
        &self,
        gpu: &Gpu,
        mut loaded: Loaded,
        (args, anew, session): (&Args, bool, Option<&Opened>),
        progress: &Progress,
    ) -> Result<Step> {
        let count = loaded
            .caches
            .as_ref()
            .map_or(0, |caches| caches.instance_model.iter().map(|model| caches.models[*model].caches.len()).sum());
        let (of_file, materials) = (Lights::of(&loaded.scene), loaded.scene.materials.clone());
        let mut lights = of_file.clone();
        if let Some(old) = self.engine.as_ref().filter(|_| !anew && session.is_none()) {
            keep_edits(old.scene(), &mut loaded.scene, &self.edited);
            lights = of_file.clone().keeping(&self.lights);
        }
        lights.apply(&mut loaded.scene);
        let mut settings = args.settings(count, self.ways);
        // Keep the chosen settings if only the number of caches or the contents of the file have changed.
        let keeps_settings = session.is_none() && self.shows(args) && args.quality() == self.args.quality();
        if keeps_settings {
            settings = self.settings;
        }
        if let Some(Opened { session, .. }) = session {
            lights = session.change(&mut loaded.scene);
        }
        let prepared = Prepared { keeps_settings, count, lights, of_file, materials, changes: self.changes };
        progress.set(1.0, "upload");
        Ok(Step::Upload(self.upload_thread(gpu, settings, || loaded), Box::new(prepared)))
    }

    /// Starts to upload the present scene again, unless it is being done.
    pub(super) fn upload_again(&mut self, gpu: &Gpu) {
        let (None, Some(engine)) = (&self.loading.again, &self.engine) else { return };
        if self.loading.refused == Some(self.changes) {
            return;
        }
        let (scene, caches) = (engine.scene().clone(), engine.baked().cloned());
        let loaded = move || Loaded { scene: Scene::clone(&scene), caches };
        self.loading.again = Some(self.upload_thread(gpu, self.settings, loaded));
    }

    /// Puts a scene onto the device on another thread.
    fn upload_thread(
        &self,
        gpu: &Gpu,
        settings: Settings,
        loaded: impl FnOnce() -> Loaded + Send + 'static,
    ) -> Thread<Uploaded> {
        let (device, size) = (gpu.device().clone(), self.picture.as_ref().map_or(self.asked, Picture::size));
        // All of the new scene must fit, so that the old one can stay if it does not.
        let make = move || -> Result<Uploaded> {
            let loaded = loaded();
            let engine = Engine::new(&device, loaded, &settings)?;
            let picture = Some(size).filter(|size| !size.contains(&0)).map(|size| engine.picture(&device, size));
            Ok(Uploaded { picture: picture.transpose()?, engine, fitted: settings })
        };
        let rest = self.rest.clone();
        match self.engine {
            None => Thread::start(make),
            Some(_) => Thread::start(move || rest.first(make)),
        }
    }

    /// Whether the pipelines of the requested settings are there. Otherwise another thread makes them. What the device
    /// refuses there it refuses again when light is made with these settings.
    pub(super) fn has_pipelines(&mut self, gpu: &Gpu, size: [u32; 2]) -> bool {
        if let Some(thread) = self.loading.pipelines.take_if(|thread| thread.is_finished()) {
            drop(thread.join());
        }
        let is_new = self.settings != self.fitted && self.loading.made_for != Some(self.settings);
        let Some(engine) = self.engine.as_ref().filter(|_| is_new && self.drawn.is_some()) else {
            return self.loading.pipelines.is_none();
        };
        if self.loading.pipelines.is_none() {
            self.loading.made_for = Some(self.settings);
            let size = Some(size).filter(|size| !size.contains(&0));
            let missing = engine.missing(gpu, &self.settings, size).ok().filter(|missing| !missing.is_empty());
            let (device, rest) = (gpu.device().clone(), self.rest.clone());
            self.loading.pipelines =
                missing.map(|missing| Thread::start(move || rest.first(|| Ok(device.make(missing)?))));
        }
        self.loading.pipelines.is_none()
    }

    /// Whether the present scene is from the file of these arguments, even with another sky or other caches.
    fn shows(&self, args: &Args) -> bool {
        self.engine.is_some() && args.scene == self.args.scene
    }

    /// Shows the present scene as it was uploaded again, with all edits since. If these need yet another upload, it
    /// follows.
    fn take_again(&mut self, gpu: &Gpu, Uploaded { mut engine, picture, fitted }: Uploaded) -> Result<()> {
        // What needed the upload may have been undone.
        let (true, Some(old)) = (self.needs_upload(), &self.engine) else {
            self.loading.drop_aside((engine, picture));
            return Ok(());
        };
        engine.show(gpu, old.scene().clone())?;
        self.replace(engine, picture, fitted);
        Ok(())
    }

    /// Replaces the scene on the device.
    fn replace(&mut self, engine: Engine, picture: Option<Picture>, fitted: Settings) {
        let old = (self.engine.replace(engine), std::mem::replace(&mut self.picture, picture));
        self.loading.drop_aside(old);
        (self.fitted, self.refused) = (fitted, None);
    }

    /// Shows a scene that is on the device.
    fn take(
        &mut self,
        gpu: &Gpu,
        Uploaded { mut engine, picture, fitted }: Uploaded,
        Prepared { keeps_settings, count, mut lights, of_file, materials, changes }: Prepared,
        (args, anew, session): (&Args, bool, Option<&Opened>),
    ) -> Result<()> {
        // Edits made during the upload.
        if let Some(old) = self.engine.as_ref().filter(|_| !anew && session.is_none() && changes != self.changes) {
            lights = of_file.keeping(&self.lights);
            engine.edit_in_place(gpu, |scene| {
                keep_edits(old.scene(), scene, &self.edited);
                lights.apply(scene);
            })?;
        }
        let same = anew && self.shows(args);
        let settings = if keeps_settings { self.settings } else { fitted };
        self.replace(engine, picture, fitted);
        self.changes += 1;
        // The upload that it needs follows.
        self.loading.replaced.extend(self.loading.again.take());
        self.of_file = materials;
        (self.pixel, self.video) = (None, None);
        self.gizmo.clear();
        // Steps of other lights cannot be undone.
        if anew || !lights.has_the_file_of(&self.lights) {
            self.history = History::default();
        }
        if !anew {
            lights.chosen = self.lights.chosen.filter(|index| *index < lights.lamps.len());
        }
        self.lights = lights;
        if anew {
            self.edited.clear();
        }
        (self.args, self.settings, self.caches) = (args.clone(), settings, count);
        self.look.behind = self.args.look().behind;
        let scene = self.engine.as_ref().map(|engine| engine.scene().clone()).unwrap_or_default();
        print(&format!(
            "scene     {}: {} triangles, {} caches",
            scene.name,
            thousands(scene.triangle_count()),
            thousands(count)
        ));
        if anew && !same {
            self.bookmarks = [None; 9];
            self.clip.animation = None;
            (self.clip.time, self.clip.playing) = (0.0, false);
            self.seen = self.args.camera.as_ref().map_or(Seen::OfScene(0), |wanted| begin_at(&scene, wanted));
        }
        self.clip.animation = self.clip.animation.filter(|clip| *clip < scene.animations().count());
        let is_there = |seen: &Seen| !matches!(seen, Seen::OfScene(index) if *index >= scene.cameras.len());
        self.bookmarks = self.bookmarks.map(|seen| seen.filter(is_there));
        if let Seen::OfScene(index) = self.seen
            && index >= scene.cameras.len()
        {
            self.seen = Seen::OfScene(0);
        }
        if let Some(Opened { session, .. }) = session {
            session::apply(session, self);
        }
        if session.is_some() || (anew && !same) {
            self.session = session.map(|opened| opened.file.clone());
        }
        if self.clip.animation.is_some() {
            self.pose(gpu);
        }
        if let Some(path) = self.args.scene.clone().filter(|_| anew) {
            self.recent = recent::with(&path, std::mem::take(&mut self.recent));
            self.loading.put_aside(move || recent::add(&path));
        }
        Ok(())
    }
}

/// The camera that `--camera` requests.
fn begin_at(scene: &Scene, wanted: &str) -> Seen {
    let index = wanted.parse().ok().or_else(|| scene.cameras.iter().position(|camera| camera.name == wanted));
    match (Free::parse(wanted), index) {
        (Some(free), _) => Seen::Free(free),
        (None, index) => Seen::OfScene(index.unwrap_or(0)),
    }
}

/// Copies visibility and edited materials from the old scene, if the new scene has the same number of each.
fn keep_edits(old: &Scene, new: &mut Scene, edited: &BTreeSet<usize>) {
    if old.instances.len() == new.instances.len() {
        for (old, new) in old.instances.iter().zip(&mut new.instances) {
            (new.hidden, new.moves) = (old.hidden, old.moves);
        }
    }
    if old.materials.len() == new.materials.len() {
        for index in edited {
            copy_edits(&old.materials[*index], &mut new.materials[*index]);
        }
    }
}
