//! The sky panel: the environment map, its brightness and rotation, the background, and the ground.

use super::{choose, is_edited, row, rows};
use crate::app::document::Document;
use crate::app::input::Wish;
use crate::cli::sky::Background;
use egui::{DragValue, RichText, Slider, Ui};
use lightskin::scene::Scene;
use lightskin::scene::defaults::Ground;

/// Brightness and rotation of the sky and height of the ground while they are being edited. The scene is loaded again when the edit ends.
#[derive(Default)]
pub(super) struct Edited {
    scale: Option<f64>,
    rotate: Option<f64>,
    height: Option<f64>,
}

impl Edited {
    pub(super) fn show(&mut self, ui: &mut Ui, document: &mut Document, wishes: &mut Vec<Wish>) {
        let now = &document.wanted().sky;
        let mut sky = now.clone();
        let own = now.sky.is_some() || now.sky_color.is_some();
        let has_sky = document.scene().is_some_and(|scene| scene.sky.is_some());
        let name = match (&now.sky, now.sky_color) {
            (Some(file), _) => file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            (None, Some(_)) => "one colour".into(),
            (None, None) if has_sky => "of the scene".into(),
            (None, None) => "none".into(),
        };
        let (mut ended, before) = (false, document.wanted().ground());
        let mut ground = before;
        rows(ui, "sky", |ui| {
            let help = "The sky lights the scene from all directions. Drop an environment map on the window to use it: an \
                        equirectangular .hdr or .exr picture in cd/m\u{b2}.";
            row(ui, "Sky", help, |ui| ui.add(egui::Label::new(name).truncate()));
            if own {
                let mut scale = self.scale.unwrap_or(now.sky_scale);
                let help = "Factor of the sky's radiance. The light is computed anew when you release the control.";
                let speed = 0.01 * scale.max(1e-3);
                let drag = DragValue::new(&mut scale).speed(speed).range(1e-6..=1e6).max_decimals(4);
                let response = row(ui, "Brightness", help, |ui| ui.add(drag.update_while_editing(false)));
                self.scale = is_edited(&response).then_some(scale).or(self.scale);
                let mut held = response.dragged() || response.has_focus();
                // One colour has nothing to turn.
                if now.sky.is_some() {
                    let mut rotate = self.rotate.unwrap_or((now.sky_rotate + 180.0).rem_euclid(360.0) - 180.0);
                    let help = "Rotation of the sky about +Y, counter-clockwise seen from above. The light is computed anew when \
                                you release the control.";
                    let slider = Slider::new(&mut rotate, -180.0..=180.0).suffix("\u{b0}").max_decimals(1);
                    let response = row(ui, "Rotation", help, |ui| ui.add(slider.update_while_editing(false)));
                    self.rotate = is_edited(&response).then_some(rotate).or(self.rotate);
                    held |= response.dragged() || response.has_focus();
                }
                ended = !held;
            }
            let mut all = vec![
                (None, "automatic"),
                (Some(Background::Studio), "grey studio"),
                (Some(Background::Transparent), "transparent"),
            ];
            all.extend(has_sky.then_some((Some(Background::Sky), "sky")));
            all.extend(matches!(sky.background, Some(Background::Color(_))).then_some((sky.background, "one colour")));
            let help = "What is shown where there is no surface. It gives no light. Transparent has alpha 0 in saved pictures.";
            row(ui, "Background", help, |ui| choose(ui, "background", &mut sky.background, &all));
            let lowest = document.scene().and_then(Scene::bounds).map_or(0.0, |(low, _)| low.y);
            let at = if let Ground::At(height) = before { height } else { lowest };
            let all = [(Ground::Auto, "automatic"), (Ground::Off, "none"), (Ground::At(at), "at a height")];
            let help = "A plane below the scene. Automatic adds it below an object that has neither lights nor a floor. The scene \
                        is loaded again.";
            row(ui, "Ground", help, |ui| choose(ui, "ground", &mut ground, &all));
            if let Ground::At(at) = before {
                let mut height = self.height.unwrap_or(at);
                let help = "Height of the ground along +Y. The scene is loaded again when you release the control.";
                let speed = 1e-3 * document.radius();
                let drag = DragValue::new(&mut height).speed(speed).suffix(" m").max_decimals(4);
                let response = row(ui, "  height", help, |ui| ui.add(drag.update_while_editing(false)));
                self.height = is_edited(&response).then_some(height).or(self.height);
                if !response.dragged() && !response.has_focus() && ground == before {
                    ground = Ground::At(self.height.take().unwrap_or(at));
                }
            }
        });
        ui.horizontal(|ui| {
            let help = "Opens an environment map with the desktop's file dialog. On Linux this needs a desktop portal.";
            if ui.button("Open sky").on_hover_text(help).clicked() {
                wishes.push(Wish::Ask);
            }
            let help = "Removes this sky. The scene is lit as without --sky.";
            if own && ui.button("Remove").on_hover_text(help).clicked() {
                (sky.sky, sky.sky_color, sky.sky_scale, sky.sky_rotate) = (None, None, 1.0, 0.0);
                *self = Self::default();
            }
        });
        if ended {
            sky.sky_scale = self.scale.take().unwrap_or(sky.sky_scale);
            sky.sky_rotate = self.rotate.take().unwrap_or(sky.sky_rotate);
        }
        if sky != document.wanted().sky || ground != before {
            let mut args = document.wanted().clone();
            args.sky = sky;
            args.set_ground(ground);
            document.open(args, false);
        } else if !own {
            ui.label(RichText::new("Drop an .hdr or .exr file here.").weak());
        }
    }
}
