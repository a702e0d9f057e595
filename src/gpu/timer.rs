//! Frame slots: each has a command buffer and a ring of timestamps, so that no frame waits for its own figures.

use super::device::Shared;
use super::{Gpu, vulkan};
use crate::error::Result;
use ash::vk;
use std::sync::Arc;

/// Zones per frame that are timed; further ones run untimed.
pub(crate) const MAX_ZONES: u32 = 64;

/// Time of one zone of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ZoneTime {
    /// The stage's name.
    pub name: &'static str,
    /// GPU time [ms].
    pub time_ms: f64,
}

/// What one frame under way owns.
pub(crate) struct Slot {
    shared: Arc<Shared>,
    pub(crate) buffer: vk::CommandBuffer,
    pub(crate) queries: vk::QueryPool,
    pub(crate) zones: Vec<&'static str>,
    /// Timeline value that says this slot is free again.
    pub(crate) done: u64,
}

impl Slot {
    pub(crate) fn new(shared: &Arc<Shared>, index: usize) -> Result<Self> {
        let info = vk::CommandBufferAllocateInfo::default().command_pool(shared.pool).command_buffer_count(1);
        // SAFETY: the pool is alive and outlives the slot.
        let buffer = unsafe { shared.device.allocate_command_buffers(&info) }.map_err(vulkan("command buffer"))?[0];
        shared.name(buffer, &format!("frame.commands {index}"));
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(2 * MAX_ZONES);
        // SAFETY: the device is alive; destroyed in `Drop`.
        let queries = unsafe { shared.device.create_query_pool(&info, None) }.map_err(vulkan("timestamp queries"))?;
        shared.name(queries, &format!("frame.timestamps {index}"));
        // SAFETY: hostQueryReset is enabled and the pool is not in use.
        unsafe { shared.device.reset_query_pool(queries, 0, 2 * MAX_ZONES) };
        Ok(Self { shared: shared.clone(), buffer, queries, zones: Vec::with_capacity(MAX_ZONES as usize), done: 0 })
    }

    /// Times of the frame this slot last held; the frame must be done. Zones of the same name are summed.
    pub(crate) fn times(&self, gpu: &Gpu) -> Result<Vec<ZoneTime>> {
        let mut stamps = vec![0_u64; 2 * self.zones.len()];
        if !stamps.is_empty() {
            // SAFETY: all these queries were written by the finished frame.
            unsafe {
                gpu.shared.device.get_query_pool_results(self.queries, 0, &mut stamps, vk::QueryResultFlags::TYPE_64)
            }
            .map_err(vulkan("reading timestamps"))?;
        }
        let mut times: Vec<ZoneTime> = Vec::with_capacity(self.zones.len());
        for (zone, pair) in self.zones.iter().zip(stamps.chunks_exact(2)) {
            let ticks = pair[1].wrapping_sub(pair[0]) & gpu.timestamp_mask;
            let time_ms = ticks as f64 * gpu.timestamp_period_ns * 1e-6;
            match times.iter_mut().find(|t| t.name == *zone) {
                Some(t) => t.time_ms += time_ms,
                None => times.push(ZoneTime { name: zone, time_ms }),
            }
        }
        Ok(times)
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.shared.wait_to_drop();
        // SAFETY: nothing is in use after the wait; the command buffer goes with its pool.
        unsafe { self.shared.device.destroy_query_pool(self.queries, None) };
    }
}
