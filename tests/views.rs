//! Several views of one world: each picture equals that of a separate frame, bit by bit, and the light is computed
//! once.

use lightskin::bake::CacheSet;
use lightskin::frame::plan::STAGES;
use lightskin::frame::{
    Antialiasing, ClusterRule, Exposure, Light, LightShadows, Near, Part, Picture, Shadows, View, World, record,
    record_part,
};
use lightskin::gpu::{Gpu, Image};
use lightskin::lab::knobs::{Gi, Knobs, Path};
use lightskin::scene::Scene;
use lightskin::scene::build::{CornellSurface, cornell};
use lightskin::scene::medium::Subsurface;

use crate::common::frames::{baked, camera, small};
use crate::common::{assert_clean, gpu};
use crate::layers::glazed;
use crate::moving::{bend, world as moving_world};
use glam::{Vec3, dvec3, vec3};

/// Two pictures of different sizes.
const SIZES: [[u32; 2]; 2] = [[40, 28], [24, 36]];

/// Lights all caches and measures the exposure.
pub(crate) fn plain() -> Knobs {
    Knobs { exposure: Exposure::Automatic, ..small() }
}

const CLUSTERS: Path = Path::Clusters(ClusterRule::Distance(4.0));

/// All layers of a picture as raw bits.
fn layers(gpu: &Gpu, picture: &Picture) -> Vec<Vec<u32>> {
    let Picture { surface, indirect, output, .. } = picture;
    let mut images: Vec<&Image> = vec![&surface.radiance, &surface.normal, &output.picture];
    images.extend(indirect.iter().flat_map(|i| [Some(&i.diffuse), i.glossy.as_ref()]).flatten());
    let mut all: Vec<Vec<u32>> = images.into_iter().map(|image| gpu.read_image(image).expect("read")).collect();
    all.push(vec![gpu.read::<u32>(&output.exposure).expect("read")[0]]);
    all
}

/// A light, and pictures of several cameras of a scene.
struct Views {
    light: Light,
    /// Each picture with the number of its camera.
    pictures: Vec<(usize, Picture)>,
}

impl Views {
    fn new(gpu: &Gpu, scene: &Scene, world: &World, knobs: &Knobs, cameras: &[usize]) -> Self {
        let light = Light::new(gpu, scene, world, &knobs.settings(), cameras.len()).expect("light");
        let picture = |&i: &usize| (i, Picture::new(gpu, world, &light, SIZES[i]).expect("a picture"));
        Self { pictures: cameras.iter().map(picture).collect(), light }
    }

    /// Draws a frame and returns the names of its zones.
    fn draw(&mut self, gpu: &Gpu, scene: &Scene, world: &World, knobs: &Knobs) -> Vec<String> {
        let drawn = gpu.frame(|cmd| {
            let view = |i: usize| View::new(&scene.cameras[i], SIZES[i], world.origin, world.radius);
            let mut views: Vec<_> = self.pictures.iter_mut().map(|(i, picture)| (view(*i), picture)).collect();
            record(cmd, world, &mut self.light, &mut views, &knobs.look());
            Ok(())
        });
        let drawn = drawn.expect("drawn");
        assert_eq!(drawn.problems, [""; 0], "{knobs:?}");
        gpu.times(&drawn).expect("times").zones.iter().map(|zone| zone.name.to_string()).collect()
    }
}

/// Draws two views together and each separately. Returns the numbers of lit caches: for both views, and for each.
pub(crate) fn compare(gpu: &Gpu, scene: &Scene, caches: &CacheSet, knobs: &Knobs) -> [u32; 3] {
    let world = World::new(gpu, scene, Some(caches)).expect("uploaded");
    let mut both = Views::new(gpu, scene, &world, knobs, &[0, 1]);
    // Draw two frames: the second must not depend on the first.
    for _ in 0..2 {
        let zones = both.draw(gpu, scene, &world, knobs);
        let planned: Vec<_> = both.light.plan.stages().map(|stage| stage.name).collect();
        let stages: Vec<_> = zones.iter().filter(|zone| STAGES.iter().any(|stage| stage.name == **zone)).collect();
        assert_eq!(stages, planned, "every stage must be one zone for any number of views: {knobs:?}");
    }
    let mut lit = [both.light.counts(gpu).expect("counts").caches; 3];
    for (i, (camera, picture)) in both.pictures.iter().enumerate() {
        let mut alone = Views::new(gpu, scene, &world, knobs, &[*camera]);
        alone.draw(gpu, scene, &world, knobs);
        let [together, alone_] = [picture, &alone.pictures[0].1].map(|picture| layers(gpu, picture));
        for (layer, (a, b)) in together.iter().zip(&alone_).enumerate() {
            assert!(a == b, "layer {layer} of view {i} differs from its own frame's: {knobs:?}");
        }
        assert!(together[3].iter().any(|bits| *bits != 0), "there must be indirect light: {knobs:?}");
        lit[1 + i] = alone.light.counts(gpu).expect("counts").caches;
    }
    lit
}

/// A room with two cameras that look at different parts of it.
pub(crate) fn room(surface: CornellSurface) -> Scene {
    let mut scene = cornell(surface, 0.2);
    scene.cameras = vec![
        camera(dvec3(0.1, 0.4, 1.5), dvec3(0.4, 0.1, -0.4), 0.3),
        camera(dvec3(-0.3, 1.2, 1.2), dvec3(-0.6, 1.5, -0.9), 0.3),
    ];
    scene
}

#[test]
fn each_of_two_pictures_is_that_of_its_own_frame() {
    let gpu = gpu();
    for (surface, is_by_texels) in [(CornellSurface::Diffuse, true), (CornellSurface::Glossy, false)] {
        let scene = room(surface);
        let mut caches = baked(&scene, 0.2, 8);
        if is_by_texels {
            caches = caches.with_cells(&scene).expect("cells");
        }
        for path in [Path::Compute, Path::DRAWS, CLUSTERS] {
            for shadows in [Shadows::Off, Shadows::Proxy, Shadows::PerLight] {
                for (bounces, cull) in [(1, true), if path == Path::Compute { (2, false) } else { (1, false) }] {
                    let knobs = Knobs { path, shadows, bounces, cull, ..plain() };
                    if !knobs.go_together() {
                        continue;
                    }
                    let lit = compare(&gpu, &scene, &caches, &knobs);
                    let [both, first, second] = lit;
                    if cull {
                        println!("{surface:?}, {path:?}, {shadows:?}: {lit:?} caches lit");
                        assert!(first < both && second < both && both <= first + second, "{lit:?}");
                    } else {
                        assert!(first == both && second == both, "{lit:?}");
                    }
                }
            }
        }
    }
    assert_clean(&gpu);
}

#[test]
fn views_without_indirect_light_and_with_all_of_it_by_brute_force_are_their_own_too() {
    let gpu = gpu();
    let scene = room(CornellSurface::Glossy);
    let caches = baked(&scene, 0.3, 8);
    compare(&gpu, &scene, &caches, &Knobs { gi: Gi::BruteForce, ..plain() });
}

/// Brute force in frames of some blocks each gives the same bits as one frame. This includes edges, layers and
/// light inside bodies.
#[test]
fn brute_force_by_blocks_is_one_frame() {
    let gpu = gpu();
    for is_filled in [false, true] {
        let mut scene = glazed();
        if is_filled {
            scene.materials[0].fill(Subsurface::of_color(vec3(0.8, 0.7, 0.4), Vec3::splat(0.03), 1.4));
        }
        let world = World::new(&gpu, &scene, None).expect("uploaded");
        for antialiasing in [Antialiasing::Off, Antialiasing::Fast, Antialiasing::Four] {
            let knobs = Knobs { gi: Gi::BruteForce, antialiasing, layers: 2, size: [50, 40], reuse: true, ..plain() };
            let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
            let drawn = |parts: &[Part]| {
                let mut light = Light::new(&gpu, &scene, &world, &knobs.settings(), 1).expect("light");
                assert_eq!(light.plan.inside, is_filled);
                let mut picture = Picture::new(&gpu, &world, &light, knobs.size).expect("a picture");
                for part in parts {
                    let frame = gpu.frame(|cmd| {
                        let views = &mut [(view, &mut picture)];
                        record_part(cmd, &world, &mut light, views, &knobs.look(), part);
                        Ok(())
                    });
                    assert_eq!(frame.expect("drawn").problems, [""; 0], "{part:?} of {knobs:?}");
                }
                // Lavapipe's threads flush denormals or not, so tails of lobes below 1e-30 cd/m^2 vary from run to run.
                let mut layers = layers(&gpu, &picture);
                let tail = |bits: &&mut u32| f32::from_bits(**bits).abs() < 1e-30;
                layers[4].iter_mut().filter(tail).for_each(|bits| *bits = 0);
                layers
            };
            let whole = drawn(&[Part::Whole]);
            let blocks = [0..5, 5..6, 6..40].map(Part::Blocks);
            let parts: Vec<_> = [Part::Before].into_iter().chain(blocks).collect();
            assert!(whole == drawn(&parts), "{knobs:?}");
            assert!(whole[3].iter().any(|bits| *bits != 0), "there must be indirect light");
        }
    }
    assert_clean(&gpu);
}

/// Frames of two views skip unchanged stages like frames of one view, with moving cameras, lights and bodies.
#[test]
fn of_two_views_nothing_is_ever_stale() {
    let gpu = gpu();
    let rays = Near::Rays { per_pixel: 4, every: 2 };
    for (shadows, path, near) in [
        (Shadows::PerLight, Path::Compute, Near::Off),
        (Shadows::PerLight, Path::Compute, rays),
        (Shadows::Proxy, Path::DRAWS, Near::Off),
        (Shadows::Off, CLUSTERS, Near::Off),
    ] {
        let mut scene = moving_world();
        scene.cameras.push(camera(dvec3(1.1, 1.7, 1.4), dvec3(-0.6, 0.9, -0.8), 0.5));
        let caches = baked(&scene, 0.3, 8);
        let knobs = Knobs { shadows, path, near, cull: true, light_shadows: LightShadows::Maps(64), ..plain() };
        let mut world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
        let lasting = Knobs { reuse: true, ..knobs };
        let mut both = Views::new(&gpu, &scene, &world, &lasting, &[0, 1]);
        for step in 0..8 {
            match step % 7 {
                1 => scene.cameras[1].world_from_camera.translation.x += 0.05,
                2 => scene.cameras[0].world_from_camera.translation.y -= 0.05,
                3 => bend(&mut scene, 0.1 * f64::from(step), 0.2),
                4 => scene.lights[0].position.x += 0.1,
                // Nothing moves in steps 5 and 0.
                6 => scene.cameras.iter_mut().for_each(|camera| camera.world_from_camera.translation.z += 0.03),
                _ => {}
            }
            world.update(&gpu, &scene).expect("the same scene");
            both.draw(&gpu, &scene, &world, &lasting);
            let skipped = both.light.skipped();
            let all = both.light.plan.stages().count();
            match step % 7 {
                0 if step == 0 => assert!(skipped.is_empty(), "{skipped:?}"),
                0 | 5 => assert_eq!(skipped.len(), all, "nothing moves: {skipped:?}"),
                1 | 2 => assert!(skipped.contains(&"rsm") && !skipped.contains(&"gbuffer"), "{skipped:?}"),
                _ => {}
            }
            for (camera, picture) in &both.pictures {
                let mut alone = Views::new(&gpu, &scene, &world, &knobs, &[*camera]);
                alone.draw(&gpu, &scene, &world, &knobs);
                let [together, alone] = [picture, &alone.pictures[0].1].map(|picture| layers(&gpu, picture));
                assert!(together == alone, "step {step}: view {camera} differs from its own frame");
            }
        }
    }
    assert_clean(&gpu);
}

#[test]
fn a_view_that_is_minimised_leaves_the_other_alone() {
    let gpu = gpu();
    let scene = room(CornellSurface::Glossy);
    let caches = baked(&scene, 0.3, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let knobs = Knobs { cull: true, reuse: true, ..plain() };
    let mut both = Views::new(&gpu, &scene, &world, &knobs, &[0, 1]);
    both.draw(&gpu, &scene, &world, &knobs);
    let whole: Vec<_> = both.pictures.iter().map(|(_, picture)| layers(&gpu, picture)).collect();
    // A frame without pixels does nothing, and the next frame must still be complete.
    for minimised in [vec![0], vec![1], vec![0, 1]] {
        let Views { light, pictures } = &mut both;
        for &i in &minimised {
            pictures[i].1.fit(&gpu, &world, light, [0, 0]).expect("no pixels");
        }
        both.draw(&gpu, &scene, &world, &knobs);
        for other in (0..2).filter(|i| !minimised.contains(i)) {
            assert!(layers(&gpu, &both.pictures[other].1) == whole[other], "without views {minimised:?}");
        }
        let Views { light, pictures } = &mut both;
        for &i in &minimised {
            pictures[i].1.fit(&gpu, &world, light, SIZES[i]).expect("shown again");
        }
        both.draw(&gpu, &scene, &world, &knobs);
        for ((_, picture), whole) in both.pictures.iter().zip(&whole) {
            assert!(layers(&gpu, picture) == *whole, "after views {minimised:?} were minimised");
        }
    }
    assert_clean(&gpu);
}
