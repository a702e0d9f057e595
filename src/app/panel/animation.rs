//! The animation panel: the clip that plays, and its video.

use super::{choose, progress, row, rows};
use crate::app::document::Document;
use crate::app::input::Wish;
use egui::{DragValue, RichText, Slider, Ui};
use lightskin::gpu::Gpu;

/// Shows the controls of the clip and of its video. `fps` is the frame rate of the video [frames/s].
pub(super) fn show(ui: &mut Ui, document: &mut Document, gpu: &Gpu, fps: &mut f64, wishes: &mut Vec<Wish>) {
    if let Some(video) = &document.video {
        let (done, what) = video.progress();
        progress(ui, done, &what);
        if ui.button("Stop").on_hover_text("Stops the video. Pictures that are already written stay.").clicked() {
            wishes.push(Wish::Video(*fps));
        }
        return;
    }
    clip(ui, document, gpu);
    if document.scene().is_none_or(|scene| scene.animations().next().is_none()) {
        return;
    }
    ui.horizontal(|ui| {
        let help = "Saves the whole clip, frame by frame, as numbered PNG files in a new folder within the current folder. \
                    `lightskin render --frames` writes the same pictures.";
        if ui.button("Save video").on_hover_text(help).clicked() {
            wishes.push(Wish::Video(*fps));
        }
        let fps = DragValue::new(fps).speed(0.1).range(1.0..=240.0).suffix(" frames/s");
        ui.add(fps).on_hover_text("Frame rate of the video.");
    });
}

fn clip(ui: &mut Ui, document: &mut Document, gpu: &Gpu) {
    let clips: Vec<(String, f64)> = document
        .scene()
        .map_or_else(Vec::new, |scene| scene.animations().map(|(name, _, end)| (name.to_owned(), end)).collect());
    if clips.is_empty() {
        ui.label(RichText::new("Nothing in this scene moves").weak());
        return;
    }
    let mut clip = document.clip;
    rows(ui, "animation", |ui| {
        let names: Vec<String> = clips.iter().enumerate().map(|(i, (name, _))| format!("{} {name}", i + 1)).collect();
        let mut all: Vec<(Option<usize>, &str)> = vec![(None, "at rest")];
        all.extend(names.iter().enumerate().map(|(i, name)| (Some(i), name.as_str())));
        row(ui, "Clip", "Animation to play.", |ui| choose(ui, "clip", &mut clip.animation, &all));
        let end = clip.animation.map_or(0.0, |animation| clips[animation].1);
        if clip.animation.is_some() {
            clip.time = if end > 0.0 { clip.time.rem_euclid(end) } else { 0.0 };
            let help = "Time within the animation. Nothing is rebaked, and no frame depends on the one before.";
            row(ui, "Time", help, |ui| ui.add(Slider::new(&mut clip.time, 0.0..=end).suffix(" s").max_decimals(2)));
        }
        let help = "Playback speed. 1 x is real time.";
        row(ui, "Speed", help, |ui| ui.add(Slider::new(&mut clip.speed, 0.1..=4.0).suffix(" x").max_decimals(1)));
    });
    if ui.button(if clip.playing { "Stop" } else { "Play" }).on_hover_text("The key P does the same.").clicked() {
        clip.playing = !clip.playing;
        clip.animation.get_or_insert(0);
    }
    clip.playing &= clip.animation.is_some();
    let moved = (clip.animation, clip.time) != (document.clip.animation, document.clip.time);
    document.clip = clip;
    if moved {
        document.pose(gpu);
    }
}
