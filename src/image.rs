//! Images on the CPU: mip levels, PNG, OpenEXR. Decoding stays within a memory limit.

pub(crate) mod decode;
pub(crate) mod ktx2;
#[cfg(feature = "exr")]
mod open_exr;

#[cfg(feature = "exr")]
pub use open_exr::write_exr;

pub use decode::set_max_memory;

use crate::error::{Error, Result};
use crate::files;
use glam::Vec3;
use image::ExtendedColorType;
use image::ImageFormat;
use std::io::BufReader;
use std::path::Path;
use std::sync::LazyLock;

/// All mip levels of an RGBA8 image, largest first. Colours are averaged as linear values, not as sRGB codes.
pub fn mip_chain(rgba: &[u8], width: u32, height: u32, srgb: bool) -> Vec<Vec<u8>> {
    let decode = |c: u8| if srgb { linear_from_srgb(c) } else { f32::from(c) / 255.0 };
    let table: Vec<f32> = (0..=255).map(decode).collect();
    let encode = |v: f32| {
        let v = if !srgb {
            v
        } else if v <= 0.003_130_8 {
            v * 12.92
        } else {
            1.055 * v.powf(1.0 / 2.4) - 0.055
        };
        (v * 255.0 + 0.5) as u8
    };
    let mut levels = vec![rgba.to_vec()];
    let (mut w, mut h) = (width as usize, height as usize);
    while w > 1 || h > 1 {
        let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
        let above = levels.last().expect("level 0");
        let mut level = Vec::with_capacity(nw * nh * 4);
        for y in 0..nh {
            for x in 0..nw {
                for channel in 0..4 {
                    // Alpha is linear in either case.
                    let texel = |dx: usize, dy: usize| {
                        let (sx, sy) = ((2 * x + dx).min(w - 1), (2 * y + dy).min(h - 1));
                        above[(sy * w + sx) * 4 + channel]
                    };
                    let four = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
                    level.push(if channel == 3 {
                        ((four.iter().map(|c| u32::from(*c)).sum::<u32>() + 2) / 4) as u8
                    } else {
                        encode(four.iter().map(|c| table[*c as usize]).sum::<f32>() * 0.25)
                    });
                }
            }
        }
        levels.push(level);
        (w, h) = (nw, nh);
    }
    levels
}

/// All mip levels of a normal map (tangent-space vectors as codes), largest first. Alpha stores how much the normals
/// under a texel vary: the root of the variance along either tangent, 0 at the largest level. The variance comes from
/// the length of the mean normal (Banerjee et al. 2005).
pub fn normal_mip_chain(rgba: &[u8], width: u32, height: u32) -> Vec<Vec<u8>> {
    let mut levels = mip_chain(rgba, width, height, false);
    let unit =
        |code: &[u8]| (Vec3::new(code[0].into(), code[1].into(), code[2].into()) / 127.5 - 1.0).normalize_or(Vec3::Z);
    let mut means: Vec<Vec3> = rgba.chunks_exact(4).map(unit).collect();
    let (mut w, mut h) = (width as usize, height as usize);
    for (i, level) in levels.iter_mut().enumerate() {
        if i > 0 {
            let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
            let above = |x: usize, y: usize| means[y.min(h - 1) * w + x.min(w - 1)];
            let four = |x: usize, y: usize| above(x, y) + above(x + 1, y) + above(x, y + 1) + above(x + 1, y + 1);
            means = (0..nw * nh).map(|at| 0.25 * four(2 * (at % nw), 2 * (at / nw))).collect();
            (w, h) = (nw, nh);
        }
        for (texel, mean) in level.chunks_exact_mut(4).zip(&means) {
            let length = mean.length().clamp(1e-3, 1.0);
            let variance = (1.0 - length * length) / (3.0 * length - length.powi(3));
            texel[3] = if i == 0 { 0 } else { (255.0 * variance.clamp(0.0, 1.0).sqrt() + 0.5) as u8 };
        }
    }
    levels
}

/// Number of values that are no valid radiance: negative, infinite or not a number.
pub fn broken_values(radiance: &[f32]) -> usize {
    radiance.iter().filter(|v| !(**v >= 0.0 && v.is_finite())).count()
}

/// Named float channels of an image, rows from the top, linear Rec.709.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Name of the layer, empty for the main picture; channels are `name.R`, `name.G`, `name.B`.
    pub name: String,
    /// Channel names.
    pub channels: Vec<&'static str>,
    /// One plane per channel, `width * height` values each.
    pub planes: Vec<Vec<f32>>,
}

impl Layer {
    /// An RGB layer from RGBA texels.
    pub fn rgb(name: &str, texels: &[[f32; 4]]) -> Self {
        Self::of(name, &["R", "G", "B"], texels)
    }

    /// A layer from the first channels of RGBA texels.
    pub fn of(name: &str, channels: &[&'static str], texels: &[[f32; 4]]) -> Self {
        let planes = (0..channels.len()).map(|c| texels.iter().map(|t| t[c]).collect()).collect();
        Self { name: name.into(), channels: channels.to_vec(), planes }
    }
}

/// Three linear channels read from a file, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width \[pixels\].
    pub width: u32,
    /// Height \[pixels\].
    pub height: u32,
    /// `width * height` values.
    pub rgb: Vec<[f32; 3]>,
}

/// Reads linear radiance of any scale from an OpenEXR or a Radiance file.
///
/// # Errors
/// Fails if the file cannot be read, is no picture, or would exceed the memory limit.
pub fn read_radiance(path: &Path) -> Result<Picture> {
    let bad = |reason: String| Error::Input { file: path.to_owned(), place: "image".into(), reason };
    if is_exr(path) {
        return read_picture(path, None);
    }
    if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("hdr")) {
        return Err(bad("is not a file of linear values; use .hdr or .exr".into()));
    }
    let decoded = decoded(path, ImageFormat::Hdr).map_err(bad)?.into_rgb32f();
    let (width, height) = decoded.dimensions();
    Ok(Picture { width, height, rgb: decoded.pixels().map(|p| p.0).collect() })
}

/// Decodes a file. The result takes at most 16 bytes per pixel.
fn decoded(path: &Path, format: ImageFormat) -> std::result::Result<image::DynamicImage, String> {
    let encoded = decode::header(BufReader::new(files::open(path)?), format)?;
    decode::within(encoded.working.saturating_add(16 * encoded.texels))?;
    encoded.decode()
}

/// Whether the name is that of an OpenEXR file (linear values of any scale).
pub fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

/// Reads a picture as linear values: a layer of an OpenEXR file (`None`: the main picture), or a PNG or JPEG. A layer
/// with one channel is copied to all three.
///
/// # Errors
/// Fails if the file cannot be read, is no picture, or would exceed the memory limit.
pub fn read_picture(path: &Path, layer: Option<&str>) -> Result<Picture> {
    let bad = |reason: String| Error::Input { file: path.to_owned(), place: "image".into(), reason };
    if !is_exr(path) {
        if let Some(layer) = layer {
            return Err(bad(format!("has no layer '{layer}'; only .exr files have layers")));
        }
        let format = ImageFormat::from_path(path)
            .map_err(|_| bad("its name has no ending of an image; give a .png or .exr file".into()))?;
        let decoded = decoded(path, format).map_err(bad)?.into_rgb8();
        let (width, height) = decoded.dimensions();
        let linear = |p: &image::Rgb<u8>| p.0.map(linear_from_srgb);
        return Ok(Picture { width, height, rgb: decoded.pixels().map(linear).collect() });
    }
    #[cfg(feature = "exr")]
    return open_exr::read(path, layer);
    #[cfg(not(feature = "exr"))]
    Err(bad("OpenEXR is not in this build; build with feature `exr`".into()))
}

/// Linear value of an 8-bit sRGB code; IEC 61966-2-1.
pub fn linear_from_srgb(code: u8) -> f32 {
    static TABLE: LazyLock<[f32; 256]> = LazyLock::new(|| {
        std::array::from_fn(|code| {
            let v = code as f32 / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        })
    });
    TABLE[usize::from(code)]
}

/// Writes an 8-bit sRGB PNG from RGBA bytes. Alpha is written only if some pixel is not opaque.
///
/// # Errors
/// Fails if the file cannot be written; no partial file is left behind.
pub fn write_png(path: &Path, width: u32, height: u32, rgba: &[u8]) -> Result<()> {
    let bytes = png(width, height, rgba).map_err(|reason| Error::Output { file: path.to_owned(), reason })?;
    files::write(path, &bytes)
}

/// Encodes RGBA bytes as an 8-bit sRGB PNG, with alpha only if some pixel is not opaque. The error is the reason.
pub(crate) fn png(width: u32, height: u32, rgba: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let opaque = rgba.chunks_exact(4).all(|p| p[3] == 255);
    let rgb = || rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    let (texels, kind) =
        if opaque { (rgb(), ExtendedColorType::Rgb8) } else { (rgba.to_vec(), ExtendedColorType::Rgba8) };
    // In memory: the encoder would not report a failure to write its last bytes.
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    let encoded = image::ImageEncoder::write_image(encoder, &texels, width, height, kind);
    encoded.map_err(|error| error.to_string())?;
    Ok(bytes)
}
