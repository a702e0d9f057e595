//! Flags for animated scenes: the animation, its times, and the names of the pictures.

use super::wrong_usage;
use anyhow::{Context, Result, bail};
use lightskin::scene::Scene;
use std::path::{Path, PathBuf};

/// Maximum number of frames in one run.
const MOST_FRAMES: usize = 1_000_000;

/// Flags for the animation and its times.
#[derive(clap::Args)]
#[command(next_help_heading = "Animation")]
pub(super) struct MotionArgs {
    /// Animation by name or index [default: the first].
    #[arg(long, value_name = "NAME|INDEX")]
    animation: Option<String>,
    /// Render the animation at this time [s].
    ///
    /// Without --time, --frames and --play the scene is rendered in its rest pose.
    #[arg(long, value_name = "T", conflicts_with_all = ["frames", "play"], allow_hyphen_values = true, value_parser = time)]
    time: Option<f64>,
    /// Render frames A to B - 1, one picture each. Use {frame} or {frame:04} in the name of the file.
    #[arg(long, value_name = "A..B", value_parser = frames)]
    frames: Option<std::ops::Range<u32>>,
    /// Frame rate of --frames and --play [frames/s].
    #[arg(long, value_name = "F", default_value_t = 30.0, value_parser = super::positive)]
    fps: f64,
    /// Render the whole animation, or its --frames, to measure it; only the last picture is written.
    #[arg(long)]
    play: bool,
    /// Run every stage in every frame, even if its inputs have not changed. The picture stays the same.
    #[arg(long, hide_short_help = true, help_heading = super::render::MEASURE)]
    pub(super) no_skip: bool,
}

/// The frames to render.
pub(super) struct Motion {
    /// Index of the animation; `None` for a scene at rest.
    animation: Option<usize>,
    /// Number and time [s] of each frame.
    moments: Vec<(u32, f64)>,
    /// Whether each frame is written to its own picture.
    pub(super) pictures: bool,
    /// Whether stages are skipped if their inputs have not changed.
    pub(super) reuse: bool,
}

fn time(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(time) if time.is_finite() => Ok(time),
        _ => Err("needs a time in seconds".into()),
    }
}

fn frames(text: &str) -> std::result::Result<std::ops::Range<u32>, String> {
    let parsed = text.split_once("..").and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    match parsed {
        Some((first, end)) if first < end => Ok(first..end),
        Some(_) => Err("is empty: A..B ends before frame B, so B must be greater than A".into()),
        None => Err("needs two whole numbers like 0..60".into()),
    }
}

/// The index of the requested animation, or of the first.
pub(super) fn animation_index(scene: &Scene, wanted: Option<&str>) -> Result<usize> {
    let all: Vec<&str> = scene.animations().map(|(name, ..)| name).collect();
    if all.is_empty() {
        bail!("{}: nothing is animated; remove --time, --frames, --play and --animation", scene.name);
    }
    let Some(wanted) = wanted else { return Ok(0) };
    let found = match wanted.parse::<usize>() {
        Ok(index) if index < all.len() => Some(index),
        _ => all.iter().position(|name| *name == wanted),
    };
    found.with_context(|| {
        let names: Vec<_> = all.iter().enumerate().map(|(i, name)| format!("{i} '{name}'")).collect();
        format!("--animation {wanted}: the scene has no such animation; it has {}", names.join(", "))
    })
}

impl MotionArgs {
    /// Ends the process if the flags cannot be combined, before anything is loaded. `one` means that the method renders
    /// only one frame. Returns the name of the first picture.
    pub(super) fn check(&self, out: &Path, repeat: u32, one: bool) -> PathBuf {
        let first = self.frames.as_ref().map_or(0, |frames| frames.start);
        let numbered = numbered(out, first) != out;
        if out.parent().is_some_and(|folder| super::motion::numbered(folder, first) != folder) {
            wrong_usage("-o: {frame} is allowed in the name of the file, not in its folder");
        }
        if one && (self.play || self.frames.as_ref().is_some_and(|frames| frames.len() > 1)) {
            wrong_usage("--gi path-trace renders one moment: use --time T");
        }
        if self.frames.as_ref().is_some_and(|frames| frames.len() > MOST_FRAMES) {
            wrong_usage("--frames: more than a million frames; render them in several runs");
        }
        if self.rests() && self.animation.is_some() {
            wrong_usage("--animation needs --time, --frames or --play: without them the scene is at rest");
        }
        let many = self.frames.as_ref().is_some_and(|frames| frames.len() > 1) && !self.play;
        if many && !numbered {
            wrong_usage("--frames writes many pictures: name them like -o out_{frame:04}.png");
        }
        if numbered && self.frames.is_none() {
            wrong_usage("-o: {frame} in the name needs --frames A..B");
        }
        if repeat > 1 && (self.frames.is_some() || self.play) {
            wrong_usage("--repeat renders one moment repeatedly: remove it, or remove --frames and --play");
        }
        super::motion::numbered(out, first)
    }

    /// Whether the scene is rendered at rest.
    fn rests(&self) -> bool {
        self.time.is_none() && self.frames.is_none() && !self.play
    }

    /// The frames that the flags request of a scene. A scene at rest or at one time is rendered `repeat` times.
    pub(super) fn motion(&self, scene: &Scene, repeat: u32) -> Result<Motion> {
        if self.rests() {
            return Ok(Motion {
                animation: None,
                moments: vec![(0, 0.0); repeat as usize],
                pictures: false,
                reuse: false,
            });
        }
        let animation = animation_index(scene, self.animation.as_deref())?;
        let end = scene.animations().nth(animation).map_or(0.0, |(_, _, end)| end);
        let frames = match (&self.frames, self.play) {
            (Some(frames), _) => frames.clone(),
            (None, true) => 0..((end * self.fps).ceil().clamp(1.0, MOST_FRAMES as f64) as u32),
            (None, false) => {
                let time = self.time.unwrap_or(0.0);
                let moments = vec![(0, time); repeat as usize];
                return Ok(Motion { animation: Some(animation), moments, pictures: false, reuse: false });
            }
        };
        Ok(Motion {
            animation: Some(animation),
            moments: frames.map(|frame| (frame, f64::from(frame) / self.fps)).collect(),
            pictures: !self.play,
            reuse: !self.no_skip,
        })
    }
}

impl Motion {
    /// Index and number of each frame.
    pub(super) fn frames(&self) -> impl ExactSizeIterator<Item = (usize, u32)> {
        self.moments.iter().map(|(number, _)| *number).enumerate()
    }

    /// The animation, and the time [s] of the frame at `index`.
    pub(super) fn moment(&self, index: usize) -> (Option<usize>, f64) {
        (self.animation, self.moments[index].1)
    }

    /// Poses the scene for the frame at `index`. Returns whether anything can have moved since the previous frame.
    pub(super) fn pose(&self, scene: &mut Scene, index: usize) -> bool {
        let time = self.moments[index].1;
        let moves = index == 0 || self.moments[index - 1].1 != time;
        if let (Some(animation), true) = (self.animation, moves) {
            scene.pose(animation, scene.looped(animation, time));
            return true;
        }
        false
    }
}

/// The name of a frame's picture: {frame} becomes the frame number, {frame:04} the number with at least four digits.
pub(super) fn numbered(out: &Path, frame: u32) -> PathBuf {
    let text = out.to_string_lossy();
    let Some((before, rest)) = text.split_once("{frame") else { return out.to_owned() };
    let Some((format, after)) = rest.split_once('}') else { return out.to_owned() };
    let width = match format.strip_prefix(':') {
        None if format.is_empty() => 0,
        Some(digits) if !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()) && digits.len() <= 2 => {
            digits.parse().unwrap_or(0)
        }
        _ => return out.to_owned(),
    };
    PathBuf::from(format!("{before}{frame:0width$}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names() {
        let name = |out: &str, frame| numbered(Path::new(out), frame).to_string_lossy().into_owned();
        assert_eq!(name("out_{frame:04}.png", 7), "out_0007.png");
        assert_eq!(name("out_{frame}.png", 12), "out_12.png");
        assert_eq!(name("{frame:02}.exr", 123), "123.exr");
        for plain in ["out.png", "out_{frame:x}.png", "out_{frame.png", "{frame:}.png"] {
            assert_eq!(name(plain, 1), plain);
        }
    }

    #[test]
    fn ranges_of_frames() {
        assert_eq!(frames("0..60"), Ok(0..60));
        assert_eq!(frames(" 3 .. 4"), Ok(3..4));
        for wrong in ["", "5", "5..5", "6..5", "-1..5", "a..b", "1..2..3"] {
            assert!(frames(wrong).is_err(), "{wrong}");
        }
    }
}
