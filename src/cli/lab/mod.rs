//! `lightskin lab`: the studies behind the engine's defaults, one a file.

mod choices;
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
    /// What the defaults are chosen by: variants of the method on the CPU, as tables.
    Choices(choices::Choices),
    /// How much indirect light trembles while a light, the camera or a model creeps along.
    Flicker(flicker::FlickerArgs),
    /// What is hard on numbers, one line each; fails if a case does.
    HardCases(hard_cases::HardCases),
    /// Every scene of a folder beside the path tracer, as a page with FLIP and bias of each, the worst first.
    Sheet(sheet::SheetArgs),
    /// Where the error of indirect light comes from.
    Sources(sources::SourcesArgs),
}

pub(super) fn run(lab: &Lab) -> Result<()> {
    match &lab.study {
        Study::Choices(args) => choices::run(args),
        Study::Flicker(args) => flicker::run(args),
        Study::HardCases(args) => hard_cases::run(args),
        Study::Sheet(args) => sheet::run(args),
        Study::Sources(args) => sources::run(args),
    }
}
