//! Animations: reads and checks samplers, and channels with their targets as indices of the file.

use std::collections::BTreeSet;

use super::Notes;
use super::pointer;
use crate::Result;
use crate::scene::accessor::{Accessors, Semantic};
use crate::scene::animation::{Interpolation, Quantity, Sampler};
use crate::scene::json::{Document, Object, plural, printable};

/// Limit on the numbers of all samplers together (512 MiB). Samplers may share accessors, so a small file could request
/// more memory than there is.
const MAX_NUMBERS: usize = 1 << 27;

/// Tolerance of the length of rotations, since they may be rounded to bytes.
const UNIT: f32 = 0.01;

/// An animation of the file.
pub(super) struct Played {
    pub name: String,
    pub tracks: Vec<Track>,
}

/// A channel of an animation.
pub(super) struct Track {
    pub sampler: Sampler,
    pub aim: Aim,
}

/// Target of a channel, by indices of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Aim {
    /// Translation of a node.
    Translation(usize),
    /// Rotation of a node.
    Rotation(usize),
    /// Scale of a node.
    Scale(usize),
    /// All morph weights of a node, or one of them.
    Weights(usize, Option<usize>),
    /// All weights of a mesh, or one of them; applies to nodes without weights of their own.
    MeshWeights(usize, Option<usize>),
    /// Visibility of a node.
    Visible(usize),
    /// A part of a light's property.
    Light(usize, Quantity, usize),
    /// A camera's property.
    Camera(usize, Quantity),
    /// A part of a material's property.
    Material(usize, Quantity, usize),
}

/// Form of a channel's values.
#[derive(Clone, Copy)]
pub(super) struct Form {
    pub semantic: Semantic,
    /// Numbers per value.
    pub width: usize,
}

/// Reads all animations. Channels with unknown targets are left out with a note.
pub(super) fn read(document: &Document, accessors: &Accessors, notes: &mut Notes) -> Result<Vec<Played>> {
    let mut reader = Reader { document, accessors, numbers: 0 };
    document.items("animations")?.iter().enumerate().map(|(index, a)| reader.animation(index, a, notes)).collect()
}

/// Number of morph targets of a mesh, from its first primitive; all primitives should have the same.
pub(super) fn target_count(mesh: &Object) -> Result<usize> {
    let first = mesh.objects("primitives", "primitive")?.into_iter().next();
    Ok(first.map(|first| first.objects("targets", "morph target")).transpose()?.map_or(0, |targets| targets.len()))
}

struct Reader<'a> {
    document: &'a Document,
    accessors: &'a Accessors<'a>,
    /// Numbers read so far.
    numbers: usize,
}

impl Reader<'_> {
    fn animation(&mut self, index: usize, object: &Object, notes: &mut Notes) -> Result<Played> {
        let samplers = object.objects("samplers", "sampler")?;
        let channels = object.objects("channels", "channel")?;
        for (list, what) in [(&samplers, "samplers"), (&channels, "channels")] {
            if list.is_empty() {
                return Err(object.error(format!("has no {what}: export the file again")));
            }
        }
        for sampler in &samplers {
            for key in ["input", "output"] {
                self.document.item("accessors", needed(sampler, key)?, sampler)?;
            }
            interpolation(sampler)?;
        }
        let mut tracks = Vec::new();
        let mut set = BTreeSet::new();
        for channel in &channels {
            let sampler = needed(channel, "sampler")?;
            let sampler = samplers.get(sampler).ok_or_else(|| {
                channel.error(format!(
                    "refers to sampler {sampler}, but the animation has {}: its index is wrong, export the file again",
                    plural(samplers.len(), "sampler")
                ))
            })?;
            let Some((aim, form)) = self.aim(channel, notes)? else { continue };
            if overlaps(&set, aim) {
                return Err(channel.error("sets the same target as another channel: export the file again"));
            }
            set.insert(aim);
            let sampler = self.sampler(sampler, channel, aim, form)?;
            tracks.push(Track { sampler, aim });
        }
        Ok(Played { name: object.name(|| format!("animation {index}")), tracks })
    }

    /// Target of a channel; `None` if it is not supported.
    fn aim(&self, channel: &Object, notes: &mut Notes) -> Result<Option<(Aim, Form)>> {
        let target = channel.object("target")?.ok_or_else(|| channel.error("has no target: export the file again"))?;
        let path = target.text("path")?.ok_or_else(|| target.error("has no path: export the file again"))?;
        if let Some(extension) = target.extension("KHR_animation_pointer")? {
            let pointer =
                extension.text("pointer")?.ok_or_else(|| extension.error("has no pointer: export the file again"))?;
            let found = pointer::aim(self.document, pointer, &extension)?;
            if found.is_none() {
                notes.add(format!(
                    "{}: animates {}, which is not supported; it stays at rest.",
                    channel.place,
                    printable(pointer)
                ));
            }
            return Ok(found);
        }
        let Some(node) = target.index("node")? else {
            notes.count("Animation channels without a node left out", 1);
            return Ok(None);
        };
        let found = node_aim(self.document, node, path, None, &target)?;
        if found.is_none() {
            notes.add(format!("{}: its path {} is unknown, the channel is left out.", channel.place, printable(path)));
        }
        Ok(found)
    }

    fn sampler(&mut self, object: &Object, channel: &Object, aim: Aim, form: Form) -> Result<Sampler> {
        let interpolation = interpolation(object)?;
        if form.semantic == Semantic::Flag && interpolation != Interpolation::Step {
            return Err(object.error("animates a boolean, which needs STEP interpolation: export the file again"));
        }
        let role = |key: &str| format!("{key} of {}", channel.place);
        let (input, output) = (needed(object, "input")?, needed(object, "output")?);
        self.check_input(input, object)?;
        for accessor in [input, output] {
            self.check_stride(accessor, object)?;
        }
        let keys = self.accessors.open(input, &role("input"), Semantic::Times, object)?;
        let values = self.accessors.open(output, &role("output"), form.semantic, object)?;
        // Weights are single numbers, `width` of which form a value.
        let per_value = form.width / values.width;
        let parts = if interpolation == Interpolation::Cubic { 3 } else { 1 };
        if interpolation == Interpolation::Cubic && keys.count < 2 {
            return Err(keys.error("has 1 element, but CUBICSPLINE needs 2: export the file again"));
        }
        let wanted = keys.count.saturating_mul(parts * per_value);
        if values.count != wanted {
            return Err(values.error(format!(
                "has {}, but {} of {} need {wanted}: export the file again",
                plural(values.count, "element"),
                plural(keys.count, "key"),
                object.place
            )));
        }
        self.numbers = self.numbers.saturating_add(keys.count).saturating_add(values.count * values.width);
        if self.numbers > MAX_NUMBERS {
            return Err(object.error(format!("the animations have more than {MAX_NUMBERS} numbers; simplify them")));
        }
        let mut times = Vec::with_capacity(keys.count);
        for at in 0..keys.count {
            let [time] = keys.floats::<1>(at);
            if !(time.is_finite() && time >= 0.0) {
                return Err(
                    keys.error(format!("element {at} is {time}, which is no valid time: export the file again"))
                );
            }
            if times.last().is_some_and(|&last| last >= time) {
                return Err(
                    keys.error(format!("element {at} is {time}, but times must increase: export the file again"))
                );
            }
            times.push(time);
        }
        let mut numbers = Vec::with_capacity(values.count * values.width);
        for at in 0..values.count {
            let value = &values.floats::<4>(at)[..values.width];
            if value.iter().any(|x| !x.is_finite()) {
                return Err(values.error(format!("element {at} is not finite: export the file again")));
            }
            let is_value = parts == 1 || at % 3 == 1;
            let length = value.iter().map(|x| x * x).sum::<f32>().sqrt();
            if matches!(aim, Aim::Rotation(_)) && is_value && (length - 1.0).abs() > UNIT {
                return Err(values.error(format!(
                    "element {at} has the length {length}, but rotations have the length 1: export the file again"
                )));
            }
            numbers.extend_from_slice(value);
        }
        Ok(Sampler { times, values: numbers, width: form.width, interpolation })
    }

    /// glTF requires the bounds of times, so that players know an animation's end.
    fn check_input(&self, input: usize, sampler: &Object) -> Result<()> {
        let accessor = self.document.item("accessors", input, sampler)?;
        if accessor.value("min").is_none() || accessor.value("max").is_none() {
            return Err(
                accessor.error(format!("has no min and max, but is input of {}: export the file again", sampler.place))
            );
        }
        Ok(())
    }

    fn check_stride(&self, accessor: usize, sampler: &Object) -> Result<()> {
        let accessor = self.document.item("accessors", accessor, sampler)?;
        let Some(view) = accessor.index("bufferView")? else { return Ok(()) };
        let view = self.document.item("bufferViews", view, &accessor)?;
        if view.value("byteStride").is_some() {
            return Err(view.error("has a byteStride, but holds keys of an animation: export the file again"));
        }
        Ok(())
    }
}

/// Whether a channel's target overlaps with that of an earlier channel.
fn overlaps(set: &BTreeSet<Aim>, aim: Aim) -> bool {
    match aim {
        Aim::Weights(node, None) => set.range(aim..=Aim::Weights(node, Some(usize::MAX))).next().is_some(),
        Aim::Weights(node, Some(_)) => set.contains(&aim) || set.contains(&Aim::Weights(node, None)),
        Aim::MeshWeights(mesh, None) => set.range(aim..=Aim::MeshWeights(mesh, Some(usize::MAX))).next().is_some(),
        Aim::MeshWeights(mesh, Some(_)) => set.contains(&aim) || set.contains(&Aim::MeshWeights(mesh, None)),
        _ => set.contains(&aim),
    }
}

/// Target and form for a node's path, given as a path or by a pointer; with `element`, a single weight.
pub(super) fn node_aim(
    document: &Document,
    node: usize,
    path: &str,
    element: Option<usize>,
    from: &Object,
) -> Result<Option<(Aim, Form)>> {
    let object = document.item("nodes", node, from)?;
    let (aim, semantic, width) = match path {
        "translation" => (Aim::Translation(node), Semantic::Vector, 3),
        "rotation" => (Aim::Rotation(node), Semantic::Rotation, 4),
        "scale" => (Aim::Scale(node), Semantic::Vector, 3),
        "weights" => {
            let mesh = object.index("mesh")?.map(|mesh| document.item("meshes", mesh, &object)).transpose()?;
            let targets = mesh.as_ref().map_or(Ok(0), target_count)?;
            let width = weights(targets, element, || format!("node {node}"), from)?;
            (Aim::Weights(node, element), Semantic::Weight, width)
        }
        _ => return Ok(None),
    };
    if object.value("matrix").is_some() && semantic != Semantic::Weight {
        return Err(from.error(format!("animates node {node}, which has a matrix: export the file again")));
    }
    Ok(Some((aim, Form { semantic, width })))
}

/// Number of weights that a channel sets, for a mesh with this many targets.
pub(super) fn weights(
    targets: usize,
    element: Option<usize>,
    whose: impl Fn() -> String,
    from: &Object,
) -> Result<usize> {
    if targets == 0 || element.is_some_and(|element| element >= targets) {
        let targets = plural(targets, "morph target");
        return Err(from.error(format!("animates weights of {}, which has {targets}: export the file again", whose())));
    }
    Ok(if element.is_some() { 1 } else { targets })
}

fn interpolation(sampler: &Object) -> Result<Interpolation> {
    match sampler.text("interpolation")? {
        None | Some("LINEAR") => Ok(Interpolation::Linear),
        Some("STEP") => Ok(Interpolation::Step),
        Some("CUBICSPLINE") => Ok(Interpolation::Cubic),
        Some(other) => {
            Err(sampler.error(format!("has the unknown interpolation {}: export the file again", printable(other))))
        }
    }
}

fn needed(object: &Object, key: &str) -> Result<usize> {
    object.index(key)?.ok_or_else(|| object.error(format!("has no {key}: export the file again")))
}
