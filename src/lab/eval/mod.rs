//! Speed against error: points of a sweep measured, kept and printed as a page.

pub mod figures;
pub mod measure;
pub mod pictures;
pub mod record;
pub mod references;
pub mod report;
pub mod run;
pub mod sweep;
