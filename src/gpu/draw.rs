//! Rendering scopes: what is drawn to, and the draws inside.

use super::bind::Bind;
use super::cmd::Cmd;
use super::hazards::Use;
use super::{Buffer, Image, Pipeline};
use ash::vk;

/// What an attachment holds when rendering begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load {
    /// What it held before.
    Keep,
    /// This value.
    Clear([f32; 4]),
    /// What it held before; it is only tested against and stays so (depth alone).
    ReadOnly,
}

/// One image to render into.
#[derive(Clone, Copy)]
pub struct Attach<'a> {
    /// The image.
    pub image: &'a Image,
    /// What it holds at first.
    pub load: Load,
}

impl<'a> Attach<'a> {
    /// As it was.
    pub fn keep(image: &'a Image) -> Self {
        Self { image, load: Load::Keep }
    }
    /// Cleared to zero.
    pub fn clear(image: &'a Image) -> Self {
        Self { image, load: Load::Clear([0.0; 4]) }
    }
}

/// Where a rendering scope draws to.
#[derive(Clone, Copy)]
pub struct Attachments<'a> {
    /// Colour attachments, in location order.
    pub colors: &'a [Attach<'a>],
    /// Depth attachment.
    pub depth: Option<Attach<'a>>,
    /// Left, top, width and height [pixels]; clearing and drawing stay inside.
    pub area: [u32; 4],
}

/// An open rendering scope.
pub struct Draw<'c, 'g> {
    pub(super) cmd: &'c Cmd<'g>,
}

impl Draw<'_, '_> {
    /// See `Cmd::bind`.
    pub fn bind(&self, pipeline: &Pipeline, resources: &[Bind<'_>]) {
        self.cmd.bind(pipeline, resources);
    }

    /// See `Cmd::push`.
    pub fn push<T: bytemuck::NoUninit>(&self, constants: &T) {
        self.cmd.push(constants);
    }

    /// Vertex buffers with byte offsets, in stream order.
    pub fn vertices(&self, buffers: &[(&Buffer, u64)]) {
        for (binding, (buffer, offset)) in buffers.iter().enumerate() {
            self.cmd.touch_buffer(buffer, Use::VertexInput);
            // SAFETY: the buffer is alive and made with vertex usage.
            unsafe {
                self.cmd.gpu.shared.device.cmd_bind_vertex_buffers(
                    self.cmd.buffer,
                    binding as u32,
                    &[buffer.handle],
                    &[*offset],
                );
            }
        }
    }

    /// Index buffer of u32 with a byte offset. It holds what never changes, so the barrier check skips it.
    pub fn indices(&self, buffer: &Buffer, offset: u64) {
        // SAFETY: the buffer is alive and made with index usage.
        unsafe {
            self.cmd.gpu.shared.device.cmd_bind_index_buffer(
                self.cmd.buffer,
                buffer.handle,
                offset,
                vk::IndexType::UINT32,
            )
        };
    }

    /// Part of the attachments that is drawn to: left, top, width and height [pixels].
    pub fn area(&self, [x, y, width, height]: [u32; 4]) {
        let device = &self.cmd.gpu.shared.device;
        let viewport = vk::Viewport {
            x: x as f32,
            y: y as f32,
            width: width as f32,
            height: height as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        };
        let offset = vk::Offset2D { x: x as i32, y: y as i32 };
        // SAFETY: viewport and scissor are dynamic in all our pipelines; the scope's own area contains this one.
        unsafe {
            device.cmd_set_viewport(self.cmd.buffer, 0, &[viewport]);
            device.cmd_set_scissor(
                self.cmd.buffer,
                0,
                &[vk::Rect2D { offset, extent: vk::Extent2D { width, height } }],
            );
        }
    }

    /// Whether counter-clockwise triangles show their front; false for mirrored instances.
    pub fn front_is_ccw(&self, ccw: bool) {
        let face = if ccw { vk::FrontFace::COUNTER_CLOCKWISE } else { vk::FrontFace::CLOCKWISE };
        // SAFETY: front face is dynamic in all our pipelines.
        unsafe { self.cmd.gpu.shared.device.cmd_set_front_face(self.cmd.buffer, face) };
    }

    /// Draws vertices without buffers: 3 for the triangle that covers the screen, or points.
    pub fn draw(&self, vertex_count: u32) {
        if self.cmd.failed() {
            return;
        }
        // SAFETY: pipeline and descriptors are bound; the shader makes its vertices from their index.
        unsafe { self.cmd.gpu.shared.device.cmd_draw(self.cmd.buffer, vertex_count, 1, 0, 0) };
    }

    /// Draws triangles from the bound buffers.
    pub fn draw_indexed(&self, index_count: u32, first_index: u32) {
        if self.cmd.failed() {
            return;
        }
        // SAFETY: pipeline, descriptors, vertex and index buffers are bound; the loader checked the indices.
        unsafe { self.cmd.gpu.shared.device.cmd_draw_indexed(self.cmd.buffer, index_count, 1, first_index, 0, 0) };
    }
}
