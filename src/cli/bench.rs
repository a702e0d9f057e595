//! `lightskin bench`: measures what `render` draws, and repeats the measurements of the thesis beside its figures.

use super::{DeviceArgs, check_messages, progress_bar};
use anyhow::Result;
use lightskin::lab::bench::{self, Extent, report};
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct BenchArgs {
    /// Folder for the report (bench.md), bench.json, CSV tables and plots.
    #[arg(short, long, value_name = "FOLDER", default_value = "lightskin-bench")]
    out: PathBuf,
    /// Measure few points with small pictures. Takes minutes on a software device, where it is the default.
    #[arg(long, conflicts_with = "full")]
    quick: bool,
    /// Measure all points of the tables of the thesis. This is the default on GPUs.
    #[arg(long)]
    full: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

pub(super) fn run(args: &BenchArgs) -> Result<()> {
    report::check_writable(&args.out)?;
    let gpu = args.device.open()?;
    let is_quick = args.quick || (gpu.is_software() && !args.full);
    let extent = if is_quick { Extent::quick() } else { Extent::full() };
    let bar = progress_bar("[{bar:40}] {percent:>3} %  {elapsed}  {wide_msg}");
    let progress = |part: f32, what: &str| {
        bar.set_message(what.to_owned());
        bar.set_position((part * 1000.0) as u64);
    };
    let results = bench::run(&gpu, &extent, &progress)?;
    bar.finish_and_clear();
    bench::write(&args.out, &gpu, &results)?;

    let device = gpu.report();
    say!("device    {} ({}, {})", device.name, device.kind, device.driver);
    for line in report::headlines(&gpu, &results) {
        say!("  {line}");
    }
    for skipped in results.tables.iter().flat_map(|table| &table.skipped) {
        say!("skipped   {skipped}");
    }
    say!("report    {}", args.out.join("bench.md").display());
    check_messages(&gpu, &results.problems)
}
