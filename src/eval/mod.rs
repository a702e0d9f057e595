//! How far one image is from another.

pub mod display;
pub mod flip;
pub mod heat;
pub mod metrics;
pub mod ssim;
