//! Rendering scopes: attachments, and the draws inside.

use super::bind::Bind;
use super::cmd::Cmd;
use super::hazards::Use;
use super::image::is_depth;
use super::{Buffer, Image, Pipeline};
use ash::vk;

/// Content of an attachment when rendering begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load {
    /// The previous content.
    Keep,
    /// This value.
    Clear([f32; 4]),
    /// The previous content, used only for tests and not changed (depth only).
    ReadOnly,
}

/// One image to render into.
#[derive(Clone, Copy)]
pub struct Attach<'a> {
    /// The image.
    pub image: &'a Image,
    /// Its content at the start.
    pub load: Load,
}

impl<'a> Attach<'a> {
    /// Keeps the previous content.
    pub fn keep(image: &'a Image) -> Self {
        Self { image, load: Load::Keep }
    }
    /// Clears to zero.
    pub fn clear(image: &'a Image) -> Self {
        Self { image, load: Load::Clear([0.0; 4]) }
    }
}

/// Targets of a rendering scope.
#[derive(Clone, Copy)]
pub struct Attachments<'a> {
    /// Colour attachments, in location order.
    pub colors: &'a [Attach<'a>],
    /// Depth attachment.
    pub depth: Option<Attach<'a>>,
    /// Left, top, width and height \[pixels\]. Clearing and drawing stay inside.
    pub area: [u32; 4],
}

/// State of the open rendering scope.
pub(super) struct Scope {
    pub(super) colors: Vec<vk::Format>,
    pub(super) depth: bool,
    /// Whether all attachments are multisampled.
    pub(super) multisampled: bool,
    /// Depth is only tested, not written.
    pub(super) read_only: bool,
    area: [u32; 4],
    pub(super) pipeline: Option<Pipeline>,
    /// Bytes available in each bound vertex buffer, from its offset on.
    vertices: Vec<u64>,
    /// Indices available in the bound index buffer, from its offset on.
    indices: u64,
}

impl<'g> Cmd<'g> {
    /// Opens a rendering scope and draws.
    pub fn render(&self, attachments: &Attachments<'_>, draw: impl FnOnce(&Draw<'_, 'g>)) {
        self.render_layer(0, attachments, draw);
    }

    /// Opens a rendering scope for this layer of every attachment and draws.
    pub fn render_layer(&self, layer: u32, attachments: &Attachments<'_>, draw: impl FnOnce(&Draw<'_, 'g>)) {
        if self.failed() {
            return;
        }
        self.outside("a rendering scope");
        let [x, y, width, height] = attachments.area;
        for Attach { image, .. } in attachments.colors.iter().chain(&attachments.depth) {
            self.own(&image.shared, &image.name);
            let [w, h] = image.made.size;
            let end = |at: u32, size: u32| u64::from(at) + u64::from(size);
            let inside = width > 0 && height > 0 && end(x, width) <= w.into() && end(y, height) <= h.into();
            assert!(inside, "{}: {width}x{height} pixels at {x}, {y} of {w}x{h}", image.name);
        }
        let colors = attachments.colors.iter().map(|a| a.image.made.format).collect::<Vec<_>>();
        assert!(!colors.iter().any(|f| is_depth(*f)), "a depth image among the colours of a rendering scope");
        if let Some(depth) = &attachments.depth {
            assert!(is_depth(depth.image.made.format), "{}: no depth image", depth.image.name);
        }
        let mut samples = attachments.colors.iter().chain(&attachments.depth).map(|a| a.image.made.samples() > 1);
        let multisampled = samples.next().unwrap_or(false);
        assert!(samples.all(|each| each == multisampled), "a rendering scope of single and many samples");
        let most = self.gpu.most_color_targets() as usize;
        assert!(colors.len() <= most, "{} colour attachments, but the device allows {most}", colors.len());
        let scope = Scope {
            colors,
            depth: attachments.depth.is_some(),
            multisampled,
            read_only: attachments.depth.is_some_and(|depth| depth.load == Load::ReadOnly),
            area: attachments.area,
            pipeline: None,
            vertices: Vec::new(),
            indices: 0,
        };
        let info = |attach: &Attach<'_>| {
            let (load, store) = match attach.load {
                Load::Keep => (vk::AttachmentLoadOp::LOAD, vk::AttachmentStoreOp::STORE),
                Load::Clear(_) => (vk::AttachmentLoadOp::CLEAR, vk::AttachmentStoreOp::STORE),
                Load::ReadOnly => (vk::AttachmentLoadOp::LOAD, vk::AttachmentStoreOp::NONE),
            };
            let clear = match attach.load {
                Load::Clear(c) if is_depth(attach.image.made.format) => {
                    vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: c[0], stencil: 0 } }
                }
                Load::Clear(float32) => vk::ClearValue { color: vk::ClearColorValue { float32 } },
                _ => vk::ClearValue::default(),
            };
            vk::RenderingAttachmentInfo::default()
                .image_view(attach.image.layer(layer))
                .image_layout(vk::ImageLayout::GENERAL)
                .load_op(load)
                .store_op(store)
                .clear_value(clear)
        };
        for attach in attachments.colors {
            self.touch_image(attach.image, Use::ColorWrite);
        }
        if let Some(depth) = &attachments.depth {
            self.touch_image(depth.image, if depth.load == Load::ReadOnly { Use::DepthRead } else { Use::DepthWrite });
        }
        let colors: Vec<_> = attachments.colors.iter().map(info).collect();
        let depth = attachments.depth.as_ref().map(info);
        let offset = vk::Offset2D { x: x as i32, y: y as i32 };
        let area = vk::Rect2D { offset, extent: vk::Extent2D { width, height } };
        let mut rendering = vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&colors);
        if let Some(depth) = &depth {
            rendering = rendering.depth_attachment(depth);
        }
        let device = &self.gpu.shared.device;
        // SAFETY: the views are alive and in GENERAL; dynamic state is set before any draw; the scope is closed below.
        unsafe {
            device.cmd_begin_rendering(self.buffer, &rendering);
            device.cmd_set_front_face(self.buffer, vk::FrontFace::COUNTER_CLOCKWISE);
        }
        *self.scope.borrow_mut() = Some(scope);
        // Bindings do not carry over into or out of a scope.
        self.bound.set(None);
        let scope = Draw { cmd: self };
        scope.area(attachments.area);
        draw(&scope);
        *self.scope.borrow_mut() = None;
        self.bound.set(None);
        // SAFETY: opened above, and nothing has ended the recording since: no command that submits runs inside a scope.
        unsafe { device.cmd_end_rendering(self.buffer) };
    }
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

    /// Binds vertex buffers with byte offsets, in stream order.
    pub fn vertices(&self, buffers: &[(&Buffer, u64)]) {
        if self.cmd.failed() {
            return;
        }
        for (buffer, offset) in buffers {
            let inside = offset.is_multiple_of(4) && *offset < buffer.held;
            assert!(inside, "{}: vertices at byte {offset} of {}", buffer.name, buffer.held);
        }
        let most = self.cmd.gpu.shared.limits.max_vertex_input_bindings as usize;
        assert!(buffers.len() <= most, "{} vertex buffers, but the device allows {most}", buffers.len());
        if let Some(scope) = self.cmd.scope.borrow_mut().as_mut() {
            scope.vertices = buffers.iter().map(|(buffer, offset)| buffer.held - offset).collect();
        }
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

    /// Binds an index buffer of u32 with a byte offset. Index buffers never change, so the barrier check skips them.
    pub fn indices(&self, buffer: &Buffer, offset: u64) {
        if self.cmd.failed() {
            return;
        }
        self.cmd.own(&buffer.shared, &buffer.name);
        let inside = offset.is_multiple_of(4) && offset < buffer.held;
        assert!(inside, "{}: indices at byte {offset} of {}", buffer.name, buffer.held);
        buffer.used();
        if let Some(scope) = self.cmd.scope.borrow_mut().as_mut() {
            scope.indices = (buffer.held - offset) / 4;
        }
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

    /// Sets the drawn part of the attachments: left, top, width and height \[pixels\]. It sets the viewport and the
    /// scissor.
    ///
    /// # Panics
    /// Panics if it is not inside the scope's own area.
    pub fn area(&self, [x, y, width, height]: [u32; 4]) {
        if self.cmd.failed() {
            return;
        }
        if let Some([left, top, w, h]) = self.cmd.scope.borrow().as_ref().map(|scope| scope.area) {
            let end = |at: u32, size: u32| u64::from(at) + u64::from(size);
            let inside = x >= left && y >= top && end(x, width) <= end(left, w) && end(y, height) <= end(top, h);
            assert!(
                inside && width > 0 && height > 0,
                "{width}x{height} pixels at {x}, {y} outside the rendering scope's area"
            );
        }
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

    /// Sets the scissor only: nothing is drawn outside this part of the attachments, but the viewport stays. Left, top,
    /// width and height \[pixels\].
    ///
    /// # Panics
    /// Panics if the rectangle exceeds the range of 31-bit numbers.
    pub fn clip(&self, [x, y, width, height]: [u32; 4]) {
        if self.cmd.failed() {
            return;
        }
        let small = |at: u32, size: u32| u64::from(at) + u64::from(size) <= i32::MAX as u64;
        assert!(small(x, width) && small(y, height), "{width}x{height} pixels at {x}, {y}");
        let scissor =
            vk::Rect2D { offset: vk::Offset2D { x: x as i32, y: y as i32 }, extent: vk::Extent2D { width, height } };
        // SAFETY: the scissor is dynamic in all our pipelines, and its offset and extent are in range.
        unsafe { self.cmd.gpu.shared.device.cmd_set_scissor(self.cmd.buffer, 0, &[scissor]) };
    }

    /// Whether counter-clockwise triangles are front-facing; false for mirrored instances.
    pub fn front_is_ccw(&self, ccw: bool) {
        if self.cmd.failed() {
            return;
        }
        let face = if ccw { vk::FrontFace::COUNTER_CLOCKWISE } else { vk::FrontFace::CLOCKWISE };
        // SAFETY: front face is dynamic in all our pipelines.
        unsafe { self.cmd.gpu.shared.device.cmd_set_front_face(self.cmd.buffer, face) };
    }

    /// Draws vertices without buffers: 3 for a full-screen triangle, points, or vertices that shaders look up
    /// themselves.
    pub fn draw(&self, vertex_count: u32) {
        self.draw_from(vertex_count, 0);
    }

    /// Draws vertices without buffers, starting at this index.
    pub fn draw_from(&self, vertex_count: u32, first_vertex: u32) {
        if self.cmd.failed() {
            return;
        }
        self.check_vertices(Some(first_vertex.saturating_add(vertex_count)));
        // SAFETY: pipeline and descriptors are bound; the shader makes its vertices from their index.
        unsafe { self.cmd.gpu.shared.device.cmd_draw(self.cmd.buffer, vertex_count, 1, first_vertex, 0) };
    }

    /// Draws vertices without buffers, with the counts stored as four numbers in a buffer, at `offset` \[bytes\]:
    /// vertices, instances, first vertex and first instance, which must be 0. The shader that writes the numbers must
    /// keep vertices and instances in the range that the vertex shader can look up.
    pub(crate) fn draw_indirect(&self, arguments: &Buffer, offset: u64) {
        if self.cmd.failed() {
            return;
        }
        self.check_vertices(Some(0));
        let inside = offset.is_multiple_of(4) && offset.checked_add(16).is_some_and(|end| end <= arguments.held);
        assert!(inside, "four numbers at byte {offset} of {}, which has {}", arguments.name, arguments.held);
        self.cmd.touch_buffer(arguments, Use::IndirectRead);
        let (buffer, arguments) = (self.cmd.buffer, arguments.handle);
        // SAFETY: pipeline and descriptors are bound; the shader makes its vertices from their index; the buffer holds
        // the four numbers.
        unsafe { self.cmd.gpu.shared.device.cmd_draw_indirect(buffer, arguments, offset, 1, 0) };
    }

    /// Draws triangles from the bound buffers. The indices must be in range; the code that fills an index buffer must
    /// ensure this.
    pub fn draw_indexed(&self, index_count: u32, first_index: u32) {
        if self.cmd.failed() {
            return;
        }
        self.check_vertices(None);
        let indices = self.cmd.scope.borrow().as_ref().map_or(0, |scope| scope.indices);
        let end = u64::from(first_index) + u64::from(index_count);
        assert!(end <= indices, "{index_count} indices from {first_index} on, but {indices} are bound");
        // SAFETY: pipeline, descriptors, vertex and index buffers are bound; the loader checked the indices.
        unsafe { self.cmd.gpu.shared.device.cmd_draw_indexed(self.cmd.buffer, index_count, 1, first_index, 0, 0) };
    }

    /// Asserts that a pipeline and its vertex buffers are bound. Each buffer must hold `count` vertices; for indexed
    /// draws only the first vertex is checked.
    fn check_vertices(&self, count: Option<u32>) {
        self.cmd.check_pushed(&self.cmd.bound.get().expect("bind before draw"));
        let scope = self.cmd.scope.borrow();
        let scope = scope.as_ref().expect("a scope is open");
        let pipeline = &*scope.pipeline.as_ref().expect("bind before draw").0;
        let strides = pipeline.raster.iter().flat_map(|state| &state.strides);
        for (i, stride) in strides.enumerate() {
            let bytes = scope.vertices.get(i).copied();
            let bytes = bytes.unwrap_or_else(|| panic!("{}: no vertex buffer {i} is bound", pipeline.name));
            let needed = u64::from(count.unwrap_or(1)) * u64::from(*stride);
            assert!(needed <= bytes, "{}: {needed} bytes of vertex buffer {i}, which has {bytes}", pipeline.name);
        }
    }
}
