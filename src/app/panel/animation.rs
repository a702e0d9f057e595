//! The animation: which clip plays, and its video.

use super::{choose, progress, row, rows};
use crate::app::document::Document;
use crate::app::input::Wish;
use egui::{DragValue, RichText, Slider, Ui};
use lightskin::gpu::Gpu;

/// The clip and its moment; a video of it at so many frames a second.
pub(super) fn show(ui: &mut Ui, document: &mut Document, gpu: &Gpu, fps: &mut f64, wishes: &mut Vec<Wish>) {
    if let Some(video) = &document.video {
        let (done, what) = video.progress();
        progress(ui, done, &what);
        if ui.button("Stop").on_hover_text("Keeps the pictures that are written.").clicked() {
            wishes.push(Wish::Video(*fps));
        }
        return;
    }
    clip(ui, document, gpu);
    if document.scene().is_none_or(|scene| scene.animations().next().is_none()) {
        return;
    }
    ui.horizontal(|ui| {
        let help = "Writes the whole clip, frame by frame, as numbered PNG files to a folder of its own in the current one. \
                    They are those of `lightskin render --frames`.";
        if ui.button("Save video").on_hover_text(help).clicked() {
            wishes.push(Wish::Video(*fps));
        }
        let fps = DragValue::new(fps).speed(0.1).range(1.0..=240.0).suffix(" frames/s");
        ui.add(fps).on_hover_text("Frames of the video in a second.");
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
        row(ui, "Clip", "Which animation plays.", |ui| choose(ui, "clip", &mut clip.animation, &all));
        let end = clip.animation.map_or(0.0, |animation| clips[animation].1);
        if clip.animation.is_some() {
            clip.time = if end > 0.0 { clip.time.rem_euclid(end) } else { 0.0 };
            let help = "Moment of the animation. Nothing is baked again, and no picture knows of the one before.";
            row(ui, "Time", help, |ui| ui.add(Slider::new(&mut clip.time, 0.0..=end).suffix(" s").max_decimals(2)));
        }
        let help = "Seconds of the animation in a second.";
        row(ui, "Speed", help, |ui| ui.add(Slider::new(&mut clip.speed, 0.1..=4.0).suffix(" x").max_decimals(1)));
    });
    if ui.button(if clip.playing { "Stop" } else { "Play" }).on_hover_text("P does the same.").clicked() {
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
