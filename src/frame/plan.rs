//! From a scene's features to the stages it needs. What a scene has not costs no pass, no target, no shader branch.

use super::{Gi, Settings, Shadows};
use crate::scene::{Material, Scene};

/// Which stages a frame has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Stage 2: there is a light.
    pub direct: bool,
    /// Stages 3, 4, 6 and 8: interpolated caches.
    pub lightskin: bool,
    /// Stage 5: only visible caches are lit.
    pub cull: bool,
    /// Stage 6 by clusters of VALs, and the pyramids before it.
    pub clusters: bool,
    /// Stage 7: the discs of caches dim the proxies of others.
    pub occlude: bool,
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
        Self {
            direct,
            lightskin: direct && settings.gi == Gi::LightSkin,
            cull: direct && settings.gi == Gi::LightSkin && settings.cull,
            clusters: direct && settings.gi == Gi::LightSkin && settings.cluster.is_some(),
            occlude: direct && settings.gi == Gi::LightSkin && settings.shadows == Shadows::Proxy,
            brute_force: direct && settings.gi == Gi::BruteForce,
            glossy: (0..scene.materials.len()).filter(used).any(|m| is_glossy(&scene.materials[m])),
        }
    }

    /// Whether there is indirect light at all.
    pub fn indirect(&self) -> bool {
        self.lightskin || self.brute_force
    }

    /// The table of stages, as `info` prints it.
    pub fn lines(&self) -> Vec<PlanLine> {
        let line = |number, name, runs, because| PlanLine { number, name, runs, because };
        let gi = if self.lightskin {
            "caches are interpolated"
        } else if self.direct {
            "not asked for by --gi"
        } else {
            "no light"
        };
        let gi_without_cull = if self.lightskin { "switched off: every cache is lit" } else { gi };
        let not_occluded = if self.lightskin { "not asked for by --shadows" } else { gi };
        vec![
            line(1, "gbuffer", true, "always"),
            line(2, "direct", self.direct, if self.direct { "there is a light" } else { "no light" }),
            line(3, "atlas", self.lightskin, gi),
            line(4, "rsm", self.indirect(), if self.indirect() { "indirect light needs VALs" } else { gi }),
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
                if self.clusters { "clusters of VALs light caches where that is near enough" } else { gi },
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

/// Whether a material can have a glossy lobe at all, whatever its textures hold.
fn is_glossy(material: &Material) -> bool {
    match material.phong {
        Some(phong) => phong.specular.max_element() > 0.0,
        None => {
            material.metallic > 0.0
                || (material.specular > 0.0 && material.ior != 1.0 && material.specular_color.max_element() > 0.0)
        }
    }
}
