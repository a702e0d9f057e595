//! What events of the window ask for.

use super::document::Document;
use glam::{DVec3, Vec2};
use std::collections::HashSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{KeyCode, ModifiersState, PhysicalKey};

/// What a key, a button or a panel asks for. Ways of the pointer are parts of the picture's height.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Wish {
    /// Close the window.
    Close,
    /// Show or hide the panels.
    Panels,
    /// Show or hide the list of keys.
    Keys,
    /// Play the animation, or stop it.
    Play,
    /// Turn around the target.
    Orbit(Vec2),
    /// Turn where the camera stands.
    Look(Vec2),
    /// Move sideways.
    Pan(Vec2),
    /// Go nearer by so many steps.
    Zoom(f32),
    /// Bring what is here to the middle; from 0 at the top left to 1.
    Centre([f32; 2]),
    /// Tell what is here; likewise.
    Pick([f32; 2]),
    /// See by this camera.
    Recall(usize),
    /// Remember the camera here.
    Keep(usize),
    /// Copy the command line of the picture.
    Copy,
    /// Write the picture as PNG.
    Save,
    /// Write it as OpenEXR with all layers.
    SaveLayers,
    /// Show what it is compared with, or stop that.
    Reference,
    /// Give the picture this size in pixels.
    Size([u32; 2]),
    /// Ask the desktop for a file to open.
    Ask,
    /// Write the session.
    SaveSession,
    /// Write the animation at so many frames a second, or end that.
    Video(f64),
    /// Open a file.
    Drop(PathBuf),
}

/// Keys that fly, and where to: right, up, forward.
const FLIGHT: [(KeyCode, [f64; 3]); 6] = [
    (KeyCode::KeyD, [1.0, 0.0, 0.0]),
    (KeyCode::KeyA, [-1.0, 0.0, 0.0]),
    (KeyCode::KeyE, [0.0, 1.0, 0.0]),
    (KeyCode::KeyQ, [0.0, -1.0, 0.0]),
    (KeyCode::KeyW, [0.0, 0.0, 1.0]),
    (KeyCode::KeyS, [0.0, 0.0, -1.0]),
];

/// Digits, which name cameras.
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

/// Two clicks within this time, no farther apart than so many pixels, are one double click.
const DOUBLE: (Duration, f32) = (Duration::from_millis(400), 5.0);

/// Radii of the scene that the camera flies in a second, and how many times more with Shift.
const SPEED: f64 = 0.4;
const FAST: f64 = 5.0;

/// Pixels of a touchpad that are a step of a wheel.
const STEP: f64 = 40.0;

/// Keys and buttons that are held.
#[derive(Default)]
pub(super) struct Input {
    pointer: Vec2,
    held: Option<MouseButton>,
    clicked: Option<(Instant, Vec2)>,
    keys: HashSet<KeyCode>,
    modifiers: ModifiersState,
}

impl Input {
    /// Whether this is a key that panels would take for themselves, which is ours unless a text is being written.
    pub(super) fn is_ours(&self, event: &WindowEvent, panels: &egui::Context) -> bool {
        let WindowEvent::KeyboardInput { event: KeyEvent { physical_key: PhysicalKey::Code(code), .. }, .. } = event
        else {
            return false;
        };
        *code == KeyCode::Tab || (*code == KeyCode::Space && !panels.text_edit_focused())
    }

    /// What an event asks for; `place` is corner and size of the picture [pixels], `taken` says that a panel has used it.
    pub(super) fn take(
        &mut self,
        event: &WindowEvent,
        panels: &egui::Context,
        place: ([u32; 2], [u32; 2]),
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
                Vec::new()
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
                    Some(MouseButton::Left) => vec![Wish::Orbit(by)],
                    Some(MouseButton::Right) => vec![Wish::Look(by)],
                    Some(MouseButton::Middle) => vec![Wish::Pan(by)],
                    _ => Vec::new(),
                }
            }
            WindowEvent::MouseInput { state: ElementState::Released, button, .. } => {
                self.held = self.held.filter(|held| held != button);
                Vec::new()
            }
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. }
                if self.over_picture(panels, place) =>
            {
                if *button == MouseButton::Left && self.modifiers.control_key() {
                    return vec![Wish::Pick(self.place_of(place))];
                }
                self.held = Some(*button);
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
            KeyCode::F1 => Some(Wish::Keys),
            KeyCode::F12 if self.modifiers.shift_key() => Some(Wish::SaveLayers),
            KeyCode::F12 => Some(Wish::Save),
            KeyCode::Space if !control => Some(Wish::Reference),
            KeyCode::KeyP if self.modifiers.shift_key() => Some(Wish::Video(super::video::FPS)),
            KeyCode::KeyP if !control => Some(Wish::Play),
            _ => digit.map(|index| if control { Wish::Keep(index) } else { Wish::Recall(index) }),
        }
    }

    /// Whether the pointer is on the picture, with no panel between.
    fn over_picture(&self, panels: &egui::Context, ([left, top], [width, height]): ([u32; 2], [u32; 2])) -> bool {
        let inside = |at: f32, first: u32, count: u32| at >= first as f32 && at < (first + count) as f32;
        let at = self.pointer / panels.pixels_per_point();
        let layer = panels.layer_id_at(egui::pos2(at.x, at.y));
        inside(self.pointer.x, left, width)
            && inside(self.pointer.y, top, height)
            && layer.is_none_or(|layer| layer.order == egui::Order::Background)
    }

    /// Where the pointer is in the picture, from 0 at its top left to 1.
    fn place_of(&self, (corner, size): ([u32; 2], [u32; 2])) -> [f32; 2] {
        [0, 1].map(|i| (self.pointer[i] - corner[i] as f32) / size[i] as f32)
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

    /// Whether a key is held that moves the camera.
    pub(super) fn flies(&self) -> bool {
        FLIGHT.iter().any(|(code, _)| self.keys.contains(code))
    }

    /// Moves the camera as the keys say, for so many seconds.
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
