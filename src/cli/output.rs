//! Standard output and standard error. What they do not take never hides what the work has found.

use anyhow::{Result, anyhow};
use std::collections::VecDeque;
use std::fmt::Arguments;
use std::io::{Error, ErrorKind, Write, stderr, stdout};
use std::sync::{Mutex, PoisonError};

/// Prints a line of the result on standard output.
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::output::line(format_args!($($text)*)) };
}

/// Why standard output takes nothing more.
static BROKEN: Mutex<Option<Error>> = Mutex::new(None);

/// Text without what terminals take for commands, such as escape codes in the names of files.
fn plain(text: Arguments<'_>) -> String {
    text.to_string().replace(|c: char| c.is_control() && c != '\n' && c != '\t', "\u{fffd}")
}

/// What `say!` does.
pub(super) fn line(text: Arguments<'_>) {
    let mut broken = BROKEN.lock().unwrap_or_else(PoisonError::into_inner);
    if broken.is_none() {
        *broken = writeln!(stdout().lock(), "{}", plain(text)).err();
    }
}

/// Fails if something that was said could not be written, unless the reader has closed the pipe, having read enough.
pub(super) fn written() -> Result<()> {
    BROKEN.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), lost)
}

/// The failure that an error of standard output is.
pub(super) fn lost(error: Error) -> Result<()> {
    match error.kind() {
        ErrorKind::BrokenPipe => Ok(()),
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            Err(anyhow!("standard output: {error}; free some space or choose another disk"))
        }
        _ => Err(anyhow!("standard output: {error}")),
    }
}

/// Prints a message on standard error. Errors of standard error itself are ignored.
pub(crate) fn tell(text: Arguments<'_>) {
    let _ = writeln!(stderr().lock(), "lightskin: {}", plain(text));
}

/// The last messages, oldest first.
static RECENT: Mutex<VecDeque<String>> = Mutex::new(VecDeque::new());

/// Messages that are remembered.
const REMEMBERED: usize = 200;

/// The last messages, oldest first: for a window that shows them.
#[cfg(feature = "app")]
pub(crate) fn recent() -> Vec<String> {
    RECENT.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
}

/// Messages on standard error, one line each.
struct Log;

impl log::Log for Log {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        // The clipboard only warns that its text is lost once the window is closed.
        let from = metadata.target();
        from.starts_with("lightskin") || (metadata.level() <= log::Level::Warn && !from.starts_with("arboard"))
    }
    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata()) {
            let mut recent = RECENT.lock().unwrap_or_else(PoisonError::into_inner);
            if recent.len() == REMEMBERED {
                recent.pop_front();
            }
            recent.push_back(record.args().to_string());
            drop(recent);
            match record.level() {
                // A desktop without a dialog for files is no failure of ours.
                log::Level::Error if record.target().starts_with("rfd") => tell(*record.args()),
                log::Level::Error => tell(format_args!("error: {}", record.args())),
                log::Level::Warn => tell(*record.args()),
                level => tell(format_args!("[{}] {}", level.as_str().to_lowercase(), record.args())),
            }
        }
    }
    fn flush(&self) {}
}

/// Starts the log: warnings, or more with `-v`, or errors alone with `-q`.
pub(super) fn start_log(verbose: u8, quiet: bool) {
    let level = match (quiet, verbose) {
        (true, _) => log::LevelFilter::Error,
        (_, 0) => log::LevelFilter::Warn,
        (_, 1) => log::LevelFilter::Info,
        _ => log::LevelFilter::Debug,
    };
    if log::set_logger(&Log).is_ok() {
        log::set_max_level(level);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_command_no_terminal() {
        assert_eq!(plain(format_args!("a\x1b[31m\u{9b}2J\rb\tc\nd")), "a\u{fffd}[31m\u{fffd}2J\u{fffd}b\tc\nd");
    }
}
