//! Signals that end the process. Half-written files are removed first, and a path trace stores its samples.

use anyhow::{Context, Result};
use lightskin::files;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether work is running that can stop cleanly on request.
static IN_ORDER: AtomicBool = AtomicBool::new(false);

/// Whether the running work should stop.
static STOP: AtomicBool = AtomicBool::new(false);

/// Starts to handle signals. Signals that are already ignored, as under `nohup`, stay ignored.
#[cfg(unix)]
pub(super) fn watch() -> Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

    let ignored = ignored();
    let heeded = [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
    let mut signals = signal_hook::iterator::Signals::new(heeded).context("signals")?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            asked_to_end(|| {
                // This ends the process.
                let _ = signal_hook::low_level::emulate_default_handler(signal);
            });
        }
    })?;
    Ok(())
}

/// Starts to handle Ctrl+C and the closing of the console.
#[cfg(windows)]
pub(super) fn watch() -> Result<()> {
    // The exit code of a process that Ctrl+C ended is STATUS_CONTROL_C_EXIT.
    ctrlc::set_handler(|| asked_to_end(|| std::process::exit(0xC000_013A_u32 as i32))).context("Ctrl+C")
}

/// Ends the process with `end`, or requests running work to stop cleanly.
fn asked_to_end(end: impl FnOnce()) {
    // A second request ends the process at once.
    if IN_ORDER.load(Ordering::SeqCst) && !STOP.swap(true, Ordering::SeqCst) {
        return;
    }
    files::abandon();
    end();
}

/// Runs work that stops cleanly and soon after the flag is set.
pub(super) fn in_order<T>(work: impl FnOnce(&AtomicBool) -> T) -> T {
    IN_ORDER.store(true, Ordering::SeqCst);
    let done = work(&STOP);
    IN_ORDER.store(false, Ordering::SeqCst);
    done
}

/// A bit for each ignored signal; the lowest bit is signal 1. 0 if the system does not provide the mask.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}
