//! Standard output and standard error. A failed write to them never hides the result or the error of the work itself.

use anyhow::{Result, anyhow};
use std::collections::VecDeque;
use std::fmt::Arguments;
use std::io::{Error, ErrorKind, Write, stderr, stdout};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::Instant;

/// Prints a result line on standard output.
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::output::line(format_args!($($text)*)) };
}

/// The first write error of standard output. Later lines are dropped.
static BROKEN: Mutex<Option<Error>> = Mutex::new(None);

/// Replaces control characters, which terminals execute as commands. File names can contain escape codes.
fn plain(text: Arguments<'_>) -> String {
    text.to_string().replace(|c: char| c.is_control() && c != '\n' && c != '\t', "\u{fffd}")
}

/// Prints a line for `say!`.
pub(super) fn line(text: Arguments<'_>) {
    let mut broken = BROKEN.lock().unwrap_or_else(PoisonError::into_inner);
    if broken.is_none() {
        *broken = writeln!(stdout().lock(), "{}", plain(text)).err();
    }
}

/// Fails if a result line could not be written. A pipe that its reader has closed is not an error.
pub(super) fn written() -> Result<()> {
    BROKEN.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), lost)
}

/// Turns a write error of standard output into the error of the run. A closed pipe is not one.
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
fn tell(text: Arguments<'_>) {
    let _ = writeln!(stderr().lock(), "lightskin: {}", plain(text));
}

/// Like `tell`, for messages of one line: file names can contain line breaks, too.
pub(crate) fn tell_line(text: Arguments<'_>) {
    tell(format_args!("{}", one_line(text)));
}

fn one_line(text: Arguments<'_>) -> String {
    text.to_string().replace(['\n', '\t'], "\u{fffd}")
}

/// The latest log messages, oldest first.
static RECENT: Mutex<VecDeque<String>> = Mutex::new(VecDeque::new());

/// When the log was started. Information and debug messages say how long ago that was.
static START: LazyLock<Instant> = LazyLock::new(Instant::now);

/// Maximum number of messages in `RECENT`.
const REMEMBERED: usize = 60;

/// The latest log messages, oldest first, for the log panel of the window.
#[cfg(feature = "app")]
pub(crate) fn recent() -> Vec<String> {
    RECENT.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
}

/// A logger that prints each message as one line on standard error.
struct Log;

impl log::Log for Log {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        // arboard, the clipboard, only warns that its text is lost when the window is closed. sctk_adwaita, the frame
        // of windows on Wayland, only reports that the desktop prefers neither dark nor light.
        let from = metadata.target();
        let silent = ["arboard", "sctk_adwaita"].iter().any(|name| from.starts_with(name));
        from.starts_with("lightskin") || (metadata.level() <= log::Level::Warn && !silent)
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
                // rfd logs an error if the desktop has no file dialog. That is not an error of lightskin.
                log::Level::Error if record.target().starts_with("rfd") => tell(*record.args()),
                log::Level::Error => tell(format_args!("error: {}", record.args())),
                log::Level::Warn => tell_line(*record.args()),
                level => {
                    let (at, level) = (START.elapsed().as_secs_f64(), level.as_str().to_lowercase());
                    tell(format_args!("[{at:.3} s, {level}] {}", record.args()));
                }
            }
        }
    }
    fn flush(&self) {}
}

/// Starts the log. It prints warnings by default, more with `-v`, and only errors with `-q`.
pub(super) fn start_log(verbose: u8, quiet: bool) {
    let level = match (quiet, verbose) {
        (true, _) => log::LevelFilter::Error,
        (_, 0) => log::LevelFilter::Warn,
        (_, 1) => log::LevelFilter::Info,
        _ => log::LevelFilter::Debug,
    };
    LazyLock::force(&START);
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
        assert_eq!(one_line(format_args!("a\nb.glb: file: is empty")), "a\u{fffd}b.glb: file: is empty");
    }
}
