//! Canvas and picture in the size of the window, and what happens without memory for it.

use super::{Open, lost};
use crate::app::inset::Insets;
use anyhow::{Error, Result};
use lightskin::frame::Picture;
use winit::dpi::PhysicalSize;

impl Open {
    /// Fits the canvas to a size of the window [pixels], and returns its own. Without memory the canvas keeps its size.
    pub(super) fn fit_canvas(&mut self, size: [u32; 2]) -> Result<[u32; 2]> {
        let is_new = std::mem::replace(&mut self.window_size, size) != size;
        let Err(error) = self.canvas.fit(&self.gpu, size).map_err(Error::new) else { return Ok(size) };
        if lost::is_loss(&error) {
            return Err(error);
        }
        if is_new {
            log::error!("{error:#}; the window returns to its last size");
            self.resize_back();
        }
        Ok(self.canvas.size())
    }

    /// Fits the picture to its place. Without memory the picture keeps its size.
    pub(super) fn fit_picture(&mut self) -> Result<()> {
        if !self.document.fit(&self.gpu)? {
            self.resize_back();
        }
        let size = self.document.picture.as_ref().map(Picture::size);
        if self.canvas.size() == self.window_size && size == Some(self.place.1) {
            self.fitted = self.window_size;
        }
        Ok(())
    }

    /// Creates what the insets need. Without memory for them they are switched off.
    pub(super) fn fit_insets(&mut self) -> Result<()> {
        let Some(engine) = &self.document.engine else { return Ok(()) };
        let error = match self.document.insets.fit(&self.gpu, engine, self.canvas.size()) {
            Ok(changed) => {
                if changed {
                    self.redraw();
                }
                return Ok(());
            }
            Err(error) => Error::new(error),
        };
        if lost::is_loss(&error) {
            return Err(error);
        }
        log::error!("{error:#}; the insets are switched off");
        self.document.insets = Insets::default();
        Ok(())
    }

    /// Asks the window to return to the last size that had memory. A window manager may refuse.
    fn resize_back(&self) {
        let [width, height] = self.fitted;
        let _ = self.window.request_inner_size(PhysicalSize::new(width, height));
        self.redraw();
    }
}
