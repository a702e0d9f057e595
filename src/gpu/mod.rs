//! A small, explicit layer over Vulkan: `Device` (creates everything, on any thread), `Gpu` (its queue and frames), `Buffer`, `Image`, `Pipeline`, `Cmd`.
//!
//! This layer knows nothing about light. It uses only Vulkan 1.3 core, so that software devices run the same code as
//! desktop GPUs. All unsafe code of the crate is in this folder.
#![allow(unsafe_code, reason = "Vulkan is called from here and only from here")]

mod bind;
mod buffer;
mod cmd;
mod codegen;
mod copy;
mod descriptors;
mod device;
mod disk;
mod draw;
mod faults;
mod frames;
mod graveyard;
mod hazards;
mod image;
mod instance;
mod layout;
mod memory;
mod missing;
mod pipeline;
mod raster;
mod readback;
mod recipe;
mod reflect;
mod registry;
#[cfg(feature = "glsl")]
mod reload;
mod sampler;
mod spirv;
#[cfg(feature = "app")]
mod swapchain;
mod timer;
mod upload;

pub use ash::vk::Format;
pub use bind::Bind;
pub use buffer::Buffer;
pub use cmd::Cmd;
pub use codegen::{Codegen, Compiled};
pub use device::{Device, Gpu, Host, Options};
pub use draw::{Attach, Attachments, Draw, Load};
pub use faults::Call;
pub use frames::Frame;
pub use hazards::Use;
pub use image::{Extent, Image, ImageDesc, SAMPLES};
pub use instance::{DeviceReport, Needs, Validation, devices};
#[cfg(feature = "app")]
pub use memory::{give_memory_back, trim_memory};
pub use missing::Missing;
pub use pipeline::Pipeline;
pub(crate) use pipeline::shader;
pub use raster::{Attribute, Blend, Cull, Depth, Raster, Shape, Stream};
pub use readback::Readback;
pub use registry::{Counters, ResourceInfo, ResourceKind};
#[cfg(feature = "glsl")]
pub use reload::ShaderFolder;
pub use sampler::SamplerKind;
#[cfg(feature = "app")]
pub use swapchain::{Present, Swapchain};
pub use timer::{FrameTimes, Span, StageTime, Work, ZoneTime, nearest_rank, ticks_between};

use crate::error::Error;

/// The error of a failed submission. What was new on the device is forgotten with it, so that nothing there can be trusted
/// any more: whatever the reason, it is a loss of the device.
pub(crate) fn forgotten(what: &'static str) -> impl FnOnce(ash::vk::Result) -> Error {
    move |result| {
        log::debug!("{what}: {result}");
        Error::DeviceLost { what: what.to_owned() }
    }
}

/// Adds a description of the failed operation to a Vulkan result.
pub(crate) fn vulkan(what: impl Into<String>) -> impl FnOnce(ash::vk::Result) -> Error {
    move |result| {
        let what = what.into();
        let result = match result {
            ash::vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => {
                "out of device memory; use a smaller window, picture, RSM or shadow map, or fewer caches".to_owned()
            }
            ash::vk::Result::ERROR_OUT_OF_HOST_MEMORY => "out of memory".to_owned(),
            ash::vk::Result::ERROR_DEVICE_LOST => return Error::DeviceLost { what },
            other => format!("{other}"),
        };
        Error::Vulkan { what, result }
    }
}
