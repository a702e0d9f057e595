//! Every live buffer and image of a device by name, and the counts by which tests see that nothing piles up.

use super::Gpu;
use super::device::Shared;
use super::graveyard::lock;
use std::collections::BTreeMap;

/// What kind of resource it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResourceKind {
    /// A buffer of the device's own memory.
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
    /// What kind it is.
    pub kind: ResourceKind,
    /// What it holds \[bytes\]; the device may reserve a little more.
    pub bytes: u64,
}

/// Live resources by identity: in the order in which they were made.
pub(super) type Registry = BTreeMap<u64, ResourceInfo>;

/// What a device holds and has made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Pipelines made since the device was opened; one that was there already does not count again.
    pub pipelines_made: u64,
    /// Pipelines that are given out again when they are asked for.
    pub pipelines_kept: usize,
    /// Descriptor sets.
    pub sets: usize,
    /// Pools they come from.
    pub pools: usize,
    /// Device memory reserved, that of dropped resources included which are still in use \[bytes\].
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

impl Gpu {
    /// Every live buffer and image, in the order in which they were made.
    pub fn resources(&self) -> Vec<ResourceInfo> {
        lock(&self.shared.registry).values().cloned().collect()
    }

    /// What the device holds, and how many pipelines it has made.
    pub fn counters(&self) -> Counters {
        self.shared.collect();
        let (sets, pools) = lock(&self.shared.descriptors).counts();
        let pipelines = self.pipelines.borrow();
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
