//! The lights panel: a row for each light, and all values of the chosen one.

use super::{row, rows};
use crate::app::document::Document;
use crate::cli::lights::{KINDS, Lamp, angles, direction, word};
use egui::{DragValue, Response, Ui};
use lightskin::gpu::Gpu;
use lightskin::scene::{Light, LightKind};

pub(super) fn show(ui: &mut Ui, document: &mut Document, gpu: &Gpu) {
    let (mut changed, radius) = (false, document.radius());
    for index in 0..document.lights.lamps.len() {
        let chosen = document.lights.chosen == Some(index);
        let (response, select) = light(ui, &mut document.lights.lamps[index], chosen);
        changed |= response;
        if select {
            document.lights.chosen = (!chosen).then_some(index);
        }
        if document.lights.chosen == Some(index) {
            changed |= values(ui, &mut document.lights.lamps[index], radius);
        }
    }
    if changed {
        document.light(gpu);
    }
    buttons(ui, document, gpu);
}

/// A row with the values that every light has. Returns whether they have changed, and whether the name was clicked.
fn light(ui: &mut Ui, lamp: &mut Lamp, chosen: bool) -> (bool, bool) {
    let (mut changed, mut select) = (false, false);
    let Lamp { light, on, .. } = lamp;
    let kind = word(light.kind);
    let (unit, what) = match light.kind {
        LightKind::Directional => (" lx", "illuminance on a surface that faces the light"),
        LightKind::Point => (" cd", "luminous intensity, equal in all directions"),
        LightKind::Spot { .. } => (" cd", "luminous intensity within the cone"),
    };
    ui.horizontal(|ui| {
        changed |= ui.checkbox(on, "").on_hover_text("Switches the light on or off.").changed();
        let mut color = light.color.to_array();
        let help = "Colour of the light, linear. After a change, one frame recomputes the light.";
        changed |= ui.color_edit_button_rgb(&mut color).on_hover_text(help).changed();
        light.color = color.into();
        let speed = f64::from(light.intensity).abs().max(1e-3) * 0.01;
        let intensity = DragValue::new(&mut light.intensity).speed(speed).range(0.0..=1e9).suffix(unit);
        let intensity = intensity.clamp_existing_to_range(false);
        changed |= ui.add_sized([92.0, 18.0], intensity).on_hover_text(format!("Brightness: {what}.")).changed();
        let is_sun = light.kind == LightKind::Directional;
        let (mut size, unit, most) = if is_sun {
            (2.0 * light.radius.to_degrees(), "\u{b0}", 2.0 * Light::WIDEST_SUN.to_degrees())
        } else {
            (light.radius, " m", 1e6)
        };
        let help = "Size of the light: the apparent angle of a sun or the radius of a lamp. Ray-traced shadows become softer \
                    with it.";
        let drag = DragValue::new(&mut size).speed(0.01).range(0.0..=most).suffix(unit).clamp_existing_to_range(false);
        if ui.add_sized([48.0, 18.0], drag).on_hover_text(help).changed() {
            light.radius = if is_sun { 0.5 * size.to_radians() } else { size };
            changed = true;
        }
        let name = if light.name.is_empty() { kind } else { light.name.as_str() };
        let help = format!("{name}: {kind}. Click to move or aim it: handles appear in the picture, values below.");
        let button = egui::Button::selectable(chosen, name).truncate();
        select = ui.add(button).on_hover_text(help).clicked();
    });
    (changed, select)
}

/// Position, direction and cone of the chosen light. Returns whether they have changed.
fn values(ui: &mut Ui, lamp: &mut Lamp, radius: f64) -> bool {
    let (mut changed, mut placed) = (false, false);
    let Lamp { light, file, .. } = lamp;
    rows(ui, "light", |ui| {
        if light.kind != LightKind::Directional {
            let help = "Position of the light along X, Y and Z [m]. You can also drag its handles in the picture.";
            placed |= several(ui, "Position", help, |ui| {
                let mut drag = |value| {
                    let drag = DragValue::new(value).speed(2e-3 * radius).max_decimals(3);
                    ui.add_sized([56.0, 18.0], drag).changed()
                };
                let [x, y, z] = [&mut light.position.x, &mut light.position.y, &mut light.position.z].map(&mut drag);
                x || y || z
            });
        }
        if light.kind != LightKind::Point {
            let is_sun = light.kind == LightKind::Directional;
            // A sun has the angles of its place in the sky.
            let sign = if is_sun { -1.0 } else { 1.0 };
            let mut at = angles(sign * light.direction);
            let help = if is_sun {
                "Place of the sun: its bearing, counter-clockwise from +Z seen from above, and its height above the horizon. \
                 You can also drag it on the circle in the picture."
            } else {
                "Direction of the beam: its bearing, counter-clockwise from +Z seen from above, and its angle above the \
                 horizon. You can also drag the yellow handle in the picture."
            };
            let turned = several(ui, if is_sun { "Place" } else { "Direction" }, help, |ui| {
                let mut drag = |value, range| {
                    let drag = DragValue::new(value).speed(0.25).range(range).suffix("\u{b0}").max_decimals(2);
                    let drag = drag.clamp_existing_to_range(false);
                    ui.add_sized([56.0, 18.0], drag).changed()
                };
                let [bearing, height] = &mut at;
                drag(bearing, -360.0..=360.0) | drag(height, -90.0..=90.0)
            });
            if turned {
                light.direction = sign * direction(at);
                placed = true;
            }
        }
        if let LightKind::Spot { inner, outer } = &mut light.kind {
            let help = "Half angles of the cone: full intensity within the first, none beyond the second.";
            changed |= several(ui, "Cone", help, |ui| {
                let mut drag = |value: &mut f32, range: std::ops::RangeInclusive<f32>| {
                    let mut angle = value.to_degrees();
                    let drag = DragValue::new(&mut angle).speed(0.1).range(range).suffix("\u{b0}").max_decimals(2);
                    let drag = drag.clamp_existing_to_range(false);
                    let response = ui.add_sized([56.0, 18.0], drag);
                    if response.changed() {
                        *value = angle.to_radians();
                    }
                    response.changed()
                };
                let most = outer.to_degrees();
                drag(inner, 0.0..=most - 0.1) | drag(outer, inner.to_degrees() + 0.1..=90.0)
            });
        }
    });
    if file.is_some() && lamp.is_edited() {
        let help = "Restores the light as the file has it.";
        if ui.button("Reset").on_hover_text(help).clicked() {
            lamp.reset();
            return true;
        }
    }
    lamp.placed |= placed;
    changed || placed
}

/// A named row of several numbers.
fn several(ui: &mut Ui, name: &str, help: &str, add: impl FnOnce(&mut Ui) -> bool) -> bool {
    let mut changed = false;
    row(ui, name, help, |ui| -> Response { ui.horizontal(|ui| changed = add(ui)).response });
    changed
}

/// Buttons that add, copy and remove lights.
fn buttons(ui: &mut Ui, document: &mut Document, gpu: &Gpu) {
    ui.horizontal(|ui| {
        ui.label("Add").on_hover_text("Adds a light in front of what the middle of the picture shows.");
        let help = "Adds it in front of what the middle of the picture shows, as bright as the exposure suggests. A sun stands \
                    50\u{b0} above the horizon.";
        for (name, kind) in KINDS {
            if ui.button(name).on_hover_text(help).clicked() {
                document.add_light(gpu, kind);
            }
        }
        let chosen = document.lights.chosen.and_then(|index| document.lights.lamps.get(index)).cloned();
        if let Some(lamp) = chosen {
            if ui.button("Copy").on_hover_text("Adds a light like the chosen one, in the same place.").clicked() {
                document.lights.add(lamp.light);
                document.light(gpu);
            } else if lamp.file.is_none()
                && ui.button("Remove").on_hover_text("Removes the light. The Delete key does the same.").clicked()
            {
                document.remove_light(gpu);
            }
        }
    });
}
