//! `lightskin completions` and `lightskin man`: shell completions and manual pages, made by clap's own generators.

use super::Cli;
use anyhow::{Context, Result};
use clap::CommandFactory;
use clap_complete::Shell;
use clap_mangen::Man;

#[derive(clap::Args)]
pub(super) struct Completions {
    /// Shell for which the script is made.
    #[arg(value_enum)]
    shell: Shell,
}

#[derive(clap::Args)]
pub(super) struct Manual {
    /// Subcommand to describe [default: the whole tool].
    command: Option<String>,
}

pub(super) fn completions(args: &Completions) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "lightskin", &mut text);
    tell(&text)
}

pub(super) fn manual(args: &Manual) -> Result<()> {
    let mut all = Cli::command();
    all.build();
    let command = match &args.command {
        None => all,
        Some(name) => {
            let found = all.find_subcommand(name).cloned();
            let command =
                found.with_context(|| format!("there is no subcommand {name}; `lightskin --help` lists them"))?;
            command.name(format!("lightskin-{name}"))
        }
    };
    let mut text = Vec::new();
    Man::new(command).render(&mut text)?;
    tell(&text)
}

fn tell(text: &[u8]) -> Result<()> {
    String::from_utf8(text.to_vec())?.lines().for_each(|line| say!("{line}"));
    Ok(())
}
