//! The timings panel: times of frames and their stages.

use crate::app::document::Document;
use egui::{Color32, RichText, Ui};

/// Median, 95th percentile and 99th percentile.
fn quantiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    // Nearest rank: the smallest value that at least this share of the values does not exceed.
    let at = |share: f64| values[((share * values.len() as f64).ceil() as usize).clamp(1, values.len()) - 1];
    [0.5, 0.95, 0.99].map(at)
}

pub(super) fn show(ui: &mut Ui, document: &Document) {
    let Some(last) = document.times.back() else {
        ui.label(RichText::new("No frame yet").weak());
        return;
    };
    let width = ui.available_width() - 10.0;
    let slowest = document.times.iter().map(|frame| frame.ms).fold(1e-6, f64::max);
    let budget = document.args.target_hz.map(|hz| 1000.0 / hz);
    let most = slowest.max(budget.unwrap_or(0.0));
    let (area, response) = ui.allocate_exact_size(egui::vec2(width, 44.0), egui::Sense::hover());
    ui.painter().rect_filled(area, 2.0, Color32::from_gray(18));
    let step = width / document.times.len().max(40) as f32;
    for (i, frame) in document.times.iter().enumerate() {
        let height = (frame.ms / most) as f32 * (area.height() - 4.0);
        let left = area.left() + step * i as f32;
        let bar = egui::Rect::from_min_max(
            egui::pos2(left, area.bottom() - height),
            egui::pos2(left + (step - 1.0).max(1.0), area.bottom()),
        );
        ui.painter().rect_filled(bar, 0.0, Color32::from_rgb(98, 140, 190));
    }
    if let Some(budget) = budget {
        let y = area.bottom() - (budget / most) as f32 * (area.height() - 4.0);
        ui.painter().hline(area.x_range(), y, egui::Stroke::new(1.0, Color32::from_rgb(230, 180, 60)));
    }
    response.on_hover_text(format!(
        "The last {} drawn frames. The slowest took {slowest:.1} ms. --target-hz adds a line at the time that a frame may take.",
        document.times.len()
    ));
    let [median, p95, p99] = quantiles(document.times.iter().map(|frame| frame.ms).collect());
    let help = "Median, 95th and 99th percentile of the frames above: 50, 95 and 99 % of the frames took no longer than these \
                times.";
    ui.label(format!("median {median:.1}, p95 {p95:.1}, p99 {p99:.1} ms")).on_hover_text(help);
    if let Some(budget) = budget {
        let over = document.times.iter().filter(|frame| frame.ms > budget).count();
        let text = format!("{over} of {} over {budget:.1} ms", document.times.len());
        ui.label(text).on_hover_text("Frames that took longer than --target-hz allows.");
    }
    ui.label(format!("last frame {:.1} ms", last.ms))
        .on_hover_text("The last drawn frame. Stages whose inputs have not changed are skipped.");
    let longest = last.stages.iter().map(|(_, ms)| *ms).fold(1e-6, f64::max);
    for (name, ms) in &last.stages {
        let (area, response) = ui.allocate_exact_size(egui::vec2(width, 16.0), egui::Sense::hover());
        let bar = egui::Rect::from_min_size(area.min, egui::vec2(width * (ms / longest) as f32, area.height()));
        ui.painter().rect_filled(bar, 2.0, Color32::from_rgb(50, 68, 92));
        let font = egui::FontId::proportional(12.0);
        let text = ui.visuals().text_color();
        let at = |x: f32| egui::pos2(x, area.center().y);
        ui.painter().text(at(area.left() + 4.0), egui::Align2::LEFT_CENTER, name, font.clone(), text);
        ui.painter().text(at(area.right() - 4.0), egui::Align2::RIGHT_CENTER, format!("{ms:.2} ms"), font, text);
        response.on_hover_text("A stage of the frame. ARCHITECTURE.md describes all stages.");
    }
}

#[cfg(test)]
mod tests {
    use super::quantiles;

    #[test]
    fn quantiles_are_values_that_were_there() {
        assert_eq!(quantiles(vec![3.0]), [3.0; 3]);
        assert_eq!(quantiles((1..=100).rev().map(f64::from).collect()), [50.0, 95.0, 99.0]);
        assert_eq!(quantiles(vec![1.0, 9.0]), [1.0, 9.0, 9.0]);
    }
}
