//! The materials panel: properties that can be edited live.

use super::subsurface::{self, Edited};
use super::{choose, is_edited, row, rows};
use crate::app::document::Document;
use egui::{DragValue, RichText, Slider, Ui};
use glam::Vec3;
use lightskin::gpu::Gpu;

pub(super) fn show(ui: &mut Ui, document: &mut Document, edited: &mut Edited, gpu: &Gpu) {
    let Some(scene) = document.scene().filter(|scene| !scene.materials.is_empty()) else {
        ui.label(RichText::new("No materials").weak());
        return;
    };
    let mut chosen = document.material.min(scene.materials.len() - 1);
    let names: Vec<String> = scene.materials.iter().enumerate().map(|(i, m)| format!("{} {}", i + 1, m.name)).collect();
    let all: Vec<(usize, &str)> = names.iter().enumerate().map(|(i, name)| (i, name.as_str())).collect();
    let (mut material, mut changed) = (scene.materials[chosen].clone(), false);
    rows(ui, "material", |ui| {
        let help = "Material to edit. Ctrl+click on the picture picks the material of a surface.";
        row(ui, "Material", help, |ui| choose(ui, "material", &mut chosen, &all));
        let textured = |texture: bool| if texture { " A texture is multiplied with it." } else { "" };
        let filled = material.subsurface.is_some();
        let of_medium = if filled { " It has no effect: light leaves from below the surface." } else { "" };
        let help = format!(
            "Colour of the surface, linear. For metals it is the colour of reflections.{}{of_medium} After a change, one \
             frame recomputes the light.",
            textured(material.base_color_texture.is_some())
        );
        let mut color = material.base_color.truncate().to_array();
        let button = |ui: &mut Ui| ui.add_enabled_ui(!filled, |ui| ui.color_edit_button_rgb(&mut color)).inner;
        changed |= row(ui, "Base colour", &help, button).changed();
        material.base_color = Vec3::from(color).extend(material.base_color.w);
        let own = material.phong.is_some();
        let of_lobe = if own { " It has no effect: this material has its own Phong lobe." } else { "" };
        let map = textured(material.metallic_roughness_texture.is_some());
        let help = format!("Roughness from 0, a mirror, to 1, matt.{map}{of_lobe}");
        let slider = |value| Slider::new(value, 0.0..=1.0).max_decimals(2);
        let roughness = row(ui, "Roughness", &help, |ui| ui.add_enabled(!own, slider(&mut material.roughness)));
        changed |= is_edited(&roughness);
        let help = format!("From 0, a dielectric, to 1, a metal.{map}{of_lobe}{of_medium}");
        let metallic = row(ui, "Metallic", &help, |ui| ui.add_enabled(!own && !filled, slider(&mut material.metallic)));
        changed |= is_edited(&metallic);
        let map = textured(material.specular_texture.is_some() || material.specular_color_texture.is_some());
        let help = format!(
            "Strength and colour, linear, of what a dielectric reflects before light enters it. 1 and white follow from \
             its index of refraction, {:.2}. Metals ignore it.{map}{of_lobe}",
            material.ior
        );
        let mut color = material.specular_color.to_array();
        row(ui, "Specular", &help, |ui| {
            let add = |ui: &mut Ui| {
                let tint = ui.color_edit_button_rgb(&mut color);
                let strength = DragValue::new(&mut material.specular).speed(0.01).range(0.0..=1.0).max_decimals(2);
                let strength = ui.add(strength);
                changed |= tint.changed() || is_edited(&strength);
                tint.union(strength)
            };
            ui.add_enabled_ui(!own, |ui| ui.horizontal(add).inner).inner
        });
        material.specular_color = Vec3::from(color);
        let help = format!(
            "Light that the surface emits: colour and radiance in cd/m\u{b2}.{} When a surface starts or stops emitting, the whole \
             scene is uploaded again.",
            textured(material.emissive_texture.is_some())
        );
        let mut strength = material.emissive.max_element();
        let mut color = if strength > 0.0 { (material.emissive / strength).to_array() } else { [1.0; 3] };
        changed |= row(ui, "Emission", &help, |ui| {
            let response = ui.horizontal(|ui| {
                let color = ui.color_edit_button_rgb(&mut color);
                let speed = f64::from(strength).max(1.0) * 0.01;
                color.union(ui.add(DragValue::new(&mut strength).speed(speed).range(0.0..=1e9).suffix(" cd/m\u{b2}")))
            });
            response.inner
        })
        .changed();
        material.emissive = Vec3::from(color) * strength;
        if let Some(of_file) = document.of_file.get(chosen).filter(|_| chosen == document.material) {
            changed |= subsurface::show(ui, (document.material, &mut material), of_file, edited);
        }
    });
    if changed && chosen == document.material {
        document.history.change();
        document.edited.insert(chosen);
        document.edit(gpu, |scene| scene.materials[chosen] = material);
    }
    document.material = chosen;
}
