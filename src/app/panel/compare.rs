//! The comparison panel: its controls, and the overlay on the picture.

use super::{choose, row, rows};
use crate::app::compare::{Compare, Map};
use crate::app::input::Wish;
use crate::app::side::Source;
use egui::{Color32, CursorIcon, Id, Rect, RichText, Sense, Slider, Stroke, Ui};

/// Width of the draggable area of the wipe [points].
const HANDLE: f32 = 12.0;

pub(super) fn section(ui: &mut Ui, compare: &mut Compare, wishes: &mut Vec<Wish>) {
    let was_shown =
        ui.ctx().data_mut(|data| std::mem::replace(data.get_temp_mut_or(Id::unique("shown"), false), compare.shown));
    // Open the section when the comparison is switched on.
    let open = (compare.shown && !was_shown).then_some(true);
    egui::CollapsingHeader::new(RichText::new("Compare").strong()).open(open).show_unindented(ui, |ui| {
        ui.add_space(2.0);
        controls(ui, compare, wishes);
        ui.add_space(6.0);
    });
}

fn controls(ui: &mut Ui, compare: &mut Compare, wishes: &mut Vec<Wish>) {
    rows(ui, "compare", |ui| {
        let help = "Shows two pictures of this view side by side. The Space key does the same.";
        row(ui, "Reference", help, |ui| ui.checkbox(&mut compare.shown, "shown (Space)"));
        let sources = [
            (Source::Lightskin, "lightskin"),
            (Source::PathTrace, "path tracer"),
            (Source::SameBounces, "traced, same bounces"),
            (Source::BruteForce, "brute force"),
            (Source::File, "a file"),
        ];
        let [left, right] = &mut compare.sides;
        let help = "Picture on the left of the wipe. Its error is measured. The path tracer follows all light paths, or only \
                    those of the caches with the same bounces. It uses one thread and pauses while you move something. Brute \
                    force lights every pixel by every virtual light, without shadows, a few rows per frame. A file is a PNG \
                    dropped on the window, or an EXR dropped while the reference is shown.";
        row(ui, "Left", help, |ui| choose(ui, "left", &mut left.source, &sources));
        let help = "Picture on the right of the wipe: the reference for the left picture. A dropped file is shown here, unless \
                    the left side waits for a file.";
        row(ui, "Right", help, |ui| choose(ui, "right", &mut right.source, &sources));
        let help = "Share of the width for the left picture. You can also drag the line over the picture.";
        row(ui, "Wipe", help, |ui| {
            let mut percent = 100.0 * compare.wipe;
            let response = ui.add(Slider::new(&mut percent, 0.0..=100.0).suffix(" %").max_decimals(0));
            compare.wipe = percent / 100.0;
            response
        });
        let maps = [(Map::Reference, "the right picture"), (Map::Flip, "FLIP map"), (Map::Relmse, "relMSE map")];
        let help = "Shows the right picture, or a map of the error of the left picture, on the right of the wipe. FLIP is the \
                    difference that an eye sees when flipping between both. relMSE is the relative squared error. Black means \
                    no error.";
        row(ui, "Show", help, |ui| choose(ui, "map", &mut compare.map, &maps));
    });
    let help = "FLIP is the mean visible difference, from 0 to 1. relMSE is the mean relative squared error. Bias is how much \
                brighter the left picture is than the right one. `lightskin compare` measures two files in the same way.";
    ui.label(numbers(compare)).on_hover_text(help);
    if let Some(size) = compare.file_size() {
        let text = format!("Match the file's size, {} x {}", size[0], size[1]);
        let help = "Resizes the window so that the picture has the size of the file. Only pictures of equal size can be compared.";
        if ui.button(text).on_hover_text(help).clicked() {
            wishes.push(Wish::Size(size));
        }
    }
    ui.label(RichText::new(compare.state()).weak());
}

fn numbers(compare: &Compare) -> String {
    let Some(errors) = &compare.errors else { return "FLIP -   relMSE -   bias -".into() };
    let bias = 100.0 * errors.bias;
    format!("FLIP {:.4}   relMSE {:.5}   bias {bias:+.2} %", errors.flip, errors.relmse)
}

/// Draws the draggable line of the wipe, and a description of the two pictures with their errors.
pub(in crate::app) fn overlay(ui: &Ui, compare: &mut Compare, picture: Rect) {
    if !compare.shown || picture.width() < 2.0 * HANDLE {
        return;
    }
    let x = picture.left() + compare.wipe * picture.width();
    let corner = egui::pos2((x - 0.5 * HANDLE).clamp(picture.left(), picture.right() - HANDLE), picture.top());
    egui::Area::new(Id::unique("wipe")).fixed_pos(corner).constrain(false).show(ui.ctx(), |ui| {
        let (area, response) = ui.allocate_exact_size(egui::vec2(HANDLE, picture.height()), Sense::drag());
        let response = response.on_hover_cursor(CursorIcon::ResizeHorizontal);
        if let Some(at) = response.interact_pointer_pos().filter(|_| response.dragged()) {
            compare.wipe = ((at.x - picture.left()) / picture.width()).clamp(0.0, 1.0);
        }
        if compare.wipe > 0.0 && compare.wipe < 1.0 {
            ui.painter().vline(x, area.y_range(), Stroke::new(1.0, Color32::from_white_alpha(180)));
        }
    });
    if picture.width() < 240.0 || picture.height() < 120.0 {
        return;
    }
    let mut lines = vec![compare.state(), numbers(compare)];
    lines.extend(compare.errors.as_ref().and_then(|errors| errors.scale).map(|scale| format!("map {scale}")));
    let at = egui::pos2(picture.left() + 8.0, picture.bottom() - 8.0);
    let painter = ui.ctx().layer_painter(egui::LayerId::new(egui::Order::Middle, Id::unique("compared")));
    let font = egui::FontId::proportional(12.0);
    let text = painter.layout(lines.join("\n"), font, Color32::from_gray(235), picture.width() - 28.0);
    let back = Rect::from_min_size(at - egui::vec2(0.0, text.size().y), text.size()).expand(4.0);
    painter.with_clip_rect(picture).rect_filled(back, 3.0, Color32::from_black_alpha(170));
    painter.with_clip_rect(picture).galley(back.min + egui::vec2(4.0, 4.0), text, Color32::WHITE);
}
