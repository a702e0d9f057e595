//! Shadows of every VAL: depth images and sums against the f64 twin, light leaks, and pictures against light paths.

use glam::{DAffine3, DVec3, Vec3};
use lightskin::bake::CacheSet;
use lightskin::frame::depth_images::DepthImages;
use lightskin::frame::{LightShadows, Shadows, View, Ways, World};
use lightskin::gpu::Gpu;
use lightskin::lab::eval::measure::{Bench, Layers};
use lightskin::lab::eval::references::{PathTraced, path_traced};
use lightskin::lab::eval::sweep::Point;
use lightskin::lab::knobs::{Frame, Knobs};
use lightskin::lab::scenes::Shadowed;
use lightskin::lab::shadows::errors;
use lightskin::reference::depth_image::{DepthImage, Plate, gather_seen};
use lightskin::reference::gather::{Cache, ProxyWeight, gather};
use lightskin::reference::occlude::Disc;
use lightskin::reference::path_trace::PathTraceSettings;
use lightskin::reference::rsm::Val;
use lightskin::scene::Scene;
use lightskin::scene::build::{atrium, cuboid};
use lightskin::shared::{self, DEPTH_IMAGE_TEXELS, LiveArgs};

use crate::common::frames::{SPOT, add, baked, camera, corner, phong, shoot, small};
use crate::common::{assert_clean, gpu, rounding};

fn shadowed() -> Knobs {
    Knobs { shadows: Shadows::PerLight, ..small() }
}

/// The corner with a box that blocks light from its walls.
fn blocked() -> Scene {
    let mut scene = corner(&[SPOT], 40.0);
    let block = cuboid(Vec3::new(-0.5, 0.1, -0.4), Vec3::new(-0.2, 0.7, 0.2), 0.1, |_| true);
    add(&mut scene, block, phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    scene
}

/// The twin's plates, which stand for caches, from the device's atlas.
fn plates(gpu: &Gpu, scene: &Scene, caches: &CacheSet) -> Vec<Plate> {
    let buffers = World::new(gpu, scene, Some(caches)).expect("uploaded");
    let mut frame = Frame::new(gpu, scene, &buffers, &shadowed()).expect("made");
    draw(gpu, scene, &buffers, &mut frame, &shadowed());
    let atlas = &frame.light.caches().expect("caches").atlas;
    let all: Vec<shared::Cache> = gpu.read(&atlas.caches).expect("atlas");
    let plate = |c: &shared::Cache| Plate {
        disc: Disc {
            position: c.position.as_dvec3() + buffers.origin,
            normal: c.normal.as_dvec3().normalize(),
            area: c.area.into(),
        },
        middle: c.middle.as_dvec3() + buffers.origin,
        axis: c.axis.as_dvec3(),
        breadth: c.breadth.into(),
    };
    all[..atlas.count as usize].iter().map(plate).collect()
}

fn draw(gpu: &Gpu, scene: &Scene, buffers: &World, frame: &mut Frame, settings: &Knobs) {
    let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, buffers, &view);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
}

/// The twin's cache of a plate.
fn cache(plate: &Plate) -> Cache {
    Cache { position: plate.disc.position, normal: plate.disc.normal, exponent: 1.0 }
}

#[test]
fn depth_images_are_the_references() {
    let gpu = gpu();
    let mut scene = blocked();
    // A drape whose folds are small compared with the distances of caches, so that the rectangles of its two sides lie
    // behind each other.
    let mut drape = cuboid(Vec3::new(0.1, 0.1, -0.5), Vec3::new(0.7, 0.8, -0.48), 0.05, |_| true);
    drape.vertices.iter_mut().for_each(|v| v.position.z += 0.06 * (15.0 * v.position.x).sin());
    add(&mut scene, drape, phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
    let caches = baked(&scene, 0.3, 8);
    let plates = plates(&gpu, &scene, &caches);
    let settings = shadowed();
    let buffers = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let mut frame = Frame::new(&gpu, &scene, &buffers, &settings).expect("made");
    draw(&gpu, &scene, &buffers, &mut frame, &settings);
    let light = frame.light.caches().expect("caches");
    let images: Vec<f32> = gpu.read(&light.gather.depth_images().expect("images").buffer).expect("read");
    let live = light.gather.live().expect("compute path");
    let list: Vec<u32> = gpu.read(&live.list).expect("list");
    let count = gpu.read::<LiveArgs>(&live.args).expect("arguments")[0].cache_count as usize;
    assert_eq!(count, plates.len());
    let (mut filled, mut differ) = (0, 0);
    for (slot, own) in list[..count].iter().enumerate() {
        let twin = DepthImage::new(&cache(&plates[*own as usize]), &plates);
        let image = &images[slot * DEPTH_IMAGE_TEXELS as usize..][..DEPTH_IMAGE_TEXELS as usize];
        for (texel, end) in image.iter().zip(&twin.ends) {
            filled += usize::from(*end > 0.0);
            // Texels whose centre is on the edge of a rectangle may differ. Distances of more than 10 km count as no
            // end.
            differ += usize::from((f64::from(*texel) - end).abs() > 1e-3 * end.max(0.1));
        }
    }
    println!("{filled} of {} texels have an end, {differ} differ", count * DEPTH_IMAGE_TEXELS as usize);
    assert!(filled * 10 > count * DEPTH_IMAGE_TEXELS as usize, "rectangles must be visible");
    let most = if rounding(&gpu) > 1.0 { 500 } else { 1000 };
    assert!(differ * most < filled, "{differ} of {filled} texels differ");

    // One workgroup per image, as on GPUs, draws the same images.
    let by_workgroups = DepthImages::with(&gpu, light.atlas.count, !gpu.is_software()).expect("made");
    let drawn = gpu.frame(|cmd| {
        by_workgroups.record(cmd, &buffers, &light.atlas, live);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    let again: Vec<f32> = gpu.read(&by_workgroups.buffer).expect("read");
    let used = count * DEPTH_IMAGE_TEXELS as usize;
    assert!(again[..used] == images[..used], "both ways must draw the same images");
    assert_clean(&gpu);
}

#[test]
fn two_sides_of_one_thing_do_not_shadow_each_other() {
    // The front of a folded drape. Its rectangle lies behind the drape's back.
    let front = Disc { position: DVec3::ZERO, normal: DVec3::Z, area: std::f64::consts::PI };
    let plate = Plate { disc: front, middle: DVec3::new(0.0, 0.0, -0.7), axis: DVec3::X * 0.9, breadth: 0.9 };
    let ends = |position: DVec3, normal: DVec3| {
        let cache = Cache { position, normal, exponent: 1.0 };
        DepthImage::new(&cache, &[plate]).ends.iter().filter(|end| **end > 0.0).count()
    };
    assert_eq!(ends(DVec3::new(0.1, 0.0, -0.3), DVec3::NEG_Z), 0, "the front must not shadow the back's cache");
    // Caches in front of the front, and caches that see it, belong to other objects.
    assert!(ends(DVec3::new(0.1, 0.0, 0.3), DVec3::NEG_Z) > 150);
    assert!(ends(DVec3::new(0.1, 0.0, -1.5), DVec3::Z) > 150);
}

#[test]
fn shadowed_sums_are_the_references() {
    let gpu = gpu();
    let scene = blocked();
    let caches = baked(&scene, 0.3, 8);
    let plates = plates(&gpu, &scene, &caches);
    // With coarse RSMs each VAL is tested alone.
    let ways = [(1, 256, 24, 1), (4, 2048, 96, 4), (3, 512, 96, 4)];
    for (caches_per_thread, split, rsm, together) in ways {
        let ways = Ways { caches_per_thread, split, ..Ways::default() };
        let settings = Knobs { ways, rsm, ..shadowed() };
        let shot = shoot(&gpu, &scene, Some(&caches), &settings);
        let eye = scene.cameras[0].world_from_camera.translation;
        let vals: Vec<Val> = shot.vals.iter().copied().filter(|val| *val != Val::NOTHING).collect();
        let (mut error, mut total, mut hidden) = (0.0, 0.0, 0.0);
        for ((own, found), plate) in shot.caches.iter().zip(&shot.proxies).zip(&plates) {
            let image = DepthImage::new(&cache(plate), &plates);
            let weight = ProxyWeight::Irradiance;
            let twin = gather_seen(own, &image, &vals, Some(eye), weight, together).diffuse.facing_irradiance;
            let open = gather(own, &vals, Some(eye), weight).diffuse.facing_irradiance;
            error += (found.diffuse.facing_irradiance - twin).abs().element_sum();
            total += twin.element_sum();
            hidden += (open - twin).abs().element_sum();
        }
        println!(
            "{caches_per_thread} caches a thread, parts of {split}: relative error {:.2e}, shadows {:.3}",
            error / total,
            hidden / total
        );
        assert!(hidden > 0.05 * total, "there must be shadows");
        assert!(error < 2e-3 * total, "{} of the light", error / total);
    }
}

#[test]
fn a_closed_dark_box_stays_dark() {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 40.0);
    // Walls of 6 cm around a room of 0.5 m, with a visible floor.
    let paint = || phong([0.7; 3], [0.0; 3], 1.0);
    let (low, high) = (Vec3::new(-0.6, 0.2, 0.3), Vec3::new(0.0, 0.8, 0.9));
    let wall = Vec3::splat(0.06);
    add(&mut scene, cuboid(low, high, 0.1, |_| true), paint(), DAffine3::IDENTITY);
    let inside = cuboid(low + wall, high - wall, 0.1, |_| true).reversed();
    add(&mut scene, inside, paint(), DAffine3::IDENTITY);
    let middle = (0.5 * (low + high)).as_dvec3();
    scene.cameras[0] = camera(middle + DVec3::new(0.15, 0.15, 0.15), middle - DVec3::new(0.2, 0.2, 0.2), 1.2);
    let caches = baked(&scene, 0.2, 8);
    let light = |shadows| {
        let shot = shoot(&gpu, &scene, Some(&caches), &Knobs { shadows, ..small() });
        shot.diffuse.iter().map(|pixel| pixel.element_sum()).sum::<f64>()
    };
    let [open, leaked] = [Shadows::Off, Shadows::PerLight].map(light);
    println!("{:.2} % of the light without shadows leaks through the walls", 100.0 * leaked / open);
    // There are holes between rectangles, but walls have two layers of them.
    assert!(open > 0.0 && leaked < 0.08 * open, "{leaked} of {open}");
}

#[test]
fn culling_and_the_ways_of_the_gather_change_nothing() {
    let gpu = gpu();
    let scene = blocked();
    let caches = baked(&scene, 0.25, 8);
    let culled = |cull| shoot(&gpu, &scene, Some(&caches), &Knobs { cull, ..shadowed() }).diffuse;
    assert_eq!(culled(true), culled(false));
}

#[test]
fn shadows_bring_pictures_nearer_to_light_paths() {
    let gpu = gpu();
    let folder = std::env::temp_dir().join(format!("lightskin-shadows-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let size = [40, 30];
    // Objects that are thin, folded, or many in one mesh, next to mostly shadowed objects.
    let scenes = Shadowed::ALL.iter().map(|which| (which.scene(), 500, 0.75)).chain([(atrium(), 2000, 0.9)]);
    for (scene, caches, at_most) in scenes {
        let wanted = PathTraced { settings: PathTraceSettings::engine(size, 1), samples: 64, glossy: false };
        let (truth, _) = path_traced(&scene, &scene.cameras[0], &wanted, &folder, &|_| ());
        let mut bench = Bench::new(&gpu, &scene, &scene.cameras[0]);
        let mut picture = |shadows| -> Layers {
            let frame = Knobs { rsm: 64, light_shadows: LightShadows::Maps(256), shadows, ..Knobs::plain(size) };
            let point = Point { frame, caches, references: 8, angle: 60_f32.to_radians(), max_edge: None };
            let measured = bench.measure(&point, 1, &|_, _| ()).expect("measured");
            assert_eq!(measured.problems, [""; 0]);
            measured.layers
        };
        let [off, on] = [Shadows::Off, Shadows::PerLight].map(|shadows| errors(&picture(shadows), &truth)[0].1);
        println!("{}: off {off:?}, on {on:?}", scene.name);
        assert!(on.metrics.relmse < at_most * off.metrics.relmse, "{}: {on:?} instead of {off:?}", scene.name);
        assert!(on.metrics.bias.abs() < 0.1, "{}: {on:?}", scene.name);
    }
    std::fs::remove_dir_all(&folder).ok();
    assert_clean(&gpu);
}
