//! `lightskin lab shadows`: shadows of indirect light beside the path tracer's.

use anyhow::{Context, Result};
use lightskin::lab::{scenes, shadows};
use lightskin::scene::build;
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct ShadowsArgs {
    /// glTF or GLB file, or a folder that contains one [default: the atrium and five built-in scenes whose indirect light is
    /// mostly shadowed].
    scene: Option<PathBuf>,
    #[command(flatten)]
    caches: crate::cli::CacheArgs,
    /// Virtual lights per light source: N x N.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=512))]
    rsm: u32,
    /// Picture size [pixels].
    #[arg(long, value_name = "WxH", default_value = "256x144", value_parser = crate::cli::render::size)]
    size: [u32; 2],
    /// Samples per pixel of the path tracer. They are stored; a later run with a larger N uses them again.
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(32..=1_000_000))]
    spp: u32,
    #[command(flatten)]
    device: crate::cli::DeviceArgs,
}

/// Prints the error of each kind of indirect shadows against the path tracer.
pub(super) fn run(args: &ShadowsArgs) -> Result<()> {
    let scenes = match &args.scene {
        Some(path) => vec![crate::cli::load_punctual(Some(path))?],
        None => scenes::Shadowed::ALL.iter().map(|which| which.scene()).chain([build::atrium()]).collect(),
    };
    let settings = shadows::ShadowsSettings {
        size: args.size,
        caches: args.caches.count(),
        rsm: args.rsm,
        samples: args.spp,
        frames: 3,
    };
    let gpu = args.device.open()?;
    let folder = lightskin::kept::folder().unwrap_or_else(std::env::temp_dir).join("shadows");
    std::fs::create_dir_all(&folder).with_context(|| format!("{}: cannot make the folder", folder.display()))?;
    let [w, h] = settings.size;
    for scene in &scenes {
        let bar = crate::cli::progress_bar("{msg:>24} [{bar:40}] {percent:>3} %  {elapsed}");
        bar.set_message("tracing paths");
        let progress = |part: f32| bar.set_position((part * 1000.0) as u64);
        let compared = shadows::compare(&gpu, scene, &settings, &folder, &progress)?;
        bar.finish_and_clear();
        let noise = 100.0 * compared.noise;
        say!(
            "{}: {} caches, {w} x {h} pixels without {} on edges; the noise of the path tracer is {noise:.1} %",
            scene.name,
            compared.caches,
            compared.on_edges
        );
        say!(
            "  {:<22}{:>9}{:>11}{:>9}{:>10}{:>12}{:>11}",
            "",
            "bias",
            "RMSE/mean",
            "relMSE",
            "w/o 1 %",
            "gather [ms]",
            "frame [ms]"
        );
        for row in &compared.rows {
            let name = crate::cli::words::ShadowsArg::of(row.shadows);
            match &row.errors {
                Err(reason) => say!("  {name:<22}{reason}"),
                Ok(layers) => {
                    for (layer, shadows::Errors { metrics: m, rmse_over_mean }) in layers {
                        let (bias, label) = (100.0 * m.bias, format!("{name}, {layer}"));
                        say!(
                            "  {label:<22}{bias:>+8.1}%{rmse_over_mean:>11.3}{:>9.4}{:>10.4}{:>12.1}{:>11.1}",
                            m.relmse,
                            m.relmse_trimmed,
                            row.gather_ms,
                            row.frame_ms
                        );
                    }
                }
            }
        }
        crate::cli::check_messages(&gpu, &compared.problems)?;
    }
    Ok(())
}
