//! The open document: a scene with its light, camera and display settings, and the job that loads the next scene.

use super::background::Rest;
use super::camera::{Free, Seen, point_at};
use super::canvas::Shown;
use super::gizmo::Gizmo;
use super::inset::Insets;
use super::marks::Marks;
use super::pixel::Pixel;
use super::recent;
use super::session::{self, Opened};
use super::undo::History;
use super::video::Video;
use super::watch::Watch;
use super::window::lost;
use crate::cli::lights::Lights;
use crate::cli::session::is_session;
use crate::cli::thousands;
use crate::cli::view::{Now, View as Args, print};
use anyhow::{Result, anyhow};
use glam::DVec3;
use lightskin::frame::engine::{Loaded, Progress};
use lightskin::frame::settings::{Caches, Gather};
use lightskin::frame::{Engine, Exposure, Indirect, Look, Picture, Settings, View, Ways, tune};
use lightskin::gpu::{FrameTimes, Gpu};
use lightskin::scene::{Camera, Material, Scene};
use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// Number of frames whose times are kept.
const HISTORY: usize = 600;

/// A scene that is being loaded or rebaked in the background.
struct Job {
    thread: JoinHandle<Result<Loaded>>,
    progress: Progress,
    args: Args,
    /// Whether the state of the file replaces the current state. Otherwise edits are kept.
    anew: bool,
    /// The session to apply after loading.
    session: Option<Opened>,
}

/// Playback state of an animation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Clip {
    /// Index of the animation. `None` for a scene at rest.
    pub(super) animation: Option<usize>,
    /// Time within the animation [s].
    pub(super) time: f64,
    pub(super) playing: bool,
    /// Playback speed, 1 for real time.
    pub(super) speed: f64,
}

/// Times of one frame.
pub(super) struct Timed {
    /// Sum of the times of all stages [ms].
    pub(super) ms: f64,
    /// Name and time [ms] of each stage.
    pub(super) stages: Vec<(&'static str, f64)>,
}

/// A scene on the device and everything that can be edited.
pub(super) struct Document {
    /// Arguments with which the scene was loaded and baked.
    pub(super) args: Args,
    pub(super) engine: Option<Engine>,
    pub(super) picture: Option<Picture>,
    /// Requested settings, used from the next frame on.
    pub(super) settings: Settings,
    /// The last settings that the device supported.
    pub(super) fitted: Settings,
    /// Size of the picture [pixels] for which memory ran out, and the settings with which it did.
    refused: Option<([u32; 2], Settings)>,
    /// View of the last frame.
    pub(super) drawn: Option<View>,
    pub(super) look: Look,
    pub(super) shown: Shown,
    /// Ends of the false-colour scales of distance [m] and luminance [cd/m^2].
    pub(super) scales: [[f32; 2]; 2],
    pub(super) marks: Marks,
    pub(super) insets: Insets,
    /// The pixel that was picked last.
    pub(super) pixel: Option<Pixel>,
    pub(super) seen: Seen,
    pub(super) bookmarks: [Option<Seen>; 9],
    pub(super) clip: Clip,
    /// The video that is being written.
    pub(super) video: Option<Video>,
    pub(super) lights: Lights,
    pub(super) gizmo: Gizmo,
    /// Number of caches in the whole scene.
    pub(super) caches: usize,
    pub(super) times: VecDeque<Timed>,
    /// Steps that can be undone.
    pub(super) history: History,
    /// Number of changes of the scene so far.
    pub(super) changes: u64,
    /// Index of the material that the panel shows.
    pub(super) material: usize,
    /// Indices of the materials that were edited.
    pub(super) edited: BTreeSet<usize>,
    /// The materials of the file.
    pub(super) of_file: Vec<Material>,
    /// File of the session, if it has one.
    pub(super) session: Option<PathBuf>,
    watch: Option<Watch>,
    job: Option<Job>,
    ways: Ways,
    rest: Rest,
}

impl Document {
    /// Starts to load the scene of the command line.
    pub(super) fn new(gpu: &Gpu, args: &Args, rest: Rest) -> Result<Self> {
        let ways = tune::fastest(gpu)?.ways;
        let settings = usual(args, args.cache_count(), ways);
        let mut document = Self {
            args: args.clone(),
            engine: None,
            picture: None,
            settings,
            fitted: settings,
            refused: None,
            drawn: None,
            look: args.look(),
            shown: Shown::Picture,
            scales: [[0.1, 10.0], [1.0, 1000.0]],
            marks: Marks::default(),
            insets: Insets::default(),
            pixel: None,
            seen: Seen::OfScene(0),
            bookmarks: [None; 9],
            clip: Clip { animation: None, time: 0.0, playing: false, speed: 1.0 },
            video: None,
            lights: Lights::default(),
            gizmo: Gizmo::default(),
            caches: 0,
            times: VecDeque::new(),
            history: History::default(),
            changes: 0,
            material: 0,
            edited: BTreeSet::new(),
            of_file: Vec::new(),
            session: None,
            watch: None,
            job: None,
            ways,
            rest,
        };
        match args.scene.as_deref().filter(|path| is_session(path)) {
            Some(file) => document.open_session(file)?,
            None => document.open(args.clone(), true),
        }
        Ok(document)
    }

    /// Starts to load a scene in the background. The old scene stays visible until then. A later call replaces the job.
    pub(super) fn open(&mut self, args: Args, anew: bool) {
        // Edits of a scene that is still being loaded go with the job that replaces its own.
        let (before, session) = self.job.take().map_or((false, None), |job| (job.anew, job.session));
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

    fn start(&mut self, args: Args, anew: bool, session: Option<Opened>) {
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
        self.job = Some(Job { thread, progress, args, anew, session });
    }

    /// Reloads the scene if watching is on and its files have changed.
    pub(super) fn watch(&mut self) {
        let Some(scene) = self.args.scene.clone().filter(|_| self.args.watch && self.job.is_none()) else { return };
        match &mut self.watch {
            Some(watch) if watch.is_of(&scene) => {
                if watch.has_changed() {
                    log::warn!("{} has changed and is reloaded", scene.display());
                    self.start(self.args.clone(), true, None);
                }
            }
            watch => *watch = Some(Watch::new(&scene)),
        }
    }

    /// The arguments of the scene that is being loaded, or of the present one.
    pub(super) fn wanted(&self) -> &Args {
        self.job.as_ref().map_or(&self.args, |job| &job.args)
    }

    /// Progress of the job from 0 to 1, and its current step. `None` without a job.
    pub(super) fn progress(&self) -> Option<(f32, String)> {
        self.job.as_ref().map(|job| job.progress.get())
    }

    /// Takes over the result of a finished job. Returns whether a job had finished. Never waits. If a scene does not
    /// load, or does not fit in memory beside the old one, the old one stays.
    ///
    /// # Errors
    /// Fails if the first scene does not load, because there is nothing to show. Also fails if the device is lost; then
    /// the job starts again.
    pub(super) fn poll(&mut self, gpu: &Gpu) -> Result<bool> {
        let Some(job) = self.job.take_if(|job| job.thread.is_finished()) else { return Ok(false) };
        let made = job.thread.join().map_err(|_| anyhow!("a background job panicked; this is a bug of lightskin"));
        let taken = made.and_then(|loaded| self.take(gpu, loaded?, (job.args.clone(), job.anew), job.session.as_ref()));
        match (taken, &self.engine) {
            (Err(error), _) if lost::is_loss(&error) => {
                self.start(job.args, job.anew, job.session);
                return Err(error);
            }
            (Err(error), Some(_)) => log::error!("{error:#}; the scene stays as it was"),
            (Err(error), None) => return Err(error),
            (Ok(()), _) => {}
        };
        Ok(true)
    }

    fn take(
        &mut self,
        gpu: &Gpu,
        mut loaded: Loaded,
        (args, anew): (Args, bool),
        session: Option<&Opened>,
    ) -> Result<()> {
        let count = loaded
            .caches
            .as_ref()
            .map_or(0, |caches| caches.instance_model.iter().map(|model| caches.models[*model].caches.len()).sum());
        let mut settings = usual(&args, count, self.ways);
        let of_file = loaded.scene.materials.clone();
        let mut lights = match &self.engine {
            Some(old) if !anew && session.is_none() => {
                keep_edits(old.scene(), &mut loaded.scene, &self.edited);
                Lights::kept(&loaded.scene, &self.lights)
            }
            _ => Lights::of(&loaded.scene),
        };
        lights.apply(&mut loaded.scene);
        // Keep the chosen settings if only the number of caches or the contents of the file have changed.
        let same_scene = self.engine.is_some() && args.scene == self.args.scene;
        if same_scene && args.quality() == self.args.quality() {
            settings = self.settings;
        }
        if let Some(Opened { session, drawing, .. }) = session {
            settings = drawing.settings(gpu, count)?;
            lights = session.change(&mut loaded.scene);
        }
        // All of the new scene must fit, so that the old one can stay if it does not.
        let engine = Engine::new(gpu, loaded, &settings)?;
        self.picture = self.picture.as_ref().map(|old| engine.picture(gpu, old.size())).transpose()?;
        (self.engine, self.fitted, self.refused) = (Some(engine), settings, None);
        self.changes += 1;
        self.of_file = of_file;
        (self.pixel, self.video) = (None, None);
        self.gizmo.clear();
        // Steps of other lights cannot be undone.
        if anew || !lights.has_the_file_of(&self.lights) {
            self.history = History::default();
        }
        self.lights = lights;
        if anew {
            self.edited.clear();
        }
        // The file is the same, even with another sky or other caches.
        let same = anew && same_scene;
        (self.args, self.settings, self.caches) = (args, settings, count);
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
            self.clip = Clip { animation: None, time: 0.0, playing: false, speed: self.clip.speed };
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
        if let Some(path) = self.args.scene.as_deref().filter(|_| anew) {
            recent::add(path);
        }
        Ok(())
    }

    /// The settings of the quality level.
    pub(super) fn usual(&self) -> Settings {
        usual(&self.args, self.caches, self.ways)
    }

    /// The current scene, with all edits.
    pub(super) fn scene(&self) -> Option<&Scene> {
        self.engine.as_ref().map(|engine| &**engine.scene())
    }

    /// The camera of the picture.
    pub(super) fn camera(&self) -> Option<Camera> {
        match self.seen {
            Seen::OfScene(index) => self.scene()?.cameras.get(index).cloned(),
            Seen::Free(free) => free.camera(),
        }
    }

    /// Radius of the scene [m].
    pub(super) fn radius(&self) -> f64 {
        self.engine.as_ref().map_or(1.0, |engine| engine.world().radius)
    }

    /// The free camera. If a camera of the scene is active, a free camera at its place becomes active, with a target at
    /// `distance` [m], or at the radius of the scene without one.
    pub(super) fn free(&mut self, distance: impl FnOnce(&Self) -> Option<f64>) -> Option<&mut Free> {
        if let Seen::OfScene(_) = self.seen {
            let distance = distance(self).unwrap_or_else(|| self.radius());
            self.seen = Seen::Free(Free::of(&self.camera()?, distance));
        }
        match &mut self.seen {
            Seen::Free(free) => Some(free),
            Seen::OfScene(_) => None,
        }
    }

    /// Distance from the eye [m] and position of the surface at `at` in the picture, from 0 at the top left to 1.
    pub(super) fn surface_at(&self, gpu: &Gpu, at: [f32; 2]) -> Option<(f64, DVec3)> {
        let (view, picture, engine) = (self.drawn?, self.picture.as_ref()?, self.engine.as_ref()?);
        if picture.is_empty() {
            return None;
        }
        let size = picture.size();
        let pixel = [0, 1].map(|i| ((at[i].max(0.0) * size[i] as f32) as u32).min(size[i] - 1));
        let depth = gpu.read_texel::<f32>(&picture.surface.depth, pixel).ok()?;
        let point = point_at(&view, at, depth)? + engine.world().origin;
        Some((point.distance(self.camera()?.world_from_camera.translation), point))
    }

    /// The false-colour scale of the shown layer.
    pub(super) fn scale(&mut self) -> &mut [f32; 2] {
        &mut self.scales[usize::from(self.shown == Shown::Luminance)]
    }

    /// Range of distances from the camera plane [m] that covers all surfaces in the picture, with a margin of 5 %.
    fn distances(&self, gpu: &Gpu) -> Option<[f32; 2]> {
        let (picture, view) = (self.picture.as_ref()?, self.drawn?);
        let depths: Vec<f32> = gpu.read_image(&picture.surface.depth).ok()?;
        let seen = || depths.iter().copied().filter(|depth| *depth > 0.0);
        // The nearest surface has the largest depth.
        let ends = [seen().fold(0.0, f32::max), seen().fold(1.0, f32::min)].map(|depth| {
            let point = view.world_from_clip * glam::Vec4::new(0.0, 0.0, depth, 1.0);
            view.plane.dot(point / point.w)
        });
        (ends[0] > 0.0 && ends[1].is_finite()).then(|| [0.95 * ends[0], 1.05 * ends[1]])
    }

    /// The exposure value of the picture; 0 if there is none.
    pub(super) fn ev(&self, gpu: &Gpu) -> f32 {
        let metered = || gpu.read::<f32>(&self.picture.as_ref()?.output.exposure).ok();
        match self.look.exposure {
            Exposure::Ev(ev) => ev,
            Exposure::Automatic => metered().map_or(0.0, |ev| ev[0]),
        }
    }

    /// Fits the scale of the shown layer to the scene and the exposure.
    pub(super) fn fit_scale(&mut self, gpu: &Gpu) {
        let ev = self.ev(gpu);
        *self.scale() = match self.shown {
            Shown::Luminance => [1.2 * (ev - 8.0).exp2(), 1.2 * (ev + 2.0).exp2()],
            _ => self.distances(gpu).unwrap_or([0.1, 10.0]),
        };
    }

    /// Edits the scene. The next frame shows the change.
    pub(super) fn edit(&mut self, gpu: &Gpu, change: impl FnOnce(&mut Scene)) {
        self.changes += 1;
        if let Some(engine) = &mut self.engine
            && let Err(error) = engine.edit(gpu, change)
        {
            lost::report(&error.into());
        }
    }

    /// Applies the lights of the panel to the scene.
    pub(super) fn light(&mut self, gpu: &Gpu) {
        self.history.change();
        let lights = self.lights.clone();
        self.edit(gpu, |scene| lights.apply(scene));
        // A light that was reset continues to follow its animation.
        if self.clip.animation.is_some() {
            self.pose(gpu);
        }
    }

    /// Poses the scene at the time of the clip.
    pub(super) fn pose(&mut self, gpu: &Gpu) {
        let clip = self.clip;
        let mut lights = std::mem::take(&mut self.lights);
        self.edit(gpu, |scene| {
            match clip.animation {
                Some(animation) => scene.pose(animation, scene.looped(animation, clip.time)),
                None => scene.rest(),
            }
            lights.follow(scene);
        });
        self.lights = lights;
    }

    /// Adapts light and picture to the requested settings and size. What the device cannot handle is logged: the picture
    /// keeps its size, or else the previous settings are restored. Returns false when a size is refused, not again while
    /// it stays.
    ///
    /// # Errors
    /// Fails if the device is lost, or nothing can be shown.
    pub(super) fn fit(&mut self, gpu: &Gpu, size: [u32; 2]) -> Result<bool> {
        let kept = self.picture.as_ref().map(Picture::size);
        let refused = self.refused == Some((size, self.settings));
        let wanted = if refused { kept } else { Some(size).filter(|size| !size.contains(&0)) };
        let Err(error) = self.try_fit(gpu, wanted) else {
            self.refused = self.refused.filter(|_| refused);
            return Ok(true);
        };
        if lost::is_loss(&error) || self.drawn.is_none() {
            return Err(error);
        }
        if wanted != kept && self.try_fit(gpu, kept).is_ok() {
            let kept = kept.map_or("there is no picture".into(), |[w, h]| format!("the picture stays at {w}x{h}"));
            log::error!("{error:#}; {kept}");
            self.refused = Some((size, self.settings));
            return Ok(false);
        }
        if self.settings == self.fitted {
            return Err(error);
        }
        log::error!("{error:#}; the previous settings are restored");
        self.settings = self.fitted;
        self.fit(gpu, size)
    }

    /// Adapts light and picture. Without a size there is no picture.
    fn try_fit(&mut self, gpu: &Gpu, size: Option<[u32; 2]>) -> Result<()> {
        let Some(engine) = &mut self.engine else { return Ok(()) };
        engine.set(&self.settings);
        match (&mut self.picture, size) {
            (Some(picture), Some(size)) => engine.fit(gpu, &mut [(picture, size)])?,
            (picture, size) => {
                engine.fit(gpu, &mut [])?;
                *picture = size.map(|size| engine.picture(gpu, size)).transpose()?;
            }
        }
        self.fitted = self.settings;
        Ok(())
    }

    /// Drops everything on the device besides the engine.
    pub(super) fn leave_device(&mut self) {
        (self.picture, self.refused) = (None, None);
        self.insets.leave_device();
    }

    /// The view of the current camera and picture size.
    pub(super) fn view(&self) -> Option<View> {
        let (engine, picture, camera) = (self.engine.as_ref()?, self.picture.as_ref()?, self.camera()?);
        Some(engine.view(&camera, picture.size()))
    }

    /// Adds the times of frames to the history, if they rendered the picture.
    pub(super) fn time(&mut self, frames: Vec<FrameTimes>) {
        for frame in frames {
            let stages: Vec<_> =
                frame.stages().iter().map(|stage| (stage.name, stage.gpu_ms.unwrap_or(stage.cpu_ms))).collect();
            // Skip frames of a comparison, which have no stage `window`, and frames that drew only panels.
            let Some((_, window)) = stages.iter().find(|(name, _)| *name == "window").copied() else { continue };
            if stages.len() < 2 {
                continue;
            }
            if self.times.len() == HISTORY {
                self.times.pop_front();
            }
            let ms: f64 = stages.iter().map(|(_, ms)| ms).sum();
            log::debug!("frame {}: {ms:.1} ms, of which the window took {window:.1} ms", frame.number);
            self.times.push_back(Timed { ms, stages });
        }
    }

    /// The settings of the gather. `None` if no caches light the picture.
    pub(super) fn compute(settings: &mut Settings) -> Option<&mut Gather> {
        match &mut settings.indirect {
            Indirect::Caches(Caches { gather, .. }) => Some(gather),
            _ => None,
        }
    }

    /// The command that writes the picture. It does not include edited lights and materials.
    pub(super) fn command(&self) -> Option<String> {
        let camera = match self.seen {
            Seen::OfScene(index) => index.to_string(),
            Seen::Free(free) => free.argument(),
        };
        Some(self.args.command(&Now {
            settings: &self.settings,
            look: &self.look,
            caches: self.caches,
            size: self.picture.as_ref()?.size(),
            camera,
            moment: self.clip.animation.map(|animation| (animation, self.clip.time)),
        }))
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

/// The settings of the quality level for this number of caches. Stages with unchanged inputs are skipped.
fn usual(args: &Args, caches: usize, ways: Ways) -> Settings {
    Settings { reuse: true, ..Settings::at(args.quality(), caches).with_ways(ways) }
}

/// Copies visibility and edited materials from the old scene, if the new scene has the same number of each.
fn keep_edits(old: &Scene, new: &mut Scene, edited: &BTreeSet<usize>) {
    if old.instances.len() == new.instances.len() {
        for (old, new) in old.instances.iter().zip(&mut new.instances) {
            new.hidden = old.hidden;
        }
    }
    if old.materials.len() == new.materials.len() {
        for index in edited {
            copy_edits(&old.materials[*index], &mut new.materials[*index]);
        }
    }
}

/// Copies what the panel can change of a material.
pub(super) fn copy_edits(old: &Material, new: &mut Material) {
    (new.base_color, new.emissive) = (old.base_color, old.emissive);
    (new.roughness, new.metallic) = (old.roughness, old.metallic);
    (new.subsurface, new.base_color_texture) = (old.subsurface, old.base_color_texture);
}
