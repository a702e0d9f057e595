//! Debug views: scales of false colours, marks of caches and lights, and the values of one pixel.

use super::{choose, row, rows};
use crate::app::document::Document;
use crate::app::gizmo::Screen;
use crate::app::marks::Discs;
use egui::{Align2, Color32, DragValue, FontId, Rect, RichText, Stroke, Ui};
use lightskin::gpu::Gpu;
use lightskin::reference::false_color::false_color;

/// Adds the scale of the shown layer, if it has one, below the choice of that layer.
pub(super) fn scale(ui: &mut Ui, document: &mut Document, gpu: &Gpu) {
    if let Some(unit) = document.shown.unit() {
        let help = "Values shown in dark blue and in dark red. The colours between them follow a logarithmic scale.";
        let mut fit = false;
        row(ui, "Scale", help, |ui| {
            ui.horizontal(|ui| {
                let [low, high] = document.scale();
                let (least, most) = (f64::from(*low), f64::from(*high));
                let drag = |value, speed| DragValue::new(value).speed(speed).custom_formatter(|value, _| short(value));
                ui.add(drag(low, 0.02 * least).range(1e-6..=0.99 * most));
                ui.add(drag(high, 0.02 * most).range(1.01 * least..=1e9));
                ui.label(unit);
                fit = ui.button("fit").on_hover_text("Fits the scale to the scene and its exposure.").clicked();
            })
            .response
        });
        if fit {
            document.fit_scale(gpu);
        }
    }
}

/// Shows the controls of the marks.
pub(super) fn marks(ui: &mut Ui, document: &mut Document) {
    let marks = &mut document.marks;
    rows(ui, "marks", |ui| {
        let ways = [
            (Discs::Off, "off"),
            (Discs::Hues, "arbitrary colours"),
            (Discs::Light, "diffuse light"),
            (Discs::Live, "live or dark"),
        ];
        let help = "Draws a disc on the surface at each cache. Arbitrary colours only serve to distinguish the caches. Diffuse \
                    light is what a white, matt surface would reflect there of the cache's light, with the exposure of the \
                    picture. It lacks the light of the sky and of short rays. Live or dark shows the caches that the picture \
                    needs in colour, and those that get no light in dark grey. Each costs one draw of all caches.";
        row(ui, "Caches", help, |ui| choose(ui, "discs", &mut marks.caches, &ways));
        let help = "Draws a line from each cache that gets light towards its diffuse proxy light: the one light that stands for \
                    all virtual lights there. It begins black and has the hue of that light. It ends at the proxy light if \
                    that is near, and else at 1.5 radii of the cache's share of the surface. Costs one draw of all caches.";
        row(ui, "Proxy lights", help, |ui| ui.checkbox(&mut marks.proxies, "as lines"));
        let help = "Draws a disc with a black rim on the surface at each virtual light that sends light. It has the hue of its \
                    light, as bright as the display allows. Large discs stand for large shares of the surface. Costs one draw of \
                    all virtual lights.";
        row(ui, "Virtual lights", help, |ui| ui.checkbox(&mut marks.vals, "as discs"));
    });
}

/// Formats a number with three significant digits.
pub(super) fn short(value: f64) -> String {
    let digits = (2.0 - value.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}

/// Draws the colours of the scale over the picture.
pub(in crate::app) fn legend(ui: &Ui, document: &mut Document, picture: Rect) {
    let Some(unit) = document.shown.unit().filter(|_| picture.width() > 260.0 && picture.height() > 80.0) else {
        return;
    };
    let [low, high] = document.scale().map(f64::from);
    let painter = ui.ctx().layer_painter(egui::LayerId::new(egui::Order::Middle, egui::Id::unique("legend")));
    let painter = painter.with_clip_rect(picture);
    let bar =
        Rect::from_min_size(picture.min + egui::vec2(16.0, 14.0), egui::vec2(picture.width().min(420.0) - 60.0, 12.0));
    painter.rect_filled(
        bar.expand2(egui::vec2(10.0, 8.0)).translate(egui::vec2(0.0, 6.0)),
        3.0,
        Color32::from_black_alpha(170),
    );
    let steps = bar.width() as usize;
    for i in 0..steps {
        let [r, g, b] = (false_color(i as f64 / steps as f64) * 255.0).round().to_array().map(|v| v as u8);
        let x = bar.left() + i as f32;
        let part = Rect::from_min_max(egui::pos2(x, bar.top()), egui::pos2(x + 1.0, bar.bottom()));
        painter.rect_filled(part, 0.0, Color32::from_rgb(r, g, b));
    }
    for i in 0..=4 {
        let share = f64::from(i) / 4.0;
        let value = low * (high / low).powf(share);
        let unit = if i == 4 { format!(" {unit}") } else { String::new() };
        let (x, align) = match i {
            0 => (bar.left(), Align2::LEFT_TOP),
            4 => (bar.right(), Align2::RIGHT_TOP),
            _ => (bar.left() + share as f32 * bar.width(), Align2::CENTER_TOP),
        };
        let text = format!("{}{unit}", short(value));
        painter.text(egui::pos2(x, bar.bottom() + 2.0), align, text, FontId::proportional(11.0), Color32::WHITE);
    }
}

/// Shows over the picture why changed shaders are not in use.
#[cfg(feature = "glsl")]
pub(in crate::app) fn shader_error(ui: &Ui, error: &str, picture: Rect) {
    egui::Area::new(egui::Id::unique("shader error"))
        .fixed_pos(picture.min + egui::vec2(12.0, 12.0))
        .interactable(false)
        .show(ui.ctx(), |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width((picture.width() - 40.0).max(100.0));
                ui.label(RichText::new("The picture has the last shaders that compiled.").strong());
                ui.label(RichText::new(error.trim()).monospace().color(Color32::from_rgb(255, 140, 120)));
            });
        });
}

/// Shows all values of the picked pixel.
pub(super) fn pixel(ui: &mut Ui, document: &mut Document) {
    let Some(pixel) = &document.pixel else { return };
    let mut close = false;
    super::section(ui, "Pixel", true, |ui| {
        rows(ui, "pixel", |ui| {
            for (name, value, help) in pixel.values() {
                ui.label(name).on_hover_text(help);
                ui.label(RichText::new(value).monospace().size(11.0)).on_hover_text(help);
                ui.end_row();
            }
        });
        close = ui.button("Close").on_hover_text("Ctrl+click on the picture shows another pixel.").clicked();
    });
    if close {
        document.pixel = None;
    }
}

/// Draws a cross at the picked pixel's surface and rings at the caches that it averages, the wider the heavier.
pub(in crate::app) fn pixel_marks(ui: &Ui, document: &Document, picture: Rect) {
    let (Some(view), Some(pixel)) = (document.view(), &document.pixel) else { return };
    let Some((place, _)) = pixel.place else { return };
    let seen = Screen { view, origin: pixel.origin, picture };
    let painter = ui.ctx().layer_painter(egui::LayerId::new(egui::Order::Middle, egui::Id::unique("pixel")));
    let painter = painter.with_clip_rect(picture);
    let twice = |width: f32| [(Color32::BLACK, width + 2.0), (Color32::WHITE, width)];
    for cache in &pixel.caches {
        let Some(on) = seen.project(cache.position.as_dvec3() + pixel.origin) else { continue };
        for (color, width) in twice(1.0) {
            painter.circle_stroke(on, 3.0 + 9.0 * cache.weight.sqrt(), Stroke::new(width, color));
        }
    }
    let Some(on) = seen.project(place) else { return };
    for (color, width) in twice(1.0) {
        for along in [egui::vec2(5.0, 5.0), egui::vec2(5.0, -5.0)] {
            painter.line_segment([on - along, on + along], Stroke::new(width, color));
        }
    }
}
