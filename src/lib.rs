//! lightskin: real-time global illumination by interpolated light caches, on Vulkan.
//!
//! A few hundred *caches* are placed once on the surfaces of models. Each cache condenses all indirect light (thousands
//! of virtual area lights from extended reflective shadow maps) into one diffuse and one glossy proxy light.
//! Interpolating the lights instead of the colours gives every pixel diffuse and glossy indirect light. It is fully
//! dynamic, without temporal history and without ray-tracing hardware. The method is Philipp Lensing's dissertation
//! *LightSkin* (Ilmenau 2014).
//!
//! A frame is a list of stages. Each stage is one file in [`frame`] with its shader in `glsl/`:
//!
//! | # | stage | in -> out |
//! | --- | --- | --- |
//! | 1 | [`frame::gbuffer`] | scene, camera -> depth, normal, reflectances, emitted radiance |
//! | 2 | [`frame::direct`] | G-buffer, shadow maps -> radiance |
//! | 3 | [`frame::atlas`] | model caches, transforms -> caches in the world |
//! | 4 | [`frame::rsm`] | scene from each light -> virtual area lights (VALs) |
//! | 5 | [`frame::visible`], [`frame::cull`] | pixels -> visible vertices or cells -> live caches |
//! | 6 | [`frame::depth_images`], [`frame::gather`], [`frame::bounce`] | VALs x caches -> proxy lights |
//! | 7 | [`frame::occlude`] | discs of caches -> dimmed proxies |
//! | 8 | [`frame::interpolate`] | proxies -> indirect radiance per pixel |
//! | 9, 10 | [`frame::inside`] | light that enters translucent bodies -> proxy dipoles -> light that leaves them |
//! | 11 | [`frame::composite`] | all radiance, exposure, tone map -> picture |
//!
//! A [`frame::World`] is a scene on the device. A [`frame::Light`] is the scene's light, computed once for all views. A
//! [`frame::Picture`] holds the images of one view. A [`frame::Engine`] owns a world and its light; everything in it
//! can change between two frames:
//!
//! ```no_run
//! use lightskin::frame::engine::Loaded;
//! use lightskin::frame::{Engine, Look, Quality};
//! use lightskin::{gpu, image};
//!
//! fn main() -> lightskin::Result<()> {
//!     // Loads as the command line does: adds a missing camera, light or ground, and places caches.
//!     let loaded = Loaded::open("scene.glb".as_ref(), Quality::High, &|_, _| {})?;
//!     let camera = loaded.scene.cameras[0].clone();
//!
//!     let gpu = gpu::Gpu::new(&gpu::Options::default())?;
//!     let settings = loaded.settings(Quality::High);
//!     let mut engine = Engine::new(&gpu, loaded, &settings)?;
//!     let size = [640, 360];
//!     let mut picture = engine.picture(&gpu, size)?;
//!     for _ in 0..2 {
//!         engine.fit(&gpu, &mut [(&mut picture, size)])?; // after any change; free when nothing changed
//!         let view = engine.view(&camera, size);
//!         let drawn = gpu.timed_frame(|cmd| {
//!             engine.record(cmd, &mut [(view, &mut picture)], &Look::default());
//!             Ok(())
//!         })?;
//!         gpu.times(&drawn)?; // waits; returns the milliseconds of each stage
//!         engine.edit(&gpu, |scene| scene.lights[0].intensity *= 2.0)?;
//!     }
//!     image::write_png("picture.png".as_ref(), 640, 360, &gpu.read_image(&picture.output.picture)?)
//! }
//! ```
//!
//! With default features off, the library is the engine alone: [`gpu`], [`scene`], [`bake`], [`frame`], and the f64
//! twins of its shaders in [`mod@reference`]. Feature `exr` adds OpenEXR files, `compare` adds `metrics`, `lab` adds
//! the tools that measure the engine, `cli` the command line, and `app` the window.

pub mod bake;
pub mod error;
pub mod files;
pub mod frame;
pub mod gpu;
pub mod image;
pub mod kept;
#[cfg(feature = "lab")]
pub mod lab;
#[cfg(feature = "compare")]
pub mod metrics;
pub mod reference;
pub mod scene;
pub mod trace;
#[allow(missing_docs, reason = "shared.glsl says no more where a member's name says all")]
pub mod shared {
    //! Structs and constants shared by host and shaders; written in `glsl/shared.glsl`.
    include!(concat!(env!("OUT_DIR"), "/shared.rs"));
}

pub use error::{Error, Result};
