//! `lightskin lab hard-cases`: numerically hard cases, one line each.

use crate::cli::{DeviceArgs, check_messages};
use anyhow::{Result, bail};
use lightskin::lab::hard_cases;

#[derive(clap::Args)]
pub(super) struct HardCases {
    /// Print JSON lines instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Runs every case and prints a table, or one JSON object per line with `json`. Fails if any case fails.
pub(super) fn run(args: &HardCases) -> Result<()> {
    let json = args.json;
    let gpu = args.device.open()?;
    let cases = hard_cases::lines();
    let mut failed = 0;
    if !json {
        say!("| case | input | expected | measured | |");
        say!("| --- | --- | --- | --- | --- |");
    }
    for case in &cases {
        let line = hard_cases::run(&gpu, case)?;
        failed += usize::from(!line.pass);
        if json {
            let hard_cases::Line { kind, input, expected, measured, pass } = &line;
            say!(
                "{}",
                serde_json::json!({
                    "schema": 1, "kind": kind, "input": input, "expected": expected, "measured": measured, "pass": pass,
                })
            );
        } else {
            let verdict = if line.pass { "ok" } else { "FAILED" };
            say!("| {} | {} | {} | {} | {verdict} |", line.kind, line.input, line.expected, line.measured);
        }
    }
    check_messages(&gpu, &[])?;
    if failed > 0 {
        bail!("{failed} of {} hard cases failed", cases.len());
    }
    if !json {
        say!("all {} hard cases passed", cases.len());
    }
    Ok(())
}
