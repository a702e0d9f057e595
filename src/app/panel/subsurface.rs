//! The medium below a surface, in the materials panel.

use super::{choose, is_edited, row};
use egui::{DragValue, Ui};
use glam::Vec3;
use lightskin::scene::Material;
use lightskin::scene::medium::Subsurface;

/// The medium of a material, by its index, while a button is held. The scene is uploaded again when the button is
/// released.
#[derive(Default)]
pub(super) struct Edited(Option<(usize, Subsurface)>);

/// Mean free path of a medium that is switched on with the surface's own colour [m].
const PATH: f32 = 2e-3;

/// What is below a surface.
#[derive(Clone, Copy, PartialEq)]
enum Below {
    /// Nothing: light is reflected at the surface.
    Nothing,
    /// A medium of a colour, or one with coefficients of its own.
    Own,
    /// A preset.
    Preset(&'static str),
}

impl Below {
    fn of(inside: Option<Subsurface>) -> Self {
        inside.map_or(Self::Nothing, |inside| inside.name().map_or(Self::Own, Self::Preset))
    }
}

/// Colour of a thick, flat body, and mean free paths [m] without the scale.
fn color_and_path(inside: Subsurface) -> [Vec3; 2] {
    let medium = Subsurface { scale: 1.0, ..inside }.medium();
    [medium.diffuse_albedo().as_vec3(), medium.extinction.recip().as_vec3()]
}

/// Adds the controls of a material to a grid. `of_file` is the material as the file has it. Returns whether the material
/// has changed.
pub(super) fn show(
    ui: &mut Ui,
    (index, material): (usize, &mut Material),
    of_file: &Material,
    edited: &mut Edited,
) -> bool {
    let held = edited.0.filter(|(of, _)| *of == index).map(|(_, inside)| inside);
    let now = held.or(material.subsurface);
    let mut wanted = now;
    let before = Below::of(now);
    let mut below = before;
    let mut all = vec![(Below::Nothing, "off")];
    if !matches!(before, Below::Preset(_)) {
        all.push((Below::Own, "own colour"));
    }
    let names = Subsurface::presets().filter(|name| Subsurface::preset(name).and_then(|own| own.name()) == Some(*name));
    all.extend(names.map(|name| (Below::Preset(name), name)));
    let transparent = material.is_seen_through();
    let of_glass = if transparent { " It is not available: this material is transparent." } else { "" };
    let help = format!(
        "Light that enters the surface, scatters below it and leaves it elsewhere, as in marble, milk or skin. Presets are \
         measured, except wax and jade. The same medium looks more opaque in a larger body. It replaces base colour and \
         texture; without it, those of the file return. With a medium, all caches are lit, also those that no visible \
         surface needs. After a change, the whole scene is uploaded again.{of_glass}"
    );
    row(ui, "Subsurface", &help, |ui| {
        ui.add_enabled_ui(!transparent, |ui| choose(ui, "subsurface", &mut below, &all)).inner
    });
    if below != before {
        let ior = if material.ior >= 1.0 { material.ior.min(4.0) } else { 1.5 };
        let scale = now.map_or(1.0, |inside| inside.scale);
        wanted = match below {
            Below::Nothing => None,
            Below::Own => Some(Subsurface::of_color(material.base_color.truncate(), Vec3::splat(PATH), ior)),
            Below::Preset(name) => Subsurface::preset(name).map(|preset| Subsurface { scale, ..preset }),
        };
    } else if let Some(inside) = &mut wanted {
        controls(ui, inside);
    }
    if ui.input(|input| input.pointer.any_down()) {
        edited.0 = wanted.map(|inside| (index, inside)).filter(|_| wanted != material.subsurface);
        return false;
    }
    edited.0 = None;
    if wanted == material.subsurface {
        return false;
    }
    match wanted {
        Some(inside) => material.fill(inside),
        None => empty(material, of_file),
    }
    true
}

/// A number that changes in proportion to its size.
fn drag(value: &mut f32) -> DragValue<'_> {
    let speed = 0.01 * f64::from(*value).max(1e-3);
    DragValue::new(value).speed(speed).range(1e-3..=1e5).max_decimals(3).update_while_editing(false)
}

/// Adds the controls of a medium.
fn controls(ui: &mut Ui, inside: &mut Subsurface) {
    let [mut color, mut path] = color_and_path(*inside);
    let (mut rgb, mut millimetres, mut scale) = (color.to_array(), (1e3 * path).to_array(), inside.scale);
    let help = "Colour of a thick piece: the share of the light that enters it and leaves it again, linear.";
    let recolored = row(ui, "  Colour", help, |ui| ui.color_edit_button_rgb(&mut rgb)).changed();
    let help = "Mean free path of red, green and blue light in the medium: how far light travels between two scatterings. \
                Longer paths make a body more translucent. They do not change the cost of a frame.";
    let paths = row(ui, "  Mean free path", help, |ui| {
        let paths = ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            let all = millimetres.each_mut().map(|path| ui.add(drag(path)));
            ui.label("mm");
            all.into_iter().reduce(|all, one| all.union(one))
        });
        paths.inner.unwrap_or(paths.response)
    });
    let stretched = is_edited(&paths);
    if recolored || stretched {
        color = if recolored { rgb.into() } else { color };
        path = if stretched { 1e-3 * Vec3::from(millimetres) } else { path };
        *inside = Subsurface { scale, ..Subsurface::of_color(color, path, inside.ior) };
    }
    let help = "Factor on all mean free paths. 10 makes the body look a tenth of its size. It does not change the cost of a \
                frame.";
    if is_edited(&row(ui, "  Scale", help, |ui| ui.add(drag(&mut scale)))) {
        inside.scale = scale;
    }
}

/// Takes the medium out of a body. If the file has none, colour and texture are those of the file again.
fn empty(material: &mut Material, of_file: &Material) {
    material.subsurface = None;
    if of_file.subsurface.is_none() {
        (material.base_color, material.metallic) = (of_file.base_color, of_file.metallic);
        material.base_color_texture = of_file.base_color_texture;
    }
}
