//! Packed files: meshopt, Draco, Basis Universal and WebP. They unpack to the original data, and errors in them end in
//! one line. `fuzz` damages them at random.

use std::path::Path;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use glam::{DVec3, Vec3};
use lightskin::scene::{Scene, gltf};
use serde_json::{Value, json};

use crate::common::{Builder, PNG, data};
use crate::malformed::check;

const DRACO: &str = "KHR_draco_mesh_compression";
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

fn bytes(base64: &str) -> Vec<u8> {
    BASE64_STANDARD.decode(base64).expect("is base64")
}

/// 2 x 2 squares in the unit square, packed by the reference encoder. POSITION, NORMAL, TEXCOORD_0 (x, 1 - y) and
/// COLOR_0 (200 x, 200 y, 50, 255) are the attributes 0 to 3. First edgebreaker, then sequential encoding.
const GRIDS: [&str; 2] = [
    "RFJBQ08CAgEBAAAACQgDCAIAA3/aB/8BEf8CiED/AohA/wKIQAT/AAAAAAABAAACAAABAAkDAAACAQEJAwABAwEDCQIAAgIBAgIEAAMBAQEBAAwDrSoj\
     VRUDKmJM//8/AP4PAAAA4P8AAAAAAAAAAP8HAAAAAAAAAAAAAAAAAAAAAIA/CwADAQEBgAFxPP/3kQMDoMyK/wAAAH8AAAAIAQEBAAsDrSofVRUDKmJM\
     ////PwAA+A8IAAAAAP8DAAAAAAAAAAAAAAAAgD8KAQEBAQLJAVE1yQH/h8kB/4eRA5EDB6jYxfdvv4EAAAAA/wAAAA==",
    "RFJBQ08CAgEAAAAICQEAAQQABAMBAgUBBQQDBAcDBwYEBQgECAcBBAAJAwAAAQkDAAEDCQIAAgICBAADAgMCAQABAQAMAx0HI+U4AwTghfg/AADgfwAA\
     QAD/B8D/AQAA/wMAAALwPwD+DwAA+B8AAAAAAAAA/wcAAAADAQEBgAFxPP/3kQMDoMyK/wAAAH8AAAAAAQEACwMdBx/lOAME4IX+D4D/AAjQ//8A+A+A\
     AP//D4D/AAAAAAAA/wMAAAABAQECyQGpKskB/4fJASuRA/9bOQ4JfjKdZWewoLCAAAAAAP8AAAAAAAAAAAAAAAAAAAAAAIA/CwgAAAAAAAAAAAAAgD8K",
];

/// 8 x 8 texels: red 230 left and 20 right, green 200 above and 30 below, blue 60, alpha 255 left and 0 right. From the
/// reference encoders: ETC1S, UASTC, UASTC in zstd, WebP, lossless WebP.
const TEXTURES: [&str; 5] = [
    "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAADwAAACkAAAAJAAAAMgAAAAAAAAAlgAAAAAAAABeAQAAAAAA\
     AAQAAAAAAAAAAAAAAAAAAAA8AAAAAAAAAAIAOACjAQIAAwMAAAgIAAAAAAAAAAA/AAAAAAAAAAAA/////0AAPw8AAAAAAAAAAP////8fAAAAS1RYd3Jp\
     dGVyAEJhc2lzIFVuaXZlcnNhbCAyLjUwAAAGAAMAMgAAAA0AAAAvAAAAAAAAAAAAAAAAAAAAAgAAAAIAAAACAAAAIECUAAAAAEAQfjBRiAAmAgAAAAAA\
     kAUJQASAAAAAQNCchABMAQAAAACAQFmAqtMOHg5UVVVVBQAAAKiqqqoCAMFEAAAAAAAAkuq/ggEwBUAAAAAAgGQgASYEDAAAAIKw6aMQAEwAAAAAAAAg\
     gADrAzgB",
    "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAAAAAAAaAAAACwAAACUAAAALAAAAAAAAAAAAAAAAAAAAAAAAADAAAAAAAAA\
     AEAAAAAAAAAAQAAAAAAAAAAsAAAAAAAAAAIAKACmAQIAAwMAABAAAAAAAAAAAAB/AwAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFzaXMgVW5pdmVy\
     c2FsIDIuNTAAAAQAAAB/fwAA1xyZ5z/VtgAAAAAAAAAAAJcCmQfgQ74BAAAAAAAAAADX3IPnX3ujAAAAAAAAAAAAl8KDB6AwZwEAAAAAAAAAAA==",
    "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAACAAAAaAAAACwAAACUAAAAJAAAAAAAAAAAAAAAAAAAAAAAAAC4AAAAAAAA\
     ADIAAAAAAAAAQAAAAAAAAAAsAAAAAAAAAAIAKACmAQIAAwMAABAAAAAAAAAAAAB/AwAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFzaXMgVW5pdmVy\
     c2FsIDIuNTAAACi1L/0gQE0BAOjXHJnnP9W2AJcCmQfgQ74B19yD5197o8KDB6AwZwQAoJShtplJOAG4",
    "UklGRoAAAABXRUJQVlA4WAoAAAAQAAAABwAABwAAQUxQSAsAAAABDzD/ERGiDxH9DwBWUDggTgAAANACAJ0BKggACAABQCYlsAJ0R//uAG8AfoADIJiS\
     2AAA/viwb8OuVoP/v3/BcMVwx+pN/P5P0tWWr/+Jj6C9tN/8Fv9FW//7l/8PTnf0AA==",
    "UklGRj4AAABXRUJQVlA4TDEAAAAvB8ABEB8gkE1Okv8iFggQInT471A0PAKCIv9Hi8weJCho24YpyZIsybeBiOh/yJ/4AA==",
];

/// Adds a buffer view packed with meshopt. Its fallback buffer has no data.
fn packed(b: &mut Builder, name: &str, mode: &str, filter: &str, [count, stride]: [usize; 2], data: &[u8]) -> usize {
    let view = b.view(data);
    if b.json["buffers"].as_array().expect("a list").len() == 1 {
        b.push("buffers", json!({"byteLength": 1 << 20, "extensions": {name: {"fallback": true}}}));
    }
    let mut extension = b.json["bufferViews"][view].clone();
    for (key, value) in
        [("mode", json!(mode)), ("filter", json!(filter)), ("count", json!(count)), ("byteStride", json!(stride))]
    {
        extension[key] = value;
    }
    let mut view_json = json!({"buffer": 1, "byteLength": count * stride, "extensions": {name: extension}});
    if mode == "ATTRIBUTES" {
        view_json["byteStride"] = json!(stride);
    }
    b.json["bufferViews"][view] = view_json;
    view
}

fn accessor(b: &mut Builder, view: usize, component: u32, kind: &str, count: usize, normalized: bool) -> Value {
    json!(b.push(
        "accessors",
        json!({"bufferView": view, "componentType": component, "type": kind, "count": count, "normalized": normalized})
    ))
}

/// A square of two triangles, drawn twice, packed with all modes and filters.
fn square(name: &str, version: i32, wide: bool) -> Builder {
    fn encoded<T>(vertices: &[T], version: i32) -> Vec<u8> {
        meshopt::encode_vertex_buffer_level(vertices, 2, Some(version)).expect("encodes")
    }
    let mut b = Builder::new();
    b.json["extensionsRequired"] = json!([name]);
    let positions = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let exponential = meshopt::encode_filter_exp(&positions, 20, meshopt::EncodeExpMode::SharedVector);
    let view = packed(&mut b, name, "ATTRIBUTES", "EXPONENTIAL", [4, 12], &encoded(&exponential, version));
    b.primitive()["attributes"]["POSITION"] = accessor(&mut b, view, 5126, "VEC3", 4, false);

    let normals = [[0.0_f32, 0.6, 0.8, 0.0]; 4];
    let (stride, octahedral) = if wide {
        (8, encoded(&meshopt::encode_filter_oct::<i16>(&normals, 12), version))
    } else {
        (4, encoded(&meshopt::encode_filter_oct::<i8>(&normals, 8), version))
    };
    let view = packed(&mut b, name, "ATTRIBUTES", "OCTAHEDRAL", [4, stride], &octahedral);
    let component = if wide { 5122 } else { 5120 };
    b.primitive()["attributes"]["NORMAL"] = accessor(&mut b, view, component, "VEC3", 4, true);

    let colors = [[1.0_f32, 0.5, 0.25, 1.0]; 4];
    let (stride, color) = if wide {
        (8, encoded(&meshopt::encode_filter_color::<u16>(&colors, 16), version))
    } else {
        (4, encoded(&meshopt::encode_filter_color::<u8>(&colors, 8), version))
    };
    let view = packed(&mut b, name, "ATTRIBUTES", "COLOR", [4, stride], &color);
    let component = if wide { 5123 } else { 5121 };
    b.primitive()["attributes"]["COLOR_0"] = accessor(&mut b, view, component, "VEC4", 4, true);

    let uvs = positions.map(|[x, y, _]| [x, 1.0 - y]);
    let view = packed(&mut b, name, "ATTRIBUTES", "NONE", [4, 8], &encoded(&uvs, version));
    b.primitive()["attributes"]["TEXCOORD_0"] = accessor(&mut b, view, 5126, "VEC2", 4, false);

    let indices = [0, 1, 2, 0, 2, 3];
    let (size, component) = if wide { (4, 5125) } else { (2, 5123) };
    let view = if version == 0 {
        let triangles = meshopt::encode_index_buffer(&indices, 4).expect("encodes");
        packed(&mut b, name, "TRIANGLES", "NONE", [6, size], &triangles)
    } else {
        let sequence = meshopt::encode_index_sequence(&indices, 4).expect("encodes");
        packed(&mut b, name, "INDICES", "NONE", [6, size], &sequence)
    };
    b.primitive()["indices"] = accessor(&mut b, view, component, "SCALAR", 6, false);

    let half = std::f32::consts::FRAC_1_SQRT_2;
    let turns = meshopt::encode_filter_quat(&[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, half, half]], 16);
    let view = packed(&mut b, name, "ATTRIBUTES", "QUATERNION", [2, 8], &encoded(&turns, version));
    let rotation = accessor(&mut b, view, 5122, "VEC4", 2, true);
    b.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"ROTATION": rotation}}});
    b
}

#[test]
fn meshopt_views_hold_what_was_packed() {
    for (name, version, wide) in
        [(MESHOPT[0], 0, false), (MESHOPT[0], 0, true), (MESHOPT[1], 1, false), (MESHOPT[1], 1, true)]
    {
        let scene = square(name, version, wide).load("meshopt").expect("is valid");
        check(&scene, Path::new("meshopt"));
        assert_eq!((scene.meshes.len(), scene.instances.len(), scene.notes.len()), (1, 2, 0), "{:?}", scene.notes);
        let mesh = &scene.meshes[0];
        let corners: Vec<Vec3> = (0..2).flat_map(|t| mesh.triangle(t)).map(|c| mesh.vertices[c].position).collect();
        let expected =
            [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]].map(|[x, y]| Vec3::new(x as f32, y as f32, 0.0));
        // The decoder may rotate the corners of a triangle.
        assert_eq!(corners.len(), expected.len());
        assert!(
            expected
                .iter()
                .all(|e| corners.iter().filter(|c| *c == e).count() == expected.iter().filter(|o| *o == e).count())
        );
        for vertex in &mesh.vertices {
            assert!((vertex.normal - Vec3::new(0.0, 0.6, 0.8)).length() < 0.02, "{}", vertex.normal);
            assert_eq!((vertex.uv0.x, vertex.uv0.y), (vertex.position.x, 1.0 - vertex.position.y));
            assert!(
                vertex.color.iter().zip([255, 128, 64, 255]).all(|(&c, e): (_, i32)| (i32::from(c) - e).abs() <= 3)
            );
        }
        let turned = scene.instances[1].world_from_model.transform_vector3(DVec3::X);
        assert!((turned - DVec3::Y).length() < 1e-3, "{turned}");
    }
}

#[test]
fn meshopt_that_decoders_do_not_take_is_refused() {
    let changes: [(&str, Value, &str); 12] = [
        ("byteStride", json!(0), "0 bytes"),
        ("byteStride", json!(14), "14 bytes"),
        ("byteStride", json!(260), "260 bytes"),
        ("byteStride", json!(u64::MAX), "bytes with mode Attributes"),
        ("count", json!(0), "0 elements"),
        ("count", json!(4294967295_u64), "--max-memory"),
        ("count", json!(5000), "broken or cut off"),
        ("mode", json!("TRIANGLES"), "mode Triangles"),
        ("mode", json!("OTHER"), "unknown mode OTHER"),
        ("filter", json!("QUATERNION"), "filter Quaternion"),
        ("filter", json!("OTHER"), "unknown filter OTHER"),
        ("byteLength", json!(1 << 30), "truncated"),
    ];
    for (key, value, told) in changes {
        let mut b = square(MESHOPT[0], 0, false);
        b.json["bufferViews"][0]["extensions"][MESHOPT[0]][key] = value;
        let message = b.error("meshopt_refused");
        assert!(message.contains(told) && message.contains("buffer view 0: extensions: EXT_meshopt"), "{message}");
    }
    // The buffer without data causes an error where something needs it.
    let mut b = square(MESHOPT[0], 0, false);
    b.json["bufferViews"][0]["extensions"] = json!({});
    assert!(b.error("meshopt_fallback").contains("buffer 1: has no uri"));
}

/// A primitive whose accessors are filled only by a Draco stream.
fn draco(stream: &[u8]) -> Builder {
    let mut b = Builder::new();
    b.json["extensionsRequired"] = json!([DRACO]);
    let view = b.view(stream);
    let kinds =
        [("POSITION", "VEC3", 5126), ("NORMAL", "VEC3", 5126), ("TEXCOORD_0", "VEC2", 5126), ("COLOR_0", "VEC4", 5121)];
    for (name, kind, component) in kinds {
        let accessor = json!({"componentType": component, "type": kind, "count": 9, "normalized": component == 5121});
        b.primitive()["attributes"][name] = json!(b.push("accessors", accessor));
    }
    let indices = b.push("accessors", json!({"componentType": 5123, "type": "SCALAR", "count": 24}));
    b.primitive()["indices"] = json!(indices);
    b.primitive()["extensions"] = json!({DRACO: {"bufferView": view,
        "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "COLOR_0": 3}}});
    b
}

#[test]
fn draco_streams_hold_what_was_packed() {
    for grid in GRIDS {
        let scene = draco(&bytes(grid)).load("draco").expect("is valid");
        check(&scene, Path::new("draco"));
        assert!(scene.notes.is_empty(), "{:?}", scene.notes);
        let mesh = &scene.meshes[0];
        assert_eq!((mesh.vertices.len(), mesh.triangle_count()), (9, 8));
        for vertex in &mesh.vertices {
            let Vec3 { x, y, z } = vertex.position;
            assert!([x, y].iter().all(|v| [0.0, 0.5, 1.0].iter().any(|e| (v - e).abs() < 1e-3)) && z.abs() < 1e-3);
            assert!((vertex.normal - Vec3::Z).length() < 0.02, "{}", vertex.normal);
            assert!((vertex.uv0.x - x).abs() < 2e-3 && (vertex.uv0.y - 1.0 + y).abs() < 2e-3, "{}", vertex.uv0);
            let [r, g, b, a] = vertex.color.map(f32::from);
            assert!((r - 200.0 * x).abs() < 1.0 && (g - 200.0 * y).abs() < 1.0 && (b, a) == (50.0, 255.0));
        }
        let area: f32 = (0..8)
            .map(|t| mesh.triangle(t).map(|c| mesh.vertices[c].position))
            .map(|[a, b, c]| 0.5 * (b - a).cross(c - a).z)
            .sum();
        assert!((area - 1.0).abs() < 1e-3, "{area}");
    }
}

#[test]
fn draco_that_does_not_fit_the_file_is_refused() {
    let grid = bytes(GRIDS[0]);
    let changes: [(&str, Value, &str); 8] = [
        ("/mode", json!(5), "only triangle lists"),
        ("/indices", Value::Null, "no indices"),
        ("/indices", json!(9), "refers to accessor 9"),
        ("/extensions/KHR_draco_mesh_compression/bufferView", json!(7), "refers to buffer view 7"),
        ("/extensions/KHR_draco_mesh_compression/attributes/NORMAL", json!(77), "no such attribute"),
        ("/extensions/KHR_draco_mesh_compression/attributes/TEXCOORD_1", json!(2), "which the primitive lacks"),
        (
            "/extensions/KHR_draco_mesh_compression/attributes/TEXCOORD_0",
            json!(1),
            "is VEC2, but its stream has 3 components",
        ),
        ("/attributes/TEXCOORD_0", json!(0), "another Draco stream"),
    ];
    for (at, value, told) in changes {
        let mut b = draco(&grid);
        let (parent, key) = at.rsplit_once('/').expect("is a pointer");
        b.primitive().pointer_mut(parent).expect("is there")[key] = value;
        let message = b.error("draco_refused");
        assert!(message.contains(told), "{at}: {message}");
    }
    // If the extension is not required, the uncompressed data is read.
    let mut b = Builder::triangle();
    let view = b.view(&grid);
    b.primitive()["extensions"] = json!({DRACO: {"bufferView": view, "attributes": {"POSITION": 0}}});
    assert_eq!(b.load("draco_besides").expect("is valid").triangle_count(), 1);
}

/// A triangle with a texture of these bytes, referenced by an extension or by glTF's own field.
fn textured(texture: &[u8], extension: Option<&str>) -> Builder {
    let mut b = Builder::triangle();
    b.attribute("TEXCOORD_0", "VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    b.primitive()["material"] = json!(0);
    let (fallback, view) = (b.view(PNG), b.view(texture));
    b.json["images"] =
        json!([{"bufferView": fallback, "mimeType": "image/png"}, {"name": "packed", "bufferView": view}]);
    b.json["textures"] = match extension {
        Some(name) => json!([{"source": 0, "extensions": {name: {"source": 1}}}]),
        None => json!([{"source": 1}]),
    };
    b.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    b
}

/// Whether a scene has the image of `TEXTURES`.
fn is_texture(scene: &Scene) -> bool {
    let [image] = scene.images.as_slice() else { panic!("one image, but {:?}", scene.notes) };
    assert_eq!((image.width, image.height, image.rgba.len()), (8, 8, 256), "{:?}", scene.notes);
    image.rgba.chunks_exact(4).enumerate().all(|(at, texel)| {
        let (x, y) = (at % 8, at / 8);
        let expected = [if x < 4 { 230 } else { 20 }, if y < 4 { 200 } else { 30 }, 60, if x < 4 { 255 } else { 0 }];
        // Invisible texels may have any colour, and lossy formats blur edges of colours.
        let colored = x < 3 && !(3..5).contains(&y);
        (if colored { 0..4 } else { 3..4 }).all(|c| (i32::from(texel[c]) - expected[c]).abs() <= 16)
    })
}

#[test]
fn textures_are_unpacked() {
    for texture in TEXTURES.map(bytes) {
        let name = if texture.starts_with(b"RIFF") { "EXT_texture_webp" } else { "KHR_texture_basisu" };
        for extension in [Some(name), None] {
            let mut b = textured(&texture, extension);
            b.json["extensionsRequired"] = json!([name]);
            let scene = b.load("texture").expect("is valid");
            assert!(is_texture(&scene), "{name}: {:?}", scene.images[0].rgba);
            assert!(scene.notes.is_empty(), "{:?}", scene.notes);
        }
    }
}

#[test]
fn textures_that_do_not_decode_are_told() {
    let [_, uastc, packed, ..] = TEXTURES.map(bytes);
    let note = |texture: &[u8]| {
        let scene = textured(texture, Some("KHR_texture_basisu")).load("texture_broken").expect("has its triangle");
        assert!(scene.images.is_empty());
        scene.notes.join(" ")
    };
    let changed = |texture: &[u8], at: usize, byte: u8| {
        let mut texture = texture.to_vec();
        texture[at] = byte;
        note(&texture)
    };
    // Two frames of 2 x 2 texels.
    let moving = "UklGRoQAAABXRUJQVlA4WAoAAAACAAAAAQAAAQAAQU5JTQYAAAAAAAAAAABBTk1GKAAAAAAAAAAAAAEAAAEAAAAAAAJWUDhMDwAAAC8BQAAABxD9j/4HIqL/AQBBTk1GKAAAAAAAAAAAAAEAAAEAAAAAAABWUDhMDwAAAC8BQAAAB9D/iP4HIqL/AQA=";
    assert!(note(&bytes(moving)).contains("an animation"));
    assert!(note(b"hello, world").contains("neither PNG, JPEG, WebP nor KTX2"));
    assert!(changed(&uastc, 12, 37).contains("neither ETC1S nor UASTC"));
    assert!(changed(&uastc, 36, 6).contains("no 2D texture"));
    assert!(changed(&uastc, 22, 1).contains("16384 x 16384 are possible"));
    assert!(changed(&uastc, 20, 9).contains("truncated: 64 bytes of 96"));
    assert!(changed(&uastc, 48, 255).contains("container is broken"));
    assert!(changed(&packed, 184, 0).contains("broken zstd"));
    assert!(note(&packed[..packed.len() - 9]).contains("container is broken"));
}

/// Files with packed data, and the offset of that data in the binary chunk. In files with textures it follows the
/// triangle and the PNG.
pub(crate) fn packed_files() -> Vec<(Builder, usize)> {
    let mut files: Vec<(Builder, usize)> = Vec::new();
    files.extend([square(MESHOPT[0], 0, false), square(MESHOPT[1], 1, true)].map(|b| (b, 0)));
    files.extend(GRIDS.map(|grid| (draco(&bytes(grid)), 0)));
    files.extend(TEXTURES.map(bytes).map(|texture| {
        let b = textured(&texture, Some("KHR_texture_basisu"));
        let start = b.binary.len() - texture.len();
        (b, start)
    }));
    files
}

#[test]
fn streams_that_are_cut_off_are_refused() {
    for (mut b, whole) in [(square(MESHOPT[0], 0, false), Vec::new()), (draco(&bytes(GRIDS[0])), bytes(GRIDS[0]))] {
        let path = match whole.is_empty() {
            true => format!("/bufferViews/0/extensions/{}/byteLength", MESHOPT[0]),
            false => "/bufferViews/0/byteLength".into(),
        };
        let length = b.json.pointer(&path).and_then(Value::as_u64).expect("is there");
        for cut in 0..length {
            *b.json.pointer_mut(&path).expect("is there") = json!(cut);
            b.error("compressed_cut");
        }
    }
    for texture in TEXTURES.map(bytes) {
        for cut in (0..texture.len()).step_by(7) {
            let scene = textured(&texture[..cut], Some("EXT_texture_webp")).load("compressed_cut").expect("a triangle");
            check(&scene, Path::new("compressed_cut"));
        }
    }
}

#[test]
fn boxes_of_other_encoders_are_boxes() {
    let Some(data) = data() else { return };
    for name in ["Box_Draco", "BoxMeshopt"] {
        let path = data.join(format!("scenes/features/required_ext/{name}.glb"));
        let scene = gltf::load(&path).unwrap_or_else(|error| panic!("{error}"));
        check(&scene, &path);
        let mesh = &scene.meshes[0];
        assert_eq!((mesh.vertices.len(), scene.triangle_count()), (24, 12), "{name}");
        let world = scene.instances[0].world_from_model;
        for vertex in &mesh.vertices {
            let corner = world.transform_point3(vertex.position.as_dvec3());
            assert!((corner.abs() - DVec3::splat(0.5)).length() < 1e-2, "{name}: {corner}");
        }
    }
}
