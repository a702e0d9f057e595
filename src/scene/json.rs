//! The JSON part of glTF, read field by field. Each access checks type and range, and errors name the place in the
//! file.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use crate::{Error, Result};

/// A glTF file's JSON, and the file name as the user gave it.
pub(super) struct Document {
    /// The file as the user named it.
    pub file: PathBuf,
    /// The root object.
    pub root: Map<String, Value>,
}

/// A JSON object in a document.
#[derive(Clone)]
pub(super) struct Object<'a> {
    file: &'a Path,
    /// Its place in glTF's terms: "accessor 3", "material 2 'Wall': normalTexture".
    pub place: String,
    map: &'a Map<String, Value>,
}

/// The top-level lists, and the noun for one of their members.
const LISTS: [(&str, &str); 13] = [
    ("accessors", "accessor"),
    ("animations", "animation"),
    ("buffers", "buffer"),
    ("bufferViews", "buffer view"),
    ("cameras", "camera"),
    ("images", "image"),
    ("materials", "material"),
    ("meshes", "mesh"),
    ("nodes", "node"),
    ("samplers", "sampler"),
    ("scenes", "scene"),
    ("skins", "skin"),
    ("textures", "texture"),
];

/// Text from the file, made safe for a one-line message.
pub(super) fn printable(text: &str) -> String {
    let mut line: String = text.chars().take(80).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().nth(80).is_some() {
        line.push_str("...");
    }
    line
}

/// "3 nodes", "1 node".
pub(super) fn plural(count: usize, noun: &str) -> String {
    match (count, noun) {
        (1, _) => format!("1 {noun}"),
        (_, "mesh") => format!("{count} meshes"),
        _ => format!("{count} {noun}s"),
    }
}

/// An input error at a place in the file.
pub(super) fn error_at(file: &Path, place: &str, reason: impl Into<String>) -> Error {
    Error::Input { file: file.to_owned(), place: place.into(), reason: reason.into() }
}

impl Document {
    /// The root as an object.
    pub(super) fn object(&self) -> Object<'_> {
        Object { file: &self.file, place: "file".into(), map: &self.root }
    }

    /// Number of members of a top-level list.
    pub(super) fn count(&self, list: &str) -> usize {
        self.root.get(list).and_then(Value::as_array).map_or(0, Vec::len)
    }

    /// A member of a top-level list; `from` is the object that refers to it.
    pub(super) fn item<'a>(&'a self, list: &str, index: usize, from: &Object) -> Result<Object<'a>> {
        let noun = LISTS.iter().find(|(name, _)| *name == list).map_or(list, |(_, noun)| noun);
        let place = format!("{noun} {index}");
        match self.root.get(list).and_then(Value::as_array).and_then(|items| items.get(index)) {
            Some(value) => self.named(value, place),
            None => Err(from.error(format!(
                "refers to {place}, but the file has {}: its index is wrong, export the file again",
                plural(self.count(list), noun)
            ))),
        }
    }

    /// All members of a top-level list.
    pub(super) fn items<'a>(&'a self, list: &str) -> Result<Vec<Object<'a>>> {
        (0..self.count(list)).map(|index| self.item(list, index, &self.object())).collect()
    }

    fn named<'a>(&'a self, value: &'a Value, place: String) -> Result<Object<'a>> {
        let mut object = Object::new(&self.file, place, value)?;
        if let Some(Value::String(name)) = object.map.get("name")
            && !name.is_empty()
        {
            object.place = format!("{} '{}'", object.place, printable(name));
        }
        Ok(object)
    }

    /// Fails if a top-level list is not a list: glTF 1.0 has objects there.
    pub(super) fn check_lists(&self) -> Result<()> {
        for (list, _) in LISTS {
            match self.root.get(list) {
                Some(Value::Object(_)) => {
                    return Err(error_at(
                        &self.file,
                        list,
                        "is an object as in glTF 1.0; convert the file to glTF 2.0, for example by importing it to and \
                         exporting it from Blender",
                    ));
                }
                None | Some(Value::Array(_)) => {}
                Some(_) => return Err(error_at(&self.file, list, "is not a list: export the file again")),
            }
        }
        Ok(())
    }
}

impl<'a> Object<'a> {
    fn new(file: &'a Path, place: String, value: &'a Value) -> Result<Self> {
        match value {
            Value::Object(map) => Ok(Self { file, place, map }),
            _ => Err(error_at(file, &place, "is not a JSON object: export the file again")),
        }
    }

    /// An input error at this object.
    pub(super) fn error(&self, reason: impl Into<String>) -> Error {
        error_at(self.file, &self.place, reason)
    }

    /// An input error at one of this object's fields.
    fn field_error(&self, key: &str, reason: &str) -> Error {
        error_at(self.file, &format!("{}: {key}", self.place), format!("{reason}: export the file again"))
    }

    /// The names of all fields.
    pub(super) fn keys(&self) -> impl Iterator<Item = &'a str> + use<'a> {
        self.map.keys().map(String::as_str)
    }

    /// A field's value; null counts as absent.
    pub(super) fn value(&self, key: &str) -> Option<&'a Value> {
        self.map.get(key).filter(|value| !value.is_null())
    }

    /// The object's name without control characters; `otherwise` if it has none.
    pub(super) fn name(&self, otherwise: impl FnOnce() -> String) -> String {
        match self.map.get("name") {
            Some(Value::String(name)) if !name.is_empty() => printable(name),
            _ => otherwise(),
        }
    }

    /// A text field.
    pub(super) fn text(&self, key: &str) -> Result<Option<&'a str>> {
        self.value(key).map(|v| v.as_str().ok_or_else(|| self.field_error(key, "is not a string"))).transpose()
    }

    /// A boolean field; false if absent.
    pub(super) fn flag(&self, key: &str) -> Result<bool> {
        self.flag_or(key, false)
    }

    /// A boolean field with a default.
    pub(super) fn flag_or(&self, key: &str, absent: bool) -> Result<bool> {
        let flag = self.value(key).map(|v| v.as_bool().ok_or_else(|| self.field_error(key, "is not true or false")));
        Ok(flag.transpose()?.unwrap_or(absent))
    }

    /// A whole number of at least 0; also accepts "4.0".
    pub(super) fn whole(&self, key: &str) -> Result<Option<u64>> {
        self.value(key)
            .map(|v| whole(v).ok_or_else(|| self.field_error(key, "is not a whole number of at least 0")))
            .transpose()
    }

    /// A required whole number.
    pub(super) fn needed_whole(&self, key: &str) -> Result<u64> {
        self.whole(key)?.ok_or_else(|| self.error(format!("has no {key}: export the file again")))
    }

    /// An index into one of the file's lists.
    pub(super) fn index(&self, key: &str) -> Result<Option<usize>> {
        Ok(self.whole(key)?.map(|index| usize::try_from(index).unwrap_or(usize::MAX)))
    }

    /// A list of indices; empty if absent.
    pub(super) fn indices(&self, key: &str) -> Result<Vec<usize>> {
        let wrong = || self.field_error(key, "is not a list of indices");
        let Some(value) = self.value(key) else { return Ok(Vec::new()) };
        value
            .as_array()
            .ok_or_else(wrong)?
            .iter()
            .map(|v| whole(v).and_then(|index| usize::try_from(index).ok()).ok_or_else(wrong))
            .collect()
    }

    /// A number that fits an f32; JSON has no NaN.
    pub(super) fn number(&self, key: &str) -> Result<Option<f64>> {
        self.value(key).map(|v| finite(v).ok_or_else(|| self.field_error(key, "is not a finite number"))).transpose()
    }

    /// A list of numbers of any length.
    pub(super) fn numbers(&self, key: &str) -> Result<Option<Vec<f64>>> {
        let wrong = || self.field_error(key, "is not a list of finite numbers");
        let Some(value) = self.value(key) else { return Ok(None) };
        value.as_array().ok_or_else(wrong)?.iter().map(|v| finite(v).ok_or_else(wrong)).collect::<Result<_>>().map(Some)
    }

    /// A list of exactly N numbers.
    pub(super) fn vector<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>> {
        let Some(list) = self.numbers(key)? else { return Ok(None) };
        <[f64; N]>::try_from(list).map(Some).map_err(|list| {
            self.field_error(key, &format!("has {} where {N} are needed", plural(list.len(), "number")))
        })
    }

    /// An object inside this one.
    pub(super) fn object(&self, key: &str) -> Result<Option<Object<'a>>> {
        self.value(key).map(|v| Object::new(self.file, format!("{}: {key}", self.place), v)).transpose()
    }

    /// A list of objects inside this one, each named by `noun` and its number; empty if absent.
    pub(super) fn objects(&self, key: &str, noun: &str) -> Result<Vec<Object<'a>>> {
        let Some(value) = self.value(key) else { return Ok(Vec::new()) };
        let list = value.as_array().ok_or_else(|| self.field_error(key, "is not a list"))?;
        list.iter().enumerate().map(|(i, v)| Object::new(self.file, format!("{}: {noun} {i}", self.place), v)).collect()
    }

    /// An extension's object.
    pub(super) fn extension(&self, name: &str) -> Result<Option<Object<'a>>> {
        match self.object("extensions")? {
            Some(extensions) => extensions.object(name),
            None => Ok(None),
        }
    }

    /// A list of strings; empty if absent.
    pub(super) fn texts(&self, key: &str) -> Result<Vec<&'a str>> {
        let wrong = || self.field_error(key, "is not a list of strings");
        let Some(value) = self.value(key) else { return Ok(Vec::new()) };
        value.as_array().ok_or_else(wrong)?.iter().map(|v| v.as_str().ok_or_else(wrong)).collect()
    }
}

fn whole(value: &Value) -> Option<u64> {
    // Above 2^53 a double cannot represent every whole number.
    let from_float = |x: f64| (x >= 0.0 && x.fract() == 0.0 && x < 9.0e15).then_some(x as u64);
    value.as_u64().or_else(|| value.as_f64().and_then(from_float))
}

fn finite(value: &Value) -> Option<f64> {
    value.as_f64().filter(|x| x.abs() <= f64::from(f32::MAX))
}
