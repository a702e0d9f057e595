//! How objects begin and end. What becomes of dropped ones: The GPU may still use them, and so may the commands that are being recorded: they lie
//! in the graveyard until the timeline says that the last submission that can name them is done. No drop waits. And images,
//! made in a layout that nothing can use, are brought to GENERAL by the next submission, whatever it is.

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

/// An image that no submission has brought to layout GENERAL.
struct Fresh {
    handle: vk::Image,
    id: u64,
    range: vk::ImageSubresourceRange,
}

/// Dropped objects, oldest first, and new images.
#[derive(Default)]
pub(super) struct Graveyard {
    graves: VecDeque<Grave>,
    /// All alive, or in a grave until the next submission is done.
    fresh: Vec<Fresh>,
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
            if !recording {
                graveyard.fresh.retain(|fresh| fresh.id != id);
            }
            graveyard.graves.push_back(Grave { until, id, remains });
        }
        self.collect();
    }

    /// The last submission that is done. Beyond all numbers if nothing is under way: then also one that was given up.
    pub(super) fn done(&self) -> u64 {
        let recording = self.recording.load(Ordering::SeqCst);
        let submitted = self.submitted.load(Ordering::SeqCst);
        // SAFETY: the semaphore is alive.
        let counter = unsafe { self.device.get_semaphore_counter_value(self.timeline) };
        // A lost device is done with everything that it was given.
        let done = counter.unwrap_or(submitted);
        if !recording && done >= submitted { u64::MAX } else { done }
    }

    /// Destroys what was dropped and is no longer in use; waits for nothing.
    pub(super) fn collect(&self) {
        let over: Vec<Grave> = {
            let mut graveyard = lock(&self.graveyard);
            if graveyard.graves.is_empty() {
                return;
            }
            // Under the lock: nothing can be bound, dropped and buried while this is found out.
            let done = self.done();
            let count = graveyard.graves.iter().take_while(|grave| grave.until <= done).count();
            let over: Vec<Grave> = graveyard.graves.drain(..count).collect();
            if !over.is_empty() {
                graveyard.fresh.retain(|fresh| over.iter().all(|grave| grave.id != fresh.id));
            }
            over
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

    /// Notes an image that is still in layout UNDEFINED.
    pub(super) fn freshly_made(&self, handle: vk::Image, id: u64, range: vk::ImageSubresourceRange) {
        lock(&self.graveyard).fresh.push(Fresh { handle, id, range });
    }

    /// Barriers that bring all new images to layout GENERAL, for the submission that is about to be made. It must be the
    /// one that is being recorded: images that were dropped since live as long.
    pub(super) fn fresh(&self) -> Vec<vk::ImageMemoryBarrier2<'static>> {
        let fresh = std::mem::take(&mut lock(&self.graveyard).fresh);
        let barrier = |fresh: Fresh| {
            vk::ImageMemoryBarrier2::default()
                .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
                .old_layout(vk::ImageLayout::UNDEFINED)
                .new_layout(vk::ImageLayout::GENERAL)
                .image(fresh.handle)
                .subresource_range(fresh.range)
        };
        fresh.into_iter().map(barrier).collect()
    }

    /// Dropped objects that are not destroyed yet.
    pub(super) fn buried(&self) -> usize {
        lock(&self.graveyard).graves.len()
    }
}
