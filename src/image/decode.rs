//! Decoding within bounds: what it takes is told by the header, before anything is allocated for it.

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
pub(crate) struct Encoded<D> {
    decoder: D,
    /// Texels.
    pub(crate) texels: u64,
    /// Width and height \[texels\].
    pub(crate) size: [u32; 2],
    /// Most memory \[bytes\] while it is decoded.
    pub(crate) working: u64,
}

/// Reads the header of an image of this format.
pub(crate) fn header<'a, R: BufRead + Seek + 'a>(
    mut file: R,
    format: ImageFormat,
) -> Result<Encoded<impl ImageDecoder + 'a>, String> {
    let describe_io = |error: std::io::Error| error.to_string();
    let length = file.seek(SeekFrom::End(0)).map_err(describe_io)?;
    file.rewind().map_err(describe_io)?;
    let mut reader = ImageReader::with_format(file, format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(max_memory());
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(describe)?;
    let (width, height) = decoder.dimensions();
    let decoded = decoder.total_bytes();
    let working = match format {
        // A copy of the file, and 16 bits for each coefficient of a progressive one.
        ImageFormat::Jpeg => decoded.saturating_mul(3).saturating_add(length),
        _ => decoded,
    };
    Ok(Encoded { decoder, texels: u64::from(width) * u64::from(height), size: [width, height], working })
}

impl<D: ImageDecoder> Encoded<D> {
    /// Decodes it.
    pub(crate) fn decode(self) -> Result<DynamicImage, String> {
        DynamicImage::from_decoder(self.decoder).map_err(describe)
    }
}

fn describe(error: image::ImageError) -> String {
    error.to_string().replace(['\n', '\r'], " ")
}
