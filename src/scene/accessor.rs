//! Bounds-checked reading of accessors. Opening an accessor checks everything, in u64 and before any allocation.
//! Elements are then decoded one by one, so that a reader takes only what it needs.

use std::cell::Cell;
use std::collections::BTreeMap;

use super::json::{Document, Object};
use crate::Result;

/// Limit on the total elements of accessors without a buffer view (all zeros), since no file data backs them.
const MAX_ZEROS: u64 = 1 << 24;

/// A buffer's bytes, or the reason why it has none.
pub(super) type Buffer = std::result::Result<Vec<u8>, String>;

/// Data that a file's accessors read.
#[derive(Default)]
pub(super) struct Contents {
    /// The file's buffers.
    pub buffers: Vec<Buffer>,
    /// Decompressed buffer views.
    pub views: BTreeMap<usize, Vec<u8>>,
    /// Decompressed accessors.
    pub accessors: BTreeMap<usize, Decoded>,
}

/// Values of an accessor that was compressed separately; stored without gaps.
pub(super) struct Decoded {
    pub bytes: Vec<u8>,
    pub count: u64,
    pub width: usize,
    pub component: Component,
}

/// A file's accessors over its buffers' bytes.
pub(super) struct Accessors<'a> {
    document: &'a Document,
    contents: &'a Contents,
    zeros: Cell<u64>,
}

/// Use of an accessor; decides which formats are accepted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Semantic {
    /// Vertex indices.
    Indices,
    /// POSITION, also of morph targets.
    Position,
    /// NORMAL.
    Normal,
    /// TANGENT.
    Tangent,
    /// NORMAL and TANGENT of morph targets: three components.
    Displacement,
    /// TEXCOORD_n.
    TexCoord,
    /// COLOR_n.
    Color,
    /// JOINTS_n.
    Joints,
    /// WEIGHTS_n.
    Weights,
    /// inverseBindMatrices.
    Matrices,
    /// Times of an animation's keys.
    Times,
    /// Translations and scales of animations and instances.
    Vector,
    /// Rotations of animations.
    Rotation,
    /// Rotations of instances.
    InstanceRotation,
    /// Weights of morph targets.
    Weight,
    /// Values for a JSON pointer: this many numbers of any component type.
    Numbers(usize),
    /// Values for a JSON pointer: booleans.
    Flag,
}

/// An opened accessor: every element below `count` is known to be inside its buffer.
pub(super) struct Accessor<'a> {
    /// Named "accessor 3 (POSITION of mesh 0 'Wall')".
    object: Object<'a>,
    /// Number of elements.
    pub count: usize,
    /// Components per element.
    pub width: usize,
    component: Component,
    normalized: bool,
    /// Bytes from element 0 onwards, and the stride; `None` for zeros.
    base: Option<(&'a [u8], usize)>,
    /// Elements that replace those of `base`: increasing indices and tightly packed values.
    sparse: Option<(Vec<u32>, &'a [u8])>,
}

/// Component type of elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: u64) -> Option<Self> {
        match code {
            5120 => Some(Self::I8),
            5121 => Some(Self::U8),
            5122 => Some(Self::I16),
            5123 => Some(Self::U16),
            5125 => Some(Self::U32),
            5126 => Some(Self::F32),
            _ => None,
        }
    }

    /// Size \[bytes\].
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

impl Semantic {
    /// Formats of glTF 2.0 and KHR_mesh_quantization.
    fn accepts(self, component: Component, width: usize, normalized: bool) -> bool {
        use Component::{F32, I8, I16, U8, U16, U32};
        let float = component == F32;
        let short = matches!(component, I8 | U8 | I16 | U16);
        let signed = normalized && matches!(component, I8 | I16);
        let fraction = float || normalized && matches!(component, U8 | U16);
        match self {
            Self::Indices => width == 1 && !normalized && matches!(component, U8 | U16 | U32),
            Self::Position => width == 3 && (float || short),
            Self::Normal => width == 3 && (float || signed),
            Self::Tangent => width == 4 && (float || signed),
            Self::Displacement => width == 3 && (float || matches!(component, I8 | I16)),
            Self::TexCoord => width == 2 && (float || short),
            Self::Color => (width == 3 || width == 4) && fraction,
            Self::Joints => width == 4 && !normalized && matches!(component, U8 | U16),
            Self::Weights => width == 4 && fraction,
            Self::Matrices => width == 16 && float,
            Self::Times => width == 1 && float,
            Self::Vector => width == 3 && float,
            Self::Rotation => width == 4 && (float || normalized && short),
            Self::InstanceRotation => width == 4 && (float || signed),
            Self::Weight => width == 1 && (float || normalized && short),
            Self::Numbers(numbers) => width == numbers,
            Self::Flag => width == 1 && !normalized && component == U8,
        }
    }
}

impl<'a> Accessors<'a> {
    /// Accessors of a document whose buffers have been read.
    pub(super) fn new(document: &'a Document, contents: &'a Contents) -> Self {
        Self { document, contents, zeros: Cell::new(0) }
    }

    /// Bytes of a buffer view, and its stride if it has one.
    pub(super) fn view(&self, index: usize, from: &Object) -> Result<(&'a [u8], Option<u64>)> {
        let view = self.document.item("bufferViews", index, from)?;
        let bytes = match self.contents.views.get(&index) {
            Some(unpacked) => unpacked.as_slice(),
            None => self.bytes(&view)?,
        };
        Ok((bytes, view.whole("byteStride")?))
    }

    /// The bytes that an object references in a buffer.
    pub(super) fn bytes(&self, view: &Object) -> Result<&'a [u8]> {
        let buffer_index = view.index("buffer")?.ok_or_else(|| view.error("names no buffer: export the file again"))?;
        let buffer = self.document.item("buffers", buffer_index, view)?;
        let bytes = match self.contents.buffers.get(buffer_index) {
            Some(Ok(bytes)) => bytes.as_slice(),
            Some(Err(reason)) => return Err(buffer.error(reason)),
            None => return Err(buffer.error("has not been read: export the file again")),
        };
        let offset = view.whole("byteOffset")?.unwrap_or(0);
        let length = view.needed_whole("byteLength")?;
        slice(bytes, offset, length).ok_or_else(|| {
            view.error(format!(
                "covers {length} bytes from byte {offset} on, but buffer {buffer_index} holds {}; the file is truncated \
                 or its counts are wrong: export it again",
                bytes.len()
            ))
        })
    }

    /// Opens an accessor for `role` ("POSITION of mesh 0 'Wall'").
    pub(super) fn open(&self, index: usize, role: &str, semantic: Semantic, from: &Object) -> Result<Accessor<'a>> {
        let mut object = self.document.item("accessors", index, from)?;
        object.place = format!("accessor {index} ({role})");
        let decoded = self.contents.accessors.get(&index);
        let count = decoded.map_or_else(|| object.needed_whole("count"), |decoded| Ok(decoded.count))?;
        if count == 0 || count > u64::from(u32::MAX) {
            return Err(
                object.error(format!("has {count} elements; it must have 1 to 4294967295: export the file again"))
            );
        }
        let code = object.needed_whole("componentType")?;
        let component = decoded.map(|decoded| decoded.component).or_else(|| Component::from_code(code));
        let component = component
            .ok_or_else(|| object.error(format!("has the unknown componentType {code}; export the file again")))?;
        let kind = object.text("type")?.ok_or_else(|| object.error("has no type: export the file again"))?;
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => 0,
        };
        let normalized = object.flag("normalized")?;
        if !semantic.accepts(component, width, normalized) {
            let normalized = if normalized { "normalized " } else { "" };
            let kind = super::json::printable(kind);
            return Err(object.error(format!("cannot be {normalized}{component:?} {kind}; export the file again")));
        }
        let size = (component.size() * width) as u64;
        let base = match (decoded, object.index("bufferView")?) {
            (Some(decoded), _) if decoded.width == width => Some((decoded.bytes.as_slice(), size as usize)),
            (Some(decoded), _) => {
                let kind = super::json::printable(kind);
                let told = format!("is {kind}, but its stream has {} components: export the file again", decoded.width);
                return Err(object.error(told));
            }
            (None, Some(view)) => Some(self.base(&object, view, count, size)?),
            (None, None) => {
                self.zeros.set(self.zeros.get().saturating_add(count));
                if self.zeros.get() > MAX_ZEROS {
                    return Err(object.error(format!(
                        "has no bufferView; accessors without one may have at most {MAX_ZEROS} elements together"
                    )));
                }
                None
            }
        };
        let sparse = match object.object("sparse")? {
            Some(sparse) => Some(self.sparse(&sparse, count, size)?),
            None => None,
        };
        Ok(Accessor { object, count: count as usize, width, component, normalized, base, sparse })
    }

    fn base(&self, object: &Object, view: usize, count: u64, size: u64) -> Result<(&'a [u8], usize)> {
        let (bytes, stride) = self.view(view, object)?;
        let stride = stride.unwrap_or(size);
        if stride < size || stride > 252 {
            return Err(object.error(format!(
                "has elements of {size} bytes, but buffer view {view} has byteStride {stride} (at most 252 is possible): \
                 export the file again"
            )));
        }
        let offset = object.whole("byteOffset")?.unwrap_or(0);
        // The stride is at most 252 and the count below 2^32, so the product fits; only adding the offset may overflow.
        let length = stride * (count - 1) + size;
        let slice = slice(bytes, offset, length).ok_or_else(|| {
            object.error(format!(
                "needs {} bytes but buffer view {view} holds {}; the file is truncated or its counts are wrong: export \
                 it again",
                offset.saturating_add(length),
                bytes.len()
            ))
        })?;
        Ok((slice, stride as usize))
    }

    fn sparse(&self, sparse: &Object, count: u64, size: u64) -> Result<(Vec<u32>, &'a [u8])> {
        let changed = sparse.needed_whole("count")?;
        if changed == 0 || changed > count {
            return Err(sparse.error(format!("replaces {changed} elements of {count}: export the file again")));
        }
        let part = |key: &str, size: u64| -> Result<&'a [u8]> {
            let part =
                sparse.object(key)?.ok_or_else(|| sparse.error(format!("has no {key}: export the file again")))?;
            let view =
                part.index("bufferView")?.ok_or_else(|| part.error("has no bufferView: export the file again"))?;
            let (bytes, _) = self.view(view, &part)?;
            slice(bytes, part.whole("byteOffset")?.unwrap_or(0), changed * size).ok_or_else(|| {
                part.error(format!(
                    "needs {} bytes but buffer view {view} holds {}: export the file again",
                    changed * size,
                    bytes.len()
                ))
            })
        };
        let code = match sparse.object("indices")? {
            Some(indices) => indices.needed_whole("componentType")?,
            None => return Err(sparse.error("has no indices: export the file again")),
        };
        let component = Component::from_code(code).filter(|&c| Semantic::Indices.accepts(c, 1, false));
        let component = component
            .ok_or_else(|| sparse.error(format!("indices cannot have componentType {code}: export the file again")))?;
        let indices: Vec<u32> =
            part("indices", component.size() as u64)?.chunks_exact(component.size()).map(unsigned).collect();
        if indices.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(sparse.error("its indices do not increase: export the file again"));
        }
        if let Some(last) = indices.last().filter(|&&last| u64::from(last) >= count) {
            return Err(sparse.error(format!("replaces element {last} of {count}: export the file again")));
        }
        Ok((indices, part("values", size)?))
    }
}

impl Accessor<'_> {
    /// An input error about this accessor.
    pub(super) fn error(&self, reason: impl Into<String>) -> crate::Error {
        self.object.error(reason)
    }

    /// Fails if an attribute has another number of elements than POSITION.
    pub(super) fn check_count(&self, vertices: usize) -> Result<()> {
        if self.count == vertices {
            return Ok(());
        }
        Err(self.error(format!("has {} elements, but POSITION has {vertices}: export the file again", self.count)))
    }

    /// Bytes of an element; `None` if it is zero.
    fn element(&self, index: usize) -> Option<&[u8]> {
        let size = self.component.size() * self.width;
        if let Some((indices, values)) = &self.sparse
            && let Ok(changed) = indices.binary_search(&(index as u32))
        {
            return values.get(changed * size..(changed + 1) * size);
        }
        let (bytes, stride) = self.base?;
        bytes.get(index * stride..index * stride + size)
    }

    /// An element as numbers; normalised integers are mapped to [-1, 1] or [0, 1]. Missing components are zero.
    pub(super) fn floats<const N: usize>(&self, index: usize) -> [f32; N] {
        let mut numbers = [0.0; N];
        if let Some(bytes) = self.element(index) {
            for (number, bytes) in numbers.iter_mut().zip(bytes.chunks_exact(self.component.size())) {
                *number = self.number(bytes);
            }
        }
        numbers
    }

    fn number(&self, bytes: &[u8]) -> f32 {
        let fraction = |value: f32, most: f32| if self.normalized { (value / most).max(-1.0) } else { value };
        match (self.component, bytes) {
            (Component::I8, &[a]) => fraction(f32::from(a as i8), 127.0),
            (Component::U8, &[a]) => fraction(f32::from(a), 255.0),
            (Component::I16, &[a, b]) => fraction(f32::from(i16::from_le_bytes([a, b])), 32767.0),
            (Component::U16, &[a, b]) => fraction(f32::from(u16::from_le_bytes([a, b])), 65535.0),
            (Component::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
            _ => unsigned(bytes) as f32,
        }
    }

    /// An element of unsigned integers.
    pub(super) fn integers<const N: usize>(&self, index: usize) -> [u32; N] {
        let mut numbers = [0; N];
        if let Some(bytes) = self.element(index) {
            for (number, bytes) in numbers.iter_mut().zip(bytes.chunks_exact(self.component.size())) {
                *number = unsigned(bytes);
            }
        }
        numbers
    }

    /// All elements as vertex indices below `vertices`.
    pub(super) fn vertex_indices(&self, vertices: usize) -> Result<Vec<u32>> {
        // glTF forbids the largest value of each type: graphics APIs interpret it as primitive restart.
        let restart = match self.component.size() {
            1 => 0xFF,
            2 => 0xFFFF,
            _ => u32::MAX,
        };
        let check = |(at, index): (usize, u32)| {
            if (index as usize) < vertices && index != restart {
                return Ok(index);
            }
            Err(self.error(if index == restart {
                format!("element {at} is {index}, which glTF forbids (primitive restart): export the file again")
            } else {
                format!("element {at} is {index}, but there are {vertices} vertices: export the file again")
            }))
        };
        (0..self.count).map(|at| (at, self.integers::<1>(at)[0])).map(check).collect()
    }
}

/// A part of `bytes`; `None` if it is out of range.
fn slice(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    bytes.get(usize::try_from(offset).ok()?..end)
}

fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}
