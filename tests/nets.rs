//! The nets hold: a lost barrier, an idle barrier, a wrong binding count or push size, a bad value are all caught.

use glam::Vec4;
use lightskin::gpu::{Gpu, Options, Use, Validation};
use lightskin::image::broken_values;
use lightskin::shared::{Cache, GatherPush, Instance, ModelCache};

fn open() -> Gpu {
    Gpu::new(&Options { device: None, validation: Validation::Sync }).expect("a Vulkan device and the validation layer")
}

const PUSH: GatherPush = GatherPush { cache_count: 4, val_count: 0, eye: Vec4::ZERO };

/// Two dispatches, the second reading what the first has written, with `barriers` between.
fn write_then_read(gpu: &Gpu, barriers: &[(Use, Use)]) -> Vec<String> {
    let model = gpu.buffer_from("test.model_caches", &[ModelCache::default(); 4]).expect("buffer");
    let instances = gpu.buffer_from("test.instances", &[Instance::default()]).expect("buffer");
    let caches = gpu.buffer("test.caches", 4 * size_of::<Cache>().max(size_of::<ModelCache>()) as u64).expect("buffer");
    let last = gpu.buffer("test.last", 4 * size_of::<Cache>() as u64).expect("buffer");
    let atlas = gpu.compute("atlas.comp", &[]).expect("pipeline");
    let frame = gpu.frame(false, |cmd| {
        cmd.begin_frame([]);
        let _zone = cmd.zone("test");
        cmd.bind(&atlas, &[(&model).into(), (&instances).into(), (&caches).into()]);
        cmd.push(&PUSH);
        cmd.dispatch(4, 1, 1);
        for (from, to) in barriers {
            cmd.barrier(*from, *to);
        }
        cmd.bind(&atlas, &[(&caches).into(), (&instances).into(), (&last).into()]);
        cmd.push(&PUSH);
        cmd.dispatch(4, 1, 1);
        Ok(())
    });
    let frame = frame.expect("frame");
    gpu.times(&frame).expect("times");
    frame.problems
}

#[test]
fn a_lost_barrier_is_caught_by_both_nets() {
    let gpu = open();
    assert_eq!(write_then_read(&gpu, &[(Use::ComputeWrite, Use::ComputeRead)]), [] as [String; 0]);
    assert_eq!(gpu.messages(), [] as [String; 0], "with the barrier nothing complains");

    let problems = write_then_read(&gpu, &[]);
    assert_eq!(problems, ["test.caches: no barrier between test:ComputeWrite and test:ComputeRead"]);
    let messages = gpu.messages();
    assert!(messages.iter().any(|m| m.contains("SYNC-HAZARD")), "the layer sees it too: {messages:?}");
}

#[test]
fn an_idle_barrier_is_caught() {
    let gpu = open();
    let problems =
        write_then_read(&gpu, &[(Use::ComputeWrite, Use::ComputeRead), (Use::ColorWrite, Use::FragmentRead)]);
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert!(problems[0].contains("separates nothing"), "{problems:?}");
}

#[test]
#[should_panic(expected = "its shaders declare 3 bindings")]
fn a_wrong_number_of_bindings_is_caught() {
    let gpu = open();
    let atlas = gpu.compute("atlas.comp", &[]).expect("pipeline");
    let _ = gpu.frame(false, |cmd| {
        cmd.bind(&atlas, &[]);
        Ok(())
    });
}

#[test]
#[should_panic(expected = "size of its push constants")]
fn a_wrong_push_size_is_caught() {
    let gpu = open();
    let buffer = gpu.buffer("test.buffer", 1024).expect("buffer");
    let atlas = gpu.compute("atlas.comp", &[]).expect("pipeline");
    let _ = gpu.frame(false, |cmd| {
        cmd.bind(&atlas, &[(&buffer).into(), (&buffer).into(), (&buffer).into()]);
        cmd.push(&1_u32);
        Ok(())
    });
}

#[test]
fn bad_values_are_counted() {
    assert_eq!(broken_values(&[0.0, 1.0, f32::MAX]), 0);
    assert_eq!(broken_values(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1e-30]), 4);
}

#[test]
fn every_device_is_reported() {
    let devices = lightskin::gpu::devices().expect("devices");
    assert!(!devices.is_empty() && devices.iter().any(|d| d.missing.is_empty()), "{devices:?}");
}

#[test]
fn an_unknown_device_is_refused_by_name() {
    let error = Gpu::new(&Options { device: Some("no such device".into()), validation: Validation::Off })
        .err()
        .expect("refused");
    assert!(error.to_string().contains("matches none of: 0 "), "{error}");
}
