//! The command-line tool: parse, dispatch to `cli`, one line per error, exit code.
#![warn(clippy::print_stderr, reason = "panics where standard error is broken")]

#[cfg(feature = "app")]
mod app;
mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    let done = match cli::parse(cli::arguments()) {
        Ok(cli) => cli::run(&cli),
        Err(usage) => cli::usage(&usage),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            cli::tell(format_args!("{error:#}"));
            ExitCode::FAILURE
        }
    }
}
