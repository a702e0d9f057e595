//! Sessions: JSON files that store a scene with its light, camera and display settings. Missing members take their
//! defaults.

use super::camera::{Free, Seen};
use super::document::{Clip, Document};
use crate::cli::view::{Drawing, View as Args};
use anyhow::{Context, Result, anyhow, bail};
use glam::{Vec3, Vec4};
use lightskin::files;
use lightskin::frame::{Exposure, Look, Settings};
use lightskin::gpu::Gpu;
use lightskin::scene::{Light, LightKind, Scene};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Version of the format.
const SCHEMA: u64 = 1;

/// The part of a session that is applied after its scene has been loaded.
pub(super) struct Session {
    drawing: Drawing,
    seen: Option<Seen>,
    bookmarks: [Option<Seen>; 9],
    clip: Option<Clip>,
    look: Look,
    lights: Vec<Value>,
    materials: Map<String, Value>,
    hidden: Vec<String>,
}

/// Whether the ending of a file's name is that of a session.
pub(super) fn is_session(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"))
}

fn camera(seen: Seen) -> String {
    match seen {
        Seen::OfScene(index) => index.to_string(),
        Seen::Free(free) => free.argument(),
    }
}

fn seen(text: &str) -> Option<Seen> {
    Free::parse(text).map(Seen::Free).or_else(|| text.parse().ok().map(Seen::OfScene))
}

/// Writes the open document as a session.
pub(super) fn save(document: &Document, path: &Path) -> Result<()> {
    let scene = document.scene().context("there is no scene yet")?;
    let lights = document.lights.iter().map(|(light, on)| {
        json!({ "name": light.name, "on": on, "color": light.color.to_array(), "intensity": light.intensity,
                "radius": light.radius })
    });
    let materials: Map<String, Value> = (document.edited.iter())
        .filter_map(|index| scene.materials.get(*index))
        .map(|m| {
            let value = json!({ "base_color": m.base_color.to_array(), "roughness": m.roughness,
                                "metallic": m.metallic, "emissive": m.emissive.to_array() });
            (m.name.clone(), value)
        })
        .collect();
    let hidden: Vec<&str> = scene.instances.iter().filter(|i| i.hidden).map(|i| i.name.as_str()).collect();
    let kept: Vec<Option<String>> = document.bookmarks.iter().map(|seen| seen.map(camera)).collect();
    let clip = document.clip;
    let exposure = match document.look.exposure {
        Exposure::Automatic => Value::Null,
        Exposure::Ev(ev) => json!(ev),
    };
    let [arguments, settings] = document.args.session_words(&document.look, &document.settings, document.caches);
    let session = json!({
        "lightskin_session": SCHEMA,
        "arguments": arguments,
        "settings": settings,
        "camera": camera(document.seen),
        "bookmarks": kept,
        "exposure": exposure,
        "animation": { "clip": clip.animation, "time": clip.time, "speed": clip.speed },
        "lights": lights.collect::<Vec<_>>(),
        "materials": materials,
        "hidden": hidden,
    });
    let text = serde_json::to_string_pretty(&session)? + "\n";
    Ok(files::write(path, text.as_bytes())?)
}

/// Reads a session: the arguments to load its scene, and the part to apply afterwards. `present` has the properties
/// that a session does not store: device, size, panels.
pub(super) fn load(path: &Path, present: &Args) -> Result<(Args, Session)> {
    let read = || -> Result<(Args, Session)> {
        let bytes = files::read(path).map_err(|reason| anyhow!(reason))?;
        let json: Value = serde_json::from_slice(&bytes).context("file: the JSON is broken; save the session again")?;
        match json["lightskin_session"].as_u64() {
            Some(SCHEMA) => {}
            Some(other) => {
                bail!("file: session format {other} is not supported, only {SCHEMA}; save it again with this lightskin")
            }
            None => bail!(
                "file: not a session of lightskin, it has no `lightskin_session`; use a file that the window has saved"
            ),
        }
        let words = strings(&json, "arguments")?;
        let args = present.of_session(&words).context("arguments: correct this, or save the session again")?;
        let drawing =
            Drawing::new(&strings(&json, "settings")?).context("settings: correct this, or save the session again")?;
        let place = |value: &Value| value.as_str().and_then(seen);
        let mut bookmarks = [None; 9];
        for (kept, value) in bookmarks.iter_mut().zip(json["bookmarks"].as_array().into_iter().flatten()) {
            *kept = place(value);
        }
        let animation = &json["animation"];
        let clip = animation.as_object().map(|_| Clip {
            animation: animation["clip"].as_u64().map(|clip| clip as usize),
            time: number(&animation["time"]).unwrap_or(0.0).into(),
            playing: false,
            speed: f64::from(number(&animation["speed"]).unwrap_or(1.0)).clamp(0.01, 100.0),
        });
        let mut look = args.look();
        if let Some(ev) = number(&json["exposure"]) {
            look.exposure = Exposure::Ev(ev.clamp(-100.0, 100.0));
        }
        let session = Session {
            drawing,
            seen: place(&json["camera"]),
            bookmarks,
            clip,
            look,
            lights: json["lights"].as_array().cloned().unwrap_or_default(),
            materials: json["materials"].as_object().cloned().unwrap_or_default(),
            hidden: if json["hidden"].is_null() { Vec::new() } else { strings(&json, "hidden")? },
        };
        Ok((args, session))
    };
    read().with_context(|| path.display().to_string())
}

/// A number that is finite in single precision.
fn number(value: &Value) -> Option<f32> {
    value.as_f64().map(|v| v as f32).filter(|v| v.is_finite())
}

fn numbers<const N: usize>(value: &Value) -> Option<[f32; N]> {
    let all: Option<Vec<f32>> = value.as_array()?.iter().map(|v| number(v).filter(|v| *v >= 0.0)).collect();
    all?.try_into().ok()
}

fn strings(json: &Value, name: &str) -> Result<Vec<String>> {
    let list = json[name].as_array().with_context(|| format!("{name}: needs a list of strings"))?;
    let string = |value: &Value| value.as_str().map(str::to_owned);
    list.iter().map(string).collect::<Option<_>>().with_context(|| format!("{name}: needs a list of strings"))
}

impl Session {
    /// The settings for this number of caches.
    pub(super) fn settings(&self, gpu: &Gpu, caches: usize) -> Result<Settings> {
        self.drawing.settings(gpu, caches)
    }

    /// Applies camera, bookmarks, exposure, animation and lights to a document, and marks the edited materials.
    pub(super) fn apply(&self, document: &mut Document) {
        document.seen = self.seen.filter(|seen| is_there(document.scene(), *seen)).unwrap_or(document.seen);
        (document.bookmarks, document.look) = (self.bookmarks, self.look);
        let clips = document.scene().map_or(0, |scene| scene.animations().count());
        if let Some(clip) = self.clip.filter(|clip| clip.animation.is_none_or(|index| index < clips)) {
            document.clip = clip;
        }
        for ((light, on), told) in document.lights.iter_mut().zip(&self.lights) {
            *on = told["on"].as_bool().unwrap_or(true);
            take_light(light, told);
        }
        let materials = document.scene().map_or_else(Vec::new, |scene| scene.materials.clone());
        document.edited =
            (0..materials.len()).filter(|index| self.materials.contains_key(&materials[*index].name)).collect();
    }

    /// Applies visibility and materials to the scene itself.
    pub(super) fn change(&self, scene: &mut Scene) {
        for instance in &mut scene.instances {
            instance.hidden = self.hidden.contains(&instance.name);
        }
        for material in &mut scene.materials {
            let Some(told) = self.materials.get(&material.name) else { continue };
            material.base_color = numbers(&told["base_color"]).map_or(material.base_color, Vec4::from_array);
            material.emissive = numbers(&told["emissive"]).map_or(material.emissive, Vec3::from_array);
            let share = |value: &Value| number(value).map(|v| v.clamp(0.0, 1.0));
            material.roughness = share(&told["roughness"]).unwrap_or(material.roughness);
            material.metallic = share(&told["metallic"]).unwrap_or(material.metallic);
        }
    }
}

fn take_light(light: &mut Light, told: &Value) {
    light.color = numbers(&told["color"]).map_or(light.color, Vec3::from_array);
    light.intensity = number(&told["intensity"]).filter(|v| (0.0..=1e9).contains(v)).unwrap_or(light.intensity);
    let widest = if light.kind == LightKind::Directional { Light::WIDEST_SUN } else { 1e6 };
    light.radius = number(&told["radius"]).filter(|v| *v >= 0.0).map_or(light.radius, |v| v.min(widest));
}

fn is_there(scene: Option<&Scene>, seen: Seen) -> bool {
    match seen {
        Seen::OfScene(index) => scene.is_some_and(|scene| index < scene.cameras.len()),
        Seen::Free(free) => free.camera().is_some(),
    }
}
