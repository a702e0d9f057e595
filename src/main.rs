//! The command-line tool: parse, dispatch to `cli`, one line per error, exit code.

mod cli;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    cli::start_log(cli.verbose, cli.quiet);
    match cli::run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("lightskin: {error:#}");
            ExitCode::FAILURE
        }
    }
}
