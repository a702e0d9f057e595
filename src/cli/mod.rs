//! Subcommands and the arguments they share. Exit codes: 0 success, 1 failure, 2 wrong usage.

#[macro_use]
mod output;

mod assets;
mod bake;
#[cfg(feature = "lab")]
mod bench;
pub(crate) mod camera;
mod compare;
#[cfg(feature = "app")]
pub(crate) mod config;
mod devices;
mod drawing;
#[cfg(feature = "lab")]
mod eval;
mod gather;
mod info;
#[cfg(feature = "lab")]
mod lab;
#[cfg_attr(not(feature = "app"), allow(dead_code, reason = "parts serve the window alone"))]
pub(crate) mod lights;
mod manual;
mod motion;
mod path_trace;
mod picture;
mod render;
#[cfg_attr(not(feature = "app"), allow(dead_code, reason = "parts serve the window alone"))]
pub(crate) mod session;
mod signals;
pub(crate) mod sky;
mod supersample;
mod timings;
#[cfg(feature = "app")]
pub(crate) mod view;
mod words;

#[cfg(feature = "app")]
pub(crate) use output::recent;
pub(crate) use output::tell_line;

use anyhow::{Context, Result, anyhow, bail};
use clap::error::ErrorKind;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use lightskin::bake::{BakeSettings, CacheSet, Density};
use lightskin::files;
use lightskin::frame::Quality;
use lightskin::gpu::{Gpu, Options, Validation};
use lightskin::scene::build::Fineness;
use lightskin::scene::defaults::Ground;
use lightskin::scene::sky::Sky;
use lightskin::scene::{Scene, build, defaults, gltf, tessellate};
use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Real-time global illumination for glTF scenes, without ray-tracing hardware.
#[derive(Parser)]
#[command(
    version,
    about = "Real-time global illumination for glTF scenes, without ray-tracing hardware",
    arg_required_else_help = true
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print information messages; -vv also prints debug messages.
    #[arg(short, long, global = true, help_heading = GLOBAL, display_order = 1000, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Print only errors.
    #[arg(short, long, global = true, help_heading = GLOBAL, display_order = 1000)]
    quiet: bool,
    /// Memory limit for decoding textures and for a scene's vertices, each.
    ///
    /// A number of bytes, or a number with a suffix, like 512M or 2G. A file that needs more is refused.
    #[arg(long, global = true, help_heading = GLOBAL, hide_short_help = true, display_order = 1000, value_name = "SIZE", default_value = "1G", value_parser = bytes)]
    max_memory: u64,
}

#[derive(Subcommand)]
enum Command {
    /// Open a glTF scene in a window and edit its light.
    ///
    /// The panels on the right change light, quality and camera. Hover over a control to read what it does and what it
    /// costs. Drag with the left button to orbit, use the wheel to zoom and W A S D E Q to fly. F1 lists all keys.
    /// `lightskin SCENE` is short for `lightskin view SCENE`.
    #[cfg(feature = "app")]
    View(Box<view::View>),
    /// Render a glTF scene to a PNG or OpenEXR file.
    Render(Box<render::Render>),
    /// Place the light caches of a scene and store them for later renders.
    Bake(bake::Bake),
    /// Print the errors of an image against a reference image.
    ///
    /// Errors of the linear values: mean absolute error (mae), mean absolute relative error (mare), root mean square
    /// error (rmse), relative mean square error (relmse), relmse without the worst 1 % of pixels (trimmed), the median
    /// relative error of luminance (median-relative), the relative error of the mean (bias), and psnr against the
    /// reference's largest value.
    ///
    /// Perceptual errors: ssim (11 x 11 Gaussian, sigma 1.5, of the sRGB luminance), and flip with its weighted
    /// quartiles.
    ///
    /// Two PNG files are compared as they are displayed. If either file is EXR, the values are radiance. For ssim, the
    /// exposure then maps the log-average luminance of the reference to middle grey, and brighter values clip. flip is
    /// then HDR-FLIP: the largest flip of each pixel over a range of exposures, from one that shows the reference's
    /// largest luminance to one that shows its median.
    Compare(compare::Compare),
    /// Measure speed against error and write a report with a curve for every setting.
    #[cfg(feature = "lab")]
    Eval(Box<eval::Eval>),
    /// Measure quality levels and their choices, and how times grow with triangles, pixels, caches and virtual lights.
    #[cfg(feature = "lab")]
    Bench(bench::BenchArgs),
    /// Run the studies behind the defaults: sources of error, flicker, numerically hard cases.
    #[cfg(feature = "lab")]
    Lab(Box<lab::Lab>),
    /// Print what a scene contains, which stages its frame runs, and how much memory they take.
    Info(info::Info),
    /// List the Vulkan devices and the required features that each one lacks.
    Devices,
    /// Write the built-in scenes as GLB files.
    Assets(assets::Assets),
    /// Show the settings of the window and where each one comes from.
    ///
    /// The command line overrides environment variables like LIGHTSKIN_QUALITY. These override the file
    /// lightskin/settings.toml in the config folder, and the file overrides the defaults.
    #[cfg(feature = "app")]
    #[command(subcommand)]
    Config(config::Config),
    /// Print a completion script for a shell.
    ///
    /// For example `lightskin completions bash > ~/.local/share/bash-completion/completions/lightskin`.
    Completions(manual::Completions),
    /// Print a manual page.
    ///
    /// For example `lightskin man render | man -l -`.
    Man(manual::Manual),
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
        #[cfg(feature = "app")]
        Command::Config(args) => config::run(args),
        Command::Completions(args) => manual::completions(args),
        Command::Man(args) => manual::manual(args),
    };
    // The subcommand's own error takes precedence over an error of standard output.
    done.and_then(|()| output::written())
}

/// The arguments of the process. `lightskin SCENE` becomes `lightskin view SCENE`, also with flags before the scene.
pub(crate) fn arguments() -> Vec<OsString> {
    let mut all: Vec<OsString> = std::env::args_os().collect();
    let is_command = |word: &OsString| Cli::command().get_subcommands().any(|c| word.to_str() == Some(c.get_name()));
    let is_scene = |word: &OsString| {
        let path = Path::new(word);
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf") || e.eq_ignore_ascii_case("glb"))
            || session::is_session(path)
            || path.is_dir()
    };
    let is_flag = |word: &OsString| word.as_encoded_bytes().starts_with(b"-");
    let is_view = all.get(1).is_some_and(|first| match first {
        flag if is_flag(flag) => all.iter().any(is_scene) && !all.iter().any(is_command),
        first => is_scene(first) && !is_command(first),
    });
    if cfg!(feature = "app") && is_view {
        all.insert(1, "view".into());
    }
    all
}

/// The grammar of the command line. A negative number after a flag is read as that flag's value, so that an error
/// message says which values the flag accepts.
fn grammar() -> clap::Command {
    fn with_negative_values(command: clap::Command) -> clap::Command {
        let command = command.mut_args(|arg| {
            let is_flag_of_value = !arg.is_positional() && arg.get_action().takes_values();
            if is_flag_of_value { arg.allow_negative_numbers(true) } else { arg }
        });
        command.mut_subcommands(with_negative_values)
    }
    with_negative_values(Cli::command())
}

/// The grammar for these arguments. Only `view` also reads settings from a file and the environment.
pub(crate) fn grammar_for(arguments: &[OsString]) -> Result<clap::Command> {
    match arguments.iter().any(|word| word == "view") {
        #[cfg(feature = "app")]
        true => config::grammar(),
        _ => Ok(grammar()),
    }
}

/// Reads the arguments.
pub(crate) fn parse(mut grammar: clap::Command, arguments: Vec<OsString>) -> std::result::Result<Cli, clap::Error> {
    let matches = grammar.try_get_matches_from_mut(arguments)?;
    Cli::from_arg_matches(&matches).map_err(|error| error.format(&mut grammar))
}

/// Prints help or the version, or ends the process with exit code 2 if the arguments are wrong.
pub(crate) fn usage(error: &clap::Error) -> Result<()> {
    if error.use_stderr() {
        error.exit();
    }
    error.print().or_else(output::lost)
}

/// Help heading of the flags that do not belong to one subcommand.
const GLOBAL: &str = "Global options";

/// Flags for the placement of caches.
#[derive(Args, Clone)]
#[command(next_help_heading = "Quality")]
struct CacheArgs {
    /// Quality level. It sets every quality setting; other flags override single settings.
    ///
    /// `lightskin info --measure` prints the memory and frame time of each level on your device.
    #[arg(long, value_enum, default_value_t)]
    quality: QualityArg,
    /// Approximate number of light caches, the surface points where indirect light is computed [default: 2000 at
    /// --quality high].
    ///
    /// More caches give finer indirect light. The time grows in proportion, or faster with shadows of indirect light.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), conflicts_with = "spacing")]
    caches: Option<u32>,
    /// Largest distance from a surface point to its nearest cache [m]. Replaces --caches.
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = positive)]
    spacing: Option<f64>,
    /// Largest angle between a surface normal and the normal of its cache [degrees].
    ///
    /// If --caches is below 8 for each instance in the scene, small models are allowed 75 degrees: larger surfaces need
    /// the caches more.
    #[arg(long, hide_short_help = true, value_name = "DEG", default_value_t = 60.0, value_parser = angle)]
    angle: f64,
    /// Subdivide triangles until no edge is longer than this [m]; 0 subdivides none [default: a quarter of the cache
    /// spacing].
    ///
    /// Indirect light is interpolated at vertices, so triangles must be small compared to the cache spacing. By
    /// default, a scene that would get too many triangles is not subdivided. Its light is then interpolated at pixels.
    #[arg(long, hide_short_help = true, value_name = "M", value_parser = at_least_zero)]
    max_edge: Option<f64>,
    /// Number of caches interpolated at each vertex [default: 8 at --quality high].
    #[arg(long, hide_short_help = true, value_name = "N", value_parser = ["8", "16"])]
    refs: Option<String>,
    /// Ground plane: auto, off, or its height along +Y [m].
    ///
    /// auto adds a ground below an object that has neither lights nor a floor.
    #[arg(long, help_heading = sky::HEADING, value_name = "auto|off|HEIGHT", default_value = "auto", allow_hyphen_values = true, value_parser = ground)]
    ground: Ground,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum QualityArg {
    /// Fast preview: few caches, no antialiasing, no shadows of indirect light.
    Low,
    /// Antialiasing and coarse shadows of indirect light.
    Medium,
    /// Ray-traced shadows, short rays for nearby light, accurate shadows of indirect light.
    #[default]
    High,
    /// Like high, with twice as many caches and virtual lights, and the mean of 64 pictures.
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

    /// Requested number of caches.
    fn count(&self) -> usize {
        self.caches.map_or(self.quality().caches(), |count| count as usize)
    }

    /// The flags that differ from their defaults, as command-line words.
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

/// The command-line word for a value of a flag.
fn word(value: impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// Flags for the device and its validation.
#[derive(Args, Clone)]
#[command(next_help_heading = GLOBAL)]
struct DeviceArgs {
    /// Vulkan device, by index or part of its name; see `lightskin devices` [default: the most capable].
    #[arg(long, value_name = "INDEX|NAME")]
    device: Option<String>,
    /// Run with the Khronos validation layer and fail if it reports anything.
    #[arg(long, hide_short_help = true, value_enum, default_value_t)]
    validation: ValidationArg,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum ValidationArg {
    /// No validation layer.
    #[default]
    Off,
    /// Core validation.
    Core,
    /// Core and synchronization validation, and lightskin's own barrier check.
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

/// Ends the process with exit code 2, for flags that cannot be combined.
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

/// Parses a number of bytes, with an optional suffix: K, M, G or T for KiB, MiB, GiB or TiB.
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

/// Parses a positive finite number.
fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() && v > 0.0 => Ok(v),
        _ => Err("needs a number above zero".into()),
    }
}

fn finite(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err("needs a number".into()),
    }
}

fn at_least_zero(text: &str) -> std::result::Result<f64, String> {
    if text == "0" { Ok(0.0) } else { positive(text) }
}

fn angle(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (1.0..=90.0).contains(&v) => Ok(v),
        _ => Err("needs an angle from 1 to 90 degrees".into()),
    }
}

/// Loads a file, or builds `built_in` without one.
fn read_scene(path: Option<&Path>, built_in: fn() -> Scene) -> Result<Scene> {
    Ok(match path {
        None => built_in(),
        Some(path) => gltf::load(&gltf_in(path)?)?,
    })
}

/// Adds a camera, a light and a ground where a scene lacks them, and prints what was added.
fn complete(mut scene: Scene, ground: Ground) -> Scene {
    defaults::complete(&mut scene, ground);
    for note in &scene.notes {
        log::warn!("{}: {note}", scene.name);
    }
    scene
}

/// Loads a scene, or builds the showpiece without a path. `sky` is a sky to put over it and the number of directional
/// lights that approximate that sky.
fn load_under(path: Option<&Path>, sky: Option<(Sky, usize)>, ground: Ground) -> Result<Scene> {
    let mut scene = read_scene(path, || build::showpiece(Fineness::default()))?;
    if let Some((sky, lights)) = sky {
        if path.is_none() {
            // The given sky and its sun replace those of the showpiece.
            scene.lights.clear();
        }
        sky.put_over(&mut scene, lights);
    }
    Ok(complete(scene, ground))
}

/// Loads a scene for measurements that use punctual lights only: emission of surfaces is removed.
#[cfg(feature = "lab")]
fn load_punctual(path: Option<&Path>) -> Result<Scene> {
    let mut scene = read_scene(path, build::atrium)?;
    if scene.emits() {
        log::warn!("{}: surface emission is ignored here; only punctual lights are measured", scene.name);
        scene.materials.iter_mut().for_each(|material| material.emissive = glam::Vec3::ZERO);
    }
    Ok(complete(scene, Ground::Auto))
}

/// Loads a scene, and subdivides triangles that are large compared to the cache spacing, unless that adds too many
/// triangles.
fn load_scene(path: Option<&Path>, caches: &CacheArgs) -> Result<Scene> {
    let mut scene = load_under(path, None, caches.ground)?;
    divide_for(&mut scene, caches, false);
    Ok(scene)
}

/// Subdivides triangles that are large compared to the cache spacing, for interpolation at vertices.
#[cfg(feature = "lab")]
fn divided(mut scene: Scene, caches: &CacheArgs) -> Scene {
    divide_for(&mut scene, caches, true);
    scene
}

/// Subdivides triangles that are large compared to the cache spacing. Returns whether light can be interpolated at
/// vertices. If that would need very many triangles, none is subdivided, unless `anyway` or `--max-edge` demands it.
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
    let mut files = files::list(path).map_err(|reason| anyhow!("{}: {reason}", path.display()))?;
    files.retain(|f| f.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf") || e.eq_ignore_ascii_case("glb")));
    match files.into_iter().next() {
        Some(file) => Ok(file),
        None => bail!("{}: the folder contains no .gltf or .glb file", path.display()),
    }
}

/// A progress bar of 1000 steps. Hidden if standard error is not a terminal.
fn progress_bar(template: &str) -> ProgressBar {
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(1000) } else { ProgressBar::hidden() };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

/// A finished bake.
struct Baked {
    caches: CacheSet,
    /// Number of caches, summed over all instances.
    count: usize,
    time: Duration,
    /// Whether the caches were read from the stored bake.
    kept: bool,
}

/// Bakes with a progress bar, or reads the stored bake unless `again` is set.
fn bake_scene(scene: &Scene, file: Option<&Path>, settings: &BakeSettings, again: bool) -> Result<Baked> {
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
    let (caches, kept) = made.with_context(|| called(scene, file))?;
    bar.finish_and_clear();
    let count = caches.instance_model.iter().map(|m| caches.models[*m].caches.len()).sum();
    Ok(Baked { caches, count, time: start.elapsed(), kept })
}

/// The name of a scene in messages: its file, or its own name without a file.
fn called(scene: &Scene, file: Option<&Path>) -> String {
    file.map_or_else(|| scene.name.clone(), |file| file.display().to_string())
}

/// Fails if the validation layer or the barrier check has reported anything.
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

/// Formats a number with spaces between thousands.
pub(crate) fn thousands(n: usize) -> String {
    let digits = n.to_string();
    let groups: Vec<_> = digits.as_bytes().rchunks(3).rev().map(|g| String::from_utf8_lossy(g).into_owned()).collect();
    groups.join(" ")
}
