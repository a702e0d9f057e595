//! What the window writes: pictures, sessions, and the command line of a picture.

use super::{Open, lost};
use crate::app::background::{alone, joined};
use crate::app::input::Wish;
use crate::app::session;
use crate::cli::view::{Taken, print};
use anyhow::{Context, Result, bail};
use std::path::PathBuf;
use std::thread::JoinHandle;

/// Maximum number of pictures that are written at the same time, because each is held in memory.
const MOST_WRITTEN: usize = 4;

/// A picture that is being written.
pub(super) struct Writing {
    path: PathBuf,
    thread: JoinHandle<Result<()>>,
    of: Of,
}

/// What a picture is written for.
pub(super) enum Of {
    /// The user asked for it.
    Wish(Wish),
    /// It is a frame of a video.
    Frame(u32),
}

impl Open {
    /// Prints the command that writes this picture and copies it to the clipboard.
    pub(super) fn copy_command(&mut self) -> Result<()> {
        let command = self.document.command().context("there is no picture whose command line could be copied")?;
        print(&command);
        self.egui.set_clipboard_text(command);
        log::warn!("copied the command line for this picture");
        Ok(())
    }

    /// Saves the picture without the panels, as PNG or with all layers, under the first free name.
    pub(super) fn save(&mut self, wish: Wish) -> Result<()> {
        let ending = if matches!(wish, Wish::SaveLayers) { "exr" } else { "png" };
        let Some(scene) = self.document.scene() else { return Ok(()) };
        if !self.can_write() {
            bail!("{MOST_WRITTEN} pictures are still being written; try again in a moment");
        }
        let named = |n: u32| PathBuf::from(format!("{}-{n}.{ending}", scene.name));
        let free = |n: &u32| !named(*n).exists() && self.writing.iter().all(|writing| writing.path != named(*n));
        let number = (1..10_000).find(free).context("the folder already has 9999 pictures; move them away")?;
        self.write(named(number), Of::Wish(wish))
    }

    /// Whether another picture may be written now.
    pub(super) fn can_write(&self) -> bool {
        self.writing.len() < MOST_WRITTEN
    }

    /// Writes the picture to a file, on a thread that waits for it.
    pub(super) fn write(&mut self, path: PathBuf, of: Of) -> Result<()> {
        let (Some(picture), Some(scene)) = (&self.document.picture, self.document.scene()) else { return Ok(()) };
        let view = self.document.drawn.context("no frame has been drawn yet")?;
        let about = format!("scene {}; {}", scene.name, self.document.command().unwrap_or_default());
        let taken = Taken::begin(&self.gpu, picture, &view, &self.document.look, &path)?;
        let (of_thread, tells) = (path.clone(), matches!(of, Of::Wish(_)));
        let write = move || {
            alone(|| taken.write(&about, &of_thread))?;
            if tells {
                print(&format!("picture   {}", of_thread.display()));
                log::warn!("wrote {}", of_thread.display());
            }
            Ok(())
        };
        let thread = std::thread::spawn(write);
        self.writing.push(Writing { path, thread, of });
        Ok(())
    }

    /// Takes over the results of pictures that are written; with `all` it waits for all of them. A picture that was lost
    /// with the device is taken again on the next one.
    pub(super) fn finish_writing(&mut self, all: bool) {
        let over = |writing: &mut Writing| all || writing.thread.is_finished();
        for Writing { thread, of, .. } in self.writing.extract_if(.., over) {
            match (joined(thread), of) {
                (Ok(()), _) => {}
                (Err(error), Of::Wish(wish)) if lost::is_loss(&error) => self.waiting.push(wish),
                (Err(error), Of::Frame(index)) if lost::is_loss(&error) => {
                    self.document.video.iter_mut().for_each(|video| video.return_to(index));
                }
                (Err(error), Of::Wish(_)) => log::error!("{error:#}"),
                (Err(error), Of::Frame(_)) => {
                    log::error!("{error:#}; the video is stopped");
                    self.document.video = None;
                }
            }
        }
    }

    /// Saves the session to its file, or under the first free name.
    pub(super) fn save_session(&mut self) -> Result<()> {
        let scene = self.document.scene().context("there is no scene yet")?;
        let named = |n: u32| PathBuf::from(format!("{}-{n}.lightskin.json", scene.name));
        let path = match &self.document.session {
            Some(path) => path.clone(),
            None => named((1..10_000).find(|n| !named(*n).exists()).context("the folder already has 9999 sessions")?),
        };
        session::save(&self.document, &path)?;
        print(&format!("session   {}", path.display()));
        log::warn!("wrote {}", path.display());
        self.document.session = Some(path);
        Ok(())
    }
}
