//! What the window writes: pictures, sessions, and the command line of a picture.

use super::Open;
use crate::app::background::alone;
use crate::app::session;
use crate::cli::view::{Taken, print};
use anyhow::{Context, Result, bail};
use std::path::PathBuf;

/// Maximum number of pictures that are written at the same time, because each is held in memory.
const MOST_WRITTEN: usize = 4;

impl Open {
    /// Prints the command that writes this picture and copies it to the clipboard.
    pub(super) fn copy_command(&mut self) -> Result<()> {
        let command = self.document.command().context("there is no picture whose command line could be copied")?;
        print(&command);
        self.egui.set_clipboard_text(command);
        log::warn!("copied the command line for this picture");
        Ok(())
    }

    /// Saves the picture without the panels under the first free name with this ending.
    pub(super) fn save(&mut self, ending: &str) -> Result<()> {
        let Some(scene) = self.document.scene() else { return Ok(()) };
        if !self.can_write() {
            bail!("{MOST_WRITTEN} pictures are still being written; try again in a moment");
        }
        let named = |n: u32| PathBuf::from(format!("{}-{n}.{ending}", scene.name));
        let free = |n: &u32| !named(*n).exists() && self.writing.iter().all(|(path, _)| *path != named(*n));
        let number = (1..10_000).find(free).context("the folder already has 9999 pictures; move them away")?;
        self.write(named(number), true)
    }

    /// Whether another picture may be written now.
    pub(super) fn can_write(&self) -> bool {
        self.writing.iter().filter(|(_, thread)| !thread.is_finished()).count() < MOST_WRITTEN
    }

    /// Writes the picture to a file: reads it back here and encodes it on a thread. With `tells`, prints the name of
    /// the file.
    pub(super) fn write(&mut self, path: PathBuf, tells: bool) -> Result<()> {
        self.writing.retain(|(_, thread)| !thread.is_finished());
        let (Some(picture), Some(scene)) = (&self.document.picture, self.document.scene()) else { return Ok(()) };
        let view = self.document.drawn.context("no frame has been drawn yet")?;
        let about = format!("scene {}; {}", scene.name, self.document.command().unwrap_or_default());
        let taken = Taken::of(&self.gpu, picture, &view, &self.document.look, &path)?;
        let of_thread = path.clone();
        let write = move || match alone(|| taken.write(&about, &of_thread)) {
            Ok(()) if tells => {
                print(&format!("picture   {}", of_thread.display()));
                log::warn!("wrote {}", of_thread.display());
            }
            Ok(()) => {}
            Err(error) => log::error!("{error:#}"),
        };
        self.writing.push((path, std::thread::spawn(write)));
        Ok(())
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
