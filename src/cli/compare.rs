//! `lightskin compare`: errors of an image against a reference, a heat map, and limits for scripts.

use anyhow::{Result, bail};
use indicatif::ProgressBar;
use lightskin::error::Error;
use lightskin::files::check_writable;
use lightskin::image::{Picture, is_exr, read_picture, write_png};
use lightskin::metrics::display::Values;
use lightskin::metrics::flip::{PIXELS_PER_DEGREE, flip, weighted_quantile};
use lightskin::metrics::heat::{self, Scale};
use lightskin::metrics::ssim::ssim;
use lightskin::metrics::{self, absolutes, metrics, relative_squares};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Metrics for which smaller is better.
const SMALLER: [&str; 11] = [
    "mae",
    "mare",
    "rmse",
    "relmse",
    "relmse-trimmed",
    "median-relative",
    "bias",
    "flip",
    "flip-q1",
    "flip-median",
    "flip-q3",
];
/// Metrics for which larger is better.
const LARGER: [&str; 2] = ["psnr", "ssim"];

#[derive(clap::Args)]
pub(super) struct Compare {
    /// Image to measure: .exr (linear) or .png (sRGB, converted to linear).
    image: PathBuf,
    /// Reference image to measure it against.
    reference: PathBuf,
    /// Layer of EXR files, like indirect.diffuse [default: the picture].
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Mask image: only pixels that are not black in it are compared.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Pixels per degree of visual angle, for FLIP. 67 is a 4K display, 0.7 m wide, seen from 0.7 m.
    #[arg(long, value_name = "N", default_value_t = PIXELS_PER_DEGREE, value_parser = pixels_per_degree)]
    ppd: f32,
    /// Write a heat map of the error, and print its scale.
    #[arg(long, value_name = "FILE.png")]
    diff: Option<PathBuf>,
    /// Error that the heat map shows.
    #[arg(long, value_enum, default_value_t, requires = "diff")]
    diff_of: DiffOf,
    /// Print JSON instead of a table. null means infinity or NaN.
    #[arg(long)]
    json: bool,
    /// Exit with code 1 if the absolute value of a metric exceeds a limit, like mare=0.05. May be repeated.
    #[arg(long, value_name = "METRIC=LIMIT", value_parser = above)]
    fail_above: Vec<(String, f64)>,
    /// Exit with code 1 if psnr or ssim is below a limit, like ssim=0.95. May be repeated.
    #[arg(long, value_name = "METRIC=LIMIT", allow_hyphen_values = true, value_parser = below)]
    fail_below: Vec<(String, f64)>,
}

#[derive(Clone, Copy, Default, clap::ValueEnum)]
enum DiffOf {
    /// Relative squared error.
    #[default]
    Relmse,
    /// Absolute error, on a scale up to the mean of the reference.
    Abs,
    /// FLIP.
    Flip,
    /// 1 - SSIM.
    Ssim,
}

fn above(text: &str) -> std::result::Result<(String, f64), String> {
    match text.split_once('=').map(|(name, value)| (name, value.parse::<f64>())) {
        Some((name, _)) if LARGER.contains(&name) => {
            Err(format!("{name} is better the larger it is; use --fail-below {name}=LIMIT"))
        }
        Some((name, Ok(value))) if SMALLER.contains(&name) && value >= 0.0 => Ok((name.to_owned(), value)),
        _ => Err(format!("needs METRIC=LIMIT like mare=0.05, the metric one of {}", SMALLER.join(", "))),
    }
}

fn below(text: &str) -> std::result::Result<(String, f64), String> {
    match text.split_once('=').map(|(name, value)| (name, value.parse::<f64>())) {
        Some((name, _)) if SMALLER.contains(&name) => {
            Err(format!("{name} is better the smaller it is; use --fail-above {name}=LIMIT"))
        }
        Some((name, Ok(value))) if LARGER.contains(&name) && !value.is_nan() => Ok((name.to_owned(), value)),
        _ => Err(format!("needs METRIC=LIMIT like ssim=0.95, the metric one of {}", LARGER.join(", "))),
    }
}

fn pixels_per_degree(text: &str) -> std::result::Result<f32, String> {
    match text.parse::<f32>() {
        Ok(v) if (1.0..=1000.0).contains(&v) => Ok(v),
        _ => Err("needs a number of pixels from 1 to 1000".into()),
    }
}

pub(super) fn run(args: &Compare) -> Result<()> {
    if let Some(path) = &args.diff {
        check_writable(path)?;
    }
    let layer = args.layer.as_deref();
    let (image, reference) = (read_picture(&args.image, layer)?, read_picture(&args.reference, layer)?);
    same_size(&args.image, &image, &args.reference, &reference)?;
    let mask = args.mask.as_ref().map(|path| Ok::<_, Error>((path, read_picture(path, None)?))).transpose()?;
    if let Some((path, mask)) = &mask {
        same_size(path, mask, &args.reference, &reference)?;
    }
    let counts = |i: &usize| mask.as_ref().is_none_or(|(_, m)| m.rgb[*i].iter().any(|v| *v > 0.0));
    let kept: Vec<usize> = (0..image.rgb.len()).filter(counts).collect();
    if kept.is_empty() {
        bail!("{}: the mask leaves no pixel to compare", args.mask.as_deref().unwrap_or(&args.image).display());
    }
    let of = |p: &Picture| -> Vec<[f32; 3]> { kept.iter().map(|i| p.rgb[*i]).collect() };
    let (a, b) = (of(&image), of(&reference));

    let size = [image.width, image.height];
    let values = if is_exr(&args.image) || is_exr(&args.reference) { Values::Radiance } else { Values::Display };
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
    bar.set_message("SSIM and FLIP");
    bar.enable_steady_tick(Duration::from_millis(100));
    let of = |map: Vec<f64>| -> Vec<f64> { kept.iter().map(|i| map[*i]).collect() };
    let ssim = of(ssim(&image.rgb, &reference.rgb, size, values));
    let flip = of(flip(&image.rgb, &reference.rgb, size, values, args.ppd));
    bar.finish_and_clear();

    let mean = |map: &[f64]| map.iter().sum::<f64>() / map.len() as f64;
    let found = metrics(&a, &b);
    let mut named = found.named().to_vec();
    named.extend([("ssim", mean(&ssim)), ("flip", mean(&flip))]);
    named.extend(
        [("flip-q1", 0.25), ("flip-median", 0.5), ("flip-q3", 0.75)].map(|(n, s)| (n, weighted_quantile(&flip, s))),
    );
    let (errors, scale) = match args.diff_of {
        DiffOf::Relmse => (relative_squares(&a, &b), Scale::Log(1e-6, 1.0)),
        DiffOf::Abs => (absolutes(&a, &b), Scale::Linear(Some(metrics::mean(&b)).filter(|m| *m > 0.0).unwrap_or(1.0))),
        DiffOf::Flip => (flip, Scale::Linear(1.0)),
        DiffOf::Ssim => (ssim.iter().map(|s| 1.0 - s).collect(), Scale::Linear(1.0)),
    };

    if args.json {
        let mut object = serde_json::json!({
            "schema": 1, "image": args.image, "reference": args.reference, "layer": layer, "pixels": found.pixels,
            "pixels_per_degree": args.ppd,
        });
        if args.diff.is_some() {
            object["diff_scale"] = scale.to_string().into();
        }
        for (name, value) in &named {
            object[name] = serde_json::json!(value);
        }
        say!("{object}");
    } else {
        say!("{:<16}{:>14}", "pixels", super::thousands(found.pixels));
        for (name, value) in &named {
            say!("{name:<16}{value:>14.6}");
        }
    }
    if let Some(path) = &args.diff {
        // Pixels outside the mask stay black.
        let mut map = vec![0.0; image.rgb.len()];
        kept.iter().zip(&errors).for_each(|(i, error)| map[*i] = *error);
        write_png(path, image.width, image.height, &heat::colors(&map, scale))?;
        if !args.json {
            say!("{}: {scale}", path.display());
        }
    }
    check_limits(args, &named)
}

/// Fails with one line that lists every exceeded limit. A metric that is NaN exceeds every limit.
fn check_limits(args: &Compare, named: &[(&str, f64)]) -> Result<()> {
    let value = |name: &str| named.iter().find(|(n, _)| *n == name).map_or(f64::NAN, |(_, v)| *v);
    let above =
        args.fail_above.iter().map(|(name, limit)| (name, value(name), limit, value(name).abs() > *limit, "above"));
    let below = args.fail_below.iter().map(|(name, limit)| (name, value(name), limit, value(name) < *limit, "below"));
    let failed: Vec<String> = above
        .chain(below)
        .filter(|(_, value, _, is_beyond, _)| *is_beyond || value.is_nan())
        .map(|(name, value, limit, _, side)| {
            if value.is_nan() {
                format!("{name} is not a number")
            } else {
                format!("{name} is {value}, {side} {limit}")
            }
        })
        .collect();
    if !failed.is_empty() {
        bail!("{}: {}", args.image.display(), failed.join("; "));
    }
    Ok(())
}

/// Fails if the images differ in size, or have more than the 2^28 pixels that FLIP's maps support.
fn same_size(path: &Path, a: &Picture, reference_path: &Path, b: &Picture) -> Result<()> {
    if (a.width, a.height) != (b.width, b.height) {
        let sizes = format!("{}x{} pixels against {}x{}", a.width, a.height, b.width, b.height);
        bail!("{}: {sizes} of {}; render both with the same --size", path.display(), reference_path.display());
    }
    if a.rgb.len() > 1 << 28 {
        bail!("{}: {}x{} pixels are too many; at most 2^28 can be compared", path.display(), a.width, a.height);
    }
    Ok(())
}
