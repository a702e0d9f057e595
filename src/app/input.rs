//! Translates events of the window to actions.

use super::document::Document;
use super::gizmo::{Gizmo, Grip};
use glam::{DVec3, Vec2};
use std::collections::HashSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{Key, KeyCode, ModifiersState, PhysicalKey};

/// An action that a key, a button or a panel requests. Movements of the pointer are in heights of the picture.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Wish {
    /// Close the window.
    Close,
    /// Show or hide the panels.
    Panels,
    /// Show or hide the list of keys.
    Keys,
    /// Show or hide the handles of lights.
    Handles,
    /// Grip a light or a handle at this position in the window [points].
    Grip(Grip, egui::Pos2),
    /// Move what is gripped to this position in the window [points].
    Pull(egui::Pos2),
    /// Let go of what is gripped.
    Release,
    /// Undo the last edit, or redo it.
    Undo { again: bool },
    /// Deselect the chosen light.
    Unchoose,
    /// Remove the chosen light.
    Remove,
    /// Make the panels larger by this number of steps, or smaller.
    Scale(i32),
    /// Give the panels the size that they had at first.
    ScaleBack,
    /// Play or stop the animation.
    Play,
    /// Orbit the camera around its target.
    Orbit(Vec2),
    /// Turn the camera in place.
    Look(Vec2),
    /// Move the camera sideways.
    Pan(Vec2),
    /// Move towards the target by this number of wheel steps.
    Zoom(f32),
    /// Centre the surface at this position in the picture, from 0 at the top left to 1.
    Centre([f32; 2]),
    /// Show the values of the pixel at this position, from 0 at the top left to 1.
    Pick([f32; 2]),
    /// Switch to the camera in this slot.
    Recall(usize),
    /// Store the current camera in this slot.
    Keep(usize),
    /// Copy the command line of the picture.
    Copy,
    /// Save the picture as PNG.
    Save,
    /// Save the picture as OpenEXR with all layers.
    SaveLayers,
    /// Show or hide the comparison.
    Reference,
    /// Resize the window so that the picture has this size [pixels].
    Size([u32; 2]),
    /// Open the desktop's file dialog.
    Ask,
    /// Save the session.
    SaveSession,
    /// Start writing the animation at this frame rate [frames/s], or stop writing it.
    Video(f64),
    /// Open a file.
    Drop(PathBuf),
}

/// Keys that fly the camera, and their directions: right, up, forward.
const FLIGHT: [(KeyCode, [f64; 3]); 6] = [
    (KeyCode::KeyD, [1.0, 0.0, 0.0]),
    (KeyCode::KeyA, [-1.0, 0.0, 0.0]),
    (KeyCode::KeyE, [0.0, 1.0, 0.0]),
    (KeyCode::KeyQ, [0.0, -1.0, 0.0]),
    (KeyCode::KeyW, [0.0, 0.0, 1.0]),
    (KeyCode::KeyS, [0.0, 0.0, -1.0]),
];

/// Digit keys, which select cameras.
const DIGITS: [KeyCode; 9] = [
    KeyCode::Digit1,
    KeyCode::Digit2,
    KeyCode::Digit3,
    KeyCode::Digit4,
    KeyCode::Digit5,
    KeyCode::Digit6,
    KeyCode::Digit7,
    KeyCode::Digit8,
    KeyCode::Digit9,
];

/// Two clicks within this time and this distance [pixels] are a double click.
const DOUBLE: (Duration, f32) = (Duration::from_millis(400), 5.0);

/// Flight speed of the camera [scene radii/s], and the factor that Shift applies to it.
const SPEED: f64 = 0.4;
const FAST: f64 = 5.0;

/// Scroll distance of a touchpad that equals one step of a wheel [pixels].
const STEP: f64 = 40.0;

/// State of the pointer, the buttons and the keys.
#[derive(Default)]
pub(super) struct Input {
    pointer: Vec2,
    held: Option<MouseButton>,
    /// Whether the left button holds a light or a handle instead of the camera.
    grips: bool,
    clicked: Option<(Instant, Vec2)>,
    keys: HashSet<KeyCode>,
    modifiers: ModifiersState,
}

impl Input {
    /// Whether the window handles this key instead of the panels: Tab always, Space unless text is being edited.
    pub(super) fn is_ours(&self, event: &WindowEvent, panels: &egui::Context) -> bool {
        let WindowEvent::KeyboardInput { event: KeyEvent { physical_key: PhysicalKey::Code(code), .. }, .. } = event
        else {
            return false;
        };
        *code == KeyCode::Tab || (*code == KeyCode::Space && !panels.text_edit_focused())
    }

    /// The actions that an event requests. `place` is the corner and size of the picture [pixels]; `taken` means that a
    /// panel has used the event.
    pub(super) fn take(
        &mut self,
        event: &WindowEvent,
        panels: &egui::Context,
        place: ([u32; 2], [u32; 2]),
        gizmo: &Gizmo,
        taken: bool,
    ) -> Vec<Wish> {
        match event {
            WindowEvent::CloseRequested => vec![Wish::Close],
            WindowEvent::DroppedFile(file) => vec![Wish::Drop(file.clone())],
            WindowEvent::ModifiersChanged(modifiers) => {
                self.modifiers = modifiers.state();
                Vec::new()
            }
            WindowEvent::Focused(false) => {
                self.keys.clear();
                self.held = None;
                if std::mem::take(&mut self.grips) { vec![Wish::Release] } else { Vec::new() }
            }
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => {
                let typing = panels.text_edit_focused() || (taken && !self.is_flight(event));
                self.key(event, typing).into_iter().collect()
            }
            WindowEvent::CursorMoved { position, .. } => {
                let to = Vec2::new(position.x as f32, position.y as f32);
                let by = (to - self.pointer) / place.1[1].max(1) as f32;
                self.pointer = to;
                match self.held {
                    Some(MouseButton::Left) if self.grips => vec![Wish::Pull(self.point(panels))],
                    Some(MouseButton::Left) => vec![Wish::Orbit(by)],
                    Some(MouseButton::Right) => vec![Wish::Look(by)],
                    Some(MouseButton::Middle) => vec![Wish::Pan(by)],
                    _ => Vec::new(),
                }
            }
            WindowEvent::MouseInput { state: ElementState::Released, button, .. } => {
                self.held = self.held.filter(|held| held != button);
                let lets_go = *button == MouseButton::Left && std::mem::take(&mut self.grips);
                if lets_go { vec![Wish::Release] } else { Vec::new() }
            }
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. }
                if self.over_picture(panels, place) =>
            {
                if *button == MouseButton::Left && self.modifiers.control_key() {
                    return vec![Wish::Pick(self.place_of(place))];
                }
                self.held = Some(*button);
                let on = self.point(panels);
                if let Some(grip) = gizmo.at(on).filter(|_| *button == MouseButton::Left) {
                    self.grips = true;
                    return vec![Wish::Grip(grip, on)];
                }
                self.click(*button, place).into_iter().collect()
            }
            WindowEvent::MouseWheel { delta, .. } if self.over_picture(panels, place) => {
                vec![Wish::Zoom(match delta {
                    MouseScrollDelta::LineDelta(_, y) => *y,
                    MouseScrollDelta::PixelDelta(by) => (by.y / STEP) as f32,
                })]
            }
            _ => Vec::new(),
        }
    }

    fn is_flight(&self, event: &KeyEvent) -> bool {
        FLIGHT.iter().any(|(code, _)| event.physical_key == PhysicalKey::Code(*code))
    }

    fn key(&mut self, event: &KeyEvent, typing: bool) -> Option<Wish> {
        let PhysicalKey::Code(code) = event.physical_key else { return None };
        if event.state == ElementState::Released {
            self.keys.remove(&code);
            return None;
        }
        let control = self.modifiers.control_key();
        let function = matches!(code, KeyCode::F1 | KeyCode::F12);
        if typing && !control && !function {
            return None;
        }
        if !control {
            self.keys.insert(code);
        }
        // Keyboards have these characters at different places.
        match event.logical_key.as_ref() {
            Key::Character("+" | "=") if control => return Some(Wish::Scale(1)),
            Key::Character("-") if control => return Some(Wish::Scale(-1)),
            Key::Character("0") if control => return Some(Wish::ScaleBack),
            _ => {}
        }
        if event.repeat {
            return None;
        }
        let digit = DIGITS.iter().position(|digit| *digit == code);
        match code {
            KeyCode::KeyQ if control => Some(Wish::Close),
            KeyCode::KeyO if control => Some(Wish::Ask),
            KeyCode::KeyS if control => Some(Wish::SaveSession),
            KeyCode::KeyC if control && self.modifiers.shift_key() => Some(Wish::Copy),
            KeyCode::Tab | KeyCode::KeyH if !control => Some(Wish::Panels),
            KeyCode::KeyZ if control && !typing => Some(Wish::Undo { again: self.modifiers.shift_key() }),
            KeyCode::KeyY if control && !typing => Some(Wish::Undo { again: true }),
            KeyCode::KeyL if !control => Some(Wish::Handles),
            KeyCode::Escape => Some(Wish::Unchoose),
            KeyCode::Delete => Some(Wish::Remove),
            KeyCode::F1 => Some(Wish::Keys),
            KeyCode::F12 if self.modifiers.shift_key() => Some(Wish::SaveLayers),
            KeyCode::F12 => Some(Wish::Save),
            KeyCode::Space if !control => Some(Wish::Reference),
            KeyCode::KeyP if self.modifiers.shift_key() => Some(Wish::Video(super::video::FPS)),
            KeyCode::KeyP if !control => Some(Wish::Play),
            _ => digit.map(|index| if control { Wish::Keep(index) } else { Wish::Recall(index) }),
        }
    }

    /// Whether the pointer is over the picture and not over a panel.
    fn over_picture(&self, panels: &egui::Context, ([left, top], [width, height]): ([u32; 2], [u32; 2])) -> bool {
        let inside = |at: f32, first: u32, count: u32| at >= first as f32 && at < (first + count) as f32;
        let layer = panels.layer_id_at(self.point(panels));
        inside(self.pointer.x, left, width)
            && inside(self.pointer.y, top, height)
            && layer.is_none_or(|layer| layer.order == egui::Order::Background)
    }

    /// Position of the pointer in the window [points].
    fn point(&self, panels: &egui::Context) -> egui::Pos2 {
        let at = self.pointer / panels.pixels_per_point();
        egui::pos2(at.x, at.y)
    }

    /// Position of the pointer in the picture, from 0 at its top left to 1.
    fn place_of(&self, (corner, size): ([u32; 2], [u32; 2])) -> [f32; 2] {
        [0, 1].map(|i| (self.pointer[i] - corner[i] as f32) / size[i] as f32)
    }

    /// Position of the pointer in the picture, from 0 at its top left to 1. `None` if it is elsewhere.
    pub(super) fn over(&self, panels: &egui::Context, place: ([u32; 2], [u32; 2])) -> Option<[f32; 2]> {
        self.over_picture(panels, place).then(|| self.place_of(place))
    }

    fn click(&mut self, button: MouseButton, place: ([u32; 2], [u32; 2])) -> Option<Wish> {
        if button != MouseButton::Left {
            return None;
        }
        let now = (Instant::now(), self.pointer);
        let second =
            |(at, before): (Instant, Vec2)| at.elapsed() < DOUBLE.0 && before.distance(self.pointer) <= DOUBLE.1;
        if self.clicked.take().is_some_and(second) {
            return Some(Wish::Centre(self.place_of(place)));
        }
        self.clicked = Some(now);
        None
    }

    /// Whether a key that flies the camera is held.
    pub(super) fn flies(&self) -> bool {
        FLIGHT.iter().any(|(code, _)| self.keys.contains(code))
    }

    /// Flies the camera in the direction of the held keys for this time [s].
    pub(super) fn fly(&self, seconds: f64, document: &mut Document) {
        if !self.flies() {
            return;
        }
        let by: DVec3 =
            FLIGHT.iter().filter(|(code, _)| self.keys.contains(code)).map(|(_, by)| DVec3::from(*by)).sum();
        let speed = if self.modifiers.shift_key() { SPEED * FAST } else { SPEED };
        let way = by * speed * seconds * document.radius();
        if let Some(free) = document.free(|_| None) {
            free.fly(way);
        }
    }
}
