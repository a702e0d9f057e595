//! The Vulkan layer on its own: shaders, images, and refused calls. Lifetimes of objects are tested in `lifetimes`.

#[path = "../build/variants.rs"]
mod variants;

use crate::common::{apart, assert_clean, compile, from_spirv, gpu, open};
use lightskin::gpu::{
    Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Extent, Format, Gpu, Image, ImageDesc, Load, Pipeline, Raster,
    SamplerKind, Shape, Stream, Use, Validation,
};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Adds a number to the red channel of an image's first texel and writes the sum to a buffer.
const ADD: &str = "#version 460
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x = 1) in;
layout(constant_id = 0) const uint MORE = 0u;
layout(binding = 0, scalar) writeonly buffer Out { float sum; };
layout(binding = 1) uniform sampler2D image;
void main() { sum = texelFetch(image, ivec2(0), 0).r + float(MORE); }
";

/// Makes a pipeline from `ADD`.
pub(crate) fn add(gpu: &Gpu, more: u32) -> Pipeline {
    from_spirv(gpu, "test.add", &compile(ADD).expect("compiles"), &[more]).expect("pipeline")
}

/// Draws depth on the whole screen.
pub(crate) const SCREEN: Raster<'_> = Raster {
    vertex: "screen.vert",
    fragment: None,
    shape: Shape::Triangles,
    streams: &[],
    colors: &[],
    blend: Blend::Replace,
    depth: Depth::Nearest,
    cull: Cull::None,
    multisampled: false,
    constants: &[],
};

/// Devices with each kind of validation.
pub(crate) fn validated() -> impl Iterator<Item = Gpu> {
    [Validation::Core, Validation::Sync].into_iter().map(open)
}

/// Copies have the content of the time when they were begun, whatever later frames do, and another thread takes them.
#[test]
fn copies_are_taken_later() {
    if apart() {
        return;
    }
    for gpu in validated() {
        let first: Vec<u32> = (0..1000).collect();
        let buffer = gpu.buffer_from("test.numbers", &first).expect("buffer");
        let [copy, same] = gpu
            .begin("test", |cmd| Ok([cmd.read_buffer::<u32>(&buffer)?, cmd.read_buffer::<u32>(&buffer)?]))
            .expect("begun");
        for _ in 0..3 {
            let frame = gpu.frame(|cmd| {
                cmd.clear(&buffer);
                Ok(())
            });
            assert_eq!(frame.expect("submitted").problems, [""; 0]);
        }
        assert_eq!(std::thread::spawn(|| copy.take()).join().expect("ended").expect("read"), first);
        assert_eq!(same.take().expect("read"), first);
        assert_eq!(gpu.read::<u32>(&buffer).expect("read"), [0; 1000]);
        // Commands that were not submitted copy nothing.
        let mut none = None;
        let failed = gpu.begin("test", |cmd| {
            none = Some(cmd.read_buffer::<u32>(&buffer)?);
            Err::<(), _>(lightskin::Error::Nothing("test".into()))
        });
        assert!(failed.is_err());
        assert!(catch_unwind(AssertUnwindSafe(|| none.expect("made").take())).is_err());
        assert_clean(&gpu);
    }
}

#[test]
fn variants_of_shaders_are_checked() {
    let of = |text: &str| {
        let other = ("other.comp".to_owned(), "void main() {}".to_owned());
        variants::entries(&[("sum.comp".to_owned(), text.to_owned()), other])
    };
    let all = of(
        "// Sums.\n// variant sum_all.comp: ALL FAST (where all are lit)\n#ifdef ALL\n#endif\n#ifndef FAST\n#endif\n",
    );
    let all = all.expect("right");
    assert_eq!(all.keys().collect::<Vec<_>>(), ["other.comp", "sum.comp", "sum_all.comp"]);
    let (plain, all) = (&all["sum.comp"], &all["sum_all.comp"]);
    assert_eq!((plain.file.as_str(), plain.defines.len()), ("sum.comp", 0));
    assert_eq!((all.file.as_str(), &all.defines[..]), ("sum.comp", &["ALL".to_owned(), "FAST".to_owned()][..]));

    let refused = |line: &str, why: &str| {
        let error = of(&format!("// Sums.\n{line}\n#ifdef ALL\n#endif\n")).expect_err(line);
        assert!(error.starts_with("glsl/sum.comp:") && error.contains(why), "{line}: {error}");
        error
    };
    assert!(refused("// variant sum_all.comp ALL (no colon)", "NAME: DEFINE").starts_with("glsl/sum.comp:2: "));
    refused("// variant sum_all.comp: ALL", "what it is for");
    refused("// variant sum_all.comp: (nothing)", "NAME: DEFINE");
    refused("// variant sum_all.comp: all (small letters)", "NAME: DEFINE");
    refused("// variant sum_all.frag: ALL (a stage of its own)", "another stage");
    refused("// variant sum_all.comp: AL (misspelt)", "nothing in the file asks for");
    refused("// variant other.comp: ALL (a file)", "is there already: glsl/other.comp");
    let twice = "// variant a.comp: ALL (once)\n// variant a.comp: ALL (twice)";
    assert!(refused(twice, "is there already: glsl/sum.comp:2").starts_with("glsl/sum.comp:3: "));
}

#[test]
fn what_is_no_shader_is_refused() {
    let gpu = gpu();
    let code = compile(ADD).expect("compiles");
    let without_magic = [&[0], &code[1..]].concat();
    let mut endless = code.clone();
    endless[5] &= 0xffff; // an instruction with zero words
    for wrong in [&[][..], &code[..4], &code[..5], &code[..6], &code[..code.len() - 1], &without_magic, &endless] {
        let error = from_spirv(&gpu, "test.wrong", wrong, &[]).err().expect("refused");
        assert!(error.to_string().contains("not a SPIR-V module"), "{error}");
    }
    assert_clean(&gpu);
}

#[test]
fn groups_are_as_large_as_their_constants_say() {
    const COUNT: &str = "#version 460
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x_id = 1, local_size_y = 2) in;
layout(binding = 0, scalar) buffer Out { uint count; };
void main() { atomicAdd(count, 1u); }
";
    let gpu = gpu();
    let code = compile(COUNT).expect("compiles");
    for threads in [1, 8, 32] {
        let count = gpu.buffer_from("test.count", &[0_u32]).expect("buffer");
        let pipeline = from_spirv(&gpu, "test.count", &code, &[0, threads]).expect("pipeline");
        gpu.run_once("count", |cmd| {
            cmd.bind(&pipeline, &[(&count).into()]);
            cmd.dispatch(64, 4, 1);
        })
        .expect("run");
        assert_eq!(gpu.read::<u32>(&count).expect("read")[0], 64 * 4);
    }
    assert_clean(&gpu);
}

#[test]
fn groups_larger_than_the_device_allows_are_refused() {
    let gpu = gpu();
    for threads in [0, 1 << 20] {
        let error = gpu.compute("gather_clusters.comp", &[0, 0, 1, threads]).err().expect("refused").to_string();
        assert!(error.contains(&format!("gather_clusters.comp, groups of [{threads}, 1, 1] threads")), "{error}");
    }
    assert_clean(&gpu);
}

/// Makes an image.
pub(crate) fn image(gpu: &Gpu, format: Format, size: [u32; 2], extent: Extent, storage: bool) -> Image {
    gpu.image(&ImageDesc { name: "test.image", format, size, extent, storage }).expect("image")
}

/// Compiles a compute shader of one line and makes a pipeline.
fn pipeline(gpu: &Gpu, group: &str, declarations: &str, main: &str) -> Pipeline {
    let code = format!(
        "#version 460\n#extension GL_EXT_scalar_block_layout : require\nlayout({group}) in;\n{declarations}\n\
         void main() {{ ivec3 at = ivec3(gl_GlobalInvocationID); {main} }}\n"
    );
    from_spirv(gpu, "test.shader", &compile(&code).expect("compiles"), &[]).expect("pipeline")
}

#[test]
fn each_layer_is_rendered_into_alone() {
    if apart() {
        return;
    }
    for gpu in validated() {
        let layers = image(&gpu, Format::R8G8B8A8_UNORM, [4, 2], Extent::Layers(2), false);
        let depths = image(&gpu, Format::D32_SFLOAT, [4, 2], Extent::Layers(3), false);
        let frame = gpu.frame(|cmd| {
            for (layer, value) in [(1, 1.0), (0, 0.2)] {
                let colors = [Attach { image: &layers, load: Load::Clear([value; 4]) }];
                let depth = Some(Attach { image: &depths, load: Load::Clear([value; 4]) });
                cmd.render_layer(layer, &Attachments { colors: &colors, depth, area: [0, 0, 4, 2] }, |_| ());
                if layer == 1 {
                    let drawn = Use::ColorWrite | Use::DepthWrite;
                    cmd.barrier(drawn, drawn);
                }
            }
            Ok(())
        });
        assert_eq!(frame.expect("frame").problems, [""; 0]);
        let texels: Vec<u8> = gpu.read_image(&layers).expect("read");
        assert_eq!(texels, [[51; 32], [255; 32]].concat());
        let texels: Vec<f32> = gpu.read_image(&depths).expect("read");
        assert_eq!(texels[..16], [[0.2; 8], [1.0; 8]].concat());
        assert_eq!((layers.bytes(), depths.bytes()), (64, 96));
        assert_eq!(gpu.read_texel::<u32>(&layers, [3, 1]).expect("read"), 0x3333_3333, "the first layer");

        // Shaders see all layers.
        let sampled = "layout(binding = 0) uniform sampler2DArray image; \
            layout(binding = 1, scalar) writeonly buffer Out { float sums[]; };";
        let read =
            pipeline(&gpu, "local_size_x = 1", sampled, "sums[at.x] = texelFetch(image, ivec3(3, 1, at.x), 0).r;");
        let sums = gpu.buffer("test.sums", 8).expect("buffer");
        gpu.run_once("read", |cmd| {
            cmd.bind(&read, &[(&layers).into(), (&sums).into()]);
            cmd.dispatch(2, 1, 1);
        })
        .expect("run");
        let sums: Vec<f32> = gpu.read(&sums).expect("read");
        assert!((sums[0] - 0.2).abs() < 1e-6 && sums[1] == 1.0, "{sums:?}");
        assert_clean(&gpu);
    }
}

#[test]
fn shaders_write_volumes_and_planes() {
    if apart() {
        return;
    }
    for (gpu, checks) in validated().zip([false, true]) {
        let volume = image(&gpu, Format::R32_SFLOAT, [4, 3], Extent::Volume(2), true);
        let plane = image(&gpu, Format::R16G16B16A16_SFLOAT, [4, 3], Extent::Plane, true);
        let layers = image(&gpu, Format::R32_UINT, [4, 3], Extent::Layers(2), true);
        let write = pipeline(
            &gpu,
            "local_size_x = 4, local_size_y = 3",
            "layout(binding = 0, r32f) uniform writeonly image3D volume; \
             layout(binding = 1, rgba16f) uniform writeonly image2D plane; \
             layout(binding = 2, r32ui) uniform writeonly uimage2DArray layers;",
            "float n = at.x + 4 * at.y + 12 * at.z; imageStore(volume, at, vec4(n)); \
             imageStore(layers, at, uvec4(2 * n)); if (at.z == 0) { imageStore(plane, at.xy, vec4(n, 0, 0, 1)); }",
        );
        let sum = pipeline(
            &gpu,
            "local_size_x = 1",
            "layout(binding = 0, r32f) uniform readonly image3D volume; layout(binding = 1) uniform sampler3D same; \
             layout(binding = 2, r32ui) uniform uimage2DArray layers; \
             layout(binding = 3, scalar) writeonly buffer Out { float sums[]; };",
            "float a = 0, b = 0; for (int i = 0; i < 24; ++i) { ivec3 p = ivec3(i % 4, i / 4 % 3, i / 12); \
             a += imageLoad(volume, p).r; b += texelFetch(same, p, 0).r; } sums[0] = a; sums[1] = b; \
             imageStore(layers, ivec3(0), uvec4(imageLoad(layers, ivec3(3, 2, 1)).r));",
        );
        let sums = gpu.buffer("test.sums", 8).expect("buffer");
        for barrier in [true, false] {
            let frame = gpu.frame(|cmd| {
                cmd.bind(&write, &[(&volume).into(), (&plane).into(), (&layers).into()]);
                cmd.dispatch(4, 3, 2);
                if barrier {
                    cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                }
                cmd.bind(&sum, &[(&volume).into(), (&volume).into(), (&layers).into(), (&sums).into()]);
                if barrier {
                    cmd.dispatch(1, 1, 1);
                }
                Ok(())
            });
            // The engine's own check includes storage images. Without the barrier, the second pipeline is only bound
            // here.
            let problems = frame.expect("frame").problems;
            let lacks = |what: &str| problems.iter().any(|p| p.contains("test.image: no barrier") && p.contains(what));
            assert_eq!(!problems.is_empty(), checks && !barrier, "{problems:?}");
            assert_eq!(lacks("ComputeRead"), checks && !barrier, "{problems:?}");
            assert_eq!(gpu.read::<f32>(&sums).expect("read"), [276.0, 276.0]);
            let mut expected: Vec<u32> = (0..24).map(|n| 2 * n).collect();
            expected[0] = if barrier { 46 } else { 0 };
            assert_eq!(gpu.read_image::<u32>(&layers).expect("read"), expected);
        }
        let texels: Vec<f32> = gpu.read_image(&volume).expect("read");
        assert!(texels.iter().enumerate().all(|(i, t)| *t == i as f32), "{texels:?}");
        let texels: Vec<u16> = gpu.read_image(&plane).expect("read");
        assert_eq!(half::f16::from_bits(texels[4 * 11]).to_f32(), 11.0);
        assert_clean(&gpu);
    }
}

#[test]
fn images_that_no_device_has_are_refused_by_name() {
    let gpu = gpu();
    let of = |format, size, extent, storage| {
        let refused = gpu.image(&ImageDesc { name: "test.image", format, size, extent, storage });
        refused.err().expect("refused").to_string()
    };
    let large = of(Format::R32_SFLOAT, [1 << 20, 4], Extent::Plane, false);
    assert!(large.contains("test.image needs 1048576x4 texels"), "{large}");
    let deep = of(Format::R32_SFLOAT, [4, 4], Extent::Volume(1 << 20), false);
    assert!(deep.contains("4x4x1048576 texels"), "{deep}");
    let many = of(Format::R32_SFLOAT, [4, 4], Extent::Layers(1 << 20), false);
    assert!(many.contains("1048576 layers"), "{many}");
    let wrong = of(Format::R8G8B8A8_SRGB, [4, 4], Extent::Plane, true);
    assert!(wrong.contains("R8G8B8A8_SRGB for"), "{wrong}");
    assert_clean(&gpu);
}

/// Records commands on a checked device and returns their panic message. Nothing may reach the validation layer.
#[track_caller]
fn refused(gpu: &Gpu, record: impl FnOnce(&Cmd<'_>)) -> String {
    let unwound = catch_unwind(AssertUnwindSafe(|| {
        let _ = gpu.frame(|cmd| {
            record(cmd);
            Ok(())
        });
    }));
    assert_clean(gpu);
    let panic = unwound.expect_err("refused");
    let text = panic.downcast_ref::<String>().cloned();
    text.or_else(|| panic.downcast_ref::<&str>().map(|&s| s.to_owned())).expect("a message")
}

#[test]
fn commands_that_break_their_contracts_are_refused() {
    if apart() {
        return;
    }
    let (gpu, other) = (open(Validation::Sync), open(Validation::Sync));
    let (small, large) = (gpu.buffer("small", 16).expect("made"), gpu.buffer("large", 4096).expect("made"));
    let foreign = other.buffer("foreign", 4096).expect("made");
    let plane = gpu.target("plane", Format::R8G8B8A8_UNORM, 8, 8).expect("made");
    let depth = gpu.target("depth", Format::D32_SFLOAT, 8, 8).expect("made");
    let red = gpu.texture("red", Format::R32_SFLOAT, 1, 1, &[vec![0; 4]]).expect("made");
    let volume = image(&gpu, Format::R32_SFLOAT, [4, 4], Extent::Volume(2), true);
    let counts = image(&gpu, Format::R32_UINT, [4, 4], Extent::Plane, false);
    let sum = add(&gpu, 0);
    let foreign_sum = add(&other, 0);
    let store = pipeline(
        &gpu,
        "local_size_x = 1",
        "layout(binding = 0, r32f) uniform writeonly image3D volume;",
        "imageStore(volume, at, vec4(0));",
    );
    let attributes = [(0, Format::R32_SFLOAT, 0)];
    let screen = gpu.raster(&SCREEN).expect("made");
    let streamed = Raster { streams: &[Stream { stride: 32, attributes: &attributes }], ..SCREEN };
    let streamed = gpu.raster(&streamed).expect("made");
    let to_plane = Raster { colors: &[Format::R8G8B8A8_UNORM], depth: Depth::None, ..SCREEN };
    let to_plane = gpu.raster(&to_plane).expect("made");
    let streams = |attributes: &[(u32, Format, u32)]| {
        drop(gpu.raster(&Raster { streams: &[Stream { stride: 32, attributes }], ..SCREEN }));
    };
    let pushed = pipeline(
        &gpu,
        "local_size_x = 1",
        "layout(push_constant) uniform Push { uint n; }; layout(binding = 0, scalar) buffer Out { uint sum; };",
        "sum = n;",
    );
    let wrap = SamplerKind { wrap: [ash::vk::SamplerAddressMode::REPEAT; 2], nearest: true };
    let scope = |cmd: &Cmd<'_>, inside: &dyn Fn(&lightskin::gpu::Draw<'_, '_>)| {
        let area = [0, 0, 8, 8];
        cmd.render(&Attachments { colors: &[], depth: Some(Attach::clear(&depth)), area }, |draw| inside(draw));
    };
    let rendered = |cmd: &Cmd<'_>, colors: &[Attach<'_>], depth: Option<Attach<'_>>, area: [u32; 4]| {
        cmd.render(&Attachments { colors, depth, area }, |_| ());
    };
    let (name, format) = ("many", Format::D32_SFLOAT);
    let multisampled = ImageDesc { name, format, size: [8, 8], extent: Extent::Samples, storage: false };
    type Record<'a> = Box<dyn Fn(&Cmd<'_>) + 'a>;
    let cases: Vec<(&str, Record<'_>)> = vec![
        // Copies.
        ("17 bytes from large to small", Box::new(|cmd| cmd.copy_buffer(&large, &small, 17))),
        ("17 bytes from small to large", Box::new(|cmd| cmd.copy_buffer(&small, &large, 17))),
        ("0 bytes", Box::new(|cmd| cmd.copy_buffer(&small, &large, 0))),
        ("copied onto itself", Box::new(|cmd| cmd.copy_buffer(&small, &small, 16))),
        ("256 bytes into small", Box::new(|cmd| cmd.copy_image_to_buffer(&plane, &small))),
        ("textures and multisampled images are not read back", Box::new(|cmd| cmd.copy_image_to_buffer(&red, &small))),
        ("large: 8 bytes at 4092", Box::new(|cmd| cmd.update(&large, 4092, &[0_u32; 2]))),
        ("foreign: of another device", Box::new(|cmd| cmd.clear(&foreign))),
        ("foreign: of another device", Box::new(|cmd| cmd.copy_buffer(&foreign, &large, 16))),
        // Binding.
        ("test.add: of another device", Box::new(|cmd| cmd.bind(&foreign_sum, &[(&small).into(), (&red).into()]))),
        ("foreign: of another device", Box::new(|cmd| cmd.bind(&sum, &[(&foreign).into(), (&red).into()]))),
        ("does not fit binding 0", Box::new(|cmd| cmd.bind(&sum, &[(&red).into(), (&red).into()]))),
        ("does not fit binding 1", Box::new(|cmd| cmd.bind(&sum, &[(&small).into(), (&small).into()]))),
        ("does not fit binding 1", Box::new(|cmd| cmd.bind(&sum, &[(&small).into(), (&volume).into()]))),
        ("does not fit binding 0", Box::new(|cmd| cmd.bind(&sum, &[Bind::Texels(&small), (&red).into()]))),
        ("does not fit binding 0", Box::new(|cmd| cmd.bind(&store, &[Bind::Texture(&volume, wrap)]))),
        ("plane was not made as storage", Box::new(|cmd| cmd.bind(&store, &[(&plane).into()]))),
        ("not every device wraps like this", {
            Box::new(|cmd| {
                let once = SamplerKind { wrap: [ash::vk::SamplerAddressMode::MIRROR_CLAMP_TO_EDGE; 2], nearest: true };
                cmd.bind(&sum, &[(&small).into(), Bind::Texture(&plane, once)]);
            })
        }),
        ("does not filter R32_UINT", {
            Box::new(|cmd| {
                let linear = SamplerKind { nearest: false, ..wrap };
                cmd.bind(&sum, &[(&small).into(), Bind::Texture(&counts, linear)]);
            })
        }),
        ("17 bytes at 0", Box::new(|cmd| cmd.bind(&sum, &[Bind::Slice(&small, 0, 17), (&red).into()]))),
        ("0 bytes at 0", Box::new(|cmd| cmd.bind(&sum, &[Bind::Slice(&small, 0, 0), (&red).into()]))),
        ("bytes at 18446744073709551615", {
            Box::new(|cmd| cmd.bind(&sum, &[Bind::Slice(&small, u64::MAX, 2), (&red).into()]))
        }),
        ("slices begin at", Box::new(|cmd| cmd.bind(&sum, &[Bind::Slice(&large, 1, 16), (&red).into()]))),
        ("bound outside a rendering scope", Box::new(|cmd| cmd.bind(&screen, &[]))),
        // Dispatching.
        ("bind before dispatch", Box::new(|cmd| cmd.dispatch(1, 1, 1))),
        ("but the device allows", {
            Box::new(|cmd| {
                cmd.bind(&sum, &[(&small).into(), (&red).into()]);
                cmd.dispatch(1, u32::MAX, 1);
            })
        }),
        ("test.shader: push constants first", {
            Box::new(|cmd| {
                cmd.bind(&pushed, &[(&small).into()]);
                cmd.dispatch(1, 1, 1);
            })
        }),
        ("three numbers at byte 8 of small", {
            Box::new(|cmd| {
                cmd.bind(&sum, &[(&small).into(), (&red).into()]);
                cmd.dispatch_indirect(&small, 8);
            })
        }),
        ("three numbers at byte 2 of small", {
            Box::new(|cmd| {
                cmd.bind(&sum, &[(&small).into(), (&red).into()]);
                cmd.dispatch_indirect(&small, 2);
            })
        }),
        // Rendering.
        ("plane: 9x8 pixels at 0, 0 of 8x8", {
            Box::new(|cmd| rendered(cmd, &[Attach::clear(&plane)], None, [0, 0, 9, 8]))
        }),
        ("pixels at 4294967295, 0", {
            Box::new(|cmd| rendered(cmd, &[Attach::clear(&plane)], None, [u32::MAX, 0, 2, 8]))
        }),
        ("plane: 0x8 pixels", Box::new(|cmd| rendered(cmd, &[Attach::clear(&plane)], None, [0, 0, 0, 8]))),
        ("not made to be rendered into", { Box::new(|cmd| rendered(cmd, &[Attach::clear(&red)], None, [0, 0, 1, 1])) }),
        ("a depth image among the colours", {
            Box::new(|cmd| rendered(cmd, &[Attach::clear(&depth)], None, [0, 0, 8, 8]))
        }),
        ("plane: no depth image", { Box::new(|cmd| rendered(cmd, &[], Some(Attach::clear(&plane)), [0, 0, 8, 8])) }),
        ("depth: layer 1 of 1", {
            Box::new(|cmd| {
                let depth = Some(Attach::clear(&depth));
                cmd.render_layer(1, &Attachments { colors: &[], depth, area: [0, 0, 8, 8] }, |_| ());
            })
        }),
        // Drawing.
        ("not for these attachments", Box::new(|cmd| scope(cmd, &|draw| draw.bind(&to_plane, &[])))),
        ("which this scope only reads", {
            Box::new(|cmd| {
                let depth = Some(Attach { image: &depth, load: Load::ReadOnly });
                cmd.render(&Attachments { colors: &[], depth, area: [0, 0, 8, 8] }, |draw| draw.bind(&screen, &[]));
            })
        }),
        ("a compute pipeline, bound inside a rendering scope", {
            Box::new(|cmd| scope(cmd, &|draw| draw.bind(&sum, &[(&small).into(), (&red).into()])))
        }),
        ("bind before draw", Box::new(|cmd| scope(cmd, &|draw| draw.draw(3)))),
        ("no vertex buffer 0 is bound", {
            Box::new(|cmd| {
                scope(cmd, &|draw| {
                    draw.bind(&streamed, &[]);
                    draw.draw(3);
                });
            })
        }),
        ("96 bytes of vertex buffer 0, which has 16", {
            Box::new(|cmd| {
                scope(cmd, &|draw| {
                    draw.bind(&streamed, &[]);
                    draw.vertices(&[(&small, 0)]);
                    draw.draw(3);
                });
            })
        }),
        ("vertices at byte 16 of 16", Box::new(|cmd| scope(cmd, &|draw| draw.vertices(&[(&small, 16)])))),
        ("indices at byte 2 of 16", Box::new(|cmd| scope(cmd, &|draw| draw.indices(&small, 2)))),
        ("3 indices from 2 on, but 4 are bound", {
            Box::new(|cmd| {
                scope(cmd, &|draw| {
                    draw.bind(&screen, &[]);
                    draw.indices(&small, 0);
                    draw.draw_indexed(3, 2);
                });
            })
        }),
        ("outside the rendering scope's area", Box::new(|cmd| scope(cmd, &|draw| draw.area([4, 4, 5, 4])))),
        ("a rendering scope: not while", Box::new(|cmd| scope(cmd, &|_| scope(cmd, &|_| ())))),
        ("a copy: not while", Box::new(|cmd| scope(cmd, &|_| cmd.copy_buffer(&large, &small, 16)))),
        ("a fill: not while", Box::new(|cmd| scope(cmd, &|_| cmd.clear(&small)))),
        ("a barrier: not while", Box::new(|cmd| scope(cmd, &|_| cmd.barrier(Use::ColorWrite, Use::CopyRead)))),
        ("bind before dispatch", Box::new(|cmd| scope(cmd, &|_| cmd.dispatch(1, 1, 1)))),
        ("the end of a frame: not while", {
            Box::new(|cmd| {
                let inside = catch_unwind(AssertUnwindSafe(|| scope(cmd, &|_| panic!("inside the scope"))));
                assert!(inside.is_err());
            })
        }),
        // Pipelines.
        ("screen.vert: not a shader of stage .comp", Box::new(|_| drop(gpu.compute("screen.vert", &[])))),
        ("vals.comp: not a shader of stage .vert", {
            Box::new(|_| drop(gpu.raster(&Raster { vertex: "vals.comp", ..SCREEN })))
        }),
        ("attribute 0 at byte 30 of 32", Box::new(|_| streams(&[(0, Format::R32_SFLOAT, 30)]))),
        ("attribute 0 at byte 24 of 32", Box::new(|_| streams(&[(0, Format::R32G32B32_SFLOAT, 24)]))),
        ("attribute 1000 of R32_SFLOAT", Box::new(|_| streams(&[(1000, Format::R32_SFLOAT, 0)]))),
        ("made for [] and depth, multisampled, not for these attachments: [] and depth", {
            Box::new(|cmd| {
                let pipeline = gpu.raster(&Raster { multisampled: true, ..SCREEN }).expect("made");
                let depth = gpu.target("depth", Format::D32_SFLOAT, 8, 8).expect("made");
                let into = Attachments { colors: &[], depth: Some(Attach::clear(&depth)), area: [0, 0, 8, 8] };
                cmd.render(&into, |draw| draw.bind(&pipeline, &[]));
            })
        }),
        ("single and many samples", {
            Box::new(|cmd| {
                let depth = gpu.image(&multisampled).expect("made");
                let color = gpu.target("color", Format::R32_SFLOAT, 8, 8).expect("made");
                let colors = [Attach::clear(&color)];
                let into = Attachments { colors: &colors, depth: Some(Attach::clear(&depth)), area: [0, 0, 8, 8] };
                cmd.render(&into, |_| ());
            })
        }),
        ("many does not fit binding 1", {
            Box::new(|cmd| {
                let image = gpu.image(&multisampled).expect("made");
                cmd.bind(&add(&gpu, 1), &[(&small).into(), (&image).into()]);
            })
        }),
        ("many: textures and multisampled images are not read back", {
            Box::new(|cmd| drop(cmd.read_image::<f32>(&gpu.image(&multisampled).expect("made"))))
        }),
        ("many: multisampled images are not storage images", {
            Box::new(|_| drop(gpu.image(&ImageDesc { storage: true, ..multisampled })))
        }),
        ("1000 colours", Box::new(|_| drop(gpu.raster(&Raster { colors: &[Format::R32_SFLOAT; 1000], ..SCREEN })))),
        // Access by the CPU.
        ("local: not a host-visible buffer", {
            Box::new(|_| assert!(gpu.buffer("local", 16).expect("made").bytes().is_empty()))
        }),
        ("back: the device still uses it", {
            Box::new(|cmd| {
                let mut back = gpu.readback_buffer("back", 16).expect("made");
                cmd.copy_buffer(&small, &back, 16);
                assert!(back.bytes().is_empty());
            })
        }),
        ("a frame is being recorded", Box::new(|_| gpu.run_once("nested", |_| ()).expect("run"))),
        ("level 0 has 3 bytes, not 4", Box::new(|_| drop(gpu.texture("x", Format::R32_SFLOAT, 1, 1, &[vec![0; 3]])))),
        ("0 levels", Box::new(|_| drop(gpu.texture("x", Format::R32_SFLOAT, 1, 1, &[])))),
        ("subgroups of 5 threads", Box::new(|_| drop(gpu.compute_in_subgroups("vals.comp", &[0], 5)))),
        ("0x4", Box::new(|_| drop(gpu.target("x", Format::R32_SFLOAT, 0, 4)))),
    ];
    for (message, record) in cases {
        let said = refused(&gpu, record);
        assert!(said.contains(message), "not '{message}' but: {said}");
    }
    // Afterwards the device still works.
    assert_eq!(gpu.read::<u32>(&gpu.buffer_from("four", &[4_u32]).expect("made")).expect("read")[0], 4);
    assert_clean(&gpu);
    assert_clean(&other);
}
