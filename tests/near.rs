//! Short rays at pixels: they agree with f64 rays, they bring pictures closer to the path tracer's, and no combination
//! of settings gives stale or broken results.

use glam::{DAffine3, DVec2, DVec3, Vec3};
use lightskin::bake::{BakeSettings, CacheSet, Density, bake};
use lightskin::frame::engine::Loaded;
use lightskin::frame::near::CACHE_REACH;
use lightskin::frame::{Antialiasing, Engine, LightShadows, Look, Near, Picture, Quality, Shadows, View, World};
use lightskin::lab::knobs::Knobs;
use lightskin::lab::scenes::{Shadowed, measured};
use lightskin::metrics::{Metrics, metrics};
use lightskin::reference::depth_image::tangents;
use lightskin::reference::near as reference;
use lightskin::reference::near::{part_counts, radiances, solid_angle, unpack_radiance};
use lightskin::reference::path_trace::{PathTrace, PathTraceSettings};
use lightskin::scene::build::{CornellSurface, atrium, cornell, cuboid, sphere};
use lightskin::scene::sky::Sky;
use lightskin::scene::{Material, Phong, Projection, Scene, luminance};
use lightskin::shared::{
    Cache, DEPTH_IMAGE_SIDE, DEPTH_IMAGE_TEXELS, DIRECTIONS, GUIDE_WORDS, GUIDES, NearLight, NearPixel, Val,
};

use crate::common::frames::{add, baked, drawn_of, drawn_turned, phong, planes, shoot, small};
use crate::common::{assert_clean, gpu, rounding};

const RAYS: Near = Near::Rays { per_pixel: 8, every: 2 };

fn near(size: [u32; 2]) -> Knobs {
    Knobs { size, near: RAYS, shadows: Shadows::PerLight, rsm: 96, light_shadows: LightShadows::Maps(1024), ..small() }
}

#[test]
fn directions_of_light_are_those_of_f64() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Diffuse, 0.1);
    let caches = baked(&scene, 0.4, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let mut lit = Vec::new();
    // Neighbours in the RSM of 96 x 96 texels are merged. What they lose and gain by shared visibility is small.
    for (shadows, rsm, together, [limit, gained]) in [
        (Shadows::Off, 48, 1, [3e-3, 1e-3]),
        (Shadows::Off, 96, 4, [3e-3, 1e-3]),
        (Shadows::PerLight, 48, 1, [3e-3, 1e-3]),
        (Shadows::PerLight, 96, 4, [3e-3, 0.01]),
    ] {
        let knobs = Knobs { shadows, rsm, ..near([96, 64]) };
        let frame = drawn_of(&gpu, &scene, &world, &knobs);
        let light = frame.light.caches().expect("caches");
        let live = light.gather.live().expect("a list");
        let list: Vec<u32> = gpu.read(&live.list).expect("read");
        let count = live.lit(&gpu).expect("read") as usize;
        let vals: Vec<Val> = gpu.read(&frame.light.vals().expect("VALs").live).expect("read");
        let val_count: u32 = gpu.read(&frame.light.vals().expect("VALs").live_count).expect("read")[0];
        let places: Vec<Cache> = gpu.read(&light.atlas.caches).expect("read");
        let images = light.gather.depth_images().map(|images| planes(&gpu, images));
        let found: Vec<u32> = gpu.read(light.gather.radiances().expect("directions")).expect("read");
        let near = CACHE_REACH * world.spacing();
        let fade = [0.8, 1.2].map(|share: f64| (share * near).powi(2));
        let guides: Vec<u32> = gpu.read(light.gather.guides().expect("directions")).expect("read");
        let (mut off, mut sum, mut all, mut moved) = (0.0, DVec3::ZERO, [DVec3::ZERO; 2], 0);
        for (slot, cache) in list[..count].iter().enumerate() {
            let (position, normal) = (places[*cache as usize].position, places[*cache as usize].normal);
            let (position, normal) = (position.as_dvec3(), normal.as_dvec3());
            let [right, up] = tangents(normal);
            let sees = |d: DVec3| {
                let Some(images) = &images else { return true };
                let texel = |axis: DVec3| {
                    let half = f64::from(DEPTH_IMAGE_SIDE) / 2.0;
                    (axis.dot(d.normalize()) * half + half).clamp(0.0, 2.0 * half - 0.5) as usize
                };
                let at = texel(up) * DEPTH_IMAGE_SIDE as usize + texel(right);
                images[slot * DEPTH_IMAGE_TEXELS as usize + at].dot(d) <= 1.0
            };
            let lit = &vals[..val_count as usize];
            let expected = radiances(lit, (position, normal), fade, together, sees);
            let unmerged = radiances(lit, (position, normal), fade, 1, sees);
            all[1] += unmerged.iter().enumerate().map(|(i, radiance)| radiance * solid_angle(i)).sum::<DVec3>();
            for (direction, expected) in expected.into_iter().enumerate() {
                let packed = found[*cache as usize * DIRECTIONS as usize + direction];
                let shown = unpack_radiance(packed);
                off += (shown - expected).length();
                sum += expected;
                all[0] += shown * solid_angle(direction);
            }
            // Parts are listed in the order of directions.
            let shown: Vec<_> = found[*cache as usize * DIRECTIONS as usize..][..DIRECTIONS as usize]
                .iter()
                .map(|packed| unpack_radiance(*packed))
                .collect();
            let words = &guides[*cache as usize * GUIDE_WORDS as usize..][..GUIDE_WORDS as usize];
            let (counts, parts) = words.split_at(DIRECTIONS as usize);
            let counts = counts.iter().map(|word| word & 0xff);
            let parts = parts.iter().flat_map(|word| word.to_le_bytes());
            let listed = (0_u8..).zip(counts.clone()).flat_map(|(direction, count)| vec![direction; count as usize]);
            assert!(parts.eq(listed) || counts.clone().all(|count| count == 0), "{words:x?}");
            let wanted = part_counts(&shown.into_iter().map(luminance).collect::<Vec<_>>(), normal);
            moved += wanted.iter().zip(counts).map(|(wanted, count)| wanted.abs_diff(count)).sum::<u32>();
        }
        println!("{shadows:?}, {rsm} texels: {count} caches, relative error {:.5}", off / sum.length());
        assert!(count > 20 && off < limit * sum.length(), "{count} caches, off by {off} of {sum}");
        println!("{moved} of {} parts are elsewhere", GUIDES as usize * count);
        assert!((moved as usize) < GUIDES as usize * count / 20);
        println!("relative error of all light {:.4}", all[0].distance(all[1]) / all[1].length());
        assert!(all[0].distance(all[1]) < gained * all[1].length(), "{all:?}");
        lit.push(sum.length());
    }
    assert!(lit[2] < 0.99 * lit[0], "shadows must reduce the light: {lit:?}");
    assert_clean(&gpu);
}

/// If vertex normals point into a body, the rays of its pixels are mirrored outwards, but look up the caches' light in
/// their original direction.
#[test]
fn rays_that_are_turned_ask_for_their_own_direction() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Diffuse, 0.2);
    let body = cuboid(Vec3::splat(-0.3), Vec3::splat(0.3), 0.2, |_| true);
    let place = DVec3::new(0.0, 0.5, 0.5);
    add(&mut scene, body, phong([0.6; 3], [0.0; 3], 1.0), DAffine3::from_translation(place));
    scene.meshes.last_mut().expect("a body").vertices.iter_mut().for_each(|v| v.normal = -v.normal);
    let caches = baked(&scene, 0.4, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let frame = drawn_of(&gpu, &scene, &world, &Knobs { shadows: Shadows::Off, ..near([96, 64]) });
    let pixels: Vec<NearPixel> = gpu.read(&frame.picture.near.as_ref().expect("rays").pixels).expect("read");
    let on_body = pixels.iter().filter(|p| {
        let position = p.position;
        p.geometric > 0.0 && (position.as_dvec3() + world.origin - place).abs().max_element() < 0.301
    });
    let [asked, all] = on_body.fold([0, 0], |[asked, all], p| [asked + usize::from({ p.all } != Vec3::ZERO), all + 1]);
    println!("{asked} of {all} pixels look light up");
    assert!(all > 50 && asked * 10 > all * 9, "{asked} of {all} pixels look light up");
    assert_clean(&gpu);
}

/// Unit normals of the vertices and of the triangle that a pixel shows.
fn normals_of(pixel: &NearPixel) -> [DVec3; 2] {
    [{ pixel.normal }.as_dvec3(), reference::decoded_normal(pixel.geometric)]
}

#[test]
fn neighbours_share_their_rays() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    // Vertex normals of few triangles lean.
    let place = DAffine3::from_translation(DVec3::new(0.3, 0.9, 0.5));
    add(&mut scene, sphere(0.5, 5), phong([0.6; 3], [0.0; 3], 1.0), place);
    Sky::even(Vec3::new(2.0, 3.0, 5.0)).put_over(&mut scene, 4);
    let caches = baked(&scene, 0.4, 8);
    let knobs = Knobs { near: Near::Rays { per_pixel: 8, every: 1 }, ..near([160, 108]) };
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let frame = drawn_of(&gpu, &scene, &world, &knobs);
    let found = frame.picture.near.as_ref().expect("rays");
    let pixels: Vec<NearPixel> = gpu.read(&found.pixels).expect("read");
    let lights: Vec<NearLight> = gpu.read(&found.lights).expect("read");
    let size = found.size.map(|side| side as usize);
    let [width, height] = size;
    // Combines each pixel's window of this radius. Its outermost pixels count half.
    let taken = |index: usize, half: isize| {
        let weight = |k: isize| if k.abs() == half { 0.5 } else { 1.0 };
        let own = pixels[index];
        let (mut sum, mut weights, mut far, mut all) = (DVec3::ZERO, 0.0, DVec3::ZERO, DVec3::ZERO);
        let [mut crowding, mut open, mut squared] = [0.0; 3];
        let [mut open_sky, mut all_sky] = [DVec3::ZERO; 2];
        let mut hidden_sky = DVec2::ZERO;
        for (i, j) in (-half..=half).flat_map(|j| (-half..=half).map(move |i| (i, j))) {
            let x = (index % width).checked_add_signed(i).filter(|x| *x < width);
            let y = (index / width).checked_add_signed(j).filter(|y| *y < height);
            let Some(p) = x.zip(y).map(|(x, y)| pixels[y * width + x]).filter(|p| p.geometric > 0.0) else { continue };
            let d = { own.position }.as_dvec3() - { p.position }.as_dvec3();
            let w = weight(i) * weight(j) * reference::alike(d, normals_of(&own), normals_of(&p));
            sum += w * { p.irradiance }.as_dvec3();
            far += w * { p.far }.as_dvec3();
            squared += w * luminance(({ p.irradiance } + { p.far }).as_dvec3()).powi(2);
            all += w * { p.all }.as_dvec3();
            crowding += w * f64::from(p.crowding);
            open_sky += w * { p.open_sky }.as_dvec3();
            hidden_sky += w * { p.hidden_sky }.as_dvec2();
            all_sky += w * { p.all_sky }.as_dvec3();
            open += w * f64::from(p.open);
            weights += w;
        }
        (own.geometric > 0.0).then(|| reference::Found {
            irradiance: sum / weights,
            open: far / all,
            // Where no sky is known, it is as open as directions are on average.
            open_sky: if all_sky.min_element() > 0.0 { open_sky / all_sky } else { DVec3::splat(open / weights) },
            sky_crowding: hidden_sky.y / hidden_sky.x.max(1e-37),
            crowding: crowding / weights,
            light: luminance((sum + far) / weights),
            light_squared: squared / weights,
            position: { own.position }.as_dvec3(),
            normals: normals_of(&own),
        })
    };
    let once: Vec<_> = (0..width * height).map(|i| taken(i, 2)).collect();
    let spread_of =
        |found: Vec<_>| [2, 5, 13, 32].iter().fold(found, |found, step| reference::spread(&found, size, *step));
    let spread = spread_of(once.clone());
    // As if no pixel were darker than its neighbours.
    let even = |found: &Option<reference::Found>| {
        found.map(|found| reference::Found { light: 1.0, light_squared: 1.0, ..found })
    };
    let everywhere = spread_of(once.iter().map(even).collect());
    let (mut most, mut moved, mut stopped, mut apart, mut shown) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64, 0);
    for (i, (wanted, light)) in spread.iter().zip(&lights).enumerate() {
        let Some(wanted) = wanted else { continue };
        let (irradiance, open) = ({ light.irradiance }.as_dvec3(), { light.open }.as_dvec3());
        let off = (irradiance - wanted.irradiance).length() / (wanted.irradiance.length() + 1e-6);
        most = most.max(off).max((open - wanted.open).abs().max_element());
        most = most.max(({ light.open_sky }.as_dvec3() - wanted.open_sky).abs().max_element());
        apart = apart.max((wanted.open_sky - wanted.open).abs().max_element());
        let before = once[i].expect("a surface");
        let length = wanted.irradiance.length() + 1e-6;
        moved = moved.max((before.irradiance - wanted.irradiance).length() / length);
        stopped = stopped.max((everywhere[i].expect("a surface").irradiance - wanted.irradiance).length() / length);
        shown += 1;
    }
    println!(
        "{shown} pixels: largest difference from the twin {most:.1e}; largest change by spreading {moved:.2}; largest by \
         what is not spread into darkness {stopped:.2}"
    );
    assert!(
        shown > 1000 && most < 3e-3 && moved > 0.05 && stopped > 0.02,
        "{shown} pixels: differ by {most} from the twin, changed by {moved}, {stopped}"
    );
    // Pictures of which the caller takes the mean are filtered over a narrower window, not spread.
    let frame = drawn_of(&gpu, &scene, &world, &Knobs { antialiasing: Antialiasing::Supersampled, ..knobs });
    let lights: Vec<NearLight> = gpu.read(&frame.picture.near.as_ref().expect("rays").lights).expect("read");
    let off = |(i, light): (usize, &NearLight)| {
        let wanted = taken(i, 1)?.irradiance;
        Some(({ light.irradiance }.as_dvec3() - wanted).length() / (wanted.length() + 1e-6))
    };
    let off = lights.iter().enumerate().filter_map(off).fold(0.0, f64::max);
    println!("one of many pictures: largest difference from what the filter gives {off:.1e}");
    assert!(off < 1e-4, "{off}");
    // The sky comes from the box's open side, other far light from everywhere else.
    assert!(apart > 0.2, "shares of the sky and of other light differ by {apart} at most");
    assert_clean(&gpu);
}

/// Diffuse indirect light from the path tracer with at most this many bounces.
fn paths(scene: &Scene, size: [u32; 2], bounces: u32, passes: usize) -> Vec<[f32; 3]> {
    let settings = PathTraceSettings::engine(size, bounces);
    let mut paths = PathTrace::new(scene, &scene.cameras[0], &settings);
    (0..passes).for_each(|_| paths.pass());
    paths.diffuse()
}

fn against(scene: &Scene, caches: &CacheSet, knobs: &Knobs, truth: &[[f32; 3]]) -> Metrics {
    let shot = shoot(&gpu(), scene, Some(caches), knobs);
    let shown: Vec<[f32; 3]> = shot.diffuse.iter().map(|p| p.as_vec3().to_array()).collect();
    metrics(&shown, truth)
}

#[test]
fn every_number_of_bounces_is_the_path_tracers() {
    let scene = cornell(CornellSurface::Diffuse, 0.1);
    let caches = baked(&scene, 0.25, 8);
    for bounces in [1, 4] {
        let truth = paths(&scene, [72, 48], bounces, 16);
        let by_default = (Near::Rays { per_pixel: 8, every: 0 }, [0.015, 0.015]);
        // At this size the pixels that share rays reach far into shadows.
        let endless = (Near::Endless { per_pixel: 32, every: 1 }, [0.02, 0.04]);
        for (kind, [bias, relmse]) in [by_default, endless] {
            let m = against(&scene, &caches, &Knobs { bounces, near: kind, ..near([72, 48]) }, &truth);
            println!(
                "{bounces} bounces, {kind:?}: bias {:+.4}, relMSE without the worst 1 % {:.4}",
                m.bias, m.relmse_trimmed
            );
            assert!(m.bias.abs() < bias && m.relmse_trimmed < relmse, "{bounces} bounces, {kind:?}: {m:?}");
        }
    }
}

#[test]
fn what_stands_nearby_is_nearer_to_paths() {
    let scene = Shadowed::Gap.scene();
    let caches = baked(&scene, 0.25, 8);
    let truth = paths(&scene, [96, 54], 1, 8);
    let [off, on, endless] = [Near::Off, RAYS, Near::Endless { per_pixel: 32, every: 1 }]
        .map(|near_is| against(&scene, &caches, &Knobs { near: near_is, ..near([96, 54]) }, &truth).relmse_trimmed);
    println!(
        "relMSE without the worst 1 %: {off:.4} with caches alone, {on:.4} with rays, {endless:.4} if they are endless"
    );
    let most = if rounding(&gpu()) > 1.0 { 0.85 } else { 0.8 };
    assert!(on < most * off && endless < most * off, "relMSE {on} and {endless} with rays, {off} without");
}

#[test]
fn lobes_are_spread_over_what_mirrors_the_same() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Glossy, 0.1);
    for phong in scene.materials.iter_mut().filter_map(|material| material.phong.as_mut()) {
        phong.exponent = 10.0;
    }
    // A narrow view: neighbouring pixels reflect almost the same.
    scene.cameras[0].projection = Projection::Perspective { yfov: 0.2 };
    let caches = baked(&scene, 0.4, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let frame = drawn_of(&gpu, &scene, &world, &near([96, 64]));
    let found = frame.picture.near.as_ref().expect("rays");
    // Input and output of the last spreading pass.
    let halfway = found.halfway.as_ref().expect("spreading");
    let [before, after] = [halfway, &found.lights].map(|lights| gpu.read::<NearLight>(lights).expect("read"));
    let lobe = |light: &NearLight| {
        let place = { light.normal }.as_dvec2();
        (light.width > 0.0).then(|| reference::FoundLobe {
            taken: { light.glossy }.as_dvec3(),
            position: { light.position }.as_dvec3(),
            normals: [
                reference::on_octahedron(place.x, place.y).normalize(),
                reference::decoded_normal(light.geometric),
            ],
            mirrored: { light.mirrored }.as_dvec3(),
            width: light.width.into(),
            nearness: light.nearness.into(),
        })
    };
    let lobes: Vec<_> = before.iter().map(lobe).collect();
    let wanted = reference::spread_lobes(&lobes, found.size.map(|side| side as usize), 32);
    let (mut most, mut moved, mut count) = (0.0_f64, 0.0_f64, 0);
    for ((wanted, light), before) in wanted.iter().zip(&after).zip(&lobes) {
        let (Some(wanted), Some(before)) = (wanted, before) else { continue };
        most = most.max(({ light.glossy }.as_dvec3() - *wanted).length() / (wanted.length() + 1e-6));
        moved = moved.max((before.taken - *wanted).length() / (wanted.length() + 1e-6));
        count += 1;
    }
    println!("{count} lobes: largest difference from the twin {most:.1e}; largest change by the pass {moved:.4}");
    assert!(
        count > 500 && most < 1e-5 && moved > 3e-4,
        "{count} lobes: differ by {most} from the twin, changed by {moved}"
    );
    assert_clean(&gpu);
}

/// Squares of 4 x 4 pixels share their directions. On a glossy floor they must not show. Such a pattern bends most
/// over two pixels and not at all over four. Smooth light bends four times as much over four as over two.
#[test]
fn squares_that_share_rays_do_not_show() {
    let gpu = gpu();
    let scene = Shadowed::Columns.scene();
    let knobs = Knobs { near: Near::Rays { per_pixel: 8, every: 1 }, ..near([240, 135]) };
    let shot = shoot(&gpu, &scene, Some(&baked(&scene, 0.25, 8)), &knobs);
    let light: Vec<f64> = shot.glossy.iter().map(|p| luminance(*p)).collect();
    let brightest = light.iter().copied().fold(0.0, f64::max);
    let on_floor = |i: usize| shot.covered[i] && shot.normals[i].y > 0.99;
    let shown = (4..light.len() - 4).filter(|i| (i % 240).clamp(4, 235) == i % 240 && light[*i] > 0.05 * brightest);
    let floor: Vec<usize> = shown.filter(|i| (i - 4..=i + 4).all(on_floor)).collect();
    let bend =
        |by: usize| -> f64 { floor.iter().map(|i| (light[i - by] - 2.0 * light[*i] + light[i + by]).abs()).sum() };
    let ratio = bend(2) / bend(4);
    println!("{} pixels of the floor: bend over two pixels {ratio:.3} of that over four", floor.len());
    assert!(floor.len() > 1000 && ratio < 0.45, "{ratio} on {} pixels", floor.len());
    assert_clean(&gpu);
}

/// In small pictures every pixel has rays by default, else every fourth; a setting decides for all sizes.
#[test]
fn small_pictures_trace_every_pixel() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Diffuse, 1.0);
    let caches = baked(&scene, 0.5, 8);
    let world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    for (every, size, traced) in [(0, [96, 54], [96, 54]), (2, [96, 54], [48, 27]), (0, [640, 361], [320, 181])] {
        let knobs = Knobs { near: Near::Rays { per_pixel: 1, every }, ..near(size) };
        let frame = drawn_of(&gpu, &scene, &world, &knobs);
        assert_eq!(frame.picture.near.as_ref().expect("rays").size, traced);
    }
    assert_clean(&gpu);
}

/// Hits nearer than two traced pixels, as right in a corner, do not keep the lobes of other pixels apart. Otherwise each
/// pixel beside them would show a single ray.
#[test]
fn the_nearest_hits_do_not_keep_lobes_apart() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Glossy, 0.1);
    let knobs = near([96, 84]);
    let world = World::new(&gpu, &scene, Some(&baked(&scene, 0.4, 8))).expect("uploaded");
    let frame = drawn_of(&gpu, &scene, &world, &knobs);
    let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
    let every = knobs.near.every(knobs.size);
    let slope = view.clip_from_world.row(1).truncate().length() * knobs.size[1] as f32;
    let pixels: Vec<NearPixel> = gpu.read(&frame.picture.near.as_ref().expect("rays").pixels).expect("read");
    let nearness = |p: &NearPixel| {
        let depth = view.clip_from_world.row(3).dot({ p.position }.extend(1.0));
        p.nearness * 4.0 * every as f32 * depth / slope
    };
    let mut all: Vec<f32> = pixels.iter().filter(|p| p.width > 0.0).map(nearness).collect();
    all.sort_by(f32::total_cmp);
    let (most, middle) = (all[all.len() - 1], all[all.len() / 2]);
    println!("{} lobes: nearness {middle:.4} in the middle and at most {most:.4}, by two traced pixels", all.len());
    assert!(all.len() > 1000 && (0.99..1.001).contains(&most) && middle < 0.2, "{most}, {middle}");
    assert_clean(&gpu);
}

#[test]
fn views_of_a_reference_have_their_own_rays_of_lobes() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Glossy, 0.1);
    let world = World::new(&gpu, &scene, Some(&baked(&scene, 0.4, 8))).expect("uploaded");
    // Only rays of lobes count for the nearness.
    let [plain, again, turned] = [0.0, 0.0, 2.0].map(|turn| {
        let frame = drawn_turned(&gpu, &scene, &world, &near([96, 64]), turn);
        let pixels: Vec<NearPixel> = gpu.read(&frame.picture.near.as_ref().expect("rays").pixels).expect("read");
        pixels.iter().filter(|p| p.width > 0.0).map(|p| p.nearness).collect::<Vec<_>>()
    });
    let moved = plain.iter().zip(&turned).filter(|(a, b)| a != b).count();
    println!("{moved} of {} lobes have other rays", plain.len());
    assert!(plain == again && plain.len() > 500 && 2 * moved > plain.len(), "{moved} of {}", plain.len());
    assert_clean(&gpu);
}

#[test]
fn metals_mirror_what_paths_do() {
    // The wall that the spot does not light is of metal. Paths hardly find light that narrow lobes concentrate. Known: seen
    // at grazing angles, rough metal is a fifth too dark.
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    let caches = baked(&scene, 0.3, 8);
    let wall = scene.materials.iter().position(|material| material.name == "green").expect("a green wall");
    for (roughness, most) in [(0.15, 0.03), (0.4, 0.25)] {
        let base_color = Vec3::splat(0.8).extend(1.0);
        scene.materials[wall] = Material { base_color, metallic: 1.0, roughness, ..Material::default() };
        let size = [72, 48];
        let mut paths = PathTrace::new(&scene, &scene.cameras[0], &PathTraceSettings::engine(size, 2));
        (0..24).for_each(|_| paths.pass());
        let shot = shoot(&gpu(), &scene, Some(&caches), &Knobs { bounces: 2, ..near(size) });
        let shown: Vec<[f32; 3]> = shot.glossy.iter().map(|p| p.as_vec3().to_array()).collect();
        let m = metrics(&shown, &paths.glossy());
        println!("roughness {roughness}: bias {:+.4}, relMSE without the worst 1 % {:.4}", m.bias, m.relmse_trimmed);
        assert!(m.bias.abs() < most && m.relmse_trimmed < 0.03, "roughness {roughness}: {m:?}");
    }
}

#[test]
fn wide_lobes_have_the_light_of_paths() {
    let mut scene = atrium();
    for material in &mut scene.materials {
        material.phong = Some(Phong { specular: Vec3::splat(0.3), exponent: 4.0 });
    }
    let settings = BakeSettings { density: Density::Count(1000), angle: 30f32.to_radians(), references: 8 };
    let caches = bake(&scene, &settings, &|_, _| ()).expect("baked");
    let settings = PathTraceSettings { glossy_bounces: true, ..PathTraceSettings::engine([96, 54], 1) };
    let mut paths = PathTrace::new(&scene, &scene.cameras[0], &settings);
    (0..5).for_each(|_| paths.pass());
    let [off, on] = [Near::Off, RAYS].map(|near_is| {
        let shot = shoot(&gpu(), &scene, Some(&caches), &Knobs { near: near_is, ..near([96, 54]) });
        let shown: Vec<[f32; 3]> = shot.glossy.iter().map(|p| p.as_vec3().to_array()).collect();
        metrics(&shown, &paths.glossy())
    });
    println!("lobes: bias {:+.4} with caches alone, {:+.4} with rays", off.bias, on.bias);
    assert!(on.bias.abs() < 0.08 && off.bias.abs() > 0.2, "{on:?} with rays, {off:?} without");
}

/// A sealed room next to a lit one gets no light. Bounds the light that leaks into it, relative to the lit room's.
#[test]
fn wide_lobes_of_gltf_have_their_own_shape() {
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    for material in &mut scene.materials {
        (material.phong, material.roughness, material.metallic) = (None, 0.5, 0.0);
    }
    let caches = baked(&scene, 0.2, 8);
    let settings = PathTraceSettings { glossy_bounces: true, ..PathTraceSettings::engine([96, 64], 1) };
    let mut paths = PathTrace::new(&scene, &scene.cameras[0], &settings);
    (0..24).for_each(|_| paths.pass());
    let shot = shoot(&gpu(), &scene, Some(&caches), &near([96, 64]));
    let shown: Vec<[f32; 3]> = shot.glossy.iter().map(|p| p.as_vec3().to_array()).collect();
    let found = metrics(&shown, &paths.glossy());
    println!("lobes of roughness .5: bias {:+.4}, trimmed relMSE {:.4}", found.bias, found.relmse_trimmed);
    assert!(found.bias.abs() < 0.15 && found.relmse_trimmed < 0.25, "{found:?}");
}

#[test]
fn a_sealed_room_stays_dark() {
    let gpu = gpu();
    let settings = BakeSettings { density: Density::Count(1000), angle: 30f32.to_radians(), references: 8 };
    for (name, scene) in measured().into_iter().filter(|(name, _)| name.starts_with("dark")) {
        let caches = bake(&scene, &settings, &|_, _| ()).expect("baked");
        for (bounces, limit) in [(1, 0.006), (4, 0.007)] {
            let knobs = Knobs { bounces, ..near([64, 36]) };
            let [dark, lit] = [0, 1].map(|camera| {
                let seen = Scene { cameras: vec![scene.cameras[camera].clone()], ..scene.clone() };
                shoot(&gpu, &seen, Some(&caches), &knobs).diffuse.iter().map(|d| d.element_sum()).sum::<f64>()
            });
            println!("{name}, {bounces} bounces: {:.2} %", 100.0 * dark / lit);
            assert!(dark < limit * lit, "{name}, {bounces} bounces: {dark} in the dark room, {lit} in the lit one");
        }
    }
}

#[test]
fn every_way_is_clean() {
    let gpu = gpu();
    for surface in [CornellSurface::Diffuse, CornellSurface::Glossy] {
        let scene = cornell(surface, 0.2);
        let vertices = baked(&scene, 0.5, 8);
        let cells = vertices.clone().with_cells(&scene).expect("cells");
        let many = if surface == CornellSurface::Diffuse { [1, 3] } else { [3, 1] };
        for (caches, bounces) in [&vertices, &cells].into_iter().zip(many) {
            for shadows in [Shadows::Off, Shadows::Proxy, Shadows::PerLight] {
                let every = [(RAYS, Antialiasing::Four), (Quality::Reference.near(), Antialiasing::Off)];
                // The reference's own shaders depend only on materials and caches: one mode of shadows tests them.
                let few = if shadows == Shadows::PerLight { 2 } else { 1 };
                for (near_is, antialiasing) in every.into_iter().take(few) {
                    let knobs = Knobs { bounces, shadows, near: near_is, antialiasing, ..near([20, 14]) };
                    let shot = shoot(&gpu, &scene, Some(caches), &knobs);
                    assert_eq!(shot.complaints, [""; 0], "{knobs:?}");
                    assert!(shot.diffuse.iter().any(|d| *d != DVec3::ZERO), "{knobs:?}");
                }
            }
        }
    }
}

#[test]
fn rays_find_what_has_moved() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Diffuse, 0.2);
    let body = cuboid(Vec3::splat(-0.2), Vec3::splat(0.2), 0.2, |_| true);
    add(&mut scene, body, phong([0.6, 0.2, 0.2], [0.0; 3], 1.0), DAffine3::from_translation(DVec3::new(0.0, 0.3, 0.5)));
    let caches = baked(&scene, 0.4, 8);
    let knobs = near([48, 32]);
    let picture = |world: &World| {
        let frame = drawn_of(&gpu, &scene, world, &knobs);
        gpu.read_image::<f32>(&frame.picture.indirect.as_ref().expect("indirect").diffuse).expect("read")
    };
    let mut world = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let before = picture(&world);
    let mut moved = scene.clone();
    moved.instances.last_mut().expect("a body").world_from_model.translation.x += 0.4;
    world.update(&gpu, &moved).expect("updated");
    let after = picture(&world);
    assert!(before != after, "the picture must show that the body has moved");
    moved.instances.last_mut().expect("a body").world_from_model.translation.x -= 0.4;
    world.update(&gpu, &moved).expect("updated");
    assert!(picture(&world) == before, "moving the body back must restore the picture");
    assert_clean(&gpu);
}

/// In a scene without instances that are declared to move, the first edit rebuilds the hierarchies. Then pictures are
/// bit-identical to those of an engine that knew of the movement from the start.
#[test]
fn what_moves_by_surprise_is_shown_as_if_it_had_been_known() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Diffuse, 0.2);
    let body = cuboid(Vec3::splat(-0.2), Vec3::splat(0.2), 0.2, |_| true);
    add(&mut scene, body, phong([0.6, 0.2, 0.2], [0.0; 3], 1.0), DAffine3::from_translation(DVec3::new(0.0, 0.3, 0.5)));
    scene.extent = scene.bounds();
    let caches = baked(&scene, 0.4, 8);
    let settings = Knobs { reuse: true, ..near([48, 32]) }.settings();
    let engine = |scene: &Scene| {
        let loaded = Loaded { scene: scene.clone(), caches: Some(caches.clone()) };
        let engine = Engine::new(&gpu, loaded, &settings).expect("made");
        let picture = engine.picture(&gpu, [48, 32]).expect("made");
        (engine, picture)
    };
    let shown = |(engine, picture): &mut (Engine, Picture)| {
        engine.fit(&gpu, &mut [(picture, [48, 32])]).expect("fits");
        let view = engine.view(&engine.scene().cameras[0].clone(), [48, 32]);
        let drawn = gpu.frame(|cmd| {
            engine.record(cmd, &mut [(view, picture)], &Look::default());
            Ok(())
        });
        assert_eq!(drawn.expect("drawn").problems, [""; 0]);
        gpu.read_image::<u32>(&picture.indirect.as_ref().expect("indirect").diffuse).expect("read")
    };
    let mut surprised = engine(&scene);
    let before = shown(&mut surprised);
    let last = scene.instances.len() - 1;
    scene.instances[last].moves = true;
    for step in 1..4 {
        let turn = DAffine3::from_rotation_y(0.4) * DAffine3::from_rotation_x(0.3);
        let body = &mut scene.instances[last];
        body.world_from_model = DAffine3::from_translation(DVec3::X * 0.1) * body.world_from_model * turn;
        let place = body.world_from_model;
        surprised.0.edit(&gpu, |scene| scene.instances[last].world_from_model = place).expect("edited");
        let found = shown(&mut surprised);
        assert!(found != before && found == shown(&mut engine(&scene)), "step {step}");
    }
    assert_clean(&gpu);
}
