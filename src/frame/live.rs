//! The list of caches that a gather lights: those that visible surfaces need, or all. METHOD 9.

use crate::error::Result;
use crate::gpu::{Buffer, Device, Gpu};
use crate::shared::{DEPTH_IMAGE_ROW, GatherSums, LiveArgs, PACK_BLOCK, VAL_TILE};

/// The list that a gather processes. Its items are caches or, in the cluster path, groups of consecutive caches. A
/// group is live if any of its caches is, and all of it is lit, so the light of a cache does not depend on which other
/// caches are visible.
pub struct Live {
    /// 1 where a visible vertex or cell references an item; all 0 between frames.
    pub flags: Buffer,
    /// Number of flagged items in each block.
    pub blocks: Buffer,
    /// Indices of live items, ascending. Contains all items until they are culled.
    pub list: Buffer,
    /// Number of live items, and the gather's dispatch size. Covers all items until they are culled.
    pub args: Buffer,
    /// Number of items in all instances.
    pub count: u32,
    /// Number of caches in all instances.
    pub caches: u32,
    /// Caches per item.
    pub group: u32,
    /// Items per workgroup.
    pub per_workgroup: u32,
    /// VALs, or nodes, per part of the sums.
    pub split: u32,
}

/// Configuration of a list.
#[derive(Clone, Copy, Debug)]
pub struct Items {
    /// Number of caches in all instances.
    pub caches: u32,
    /// Caches per item.
    pub group: u32,
    /// Items per workgroup.
    pub per_workgroup: u32,
    /// Number of VALs, or nodes, that light the caches.
    pub lights: u32,
    /// VALs, or nodes, per part of the sums.
    pub split: u32,
}

/// Memory limit for the parts of the sums \[bytes\], unless parts would then become too long.
const PARTS_BYTES: u64 = 64 << 20;

/// Lights per part: the wanted number, or more if the parts would take too much memory, but never more than `longest`.
pub(super) fn split_of(caches: u32, lights: u32, wanted: u32, longest: u32) -> u32 {
    let sums = u64::from(caches.max(1)) * size_of::<GatherSums>() as u64;
    let in_memory = u64::from(lights.max(1)).div_ceil((PARTS_BYTES / sums).max(1));
    in_memory.max(wanted.into()).next_multiple_of(VAL_TILE.into()).min(longest.into()) as u32
}

/// Number of parts for this many lights.
pub(super) fn parts_of(lights: u32, split: u32) -> u32 {
    lights.max(1).div_ceil(split)
}

/// Creates a buffer for this many parts of the sums of all caches.
pub(super) fn new_parts(gpu: &Device, caches: u32, parts: u32) -> Result<Buffer> {
    gpu.buffer("gather.parts", u64::from(caches.max(1)) * size_of::<GatherSums>() as u64 * u64::from(parts))
}

impl Live {
    /// Creates a list of all caches.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn new(gpu: &Device, items: Items) -> Result<Self> {
        let Items { caches, group, per_workgroup, lights, split } = items;
        let (count, room) = (caches.div_ceil(group), caches.max(1).div_ceil(group));
        Ok(Self {
            flags: gpu.buffer_from("cull.flags", &vec![0_u32; room as usize])?,
            blocks: gpu.buffer("cull.blocks", 4 * u64::from(room.div_ceil(PACK_BLOCK)))?,
            list: gpu.buffer_from("cull.live", &(0..room).collect::<Vec<_>>())?,
            args: gpu.buffer_from("cull.live_args", &[live_args(count, lights.max(1), per_workgroup, split)])?,
            count,
            caches,
            group,
            per_workgroup,
            split,
        })
    }

    /// Number of caches in the live items. Waits for the device.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn lit(&self, gpu: &Gpu) -> Result<u32> {
        let items = gpu.read::<LiveArgs>(&self.args)?[0].cache_count;
        let list: Vec<u32> = gpu.read(&self.list)?;
        Ok(list[..items as usize].iter().map(|item| (self.caches - item * self.group).min(self.group)).sum())
    }
}

/// The gather's dispatch over these caches (or groups) and VALs (or nodes). Must match glsl/lib/pack.glsl.
fn live_args(caches: u32, lights: u32, per_workgroup: u32, split: u32) -> LiveArgs {
    LiveArgs {
        groups_x: caches.div_ceil(per_workgroup),
        groups_y: lights.div_ceil(split).max(1),
        groups_z: 1,
        cache_count: caches,
        images_x: caches.min(DEPTH_IMAGE_ROW),
        images_y: caches.div_ceil(DEPTH_IMAGE_ROW),
        images_z: 1,
    }
}
