//! Buffers and images that know their name, size and format, and free themselves.

use super::device::Shared;
use super::graveyard::{Remains, lock};
use super::registry::ResourceKind;
use super::{Gpu, vulkan};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use gpu_allocator::{AllocationError, MemoryLocation};
use std::cell::OnceCell;
use std::sync::Arc;

/// A buffer. Device-local ones are filled once by upload or by shaders; host ones are written every frame or read back.
pub struct Buffer {
    shared: Arc<Shared>,
    allocation: Option<Allocation>,
    pub(crate) handle: vk::Buffer,
    /// The buffer as RGBA32F texels; made when a shader first reads it so.
    texels: OnceCell<vk::BufferView>,
    pub(crate) id: u64,
    /// `stage.thing`, as validation messages and captures show it.
    pub name: String,
    /// Size [bytes].
    pub size: u64,
}

/// An image: a render target, a shadow map or a texture. Always in layout GENERAL once a frame has begun.
pub struct Image {
    shared: Arc<Shared>,
    allocation: Option<Allocation>,
    pub(crate) handle: vk::Image,
    pub(crate) view: vk::ImageView,
    pub(crate) id: u64,
    /// `stage.thing`, as validation messages and captures show it.
    pub name: String,
    /// Texel format.
    pub format: vk::Format,
    /// Width [texels].
    pub width: u32,
    /// Height [texels].
    pub height: u32,
    pub(crate) mips: u32,
}

/// How a texture is filtered and wrapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SamplerKind {
    /// Wrapping along u and v.
    pub wrap: [vk::SamplerAddressMode; 2],
    /// Texels stay square when magnified.
    pub nearest: bool,
}

/// Every use a buffer of ours may be put to: one list, so that no buffer is refused a use it needs later.
const BUFFER_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::UNIFORM_BUFFER.as_raw()
        | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw()
        | vk::BufferUsageFlags::VERTEX_BUFFER.as_raw()
        | vk::BufferUsageFlags::INDEX_BUFFER.as_raw()
        | vk::BufferUsageFlags::INDIRECT_BUFFER.as_raw()
        | vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);

impl Shared {
    fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Allocation> {
        let desc = AllocationCreateDesc {
            name,
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let allocate = || lock(&self.allocator).as_mut().expect("alive").allocate(&desc);
        let mut allocation = allocate();
        if matches!(allocation, Err(AllocationError::OutOfMemory)) {
            // What was dropped may be enough.
            self.wait()?;
            self.collect();
            allocation = allocate();
        }
        allocation.map_err(|e| Error::Vulkan {
            what: format!("{name}: {} KiB", requirements.size / 1024),
            result: format!("{e}; ask for a smaller picture, RSM or shadow map, or for fewer caches"),
        })
    }

    pub(super) fn free(&self, allocation: Option<Allocation>) {
        if let Some(allocation) = allocation
            && let Some(allocator) = lock(&self.allocator).as_mut()
            && let Err(error) = allocator.free(allocation)
        {
            log::error!("freeing device memory: {error}");
        }
    }
}

impl Gpu {
    /// A device-local buffer; its content is undefined.
    pub fn buffer(&self, name: &str, size: u64) -> Result<Buffer> {
        self.make_buffer(name, size, MemoryLocation::GpuOnly)
    }

    /// A buffer that the CPU writes and the GPU reads.
    pub fn host_buffer(&self, name: &str, size: u64) -> Result<Buffer> {
        self.make_buffer(name, size, MemoryLocation::CpuToGpu)
    }

    /// A buffer that the GPU writes and the CPU reads.
    pub fn readback_buffer(&self, name: &str, size: u64) -> Result<Buffer> {
        self.make_buffer(name, size, MemoryLocation::GpuToCpu)
    }

    /// A device-local buffer that holds `data`; at least 16 bytes, so that an empty list can be bound.
    pub fn buffer_from<T: bytemuck::NoUninit>(&self, name: &str, data: &[T]) -> Result<Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.buffer(name, bytes.len().max(16) as u64)?;
        if !bytes.is_empty() {
            let mut staging = self.host_buffer("upload", bytes.len() as u64)?;
            staging.write(0, bytes);
            self.run_once("upload", |cmd| cmd.copy_buffer(&staging, &buffer, bytes.len() as u64))?;
        }
        Ok(buffer)
    }

    /// Reads a whole buffer back; waits for the device.
    pub fn read<T: bytemuck::Pod>(&self, buffer: &Buffer) -> Result<Vec<T>> {
        let back = self.readback_buffer("readback", buffer.size)?;
        self.run_once("readback", |cmd| cmd.copy_buffer(buffer, &back, buffer.size))?;
        Ok(bytemuck::pod_collect_to_vec(back.bytes()))
    }

    /// Reads an image back as tightly packed texels; waits for the device.
    pub fn read_image<T: bytemuck::Pod>(&self, image: &Image) -> Result<Vec<T>> {
        let size = u64::from(image.width) * u64::from(image.height) * texel_bytes(image.format);
        let back = self.readback_buffer("readback", size)?;
        self.run_once("readback", |cmd| cmd.copy_image_to_buffer(image, &back))?;
        Ok(bytemuck::pod_collect_to_vec(back.bytes()))
    }

    fn make_buffer(&self, name: &str, size: u64, location: MemoryLocation) -> Result<Buffer> {
        let device = &self.shared.device;
        if size > self.shared.max_buffer_size {
            return Err(self.too_large(format!("buffer {name} needs {size} bytes"), self.shared.max_buffer_size));
        }
        let info = vk::BufferCreateInfo::default().size(size.max(4)).usage(BUFFER_USAGE);
        let what = || format!("buffer {name}, {size} bytes");
        // SAFETY: the device is alive; the handle is destroyed in `Drop`.
        let handle = unsafe { device.create_buffer(&info, None) }.map_err(vulkan(what()))?;
        self.shared.name(handle, name);
        let mut buffer = Buffer {
            shared: self.shared.clone(),
            allocation: None,
            handle,
            texels: OnceCell::new(),
            id: self.shared.new_id(),
            name: name.to_owned(),
            size: size.max(4),
        };
        // SAFETY: plain query of a live buffer.
        let requirements = unsafe { device.get_buffer_memory_requirements(handle) };
        let allocation = self.shared.allocate(name, requirements, location, true)?;
        // SAFETY: fresh memory of the right kind and size; bound once.
        unsafe { device.bind_buffer_memory(handle, allocation.memory(), allocation.offset()) }
            .map_err(vulkan(what()))?;
        buffer.allocation = Some(allocation);
        let kind = if location == MemoryLocation::GpuOnly { ResourceKind::Buffer } else { ResourceKind::HostBuffer };
        self.shared.register(buffer.id, name, kind, buffer.size);
        Ok(buffer)
    }

    /// A render target that shaders can also read.
    pub fn target(&self, name: &str, format: vk::Format, width: u32, height: u32) -> Result<Image> {
        let attachment = if is_depth(format) {
            vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT
        } else {
            vk::ImageUsageFlags::COLOR_ATTACHMENT
        };
        let usage = attachment
            | vk::ImageUsageFlags::SAMPLED
            | vk::ImageUsageFlags::TRANSFER_SRC
            | vk::ImageUsageFlags::TRANSFER_DST;
        self.make_image(name, format, [width, height, 1], usage)
    }

    /// A sampled texture with all its mip levels given, largest first, tightly packed.
    pub fn texture(
        &self,
        name: &str,
        format: vk::Format,
        width: u32,
        height: u32,
        levels: &[Vec<u8>],
    ) -> Result<Image> {
        let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST;
        let image = self.make_image(name, format, [width, height, levels.len() as u32], usage)?;
        let mut staging = self.host_buffer("upload", levels.iter().map(|l| l.len() as u64).sum())?;
        let mut offset = 0;
        for level in levels {
            staging.write(offset, level);
            offset += level.len() as u64;
        }
        self.run_once("upload", |cmd| cmd.copy_buffer_to_texture(&staging, &image))?;
        Ok(image)
    }

    fn make_image(
        &self,
        name: &str,
        format: vk::Format,
        [width, height, mips]: [u32; 3],
        usage: vk::ImageUsageFlags,
    ) -> Result<Image> {
        let device = &self.shared.device;
        let what = || format!("image {name} {width}x{height} {format:?}");
        let limit = self.shared.limits.max_image_dimension2_d;
        if width.max(height) > limit {
            return Err(self.too_large(format!("image {name} needs {width}x{height} texels"), limit.into()));
        }
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(mips)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(usage);
        // SAFETY: the device is alive; the handle is destroyed in `Drop`.
        let handle = unsafe { device.create_image(&info, None) }.map_err(vulkan(what()))?;
        self.shared.name(handle, name);
        let mut image = Image {
            shared: self.shared.clone(),
            allocation: None,
            handle,
            view: vk::ImageView::null(),
            id: self.shared.new_id(),
            name: name.to_owned(),
            format,
            width,
            height,
            mips,
        };
        // SAFETY: plain query of a live image.
        let requirements = unsafe { device.get_image_memory_requirements(handle) };
        let allocation = self.shared.allocate(name, requirements, MemoryLocation::GpuOnly, false)?;
        // SAFETY: fresh memory of the right kind and size; bound once.
        unsafe { device.bind_image_memory(handle, allocation.memory(), allocation.offset()) }
            .map_err(vulkan(what()))?;
        image.allocation = Some(allocation);
        let range = vk::ImageSubresourceRange {
            aspect_mask: aspect(format),
            base_mip_level: 0,
            level_count: mips,
            base_array_layer: 0,
            layer_count: 1,
        };
        let info = vk::ImageViewCreateInfo::default()
            .image(handle)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(range);
        // SAFETY: the image is bound; the view is destroyed in `Drop`.
        image.view = unsafe { device.create_image_view(&info, None) }.map_err(vulkan(what()))?;
        self.shared.name(image.view, name);
        self.shared.register(image.id, name, ResourceKind::Image, image.bytes());
        Ok(image)
    }

    /// The buffer as RGBA32F texels of 16 bytes.
    pub(crate) fn texels(&self, buffer: &Buffer) -> Result<vk::BufferView> {
        if let Some(view) = buffer.texels.get() {
            return Ok(*view);
        }
        let limit = u64::from(self.shared.limits.max_texel_buffer_elements);
        if buffer.size / 16 > limit {
            return Err(self.too_large(format!("buffer {} needs {} texels", buffer.name, buffer.size / 16), limit));
        }
        let info = vk::BufferViewCreateInfo::default()
            .buffer(buffer.handle)
            .format(vk::Format::R32G32B32A32_SFLOAT)
            .range(buffer.size / 16 * 16);
        // SAFETY: the buffer is bound and made with texel usage; the view is destroyed before it, in `Drop`.
        let view = unsafe { self.shared.device.create_buffer_view(&info, None) }.map_err(vulkan("texel buffer"))?;
        self.shared.name(view, &buffer.name);
        Ok(*buffer.texels.get_or_init(|| view))
    }

    /// A resource beyond a limit of the device.
    pub(crate) fn too_large(&self, what: String, limit: u64) -> Error {
        Error::TooLarge(format!("{what}, but {} allows {limit}; ask for less of it", self.report().name))
    }

    /// The sampler of a kind; made on first use, kept as long as the device.
    pub(crate) fn sampler(&self, kind: SamplerKind) -> Result<vk::Sampler> {
        let mut samplers = self.samplers.borrow_mut();
        if let Some(sampler) = samplers.get(&kind) {
            return Ok(*sampler);
        }
        let filter = if kind.nearest { vk::Filter::NEAREST } else { vk::Filter::LINEAR };
        let info = vk::SamplerCreateInfo::default()
            .mag_filter(filter)
            .min_filter(filter)
            .mipmap_mode(if kind.nearest { vk::SamplerMipmapMode::NEAREST } else { vk::SamplerMipmapMode::LINEAR })
            .address_mode_u(kind.wrap[0])
            .address_mode_v(kind.wrap[1])
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .max_lod(vk::LOD_CLAMP_NONE);
        // SAFETY: the device is alive; destroyed when `Gpu` is dropped.
        let sampler = unsafe { self.shared.device.create_sampler(&info, None) }.map_err(vulkan("sampler"))?;
        self.shared.name(sampler, &format!("gpu.sampler {kind:?}"));
        samplers.insert(kind, sampler);
        Ok(sampler)
    }
}

impl Buffer {
    /// The bytes of a host-visible buffer.
    pub fn bytes(&self) -> &[u8] {
        let all = self.allocation.as_ref().and_then(Allocation::mapped_slice).expect("host-visible buffer");
        &all[..self.size as usize]
    }

    /// Writes into a host-visible buffer.
    pub fn write<T: bytemuck::NoUninit>(&mut self, offset: u64, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let all = self.allocation.as_mut().and_then(Allocation::mapped_slice_mut).expect("host-visible buffer");
        all[offset as usize..offset as usize + bytes.len()].copy_from_slice(bytes);
    }
}

impl Image {
    /// Device memory the image takes [bytes], as `info` and the frame plan state it.
    pub fn bytes(&self) -> u64 {
        (0..self.mips).map(|m| u64::from(self.width >> m).max(1) * u64::from(self.height >> m).max(1)).sum::<u64>()
            * texel_bytes(self.format)
    }
}

/// Bytes of one texel of the formats the engine uses.
pub(crate) fn texel_bytes(format: vk::Format) -> u64 {
    match format {
        vk::Format::R32G32B32A32_SFLOAT => 16,
        vk::Format::R16G16B16A16_SFLOAT | vk::Format::R32G32_SFLOAT | vk::Format::R32G32_UINT => 8,
        vk::Format::R8G8B8A8_UNORM | vk::Format::R8G8B8A8_SRGB | vk::Format::D32_SFLOAT | vk::Format::R32_SFLOAT => 4,
        other => unreachable!("{other:?} is not used here"),
    }
}

pub(crate) fn is_depth(format: vk::Format) -> bool {
    format == vk::Format::D32_SFLOAT
}

pub(crate) fn aspect(format: vk::Format) -> vk::ImageAspectFlags {
    if is_depth(format) { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        self.shared.unregister(self.id);
        let (handle, texels, memory) = (self.handle, self.texels.take(), self.allocation.take());
        self.shared.bury(self.id, Remains::Buffer { handle, texels, memory });
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        self.shared.unregister(self.id);
        let (handle, views, memory) = (self.handle, vec![self.view], self.allocation.take());
        self.shared.bury(self.id, Remains::Image { handle, views, memory });
    }
}
