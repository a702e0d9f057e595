//! lightskin: real-time global illumination by interpolated light caches.

pub mod bake;
pub mod error;
pub mod frame;
pub mod gpu;
pub mod image;
pub mod reference;
pub mod scene;
#[allow(missing_docs, reason = "shared.glsl says no more where a member's name says all")]
pub mod shared {
    //! Structs and constants that host and shaders share; written in `glsl/shared.glsl`.
    include!(concat!(env!("OUT_DIR"), "/shared.rs"));
}

pub use error::{Error, Result};
