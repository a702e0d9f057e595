//! `lightskin compare`: errors of one image against another, a heat map, and limits for scripts.

use anyhow::{Result, bail};
use lightskin::eval::metrics::{metrics, relative_squares};
use lightskin::image::{Picture, read_picture, write_png};
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct Compare {
    /// Image to judge: .exr (linear) or .png (sRGB, compared linearly).
    image: PathBuf,
    /// Image to judge it by.
    reference: PathBuf,
    /// Layer of EXR files, like indirect.diffuse; the picture itself without it.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Compare only pixels that are not black in this image.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Write a heat map of the relative squared error, from black (1e-6) to white (1 and more).
    #[arg(long, value_name = "FILE.png")]
    diff: Option<PathBuf>,
    /// Print one JSON object instead of the table.
    #[arg(long)]
    json: bool,
    /// Fail (exit code 1) if a metric's absolute value is above a limit; may be given several times.
    #[arg(long, value_name = "METRIC=LIMIT", value_parser = limit)]
    fail_above: Vec<(String, f64)>,
}

fn limit(text: &str) -> std::result::Result<(String, f64), String> {
    let names = ["mae", "mare", "rmse", "relmse", "relmse-trimmed", "bias"];
    match text.split_once('=').map(|(name, value)| (name, value.parse::<f64>())) {
        Some((name, Ok(value))) if names.contains(&name) && value >= 0.0 => Ok((name.to_owned(), value)),
        _ => Err(format!("needs METRIC=LIMIT like mare=0.05, the metric one of {}", names.join(", "))),
    }
}

pub(super) fn run(args: &Compare) -> Result<()> {
    let layer = args.layer.as_deref();
    let (image, reference) = (read_picture(&args.image, layer)?, read_picture(&args.reference, layer)?);
    same_size(args, &image, &reference)?;
    let mask = args.mask.as_ref().map(|path| read_picture(path, None)).transpose()?;
    if let Some(mask) = &mask {
        same_size(args, mask, &reference)?;
    }
    let counts = |i: usize| mask.as_ref().is_none_or(|m| m.rgb[i].iter().any(|v| *v > 0.0));
    let of = |p: &Picture| -> Vec<[f32; 3]> { (0..p.rgb.len()).filter(|i| counts(*i)).map(|i| p.rgb[i]).collect() };
    let (a, b) = (of(&image), of(&reference));
    if a.is_empty() {
        bail!("the mask leaves no pixel to compare");
    }
    let found = metrics(&a, &b);
    if args.json {
        let mut object = serde_json::json!({ "schema": 1, "image": args.image, "reference": args.reference, "layer": layer, "pixels": found.pixels });
        for (name, value) in found.named() {
            object[name] = serde_json::json!(value);
        }
        say!("{object}");
    } else {
        say!("{:<16}{:>14}", "pixels", super::thousands(found.pixels));
        for (name, value) in found.named() {
            say!("{name:<16}{value:>14.6}");
        }
    }
    if let Some(path) = &args.diff {
        let heat: Vec<u8> = relative_squares(&image.rgb, &reference.rgb).iter().flat_map(|e| heat(*e)).collect();
        write_png(path, image.width, image.height, &heat)?;
    }
    let value = |name: &str| found.named().into_iter().find(|(n, _)| *n == name).map_or(f64::NAN, |(_, v)| v);
    // A value that is no number is above every limit.
    let is_above = |value: f64, limit: f64| value.is_nan() || value.abs() > limit;
    if let Some((name, limit)) = args.fail_above.iter().find(|(name, limit)| is_above(value(name), *limit)) {
        bail!("{name} is {}, above {limit}", value(name));
    }
    Ok(())
}

fn same_size(args: &Compare, a: &Picture, b: &Picture) -> Result<()> {
    if (a.width, a.height) != (b.width, b.height) {
        let sizes = format!("{}x{} against {}x{}", a.width, a.height, b.width, b.height);
        bail!("{}: {sizes} pixels; render both with the same --size", args.image.display());
    }
    Ok(())
}

/// Black, blue, red, yellow, white over six decades up to 1.
fn heat(error: f64) -> [u8; 4] {
    let stops = [[0.0, 0.0, 0.0], [0.1, 0.1, 0.7], [0.8, 0.1, 0.3], [1.0, 0.8, 0.1], [1.0, 1.0, 1.0]];
    let t = if error.is_nan() { 1.0 } else { ((error.max(1e-6).log10() + 6.0) / 6.0).clamp(0.0, 1.0) };
    let i = ((t * 4.0) as usize).min(3);
    let f = t * 4.0 - i as f64;
    let mix = |c: usize| ((stops[i][c] * (1.0 - f) + stops[i + 1][c] * f) * 255.0 + 0.5) as u8;
    [mix(0), mix(1), mix(2), 255]
}
