//! The safety nets catch errors: a missing barrier, an idle barrier, a wrong number of bindings, a wrong push size, an
//! invalid value.

use crate::common::{apart, open};
use glam::Vec3;
use lightskin::bake::{self, Density};
use lightskin::frame::check::{Broken, Check};
use lightskin::frame::{LightShadows, View, World};
use lightskin::gpu::{Gpu, Options, Use, Validation};
use lightskin::image::broken_values;
use lightskin::lab::knobs::{Frame, Knobs};
use lightskin::scene::Scene;
use lightskin::scene::build::{CornellSurface, cornell};
use lightskin::shared::{Cache, OccludePush};

const PUSH: OccludePush = OccludePush { cache_count: 4, group_count: 1, first_proxy: 0 };

/// Two dispatches with `barriers` between them. The second reads what the first has written.
fn write_then_read(gpu: &Gpu, barriers: &[(Use, Use)]) -> Vec<String> {
    let first = gpu.buffer_from("test.first", &[Cache::default(); 4]).expect("buffer");
    let caches = gpu.buffer("test.caches", 4 * size_of::<Cache>() as u64).expect("buffer");
    let last = gpu.buffer("test.last", 4 * size_of::<Cache>() as u64).expect("buffer");
    let groups = gpu.compute("occluder_groups.comp", &[]).expect("pipeline");
    let frame = gpu.frame(|cmd| {
        let _zone = cmd.zone("test");
        cmd.bind(&groups, &[(&first).into(), (&caches).into()]);
        cmd.push(&PUSH);
        cmd.dispatch(1, 1, 1);
        for (from, to) in barriers {
            cmd.barrier(*from, *to);
        }
        cmd.bind(&groups, &[(&caches).into(), (&last).into()]);
        cmd.push(&PUSH);
        cmd.dispatch(1, 1, 1);
        Ok(())
    });
    let frame = frame.expect("frame");
    gpu.times(&frame).expect("times");
    frame.problems
}

#[test]
fn a_lost_barrier_is_caught_by_both_nets() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    assert_eq!(write_then_read(&gpu, &[(Use::ComputeWrite, Use::ComputeRead)]), [] as [String; 0]);
    assert_eq!(gpu.messages(), [] as [String; 0], "with the barrier there must be no messages");

    let problems = write_then_read(&gpu, &[]);
    assert_eq!(problems, ["test.caches: no barrier between test:ComputeWrite and test:ComputeRead"]);
    let messages = gpu.messages();
    assert!(messages.iter().any(|m| m.contains("SYNC-HAZARD")), "the validation layer must see it, too: {messages:?}");
}

#[test]
fn an_idle_barrier_is_caught() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let problems =
        write_then_read(&gpu, &[(Use::ComputeWrite, Use::ComputeRead), (Use::ColorWrite, Use::FragmentRead)]);
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert!(problems[0].contains("separates nothing"), "{problems:?}");
}

/// The message of a panic.
fn panics<T>(run: impl FnOnce() -> T) -> String {
    let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).err().expect("a panic");
    let text = panic.downcast_ref::<String>().cloned();
    text.or_else(|| panic.downcast_ref::<&str>().map(|&s| s.to_owned())).expect("a message")
}

#[test]
fn a_wrong_number_of_bindings_is_caught() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let groups = gpu.compute("occluder_groups.comp", &[]).expect("pipeline");
    let told = panics(|| {
        gpu.frame(|cmd| {
            cmd.bind(&groups, &[]);
            Ok(())
        })
    });
    assert!(told.contains("its shaders declare 2 bindings"), "{told}");
}

#[test]
fn a_wrong_push_size_is_caught() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let buffer = gpu.buffer("test.buffer", 1024).expect("buffer");
    let groups = gpu.compute("occluder_groups.comp", &[]).expect("pipeline");
    let told = panics(|| {
        gpu.frame(|cmd| {
            cmd.bind(&groups, &[(&buffer).into(), (&buffer).into()]);
            cmd.push(&1_u32);
            Ok(())
        })
    });
    assert!(told.contains("size of its push constants"), "{told}");
}

#[test]
fn bad_values_are_counted() {
    assert_eq!(broken_values(&[0.0, 1.0, f32::MAX]), 0);
    assert_eq!(broken_values(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1e-30]), 4);
}

/// Counts of the device's check for a frame of this scene, and the host's count for direct light.
fn check(gpu: &Gpu, scene: &Scene) -> (Vec<Broken>, usize) {
    let caches = bake::bake(scene, &CACHES, &|_, _| {}).expect("bake");
    let buffers = World::new(gpu, scene, Some(&caches)).expect("upload");
    let settings = Knobs { rsm: 20, light_shadows: LightShadows::Maps(64), ..Knobs::plain([70, 50]) };
    let mut frame = Frame::new(gpu, scene, &buffers, &settings).expect("frame");
    let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &buffers, &view);
        Ok(())
    });
    assert_eq!(drawn.expect("frame").problems, [""; 0]);
    let found = Check::new(gpu).expect("check").count(gpu, &frame.light, &frame.picture).expect("count");
    let direct: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.radiance).expect("direct");
    (found, direct.iter().map(|p| broken_values(&p[..3])).sum())
}

const CACHES: bake::BakeSettings = bake::BakeSettings { density: Density::Count(60), angle: 1.0, references: 8 };

#[test]
fn broken_values_are_counted_on_the_device() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let scene = cornell(CornellSurface::Glossy, 0.5);
    let counts = |found: &[Broken]| -> Vec<(&str, u64)> { found.iter().map(|f| (f.target, f.broken)).collect() };
    let (found, _) = check(&gpu, &scene);
    let targets = ["direct", "indirect.diffuse", "indirect.glossy", "VALs", "caches' sums", "proxies"];
    assert_eq!(counts(&found), targets.map(|t| (t, 0)));
    let [sums, caches] = [found[4].values / 16, found[5].values / 14];
    assert!(
        found[0].values == 3 * 70 * 50 && found[3].values == 11 * 400 && sums >= caches && caches >= 30,
        "{found:?}"
    );

    // Every surface emits one value of each kind. The device must count as many invalid values as the host.
    let mut shining = scene.clone();
    shining.lights.clear();
    for (i, material) in shining.materials.iter_mut().enumerate() {
        material.emissive = [Vec3::new(-1.0, f32::NAN, 2.0), Vec3::new(f32::INFINITY, -0.0, 1.0), Vec3::NEG_ONE][i];
    }
    let (found, on_host) = check(&gpu, &shining);
    // Invalid emission is not sent on as light.
    assert_eq!(counts(&found), targets.map(|t| (t, if t == "direct" { on_host as u64 } else { 0 })));
    assert!(on_host > 3000, "{on_host}");

    // A light with an invalid intensity makes everything that it reaches invalid.
    for intensity in [f32::NAN, f32::INFINITY, -1.0] {
        let mut broken = scene.clone();
        broken.lights[0].intensity = intensity;
        let (found, _) = check(&gpu, &broken);
        assert!([0, 3, 4].iter().all(|target| found[*target].broken > 0), "{intensity}: {found:?}");
    }
    assert_eq!(gpu.messages(), [] as [String; 0]);
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
