//! lightskin: real-time global illumination by interpolated light caches, on Vulkan.
//!
//! A few hundred *caches*, placed once on the surfaces of models, each boil down all indirect light (thousands of
//! virtual area lights from extended reflective shadow maps) to one diffuse and one glossy proxy light. Interpolating
//! the lights, not the colours, gives every pixel diffuse and glossy indirect light: fully dynamic, without temporal
//! history, without ray-tracing hardware. The method is Philipp Lensing's dissertation *LightSkin* (Ilmenau 2014).
//!
//! A frame is a list of stages, each one file in [`frame`] with its shader in `glsl/`:
//!
//! | # | stage | in -> out |
//! | --- | --- | --- |
//! | 1 | [`frame::gbuffer`] | scene, camera -> depth, normal, reflectances, emitted radiance |
//! | 2 | [`frame::direct`] | G-buffer, shadow maps -> radiance |
//! | 3 | [`frame::atlas`] | model caches, transforms -> caches in the world |
//! | 4 | [`frame::rsm`] | scene from each light -> virtual area lights (VALs) |
//! | 5 | [`frame::visible`] or [`frame::cells`], [`frame::cull`] | pixels -> visible vertices or cells -> live caches |
//! | 6 | [`frame::depth_images`], [`frame::gather`], [`frame::bounce`] | VALs x caches -> proxy lights |
//! | 7 | [`frame::occlude`] | discs of caches -> dimmed proxies |
//! | 8 | [`frame::interpolate`] | proxies -> indirect radiance per pixel |
//! | 11 | [`frame::composite`] | all radiance, exposure, tone map -> picture |
//!
//! Stages 9 and 10 (subsurface scattering) keep their numbers and are yet to come.
//!
//! ```no_run
//! use lightskin::frame::{Frame, SceneBuffers, Settings, View};
//! use lightskin::{bake, gpu, image, scene};
//!
//! fn main() -> lightskin::Result<()> {
//!     let mut scene = scene::gltf::load("scene.glb".as_ref())?;
//!     scene::defaults::complete(&mut scene); // a camera and a light, if it has none
//!
//!     let density = bake::Density::Count(1000);
//!     let caches = bake::bake(&scene, &bake::Settings { density, angle: 1.0, references: 8 }, &|_, _| {})?;
//!
//!     let gpu = gpu::Gpu::new(&gpu::Options::default())?;
//!     let settings = Settings { size: [640, 360], ..Settings::default() };
//!     let buffers = SceneBuffers::new(&gpu, &scene, Some(&caches))?;
//!     let frame = Frame::new(&gpu, &scene, &buffers, &settings)?;
//!     let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
//!     let drawn = gpu.frame(false, |cmd| {
//!         frame.record(cmd, &buffers, &view);
//!         Ok(())
//!     })?;
//!     gpu.times(&drawn)?; // waits, and gives the milliseconds of each stage
//!     image::write_png("picture.png".as_ref(), 640, 360, &gpu.read_image(&frame.targets.output)?)
//! }
//! ```
//!
//! The engine alone is what default features off leave: [`gpu`], [`scene`], [`bake`], [`frame`], and the f64 twins of its
//! shaders in [`reference`]. Feature `exr` adds OpenEXR files, `compare` adds `metrics`, `lab` what measures the engine, and
//! `cli` the command line.

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
    //! Structs and constants that host and shaders share; written in `glsl/shared.glsl`.
    include!(concat!(env!("OUT_DIR"), "/shared.rs"));
}

pub use error::{Error, Result};
