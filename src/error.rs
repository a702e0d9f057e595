//! The library's error type: failures outside the program, described so that the user can act. Programming errors are
//! asserts.

use std::path::PathBuf;

/// A failure outside the program. Each message is one line: what, where, why, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file cannot be read or has invalid content: file, place in the file, reason and remedy.
    #[error("{}: {place}: {reason}", file.display())]
    Input {
        /// The file as the user named it.
        file: PathBuf,
        /// Place in the file, in the file's own terms ("accessor 3", "image 2 'wall.png'", "file").
        place: String,
        /// What is wrong at this place, and the remedy if there is one.
        reason: String,
    },
    /// A file cannot be written. No partial file is left behind.
    #[error("{}: cannot write: {reason}", file.display())]
    Output {
        /// The file as the user named it.
        file: PathBuf,
        /// The reason and the remedy.
        reason: String,
    },
    /// No Vulkan device can run the engine; lists what each device lacks.
    #[error("no suitable Vulkan device: {0}")]
    NoDevice(String),
    /// A Vulkan call failed; names the operation and the result.
    #[error("{what}: {result}")]
    Vulkan {
        /// The operation ("image rsm.normal 128x128 R32G32B32A32_SFLOAT").
        what: String,
        /// The result, in words.
        result: String,
    },
    /// The driver has reset the device, or it has crashed; names the operation that found out. Nothing works on it any
    /// more. Another `Gpu` may be opened after everything of this one has been dropped.
    #[error("{what}: the device was lost (driver reset or crash); update the driver or try another --device")]
    DeviceLost {
        /// The operation ("submitting a frame").
        what: String,
    },
    /// There is nothing to work on; names what is missing.
    #[error("{0}")]
    Nothing(String),
    /// The scene exceeds an index range or a budget; names the limit and what to change.
    #[error("{0}")]
    TooLarge(String),
}

/// Result of every operation that can fail for reasons outside the program.
pub type Result<T> = std::result::Result<T, Error>;
