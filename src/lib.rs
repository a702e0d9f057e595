//! lightskin: real-time global illumination by interpolated light caches.

pub mod bake;
pub mod error;
pub mod reference;
pub mod scene;

pub use error::{Error, Result};
