//! Sessions of the window: the open document as a file, and back.

use super::camera::{Free, Seen};
use super::document::{Clip, Document};
use crate::cli::lights::Lamp;
use crate::cli::session::{SCHEMA, Session};
use crate::cli::view::View as Args;
use anyhow::{Context, Result};
use lightskin::files;
use lightskin::frame::Exposure;
use lightskin::scene::Scene;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

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
    let lights: Vec<Value> = document.lights.lamps.iter().map(Lamp::written).collect();
    let materials: Map<String, Value> = (document.edited.iter())
        .filter_map(|index| scene.materials.get(*index))
        .map(|m| {
            let subsurface = m.subsurface.map(|inside| {
                json!({ "sigma_s": inside.sigma_s.to_array(), "sigma_a": inside.sigma_a.to_array(), "g": inside.g,
                        "ior": inside.ior, "scale": inside.scale })
            });
            let value = json!({ "base_color": m.base_color.to_array(), "roughness": m.roughness,
                                "metallic": m.metallic, "specular": m.specular,
                                "specular_color": m.specular_color.to_array(), "emissive": m.emissive.to_array(), "subsurface": subsurface });
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
        "lights": lights,
        "materials": materials,
        "hidden": hidden,
    });
    let text = serde_json::to_string_pretty(&session)? + "\n";
    Ok(files::write(path, text.as_bytes())?)
}

/// A session and its file.
pub(super) struct Opened {
    pub(super) file: PathBuf,
    pub(super) session: Session,
}

/// Reads a session: the arguments to load its scene, and the part to apply afterwards. `present` has the properties
/// that a session does not store: device, size, panels.
pub(super) fn load(path: &Path, present: &Args) -> Result<(Args, Opened)> {
    let read = || -> Result<(Args, Opened)> {
        let session = Session::read(path)?;
        let args_of = |words: &[String], place: &str| {
            let args = present.of_session(words);
            args.with_context(|| format!("{place}: correct this, or save the session again"))
        };
        args_of(&session.arguments, "arguments")?;
        let args = args_of(&[&session.arguments[..], &session.settings].concat(), "settings")?;
        Ok((args, Opened { file: path.to_owned(), session }))
    };
    read().with_context(|| path.display().to_string())
}

/// Applies camera, bookmarks, exposure and animation to a document, and marks the edited materials.
pub(super) fn apply(session: &Session, document: &mut Document) {
    let place = |text: &Option<String>| text.as_deref().and_then(seen);
    let camera = place(&session.camera).filter(|seen| is_there(document.scene(), *seen));
    document.seen = camera.unwrap_or(document.seen);
    let bookmark = |index: usize| place(session.bookmarks.get(index)?).filter(|seen| is_there(document.scene(), *seen));
    document.bookmarks = std::array::from_fn(bookmark);
    document.look = document.args.look();
    if let Some(ev) = session.exposure {
        document.look.exposure = Exposure::Ev(ev);
    }
    let clips = document.scene().map_or(0, |scene| scene.animations().count());
    if let Some(moment) = session.moment.as_ref().filter(|m| m.animation.is_none_or(|index| index < clips)) {
        let (animation, time, speed) = (moment.animation, moment.time, moment.speed);
        document.clip = Clip { animation, time, playing: false, speed };
    }
    let materials = document.scene().map_or_else(Vec::new, |scene| scene.materials.clone());
    document.edited = (0..materials.len()).filter(|index| session.has_edited(&materials[*index].name)).collect();
}

fn is_there(scene: Option<&Scene>, seen: Seen) -> bool {
    match seen {
        Seen::OfScene(index) => scene.is_some_and(|scene| index < scene.cameras.len()),
        Seen::Free(free) => free.camera().is_some(),
    }
}
