//! Every image and buffer that a frame writes: one line each with name, format, size and when.

use super::{Plan, SceneBuffers, Settings};
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Format, Gpu, Image};
use crate::shared::{ATLAS_WIDTH, Cache, Proxy, VAL_TILE, Val};

/// The resources of a frame; stages write and read them, nobody else owns any.
pub struct Targets {
    /// Picture size [pixels].
    pub size: [u32; 2],
    /// Reversed depth: 1 at the near plane, 0 where nothing is.
    pub depth: Image,
    /// Shading normal and Phong exponent.
    pub normal: Image,
    /// `rho_d`, and x of the octahedral geometric normal.
    pub albedo: Image,
    /// `rho_g`, and y of the octahedral geometric normal.
    pub specular: Image,
    /// Emitted and directly reflected radiance.
    pub direct: Image,
    /// The picture: tone-mapped sRGB.
    pub output: Image,
    /// Exposure value that the picture's own luminance asks for.
    pub exposure: Buffer,
    /// Shadow map of one light at a time; six-view lights tile it three by two.
    pub shadow: Option<Image>,
    /// One extended RSM at a time.
    pub rsm: Option<RsmTargets>,
    /// Indirect radiance.
    pub indirect: Option<IndirectTargets>,
    /// Caches in the world and their proxies.
    pub caches: Option<CacheTargets>,
}

/// Stage 4.
pub struct RsmTargets {
    /// World position, and 1 where something is.
    pub position: Image,
    /// Normal on the lit side, and the material.
    pub normal: Image,
    /// `rho_d`.
    pub albedo: Image,
    /// Reversed depth.
    pub depth: Image,
    /// The VALs of all lights, padded with dark ones to whole tiles.
    pub vals: Buffer,
    /// VALs before padding.
    pub val_count: u32,
}

/// Stage 8.
pub struct IndirectTargets {
    /// Diffuse lobe.
    pub diffuse: Image,
    /// Glossy lobe; only where a material has one.
    pub glossy: Option<Image>,
}

/// Stages 3 and 6.
pub struct CacheTargets {
    /// The atlas: every instance's caches in the world.
    pub atlas: Buffer,
    /// Sums of the gather: positions and irradiance of the diffuse, then of the glossy lobe.
    pub sums: Vec<Image>,
    /// Proxy lights of both lobes.
    pub proxies: Buffer,
    /// Caches of all instances.
    pub count: u32,
}

impl CacheTargets {
    /// Rows of the atlas that hold caches.
    pub fn rows(&self) -> u32 {
        self.count.div_ceil(ATLAS_WIDTH)
    }
}

impl Targets {
    /// Makes what the plan needs.
    pub fn new(gpu: &Gpu, plan: &Plan, scene: &SceneBuffers, settings: &Settings) -> Result<Self> {
        let [w, h] = settings.size;
        let float = Format::R32G32B32A32_SFLOAT;
        let half = Format::R16G16B16A16_SFLOAT;
        let depth = Format::D32_SFLOAT;
        let shadow = settings.shadow_map;
        Ok(Self {
            size: settings.size,
            depth: gpu.target("gbuffer.depth", depth, w, h)?,
            normal: gpu.target("gbuffer.normal", float, w, h)?,
            albedo: gpu.target("gbuffer.albedo", half, w, h)?,
            specular: gpu.target("gbuffer.specular", half, w, h)?,
            direct: gpu.target("direct.radiance", float, w, h)?,
            output: gpu.target("composite.output", Format::R8G8B8A8_SRGB, w, h)?,
            exposure: gpu.buffer("composite.exposure", 16)?,
            shadow: plan.direct.then(|| gpu.target("direct.shadow", depth, shadow, shadow)).transpose()?,
            rsm: plan.indirect().then(|| RsmTargets::new(gpu, scene, settings)).transpose()?,
            indirect: plan
                .indirect()
                .then(|| {
                    Ok::<_, Error>(IndirectTargets {
                        diffuse: gpu.target("interpolate.diffuse", float, w, h)?,
                        glossy: plan.glossy.then(|| gpu.target("interpolate.glossy", float, w, h)).transpose()?,
                    })
                })
                .transpose()?,
            caches: plan.lightskin.then(|| CacheTargets::new(gpu, plan, scene.cache_count)).transpose()?,
        })
    }

    /// Every image, for the one transition at a frame's beginning.
    pub fn images(&self) -> Vec<&Image> {
        let mut all = vec![&self.depth, &self.normal, &self.albedo, &self.specular, &self.direct, &self.output];
        all.extend(&self.shadow);
        if let Some(rsm) = &self.rsm {
            all.extend([&rsm.position, &rsm.normal, &rsm.albedo, &rsm.depth]);
        }
        if let Some(indirect) = &self.indirect {
            all.push(&indirect.diffuse);
            all.extend(&indirect.glossy);
        }
        if let Some(caches) = &self.caches {
            all.extend(&caches.sums);
        }
        all
    }

    /// Every buffer.
    pub fn buffers(&self) -> Vec<&Buffer> {
        let mut all = vec![&self.exposure];
        all.extend(self.rsm.as_ref().map(|rsm| &rsm.vals));
        if let Some(caches) = &self.caches {
            all.extend([&caches.atlas, &caches.proxies]);
        }
        all
    }
}

impl RsmTargets {
    fn new(gpu: &Gpu, scene: &SceneBuffers, settings: &Settings) -> Result<Self> {
        let n = settings.rsm;
        let val_count: u64 = scene.lights.iter().map(|l| u64::from(l.views) * u64::from(l.rsm_size(n)).pow(2)).sum();
        let val_count = u32::try_from(val_count).ok().filter(|c| *c <= 1 << 25);
        let val_count =
            val_count.ok_or_else(|| Error::TooLarge("more than 33 million VALs; ask for a smaller --rsm".into()))?;
        let float = Format::R32G32B32A32_SFLOAT;
        let dark = vec![Val { area: 1.0, ..Val::default() }; val_count.next_multiple_of(VAL_TILE) as usize];
        Ok(Self {
            position: gpu.target("rsm.position", float, n, n)?,
            normal: gpu.target("rsm.normal", float, n, n)?,
            albedo: gpu.target("rsm.albedo", float, n, n)?,
            depth: gpu.target("rsm.depth", Format::D32_SFLOAT, n, n)?,
            vals: gpu.buffer_from("rsm.vals", &dark)?,
            val_count,
        })
    }
}

impl CacheTargets {
    fn new(gpu: &Gpu, plan: &Plan, count: u32) -> Result<Self> {
        let names = [
            "gather.diffuse_position",
            "gather.diffuse_irradiance",
            "gather.glossy_position",
            "gather.glossy_irradiance",
        ];
        let rows = count.div_ceil(ATLAS_WIDTH).max(1);
        let sum = |name: &&str| gpu.target(name, Format::R32G32B32A32_SFLOAT, ATLAS_WIDTH, rows);
        let n = u64::from(count.max(1));
        Ok(Self {
            atlas: gpu.buffer("atlas.caches", n * size_of::<Cache>() as u64)?,
            sums: names[..if plan.glossy { 4 } else { 2 }].iter().map(sum).collect::<Result<_>>()?,
            proxies: gpu.buffer("gather.proxies", n * size_of::<Proxy>() as u64)?,
            count,
        })
    }
}
