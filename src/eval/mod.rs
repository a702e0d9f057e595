//! How far one image is from another.

pub mod choices;
pub mod metrics;
