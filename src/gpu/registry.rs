//! All live buffers and images of a device by name, and counters with which tests detect leaks.

use super::Device;
use super::device::Shared;
use super::graveyard::lock;
use std::collections::BTreeMap;

/// Kind of a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResourceKind {
    /// A buffer in device-local memory.
    Buffer,
    /// A buffer that the CPU writes or reads.
    HostBuffer,
    /// An image.
    Image,
}

/// A live resource.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResourceInfo {
    /// `stage.thing`.
    pub name: String,
    /// Kind of the resource.
    pub kind: ResourceKind,
    /// Size of its content \[bytes\]; the device may reserve slightly more.
    pub bytes: u64,
}

/// Live resources by identity, which is the order of creation.
pub(super) type Registry = BTreeMap<u64, ResourceInfo>;

/// Counters of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Pipelines created since the device was opened; reused ones do not count again.
    pub pipelines_made: u64,
    /// Pipelines in the cache.
    pub pipelines_kept: usize,
    /// Descriptor sets.
    pub sets: usize,
    /// Descriptor pools.
    pub pools: usize,
    /// Reserved device memory, including dropped resources that are still in use \[bytes\].
    pub allocated_bytes: u64,
    /// Live buffers and images.
    pub resources: usize,
    /// Dropped objects that are still in use.
    pub buried: usize,
}

impl Shared {
    pub(super) fn register(&self, id: u64, name: &str, kind: ResourceKind, bytes: u64) {
        lock(&self.registry).insert(id, ResourceInfo { name: name.to_owned(), kind, bytes });
    }

    pub(super) fn unregister(&self, id: u64) {
        lock(&self.registry).remove(&id);
    }
}

impl Device {
    /// All live buffers and images, in order of creation.
    pub fn resources(&self) -> Vec<ResourceInfo> {
        lock(&self.shared.registry).values().cloned().collect()
    }

    /// The current counters.
    pub fn counters(&self) -> Counters {
        self.shared.collect();
        let (sets, pools) = lock(&self.shared.descriptors).counts();
        let pipelines = lock(&self.pipelines);
        Counters {
            pipelines_made: pipelines.made(),
            pipelines_kept: pipelines.kept(),
            sets,
            pools,
            allocated_bytes: lock(&self.shared.allocator).as_ref().map_or(0, |allocator| allocator.capacity()),
            resources: lock(&self.shared.registry).len(),
            buried: self.shared.buried(),
        }
    }
}
