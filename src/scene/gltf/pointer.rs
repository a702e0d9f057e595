//! JSON pointers of KHR_animation_pointer, resolved to the properties that the engine supports.

use super::animations::{Aim, Form, node_aim, target_count, weights};
use crate::Result;
use crate::scene::accessor::Semantic;
use crate::scene::animation::Quantity;
use crate::scene::json::{Document, Object, plural, printable};

/// Target of a pointer and the form of its values; `None` if the engine does not support it.
pub(super) fn aim(document: &Document, pointer: &str, from: &Object) -> Result<Option<(Aim, Form)>> {
    let Some(path) = pointer.strip_prefix('/') else {
        return Err(from.error(format!("pointer {} does not begin with /: export the file again", printable(pointer))));
    };
    let words: Vec<String> = path.split('/').map(|word| word.replace("~1", "/").replace("~0", "~")).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let number = |word: &str| -> Result<usize> {
        word.parse().map_err(|_| {
            let (word, pointer) = (printable(word), printable(pointer));
            from.error(format!("pointer {pointer}: {word} is no index: export the file again"))
        })
    };
    let numbers = |aim: Aim, width: usize| Ok(Some((aim, Form { semantic: Semantic::Numbers(width), width })));
    match &words[..] {
        ["nodes", node, "extensions", "KHR_node_visibility", "visible"] => {
            let node = number(node)?;
            document.item("nodes", node, from)?;
            Ok(Some((Aim::Visible(node), Form { semantic: Semantic::Flag, width: 1 })))
        }
        ["nodes", node, path] => {
            let found = node_aim(document, number(node)?, path, None, from)?;
            // A pointer may have any integer component type.
            Ok(found.map(|(aim, form)| (aim, widened(form))))
        }
        ["nodes", node, "weights", element] => {
            let found = node_aim(document, number(node)?, "weights", Some(number(element)?), from)?;
            Ok(found.map(|(aim, form)| (aim, widened(form))))
        }
        ["meshes", mesh, "weights", element @ ..] if element.len() < 2 => {
            let mesh = number(mesh)?;
            let element = element.first().map(|word| number(word)).transpose()?;
            let targets = target_count(&document.item("meshes", mesh, from)?)?;
            let width = weights(targets, element, || format!("mesh {mesh}"), from)?;
            Ok(Some((Aim::MeshWeights(mesh, element), Form { semantic: Semantic::Numbers(1), width })))
        }
        ["cameras", camera, kind, field] => {
            let camera = number(camera)?;
            document.item("cameras", camera, from)?;
            match (*kind, *field) {
                ("perspective", "yfov") => numbers(Aim::Camera(camera, Quantity::Yfov), 1),
                ("orthographic", "ymag") => numbers(Aim::Camera(camera, Quantity::Ymag), 1),
                _ => Ok(None),
            }
        }
        ["extensions", "KHR_lights_punctual", "lights", light, field @ ..] => {
            let light = number(light)?;
            let root = document.object().extension("KHR_lights_punctual")?;
            let lights = root.map(|root| root.objects("lights", "light")).transpose()?.unwrap_or_default();
            if light >= lights.len() {
                let lights = plural(lights.len(), "light");
                return Err(
                    from.error(format!("animates light {light}, but the file has {lights}: export the file again"))
                );
            }
            match field {
                ["color"] => numbers(Aim::Light(light, Quantity::LightColor, 0), 3),
                ["intensity"] => numbers(Aim::Light(light, Quantity::LightIntensity, 0), 1),
                ["range"] => numbers(Aim::Light(light, Quantity::LightRange, 0), 1),
                ["spot", "innerConeAngle"] => numbers(Aim::Light(light, Quantity::Cone, 0), 1),
                ["spot", "outerConeAngle"] => numbers(Aim::Light(light, Quantity::Cone, 1), 1),
                _ => Ok(None),
            }
        }
        ["materials", material, field @ ..] => {
            let material = number(material)?;
            document.item("materials", material, from)?;
            match material_quantity(field) {
                Some((quantity, part, width)) => numbers(Aim::Material(material, quantity, part), width),
                None => Ok(None),
            }
        }
        _ => Ok(None),
    }
}

fn widened(form: Form) -> Form {
    let components = if form.semantic == Semantic::Weight { 1 } else { form.width };
    Form { semantic: Semantic::Numbers(components), ..form }
}

/// The material property at a path, the part of it, and the number of components.
fn material_quantity(path: &[&str]) -> Option<(Quantity, usize, usize)> {
    let found = match path {
        ["pbrMetallicRoughness", "baseColorFactor"] => (Quantity::BaseColor, 0, 4),
        ["pbrMetallicRoughness", "metallicFactor"] => (Quantity::Metallic, 0, 1),
        ["pbrMetallicRoughness", "roughnessFactor"] => (Quantity::Roughness, 0, 1),
        ["emissiveFactor"] => (Quantity::Emission, 0, 3),
        ["extensions", "KHR_materials_emissive_strength", "emissiveStrength"] => (Quantity::Emission, 1, 1),
        ["alphaCutoff"] => (Quantity::AlphaCutoff, 0, 1),
        ["normalTexture", "scale"] => (Quantity::NormalScale, 0, 1),
        ["extensions", "KHR_materials_ior", "ior"] => (Quantity::Ior, 0, 1),
        ["extensions", "KHR_materials_specular", "specularFactor"] => (Quantity::Specular, 0, 1),
        ["extensions", "KHR_materials_specular", "specularColorFactor"] => (Quantity::SpecularColor, 0, 3),
        [texture @ .., "extensions", "KHR_texture_transform", field] => {
            let place = TEXTURES.iter().position(|path| path.split('/').eq(texture.iter().copied()))?;
            let (part, width) = match *field {
                "offset" => (0, 2),
                "rotation" => (1, 1),
                "scale" => (2, 2),
                _ => return None,
            };
            (Quantity::TextureTransform(place), part, width)
        }
        _ => return None,
    };
    Some(found)
}

/// Paths of a material's textures in the file, in the order of `Material::textures_mut`.
pub(super) const TEXTURES: [&str; 12] = [
    "pbrMetallicRoughness/baseColorTexture",
    "pbrMetallicRoughness/metallicRoughnessTexture",
    "normalTexture",
    "emissiveTexture",
    "extensions/KHR_materials_specular/specularTexture",
    "extensions/KHR_materials_specular/specularColorTexture",
    "extensions/KHR_materials_transmission/transmissionTexture",
    "extensions/KHR_materials_volume/thicknessTexture",
    "extensions/KHR_materials_clearcoat/clearcoatTexture",
    "extensions/KHR_materials_clearcoat/clearcoatRoughnessTexture",
    "extensions/KHR_materials_sheen/sheenColorTexture",
    "extensions/KHR_materials_sheen/sheenRoughnessTexture",
];
