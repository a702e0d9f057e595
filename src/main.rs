//! The command-line tool: parse, dispatch to `cli`, one line per error, exit code.
#![warn(clippy::print_stderr, reason = "panics where standard error is broken")]

#[cfg(feature = "app")]
mod app;
mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = cli::arguments();
    let parsed = cli::grammar_for(&arguments).map(|grammar| cli::parse(grammar, arguments));
    let done = match parsed {
        Ok(Ok(cli)) => cli::run(&cli),
        Ok(Err(usage)) => cli::usage(&usage),
        Err(error) => Err(error),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            cli::tell_line(format_args!("{error:#}"));
            ExitCode::FAILURE
        }
    }
}
