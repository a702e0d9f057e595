//! Device memory, and errors if there is not enough.

use super::device::Shared;
use super::graveyard::lock;
use super::{Device, vulkan};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use gpu_allocator::{AllocationError, MemoryLocation};
use std::sync::atomic::Ordering;

impl Shared {
    pub(super) fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Allocation> {
        let desc = AllocationCreateDesc {
            name,
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let allocate = || {
            let reserved = self.memory.load(Ordering::Relaxed).saturating_add(requirements.size);
            if reserved > self.most_memory.load(Ordering::Relaxed) {
                return Err(AllocationError::OutOfMemory);
            }
            lock(&self.allocator).as_mut().expect("alive").allocate(&desc)
        };
        let mut allocation = allocate();
        if matches!(allocation, Err(AllocationError::OutOfMemory)) {
            // Freeing dropped objects may give enough memory.
            self.wait()?;
            self.collect();
            allocation = allocate();
        }
        let what = || format!("{name}, {} KiB", requirements.size / 1024);
        let allocation = allocation.map_err(|error| match error {
            AllocationError::OutOfMemory => vulkan(what())(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY),
            other => Error::Vulkan { what: what(), result: other.to_string() },
        })?;
        self.memory.fetch_add(allocation.size(), Ordering::Relaxed);
        Ok(allocation)
    }

    pub(super) fn free(&self, allocation: Option<Allocation>) {
        let Some(allocation) = allocation else { return };
        self.memory.fetch_sub(allocation.size(), Ordering::Relaxed);
        if let Some(allocator) = lock(&self.allocator).as_mut()
            && let Err(error) = allocator.free(allocation)
        {
            log::error!("freeing device memory: {error}");
        }
    }
}

impl Device {
    /// Error for a resource beyond a limit of the device.
    pub(crate) fn too_large(&self, what: String, limit: u64) -> Error {
        Error::TooLarge(format!(
            "{what}, but {} allows {limit}; lower --rsm, --caches, --size or --quality",
            self.report().name
        ))
    }
}

/// Makes the C library return blocks of 1 MiB and more to the system as soon as they are freed. By default it keeps
/// them for the thread that used them, so a program with many short threads grows by tens of MiB with each one. Meant
/// for programs that run for hours; call it before the first thread starts. A library should leave this to its host.
/// Only has an effect with glibc.
#[cfg(feature = "app")]
pub fn give_memory_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// Smallest block that is allocated directly from the system \[bytes\].
        const SMALLEST: i32 = 1 << 20;
        // SAFETY: sets a parameter of the allocator, which does its own locking.
        unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, SMALLEST) };
    }
}

/// Makes the C library return the free pages of all threads to the system. Meant for a thread that has freed much and that
/// nobody waits for. Only has an effect with glibc.
#[cfg(feature = "app")]
pub fn trim_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: the allocator does its own locking.
    unsafe {
        libc::malloc_trim(0);
    }
}
