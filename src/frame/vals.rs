//! The VALs of all lights: written by stage 4, read by stage 6. METHOD 2.

use super::settings::ProxyWeight;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Device};
use crate::shared::{PACK_BLOCK, VAL_TILE, Val};
use glam::Vec3;

/// The VALs of all lights.
pub struct Vals {
    /// One VAL per RSM texel, ordered by light, view and row, followed by the VALs of emissive surfaces.
    pub all: Buffer,
    /// Number of VALs.
    pub count: u32,
    /// 1 where a VAL carries light or contributes to the position of a proxy.
    pub flags: Buffer,
    /// Number of flagged VALs in each block.
    pub blocks: Buffer,
    /// The flagged VALs in order, padded to whole tiles with VALs without light.
    pub live: Buffer,
    /// Number of flagged VALs before padding.
    pub live_count: Buffer,
    /// Copy of the VALs of emissive surfaces that carry light, and their number; only if there are any.
    pub(super) emitted: Option<(Buffer, Buffer)>,
}

impl Vals {
    /// Creates buffers for this many VALs, named after the stage that writes them.
    pub(super) fn new(gpu: &Device, stage: &str, count: u32) -> Result<Self> {
        let bytes = |count: u32| u64::from(count) * size_of::<Val>() as u64;
        Ok(Self {
            all: gpu.buffer(&format!("{stage}.vals"), bytes(count))?,
            count,
            flags: gpu.buffer(&format!("{stage}.val_flags"), 4 * u64::from(count))?,
            blocks: gpu.buffer(&format!("{stage}.val_blocks"), 4 * u64::from(count.div_ceil(PACK_BLOCK)))?,
            live: gpu.buffer(&format!("{stage}.live_vals"), bytes(count.next_multiple_of(VAL_TILE)))?,
            live_count: gpu.buffer(&format!("{stage}.live_val_count"), 4)?,
            emitted: None,
        })
    }

    /// Creates `count` VALs, of which the last are given. Only `update` changes these.
    pub(super) fn with(gpu: &Device, count: u32, last: &[Val], weight: ProxyWeight) -> Result<Self> {
        let made = Self::new(gpu, "rsm", count)?;
        if last.is_empty() {
            return Ok(made);
        }
        let (given, given_flags) = weighed(last, weight);
        let mut all = vec![Val::default(); count as usize - last.len()];
        let mut flags = vec![0; all.len()];
        all.extend(given);
        flags.extend(given_flags);
        let (shining, shining_count) = shining(&all[all.len() - last.len()..]);
        let emitted = (
            gpu.buffer_from("rsm.emitted_vals", &shining)?,
            gpu.buffer_from("rsm.emitted_val_count", &[shining_count])?,
        );
        Ok(Self {
            all: gpu.buffer_from("rsm.vals", &all)?,
            flags: gpu.buffer_from("rsm.val_flags", &flags)?,
            emitted: Some(emitted),
            ..made
        })
    }

    /// Records an update of the last VALs.
    pub(super) fn update(&self, cmd: &Cmd<'_>, last: &[Val], weight: ProxyWeight) {
        let (vals, flags) = weighed(last, weight);
        let first = u64::from(self.count) - last.len() as u64;
        cmd.update(&self.all, first * size_of::<Val>() as u64, &vals);
        cmd.update(&self.flags, 4 * first, &flags);
        if let Some((emitted, count)) = &self.emitted {
            let (shining, shining_count) = shining(&vals);
            cmd.update(emitted, 0, &shining);
            cmd.update(count, 0, &[shining_count]);
        }
    }

    /// These VALs, all of them live.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn of(gpu: &Device, vals: &[Val]) -> Result<Self> {
        let mut padded = vals.to_vec();
        padded.resize(vals.len().next_multiple_of(VAL_TILE as usize), Val { area: 1.0, ..Val::default() });
        let count = vals.len() as u32;
        let live = gpu.buffer_from("rsm.live_vals", &padded)?;
        Ok(Self { live, live_count: gpu.buffer_from("rsm.live_val_count", &[count])?, ..Self::new(gpu, "rsm", count)? })
    }
}

/// The VALs that carry light, padded with dark ones to as many whole tiles as all VALs need, and their number.
fn shining(vals: &[Val]) -> (Vec<Val>, u32) {
    let mut shining: Vec<Val> = vals.iter().filter(|val| val.flux != Vec3::ZERO).copied().collect();
    let count = shining.len() as u32;
    shining.resize(vals.len().next_multiple_of(VAL_TILE as usize), Val { area: 1.0, ..Val::default() });
    (shining, count)
}

/// VALs with their weights for the positions of proxies, and flags of those that carry light.
fn weighed(vals: &[Val], weight: ProxyWeight) -> (Vec<Val>, Vec<u32>) {
    let weight_of = |val: &Val| match weight {
        ProxyWeight::Irradiance => val.flux.dot(Vec3::new(0.2126, 0.7152, 0.0722)),
        ProxyWeight::FormFactor if val.flux == Vec3::ZERO => 0.0,
        ProxyWeight::FormFactor => val.area,
    };
    vals.iter().map(|val| (Val { weight: weight_of(val), ..*val }, u32::from(val.flux != Vec3::ZERO))).unzip()
}
