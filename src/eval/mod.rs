//! How far one image is from another, where the difference comes from, what each setting costs in error and in time, and
//! how the engine bears what is hard on numbers and on time.

pub mod choices;
pub mod display;
pub mod figures;
pub mod flicker;
pub mod flip;
pub mod hard_cases;
pub mod heat;
pub mod measure;
pub mod metrics;
pub mod pictures;
pub mod plot;
pub mod record;
pub mod references;
pub mod report;
pub mod run;
pub mod shadows;
pub mod shot;
pub mod sources;
pub mod ssim;
pub mod sweep;
pub mod worlds;
