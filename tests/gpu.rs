//! The layer over Vulkan by itself: lifetimes of what is dropped, pipelines that are made once.

#[path = "../build/variants.rs"]
mod variants;

use crate::cli::{folder, works};
use crate::common::{assert_clean, compile, gpu};
use lightskin::gpu::{
    Attach, Attachments, Blend, Cull, Depth, Format, Gpu, Options, Pipeline, Raster, Shape, Validation,
};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Adds a number to the first texel of an image's red and writes it to a buffer.
const ADD: &str = "#version 460
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x = 1) in;
layout(constant_id = 0) const uint MORE = 0u;
layout(binding = 0, scalar) writeonly buffer Out { float sum; };
layout(binding = 1) uniform sampler2D image;
void main() { sum = texelFetch(image, ivec2(0), 0).r + float(MORE); }
";

fn add(gpu: &Gpu, more: u32) -> Pipeline {
    gpu.compute_from_spirv("test.add", &compile(ADD).expect("compiles"), &[more]).expect("pipeline")
}

/// Draws the whole screen's depth.
const SCREEN: Raster<'_> = Raster {
    vertex: "screen.vert",
    fragment: None,
    shape: Shape::Triangles,
    streams: &[],
    colors: &[],
    blend: Blend::Replace,
    depth: Depth::Nearest,
    cull: Cull::None,
    constants: &[],
};

fn validated() -> impl Iterator<Item = Gpu> {
    let open = |validation| Gpu::new(&Options { device: None, validation }).expect("device and validation layer");
    [Validation::Core, Validation::Sync].into_iter().map(open)
}

/// Records a frame that makes a texture, a buffer, a target and two pipelines, uses them all and drops them at once.
fn drop_what_was_bound(gpu: &Gpu, split: bool) -> lightskin::Result<lightskin::gpu::Frame> {
    let red = [1.5_f32.to_le_bytes().to_vec()];
    let image = gpu.texture("test.red", Format::R32_SFLOAT, 1, 1, &red).expect("texture");
    let depth = gpu.target("test.depth", Format::D32_SFLOAT, 4, 4).expect("target");
    gpu.frame(split, |cmd| {
        cmd.begin_frame([&depth]);
        let (sum, pipeline) = (gpu.buffer("test.sum", 4).expect("buffer"), add(gpu, 2));
        {
            let _zone = cmd.zone("add");
            cmd.bind(&pipeline, &[(&sum).into(), (&image).into()]);
            cmd.dispatch(1, 1, 1);
        }
        drop((sum, pipeline, image));
        let area = [0, 0, 4, 4];
        cmd.render(&Attachments { colors: &[], depth: Some(Attach::clear(&depth)), area }, |draw| {
            let pipeline = gpu.raster(&SCREEN).expect("pipeline");
            draw.bind(&pipeline, &[]);
            draw.draw(3);
            gpu.forget_pipelines();
        });
        drop(depth);
        Ok(())
    })
}

#[test]
fn what_is_dropped_while_it_is_recorded_lives_until_the_frame_is_done() {
    for gpu in validated() {
        let before = gpu.counters();
        for split in [false, true, false, false] {
            assert_eq!(drop_what_was_bound(&gpu, split).expect("frame").problems, [""; 0]);
        }
        gpu.wait().expect("done");
        let after = gpu.counters();
        assert_eq!((after.buried, after.sets, after.resources), (0, 0, before.resources), "{after:?}");
        assert_clean(&gpu);
    }
}

#[test]
fn a_frame_that_is_given_up_leaves_nothing_behind() {
    for gpu in validated() {
        let kept = gpu.buffer("test.kept", 16).expect("buffer");
        let result = gpu.frame(false, |cmd| {
            cmd.clear(&kept);
            let buffer = gpu.buffer("test.dropped", 16).expect("buffer");
            cmd.clear(&buffer);
            Err(lightskin::Error::Nothing("given up".into()))
        });
        assert!(result.is_err());
        let unwound = catch_unwind(AssertUnwindSafe(|| {
            let _ = gpu.frame(false, |cmd| {
                let buffer = gpu.buffer("test.dropped", 16).expect("buffer");
                cmd.clear(&buffer);
                cmd.push(&1_u32); // nothing is bound
                Ok(())
            });
        }));
        assert!(unwound.is_err());
        assert_eq!((gpu.counters().buried, gpu.counters().resources), (0, 1));
        // Both slots of the ring still work.
        for _ in 0..3 {
            let frame = gpu.frame(false, |cmd| {
                cmd.clear(&kept);
                Ok(())
            });
            assert_eq!(frame.expect("frame").problems, [""; 0]);
        }
        assert_clean(&gpu);
    }
}

#[test]
fn nothing_piles_up_of_what_is_made_and_dropped() {
    let gpu = gpu();
    let image = gpu.texture("test.red", Format::R32_SFLOAT, 1, 1, &[vec![0; 4]]).expect("texture");
    let mut first = None;
    for i in 0..1000_u32 {
        let (sum, pipeline) = (gpu.buffer("test.sum", 65_536).expect("buffer"), add(&gpu, i % 3));
        let frame = gpu.frame(false, |cmd| {
            cmd.begin_frame([]);
            cmd.bind(&pipeline, &[(&sum).into(), (&image).into()]);
            cmd.dispatch(1, 1, 1);
            Ok(())
        });
        assert_eq!(frame.expect("frame").problems, [""; 0]);
        drop((sum, pipeline));
        if i == 10 || i == 999 {
            gpu.wait().expect("done");
            let now = gpu.counters();
            let now = (now.sets, now.pools, now.allocated_bytes, now.resources, now.buried);
            assert_eq!(now, *first.get_or_insert(now), "after {i}");
        }
    }
    assert_clean(&gpu);
}

#[test]
fn memory_comes_back_without_another_frame() {
    let gpu = gpu();
    let small = gpu.buffer("test.small", 16).expect("buffer");
    let before = gpu.counters();
    let large = gpu.buffer("test.large", 300 << 20).expect("buffer");
    let during = gpu.counters();
    assert!(during.allocated_bytes >= before.allocated_bytes + (300 << 20), "{during:?}");
    let frame = gpu.frame(false, |cmd| {
        cmd.clear(&large);
        drop(large);
        Ok(())
    });
    assert_eq!(frame.expect("frame").problems, [""; 0]);
    gpu.wait().expect("done");
    assert_eq!(gpu.counters(), before);
    drop(small);
    assert_clean(&gpu);
}

#[test]
fn what_is_dropped_on_another_thread_is_destroyed_in_time() {
    let gpu = gpu();
    let mut frames = Vec::new();
    std::thread::scope(|threads| {
        let (send, receive) = std::sync::mpsc::channel::<lightskin::gpu::Buffer>();
        threads.spawn(move || receive.into_iter().for_each(drop));
        for _ in 0..200 {
            let frame = gpu.frame(false, |cmd| {
                let buffer = gpu.buffer("test.sent", 1 << 16).expect("buffer");
                cmd.clear(&buffer);
                send.send(buffer).expect("the other thread listens");
                Ok(())
            });
            frames.extend(frame.expect("frame").problems);
        }
    });
    assert_eq!(frames, [""; 0]);
    gpu.wait().expect("done");
    assert_eq!((gpu.counters().buried, gpu.counters().resources), (0, 0));
    assert_clean(&gpu);
}

#[test]
fn what_outlives_its_device_stays_sound() {
    for gpu in validated() {
        let (buffer, pipeline) = (gpu.host_buffer("test.kept", 16).expect("buffer"), add(&gpu, 1));
        let image = gpu.target("test.kept", Format::D32_SFLOAT, 4, 4).expect("target");
        drop_what_was_bound(&gpu, false).map(drop).expect("frame");
        drop(gpu);
        assert_eq!(buffer.bytes().len(), 16);
        drop((pipeline, image, buffer));
    }
}

#[test]
fn what_is_asked_for_again_is_the_same_pipeline() {
    let gpu = gpu();
    let made = |gpu: &Gpu| gpu.counters().pipelines_made;
    let (first, other) = (Raster { cull: Cull::Back, ..SCREEN }, Raster { depth: Depth::Behind, ..SCREEN });
    // There and back, with nothing held in between.
    for _ in 0..3 {
        for constant in [0, 1] {
            gpu.compute("vals.comp", &[constant]).expect("pipeline");
        }
        for raster in [&first, &other, &SCREEN] {
            gpu.raster(raster).expect("pipeline");
        }
        assert_eq!(made(&gpu), 5);
    }
    if let Some(threads) = gpu.voting_threads() {
        gpu.compute_in_subgroups("vals.comp", &[0], threads).expect("pipeline");
        assert_eq!(made(&gpu), 6);
    }
    let before = made(&gpu);
    let held = gpu.compute("vals.comp", &[0]).expect("pipeline");
    gpu.forget_pipelines();
    let anew = gpu.compute("vals.comp", &[0]).expect("pipeline");
    assert_eq!(made(&gpu), before + 1);
    drop((held, anew));
    assert_clean(&gpu);
}

#[test]
fn few_pipelines_are_kept_that_nobody_holds() {
    let gpu = gpu();
    let make = |i: u32| gpu.raster(&Raster { constants: &[i], ..SCREEN }).expect("pipeline");
    let held: Vec<_> = (0..200).map(make).collect();
    assert_eq!((gpu.counters().pipelines_kept, gpu.counters().pipelines_made), (200, 200));
    for i in 200..500 {
        make(i);
    }
    // The one that is being handed out is not spare.
    let now = gpu.counters();
    assert_eq!((now.pipelines_kept, now.pipelines_made, now.buried), (200 + 128 + 1, 500, 0));
    // What is held and what was asked for last is still there.
    (0..200).chain(450..500).for_each(|i| drop(make(i)));
    assert_eq!(gpu.counters().pipelines_made, 500);
    drop(held);
    make(500);
    assert_eq!(gpu.counters().pipelines_kept, 128 + 1);
    assert_clean(&gpu);
}

#[test]
fn compiled_pipelines_are_kept_on_disk_and_damage_is_no_error() {
    let at = folder("gpu-pipelines");
    let render = || works(&at, &["render", "--gi", "off", "--size", "16x16", "-o", "a.png", "--validation", "core"]);
    let kept = || {
        let files = fs::read_dir(at.join("cache/lightskin")).expect("the kept files");
        let mut files: Vec<_> = files.map(|f| f.expect("entry").path()).collect();
        files.retain(|f| f.file_name().is_some_and(|n| n.to_string_lossy().starts_with("pipelines-")));
        let [file] = files.try_into().expect("one file of pipelines");
        file
    };
    render();
    let whole = fs::read(kept()).expect("kept");
    let picture = fs::read(at.join("a.png")).expect("picture");
    let written = |file: &std::path::Path| fs::metadata(file).expect("kept").modified().expect("a time");
    // What nothing was added to is not written again.
    let first = written(&kept());
    render();
    assert_eq!(written(&kept()), first);
    // Damaged, cut off, empty, of another device: the picture is the same, and the file is whole again.
    let foreign = [&whole[..48], &[whole[48] ^ 1], &whole[49..]].concat();
    let flipped = [&whole[..whole.len() - 1], &[whole[whole.len() - 1] ^ 1]].concat();
    for bytes in [foreign, flipped, whole[..20].to_vec(), whole[..whole.len() - 1].to_vec(), vec![]] {
        fs::write(kept(), bytes).expect("the file can be damaged");
        render();
        assert!(fs::read(at.join("a.png")).expect("picture") == picture);
        assert_eq!(fs::read(kept()).expect("kept").len(), whole.len());
    }
}

#[test]
fn resources_are_known_by_name() {
    let gpu = gpu();
    let buffer = gpu.buffer("test.list", 400).expect("buffer");
    let image = gpu.target("test.picture", Format::R8G8B8A8_UNORM, 8, 4).expect("target");
    let known = |gpu: &Gpu| gpu.resources().into_iter().map(|r| (r.name, r.bytes)).collect::<Vec<_>>();
    assert_eq!(known(&gpu), [("test.list".to_owned(), 400), ("test.picture".to_owned(), 128)]);
    drop(buffer);
    assert_eq!(known(&gpu), [("test.picture".to_owned(), 128)]);
    drop(image);
    assert!(known(&gpu).is_empty());
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
    endless[5] &= 0xffff; // an instruction of no words
    for wrong in [&[][..], &code[..4], &code[..5], &code[..6], &code[..code.len() - 1], &without_magic, &endless] {
        let error = gpu.compute_from_spirv("test.wrong", wrong, &[]).err().expect("refused");
        assert!(error.to_string().contains("no SPIR-V module"), "{error}");
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
        let pipeline = gpu.compute_from_spirv("test.count", &code, &[0, threads]).expect("pipeline");
        gpu.run_once("count", |cmd| {
            cmd.bind(&pipeline, &[(&count).into()]);
            cmd.dispatch(64, 4, 1);
        })
        .expect("run");
        assert_eq!(gpu.read::<u32>(&count).expect("read")[0], 64 * 4);
    }
    assert_clean(&gpu);
}
