//! A world and its light, both of which may change between two frames: scene, caches, settings, sizes. Slow work runs
//! in the background, while frames continue with the current data.

use super::light::Light;
use super::picture::Picture;
use super::record::record;
use super::settings::{Look, Quality, Settings};
use super::view::View;
use super::world::World;
use crate::bake::{BakeSettings, CacheSet, Density, bake_cached};
use crate::error::{Error, Result};
use crate::gpu::{Cmd, Device, Missing};
use crate::scene::defaults::{Ground, complete};
use crate::scene::{Camera, Scene, gltf, tessellate};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A scene with its caches, as a background job produces it.
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Its caches. Without caches, only direct light and brute force are possible.
    pub caches: Option<CacheSet>,
}

impl Loaded {
    /// Loads a glTF file at a quality level, as the command line does. Adds the camera, the light and the ground if the
    /// scene lacks them (its `notes` list them), subdivides triangles where light is interpolated at their vertices,
    /// and places caches. The caches are stored in the user's cache folder for later runs. `progress` receives the
    /// fraction done, from 0 to 1, and the name of the current step.
    ///
    /// # Errors
    /// Fails if a file cannot be read, or no caches can be placed on the scene.
    pub fn open(path: &Path, quality: Quality, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<Self> {
        progress(0.0, "load");
        Self::of(gltf::load(path)?, quality, progress)
    }

    /// Prepares a scene at a quality level, as `open` does.
    ///
    /// # Errors
    /// Fails if no caches can be placed on the scene.
    pub fn of(mut scene: Scene, quality: Quality, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<Self> {
        complete(&mut scene, Ground::Auto);
        let spacing = tessellate::expected_spacing(&scene, quality.caches());
        let at_vertices = tessellate::divide_if_few(&mut scene, spacing);
        let density = Density::Count(quality.caches());
        let settings = BakeSettings { density, angle: 60_f32.to_radians(), references: quality.references() };
        Self::with_caches(scene, &settings, at_vertices, progress)
    }

    /// Places caches, or reads stored ones. Where light is not interpolated at vertices, pixels look up their caches in
    /// cells.
    ///
    /// # Errors
    /// Fails if no caches can be placed on the scene.
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
                Err(error) => log::warn!("{error:#}: light is interpolated at vertices without subdividing triangles"),
            }
        }
        Ok(Self { scene, caches: Some(caches) })
    }

    /// The settings that `render` uses for this scene at a quality level.
    pub fn settings(&self, quality: Quality) -> Settings {
        let models = |set: &CacheSet| set.instance_model.iter().map(|m| set.models[*m].caches.len()).sum();
        Settings::at(quality, self.caches.as_ref().map_or(0, models))
    }
}

/// Progress of a background job.
#[derive(Clone, Default)]
pub struct Progress {
    /// In thousandths.
    done: Arc<AtomicU32>,
    what: Arc<Mutex<String>>,
}

impl Progress {
    /// Sets the fraction done, from 0 to 1, and the current step. `bake::bake` calls this.
    pub fn set(&self, done: f32, what: &str) {
        self.done.store((done.clamp(0.0, 1.0) * 1000.0) as u32, Ordering::Relaxed);
        let mut now = self.what.lock().unwrap_or_else(PoisonError::into_inner);
        if *now != what {
            what.clone_into(&mut now);
        }
    }

    /// Fraction done, from 0 to 1, and the current step.
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
    /// Whether `scene` has changes that frames do not show.
    behind: bool,
}

impl Engine {
    /// Uploads a scene and creates its light.
    ///
    /// # Errors
    /// As `World::new` and `Light::new`.
    pub fn new(gpu: &Device, loaded: Loaded, settings: &Settings) -> Result<Self> {
        let Loaded { scene, caches } = loaded;
        let world = World::new(gpu, &scene, caches.as_ref())?;
        let light = Light::new(gpu, &scene, &world, settings, 1)?;
        Ok(Self { scene: Arc::new(scene), world, light, settings: *settings, job: None, behind: false })
    }

    /// Takes the scene, with all edits, and its caches back from the device. With these, `new` makes the same engine on
    /// another device, for example after the loss of this one.
    pub fn into_loaded(self) -> Loaded {
        Loaded { scene: Arc::unwrap_or_clone(self.scene), caches: self.world.into_caches() }
    }

    /// The scene as it is drawn.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The scene on the device.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The light of the scene.
    pub fn light(&self) -> &Light {
        &self.light
    }

    /// The current settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether the scene on the device has what these settings need. Otherwise the next `fit` creates it, which may take
    /// seconds: the BVHs, and the reflectances of the caches. A new engine has all that its settings need.
    pub fn is_ready_for(&self, settings: &Settings) -> bool {
        self.world.is_ready_for(settings)
    }

    /// The pipelines that light with these settings and a picture of this size need and that are not there yet. If
    /// another thread makes them, the next `fit` takes less time.
    ///
    /// # Errors
    /// As `Light::new` and `Picture::new`.
    pub fn missing(&self, gpu: &Device, settings: &Settings, size: Option<[u32; 2]>) -> Result<Missing> {
        gpu.missing(|| {
            let light = Light::new(gpu, &self.scene, &self.world, settings, 1)?;
            let picture = size.map(|size| Picture::new(gpu, &self.world, &light, size)).transpose()?;
            Ok((light, picture))
        })
    }

    /// Changes the settings; they take effect at the next `fit`.
    pub fn set(&mut self, settings: &Settings) {
        self.settings = *settings;
    }

    /// Changes transforms, poses, lights (including their number) or materials. Takes effect at the next frame.
    ///
    /// # Errors
    /// Fails if models or instances change, since they need other caches: `scene` then has the change, but frames keep
    /// showing the old state until a job (`start`) or `load` provides the caches. Also fails if the device runs out of
    /// memory.
    pub fn edit(&mut self, gpu: &Device, change: impl FnOnce(&mut Scene)) -> Result<()> {
        let mut scene = self.scene.clone();
        // Avoids a copy unless a job or the caller still reads the scene.
        self.scene = Arc::default();
        change(Arc::make_mut(&mut scene));
        let updated = self.world.update(gpu, &scene);
        self.scene = scene;
        self.behind = updated.is_err();
        updated
    }

    /// As `edit`, if the change only rewrites what is on the device. Otherwise `is_behind` is true from now on: `scene` has
    /// the change, but frames keep showing the old state. A new engine of `scene` and `baked` shows it. It can be made
    /// on another thread.
    ///
    /// # Errors
    /// As `edit`.
    pub fn edit_in_place(&mut self, gpu: &Device, change: impl FnOnce(&mut Scene)) -> Result<()> {
        // Avoids a copy unless a job or the caller still reads the scene.
        let mut scene = std::mem::take(&mut self.scene);
        change(Arc::make_mut(&mut scene));
        self.show(gpu, scene)
    }

    /// Replaces the scene by one that differs from it only by edits, as `edit_in_place` does.
    ///
    /// # Errors
    /// As `edit`.
    pub fn show(&mut self, gpu: &Device, scene: Arc<Scene>) -> Result<()> {
        self.scene = scene;
        self.behind = !self.world.updates_in_place(&self.scene);
        if self.behind { Ok(()) } else { self.world.update(gpu, &self.scene) }
    }

    /// Whether the scene has changes that frames do not show.
    pub fn is_behind(&self) -> bool {
        self.behind
    }

    /// The caches of the scene, as a job made them.
    pub fn baked(&self) -> Option<&CacheSet> {
        self.world.baked()
    }

    /// Replaces the scene, or its caches. Takes effect at the next `fit`.
    ///
    /// # Errors
    /// As `World::new`; then nothing has changed.
    pub fn load(&mut self, gpu: &Device, loaded: Loaded) -> Result<()> {
        self.world = World::new(gpu, &loaded.scene, loaded.caches.as_ref())?;
        self.scene = Arc::new(loaded.scene);
        self.behind = false;
        Ok(())
    }

    /// Makes a scene or caches on another thread, for example another file, more or fewer instances, or another spacing
    /// of caches. `poll` takes over the result. If several jobs are started, only the last one counts.
    pub fn start(&mut self, make: impl FnOnce(&Progress) -> Result<Loaded> + Send + 'static) {
        let progress = Progress::default();
        let told = progress.clone();
        self.job = Some(Job { thread: std::thread::spawn(move || make(&told)), progress });
    }

    /// The running job, if any.
    pub fn progress(&self) -> Option<&Progress> {
        self.job.as_ref().map(|job| &job.progress)
    }

    /// Takes over the result of a finished job and returns whether there was one. Never waits.
    ///
    /// # Errors
    /// Fails if the job failed or `load` fails; then nothing has changed.
    pub fn poll(&mut self, gpu: &Device) -> Result<bool> {
        match self.job.take() {
            Some(job) if job.thread.is_finished() => self.take_over(gpu, job),
            job => {
                self.job = job;
                Ok(false)
            }
        }
    }

    /// Waits for the job and takes over its result.
    ///
    /// # Errors
    /// As `poll`.
    pub fn wait(&mut self, gpu: &Device) -> Result<bool> {
        match self.job.take() {
            Some(job) => self.take_over(gpu, job),
            None => Ok(false),
        }
    }

    fn take_over(&mut self, gpu: &Device, job: Job) -> Result<bool> {
        let made = job.thread.join();
        let made = made.map_err(|_| Error::Nothing("a background job panicked; this is a bug of lightskin".into()))?;
        self.load(gpu, made?)?;
        Ok(true)
    }

    /// Creates a picture of this size \[pixels\].
    ///
    /// # Errors
    /// As `Picture::new`.
    pub fn picture(&self, gpu: &Device, size: [u32; 2]) -> Result<Picture> {
        Picture::new(gpu, &self.world, &self.light, size)
    }

    /// Rebuilds light and pictures that no longer fit the scene, the settings, the sizes or the number of views. Call
    /// it before each frame; it costs nothing if everything fits.
    ///
    /// # Errors
    /// Fails if the device cannot hold or support something. Parts that were not rebuilt before the error stay as they
    /// were.
    pub fn fit(&mut self, gpu: &Device, pictures: &mut [(&mut Picture, [u32; 2])]) -> Result<()> {
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
