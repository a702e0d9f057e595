//! Subcommands and their shared arguments. Exit codes: 0 done, 1 failed, 2 wrong usage.

#[macro_use]
mod output;

mod assets;
mod bake;
#[cfg(feature = "lab")]
mod bench;
pub(crate) mod camera;
mod compare;
mod devices;
#[cfg(feature = "lab")]
mod eval;
mod info;
#[cfg(feature = "lab")]
mod lab;
mod motion;
mod path_trace;
mod picture;
mod render;
mod signals;
mod sky;
mod timings;
#[cfg(feature = "app")]
pub(crate) mod view;
mod words;

#[cfg(feature = "app")]
pub(crate) use output::recent;
pub(crate) use output::tell;

use anyhow::{Context, Result, bail};
use clap::error::ErrorKind;
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use lightskin::bake::{BakeSettings, CacheSet, Density};
use lightskin::frame::settings::Gather;
use lightskin::frame::{ClusterRule, DrawSource, Near, Quality, Shadows, tune};
use lightskin::gpu::{Gpu, Options, Validation};
use lightskin::scene::build::Fineness;
use lightskin::scene::defaults::Ground;
use lightskin::scene::sky::Sky;
use lightskin::scene::{Scene, build, defaults, gltf, tessellate};
use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Real-time global illumination by interpolated light caches.
#[derive(Parser)]
#[command(version, about, arg_required_else_help = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Say more on standard error; twice for everything.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Say nothing but errors on standard error.
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Most memory that decoding pictures and textures may take, and a scene's vertices, in bytes or like 512M or 2G; what
    /// takes more is refused.
    #[arg(long, global = true, value_name = "SIZE", default_value = "1G", value_parser = bytes)]
    max_memory: u64,
}

#[derive(Subcommand)]
enum Command {
    /// Look at a glTF scene, or the built-in showpiece, in a window, and change its light.
    ///
    /// Panels at the right change light, quality and camera; each control says what it does and costs when the pointer rests
    /// on it. F1 lists the keys: the left button turns the camera around its target, the wheel goes nearer, W A S D E Q fly. `lightskin
    /// SCENE` is short for `lightskin view SCENE`.
    #[cfg(feature = "app")]
    View(Box<view::View>),
    /// Render a glTF scene, or the built-in showpiece, to a PNG or OpenEXR file.
    Render(Box<render::Render>),
    /// Place the caches of a scene and keep them for later renders.
    Bake(bake::Bake),
    /// Errors of one image against another.
    ///
    /// Of the linear values: mean absolute error, the same relative to the reference (mare), root of the mean square
    /// (rmse), relative mean square (relmse; trimmed: without the worst 1 % of pixels), the relative error of luminance
    /// that half of the pixels stay below (median-relative), relative error of the mean (bias), psnr against the
    /// reference's largest value. Of what a display shows: ssim (11 x 11 Gaussian, sigma 1.5, on the sRGB-encoded
    /// luminance) and flip with its weighted quartiles.
    ///
    /// Two PNG files are shown as they are. Otherwise values are radiance: ssim brings the log-average luminance of the
    /// reference to middle grey and clips; flip is HDR-FLIP, for each pixel the largest flip over exposures from the
    /// one that shows the reference's largest luminance to the one that shows its median, 8 bits each.
    Compare(compare::Compare),
    /// Measure speed against error: a report with a curve for every knob.
    #[cfg(feature = "lab")]
    Eval(Box<eval::Eval>),
    /// Measure times over triangles, resolution, caches and VALs on generated scenes, beside the thesis's figures.
    #[cfg(feature = "lab")]
    Bench(bench::BenchArgs),
    /// Studies behind the defaults: where errors come from, what trembles, what is hard on numbers.
    #[cfg(feature = "lab")]
    Lab(Box<lab::Lab>),
    /// Show what a scene holds, what its frame will do, and the memory of each stage.
    Info(info::Info),
    /// List Vulkan devices and what each lacks.
    Devices,
    /// Write the built-in scenes as GLB files.
    Assets(assets::Assets),
}

/// Runs the chosen subcommand.
pub(crate) fn run(cli: &Cli) -> Result<()> {
    output::start_log(cli.verbose, cli.quiet);
    lightskin::image::set_max_memory(cli.max_memory);
    signals::watch()?;
    let done = match &cli.command {
        #[cfg(feature = "app")]
        Command::View(args) => view::run(args),
        Command::Render(args) => render::run(args),
        Command::Bake(args) => bake::run(args),
        #[cfg(feature = "lab")]
        Command::Bench(args) => bench::run(args),
        Command::Compare(args) => compare::run(args),
        #[cfg(feature = "lab")]
        Command::Eval(args) => eval::run(args),
        #[cfg(feature = "lab")]
        Command::Lab(args) => lab::run(args),
        Command::Info(args) => info::run(args),
        Command::Devices => devices::run(),
        Command::Assets(args) => assets::run(args),
    };
    // What the work has found comes first.
    done.and_then(|()| output::written())
}

/// The arguments of the run. A scene alone is to be looked at: `lightskin SCENE` is `lightskin view SCENE`.
pub(crate) fn arguments() -> Vec<OsString> {
    let mut all: Vec<OsString> = std::env::args_os().collect();
    let is_command = |word: &OsString| Cli::command().get_subcommands().any(|c| word.to_str() == Some(c.get_name()));
    let is_scene = |word: &OsString| {
        let path = Path::new(word);
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf") || e.eq_ignore_ascii_case("glb"))
            || path.is_dir()
    };
    if cfg!(feature = "app") && all.get(1).is_some_and(|first| !is_command(first) && is_scene(first)) {
        all.insert(1, "view".into());
    }
    all
}

/// Prints help, or ends the run with exit code 2 for what cannot be understood.
pub(crate) fn usage(error: &clap::Error) -> Result<()> {
    if error.use_stderr() {
        error.exit();
    }
    error.print().or_else(output::lost)
}

/// How caches are placed.
#[derive(Args, Clone)]
struct CacheArgs {
    /// What changes the picture, as one choice: caches, their references, sizes of maps, shadows of indirect light. Single
    /// flags go over it; `lightskin info` says what each level costs.
    #[arg(long, value_enum, default_value_t)]
    quality: QualityArg,
    /// About this many caches over the whole scene [default: 2000 at --quality high].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), conflicts_with = "spacing")]
    caches: Option<u32>,
    /// Largest distance [m] of a surface point to a cache, instead of a count.
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = positive)]
    spacing: Option<f64>,
    /// Largest angle [degrees] between a surface and its cache.
    #[arg(long, value_name = "DEG", default_value_t = 60.0, value_parser = angle)]
    angle: f64,
    /// Longest edge [m] of a triangle; longer ones are halved, since light is interpolated per vertex. 0 leaves all as
    /// they are; a quarter of the caches' expected spacing without this flag, and 0 at texel level and where a scene would
    /// have more than twice its triangles and 64 for each cache.
    #[arg(long, value_name = "M", value_parser = at_least_zero)]
    max_edge: Option<f64>,
    /// Caches that each vertex refers to [default: 8 at --quality high].
    #[arg(long, value_name = "N", value_parser = ["8", "16"])]
    refs: Option<String>,
    /// A ground: auto puts one under an object that has neither lights nor a floor, at its lowest point; off leaves it
    /// out; a height [m] on +Y puts one there, whatever the scene.
    #[arg(long, value_name = "auto|off|HEIGHT", default_value = "auto", allow_hyphen_values = true, value_parser = ground)]
    ground: Ground,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum QualityArg {
    /// A quick look: few caches, small maps, no shadows of indirect light.
    Low,
    /// Shadows of each cache's light as a whole.
    Medium,
    /// Shadows of every virtual light, where caches are not very many.
    #[default]
    High,
    /// Twice as dense in everything.
    Reference,
}

impl QualityArg {
    const ALL: [(Self, Quality); 4] = [
        (Self::Low, Quality::Low),
        (Self::Medium, Quality::Medium),
        (Self::High, Quality::High),
        (Self::Reference, Quality::Reference),
    ];

    fn of(quality: Quality) -> Self {
        Self::ALL.iter().find(|(_, level)| *level == quality).map_or(Self::High, |(arg, _)| *arg)
    }
}

impl CacheArgs {
    fn quality(&self) -> Quality {
        QualityArg::ALL.iter().find(|(arg, _)| *arg == self.quality).map_or(Quality::High, |(_, level)| *level)
    }

    /// Caches that are asked for.
    fn count(&self) -> usize {
        self.caches.map_or(self.quality().caches(), |count| count as usize)
    }

    /// What differs from the default, as one types it.
    #[cfg(feature = "app")]
    fn words(&self) -> Vec<String> {
        let Self { quality, caches, spacing, angle, max_edge, refs, ground } = self;
        let mut words = Vec::new();
        let mut flag = |name: &str, value: Option<String>| {
            words.extend(value.into_iter().flat_map(|value| [name.to_owned(), value]));
        };
        flag("--quality", (*quality != QualityArg::default()).then(|| word(*quality)));
        flag("--caches", caches.map(|n| n.to_string()));
        flag("--spacing", spacing.map(|n| n.to_string()));
        flag("--angle", (*angle != 60.0).then(|| angle.to_string()));
        flag("--max-edge", max_edge.map(|n| n.to_string()));
        flag("--refs", refs.clone());
        flag(
            "--ground",
            match ground {
                Ground::Auto => None,
                Ground::Off => Some("off".into()),
                Ground::At(height) => Some(height.to_string()),
            },
        );
        words
    }

    fn settings(&self) -> BakeSettings {
        BakeSettings {
            density: self.spacing.map_or(Density::Count(self.count()), Density::Spacing),
            angle: self.angle.to_radians() as f32,
            references: match self.refs.as_deref() {
                Some("16") => 16,
                Some(_) => 8,
                None => self.quality().references(),
            },
        }
    }
}

/// A value of a flag as one types it.
fn word(value: impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// Which device, how closely watched.
#[derive(Args, Clone)]
struct DeviceArgs {
    /// Device by index or part of its name (see `lightskin devices`).
    #[arg(long, value_name = "INDEX|NAME")]
    device: Option<String>,
    /// Run under the Khronos validation layer; any message makes the run fail.
    #[arg(long, value_enum, default_value_t)]
    validation: ValidationArg,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum ValidationArg {
    #[default]
    Off,
    Core,
    Sync,
}

impl DeviceArgs {
    fn open(&self) -> Result<Gpu> {
        Ok(Gpu::new(&self.options())?)
    }

    fn options(&self) -> Options {
        let validation = match self.validation {
            ValidationArg::Off => Validation::Off,
            ValidationArg::Core => Validation::Core,
            ValidationArg::Sync => Validation::Sync,
        };
        Options { device: self.device.clone(), validation }
    }
}

/// How caches are lit.
#[derive(Args)]
struct GatherArgs {
    /// What lights caches. How compute is spread over the device is measured within seconds when first needed, then kept.
    #[arg(long, value_enum, default_value_t)]
    gather: GatherArg,
    /// Light every cache, not only those that visible surfaces need. The picture stays the same.
    #[arg(long)]
    no_cull: bool,
    #[command(flatten)]
    cluster: ClusterArgs,
}

/// Whether clusters stand for virtual lights.
#[derive(Args)]
struct ClusterArgs {
    /// Let clusters of virtual lights light caches that are farther away than C of their radii. A larger C computes more
    /// light, errs less and trembles less: while lights moved, 4 added up to 1.3 % and 3.4 % to the light of a cache in two
    /// rooms and 82 % on a curved scan, 8 added 0.3 %, 2.9 % and 14 % (docs/clustering.md).
    #[arg(long, value_name = "C", allow_hyphen_values = true, value_parser = positive)]
    cluster: Option<f64>,
    /// The same where they err by no more than the share P of what a cache receives, like 0.01.
    #[arg(long, value_name = "P", allow_hyphen_values = true, value_parser = at_least_zero, conflicts_with = "cluster")]
    cluster_error: Option<f64>,
}

impl ClusterArgs {
    fn rule(&self) -> Option<ClusterRule> {
        let distance = self.cluster.map(|c| ClusterRule::Distance(c as f32));
        distance.or(self.cluster_error.map(|share| ClusterRule::Error(share as f32)))
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum GatherArg {
    /// Compute shader over the list of caches that matter.
    #[default]
    #[value(alias = "auto")]
    Compute,
    /// Additive draws into float targets, culled by the depth test.
    Fragment,
}

impl GatherArgs {
    fn by_draws(&self) -> bool {
        matches!(self.gather, GatherArg::Fragment)
    }

    fn by_clusters(&self) -> bool {
        self.cluster.rule().is_some()
    }

    /// Ends the run where flags do not go together.
    fn check(&self, shadows: Shadows) {
        if shadows == Shadows::PerLight && self.by_draws() {
            wrong_usage("--shadows per-light needs --gather compute: draws see no depth images");
        }
        if shadows == Shadows::PerLight && self.by_clusters() {
            wrong_usage("--shadows per-light tests every virtual light: leave --cluster and --cluster-error out");
        }
        if matches!(self.gather, GatherArg::Fragment) && self.cluster.rule().is_some() {
            wrong_usage("--cluster and --cluster-error need --gather compute: draws take every virtual light");
        }
    }

    /// Ends the run where flags do not go with more than one bounce.
    fn check_bounces(&self) {
        if matches!(self.gather, GatherArg::Fragment) {
            wrong_usage("--bounces above 1 needs --gather compute: draws take the lights' own virtual lights alone");
        }
        if self.cluster.rule().is_some() {
            wrong_usage("--bounces above 1 does not go with --cluster or --cluster-error: lit caches form no pyramid");
        }
    }

    /// What lights the caches; flags have been checked.
    fn gather(&self, gpu: &Gpu, shadows: Shadows, near: Near, bounces: u32) -> Result<Gather> {
        let dim = shadows == Shadows::Proxy;
        Ok(match (self.cluster.rule(), self.gather) {
            (Some(rule), _) => Gather::Clusters { rule, dim },
            (None, GatherArg::Fragment) => Gather::Draws { source: DrawSource::Texels, tile: 4096, dim },
            (None, GatherArg::Compute) => Gather::Compute { ways: tune::fastest(gpu)?.ways, bounces, shadows, near },
        })
    }
}

/// Ends the run with exit code 2, for flags that do not go together.
fn wrong_usage(what: &str) -> ! {
    Cli::command().error(ErrorKind::ArgumentConflict, what).exit()
}

fn ground(text: &str) -> std::result::Result<Ground, String> {
    match (text, text.parse::<f64>()) {
        ("auto", _) => Ok(Ground::Auto),
        ("off", _) => Ok(Ground::Off),
        (_, Ok(height)) if height.is_finite() => Ok(Ground::At(height)),
        _ => Err("needs auto, off or a height in metres".into()),
    }
}

/// A number of bytes, or of KiB, MiB, GiB or TiB.
fn bytes(text: &str) -> std::result::Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| !c.is_ascii_digit());
    let shift = match text[digits.len()..].to_ascii_uppercase().as_str() {
        "" => Some(0),
        "K" => Some(10),
        "M" => Some(20),
        "G" => Some(30),
        "T" => Some(40),
        _ => None,
    };
    let bytes = shift.and_then(|shift| digits.parse::<u64>().ok()?.checked_mul(1 << shift));
    bytes.filter(|bytes| *bytes > 0).ok_or_else(|| "needs a number of bytes, or one like 512M or 2G".into())
}

/// A positive finite number.
fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() && v > 0.0 => Ok(v),
        _ => Err("needs a number above zero".into()),
    }
}

fn at_least_zero(text: &str) -> std::result::Result<f64, String> {
    if text == "0" { Ok(0.0) } else { positive(text) }
}

fn angle(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (1.0..=90.0).contains(&v) => Ok(v),
        _ => Err("needs degrees from 1 to 90".into()),
    }
}

/// Loads a file, or builds the scene that stands for none.
fn read_scene(path: Option<&Path>, built_in: fn() -> Scene) -> Result<Scene> {
    Ok(match path {
        None => built_in(),
        Some(path) => gltf::load(&gltf_in(path)?)?,
    })
}

/// Adds the camera, the light and the ground that a scene may lack and says so.
fn complete(mut scene: Scene, ground: Ground) -> Scene {
    defaults::complete(&mut scene, ground);
    for note in &scene.notes {
        log::warn!("{}: {note}", scene.name);
    }
    scene
}

/// Loads what is to be shown, or the showpiece, under a sky, which so many lights stand for.
fn load_under(path: Option<&Path>, sky: Option<(Sky, usize)>, ground: Ground) -> Result<Scene> {
    let mut scene = read_scene(path, || build::showpiece(Fineness::default()))?;
    if let Some((sky, lights)) = sky {
        if path.is_none() {
            // Another sky and its sun take the place of the showpiece's own.
            scene.lights.clear();
        }
        sky.put_over(&mut scene, lights);
    }
    Ok(complete(scene, ground))
}

/// Loads a scene for what is measured by the light of punctual lights: surfaces emit nothing.
#[cfg(feature = "lab")]
fn load_punctual(path: Option<&Path>) -> Result<Scene> {
    let mut scene = read_scene(path, build::atrium)?;
    if scene.emits() {
        log::warn!("{}: its surfaces emit nothing here; what is measured is the light of punctual lights", scene.name);
        scene.materials.iter_mut().for_each(|material| material.emissive = glam::Vec3::ZERO);
    }
    Ok(complete(scene, Ground::Auto))
}

/// Loads a scene, and divides triangles that are large against the distance of caches, where that costs little.
fn load_scene(path: Option<&Path>, caches: &CacheArgs) -> Result<Scene> {
    let mut scene = load_under(path, None, caches.ground)?;
    divide_for(&mut scene, caches, false);
    Ok(scene)
}

/// The scene with triangles divided that are large against the distance of caches, for light at vertices.
#[cfg(feature = "lab")]
fn divided(mut scene: Scene, caches: &CacheArgs) -> Scene {
    divide_for(&mut scene, caches, true);
    scene
}

/// Divides triangles that are large against the distance of caches. Says whether light can be interpolated at vertices:
/// where that would take very many triangles none is divided, unless `anyway` or `--max-edge` asks for it.
fn divide_for(scene: &mut Scene, caches: &CacheArgs, anyway: bool) -> bool {
    let spacing = caches.spacing.unwrap_or_else(|| tessellate::expected_spacing(scene, caches.count()));
    if anyway || caches.max_edge.is_some() {
        tessellate::divide(scene, spacing, caches.max_edge);
        return true;
    }
    tessellate::divide_if_few(scene, spacing)
}

/// The file itself, or the first glTF file of a folder.
fn gltf_in(path: &Path) -> Result<PathBuf> {
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    let entries = std::fs::read_dir(path).with_context(|| path.display().to_string())?;
    let mut files: Vec<_> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    files.retain(|f| f.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf") || e.eq_ignore_ascii_case("glb")));
    files.sort();
    match files.into_iter().next() {
        Some(file) => Ok(file),
        None => bail!("{}: the folder holds no .gltf or .glb file", path.display()),
    }
}

/// A bar of a thousand steps on a terminal, none elsewhere.
fn progress_bar(template: &str) -> ProgressBar {
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(1000) } else { ProgressBar::hidden() };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

/// What a bake took.
struct Baked {
    caches: CacheSet,
    /// Caches over all instances.
    count: usize,
    time: Duration,
    /// Read from the kept file instead of made.
    kept: bool,
}

/// Bakes with a progress bar, or reads the kept bake.
fn bake_scene(scene: &Scene, settings: &BakeSettings, again: bool) -> Result<Baked> {
    let bar = progress_bar("{msg:>24} [{bar:40}] {percent:>3} %  {elapsed}");
    let progress = |fraction: f32, what: &str| {
        bar.set_message(what.to_owned());
        bar.set_position((fraction * 1000.0) as u64);
    };
    let start = Instant::now();
    let made = if again {
        lightskin::bake::bake(scene, settings, &progress).map(|set| (set, false))
    } else {
        lightskin::bake::bake_cached(scene, settings, &progress)
    };
    let (caches, kept) = made.with_context(|| scene.name.clone())?;
    bar.finish_and_clear();
    let count = caches.instance_model.iter().map(|m| caches.models[*m].caches.len()).sum();
    Ok(Baked { caches, count, time: start.elapsed(), kept })
}

/// Fails when the validation layer or the barrier check has said anything.
pub(crate) fn check_messages(gpu: &Gpu, problems: &[String]) -> Result<()> {
    let messages = gpu.messages();
    for problem in problems {
        log::error!("barriers: {problem}");
    }
    if !messages.is_empty() || !problems.is_empty() {
        bail!(
            "{} validation messages and {} barrier problems; this is a bug of lightskin",
            messages.len(),
            problems.len()
        );
    }
    Ok(())
}

/// A number with spaces between thousands.
pub(crate) fn thousands(n: usize) -> String {
    let digits = n.to_string();
    let groups: Vec<_> = digits.as_bytes().rchunks(3).rev().map(|g| String::from_utf8_lossy(g).into_owned()).collect();
    groups.join(" ")
}
