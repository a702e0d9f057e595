//! Device memory, and errors if there is not enough.

use super::Gpu;
use super::device::Shared;
use super::graveyard::lock;
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use gpu_allocator::{AllocationError, MemoryLocation};

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
        let allocate = || lock(&self.allocator).as_mut().expect("alive").allocate(&desc);
        let mut allocation = allocate();
        if matches!(allocation, Err(AllocationError::OutOfMemory)) {
            // Freeing dropped objects may give enough memory.
            self.wait()?;
            self.collect();
            allocation = allocate();
        }
        allocation.map_err(|e| Error::Vulkan {
            what: format!("{name}: {} KiB", requirements.size / 1024),
            result: format!("{e}; use a smaller picture, RSM or shadow map, or fewer caches"),
        })
    }

    pub(super) fn free(&self, allocation: Option<Allocation>) {
        if let Some(allocation) = allocation
            && let Some(allocator) = lock(&self.allocator).as_mut()
            && let Err(error) = allocator.free(allocation)
        {
            log::error!("freeing device memory: {error}");
        }
    }
}

impl Gpu {
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
