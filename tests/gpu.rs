//! The layer over Vulkan by itself: lifetimes of what is dropped, pipelines that are made once.

use crate::common::{assert_clean, compile, gpu};
use lightskin::gpu::{
    Attach, Attachments, Blend, Cull, Depth, Format, Gpu, Options, Pipeline, Raster, Shape, Validation,
};
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

/// A pipeline that draws nothing but needs an image of this format; the engine's own shaders.
fn screen(gpu: &Gpu) -> Pipeline {
    gpu.raster(&Raster {
        vertex: "screen.vert",
        fragment: None,
        shape: Shape::Triangles,
        streams: &[],
        colors: &[],
        blend: Blend::Replace,
        depth: Depth::Nearest,
        cull: Cull::None,
        constants: &[],
    })
    .expect("pipeline")
}

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
            let pipeline = screen(gpu);
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
