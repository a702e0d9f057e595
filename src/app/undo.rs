//! Undo and redo of edits of lights, materials and visibility.

use super::document::{Document, copy_edits};
use crate::cli::lights::Lamp;
use lightskin::gpu::Gpu;
use lightskin::scene::Material;

/// Maximum number of steps that can be undone.
const MOST: usize = 100;

/// Everything that can be undone.
#[derive(Clone)]
struct Edits {
    lamps: Vec<Lamp>,
    materials: Vec<Material>,
    hidden: Vec<bool>,
}

/// The edits so far. All changes from the press of a button to its release are one step.
#[derive(Default)]
pub(super) struct History {
    past: Vec<Edits>,
    future: Vec<Edits>,
    /// The state before the current step.
    settled: Option<Edits>,
    /// Whether a step has begun.
    open: bool,
}

impl History {
    /// Whether there is a step to undo.
    pub(super) fn can_undo(&self) -> bool {
        !self.past.is_empty()
    }

    /// Notes that something changes.
    pub(super) fn change(&mut self) {
        if !std::mem::replace(&mut self.open, true) {
            self.future.clear();
            self.past.extend(self.settled.take());
            if self.past.len() > MOST {
                self.past.remove(0);
            }
        }
    }
}

impl Document {
    /// Ends the current step. To be called whenever no button is held.
    pub(super) fn settle(&mut self) {
        if self.history.open || self.history.settled.is_none() {
            (self.history.open, self.history.settled) = (false, self.edits());
        }
    }

    fn edits(&self) -> Option<Edits> {
        let scene = self.scene()?;
        let hidden = scene.instances.iter().map(|instance| instance.hidden).collect();
        Some(Edits { lamps: self.lights.lamps.clone(), materials: scene.materials.clone(), hidden })
    }

    /// Undoes the last step, or with `again` redoes the last one that was undone.
    pub(super) fn undo(&mut self, gpu: &Gpu, again: bool) {
        self.settle();
        let Some(now) = self.edits() else { return };
        let (from, to) = match again {
            false => (&mut self.history.past, &mut self.history.future),
            true => (&mut self.history.future, &mut self.history.past),
        };
        let Some(edits) = from.pop() else {
            log::warn!("there is nothing to {}", if again { "redo" } else { "undo" });
            return;
        };
        to.push(now);
        self.lights.lamps.clone_from(&edits.lamps);
        self.lights.chosen = self.lights.chosen.filter(|index| *index < edits.lamps.len());
        let lights = self.lights.clone();
        self.edit(gpu, |scene| {
            lights.apply(scene);
            if scene.materials.len() == edits.materials.len() {
                edits.materials.iter().zip(&mut scene.materials).for_each(|(from, to)| copy_edits(from, to));
            }
            if scene.instances.len() == edits.hidden.len() {
                for (instance, hidden) in scene.instances.iter_mut().zip(&edits.hidden) {
                    instance.moves |= instance.hidden != *hidden;
                    instance.hidden = *hidden;
                }
            }
        });
        self.history.settled = Some(edits);
        self.gizmo.clear();
        // Lights that the user has not placed follow their animation.
        if self.clip.animation.is_some() {
            self.pose(gpu);
        }
    }
}
