//! Materials, lights and cameras as glTF JSON.

use super::Document;
use crate::scene::animation::Quantity;
use crate::scene::{Camera, Light, LightKind, Material, Projection, Sampler, Scene, Texture, Wrap};
use glam::{Affine2, DVec3, Vec3, Vec4};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Rest values of animated properties, by quantity and by index of the light, camera or material.
pub(super) type Rest = BTreeMap<(Quantity, usize), [[f64; 4]; 3]>;

/// The rest values of a scene's animated properties.
pub(super) fn rest(scene: &Scene) -> Rest {
    let properties = scene.rig.iter().flat_map(|rig| &rig.parts().properties);
    properties.flat_map(|p| p.of().iter().map(|&of| ((p.quantity(), of), p.at_rest()))).collect()
}

/// The file's textures, each an image and a sampler, and the file's samplers.
#[derive(Default)]
pub(super) struct Textures {
    pub(super) list: Vec<Value>,
    pub(super) samplers: Vec<Value>,
}

/// Index of a value in a list; appends the value if it is new.
fn place(list: &mut Vec<Value>, value: Value) -> usize {
    list.iter().position(|known| *known == value).unwrap_or_else(|| {
        list.push(value);
        list.len() - 1
    })
}

/// A material's reference to a texture.
fn texture(document: &mut Document, texture: Texture) -> Value {
    let Texture { image, uv_set, transform, sampler } = texture;
    let mut own = json!({ "source": image });
    if sampler != Sampler::default() {
        let wrap = |wrap| match wrap {
            Wrap::Repeat => 10497,
            Wrap::Mirror => 33648,
            Wrap::Clamp => 33071,
        };
        let filter = if sampler.nearest { 9728 } else { 9729 };
        let value = json!({ "wrapS": wrap(sampler.wrap_u), "wrapT": wrap(sampler.wrap_v), "magFilter": filter });
        own["sampler"] = json!(place(&mut document.textures.samplers, value));
    }
    let mut value = json!({ "index": place(&mut document.textures.list, own) });
    if uv_set != 0 {
        value["texCoord"] = json!(uv_set);
    }
    if transform != Affine2::IDENTITY {
        let [x, y] = [transform.matrix2.x_axis, transform.matrix2.y_axis];
        let scale = [x.length(), y.length().copysign(transform.matrix2.determinant())];
        let rotation = if x.y == 0.0 && x.x > 0.0 { 0.0 } else { (-x.y).atan2(x.x) };
        let members = json!({ "offset": transform.translation.to_array(), "rotation": rotation, "scale": scale });
        document.extensions.insert("KHR_texture_transform");
        value["extensions"]["KHR_texture_transform"] = members;
    }
    value
}

/// A material. Extensions targeted by animations are written even if their values are the defaults.
pub(super) fn material(document: &mut Document, index: usize, material: &Material, rest: &Rest) -> Value {
    let animated = |quantity| rest.get(&(quantity, index));
    let mut told = |own: Option<Texture>| own.map(|own| texture(document, own));
    let [
        base_color,
        metallic_roughness,
        normal,
        emission,
        specular_of,
        specular_color,
        transmission,
        thickness,
        over @ ..,
    ] = material.clone().textures_mut().map(|own| told(*own));
    let mut value = json!({
        "name": material.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": material.base_color.to_array(),
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        },
    });
    if material.base_color == Vec4::ONE {
        value["pbrMetallicRoughness"].as_object_mut().expect("made above").remove("baseColorFactor");
    }
    let of_core = [("baseColorTexture", base_color), ("metallicRoughnessTexture", metallic_roughness)];
    for (key, texture) in of_core.into_iter().filter_map(|(key, texture)| Some((key, texture?))) {
        value["pbrMetallicRoughness"][key] = texture;
    }
    if let Some(mut normal) = normal {
        if material.normal_scale != 1.0 {
            normal["scale"] = json!(material.normal_scale);
        }
        value["normalTexture"] = normal;
    }
    if let Some(emission) = emission {
        value["emissiveTexture"] = emission;
    }
    if material.double_sided {
        value["doubleSided"] = json!(true);
    }
    if material.blend {
        value["alphaMode"] = json!("BLEND");
    } else if let Some(cutoff) = material.seen_cutoff() {
        value["alphaMode"] = json!("MASK");
        value["alphaCutoff"] = json!(cutoff);
    }
    let mut extend = |name: &'static str, members: Value| {
        document.extensions.insert(name);
        value["extensions"][name] = members;
    };
    // The core's factor is at most 1; brighter emission is scaled by its largest channel.
    let mut strength = f64::from(material.emissive.max_element().max(1.0));
    let mut emissive = (material.emissive / strength as f32).as_dvec3();
    if let Some([factor, [own, ..], _]) = animated(Quantity::Emission) {
        (emissive, strength) = (DVec3::from_slice(factor), *own);
    }
    if strength > 1.0 || animated(Quantity::Emission).is_some() {
        extend("KHR_materials_emissive_strength", json!({ "emissiveStrength": strength }));
    }
    if material.ior != 1.5 || animated(Quantity::Ior).is_some() {
        extend("KHR_materials_ior", json!({ "ior": material.ior }));
    }
    if material.transmission > 0.0 {
        let mut factors = json!({ "transmissionFactor": material.transmission });
        if let Some(texture) = transmission {
            factors["transmissionTexture"] = texture;
        }
        extend("KHR_materials_transmission", factors);
    }
    if material.thickness > 0.0 {
        let mut factors = json!({ "thicknessFactor": material.thickness });
        let most = material.attenuation.max_element();
        if most > 0.0 {
            factors["attenuationDistance"] = json!(1.0 / most);
            factors["attenuationColor"] = json!((-material.attenuation / most).exp().to_array());
        }
        if let Some(texture) = thickness {
            factors["thicknessTexture"] = texture;
        }
        extend("KHR_materials_volume", factors);
    }
    for (name, factors) in over_lobes(material, over) {
        extend(name, factors);
    }
    let specular = animated(Quantity::Specular).or(animated(Quantity::SpecularColor));
    let of_specular = [("specularTexture", specular_of), ("specularColorTexture", specular_color)];
    let has_textures = of_specular.iter().any(|(_, texture)| texture.is_some());
    if material.specular != 1.0 || material.specular_color != Vec3::ONE || specular.is_some() || has_textures {
        let mut factors = json!({
            "specularFactor": material.specular,
            "specularColorFactor": material.specular_color.to_array(),
        });
        for (key, texture) in of_specular.into_iter().filter_map(|(key, texture)| Some((key, texture?))) {
            factors[key] = texture;
        }
        extend("KHR_materials_specular", factors);
    }
    if emissive != DVec3::ZERO {
        value["emissiveFactor"] = json!(emissive.to_array());
    }
    if let Some(phong) = material.phong {
        let lobe = json!({ "specular": phong.specular.to_array(), "exponent": phong.exponent });
        value["extras"]["lightskin"]["phong"] = lobe;
    }
    if let Some(inside) = material.subsurface {
        value["extras"]["lightskin"]["subsurface"] = json!({
            "sigma_s": inside.sigma_s.to_array(),
            "sigma_a": inside.sigma_a.to_array(),
            "g": inside.g,
            "ior": inside.ior,
            "scale": inside.scale,
        });
    }
    value
}

/// The coat and sheen extensions of a material, with their textures.
fn over_lobes(material: &Material, textures: [Option<Value>; 4]) -> Vec<(&'static str, Value)> {
    let [coat, coat_roughness, sheen, sheen_roughness] = textures;
    let with = |mut factors: Value, textures: [(&str, Option<Value>); 2]| {
        for (key, texture) in textures.into_iter().filter_map(|(key, texture)| Some((key, texture?))) {
            factors[key] = texture;
        }
        factors
    };
    let mut extensions = Vec::new();
    if material.coat > 0.0 {
        let factors = json!({ "clearcoatFactor": material.coat, "clearcoatRoughnessFactor": material.coat_roughness });
        let textures = [("clearcoatTexture", coat), ("clearcoatRoughnessTexture", coat_roughness)];
        extensions.push(("KHR_materials_clearcoat", with(factors, textures)));
    }
    if material.sheen_color.max_element() > 0.0 {
        let color = material.sheen_color.to_array();
        let factors = json!({ "sheenColorFactor": color, "sheenRoughnessFactor": material.sheen_roughness });
        let textures = [("sheenColorTexture", sheen), ("sheenRoughnessTexture", sheen_roughness)];
        extensions.push(("KHR_materials_sheen", with(factors, textures)));
    }
    extensions
}

/// A light. A light hidden at rest keeps its intensity in the file.
pub(super) fn light(index: usize, light: &Light, rest: &Rest) -> Value {
    let kind = match light.kind {
        LightKind::Directional => "directional",
        LightKind::Point => "point",
        LightKind::Spot { .. } => "spot",
    };
    let mut value = json!({
        "name": light.name,
        "type": kind,
        "color": light.color.to_array(),
        "intensity": rest.get(&(Quantity::LightIntensity, index)).map_or(f64::from(light.intensity), |rest| rest[0][0]),
    });
    if let LightKind::Spot { inner, outer } = light.kind {
        value["spot"] = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
    }
    if let Some(range) = light.range {
        value["range"] = json!(range);
    }
    if light.radius > 0.0 {
        let own = match light.kind {
            LightKind::Directional => json!({ "angle": 2.0 * light.radius.to_degrees() }),
            _ => json!({ "radius": light.radius }),
        };
        value["extras"] = json!({ "lightskin": own });
    }
    value
}

/// A camera. The engine takes the near plane from the scene, but glTF requires one here.
pub(super) fn camera(camera: &Camera) -> Value {
    let mut value = match camera.projection {
        Projection::Perspective { yfov } => {
            json!({ "type": "perspective", "perspective": { "yfov": yfov, "znear": 0.05 } })
        }
        Projection::Orthographic { ymag } => json!({
            "type": "orthographic",
            "orthographic": { "xmag": ymag, "ymag": ymag, "znear": 0.0, "zfar": 1000.0 },
        }),
    };
    value["name"] = json!(camera.name);
    value
}
