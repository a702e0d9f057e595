//! Materials and textures for shaders.

use crate::error::Result;
use crate::gpu::{Format, Gpu, Image, SamplerKind};
use crate::image::mip_chain;
use crate::scene::{Material, Sampler, Scene, Texture, Wrap};
use crate::shared::{self, TEXTURE_COUNT, TextureSlot};
use ash::vk::SamplerAddressMode;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A material for shaders.
pub(super) fn material(m: &Material) -> shared::Material {
    shared::Material {
        base_color: m.base_color,
        emissive: m.emissive,
        alpha_cutoff: m.alpha_cutoff.unwrap_or(-1.0),
        seen_cutoff: m.seen_cutoff().unwrap_or(-1.0),
        blend: m.blend.into(),
        transmission: m.transmission,
        optical_depth: m.optical_depth,
        specular_color: m.specular_color,
        specular: m.specular,
        phong_specular: m.phong.map_or(Vec3::ZERO, |p| p.specular),
        phong_exponent: m.phong.map_or(-1.0, |p| p.exponent),
        metallic: m.metallic,
        roughness: m.roughness,
        ior: m.ior,
        normal_scale: m.normal_scale,
    }
}

/// Textures of a material in the order of the shaders, and whether they are sRGB.
pub(super) fn used(m: &Material) -> [(Option<Texture>, bool); TEXTURE_COUNT as usize] {
    [
        (m.base_color_texture, true),
        (m.metallic_roughness_texture, false),
        (m.normal_texture, false),
        (m.emissive_texture, true),
        (m.specular_texture, false),
        (m.specular_color_texture, true),
        (m.transmission_texture, false),
        (m.thickness_texture, false),
    ]
}

/// How the textures of a material are looked up, for shaders.
pub(super) fn slots(m: &Material) -> [TextureSlot; TEXTURE_COUNT as usize] {
    used(m).map(|(texture, _)| {
        texture.map_or_else(TextureSlot::default, |t| TextureSlot {
            linear: Vec4::from_array(t.transform.matrix2.to_cols_array()),
            translation: t.transform.translation,
            uv_set: u32::from(t.uv_set),
            present: 1,
        })
    })
}

/// Image and sampler of each texture of each material.
pub(super) type MaterialTextures = Vec<[(usize, SamplerKind); TEXTURE_COUNT as usize]>;

/// Uploads each image once per colour space it is used in; image 0 is one white texel for what a material lacks.
pub(super) fn upload_textures(gpu: &Gpu, scene: &Scene) -> Result<(Vec<Image>, MaterialTextures)> {
    let mut wanted: BTreeMap<(usize, bool), usize> = BTreeMap::new();
    for (texture, srgb) in scene.materials.iter().flat_map(used) {
        if let Some(texture) = texture {
            let next = wanted.len() + 1;
            wanted.entry((texture.image, srgb)).or_insert(next);
        }
    }
    let chains: Vec<_> = wanted
        .par_iter()
        .map(|(&(image, srgb), &slot)| {
            let image = &scene.images[image];
            (slot, srgb, mip_chain(&image.rgba, image.width, image.height, srgb))
        })
        .collect();
    let mut textures: Vec<Option<Image>> = Vec::new();
    textures.resize_with(wanted.len() + 1, || None);
    textures[0] = Some(gpu.texture("scene.texture white", Format::R8G8B8A8_UNORM, 1, 1, &[vec![255; 4]])?);
    for ((&(index, _), _), (slot, srgb, levels)) in wanted.iter().zip(chains) {
        let image = &scene.images[index];
        let format = if srgb { Format::R8G8B8A8_SRGB } else { Format::R8G8B8A8_UNORM };
        textures[slot] =
            Some(gpu.texture(&format!("scene.texture {}", image.name), format, image.width, image.height, &levels)?);
    }
    let mut per_material = Vec::new();
    for material in &scene.materials {
        let mut row = [(0, sampler_kind(Default::default())); TEXTURE_COUNT as usize];
        for (i, (texture, srgb)) in used(material).into_iter().enumerate() {
            if let Some(texture) = texture {
                row[i] = (wanted[&(texture.image, srgb)], sampler_kind(texture.sampler));
            }
        }
        per_material.push(row);
    }
    Ok((textures.into_iter().flatten().collect(), per_material))
}

fn sampler_kind(sampler: Sampler) -> SamplerKind {
    let wrap = |w| match w {
        Wrap::Repeat => SamplerAddressMode::REPEAT,
        Wrap::Mirror => SamplerAddressMode::MIRRORED_REPEAT,
        Wrap::Clamp => SamplerAddressMode::CLAMP_TO_EDGE,
    };
    SamplerKind { wrap: [wrap(sampler.wrap_u), wrap(sampler.wrap_v)], nearest: sampler.nearest }
}
