//! `lightskin lab flicker`: how much indirect light flickers while something moves slowly.

use crate::cli::gather::ClusterArgs;
use crate::cli::motion::animation_index;
use crate::cli::{CacheArgs, DeviceArgs, QualityArg, bake_scene, check_messages, divided, load_punctual, progress_bar};
use anyhow::{Context, Result};
use lightskin::frame::ClusterRule;
use lightskin::lab::flicker::{Figures, Flicker, Job, Motion, Played, measure, model};
use lightskin::scene::defaults::Ground;
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct FlickerArgs {
    /// glTF or GLB file, or a folder that contains one [default: the built-in atrium].
    scene: Option<PathBuf>,
    /// Numbers of caches, separated by commas.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_values_t = [250, 1000, 4000], value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    caches: Vec<u32>,
    /// Sides of the reflective shadow maps [texels], separated by commas. Each is compared with twice the largest side.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_values_t = [32, 64, 128, 256], value_parser = clap::value_parser!(u32).range(1..=2048))]
    rsm: Vec<u32>,
    /// Node to move, by name [default: the largest that is smaller than half the scene].
    #[arg(long, value_name = "NODE")]
    model: Option<String>,
    /// Animations to play, by name or index, separated by commas [default: the first].
    #[arg(long, value_name = "NAME|INDEX,..", value_delimiter = ',')]
    animation: Vec<String>,
    /// Start time of the animation [s].
    #[arg(long, value_name = "T", default_value_t = 0.0, allow_hyphen_values = true)]
    time: f64,
    /// Frame rate of the animation [frames/s].
    #[arg(long, value_name = "F", default_value_t = 60.0, value_parser = crate::cli::positive)]
    fps: f64,
    /// Print JSON lines instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    cluster: ClusterArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Measures a scene, or the built-in atrium, and prints a table, or one JSON object per row with `json`.
pub(super) fn run(args: &FlickerArgs) -> Result<()> {
    let (path, device, json) = (args.scene.as_deref(), &args.device, args.json);
    let most = args.caches.iter().copied().max().context("--caches names no number")?;
    let largest = args.rsm.iter().copied().max().context("--rsm names no size")?;
    let asked = |caches| CacheArgs {
        ground: Ground::Auto,
        quality: QualityArg::High,
        caches: Some(caches),
        spacing: None,
        angle: 60.0,
        max_edge: None,
        refs: None,
    };
    let scene = divided(load_punctual(path)?, &asked(most));
    let named = |name: &String| {
        let found = scene.instances.iter().position(|i| i.name == *name);
        found.with_context(|| format!("--model {name}: the scene has no node of this name with a mesh"))
    };
    let model = match &args.model {
        Some(name) => Some(named(name)?),
        None => model(&scene),
    };
    let mut caches = Vec::new();
    for count in &args.caches {
        caches.push(bake_scene(&scene, args.scene.as_deref(), &asked(*count).settings(), false)?.caches);
    }
    let mut animations = Vec::new();
    if args.animation.is_empty() && scene.animations().next().is_some() {
        animations.push(0);
    }
    for wanted in &args.animation {
        animations.push(animation_index(&scene, Some(wanted))?);
    }
    let job = Job {
        size: [64, 36],
        frames: 16,
        rsm: args.rsm.clone(),
        fine: 2 * largest,
        cluster: args.cluster.rule(),
        pace: 1.0,
        model,
        animation: None,
    };
    let gpu = device.open()?;
    let bar = progress_bar("[{bar:40}] {percent:>3} %  {elapsed}  {wide_msg}");
    let moving = model.map_or_else(|| "no model".into(), |i| format!("model '{}'", scene.instances[i].name));
    let [w, h] = job.size;
    if !json {
        say!(
            "{}, light '{}', {moving}: {} frames of {w}x{h} pixels, finer RSM {}{}",
            scene.name,
            scene.lights.first().map_or("none", |l| &l.name),
            job.frames,
            job.fine,
            match job.cluster {
                None => String::new(),
                Some(ClusterRule::Distance(radii)) => format!(", clusters beyond {radii} radii"),
                Some(ClusterRule::Error(share)) => format!(", clusters that err by up to {share}"),
            }
        );
        say!("in % of the mean of brute force; caches / brute force\n");
        say!(
            "| moves | RSM | caches | change | **flicker** (without the worst 1 %) | VALs' own | jitter | of the mean | of the caches' diffuse light |"
        );
        say!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    }
    let mut motions = vec![(Motion::Light, None), (Motion::Camera, None)];
    motions.extend(model.map(|_| (Motion::Model, None)));
    motions.extend(animations.into_iter().map(|index| (Motion::Animation, Some(index))));
    let share = 1000.0 / motions.len() as f32;
    for (i, (motion, index)) in motions.into_iter().enumerate() {
        let progress = |part: f32, what: &str| {
            bar.set_message(what.to_owned());
            bar.set_position(((i as f32 + part) * share) as u64);
        };
        // All frames are within the animation, because everything jumps where it restarts.
        let played = |index: usize| {
            let end = scene.animations().nth(index).map_or(0.0, |(_, _, end)| end);
            let steps = (job.frames - 1) as f64;
            let step = (1.0 / args.fps).min(end / steps);
            Played { index, begin: args.time.clamp(0.0, (end - steps * step).max(0.0)), step }
        };
        let animation = index.map(played);
        let moves = match index.and_then(|index| scene.animations().nth(index)) {
            Some((name, ..)) => format!("animation '{name}'"),
            None => motion.name().to_owned(),
        };
        for row in measure(&gpu, &scene, &caches, motion, &Job { animation, ..job.clone() }, &progress)? {
            bar.suspend(|| print(&row, &moves, args));
        }
    }
    bar.finish_and_clear();
    check_messages(&gpu, &[])
}

fn print(row: &Flicker, moves: &str, args: &FlickerArgs) {
    let Flicker { motion: _, rsm, caches, figures } = *row;
    let Figures { kept, change, flicker, flicker_trimmed, vals_own, jitter, of_mean, of_caches } = figures;
    if args.json {
        say!(
            "{}",
            serde_json::json!({
                "schema": 2, "moves": moves, "cluster": args.cluster.cluster,
                "cluster_error": args.cluster.cluster_error, "rsm": rsm, "caches": caches, "kept": kept, "change": change,
                "flicker": flicker, "flicker_trimmed": flicker_trimmed, "vals_own": vals_own, "jitter": jitter, "of_mean": of_mean,
                "of_caches": of_caches,
            })
        );
        return;
    }
    let percent = |v: f64| format!("{:.3}", 100.0 * v);
    let pair = |v: [f64; 2]| format!("{} / {}", percent(v[0]), percent(v[1]));
    say!(
        "| {} | {rsm} | {caches} | {} | **{}** ({}) | {} | {} | {} | {} |",
        moves,
        pair(change),
        percent(flicker),
        percent(flicker_trimmed),
        percent(vals_own),
        pair(jitter),
        pair(of_mean),
        percent(of_caches)
    );
}
