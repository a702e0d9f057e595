//! The light of a world: once for all views. What caches and pixels receive, and what that takes.

use super::brute_force::BruteForce;
use super::caches::CacheLight;
use super::direct::Direct;
use super::gather::Gather;
use super::plan::{Plan, STAGES};
use super::pose::Poses;
use super::refit::Refit;
use super::revision::Made;
use super::rsm::Rsm;
use super::settings::{self, Near, Settings};
use super::vals::Vals;
use super::world::World;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::scene::Scene;

/// Where indirect light comes from.
pub enum IndirectLight {
    /// Nowhere.
    Off,
    /// Every VAL onto every pixel.
    BruteForce(BruteForce),
    /// Interpolated caches.
    Caches(Box<CacheLight>),
}

/// Shadow map, VALs, caches and proxies of a world, and the passes that make them.
pub struct Light {
    /// Which stages there are.
    pub plan: Plan,
    /// Stage 4; only with indirect light.
    pub rsm: Option<Rsm>,
    /// Stage 2; only with lights.
    pub direct: Option<Direct>,
    /// Stages 3 and 5 to 8.
    pub indirect: IndirectLight,
    pub(super) poses: Option<Poses>,
    pub(super) refit: Option<Refit>,
    pub(super) made: MadeOfLights,
    pub(super) outdated: Outdated,
    settings: Settings,
    /// Most views of a frame.
    eyes: u32,
    /// Of the world that it was made for.
    layout: u64,
    /// A bit for each stage that the last recorded frame has run.
    pub(super) ran: u32,
}

/// What is up to date, of VALs.
#[derive(Default)]
pub(super) struct MadeOfLights {
    /// Those of each light.
    pub(super) lights: Vec<Made>,
    /// All of them, and their list.
    pub(super) vals: Made,
    /// Revision of the surfaces that those of emitters are of.
    pub(super) emitters: u64,
}

/// What the next frame has to make.
#[derive(Default)]
pub(super) struct Outdated {
    pub(super) atlas: bool,
    /// VALs, light by light.
    pub(super) lights: Vec<bool>,
    /// The list of VALs, and what stands on it.
    pub(super) vals: bool,
    /// VALs of the surfaces that emit.
    pub(super) emitters: bool,
    pub(super) cull: bool,
    pub(super) depth_images: bool,
    pub(super) sky: bool,
    pub(super) proxies: bool,
}

/// What a frame has worked with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Caches that were lit.
    pub caches: u32,
    /// VALs that carry light.
    pub vals: u32,
    /// Pairs of a cache and a VAL, or a node that stands for some, whose light was computed.
    pub pairs: u64,
}

impl Light {
    /// Makes the light of a world for frames of `eyes` views at most. The scene is the one that was uploaded; further bounces
    /// look up what its surfaces reflect.
    ///
    /// # Errors
    /// What the device cannot hold or do, by name: see `Draws::new` and `Visible::new`.
    pub fn new(gpu: &Gpu, scene: &Scene, world: &World, settings: &Settings, eyes: usize) -> Result<Self> {
        let plan = world.plan(settings);
        let (weight, side) = (settings.proxy_weight(), settings.rsm.max(1));
        let eyes = u32::try_from(eyes.max(1)).unwrap_or(u32::MAX);
        let lights_all = match settings.indirect {
            settings::Indirect::Caches(caches) => {
                plan.lightskin && !plan.cull && matches!(caches.gather, settings::Gather::Compute { .. })
            }
            _ => false,
        };
        let rsm = plan.indirect().then(|| Rsm::new(gpu, world, side, weight, lights_all, &plan)).transpose()?;
        let vals = rsm.as_ref().map_or(0, |rsm| rsm.vals.count);
        if plan.bounces > 0 {
            world.make_albedos(gpu, scene)?;
        }
        if plan.near != Near::Off || plan.sky_light || plan.light_rays {
            world.make_rays(gpu, scene)?;
        }
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
            // VALs of emitters were uploaded.
            made: MadeOfLights { emitters: world.revisions.surfaces, ..MadeOfLights::default() },
            outdated: Outdated::default(),
            settings: *settings,
            eyes,
            layout: world.layout,
            ran: 0,
            plan,
        })
    }

    /// Rebuilds what no longer fits the world, the settings or the number of views; costs nothing if all fits. Pictures
    /// are to be fitted afterwards.
    ///
    /// # Errors
    /// As `new`; the light is then as it was.
    pub fn fit(&mut self, gpu: &Gpu, scene: &Scene, world: &World, settings: &Settings, eyes: usize) -> Result<()> {
        // Maps that are kept take memory that others do not.
        let reuse = if self.plan.direct && !self.plan.light_rays { self.settings.reuse } else { settings.reuse };
        let same = Settings { reuse, ..self.settings } == *settings;
        if same && self.fits(world) && eyes <= self.eyes() {
            self.settings.reuse = settings.reuse;
            return Ok(());
        }
        *self = Self::new(gpu, scene, world, settings, eyes)?;
        Ok(())
    }

    /// Whether it was made for a world as that is now.
    pub fn fits(&self, world: &World) -> bool {
        self.layout == world.layout && self.plan == world.plan(&self.settings)
    }

    /// What shapes it.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Most views of a frame.
    pub fn eyes(&self) -> usize {
        self.eyes as usize
    }

    /// The VALs, where there are any.
    pub fn vals(&self) -> Option<&Vals> {
        self.rsm.as_ref().map(|rsm| &rsm.vals)
    }

    /// The caches, where light is interpolated.
    pub fn caches(&self) -> Option<&CacheLight> {
        if let IndirectLight::Caches(caches) = &self.indirect { Some(caches) } else { None }
    }

    /// Caches that the last frame has lit, VALs that carry light, and pairs of both. Waits for the device.
    ///
    /// # Errors
    /// A device that was lost.
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

    /// Stages of the plan that the last recorded frame has left out, since nothing they read had changed.
    pub fn skipped(&self) -> Vec<&'static str> {
        let planned = STAGES.iter().enumerate().filter(|(_, stage)| (stage.planned)(&self.plan));
        planned.filter(|(place, _)| self.ran >> place & 1 == 0).map(|(_, stage)| stage.name).collect()
    }
}
