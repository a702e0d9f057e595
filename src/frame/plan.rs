//! From a scene's features to the stages it needs. What a scene has not costs no pass, no target, no shader branch.

use super::{GatherPath, Gi, Settings, Shadows};
use crate::scene::Scene;
use crate::scene::animation::Quantity;

/// Which stages a frame has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Before stage 1: meshes that bend are posed.
    pub deform: bool,
    /// Stage 2: there is a light.
    pub direct: bool,
    /// Stage 2 where no surface is: there is a sky.
    pub sky: bool,
    /// Surfaces that emit are VALs, beside those of stage 4.
    pub emitters: bool,
    /// Stages 3, 4, 6 and 8: interpolated caches.
    pub lightskin: bool,
    /// Stage 5: only visible caches are lit.
    pub cull: bool,
    /// Stage 6 by clusters of VALs, and the pyramids before it.
    pub clusters: bool,
    /// Stage 6 goes on: lit caches light all caches.
    pub bounces: bool,
    /// Stage 7: the discs of caches dim the proxies of others.
    pub occlude: bool,
    /// Stage 6 tests every VAL against what caches see of the others' rectangles.
    pub depth_images: bool,
    /// Stage 4 and every VAL onto every pixel, instead of 3, 6 and 8.
    pub brute_force: bool,
    /// A material has a glossy lobe: its share of stages 6 and 8 and its targets.
    pub glossy: bool,
}

/// One line of `lightskin info`: a stage of METHOD's table, and why it runs or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlanLine {
    /// METHOD's number.
    pub number: u32,
    /// METHOD's name.
    pub name: &'static str,
    /// Whether the frame has it.
    pub runs: bool,
    /// Why.
    pub because: &'static str,
}

impl Plan {
    /// The stages that this scene needs under these settings.
    pub fn new(scene: &Scene, settings: &Settings) -> Self {
        let direct = !scene.lights.is_empty();
        let used = |m: &usize| scene.meshes.iter().flat_map(|mesh| &mesh.primitives).any(|p| p.material == *m);
        let emitters = scene.emits();
        let lightskin = (direct || emitters) && settings.gi == Gi::LightSkin && settings.bounces > 0;
        let bounces = lightskin && settings.bounces > 1;
        Self {
            deform: scene.instances.iter().any(|instance| scene.meshes[instance.mesh].deform.is_some()),
            direct,
            sky: scene.sky.is_some(),
            emitters,
            lightskin,
            cull: lightskin && settings.cull && !bounces,
            clusters: lightskin && settings.cluster.is_some(),
            bounces,
            occlude: lightskin && settings.shadows == Shadows::Proxy,
            depth_images: lightskin && settings.shadows == Shadows::PerLight,
            brute_force: (direct || emitters) && settings.gi == Gi::BruteForce && settings.bounces > 0,
            glossy: (0..scene.materials.len()).filter(used).any(|m| is_glossy(scene, m)),
        }
    }

    /// Whether there is indirect light at all.
    pub fn indirect(&self) -> bool {
        self.lightskin || self.brute_force
    }

    /// Whether the gather lights all caches by every VAL, from a list: then that is the same in each frame.
    pub fn lights_all(&self, settings: &Settings) -> bool {
        self.lightskin && !self.cull && !self.clusters && settings.gather.path == GatherPath::Compute
    }

    /// The table of stages, as `info` prints it.
    pub fn lines(&self) -> Vec<PlanLine> {
        let line = |number, name, runs, because| PlanLine { number, name, runs, because };
        let gi = if self.lightskin {
            "caches are interpolated"
        } else if self.direct || self.emitters {
            "not asked for by --gi"
        } else {
            "no light"
        };
        let gi_without_cull = match () {
            () if self.bounces => "every cache lights others in the next bounce",
            () if self.lightskin => "switched off: every cache is lit",
            () => gi,
        };
        let not_occluded = match () {
            () if self.depth_images => "the gather itself leaves out VALs that are hidden",
            () if self.lightskin => "not asked for by --shadows",
            () => gi,
        };
        vec![
            line(1, "gbuffer", true, "always"),
            line(
                2,
                "direct",
                self.direct,
                match (self.direct, self.sky) {
                    (true, true) => "there is a light, and a sky",
                    (true, false) => "there is a light",
                    (false, _) => "no light",
                },
            ),
            line(3, "atlas", self.lightskin, gi),
            line(
                4,
                "rsm",
                self.indirect(),
                match () {
                    () if self.indirect() && !self.direct => "surfaces that emit are VALs",
                    () if self.indirect() && self.emitters => {
                        "indirect light needs VALs; surfaces that emit are some, too"
                    }
                    () if self.indirect() => "indirect light needs VALs",
                    () => gi,
                },
            ),
            line(
                5,
                "cull",
                self.cull,
                if self.cull { "only caches that visible surfaces need are lit" } else { gi_without_cull },
            ),
            line(
                6,
                "gather",
                self.lightskin,
                match () {
                    () if self.bounces => "caches light caches, bounce after bounce",
                    () if self.clusters => "clusters of VALs light caches where that is near enough",
                    () => gi,
                },
            ),
            line(
                7,
                "occlude",
                self.occlude,
                if self.occlude { "caches are in the way of proxy lights" } else { not_occluded },
            ),
            line(
                8,
                "interpolate",
                self.indirect(),
                if self.brute_force { "by brute force: every VAL onto every pixel" } else { gi },
            ),
            line(9, "dipole", false, "not built yet: no subsurface scattering"),
            line(10, "scatter", false, "not built yet: no subsurface scattering"),
            line(11, "composite", true, "always"),
        ]
    }
}

/// What a lobe may come from.
const LOBE: [Quantity; 4] = [Quantity::Metallic, Quantity::Ior, Quantity::Specular, Quantity::SpecularColor];

/// Whether a material can have a glossy lobe at all, whatever its textures hold and its animations set.
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
