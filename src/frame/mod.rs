//! The frame: METHOD's eleven stages in order, each in the file of its name.

mod albedo;
pub mod atlas;
pub mod bounce;
pub mod brute_force;
pub mod cells;
pub mod check;
pub mod clusters;
pub mod composite;
pub mod cull;
pub mod deform;
pub mod depth_images;
pub mod direct;
mod emitters;
pub mod gather;
pub mod gbuffer;
pub mod interpolate;
pub mod lights;
mod model_caches;
mod moving;
pub mod occlude;
pub mod pack;
pub mod plan;
pub mod pyramid;
mod reuse;
pub mod rsm;
pub mod sky;
pub mod targets;
pub mod tune;
pub mod upload;
pub mod view;
pub mod visible;

pub use clusters::Cluster;
pub use gather::{GatherPath, GatherSettings, ValSource};
pub use plan::{Plan, PlanLine};
use reuse::Due;
pub use targets::Targets;
pub use upload::SceneBuffers;
pub use view::View;

use crate::error::{Error, Result};
use crate::gpu::{Buffer, Cmd, Format, Gpu, Stream, Use};
use crate::scene::{Scene, Vertex};
use crate::shared::LiveArgs;
use std::cell::RefCell;

/// How indirect light is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gi {
    /// Interpolated caches.
    #[default]
    LightSkin,
    /// Every VAL onto every pixel.
    BruteForce,
    /// None.
    Off,
}

/// What the light of a vertex's caches is averaged as. METHOD 5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Facing irradiance and position of the lit caches, faster kernel: bounded, and the better one by measurement.
    #[default]
    Facing,
    /// Flux and position with the thesis's weights, eq. 5.49 to 5.51.
    Printed,
}

/// Where caches are averaged. METHOD 5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Level {
    /// At vertices: between them lights are interpolated, so that triangles must be small against the caches' spacing.
    #[default]
    Vertex,
    /// At every pixel, whatever the triangles; for a `CacheSet` with cells.
    Texel,
}

/// How strongly a VAL pulls a proxy's position. METHOD 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ProxyWeight {
    /// By its irradiance on the cache.
    #[default]
    Irradiance,
    /// By its form factor, as eq. 5.42 prints it.
    FormFactor,
}

/// Whether things are in the way of indirect light. METHOD 6.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shadows {
    /// Nothing is.
    #[default]
    Off,
    /// Stage 7: the discs of the other caches dim a cache's proxy lights.
    Proxy,
    /// Stage 6 tests every VAL against what each cache sees of the others' rectangles.
    PerLight,
}

/// Curve from scene to display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Tonemap {
    /// Khronos PBR Neutral.
    #[default]
    PbrNeutral = 0,
    /// AgX.
    Agx = 1,
    /// ACES, Hill's fit.
    Aces = 2,
    /// None but clipping.
    Linear = 3,
}

/// How bright the picture is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// The log-average luminance becomes middle grey.
    #[default]
    Automatic,
    /// Exposure value at ISO 100: 1.2 * 2^EV cd/m^2 becomes 1.
    Ev(f32),
}

/// Everything that shapes a frame besides scene and camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Picture [pixels].
    pub size: [u32; 2],
    /// Indirect light.
    pub gi: Gi,
    /// Indirect bounces; 0 is direct light alone. More than one take the gather's compute path and every VAL.
    pub bounces: u32,
    /// References per vertex, 8 or 16; those of the bake.
    pub references: usize,
    /// Texels of an RSM's side; six-view lights share as many.
    pub rsm: u32,
    /// Texels of a shadow map's side.
    pub shadow_map: u32,
    /// Kernel and quantities of stage 8.
    pub interpolation: Interpolation,
    /// Where stage 8 averages caches.
    pub level: Level,
    /// Weights of stage 6.
    pub proxy_weight: ProxyWeight,
    /// How stage 6 runs.
    pub gather: GatherSettings,
    /// Clusters of VALs light caches where that is near enough, instead of every VAL; by the compute path alone.
    pub cluster: Option<Cluster>,
    /// Only caches that visible surfaces need are lit. Pictures do not change.
    pub cull: bool,
    /// Soft shadows of indirect light.
    pub shadows: Shadows,
    /// Stages whose inputs are those of the frame before are left out. Pictures do not change, times do.
    pub reuse: bool,
    /// Curve of stage 11.
    pub tonemap: Tonemap,
    /// Exposure of stage 11.
    pub exposure: Exposure,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            size: [1280, 720],
            gi: Gi::LightSkin,
            bounces: 1,
            references: 8,
            rsm: 128,
            shadow_map: 2048,
            interpolation: Interpolation::Facing,
            level: Level::Vertex,
            proxy_weight: ProxyWeight::Irradiance,
            gather: GatherSettings::default(),
            cluster: None,
            cull: true,
            shadows: Shadows::Off,
            reuse: false,
            tonemap: Tonemap::PbrNeutral,
            exposure: Exposure::Automatic,
        }
    }
}

/// A vertex as stages 1, 2 and 4 read it.
const VERTEX: Stream<'static> = Stream {
    stride: size_of::<Vertex>() as u32,
    attributes: &[
        (0, Format::R32G32B32_SFLOAT, 0),
        (1, Format::R32G32B32_SFLOAT, 12),
        (2, Format::R32G32B32A32_SFLOAT, 24),
        (3, Format::R32G32_SFLOAT, 40),
        (4, Format::R32G32_SFLOAT, 48),
        (5, Format::R8G8B8A8_UNORM, 56),
    ],
};

/// The stages a scene needs, and their targets.
pub struct Frame {
    /// Which stages there are.
    pub plan: Plan,
    /// What they write.
    pub targets: Targets,
    poses: Option<deform::Poses>,
    gbuffer: gbuffer::GBuffer,
    direct: Option<direct::Direct>,
    sky: Option<sky::Background>,
    rsm: Option<rsm::Rsm>,
    lightskin: Option<LightSkin>,
    brute_force: Option<brute_force::BruteForce>,
    composite: composite::Composite,
    bounces: u32,
    reuse: bool,
    /// What the targets hold.
    done: RefCell<reuse::Done>,
    /// What the last recorded frame has run.
    due: RefCell<Due>,
}

/// What a frame has worked with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Live {
    /// Caches that were lit.
    pub caches: u32,
    /// VALs that carry light.
    pub vals: u32,
    /// Pairs of a cache and a VAL, or a node that stands for some, whose light was computed.
    pub pairs: u64,
}

/// Stages 3 and 5 to 8.
struct LightSkin {
    atlas: atlas::Atlas,
    visible: Seen,
    cull: Option<cull::Cull>,
    gather: Lighting,
    occlude: Option<occlude::Occlude>,
    interpolate: interpolate::Interpolate,
}

/// Ways to find what is visible.
enum Seen {
    /// Corners of triangles.
    Vertices(visible::Visible),
    /// Cells of surfaces.
    Cells(cells::VisibleCells),
}

/// Ways of stage 6.
enum Lighting {
    /// Every VAL.
    All(Box<gather::Gather>),
    /// Clusters of them.
    Clusters(Box<clusters::Clusters>),
}

impl Frame {
    /// Makes stages and targets for a scene.
    pub fn new(gpu: &Gpu, scene: &Scene, buffers: &SceneBuffers, settings: &Settings) -> Result<Self> {
        let plan = Plan::new(scene, settings);
        if settings.cluster.is_some() && settings.gather.path == GatherPath::Fragment {
            return Err(Error::Nothing("clusters of VALs need the gather's compute path".into()));
        }
        if plan.bounces && (settings.cluster.is_some() || settings.gather.path == GatherPath::Fragment) {
            return Err(Error::Nothing("more than one bounce needs the gather's compute path, and no clusters".into()));
        }
        if plan.bounces && buffers.cache_albedos.is_none() {
            return Err(Error::Nothing("more than one bounce needs SceneBuffers::add_albedos".into()));
        }
        if plan.brute_force && settings.bounces > 1 {
            return Err(Error::Nothing("brute force has one bounce".into()));
        }
        let of_pixels = buffers.cells.as_ref().map(|cells| cells.row);
        if plan.lightskin && of_pixels.is_some() != (settings.level == Level::Texel) {
            return Err(Error::Nothing(
                "caches come with cells for pixels to look up, or are averaged at vertices".into(),
            ));
        }
        if settings.shadows == Shadows::PerLight
            && (settings.cluster.is_some() || settings.gather.path == GatherPath::Fragment)
        {
            return Err(Error::Nothing("shadows of every VAL need the gather's compute path without clusters".into()));
        }
        let lightskin = || -> Result<LightSkin> {
            Ok(LightSkin {
                atlas: atlas::Atlas::new(gpu)?,
                visible: match of_pixels {
                    None => Seen::Vertices(visible::Visible::new(gpu)?),
                    Some(_) => Seen::Cells(cells::VisibleCells::new(gpu)?),
                },
                cull: plan
                    .cull
                    .then(|| cull::Cull::new(gpu, settings, of_pixels.unwrap_or(settings.references)))
                    .transpose()?,
                gather: match settings.cluster {
                    None => Lighting::All(Box::new(gather::Gather::of_frame(gpu, &plan, settings, buffers.lights())?)),
                    Some(rule) => {
                        let made = clusters::Clusters::new(gpu, buffers, settings, rule, plan.glossy)?;
                        Lighting::Clusters(Box::new(made))
                    }
                },
                occlude: plan.occlude.then(|| occlude::Occlude::new(gpu, &plan, settings)).transpose()?,
                interpolate: interpolate::Interpolate::new(gpu, &plan, settings, of_pixels)?,
            })
        };
        Ok(Self {
            targets: Targets::new(gpu, &plan, buffers, settings)?,
            gbuffer: gbuffer::GBuffer::new(gpu, &plan)?,
            direct: plan.direct.then(|| direct::Direct::new(gpu)).transpose()?,
            sky: plan.sky.then(|| sky::Background::new(gpu)).transpose()?,
            rsm: plan
                .indirect()
                .then(|| rsm::Rsm::new(gpu, settings.proxy_weight, plan.lights_all(settings)))
                .transpose()?,
            lightskin: plan.lightskin.then(lightskin).transpose()?,
            brute_force: plan.brute_force.then(|| brute_force::BruteForce::new(gpu, &plan)).transpose()?,
            composite: composite::Composite::new(gpu, &plan, settings)?,
            poses: plan.deform.then(|| deform::Poses::new(gpu)).transpose()?,
            bounces: settings.bounces,
            reuse: settings.reuse,
            done: RefCell::new(reuse::Done::new(buffers)),
            due: RefCell::default(),
            plan,
        })
    }

    /// Every buffer that a frame writes.
    pub fn buffers(&self) -> Vec<&Buffer> {
        let mut all = self.targets.buffers();
        if let Some(LightSkin { gather: Lighting::Clusters(clusters), .. }) = &self.lightskin {
            all.extend(clusters.pyramid.buffers());
        }
        all
    }

    /// Caches that the last frame has lit, VALs that carry light, and pairs of both. Waits for the device.
    pub fn live(&self, gpu: &Gpu) -> Result<Live> {
        let mut live = Live::default();
        if let Some(rsm) = &self.targets.rsm {
            live.vals = gpu.read::<u32>(&rsm.vals.live_count)?[0];
        }
        if let Some(caches) = &self.targets.caches {
            live.caches = match (&caches.live, &caches.mask) {
                (Some(list), _) => lit(gpu, list, caches.count)?,
                (_, Some(mask)) => {
                    let mask: Vec<f32> = gpu.read_image(mask)?;
                    (0..caches.count).filter(|cache| mask[caches.texel(*cache)] > 0.0).count() as u32
                }
                _ => caches.count,
            };
            live.pairs = u64::from(live.caches) * u64::from(live.vals);
            if caches.bounces.is_some() {
                live.pairs += u64::from(self.bounces) * u64::from(caches.count).pow(2);
            }
            if let (Some(clusters), Some(list)) = (&caches.clusters, &caches.live) {
                let LiveArgs { groups_x, groups_y, .. } = gpu.read(&list.args)?[0];
                let pairs: Vec<u32> = gpu.read(&clusters.pairs)?;
                live.pairs = pairs[..(groups_x * groups_y) as usize].iter().map(|n| u64::from(*n)).sum();
            }
        }
        Ok(live)
    }

    /// Stages of the plan that the last recorded frame has left out, since nothing they read had changed.
    pub fn skipped(&self) -> Vec<&'static str> {
        self.due.borrow().skipped(&self.plan)
    }

    /// Records one frame, top to bottom; the numbers are METHOD's. A stage the scene does not need is `None`, one whose
    /// inputs are as they were is not `due`.
    pub fn record(&self, cmd: &Cmd<'_>, scene: &SceneBuffers, view: &View) {
        let t = &self.targets;
        let (mut due, mut done) = (self.due.borrow_mut(), self.done.borrow_mut());
        due.find(self.reuse, &self.plan, &done, &scene.revisions, view);
        // The last frame is done; images UNDEFINED -> GENERAL, unless what they hold may be of use.
        cmd.begin_frame(if self.reuse && done.is_some() { Vec::new() } else { t.images() });

        if let (true, Some(poses)) = (scene.record_changes(cmd), &self.poses) {
            poses.record(cmd, scene); // what bends, before all stages
            cmd.barrier(Use::ComputeWrite, Use::VertexInput | Use::ComputeRead);
        }
        if due.direct {
            self.gbuffer.record(cmd, scene, view, t); // 1
        }
        if let Some(direct) = self.direct.as_ref().filter(|_| due.direct) {
            direct.record(cmd, scene, view, t); // 2
        }
        if let Some(sky) = self.sky.as_ref().filter(|_| due.direct) {
            sky.record(cmd, scene, view, t); // 2
        }
        if let (true, Some(LightSkin { atlas, .. }), Some(caches)) = (due.atlas, &self.lightskin, &t.caches) {
            atlas.record(cmd, scene, caches); // 3
        }
        if let (true, Some(rsm), Some(targets)) = (due.rsm, &self.rsm, &t.rsm) {
            let all = t.caches.as_ref().and_then(|caches| caches.live.as_ref());
            rsm.record(cmd, scene, &due.lights, done.new_emitters(scene), targets, all); // 4
            if let Some(LightSkin { gather: Lighting::Clusters(by), .. }) = &self.lightskin {
                by.pyramid.record(cmd, targets); // 6, before the gather
            }
        }
        if let (Some(gi), Some(caches), Some(rsm), Some(out)) = (&self.lightskin, &t.caches, &t.rsm, &t.indirect)
            && let (Some(element), Some(visible)) = (&t.element, &t.visible)
        {
            if due.visible {
                match &gi.visible {
                    Seen::Vertices(by) => by.record(cmd, scene, &[element], visible), // 5
                    Seen::Cells(by) => by.record(cmd, scene, view, element, visible), // 5
                }
            }
            if let Some(cull) = gi.cull.as_ref().filter(|_| due.cull) {
                cull.record(cmd, scene, visible, &rsm.vals, caches); // 5
            }
            if due.direct {
                cmd.barrier(
                    Use::ComputeWrite | Use::DepthWrite,
                    Use::ComputeRead | Use::IndirectRead | Use::VertexRead | Use::FragmentRead | Use::DepthRead,
                ); //   VALs, atlas, live caches -> 6
            }
            if due.gather {
                match &gi.gather {
                    Lighting::All(gather) => {
                        gather.record(cmd, &rsm.vals, view, caches, scene.cache_albedos(), due.depth_images); // 6
                    }
                    Lighting::Clusters(clusters) => clusters.record(cmd, &rsm.vals, view, caches), // 6
                }
                if let Some(occlude) = &gi.occlude {
                    occlude.record(cmd, caches); // 7
                }
            }
            if due.interpolate {
                gi.interpolate.record(cmd, scene, view, t, visible, caches, out); // 8
            }
        }
        if let (true, Some(brute_force), Some(rsm), Some(out)) =
            (due.interpolate, &self.brute_force, &t.rsm, &t.indirect)
        {
            cmd.barrier(Use::ComputeWrite | Use::ColorWrite | Use::DepthWrite, Use::FragmentRead); //   VALs, G-buffer -> 8
            brute_force.record(cmd, &rsm.vals, view, t, out); // 8
        }
        if due.composite {
            self.composite.record(cmd, t); // 11
        }
        done.set(&scene.revisions, view);
    }
}

/// Caches of the live items of a list.
fn lit(gpu: &Gpu, live: &targets::LiveCaches, count: u32) -> Result<u32> {
    let items = gpu.read::<LiveArgs>(&live.args)?[0].cache_count;
    let list: Vec<u32> = gpu.read(&live.list)?;
    Ok(list[..items as usize].iter().map(|item| (count - item * live.group).min(live.group)).sum())
}
