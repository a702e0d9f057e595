//! Sessions: JSON files that store a scene with its edited light, camera and display settings. The window writes them,
//! `render` draws them. Missing members take their defaults.

use super::lights::Lights;
use anyhow::{Context, Result, anyhow, bail};
use clap::ArgMatches;
use clap::parser::ValueSource;
use glam::{Vec3, Vec4};
use lightskin::files;
use lightskin::scene::Scene;
use lightskin::scene::medium::Subsurface;
use serde_json::{Map, Value};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Version of the format.
pub(crate) const SCHEMA: u64 = 1;

/// Flags of a command line, and flags of a session that they replace although `render` would prefer those.
const INSTEAD: [(&str, &str); 4] = [("sky", "sky_color"), ("caches", "spacing"), ("frames", "time"), ("play", "time")];

/// The moment of an animation.
pub(crate) struct Moment {
    /// Index of the animation. `None` for a scene at rest.
    pub(crate) animation: Option<usize>,
    /// Time within the animation [s].
    pub(crate) time: f64,
    /// Playback speed, 1 for real time.
    pub(crate) speed: f64,
}

/// The contents of a session file.
pub(crate) struct Session {
    /// The scene, and flags of `view` to load it.
    pub(crate) arguments: Vec<String>,
    /// Flags of `render` that draw it.
    pub(crate) settings: Vec<String>,
    /// Value of `--camera`.
    pub(crate) camera: Option<String>,
    /// Values of `--camera` of the stored cameras.
    pub(crate) bookmarks: Vec<Option<String>>,
    /// Exposure value. `None` if it is metered.
    pub(crate) exposure: Option<f32>,
    pub(crate) moment: Option<Moment>,
    lights: Vec<Value>,
    materials: Map<String, Value>,
    hidden: Vec<String>,
}

/// Whether the ending of a file's name is that of a session.
pub(crate) fn is_session(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"))
}

/// A number that is finite in single precision.
pub(super) fn number(value: &Value) -> Option<f32> {
    value.as_f64().map(|v| v as f32).filter(|v| v.is_finite())
}

pub(super) fn numbers<const N: usize>(value: &Value) -> Option<[f32; N]> {
    let all: Option<Vec<f32>> = value.as_array()?.iter().map(|v| number(v).filter(|v| *v >= 0.0)).collect();
    all?.try_into().ok()
}

/// A medium below a surface. `None` if it is missing or impossible.
fn subsurface(value: &Value) -> Option<Subsurface> {
    let [sigma_s, sigma_a] = [numbers(&value["sigma_s"])?, numbers(&value["sigma_a"])?].map(Vec3::from_array);
    let within = |key: &str, least: f32, most: f32| number(&value[key]).filter(|v| (least..=most).contains(v));
    let (g, ior, scale) = (within("g", -0.99, 0.99)?, within("ior", 1.0, 4.0)?, within("scale", 1e-6, 1e6)?);
    let is_possible = (sigma_s + sigma_a).min_element() > 0.0 && sigma_s.max(sigma_a).max_element() <= 1e9;
    is_possible.then_some(Subsurface { sigma_s, sigma_a, g, ior, scale })
}

/// A list of strings. Empty if it is missing.
fn strings(json: &Value, name: &str) -> Result<Vec<String>> {
    if json[name].is_null() {
        return Ok(Vec::new());
    }
    let list = json[name].as_array().with_context(|| format!("{name}: needs a list of strings"))?;
    let string = |value: &Value| value.as_str().map(str::to_owned);
    list.iter().map(string).collect::<Option<_>>().with_context(|| format!("{name}: needs a list of strings"))
}

impl Session {
    /// Reads a session.
    ///
    /// # Errors
    /// Fails if the file is not a session of this format.
    pub(crate) fn read(path: &Path) -> Result<Self> {
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
        let text = |value: &Value| value.as_str().map(str::to_owned);
        let animation = &json["animation"];
        let moment = animation.as_object().map(|_| Moment {
            animation: animation["clip"].as_u64().map(|clip| clip as usize),
            time: animation["time"].as_f64().filter(|time| time.is_finite()).unwrap_or(0.0),
            speed: f64::from(number(&animation["speed"]).unwrap_or(1.0)).clamp(0.01, 100.0),
        });
        Ok(Self {
            arguments: strings(&json, "arguments")?,
            settings: strings(&json, "settings")?,
            camera: text(&json["camera"]),
            bookmarks: json["bookmarks"].as_array().into_iter().flatten().map(text).collect(),
            exposure: number(&json["exposure"]).map(|ev| ev.clamp(-100.0, 100.0)),
            moment,
            lights: json["lights"].as_array().cloned().unwrap_or_default(),
            materials: json["materials"].as_object().cloned().unwrap_or_default(),
            hidden: strings(&json, "hidden")?,
        })
    }

    /// Whether the session has edited a material of this name.
    pub(crate) fn has_edited(&self, material: &str) -> bool {
        self.materials.contains_key(material)
    }

    /// Applies visibility, materials and lights to a scene that was just loaded. Returns its editable lights.
    pub(crate) fn change(&self, scene: &mut Scene) -> Lights {
        for instance in &mut scene.instances {
            instance.hidden = self.hidden.contains(&instance.name);
        }
        for material in &mut scene.materials {
            let Some(told) = self.materials.get(&material.name) else { continue };
            let color = numbers(&told["base_color"]).map(|color| Vec4::from_array(color).min(Vec4::splat(1e3)));
            let emissive = numbers(&told["emissive"]).map(|color| Vec3::from_array(color).min(Vec3::splat(1e9)));
            let share = |value: &Value| number(value).map(|v| v.clamp(0.0, 1.0));
            let [roughness, metallic, specular] = ["roughness", "metallic", "specular"].map(|key| share(&told[key]));
            let reflected = numbers(&told["specular_color"]).map(|color| Vec3::from_array(color).min(Vec3::splat(1e3)));
            let inside = subsurface(&told["subsurface"]);
            for (key, is_read) in [
                ("base_color", color.is_some()),
                ("emissive", emissive.is_some()),
                ("roughness", roughness.is_some()),
                ("metallic", metallic.is_some()),
                ("specular", specular.is_some()),
                ("specular_color", reflected.is_some()),
                ("subsurface", inside.is_some()),
            ] {
                if !is_read && !told[key].is_null() {
                    let name = &material.name;
                    log::warn!(
                        "materials.{name}.{key}: not a possible value; the scene's is kept. Save the session again"
                    );
                }
            }
            material.base_color = color.unwrap_or(material.base_color);
            material.emissive = emissive.unwrap_or(material.emissive);
            material.roughness = roughness.unwrap_or(material.roughness);
            material.metallic = metallic.unwrap_or(material.metallic);
            material.specular = specular.unwrap_or(material.specular);
            material.specular_color = reflected.unwrap_or(material.specular_color);
            match (inside, told.get("subsurface")) {
                (Some(inside), _) => material.fill(inside),
                (None, Some(Value::Null)) => material.subsurface = None,
                (None, _) => {}
            }
        }
        let mut lights = Lights::of(scene);
        lights.take(&self.lights);
        lights.apply(scene);
        lights
    }

    /// The grammar for these arguments of `render` with the values of the session as defaults, and the session's scene.
    ///
    /// # Errors
    /// Fails if the session has flags that `render` does not know.
    pub(super) fn grammar(&self, arguments: &[OsString]) -> Result<(clap::Command, Option<PathBuf>)> {
        let grammar = super::grammar();
        let given = grammar.clone().try_get_matches_from(arguments)?;
        let is_given = |matches: Option<&ArgMatches>, id: &str| {
            matches.is_some_and(|matches| matches.value_source(id) == Some(ValueSource::CommandLine))
        };
        let mut words = ["lightskin", "render"].map(str::to_owned).to_vec();
        words.extend(self.arguments.iter().chain(&self.settings).cloned());
        let mut flag = |name: &str, value: Option<String>| {
            words.extend(value.into_iter().flat_map(|value| [name.to_owned(), value]));
        };
        flag("--camera", self.camera.clone());
        flag("--ev", self.exposure.map(|ev| ev.to_string()));
        let moment = self.moment.as_ref().and_then(|moment| Some((moment.animation?, moment.time)));
        flag("--animation", moment.map(|(animation, _)| animation.to_string()));
        flag("--time", moment.map(|(_, time)| time.to_string()));
        // Quality and similar flags may appear in both lists.
        let known = grammar.clone().mut_subcommand("render", |render| render.args_override_self(true));
        let told = known.try_get_matches_from(words).map_err(|error| {
            let said = error.to_string();
            anyhow!("{}", said.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned())
        })?;
        let [told, given] = [&told, &given].map(|matches| matches.subcommand_matches("render"));
        let scene = told.and_then(|told| told.get_one::<PathBuf>("scene").cloned());
        let grammar = grammar.mut_subcommand("render", |command| {
            command.mut_args(|arg| {
                let id = arg.get_id().as_str().to_owned();
                let replaced = INSTEAD.iter().any(|(flag, other)| *other == id && is_given(given, flag));
                if arg.is_positional() || replaced || !is_given(told, &id) {
                    return arg;
                }
                let values = told.and_then(|told| told.get_raw(&id)).into_iter().flatten();
                arg.default_values(values.map(ToOwned::to_owned).collect::<Vec<_>>())
            })
        });
        Ok((grammar, scene))
    }
}
