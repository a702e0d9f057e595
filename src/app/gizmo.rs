//! Handles in the picture that move and aim lights.

use super::document::Document;
use crate::cli::lights::Lamp;
use egui::{Align2, Color32, CursorIcon, FontId, Id, LayerId, Order, Painter, Pos2, Rect, Stroke, Ui};
use glam::{DVec3, Vec4};
use lightskin::frame::View;
use lightskin::gpu::Gpu;
use lightskin::reference::tonemap::srgb_from_linear;
use lightskin::scene::LightKind;
use std::f64::consts::TAU;

/// Length of the arrows, and radius of the circle on which a sun is dragged [points].
const LENGTH: f64 = 70.0;
/// Size of what can be gripped [points].
const GRIP: f32 = 16.0;
/// Colours of the arrows along +X, +Y and +Z.
const AXES: [Color32; 3] =
    [Color32::from_rgb(232, 86, 80), Color32::from_rgb(120, 200, 80), Color32::from_rgb(86, 140, 240)];
const CHOSEN: Color32 = Color32::from_rgb(255, 196, 64);

/// A handle of the chosen light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Handle {
    /// Moves along +X, +Y or +Z.
    Axis(usize),
    /// Moves parallel to the picture.
    Middle,
    /// Aims a spot, or moves a sun across the sky.
    Aim,
}

/// What the pointer can grip in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Grip {
    /// A light that is not chosen, by its index.
    Light(usize),
    /// A handle of the chosen light.
    Handle(Handle),
}

/// A handle that is held.
struct Held {
    handle: Handle,
    /// Position of the light when it was gripped [m].
    from: DVec3,
    /// Where the pointer was then [points].
    at: Pos2,
}

/// The lights in the picture of the last frame, and the handle that is held.
#[derive(Default)]
pub(super) struct Gizmo {
    screen: Option<Screen>,
    grips: Vec<(Pos2, Grip)>,
    held: Option<Held>,
    /// Whether a light has moved since the last frame.
    moved: bool,
}

impl Gizmo {
    /// What lies below a position in the window [points].
    pub(super) fn at(&self, on: Pos2) -> Option<Grip> {
        let near = self.grips.iter().filter(|(at, _)| at.distance(on) <= 0.5 * GRIP);
        near.min_by(|a, b| a.0.distance(on).total_cmp(&b.0.distance(on))).map(|(_, grip)| *grip)
    }

    /// Removes everything that can be gripped, because it is not shown.
    pub(super) fn clear(&mut self) {
        *self = Self { moved: self.moved, ..Self::default() };
    }
}

impl Document {
    /// Grips something at a position in the window [points].
    pub(super) fn grip(&mut self, grip: Grip, at: Pos2) {
        match (grip, self.lights.chosen, self.gizmo.screen) {
            (Grip::Light(index), ..) => {
                self.gizmo.held = None;
                self.lights.chosen = Some(index).filter(|index| *index < self.lights.lamps.len());
            }
            (Grip::Handle(handle), Some(index), Some(seen)) => {
                let from = centre(&self.lights.lamps[index], &seen, self.radius());
                self.gizmo.held = Some(Held { handle, from, at });
            }
            _ => {}
        }
    }

    /// Moves what is held to a position in the window [points]. The next frame shows it.
    pub(super) fn pull(&mut self, to: Pos2) {
        let (Some(index), Some(seen), Some(held)) = (self.lights.chosen, self.gizmo.screen, &self.gizmo.held) else {
            return;
        };
        let Some(length) = seen.scale(held.from).map(|scale| LENGTH * scale) else { return };
        let lamp = &mut self.lights.lamps[index];
        let before = lamp.light.clone();
        match held.handle {
            Handle::Aim => {
                let towards = seen.on_sphere(to, held.from, length, aim(lamp)).as_vec3();
                let is_sun = lamp.light.kind == LightKind::Directional;
                lamp.light.direction = if is_sun { -towards } else { towards };
            }
            _ => lamp.light.position = moved(&seen, held, to).unwrap_or(lamp.light.position),
        }
        if lamp.light != before {
            lamp.placed = true;
            self.gizmo.moved = true;
            self.history.change();
        }
    }

    /// Applies all movements since the last frame at once.
    pub(super) fn follow_pointer(&mut self, gpu: &Gpu) {
        if std::mem::take(&mut self.gizmo.moved) {
            self.light(gpu);
        }
    }

    /// Lets go of what is held.
    pub(super) fn release(&mut self) {
        self.gizmo.held = None;
    }
}

/// The view of a picture that lies at a place in the window.
#[derive(Clone, Copy)]
pub(super) struct Screen {
    pub(super) view: View,
    /// Origin of the scene [m].
    pub(super) origin: DVec3,
    /// Place of the picture [points].
    pub(super) picture: Rect,
}

impl Screen {
    /// Where a point appears. `None` behind the camera.
    pub(super) fn project(&self, point: DVec3) -> Option<Pos2> {
        let clip = self.view.clip_from_world * (point - self.origin).as_vec3().extend(1.0);
        let at = 0.5 * egui::vec2(clip.x / clip.w + 1.0, clip.y / clip.w + 1.0);
        let on = self.picture.min + self.picture.size() * at;
        (clip.w > 0.0 && on.is_finite()).then_some(on)
    }

    /// Origin and unit direction of the ray through a position in the window.
    fn ray(&self, on: Pos2) -> (DVec3, DVec3) {
        let at = (on - self.picture.min) / self.picture.size();
        let world = |depth: f32| self.view.world_from_clip * Vec4::new(2.0 * at.x - 1.0, 2.0 * at.y - 1.0, depth, 1.0);
        let eye = self.view.eye.truncate().as_dvec3();
        match self.view.eye.w {
            0.0 => (world(0.0).truncate().as_dvec3() + self.origin, -eye.normalize()),
            // In perspective, points of depth 0 are infinitely far.
            _ => (eye + self.origin, world(0.0).truncate().as_dvec3().normalize()),
        }
    }

    /// Unit direction into the picture.
    fn forward(&self) -> DVec3 {
        self.view.plane.truncate().as_dvec3().normalize_or(DVec3::NEG_Z)
    }

    /// The point below a position in the window on the plane through `through` parallel to the picture.
    fn on_plane(&self, on: Pos2, through: DVec3) -> Option<DVec3> {
        let (origin, along) = self.ray(on);
        let distance = (through - origin).dot(self.forward()) / along.dot(self.forward());
        distance.is_finite().then(|| origin + distance * along)
    }

    /// Length that appears as one point of the window at this place [m].
    fn scale(&self, at: DVec3) -> Option<f64> {
        let on = self.project(at)?;
        let [a, b] = [on, on + egui::vec2(1.0, 0.0)].map(|on| self.on_plane(on, at));
        Some(a?.distance(b?)).filter(|length| *length > 0.0 && length.is_finite())
    }

    /// Position [m] along the line through `from` that is nearest to what is below a position in the window. `None` if
    /// the line runs into the picture.
    fn along(&self, on: Pos2, from: DVec3, axis: DVec3) -> Option<f64> {
        let (origin, along) = self.ray(on);
        let (apart, cosine) = (from - origin, axis.dot(along));
        let sine2 = 1.0 - cosine * cosine;
        (sine2 > 1e-3).then(|| (cosine * along.dot(apart) - axis.dot(apart)) / sine2)
    }

    /// Unit direction from `centre` to the point below a position in the window on a sphere of this radius [m]: of the two
    /// the one nearer to `now`, or the nearest point of the outline if the sphere is missed.
    fn on_sphere(&self, on: Pos2, centre: DVec3, radius: f64, now: DVec3) -> DVec3 {
        let (origin, along) = self.ray(on);
        let middle = (centre - origin).dot(along);
        let nearest = origin + middle * along - centre;
        let half = (radius * radius - nearest.length_squared()).max(0.0).sqrt();
        let ends = [-half, half].map(|by| (nearest + by * along).normalize_or(now));
        if ends[0].dot(now) >= ends[1].dot(now) { ends[0] } else { ends[1] }
    }
}

/// The point about which a light's handles lie. Suns, which are infinitely far, have theirs in the middle of the picture.
fn centre(lamp: &Lamp, seen: &Screen, radius: f64) -> DVec3 {
    match lamp.light.kind {
        LightKind::Directional => {
            let (origin, along) = seen.ray(seen.picture.center());
            origin + radius * along
        }
        _ => lamp.light.position,
    }
}

/// Unit direction from the centre of the handles to the one that aims. A sun is held where it stands.
fn aim(lamp: &Lamp) -> DVec3 {
    let direction = lamp.light.direction.as_dvec3();
    if lamp.light.kind == LightKind::Directional { -direction } else { direction }
}

/// Draws lights and the handles of the chosen one over the picture, and notes where they can be gripped.
pub(super) fn show(ui: &Ui, document: &mut Document, picture: Rect) {
    document.gizmo.grips.clear();
    let (Some(view), Some(engine)) = (document.view(), &document.engine) else { return };
    if picture.width() < 100.0 || picture.height() < 100.0 {
        return;
    }
    let seen = Screen { view, origin: engine.world().origin, picture };
    document.gizmo.screen = Some(seen);
    let (radius, pointer) = (document.radius(), ui.input(|input| input.pointer.hover_pos()));
    let painter = ui.ctx().layer_painter(LayerId::new(Order::Middle, Id::unique("lights in the picture")));
    let painter = painter.with_clip_rect(picture);
    let grips = &mut document.gizmo.grips;
    for (index, lamp) in document.lights.lamps.iter().enumerate() {
        let chosen = document.lights.chosen == Some(index);
        if lamp.light.kind == LightKind::Directional && !chosen {
            continue;
        }
        let centre = centre(lamp, &seen, radius);
        let Some(on) = seen.project(centre).filter(|on| picture.contains(*on)) else { continue };
        if chosen {
            handles(&painter, &seen, lamp, centre, grips);
        } else {
            grips.push((on, Grip::Light(index)));
        }
        bulb(&painter, on, lamp, chosen);
        if pointer.is_some_and(|pointer| pointer.distance(on) <= 0.5 * GRIP) {
            let at = on + egui::vec2(12.0, -12.0);
            let font = FontId::proportional(13.0);
            painter.text(
                at + egui::vec2(1.0, 1.0),
                Align2::LEFT_BOTTOM,
                &lamp.light.name,
                font.clone(),
                Color32::BLACK,
            );
            painter.text(at, Align2::LEFT_BOTTOM, &lamp.light.name, font, Color32::WHITE);
        }
    }
    if pointer.is_some_and(|pointer| document.gizmo.at(pointer).is_some()) {
        ui.ctx().set_cursor_icon(CursorIcon::Grab);
    }
}

/// Draws a light: a disc of its colour, dark inside if it is off.
fn bulb(painter: &Painter, on: Pos2, lamp: &Lamp, chosen: bool) {
    let color = (lamp.light.color / lamp.light.color.max_element().max(1e-6)).as_dvec3();
    let [r, g, b] = srgb_from_linear(color).to_array().map(|value| (255.0 * value).round() as u8);
    let fill = if lamp.on { Color32::from_rgb(r, g, b) } else { Color32::from_gray(60) };
    painter.circle(on, 6.0, fill, Stroke::new(3.0, Color32::from_black_alpha(140)));
    painter.circle_stroke(on, 6.0, Stroke::new(1.5, if chosen { CHOSEN } else { Color32::from_gray(220) }));
}

/// Draws the handles of the chosen light, and notes where they can be gripped.
fn handles(painter: &Painter, seen: &Screen, lamp: &Lamp, centre: DVec3, grips: &mut Vec<(Pos2, Grip)>) {
    let (Some(scale), Some(middle)) = (seen.scale(centre), seen.project(centre)) else { return };
    let length = LENGTH * scale;
    let is_sun = lamp.light.kind == LightKind::Directional;
    let mut all = Vec::new();
    if !is_sun {
        grips.push((middle, Grip::Handle(Handle::Middle)));
        for (axis, color) in AXES.into_iter().enumerate() {
            all.push((Handle::Axis(axis), DVec3::AXES[axis], color));
        }
    }
    if lamp.light.kind != LightKind::Point {
        outline(painter, seen, lamp, centre, length);
        all.push((Handle::Aim, aim(lamp), CHOSEN));
    }
    for (handle, along, color) in all {
        let Some(on) = seen.project(centre + length * along) else { continue };
        // A handle that points at the viewer cannot be pulled, and would cover the middle.
        if on.distance(middle) <= GRIP && !is_sun {
            continue;
        }
        painter.line_segment([middle, on], Stroke::new(4.0, Color32::from_black_alpha(120)));
        painter.line_segment([middle, on], Stroke::new(2.0, color));
        painter.circle(on, 5.0, color, Stroke::new(1.0, Color32::from_black_alpha(160)));
        grips.push((on, Grip::Handle(handle)));
    }
}

/// Where an arrow or the middle has moved its light.
fn moved(seen: &Screen, held: &Held, pointer: Pos2) -> Option<DVec3> {
    let by = match held.handle {
        Handle::Axis(axis) => {
            let axis = DVec3::AXES[axis];
            let [from, to] = [held.at, pointer].map(|on| seen.along(on, held.from, axis));
            (to? - from?) * axis
        }
        _ => {
            let [from, to] = [held.at, pointer].map(|on| seen.on_plane(on, held.from));
            to? - from?
        }
    };
    Some(held.from + by).filter(|position| position.is_finite())
}

/// Draws the cone of a spot, or the circle on which a sun is dragged.
fn outline(painter: &Painter, seen: &Screen, lamp: &Lamp, centre: DVec3, length: f64) {
    let ring = |around: DVec3, angle: f64, color: Color32| {
        let (u, v) = around.any_orthonormal_pair();
        let point = |i: u32| {
            let turn = TAU * f64::from(i) / 48.0;
            let across = angle.sin() * (turn.cos() * u + turn.sin() * v);
            seen.project(centre + length * (angle.cos() * around + across))
        };
        let points: Vec<Pos2> = (0..=48).filter_map(point).collect();
        painter.line(points, Stroke::new(1.5, color));
    };
    match lamp.light.kind {
        LightKind::Spot { inner, outer } => {
            ring(aim(lamp), f64::from(inner), CHOSEN.gamma_multiply(0.5));
            ring(aim(lamp), f64::from(outer), CHOSEN);
        }
        _ => {
            ring(seen.forward(), TAU / 4.0, CHOSEN.gamma_multiply(0.5));
            ring(DVec3::Y, TAU / 4.0, CHOSEN.gamma_multiply(0.3));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightskin::scene::{Camera, Projection};

    /// A view of a scene of 2 m that is far from the origin of the world.
    fn seen(projection: Projection) -> Screen {
        let origin = DVec3::new(5000.0, -20.0, 300.0);
        let camera = crate::cli::camera::look_at(origin + DVec3::new(1.0, 2.0, 5.0), origin, DVec3::Y, 40.0);
        let camera = Camera { projection, ..camera.expect("a camera") };
        let picture = Rect::from_min_size(egui::pos2(40.0, 20.0), egui::vec2(600.0, 400.0));
        Screen { view: View::new(&camera, [600, 400], origin, 2.0), origin, picture }
    }

    const KINDS: [Projection; 2] = [Projection::Perspective { yfov: 0.8 }, Projection::Orthographic { ymag: 1.5 }];

    #[test]
    fn lights_stay_under_the_pointer() {
        for seen in KINDS.map(seen) {
            let from = seen.origin + DVec3::new(0.3, 0.5, -0.4);
            let at = seen.project(from).expect("in view");
            for (handle, to) in [(Handle::Middle, egui::vec2(70.0, -35.0)), (Handle::Axis(0), egui::vec2(64.0, 9.0))] {
                let held = Held { handle, from, at };
                let position = moved(&seen, &held, at + to).expect("a position");
                let now = seen.project(position).expect("in view") - at;
                match handle {
                    Handle::Axis(_) => {
                        assert!((position - from).cross(DVec3::X).length() < 1e-9, "{position}");
                        let along = seen.project(from + 0.1 * DVec3::X).expect("in view") - at;
                        // In the picture it is as far along the arrow as the pointer, but for perspective.
                        assert!(((now - to).dot(along) / along.length()).abs() < 4.0, "{now:?}");
                    }
                    _ => {
                        assert!((now - to).length() < 0.02, "{now:?}");
                        assert!((position - from).dot(seen.forward()).abs() < 1e-6, "it must keep its distance");
                    }
                }
            }
            let still = Held { handle: Handle::Axis(1), from, at };
            assert!(moved(&seen, &still, at).expect("a position").distance(from) < 1e-9);
        }
    }

    #[test]
    fn suns_follow_the_pointer_over_their_sphere() {
        for seen in KINDS.map(seen) {
            let (centre, radius) = (seen.origin, 0.5);
            for wanted in [DVec3::Y, DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.48, 0.6, 0.64)] {
                let on = seen.project(centre + radius * wanted).expect("in view");
                let found = seen.on_sphere(on, centre, radius, (wanted + 0.1 * DVec3::X).normalize());
                assert!((found - wanted).length() < 1e-3, "{found} for {wanted}");
            }
            // Beside the sphere it is the nearest point of the outline.
            let beside = seen.on_sphere(egui::pos2(600.0, 220.0), centre, radius, DVec3::Y);
            assert!((beside.length() - 1.0).abs() < 1e-9 && beside.x > 0.9, "{beside}");
        }
    }

    #[test]
    fn lengths_in_the_picture_are_those_of_the_scene() {
        for seen in KINDS.map(seen) {
            let at = seen.origin + DVec3::new(0.2, 0.1, 0.3);
            let scale = seen.scale(at).expect("in view");
            let right = seen.forward().cross(DVec3::Y).normalize();
            let apart = seen.project(at + 50.0 * scale * right).expect("in view") - seen.project(at).expect("in view");
            assert!((apart.length() - 50.0).abs() < 0.5, "{apart:?}");
        }
    }
}
