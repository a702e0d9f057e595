//! The library's error: the world's fault, told so that the user can act. Programmer's mistakes are asserts.

use std::path::PathBuf;

/// What went wrong outside the program. Each message is one line: what, where, why, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file that cannot be read or does not hold what it should: file, place in it, reason and remedy.
    #[error("{}: {place}: {reason}", file.display())]
    Input {
        /// The file as the user named it.
        file: PathBuf,
        /// Where in the file, in its own terms ("accessor 3", "image 2 'wall.png'", "file").
        place: String,
        /// What is wrong there and, where there is one, the remedy.
        reason: String,
    },
    /// A file that cannot be written. Nothing half-written is left behind.
    #[error("{}: cannot write: {reason}", file.display())]
    Output {
        /// The file as the user named it.
        file: PathBuf,
        /// Why, and the remedy.
        reason: String,
    },
    /// No Vulkan device can run the engine; says what each one lacks.
    #[error("no suitable Vulkan device: {0}")]
    NoDevice(String),
    /// A Vulkan call failed: what was being made, and the result.
    #[error("{what}: {result}")]
    Vulkan {
        /// What was being done ("image rsm.normal 128x128 R32G32B32A32_SFLOAT").
        what: String,
        /// The result, in words.
        result: String,
    },
    /// There is nothing to work on; says what is missing.
    #[error("{0}")]
    Nothing(String),
    /// The scene asks for more than an index or a budget can hold; says which and what to change.
    #[error("{0}")]
    TooLarge(String),
}

/// Result of everything that can fail for reasons outside the program.
pub type Result<T> = std::result::Result<T, Error>;
