//! OpenEXR: layers of linear floats in one file.

use super::{Layer, Picture, decode};
use crate::error::{Error, Result};
use crate::files::{self, replace_file};
use exr::meta::BlockDescription;
use exr::meta::header::Header;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, LayerAttributes, LineOrder,
    ReadChannels, ReadLayers, Text, WritableImage,
};
use std::io::BufReader;
use std::path::Path;

/// Reads a layer, or the main picture (`None`). A layer with one channel is copied to all three.
pub(super) fn read(path: &Path, layer: Option<&str>) -> Result<Picture> {
    let bad = |reason: String| Error::Input { file: path.to_owned(), place: "image".into(), reason };
    let failed = |error: exr::error::Error| {
        bad(match error {
            exr::error::Error::Io(_) => "its block table is broken; write or download it again".into(),
            error => format!("{error}; write or download it again"),
        })
    };
    let chunks = exr::block::read(BufReader::new(files::open(path).map_err(bad)?), false).map_err(failed)?;
    decode::within(bytes_needed(chunks.headers())).map_err(bad)?;
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = reader.all_attributes().from_chunks(chunks).map_err(failed)?;
    let size = image.layer_data.size;
    let channels = &image.layer_data.channel_data.list;
    let find = |name: &str| channels.iter().find(|c| c.name.eq_case_insensitive(name));
    let prefix = layer.map_or_else(String::new, |l| format!("{l}."));
    let triple = |names: [&str; 3]| -> Option<Vec<_>> { names.iter().map(|n| find(&format!("{prefix}{n}"))).collect() };
    let single = || layer.and_then(find).map(|c| vec![c; 3]);
    let found = triple(["R", "G", "B"]).or_else(|| triple(["X", "Y", "Z"]).filter(|_| layer.is_some())).or_else(single);
    let found = found.ok_or_else(|| {
        let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        let names = names.join(", ");
        bad(match layer {
            Some(layer) => format!("has no layer '{layer}'; its channels are {names}; use one of these layers"),
            None => format!("channels R, G and B are needed; its channels are {names}"),
        })
    })?;
    let mut rgb = vec![[0.0; 3]; size.area()];
    for (c, channel) in found.iter().enumerate() {
        rgb.iter_mut().zip(channel.sample_data.values_as_f32()).for_each(|(pixel, value)| pixel[c] = value);
    }
    Ok(Picture { width: size.width() as u32, height: size.height() as u32, rgb })
}

/// Peak memory \[bytes\] of reading: the samples of the largest part and their converted values, a few blocks that are
/// decompressed at the same time, and the offset tables of all parts.
fn bytes_needed(headers: &[Header]) -> u64 {
    let at_once = 2 * (rayon::current_num_threads() as u64 + 3);
    let of = |header: &Header| {
        let texel = header.channels.bytes_per_pixel as u64;
        let area = |width: usize, height: usize| (width as u64).saturating_mul(height as u64);
        let block = match header.blocks {
            BlockDescription::Tiles(tiles) => area(tiles.tile_size.width(), tiles.tile_size.height()),
            BlockDescription::ScanLines => area(header.layer_size.width(), header.compression.scan_lines_per_block()),
        };
        let all = area(header.layer_size.width(), header.layer_size.height()).saturating_mul(texel + 12);
        all.saturating_add(block.saturating_mul(texel).saturating_mul(at_once))
    };
    let places = headers.iter().fold(0, |sum: u64, header| sum.saturating_add(32 * header.chunk_count as u64));
    headers.iter().map(of).max().unwrap_or(0).saturating_add(places)
}

/// Writes a 32-bit float OpenEXR with all layers in one part, linear Rec.709. `metadata` becomes the file's comment.
///
/// # Errors
/// Fails if the file cannot be written; no partial file is left behind.
pub fn write_exr(path: &Path, width: u32, height: u32, layers: &[Layer], metadata: &str) -> Result<()> {
    let mut channels = exr::prelude::SmallVec::<[AnyChannel<FlatSamples>; 4]>::new();
    for layer in layers {
        for (channel, plane) in layer.channels.iter().zip(&layer.planes) {
            let name = if layer.name.is_empty() { (*channel).to_owned() } else { format!("{}.{channel}", layer.name) };
            channels.push(AnyChannel::new(Text::new_or_panic(&name), FlatSamples::F32(plane.clone())));
        }
    }
    let attributes = LayerAttributes {
        software_name: Text::new_or_none(concat!("lightskin ", env!("CARGO_PKG_VERSION"))),
        // One attribute only: the crate writes several in an order that changes from run to run.
        comments: Text::new_or_none(metadata),
        ..LayerAttributes::default()
    };
    let layer = exr::prelude::Layer::new(
        (width as usize, height as usize),
        attributes,
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing },
        AnyChannels::sort(channels),
    );
    let image = Image::from_layer(layer);
    replace_file(path, |file| {
        image.write().to_buffered(file).map_err(|error| match error {
            exr::error::Error::Io(error) => error,
            other => std::io::Error::other(other),
        })
    })
}
