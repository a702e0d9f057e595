//! The window's size: `--size` is that of the picture [pixels], whatever the display's scale.

use super::Open;
use crate::app::panel;
use crate::cli::view::View;
use anyhow::{Context, Result};
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

/// Opens a window for the picture and the panels that the command line asks for.
pub(super) fn open(events: &ActiveEventLoop, args: &View) -> Result<Window> {
    let of_panels = if args.no_panels { 0.0 } else { args.ui_scale };
    // Wayland tells the scale after the first picture; until then it is 1. X11 tells it here.
    let attributes = Window::default_attributes().with_title("lightskin").with_inner_size(around(args, of_panels));
    let window = events.create_window(attributes).context("opening a window")?;
    let scale = window.scale_factor() as f32;
    if scale != 1.0 {
        let _ = window.request_inner_size(around(args, of_panels * scale));
    }
    Ok(window)
}

/// Size of a window with the picture of the command line, and panels at this scale beside it.
fn around(args: &View, panels: f32) -> PhysicalSize<u32> {
    PhysicalSize::new(args.size[0] + (panel::WIDTH * panels) as u32, args.size[1])
}

impl Open {
    /// A picture that has the size of the command line keeps it when the display's scale changes.
    pub(super) fn keep_picture_size(&self, event: &WindowEvent) {
        let WindowEvent::ScaleFactorChanged { scale_factor, inner_size_writer } = event else { return };
        if self.frames == 0 || self.place.1 == self.document.args.size {
            let of_panels = if self.panel.visible { self.egui.egui_ctx().zoom_factor() } else { 0.0 };
            let size = around(&self.document.args, of_panels * *scale_factor as f32);
            let _ = inner_size_writer.clone().request_inner_size(size);
        }
    }
}
