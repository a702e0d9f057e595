//! How far one image is from another, and how the engine bears what is hard on numbers and on time.

pub mod flicker;
pub mod hard_cases;
pub mod metrics;
pub mod shot;
pub mod worlds;
