//! Generated scenes for measurements only, built with [`crate::scene::build`].

mod coats;
mod measured;
mod moving;
mod shadowed;
mod spheres;
mod valley;

pub use coats::coats;
pub use measured::measured;
pub use moving::{crowd, moving};
pub use shadowed::Shadowed;
pub use spheres::spheres;
pub use valley::valley;
