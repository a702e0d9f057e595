//! Files of a glTF asset: the JSON or GLB container, external buffers and images, and data: URIs.

use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use serde_json::Value;

use crate::scene::accessor::Buffer;
use crate::scene::json::{Document, error_at, printable};
use crate::{Result, files};

/// Limit on the bytes of all buffers of an asset; more would not fit the engine's 32-bit indices.
const MAX_BYTES: u64 = 4 << 30;

/// Largest JSON that is parsed \[bytes\]. "0," becomes a value of 32 bytes, so parsing may need 16 times as much
/// memory.
const MAX_JSON: usize = 256 << 20;

/// Base64 with optional padding, as found in practice.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// Reads a .gltf or .glb: its JSON, checked to be glTF 2, and the binary chunk of a GLB.
pub(super) fn open(path: &Path) -> Result<(Document, Option<Vec<u8>>)> {
    let error = |reason: String| error_at(path, "file", reason);
    let bytes = files::read(path).map_err(error)?;
    if bytes.is_empty() {
        return Err(error("is empty; export or download it again".into()));
    }
    let (json, binary) = if bytes.starts_with(b"glTF") {
        let (json, binary) = chunks(&bytes).map_err(error)?;
        (json, binary.map(<[u8]>::to_vec))
    } else {
        (bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&bytes), None)
    };
    if json.trim_ascii_start().first() != Some(&b'{') {
        return Err(error("is not glTF: neither a GLB nor JSON; give a .gltf or .glb file".into()));
    }
    if json.len() > MAX_JSON {
        return Err(error("its JSON is larger than 256 MiB; keep buffers and images in separate files".into()));
    }
    let root: Value =
        serde_json::from_slice(json).map_err(|e| error(format!("its JSON is broken, export it again: {e}")))?;
    let Value::Object(root) = root else {
        return Err(error("is not glTF: its JSON is not an object; give a .gltf or .glb file".into()));
    };
    let document = Document { file: path.to_owned(), root };
    check_version(&document)?;
    Ok((document, binary))
}

/// Fails unless the file is glTF 2.x that 2.0 loaders may read.
fn check_version(document: &Document) -> Result<()> {
    let root = document.object();
    let Some(asset) = root.object("asset")? else {
        document.check_lists()?;
        return Err(root.error("is not glTF 2.0: it has no asset.version; export the file again"));
    };
    let version = asset.text("version")?.unwrap_or("none");
    let needed = asset.text("minVersion")?.unwrap_or("2.0");
    if version.split('.').next() != Some("2") {
        return Err(asset.error(format!(
            "version is '{}', 2.0 is needed; convert the file, for example by importing it to and exporting it from Blender",
            printable(version)
        )));
    }
    if needed != "2.0" {
        return Err(asset.error(format!(
            "minVersion is {}, but this program reads 2.0; export the file as 2.0",
            printable(needed)
        )));
    }
    document.check_lists()
}

/// The JSON chunk and the binary chunk of a GLB.
fn chunks(bytes: &[u8]) -> std::result::Result<(&[u8], Option<&[u8]>), String> {
    let word = |at: usize| -> Option<u32> { Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?)) };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err("the GLB ends in its header; export or download it again".into());
    };
    match version {
        2 => {}
        1 => return Err("is binary glTF 1.0; convert it to glTF 2.0".into()),
        _ => return Err(format!("is a GLB of version {version}; version 2 is needed")),
    }
    if u64::from(length) > bytes.len() as u64 {
        return Err(format!(
            "the GLB should have {length} bytes but has {}: it is truncated, export or download it again",
            bytes.len()
        ));
    }
    let end = length as usize;
    let mut at = 12;
    let mut chunk = || -> std::result::Result<Option<(u32, &[u8])>, String> {
        if at + 8 > end {
            return Ok(None);
        }
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else { return Ok(None) };
        let start = at + 8;
        if size as usize > end - start {
            return Err(format!(
                "a GLB chunk at byte {at} exceeds the file: it is truncated, export or download it again"
            ));
        }
        at = start + size as usize;
        Ok(Some((kind, &bytes[start..at])))
    };
    let json = match chunk()? {
        Some((0x4E4F_534A, json)) => json,
        _ => return Err("the GLB's first chunk is not JSON; export it again".into()),
    };
    let binary = match chunk()? {
        Some((0x004E_4942, binary)) => Some(binary),
        _ => None,
    };
    Ok((json, binary))
}

/// Contents of all buffers, each cut to its byteLength, or the reason why it has none. A missing buffer fails only when
/// it is used, since unused buffers may be placeholders.
pub(super) fn buffers(document: &Document, mut binary: Option<Vec<u8>>) -> Result<Vec<Buffer>> {
    let folder = folder(&document.file);
    let mut total = 0;
    let mut buffers = Vec::new();
    for (index, buffer) in document.items("buffers")?.into_iter().enumerate() {
        let length = buffer.needed_whole("byteLength")?;
        let bytes = match buffer.text("uri")? {
            Some(uri) => fetch(&folder, uri),
            None if index == 0 => {
                binary.take().ok_or_else(|| "has no uri, and the file has no binary chunk; export it again".into())
            }
            None => Err("has no uri; only buffer 0 of a GLB may lack it: export the file again".into()),
        };
        let bytes = bytes.and_then(|mut bytes| {
            if (bytes.len() as u64) < length {
                return Err(format!(
                    "should hold {length} bytes but holds {}: it is truncated, export or download it again",
                    bytes.len()
                ));
            }
            bytes.truncate(length as usize);
            Ok(bytes)
        });
        total += bytes.as_ref().map_or(0, Vec::len) as u64;
        if total > MAX_BYTES {
            return Err(buffer.error("the buffers hold more than 4 GiB together; split the file"));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// The folder that all of an asset's files must be in.
pub(super) fn folder(file: &Path) -> PathBuf {
    file.parent().map(Path::to_owned).unwrap_or_default()
}

/// Content of a URI: a data: URI, or a file in the asset's folder.
pub(super) fn fetch(folder: &Path, uri: &str) -> std::result::Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, data) = data.split_once(',').ok_or("its data: URI has no comma; export it again")?;
        if !kind.ends_with(";base64") {
            return Err("its data: URI is not base64; export it again".into());
        }
        return BASE64.decode(data).map_err(|e| format!("its data: URI is not valid base64, export it again: {e}"));
    }
    let path = folder.join(relative(uri)?);
    files::read(&path).map_err(|reason| format!("'{}' {reason}", printable(uri)))
}

/// Opens the content of a URI for reading in pieces.
pub(super) fn reader(folder: &Path, uri: &str) -> std::result::Result<Box<dyn Contents>, String> {
    if uri.starts_with("data:") {
        return Ok(Box::new(Cursor::new(fetch(folder, uri)?)));
    }
    let file = files::open(&folder.join(relative(uri)?)).map_err(|reason| format!("'{}' {reason}", printable(uri)))?;
    Ok(Box::new(BufReader::new(file)))
}

/// Seekable bytes of a file or in memory.
pub(super) trait Contents: BufRead + Seek {}

impl<T: BufRead + Seek> Contents for T {}

/// A relative URI as a path that stays inside the folder that it is relative to.
fn relative(uri: &str) -> std::result::Result<PathBuf, String> {
    let shown = printable(uri);
    if uri.split('/').next().is_some_and(|first| first.contains(':')) {
        return Err(format!("'{shown}' is not a relative path; put the file beside the glTF and refer to it by name"));
    }
    let name =
        decode_percent(uri).ok_or_else(|| format!("'{shown}' is not UTF-8 after percent-decoding; rename the file"))?;
    if name.is_empty() || name.starts_with('/') || name.contains(['\\', '\0']) {
        return Err(format!("'{shown}' is not a relative path with forward slashes; export the file again"));
    }
    let mut path = PathBuf::new();
    for part in name.split('/') {
        match part {
            "" | "." => {}
            ".." if path.pop() => {}
            ".." => return Err(format!("'{shown}' leaves the asset's folder; move the file into it")),
            // "C:" would be a drive on some systems, so colons are refused on all.
            _ if part.contains(':') => return Err(format!("'{shown}' has a colon in it; rename the file")),
            _ => path.push(part),
        }
    }
    Ok(path)
}

/// Percent-decodes text; a percent sign that starts no escape is kept.
fn decode_percent(text: &str) -> Option<String> {
    let hex = |byte: Option<&u8>| byte.and_then(|&b| char::from(b).to_digit(16));
    let bytes = text.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        match (bytes[at], hex(bytes.get(at + 1)), hex(bytes.get(at + 2))) {
            (b'%', Some(high), Some(low)) => {
                decoded.push((high * 16 + low) as u8);
                at += 3;
            }
            (byte, ..) => {
                decoded.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8(decoded).ok()
}

/// Extensions that the loader supports.
const SUPPORTED: [&str; 19] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

/// Fails if a required extension is not supported. Returns a note on unsupported optional extensions.
pub(super) fn check_extensions(document: &Document) -> Result<Option<String>> {
    let root = document.object();
    for name in root.texts("extensionsRequired")? {
        if SUPPORTED.contains(&name) {
            continue;
        }
        let remedy = match name {
            "EXT_texture_avif" | "MSFT_texture_dds" => "export with PNG, JPEG, WebP or KTX2 textures",
            _ if name.starts_with("KHR_materials_") => "export without this material extension or without requiring it",
            _ => "export without it",
        };
        return Err(root.error(format!("requires the extension {}, which is not supported: {remedy}", printable(name))));
    }
    let mut ignored: Vec<String> =
        root.texts("extensionsUsed")?.into_iter().filter(|name| !SUPPORTED.contains(name)).map(printable).collect();
    ignored.sort();
    ignored.dedup();
    ignored.truncate(32);
    Ok((!ignored.is_empty()).then(|| format!("Ignored extensions: {}.", ignored.join(", "))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_uris_stay_inside() {
        assert_eq!(relative("a%20b/./c.png"), Ok(PathBuf::from("a b/c.png")));
        assert_eq!(relative("a/../100%.png"), Ok(PathBuf::from("100%.png")));
        for uri in
            ["../a", "a/../../b", "/etc/passwd", "%2e%2e/a", "http://x/y", "file:///a", "C:/a", "a\\b", "", "%00"]
        {
            assert!(relative(uri).is_err(), "{uri}");
        }
    }

    #[test]
    fn data_uris_decode() {
        assert_eq!(fetch(Path::new(""), "data:application/octet-stream;base64,AAEC"), Ok(vec![0, 1, 2]));
        assert_eq!(fetch(Path::new(""), "data:;base64,AAE"), Ok(vec![0, 1]));
        assert!(fetch(Path::new(""), "data:;base64,%%").is_err());
        assert!(fetch(Path::new(""), "data:text/plain,abc").is_err());
    }
}
