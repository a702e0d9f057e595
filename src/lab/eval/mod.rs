//! Speed against error: measures the points of a sweep, keeps the results, and writes a report page.

pub mod figures;
pub mod measure;
pub mod pictures;
pub mod record;
pub mod references;
pub mod report;
pub mod run;
pub mod sweep;
