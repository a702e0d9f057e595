//! The window of `lightskin view`: it handles events and shows frames. The library renders the picture; no code here
//! computes light.

mod background;
mod camera;
mod canvas;
mod compare;
mod document;
mod gizmo;
mod input;
mod inset;
mod lights;
mod loading;
mod marks;
mod panel;
mod pixel;
mod recent;
mod reference;
mod session;
#[cfg(feature = "glsl")]
mod shaders;
mod side;
mod textures;
mod undo;
mod video;
mod watch;
mod window;

use crate::cli::view::View;
use anyhow::{Result, anyhow};
use std::time::Instant;
use window::{Open, lost};
use winit::application::ApplicationHandler;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::WindowId;

/// State of the event loop.
struct App<'a> {
    args: &'a View,
    /// The window, once the system allows to create one.
    open: Option<Open>,
    /// The error that ended the run, if any.
    ended: Result<()>,
}

/// Shows a window until it is closed.
pub(crate) fn run(args: &View) -> Result<()> {
    args.check();
    lightskin::gpu::give_memory_back();
    let events = EventLoop::new().map_err(|error| {
        anyhow!("no display for a window ({error}); use `lightskin render` to write pictures without one")
    })?;
    let mut app = App { args, open: None, ended: Ok(()) };
    let ran = events.run_app(&mut app);
    app.ended.and(ran.map_err(|error| anyhow!("the window's events: {error}")))
}

impl App<'_> {
    /// Returns the value of a result, or ends the run with its error.
    fn check<T>(&mut self, events: &ActiveEventLoop, result: Result<T>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(error) => {
                self.ended = Err(error);
                events.exit();
                None
            }
        }
    }
}

impl ApplicationHandler for App<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.open.is_none() {
            let open = Open::new(events, self.args);
            self.open = self.check(events, open);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        #[cfg(feature = "glsl")]
        if self.open.as_mut().is_some_and(Open::has_new_shaders) {
            let remade = self.open.take().map(Open::with_new_shaders).transpose();
            self.open = self.check(events, remade).flatten();
        }
        let Some(open) = &mut self.open else { return };
        if matches!(event, WindowEvent::RedrawRequested) {
            match open.draw() {
                Err(error) if lost::is_loss(&error) => {
                    let recovered = self.open.take().map(|open| open.recover(&error)).transpose();
                    self.open = self.check(events, recovered).flatten();
                }
                drawn => drop(self.check(events, drawn)),
            }
        } else {
            open.event(&event);
        }
        if self.open.as_ref().is_some_and(Open::closed) {
            events.exit();
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(open) = &mut self.open else { return };
        events.set_control_flow(match open.next_draw() {
            Some(at) if at <= Instant::now() => {
                open.redraw();
                ControlFlow::Wait
            }
            Some(at) => ControlFlow::WaitUntil(at),
            None => ControlFlow::Wait,
        });
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // The window must close before its display connection does.
        if let Some(open) = self.open.take() {
            let closed = open.close();
            if self.ended.is_ok() {
                self.ended = closed;
            }
        }
    }
}
