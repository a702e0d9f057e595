//! `lightskin lab`: the studies behind the engine's defaults, one a file.

mod choices;
mod codegen;
mod flicker;
mod hard_cases;
mod sheet;
mod sources;

use anyhow::Result;

#[derive(clap::Args)]
pub(super) struct Lab {
    #[command(subcommand)]
    study: Study,
}

#[derive(clap::Subcommand)]
enum Study {
    /// Compare variants of the method on the CPU: the tables behind the defaults.
    Choices(choices::Choices),
    /// Compile all compute shaders and print registers, spills, occupancy and instructions, as the driver gives them.
    Codegen(codegen::CodegenArgs),
    /// Measure flicker while a light, the camera or a model moves slowly.
    Flicker(flicker::FlickerArgs),
    /// Check numerically hard cases; fails if one fails.
    HardCases(hard_cases::HardCases),
    /// Draw every scene of a folder beside the path tracer, on one page with FLIP and bias, the worst first.
    Sheet(sheet::SheetArgs),
    /// Measure how much each approximation adds to the error of indirect light.
    Sources(sources::SourcesArgs),
}

pub(super) fn run(lab: &Lab) -> Result<()> {
    match &lab.study {
        Study::Choices(args) => choices::run(args),
        Study::Codegen(args) => codegen::run(args),
        Study::Flicker(args) => flicker::run(args),
        Study::HardCases(args) => hard_cases::run(args),
        Study::Sheet(args) => sheet::run(args),
        Study::Sources(args) => sources::run(args),
    }
}
