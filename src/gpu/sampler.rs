//! Filtering and wrapping of textures.

use super::graveyard::lock;
use super::{Device, vulkan};
use crate::error::Result;
use ash::vk;

/// Filtering and wrapping of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SamplerKind {
    /// Wrapping along u and v.
    pub wrap: [vk::SamplerAddressMode; 2],
    /// Whether to take the nearest texel instead of filtering.
    pub nearest: bool,
}

impl SamplerKind {
    /// Filtered, with the edge's texels repeated beyond it.
    pub const CLAMPED: Self = Self { wrap: [vk::SamplerAddressMode::CLAMP_TO_EDGE; 2], nearest: false };
}

impl Device {
    /// The sampler of a kind, created on first use and kept as long as the device.
    pub(crate) fn sampler(&self, kind: SamplerKind) -> Result<vk::Sampler> {
        let mut samplers = lock(&self.samplers);
        if let Some(sampler) = samplers.get(&kind) {
            return Ok(*sampler);
        }
        let core = [
            vk::SamplerAddressMode::REPEAT,
            vk::SamplerAddressMode::MIRRORED_REPEAT,
            vk::SamplerAddressMode::CLAMP_TO_EDGE,
            vk::SamplerAddressMode::CLAMP_TO_BORDER,
        ];
        assert!(kind.wrap.iter().all(|wrap| core.contains(wrap)), "{kind:?}: not every device wraps like this");
        let filter = if kind.nearest { vk::Filter::NEAREST } else { vk::Filter::LINEAR };
        let info = vk::SamplerCreateInfo::default()
            .mag_filter(filter)
            .min_filter(filter)
            .mipmap_mode(if kind.nearest { vk::SamplerMipmapMode::NEAREST } else { vk::SamplerMipmapMode::LINEAR })
            .address_mode_u(kind.wrap[0])
            .address_mode_v(kind.wrap[1])
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .max_lod(vk::LOD_CLAMP_NONE);
        // SAFETY: the device is alive; destroyed when `Device` is dropped.
        let sampler = unsafe { self.shared.device.create_sampler(&info, None) }.map_err(vulkan("sampler"))?;
        self.shared.name(sampler, &format!("gpu.sampler {kind:?}"));
        samplers.insert(kind, sampler);
        Ok(sampler)
    }
}
