//! Images that know their name, size and format and free themselves.

use super::device::Shared;
use super::graveyard::Remains;
use super::registry::ResourceKind;
use super::{Device, vulkan};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use std::sync::Arc;

/// An image: a render target, shadow map, texture or volume. The first submission after its creation transitions it to
/// layout GENERAL, in which it stays.
pub struct Image {
    pub(super) shared: Arc<Shared>,
    allocation: Option<Allocation>,
    pub(super) handle: vk::Image,
    /// View of the whole image, for shaders.
    pub(super) view: vk::ImageView,
    /// One view per layer for rendering, if there are several layers.
    layers: Vec<vk::ImageView>,
    pub(super) id: u64,
    /// A private copy of the creation parameters, on which unsafe code relies.
    pub(super) made: Made,
    /// `stage.thing`, as validation messages and captures show it.
    pub name: String,
    /// Texel format.
    pub format: vk::Format,
    /// Width \[texels\].
    pub width: u32,
    /// Height \[texels\].
    pub height: u32,
}

/// Arrangement of an image's texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// A plane; `sampler2D` and `image2D` in shaders.
    Plane,
    /// This many planes; `sampler2DArray` and `image2DArray` in shaders. Each layer can be rendered into.
    Layers(u32),
    /// A volume of this depth \[texels\]; `sampler3D` and `image3D` in shaders. It cannot be rendered into.
    Volume(u32),
    /// A plane with `SAMPLES` samples per texel; `sampler2DMS` in shaders. It can only be rendered into.
    Samples,
}

/// Samples per texel of a multisampled image. All devices have this number for depth and formats of floats.
pub const SAMPLES: u32 = 4;

/// Description of an image.
#[derive(Clone, Copy, Debug)]
pub struct ImageDesc<'a> {
    /// `stage.thing`.
    pub name: &'a str,
    /// Texel format.
    pub format: vk::Format,
    /// Width and height \[texels\].
    pub size: [u32; 2],
    /// Arrangement of the texels.
    pub extent: Extent,
    /// Whether shaders write it as a storage image (`image2D` and similar).
    pub storage: bool,
}

/// Creation parameters on which unsafe code relies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Made {
    pub(super) format: vk::Format,
    pub(super) size: [u32; 2],
    pub(super) extent: Extent,
    pub(super) mips: u32,
    pub(super) usage: vk::ImageUsageFlags,
}

impl Made {
    /// Number of layers.
    pub(super) fn layers(self) -> u32 {
        if let Extent::Layers(layers) = self.extent { layers } else { 1 }
    }

    /// Depth \[texels\].
    pub(super) fn depth(self) -> u32 {
        if let Extent::Volume(depth) = self.extent { depth } else { 1 }
    }

    /// Number of samples per texel.
    pub(super) fn samples(self) -> u32 {
        if self.extent == Extent::Samples { SAMPLES } else { 1 }
    }

    /// Width, height and depth of a mip level.
    pub(super) fn level(self, mip: u32) -> vk::Extent3D {
        let [width, height, depth] = [self.size[0], self.size[1], self.depth()].map(|n| (n >> mip).max(1));
        vk::Extent3D { width, height, depth }
    }

    /// Size of a mip level with all layers \[bytes\].
    pub(super) fn level_bytes(self, mip: u32) -> u64 {
        let vk::Extent3D { width, height, depth } = self.level(mip);
        [width, height, depth, self.layers(), self.samples()].into_iter().map(u64::from).product::<u64>()
            * texel_bytes(self.format)
    }

    /// View type in shaders.
    pub(super) fn view_type(self) -> vk::ImageViewType {
        match self.extent {
            Extent::Plane | Extent::Samples => vk::ImageViewType::TYPE_2D,
            Extent::Layers(_) => vk::ImageViewType::TYPE_2D_ARRAY,
            Extent::Volume(_) => vk::ImageViewType::TYPE_3D,
        }
    }

    /// Kind of image that a shader must declare: view type, and whether texels have many samples.
    pub(super) fn seen(self) -> (vk::ImageViewType, bool) {
        (self.view_type(), self.samples() > 1)
    }

    /// The whole image.
    pub(super) fn range(self) -> vk::ImageSubresourceRange {
        vk::ImageSubresourceRange {
            aspect_mask: aspect(self.format),
            base_mip_level: 0,
            level_count: self.mips,
            base_array_layer: 0,
            layer_count: self.layers(),
        }
    }
}

impl Device {
    /// Creates a render target that shaders can also read.
    ///
    /// # Errors
    /// Fails if size or format exceed the device's limits, or the device runs out of memory.
    pub fn target(&self, name: &str, format: vk::Format, width: u32, height: u32) -> Result<Image> {
        self.image(&ImageDesc { name, format, size: [width, height], extent: Extent::Plane, storage: false })
    }

    /// Creates an image that is rendered into or written by shaders, and read by other passes.
    ///
    /// # Errors
    /// Fails if the size exceeds the device's limits, the format does not support this use, or the device runs out of
    /// memory.
    pub fn image(&self, desc: &ImageDesc<'_>) -> Result<Image> {
        let mut usage = vk::ImageUsageFlags::SAMPLED;
        if desc.extent != Extent::Samples {
            usage |= vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        }
        usage |= match desc.extent {
            Extent::Volume(_) => vk::ImageUsageFlags::empty(),
            _ if is_depth(desc.format) => vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT,
            _ => vk::ImageUsageFlags::COLOR_ATTACHMENT,
        };
        if desc.storage {
            let single = desc.extent != Extent::Samples;
            assert!(single, "{}: multisampled images are not storage images", desc.name);
            usage |= vk::ImageUsageFlags::STORAGE;
        }
        let ImageDesc { name, format, size, extent, .. } = *desc;
        self.make_image(name, Made { format, size, extent, mips: 1, usage })
    }

    /// Creates a sampled texture from all its mip levels, largest first, tightly packed.
    ///
    /// # Errors
    /// Fails if size or format exceed the device's limits, or the device runs out of memory.
    pub fn texture(
        &self,
        name: &str,
        format: vk::Format,
        width: u32,
        height: u32,
        levels: &[Vec<u8>],
    ) -> Result<Image> {
        let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST;
        let made = Made { format, size: [width, height], extent: Extent::Plane, mips: levels.len() as u32, usage };
        let most = width.max(height).max(1).ilog2() + 1;
        assert!((1..=most).contains(&made.mips), "{name}: {} levels of {width}x{height} texels", made.mips);
        for (mip, level) in levels.iter().enumerate() {
            let bytes = made.level_bytes(mip as u32);
            assert!(level.len() as u64 == bytes, "{name}: level {mip} has {} bytes, not {bytes}", level.len());
        }
        let image = self.make_image(name, made)?;
        self.upload_to_texture(&image, levels)?;
        Ok(image)
    }

    /// Rejects images that the device cannot create.
    fn check_image(&self, name: &str, made: Made, kind: vk::ImageType) -> Result<()> {
        // Unknown formats panic before the driver sees them.
        texel_bytes(made.format);
        let [width, height] = made.size;
        let (layers, depth) = (made.layers(), made.depth());
        assert!(width.min(height).min(layers).min(depth) > 0, "image {name}: {width}x{height}, {:?}", made.extent);
        let limits = &self.shared.limits;
        let limit =
            if kind == vk::ImageType::TYPE_3D { limits.max_image_dimension3_d } else { limits.max_image_dimension2_d };
        if width.max(height).max(depth) > limit {
            let depth = if depth > 1 { format!("x{depth}") } else { String::new() };
            return Err(self.too_large(format!("image {name} needs {width}x{height}{depth} texels"), limit.into()));
        }
        if layers > limits.max_image_array_layers {
            let most = limits.max_image_array_layers.into();
            return Err(self.too_large(format!("image {name} needs {layers} layers"), most));
        }
        // SAFETY: plain query of a live instance and its device.
        let supported = unsafe {
            self.shared.instance.instance.get_physical_device_image_format_properties(
                self.shared.physical,
                made.format,
                kind,
                vk::ImageTiling::OPTIMAL,
                made.usage,
                vk::ImageCreateFlags::empty(),
            )
        };
        let what = || format!("image {name} of {:?} for {:?}", made.format, made.usage);
        let supported = supported.map_err(|result| Error::Vulkan { what: what(), result: result.to_string() })?;
        if !supported.sample_counts.contains(count(made.samples())) {
            let result = format!("the device lacks {} samples", made.samples());
            return Err(Error::Vulkan { what: what(), result });
        }
        Ok(())
    }

    /// What the device can do with a format.
    pub(super) fn uses_of(&self, format: vk::Format) -> vk::FormatProperties {
        let shared = &self.shared;
        // SAFETY: plain query of a live instance and its device.
        unsafe { shared.instance.instance.get_physical_device_format_properties(shared.physical, format) }
    }

    fn make_image(&self, name: &str, made: Made) -> Result<Image> {
        let device = &self.shared.device;
        let (format, [width, height]) = (made.format, made.size);
        let what = || format!("image {name} {width}x{height} {format:?}");
        let kind = if let Extent::Volume(_) = made.extent { vk::ImageType::TYPE_3D } else { vk::ImageType::TYPE_2D };
        self.check_image(name, made, kind)?;
        let info = vk::ImageCreateInfo::default()
            .image_type(kind)
            .format(format)
            .extent(made.level(0))
            .mip_levels(made.mips)
            .array_layers(made.layers())
            .samples(count(made.samples()))
            .usage(made.usage);
        // SAFETY: the device is alive; the handle is destroyed in `Drop`.
        let handle = unsafe { device.create_image(&info, None) }.map_err(vulkan(what()))?;
        self.shared.name(handle, name);
        let mut image = Image {
            shared: self.shared.clone(),
            allocation: None,
            handle,
            view: vk::ImageView::null(),
            layers: Vec::new(),
            id: self.shared.new_id(),
            made,
            name: name.to_owned(),
            format,
            width,
            height,
        };
        // SAFETY: plain query of a live image.
        let requirements = unsafe { device.get_image_memory_requirements(handle) };
        let allocation = self.shared.allocate(name, requirements, MemoryLocation::GpuOnly, false)?;
        // SAFETY: fresh memory of the right kind and size; bound once.
        unsafe { device.bind_image_memory(handle, allocation.memory(), allocation.offset()) }
            .map_err(vulkan(what()))?;
        image.allocation = Some(allocation);
        let view = |view_type, subresource_range, name: &str| -> Result<vk::ImageView> {
            let info = vk::ImageViewCreateInfo::default()
                .image(handle)
                .view_type(view_type)
                .format(format)
                .subresource_range(subresource_range);
            // SAFETY: the image is bound; the view is destroyed in `Drop`.
            let view = unsafe { device.create_image_view(&info, None) }.map_err(vulkan(what()))?;
            self.shared.name(view, name);
            Ok(view)
        };
        image.view = view(made.view_type(), made.range(), name)?;
        if let Extent::Layers(layers) = made.extent {
            for layer in 0..layers {
                let range = vk::ImageSubresourceRange { base_array_layer: layer, layer_count: 1, ..made.range() };
                image.layers.push(view(vk::ImageViewType::TYPE_2D, range, &format!("{name} {layer}"))?);
            }
        }
        self.shared.register(image.id, name, ResourceKind::Image, image.bytes());
        self.shared.freshly_made(handle, image.id, made.range());
        Ok(image)
    }
}

impl Image {
    /// Device memory of the image \[bytes\], as reported by `info` and the frame plan.
    pub fn bytes(&self) -> u64 {
        (0..self.made.mips).map(|mip| self.made.level_bytes(mip)).sum()
    }

    /// The view for rendering into a layer.
    pub(super) fn layer(&self, layer: u32) -> vk::ImageView {
        let name = &self.name;
        let drawn = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT;
        assert!(self.made.usage.intersects(drawn), "{name}: it was not made to be rendered into");
        assert!(layer < self.made.layers(), "{name}: layer {layer} of {}", self.made.layers());
        self.layers.get(layer as usize).copied().unwrap_or(self.view)
    }
}

/// Size of a texel \[bytes\], for the formats that the engine uses.
pub(crate) fn texel_bytes(format: vk::Format) -> u64 {
    match format {
        vk::Format::R32G32B32A32_SFLOAT | vk::Format::R32G32B32A32_UINT => 16,
        vk::Format::R16G16B16A16_SFLOAT | vk::Format::R32G32_SFLOAT | vk::Format::R32G32_UINT => 8,
        vk::Format::R8G8B8A8_UNORM | vk::Format::R8G8B8A8_SRGB | vk::Format::D32_SFLOAT | vk::Format::R32_SFLOAT => 4,
        vk::Format::R32_UINT => 4,
        other => panic!("images of format {other:?} are not supported"),
    }
}

/// A number of samples per texel, as Vulkan's flag.
pub(super) fn count(samples: u32) -> vk::SampleCountFlags {
    vk::SampleCountFlags::from_raw(samples)
}

pub(crate) fn is_depth(format: vk::Format) -> bool {
    format == vk::Format::D32_SFLOAT
}

pub(crate) fn aspect(format: vk::Format) -> vk::ImageAspectFlags {
    if is_depth(format) { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR }
}

impl Drop for Image {
    fn drop(&mut self) {
        self.shared.unregister(self.id);
        let views = std::iter::once(self.view).chain(self.layers.drain(..)).collect();
        let (handle, memory) = (self.handle, self.allocation.take());
        self.shared.bury(self.id, Remains::Image { handle, views, memory });
    }
}
