//! How far one image is from another, and where the difference comes from.

pub mod display;
pub mod flip;
pub mod heat;
pub mod metrics;
pub mod sources;
pub mod ssim;
