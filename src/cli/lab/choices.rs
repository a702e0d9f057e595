//! `lightskin lab choices`: the tables by which the defaults were chosen.

use anyhow::{Context, Result};
use lightskin::lab::choices::{Row, Study, StudySettings, Worst};
use lightskin::lab::{scenes, shadows};
use lightskin::scene::{Scene, build};
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct Choices {
    /// glTF or GLB file, or a folder that contains one [default: a built-in body between two walls].
    scene: Option<PathBuf>,
    #[command(flatten)]
    caches: crate::cli::CacheArgs,
    /// Virtual lights per light source: N x N.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=512))]
    rsm: u32,
    /// Picture size [pixels].
    #[arg(long, value_name = "WxH", default_value = "256x144", value_parser = crate::cli::render::size)]
    size: [u32; 2],
    /// Replace the exponent of every exact Phong lobe [default: unchanged].
    #[arg(long, value_name = "K", value_parser = crate::cli::positive)]
    exponent: Option<f64>,
    /// Compare the shadows of indirect light with one bounce of the path tracer.
    ///
    /// Uses SCENE, or the atrium and five built-in scenes whose indirect light is mostly shadowed.
    #[arg(long)]
    shadows: bool,
    /// Samples per pixel of the path tracer with --shadows. They are stored; a later run with a larger N uses them again.
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(32..=1_000_000))]
    spp: u32,
    #[command(flatten)]
    device: crate::cli::DeviceArgs,
}

pub(super) fn run(args: &Choices) -> Result<()> {
    if args.shadows {
        return shadows(args);
    }
    let mut scene = match &args.scene {
        Some(path) => crate::cli::divided(crate::cli::load_punctual(Some(path))?, &args.caches),
        None => scenes::between_walls(0.05),
    };
    if let Some(k) = args.exponent {
        scene.materials.iter_mut().filter_map(|m| m.phong.as_mut()).for_each(|phong| phong.exponent = k as f32);
    }
    let settings = StudySettings { size: args.size, caches: args.caches.count(), rsm: args.rsm as usize };
    tables(&scene, &settings)
}

/// Prints the error of each kind of indirect shadows against the path tracer.
fn shadows(args: &Choices) -> Result<()> {
    let mut scenes = shadowed_scenes(args)?;
    if args.scene.is_none() {
        scenes.push(build::atrium());
    }
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

/// The given scene, or the five built-in scenes whose indirect light is mostly shadowed.
fn shadowed_scenes(args: &Choices) -> Result<Vec<Scene>> {
    Ok(match &args.scene {
        Some(path) => vec![crate::cli::load_punctual(Some(path))?],
        None => scenes::Shadowed::ALL.iter().map(|which| which.scene()).collect(),
    })
}

/// Prints all tables of a scene.
pub(super) fn tables(scene: &Scene, settings: &StudySettings) -> Result<()> {
    let camera = crate::cli::camera::camera(scene, None)?;
    let study = Study::new(scene, &camera, *settings)?;
    let [caches, vals] = study.counts();
    let [w, h] = settings.size;
    say!("{}: {caches} caches, {vals} VALs, {w} x {h} pixels", scene.name);
    let lobes: &[(&str, bool)] =
        if study.is_glossy() { &[("diffuse", false), ("glossy", true)] } else { &[("diffuse", false)] };
    for &(lobe, is_glossy) in lobes {
        print(&format!("{lobe}: against brute force"), &if is_glossy { study.glossy() } else { study.diffuse() });
        print(&format!("{lobe}: references"), &study.references(is_glossy));
        let Worst { share, near_val, too_bright, radiance: [found, brute_force, paths] } = study.worst(is_glossy);
        say!(
            "{lobe}: the worst 1 % of pixels hold {:.1} % of the squared error; {:.0} % are within a VAL's side of one, {:.0} % too bright",
            100.0 * share,
            100.0 * near_val,
            100.0 * too_bright
        );
        say!("  there interpolated {found:.4} cd/m^2, by brute force {brute_force:.4}, by light paths {paths:.4}");
    }
    let (areas, noise) = study.areas();
    say!("light paths have a noise of {:.1} %", 100.0 * noise);
    for (&(lobe, _), rows) in lobes.iter().zip(&areas) {
        print(&format!("{lobe}: area of VALs, against light paths"), rows);
    }
    Ok(())
}

fn print(title: &str, rows: &[Row]) {
    say!("{title:<48}{:>9}{:>11}{:>11}{:>9}{:>9}", "MARE", "relMSE", "w/o 1 %", "bias", "w/o 1 %");
    for Row { name, metrics: m, trimmed_bias } in rows {
        let (bias, trimmed) = (100.0 * m.bias, 100.0 * trimmed_bias);
        say!("  {name:<46}{:>9.4}{:>11.4}{:>11.5}{bias:>+8.1}%{trimmed:>+8.1}%", m.mare, m.relmse, m.relmse_trimmed);
    }
}
