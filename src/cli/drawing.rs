//! Flags that choose how light is computed and drawn, shared by `render` and `view`.

use super::gather::GatherArgs;
use super::words::{
    AntialiasingArg, GiArg, InterpolationArg, NearArg, ProxyWeightArg, ShadowsArg, light_shadows, light_shadows_word,
};
use super::{word, wrong_usage};
use lightskin::frame::settings::{Caches, Gather, Ways};
use lightskin::frame::{
    Antialiasing, Indirect, Interpolation, LightShadows, Near, ProxyWeight, Quality, Settings, Shadows,
};
use serde_json::{Value, json};

/// Headings of the help.
pub(super) const QUALITY: &str = "Quality";
pub(super) const METHOD: &str = "Variants of the method";

/// Short rays per traced pixel in each of many pictures whose mean is taken.
const RAYS_OF_A_SAMPLE: u32 = 4;

/// The settings of a frame, where they differ from those of the quality level.
#[derive(clap::Args, Clone, Default)]
pub(super) struct DrawingArgs {
    /// Method for indirect light.
    #[arg(long, value_enum, default_value_t)]
    pub(super) gi: GiArg,
    /// Number of indirect bounces [default: set by --quality; no limit with --gi path-trace].
    ///
    /// 0 renders only direct light: lamps, emissive surfaces and the sky. Caches support up to 16 bounces, brute force
    /// one.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub(super) bounces: Option<u32>,
    /// Virtual lights per light source: N x N, the texels of its reflective shadow map [default: 128 at --quality
    /// high].
    ///
    /// A virtual light is a lit surface point that gives indirect light. More of them give smoother indirect light.
    #[arg(long, help_heading = QUALITY, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    rsm: Option<u32>,
    /// Shadows of lamps and the sun: rays, or shadow maps of N x N texels [default: rays at --quality high].
    #[arg(long, help_heading = QUALITY, value_name = "rays|N", value_parser = light_shadows)]
    shadow_map: Option<LightShadows>,
    /// Antialiasing: extra sample points per pixel, or fast [default: 4 at --quality high].
    ///
    /// 64 averages 64 pictures. `render` does so at --quality reference, except with --gi brute-force. With --gi
    /// path-trace, any value but off spreads the samples over the pixel.
    #[arg(long, help_heading = QUALITY, value_name = "off|fast|4|8|64", value_enum)]
    aa: Option<AntialiasingArg>,
    /// Maximum number of glass and blended layers per pixel; the nearest are drawn [default: 4 at --quality high].
    #[arg(long, help_heading = QUALITY, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    layers: Option<u32>,
    #[command(flatten)]
    pub(super) gather: GatherArgs,
    /// Quantity that is interpolated between caches.
    ///
    /// Each cache condenses all indirect light into one diffuse and one glossy proxy light.
    #[arg(long, help_heading = METHOD, hide_short_help = true, value_enum, default_value_t)]
    interpolation: InterpolationArg,
    /// Weight of each virtual light when the position of a proxy light is averaged.
    #[arg(long, help_heading = METHOD, hide_short_help = true, value_enum, default_value_t)]
    proxy_weight: ProxyWeightArg,
    /// Shadows of indirect light [default: per-light at --quality high].
    ///
    /// The default is cheaper above 20000 caches (4096 with --near off), with --gather fragment and with clusters.
    #[arg(long, help_heading = QUALITY, value_enum)]
    pub(super) shadows: Option<ShadowsArg>,
    /// Rays from pixels, for light and occlusion that caches cannot resolve [default: rays at --quality high, endless at
    /// reference].
    #[arg(long, help_heading = QUALITY, value_enum)]
    near: Option<NearArg>,
    /// Short rays per traced pixel, and a quarter as many more towards bright regions, or half as many under a sky; 16
    /// neighbouring pixels share their rays [default: 8 at --quality high; 4 with --aa 64].
    #[arg(long, help_heading = QUALITY, hide_short_help = true, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32))]
    near_rays: Option<u32>,
    /// Trace short rays at every N-th pixel of every N-th row; 0: 2, but 1 below 640x360 pixels [default: 0 at --quality
    /// high].
    #[arg(long, help_heading = QUALITY, hide_short_help = true, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=8))]
    near_every: Option<u32>,
}

impl DrawingArgs {
    /// Ends the process if the flags cannot be combined.
    pub(super) fn check(&self, level: Quality) {
        self.gather.check(self.shadows(level, 0));
        match self.gi {
            GiArg::Lightskin if self.bounces(level) > 16 => wrong_usage("--bounces: caches support 16 at most"),
            GiArg::Lightskin if self.bounces(level) > 1 => self.gather.check_bounces(),
            GiArg::BruteForce if self.bounces(level) > 1 => {
                wrong_usage("--gi brute-force has one bounce: use --bounces 0 or 1")
            }
            _ => {}
        }
    }

    /// The same flags for pictures that may take long: at the highest level they are supersampled. Brute force would take
    /// hours.
    pub(super) fn for_stills(mut self, level: Quality) -> Self {
        if self.aa.is_none() && level == Quality::Reference && self.gi != GiArg::BruteForce {
            self.aa = Some(AntialiasingArg::Supersampled);
        }
        self
    }

    /// Number of indirect bounces: as requested, else that of the quality level, or 1 if the method supports only one.
    pub(super) fn bounces(&self, level: Quality) -> u32 {
        let has_one = self.gi == GiArg::BruteForce || self.gather.by_draws() || self.gather.by_clusters();
        self.bounces.unwrap_or(if has_one { 1 } else { level.bounces() })
    }

    /// Antialiasing: as requested, or that of the quality level.
    pub(super) fn antialiasing(&self, level: Quality) -> Antialiasing {
        self.aa.map_or(level.antialiasing(), Antialiasing::from)
    }

    /// Whether the gather's fastest variant matters, so that it must be measured.
    pub(super) fn needs_ways(&self) -> bool {
        self.gi == GiArg::Lightskin && !self.gather.by_draws() && !self.gather.by_clusters()
    }

    /// The settings of the quality level, overridden by the flags.
    pub(super) fn settings(&self, level: Quality, caches: usize, ways: Ways) -> Settings {
        let mut settings = Settings::at(level, caches);
        settings.rsm = self.rsm.unwrap_or(settings.rsm);
        settings.light_shadows = self.shadow_map.unwrap_or(settings.light_shadows);
        settings.antialiasing = self.antialiasing(level);
        settings.layers = self.layers.unwrap_or(settings.layers);
        let bounces = self.bounces(level);
        settings.indirect = match self.gi {
            GiArg::PathTrace | GiArg::Off => Indirect::Off,
            _ if bounces == 0 && (self.gather.by_draws() || self.gather.by_clusters()) => Indirect::Off,
            GiArg::BruteForce if bounces == 0 => Indirect::Off,
            GiArg::BruteForce => Indirect::BruteForce,
            GiArg::Lightskin => Indirect::Caches(Caches {
                gather: self.gather.gather(ways, self.shadows(level, caches), self.near(level), bounces),
                cull: !self.gather.no_cull,
                interpolation: match self.interpolation {
                    InterpolationArg::Facing => Interpolation::Facing,
                    InterpolationArg::Printed => Interpolation::Printed,
                },
                proxy_weight: match self.proxy_weight {
                    ProxyWeightArg::Irradiance => ProxyWeight::Irradiance,
                    ProxyWeightArg::FormFactor => ProxyWeight::FormFactor,
                },
            }),
        };
        settings
    }

    /// Short rays: as requested, or those of the quality level if the other flags allow them.
    fn near(&self, level: Quality) -> Near {
        let near = match self.near {
            _ if self.gi != GiArg::Lightskin || self.gather.by_clusters() || self.gather.by_draws() => Near::Off,
            Some(NearArg::Off) => Near::Off,
            Some(_) if level.near() == Near::Off => Quality::High.near(),
            _ => level.near(),
        };
        let Some([per_pixel, every]) = near.rays() else { return Near::Off };
        // Points of a pixel have different rays.
        let is_mean = self.antialiasing(level) == Antialiasing::Supersampled;
        let usual = if is_mean { per_pixel.min(RAYS_OF_A_SAMPLE) } else { per_pixel };
        let (per_pixel, every) = (self.near_rays.unwrap_or(usual), self.near_every.unwrap_or(every));
        match self.near.unwrap_or(NearArg::of(near)) {
            NearArg::Off => Near::Off,
            NearArg::Rays => Near::Rays { per_pixel, every },
            NearArg::Endless => Near::Endless { per_pixel, every },
        }
    }

    /// Shadows of indirect light: as requested, or the best kind that the level, the other flags and the number of
    /// caches allow.
    pub(super) fn shadows(&self, level: Quality, caches: usize) -> Shadows {
        match self.shadows {
            _ if self.gi != GiArg::Lightskin => Shadows::Off,
            Some(asked) => asked.kind(),
            None if self.gather.by_clusters() => Shadows::Off,
            // The gather by draws cannot read depth images.
            None if self.gather.by_draws() => level.shadows(caches, Near::Off).min(Shadows::Proxy),
            None => level.shadows(caches, self.near(level)),
        }
    }

    /// The settings that affect cost, named like the flags.
    pub(super) fn facts(&self, level: Quality, settings: &Settings, size: [u32; 2]) -> Vec<(&'static str, Value)> {
        // No `..`, so that a new setting must be added to this list.
        let Settings { indirect, rsm, light_shadows, antialiasing, layers, reuse } = *settings;
        let caches = if let Indirect::Caches(caches) = indirect { Some(caches) } else { None };
        let gather = caches.map(|caches| caches.gather);
        let ways = if let Some(Gather::Compute { ways, .. }) = gather { Some(ways) } else { None };
        vec![
            ("gi", word(self.gi).into()),
            ("quality", word(super::QualityArg::of(level)).into()),
            ("bounces", json!(self.bounces(level))),
            ("rsm", json!(rsm)),
            ("shadow_map", light_shadows_word(light_shadows).into()),
            ("aa", word(AntialiasingArg::of(antialiasing)).into()),
            ("layers", json!(layers)),
            ("gather", json!(gather.map(|gather| gather.name()))),
            ("gather_vals", json!(ways.map(|ways| ways.source.name()))),
            ("gather_caches_per_thread", json!(ways.map(|ways| ways.caches_per_thread))),
            ("gather_split", json!(ways.map(|ways| ways.split))),
            ("cluster", json!(self.gather.cluster.cluster)),
            ("cluster_error", json!(self.gather.cluster.cluster_error)),
            ("cull", json!(caches.is_some_and(|caches| caches.cull))),
            ("near", word(NearArg::of(gather.map_or(Near::Off, |gather| gather.near()))).into()),
            ("near_rays", json!(gather.map(|gather| gather.near().per_pixel()))),
            ("near_every", json!(gather.map(|gather| gather.near().every(size)))),
            ("shadows", json!(ShadowsArg::of(gather.map_or(Shadows::Off, |gather| gather.shadows())))),
            ("skip", json!(reuse)),
            ("interpolation", word(self.interpolation).into()),
            ("proxy_weight", word(self.proxy_weight).into()),
        ]
    }
}
