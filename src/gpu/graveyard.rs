//! Deferred destruction, and the first layout and content of new objects. The GPU and the commands being recorded may
//! still use a dropped object. It stays in the graveyard until the timeline shows that the last submission that may
//! refer to it is done, so no drop waits. New images have an unusable layout; the next submission of any kind
//! transitions them to GENERAL, and the next frame copies the content of new objects (`upload`). Any thread may create
//! and drop objects at any time.

use super::device::Shared;
use super::upload::{Target, Upload};
use ash::vk;
use gpu_allocator::vulkan::Allocation;
use std::collections::{HashSet, VecDeque};
use std::sync::atomic::Ordering;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Handles of a dropped object, and its memory.
pub(super) enum Remains {
    Buffer { handle: vk::Buffer, texels: Option<vk::BufferView>, memory: Option<Allocation> },
    Image { handle: vk::Image, views: Vec<vk::ImageView>, memory: Option<Allocation> },
    Pipeline(vk::Pipeline),
    Layout { layout: vk::PipelineLayout, set_layout: vk::DescriptorSetLayout },
}

/// One dropped object.
struct Grave {
    /// Timeline value of the last submission that may refer to it.
    until: u64,
    /// Descriptor sets that refer to this identity are freed with it.
    id: u64,
    remains: Remains,
}

/// An image that no submission has transitioned to layout GENERAL yet.
struct Fresh {
    handle: vk::Image,
    id: u64,
    range: vk::ImageSubresourceRange,
}

/// Dropped objects, oldest first, and new ones.
#[derive(Default)]
pub(super) struct Graveyard {
    graves: VecDeque<Grave>,
    /// New images. All are alive, or in a grave; `forget_dropped` removes those that the next submission may outlive.
    fresh: Vec<Fresh>,
    /// Content of new buffers and textures, likewise.
    pub(super) uploads: Vec<Upload>,
}

impl Graveyard {
    /// Removes what is new of objects that were dropped before the recording of submission `number` began. Another thread
    /// may have made and dropped them after the previous submission had taken what was new.
    fn forget_dropped(&mut self, number: u64) {
        if self.fresh.is_empty() && self.uploads.is_empty() {
            return;
        }
        let dropped: HashSet<u64> =
            self.graves.iter().filter(|grave| grave.until < number).map(|grave| grave.id).collect();
        self.fresh.retain(|fresh| !dropped.contains(&fresh.id));
        let staging = self.cancel(|of| dropped.contains(&of));
        self.graves.extend(staging.into_iter().map(|remains| Grave { until: number, id: 0, remains }));
    }

    /// Removes the new content of resources that no submission will use, and returns what is left of it.
    fn cancel(&mut self, is_dropped: impl Fn(u64) -> bool) -> Vec<Remains> {
        self.uploads.extract_if(.., |upload| is_dropped(upload.id)).map(|upload| upload.split().1).collect()
    }
}

/// Locks data that a panic elsewhere cannot leave half changed. Destructors also run while a panic unwinds.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// Takes over a dropped object and destroys all objects that are no longer in use. Never waits.
    pub(super) fn bury(&self, id: u64, remains: Remains) {
        {
            let mut graveyard = lock(&self.graveyard);
            // The order matters: a recording that ends in between has counted its submission first.
            let recording = self.recording.load(Ordering::SeqCst);
            let until = self.submitted.load(Ordering::SeqCst) + u64::from(recording);
            if !recording {
                graveyard.fresh.retain(|fresh| fresh.id != id);
                let staging = graveyard.cancel(|of| of == id);
                graveyard.graves.extend(staging.into_iter().map(|remains| Grave { until, id: 0, remains }));
            }
            graveyard.graves.push_back(Grave { until, id, remains });
        }
        self.collect();
    }

    /// The last completed submission. If nothing is in flight, the maximum number, which also covers an abandoned
    /// submission.
    pub(super) fn done(&self) -> u64 {
        let recording = self.recording.load(Ordering::SeqCst);
        let submitted = self.submitted.load(Ordering::SeqCst);
        // SAFETY: the semaphore is alive.
        let counter = unsafe { self.device.get_semaphore_counter_value(self.timeline) };
        // A lost device no longer uses anything. A submission may be complete before the call that makes it returns.
        let done = counter.unwrap_or(submitted).min(submitted);
        if !recording && done >= submitted { u64::MAX } else { done }
    }

    /// Destroys dropped objects that are no longer in use. Never waits.
    pub(super) fn collect(&self) {
        let over: Vec<Grave> = {
            let mut graveyard = lock(&self.graveyard);
            if graveyard.graves.is_empty() {
                return;
            }
            // Done under the lock, so that no object can be bound, dropped and buried at the same time.
            let done = self.done();
            let count = graveyard.graves.iter().take_while(|grave| grave.until <= done).count();
            let mut over: Vec<Grave> = graveyard.graves.drain(..count).collect();
            if !over.is_empty() {
                graveyard.fresh.retain(|fresh| over.iter().all(|grave| grave.id != fresh.id));
                let staging = graveyard.cancel(|of| over.iter().any(|grave| grave.id == of));
                over.extend(staging.into_iter().map(|remains| Grave { until: 0, id: 0, remains }));
            }
            over
        };
        for grave in over {
            self.destroy(grave);
        }
    }

    /// Destroys all remaining objects, together with the device.
    pub(super) fn collect_all(&self) {
        let Graveyard { graves, uploads, .. } = std::mem::take(&mut *lock(&self.graveyard));
        let staging = uploads.into_iter().map(|upload| Grave { until: 0, id: 0, remains: upload.split().1 });
        for grave in graves.into_iter().chain(staging) {
            self.destroy(grave);
        }
    }

    fn destroy(&self, Grave { id, remains, .. }: Grave) {
        lock(&self.descriptors).forget(&self.device, id);
        let device = &self.device;
        // SAFETY: all handles were created from this device and their owner has been dropped; no commands that are
        // submitted or being recorded use them (`collect`), and no descriptor set refers to them any more. Views are
        // destroyed before their buffer or image.
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

    /// Registers an image that is still in layout UNDEFINED.
    pub(super) fn freshly_made(&self, handle: vk::Image, id: u64, range: vk::ImageSubresourceRange) {
        lock(&self.graveyard).fresh.push(Fresh { handle, id, range });
    }

    /// Barriers that transition all new images to layout GENERAL, for the submission about to be made. It must be the
    /// one being recorded, since images dropped meanwhile live only until its end.
    pub(super) fn fresh(&self) -> Vec<vk::ImageMemoryBarrier2<'static>> {
        let fresh = {
            let mut graveyard = lock(&self.graveyard);
            graveyard.forget_dropped(self.submitted.load(Ordering::SeqCst) + 1);
            std::mem::take(&mut graveyard.fresh)
        };
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

    /// Copies of all new content, for the submission being recorded, as for `fresh`.
    pub(super) fn new_content(&self) -> Vec<(vk::Buffer, Target)> {
        let graveyard = &mut *lock(&self.graveyard);
        let until = self.submitted.load(Ordering::SeqCst) + 1;
        graveyard.forget_dropped(until);
        let graves = &mut graveyard.graves;
        let copies = graveyard.uploads.drain(..).map(|upload| {
            let (copy, remains) = upload.split();
            graves.push_back(Grave { until, id: 0, remains });
            copy
        });
        copies.collect()
    }

    /// Number of dropped objects that are not destroyed yet.
    pub(super) fn buried(&self) -> usize {
        lock(&self.graveyard).graves.len()
    }
}
