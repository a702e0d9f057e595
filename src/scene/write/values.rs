//! Materials, lights and cameras as glTF has them.

use super::Document;
use crate::scene::animation::Quantity;
use crate::scene::{Camera, Light, LightKind, Material, Projection, Scene};
use glam::{DVec3, Vec3, Vec4};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The rest values of what animations set, by what it is and the index of the light, camera or material.
pub(super) type Rest = BTreeMap<(Quantity, usize), [[f64; 4]; 3]>;

/// See [`Rest`].
pub(super) fn rest(scene: &Scene) -> Rest {
    let properties = scene.rig.iter().flat_map(|rig| &rig.parts().properties);
    properties.flat_map(|p| p.of().iter().map(|&of| ((p.quantity(), of), p.at_rest()))).collect()
}

/// A material. Extensions that animations aim at are there even where their values say nothing.
pub(super) fn material(document: &mut Document, index: usize, material: &Material, rest: &Rest) -> Value {
    let animated = |quantity| rest.get(&(quantity, index));
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
    if material.double_sided {
        value["doubleSided"] = json!(true);
    }
    if let Some(cutoff) = material.alpha_cutoff {
        value["alphaMode"] = json!("MASK");
        value["alphaCutoff"] = json!(cutoff);
    }
    let mut extend = |name: &'static str, members: Value| {
        document.extensions.insert(name);
        value["extensions"][name] = members;
    };
    // The core's factor ends at 1; what is brighter is told by its largest channel.
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
    let specular = animated(Quantity::Specular).or(animated(Quantity::SpecularColor));
    if material.specular != 1.0 || material.specular_color != Vec3::ONE || specular.is_some() {
        let factors = json!({
            "specularFactor": material.specular,
            "specularColorFactor": material.specular_color.to_array(),
        });
        extend("KHR_materials_specular", factors);
    }
    if emissive != DVec3::ZERO {
        value["emissiveFactor"] = json!(emissive.to_array());
    }
    if let Some(phong) = material.phong {
        let lobe = json!({ "specular": phong.specular.to_array(), "exponent": phong.exponent });
        value["extras"] = json!({ "lightskin": { "phong": lobe } });
    }
    value
}

/// A light. One that is hidden at rest has an intensity all the same.
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
    value
}

/// The engine takes the near plane from the scene, not from here; glTF wants one all the same.
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
