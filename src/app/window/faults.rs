//! Failures of the device that tests request by environment variables:
//!
//! - `LIGHTSKIN_LOSE_DEVICE=40:submit,60:present` loses the device twice: at the first submission from the 40th frame
//!   with a scene on, and at the first presentation from the 60th on. The calls are submit, wait, copy, acquire and
//!   present. The calls surface and query lose only the window's surface: when an image is acquired, and when the
//!   window is asked what it supports.
//! - `LIGHTSKIN_DEVICE_MIB=64` limits the memory for buffers and images [MiB].

use anyhow::{Context, Result, bail};
use lightskin::gpu::{Call, Gpu};
use std::collections::VecDeque;

/// Calls by their names in the variable.
const CALLS: [(&str, Call); 7] = [
    ("submit", Call::Submit),
    ("wait", Call::Wait),
    ("copy", Call::Copy),
    ("acquire", Call::Acquire),
    ("present", Call::Present),
    ("surface", Call::Surface),
    ("query", Call::Query),
];

/// The requested failures.
pub(super) struct Faults {
    /// Number of frames with a scene so far.
    frames: u64,
    /// Frames that lose the device, and the calls at which they do, in order.
    losses: VecDeque<(u64, Call)>,
    /// Limit of the device's memory [bytes].
    memory: Option<u64>,
}

impl Faults {
    /// Reads the variables.
    pub(super) fn new() -> Result<Self> {
        let losses = std::env::var("LIGHTSKIN_LOSE_DEVICE").unwrap_or_default();
        let losses = losses.split(',').filter(|one| !one.is_empty()).map(loss).collect::<Result<_>>();
        let memory = std::env::var("LIGHTSKIN_DEVICE_MIB").ok().map(|mib| mib.parse::<u64>()).transpose();
        Ok(Self {
            frames: 0,
            losses: losses.context("LIGHTSKIN_LOSE_DEVICE")?,
            memory: memory.context("LIGHTSKIN_DEVICE_MIB")?.map(|mib| mib << 20),
        })
    }

    /// Prepares a device that was just opened.
    pub(super) fn open(&self, gpu: &Gpu) {
        if let Some(memory) = self.memory {
            gpu.limit_memory(memory);
        }
    }

    /// Counts a frame with a scene, and prepares the loss of the device if this frame is to lose it.
    pub(super) fn frame(&mut self, gpu: &Gpu) {
        self.frames += 1;
        if let Some((_, call)) = self.losses.pop_front_if(|(frame, _)| *frame <= self.frames) {
            gpu.lose_at(call);
        }
    }
}

/// Reads a frame and a call.
fn loss(text: &str) -> Result<(u64, Call)> {
    let (frame, name) = text.split_once(':').context("needs FRAME:CALL")?;
    match CALLS.iter().find(|(call, _)| *call == name) {
        Some((_, call)) => Ok((frame.parse()?, *call)),
        None => bail!("needs one of {} instead of {name}", CALLS.map(|(name, _)| name).join(", ")),
    }
}
