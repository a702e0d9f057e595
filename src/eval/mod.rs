//! How far one image is from another.

pub mod metrics;
