//! A video: the frames of an animation as numbered PNG files, in a folder of their own.

use super::document::{Clip, Document};
use anyhow::{Context, Result};
use std::path::PathBuf;

/// Default frame rate [frames/s].
pub(super) const FPS: f64 = 30.0;

/// Maximum number of frames.
const MOST: f64 = 100_000.0;

/// A video that is being written.
pub(super) struct Video {
    pub(super) folder: PathBuf,
    fps: f64,
    /// Index of the next frame, and number of frames.
    next: u32,
    pub(super) count: u32,
    /// Playback state before the video.
    before: Clip,
}

impl Video {
    /// Starts a video of the chosen animation, or of the first, and creates its folder.
    ///
    /// # Errors
    /// Fails if the scene has no animation, or the folder cannot be created.
    pub(super) fn begin(document: &mut Document, fps: f64) -> Result<Self> {
        let before = document.clip;
        let index = before.animation.unwrap_or(0);
        let scene = document.scene().context("there is no scene yet")?;
        let (_, _, end) = scene.animations().nth(index).context("nothing in this scene moves")?;
        let count = (end * fps).ceil().clamp(1.0, MOST) as u32;
        let named = |n: u32| PathBuf::from(format!("{}-video-{n}", scene.name));
        let number = (1..10_000).find(|n| !named(*n).exists()).context("the folder already has 9999 videos")?;
        let folder = named(number);
        std::fs::create_dir(&folder).with_context(|| folder.display().to_string())?;
        document.clip = Clip { animation: Some(index), playing: false, ..before };
        Ok(Self { folder, fps, next: 0, count, before })
    }

    /// Time of the next frame [s]. `None` after the last.
    pub(super) fn moment(&self) -> Option<f64> {
        (self.next < self.count).then(|| f64::from(self.next) / self.fps)
    }

    /// Index and file of the next frame.
    pub(super) fn next(&self) -> (u32, PathBuf) {
        (self.next, self.folder.join(format!("{:05}.png", self.next)))
    }

    /// Returns to a frame that was lost. It and the later ones are written again.
    pub(super) fn return_to(&mut self, index: u32) {
        self.next = self.next.min(index);
    }

    /// Advances to the next frame.
    pub(super) fn advance(&mut self) {
        self.next += 1;
    }

    /// Progress from 0 to 1, and as text.
    pub(super) fn progress(&self) -> (f32, String) {
        (self.next as f32 / self.count as f32, format!("video, {} of {}", self.next, self.count))
    }

    /// Restores the playback state from before the video.
    pub(super) fn end(self, document: &mut Document) {
        document.clip = self.before;
    }
}
