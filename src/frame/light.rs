//! The light of a world, shared by all views: the light of caches and pixels, and the passes that compute it.

use super::brute_force::BruteForce;
use super::caches::CacheLight;
use super::direct::Direct;
use super::gather::Gather;
use super::plan::{Plan, STAGES};
use super::pose::Poses;
use super::refit::Refit;
use super::revision::Made;
use super::rsm::Rsm;
use super::settings::{self, Settings};
use super::vals::Vals;
use super::world::World;
use crate::error::Result;
use crate::gpu::{Device, Gpu};
use crate::scene::Scene;

/// Source of indirect light.
pub enum IndirectLight {
    /// None.
    Off,
    /// Every VAL lights every pixel.
    BruteForce(BruteForce),
    /// Interpolated caches.
    Caches(Box<CacheLight>),
}

/// Shadow maps, VALs, caches and proxies of a world, and the passes that compute them.
pub struct Light {
    /// The stages of a frame.
    pub plan: Plan,
    /// Stage 4; only with indirect light.
    pub rsm: Option<Rsm>,
    /// Stage 2; only with lights.
    pub direct: Option<Direct>,
    /// Stages 3 and 5 to 10.
    pub indirect: IndirectLight,
    pub(super) poses: Option<Poses>,
    pub(super) refit: Option<Refit>,
    pub(super) made: MadeOfLights,
    pub(super) outdated: Outdated,
    settings: Settings,
    /// Maximum number of views in a frame.
    eyes: u32,
    /// `World::layout` of the world that it was created for.
    layout: u64,
    /// A bit for each stage that the last recorded frame ran.
    pub(super) ran: u32,
}

/// Revisions of the VALs.
#[derive(Default)]
pub(super) struct MadeOfLights {
    /// VALs of each light.
    pub(super) lights: Vec<Made>,
    /// All VALs, and their list.
    pub(super) vals: Made,
    /// Revision of the surfaces at which the VALs of emitters were written.
    pub(super) emitters: u64,
}

/// Parts that the next frame must recompute.
#[derive(Default)]
pub(super) struct Outdated {
    pub(super) atlas: bool,
    /// VALs of each light.
    pub(super) lights: Vec<bool>,
    /// The list of VALs, and everything computed from it.
    pub(super) vals: bool,
    /// VALs of the emissive surfaces.
    pub(super) emitters: bool,
    pub(super) cull: bool,
    pub(super) depth_images: bool,
    pub(super) sky: bool,
    pub(super) proxies: bool,
}

/// Amount of work of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Lit caches.
    pub caches: u32,
    /// VALs that carry light.
    pub vals: u32,
    /// Pairs of a cache and a VAL, or a cluster of VALs, whose light was computed.
    pub pairs: u64,
}

impl Light {
    /// Creates the light of a world for frames of at most `eyes` views. `scene` must be the uploaded scene; further
    /// bounces read the reflectance of its surfaces.
    ///
    /// # Errors
    /// Fails with the name of the limit if the device cannot hold or support something: see `Draws::new` and
    /// `Visible::new`.
    pub fn new(gpu: &Device, scene: &Scene, world: &World, settings: &Settings, eyes: usize) -> Result<Self> {
        let plan = world.plan(settings);
        let (weight, side) = (settings.proxy_weight(), settings.rsm.max(1));
        let eyes = u32::try_from(eyes.max(1)).unwrap_or(u32::MAX);
        let gather = match settings.indirect {
            settings::Indirect::Caches(caches) => Some(caches.gather),
            _ => None,
        };
        let lights_all = plan.lightskin && !plan.cull && matches!(gather, Some(settings::Gather::Compute { .. }));
        let grids = matches!(gather, Some(settings::Gather::Clusters { .. }));
        if plan.bounces > 0 {
            world.make_albedos(gpu, scene)?;
        }
        if plan.rays() {
            world.make_rays(gpu, scene)?;
        }
        let new = || Rsm::new(gpu, world, side, weight, [lights_all, grids], &plan);
        let rsm = plan.indirect().then(new).transpose()?;
        let vals = rsm.as_ref().map_or(0, |rsm| rsm.vals.count);
        Ok(Self {
            rsm,
            direct: plan
                .direct
                .then(|| Direct::new(gpu, world, &plan, (settings.light_shadows.map(), settings.reuse)))
                .transpose()?,
            indirect: match &settings.indirect {
                settings::Indirect::Caches(caches) if plan.lightskin => {
                    IndirectLight::Caches(Box::new(CacheLight::new(gpu, &plan, world, caches, [vals, side, eyes])?))
                }
                settings::Indirect::BruteForce if plan.brute_force => {
                    IndirectLight::BruteForce(BruteForce::new(gpu, &plan)?)
                }
                _ => IndirectLight::Off,
            },
            poses: plan.deform.then(|| Poses::new(gpu)).transpose()?,
            refit: plan.deform.then(|| Refit::new(gpu)).transpose()?,
            // VALs of emitters are complete after the upload.
            made: MadeOfLights { emitters: world.revisions.surfaces, ..MadeOfLights::default() },
            outdated: Outdated::default(),
            settings: *settings,
            eyes,
            layout: world.layout,
            ran: 0,
            plan,
        })
    }

    /// Rebuilds the light if it no longer fits the world, the settings or the number of views; otherwise it costs
    /// nothing. Fit the pictures afterwards.
    ///
    /// # Errors
    /// As `new`; then the light has not changed.
    pub fn fit(&mut self, gpu: &Device, scene: &Scene, world: &World, settings: &Settings, eyes: usize) -> Result<()> {
        // With shadow maps, `reuse` changes how many maps are allocated.
        let reuse = if self.plan.direct && !self.plan.light_rays { self.settings.reuse } else { settings.reuse };
        let same = Settings { reuse, ..self.settings } == *settings;
        if same && self.fits(world) && eyes <= self.eyes() {
            self.settings.reuse = settings.reuse;
            return Ok(());
        }
        *self = Self::new(gpu, scene, world, settings, eyes)?;
        Ok(())
    }

    /// Whether the light was created for the world in its current state.
    pub fn fits(&self, world: &World) -> bool {
        self.layout == world.layout && self.plan == world.plan(&self.settings)
    }

    /// The settings of this light.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Maximum number of views in a frame.
    pub fn eyes(&self) -> usize {
        self.eyes as usize
    }

    /// The VALs, if there are any.
    pub fn vals(&self) -> Option<&Vals> {
        self.rsm.as_ref().map(|rsm| &rsm.vals)
    }

    /// The caches, if light is interpolated.
    pub fn caches(&self) -> Option<&CacheLight> {
        if let IndirectLight::Caches(caches) = &self.indirect { Some(caches) } else { None }
    }

    /// Caches that the last frame lit, VALs that carry light, and pairs of both. Waits for the device.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn counts(&self, gpu: &Gpu) -> Result<Counts> {
        let mut counts = Counts::default();
        if let Some(vals) = self.vals() {
            counts.vals = gpu.read::<u32>(&vals.live_count)?[0];
        }
        let Some(CacheLight { gather, atlas, .. }) = self.caches() else { return Ok(counts) };
        counts.caches = match gather {
            Gather::Draws(draws) => match &draws.mask {
                Some(mask) => {
                    let mask: Vec<f32> = gpu.read_image(&mask.image)?;
                    (0..atlas.count).filter(|cache| mask[draws.texels.texel(*cache)] > 0.0).count() as u32
                }
                None => atlas.count,
            },
            Gather::Compute(by) => by.live.lit(gpu)?,
            Gather::Clusters(by) => by.live.lit(gpu)?,
        };
        counts.pairs = u64::from(counts.caches) * u64::from(counts.vals);
        match gather {
            Gather::Clusters(by) => counts.pairs = by.pairs(gpu)?,
            Gather::Compute(by) => {
                let bounces = by.bounces.as_ref().map_or(0, |bounces| bounces.gathers());
                counts.pairs += u64::from(bounces) * u64::from(atlas.count).pow(2);
            }
            Gather::Draws(_) => {}
        }
        Ok(counts)
    }

    /// Stages of the plan that the last recorded frame skipped because their inputs had not changed.
    pub fn skipped(&self) -> Vec<&'static str> {
        let planned = STAGES.iter().enumerate().filter(|(_, stage)| (stage.planned)(&self.plan));
        planned.filter(|(place, _)| self.ran >> place & 1 == 0).map(|(_, stage)| stage.name).collect()
    }
}
