//! `lightskin eval`: a report of speed against error, with a curve for every setting.

use super::{DeviceArgs, angle, at_least_zero, camera, check_messages, load_punctual, progress_bar, render};
use anyhow::{Context, Result};
use lightskin::frame::Quality;
use lightskin::lab::eval::figures::Figures;
use lightskin::lab::eval::references::Truth;
use lightskin::lab::eval::report;
use lightskin::lab::eval::run::{Job, run as measure};
use lightskin::lab::eval::sweep::{Extent, Point, Sweep};
use lightskin::lab::knobs::Knobs;
use lightskin::lab::plot;
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct Eval {
    /// glTF or GLB file, or a folder that contains one [default: the built-in atrium].
    scene: Option<PathBuf>,
    /// Folder of the report. An interrupted run continues in the same folder.
    #[arg(short, long, value_name = "REPORT", default_value = "report")]
    out: PathBuf,
    /// Measure fewer points with smaller pictures. Takes minutes instead of an hour on a software device.
    #[arg(long)]
    quick: bool,
    /// Picture size [pixels] [default: 480x270, or 240x135 with --quick].
    #[arg(long, value_name = "WxH", value_parser = render::size)]
    size: Option<[u32; 2]>,
    /// Samples per pixel of the path tracer [default: 2048, or 256 with --quick]. They are stored; a later run with a
    /// larger N uses them again.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    spp: Option<u32>,
    /// Number of timed frames; the median counts.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: u32,
    /// Camera of the scene by name or index, or "eye;target;up;fov" [default: the first camera].
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true, value_parser = super::camera::readable)]
    camera: Option<String>,
    /// Number of caches while other settings vary.
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    caches: u32,
    /// Virtual lights per light source, N x N, while other settings vary.
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..=4096))]
    rsm: u32,
    /// Largest angle between a surface normal and the normal of its cache [degrees].
    ///
    /// If --caches is below 8 for each instance in the scene, small models are allowed 75 degrees: larger surfaces need
    /// the caches more.
    #[arg(long, value_name = "DEG", default_value_t = 60.0, value_parser = angle)]
    angle: f64,
    /// Subdivide triangles until no edge is longer than this [m]; 0 subdivides none [default: a quarter of the cache
    /// spacing].
    #[arg(long, value_name = "M", value_parser = at_least_zero)]
    max_edge: Option<f64>,
    #[command(flatten)]
    device: DeviceArgs,
}

impl Eval {
    fn sweep(&self) -> Sweep {
        let (extent, size, samples) =
            if self.quick { (Extent::Quick, [240, 135], 256) } else { (Extent::Full, [480, 270], 2048) };
        let (size, caches) = (self.size.unwrap_or(size), self.caches as usize);
        let frame = Knobs { rsm: self.rsm, bounces: Quality::High.bounces(), ..Knobs::at(Quality::High, caches, size) };
        let base = Point {
            frame,
            caches,
            references: Quality::High.references(),
            angle: self.angle.to_radians() as f32,
            max_edge: self.max_edge,
        };
        Sweep::new(base, extent, self.frames as usize, self.spp.unwrap_or(samples))
    }
}

pub(super) fn run(args: &Eval) -> Result<()> {
    report::check_writable(&args.out)?;
    let scene = load_punctual(args.scene.as_deref())?;
    let camera = camera::camera(&scene, args.camera.as_deref())?;
    let gpu = args.device.open()?;
    let sweep = args.sweep();
    let bar = progress_bar("[{bar:40}] {percent:>3} %  {elapsed}, {eta} left  {wide_msg}");
    let progress = |part: f32, what: &str| {
        bar.set_message(what.to_owned());
        bar.set_position((part * 1000.0) as u64);
    };
    let program = identity()?;
    let job = Job { gpu: &gpu, scene: &scene, camera: &camera, sweep: &sweep, folder: &args.out, program: &program };
    let results = measure(&job, &progress)?;
    bar.finish_and_clear();
    report::write(&job, &results, &[])?;

    let failed = results.rows.iter().filter(|row| row.failed.is_some()).count();
    say!(
        "points    {} ({} measured now, {} kept, {failed} failed)",
        results.rows.len(),
        results.measured,
        results.kept
    );
    // Points of one bounce without shadows are compared with references of the same light, all others with all light.
    let figures = Figures { job: &job, results: &results };
    let rows = Truth::ALL.into_iter().filter_map(|truth| Some((truth, figures.row(figures.base(truth))?)));
    for errors in rows.flat_map(|(truth, row)| row.errors.iter().filter(move |errors| errors.truth == truth.name())) {
        let value = |name: &str| errors.values.iter().find(|(n, _)| n == name).map_or(f64::NAN, |(_, v)| *v);
        let (mare, bias) = (plot::short(value("mare") * 100.0), plot::short(value("bias") * 100.0));
        say!("  {:<24}{:<18}error {mare} %, bias {bias} %", errors.truth, errors.layer);
    }
    for reference in &results.references {
        if let (Some(name), Some(noise)) = (reference["name"].as_str(), reference["noise"].as_f64()) {
            say!("  {name:<24}noise of the reference itself {} %; --spp lowers it", plot::short(noise * 100.0));
        }
    }
    say!("report    {}", args.out.join("index.html").display());
    check_messages(&gpu, &results.problems)
}

/// Hash of this executable. Results of different executables are not mixed.
fn identity() -> Result<String> {
    let path = std::env::current_exe().context("this program's own file")?;
    let bytes = std::fs::read(&path).with_context(|| path.display().to_string())?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
}
