//! `lightskin lab codegen`: statistics of the shaders as a driver compiles them.

use anyhow::Result;
use lightskin::gpu::Codegen;
use lightskin::lab::codegen;

#[derive(clap::Args)]
pub(super) struct CodegenArgs {
    /// Vulkan device, by index or part of its name; see `lightskin devices`. It does not have to support drawing.
    #[arg(long, value_name = "INDEX|NAME")]
    device: Option<String>,
    /// Compile only shaders whose names begin with this [default: all].
    #[arg(long, value_name = "NAME", default_value = "")]
    only: String,
}

/// Prints the table.
pub(super) fn run(args: &CodegenArgs) -> Result<()> {
    let compiler = Codegen::new(args.device.as_deref())?;
    say!("{} ({}), Vulkan {}", compiler.report.name, compiler.report.driver, compiler.report.api);
    say!("");
    say!(
        "| shader | constants | vector registers | scalar registers | spilled | waves | instructions | vector a pair |"
    );
    say!("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    let whole = |number: Option<f64>| number.map_or_else(|| "-".to_owned(), |n| format!("{n:.0}"));
    for line in codegen::lines(&compiler, &args.only)? {
        let [vector, scalar] = [0, 1].map(|i| whole(line.registers.map(|r| r[i])));
        let per_pair = line.per_pair.map_or_else(String::new, |n| format!("{n:.1}"));
        let (spilled, waves, count) = (whole(line.spilled), whole(line.occupancy), whole(line.instructions));
        let kind = if line.kind.is_empty() { "its own" } else { &line.kind };
        say!("| {} | {kind} | {vector} | {scalar} | {spilled} | {waves} | {count} | {per_pair} |", line.shader);
    }
    Ok(())
}
