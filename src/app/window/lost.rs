//! A new device, after the loss of the old one or for changed shaders: the window continues on it.

use super::Open;
use crate::app::canvas::Canvas;
use crate::cli::check_messages;
use anyhow::{Context, Error, Result, bail};
use lightskin::frame::Engine;
use std::rc::Rc;
use std::time::{Duration, Instant};
use winit::raw_window_handle::HasDisplayHandle;

/// If the device is lost twice within this time, the run ends: its driver does not recover, or the scene breaks it.
const APART: Duration = Duration::from_secs(60);

/// The operation that found the device lost. `None` for other errors.
fn operation(error: &Error) -> Option<&str> {
    error.chain().find_map(|cause| match cause.downcast_ref() {
        Some(lightskin::Error::DeviceLost { what }) => Some(what.as_str()),
        _ => None,
    })
}

/// Whether an error is the loss of the device.
pub(in crate::app) fn is_loss(error: &Error) -> bool {
    operation(error).is_some()
}

/// Logs an error, unless it is the loss of the device: the next frame fails as well, and is handled.
pub(in crate::app) fn report(error: &Error) {
    if !is_loss(error) {
        log::error!("{error:#}");
    }
}

impl Open {
    /// Continues on a new device with the scene in memory, its edits, the view and all settings. `error` is the loss of
    /// the old one.
    ///
    /// # Errors
    /// Fails if the last loss is less than a minute ago, or no device can take over.
    pub(in crate::app) fn recover(mut self, error: &Error) -> Result<Self> {
        let what = operation(error).unwrap_or_default();
        self.finish_writing(true); // even if the run ends
        if self.lost.is_some_and(|last| last.elapsed() < APART) {
            bail!(
                "the device was lost twice within a minute, now at: {what}; update the driver or try another --device"
            );
        }
        log::warn!("the device was lost at: {what}; the window continues on a new one");
        self.lost = Some(Instant::now());
        let open = self.on_new_device().context("the device was lost, and no other takes over")?;
        open.redraw();
        Ok(open)
    }

    /// Whether shaders have changed, are compiled, and are taken by the device.
    #[cfg(feature = "glsl")]
    pub(in crate::app) fn has_new_shaders(&mut self) -> bool {
        let gpu = &self.gpu;
        self.shaders.as_mut().is_some_and(|shaders| shaders.reload(gpu))
    }

    /// Makes everything on the device anew, with the shaders of now.
    ///
    /// # Errors
    /// Fails if no device opens.
    #[cfg(feature = "glsl")]
    pub(in crate::app) fn with_new_shaders(mut self) -> Result<Self> {
        self.finish_writing(true);
        let open = self.on_new_device().context("the changed shaders")?;
        open.redraw();
        Ok(open)
    }

    fn on_new_device(self) -> Result<Self> {
        let Self { mut document, mut compare, canvas, swapchain, gpu, .. } = self;
        document.leave_device();
        let loaded = document.engine.take().map(Engine::into_loaded);
        compare.leave_device();
        let textures = canvas.textures.leave_device();
        drop(swapchain);
        check_messages(&gpu, &[])?;
        // Drivers may refuse another device, or another swapchain of the window, while the old one exists.
        drop(gpu);
        let display = self.window.display_handle().context("the display")?.as_raw();
        let gpu = Rc::new(document.args.open_device(display)?);
        self.faults.open(&gpu);
        let swapchain = gpu.swapchain(self.window.clone(), document.args.present())?;
        let canvas = Canvas::new(&gpu, self.window.inner_size().into(), textures)?;
        document.engine = loaded.map(|loaded| Engine::new(&gpu, loaded, &document.fitted)).transpose()?;
        Ok(Self { document, compare, canvas, swapchain, gpu, ..self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_is_found_below_other_errors() {
        let lost = lightskin::Error::DeviceLost { what: "waiting".into() };
        assert_eq!(operation(&Error::new(lost).context("a picture")), Some("waiting"));
        assert_eq!(operation(&Error::new(lightskin::Error::Nothing("no scene".into()))), None);
    }
}
