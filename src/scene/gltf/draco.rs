//! KHR_draco_mesh_compression: decodes primitives before they are read. Their accessors then hold the streams' values.

use std::collections::BTreeMap;

use draco_core::{DataType, DecodeLimits, DecoderBuffer, ErrorKind, MeshDecoder, PointAttribute, PointIndex};

use crate::Result;
use crate::image::decode;
use crate::scene::accessor::{Accessors, Component, Contents, Decoded};
use crate::scene::json::{Document, Object, printable};

const NAME: &str = "KHR_draco_mesh_compression";

/// Largest memory use \[bytes\] per triangle during decoding, including its share of positions.
const FACE: u64 = 128;

/// A compressed primitive.
struct Packed<'a> {
    view: usize,
    primitive: Object<'a>,
    extension: Object<'a>,
    /// The accessor of its vertex indices.
    indices: usize,
    /// For each attribute, its name, its accessor and its identifier in the stream.
    attributes: Vec<(&'a str, usize, u32)>,
}

/// Decodes all primitives that have no uncompressed fallback.
pub(super) fn unpack(document: &Document, contents: &mut Contents) -> Result<()> {
    let required = document.object().texts("extensionsRequired")?.contains(&NAME);
    let mut packed = Vec::new();
    for mesh in document.items("meshes")? {
        for primitive in mesh.objects("primitives", "primitive")? {
            if let Some(extension) = primitive.extension(NAME)? {
                packed.extend(Packed::read(document, primitive, extension, required)?);
            }
        }
    }
    let mut decoded = BTreeMap::new();
    // By accessor, the stream that it holds.
    let mut sources = BTreeMap::new();
    let mut left = decode::max_memory();
    let accessors = Accessors::new(document, contents);
    // Primitives that share a stream must be adjacent.
    packed.sort_by_key(|packed| packed.view);
    for same in packed.chunk_by(|a, b| a.view == b.view) {
        let (bytes, _) = accessors.view(same[0].view, &same[0].extension)?;
        let mesh = mesh(bytes, left, &same[0].extension)?;
        for packed in same {
            for (accessor, source, made) in packed.accessors(&mesh, &mut left)? {
                let source = (packed.view, source);
                if *sources.entry(accessor).or_insert(source) != source {
                    return Err(packed.extension.error(format!(
                        "accessor {accessor} belongs to another Draco stream, too: export the file again"
                    )));
                }
                decoded.insert(accessor, made);
            }
        }
    }
    contents.accessors = decoded;
    Ok(())
}

/// Decodes a stream within the memory limit.
fn mesh(bytes: &[u8], left: u64, place: &Object) -> Result<draco_core::Mesh> {
    let limits =
        DecodeLimits::default().with_max_decoded_bytes(left).with_max_faces(left / FACE).with_max_points(left / FACE);
    let mut mesh = draco_core::Mesh::new();
    match MeshDecoder::new().decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh) {
        Ok(()) => Ok(mesh),
        Err(error) if error.kind() == ErrorKind::LimitExceeded => Err(too_large(place)),
        Err(error) => {
            let why = printable(&error.to_string());
            Err(place.error(format!("its Draco stream does not decode ({why}): export or download the file again")))
        }
    }
}

fn too_large(place: &Object) -> crate::Error {
    let most = decode::max_memory().div_ceil(1 << 20);
    place.error(format!(
        "Draco streams exceed {most} MiB of memory at this point; simplify the file, or allow more with --max-memory"
    ))
}

impl<'a> Packed<'a> {
    /// A primitive to decode; `None` if it has an uncompressed fallback that may be used.
    fn read(
        document: &'a Document,
        primitive: Object<'a>,
        extension: Object<'a>,
        required: bool,
    ) -> Result<Option<Self>> {
        let view = extension
            .index("bufferView")?
            .ok_or_else(|| extension.error("names no bufferView: export the file again"))?;
        let of_stream = extension
            .object("attributes")?
            .ok_or_else(|| extension.error("has no attributes: export the file again"))?;
        let of_file = primitive
            .object("attributes")?
            .ok_or_else(|| primitive.error("has no attributes: export the file again"))?;
        let mode = primitive.whole("mode")?.unwrap_or(4);
        if mode != 4 {
            return Err(primitive
                .error(format!("has mode {mode}; Draco supports only triangle lists (4): export the file again")));
        }
        let mut attributes = Vec::new();
        for name in of_stream.keys() {
            let id = u32::try_from(of_stream.needed_whole(name)?).unwrap_or(u32::MAX);
            let accessor = of_file.index(name)?.ok_or_else(|| {
                let name = printable(name);
                extension.error(format!("has the attribute {name}, which the primitive lacks: export the file again"))
            })?;
            attributes.push((name, accessor, id));
        }
        let indices = primitive.index("indices")?;
        let indices =
            indices.ok_or_else(|| primitive.error("has Draco triangles, but no indices: export the file again"))?;
        let mut stored = true;
        for accessor in attributes.iter().map(|attribute| attribute.1).chain([indices]) {
            stored &= document.item("accessors", accessor, &primitive)?.value("bufferView").is_some();
        }
        if stored && !required {
            return Ok(None);
        }
        Ok(Some(Self { view, primitive, extension, indices, attributes }))
    }

    /// Accessors, the part of the stream that each holds (an attribute, or `None` for the indices), and the values.
    fn accessors(&self, mesh: &draco_core::Mesh, left: &mut u64) -> Result<Vec<(usize, Option<u32>, Decoded)>> {
        let mut take = |bytes: usize| {
            *left = left.checked_sub(bytes as u64).ok_or_else(|| too_large(&self.extension))?;
            Ok::<_, crate::Error>(())
        };
        if mesh.num_faces() == 0 {
            return Err(self.primitive.error("its Draco stream has no triangles: export the file again"));
        }
        take(mesh.num_faces() * 12)?;
        let bytes = mesh.faces().iter().flatten().flat_map(|point| point.0.to_le_bytes()).collect();
        let corners = Decoded { bytes, count: 3 * mesh.num_faces() as u64, width: 1, component: Component::U32 };
        let mut made = vec![(self.indices, None, corners)];
        for &(name, accessor, id) in &self.attributes {
            let wrong = |what: &str| {
                self.extension.error(format!("{}: its Draco stream {what}: export the file again", printable(name)))
            };
            let attribute = mesh.attribute_by_unique_id(id).ok_or_else(|| wrong("has no such attribute"))?;
            let component =
                component(attribute.data_type()).ok_or_else(|| wrong("holds a number type that glTF lacks"))?;
            let width = usize::from(attribute.num_components());
            take(mesh.num_points() * width * component.size())?;
            let bytes = values(attribute, mesh.num_points(), width * component.size());
            let bytes = bytes.ok_or_else(|| wrong("lacks values"))?;
            made.push((accessor, Some(id), Decoded { bytes, count: mesh.num_points() as u64, width, component }));
        }
        Ok(made)
    }
}

fn component(kind: DataType) -> Option<Component> {
    match kind {
        DataType::Int8 => Some(Component::I8),
        DataType::Uint8 => Some(Component::U8),
        DataType::Int16 => Some(Component::I16),
        DataType::Uint16 => Some(Component::U16),
        DataType::Uint32 => Some(Component::U32),
        DataType::Float32 => Some(Component::F32),
        _ => None,
    }
}

/// The attribute's value at each point, `size` bytes each.
fn values(attribute: &PointAttribute, points: usize, size: usize) -> Option<Vec<u8>> {
    let stride = usize::try_from(attribute.byte_stride()).ok()?;
    let data = attribute.buffer().data();
    let mut bytes = Vec::with_capacity(points * size);
    for point in 0..points as u32 {
        let at = (attribute.mapped_index(PointIndex(point)).0 as usize).checked_mul(stride)?;
        bytes.extend(data.get(at..at.checked_add(size)?)?);
    }
    Some(bytes)
}
