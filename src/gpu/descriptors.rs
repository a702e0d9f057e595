//! Descriptor sets by what is bound: written once on first use, so that a frame like the last one makes none, and given
//! back with the first of the things they name.

use super::device::Shared;
use super::vulkan;
use crate::error::Result;
use ash::vk;
use std::collections::HashMap;
use std::sync::Arc;

/// One set, with the pool it came from and the identities of everything it names.
struct Set {
    handle: vk::DescriptorSet,
    pool: usize,
    names: Box<[u64]>,
}

/// What is bound, as numbers: the layout's identity, then three for each resource.
pub(super) type Key = [u64];

/// All pools and sets.
#[derive(Default)]
pub(super) struct Descriptors {
    pools: Vec<vk::DescriptorPool>,
    sets: HashMap<Arc<Key>, Set>,
    /// Sets that name an identity.
    naming: HashMap<u64, Vec<Arc<Key>>>,
}

const SETS_PER_POOL: u32 = 256;

impl Descriptors {
    /// The set with this key, or a fresh one that `write` fills. It goes with the first of `names`, identities of the layout
    /// and the resources, that is destroyed.
    pub(super) fn get(
        &mut self,
        shared: &Shared,
        key: &Key,
        (name, layout): (&str, vk::DescriptorSetLayout),
        names: impl FnOnce() -> Box<[u64]>,
        write: impl FnOnce(vk::DescriptorSet) -> Result<()>,
    ) -> Result<vk::DescriptorSet> {
        if let Some(set) = self.sets.get(key) {
            return Ok(set.handle);
        }
        let (handle, pool) = self.allocate(shared, layout)?;
        shared.name(handle, name);
        if let Err(error) = write(handle) {
            self.free(&shared.device, handle, pool);
            return Err(error);
        }
        let key: Arc<Key> = key.into();
        let names = names();
        for id in &names {
            self.naming.entry(*id).or_default().push(key.clone());
        }
        self.sets.insert(key, Set { handle, pool, names });
        Ok(handle)
    }

    /// A set from the first pool that has room.
    fn allocate(&mut self, shared: &Shared, layout: vk::DescriptorSetLayout) -> Result<(vk::DescriptorSet, usize)> {
        let layouts = [layout];
        for at in 0.. {
            let fresh = at == self.pools.len();
            if fresh {
                self.pools.push(pool(shared)?);
            }
            let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pools[at]).set_layouts(&layouts);
            // SAFETY: pool and layout are alive, and only the holder of `self` uses the pool.
            match unsafe { shared.device.allocate_descriptor_sets(&info) } {
                Ok(sets) => return Ok((sets[0], at)),
                Err(vk::Result::ERROR_OUT_OF_POOL_MEMORY | vk::Result::ERROR_FRAGMENTED_POOL) if !fresh => {}
                Err(result) => return Err(vulkan("descriptor set")(result)),
            }
        }
        unreachable!("a fresh pool has given a set or an error")
    }

    fn free(&self, device: &ash::Device, set: vk::DescriptorSet, pool: usize) {
        // SAFETY: the set came from this pool, which allows freeing; no submission that uses it is pending.
        if let Err(result) = unsafe { device.free_descriptor_sets(self.pools[pool], &[set]) } {
            log::debug!("freeing a descriptor set: {result}");
        }
    }

    /// Gives back all sets that name something which nothing in use names any more.
    pub(super) fn forget(&mut self, device: &ash::Device, id: u64) {
        for key in self.naming.remove(&id).unwrap_or_default() {
            let Some(set) = self.sets.remove(&key) else { continue };
            for other in set.names.iter().filter(|other| **other != id) {
                if let Some(keys) = self.naming.get_mut(other) {
                    keys.retain(|k| !Arc::ptr_eq(k, &key));
                }
            }
            self.free(device, set.handle, set.pool);
        }
    }

    /// Numbers of sets and of pools.
    pub(super) fn counts(&self) -> (usize, usize) {
        (self.sets.len(), self.pools.len())
    }

    /// Destroys all pools, when the device goes.
    pub(super) fn destroy(&mut self, device: &ash::Device) {
        for pool in self.pools.drain(..) {
            // SAFETY: the device is idle, and no set is used after this.
            unsafe { device.destroy_descriptor_pool(pool, None) };
        }
    }
}

fn pool(shared: &Shared) -> Result<vk::DescriptorPool> {
    let sizes = [
        vk::DescriptorType::STORAGE_BUFFER,
        vk::DescriptorType::UNIFORM_BUFFER,
        vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
        vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
        vk::DescriptorType::STORAGE_IMAGE,
    ]
    .map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: 8 * SETS_PER_POOL });
    let info = vk::DescriptorPoolCreateInfo::default()
        .flags(vk::DescriptorPoolCreateFlags::FREE_DESCRIPTOR_SET)
        .max_sets(SETS_PER_POOL)
        .pool_sizes(&sizes);
    // SAFETY: the device is alive; destroyed in `destroy`.
    let pool = unsafe { shared.device.create_descriptor_pool(&info, None) }.map_err(vulkan("descriptor pool"))?;
    shared.name(pool, "gpu.descriptors");
    Ok(pool)
}
