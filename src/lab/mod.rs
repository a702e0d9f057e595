//! The laboratory: error and time of each setting, sources of error, and behaviour in numerically difficult and moving
//! scenes.

pub mod bench;
pub mod codegen;
pub mod eval;
pub mod flicker;
pub mod hard_cases;
pub mod knobs;
pub mod plot;
pub mod scenes;
pub mod shadows;
pub mod sheet;
pub mod shot;
pub mod sources;
pub mod worlds;
