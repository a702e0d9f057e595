//! What becomes of dropped objects. The GPU may still use them, and so may the commands that are being recorded: they lie
//! in the graveyard until the timeline says that the last submission that can name them is done. No drop waits.

use super::device::Shared;
use ash::vk;
use gpu_allocator::vulkan::Allocation;
use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Handles of a dropped object, and the memory behind them.
pub(super) enum Remains {
    Buffer { handle: vk::Buffer, texels: Option<vk::BufferView>, memory: Option<Allocation> },
    Image { handle: vk::Image, views: Vec<vk::ImageView>, memory: Option<Allocation> },
    Pipeline(vk::Pipeline),
    Layout { layout: vk::PipelineLayout, set_layout: vk::DescriptorSetLayout },
}

/// One dropped object.
struct Grave {
    /// Timeline value of the last submission that can name it.
    until: u64,
    /// Descriptor sets that name this identity go with it.
    id: u64,
    remains: Remains,
}

/// Dropped objects, oldest first.
#[derive(Default)]
pub(super) struct Graveyard {
    graves: VecDeque<Grave>,
}

/// Locks what a panic elsewhere cannot have left half changed: destructors run while a panic unwinds, too.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// Takes a dropped object over and destroys all whose time has come; waits for nothing.
    pub(super) fn bury(&self, id: u64, remains: Remains) {
        {
            let mut graveyard = lock(&self.graveyard);
            // In this order: a recording that ends in between has counted its submission first.
            let recording = self.recording.load(Ordering::SeqCst);
            let until = self.submitted.load(Ordering::SeqCst) + u64::from(recording);
            graveyard.graves.push_back(Grave { until, id, remains });
        }
        self.collect();
    }

    /// Destroys what was dropped and is no longer in use; waits for nothing.
    pub(super) fn collect(&self) {
        let over: Vec<Grave> = {
            let mut graveyard = lock(&self.graveyard);
            if graveyard.graves.is_empty() {
                return;
            }
            // Under the lock: nothing can be bound, dropped and buried between these reads.
            let recording = self.recording.load(Ordering::SeqCst);
            let submitted = self.submitted.load(Ordering::SeqCst);
            // SAFETY: the semaphore is alive.
            let counter = unsafe { self.device.get_semaphore_counter_value(self.timeline) };
            // A lost device is done with everything that it was given.
            let done = counter.unwrap_or(submitted);
            // With nothing being recorded, a submission that is still to come names none of these.
            let done = if !recording && done >= submitted { u64::MAX } else { done };
            let count = graveyard.graves.iter().take_while(|grave| grave.until <= done).count();
            graveyard.graves.drain(..count).collect()
        };
        for grave in over {
            self.destroy(grave);
        }
    }

    /// Destroys what is left when the device goes.
    pub(super) fn collect_all(&self) {
        let all = std::mem::take(&mut lock(&self.graveyard).graves);
        for grave in all {
            self.destroy(grave);
        }
    }

    fn destroy(&self, Grave { id, remains, .. }: Grave) {
        lock(&self.descriptors).forget(&self.device, id);
        let device = &self.device;
        // SAFETY: all handles were made from this device and their owner is gone; nothing submitted or being recorded uses
        // them (`collect`), and no descriptor set that names them is left. Views go before what they show.
        let memory = unsafe {
            match remains {
                Remains::Buffer { handle, texels, memory } => {
                    if let Some(view) = texels {
                        device.destroy_buffer_view(view, None);
                    }
                    device.destroy_buffer(handle, None);
                    memory
                }
                Remains::Image { handle, views, memory } => {
                    for view in views {
                        device.destroy_image_view(view, None);
                    }
                    device.destroy_image(handle, None);
                    memory
                }
                Remains::Pipeline(handle) => {
                    device.destroy_pipeline(handle, None);
                    None
                }
                Remains::Layout { layout, set_layout } => {
                    device.destroy_pipeline_layout(layout, None);
                    device.destroy_descriptor_set_layout(set_layout, None);
                    None
                }
            }
        };
        self.free(memory);
    }

    /// Dropped objects that are not destroyed yet.
    pub(super) fn buried(&self) -> usize {
        lock(&self.graveyard).graves.len()
    }
}
