//! Simulated failures of a device: its loss, and an end of its memory. No driver produces these on request, so tests
//! ask for them here.

use super::device::{Device, Shared};
use super::graveyard::lock;
use ash::vk;
use std::sync::atomic::Ordering;

/// A kind of Vulkan call that can report the loss of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Call {
    /// Submitting commands.
    Submit,
    /// Waiting for a submission.
    Wait,
    /// Uploading or reading back outside a frame.
    Copy,
    /// Acquiring an image of a window.
    Acquire,
    /// Presenting an image of a window.
    Present,
    /// Acquiring an image of a window. It loses the window's surface, not the device.
    Surface,
    /// Asking what a window supports. It loses the window's surface, not the device.
    Query,
}

/// Whether a device acts as if it were lost.
#[derive(Clone, Copy, Debug, Default)]
pub(super) enum Lost {
    /// No.
    #[default]
    Never,
    /// From the next call of this kind on.
    At(Call),
    /// No, but it has no memory for the next submission.
    Refuses,
    /// Yes.
    Now,
}

impl Device {
    /// Makes the device act as if it were lost, from the next call of this kind on; for tests. A driver may report a
    /// real loss at any of these calls, too.
    pub fn lose_at(&self, call: Call) {
        *lock(&self.shared.lost) = Lost::At(call);
    }

    /// Makes the device act as if it had no memory for the next submission; for tests.
    pub fn refuse_submission(&self) {
        *lock(&self.shared.lost) = Lost::Refuses;
    }

    /// Makes the device act as if it had this much memory \[bytes\] for buffers and images; for tests.
    pub fn limit_memory(&self, bytes: u64) {
        self.shared.most_memory.store(bytes, Ordering::Relaxed);
    }
}

impl Shared {
    /// Fails if the device acts as lost, or refuses a submission. Called before each call of this kind, which is then
    /// not made, except waits: the device may still use objects that are about to be destroyed.
    pub(super) fn check_lost(&self, call: Call) -> Result<(), vk::Result> {
        let mut lost = lock(&self.lost);
        match *lost {
            Lost::At(kind) if kind == call => *lost = Lost::Now,
            Lost::Refuses if call == Call::Submit => {
                *lost = Lost::Never;
                return Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY);
            }
            Lost::Now => {}
            _ => return Ok(()),
        }
        Err(vk::Result::ERROR_DEVICE_LOST)
    }

    /// Fails once if the surface of a window acts as lost at this kind of call. Called before each one.
    #[cfg(feature = "app")]
    pub(super) fn check_surface(&self, call: Call) -> Result<(), vk::Result> {
        let mut lost = lock(&self.lost);
        if !matches!(*lost, Lost::At(kind) if kind == call) {
            return Ok(());
        }
        *lost = Lost::Never;
        Err(vk::Result::ERROR_SURFACE_LOST_KHR)
    }
}
