//! Style and size of the panels.

use crate::cli::view::UI_SCALES;
use egui::style::ScrollAnimation;
use egui::{Context, Theme};

/// Change of the size by one key press.
const STEP: f32 = 0.1;

/// Style of the panels: dark, so that they do not affect the impression of the picture. With `reduced_motion` they
/// change at once, without transitions.
pub(in crate::app) fn set(panels: &Context, reduced_motion: bool) {
    panels.set_theme(Theme::Dark);
    // On slow devices a frame can take a second, so the press and the release of a button are in different frames.
    panels.options_mut(|options| options.input_options.max_click_duration = 10.0);
    // `Input` has the keys for it.
    panels.options_mut(|options| options.zoom_with_keyboard = false);
    panels.all_styles_mut(|style| {
        style.spacing.slider_width = 118.0;
        style.spacing.combo_width = 168.0;
        style.spacing.item_spacing.y = 5.0;
        style.interaction.tooltip_delay = 0.3;
        if reduced_motion {
            style.animation_time = 0.0;
            style.scroll_animation = ScrollAnimation::none();
            style.visuals.text_cursor.blink = false;
        }
    });
}

/// Sets the size relative to the display's own scale. Events from now on, and the next frame, have this size.
pub(in crate::app) fn set_scale(panels: &Context, scale: f32) {
    panels.options_mut(|options| options.zoom_factor = scale);
}

/// Changes the size by this number of steps.
pub(in crate::app) fn change_scale(panels: &Context, steps: i32) {
    let scale = ((panels.zoom_factor() / STEP).round() + steps as f32) * STEP;
    set_scale(panels, scale.clamp(*UI_SCALES.start(), *UI_SCALES.end()));
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::{Id, RawInput};

    /// How far something has opened 10 ms after it began to.
    fn opened(reduced_motion: bool) -> f32 {
        let panels = Context::default();
        set(&panels, reduced_motion);
        let mut open = 0.0;
        for (time, wanted) in [(0.0, false), (0.01, true), (0.02, true)] {
            let input = RawInput { time: Some(time), ..RawInput::default() };
            let mut output = panels.run_ui(input, |ui| open = ui.ctx().animate_bool(Id::unique("part"), wanted));
            output.textures_delta.clear();
        }
        open
    }

    #[test]
    fn reduced_motion_opens_at_once() {
        assert_eq!(opened(true), 1.0);
        assert!(opened(false) < 0.5);
    }

    #[test]
    fn sizes_have_ends() {
        let panels = Context::default();
        set_scale(&panels, 1.0);
        change_scale(&panels, 3);
        assert!((panels.zoom_factor() - 1.3).abs() < 1e-6);
        change_scale(&panels, 100);
        assert_eq!(panels.zoom_factor(), 4.0);
        change_scale(&panels, -100);
        assert_eq!(panels.zoom_factor(), 0.5);
    }
}
