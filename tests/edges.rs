//! Smoothed edges: coverage of pixels against their sample points, and pictures against 64 samples a pixel.

use crate::common::frames::{add, baked, camera, drawn_of, small};
use crate::common::gpu;
use glam::{Affine2, DAffine3, DVec2, DVec3, Vec2, Vec3, Vec4};
use lightskin::bake::CacheSet;
use lightskin::frame::{Antialiasing, Behind, LightShadows, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::metrics::display::Values;
use lightskin::metrics::flip::{PIXELS_PER_DEGREE, flip};
use lightskin::scene::build::{self, Fineness, quad};
use lightskin::scene::defaults::{Ground, complete};
use lightskin::scene::gltf::load;
use lightskin::scene::{Camera, Image, Material, Projection, Sampler, Scene, Texture};
use std::collections::HashSet;
use std::path::Path;

/// A white emissive square of side 1, rotated by `angle`, in front of nothing. The picture is 2 units high.
fn slanted(angle: f64) -> Scene {
    let mut scene = Scene::default();
    let material = Material { emissive: Vec3::ONE, base_color: Vec3::ZERO.extend(1.0), ..Material::default() };
    let corner = Vec3::new(-0.5, -0.5, 0.0);
    add(&mut scene, quad(corner, Vec3::X, Vec3::Y, 2.0), material, DAffine3::from_rotation_z(angle));
    scene.cameras =
        vec![Camera { projection: Projection::Orthographic { ymag: 1.0 }, ..camera(DVec3::Z, DVec3::ZERO, 1.0) }];
    scene
}

/// Fraction of a pixel's points inside the square, and whether a point is too close to its outline for a sure result.
fn share(index: usize, size: u32, angle: f64, antialiasing: Antialiasing) -> (f64, bool) {
    let middle = DVec2::new((index as u32 % size) as f64 + 0.5, (index as u32 / size) as f64 + 0.5);
    let points: Vec<DVec2> =
        [Vec2::ZERO].into_iter().chain(antialiasing.offsets()).map(|o| middle + o.as_dvec2()).collect();
    let side = |p: &DVec2| {
        let at = (*p / f64::from(size) * 2.0 - 1.0) * DVec2::new(1.0, -1.0);
        let turned = DVec2::from_angle(-angle).rotate(at).abs();
        turned.max_element() - 0.5
    };
    let inside = points.iter().filter(|p| side(p) < 0.0).count();
    (inside as f64 / points.len() as f64, points.iter().any(|p| side(p).abs() < 1e-4))
}

/// All kinds of antialiasing.
const KINDS: [Antialiasing; 4] = [Antialiasing::Off, Antialiasing::Fast, Antialiasing::Four, Antialiasing::Eight];

#[test]
fn shares_of_pixels_are_those_of_their_points() {
    let gpu = gpu();
    let size = 32;
    for angle in [0.0, 0.1, 0.5, 0.7] {
        let scene = slanted(angle);
        let world = World::new(&gpu, &scene, None).expect("made");
        for antialiasing in KINDS {
            let knobs = Knobs { gi: Gi::Off, antialiasing, size: [size; 2], ..small() };
            let mut frame = drawn_of(&gpu, &scene, &world, &knobs);
            let seen: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.radiance).expect("read");
            frame.look.behind = Behind::Transparent;
            let clear = pictured(&gpu, &scene, &world, &mut frame);
            for (i, seen) in seen.iter().enumerate() {
                let (wanted, unsure) = share(i, size, angle, antialiasing);
                let off = (f64::from(seen[0]) - wanted).abs();
                assert!(
                    unsure || off < 1e-6,
                    "{angle} {antialiasing:?}: pixel {i} shows {} of the square, not {wanted}",
                    seen[0]
                );
                let alpha = f64::from(clear[i][3]) / 255.0;
                assert!(
                    unsure || (alpha - wanted).abs() < 0.003,
                    "{angle} {antialiasing:?}: alpha {alpha}, not {wanted}"
                );
                // White keeps its colour at any coverage.
                assert!(wanted == 0.0 || unsure || clear[i][0] == clear[clear.len() / 2 + 16][0], "{:?}", clear[i]);
            }
        }
    }
}

/// Draws again with the frame's current look, and returns the picture.
fn pictured(gpu: &Gpu, scene: &Scene, world: &World, frame: &mut Frame) -> Vec<[u8; 4]> {
    let view = lightskin::frame::View::new(&scene.cameras[0], frame.picture.size(), world.origin, world.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, world, &view);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    gpu.read_image(&frame.picture.output.picture).expect("read")
}

/// Sum of all radiance layers of a picture.
fn radiance(gpu: &Gpu, frame: &Frame) -> Vec<Vec3> {
    let picture = &frame.picture;
    let indirect = picture.indirect.as_ref();
    let images =
        [Some(&picture.surface.radiance), indirect.map(|i| &i.diffuse), indirect.and_then(|i| i.glossy.as_ref())];
    let mut sum = vec![Vec3::ZERO; picture.size().iter().product::<u32>() as usize];
    for image in images.into_iter().flatten() {
        let texels: Vec<[f32; 4]> = gpu.read_image(image).expect("read");
        sum.iter_mut().zip(&texels).for_each(|(sum, t)| *sum += Vec3::new(t[0], t[1], t[2]));
    }
    sum
}

/// Mean over 8x8 samples of each pixel, and whether the samples show more than one surface.
fn supersampled(gpu: &Gpu, scene: &Scene, world: &World, knobs: &Knobs) -> (Vec<Vec3>, Vec<bool>) {
    let [w, h] = knobs.size.map(|side| side as usize);
    let frame = drawn_of(gpu, scene, world, &Knobs { size: knobs.size.map(|side| 8 * side), ..*knobs });
    let radiance = radiance(gpu, &frame);
    let element = frame.picture.surface.element.as_ref().expect("elements");
    let draws: Vec<[u32; 2]> = gpu.read_image(element).expect("read");
    let normals: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.normal).expect("read");
    let normal = |at: usize| Vec3::new(normals[at][0], normals[at][1], normals[at][2]);
    let pixels = (0..w * h).map(|i| {
        let samples = || (0..64).map(move |s| (8 * (i / w) + s / 8) * 8 * w + 8 * (i % w) + s % 8);
        let first = samples().next().expect("one");
        let other =
            |at: usize| draws[at][0] != draws[first][0] || (draws[at][0] > 0 && normal(at).dot(normal(first)) < 0.8);
        (samples().map(|at| radiance[at]).sum::<Vec3>() / 64.0, samples().any(other))
    });
    pixels.unzip()
}

/// Errors with the fast kind, four and eight points, relative to errors with the pixels' centres alone: FLIP on edges,
/// FLIP over all pixels, RMSE on edges.
fn errors(gpu: &Gpu, scene: &Scene, caches: &CacheSet, base: Knobs) -> [[f64; 3]; 3] {
    let world = World::new(gpu, scene, Some(caches)).expect("made");
    let (truth, edges) = supersampled(gpu, scene, &world, &base);
    // Scale the radiance, so that FLIP is equally sensitive in scenes of any brightness.
    let mut bright: Vec<f32> = truth.iter().map(|c| c.max_element()).collect();
    bright.sort_by(f32::total_cmp);
    let scale = 1.0 / bright[bright.len() * 3 / 4].max(f32::MIN_POSITIVE);
    let truth: Vec<[f32; 3]> = truth.iter().map(|c| (c * scale).to_array()).collect();
    let error = |antialiasing| {
        let frame = drawn_of(gpu, scene, &world, &Knobs { antialiasing, ..base });
        let seen: Vec<[f32; 3]> = radiance(gpu, &frame).iter().map(|c| (c * scale).to_array()).collect();
        let map = flip(&seen, &truth, base.size, Values::Radiance, PIXELS_PER_DEGREE);
        let on_edges: f64 = map.iter().zip(&edges).filter(|(_, edge)| **edge).map(|(e, _)| e).sum();
        let square = |(a, b): (&[f32; 3], &[f32; 3])| (Vec3::from(*a) - Vec3::from(*b)).length_squared();
        let squares: f32 =
            seen.iter().zip(&truth).zip(&edges).filter(|(_, edge)| **edge).map(|(ab, _)| square(ab)).sum();
        [on_edges, map.iter().sum(), f64::from(squares).sqrt()]
    };
    let [off, fast, four, eight] = KINDS.map(error);
    let share = edges.iter().filter(|edge| **edge).count() as f64 / edges.len() as f64;
    println!("{} {:?}: edges are {:.1} % of the pixels", scene.name, base.size, 100.0 * share);
    [("fast", fast), ("4", four), ("8", eight)].map(|(name, found)| {
        let of_off = [0, 1, 2].map(|i| found[i] / off[i]);
        let [on_edges, all, rmse] = of_off;
        println!("aa {name} relative to off: FLIP on edges {on_edges:.3}, over all {all:.3}; RMSE on edges {rmse:.3}");
        of_off
    })
}

#[test]
fn edges_come_near_to_those_of_many_samples() {
    let gpu = gpu();
    let scene = build::atrium();
    let caches = baked(&scene, 1.5, 8);
    let size = [320, 180];
    let base = Knobs { size, light_shadows: LightShadows::Maps(2048), ..Knobs::plain(size) };
    let [fast, four, eight] = errors(&gpu, &scene, &caches, base);
    for (found, limits) in [(fast, [0.58; 3]), (four, [0.41, 0.4, 0.41]), (eight, [0.41, 0.4, 0.41])] {
        assert!(found.iter().zip(&limits).all(|(found, limit)| found < limit), "{found:?}, limits {limits:?}");
    }
}

/// A measurement rather than a test: `cargo test --test lightskin -- --ignored --nocapture edges_of_shared_scenes`.
#[test]
#[ignore = "takes minutes, and says how good the picture is"]
fn edges_of_shared_scenes() {
    let gpu = gpu();
    let mut scenes = vec![build::showpiece(Fineness::default())];
    if let Some(data) = std::env::var_os("LIGHTSKIN_DATA") {
        for name in ["thesis/stanford_bunny.glb", "sponza/Sponza.gltf", "large/country_kitchen.glb"] {
            scenes.push(load(&Path::new(&data).join("scenes").join(name)).expect(name));
        }
    }
    for mut scene in scenes {
        complete(&mut scene, Ground::Auto);
        let (low, high) = scene.bounds().expect("triangles");
        let caches = baked(&scene, (high - low).length() / 12.0, 8);
        let size = [320, 180];
        let base = Knobs { size, light_shadows: LightShadows::Rays, ..Knobs::plain(size) };
        errors(&gpu, &scene, &caches, base);
    }
}

/// Emissive squares of different colours, one behind another: centre, rotation, colour.
fn heap() -> Vec<(DVec2, f64, Vec3)> {
    let part = |i: usize, by: f64| (i as f64 * by).fract();
    let square = |i: usize| {
        let middle = DVec2::new(part(i, 0.618) - 0.5, part(i, 0.414) - 0.5) * 1.6;
        let color = Vec3::new(part(i, 0.37) as f32, part(i, 0.73) as f32, part(i, 0.19) as f32);
        (middle, 7.0 * part(i, 0.271), color + 0.1)
    };
    (0..100).map(square).collect()
}

/// Holes of an alpha mask: the fast kind tests the mask at every sample.
#[test]
fn holes_have_the_shares_of_their_points() {
    let gpu = gpu();
    let size = 64;
    for angle in [0.2, 0.7] {
        // The mask is open where u > .5, which is a slanted line through the middle of the square.
        let mut scene = slanted(0.0);
        let turned = DVec2::from_angle(-angle);
        let u_of = |place: DVec2| 0.6 * turned.rotate(place).x + 0.5;
        for vertex in &mut scene.meshes[0].vertices {
            vertex.uv0 = Vec2::new(u_of(vertex.position.truncate().as_dvec2()) as f32, 0.5);
        }
        let rgba = [[255; 32], [0; 32]].concat();
        scene.images.push(Image { name: "half".into(), width: 16, height: 1, rgba });
        let texture = Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler: Sampler::default() };
        scene.materials[0].base_color_texture = Some(texture);
        scene.materials[0].alpha_cutoff = Some(0.5);
        let world = World::new(&gpu, &scene, None).expect("made");
        let antialiasing = Antialiasing::Fast;
        let frame = drawn_of(&gpu, &scene, &world, &Knobs { gi: Gi::Off, antialiasing, size: [size; 2], ..small() });
        let seen: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.radiance).expect("read");
        let (mut worst, mut cut) = (0.0_f64, 0);
        for (i, seen) in seen.iter().enumerate() {
            let middle = DVec2::new((i as u32 % size) as f64 + 0.5, (i as u32 / size) as f64 + 0.5);
            let points = [Vec2::ZERO].into_iter().chain(antialiasing.offsets());
            let places: Vec<DVec2> = points
                .map(|offset| ((middle + offset.as_dvec2()) / f64::from(size) * 2.0 - 1.0) * DVec2::new(1.0, -1.0))
                .collect();
            let unsure =
                places.iter().any(|p| (u_of(*p) - 0.5).abs() < 5e-4 || (p.abs().max_element() - 0.5).abs() < 1e-3);
            let inside = places.iter().filter(|p| p.abs().max_element() < 0.5 && u_of(**p) < 0.5).count() as f64 / 5.0;
            if !unsure {
                worst = worst.max((f64::from(seen[0]) - inside).abs());
                cut += usize::from(inside > 0.0 && inside < 1.0);
            }
        }
        println!("{angle}: largest error {worst:.1e}, {cut} pixels are cut");
        assert!(worst < 1e-6 && cut > 15, "{angle}: {worst} {cut}");
    }
}

#[test]
fn third_surfaces_have_the_light_of_pixels_around() {
    let gpu = gpu();
    let (size, side) = (64_u32, 0.4);
    let mut scene = Scene::default();
    for (i, (middle, angle, color)) in heap().into_iter().enumerate() {
        let material = Material { emissive: color, base_color: Vec3::ZERO.extend(1.0), ..Material::default() };
        let corner = Vec3::new(-0.5, -0.5, 0.0) * side as f32;
        let turned = DAffine3::from_rotation_z(angle);
        let place = DAffine3::from_translation(middle.extend(-0.05 * i as f64)) * turned;
        add(&mut scene, quad(corner, Vec3::X * side as f32, Vec3::Y * side as f32, 2.0), material, place);
    }
    let projection = Projection::Orthographic { ymag: 1.0 };
    scene.cameras = vec![Camera { projection, ..camera(DVec3::Z, DVec3::ZERO, 1.0) }];
    let world = World::new(&gpu, &scene, None).expect("made");
    // The square that a point shows, and whether the point is too close to an outline for a sure result.
    let shown = |p: DVec2| {
        let at = (p / f64::from(size) * 2.0 - 1.0) * DVec2::new(1.0, -1.0);
        let outside = |(middle, angle, _): &(DVec2, f64, Vec3)| {
            DVec2::from_angle(-angle).rotate(at - *middle).abs().max_element() - 0.5 * side
        };
        let unsure = heap().iter().any(|square| outside(square).abs() < 1e-4);
        (heap().iter().position(|square| outside(square) < 0.0), unsure)
    };
    for antialiasing in [Antialiasing::Four, Antialiasing::Eight] {
        let frame = drawn_of(&gpu, &scene, &world, &Knobs { gi: Gi::Off, antialiasing, size: [size; 2], ..small() });
        let seen: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.radiance).expect("read");
        let (mut right, mut all) = (0, 0);
        for (i, seen) in seen.iter().enumerate() {
            let middle = DVec2::new((i as u32 % size) as f64 + 0.5, (i as u32 / size) as f64 + 0.5);
            let points: Vec<_> =
                [Vec2::ZERO].into_iter().chain(antialiasing.offsets()).map(|o| shown(middle + o.as_dvec2())).collect();
            let kinds: HashSet<_> = points.iter().map(|(shown, _)| shown).collect();
            if kinds.len() < 3 || points.iter().any(|(_, unsure)| *unsure) {
                continue;
            }
            let color = |shown: &(Option<usize>, bool)| shown.0.map_or(Vec3::ZERO, |i| heap()[i].2);
            let mean = points.iter().map(color).sum::<Vec3>() / points.len() as f32;
            all += 1;
            right += usize::from((Vec3::from_slice(seen) - mean).abs().max_element() < 1e-5);
        }
        println!("{antialiasing:?}: {right} of {all} pixels with three or more surfaces are right");
        assert!(all > 20 && 5 * right >= 4 * all, "{right} of {all}");
    }
}

#[test]
fn textures_are_means_over_points() {
    let gpu = gpu();
    let mut scene = slanted(0.3);
    let texels =
        (0..32 * 32_u32).flat_map(|i| [i.wrapping_mul(2_654_435_761).to_be_bytes()[0]; 3].into_iter().chain([255]));
    for vertex in &mut scene.meshes[0].vertices {
        vertex.uv0 = vertex.position.truncate();
    }
    scene.images.push(Image { name: "noise".into(), width: 32, height: 32, rgba: texels.collect() });
    let texture = Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler: Sampler::default() };
    let noise = Some(texture);
    let own = scene.materials[0].clone();
    scene.materials[0] =
        Material { base_color: Vec4::ONE, metallic: 0.0, base_color_texture: noise, emissive_texture: noise, ..own };
    let world = World::new(&gpu, &scene, None).expect("made");
    let images = |size: u32, antialiasing| {
        let frame = drawn_of(&gpu, &scene, &world, &Knobs { gi: Gi::Off, antialiasing, size: [size; 2], ..small() });
        let surface = &frame.picture.surface;
        let halves: Vec<[u16; 4]> = gpu.read_image(&surface.albedo).expect("read");
        let emitted: Vec<[f32; 4]> = gpu.read_image(&surface.radiance).expect("read");
        let depths: Vec<f32> = gpu.read_image(&surface.depth).expect("read");
        let albedos = halves.iter().map(|texel| half::f16::from_bits(texel[0]).to_f32());
        albedos.zip(emitted).zip(depths).map(|((a, e), d)| [a, e[0], d]).collect::<Vec<_>>()
    };
    let (size, many) = (32, 8);
    let truth = images(size * many, Antialiasing::Off);
    let of_pixel = |i: u32| (0..many * many).map(|sample| truth[truth_at(i, sample, size, many)]).collect::<Vec<_>>();
    let error = |antialiasing| {
        let seen = images(size, antialiasing);
        let mut squares = [0.0_f64; 2];
        for (i, seen) in seen.iter().enumerate() {
            let samples = of_pixel(i as u32);
            if samples.iter().all(|sample| sample[2] > 0.0) {
                for (which, square) in squares.iter_mut().enumerate() {
                    let mean = samples.iter().map(|sample| sample[which]).sum::<f32>() / samples.len() as f32;
                    *square += f64::from(seen[which] - mean).powi(2);
                }
            }
        }
        squares.map(f64::sqrt)
    };
    // A sample of many has its own share of the pixel: about that of the four points in its middle.
    let middle = |i: u32| [27, 28, 35, 36].map(|sample| truth[truth_at(i, sample, size, many)]);
    let off_middle = |antialiasing| {
        let seen = images(size, antialiasing);
        let inside = (0..size * size).filter(|i| of_pixel(*i).iter().all(|sample| sample[2] > 0.0));
        let square = |i: u32| (seen[i as usize][0] - middle(i).iter().map(|s| s[0]).sum::<f32>() / 4.0).powi(2);
        f64::from(inside.map(square).sum::<f32>()).sqrt()
    };
    let [own, whole] = [Antialiasing::Supersampled, Antialiasing::Off].map(off_middle);
    println!("albedo of a sample: RMSE {:.3} of that with the whole pixel's", own / whole);
    assert!(own < 0.3 * whole, "{own} {whole}");
    let [off, fast, four, eight] = KINDS.map(error);
    println!("albedo: RMSE relative to off {:.3} with the fast kind", fast[0] / off[0]);
    assert!(fast[0] < 0.5 * off[0], "{fast:?} {off:?}");
    for (which, name) in ["albedo", "emission"].into_iter().enumerate() {
        let [four, eight] = [four, eight].map(|found| found[which] / off[which]);
        println!("{name}: RMSE relative to off {four:.3} with 4 points, {eight:.3} with 8");
        assert!(four < 0.4 && eight < 0.4, "{name}: {four} {eight}");
    }
}

/// Index in the larger picture of one of a pixel's `many` x `many` samples.
fn truth_at(pixel: u32, sample: u32, size: u32, many: u32) -> usize {
    let (x, y) = (pixel % size * many + sample % many, pixel / size * many + sample / many);
    (y * size * many + x) as usize
}
