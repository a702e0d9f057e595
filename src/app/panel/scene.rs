//! The scene panel: the tree of objects, each of which can be hidden.

use crate::app::document::Document;
use egui::collapsing_header::paint_default_icon;
use egui::{Checkbox, ScrollArea, Ui};
use lightskin::gpu::Gpu;
use lightskin::scene::Scene;
use std::collections::BTreeSet;
use std::ops::Range;

/// Indentation of a level of the tree [points].
const INDENT: f32 = 14.0;

/// A line of the tree.
struct Line {
    level: usize,
    /// Index into `Scene::groups`. `None` for a single object.
    group: Option<usize>,
    /// The objects that the line stands for.
    instances: Range<usize>,
}

/// The lines of the tree if only the groups in `open` list what they hold.
fn lines(scene: &Scene, open: &BTreeSet<usize>) -> Vec<Line> {
    let mut lines = Vec::new();
    let mut ends: Vec<usize> = Vec::new();
    let (mut next, mut instance) = (0, 0);
    while instance < scene.instances.len() {
        ends.retain(|end| *end > instance);
        let level = ends.len();
        match scene.groups.get(next).map(|group| group.instances.clone()) {
            // Groups within one that is closed.
            Some(held) if held.start < instance => next += 1,
            Some(held) if held.start == instance => {
                lines.push(Line { level, group: Some(next), instances: held.clone() });
                if open.contains(&next) {
                    ends.push(held.end);
                } else {
                    instance = held.end;
                }
                next += 1;
            }
            _ => {
                lines.push(Line { level, group: None, instances: instance..instance + 1 });
                instance += 1;
            }
        }
    }
    lines
}

pub(super) fn show(ui: &mut Ui, document: &mut Document, open: &mut BTreeSet<usize>, gpu: &Gpu) {
    let Some(scene) = document.scene() else { return };
    let lines = lines(scene, open);
    let (mut toggled, mut turned) = (None, None);
    let height = ui.spacing().interact_size.y;
    ScrollArea::vertical().id_salt("instances").max_height(200.0).auto_shrink([false, true]).show_rows(
        ui,
        height,
        lines.len(),
        |ui, range| {
            for Line { level, group, instances } in &lines[range] {
                ui.horizontal(|ui| {
                    ui.add_space(INDENT * *level as f32);
                    if !scene.groups.is_empty() {
                        let size = egui::Vec2::splat(ui.spacing().icon_width);
                        let icon = ui.allocate_response(size, egui::Sense::click());
                        if let Some(group) = group {
                            let is_open = open.contains(group);
                            paint_default_icon(ui, f32::from(u8::from(is_open)), &icon);
                            let help = if is_open { "Hides the list of its objects." } else { "Lists its objects." };
                            if icon.on_hover_text(help).clicked() {
                                turned = Some(*group);
                            }
                        }
                    }
                    let held = &scene.instances[instances.clone()];
                    let shown = held.iter().filter(|instance| !instance.hidden).count();
                    let mut visible = shown == held.len();
                    let name = group.map_or(&held[0].name, |group| &scene.groups[group].name);
                    let help = "Shows or hides the object, or all of a group. Hidden objects are not drawn and block no \
                                light. Caches stay in place.";
                    let mixed = 0 < shown && shown < held.len();
                    let checkbox = Checkbox::new(&mut visible, name).indeterminate(mixed);
                    if ui.add(checkbox).on_hover_text(help).changed() {
                        toggled = Some((instances.clone(), !visible));
                    }
                });
            }
        },
    );
    if let Some(group) = turned
        && !open.remove(&group)
    {
        open.insert(group);
    }
    if let Some((instances, hidden)) = toggled {
        document.history.change();
        document.edit(gpu, |scene| {
            for instance in &mut scene.instances[instances] {
                instance.moves |= instance.hidden != hidden;
                instance.hidden = hidden;
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightskin::scene::{Group, Instance};

    #[test]
    fn open_groups_list_what_they_hold() {
        let group = |name: &str, instances| Group { name: name.into(), instances };
        let scene = Scene {
            instances: vec![Instance::default(); 7],
            groups: vec![group("house", 1..6), group("room", 1..4), group("table", 2..4)],
            ..Scene::default()
        };
        let told = |open: &[usize]| -> Vec<(usize, Option<usize>, usize)> {
            let lines = lines(&scene, &open.iter().copied().collect());
            lines.iter().map(|line| (line.level, line.group, line.instances.len())).collect()
        };
        let one = |level| (level, None, 1);
        assert_eq!(told(&[1]), [one(0), (0, Some(0), 5), one(0)]);
        assert_eq!(told(&[0, 2]), [one(0), (0, Some(0), 5), (1, Some(1), 3), one(1), one(1), one(0)]);
        let all =
            [one(0), (0, Some(0), 5), (1, Some(1), 3), one(2), (2, Some(2), 2), one(3), one(3), one(1), one(1), one(0)];
        assert_eq!(told(&[0, 1, 2]), all);
    }
}
