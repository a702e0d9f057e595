//! How far one image is from another, and where the difference comes from.

pub mod metrics;
pub mod sources;
