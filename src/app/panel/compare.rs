//! What the picture is held against: controls, and what stands over the picture.

use super::{choose, row, rows};
use crate::app::compare::{Compare, Map};
use crate::app::input::Wish;
use crate::app::side::Source;
use egui::{Color32, CursorIcon, Id, Rect, RichText, Sense, Slider, Stroke, Ui};

/// Width of what drags the wipe [points].
const HANDLE: f32 = 12.0;

pub(super) fn section(ui: &mut Ui, compare: &mut Compare, wishes: &mut Vec<Wish>) {
    let was_shown =
        ui.ctx().data_mut(|data| std::mem::replace(data.get_temp_mut_or(Id::unique("shown"), false), compare.shown));
    // What has just been switched on shows its controls.
    let open = (compare.shown && !was_shown).then_some(true);
    egui::CollapsingHeader::new(RichText::new("Compare").strong()).open(open).show_unindented(ui, |ui| {
        ui.add_space(2.0);
        controls(ui, compare, wishes);
        ui.add_space(6.0);
    });
}

fn controls(ui: &mut Ui, compare: &mut Compare, wishes: &mut Vec<Wish>) {
    rows(ui, "compare", |ui| {
        let help = "Shows two pictures of this view side by side. Space does the same.";
        row(ui, "Reference", help, |ui| ui.checkbox(&mut compare.shown, "shown (Space)"));
        let sources = [
            (Source::Lightskin, "lightskin"),
            (Source::PathTrace, "path tracer"),
            (Source::SameBounces, "same bounces, traced"),
            (Source::BruteForce, "brute force"),
            (Source::File, "a file"),
        ];
        let [left, right] = &mut compare.sides;
        let help = "What is on the left of the wipe and is measured. The path tracer follows all light there is; with the same \
                    bounces it follows what the caches do. It works on one thread and rests while you move something. Brute \
                    force lights every pixel by every virtual light, without shadows, some rows with each frame. A file is a \
                    PNG dropped here, or an EXR dropped while the reference shows.";
        row(ui, "Left", help, |ui| choose(ui, "left", &mut left.source, &sources));
        let help = "What is on the right of the wipe: the reference. The left picture is measured against it. A file that is \
                    dropped comes here, unless the left side waits for one.";
        row(ui, "Right", help, |ui| choose(ui, "right", &mut right.source, &sources));
        let help = "How much of the width the left picture has. The line over the picture can be dragged, too.";
        row(ui, "Wipe", help, |ui| {
            let mut percent = 100.0 * compare.wipe;
            let response = ui.add(Slider::new(&mut percent, 0.0..=100.0).suffix(" %").max_decimals(0));
            compare.wipe = percent / 100.0;
            response
        });
        let maps = [
            (Map::Reference, "the right picture"),
            (Map::Flip, "map of FLIP"),
            (Map::Relmse, "map of relative squares"),
        ];
        let help = "What stands on the right of the wipe: the right picture, or a map of how far the left one is from it. FLIP is what an \
                    eye sees when flipping between both. Black is no error.";
        row(ui, "Show", help, |ui| choose(ui, "map", &mut compare.map, &maps));
    });
    let help = "FLIP is the mean of what an eye sees, from 0 to 1. relMSE is the mean relative squared error. Bias is how \
                much brighter the left picture is than the right one. `lightskin compare` says the same of two files.";
    ui.label(numbers(compare)).on_hover_text(help);
    if let Some(size) = compare.file_size() {
        let text = format!("Size of the file, {} x {}", size[0], size[1]);
        let help = "Makes the window so large that the picture has the file's size. Only then can they be compared.";
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

/// The wipe's line, which can be dragged, and what is seen beside it.
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
