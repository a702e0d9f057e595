//! Lifetimes of device objects: dropped objects, abandoned frames, memory, and pipelines that are made once and kept.

use crate::cli::{ATRIUM, folder, works};
use crate::common::{apart, assert_clean, frame_of, open};
use crate::gpu::{SCREEN, add, image, validated};
use lightskin::gpu::{
    Attach, Attachments, Buffer, Cmd, Cull, Depth, Extent, Format, Gpu, Image, Load, Pipeline, Raster, Validation,
};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Records a frame that makes a texture, a buffer, a target and two pipelines, uses them all and drops them at once.
fn drop_what_was_bound(gpu: &Gpu, split: bool) -> lightskin::Result<lightskin::gpu::Frame> {
    let red = [1.5_f32.to_le_bytes().to_vec()];
    let image = gpu.texture("test.red", Format::R32_SFLOAT, 1, 1, &red).expect("texture");
    let depth = gpu.target("test.depth", Format::D32_SFLOAT, 4, 4).expect("target");
    frame_of(gpu, split, |cmd| {
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
    if apart() {
        return;
    }
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

/// A submission that the driver refuses forgets what is new, so the device counts as lost. It can be closed.
#[test]
fn a_refused_submission_is_a_loss() {
    if apart() {
        return;
    }
    for gpu in validated() {
        for split in [false, true] {
            let image = gpu.texture("test.red", Format::R32_SFLOAT, 1, 1, &[vec![0; 4]]).expect("texture");
            gpu.refuse_submission();
            let refused = frame_of(&gpu, split, |cmd| {
                let _zone = cmd.zone("test");
                Ok(())
            });
            let refused = refused.map(|_| ()).expect_err("it is refused");
            assert!(matches!(refused, lightskin::Error::DeviceLost { .. }), "{refused}");
            drop(image);
        }
        assert_clean(&gpu);
    }
}

#[test]
fn a_frame_that_is_given_up_leaves_nothing_behind() {
    if apart() {
        return;
    }
    for gpu in validated() {
        let kept = gpu.buffer("test.kept", 16).expect("buffer");
        let result = gpu.frame(|cmd| {
            cmd.clear(&kept);
            let buffer = gpu.buffer("test.dropped", 16).expect("buffer");
            cmd.clear(&buffer);
            Err(lightskin::Error::Nothing("given up".into()))
        });
        assert!(result.is_err());
        let unwound = catch_unwind(AssertUnwindSafe(|| {
            let _ = gpu.frame(|cmd| {
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
            let frame = gpu.frame(|cmd| {
                cmd.clear(&kept);
                Ok(())
            });
            assert_eq!(frame.expect("frame").problems, [""; 0]);
        }
        assert_clean(&gpu);
    }
}

/// A number, and a buffer and a texture with it as their content.
type Made = (u32, Buffer, Image, Pipeline);

#[test]
fn another_thread_makes_and_drops_what_frames_do_not_wait_for() {
    if apart() {
        return;
    }
    for gpu in validated() {
        let before = gpu.counters();
        let (give, take) = std::sync::mpsc::channel();
        let device = gpu.device().clone();
        let maker = std::thread::spawn(move || {
            for i in 0..300_u32 {
                let buffer = device.buffer_from("test.made", &[i; 64]).expect("buffer");
                let level: Vec<u8> = [i as f32; 16].iter().flat_map(|v| v.to_le_bytes()).collect();
                let image = device.texture("test.texture", Format::R32_SFLOAT, 4, 4, &[level]).expect("texture");
                let pipeline = device.raster(&SCREEN).expect("pipeline");
                // Others are dropped before, while or after their content is copied.
                if i % 3 == 0 {
                    give.send((i, buffer, image, pipeline)).expect("wanted");
                }
            }
        });
        let (sum, mut made) = (gpu.buffer("test.sum", 4).expect("buffer"), Vec::<Made>::new());
        let add = add(&gpu, 1);
        while !maker.is_finished() {
            let frame = gpu.frame(|cmd| {
                if let Some((_, _, image, _)) = made.last() {
                    cmd.bind(&add, &[(&sum).into(), image.into()]);
                    cmd.dispatch(1, 1, 1);
                }
                Ok(())
            });
            assert_eq!(frame.expect("frame").problems, [""; 0]);
            made.extend(take.try_iter());
        }
        maker.join().expect("made");
        made.extend(take.try_iter());
        assert_eq!(made.len(), 100);
        for (i, buffer, image, _) in &made {
            assert_eq!(gpu.read::<u32>(buffer).expect("read"), [*i; 64]);
            let frame = gpu.frame(|cmd| {
                cmd.bind(&add, &[(&sum).into(), image.into()]);
                cmd.dispatch(1, 1, 1);
                Ok(())
            });
            assert_eq!(frame.expect("frame").problems, [""; 0]);
            assert_eq!(gpu.read::<f32>(&sum).expect("read"), [*i as f32 + 1.0]);
        }
        // Content that no submission copies goes with its resource.
        drop(gpu.buffer_from("test.dropped", &[0_u32; 64]).expect("buffer"));
        drop((made, sum, add));
        gpu.forget_pipelines();
        gpu.wait().expect("done");
        let after = gpu.counters();
        assert_eq!((after.buried, after.sets, after.resources), (0, 0, before.resources), "{after:?}");
        assert_clean(&gpu);
    }
}

#[test]
fn a_device_that_another_thread_holds_is_closed_after_it() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let device = gpu.device().clone();
    // Its content is never copied.
    let buffer = device.buffer_from("test.made", &[1_u32; 64]).expect("buffer");
    assert_clean(&gpu);
    drop(gpu);
    std::thread::spawn(move || drop((buffer, device))).join().expect("dropped");
}

#[test]
fn nothing_piles_up_of_what_is_made_and_dropped() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let image = gpu.texture("test.red", Format::R32_SFLOAT, 1, 1, &[vec![0; 4]]).expect("texture");
    let mut first = None;
    for i in 0..1000_u32 {
        let (sum, pipeline) = (gpu.buffer("test.sum", 65_536).expect("buffer"), add(&gpu, i % 3));
        let frame = gpu.frame(|cmd| {
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
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let small = gpu.buffer("test.small", 16).expect("buffer");
    let before = gpu.counters();
    let large = gpu.buffer("test.large", 300 << 20).expect("buffer");
    let during = gpu.counters();
    assert!(during.allocated_bytes >= before.allocated_bytes + (300 << 20), "{during:?}");
    let frame = gpu.frame(|cmd| {
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
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let mut frames = Vec::new();
    std::thread::scope(|threads| {
        let (send, receive) = std::sync::mpsc::channel::<Buffer>();
        threads.spawn(move || receive.into_iter().for_each(drop));
        for _ in 0..200 {
            let frame = gpu.frame(|cmd| {
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
    if apart() {
        return;
    }
    for gpu in validated() {
        let (mut buffer, pipeline) = (gpu.host_buffer("test.kept", 16).expect("buffer"), add(&gpu, 1));
        let image = gpu.target("test.kept", Format::D32_SFLOAT, 4, 4).expect("target");
        drop_what_was_bound(&gpu, false).map(drop).expect("frame");
        drop(gpu);
        assert_eq!(buffer.bytes().len(), 16);
        drop((pipeline, image, buffer));
    }
}

#[test]
fn what_is_asked_for_again_is_the_same_pipeline() {
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let made = |gpu: &Gpu| gpu.counters().pipelines_made;
    let (first, other) = (Raster { cull: Cull::Back, ..SCREEN }, Raster { depth: Depth::Behind, ..SCREEN });
    // Request the pipelines repeatedly, without holding any in between.
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
        gpu.compute_in_subgroups("follow.comp", &[], threads).expect("pipeline");
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
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
    let make = |i: u32| gpu.raster(&Raster { constants: &[i], ..SCREEN }).expect("pipeline");
    let held: Vec<_> = (0..200).map(make).collect();
    assert_eq!((gpu.counters().pipelines_kept, gpu.counters().pipelines_made), (200, 200));
    for i in 200..500 {
        make(i);
    }
    // The pipeline that is just handed out does not count as unused.
    let now = gpu.counters();
    assert_eq!((now.pipelines_kept, now.pipelines_made, now.buried), (200 + 128 + 1, 500, 0));
    // Held pipelines and the most recently requested pipelines are still there.
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
    let args = ["render", ATRIUM, "--gi", "off", "--size", "16x16", "-o", "a.png", "--validation", "core"];
    let render = || works(&at, &args);
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
    // The file is not written again if nothing was added.
    let first = written(&kept());
    render();
    assert_eq!(written(&kept()), first);
    // Damaged, cut off, empty, from another device: the picture is the same, and the file is whole again afterwards.
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
    if apart() {
        return;
    }
    let gpu = open(Validation::Sync);
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
fn images_are_ready_whenever_they_were_made() {
    if apart() {
        return;
    }
    for gpu in validated() {
        for split in [false, true] {
            let early = image(&gpu, Format::R32_SFLOAT, [2, 2], Extent::Plane, false);
            drop(image(&gpu, Format::R32_SFLOAT, [2, 2], Extent::Plane, false)); // never used
            let mut late = None;
            let clear = |cmd: &Cmd<'_>, image: &Image| {
                let colors = [Attach { image, load: Load::Clear([3.0; 4]) }];
                cmd.render(&Attachments { colors: &colors, depth: None, area: [0, 0, 2, 2] }, |_| ());
            };
            let given_up = frame_of(&gpu, split, |cmd| {
                let dropped = image(&gpu, Format::R32_SFLOAT, [2, 2], Extent::Plane, false);
                clear(cmd, &dropped);
                clear(cmd, &early);
                Err(lightskin::Error::Nothing("given up".into()))
            });
            assert!(given_up.is_err());
            let frame = frame_of(&gpu, split, |cmd| {
                let dropped = image(&gpu, Format::R32_SFLOAT, [2, 2], Extent::Plane, false);
                clear(cmd, &dropped);
                drop(dropped);
                let _zone = cmd.zone("late");
                let made = image(&gpu, Format::R32_SFLOAT, [2, 2], Extent::Plane, false);
                clear(cmd, &made);
                clear(cmd, &early);
                late = Some(made);
                Ok(())
            });
            assert_eq!(frame.expect("frame").problems, [""; 0]);
            for image in [&early, late.as_ref().expect("made")] {
                assert_eq!(gpu.read_image::<f32>(image).expect("read"), [3.0; 4]);
            }
        }
        gpu.wait().expect("done");
        assert_eq!((gpu.counters().resources, gpu.counters().buried), (0, 0));
        assert_clean(&gpu);
    }
}
