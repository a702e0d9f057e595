//! The laboratory: what each setting costs in error and in time, where errors come from, and how the engine bears what is
//! hard on numbers and on time.

pub mod bench;
pub mod choices;
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
