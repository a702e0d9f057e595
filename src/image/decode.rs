//! Decoding within bounds: what it takes is told by the header, before anything is allocated for it.

use image::codecs::webp::WebPDecoder;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::io::{BufRead, Seek, SeekFrom};
use std::sync::atomic::{AtomicU64, Ordering};

/// Most memory \[bytes\] that decoding may take at once.
static MOST: AtomicU64 = AtomicU64::new(1 << 30);

/// Sets the most memory \[bytes\] that decoding pictures and textures may take at once, on all threads together and with
/// what they become, and that vertices and indices of a scene may take; 1 GiB without this. What needs more is refused.
pub fn set_max_memory(bytes: u64) {
    MOST.store(bytes, Ordering::Relaxed);
}

/// Most memory \[bytes\] that decoding may take at once.
pub(crate) fn max_memory() -> u64 {
    MOST.load(Ordering::Relaxed)
}

/// Refuses what takes more memory \[bytes\] than is allowed.
pub(crate) fn within(needed: u64) -> Result<(), String> {
    let most = max_memory();
    if needed <= most {
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    let (needed, most) = (mib(needed), mib(most));
    Err(format!("decoding takes {needed} MiB of memory, and {most} are allowed; --max-memory {needed}M allows it"))
}

/// An image of which the header alone is read so far.
pub(crate) struct Encoded<'a> {
    decoder: Box<dyn ImageDecoder + 'a>,
    /// Texels.
    pub(crate) texels: u64,
    /// Width and height \[texels\].
    pub(crate) size: [u32; 2],
    /// Most memory \[bytes\] while it is decoded.
    pub(crate) working: u64,
}

/// Reads the header of an image of this format.
pub(crate) fn header<'a, R: BufRead + Seek + 'a>(mut file: R, format: ImageFormat) -> Result<Encoded<'a>, String> {
    let length = length(&mut file)?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(max_memory());
    let decoder: Box<dyn ImageDecoder + 'a> = if format == ImageFormat::WebP {
        let mut decoder = WebPDecoder::new(file).map_err(describe)?;
        // No texture moves, and what puts frames together panics on broken ones.
        if decoder.has_animation() {
            return Err("it is an animation".into());
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
        // A copy of the file, and 16 bits for each coefficient of a progressive one.
        ImageFormat::Jpeg => decoded.saturating_mul(3).saturating_add(length),
        // Planes or a canvas of the frame and its transforms, and a copy of the file.
        ImageFormat::WebP => decoded.saturating_mul(4).saturating_add(length),
        _ => decoded,
    };
    Ok(Encoded { decoder, texels: texels(width, height), size: [width, height], working })
}

/// Reads a KTX2 file, and of what it holds the header.
pub(crate) fn ktx2<'a>(mut file: impl BufRead + Seek) -> Result<Encoded<'a>, String> {
    within(length(&mut file)?)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    let texture = super::ktx2::Texture::new(bytes)?;
    let (width, height) = texture.dimensions();
    let working = texture.working();
    Ok(Encoded { decoder: Box::new(texture), texels: texels(width, height), size: [width, height], working })
}

/// Length \[bytes\] of a file, which is then read from its start.
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
    /// Decodes it.
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
