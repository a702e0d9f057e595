//! Commands of one frame, in order: zones, bindings, dispatches, rendering, barriers, copies.

use super::bind::Bound;
use super::buffer::Buffer;
use super::device::{Gpu, Shared};
use super::draw::Scope;
use super::faults::Call;
use super::frames::Slot;
use super::hazards::{Log, Use};
use super::image::Image;
use super::timer::{MAX_ZONES, Recorded, STAGE_ZONES, Span, Work};
use super::{forgotten, vulkan};
use crate::error::{Error, Result};
use ash::vk;
use std::cell::{Cell, RefCell, RefMut};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Records one frame into a slot of the ring.
pub struct Cmd<'g> {
    pub(super) gpu: &'g Gpu,
    pub(super) slot: RefCell<RefMut<'g, Slot>>,
    pub(super) buffer: vk::CommandBuffer,
    pub(super) bound: Cell<Option<Bound>>,
    /// Size \[bytes\] and stages of the push constants that were set last.
    pub(super) pushed: Cell<(u32, vk::ShaderStageFlags)>,
    pub(super) log: Option<RefCell<Log>>,
    pub(super) zone: Cell<&'static str>,
    /// Submits and waits at the end of each zone: the only way to get correct timings per pass on lavapipe.
    split: bool,
    pub(super) error: RefCell<Option<Error>>,
    pub(super) key: RefCell<Vec<u64>>,
    /// The open rendering scope.
    pub(super) scope: RefCell<Option<Scope>>,
    /// Whether the buffer is recording. Then only `self` may reset or submit it.
    open: Cell<bool>,
}

/// A stage of the frame, until dropped: its label, timestamps, and name in the barrier check.
pub struct Zone<'c, 'g> {
    cmd: &'c Cmd<'g>,
    outer: &'static str,
    /// Index among the frame's zones.
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
            pushed: Cell::default(),
            log: gpu.check_barriers.then(RefCell::default),
            zone: Cell::new("frame"),
            split,
            error: RefCell::new(None),
            key: RefCell::new(Vec::with_capacity(64)),
            scope: RefCell::new(None),
            open: Cell::new(false),
        }
    }

    pub(super) fn begin(&self) -> Result<()> {
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        self.gpu.shared.begin_recording();
        // SAFETY: the buffer's last use is done; its pool allows resetting by beginning.
        unsafe { self.gpu.shared.device.begin_command_buffer(self.buffer, &info) }
            .map_err(vulkan("beginning a frame"))?;
        self.open.set(true);
        // Each command buffer begins with nothing bound.
        self.bound.set(None);
        self.pushed.set(Default::default());
        Ok(())
    }

    /// Ends and submits the recorded commands. Returns the timeline value that signals their completion.
    pub(super) fn submit(&self) -> Result<u64> {
        // A scope may be open if the caller caught a panic inside it.
        self.outside("the end of a frame");
        let start = self.slot.borrow().notes.now();
        let submitted = &self.gpu.shared.submitted;
        let value = submitted.load(Ordering::SeqCst) + 1;
        // SAFETY: the buffer is recording and complete.
        unsafe { self.gpu.shared.device.end_command_buffer(self.buffer) }.map_err(vulkan("ending a frame"))?;
        let prologue = self.prologue()?;
        let buffers: Vec<_> = prologue
            .into_iter()
            .chain([self.buffer])
            .map(|buffer| vk::CommandBufferSubmitInfo::default().command_buffer(buffer))
            .collect();
        let signals = [vk::SemaphoreSubmitInfo::default()
            .semaphore(self.gpu.shared.timeline)
            .value(value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        let info = vk::SubmitInfo2::default().command_buffer_infos(&buffers).signal_semaphore_infos(&signals);
        // SAFETY: the buffers are complete; one thread submits (`Gpu` is not `Sync`).
        unsafe {
            self.gpu
                .shared
                .check_lost(Call::Submit)
                .and_then(|()| self.gpu.shared.device.queue_submit2(self.gpu.queue, &[info], vk::Fence::null()))
                .map_err(forgotten("submitting a frame"))?;
        }
        self.open.set(false);
        submitted.store(value, Ordering::SeqCst);
        self.slot.borrow_mut().notes.worked(Work::Submit, start);
        Ok(value)
    }

    /// Transitions images created since the last submission to layout GENERAL, and copies the content of new buffers and
    /// textures, if there are any.
    fn prologue(&self) -> Result<Option<vk::CommandBuffer>> {
        let shared = &self.gpu.shared;
        // A texture's content is registered after its image, so this never takes one without the other.
        let copies = shared.new_content();
        let fresh = shared.fresh();
        if fresh.is_empty() && copies.is_empty() {
            return Ok(None);
        }
        let (device, prologue) = (&shared.device, self.slot.borrow().prologue);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let barriers = vk::DependencyInfo::default().image_memory_barriers(&fresh);
        // SAFETY: the prologue's last use ended with that of `self.buffer`; images and buffers live until this submission
        // is done.
        unsafe {
            device.begin_command_buffer(prologue, &begin).map_err(forgotten("beginning uploads"))?;
            device.cmd_pipeline_barrier2(prologue, &barriers);
            shared.copy_new(prologue, &copies);
            device.end_command_buffer(prologue).map_err(forgotten("ending uploads"))?;
        }
        Ok(Some(prologue))
    }

    /// Waits for a part of this frame.
    pub(super) fn wait_for(&self, value: u64) -> Result<()> {
        let start = self.slot.borrow().notes.now();
        self.gpu.shared.wait_for(value)?;
        self.slot.borrow_mut().notes.worked(Work::Wait, start);
        Ok(())
    }

    /// Whether an earlier command failed. Then nothing more is recorded, and `Gpu::frame` returns the error.
    pub(super) fn failed(&self) -> bool {
        self.error.borrow().is_some()
    }

    /// Submits the recorded commands, waits, and continues with an empty buffer.
    fn flush(&self) {
        if self.failed() {
            return;
        }
        let result = self.submit().and_then(|value| self.wait_for(value)).and_then(|()| self.begin());
        if let Err(error) = result {
            self.error.borrow_mut().get_or_insert(error);
        }
    }

    /// Opens a stage: debug label, timestamps, and the stage's name in the barrier check.
    pub fn zone(&self, name: &'static str) -> Zone<'_, 'g> {
        self.open_zone(name, false)
    }

    fn open_zone(&self, name: &'static str, is_shader: bool) -> Zone<'_, 'g> {
        let split = self.split && self.scope.borrow().is_none();
        if split {
            self.flush();
        }
        let mut slot = self.slot.borrow_mut();
        let index = slot.notes.zones.len();
        let timed = !self.failed() && self.gpu.clock.bits != 0 && index < MAX_ZONES as usize;
        let begin_ms = slot.notes.now();
        let depth = slot.notes.depth;
        slot.notes.zones.push(Recorded { name, depth, is_shader, timed, cpu: Span { begin_ms, end_ms: begin_ms } });
        slot.notes.depth += 1;
        let query = timed.then_some(2 * index as u32);
        if let Some(query) = query {
            self.stamp(slot.queries, query);
        }
        drop(slot);
        if split {
            // lavapipe runs a dispatch at once but takes timestamps when it flushes. Without this, the timestamp would
            // follow the dispatch.
            self.flush();
        }
        self.label(name);
        Zone { cmd: self, outer: self.zone.replace(name), index, query }
    }

    /// Writes a timestamp when all earlier commands are done.
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

    /// Makes all earlier work complete and visible to all later work. Only at the start of every submission.
    pub(super) fn full_barrier(&self) {
        let all = vk::PipelineStageFlags2::ALL_COMMANDS;
        let barriers = [vk::MemoryBarrier2::default()
            .src_stage_mask(all)
            .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
            .dst_stage_mask(all)
            .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)];
        self.pipeline_barrier(&vk::DependencyInfo::default().memory_barriers(&barriers));
    }

    /// Makes earlier work of kind `from` complete and visible to later work of kind `to`. The consuming stage calls it
    /// before it reads.
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
        self.outside("a barrier");
        // SAFETY: the buffer is recording, outside a rendering scope.
        unsafe { self.gpu.shared.device.cmd_pipeline_barrier2(self.buffer, info) };
    }

    /// Asserts that a resource belongs to the recording device.
    pub(super) fn own(&self, shared: &Arc<Shared>, name: &str) {
        assert!(Arc::ptr_eq(shared, &self.gpu.shared), "{name}: of another device");
    }

    /// Asserts that no rendering scope is open, for commands that are not allowed inside one.
    pub(super) fn outside(&self, what: &str) {
        assert!(self.scope.borrow().is_none(), "{what}: not while a rendering scope is open");
    }

    pub(super) fn touch_buffer(&self, buffer: &Buffer, how: Use) {
        self.own(&buffer.shared, &buffer.name);
        buffer.used();
        if let Some(log) = &self.log {
            log.borrow_mut().touch(buffer.id, &buffer.name, how, self.zone.get());
        }
    }

    pub(super) fn touch_image(&self, image: &Image, how: Use) {
        self.own(&image.shared, &image.name);
        if let Some(log) = &self.log {
            log.borrow_mut().touch(image.id, &image.name, how, self.zone.get());
        }
    }

    /// Runs the bound compute shader over this many items. The workgroup size comes from the shader.
    pub fn dispatch(&self, x: u32, y: u32, z: u32) {
        if self.failed() {
            return;
        }
        let bound = self.bound_to_compute();
        let [x, y, z] = [x.div_ceil(bound.group[0]), y.div_ceil(bound.group[1]), z.div_ceil(bound.group[2])];
        let most = self.gpu.shared.limits.max_compute_work_group_count;
        let fits = x <= most[0] && y <= most[1] && z <= most[2];
        assert!(fits, "{}: {x} x {y} x {z} groups, but the device allows {most:?}", bound.name);
        let _zone = self.shader_zone(&bound);
        // SAFETY: a compute pipeline with all its descriptors is bound, and the groups are no more than allowed.
        unsafe { self.gpu.shared.device.cmd_dispatch(self.buffer, x, y, z) };
    }

    /// Runs the bound compute shader with the workgroup counts stored as three numbers in a buffer, at `offset`
    /// \[bytes\]. The shader that writes the numbers must respect the device's limits.
    pub fn dispatch_indirect(&self, arguments: &Buffer, offset: u64) {
        if self.failed() {
            return;
        }
        let bound = self.bound_to_compute();
        let name = bound.name;
        let inside = offset.is_multiple_of(4) && offset.checked_add(12).is_some_and(|end| end <= arguments.held);
        assert!(inside, "{name}: three numbers at byte {offset} of {}, which has {}", arguments.name, arguments.held);
        let _zone = self.shader_zone(&bound);
        self.touch_buffer(arguments, Use::IndirectRead);
        // SAFETY: a compute pipeline with all its descriptors is bound; the buffer holds the three numbers.
        unsafe { self.gpu.shared.device.cmd_dispatch_indirect(self.buffer, arguments.handle, offset) };
    }

    /// A zone for one dispatch, if shaders are timed and stages keep enough timestamps. Where each zone is submitted
    /// separately, what is bound would be lost.
    fn shader_zone(&self, bound: &Bound) -> Option<Zone<'_, 'g>> {
        let is_timed = self.gpu.times_shaders.get() && !self.split;
        let fits = self.slot.borrow().notes.zones.len() < (MAX_ZONES - STAGE_ZONES) as usize;
        (is_timed && fits).then(|| self.open_zone(bound.name, true))
    }

    fn bound_to_compute(&self) -> Bound {
        let bound = self.bound.get().expect("bind before dispatch");
        assert!(bound.compute, "{}: a graphics pipeline cannot be dispatched", bound.name);
        self.check_pushed(&bound);
        bound
    }
}

impl Drop for Cmd<'_> {
    fn drop(&mut self) {
        if self.open.get() {
            // The frame was abandoned because of an error or a panic.
            // SAFETY: the buffer is not pending: nothing of it was submitted since it began. Its pool allows resetting.
            let reset = unsafe {
                self.gpu.shared.device.reset_command_buffer(self.buffer, vk::CommandBufferResetFlags::empty())
            };
            log::debug!("a frame was abandoned: {reset:?}");
        }
        self.gpu.shared.end_recording();
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
