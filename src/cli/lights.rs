//! The lights that the window can edit and sessions store: those of the file, and those that the user has added.

use super::session::{number, numbers};
use glam::{DVec3, Vec3};
use lightskin::scene::{Light, LightKind, Scene};
use serde_json::{Value, json};
use std::ops::Range;

/// A light, and what the user has done to it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lamp {
    pub(crate) light: Light,
    /// A light that is off keeps its intensity here.
    pub(crate) on: bool,
    /// Whether the user has moved or aimed it. Then animations no longer move it.
    pub(crate) placed: bool,
    /// The light as the file has it. `None` for a light that the user has added.
    pub(crate) file: Option<Light>,
}

impl Lamp {
    fn of_file(light: &Light) -> Self {
        Self { light: light.clone(), on: true, placed: false, file: Some(light.clone()) }
    }

    /// A light that the user adds.
    fn added(light: Light) -> Self {
        Self { light, on: true, placed: true, file: None }
    }

    /// Whether the user has changed anything of it.
    pub(crate) fn is_edited(&self) -> bool {
        !self.on || self.placed || self.file.as_ref().is_none_or(|file| !same_emission(file, &self.light))
    }

    /// Undoes all changes of a light of the file.
    pub(crate) fn reset(&mut self) {
        if let Some(file) = &self.file {
            *self = Self::of_file(file);
        }
    }
}

/// Whether two lights differ only in place and direction, which animations may change.
fn same_emission(a: &Light, b: &Light) -> bool {
    *a == Light { position: a.position, direction: a.direction, ..b.clone() }
}

/// The editable lights of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lights {
    /// First the lights of the file without those that approximate its sky, then the added ones.
    pub(crate) lamps: Vec<Lamp>,
    /// The light whose handles and values are shown.
    pub(crate) chosen: Option<usize>,
}

/// Indices in `Scene::lights` of the lights that approximate the sky.
fn of_sky(scene: &Scene) -> Range<usize> {
    scene.sky.as_ref().map_or(0..0, |sky| sky.lights.clone())
}

impl Lights {
    /// The lights of a scene as it was loaded.
    pub(crate) fn of(scene: &Scene) -> Self {
        let sky = of_sky(scene);
        let own = scene.lights.iter().enumerate().filter(|(index, _)| !sky.contains(index));
        Self { lamps: own.map(|(_, light)| Lamp::of_file(light)).collect(), chosen: None }
    }

    /// The lights of the file.
    fn own(&self) -> &[Lamp] {
        let added = self.lamps.iter().position(|lamp| lamp.file.is_none());
        &self.lamps[..added.unwrap_or(self.lamps.len())]
    }

    /// The lights that the user has added.
    fn added(&self) -> &[Lamp] {
        &self.lamps[self.own().len()..]
    }

    /// These lights of a scene that was loaded again, with the edits of `before`: changes of lights that are still at
    /// the same index under the same name, and all added lights.
    pub(crate) fn keeping(mut self, before: &Self) -> Self {
        let lights = &mut self;
        for (lamp, old) in lights.lamps.iter_mut().zip(before.own()) {
            if old.is_edited() && old.light.name == lamp.light.name && same_shape(old.light.kind, lamp.light.kind) {
                // The sun of another sky keeps its own place, unless the user has moved the old one.
                let moved = if old.placed { &old.light } else { &lamp.light };
                let (position, direction) = (moved.position, moved.direction);
                let light = Light { position, direction, ..old.light.clone() };
                *lamp = Lamp { light, file: lamp.file.take(), ..*old };
            }
        }
        lights.lamps.extend_from_slice(before.added());
        lights.chosen = before.chosen.filter(|index| *index < lights.lamps.len());
        self
    }

    /// Whether both have the same lights of a file, but for edits.
    pub(crate) fn has_the_file_of(&self, other: &Self) -> bool {
        let names =
            |lights: &Self| -> Vec<String> { lights.own().iter().map(|lamp| lamp.light.name.clone()).collect() };
        names(self) == names(other)
    }

    /// Adds a light and chooses it. Gives it the first free name.
    pub(crate) fn add(&mut self, mut light: Light) {
        let is_free = |name: &str| self.lamps.iter().all(|lamp| lamp.light.name != name);
        let kind = word(light.kind);
        light.name = (1..).map(|n| format!("{kind} {n}")).find(|name| is_free(name)).unwrap_or_default();
        self.chosen = Some(self.lamps.len());
        self.lamps.push(Lamp::added(light));
    }

    /// Removes the chosen light and returns true, if the user has added it. Lights of the file can only be switched off.
    pub(crate) fn remove_chosen(&mut self) -> bool {
        let added = |index: &usize| self.lamps.get(*index).is_some_and(|lamp| lamp.file.is_none());
        let Some(index) = self.chosen.take_if(|index| added(index)) else { return false };
        self.lamps.remove(index);
        true
    }

    /// Takes over the lights of a session: edits of the file's lights in their order, and added lights, which have a
    /// type.
    pub(crate) fn take(&mut self, told: &[Value]) {
        self.lamps.truncate(self.own().len());
        let (added, own): (Vec<_>, Vec<_>) = told.iter().partition(|told| told["type"].is_string());
        for (lamp, told) in self.lamps.iter_mut().zip(own) {
            // Another light may stand at this index of the file by now.
            if told["name"].as_str().is_none_or(|name| name == lamp.light.name) {
                lamp.take(told);
            }
        }
        for told in added {
            let Some((_, kind)) = KINDS.iter().find(|(word, _)| told["type"] == *word) else { continue };
            let mut lamp = Lamp::added(dark(*kind));
            lamp.light.name = told["name"].as_str().unwrap_or_default().to_owned();
            lamp.light.range = number(&told["range"]).filter(|range| *range > 0.0);
            lamp.take(told);
            self.lamps.push(lamp);
        }
    }

    /// Writes the lights to the scene that they belong to.
    pub(crate) fn apply(&self, scene: &mut Scene) {
        scene.lights.truncate(self.own().len() + of_sky(scene).len());
        for (lamp, light) in self.lamps.iter().zip(own(scene)) {
            *light = lamp.shown();
        }
        scene.lights.extend(self.added().iter().map(Lamp::shown));
    }

    /// Takes over where an animation has moved lights. Keeps those in place and dark that the user has placed or switched
    /// off.
    pub(crate) fn follow(&mut self, scene: &mut Scene) {
        for (lamp, light) in self.lamps.iter_mut().zip(own(scene)) {
            if lamp.placed {
                (light.position, light.direction) = (lamp.light.position, lamp.light.direction);
            } else {
                (lamp.light.position, lamp.light.direction) = (light.position, light.direction);
            }
            if !lamp.on {
                light.intensity = 0.0;
            }
        }
    }
}

impl Lamp {
    /// The light as it shines.
    fn shown(&self) -> Light {
        Light { intensity: if self.on { self.light.intensity } else { 0.0 }, ..self.light.clone() }
    }

    /// The light as sessions store it. Members are named like those of glTF's lights, where there are such.
    /// Of a light that the user has not edited only the name, so that it stays as its file has it.
    pub(crate) fn written(&self) -> Value {
        let light = &self.light;
        if !self.is_edited() {
            return json!({ "name": light.name });
        }
        let mut value = json!({ "name": light.name, "on": self.on, "color": light.color.to_array(),
                                "intensity": light.intensity, "radius": light.radius });
        if self.placed {
            value["position"] = json!(light.position.to_array());
            value["direction"] = json!(light.direction.to_array());
        }
        if let LightKind::Spot { inner, outer } = light.kind {
            (value["innerConeAngle"], value["outerConeAngle"]) = (json!(inner), json!(outer));
        }
        if self.file.is_none() {
            value["type"] = json!(word(light.kind));
            value["range"] = json!(light.range);
        }
        value
    }

    /// Takes over what a session has stored of the light. Members that are missing or out of range stay as they are.
    fn take(&mut self, told: &Value) {
        let light = &mut self.light;
        self.on = told["on"].as_bool().unwrap_or(true);
        let color = numbers(&told["color"]).map(Vec3::from_array);
        light.color = color.filter(|color| color.max_element() <= 1e6).unwrap_or(light.color);
        light.intensity = number(&told["intensity"]).filter(|v| (0.0..=1e9).contains(v)).unwrap_or(light.intensity);
        let widest = if light.kind == LightKind::Directional { Light::WIDEST_SUN } else { 1e6 };
        light.radius = number(&told["radius"]).filter(|v| *v >= 0.0).map_or(light.radius, |v| v.min(widest));
        if let LightKind::Spot { inner, outer } = &mut light.kind
            && let (Some(a), Some(b)) = (number(&told["innerConeAngle"]), number(&told["outerConeAngle"]))
            && (0.0..=b).contains(&a)
            && b > 0.0
            && b <= std::f32::consts::FRAC_PI_2
        {
            (*inner, *outer) = (a, b);
        }
        if let (Some(position), Some(direction)) = (vector(&told["position"]), vector(&told["direction"])) {
            light.position = position;
            // A direction that is already of unit length stays as it is, bit for bit.
            let direction = direction.as_vec3();
            let is_unit = direction.is_normalized();
            light.direction = if is_unit { direction } else { direction.normalize_or(light.direction) };
            self.placed = true;
        }
    }
}

/// A vector of numbers up to a billion.
fn vector(value: &Value) -> Option<DVec3> {
    let all: Option<Vec<f64>> = value.as_array()?.iter().map(|v| v.as_f64().filter(|v| v.abs() <= 1e9)).collect();
    all?.try_into().ok().map(DVec3::from_array)
}

/// A white light at the origin without intensity, which shines downwards.
pub(crate) fn dark(kind: LightKind) -> Light {
    let (name, position, direction) = (String::new(), DVec3::ZERO, Vec3::NEG_Y);
    Light { name, kind, color: Vec3::ONE, intensity: 0.0, range: None, radius: 0.0, position, direction }
}

/// The lights of a scene except those that approximate its sky.
fn own(scene: &mut Scene) -> impl Iterator<Item = &mut Light> {
    let sky = of_sky(scene);
    scene.lights.iter_mut().enumerate().filter(move |(index, _)| !sky.contains(index)).map(|(_, light)| light)
}

/// Whether two lights are of one kind, whatever their cones.
fn same_shape(a: LightKind, b: LightKind) -> bool {
    std::mem::discriminant(&a) == std::mem::discriminant(&b)
}

/// Kinds of lights that can be added, and what the window and sessions call them.
pub(crate) const KINDS: [(&str, LightKind); 3] = [
    ("point", LightKind::Point),
    ("spot", LightKind::Spot { inner: 0.3, outer: 0.5 }),
    ("sun", LightKind::Directional),
];

/// What the window and sessions call a light of this kind.
pub(crate) fn word(kind: LightKind) -> &'static str {
    KINDS.iter().find(|(_, one)| same_shape(*one, kind)).map_or("light", |(word, _)| word)
}

/// Azimuth and elevation of a direction [degrees]: counter-clockwise from +Z seen from above, and above the horizon.
pub(crate) fn angles(direction: Vec3) -> [f32; 2] {
    [direction.x.atan2(direction.z).to_degrees(), direction.y.clamp(-1.0, 1.0).asin().to_degrees()]
}

/// The unit direction with these angles [degrees], as `angles` gives them.
pub(crate) fn direction([azimuth, elevation]: [f32; 2]) -> Vec3 {
    let (azimuth, elevation) = (f64::from(azimuth).to_radians(), f64::from(elevation).to_radians());
    let level = elevation.cos();
    DVec3::new(azimuth.sin() * level, elevation.sin(), azimuth.cos() * level).normalize().as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightskin::scene::build::{CornellSurface, cornell};
    use lightskin::scene::sky::Sky;

    fn box_with_sky() -> Scene {
        let mut scene = cornell(CornellSurface::Diffuse, 0.5);
        Sky::even(Vec3::ONE).put_over(&mut scene, 4);
        scene
    }

    fn spot() -> Light {
        let position = DVec3::new(0.1, 1.5, 0.2);
        Light { intensity: 30.0, position, ..dark(LightKind::Spot { inner: 0.1, outer: 0.4 }) }
    }

    #[test]
    fn edits_reach_the_scene_and_nothing_else_changes() {
        let mut scene = box_with_sky();
        let before = scene.lights.clone();
        let mut lights = Lights::of(&scene);
        lights.apply(&mut scene);
        assert_eq!(scene.lights, before, "without edits");
        assert!(lights.lamps.iter().all(|lamp| !lamp.is_edited()));
        assert_eq!(lights.lamps.len() + 4, before.len(), "the sky's lights are not editable");

        lights.add(spot());
        lights.add(spot());
        assert_eq!((lights.lamps[1].light.name.as_str(), lights.lamps[2].light.name.as_str()), ("spot 1", "spot 2"));
        lights.lamps[0].on = false;
        lights.apply(&mut scene);
        assert_eq!(scene.lights.len(), before.len() + 2);
        assert_eq!(scene.lights[0].intensity, 0.0);
        assert_eq!(scene.lights[1..5], before[1..5]);
        assert_eq!(scene.lights[6].intensity, 30.0);
        lights.chosen = Some(1);
        assert!(lights.remove_chosen());
        lights.chosen = Some(0);
        assert!(!lights.remove_chosen(), "a light of the file");
        lights.lamps[0].reset();
        lights.apply(&mut scene);
        assert_eq!(scene.lights[..5], before[..], "a light of the file cannot be removed");
        assert_eq!(scene.lights[5].name, "spot 2");
    }

    #[test]
    fn animations_move_what_the_user_has_not_placed() {
        let mut scene = cornell(CornellSurface::Diffuse, 0.5);
        let mut lights = Lights::of(&scene);
        scene.lights[0].position = DVec3::X;
        lights.follow(&mut scene);
        assert_eq!(lights.lamps[0].light.position, DVec3::X);
        assert!(!lights.lamps[0].is_edited());
        (lights.lamps[0].placed, lights.lamps[0].on) = (true, false);
        (scene.lights[0].position, scene.lights[0].intensity) = (DVec3::Y, 5.0);
        lights.follow(&mut scene);
        assert_eq!((scene.lights[0].position, scene.lights[0].intensity), (DVec3::X, 0.0));
    }

    #[test]
    fn edits_outlive_another_bake_and_another_sky() {
        let mut lights = Lights::of(&cornell(CornellSurface::Diffuse, 0.5));
        let lamp = &mut lights.lamps[0];
        (lamp.light.color, lamp.light.intensity, lamp.light.radius) = (Vec3::new(0.1, 0.2, 0.3), 4.0, 0.5);
        lights.add(spot());
        let mut scene = box_with_sky();
        let kept = Lights::of(&scene).keeping(&lights);
        kept.apply(&mut scene);
        let light = &scene.lights[0];
        assert_eq!((light.color, light.intensity, light.radius), (Vec3::new(0.1, 0.2, 0.3), 4.0, 0.5));
        assert_eq!((scene.lights.len(), scene.lights[5].name.as_str()), (6, "spot 1"));
        assert!(
            kept.lamps[0].file.as_ref().is_some_and(|file| file.intensity != 4.0),
            "a reset gives the file's light"
        );

        // The sun of another sky stands elsewhere. Its brightness stays as edited.
        let mut turned = box_with_sky();
        turned.lights[0].direction = Vec3::X;
        let kept = Lights::of(&turned).keeping(&lights);
        assert_eq!((kept.lamps[0].light.direction, kept.lamps[0].light.intensity), (Vec3::X, 4.0));
        lights.lamps[0].placed = true;
        assert_eq!(Lights::of(&turned).keeping(&lights).lamps[0].light.direction, lights.lamps[0].light.direction);

        let mut other = box_with_sky();
        other.lights[0].name = "another".into();
        assert!(!Lights::of(&other).keeping(&lights).lamps[0].is_edited(), "another light keeps its own values");
    }

    #[test]
    fn sessions_bring_all_edits_back() {
        let mut lights = Lights::of(&cornell(CornellSurface::Diffuse, 0.5));
        lights.add(spot());
        lights.add(Light { kind: LightKind::Directional, range: Some(3.0), ..spot() });
        lights.lamps[0].on = false;
        (lights.lamps[0].light.position, lights.lamps[0].placed) = (DVec3::new(0.1, -2.0, 3e7), true);
        lights.lamps[1].light.kind = LightKind::Spot { inner: 1.2, outer: 1.2 };
        lights.chosen = None;
        let written: Vec<Value> = lights.lamps.iter().map(Lamp::written).collect();
        let text = serde_json::to_string(&written).expect("JSON");
        let mut read = Lights::of(&cornell(CornellSurface::Diffuse, 0.5));
        read.take(&serde_json::from_str::<Vec<Value>>(&text).expect("JSON"));
        assert_eq!(read.lamps, lights.lamps);

        let before = read.lamps.clone();
        let bad = json!([{ "intensity": -1, "color": [1, 2], "position": [0, 1e300, 0], "direction": [0, 0, 1] },
                         { "type": "laser" }, { "type": "spot", "innerConeAngle": 2.0, "outerConeAngle": 1.0 }]);
        read.take(bad.as_array().expect("a list"));
        assert_eq!(read.lamps[0].light, before[0].light, "values out of range change nothing");
        assert_eq!((read.lamps.len(), read.lamps[1].light.kind), (2, LightKind::Spot { inner: 0.3, outer: 0.5 }));
    }

    #[test]
    fn angles_are_those_of_their_direction() {
        for wanted in [[0.0, 0.0], [90.0, -30.0], [-135.0, 60.0], [10.0, 89.0]] {
            let found = angles(direction(wanted));
            assert!((0..2).all(|i| (found[i] - wanted[i]).abs() < 1e-3), "{found:?} for {wanted:?}");
        }
        assert!((direction([90.0, 0.0]) - Vec3::X).length() < 1e-6);
    }
}
