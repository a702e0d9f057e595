//! `lightskin eval`: measurements of the engine.

use super::{DeviceArgs, hard_cases};
use anyhow::{Result, bail};

#[derive(clap::Args)]
pub(super) struct Eval {
    /// Run what is hard on numbers, one line each.
    #[arg(long)]
    hard_cases: bool,
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
    bail!("nothing to measure: ask for --hard-cases")
}
