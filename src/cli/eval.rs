//! `lightskin eval`: measurements of the engine.

use super::{DeviceArgs, flicker, hard_cases};
use anyhow::{Result, bail};
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct Eval {
    /// glTF or GLB file, or a folder with one; the built-in atrium without one.
    scene: Option<PathBuf>,
    /// Run what is hard on numbers, one line each; needs no scene.
    #[arg(long, conflicts_with = "scene")]
    hard_cases: bool,
    /// Measure how much the indirect light trembles while a light, the camera or a model creeps along.
    #[arg(long, conflicts_with = "hard_cases")]
    flicker: bool,
    #[command(flatten)]
    flicker_args: flicker::FlickerArgs,
    /// Print one JSON object a line instead of the table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

pub(super) fn run(args: &Eval) -> Result<()> {
    if args.hard_cases {
        return hard_cases::run(&args.device, args.json);
    }
    if args.flicker {
        return flicker::run(args.scene.as_deref(), &args.flicker_args, &args.device, args.json);
    }
    bail!("nothing to measure: ask for --hard-cases or --flicker")
}
