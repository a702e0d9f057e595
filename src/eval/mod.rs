//! How far one image is from another, and what each setting costs in error and in time.

pub mod display;
pub mod figures;
pub mod flip;
pub mod heat;
pub mod measure;
pub mod metrics;
pub mod pictures;
pub mod plot;
pub mod record;
pub mod references;
pub mod report;
pub mod run;
pub mod ssim;
pub mod sweep;
