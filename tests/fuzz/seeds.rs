//! The files from which mutants are made.

use crate::cli::{folder, works};
use crate::common::{data, glb, gltf_files};
use crate::{compressed, malformed};
use exr::prelude::{
    Compression, Encoding, Image, Layer, LayerAttributes, LineOrder, SpecificChannels, Vec2, WritableImage,
};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};

/// What the tool does with a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Scene,
    Sky,
    Picture,
    Bake,
    Samples,
    Session,
}

/// A valid file, or a hostile file that is correctly refused.
pub(super) struct Seed {
    pub(super) kind: Kind,
    /// File name of its mutants.
    pub(super) name: String,
    pub(super) bytes: Vec<u8>,
    /// Offset of packed data in the binary chunk.
    pub(super) packed: Option<usize>,
    /// Folder of the files that it refers to.
    pub(super) beside: Option<PathBuf>,
}

impl Seed {
    fn new(kind: Kind, name: &str, bytes: Vec<u8>) -> Self {
        Self { kind, name: name.into(), bytes, packed: None, beside: None }
    }
}

/// Our own scenes. The first uses a bit of everything.
pub(super) fn scenes() -> Vec<Seed> {
    let rich = malformed::rich();
    let mut seeds = vec![Seed::new(Kind::Scene, "mutant.glb", glb(&rich.json, &rich.binary))];
    seeds.extend(compressed::packed_files().into_iter().map(|(b, start)| Seed {
        packed: Some(start),
        ..Seed::new(Kind::Scene, "mutant.glb", glb(&b.json, &b.binary))
    }));
    seeds
}

/// The small scenes in these folders of the test data.
fn scenes_of_data(folders: &[&str]) -> Vec<Seed> {
    let Some(data) = data() else { return scenes() };
    let paths = folders.iter().flat_map(|folder| gltf_files(&data.join(folder)));
    let small = paths.filter(|path| fs::metadata(path).is_ok_and(|file| file.len() < 1_000_000));
    let seed = |path: PathBuf| {
        let is_binary = path.extension().is_some_and(|e| e == "glb");
        let bytes = fs::read(&path).expect("test data is readable");
        let beside = path.parent().filter(|_| !is_binary).map(Path::to_owned);
        Seed { beside, ..Seed::new(Kind::Scene, if is_binary { "mutant.glb" } else { "mutant.gltf" }, bytes) }
    };
    small.map(seed).collect()
}

const SIZE: [usize; 2] = [16, 8];

/// OpenEXR pictures with every compression that the reader supports.
fn exr_files() -> Vec<Vec<u8>> {
    let packings = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
    ];
    let file = |compression| {
        let texel = |Vec2(x, y): Vec2<usize>| (x as f32 * 0.1, y as f32, 0.5_f32);
        let encoding = Encoding { compression, line_order: LineOrder::Increasing, ..Encoding::UNCOMPRESSED };
        let layer = Layer::new((SIZE[0], SIZE[1]), LayerAttributes::named(""), encoding, SpecificChannels::rgb(texel));
        let mut bytes = std::io::Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).expect("in memory");
        bytes.into_inner()
    };
    packings.map(file).to_vec()
}

/// Radiance pictures: one with plain texels, one run-length encoded.
fn hdr_files() -> [Vec<u8>; 2] {
    let header = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n", SIZE[1], SIZE[0]).into_bytes();
    let flat = [header.clone(), [100, 120, 140, 128].repeat(SIZE[0] * SIZE[1])].concat();
    let row = [vec![2, 2, 0, SIZE[0] as u8], [128 + SIZE[0] as u8, 128].repeat(4)].concat();
    [flat, [header, row.repeat(SIZE[1])].concat()]
}

/// A session as the window writes it.
fn session() -> Vec<u8> {
    let session = json!({
        "lightskin_session": 1, "arguments": ["box.glb", "--quality", "low", "--caches", "20"],
        "settings": ["--rsm", "8", "--shadows", "proxy"], "camera": "0,1,3;0,1,0;0,1,0;50",
        "bookmarks": [null, "0"], "exposure": 3.0,
        "animation": { "clip": null, "time": 0.0, "speed": 1.0 },
        "lights": [{ "name": "a", "on": true, "color": [1.0, 0.5, 0.2], "intensity": 3.0, "radius": 0.1 }],
        "materials": { "white": { "base_color": [0.1, 0.2, 0.9, 1.0], "roughness": 0.5, "metallic": 0.0,
                                  "emissive": [0.0, 0.0, 0.0] } },
        "hidden": ["box"],
    });
    session.to_string().into_bytes()
}

/// A scene for testing kept files and sessions: two triangles that see each other.
pub(super) const BOX: &str = "box.glb";

pub(super) fn write_box(folder: &Path) {
    let rich = malformed::rich();
    fs::write(folder.join(BOX), glb(&rich.json, &rich.binary)).expect("the target folder is writable");
}

/// A bake and samples as the tool keeps them.
fn kept_files() -> Vec<Seed> {
    let at = folder("fuzz/kept");
    write_box(&at);
    works(&at, &[&["bake", BOX][..], &super::run::CACHES].concat());
    works(&at, &super::run::PATH_TRACE);
    let files = fs::read_dir(at.join("cache/lightskin")).expect("kept files");
    let seed = |path: PathBuf| {
        let kind = match path.extension()?.to_str()? {
            "caches" => Kind::Bake,
            "samples" => Kind::Samples,
            _ => return None,
        };
        Some(Seed::new(kind, path.file_name()?.to_str()?, fs::read(&path).expect("a kept file")))
    };
    let seeds: Vec<Seed> = files.filter_map(|file| seed(file.expect("a kept file").path())).collect();
    assert!([Kind::Bake, Kind::Samples].iter().all(|kind| seeds.iter().any(|seed| seed.kind == *kind)));
    seeds
}

/// Seeds of every kind, with the weights of the kinds.
pub(super) fn all() -> Vec<(usize, Vec<Seed>)> {
    let exr: Vec<Vec<u8>> = exr_files();
    let bomb = data().map(|data| fs::read(data.join("repro/exr_bomb_100k.exr")).expect("test data is readable"));
    let named = |kind, name: &str, files: Vec<Vec<u8>>| -> Vec<Seed> {
        files.into_iter().map(|bytes| Seed::new(kind, name, bytes)).collect()
    };
    let mut skies = named(Kind::Sky, "mutant.exr", exr.iter().cloned().chain(bomb).collect());
    skies.extend(named(Kind::Sky, "mutant.hdr", hdr_files().to_vec()));
    let pictures = named(Kind::Picture, "mutant.exr", exr);
    let (bakes, samples): (Vec<Seed>, Vec<Seed>) = kept_files().into_iter().partition(|seed| seed.kind == Kind::Bake);
    let sessions = named(Kind::Session, "mutant.json", vec![session()]);
    vec![
        (50, scenes()),
        (60, scenes_of_data(&["scenes/features", "scenes/cornell"])),
        (20, scenes_of_data(&["malformed", "repro"])),
        (24, skies),
        (12, pictures),
        (20, bakes),
        (20, samples),
        (4, sessions),
    ]
}
