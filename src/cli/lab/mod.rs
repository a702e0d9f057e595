//! `lightskin lab`: the studies behind the engine's defaults, one per file.

mod codegen;
mod flicker;
mod hard_cases;
mod shadows;
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
    /// Compile all compute shaders and print the registers, spills, occupancy and instructions that the driver reports.
    Codegen(codegen::CodegenArgs),
    /// Measure flicker while a light, the camera or a model moves slowly.
    Flicker(flicker::FlickerArgs),
    /// Check numerically hard cases. Fails if any case fails.
    HardCases(hard_cases::HardCases),
    /// Compare the shadows of indirect light with one bounce of the path tracer.
    Shadows(shadows::ShadowsArgs),
    /// Compare every scene of a folder with the path tracer, on one page with FLIP and bias, worst first.
    Sheet(sheet::SheetArgs),
    /// Measure how much each approximation adds to the error of indirect light.
    Sources(sources::SourcesArgs),
}

pub(super) fn run(lab: &Lab) -> Result<()> {
    match &lab.study {
        Study::Codegen(args) => codegen::run(args),
        Study::Flicker(args) => flicker::run(args),
        Study::HardCases(args) => hard_cases::run(args),
        Study::Shadows(args) => shadows::run(args),
        Study::Sheet(args) => sheet::run(args),
        Study::Sources(args) => sources::run(args),
    }
}
