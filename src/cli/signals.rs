//! Signals that end the run: half-written files are removed first, and a path trace keeps its samples.

use anyhow::{Context, Result};
use lightskin::files;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether work is running that can stop cleanly when asked to.
static IN_ORDER: AtomicBool = AtomicBool::new(false);

/// Whether it is asked to.
static STOP: AtomicBool = AtomicBool::new(false);

/// Handles signals from here on. Those that are ignored already, as under `nohup`, stay ignored.
#[cfg(unix)]
pub(super) fn watch() -> Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

    let ignored = ignored();
    let heeded = [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
    let mut signals = signal_hook::iterator::Signals::new(heeded).context("signals")?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            asked_to_end(|| {
                // It ends the process.
                let _ = signal_hook::low_level::emulate_default_handler(signal);
            });
        }
    })?;
    Ok(())
}

/// Handles Ctrl+C and the closing of the console from here on.
#[cfg(windows)]
pub(super) fn watch() -> Result<()> {
    // What a process ends with that Ctrl+C has ended: STATUS_CONTROL_C_EXIT.
    ctrlc::set_handler(|| asked_to_end(|| std::process::exit(0xC000_013A_u32 as i32))).context("Ctrl+C")
}

/// Ends the run by `end`, or asks running work to stop cleanly.
fn asked_to_end(end: impl FnOnce()) {
    // A second request does not wait.
    if IN_ORDER.load(Ordering::SeqCst) && !STOP.swap(true, Ordering::SeqCst) {
        return;
    }
    files::abandon();
    end();
}

/// Runs work that stops cleanly, and soon, once the flag is set.
pub(super) fn in_order<T>(work: impl FnOnce(&AtomicBool) -> T) -> T {
    IN_ORDER.store(true, Ordering::SeqCst);
    let done = work(&STOP);
    IN_ORDER.store(false, Ordering::SeqCst);
    done
}

/// A bit for each signal that is ignored, the lowest for number 1; none where the system does not say.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}
