//! Small worlds, whole frames of them, and what the device made on the way, as the references read it.

use lightskin::bake::CacheSet;
use lightskin::frame::Settings;
use lightskin::gpu::Gpu;
use lightskin::scene::Scene;

pub(crate) use lightskin::eval::shot::{Seen, Shot, reflection, seen, small, triangles};
pub(crate) use lightskin::eval::worlds::{SPOT, add, camera, corner, lamp, phong, placed};

/// Caches this far apart [m].
pub(crate) fn baked(scene: &Scene, spacing: f64, references: usize) -> CacheSet {
    lightskin::eval::worlds::baked(scene, spacing, references).expect("bakes")
}

/// Draws one frame from the scene's first camera, fails if validation, the barrier check or the check for broken values
/// say anything, and reads it back.
#[track_caller]
pub(crate) fn shoot(gpu: &Gpu, scene: &Scene, caches: Option<&CacheSet>, settings: &Settings) -> Shot {
    let shot = lightskin::eval::shot::shoot(gpu, scene, caches, settings).expect("drawn");
    assert_eq!(shot.complaints, [""; 0]);
    super::assert_clean(gpu);
    shot
}
