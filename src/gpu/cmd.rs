//! Commands of one frame, in order: zones, binds, dispatches, rendering, barriers in words, copies.

use super::device::Gpu;
use super::draw::{Attach, Attachments, Draw, Load};
use super::frames::Slot;
use super::hazards::{Log, Use};
use super::resource::{Buffer, Image, SamplerKind, aspect, is_depth, texel_bytes};
use super::timer::{MAX_ZONES, Recorded, Span, Work};
use super::{Pipeline, vulkan};
use crate::error::{Error, Result};
use ash::vk;
use std::cell::{Cell, RefCell, RefMut};
use std::sync::atomic::Ordering;

/// A resource for one binding of a shader, in binding order.
#[derive(Clone, Copy)]
pub enum Bind<'a> {
    /// A whole buffer.
    Buffer(&'a Buffer),
    /// Part of a buffer: offset and size [bytes].
    Slice(&'a Buffer, u64, u64),
    /// A buffer read as RGBA32F texels.
    Texels(&'a Buffer),
    /// An image read texel by texel.
    Image(&'a Image),
    /// A filtered texture.
    Texture(&'a Image, SamplerKind),
}

impl<'a> From<&'a Buffer> for Bind<'a> {
    fn from(buffer: &'a Buffer) -> Self {
        Bind::Buffer(buffer)
    }
}

impl<'a> From<&'a Image> for Bind<'a> {
    fn from(image: &'a Image) -> Self {
        Bind::Image(image)
    }
}

/// What is copied of the bound pipeline, so that no lifetime leaks into the stages.
#[derive(Clone, Copy)]
struct Bound {
    name: &'static str,
    layout: vk::PipelineLayout,
    push_bytes: u32,
    stages: vk::ShaderStageFlags,
    group: [u32; 3],
}

/// Records one frame into a slot of the ring.
pub struct Cmd<'g> {
    pub(super) gpu: &'g Gpu,
    pub(super) slot: RefCell<RefMut<'g, Slot>>,
    pub(super) buffer: vk::CommandBuffer,
    bound: Cell<Option<Bound>>,
    pub(super) log: Option<RefCell<Log>>,
    pub(super) zone: Cell<&'static str>,
    /// Submit and wait at the end of each zone: the only way to right figures per pass on lavapipe.
    split: bool,
    pub(super) error: RefCell<Option<Error>>,
    key: RefCell<Vec<u64>>,
}

/// A stage of the frame: label, timestamps, and its name in the barrier check, until dropped.
pub struct Zone<'c, 'g> {
    cmd: &'c Cmd<'g>,
    outer: &'static str,
    /// Its place among the frame's zones.
    index: usize,
    query: Option<u32>,
}

impl<'g> Cmd<'g> {
    pub(super) fn new(gpu: &'g Gpu, slot: RefMut<'g, Slot>, split: bool) -> Self {
        Self {
            gpu,
            buffer: slot.buffer,
            slot: RefCell::new(slot),
            bound: Cell::new(None),
            log: gpu.check_barriers.then(RefCell::default),
            zone: Cell::new("frame"),
            split,
            error: RefCell::new(None),
            key: RefCell::new(Vec::with_capacity(64)),
        }
    }

    pub(super) fn begin(&self) -> Result<()> {
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the buffer's last use is done; its pool allows resetting by beginning.
        unsafe { self.gpu.shared.device.begin_command_buffer(self.buffer, &info) }.map_err(vulkan("beginning a frame"))
    }

    /// Ends and submits what is recorded; gives the timeline value that says it is done.
    pub(super) fn submit(&self) -> Result<u64> {
        let start = self.slot.borrow().notes.now();
        let submitted = &self.gpu.shared.submitted;
        let value = submitted.load(Ordering::SeqCst) + 1;
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(self.buffer)];
        let signals = [vk::SemaphoreSubmitInfo::default()
            .semaphore(self.gpu.shared.timeline)
            .value(value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        let info = vk::SubmitInfo2::default().command_buffer_infos(&buffers).signal_semaphore_infos(&signals);
        // SAFETY: the buffer is recording and complete; one thread records at a time (`Gpu` is not `Sync`).
        unsafe {
            self.gpu.shared.device.end_command_buffer(self.buffer).map_err(vulkan("ending a frame"))?;
            self.gpu
                .shared
                .device
                .queue_submit2(self.gpu.queue, &[info], vk::Fence::null())
                .map_err(vulkan("submitting a frame"))?;
        }
        submitted.store(value, Ordering::SeqCst);
        self.slot.borrow_mut().notes.worked(Work::Submit, start);
        Ok(value)
    }

    /// Waits for a part of this frame.
    pub(super) fn wait_for(&self, value: u64) -> Result<()> {
        let start = self.slot.borrow().notes.now();
        self.gpu.shared.wait_for(value)?;
        self.slot.borrow_mut().notes.worked(Work::Wait, start);
        Ok(())
    }

    /// Whether an earlier command has failed: then nothing more is recorded, and `Gpu::frame` gives its error.
    pub(super) fn failed(&self) -> bool {
        self.error.borrow().is_some()
    }

    /// Submits what is recorded so far, waits, and goes on with an empty buffer.
    fn flush(&self) {
        if self.failed() {
            return;
        }
        let result = self.submit().and_then(|value| self.wait_for(value)).and_then(|()| self.begin());
        if let Err(error) = result {
            self.error.borrow_mut().get_or_insert(error);
        }
    }

    /// Opens a stage: debug label, timestamps, and the name under which the barrier check reports it.
    pub fn zone(&self, name: &'static str) -> Zone<'_, 'g> {
        if self.split {
            self.flush();
        }
        let mut slot = self.slot.borrow_mut();
        let index = slot.notes.zones.len();
        let timed = !self.failed() && self.gpu.clock.bits != 0 && index < MAX_ZONES as usize;
        let begin_ms = slot.notes.now();
        let depth = slot.notes.depth;
        slot.notes.zones.push(Recorded { name, depth, timed, cpu: Span { begin_ms, end_ms: begin_ms } });
        slot.notes.depth += 1;
        let query = timed.then_some(2 * index as u32);
        if let Some(query) = query {
            self.stamp(slot.queries, query);
        }
        drop(slot);
        if self.split {
            // lavapipe runs a dispatch at once but takes timestamps when it flushes: else this one would come after it.
            self.flush();
        }
        self.label(name);
        Zone { cmd: self, outer: self.zone.replace(name), index, query }
    }

    /// Writes a timestamp when everything before is done.
    fn stamp(&self, queries: vk::QueryPool, query: u32) {
        let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
        // SAFETY: the buffer is recording; the query was reset and is written once per frame.
        unsafe { self.gpu.shared.device.cmd_write_timestamp2(self.buffer, stage, queries, query) };
    }

    fn label(&self, name: &str) {
        if let Some(names) = self.gpu.shared.names.as_ref().filter(|_| !self.failed()) {
            let name = std::ffi::CString::new(name).unwrap_or_default();
            let label = vk::DebugUtilsLabelEXT::default().label_name(&name);
            // SAFETY: the buffer is recording; the label is closed when its zone is dropped.
            unsafe { names.cmd_begin_debug_utils_label(self.buffer, &label) };
        }
    }

    /// Everything before is done and visible to everything after. Opens a frame; nowhere else.
    pub(super) fn full_barrier(&self) {
        let all = vk::PipelineStageFlags2::ALL_COMMANDS;
        let barriers = [vk::MemoryBarrier2::default()
            .src_stage_mask(all)
            .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
            .dst_stage_mask(all)
            .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)];
        self.pipeline_barrier(&vk::DependencyInfo::default().memory_barriers(&barriers));
    }

    /// Opens a frame: the last one is done, and every target goes from UNDEFINED to GENERAL, its content discarded.
    pub fn begin_frame<'i>(&self, targets: impl IntoIterator<Item = &'i Image>) {
        self.full_barrier();
        let barriers: Vec<_> =
            targets.into_iter().map(|image| discard(image, vk::PipelineStageFlags2::ALL_COMMANDS)).collect();
        self.pipeline_barrier(&vk::DependencyInfo::default().image_memory_barriers(&barriers));
    }

    /// What `from` did before is done and visible to what `to` does after. The consumer writes it, before it reads.
    pub fn barrier(&self, from: Use, to: Use) {
        let ((src_stage, src_access), (dst_stage, dst_access)) = (from.masks(), to.masks());
        let barriers = [vk::MemoryBarrier2::default()
            .src_stage_mask(src_stage)
            .src_access_mask(src_access)
            .dst_stage_mask(dst_stage)
            .dst_access_mask(dst_access)];
        self.pipeline_barrier(&vk::DependencyInfo::default().memory_barriers(&barriers));
        if let Some(log) = &self.log {
            log.borrow_mut().barrier(from, to, self.zone.get());
        }
    }

    pub(super) fn pipeline_barrier(&self, info: &vk::DependencyInfo<'_>) {
        if self.failed() {
            return;
        }
        // SAFETY: the buffer is recording, outside a rendering scope.
        unsafe { self.gpu.shared.device.cmd_pipeline_barrier2(self.buffer, info) };
    }

    pub(super) fn touch_buffer(&self, buffer: &Buffer, how: Use) {
        if let Some(log) = &self.log {
            log.borrow_mut().touch(buffer.id, &buffer.name, how, self.zone.get());
        }
    }

    fn touch_image(&self, image: &Image, how: Use) {
        if let Some(log) = &self.log {
            log.borrow_mut().touch(image.id, &image.name, how, self.zone.get());
        }
    }

    /// Binds a pipeline and its resources, in the order of the shader's bindings.
    pub fn bind(&self, pipeline: &Pipeline, resources: &[Bind<'_>]) {
        if self.failed() {
            return;
        }
        let name = pipeline.name;
        assert_eq!(
            resources.len(),
            pipeline.slots.len(),
            "{name}: its shaders declare {} bindings",
            pipeline.slots.len()
        );
        let mut key = self.key.borrow_mut();
        key.clear();
        key.push(pipeline.id);
        for (slot, resource) in pipeline.slots.iter().zip(resources) {
            match *resource {
                Bind::Buffer(buffer) => key.extend([buffer.id, 0, buffer.size]),
                Bind::Slice(buffer, offset, size) => key.extend([buffer.id, offset, size]),
                Bind::Texels(buffer) => key.extend([buffer.id, 4, 0]),
                Bind::Image(image) => key.extend([image.id, 1, 0]),
                Bind::Texture(image, kind) => {
                    let wrap = kind.wrap.map(|w| w.as_raw() as u64);
                    key.extend([image.id, 2 + u64::from(kind.nearest), wrap[0] << 32 | wrap[1]]);
                }
            }
            for how in &slot.uses {
                match resource {
                    Bind::Buffer(b) | Bind::Slice(b, ..) | Bind::Texels(b) => self.touch_buffer(b, *how),
                    Bind::Image(i) | Bind::Texture(i, _) => self.touch_image(i, *how),
                }
            }
        }
        let shared = &self.gpu.shared;
        let mut descriptors = self.gpu.descriptors.borrow_mut();
        let set =
            descriptors.get(shared, &key, (name, pipeline.set_layout), |set| self.write_set(set, pipeline, resources));
        drop(descriptors);
        let set = match set {
            Ok(set) => set,
            Err(error) => {
                self.error.borrow_mut().get_or_insert(error);
                return;
            }
        };
        let point = pipeline.point;
        // SAFETY: pipeline, layout and set belong together and live until the frame is done (destructors wait).
        unsafe {
            shared.device.cmd_bind_pipeline(self.buffer, point, pipeline.handle);
            if !resources.is_empty() {
                shared.device.cmd_bind_descriptor_sets(self.buffer, point, pipeline.layout, 0, &[set], &[]);
            }
        }
        self.bound.set(Some(Bound {
            name,
            layout: pipeline.layout,
            push_bytes: pipeline.push_bytes,
            stages: pipeline.stages,
            group: pipeline.group,
        }));
    }

    fn write_set(&self, set: vk::DescriptorSet, pipeline: &Pipeline, resources: &[Bind<'_>]) -> Result<()> {
        let nearest = SamplerKind { wrap: [vk::SamplerAddressMode::CLAMP_TO_EDGE; 2], nearest: true };
        for (slot, resource) in pipeline.slots.iter().zip(resources) {
            let write =
                vk::WriteDescriptorSet::default().dst_set(set).dst_binding(slot.binding).descriptor_type(slot.kind);
            let (buffer, image, texels);
            let write = match *resource {
                Bind::Buffer(b) => {
                    let limit = u64::from(self.gpu.shared.limits.max_storage_buffer_range);
                    if b.size > limit {
                        return Err(self.gpu.too_large(format!("buffer {} needs {} bytes", b.name, b.size), limit));
                    }
                    buffer = [vk::DescriptorBufferInfo { buffer: b.handle, offset: 0, range: vk::WHOLE_SIZE }];
                    write.buffer_info(&buffer)
                }
                Bind::Slice(b, offset, range) => {
                    buffer = [vk::DescriptorBufferInfo { buffer: b.handle, offset, range }];
                    write.buffer_info(&buffer)
                }
                Bind::Texels(b) => {
                    texels = [self.gpu.texels(b)?];
                    write.texel_buffer_view(&texels)
                }
                Bind::Image(i) | Bind::Texture(i, _) => {
                    let kind = if let Bind::Texture(_, kind) = resource { *kind } else { nearest };
                    let sampler = self.gpu.sampler(kind)?;
                    image = [vk::DescriptorImageInfo {
                        sampler,
                        image_view: i.view,
                        image_layout: vk::ImageLayout::GENERAL,
                    }];
                    write.image_info(&image)
                }
            };
            // SAFETY: the set is fresh and not in use; the infos live to the end of the call.
            unsafe { self.gpu.shared.device.update_descriptor_sets(&[write], &[]) };
        }
        Ok(())
    }

    /// Sets the push constants of the bound pipeline.
    pub fn push<T: bytemuck::NoUninit>(&self, constants: &T) {
        if self.failed() {
            return;
        }
        let bound = self.bound.get().expect("bind before push");
        let bytes = bytemuck::bytes_of(constants);
        assert_eq!(bytes.len() as u32, bound.push_bytes, "{}: size of its push constants", bound.name);
        // SAFETY: size and stages are those of the layout.
        unsafe { self.gpu.shared.device.cmd_push_constants(self.buffer, bound.layout, bound.stages, 0, bytes) };
    }

    /// Runs the bound compute shader over this many items; the group size is the shader's own.
    pub fn dispatch(&self, x: u32, y: u32, z: u32) {
        if self.failed() {
            return;
        }
        let bound = self.bound.get().expect("bind before dispatch");
        let [x, y, z] = [x.div_ceil(bound.group[0]), y.div_ceil(bound.group[1]), z.div_ceil(bound.group[2])];
        // SAFETY: a compute pipeline with all its descriptors is bound.
        unsafe { self.gpu.shared.device.cmd_dispatch(self.buffer, x, y, z) };
    }

    /// Runs the bound compute shader over as many groups as three numbers of a buffer say; `offset` in bytes.
    pub fn dispatch_indirect(&self, arguments: &Buffer, offset: u64) {
        if self.failed() {
            return;
        }
        self.touch_buffer(arguments, Use::IndirectRead);
        // SAFETY: a compute pipeline with all its descriptors is bound; the buffer holds the three numbers.
        unsafe { self.gpu.shared.device.cmd_dispatch_indirect(self.buffer, arguments.handle, offset) };
    }

    /// Opens a rendering scope and draws.
    pub fn render(&self, attachments: &Attachments<'_>, draw: impl FnOnce(&Draw<'_, 'g>)) {
        if self.failed() {
            return;
        }
        let info = |attach: &Attach<'_>| {
            let (load, store) = match attach.load {
                Load::Keep => (vk::AttachmentLoadOp::LOAD, vk::AttachmentStoreOp::STORE),
                Load::Clear(_) => (vk::AttachmentLoadOp::CLEAR, vk::AttachmentStoreOp::STORE),
                Load::ReadOnly => (vk::AttachmentLoadOp::LOAD, vk::AttachmentStoreOp::NONE),
            };
            let clear = match attach.load {
                Load::Clear(c) if is_depth(attach.image.format) => {
                    vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: c[0], stencil: 0 } }
                }
                Load::Clear(float32) => vk::ClearValue { color: vk::ClearColorValue { float32 } },
                _ => vk::ClearValue::default(),
            };
            vk::RenderingAttachmentInfo::default()
                .image_view(attach.image.view)
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
        let [x, y, width, height] = attachments.area;
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
        let scope = Draw { cmd: self };
        scope.area(attachments.area);
        draw(&scope);
        // SAFETY: opened above.
        unsafe { device.cmd_end_rendering(self.buffer) };
    }

    /// Copies the first `size` bytes of a buffer to another.
    pub fn copy_buffer(&self, from: &Buffer, to: &Buffer, size: u64) {
        if self.failed() {
            return;
        }
        self.touch_buffer(from, Use::CopyRead);
        self.touch_buffer(to, Use::CopyWrite);
        let regions = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size }];
        // SAFETY: both are alive and at least `size` long (callers pass a buffer's own size).
        unsafe { self.gpu.shared.device.cmd_copy_buffer(self.buffer, from.handle, to.handle, &regions) };
    }

    /// Fills a buffer with zeros.
    pub fn clear(&self, buffer: &Buffer) {
        if self.failed() {
            return;
        }
        self.touch_buffer(buffer, Use::CopyWrite);
        // SAFETY: the buffer is alive and made with transfer usage.
        unsafe { self.gpu.shared.device.cmd_fill_buffer(self.buffer, buffer.handle, 0, vk::WHOLE_SIZE, 0) };
    }

    /// Writes into a buffer, by way of the command buffer: for what changes from frame to frame.
    pub fn update<T: bytemuck::NoUninit>(&self, to: &Buffer, first_byte: u64, data: &[T]) {
        /// Most bytes of one such command.
        const MOST: usize = 65_536;
        let bytes: &[u8] = bytemuck::cast_slice(data);
        assert!(first_byte.is_multiple_of(4) && bytes.len().is_multiple_of(4), "{}: whole words", to.name);
        assert!(first_byte + bytes.len() as u64 <= to.size, "{}: {} bytes at {first_byte}", to.name, bytes.len());
        if self.failed() || bytes.is_empty() {
            return;
        }
        self.touch_buffer(to, Use::CopyWrite);
        for (i, part) in bytes.chunks(MOST).enumerate() {
            let offset = first_byte + (i * MOST) as u64;
            // SAFETY: the buffer is alive, and offset and size, both of whole words, lie within it by the assertion above.
            unsafe { self.gpu.shared.device.cmd_update_buffer(self.buffer, to.handle, offset, part) };
        }
    }

    /// Copies an image, tightly packed, into a buffer.
    pub fn copy_image_to_buffer(&self, from: &Image, to: &Buffer) {
        if self.failed() {
            return;
        }
        self.touch_image(from, Use::CopyRead);
        self.touch_buffer(to, Use::CopyWrite);
        let regions = [region(from, 0, 0)];
        // SAFETY: the buffer holds `width * height` texels (made so by the caller); the image is in GENERAL.
        unsafe {
            self.gpu.shared.device.cmd_copy_image_to_buffer(
                self.buffer,
                from.handle,
                vk::ImageLayout::GENERAL,
                to.handle,
                &regions,
            );
        }
    }

    /// Fills all levels of a fresh texture from a buffer that holds them one after the other.
    pub(crate) fn copy_buffer_to_texture(&self, from: &Buffer, to: &Image) {
        if self.failed() {
            return;
        }
        let barriers = [discard(to, vk::PipelineStageFlags2::COPY)];
        self.pipeline_barrier(&vk::DependencyInfo::default().image_memory_barriers(&barriers));
        self.touch_buffer(from, Use::CopyRead);
        self.touch_image(to, Use::CopyWrite);
        let mut offset = 0;
        let regions: Vec<_> = (0..to.mips)
            .map(|mip| {
                let here = region(to, mip, offset);
                offset +=
                    u64::from(here.image_extent.width) * u64::from(here.image_extent.height) * texel_bytes(to.format);
                here
            })
            .collect();
        // SAFETY: the buffer holds all levels; the image is in GENERAL since the barrier above.
        unsafe {
            self.gpu.shared.device.cmd_copy_buffer_to_image(
                self.buffer,
                from.handle,
                to.handle,
                vk::ImageLayout::GENERAL,
                &regions,
            );
        }
    }
}

/// From UNDEFINED to GENERAL: what the image held is gone.
fn discard(image: &Image, stage: vk::PipelineStageFlags2) -> vk::ImageMemoryBarrier2<'static> {
    vk::ImageMemoryBarrier2::default()
        .src_stage_mask(stage)
        .dst_stage_mask(stage)
        .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
        .old_layout(vk::ImageLayout::UNDEFINED)
        .new_layout(vk::ImageLayout::GENERAL)
        .image(image.handle)
        .subresource_range(vk::ImageSubresourceRange {
            aspect_mask: aspect(image.format),
            base_mip_level: 0,
            level_count: image.mips,
            base_array_layer: 0,
            layer_count: 1,
        })
}

/// One level, tightly packed at an offset of a buffer.
fn region(image: &Image, mip: u32, offset: u64) -> vk::BufferImageCopy {
    vk::BufferImageCopy {
        buffer_offset: offset,
        buffer_row_length: 0,
        buffer_image_height: 0,
        image_subresource: vk::ImageSubresourceLayers {
            aspect_mask: aspect(image.format),
            mip_level: mip,
            base_array_layer: 0,
            layer_count: 1,
        },
        image_offset: vk::Offset3D::default(),
        image_extent: vk::Extent3D {
            width: (image.width >> mip).max(1),
            height: (image.height >> mip).max(1),
            depth: 1,
        },
    }
}

impl Drop for Zone<'_, '_> {
    fn drop(&mut self) {
        let cmd = self.cmd;
        cmd.zone.set(self.outer);
        if cmd.failed() {
            return;
        }
        if let Some(names) = &cmd.gpu.shared.names {
            // SAFETY: closes what `zone` opened.
            unsafe { names.cmd_end_debug_utils_label(cmd.buffer) };
        }
        let mut slot = cmd.slot.borrow_mut();
        if let Some(query) = self.query {
            cmd.stamp(slot.queries, query + 1);
        }
        slot.notes.depth -= 1;
        slot.notes.zones[self.index].cpu.end_ms = slot.notes.now();
    }
}
