//! Content of new buffers and textures. It waits in host memory; the next frame or read-back copies it first. So any
//! thread can fill new resources, without waiting for the device.

use super::Image;
use super::buffer::Buffer;
use super::copy::region;
use super::device::{Device, Shared};
use super::faults::Call;
use super::graveyard::{Remains, lock};
use super::vulkan;
use crate::error::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

/// Content that waits for a submission.
pub(super) struct Upload {
    /// Identity of the resource that it belongs to.
    pub(super) id: u64,
    from: vk::Buffer,
    memory: Allocation,
    to: Target,
}

/// Where the content belongs.
pub(super) enum Target {
    /// The start of a buffer: this many bytes.
    Buffer(vk::Buffer, u64),
    /// All levels of a texture.
    Texture(vk::Image, Vec<vk::BufferImageCopy>),
}

impl Device {
    /// Fills the start of a new buffer.
    pub(super) fn upload_to_buffer(&self, to: &Buffer, bytes: &[u8]) -> Result<()> {
        self.upload(to.id, &[bytes], Target::Buffer(to.handle, bytes.len() as u64))
    }

    /// Fills all levels of a new texture, which are as long as the texture requires.
    pub(super) fn upload_to_texture(&self, to: &Image, levels: &[Vec<u8>]) -> Result<()> {
        let mut offset = 0;
        let regions = levels.iter().enumerate().map(|(mip, level)| {
            let here = region(to, mip as u32, offset);
            offset += level.len() as u64;
            here
        });
        let target = Target::Texture(to.handle, regions.collect());
        self.upload(to.id, &levels.iter().map(Vec::as_slice).collect::<Vec<_>>(), target)
    }

    fn upload(&self, id: u64, parts: &[&[u8]], to: Target) -> Result<()> {
        self.shared.check_lost(Call::Copy).map_err(vulkan("upload"))?;
        let size = parts.iter().map(|part| part.len() as u64).sum();
        // The system's memory, even where the device's is visible to the host: it is needed only once.
        let (from, mut memory) = self.shared.raw_buffer("upload", size, MemoryLocation::GpuToCpu)?;
        let mut bytes = memory.mapped_slice_mut().expect("host-visible memory");
        for part in parts {
            let (here, rest) = bytes.split_at_mut(part.len());
            here.copy_from_slice(part);
            bytes = rest;
        }
        lock(&self.shared.graveyard).uploads.push(Upload { id, from, memory, to });
        Ok(())
    }
}

impl Upload {
    /// The copy to record, and what is left of the upload after it.
    pub(super) fn split(self) -> ((vk::Buffer, Target), Remains) {
        let Self { from, memory, to, .. } = self;
        ((from, to), Remains::Buffer { handle: from, texels: None, memory: Some(memory) })
    }
}

impl Shared {
    /// Records copies of new content, and makes it visible to all later commands.
    ///
    /// # Safety
    /// `commands` must be recording. Sources and targets must live until their submission is done, and new images must
    /// be in layout GENERAL by then.
    pub(super) unsafe fn copy_new(&self, commands: vk::CommandBuffer, copies: &[(vk::Buffer, Target)]) {
        if copies.is_empty() {
            return;
        }
        for (from, to) in copies {
            // SAFETY: as promised; a source holds all that its target receives, and both allow transfers.
            unsafe {
                match to {
                    Target::Buffer(buffer, size) => {
                        let regions = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: *size }];
                        self.device.cmd_copy_buffer(commands, *from, *buffer, &regions);
                    }
                    Target::Texture(image, regions) => {
                        let general = vk::ImageLayout::GENERAL;
                        self.device.cmd_copy_buffer_to_image(commands, *from, *image, general, regions);
                    }
                }
            }
        }
        let barriers = [vk::MemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
            .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)];
        // SAFETY: as promised.
        unsafe {
            self.device.cmd_pipeline_barrier2(commands, &vk::DependencyInfo::default().memory_barriers(&barriers));
        }
    }
}
