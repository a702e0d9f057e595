//! Selects the stages that a scene's features need, and holds the one table of stages. A feature that the scene lacks
//! costs no pass, no target and no shader branch.

use super::settings::{Antialiasing, Caches, Gather, Indirect, LightShadows, Near, ProxyWeight, Settings, Shadows};
use crate::scene::animation::Quantity;
use crate::scene::{Material, Scene};

/// Features of a scene that determine its stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Features {
    /// Some meshes are skinned or morphed.
    pub bends: bool,
    /// Punctual lights.
    pub lights: bool,
    /// Lights other than those that represent the sky.
    pub lamps: bool,
    /// A sky that lights the scene.
    pub sky_light: bool,
    /// A sky or another backdrop is visible.
    pub sky: bool,
    /// Emissive surfaces that are area lights or lamps.
    pub areas: bool,
    /// Other emissive surfaces.
    pub emits: bool,
    /// Some material has a glossy lobe.
    pub glossy: bool,
    /// Some material is transparent.
    pub seen_through: bool,
    /// Some material is glass that bends light.
    pub bends_light: bool,
    /// Some material has a clear coat or sheen.
    pub coated: bool,
    /// Some material scatters light below its surface.
    pub filled: bool,
    /// The device can hold the data for ray tracing.
    pub rays: bool,
}

impl Features {
    /// Features of a scene. `areas` says whether some emissive surfaces are area lights or lamps, `emits` whether some are not.
    pub fn new(scene: &Scene, areas: bool, emits: bool) -> Self {
        Self {
            bends: scene.instances.iter().any(|instance| scene.meshes[instance.mesh].deform.is_some()),
            lights: !scene.lights.is_empty(),
            lamps: scene.lights.len() > scene.sky.as_ref().map_or(0, |sky| sky.lights.len()),
            sky_light: scene.sky.as_ref().is_some_and(|sky| !sky.lights.is_empty()),
            sky: scene.has_backdrop(),
            areas,
            emits,
            glossy: has_glossy_lobe(scene),
            seen_through: has(scene, Material::is_seen_through),
            bends_light: has(scene, Material::is_solid),
            coated: has(scene, Material::is_coated),
            filled: has(scene, |material| material.subsurface.is_some()),
            rays: true,
        }
    }

    /// Whether any surfaces emit, as area lights or otherwise.
    pub fn emits_at_all(&self) -> bool {
        self.areas || self.emits
    }
}

/// Stages of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Before stage 1: poses deformed meshes.
    pub deform: bool,
    /// Stage 2: there is a direct light.
    pub direct: bool,
    /// Stage 2 uses rays instead of shadow maps.
    pub light_rays: bool,
    /// Stage 2 in pixels without a surface: a sky or another backdrop is visible.
    pub sky: bool,
    /// Emissive surfaces that are not area lights become VALs, in addition to those of stage 4.
    pub emitters: bool,
    /// Stage 4 for lights: lit surfaces become VALs.
    pub reflects: bool,
    /// Stages 6 and 8: caches see the sky. Without these stages, directional lights represent it.
    pub sky_light: bool,
    /// Stage 6: caches send the sky's light on. Otherwise VALs of the lights that represent it do.
    pub sends_sky: bool,
    /// Stages 3, 4, 6 and 8: interpolated caches.
    pub lightskin: bool,
    /// Stage 5: only visible caches are lit.
    pub cull: bool,
    /// Stage 6 uses clusters of VALs, and pyramids are built before it.
    pub clusters: bool,
    /// Number of repetitions of stage 6. In each one, the lit caches light all caches.
    pub bounces: u32,
    /// Stage 7: the discs of caches dim the proxies of others.
    pub occlude: bool,
    /// Stage 6 tests every VAL against the other caches' rectangles, as each cache sees them.
    pub depth_images: bool,
    /// Source of light from nearby surfaces; with rays, stage 6 leaves these surfaces to short rays at pixels.
    pub near: Near,
    /// Stage 4, and every VAL lights every pixel, instead of stages 3, 6 and 8.
    pub brute_force: bool,
    /// Stages 1 and 8: pixels have a second surface.
    pub antialiasing: Antialiasing,
    /// Stages 1 and 8: maximum number of transparent layers.
    pub layers: u32,
    /// Stage 8: rays follow the light through bodies of glass.
    pub refracts: bool,
    /// Some material has a clear coat or sheen: stage 1 has one more target; stage 2 and the sky light evaluate these
    /// lobes.
    pub coated: bool,
    /// Stages 4, 9 and 10: light travels through translucent bodies. Without these stages such bodies reflect as much
    /// light as if it left them where it entered.
    pub inside: bool,
    /// Some material has a glossy lobe: stages 6 and 8 evaluate it and have targets for it.
    pub glossy: bool,
    /// Caches have proxies for the glossy lobe. With short rays they have none.
    pub lobes: bool,
    /// VALs send a share of their flux in the lobe in which their surface reflects. Without short rays all is diffuse.
    pub sends_lobes: bool,
}

/// A stage: its number in METHOD, its name, and the condition under which a frame has it.
#[derive(Clone, Copy, Debug)]
pub struct Stage {
    /// METHOD's number. Entries with the same number are parts of one stage or alternatives.
    pub number: u32,
    /// Name in captures, timings and traces.
    pub name: &'static str,
    /// Whether a plan has this stage.
    pub planned: fn(&Plan) -> bool,
}

/// Declares the stages in the order of the frame, and a constant for each one's index in `STAGES`.
macro_rules! stages {
    ($($constant:ident: $number:literal $name:literal $planned:expr;)*) => {
        /// All stages in the order of the frame. Plans, `info`, skipping, timings and tests use this table.
        pub const STAGES: &[Stage] = &[$(Stage { number: $number, name: $name, planned: $planned }),*];
        #[allow(non_camel_case_types, clippy::upper_case_acronyms, reason = "places in a table, named as constants")]
        enum Place { $($constant),* }
        $(pub(super) const $constant: usize = Place::$constant as usize;)*
    };
}

stages! {
    GBUFFER: 1 "gbuffer" |_| true;
    EDGES: 1 "edges" |plan| plan.antialiasing.points() > 0;
    LAYERS: 1 "layers" |plan| plan.layers > 0;
    DIRECT: 2 "direct" |plan| plan.direct;
    SKY: 2 "sky" |plan| plan.sky;
    ATLAS: 3 "atlas" |plan| plan.lightskin;
    RSM: 4 "rsm" Plan::indirect;
    PYRAMID: 4 "pyramid" |plan| plan.clusters;
    VISIBLE: 5 "visible" |plan| plan.lightskin;
    CULL: 5 "cull" |plan| plan.cull;
    DEPTH_IMAGES: 6 "depth images" |plan| plan.depth_images;
    SKY_SEEN: 6 "sky on caches" |plan| plan.sky_light;
    GATHER: 6 "gather" |plan| plan.lightskin;
    OCCLUDE: 7 "occlude" |plan| plan.occlude;
    NEAR: 8 "near rays" |plan| plan.near != Near::Off;
    INTERPOLATE: 8 "interpolate" |plan| plan.lightskin;
    SKY_LIGHT: 8 "sky light" |plan| plan.sky_light;
    BRUTE_FORCE: 8 "brute force" |plan| plan.brute_force;
    DIPOLES: 9 "dipole gather" |plan| plan.inside && plan.lightskin;
    SCATTER: 10 "scatter" |plan| plan.inside;
    MIX: 8 "mix edges" |plan| plan.antialiasing.points() > 0;
    MIX_LAYERS: 8 "mix layers" |plan| plan.layers > 0;
    COMPOSITE: 11 "composite" |_| true;
}

impl Plan {
    /// The stages that a scene with these features needs under these settings.
    pub fn of(scene: &Features, settings: &Settings) -> Self {
        let lights = scene.lights || scene.areas;
        let light = lights || scene.emits;
        let asked = if let Indirect::Caches(caches) = &settings.indirect { Some(caches) } else { None };
        let sees = |caches: &Caches| matches!(caches.gather, Gather::Compute { .. });
        let sky_light = scene.sky_light && scene.rays && asked.is_some_and(sees);
        let caches = asked.filter(|caches| scene.emits || sky_light || (lights && caches.gather.bounces() > 0));
        let gather = caches.map(|caches| caches.gather);
        let shadows = gather.map_or(Shadows::Off, |gather| gather.shadows());
        let near = gather.filter(|_| scene.rays).map_or(Near::Off, |gather| gather.near());
        let by_irradiance = caches.is_some_and(|caches| caches.proxy_weight == ProxyWeight::Irradiance);
        let brute_force = light && settings.indirect == Indirect::BruteForce;
        let bounce = gather.is_some_and(|gather| gather.bounces() > 0);
        let inside = scene.filled && (brute_force || bounce);
        let sends_sky = sky_light && bounce;
        // Light of punctual and area lights has bounced once when it reaches caches; without bounces there are no
        // caches for it. Light of other emissive surfaces and of the sky has not bounced yet.
        let bounces = match gather {
            Some(Gather::Compute { bounces, .. }) if scene.emits || sends_sky => bounces,
            Some(Gather::Compute { bounces, .. }) => bounces.saturating_sub(1),
            _ => 0,
        };
        // Light of the sky enters bodies from RSMs of the lights that represent it.
        let lit = scene.areas || if sends_sky && !inside { scene.lamps } else { scene.lights };
        let direct = scene.areas || if sky_light { scene.lamps } else { scene.lights };
        Self {
            deform: scene.bends,
            direct,
            light_rays: direct && scene.rays && settings.light_shadows == LightShadows::Rays,
            sky: scene.sky,
            emitters: scene.emits,
            reflects: lit && (brute_force || bounce),
            sky_light,
            sends_sky,
            lightskin: caches.is_some(),
            cull: caches.is_some_and(|caches: &Caches| caches.cull) && bounces == 0 && !inside,
            clusters: matches!(gather, Some(Gather::Clusters { .. })),
            bounces,
            occlude: shadows == Shadows::Proxy,
            depth_images: shadows == Shadows::PerLight,
            near,
            brute_force,
            antialiasing: settings.antialiasing,
            layers: if scene.seen_through { settings.layers } else { 0 },
            refracts: scene.bends_light && scene.rays && settings.layers > 0,
            coated: scene.coated,
            inside,
            glossy: scene.glossy,
            lobes: scene.glossy && near == Near::Off,
            sends_lobes: scene.glossy && near != Near::Off && by_irradiance,
        }
    }

    /// Whether there is any indirect light.
    pub fn indirect(&self) -> bool {
        self.lightskin || self.brute_force
    }

    /// Whether any stage traces rays.
    pub(super) fn rays(&self) -> bool {
        self.near != Near::Off || self.sky_light || self.light_rays || self.refracts
    }

    /// Whether vertices average the share of the sky that caches see. With short rays, pixels know it better.
    pub fn sky_at_vertices(&self) -> bool {
        self.sky_light && self.near == Near::Off
    }

    /// Whether pixels store which triangle they show.
    pub(super) fn elements(&self) -> bool {
        self.lightskin || self.inside
    }

    /// The stages of this plan, in order.
    pub fn stages(&self) -> impl Iterator<Item = &'static Stage> {
        STAGES.iter().filter(|stage| (stage.planned)(self))
    }

    /// The reason why a frame has or lacks a stage, as `info` prints it.
    pub fn why(&self, stage: &Stage) -> &'static str {
        let planned = (stage.planned)(self);
        let caches = match () {
            () if self.lightskin => "caches are interpolated",
            () if self.direct || self.emitters => "not asked for by --gi",
            () => "no light",
        };
        match stage.name {
            "gbuffer" | "composite" => "always",
            "edges" if planned => "antialiasing: which surface each point of a pixel shows",
            "mix edges" if planned => "antialiasing: averages each pixel over its points",
            "edges" | "mix edges" => "not asked for by --aa",
            "layers" if planned => "glass and blended materials, nearest first",
            "mix layers" if planned => "blends glass over the surfaces behind it",
            "layers" | "mix layers" => "no glass, no blended materials",
            "direct" if planned => "there is a light",
            "direct" if !self.sky_light => "no light",
            "sky" if planned => "the sky shows behind the scene",
            "sky" => "no sky shows",
            "direct" => "no light but the sky",
            "sky on caches" | "sky light" if planned => "a sky lights the scene",
            "sky on caches" | "sky light" => "no sky, or directional lights represent it",
            "rsm" if planned && !self.reflects && !self.emitters => "no VALs: caches send the sky's light on",
            "rsm" if planned && !self.reflects => "emissive surfaces become VALs",
            "rsm" if planned && self.emitters => "makes VALs of lit surfaces, and of large curved emissive surfaces",
            "rsm" if planned => "makes VALs of lit surfaces",
            "pyramid" if planned => "builds clusters of VALs",
            "pyramid" if self.lightskin => "not asked for by --cluster",
            "visible" if planned => "finds the caches that visible surfaces need",
            "cull" if planned => "keeps the caches that visible surfaces need",
            "cull" if self.inside => "translucent bodies need all of their caches",
            "cull" if self.bounces > 0 => "all caches are lit: each lights others in the next bounce",
            "cull" if self.lightskin => "switched off: every cache is lit",
            "depth images" if planned => "images of the scene from each cache, to shadow VALs",
            "depth images" if self.lightskin => "not asked for by --shadows",
            "near rays" if planned => "light and shadows from surfaces closer than the cache spacing",
            "near rays" if self.lightskin => "not asked for by --near",
            "dipole gather" if planned => "light inside translucent bodies, at each of their caches",
            "scatter" if planned => "light that leaves translucent bodies, at each pixel",
            "dipole gather" if self.inside => "brute force is used",
            "dipole gather" | "scatter" if self.lightskin || self.brute_force => "no translucent bodies",
            "gather" if self.bounces > 0 => "lights caches by VALs, then by each other, bounce after bounce",
            "gather" if self.clusters => "lights caches by clusters of VALs where they are far enough",
            "occlude" if planned => "dims proxy lights by the caches in their way",
            "occlude" if self.depth_images => "not needed: the gather leaves out hidden VALs",
            "occlude" if self.lightskin => "not asked for by --shadows",
            "interpolate" if self.brute_force => "brute force is used",
            "brute force" if planned => "every VAL at every pixel",
            "brute force" if self.lightskin => "caches are used",
            _ => caches,
        }
    }
}

/// Material quantities that can create a glossy lobe.
const LOBE: [Quantity; 4] = [Quantity::Metallic, Quantity::Ior, Quantity::Specular, Quantity::SpecularColor];

/// Whether any surface of the scene has a material with this property.
fn has(scene: &Scene, is: impl Fn(&Material) -> bool) -> bool {
    let materials = scene.meshes.iter().flat_map(|mesh| &mesh.primitives).map(|p| &scene.materials[p.material]);
    materials.into_iter().any(is)
}

/// Whether any surface of the scene can have a glossy lobe.
pub fn has_glossy_lobe(scene: &Scene) -> bool {
    let glossy: Vec<bool> = (0..scene.materials.len()).map(|m| is_glossy(scene, m)).collect();
    scene.meshes.iter().flat_map(|mesh| &mesh.primitives).any(|p| glossy[p.material])
}

/// Whether a material can have a glossy lobe, for any content of its textures and any state of its animations.
fn is_glossy(scene: &Scene, index: usize) -> bool {
    let material = &scene.materials[index];
    if material.phong.is_none() && scene.animates(&LOBE, index) {
        return true;
    }
    match material.phong {
        Some(phong) => phong.specular.max_element() > 0.0,
        None => {
            material.metallic > 0.0
                || (material.specular > 0.0 && material.ior != 1.0 && material.specular_color.max_element() > 0.0)
        }
    }
}
