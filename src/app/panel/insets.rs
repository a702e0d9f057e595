//! Controls of the insets, and what is written at them.

use super::{choose, row, rows};
use crate::app::document::Document;
use crate::app::inset::{Insets, Map, distance_by_depth, farthest};
use crate::app::lights::light_name;
use egui::{Align2, Color32, DragValue, FontId, Painter, Rect, Stroke, Ui};
use lightskin::frame::Engine;

/// Largest side of an inset, as a share of the picture's shorter side.
const MOST: f32 = 0.4;

/// Distance of insets from the picture's border and from each other [points].
const GAP: f32 = 12.0;

/// Smallest width of the text at an inset [points].
const LEAST_TEXT: f32 = 130.0;

/// Shows the controls.
pub(super) fn controls(ui: &mut Ui, document: &mut Document) {
    let Some(engine) = &document.engine else { return };
    let (world, insets) = (engine.world(), &mut document.insets);
    let names: Vec<String> = (0..world.lights().len()).map(|i| light_name(engine, i)).collect();
    let lights: Vec<(usize, &str)> = names.iter().enumerate().map(|(i, name)| (i, name.as_str())).collect();
    rows(ui, "insets", |ui| {
        let maps = [
            (Map::Off, "off"),
            (Map::Shadow, "shadow map: depth"),
            (Map::Depth, "RSM: depth"),
            (Map::Normal, "RSM: normals"),
            (Map::Albedo, "RSM: albedo"),
        ];
        let help = "Shows what a light sees, in a corner of the picture. The texels of its reflective shadow map (RSM) become \
                    virtual lights. All lights draw their RSMs into the same images, one after another. So the chosen one is \
                    drawn again, whenever the light or the scene changes. A shadow map is shown only if each light keeps \
                    its own.";
        row(ui, "Light's map", help, |ui| choose(ui, "inset map", &mut insets.map, &maps));
        if let Some((mut light, info, view)) = insets.chosen(world).filter(|_| insets.map != Map::Off) {
            let help = "The light whose map is shown.";
            if row(ui, "  of", help, |ui| choose(ui, "inset light", &mut light, &lights)).changed() {
                (insets.light, insets.view) = (light, 0);
            } else if info.views > 1 {
                let mut number = view + 1;
                let help = "The face that is shown. Lamps see through the six faces of a cube: +X, -X, +Y, -Y, +Z and -Z. \
                            Emissive surfaces have five faces for each of several points.";
                let drag = DragValue::new(&mut number).range(1..=info.views).speed(0.05);
                if row(ui, "  face", help, |ui| ui.add(drag.suffix(format!(" of {}", info.views)))).changed() {
                    insets.view = number - 1;
                }
            }
        }
        let help = "Shows the depth image of the cache that is nearest to the surface under the pointer, in a corner of the \
                    picture: how far the cache sees in each direction above its surface, before other surfaces hide virtual \
                    lights. The middle is the direction of its normal. Black means that nothing is in the way. With short rays, \
                    surfaces in their range are left out. Only caches that the picture needs have images. Costs one pass over \
                    these caches, and waits for each frame.";
        row(ui, "Depth image", help, |ui| ui.checkbox(&mut insets.depth_image, "of the cache at the pointer"));
    });
}

/// Places the insets in a corner of the picture, and writes what they are.
pub(in crate::app) fn show(ui: &Ui, document: &mut Document, picture: Rect) {
    let Some(engine) = &document.engine else { return };
    let insets = &mut document.insets;
    let painter = ui.ctx().layer_painter(egui::LayerId::new(egui::Order::Middle, egui::Id::unique("insets")));
    let painter = painter.with_clip_rect(picture);
    let most = (MOST * picture.width().min(picture.height())).max(0.0);
    let mut corner = picture.max - egui::vec2(GAP, GAP);
    (insets.places, insets.sides) = ([[0; 3]; 2], [None; 2]);
    if insets.map != Map::Off {
        let found = insets.map_side(engine);
        let text = found.map_or_else(|why| why.to_owned(), |_| of_map(insets, engine));
        insets.sides[0] = found.ok();
        insets.places[0] = place(&painter, &mut corner, most, found.ok(), &text).0;
    }
    if insets.depth_image {
        let found = Insets::depth_image_side(engine);
        let text = found.map_or_else(|why| why.to_owned(), |_| of_cache(insets, engine));
        insets.sides[1] = found.ok();
        let (place, square) = place(&painter, &mut corner, most, found.ok(), &text);
        insets.places[1] = place;
        if found.is_ok() {
            // Beyond this circle there are no directions.
            painter.circle_stroke(square.center(), 0.5 * square.width(), Stroke::new(1.0, Color32::from_gray(120)));
        }
    }
}

/// Places an inset left of the last one, and writes its text above. Without texels there is only the text. Returns its
/// corner and side in the window [pixels], and the square that it fills.
fn place(painter: &Painter, corner: &mut egui::Pos2, most: f32, texels: Option<u32>, text: &str) -> ([u32; 3], Rect) {
    let scale = painter.pixels_per_point();
    let most = (most * scale) as u32;
    // Texels are whole numbers of pixels, unless there are more texels than pixels.
    let side = texels.map_or(0, |texels| if texels <= most { most / texels * texels } else { most });
    let [right, bottom] = [corner.x, corner.y].map(|at| (at * scale).max(0.0) as u32);
    let [left, top] = [right, bottom].map(|end| end.saturating_sub(side));
    let square = Rect::from_min_size(egui::pos2(left as f32, top as f32), egui::Vec2::splat(side as f32)) / scale;
    let width = square.width().max(LEAST_TEXT);
    let font = FontId::proportional(11.0);
    let words = painter.layout(text.to_owned(), font, Color32::from_gray(235), width - 8.0);
    let back = Align2::RIGHT_BOTTOM
        .anchor_size(square.right_top() - egui::vec2(0.0, 4.0), egui::vec2(width, words.size().y + 6.0));
    painter.rect_filled(back, 3.0, Color32::from_black_alpha(170));
    painter.galley(back.min + egui::vec2(4.0, 3.0), words, Color32::WHITE);
    painter.rect_stroke(square, 0.0, Stroke::new(1.0, Color32::from_gray(120)), egui::StrokeKind::Outside);
    corner.x -= width.max(square.width()) + GAP;
    ([left, top, side], square)
}

/// What is written at the map of a light.
fn of_map(insets: &Insets, engine: &Engine) -> String {
    let Some((index, info, view)) = insets.chosen(engine.world()) else { return String::new() };
    let what = match insets.map {
        Map::Off => "",
        Map::Shadow => "shadow map",
        Map::Depth => "RSM, depth",
        Map::Normal => "RSM, normals",
        Map::Albedo => "RSM, albedo",
    };
    let face = if info.views > 1 { format!(", face {}", view + 1) } else { String::new() };
    let scale = if [Map::Shadow, Map::Depth].contains(&insets.map) {
        colors(distance_by_depth(engine.world(), info.first_view + view).1)
    } else {
        String::new()
    };
    format!("Light {}{face}: {what}{scale}", index + 1)
}

/// What is written at the depth image.
fn of_cache(insets: &Insets, engine: &Engine) -> String {
    let Some(found) = insets.found else { return "No cache: move the pointer over a surface.".into() };
    let at = engine.world().origin + found.position.as_dvec3();
    let scale = colors(farthest(engine.world()));
    format!("Cache {} at {:.2} {:.2} {:.2} m{scale}", found.number - 1, at.x, at.y, at.z)
}

/// The distances at both ends of the false colours, of which `far` is the larger [m].
fn colors(far: f32) -> String {
    let [low, high] = Insets::scale(far).map(|end| super::debug::short(end.into()));
    format!("\nblue {low} m, red {high} m")
}
