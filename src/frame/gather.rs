//! Stage 6, gather: sums VALs at caches into proxy lights. METHOD 3-4, thesis 5.3.
//!
//! There are three ways. Compute processes the list of live caches with several caches per thread, and splits the VALs
//! into parts so that few caches fill a device too. Draws (`gather_draws.rs`) add tiles of VALs to float images by
//! blending. Clusters (`gather_clusters.rs`) replace VALs by nodes of a pyramid. The first two share the loop body in
//! glsl/lib/gather.glsl.

use super::bounce::{Bounces, Sources};
use super::depth_images::{DepthImages, SentOn, are_texels};
use super::directions::Directions;
use super::gather_clusters::Clusters;
use super::gather_draws::Draws;
use super::live::{Items, Live, new_parts, parts_of, split_of};
use super::near::CACHE_REACH;
use super::plan::Plan;
pub use super::proxies::{Lit, SeenSky};
use super::settings::{self, Near, Shadows, Ways};
pub use super::sums::ComputeKind;
use super::sums::{SumBinds, SumKind, sum_pipeline};
use super::vals::Vals;
use super::world::{LightInfo, World};
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{GATHER_THREADS, GatherPush, GlossySums};
use glam::Vec4;

/// Lights the caches in one of three ways.
pub enum Gather {
    /// Every VAL, by a compute shader.
    Compute(Box<Compute>),
    /// Every VAL, by draws.
    Draws(Box<Draws>),
    /// Clusters of VALs.
    Clusters(Box<Clusters>),
}

/// Consecutive VALs that share the visibility of the first one. They are neighbours in an RSM and together mostly
/// smaller than a texel of a depth image.
const SHADOWED_TOGETHER: u32 = 4;

/// Smallest RSM side \[texels\] at which this many neighbours lie close enough together.
const FINE_RSM: u32 = 96;

impl Gather {
    /// Creates the gather of a plan for a world's caches, this many VALs, RSMs with `rsm` texels a side, and this many
    /// eyes.
    pub(super) fn new(
        gpu: &Device,
        plan: &Plan,
        world: &World,
        way: &settings::Caches,
        [vals, rsm, eyes]: [u32; 3],
    ) -> Result<Self> {
        let caches = world.cache_count;
        Ok(match way.gather {
            settings::Gather::Compute { ways, shadows, .. } => {
                // Neighbouring VALs of a coarse RSM, of an area light, or of the list of emissive patches, lie in different
                // directions.
                let close = |light: &LightInfo| !light.is_area && light.rsm_size(rsm) >= FINE_RSM;
                let mut lights = world.lights().iter().filter(|light| !(light.of_sky && plan.sends_sky));
                let fine = !plan.emitters && lights.all(close);
                let together = if fine { SHADOWED_TOGETHER } else { 1 };
                let (glossy, bounces, weight) = (plan.lobes, plan.bounces, way.proxy_weight);
                let emitted = if plan.emitters { world.emitters.len() as u32 } else { 0 };
                let is_near = plan.near != Near::Off;
                let near = if is_near { (CACHE_REACH * world.spacing()) as f32 } else { 0.0 };
                let (sky, sees_sky) = (plan.sends_sky, plan.sky_light);
                let lobes = plan.sends_lobes;
                let kind = ComputeKind {
                    glossy,
                    lobes,
                    shadows,
                    together,
                    bounces,
                    emitted,
                    sky,
                    sees_sky,
                    weight,
                    eyes,
                    near,
                };
                Self::Compute(Box::new(match (shadows, is_near) {
                    (Shadows::PerLight, true) => {
                        let images = DepthImages::traced(gpu, world, bounces > 0)?;
                        Compute::with_images(gpu, [caches, vals], &ways, kind, Some(images))?
                    }
                    _ => Compute::new(gpu, caches, vals, &ways, kind)?,
                }))
            }
            settings::Gather::Draws { source, tile, dim } => {
                Self::Draws(Box::new(Draws::new(gpu, caches, plan.lobes, plan.cull, source, tile, dim)?))
            }
            settings::Gather::Clusters { rule, dim } => {
                Self::Clusters(Box::new(Clusters::new(gpu, world, rsm, rule, plan.lobes, dim)?))
            }
        })
    }

    /// The list of live caches. `None` for the gather by draws, which culls by the depth test.
    pub fn live(&self) -> Option<&Live> {
        match self {
            Self::Compute(by) => Some(&by.live),
            Self::Draws(_) => None,
            Self::Clusters(by) => Some(&by.live),
        }
    }

    /// Buffer with the number of VALs, or of nodes over them, that are split into parts.
    pub(super) fn light_count<'a>(&'a self, vals: &'a Vals) -> &'a Buffer {
        if let Self::Clusters(by) = self { &by.node_count } else { &vals.live_count }
    }

    /// Depth images of the caches; only with shadows of every VAL.
    pub fn depth_images(&self) -> Option<&DepthImages> {
        if let Self::Compute(by) = self { by.depth_images.as_ref() } else { None }
    }

    /// What the rays of depth images have met; only where they are traced and caches light caches.
    pub(super) fn sent_on(&self) -> Option<&SentOn> {
        self.depth_images().and_then(|images| images.sent_on.as_ref())
    }

    /// Radiance at caches by direction, for short rays.
    pub fn radiances(&self) -> Option<&Buffer> {
        if let Self::Compute(by) = self { Some(&by.near.as_ref()?.radiances) } else { None }
    }

    /// What guides short rays, `GUIDE_WORDS` values per cache.
    pub fn guides(&self) -> Option<&Buffer> {
        if let Self::Compute(by) = self { Some(&by.near.as_ref()?.guides) } else { None }
    }

    /// The sums of VALs' light, one after the other; `None` for other gathers than the compute shader's.
    pub(super) fn sums(&self) -> Option<Sums<'_>> {
        let Self::Compute(by) = self else { return None };
        let cache_parts = by.bounces.as_ref().map_or(0, |bounces| bounces.parts);
        Some(Sums { parts: &by.parts, args: &by.live.args, cache_parts })
    }

    /// The caches as VALs, if caches light caches.
    pub(super) fn cache_vals(&self) -> Option<&Buffer> {
        if let Self::Compute(by) = self { by.bounces.as_ref().map(|bounces| &bounces.vals) } else { None }
    }

    /// Records the stage. Depth images must be complete.
    pub fn record(&self, cmd: &Cmd<'_>, lit: &Lit<'_>) {
        match self {
            Self::Compute(by) => by.record(cmd, lit),
            Self::Draws(by) => by.record(cmd, lit),
            Self::Clusters(by) => by.record(cmd, lit),
        }
    }
}

/// Sums of light, one after the other for each part of the VALs.
#[derive(Clone, Copy)]
pub(super) struct Sums<'a> {
    pub(super) parts: &'a Buffer,
    /// A `LiveArgs`: numbers of caches and of parts.
    pub(super) args: &'a Buffer,
    /// Parts before those of the VALs, for light that caches send on.
    pub(super) cache_parts: u32,
}

/// The gather by a compute shader.
pub struct Compute {
    /// The caches that it lights.
    pub live: Live,
    /// Sums, one after the other for each part of the VALs.
    pub parts: Buffer,
    /// Number of finished parts for the caches of each thread; all 0 between frames.
    pub arrived: Buffer,
    /// Sums VALs. Also makes the proxies, unless caches light caches.
    sum: Pipeline,
    /// The same for two eyes at once.
    two_eyes: Option<TwoEyes>,
    /// Only with shadows of every VAL.
    pub depth_images: Option<DepthImages>,
    /// Only where caches light caches.
    pub bounces: Option<Bounces>,
    /// Only with short rays.
    near: Option<Directions>,
}

/// A gather for two eyes at once, which share position and form factor.
struct TwoEyes {
    sum: Pipeline,
    /// Sums of the second eye's glossy lobe, one after the other for each part.
    parts: Buffer,
}

/// Maximum number of VALs in a part. Older lavapipe leaves loops after 65 535 iterations, and an iteration handles a
/// few VALs.
const LONGEST_PART: u32 = 32_768;

impl Compute {
    /// Creates the gather for this many caches and VALs.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, caches: u32, vals: u32, ways: &Ways, kind: ComputeKind) -> Result<Self> {
        let images = (kind.shadows == Shadows::PerLight).then(|| DepthImages::new(gpu, caches)).transpose()?;
        Self::with_images(gpu, [caches, vals], ways, kind, images)
    }

    /// Creates the gather with these depth images.
    fn with_images(
        gpu: &Device,
        [caches, vals]: [u32; 2],
        ways: &Ways,
        kind: ComputeKind,
        depth_images: Option<DepthImages>,
    ) -> Result<Self> {
        // Caches can also become VALs.
        let ways = &ways.within(gpu.most_texels(), vals.max(caches));
        let split = split_of(caches, vals, ways.split, LONGEST_PART);
        let per_workgroup = GATHER_THREADS * ways.caches();
        let live = Live::new(gpu, Items { caches, group: 1, per_workgroup, lights: vals, split })?;
        let ComputeKind { glossy, shadows, together, bounces, eyes, near, lobes, sees_sky, .. } = kind;
        let is_near = near > 0.0;
        // Shaders expect planes wherever short rays find nearby light.
        assert!(depth_images.as_ref().is_none_or(|images| images.are_traced() == is_near), "images of another kind");
        let further = bounces > 0;
        let is_traced = depth_images.as_ref().is_some_and(|images| images.sent_on.is_some());
        let bounces = further.then(|| Bounces::new(gpu, &live, ways, kind, is_traced)).transpose()?;
        let parts = parts_of(vals, split) + bounces.as_ref().map_or(0, |bounces| bounces.parts);
        let images_as_texels = are_texels(gpu, caches, is_near);
        let sum = |proxies, two_eyes| {
            let near = is_near;
            sum_pipeline(
                gpu,
                ways,
                SumKind { glossy, shadows, together, proxies, two_eyes, near, lobes, images_as_texels },
            )
        };
        let to_rays = || {
            let (shadowed, further) = (shadows == Shadows::PerLight, bounces.is_some());
            Directions::new(gpu, [caches, vals], [shadowed, further, lobes, sees_sky], near, together)
        };
        let two_eyes = || -> Result<TwoEyes> {
            let bytes = u64::from(caches.max(1)) * u64::from(parts) * size_of::<GlossySums>() as u64;
            Ok(TwoEyes { sum: sum(true, true)?, parts: gpu.buffer("gather.second_parts", bytes)? })
        };
        Ok(Self {
            two_eyes: (glossy && eyes > 1 && !further).then(two_eyes).transpose()?,
            parts: new_parts(gpu, caches, parts)?,
            arrived: gpu.buffer_from("gather.arrived", &vec![0_u32; caches.max(1) as usize])?,
            sum: sum(!further, false)?,
            near: is_near.then(to_rays).transpose()?,
            depth_images,
            bounces,
            live,
        })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, lit: &Lit<'_>) {
        let mut runs = lit.runs().peekable();
        let mut is_first = true;
        while let Some(run) = runs.next() {
            if !std::mem::take(&mut is_first) {
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // parts, counts
            }
            let second = self.two_eyes.as_ref().and_then(|two_eyes| Some((two_eyes, runs.next()?)));
            self.record_run(cmd, lit, run, second);
        }
        if let Some(directions) = &self.near {
            let (bounces, images) = (self.bounces.as_ref(), self.depth_images.as_ref());
            directions.record(cmd, lit, &self.live, bounces, images, &self.parts);
        }
    }

    /// Records the gather for one eye or for two. Each is given by its first proxy and its position.
    fn record_run(
        &self,
        cmd: &Cmd<'_>,
        lit: &Lit<'_>,
        (first_proxy, eye): (u32, Vec4),
        second: Option<(&TwoEyes, (u32, Vec4))>,
    ) {
        let (second_proxy, second_eye) = second.map_or((0, Vec4::ZERO), |(_, run)| run);
        let [begin, end] = self.near.as_ref().map_or([-1.0, 0.0], |near| near.fade);
        let push = GatherPush {
            cache_count: lit.atlas.count,
            first: 0,
            tile: 0,
            split: self.live.split,
            columns: 0,
            cache_parts: self.bounces.as_ref().map_or(0, |bounces| bounces.parts),
            first_proxy,
            second_proxy,
            eye,
            second_eye,
            near_begin: begin,
            near_scale: 1.0 / (end - begin),
        };
        let binds = SumBinds {
            atlas: lit.atlas,
            live: &self.live,
            vals: (&lit.vals.live, &lit.vals.live_count),
            parts: &self.parts,
            proxies: self.bounces.is_none().then_some((&lit.proxies.buffer, &self.arrived)),
            depth_images: self.depth_images.as_ref().map(|images| &images.buffer),
            second_parts: second.map(|(two_eyes, _)| &two_eyes.parts),
        };
        let primary = |binds: &SumBinds<'_>, push: &GatherPush| {
            binds.bind(cmd, second.map_or(&self.sum, |(two_eyes, _)| &two_eyes.sum));
            cmd.push(push);
            cmd.dispatch_indirect(&self.live.args, 0);
        };
        match (&self.bounces, lit.albedos) {
            (Some(bounces), Some(albedos)) => {
                // Caches pass on all the light that they receive.
                let of_all = GatherPush { near_begin: -1.0, near_scale: 1e30, ..push };
                let sent_on = self.depth_images.as_ref().and_then(|images| images.sent_on.as_ref());
                let of_all_binds =
                    SumBinds { depth_images: sent_on.map(|s| &s.images).or(binds.depth_images), ..binds };
                primary(&of_all_binds, &of_all);
                let sums = [of_all_binds, binds].map(|binds| SumBinds { proxies: None, ..binds });
                let leave_out = || primary(&binds, &push);
                let pushes = [&of_all, &push];
                let leave_out = self.near.is_some().then_some(&leave_out as &dyn Fn());
                bounces.record(
                    cmd,
                    Sources { albedos, sky: lit.sky.map(|sky| sky.seen), emitted: lit.vals.emitted.as_ref(), sent_on },
                    [&sums[0], &sums[1]],
                    &lit.proxies.buffer,
                    pushes,
                    leave_out,
                );
            }
            _ => primary(&binds, &push),
        }
    }
}
