//! Videos: an animation is drawn picture by picture, and each is written to a file.

use super::save::Of;
use super::{Open, lost};
use crate::app::video::Video;
use crate::cli::view::print;
use anyhow::Result;

impl Open {
    /// Starts a video, or stops the one that is being written.
    pub(super) fn film(&mut self, fps: f64) -> Result<()> {
        match self.document.video.take() {
            Some(video) => video.end(&mut self.document),
            None => self.document.video = Some(Video::begin(&mut self.document, fps)?),
        }
        Ok(())
    }

    /// Poses the scene for the next frame of the video, if that frame can be written. Returns whether it was posed.
    pub(super) fn pose_for_video(&mut self) -> bool {
        let moment = self.document.video.as_ref().and_then(Video::moment);
        let moment =
            moment.filter(|_| self.can_write() && self.document.picture.is_some() && !self.document.is_behind());
        if let Some(moment) = moment {
            self.document.clip.time = moment;
            self.document.pose(&self.gpu);
        }
        moment.is_some()
    }

    /// Writes the video frame that was just drawn, if any, and ends a complete video. Fails only if the device is lost.
    pub(super) fn film_frame(&mut self, drawn: bool) -> Result<()> {
        let next = self.document.video.as_ref().filter(|_| drawn && !self.document.is_behind()).map(Video::next);
        match next.map(|(index, file)| self.write(file, Of::Frame(index))) {
            Some(Err(error)) if lost::is_loss(&error) => return Err(error),
            Some(Err(error)) => {
                log::error!("{error:#}; the video is stopped");
                self.document.video = None;
            }
            Some(Ok(())) => self.document.video.iter_mut().for_each(Video::advance),
            None => {}
        }
        let written = self.writing.is_empty();
        if let Some(video) = self.document.video.take_if(|video| video.moment().is_none() && written) {
            print(&format!("video     {}: {} pictures", video.folder.display(), video.count));
            log::warn!("wrote {}", video.folder.display());
            video.end(&mut self.document);
            self.document.pose(&self.gpu);
        }
        Ok(())
    }
}
