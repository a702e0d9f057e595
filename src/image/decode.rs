//! Decoding within a memory limit: the header gives the memory needed before anything is allocated.

use image::codecs::webp::WebPDecoder;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::io::{BufRead, Seek, SeekFrom};
use std::sync::atomic::{AtomicU64, Ordering};

/// Memory limit for decoding \[bytes\].
static MOST: AtomicU64 = AtomicU64::new(1 << 30);

/// Sets the memory limit \[bytes\] for decoding pictures and textures, for all threads together and including the
/// decoded results. The same limit applies to the vertices and indices of a scene. The default is 1 GiB; input that
/// needs more is refused.
pub fn set_max_memory(bytes: u64) {
    MOST.store(bytes, Ordering::Relaxed);
}

/// Memory limit for decoding \[bytes\].
pub(crate) fn max_memory() -> u64 {
    MOST.load(Ordering::Relaxed)
}

/// Fails if the memory needed \[bytes\] exceeds the limit.
pub(crate) fn within(needed: u64) -> Result<(), String> {
    let most = max_memory();
    if needed <= most {
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    let (needed, most) = (mib(needed), mib(most));
    Err(format!("decoding takes {needed} MiB of memory, but the limit is {most} MiB; --max-memory {needed}M allows it"))
}

/// An image of which only the header has been read.
pub(crate) struct Encoded<'a> {
    decoder: Box<dyn ImageDecoder + 'a>,
    /// Number of texels.
    pub(crate) texels: u64,
    /// Width and height \[texels\].
    pub(crate) size: [u32; 2],
    /// Peak memory \[bytes\] during decoding.
    pub(crate) working: u64,
}

/// Reads the header of an image of this format.
pub(crate) fn header<'a, R: BufRead + Seek + 'a>(mut file: R, format: ImageFormat) -> Result<Encoded<'a>, String> {
    let length = length(&mut file)?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(max_memory());
    let decoder: Box<dyn ImageDecoder + 'a> = if format == ImageFormat::WebP {
        let mut decoder = WebPDecoder::new(file).map_err(describe)?;
        // Textures do not move, and the decoder's compositing of frames panics on broken animations.
        if decoder.has_animation() {
            return Err("it is an animation; use a still image".into());
        }
        decoder.set_limits(limits).map_err(describe)?;
        Box::new(decoder)
    } else {
        let mut reader = ImageReader::with_format(file, format);
        reader.limits(limits);
        Box::new(reader.into_decoder().map_err(describe)?)
    };
    let (width, height) = decoder.dimensions();
    let decoded = decoder.total_bytes();
    let working = match format {
        // A copy of the file, and 16 bits for each coefficient of a progressive JPEG.
        ImageFormat::Jpeg => decoded.saturating_mul(3).saturating_add(length),
        // The frame's planes or canvas and its transforms, and a copy of the file.
        ImageFormat::WebP => decoded.saturating_mul(4).saturating_add(length),
        _ => decoded,
    };
    Ok(Encoded { decoder, texels: texels(width, height), size: [width, height], working })
}

/// Reads a KTX2 file and parses its header.
pub(crate) fn ktx2<'a>(mut file: impl BufRead + Seek) -> Result<Encoded<'a>, String> {
    within(length(&mut file)?)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    let texture = super::ktx2::Texture::new(bytes)?;
    let (width, height) = texture.dimensions();
    let working = texture.working();
    Ok(Encoded { decoder: Box::new(texture), texels: texels(width, height), size: [width, height], working })
}

/// Length of a file \[bytes\]; rewinds the file to its start.
fn length(file: &mut impl Seek) -> Result<u64, String> {
    let describe = |error: std::io::Error| error.to_string();
    let length = file.seek(SeekFrom::End(0)).map_err(describe)?;
    file.rewind().map_err(describe)?;
    Ok(length)
}

fn texels(width: u32, height: u32) -> u64 {
    u64::from(width) * u64::from(height)
}

impl Encoded<'_> {
    /// Decodes the image.
    pub(crate) fn decode(self) -> Result<DynamicImage, String> {
        DynamicImage::from_decoder(self.decoder).map_err(describe)
    }
}

fn describe(error: image::ImageError) -> String {
    match error {
        image::ImageError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            "it is cut off; write or download it again".into()
        }
        error => error.to_string().replace(['\n', '\r'], " ") + "; write or download it again",
    }
}
