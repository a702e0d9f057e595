//! How far one image is from another, and how the engine bears what is hard on numbers and on time.

pub mod display;
pub mod flicker;
pub mod flip;
pub mod hard_cases;
pub mod heat;
pub mod metrics;
pub mod shot;
pub mod ssim;
pub mod worlds;
