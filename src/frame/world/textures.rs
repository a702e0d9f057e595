//! Materials and textures for shaders.

use super::filled::CloseBy;
use crate::error::Result;
use crate::gpu::{Device, Format, Image, SamplerKind};
use crate::image::{mip_chain, normal_mip_chain};
use crate::scene::{self, Material, Sampler, Scene, Texture, Wrap};
use crate::shared::{self, TEXTURE_COUNT, TextureSlot};
use ash::vk::SamplerAddressMode;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A material in the form that shaders use. `close_by` is the part of the light from inside that leaves close to where it
/// entered.
pub(super) fn material((m, close_by): (&Material, &CloseBy)) -> shared::Material {
    shared::Material {
        base_color: m.base_color,
        emissive: m.emissive,
        alpha_cutoff: m.alpha_cutoff.unwrap_or(-1.0),
        seen_cutoff: m.seen_cutoff().unwrap_or(-1.0),
        blend: m.blend.into(),
        transmission: m.transmission,
        attenuation: m.attenuation,
        thickness: m.thickness,
        specular_color: m.specular_color,
        specular: m.specular,
        phong_specular: m.phong.map_or(Vec3::ZERO, |p| p.specular),
        phong_exponent: m.phong.map_or(-1.0, |p| p.exponent),
        metallic: m.metallic,
        roughness: m.roughness,
        ior: m.ior,
        normal_scale: m.normal_scale,
        coat: m.coat,
        coat_roughness: m.coat_roughness,
        sheen_color: m.sheen_color,
        sheen_roughness: m.sheen_roughness,
        close_by: m
            .subsurface
            .map_or(Vec3::ZERO, |inside| (close_by.share * inside.medium().diffuse_albedo()).as_vec3()),
        inside_ior: m.subsurface.map_or(0.0, |inside| inside.ior),
    }
}

/// Content of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Holds {
    Numbers,
    /// In sRGB.
    Colors,
    Normals,
}

/// Textures of a material in the order of the shaders, and their contents.
pub(super) fn used(m: &Material) -> [(Option<Texture>, Holds); TEXTURE_COUNT as usize] {
    use Holds::{Colors, Normals, Numbers};
    [
        (m.base_color_texture, Colors),
        (m.metallic_roughness_texture, Numbers),
        (m.normal_texture, Normals),
        (m.emissive_texture, Colors),
        (m.specular_texture, Numbers),
        (m.specular_color_texture, Colors),
        (m.transmission_texture, Numbers),
        (m.thickness_texture, Numbers),
        (m.coat_texture, Numbers),
        (m.coat_roughness_texture, Numbers),
        (m.sheen_color_texture, Colors),
        (m.sheen_roughness_texture, Numbers),
    ]
}

/// Lookup parameters of a material's textures, for shaders.
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

/// Maximum number of kinds of materials with their own pipelines.
const MOST_KINDS: usize = 16;

/// The kinds of the materials that a scene uses, for shaders, and the index of each material's kind. Kinds beyond the
/// maximum are drawn as one.
pub(super) fn kinds(scene: &Scene) -> (Vec<u32>, Vec<usize>) {
    let kind = |m: &Material| {
        let textures = used(m).map(|(texture, _)| u32::from(texture.is_some()));
        let bits = textures.iter().enumerate().fold(0, |all, (i, bit)| all | bit << i);
        let masked = m.alpha_cutoff.is_some() || m.seen_cutoff().is_some();
        bits | if m.phong.is_some() { shared::KIND_PHONG } else { 0 } | if masked { shared::KIND_MASKED } else { 0 }
    };
    let mut drawn: Vec<usize> =
        scene.meshes.iter().flat_map(|mesh| &mesh.primitives).map(|primitive| primitive.material).collect();
    drawn.sort_unstable();
    drawn.dedup();
    let mut kinds: Vec<u32> = drawn.iter().map(|i| kind(&scene.materials[*i])).collect();
    kinds.sort_unstable();
    kinds.dedup();
    if kinds.len() > MOST_KINDS {
        let others = kinds.drain(MOST_KINDS - 1..).fold(shared::KIND_MIXED, |all, one| all | one);
        kinds.push(others);
    }
    let last = kinds.len().saturating_sub(1);
    let place = |m| kinds.iter().position(|one| *one == kind(m)).unwrap_or(last);
    let of_materials = scene.materials.iter().map(place).collect();
    (kinds, of_materials)
}

/// Image and sampler of each texture of each material.
pub(super) type MaterialTextures = Vec<[(usize, SamplerKind); TEXTURE_COUNT as usize]>;

/// Uploads each image once per kind of content. Image 0 is one white texel, for missing textures.
pub(super) fn upload_textures(gpu: &Device, scene: &Scene) -> Result<(Vec<Image>, MaterialTextures)> {
    let mut wanted: BTreeMap<(usize, Holds), usize> = BTreeMap::new();
    for (texture, holds) in scene.materials.iter().flat_map(used) {
        if let Some(texture) = texture {
            let next = wanted.len() + 1;
            wanted.entry((texture.image, holds)).or_insert(next);
        }
    }
    let chains: Vec<_> = wanted
        .par_iter()
        .map(|(&(image, holds), &slot)| {
            let scene::Image { rgba, width, height, .. } = &scene.images[image];
            let levels = match holds {
                Holds::Normals => normal_mip_chain(rgba, *width, *height),
                _ => mip_chain(rgba, *width, *height, holds == Holds::Colors),
            };
            (slot, holds, levels)
        })
        .collect();
    let mut textures: Vec<Option<Image>> = Vec::new();
    textures.resize_with(wanted.len() + 1, || None);
    textures[0] = Some(gpu.texture("scene.texture white", Format::R8G8B8A8_UNORM, 1, 1, &[vec![255; 4]])?);
    for ((&(index, _), _), (slot, holds, levels)) in wanted.iter().zip(chains) {
        let image = &scene.images[index];
        let format = if holds == Holds::Colors { Format::R8G8B8A8_SRGB } else { Format::R8G8B8A8_UNORM };
        textures[slot] =
            Some(gpu.texture(&format!("scene.texture {}", image.name), format, image.width, image.height, &levels)?);
    }
    let mut per_material = Vec::new();
    for material in &scene.materials {
        let mut row = [(0, sampler_kind(Default::default())); TEXTURE_COUNT as usize];
        for (i, (texture, holds)) in used(material).into_iter().enumerate() {
            if let Some(texture) = texture {
                row[i] = (wanted[&(texture.image, holds)], sampler_kind(texture.sampler));
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
