//! `lightskin render --gi path-trace`: the reference picture, with progress, a noise estimate and stored samples.

use super::picture::{LayerArg, Layers, TonemapArg};
use super::signals;
use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use lightskin::frame::Behind;
use lightskin::kept;
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings, Sources, camera_ray};
use lightskin::reference::world::Surface;
use lightskin::scene::{Camera, Scene};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Time between two saves of the samples to their file. A crash loses at most the samples of this time.
const SAVE_EVERY: Duration = Duration::from_secs(20);

#[derive(Args)]
#[command(next_help_heading = "Reference pictures (--gi path-trace)")]
pub(super) struct PathTraceArgs {
    /// Samples per pixel, rounded up to a multiple of 16.
    ///
    /// Samples are stored: an interrupted run continues, and a larger N refines the picture.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    spp: u32,
    /// Stop early once the mean relative standard error of indirect light is below this, like 0.01 [default: never].
    #[arg(long, value_name = "SHARE", value_parser = super::positive)]
    noise: Option<f64>,
    /// Trace one bounce of indirect light without occlusion. --gi brute-force converges to this picture.
    #[arg(long, hide_short_help = true, conflicts_with_all = ["bounces", "matching", "sources"])]
    no_visibility: bool,
    /// Restrict the light paths to those of another method [default: all light paths].
    #[arg(long = "match", hide_short_help = true, value_name = "WHAT", value_enum)]
    matching: Option<Match>,
    /// Sources of light [default: all; punctual with --no-visibility].
    #[arg(long, hide_short_help = true, value_enum)]
    sources: Option<SourcesArg>,
    /// Seed of the random numbers.
    #[arg(long, hide_short_help = true, value_name = "N", default_value_t = 0)]
    seed: u32,
}

/// A method whose light paths are traced.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Match {
    /// The light paths of --gi lightskin --near off: its number of bounces, and only the last bounce glossy.
    Engine,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum SourcesArg {
    /// Only lamps and suns. Emissive surfaces and the sky are visible but give no light.
    Punctual,
    /// Only emissive surfaces.
    Surfaces,
    /// Only the sky.
    Sky,
    /// All sources.
    All,
}

/// The file of the picture and how it is shown.
pub(super) struct Picture<'a> {
    pub(super) out: &'a Path,
    pub(super) size: [u32; 2],
    pub(super) bounces: Option<u32>,
    /// Number of bounces of `--gi lightskin` with the same flags.
    pub(super) of_engine: u32,
    /// Whether samples are spread over each pixel, instead of going through its centre.
    pub(super) spread: bool,
    pub(super) layer: Option<LayerArg>,
    pub(super) tonemap: TonemapArg,
    pub(super) ev: Option<f32>,
    pub(super) behind: Behind,
}

impl PathTraceArgs {
    fn settings(&self, picture: &Picture<'_>) -> PathTraceSettings {
        let (size, bounces) = (picture.size, picture.bounces);
        let mut settings = match self.matching {
            _ if self.no_visibility => PathTraceSettings::unshadowed(size),
            Some(Match::Engine) => PathTraceSettings::engine(size, picture.of_engine),
            None => PathTraceSettings { bounces, ..PathTraceSettings::of(size) },
        };
        settings.sources = match self.sources {
            None => settings.sources,
            Some(SourcesArg::Punctual) => Sources::Punctual,
            Some(SourcesArg::Surfaces) => Sources::Surfaces,
            Some(SourcesArg::Sky) => Sources::Sky,
            Some(SourcesArg::All) => Sources::All,
        };
        PathTraceSettings { seed: self.seed, spread: picture.spread, ..settings }
    }
}

pub(super) fn run(args: &PathTraceArgs, scene: &Scene, camera: &Camera, picture: &Picture<'_>) -> Result<()> {
    let settings = args.settings(picture);
    let mut trace = PathTrace::new(scene, camera, &settings);
    let file: Option<PathBuf> = kept::folder().map(|folder| trace.kept_in(&folder));
    let resumed = file.as_ref().is_some_and(|file| trace.resume(file));
    let before = trace.samples();
    if resumed {
        log::info!("{before} samples per pixel were stored");
    }

    let bar =
        if std::io::stderr().is_terminal() { ProgressBar::new(u64::from(args.spp)) } else { ProgressBar::hidden() };
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos}/{len} samples  {msg}  {elapsed} of {duration}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_position(u64::from(before));
    bar.reset_eta();

    let start = Instant::now();
    let mut saved = (Instant::now(), before);
    let save = |trace: &PathTrace<'_>| {
        if let Some(Err(error)) = file.as_ref().map(|file| trace.save(file)) {
            log::warn!("the samples cannot be stored: {error}; set XDG_CACHE_HOME to a writable folder");
        }
    };
    let is_done = |trace: &PathTrace<'_>| {
        trace.is_exact() || trace.samples() >= args.spp || args.noise.is_some_and(|noise| trace.noise() <= noise)
    };
    signals::in_order(|stop| {
        while !is_done(&trace) && trace.pass_unless(stop) {
            bar.set_position(u64::from(trace.samples()));
            bar.set_message(format!("noise {:.2} %", 100.0 * trace.noise()));
            if saved.0.elapsed() > SAVE_EVERY {
                save(&trace);
                saved = (Instant::now(), trace.samples());
            }
        }
        bar.finish_and_clear();
        if trace.samples() > saved.1 {
            save(&trace);
        }
    });
    if !is_done(&trace) {
        bail!(
            "stopped at {} of {} samples per pixel; the same command continues from there",
            trace.samples(),
            args.spp
        );
    }
    let time = start.elapsed();

    let layers = layers(&trace, camera, picture.size);
    let ev = picture.ev.unwrap_or_else(|| layers.automatic_ev() as f32);
    let noise = 100.0 * trace.noise();
    let metadata = format!(
        "scene {}; camera {}; path-traced, {} samples per pixel, noise {noise:.3} %; {settings:?}; EV {ev}",
        scene.name,
        camera.name,
        trace.samples()
    );
    layers.write(picture.out, picture.layer, picture.tonemap, ev, picture.behind, &metadata)?;
    say!(
        "scene     {} ({} triangles, {} lights)",
        scene.name,
        super::thousands(scene.triangle_count()),
        scene.lights.len()
    );
    say!(
        "samples   {} per pixel ({before} were stored, {} made in {:.1} s)",
        trace.samples(),
        trace.samples() - before,
        time.as_secs_f64()
    );
    if noise.is_finite() {
        say!("noise     {noise:.3} % (mean relative standard error of indirect light)");
    }
    say!("exposure  EV {ev:.2}");
    say!("picture   {}", picture.out.display());
    match layers.broken() {
        0 => Ok(()),
        broken => bail!("{broken} values of the picture are negative or not finite; this is a bug of lightskin"),
    }
}

fn layers(trace: &PathTrace<'_>, camera: &Camera, size: [u32; 2]) -> Layers {
    let rgba = |texels: Vec<[f32; 3]>| texels.into_iter().map(|[r, g, b]| [r, g, b, 0.0]).collect::<Vec<_>>();
    let surfaces = trace.surfaces();
    let (eye, forward) = (camera.world_from_camera.translation, -camera.world_from_camera.matrix3.z_axis.normalize());
    let seen = |value: &dyn Fn(&Surface) -> [f32; 4], nothing: f32| -> Vec<[f32; 4]> {
        surfaces.iter().map(|s| s.as_ref().map_or([nothing; 4], value)).collect()
    };
    let albedo = |(index, surface): (usize, &Option<Surface>)| {
        let (_, direction) = camera_ray(camera, size, index);
        let of = |s: &Surface| s.reflection.diffuse(-s.normal.dot(direction));
        surface.as_ref().map_or([0.0; 4], |s| of(s).extend(0.0).to_array())
    };
    let (behind, covered) = trace.backdrop();
    Layers {
        size,
        behind: rgba(behind),
        covered,
        direct: rgba(trace.direct()),
        diffuse: rgba(trace.diffuse()),
        glossy: rgba(trace.glossy()),
        albedo: (0..).zip(&surfaces).map(albedo).collect(),
        normal: seen(&|s| s.normal.as_vec3().extend(0.0).to_array(), 0.0),
        depth: seen(&|s| [(s.position - eye).dot(forward) as f32; 4], f32::INFINITY),
    }
}
