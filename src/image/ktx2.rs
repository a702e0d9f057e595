//! KTX2 textures of Basis Universal (ETC1S and UASTC), their largest level as RGBA8. The container is parsed and
//! checked here, so the transcoder gets no unchecked data that it would trust.

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use image::error::{DecodingError, ImageFormatHint};
use image::{ColorType, ImageDecoder, ImageError, ImageResult};
use ruzstd::decoding::StreamingDecoder;
use std::borrow::Cow;
use std::io::Read;
use std::ops::Range;

/// Magic bytes at the start of a KTX2 file.
pub(crate) const MAGIC: &[u8] = b"\xABKTX 20\xBB\r\n\x1A\n";

/// Zstd window size that every decoder should accept \[bytes\].
const WINDOW: u64 = 8 << 20;

/// Size of ETC1S codebooks and their lookup tables \[bytes\].
const CODEBOOKS: u64 = 8 << 20;

/// Lengths of a KTX2 file's header and of an entry of its level index \[bytes\].
const HEADER: usize = 80;
const LEVEL: usize = 24;

/// Offsets of the header fields that are changed \[bytes\].
const LEVEL_COUNT: usize = 40;
const SCHEME: usize = 44;
const DESCRIPTOR: usize = 48;
const KEYS: usize = 56;
const GLOBAL: usize = 64;

/// A texture whose container has been parsed and checked.
pub(super) struct Texture {
    bytes: Vec<u8>,
    /// Width and height \[texels\].
    size: [u32; 2],
    kind: Kind,
    /// The data format descriptor.
    descriptor: Range<usize>,
    /// The largest level.
    level: Range<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Etc1s,
    Uastc,
    /// UASTC compressed with zstd.
    Packed,
}

impl Texture {
    /// Parses a file's container.
    pub(super) fn new(mut bytes: Vec<u8>) -> Result<Self, String> {
        let broken = || "its KTX2 container is broken or cut off".to_owned();
        if bytes.len() < HEADER + LEVEL || !bytes.starts_with(MAGIC) {
            return Err(broken());
        }
        let [format, _, width, height, depth, layers, faces, _, scheme] =
            std::array::from_fn(|at| word(&bytes, MAGIC.len() + 4 * at));
        if width == 0 || height == 0 || depth > 0 || layers > 0 || faces != 1 {
            return Err("its KTX2 is no 2D texture but a line, volume, array or cube".into());
        }
        let range = |offset: u64, length: u64| -> Result<Range<usize>, String> {
            let end = offset.checked_add(length).filter(|&end| end <= bytes.len() as u64).ok_or_else(broken)?;
            Ok(offset as usize..end as usize)
        };
        let descriptor = range(word(&bytes, DESCRIPTOR).into(), word(&bytes, DESCRIPTOR + 4).into())?;
        let level = range(long(&bytes, HEADER), long(&bytes, HEADER + 8))?;
        range(long(&bytes, GLOBAL), long(&bytes, GLOBAL + 8))?;
        // Format 0 means that the descriptor's colour model and the supercompression scheme define the encoding.
        let kind = match (format, bytes[descriptor.clone()].get(12), scheme) {
            (0, Some(163), 1) => Kind::Etc1s,
            (0, Some(166), 0) => Kind::Uastc,
            (0, Some(166), 2) => Kind::Packed,
            _ => return Err("its KTX2 is neither ETC1S nor UASTC of Basis Universal".into()),
        };
        // The key/value data is not used.
        bytes[KEYS..GLOBAL].fill(0);
        Ok(Self { bytes, size: [width, height], kind, descriptor, level })
    }

    /// Size of the largest level in UASTC \[bytes\]: 16 for each 4 x 4 texels.
    fn blocks(&self) -> u64 {
        self.size.iter().map(|side| u64::from(side.div_ceil(4))).product::<u64>().saturating_mul(16)
    }

    /// Peak memory \[bytes\] during decoding.
    pub(super) fn working(&self) -> u64 {
        let aside = match self.kind {
            Kind::Etc1s => self.blocks().saturating_add(CODEBOOKS),
            Kind::Uastc => self.blocks(),
            Kind::Packed => self.blocks().saturating_mul(2).saturating_add(self.window()),
        };
        (self.bytes.len() as u64).saturating_add(aside).saturating_add(self.total_bytes())
    }

    /// Largest zstd window: encoders round the size of the level up to a power of two.
    fn window(&self) -> u64 {
        self.blocks().saturating_mul(2).max(WINDOW)
    }

    /// The file for the transcoder. For UASTC it contains only the largest level.
    fn container(&self) -> Result<Cow<'_, [u8]>, String> {
        let stored = &self.bytes[self.level.clone()];
        let blocks: Cow<[u8]> = match self.kind {
            Kind::Etc1s => return Ok(Cow::Borrowed(&self.bytes)),
            Kind::Uastc => Cow::Borrowed(stored),
            Kind::Packed => Cow::Owned(self.unpacked(stored)?),
        };
        let descriptor = &self.bytes[self.descriptor.clone()];
        let start = HEADER + LEVEL + descriptor.len();
        let length = self.blocks();
        let Some(blocks) = usize::try_from(length).ok().and_then(|length| blocks.get(..length)) else {
            return Err(format!("its KTX2 is truncated: {} bytes of {length}", blocks.len()));
        };
        let mut bytes = Vec::with_capacity(start + blocks.len());
        bytes.extend(&self.bytes[..HEADER]);
        bytes[LEVEL_COUNT..SCHEME].copy_from_slice(&1_u32.to_le_bytes());
        bytes[SCHEME..DESCRIPTOR].fill(0);
        bytes[DESCRIPTOR..DESCRIPTOR + 4].copy_from_slice(&((HEADER + LEVEL) as u32).to_le_bytes());
        bytes[GLOBAL..HEADER].fill(0);
        bytes.extend([start as u64, length, length].into_iter().flat_map(u64::to_le_bytes));
        bytes.extend(descriptor);
        bytes.extend(blocks);
        Ok(Cow::Owned(bytes))
    }

    /// Decompresses a zstd level. Reads only as many bytes as the texels need, whatever the file claims.
    fn unpacked(&self, packed: &[u8]) -> Result<Vec<u8>, String> {
        let broken = |why: String| format!("its KTX2 holds broken zstd: {why}");
        let decoder = StreamingDecoder::new_with_max_window_size(packed, self.window());
        let decoder = decoder.map_err(|error| broken(error.to_string()))?;
        let mut blocks = Vec::new();
        decoder.take(self.blocks()).read_to_end(&mut blocks).map_err(|error| broken(error.to_string()))?;
        Ok(blocks)
    }

    fn read(&self, rgba: &mut [u8]) -> Result<(), String> {
        let container = self.container()?;
        let broken = |error: basisu::Error| format!("its Basis Universal data is broken: {error:?}");
        let transcoder = Transcoder::new(&container).map_err(broken)?;
        transcoder.transcode_into(0, TargetFormat::Rgba32, DecodeFlags::NONE, rgba).map_err(broken)?;
        Ok(())
    }
}

impl ImageDecoder for Texture {
    fn dimensions(&self) -> (u32, u32) {
        self.size.into()
    }

    fn color_type(&self) -> ColorType {
        ColorType::Rgba8
    }

    fn read_image(self, rgba: &mut [u8]) -> ImageResult<()> {
        let format = ImageFormatHint::Name("KTX2".into());
        self.read(rgba).map_err(|reason| ImageError::Decoding(DecodingError::new(format, reason)))
    }

    fn read_image_boxed(self: Box<Self>, rgba: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(rgba)
    }
}

/// A 32-bit number in the header or in the first entry of the level index.
fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte]))
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from(word(bytes, at)) | u64::from(word(bytes, at + 4)) << 32
}
