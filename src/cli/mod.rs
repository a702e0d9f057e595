//! Subcommands and their shared arguments. Exit codes: 0 done, 1 failed, 2 wrong usage.

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
#[cfg(feature = "lab")]
mod eval;
mod gather;
mod info;
#[cfg(feature = "lab")]
mod lab;
mod manual;
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
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use lightskin::bake::{BakeSettings, CacheSet, Density};
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
    /// Print more messages; twice for all of them.
    #[arg(short, long, global = true, help_heading = GLOBAL, display_order = 1000, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Print errors alone.
    #[arg(short, long, global = true, help_heading = GLOBAL, display_order = 1000)]
    quiet: bool,
    /// Limit of memory for decoding textures, and for a scene's vertices.
    ///
    /// In bytes, or like 512M or 2G. A file that needs more is refused.
    #[arg(long, global = true, help_heading = GLOBAL, hide_short_help = true, display_order = 1000, value_name = "SIZE", default_value = "1G", value_parser = bytes)]
    max_memory: u64,
}

#[derive(Subcommand)]
enum Command {
    /// Open a glTF scene in a window and change its light.
    ///
    /// The panels at the right change light, quality and camera. Rest the pointer on a control to read what it does and what it
    /// costs. Left drag orbits, the wheel zooms, W A S D E Q fly, F1 lists all keys. `lightskin SCENE` is short for
    /// `lightskin view SCENE`.
    #[cfg(feature = "app")]
    View(Box<view::View>),
    /// Render a glTF scene to a PNG or OpenEXR file.
    Render(Box<render::Render>),
    /// Place the light caches of a scene, and keep them for later renders.
    Bake(bake::Bake),
    /// Print the errors of one image against another.
    ///
    /// Errors of the linear values: mean absolute error (mae), the same relative to the reference (mare), root mean square
    /// (rmse), relative mean square (relmse), relmse without the worst 1 % of pixels (trimmed), the median of relative errors
    /// of luminance (median-relative), the relative error of the mean (bias), and psnr against the reference's largest value.
    ///
    /// Errors that an eye sees: ssim (11 x 11 Gaussian, sigma 1.5, of the sRGB luminance), and flip with its weighted quartiles.
    ///
    /// Two PNG files are compared as they are. Other values are radiance. For ssim the log-average luminance of the reference
    /// becomes middle grey, and brighter values clip. flip is then HDR-FLIP: each pixel has its largest flip over a range of
    /// exposures, from one that shows the reference's largest luminance to one that shows its median.
    Compare(compare::Compare),
    /// Measure speed against error, and write a report with a curve for every setting.
    #[cfg(feature = "lab")]
    Eval(Box<eval::Eval>),
    /// Measure how times grow with triangles, pixels, caches and virtual lights.
    #[cfg(feature = "lab")]
    Bench(bench::BenchArgs),
    /// Studies behind the defaults: sources of error, flicker, numerically hard cases.
    #[cfg(feature = "lab")]
    Lab(Box<lab::Lab>),
    /// Show what a scene contains, which stages its frame has, and the memory they take.
    Info(info::Info),
    /// List the Vulkan devices, and what each lacks.
    Devices,
    /// Write the built-in scenes as GLB files.
    Assets(assets::Assets),
    /// Settings of the window: the command line goes over variables like LIGHTSKIN_QUALITY, these over the file
    /// lightskin/settings.toml in the config folder, that over the defaults.
    #[cfg(feature = "app")]
    #[command(subcommand)]
    Config(config::Config),
    /// Print completions for a shell, like `lightskin completions bash > ~/.local/share/bash-completion/completions/lightskin`.
    Completions(manual::Completions),
    /// Print a manual page, like `lightskin man render | man -l -`.
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

/// The grammar of the command line. What looks like a number below zero is a flag's value, so that the flag says what it takes.
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

/// The grammar for these arguments: only the window has settings besides.
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

/// Prints help, or ends the run with exit code 2 for what cannot be understood.
pub(crate) fn usage(error: &clap::Error) -> Result<()> {
    if error.use_stderr() {
        error.exit();
    }
    error.print().or_else(output::lost)
}

/// Heading of the flags that every subcommand has.
const GLOBAL: &str = "Global options";

/// How caches are placed.
#[derive(Args, Clone)]
#[command(next_help_heading = "Quality")]
struct CacheArgs {
    /// Quality level. It sets all that changes the picture; the flags below override single settings.
    ///
    /// `lightskin info --measure` shows what each level costs on this device.
    #[arg(long, value_enum, default_value_t)]
    quality: QualityArg,
    /// Number of light caches, about [default: 2000 at --quality high].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), conflicts_with = "spacing")]
    caches: Option<u32>,
    /// Largest distance between a surface and its nearest cache [m]; used instead of --caches.
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = positive)]
    spacing: Option<f64>,
    /// Largest angle between the normals of a surface and of its cache [degrees].
    #[arg(long, hide_short_help = true, value_name = "DEG", default_value_t = 60.0, value_parser = angle)]
    angle: f64,
    /// Divide triangles until no edge is longer than this [m]; 0 divides none.
    ///
    /// Indirect light is interpolated at vertices, so triangles must be small against the spacing of the caches. The default
    /// is a quarter of that spacing. A scene that would then have too many triangles stays undivided, and is lit at pixels
    /// (--interp texel).
    #[arg(long, hide_short_help = true, value_name = "M", value_parser = at_least_zero)]
    max_edge: Option<f64>,
    /// Caches that each vertex interpolates [default: 8 at --quality high].
    #[arg(long, hide_short_help = true, value_name = "N", value_parser = ["8", "16"])]
    refs: Option<String>,
    /// Ground plane: auto, off, or its height on +Y [m].
    ///
    /// auto puts a ground under an object that has neither lights nor a floor.
    #[arg(long, help_heading = sky::HEADING, value_name = "auto|off|HEIGHT", default_value = "auto", allow_hyphen_values = true, value_parser = ground)]
    ground: Ground,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum QualityArg {
    /// A quick look: few caches, no antialiasing, no shadows of indirect light.
    Low,
    /// Antialiasing, and coarse shadows of indirect light.
    Medium,
    /// Ray-traced shadows, short rays for nearby light, accurate shadows of indirect light.
    #[default]
    High,
    /// As high, with twice the density of everything.
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
#[command(next_help_heading = GLOBAL)]
struct DeviceArgs {
    /// Vulkan device, by index or part of its name (see `lightskin devices`).
    #[arg(long, value_name = "INDEX|NAME")]
    device: Option<String>,
    /// Run under the Khronos validation layer; fail on any message.
    #[arg(long, hide_short_help = true, value_enum, default_value_t)]
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

/// What messages call a scene: its file, or the name of one without.
fn called(scene: &Scene, file: Option<&Path>) -> String {
    file.map_or_else(|| scene.name.clone(), |file| file.display().to_string())
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
