//! The open window: its state, its panels, and the drawing of a frame.

mod faults;
mod film;
mod fit;
pub(super) mod lost;
mod save;
mod size;
mod spent;

use super::canvas::{Canvas, Scenery};
use super::compare::{Compare, Now};
use super::document::Document;
use super::input::{Input, Wish};
use super::panel;
use super::pixel::Pixel;
#[cfg(feature = "glsl")]
use super::shaders::Shaders;
use super::textures::Textures;
use super::watch::EVERY;
use crate::cli::check_messages;
use crate::cli::session::is_session;
use crate::cli::view::{self, View as Args, print};
use anyhow::{Context, Result};
use faults::Faults;
use lightskin::frame::Picture;
use lightskin::gpu::{Cmd, Gpu, Swapchain};
use save::Writing;
use spent::{FRAME, Spent};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::ActiveEventLoop;
use winit::raw_window_handle::HasDisplayHandle;
use winit::window::Window;

/// Number of frames between two log lines with the counters of the device.
const COUNTED: u64 = 50;

/// Time between two checks of background jobs.
const POLL: Duration = Duration::from_millis(100);

/// Longest time that a frame advances what moves, so that nothing jumps after a slow one.
const LONGEST: Duration = Duration::from_millis(100);

/// A window and its contents. The order of the fields is the order in which they are dropped.
pub(super) struct Open {
    document: Document,
    compare: Compare,
    canvas: Canvas,
    swapchain: Swapchain,
    egui: egui_winit::State,
    input: Input,
    panel: panel::State,
    gpu: Rc<Gpu>,
    window: Arc<Window>,
    /// Corner and size of the picture in the window [pixels].
    place: ([u32; 2], [u32; 2]),
    /// Size of the window [pixels].
    window_size: [u32; 2],
    /// The last size of the window [pixels] for which there was memory.
    fitted: [u32; 2],
    /// Problems that the barrier check has reported.
    problems: Vec<String>,
    /// Number of drawn frames.
    frames: u64,
    /// Time of the last frame.
    last: Instant,
    /// Time of the next frame, if it is due without an event.
    next: Option<Instant>,
    /// Copies and saves that wait for the next frame, so that earlier actions are in it.
    waiting: Vec<Wish>,
    /// Pictures that are being written.
    writing: Vec<Writing>,
    /// The desktop's file dialog, while it is open.
    dialog: Option<JoinHandle<Option<PathBuf>>>,
    closed: bool,
    /// Time of the last loss of a device.
    lost: Option<Instant>,
    faults: Faults,
    /// The shaders that are compiled again when they change, with `--dev`.
    #[cfg(feature = "glsl")]
    shaders: Option<Shaders>,
}

impl Open {
    /// Opens the window and starts to load the scene.
    pub(super) fn new(events: &ActiveEventLoop, args: &Args) -> Result<Self> {
        let window = Arc::new(size::open(events, args)?);
        let display = events.display_handle().context("the display")?.as_raw();
        let gpu = Rc::new(args.open_device(display)?);
        let faults = Faults::new()?;
        faults.open(&gpu);
        let swapchain = gpu.swapchain(window.clone(), args.present())?;
        let size = window.inner_size();
        let context = egui::Context::default();
        panel::style::set(&context, args.reduced_motion);
        panel::style::set_scale(&context, args.ui_scale);
        let scale = window.scale_factor() as f32;
        let egui = egui_winit::State::new(context, egui::ViewportId::ROOT, &window, Some(scale), window.theme(), None);
        let mut compare = Compare::new(args.reference_spp);
        if let Some(file) = &args.against {
            compare.open(file);
        }
        Ok(Self {
            document: Document::new(&gpu, args, compare.rest.clone())?,
            compare,
            canvas: Canvas::new(&gpu, size.into(), Textures::default())?,
            swapchain,
            egui,
            input: Input::default(),
            panel: panel::State::new(!args.no_panels),
            gpu,
            window,
            place: ([0, 0], [0, 0]),
            window_size: size.into(),
            fitted: size.into(),
            problems: Vec::new(),
            frames: 0,
            last: Instant::now(),
            next: None,
            waiting: Vec::new(),
            writing: Vec::new(),
            dialog: None,
            closed: false,
            lost: None,
            faults,
            #[cfg(feature = "glsl")]
            shaders: args.dev.as_deref().map(Shaders::new).transpose().map_err(anyhow::Error::msg)?,
        })
    }

    pub(super) fn closed(&self) -> bool {
        self.closed
    }

    pub(super) fn redraw(&self) {
        self.window.request_redraw();
    }

    /// Time of the next frame if it is due without an event. `None` if nothing moves.
    pub(super) fn next_draw(&self) -> Option<Instant> {
        self.next
    }

    /// Closes the window. Fails if the validation layer or the barrier check has reported anything.
    pub(super) fn close(mut self) -> Result<()> {
        self.finish_writing(true);
        let Self { document, compare, canvas, swapchain, gpu, mut problems, .. } = self;
        problems.extend_from_slice(&compare.problems);
        drop((document, compare, canvas, swapchain));
        gpu.wait()?;
        check_messages(&gpu, &problems)
    }

    /// Handles an event. Its changes appear in the next frame.
    pub(super) fn event(&mut self, event: &WindowEvent) {
        self.keep_picture_size(event);
        let ours = self.input.is_ours(event, self.egui.egui_ctx());
        let answer = if ours { None } else { Some(self.egui.on_window_event(&self.window, event)) };
        if is_input(event) {
            self.compare.rest.touch();
        }
        // Without memory for a larger picture, it is smaller than its place.
        let place = (self.place.0, self.document.picture.as_ref().map_or(self.place.1, Picture::size));
        let taken = answer.is_some_and(|answer| answer.consumed);
        let wishes = self.input.take(event, self.egui.egui_ctx(), place, &self.document.gizmo, taken);
        let changes = !wishes.is_empty();
        for wish in wishes {
            let (mut spent, name) = (Spent::new(), format!("{wish:?}"));
            self.grant(wish);
            spent.on("wish");
            spent.log(&name);
        }
        if changes || answer.is_none_or(|answer| answer.repaint) || matches!(event, WindowEvent::Resized(_)) {
            self.redraw();
        }
    }

    fn grant(&mut self, wish: Wish) {
        let gpu = &self.gpu;
        let document = &mut self.document;
        match wish {
            Wish::Close => self.closed = true,
            Wish::Panels => self.panel.visible = !self.panel.visible,
            Wish::Keys => self.panel.keys = !self.panel.keys,
            Wish::Handles => self.panel.handles = !self.panel.handles,
            Wish::Grip(grip, at) => document.grip(grip, at),
            Wish::Pull(to) => document.pull(to),
            Wish::Release => document.release(),
            Wish::Undo { again } => document.undo(gpu, again),
            Wish::Unchoose => document.lights.chosen = None,
            Wish::Remove if self.panel.shows_lights() => document.remove_light(gpu),
            Wish::Remove => {}
            Wish::Scale(steps) => panel::style::change_scale(self.egui.egui_ctx(), steps),
            Wish::ScaleBack => panel::style::set_scale(self.egui.egui_ctx(), document.args.ui_scale),
            Wish::Play => {
                if document.scene().is_some_and(|scene| scene.animations().next().is_some()) {
                    document.clip.animation.get_or_insert(0);
                    document.clip.playing = !document.clip.playing;
                }
            }
            Wish::Orbit(by) => {
                if let Some(free) = document.free(|d| d.surface_at(gpu, [0.5, 0.5]).map(|(distance, _)| distance)) {
                    free.orbit(by);
                }
            }
            Wish::Look(by) => {
                if let Some(free) = document.free(|_| None) {
                    free.look(by);
                }
            }
            Wish::Pan(by) => {
                if let Some(free) = document.free(|d| d.surface_at(gpu, [0.5, 0.5]).map(|(distance, _)| distance)) {
                    free.pan(by);
                }
            }
            Wish::Zoom(steps) => {
                if let Some(free) = document.free(|d| d.surface_at(gpu, [0.5, 0.5]).map(|(distance, _)| distance)) {
                    free.zoom(steps);
                }
            }
            Wish::Centre(at) => {
                let found = document.surface_at(gpu, at);
                if let (Some((distance, point)), Some(free)) = (found, document.free(|_| found.map(|(d, _)| d))) {
                    log::debug!("centred on {point} at a distance of {distance} m");
                    free.centre(point);
                }
            }
            Wish::Pick(at) => match Pixel::pick(gpu, document, at) {
                Ok(pixel) => {
                    pixel.iter().for_each(|pixel| print(&pixel.line()));
                    if let Some((material, _)) = pixel.as_ref().and_then(|pixel| pixel.material.as_ref()) {
                        document.material = *material;
                    }
                    document.pixel = pixel;
                }
                Err(error) => lost::report(&error),
            },
            Wish::Recall(index) => {
                let cameras = document.scene().map_or(0, |scene| scene.cameras.len());
                match document.bookmarks[index] {
                    Some(seen) => document.seen = seen,
                    None if index < cameras => document.seen = super::camera::Seen::OfScene(index),
                    None => log::warn!("there is no camera {}; Ctrl+{} stores the current one", index + 1, index + 1),
                }
            }
            Wish::Keep(index) => {
                document.bookmarks[index] = Some(document.seen);
                log::warn!("the current camera is stored as camera {}", index + 1);
            }
            Wish::Copy | Wish::Save | Wish::SaveLayers => self.waiting.push(wish),
            Wish::Reference => self.compare.shown = !self.compare.shown,
            Wish::Size(picture) => {
                let around = [0, 1].map(|i| self.window_size[i].saturating_sub(self.place.1[i]));
                let size = PhysicalSize::new(picture[0] + around[0], picture[1] + around[1]);
                let _ = self.window.request_inner_size(size);
            }
            Wish::Drop(file) if self.compare.takes(&file) => {
                self.compare.open(&file);
            }
            Wish::Drop(file) if is_session(&file) => {
                if let Err(error) = document.open_session(&file) {
                    log::error!("{error:#}");
                }
            }
            Wish::Ask => {
                // If two dialogs are open, only the answer of the second counts.
                self.dialog = Some(std::thread::spawn(ask));
            }
            Wish::SaveSession => {
                if let Err(error) = self.save_session() {
                    log::error!("{error:#}");
                }
            }
            Wish::Video(fps) => {
                if let Err(error) = self.film(fps) {
                    log::error!("{error:#}");
                }
            }
            Wish::Drop(file) if view::is_sky(&file) => document.open(document.wanted().with_sky(&file), false),
            Wish::Drop(file) => document.open(document.wanted().with_file(&file), true),
        }
    }

    /// Draws one frame: handles the panels, renders the changed parts of the picture, and draws the panels over it.
    pub(super) fn draw(&mut self) -> Result<()> {
        let (now, mut spent) = (Instant::now(), Spent::new());
        // Not sooner after the last frame than `--max-fps` allows.
        let apart = self.document.args.max_fps.map_or(Duration::ZERO, |fps| Duration::from_secs_f64(1.0 / fps));
        if let Some(due) = self.last.checked_add(apart).filter(|due| self.frames > 0 && *due > now) {
            self.next = Some(due);
            return Ok(());
        }
        let past = now.duration_since(self.last).min(apart.max(LONGEST)).as_secs_f64();
        self.last = now;
        let size: [u32; 2] = self.window.inner_size().into();
        if size.contains(&0) {
            self.next = None;
            return Ok(());
        }
        if let Some(dialog) = self.dialog.take_if(|dialog| dialog.is_finished())
            && let Ok(Some(file)) = dialog.join()
        {
            self.grant(Wish::Drop(file));
        }
        if self.document.engine.is_some() {
            self.faults.frame(&self.gpu);
        }
        self.finish_writing(false);
        self.document.watch();
        self.input.fly(past, &mut self.document);
        if self.document.clip.playing {
            self.document.clip.time += past * self.document.clip.speed;
            self.document.pose(&self.gpu);
        }

        self.document.follow_pointer(&self.gpu);
        if let Some(at) = self.input.over(self.egui.egui_ctx(), self.place) {
            self.document.insets.pointer = at;
        }
        let filmed = self.pose_for_video();
        spent.on("scene");

        let input = self.egui.take_egui_input(&self.window);
        let context = self.egui.egui_ctx().clone();
        let (mut left_over, mut wishes) = (egui::Rect::NOTHING, Vec::new());
        let (document, compare, panel, gpu) = (&mut self.document, &mut self.compare, &mut self.panel, &self.gpu);
        let output = context.run_ui(input, |ui| {
            let (new, rest) = panel.show(ui, document, compare, gpu);
            wishes.extend(new);
            left_over = rest;
            panel.over(ui, document, left_over);
            panel::debug::legend(ui, document, left_over);
            panel::insets::show(ui, document, left_over);
            panel.hint(ui, left_over);
            panel::compare::overlay(ui, compare, left_over);
            #[cfg(feature = "glsl")]
            if let Some(error) = self.shaders.as_ref().and_then(|shaders| shaders.error.as_ref()) {
                panel::debug::shader_error(ui, error, left_over);
            }
        });
        spent.on("panels");
        self.canvas.textures.change(output.textures_delta);
        self.egui.handle_platform_output(&self.window, output.platform_output);
        spent.on("desktop");
        for wish in wishes {
            self.grant(wish);
        }
        if !context.input(|input| input.pointer.any_down()) && !context.text_edit_focused() {
            self.document.settle();
        }
        spent.on("edits");
        let size = self.fit_canvas(size)?;
        spent.on("canvas");
        let scale = output.pixels_per_point;
        let pixel = |at: f32, most: u32| ((at * scale).round().max(0.0) as u32).min(most);
        let corner = [pixel(left_over.min.x, size[0]), pixel(left_over.min.y, size[1])];
        let far = [pixel(left_over.max.x, size[0]), pixel(left_over.max.y, size[1])];
        self.place = (corner, [0, 1].map(|i| far[i].saturating_sub(corner[i])));

        // After all that reads the picture of the last frame: a new scene has a new one, which is made in its upload.
        self.document.asked = self.place.1;
        let worked = self.document.progress().is_some();
        if self.document.poll(&self.gpu)?
            && let Some(scene) = self.document.scene()
        {
            self.window.set_title(&format!("{} - lightskin", scene.name));
        }
        if worked && self.document.progress().is_none() {
            self.redraw(); // with new panels
        }
        spent.on("upload");
        self.fit_picture()?;
        spent.on("light");
        self.fit_insets()?;
        spent.on("insets");
        let primitives = context.tessellate(output.shapes, scale);
        self.canvas.take(&self.gpu, &primitives, scale)?;
        spent.on("triangles");
        let view = self.document.view();
        let document = &mut self.document;
        let (canvas, look, over) = (&self.canvas, document.look, self.compare.over());
        let (shown, scale, marks) = (document.shown, *document.scale(), document.marks);
        let record = |cmd: &Cmd<'_>| {
            if let (Some(view), Some(engine), Some(picture)) = (view, &mut document.engine, &mut document.picture) {
                engine.record(cmd, &mut [(view, picture)], &look);
                document.insets.record(cmd, engine, (&view, picture));
            }
            let light = document.engine.as_ref().map(|engine| engine.light());
            let insets = document.engine.as_ref().map_or(Vec::new(), |engine| document.insets.drawn(engine));
            let picture = document.picture.as_ref().zip(view);
            let scenery = picture.map(|(picture, view)| Scenery {
                picture,
                view,
                corner,
                shown,
                look: &look,
                scale,
                over,
                insets,
                marks,
                light,
            });
            canvas.record(cmd, scenery.as_ref());
            Ok(())
        };
        // Times of stages cost a software device one submission each, a quarter of a small frame. Panels show them.
        let timed = self.panel.visible || !self.gpu.is_software();
        let frame = if timed { self.gpu.timed_frame(record) } else { self.gpu.frame(record) }?;
        self.problems.extend(frame.problems);
        let times = self.gpu.finished_times()?;
        if timed {
            self.document.time(times);
        }
        spent.on(FRAME);
        self.document.drawn = view;
        if self.document.insets.read(&self.gpu)? {
            self.redraw(); // with its new text
        }
        if filmed || !self.waiting.is_empty() {
            self.gpu.wait()?; // for the frame that is read
            spent.on(FRAME);
        }
        self.film_frame(filmed)?;
        while let (false, Some(wish)) = (self.document.is_behind(), self.waiting.first()) {
            let done = match wish {
                Wish::Copy => self.copy_command(),
                Wish::SaveLayers => self.save(Wish::SaveLayers),
                _ => self.save(Wish::Save),
            };
            match done {
                // It is done on the next device.
                Err(error) if lost::is_loss(&error) => return Err(error),
                Err(error) => log::error!("{error:#}"),
                Ok(()) => {}
            }
            self.waiting.remove(0);
        }
        spent.on("files");
        let compared = self.compare()?;
        spent.on("comparison");
        self.window.pre_present_notify();
        let seen = self.swapchain.show(&self.canvas.image)?;
        spent.on(FRAME);
        self.frames += 1;
        spent.log("draw");
        if self.frames.is_multiple_of(COUNTED) {
            log::debug!("after {} frames {:?}", self.frames, self.gpu.counters());
        }

        let soon = output.viewport_output.get(&egui::ViewportId::ROOT).map_or(Duration::MAX, |v| v.repaint_delay);
        let works = self.dialog.is_some()
            || self.document.progress().is_some()
            || self.compare.works()
            || self.document.video.is_some()
            || !self.writing.is_empty();
        let moves = self.document.clip.playing || self.input.flies() || filmed;
        let wait = match (moves, works || !seen) {
            (true, _) => Some(Duration::ZERO),
            (false, true) => Some(soon.min(POLL)),
            (false, false) => Some(soon).filter(|wait| *wait < Duration::from_secs(3600)),
        };
        let watches = self.document.args.watch;
        #[cfg(feature = "glsl")]
        let watches = watches || self.shaders.is_some();
        let wait = if watches { Some(wait.unwrap_or(EVERY).min(EVERY)) } else { wait };
        self.next = wait.map(|wait| Instant::now() + if compared { Duration::ZERO } else { wait });
        Ok(())
    }

    /// Advances the comparison. Returns whether the next frame should follow at once. Fails only if the device is lost.
    fn compare(&mut self) -> Result<bool> {
        let Document { engine, picture, drawn, changes, clip, look, .. } = &self.document;
        let (Some(engine), Some(picture), Some(view)) = (engine, picture, *drawn) else { return Ok(false) };
        let Some(camera) = self.document.camera() else { return Ok(false) };
        let busy =
            clip.playing || self.document.video.is_some() || self.document.progress().is_some() || self.input.flies();
        let now = Now { engine, picture, view, camera, look: *look, changes: *changes, busy };
        let drew = !engine.light().skipped().contains(&"composite");
        let before = self.compare.version();
        let stepped = self.compare.step(&self.gpu, &now, drew);
        let size = match stepped {
            Ok(size) => size,
            Err(error) if lost::is_loss(&error) => return Err(error),
            // If memory ran out, the picture stays.
            Err(error) => {
                log::error!("{error:#}; the comparison is switched off");
                self.compare.stop();
                None
            }
        };
        if let Some(size) = size.filter(|size| *size != picture.size()) {
            self.grant(Wish::Size(size));
        }
        Ok(self.compare.version() != before || self.compare.hurries())
    }
}

/// Shows the desktop's file dialog. Returns `None` without a desktop portal, which is logged.
fn ask() -> Option<PathBuf> {
    let dialog = rfd::FileDialog::new().set_title("Open a scene, a sky, a session or a picture");
    let files = ["gltf", "glb", "hdr", "exr", "json", "png"];
    dialog.add_filter("All supported files", &files).pick_file()
}

/// Whether an event is user input.
fn is_input(event: &WindowEvent) -> bool {
    matches!(
        event,
        WindowEvent::KeyboardInput { .. }
            | WindowEvent::CursorMoved { .. }
            | WindowEvent::MouseInput { .. }
            | WindowEvent::MouseWheel { .. }
            | WindowEvent::Resized(_)
    )
}
