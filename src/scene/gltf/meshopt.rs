//! EXT_meshopt_compression and KHR_meshopt_compression: decompresses buffer views before they are read. The decoders
//! are C++ code made for untrusted input; their assertions are checked here first.

use bytemuck::{cast_slice, cast_slice_mut};
use meshopt::{decode_filter_color, decode_filter_exp, decode_filter_oct, decode_filter_quat};
use rayon::prelude::*;

use crate::Result;
use crate::image::decode;
use crate::scene::accessor::{Accessors, Contents};
use crate::scene::json::{Document, Object, printable};

const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Largest vertex stride \[bytes\].
const MAX_STRIDE: u64 = 256;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Filter {
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

/// A compressed buffer view.
struct Packed<'a> {
    view: usize,
    object: Object<'a>,
    bytes: &'a [u8],
    mode: Mode,
    filter: Filter,
    count: usize,
    stride: usize,
}

/// Decompresses all compressed buffer views.
pub(super) fn unpack(document: &Document, contents: &mut Contents) -> Result<()> {
    let accessors = Accessors::new(document, contents);
    let mut packed = Vec::new();
    let mut total = 0_u64;
    for (index, view) in document.items("bufferViews")?.into_iter().enumerate() {
        for name in NAMES {
            let Some(object) = view.extension(name)? else { continue };
            let view = Packed::read(index, object, &accessors)?;
            total = total.saturating_add(view.count as u64 * view.stride as u64);
            decode::within(total).map_err(|reason| view.object.error(reason))?;
            packed.push(view);
            break;
        }
    }
    let unpacked: Vec<(usize, Vec<u8>)> = packed.par_iter().map(Packed::unpack).collect::<Result<_>>()?;
    contents.views.extend(unpacked);
    Ok(())
}

impl<'a> Packed<'a> {
    fn read(view: usize, object: Object<'a>, accessors: &Accessors<'a>) -> Result<Self> {
        let unknown = |key: &str, text: &str| {
            let text = printable(text);
            Err(object.error(format!("has the unknown {key} {text}: export the file again, or without compression")))
        };
        let mode = match object.text("mode")?.unwrap_or("none") {
            "ATTRIBUTES" => Mode::Attributes,
            "TRIANGLES" => Mode::Triangles,
            "INDICES" => Mode::Indices,
            other => return unknown("mode", other),
        };
        let filter = match object.text("filter")?.unwrap_or("NONE") {
            "NONE" => Filter::None,
            "OCTAHEDRAL" => Filter::Octahedral,
            "QUATERNION" => Filter::Quaternion,
            "EXPONENTIAL" => Filter::Exponential,
            "COLOR" => Filter::Color,
            other => return unknown("filter", other),
        };
        let (count, stride) = (object.needed_whole("count")?, object.needed_whole("byteStride")?);
        let possible = match (mode, filter) {
            (Mode::Attributes, Filter::None | Filter::Exponential) => {
                stride.is_multiple_of(4) && (4..=MAX_STRIDE).contains(&stride)
            }
            (Mode::Attributes, Filter::Octahedral | Filter::Color) => stride == 4 || stride == 8,
            (Mode::Attributes, Filter::Quaternion) => stride == 8,
            (Mode::Triangles, Filter::None) => count.is_multiple_of(3) && (stride == 2 || stride == 4),
            (Mode::Indices, Filter::None) => stride == 2 || stride == 4,
            (Mode::Triangles | Mode::Indices, _) => false,
        };
        if !possible || count == 0 || count > u64::from(u32::MAX) {
            return Err(object.error(format!(
                "cannot be {count} elements of {stride} bytes with mode {mode:?} and filter {filter:?}: export the file again"
            )));
        }
        let bytes = accessors.bytes(&object)?;
        Ok(Self { view, object, bytes, mode, filter, count: count as usize, stride: stride as usize })
    }

    fn unpack(&self) -> Result<(usize, Vec<u8>)> {
        let unpacked = match (self.mode, self.stride) {
            (Mode::Attributes, stride) => {
                vertices(self.bytes, self.count, stride / 4).map(|words| self.filtered(words))
            }
            (Mode::Triangles, 2) => meshopt::decode_index_buffer::<u16>(self.bytes, self.count).map(|i| to_bytes(&i)),
            (Mode::Triangles, _) => meshopt::decode_index_buffer::<u32>(self.bytes, self.count).map(|i| to_bytes(&i)),
            (Mode::Indices, 2) => meshopt::decode_index_sequence::<u16>(self.bytes, self.count).map(|i| to_bytes(&i)),
            (Mode::Indices, _) => meshopt::decode_index_sequence::<u32>(self.bytes, self.count).map(|i| to_bytes(&i)),
        };
        let broken = |_| self.object.error("its data is broken or cut off: export or download the file again");
        Ok((self.view, unpacked.map_err(broken)?))
    }

    /// Applies the filter to decoded vertices and returns their bytes.
    fn filtered(&self, mut words: Vec<u32>) -> Vec<u8> {
        match (self.filter, self.stride) {
            (Filter::None, _) => {}
            (Filter::Octahedral, 4) => decode_filter_oct::<i8>(cast_slice_mut(&mut words)),
            (Filter::Octahedral, _) => decode_filter_oct::<i16>(cast_slice_mut(&mut words)),
            (Filter::Quaternion, _) => decode_filter_quat(cast_slice_mut(&mut words)),
            (Filter::Exponential, _) => decode_filter_exp::<1>(cast_slice_mut(&mut words)),
            (Filter::Color, 4) => decode_filter_color::<u8>(cast_slice_mut(&mut words)),
            (Filter::Color, _) => decode_filter_color::<u16>(cast_slice_mut(&mut words)),
        }
        to_bytes(&words)
    }
}

fn to_bytes<T: bytemuck::NoUninit>(values: &[T]) -> Vec<u8> {
    cast_slice(values).to_vec()
}

/// A vertex of this many words; the decoder takes its stride from the type.
#[derive(Clone)]
struct Words<const N: usize>([u32; N]);

impl<const N: usize> Default for Words<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

/// Decodes vertices of this many words each.
fn vertices(bytes: &[u8], count: usize, words: usize) -> meshopt::Result<Vec<u32>> {
    fn decode<const N: usize>(bytes: &[u8], count: usize) -> meshopt::Result<Vec<u32>> {
        let vertices = meshopt::decode_vertex_buffer::<Words<N>>(bytes, count)?;
        Ok(vertices.iter().flat_map(|words| words.0).collect())
    }
    macro_rules! of_each {
        ($($n:literal)*) => {
            match words {
                $($n => decode::<$n>(bytes, count),)*
                _ => Err(meshopt::Error::Parse("stride".into())),
            }
        };
    }
    of_each!(
        1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64
    )
}
