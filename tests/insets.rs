//! Insets of the window: the map of a light drawn again, images with texels as squares, and the depth image of the cache
//! nearest to a pixel's surface.

use crate::common::frames::{SPOT, baked, corner, drawn_of, planes, small};
use crate::common::{assert_clean, gpu};
use crate::debug_views::{BYTES, ONE_TO_ONE, pass};
use glam::{DVec2, DVec3, Vec3, Vec4};
use lightskin::frame::rsm::{Rsm, RsmCopy};
use lightskin::frame::{LightShadows, Near, Shadows, View, World};
use lightskin::gpu::{Attach, Attachments, Bind, Extent, Format, Gpu, Image, ImageDesc, Shape, Use};
use lightskin::lab::knobs::Knobs;
use lightskin::reference::depth_image::tangents;
use lightskin::reference::false_color::{decades, false_color};
use lightskin::reference::tonemap::srgb_from_linear;
use lightskin::scene::{LightKind, Projection};
use lightskin::shared::{
    Cache, DEPTH_IMAGE_SIDE, DEPTH_IMAGE_TEXELS, LAYER_DEPTH, LAYER_DIRECTION, LAYER_REFLECTANCE, LayerPush, LiveArgs,
    NearestCache, NearestPush, Val,
};

/// Draws a view of a light.
fn copied(gpu: &Gpu, world: &World, copy: &mut RsmCopy, rsm: &Rsm, of: (usize, u32)) {
    let drawn = gpu.frame(|cmd| {
        copy.record(cmd, world, rsm, of);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
}

/// A copy shows the same view as stage 4 drew, for each face of each light: its positions are those of the virtual
/// lights, and the last one has all bits of stage 4's own images. A light that has moved is drawn again.
#[test]
fn a_copy_is_the_rsm_of_its_light() {
    let gpu = gpu();
    let mut scene = corner(&[LightKind::Point, SPOT, LightKind::Directional], 20.0);
    let mut world = World::new(&gpu, &scene, Some(&baked(&scene, 0.45, 8))).expect("upload");
    let mut frame = drawn_of(&gpu, &scene, &world, &small());
    let rsm = frame.light.rsm.as_ref().expect("RSMs");
    let mut copy = RsmCopy::new(&gpu, rsm).expect("images");
    let vals: Vec<Val> = gpu.read(&rsm.vals.all).expect("VALs");
    let (mut first, mut seen) = (0, Vec::new());
    for (light, info) in world.lights().iter().enumerate() {
        assert!(rsm.draws(&world, light));
        let size = info.rsm_size(rsm.depth.width) as usize;
        for view in 0..info.views {
            copied(&gpu, &world, &mut copy, rsm, (light, view));
            let positions: Vec<[f32; 4]> = gpu.read_image(&copy.position).expect("positions");
            let mut hits = 0;
            for i in 0..size * size {
                let hit = positions[i / size * copy.position.width as usize + i % size];
                if hit[3] > 0.0 {
                    assert_eq!(vals[first + i].position.to_array(), hit[..3], "light {light}, view {view}, texel {i}");
                    hits += 1;
                }
            }
            seen.push(hits);
            first += size * size;
        }
    }
    assert!(seen.iter().filter(|hits| **hits > 5).count() >= 5, "hits of each view: {seen:?}");
    for (copied, own) in [(&copy.position, &rsm.position), (&copy.normal, &rsm.normal), (&copy.albedo, &rsm.albedo)] {
        let bits = |image: &Image| -> Vec<[u32; 4]> { gpu.read_image(image).expect("texels") };
        assert!(bits(copied) == bits(own), "{} differs from {}", copied.name, own.name);
    }
    let depths = |image: &Image| -> Vec<u32> { gpu.read_image(image).expect("depths") };
    let before = depths(&copy.depth);
    assert!(before == depths(&rsm.depth), "the depths differ");

    scene.lights[2].direction = Vec3::new(-0.3, -1.0, -0.2).normalize();
    world.update(&gpu, &scene).expect("moved");
    let view = View::new(&scene.cameras[0], small().size, world.origin, world.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &world, &view);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    let rsm = frame.light.rsm.as_ref().expect("RSMs");
    copied(&gpu, &world, &mut copy, rsm, (2, 0));
    assert!(depths(&copy.depth) != before && depths(&copy.depth) == depths(&rsm.depth), "the light has moved");
    assert_clean(&gpu);
}

/// Pixels of the window around an inset, each texel drawn as a square of pixels.
fn inset(gpu: &Gpu, image: &Image, push: LayerPush, [left, top, side]: [u32; 3]) -> Vec<[u8; 4]> {
    let canvas = gpu.target("test.canvas", BYTES, WINDOW, WINDOW).expect("a target");
    let exposure = gpu.buffer_from("test.exposure", &[0.0_f32; 4]).expect("a buffer");
    let pipeline = pass(gpu, "screen.vert", "layer.frag", Shape::Triangles);
    let area = [0, 0, WINDOW, WINDOW];
    let drawn = gpu.frame(|cmd| {
        cmd.render(&Attachments { colors: &[Attach::clear(&canvas)], depth: None, area }, |draw| {
            draw.bind(&pipeline, &[image.into(), (&exposure).into(), image.into(), image.into()]);
            draw.push(&LayerPush { left, top, ..push });
            draw.area([left, top, side, side]);
            draw.draw(3);
        });
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    gpu.read_image(&canvas).expect("pixels")
}

/// Side of the window of these insets [pixels].
const WINDOW: u32 = 100;

/// Insets of an RSM's images and of one face of a shadow map show the texels that are read back, nowhere else a pixel.
#[test]
fn an_inset_shows_texels_as_squares() {
    let gpu = gpu();
    let scene = corner(&[LightKind::Point], 20.0);
    let world = World::new(&gpu, &scene, Some(&baked(&scene, 0.45, 8))).expect("upload");
    let knobs = Knobs { rsm: 54, light_shadows: LightShadows::Maps(66), ..small() };
    let frame = drawn_of(&gpu, &scene, &world, &knobs);
    let (rsm, info) = (frame.light.rsm.as_ref().expect("RSMs"), &world.lights()[0]);
    let mut copy = RsmCopy::new(&gpu, rsm).expect("images");
    let face = 3; // -Y
    copied(&gpu, &world, &mut copy, rsm, (0, face));
    let side = info.rsm_size(rsm.depth.width);
    assert_eq!(side, 22, "a sixth of the texels of a square of 54");
    let near = world.clip_from_world(info.first_view + face).row(2).w;
    let [low, high] = [0.1, 4.0];
    // Reversed depth is the near plane's distance divided by the distance.
    let depth_push = LayerPush { how: LAYER_DEPTH, depth: Vec4::new(near, 0.0, 0.0, 1.0), low, high, ..ONE_TO_ONE };
    let of_depth = |depth: f32| {
        let distance = f64::from(near) / f64::from(depth);
        if depth > 0.0 { false_color(decades(distance, low.into(), high.into())) } else { DVec3::ZERO }
    };
    let vectors = |image: &Image| -> Vec<DVec3> {
        let texels: Vec<[f32; 4]> = gpu.read_image(image).expect("texels");
        texels.iter().map(|t| DVec3::new(t[0].into(), t[1].into(), t[2].into())).collect()
    };
    let colors = |image: &Image| -> Vec<DVec3> {
        gpu.read_image::<f32>(image).expect("depths").into_iter().map(of_depth).collect()
    };
    let map = frame.light.direct.as_ref().and_then(|direct| direct.shadow_map(&world, 0)).expect("a map of its own");
    let of_map = info.shadow_size(map.width);
    let tile = info.tile(face).map(|tile| tile * of_map);
    assert_eq!((of_map, tile), (22, [0, 22]));
    let directions = vectors(&copy.normal).into_iter().map(|normal| normal * 0.5 + 0.5).collect();
    let albedos = vectors(&copy.albedo).into_iter().map(srgb_from_linear).collect();
    let cases: [(&Image, [u32; 2], LayerPush, Vec<DVec3>); 4] = [
        (&copy.depth, [0, 0], depth_push, colors(&copy.depth)),
        (&copy.normal, [0, 0], LayerPush { how: LAYER_DIRECTION, ..ONE_TO_ONE }, directions),
        (&copy.albedo, [0, 0], LayerPush { how: LAYER_REFLECTANCE, ..ONE_TO_ONE }, albedos),
        (map, tile, depth_push, colors(map)),
    ];
    for (image, [first_column, first_row], push, wanted) in cases {
        // Texels of 3 pixels a side, and fewer pixels than texels.
        for pixels in [66, 11] {
            let texels = side as f32 / pixels as f32;
            let push = LayerPush { first_column, first_row, texels, ..push };
            let [left, top] = [17, 29];
            let found = inset(&gpu, image, push, [left, top, pixels]);
            let mut kinds = std::collections::BTreeSet::new();
            for (i, pixel) in found.iter().enumerate() {
                let [x, y] = [i as u32 % WINDOW, i as u32 / WINDOW].map(i64::from);
                let at = [x - i64::from(left), y - i64::from(top)];
                if at.iter().any(|at| !(0..i64::from(pixels)).contains(at)) {
                    assert_eq!(*pixel, [0; 4], "{}: a pixel outside, at {x}, {y}", image.name);
                    continue;
                }
                let texel = at.map(|at| (2 * at as u32 + 1) * side / (2 * pixels));
                let index = (first_row + texel[1]) * image.width + first_column + texel[0];
                let far = (0..3).map(|c| (f64::from(pixel[c]) - 255.0 * wanted[index as usize][c]).abs());
                let far = far.fold(0.0, f64::max);
                assert!(far < 1.0, "{}: {pixel:?} at {x}, {y} is not {}", image.name, wanted[index as usize]);
                kinds.insert(*pixel);
            }
            assert!(kinds.len() > 1, "{}: all pixels are {kinds:?}", image.name);
        }
    }
    assert_clean(&gpu);
}

/// Unit direction through the middle of a depth image's texel; if it lies outside the unit disc, just above the horizon.
fn direction(texel: usize, normal: DVec3) -> DVec3 {
    let side = DEPTH_IMAGE_SIDE as usize;
    let at = DVec2::new((texel % side) as f64 + 0.5, (texel / side) as f64 + 0.5) * 2.0 / side as f64 - 1.0;
    let at = at.clamp_length_max(0.9995);
    let [tangent, bitangent] = tangents(normal);
    tangent * at.x + bitangent * at.y + normal * (1.0 - at.length_squared()).sqrt()
}

/// The search finds the nearest live cache that lights the side which a pixel shows, and copies its depth image.
#[test]
fn the_nearest_cache_is_found() {
    // Its image is drawn without short rays, and traced with them.
    [Near::Off, Near::Rays { per_pixel: 8, every: 2 }].into_iter().for_each(nearest_caches);
}

fn nearest_caches(near: Near) {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 20.0);
    // Some caches are out of view, and not live. Others lie behind what a pixel shows.
    scene.cameras[0].projection = Projection::Perspective { yfov: 0.9 };
    let side = 96;
    let knobs = Knobs { size: [side; 2], cull: true, shadows: Shadows::PerLight, near, ..small() };
    let world = World::new(&gpu, &scene, Some(&baked(&scene, 0.3, 8))).expect("upload");
    let frame = drawn_of(&gpu, &scene, &world, &knobs);
    let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
    let (caches, surface) = (frame.light.caches().expect("caches"), &frame.picture.surface);
    let (live, images) = (caches.gather.live().expect("a list"), caches.gather.depth_images().expect("images"));
    let all: Vec<Cache> = gpu.read(&caches.atlas.caches).expect("caches");
    let count = gpu.read::<LiveArgs>(&live.args).expect("arguments")[0].cache_count as usize;
    let list: Vec<u32> = gpu.read(&live.list).expect("a list");
    let texels = DEPTH_IMAGE_TEXELS as usize;
    let of_all: Vec<f32> = if near == Near::Off {
        gpu.read(&images.buffer).expect("images")
    } else {
        let along = |(at, plane): (usize, &DVec3)| {
            let Some(cache) = list[..count].get(at / texels) else { return 0.0 };
            plane.dot(direction(at % texels, { all[*cache as usize].normal }.as_dvec3())).max(0.0) as f32
        };
        planes(&gpu, images).iter().enumerate().map(along).collect()
    };
    let depths: Vec<f32> = gpu.read_image(&surface.depth).expect("depths");
    let normals: Vec<[f32; 4]> = gpu.read_image(&surface.normal).expect("normals");
    assert!(count < all.len(), "all of {count} caches are live");

    let pipeline = gpu.compute("nearest_cache.comp", &[]).expect("a shader");
    let found = gpu.buffer("test.found", size_of::<NearestCache>() as u64).expect("a buffer");
    let (size, storage) = ([DEPTH_IMAGE_SIDE; 2], true);
    let desc = ImageDesc { name: "test.image", format: Format::R32_SFLOAT, size, extent: Extent::Plane, storage };
    let image = gpu.image(&desc).expect("an image");
    let (mut seen, mut empty, mut behind) = (std::collections::BTreeSet::new(), 0, 0);
    for (column, row) in (0..12).flat_map(|y| (0..12).map(move |x| (4 + 8 * x, 4 + 8 * y))) {
        let drawn = gpu.frame(|cmd| {
            cmd.clear(&found);
            cmd.barrier(Use::CopyWrite, Use::ComputeWrite);
            let lists = [&caches.atlas.caches, &live.list, &live.args, &images.buffer].map(Bind::from);
            let pictures = [&surface.depth, &surface.normal, &image].map(Bind::from);
            cmd.bind(&pipeline, &[&lists[..], &pictures, &[(&found).into()]].concat());
            let are_planes = images.are_traced().into();
            cmd.push(&NearestPush { world_from_clip: view.world_from_clip, column, row, are_planes });
            cmd.dispatch(1, 1, 1);
            Ok(())
        });
        assert_eq!(drawn.expect("drawn").problems, [""; 0]);
        let told = gpu.read::<NearestCache>(&found).expect("a cache")[0];
        let shown: Vec<f32> = gpu.read_image(&image).expect("an image");
        let pixel = (row * side + column) as usize;
        if depths[pixel] == 0.0 {
            assert!(told.number == 0 && shown.iter().all(|texel| *texel == 0.0), "there is no surface");
            empty += 1;
            continue;
        }
        let at = [column, row].map(|v| (f64::from(v) + 0.5) / f64::from(side) * 2.0 - 1.0);
        let clip = glam::DVec4::new(at[0], at[1], depths[pixel].into(), 1.0);
        let point = view.world_from_clip.as_dmat4() * clip;
        let point = point.truncate() / point.w;
        let normal = Vec3::from_slice(&normals[pixel]);
        let distance = |cache: &Cache| point.distance({ cache.position }.as_dvec3());
        let faces = |slot: &usize| { all[list[*slot] as usize].normal }.dot(normal) > 0.0;
        let nearest = |some: &dyn Fn(&usize) -> bool| {
            let some = (0..count).filter(some);
            some.min_by(|a, b| distance(&all[list[*a] as usize]).total_cmp(&distance(&all[list[*b] as usize])))
        };
        let slot = nearest(&faces).expect("a cache");
        behind += u32::from(nearest(&|_| true) != Some(slot));
        let cache = &all[list[slot] as usize];
        // Of two caches at the same distance either may be found.
        let other = &all[told.number as usize - 1];
        assert!((distance(other) - distance(cache)).abs() < 1e-5, "{column}, {row}: {} is nearer", list[slot]);
        assert!((f64::from(told.distance) - distance(other)).abs() < 1e-5, "{column}, {row}: {told:?}");
        let slot = list[..count].iter().position(|cache| *cache == told.number - 1).expect("a live cache");
        assert_eq!(({ told.position }, { told.normal }), ({ other.position }, { other.normal }));
        let alike = |(a, b): (&f32, &f32)| (a - b).abs() <= if near == Near::Off { 0.0 } else { 1e-4 * b.max(0.1) };
        assert!(shown.iter().zip(&of_all[slot * texels..]).all(alike), "cache {}", told.number - 1);
        assert!(shown.iter().any(|texel| *texel > 0.0) || seen.len() < 3, "an image without surfaces");
        seen.insert(told.number);
    }
    assert!(seen.len() > 20 && empty > 0, "{} caches, {empty} pixels without a surface", seen.len());
    println!("{} caches found; for {behind} pixels a nearer one lies on another side", seen.len());
    assert_clean(&gpu);
}
