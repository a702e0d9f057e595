//! A ring of frame slots, each with a command buffer and timestamps. A frame's times are fetched once it is known to be
//! done, so that no frame waits for its own times.

use super::cmd::Cmd;
use super::device::{FRAMES_IN_FLIGHT, Gpu, Shared};
use super::faults::Call;
use super::hazards::Use;
use super::timer::{FrameTimes, Line, MAX_ZONES, Notes, Work};
use super::vulkan;
use crate::error::Result;
use ash::vk;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Maximum number of frames whose times are kept until they are fetched; older ones are dropped.
const KEPT_TIMES: usize = 256;

/// Resources of one frame in flight.
pub(crate) struct Slot {
    shared: Arc<Shared>,
    pub(crate) buffer: vk::CommandBuffer,
    /// Submitted before `buffer`. Transitions new images to layout GENERAL, and copies the content of new resources.
    pub(super) prologue: vk::CommandBuffer,
    pub(crate) queries: vk::QueryPool,
    /// The frame that is being or was last recorded here.
    pub(crate) notes: Notes,
    /// Timeline value at which this slot is free again.
    done: u64,
    /// Submitted, but its times have not been read yet.
    unread: bool,
}

/// All slots, and the times read from them.
pub(crate) struct Ring {
    pub(crate) slots: Vec<RefCell<Slot>>,
    line: RefCell<Line>,
    kept: RefCell<VecDeque<FrameTimes>>,
    frames: Cell<u64>,
}

/// A submitted frame: its number, and the problems that the barrier check found.
#[must_use = "check the frame's problems"]
pub struct Frame {
    number: u64,
    value: u64,
    /// Missing and unnecessary barriers; only filled with `Validation::Sync`.
    pub problems: Vec<String>,
}

impl Slot {
    fn new(shared: &Arc<Shared>, index: usize) -> Result<Self> {
        let info = vk::CommandBufferAllocateInfo::default().command_pool(shared.pool).command_buffer_count(2);
        // SAFETY: the pool is alive and outlives the slot.
        let buffers = unsafe { shared.device.allocate_command_buffers(&info) }.map_err(vulkan("command buffers"))?;
        let [prologue, buffer] = [buffers[0], buffers[1]];
        shared.name(buffer, &format!("frame.commands {index}"));
        shared.name(prologue, &format!("frame.uploads {index}"));
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(2 * MAX_ZONES);
        // SAFETY: the device is alive; destroyed in `Drop`.
        let queries = unsafe { shared.device.create_query_pool(&info, None) }.map_err(vulkan("timestamp queries"))?;
        shared.name(queries, &format!("frame.timestamps {index}"));
        let notes = Notes {
            number: 0,
            split: false,
            begin: Instant::now(),
            depth: 0,
            zones: Vec::with_capacity(MAX_ZONES as usize),
            work: Vec::with_capacity(2 * MAX_ZONES as usize),
        };
        Ok(Self { shared: shared.clone(), buffer, prologue, queries, notes, done: 0, unread: false })
    }

    /// Prepares the slot for a frame. The slot's last frame must be done.
    fn open(&mut self, number: u64, split: bool, begin: Instant) {
        self.notes.zones.clear();
        self.notes.work.clear();
        (self.notes.number, self.notes.split, self.notes.begin, self.notes.depth) = (number, split, begin, 0);
        // SAFETY: hostQueryReset is enabled, and the last frame that used the queries is done.
        unsafe { self.shared.device.reset_query_pool(self.queries, 0, 2 * MAX_ZONES) };
    }
}

impl Ring {
    pub(crate) fn new(shared: &Arc<Shared>) -> Result<Self> {
        Ok(Self {
            slots: (0..FRAMES_IN_FLIGHT).map(|i| Slot::new(shared, i).map(RefCell::new)).collect::<Result<_>>()?,
            line: RefCell::default(),
            kept: RefCell::default(),
            frames: Cell::new(0),
        })
    }
}

impl Gpu {
    /// Records and submits a frame. Waits only if the frame before the previous one is not done.
    ///
    /// # Errors
    /// Fails if recording or submitting fails. Then nothing of the frame is submitted.
    pub fn frame(&self, record: impl FnOnce(&Cmd<'_>) -> Result<()>) -> Result<Frame> {
        self.counted(false, record)
    }

    /// Records and submits a frame with meaningful times per stage. Software devices attribute chained passes wrongly,
    /// so on these each zone is submitted alone and waited for.
    ///
    /// # Errors
    /// As `frame`.
    pub fn timed_frame(&self, record: impl FnOnce(&Cmd<'_>) -> Result<()>) -> Result<Frame> {
        self.counted(self.is_software(), record)
    }

    fn counted(&self, split: bool, record: impl FnOnce(&Cmd<'_>) -> Result<()>) -> Result<Frame> {
        let frame = self.submit(split, record)?;
        let slot = &self.ring.slots[frame.number as usize % FRAMES_IN_FLIGHT];
        slot.borrow_mut().unread = true;
        Ok(frame)
    }

    fn submit(&self, split: bool, record: impl FnOnce(&Cmd<'_>) -> Result<()>) -> Result<Frame> {
        let recording = self.shared.recording.load(Ordering::SeqCst);
        assert!(
            !recording,
            "a frame is being recorded: nothing can be submitted, uploaded or read back before it ends"
        );
        let begin = Instant::now();
        let number = self.ring.frames.get();
        let mut slot = self.ring.slots[number as usize % FRAMES_IN_FLIGHT].borrow_mut();
        self.shared.wait_for(slot.done)?;
        self.shared.collect();
        let waited = begin.elapsed();
        self.keep_times(&mut slot)?;
        slot.open(number, split, begin);
        slot.notes.work.push((Work::Wait, super::Span { begin_ms: 0.0, end_ms: waited.as_secs_f64() * 1e3 }));
        let start = slot.notes.now();
        let cmd = Cmd::new(self, slot, split);
        cmd.begin()?;
        cmd.full_barrier();
        let recorded = record(&cmd);
        cmd.slot.borrow_mut().notes.worked(Work::Record, start);
        // An abandoned frame leaves nothing behind, except parts that a split frame has already submitted and waited
        // for (`Drop for Cmd`).
        cmd.error.take().map_or(recorded, Err)?;
        let value = cmd.submit()?;
        if split {
            cmd.wait_for(value)?;
        }
        cmd.slot.borrow_mut().done = value;
        self.ring.frames.set(number + 1);
        Ok(Frame { number, value, problems: cmd.log.as_ref().map_or_else(Vec::new, |log| log.take().problems()) })
    }

    /// Times of all frames that are done and have not been fetched, oldest first; never waits. If there are more than
    /// 256, the oldest are lost.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn finished_times(&self) -> Result<Vec<FrameTimes>> {
        // SAFETY: the semaphore is alive.
        let done = unsafe { self.shared.device.get_semaphore_counter_value(self.shared.timeline) }
            .map_err(vulkan("querying finished frames"))?;
        // The next slot in the ring holds the oldest frame.
        for i in 0..FRAMES_IN_FLIGHT {
            let mut slot = self.ring.slots[(self.ring.frames.get() as usize + i) % FRAMES_IN_FLIGHT].borrow_mut();
            if slot.done <= done {
                self.keep_times(&mut slot)?;
            }
        }
        Ok(self.ring.kept.borrow_mut().drain(..).collect())
    }

    /// Waits for everything submitted. Afterwards `finished_times` has every frame.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn wait(&self) -> Result<()> {
        self.shared.wait()?;
        self.shared.collect();
        Ok(())
    }

    /// Waits for a frame and fetches its times, which must not have been fetched yet.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn times(&self, frame: &Frame) -> Result<FrameTimes> {
        let mut slot = self.ring.slots[frame.number as usize % FRAMES_IN_FLIGHT].borrow_mut();
        let held = slot.unread && slot.notes.number == frame.number;
        let start = slot.notes.now();
        self.shared.wait_for(frame.value)?;
        if held {
            slot.notes.worked(Work::Wait, start);
            self.keep_times(&mut slot)?;
        }
        let mut kept = self.ring.kept.borrow_mut();
        let at = kept.iter().position(|times| times.number == frame.number);
        Ok(at
            .and_then(|at| kept.remove(at))
            .expect("times of a frame can be fetched once, and only while they are kept"))
    }

    /// Reads the times of the slot's frame, which must be done, and keeps them.
    fn keep_times(&self, slot: &mut Slot) -> Result<()> {
        if !std::mem::take(&mut slot.unread) {
            return Ok(());
        }
        let mut stamps = [0_u64; 2 * MAX_ZONES as usize];
        let stamps = &mut stamps[..2 * slot.notes.zones.iter().filter(|z| z.timed).count()];
        if !stamps.is_empty() {
            // SAFETY: all these queries were written by the finished frame.
            unsafe {
                self.shared.device.get_query_pool_results(slot.queries, 0, stamps, vk::QueryResultFlags::TYPE_64)
            }
            .map_err(vulkan("reading timestamps"))?;
        }
        let mut kept = self.ring.kept.borrow_mut();
        if kept.len() == KEPT_TIMES {
            kept.pop_front();
        }
        kept.push_back(slot.notes.times(stamps, &self.clock, &mut self.ring.line.borrow_mut()));
        Ok(())
    }

    /// Records, submits and waits: for work outside the frame loop. Has no times.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn run_once(&self, name: &'static str, record: impl FnOnce(&Cmd<'_>)) -> Result<()> {
        let (value, ()) = self.submit_copies(name, |cmd| {
            record(cmd);
            Ok(())
        })?;
        self.shared.wait_for(value)
    }

    /// Records and submits copies to the CPU, without waiting for them: `record` returns them. Has no times.
    ///
    /// # Errors
    /// Fails if the device is lost, or there is no memory for the copies.
    pub fn begin<T>(&self, name: &'static str, record: impl FnOnce(&Cmd<'_>) -> Result<T>) -> Result<T> {
        self.submit_copies(name, record).map(|(_, copies)| copies)
    }

    fn submit_copies<T>(&self, name: &'static str, record: impl FnOnce(&Cmd<'_>) -> Result<T>) -> Result<(u64, T)> {
        self.shared.check_lost(Call::Copy).map_err(vulkan(name))?;
        let mut copies = None;
        let frame = self.submit(false, |cmd| {
            cmd.zone.set(name);
            copies = Some(record(cmd)?);
            // Makes copied data visible to the CPU.
            let ((src_stage, src_access), (dst_stage, dst_access)) = (Use::CopyWrite.masks(), Use::HostRead.masks());
            let barriers = [vk::MemoryBarrier2::default()
                .src_stage_mask(src_stage)
                .src_access_mask(src_access)
                .dst_stage_mask(dst_stage)
                .dst_access_mask(dst_access)];
            cmd.pipeline_barrier(&vk::DependencyInfo::default().memory_barriers(&barriers));
            Ok(())
        })?;
        Ok((frame.value, copies.expect("recorded")))
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.shared.wait_to_drop();
        // SAFETY: nothing is in use after the wait; the command buffers are freed with their pool.
        unsafe { self.shared.device.destroy_query_pool(self.queries, None) };
    }
}
