//! Descriptor sets, cached by the bound resources. A set is written once on first use, so a frame like the previous one
//! writes none. It is freed as soon as one of the objects it refers to is destroyed.

use super::device::Shared;
use super::vulkan;
use crate::error::Result;
use ash::vk;
use std::collections::HashMap;
use std::sync::Arc;

/// One set, with its pool and the identities of all objects it refers to.
struct Set {
    handle: vk::DescriptorSet,
    pool: usize,
    names: Box<[u64]>,
}

/// Key of a set: the layout's identity, then three numbers for each resource.
pub(super) type Key = [u64];

/// All pools and sets.
#[derive(Default)]
pub(super) struct Descriptors {
    pools: Vec<vk::DescriptorPool>,
    sets: HashMap<Arc<Key>, Set>,
    /// Sets that refer to an identity.
    naming: HashMap<u64, Vec<Arc<Key>>>,
}

const SETS_PER_POOL: u32 = 256;

impl Descriptors {
    /// The set with this key, or a new one that `write` fills. It is freed when the first of `names` is destroyed, the
    /// identities of the layout and the resources.
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

    /// Allocates a set from the first pool with space.
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
        unreachable!("a new pool returns a set or an error")
    }

    fn free(&self, device: &ash::Device, set: vk::DescriptorSet, pool: usize) {
        // SAFETY: the set came from this pool, which allows freeing; no submission that uses it is pending.
        if let Err(result) = unsafe { device.free_descriptor_sets(self.pools[pool], &[set]) } {
            log::debug!("freeing a descriptor set: {result}");
        }
    }

    /// Frees all sets that refer to an identity. No pending submission may use them.
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

    /// Destroys all pools, together with the device.
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
