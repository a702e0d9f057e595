//! The panels: all controls, with tooltips that say what each does and costs.

mod animation;
pub(super) mod compare;
pub(super) mod debug;
pub(super) mod insets;
mod lights;
mod materials;
mod memory;
mod placement;
mod scene;
mod sky;
pub(super) mod style;
mod subsurface;
mod timings;

use super::camera::Seen;
use super::canvas::Shown;
use super::compare::Compare;
use super::document::Document;
use super::gizmo;
use super::input::Wish;
use super::recent;
use super::video::Video;
use crate::cli::{recent, thousands};
use egui::{ComboBox, DragValue, Grid, ProgressBar, Rect, Response, RichText, ScrollArea, Slider, Ui};
use lightskin::frame::settings::Gather;
use lightskin::frame::{Antialiasing, Exposure, Indirect, LightShadows, Near, Quality, Shadows, Tonemap};
use lightskin::gpu::Gpu;
use lightskin::scene::Projection;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Width of the panels [points].
pub(super) const WIDTH: f32 = 320.0;

/// Keys and their actions.
const KEYS: [(&str, &str); 28] = [
    ("left drag", "orbit around the target"),
    ("right drag", "look around"),
    ("middle drag", "move sideways"),
    ("wheel", "zoom in or out"),
    ("double click", "centre the surface under the pointer"),
    ("Ctrl+click", "show values, lights and caches of the pixel"),
    ("W A S D", "fly forward, left, back, right"),
    ("E, Q", "fly up, down"),
    ("Shift", "fly faster"),
    ("1 to 9", "use a stored camera or a camera of the scene"),
    ("Ctrl+1 to 9", "store the current camera"),
    ("P", "play or stop the animation"),
    ("Shift+P", "start or stop writing the animation as PNG files"),
    ("Ctrl+Z", "undo the last change of a light, a material or a visible object"),
    ("Ctrl+Shift+Z", "redo it"),
    ("L", "show or hide the handles of lights"),
    ("Delete", "remove the chosen light"),
    ("Tab, H", "show or hide the panels"),
    ("Ctrl+Plus, Ctrl+Minus", "make the panels larger, smaller"),
    ("Ctrl+0", "give the panels the size of --ui-scale"),
    ("Ctrl+Shift+C", "copy the command line for this picture"),
    ("Space", "show or hide the reference of this view"),
    ("F12", "save the picture as PNG"),
    ("Shift+F12", "save the picture as OpenEXR with all layers"),
    ("Ctrl+O", "open a file with the file dialog"),
    ("Ctrl+S", "save the session: scene, view, light, settings"),
    ("F1", "show or hide this list"),
    ("Ctrl+Q", "quit"),
];

/// How long the hint stays at the first start.
const HINT: Duration = Duration::from_secs(30);

/// State of the panels.
pub(super) struct State {
    pub(super) visible: bool,
    /// Whether the list of keys is open.
    pub(super) keys: bool,
    /// Whether lights and their handles are shown in the picture.
    pub(super) handles: bool,
    /// Number, spacing and angle of caches while they are being edited.
    caches: Option<u32>,
    spacing: Option<f64>,
    angle: Option<f64>,
    /// Groups of the scene whose instances are listed.
    groups: BTreeSet<usize>,
    /// Frame rate of videos [frames/s].
    fps: f64,
    sky: sky::Edited,
    subsurface: subsurface::Edited,
    /// Text in the field for a path.
    path: String,
    /// End of the hint at the first start.
    hint: Option<Instant>,
}

/// Adds a grid of two columns: names and controls.
fn rows(ui: &mut Ui, name: &str, add: impl FnOnce(&mut Ui)) {
    Grid::new(name).num_columns(2).spacing([12.0, 6.0]).min_col_width(84.0).show(ui, add);
}

/// Adds a named control to a grid, with a tooltip.
fn row(ui: &mut Ui, name: &str, help: &str, add: impl FnOnce(&mut Ui) -> Response) -> Response {
    ui.label(name).on_hover_text(help);
    let response = add(ui).on_hover_text(help);
    ui.end_row();
    response
}

/// Whether the user has changed the value of a number. Widgets also report a change when they merely round or clamp what
/// they show.
fn is_edited(response: &Response) -> bool {
    let touched = response.dragged() || response.drag_stopped() || response.has_focus() || response.lost_focus();
    response.changed() && (touched || response.clicked())
}

/// Adds a drop-down list. The response is marked as changed if another entry was chosen.
fn choose<T: Copy + PartialEq>(ui: &mut Ui, id: &str, value: &mut T, all: &[(T, &str)]) -> Response {
    let name = all.iter().find(|(one, _)| one == value).map_or("", |(_, name)| *name);
    let before = *value;
    let mut response = ComboBox::from_id_salt(id)
        .selected_text(name)
        .truncate()
        .height(400.0)
        .show_ui(ui, |ui| {
            for (one, name) in all {
                ui.selectable_value(value, *one, *name);
            }
        })
        .response;
    if *value != before {
        response.mark_changed();
    }
    response
}

impl State {
    pub(super) fn new(visible: bool) -> Self {
        let hint = (visible && recent::is_first()).then(|| Instant::now() + HINT);
        Self {
            visible,
            keys: false,
            handles: true,
            caches: None,
            spacing: None,
            angle: None,
            groups: BTreeSet::new(),
            fps: super::video::FPS,
            sky: sky::Edited::default(),
            subsurface: subsurface::Edited::default(),
            path: String::new(),
            hint,
        }
    }

    /// Shows the panels. Returns the actions that they request beyond changes of the document, and the part of the
    /// window beside them.
    pub(super) fn show(
        &mut self,
        ui: &mut Ui,
        document: &mut Document,
        compare: &mut Compare,
        gpu: &Gpu,
    ) -> (Vec<Wish>, Rect) {
        let (mut wishes, mut left_over) = (Vec::new(), ui.available_rect_before_wrap());
        if self.visible {
            // The picture keeps a part of a window that is too narrow for both.
            let all = left_over.width();
            let width = if all > WIDTH { WIDTH } else { (0.8 * all).floor() };
            left_over.max.x -= width;
            egui::Panel::right("panels").resizable(false).show_separator_line(false).exact_size(width).show(ui, |ui| {
                ui.add_space(6.0);
                heading(ui, document, gpu);
                ui.separator();
                ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                    debug::pixel(ui, document);
                    section(ui, "Global illumination", true, |ui| self.gi(ui, document));
                    section(ui, "Lights", true, |ui| lights::show(ui, document, gpu));
                    section(ui, "Sky", false, |ui| self.sky.show(ui, document, &mut wishes));
                    section(ui, "Camera", true, |ui| camera(ui, document, gpu, &mut wishes));
                    compare::section(ui, compare, &mut wishes);
                    section(ui, "Debug views", false, |ui| {
                        debug::marks(ui, document);
                        insets::controls(ui, document);
                    });
                    section(ui, "Materials", false, |ui| materials::show(ui, document, &mut self.subsurface, gpu));
                    section(ui, "Animation", false, |ui| {
                        animation::show(ui, document, gpu, &mut self.fps, &mut wishes)
                    });
                    section(ui, "Scene", false, |ui| scene::show(ui, document, &mut self.groups, gpu));
                    section(ui, "Placement of caches", false, |ui| self.placement(ui, document));
                    section(ui, "Variants of the method", false, |ui| placement::variants(ui, document));
                    section(ui, "Timings", true, |ui| timings::show(ui, document));
                    section(ui, "Memory", false, |ui| memory::show(ui, gpu));
                    section(ui, "Files", false, |ui| self.files(ui, document, &mut wishes));
                    section(ui, "Log", false, log);
                });
            });
        } else if let Some((done, what)) = work(document) {
            egui::Area::new(egui::Id::unique("progress"))
                .fixed_pos([12.0, 12.0])
                .show(ui.ctx(), |ui| progress(ui, done, &what));
        }
        if self.keys {
            keys(ui, &mut self.keys);
        }
        (wishes, left_over)
    }

    /// Whether lights and their handles are shown in the picture.
    pub(super) fn shows_lights(&self) -> bool {
        self.visible && self.handles
    }

    /// While the panels are visible, shows lights and their handles over the picture, and what lights the picked pixel.
    pub(super) fn over(&self, ui: &Ui, document: &mut Document, picture: Rect) {
        if self.visible {
            debug::pixel_marks(ui, document, picture);
        }
        if self.shows_lights() {
            gizmo::show(ui, document, picture);
        } else {
            document.gizmo.clear();
        }
    }

    /// Shows three lines over the picture at the first start. They disappear after `HINT`, or when a button is pressed.
    pub(super) fn hint(&mut self, ui: &Ui, picture: Rect) {
        let is_small = picture.width() < 420.0 || picture.height() < 200.0;
        let dragged = ui.input(|input| input.pointer.any_down());
        let Some(left) = self.hint.and_then(|end| end.checked_duration_since(Instant::now())).filter(|_| !dragged)
        else {
            self.hint = None;
            return;
        };
        if is_small {
            return;
        }
        ui.ctx().request_repaint_after(left);
        let middle = picture.center_top() + egui::vec2(0.0, 0.75 * picture.height());
        egui::Area::new(egui::Id::unique("hint"))
            .fixed_pos(middle)
            .pivot(egui::Align2::CENTER_CENTER)
            .interactable(false)
            .show(ui.ctx(), |ui| {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    ui.label("Drag to orbit, use the wheel to zoom and W A S D to fly.");
                    ui.label("Drop a glTF scene or a sky here. Space shows a path-traced reference.");
                    ui.label("F1 lists all keys. Hover over a control to read what it does.");
                });
            });
    }

    fn files(&mut self, ui: &mut Ui, document: &mut Document, wishes: &mut Vec<Wish>) {
        let help = "Path of a scene, a sky (.hdr, .exr), a session (.json) or a picture to compare with (.png). Press Enter to \
                    open it. You can also drop files on the window.";
        let typed = egui::TextEdit::singleline(&mut self.path).hint_text("path of a file").desired_width(WIDTH - 40.0);
        let response = ui.add(typed).on_hover_text(help);
        if response.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter)) && !self.path.is_empty() {
            wishes.push(Wish::Drop(PathBuf::from(self.path.trim())));
        }
        ui.horizontal(|ui| {
            let help = "Opens a file with the desktop's file dialog. On Linux this needs a desktop portal.";
            if ui.button("Open").on_hover_text(help).clicked() {
                wishes.push(Wish::Ask);
            }
            let help = "Saves scene, view, light, materials and settings as a JSON file in the current folder. To restore them, drop \
                        the file here or pass it on the command line instead of a scene.";
            if ui.button("Save session").on_hover_text(help).clicked() {
                wishes.push(Wish::SaveSession);
            }
            let help = "Reloads the scene when its files change. The camera stays.";
            ui.checkbox(&mut document.args.watch, "watch").on_hover_text(help);
        });
        for path in &document.recent {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if ui.link(name).on_hover_text(path.display().to_string()).clicked() {
                wishes.push(Wish::Drop(path.clone()));
            }
        }
    }

    fn gi(&mut self, ui: &mut Ui, document: &mut Document) {
        let mut quality = document.wanted().quality();
        let mut settings = document.settings;
        rows(ui, "gi", |ui| {
            let levels = [
                (Quality::Low, "low"),
                (Quality::Medium, "medium"),
                (Quality::High, "high"),
                (Quality::Reference, "reference"),
            ];
            let help = "Sets everything below at once: caches, map sizes, shadows and rays. The caches of a new level are \
                        baked in the background. The old picture stays until they are ready.";
            if row(ui, "Quality", help, |ui| choose(ui, "quality", &mut quality, &levels)).changed() {
                let mut args = document.wanted().clone();
                args.set_quality(quality);
                document.open(args, false);
            }
            let mut count = self.caches.unwrap_or(document.wanted().cache_count().unwrap_or(document.caches) as u32);
            let help = format!(
                "Approximate number of light caches on the surfaces. More caches give finer indirect light. The time \
                 grows in proportion, or faster with shadows. New caches are baked in the background.{}",
                cost(document, &["gather", "depth images", "occlude"])
            );
            let response = row(ui, "Caches", &help, |ui| {
                ui.add(DragValue::new(&mut count).range(10..=100_000).speed(10.0).update_while_editing(false))
            });
            self.caches = (response.changed() || response.dragged()).then_some(count).or(self.caches);
            if let (false, Some(count)) = (response.dragged() || response.has_focus(), self.caches) {
                self.caches = None;
                let mut args = document.wanted().clone();
                if args.cache_count() != Some(count as usize) {
                    args.set_caches(Some(count));
                    document.open(args, false);
                }
            }
            let ways =
                [(document.usual().indirect, "caches"), (Indirect::BruteForce, "brute force"), (Indirect::Off, "off")];
            let mut way = match settings.indirect {
                Indirect::Caches(_) => ways[0].0,
                other => other,
            };
            let help = "Method for indirect light. Caches are the real-time method. Brute force lights every pixel by every \
                        virtual light, without shadows: slow, but without interpolation. Off shows only direct light.";
            if row(ui, "Indirect light", help, |ui| choose(ui, "indirect", &mut way, &ways)).changed() {
                settings.indirect = way;
            }
            if let Some(Gather::Compute { bounces, shadows, near, .. }) = Document::compute(&mut settings) {
                let help = format!(
                    "Number of reflections after the direct light of lamps and emissive surfaces. In each further bounce \
                     all caches light each other once more.{}",
                    cost(document, &["gather"])
                );
                row(ui, "Bounces", &help, |ui| ui.add(Slider::new(bounces, 0..=16)));
                let kinds =
                    [(Shadows::Off, "off"), (Shadows::Proxy, "per cache"), (Shadows::PerLight, "per virtual light")];
                let help = format!(
                    "Shadows of indirect light. Off lets it pass through walls. Per cache dims the light of each cache as a \
                     whole. Per virtual light tests each virtual light at each cache and costs most.{}",
                    cost(document, &["depth images", "occlude"])
                );
                row(ui, "GI shadows", &help, |ui| choose(ui, "shadows", shadows, &kinds));
                let help = format!(
                    "Short rays find light and occlusion from surfaces within one cache spacing, such as contact shadows and \
                     corners. Endless rays go on to the first surface, wherever it is; caches then give only further bounces. The \
                     cost grows with the number of pixels.{}",
                    cost(document, &["near rays"])
                );
                let [per_pixel, every] = near.rays().or(Quality::High.near().rays()).unwrap_or_default();
                let kinds = [
                    (Near::Off, "off"),
                    (Near::Rays { per_pixel, every }, "short"),
                    (Near::Endless { per_pixel, every }, "endless"),
                ];
                row(ui, "Rays", &help, |ui| choose(ui, "near", near, &kinds));
                if let Near::Rays { per_pixel, every } | Near::Endless { per_pixel, every } = near {
                    let help =
                        "Rays per traced pixel. 16 neighbouring pixels share their rays. The time grows in proportion.";
                    row(ui, "  per pixel", help, |ui| ui.add(Slider::new(per_pixel, 1..=32)));
                    let help = "Distance between traced pixels, along rows and columns. 2 needs a quarter of the rays of 1. auto: 2, but \
                         1 in pictures below 640 x 360 pixels.";
                    row(ui, "  every", help, |ui| {
                        let shown = |every: f64, _| if every == 0.0 { "auto".into() } else { format!("{every} px") };
                        ui.add(Slider::new(every, 0..=8).custom_formatter(shown))
                    });
                }
            }
            let sizes = [32, 64, 96, 128, 192, 256].map(|n| (n, format!("{n} x {n}")));
            let sizes = sizes.each_ref().map(|(n, name)| (*n, name.as_str()));
            let help = format!(
                "Virtual lights of each light source: the texels of its reflective shadow map. The time of the gather \
                 grows in proportion.{}",
                cost(document, &["rsm", "gather"])
            );
            row(ui, "Virtual lights", &help, |ui| choose(ui, "rsm", &mut settings.rsm, &sizes));
            let kinds = [
                (LightShadows::Maps(512), "map of 512 x 512"),
                (LightShadows::Maps(1024), "map of 1024 x 1024"),
                (LightShadows::Maps(2048), "map of 2048 x 2048"),
                (LightShadows::Maps(4096), "map of 4096 x 4096"),
                (LightShadows::Rays, "rays"),
            ];
            let help = format!(
                "Shadows of lamps and the sun: rays from each pixel, or shadow maps, whose edges are as coarse as their \
                 texels.{}",
                cost(document, &["direct"])
            );
            row(ui, "Direct shadows", &help, |ui| choose(ui, "light_shadows", &mut settings.light_shadows, &kinds));
            let kinds = [
                (Antialiasing::Off, "off"),
                (Antialiasing::Fast, "fast"),
                (Antialiasing::Four, "4 extra points"),
                (Antialiasing::Eight, "8 extra points"),
            ];
            let help = format!(
                "Sample points per pixel, in addition to its centre, for smooth edges. The scene is drawn once for each. Fast \
                 draws four at once. Where they show another surface, they take the light of the pixels around.{}",
                cost(document, &["edges", "mix edges"])
            );
            row(ui, "Antialiasing", &help, |ui| choose(ui, "antialiasing", &mut settings.antialiasing, &kinds));
            let kinds = [(1, "1 layer"), (2, "2 layers"), (4, "4 layers"), (8, "8 layers")];
            let help = format!(
                "Maximum number of glass and other blended surfaces that a pixel shows, one behind another. Each layer costs as \
                 much shading as a picture of its own.{}",
                cost(document, &["layers", "mix layers"])
            );
            row(ui, "Glass layers", &help, |ui| choose(ui, "layers", &mut settings.layers, &kinds));
        });
        document.settings = settings;
    }
}

/// The times of these stages in the last drawn frame, as text for a tooltip.
fn cost(document: &Document, stages: &[&str]) -> String {
    let Some(last) = document.times.back() else { return String::new() };
    let told: Vec<String> = (last.stages.iter())
        .filter(|(name, _)| stages.contains(name))
        .map(|(name, ms)| format!("{name} {ms:.2} ms"))
        .collect();
    if told.is_empty() { String::new() } else { format!("\n\nIn the last frame: {}.", told.join(", ")) }
}

fn section(ui: &mut Ui, name: &str, open: bool, add: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(name).strong()).default_open(open).show_unindented(ui, |ui| {
        ui.add_space(2.0);
        add(ui);
        ui.add_space(6.0);
    });
}

fn progress(ui: &mut Ui, done: f32, what: &str) {
    ui.add(ProgressBar::new(done).desired_width(WIDTH - 24.0).text(what.to_owned()));
}

/// Progress of a job or of a video, from 0 to 1, and what it does.
fn work(document: &Document) -> Option<(f32, String)> {
    document.progress().or_else(|| document.video.as_ref().map(Video::progress))
}

fn heading(ui: &mut Ui, document: &Document, gpu: &Gpu) {
    if let Some(scene) = document.scene() {
        let file = document.args.scene.as_ref().map_or("built in".into(), |path| path.display().to_string());
        ui.label(RichText::new(&scene.name).heading()).on_hover_text(file);
        let (triangles, caches) = (thousands(scene.triangle_count()), thousands(document.caches));
        ui.label(format!("{triangles} triangles, {caches} caches"));
    } else {
        ui.label(RichText::new("lightskin").heading());
    }
    ui.label(RichText::new(&gpu.report().name).weak()).on_hover_text(&gpu.report().driver);
    match work(document) {
        Some((done, what)) => progress(ui, done, &what),
        None => {
            ui.label(RichText::new("F1 lists all keys. Drop a scene or a sky here.").weak());
        }
    }
}

fn camera(ui: &mut Ui, document: &mut Document, gpu: &Gpu, wishes: &mut Vec<Wish>) {
    let names: Vec<String> = document.scene().map_or_else(Vec::new, |scene| {
        scene.cameras.iter().enumerate().map(|(i, camera)| format!("{} {}", i + 1, camera.name)).collect()
    });
    rows(ui, "camera", |ui| {
        let mut all: Vec<(Seen, &str)> =
            names.iter().enumerate().map(|(i, name)| (Seen::OfScene(i), name.as_str())).collect();
        if let Seen::Free(_) = document.seen {
            all.push((document.seen, "free camera"));
        }
        let help = "Camera of the picture. Moving the view switches to a free camera. Ctrl+1 to 9 store it.";
        let mut seen = document.seen;
        row(ui, "Camera", help, |ui| choose(ui, "camera", &mut seen, &all));
        document.seen = seen;
        let degrees = document.camera().map(|camera| match camera.projection {
            Projection::Perspective { yfov } => yfov.to_degrees(),
            Projection::Orthographic { .. } => 0.0,
        });
        if let Some(before) = degrees.filter(|degrees| *degrees > 0.0) {
            let mut fov = before;
            let help = "Vertical field of view. A small angle is a long lens.";
            if row(ui, "Field of view", help, |ui| ui.add(Slider::new(&mut fov, 5.0..=120.0).suffix(" deg"))).changed()
                && let Some(free) = document.free(|_| None)
            {
                free.fov = fov;
            }
        }
        let mut automatic = document.look.exposure == Exposure::Automatic;
        let help = "Meters the exposure from the surfaces in view. Switch it off to fix the exposure. Free of cost.";
        if row(ui, "Exposure", help, |ui| ui.checkbox(&mut automatic, "automatic")).changed() {
            document.look.exposure = if automatic { Exposure::Automatic } else { Exposure::Ev(document.ev(gpu)) };
        }
        if let Exposure::Ev(ev) = &mut document.look.exposure {
            let help = "Exposure value at ISO 100. A value larger by 1 makes the picture half as bright.";
            row(ui, "Exposure value", help, |ui| {
                ui.add(DragValue::new(ev).speed(0.05).range(-100.0..=100.0).max_decimals(2))
            });
        }
        let curves = [
            (Tonemap::PbrNeutral, "PBR Neutral"),
            (Tonemap::Agx, "AgX"),
            (Tonemap::Aces, "ACES"),
            (Tonemap::Linear, "none, clipped"),
        ];
        let help =
            "Curve from radiance to display colours. PBR Neutral preserves base colours. AgX and ACES look like film.";
        row(ui, "Tone curve", help, |ui| choose(ui, "tonemap", &mut document.look.tonemap, &curves));
        let help = "Shows the picture or a single layer. Depth and luminance are in false colours. Broken values marks pixels \
                    with negative or non-finite radiance in magenta. Free of cost.";
        if row(ui, "Show", help, |ui| choose(ui, "shown", &mut document.shown, &Shown::ALL)).changed() {
            document.fit_scale(gpu);
        }
        debug::scale(ui, document, gpu);
    });
    ui.horizontal(|ui| {
        let help = "Copies and prints the command that renders this picture to a file. It does not include edited lights and \
                    materials, or hidden objects: save a session for those, and render that.";
        if ui.button("Copy as command line").on_hover_text(help).clicked() {
            wishes.push(Wish::Copy);
        }
        if ui.button("Save PNG").on_hover_text("Saves the picture without the panels to the current folder.").clicked() {
            wishes.push(Wish::Save);
        }
    });
}

fn log(ui: &mut Ui) {
    ScrollArea::vertical().id_salt("log").max_height(160.0).stick_to_bottom(true).auto_shrink([false, true]).show(
        ui,
        |ui| {
            for line in recent() {
                ui.label(RichText::new(line).small());
            }
        },
    );
}

fn keys(ui: &Ui, open: &mut bool) {
    egui::Window::new("Keys").open(open).collapsible(false).resizable(false).default_pos([24.0, 24.0]).show(
        ui.ctx(),
        |ui| {
            rows(ui, "keys", |ui| {
                for (key, what) in KEYS {
                    ui.label(RichText::new(key).strong());
                    ui.label(what);
                    ui.end_row();
                }
            });
        },
    );
}
