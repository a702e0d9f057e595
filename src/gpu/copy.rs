//! Commands that copy, fill and update.

use super::cmd::Cmd;
use super::hazards::Use;
use super::image::{Extent, aspect, is_depth, texel_bytes};
use super::{Buffer, Image};
use ash::vk;

impl Cmd<'_> {
    /// Copies the first `size` bytes of a buffer to another.
    pub fn copy_buffer(&self, from: &Buffer, to: &Buffer, size: u64) {
        if self.failed() {
            return;
        }
        self.outside("a copy");
        assert!(size > 0 && size <= from.held.min(to.held), "{size} bytes from {} to {}", from.name, to.name);
        assert!(from.id != to.id, "{}: copied onto itself", from.name);
        self.touch_buffer(from, Use::CopyRead);
        self.touch_buffer(to, Use::CopyWrite);
        let regions = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size }];
        // SAFETY: both are alive, at least `size` long, and not the same.
        unsafe { self.gpu.shared.device.cmd_copy_buffer(self.buffer, from.handle, to.handle, &regions) };
    }

    /// Fills a buffer with zeros.
    pub fn clear(&self, buffer: &Buffer) {
        if self.failed() {
            return;
        }
        self.outside("a fill");
        self.touch_buffer(buffer, Use::CopyWrite);
        // SAFETY: the buffer is alive and made with transfer usage.
        unsafe { self.gpu.shared.device.cmd_fill_buffer(self.buffer, buffer.handle, 0, vk::WHOLE_SIZE, 0) };
    }

    /// Writes into a buffer through the command buffer, for data that changes from frame to frame.
    pub fn update<T: bytemuck::NoUninit>(&self, to: &Buffer, first_byte: u64, data: &[T]) {
        /// Maximum size of one such command \[bytes\].
        const MOST: usize = 65_536;
        let bytes: &[u8] = bytemuck::cast_slice(data);
        assert!(first_byte.is_multiple_of(4) && bytes.len().is_multiple_of(4), "{}: whole words", to.name);
        let inside = first_byte.checked_add(bytes.len() as u64).is_some_and(|end| end <= to.held);
        assert!(inside, "{}: {} bytes at {first_byte}", to.name, bytes.len());
        if self.failed() || bytes.is_empty() {
            return;
        }
        self.outside("an update");
        self.touch_buffer(to, Use::CopyWrite);
        for (i, part) in bytes.chunks(MOST).enumerate() {
            let offset = first_byte + (i * MOST) as u64;
            // SAFETY: the buffer is alive; offset and size are whole words and lie within it by the assertions above.
            unsafe { self.gpu.shared.device.cmd_update_buffer(self.buffer, to.handle, offset, part) };
        }
    }

    /// Copies an image, tightly packed, into a buffer.
    pub fn copy_image_to_buffer(&self, from: &Image, to: &Buffer) {
        self.copy_region(from, to, from.made.level_bytes(0), region(from, 0, 0));
    }

    /// Copies one texel of the first layer, given by column and row, to the start of a buffer.
    pub(crate) fn copy_texel_to_buffer(&self, from: &Image, at: [u32; 2], to: &Buffer) {
        let ([x, y], [width, height]) = (at, from.made.size);
        assert!(x < width && y < height, "{}: texel {x}, {y} of {width}x{height}", from.name);
        let here = region(from, 0, 0);
        let here = vk::BufferImageCopy {
            image_offset: vk::Offset3D { x: x as i32, y: y as i32, z: 0 },
            image_extent: vk::Extent3D { width: 1, height: 1, depth: 1 },
            image_subresource: vk::ImageSubresourceLayers { layer_count: 1, ..here.image_subresource },
            ..here
        };
        self.copy_region(from, to, texel_bytes(from.made.format), here);
    }

    /// Copies a region of an image, with a size of `bytes`, into a buffer.
    fn copy_region(&self, from: &Image, to: &Buffer, bytes: u64, region: vk::BufferImageCopy) {
        if self.failed() {
            return;
        }
        self.outside("a copy");
        assert!(bytes <= to.held, "{}: {bytes} bytes into {}, which has {}", from.name, to.name, to.held);
        let readable = from.made.usage.contains(vk::ImageUsageFlags::TRANSFER_SRC);
        assert!(readable, "{}: textures and multisampled images are not read back", from.name);
        self.touch_image(from, Use::CopyRead);
        self.touch_buffer(to, Use::CopyWrite);
        // SAFETY: the region lies within the image, which is in GENERAL, and the buffer has room for its texels.
        unsafe {
            self.gpu.shared.device.cmd_copy_image_to_buffer(
                self.buffer,
                from.handle,
                vk::ImageLayout::GENERAL,
                to.handle,
                &[region],
            );
        }
    }

    /// Copies an image bit by bit into another with texels of the same size, at left and top \[pixels\].
    pub fn copy_image(&self, from: &Image, to: &Image, at: [u32; 2]) {
        self.copy_part(from, [0, 0], from.made.size, to, at);
    }

    /// Copies a part of an image, given by its corner and size \[pixels\], to a corner in another image.
    pub(crate) fn copy_part(&self, from: &Image, first: [u32; 2], size: [u32; 2], to: &Image, at: [u32; 2]) {
        if self.failed() {
            return;
        }
        self.outside("a copy");
        let holds = |image: &Image, corner: [u32; 2]| {
            (0..2).all(|i| u64::from(corner[i]) + u64::from(size[i]) <= u64::from(image.made.size[i]))
        };
        assert!(holds(from, first) && holds(to, at), "{} to {}: {size:?} texels at {at:?}", from.name, to.name);
        assert!(from.id != to.id, "{}: copied onto itself", from.name);
        let (has, takes) = (from.made.format, to.made.format);
        let planes = [from, to].iter().all(|image| image.made.extent == Extent::Plane);
        let alike = has == takes || (!is_depth(has) && !is_depth(takes) && texel_bytes(has) == texel_bytes(takes));
        let usable = from.made.usage.contains(vk::ImageUsageFlags::TRANSFER_SRC);
        assert!(planes && alike && usable, "{} cannot be copied to {}", from.name, to.name);
        self.touch_image(from, Use::CopyRead);
        self.touch_image(to, Use::CopyWrite);
        let layers = vk::ImageSubresourceLayers { aspect_mask: aspect(has), layer_count: 1, ..Default::default() };
        let offset = |[x, y]: [u32; 2]| vk::Offset3D { x: x as i32, y: y as i32, z: 0 };
        let regions = [vk::ImageCopy {
            src_subresource: layers,
            src_offset: offset(first),
            dst_subresource: layers,
            dst_offset: offset(at),
            extent: vk::Extent3D { width: size[0], height: size[1], depth: 1 },
        }];
        let general = vk::ImageLayout::GENERAL;
        let device = &self.gpu.shared.device;
        // SAFETY: both are alive, in GENERAL and large enough, of one aspect, with texels of the same size; all planes
        // are made with transfer usage as target.
        unsafe { device.cmd_copy_image(self.buffer, from.handle, general, to.handle, general, &regions) };
    }
}

/// One level with all layers, tightly packed at an offset in a buffer.
pub(super) fn region(image: &Image, mip: u32, offset: u64) -> vk::BufferImageCopy {
    vk::BufferImageCopy {
        buffer_offset: offset,
        buffer_row_length: 0,
        buffer_image_height: 0,
        image_subresource: vk::ImageSubresourceLayers {
            aspect_mask: aspect(image.made.format),
            mip_level: mip,
            base_array_layer: 0,
            layer_count: image.made.layers(),
        },
        image_offset: vk::Offset3D::default(),
        image_extent: image.made.level(mip),
    }
}
