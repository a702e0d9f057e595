//! A world and its light that may change between two frames: scenes, caches, settings, sizes. What takes long is made in the
//! background, while frames go on with what there is.

use super::light::Light;
use super::picture::Picture;
use super::record::record;
use super::settings::{Look, Quality, Settings};
use super::view::View;
use super::world::World;
use crate::bake::{BakeSettings, CacheSet, Density, bake_cached};
use crate::error::{Error, Result};
use crate::gpu::{Cmd, Gpu};
use crate::scene::defaults::{Ground, complete};
use crate::scene::{Camera, Scene, gltf, tessellate};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A scene with its caches, as a background job makes it.
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Its caches; without any there is direct light, or brute force.
    pub caches: Option<CacheSet>,
}

impl Loaded {
    /// What the command line makes of a glTF file at a quality level: the scene with the camera, the light and the ground that
    /// it lacks (its `notes` say which), its triangles divided where light is interpolated at their vertices, and its
    /// caches, which are kept in the user's cache folder for the next time. `progress` hears how far it is, from 0 to 1,
    /// and what is being done.
    ///
    /// # Errors
    /// Files that cannot be read, and scenes on which no caches can be placed.
    pub fn open(path: &Path, quality: Quality, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<Self> {
        progress(0.0, "load");
        let mut scene = gltf::load(path)?;
        complete(&mut scene, Ground::Auto);
        let spacing = tessellate::expected_spacing(&scene, quality.caches());
        let at_vertices = tessellate::divide_if_few(&mut scene, spacing);
        let density = Density::Count(quality.caches());
        let settings = BakeSettings { density, angle: 60_f32.to_radians(), references: quality.references() };
        Self::with_caches(scene, &settings, at_vertices, progress)
    }

    /// Places caches, or reads kept ones. Where light is not interpolated at vertices, pixels find their caches by cells.
    ///
    /// # Errors
    /// Scenes on which no caches can be placed.
    pub fn with_caches(
        scene: Scene,
        settings: &BakeSettings,
        at_vertices: bool,
        progress: &(dyn Fn(f32, &str) + Sync),
    ) -> Result<Self> {
        let (mut caches, _) = bake_cached(&scene, settings, progress)?;
        if !at_vertices {
            match caches.clone().with_cells(&scene) {
                Ok(with_cells) => caches = with_cells,
                Err(error) => log::warn!("{error:#}: light is interpolated at the vertices of undivided triangles"),
            }
        }
        Ok(Self { scene, caches: Some(caches) })
    }

    /// What `render` draws of it at a quality level.
    pub fn settings(&self, quality: Quality) -> Settings {
        let models = |set: &CacheSet| set.instance_model.iter().map(|m| set.models[*m].caches.len()).sum();
        Settings::at(quality, self.caches.as_ref().map_or(0, models))
    }
}

/// How far a background job is.
#[derive(Clone, Default)]
pub struct Progress {
    /// In thousandths.
    done: Arc<AtomicU32>,
    what: Arc<Mutex<String>>,
}

impl Progress {
    /// So far, from 0 to 1, doing this: what `bake::bake` calls.
    pub fn set(&self, done: f32, what: &str) {
        self.done.store((done.clamp(0.0, 1.0) * 1000.0) as u32, Ordering::Relaxed);
        let mut now = self.what.lock().unwrap_or_else(PoisonError::into_inner);
        if *now != what {
            what.clone_into(&mut now);
        }
    }

    /// How far, from 0 to 1, and what is being done.
    pub fn get(&self) -> (f32, String) {
        let what = self.what.lock().unwrap_or_else(PoisonError::into_inner).clone();
        (self.done.load(Ordering::Relaxed) as f32 * 1e-3, what)
    }
}

struct Job {
    thread: JoinHandle<Result<Loaded>>,
    progress: Progress,
}

/// A scene on the device and its light.
pub struct Engine {
    scene: Arc<Scene>,
    world: World,
    light: Light,
    settings: Settings,
    job: Option<Job>,
}

impl Engine {
    /// Uploads a scene and makes its light.
    ///
    /// # Errors
    /// As `World::new` and `Light::new`.
    pub fn new(gpu: &Gpu, loaded: Loaded, settings: &Settings) -> Result<Self> {
        let Loaded { scene, caches } = loaded;
        let world = World::new(gpu, &scene, caches.as_ref())?;
        let light = Light::new(gpu, &scene, &world, settings, 1)?;
        Ok(Self { scene: Arc::new(scene), world, light, settings: *settings, job: None })
    }

    /// The scene as it is drawn.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The scene on the device.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Its light.
    pub fn light(&self) -> &Light {
        &self.light
    }

    /// What shapes it.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Other settings from the next `fit` on.
    pub fn set(&mut self, settings: &Settings) {
        self.settings = *settings;
    }

    /// Changes places, poses, lights (also more or fewer of them) or materials, from the next frame on.
    ///
    /// # Errors
    /// Other models or instances, which need other caches: `scene` then has the change, and frames go on showing what they
    /// showed, until a job (`start`) or `load` brings the caches. What the device has no memory for.
    pub fn edit(&mut self, gpu: &Gpu, change: impl FnOnce(&mut Scene)) -> Result<()> {
        let mut scene = self.scene.clone();
        // No copy unless a job or the caller reads the scene.
        self.scene = Arc::default();
        change(Arc::make_mut(&mut scene));
        let updated = self.world.update(gpu, &scene);
        self.scene = scene;
        updated
    }

    /// Shows another scene, or this one with other caches, from the next `fit` on.
    ///
    /// # Errors
    /// As `World::new`; then everything is as it was.
    pub fn load(&mut self, gpu: &Gpu, loaded: Loaded) -> Result<()> {
        self.world = World::new(gpu, &loaded.scene, loaded.caches.as_ref())?;
        self.scene = Arc::new(loaded.scene);
        Ok(())
    }

    /// Makes a scene or caches on another thread, which `poll` takes over when they are there: another file, more or fewer
    /// instances, another spacing of caches. Of several jobs the last one counts.
    pub fn start(&mut self, make: impl FnOnce(&Progress) -> Result<Loaded> + Send + 'static) {
        let progress = Progress::default();
        let told = progress.clone();
        self.job = Some(Job { thread: std::thread::spawn(move || make(&told)), progress });
    }

    /// The job that is under way, if any.
    pub fn progress(&self) -> Option<&Progress> {
        self.job.as_ref().map(|job| &job.progress)
    }

    /// Takes over what a job has made; says whether it has. Never waits.
    ///
    /// # Errors
    /// Of the job, or as `load`; then everything is as it was.
    pub fn poll(&mut self, gpu: &Gpu) -> Result<bool> {
        match self.job.take() {
            Some(job) if job.thread.is_finished() => self.take_over(gpu, job),
            job => {
                self.job = job;
                Ok(false)
            }
        }
    }

    /// The same, but waits for the job.
    ///
    /// # Errors
    /// As `poll`.
    pub fn wait(&mut self, gpu: &Gpu) -> Result<bool> {
        match self.job.take() {
            Some(job) => self.take_over(gpu, job),
            None => Ok(false),
        }
    }

    fn take_over(&mut self, gpu: &Gpu, job: Job) -> Result<bool> {
        let made = job.thread.join();
        let made = made.map_err(|_| Error::Nothing("a background job has ended by a bug of its own".into()))?;
        self.load(gpu, made?)?;
        Ok(true)
    }

    /// A picture of this many pixels.
    ///
    /// # Errors
    /// As `Picture::new`.
    pub fn picture(&self, gpu: &Gpu, size: [u32; 2]) -> Result<Picture> {
        Picture::new(gpu, &self.world, &self.light, size)
    }

    /// Rebuilds light and pictures where they no longer fit scene, settings, sizes or the number of views; costs nothing
    /// where all do. Before each frame.
    ///
    /// # Errors
    /// What the device cannot hold or do. What was not rebuilt by then stays as it was.
    pub fn fit(&mut self, gpu: &Gpu, pictures: &mut [(&mut Picture, [u32; 2])]) -> Result<()> {
        self.light.fit(gpu, &self.scene, &self.world, &self.settings, pictures.len())?;
        pictures.iter_mut().try_for_each(|(picture, size)| picture.fit(gpu, &self.world, &self.light, *size))
    }

    /// A camera's view of the scene.
    pub fn view(&self, camera: &Camera, size: [u32; 2]) -> View {
        View::new(camera, size.map(|side| side.max(1)), self.world.origin, self.world.radius)
    }

    /// Records a frame; see `frame::record`.
    pub fn record(&mut self, cmd: &Cmd<'_>, views: &mut [(View, &mut Picture)], look: &Look) {
        record(cmd, &self.world, &mut self.light, views, look);
    }
}
