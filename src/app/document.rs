//! The open document: a scene with its light, camera and display settings.

use super::background::Rest;
use super::camera::{Free, Seen, point_at};
use super::canvas::Shown;
use super::gizmo::Gizmo;
use super::inset::Insets;
use super::loading::Loading;
use super::marks::Marks;
use super::pixel::Pixel;
use super::recent;
use super::undo::History;
use super::video::Video;
use super::watch::Watch;
use super::window::lost;
use crate::cli::lights::Lights;
use crate::cli::session::is_session;
use crate::cli::view::{Now, View as Args};
use anyhow::Result;
use glam::DVec3;
use lightskin::frame::settings::{Caches, Gather};
use lightskin::frame::{Engine, Exposure, Indirect, Look, Picture, Settings, View, Ways, tune};
use lightskin::gpu::{FrameTimes, Gpu};
use lightskin::scene::{Camera, Material, Scene};
use std::collections::{BTreeSet, VecDeque};
use std::path::PathBuf;

/// Number of frames whose times are kept.
const HISTORY: usize = 600;

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
    pub(super) refused: Option<([u32; 2], Settings)>,
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
    /// Recent scenes, newest first.
    pub(super) recent: Vec<PathBuf>,
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
    pub(super) loading: Loading,
    /// The size that the picture should have [pixels].
    pub(super) asked: [u32; 2],
    pub(super) ways: Ways,
    pub(super) rest: Rest,
}

impl Document {
    /// Starts to load the scene of the command line.
    pub(super) fn new(gpu: &Gpu, args: &Args, rest: Rest) -> Result<Self> {
        let ways = tune::fastest(gpu)?.ways;
        let settings = args.settings(args.cache_count().unwrap_or(args.quality().caches()), ways);
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
            recent: recent::all(),
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
            loading: Loading::default(),
            asked: [0, 0],
            ways,
            rest,
        };
        match args.scene.as_deref().filter(|path| is_session(path)) {
            Some(file) => document.open_session(file)?,
            None => document.open(args.clone(), true),
        }
        Ok(document)
    }

    /// Reloads the scene if watching is on and its files have changed.
    pub(super) fn watch(&mut self) {
        let Some(scene) = self.args.scene.clone().filter(|_| self.args.watch && !self.loading.works()) else { return };
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

    /// The settings of the quality level.
    pub(super) fn usual(&self) -> Settings {
        Settings { reuse: true, ..Settings::at(self.args.quality(), self.caches).with_ways(self.ways) }
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

    /// Edits the scene. The next frame shows the change, or the first one after another upload of the scene.
    pub(super) fn edit(&mut self, gpu: &Gpu, change: impl FnOnce(&mut Scene)) {
        self.changes += 1;
        if let Some(engine) = &mut self.engine
            && let Err(error) = engine.edit_in_place(gpu, change)
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

    /// Adapts light and picture to the requested settings and the size `asked`. What the device cannot handle is logged:
    /// the picture keeps its size, or else the previous settings are restored. Returns false when a size is refused, not
    /// again while it stays.
    ///
    /// # Errors
    /// Fails if the device is lost, or nothing can be shown.
    pub(super) fn fit(&mut self, gpu: &Gpu) -> Result<bool> {
        let size = self.asked;
        if self.needs_upload() {
            self.upload_again(gpu);
        }
        // What takes long is made on another thread. Until then the previous settings stay.
        let is_ready = self.engine.as_ref().is_none_or(|engine| engine.is_ready_for(&self.settings))
            && self.has_pipelines(gpu, size);
        let settings = if is_ready { self.settings } else { self.fitted };
        let kept = self.picture.as_ref().map(Picture::size);
        let refused = self.refused == Some((size, settings));
        let wanted = if refused { kept } else { Some(size).filter(|size| !size.contains(&0)) };
        let Err(error) = self.try_fit(gpu, settings, wanted) else {
            self.refused = self.refused.filter(|_| refused);
            return Ok(true);
        };
        if lost::is_loss(&error) || self.drawn.is_none() {
            return Err(error);
        }
        if wanted != kept && self.try_fit(gpu, settings, kept).is_ok() {
            let kept = kept.map_or("there is no picture".into(), |[w, h]| format!("the picture stays at {w}x{h}"));
            log::error!("{error:#}; {kept}");
            self.refused = Some((size, settings));
            return Ok(false);
        }
        if self.settings == self.fitted {
            return Err(error);
        }
        log::error!("{error:#}; the previous settings are restored");
        self.settings = self.fitted;
        self.fit(gpu)
    }

    /// Adapts light and picture. Without a size there is no picture.
    fn try_fit(&mut self, gpu: &Gpu, settings: Settings, size: Option<[u32; 2]>) -> Result<()> {
        let Some(engine) = &mut self.engine else { return Ok(()) };
        engine.set(&settings);
        match (&mut self.picture, size) {
            (Some(picture), Some(size)) => engine.fit(gpu, &mut [(picture, size)])?,
            (picture, size) => {
                engine.fit(gpu, &mut [])?;
                *picture = size.map(|size| engine.picture(gpu, size)).transpose()?;
            }
        }
        self.fitted = settings;
        Ok(())
    }

    /// Drops everything on the device besides the engine. A scene that is being uploaded is loaded again.
    pub(super) fn leave_device(&mut self) {
        (self.picture, self.refused) = (None, None);
        self.insets.leave_device();
        self.load_again();
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

/// Copies what the panel can change of a material.
pub(super) fn copy_edits(old: &Material, new: &mut Material) {
    (new.base_color, new.emissive) = (old.base_color, old.emissive);
    (new.roughness, new.metallic) = (old.roughness, old.metallic);
    (new.specular, new.specular_color) = (old.specular, old.specular_color);
    (new.subsurface, new.base_color_texture) = (old.subsurface, old.base_color_texture);
}
