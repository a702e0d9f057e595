//! Debug views of the window: false colours, marked invalid values, marks of caches, proxy lights and virtual lights.

use glam::{DVec2, DVec3, Mat4, Vec3, Vec4, dvec2};
use lightskin::frame::{View, World};
use lightskin::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cull, Depth, Format, Gpu, Image, Pipeline, Raster, Shape,
};
use lightskin::lab::knobs::Knobs;
use lightskin::reference::false_color::{decades, false_color};
use lightskin::reference::tonemap::{agx, pbr_neutral, srgb_from_linear};
use lightskin::scene::Projection;
use lightskin::shared::{
    Cache, LAYER_BROKEN, LAYER_DEPTH, LAYER_LUMINANCE, LayerPush, LiveArgs, MARK_DARK, MARK_HUE, MARK_LIGHT,
    MARK_RIMMED, MarkPush, Proxy, Val,
};
use std::f64::consts::PI;

use crate::common::frames::{SPOT, baked, corner, drawn_of, small};
use crate::common::{assert_clean, gpu, map_on_gpu};

#[test]
fn false_colors_are_turbo() {
    let inputs: Vec<[f32; 1]> = (0..=400_u16).map(|i| [f32::from(i) / 320.0 - 0.1]).collect();
    let found = map_on_gpu(&gpu(), &["lib/false_color.glsl"], "vec4(false_color(x[0]), 0.0)", &inputs);
    for ([t], found) in inputs.iter().zip(found) {
        let wanted = false_color((*t).into());
        let far = DVec3::from_slice(&found.map(f64::from)).distance(wanted);
        // The polynomial sums terms that are a hundred times as large.
        assert!(far < 1e-4, "{t}: {found:?} is not {wanted}");
    }
    let middle = false_color(0.5);
    assert!(middle.y > middle.x && middle.y > middle.z, "the middle must be green: {middle}");
    let values: Vec<[f32; 1]> = [-1.0, 0.0, 1e-9, 0.1, 0.5, 1.0, 7.0, 10.0, 1e9].map(|v| [v]).to_vec();
    let found = map_on_gpu(&gpu(), &["lib/false_color.glsl"], "vec4(decades(x[0], 0.1, 10.0))", &values);
    for ([value], found) in values.iter().zip(found) {
        let wanted = decades((*value).into(), f64::from(0.1_f32), 10.0);
        assert!((f64::from(found[0]) - wanted).abs() < 1e-5, "{value}: {} is not {wanted}", found[0]);
    }
}

const FLOAT: Format = Format::R32G32B32A32_SFLOAT;
pub(crate) const BYTES: Format = Format::R8G8B8A8_UNORM;

pub(crate) fn pass(gpu: &Gpu, vertex: &'static str, fragment: &'static str, shape: Shape) -> Pipeline {
    let raster = Raster {
        vertex,
        fragment: Some(fragment),
        shape,
        streams: &[],
        colors: &[BYTES],
        blend: Blend::Replace,
        depth: Depth::None,
        cull: Cull::None,
        multisampled: false,
        constants: &[],
    };
    gpu.raster(&raster).expect("a pass")
}

fn texture(gpu: &Gpu, [width, height]: [u32; 2], texels: &[[f32; 4]]) -> Image {
    gpu.texture("test", FLOAT, width, height, &[bytemuck::cast_slice(texels).to_vec()]).expect("a texture")
}

/// A layer whose texels are the pixels.
pub(crate) const ONE_TO_ONE: LayerPush = LayerPush {
    how: 0,
    tonemap: 0,
    left: 0,
    top: 0,
    first_column: 0,
    first_row: 0,
    texels: 1.0,
    parts: 1,
    low: 0.0,
    high: 0.0,
    depth: Vec4::ZERO,
};

/// Pixels of a layer pass over one row of texels.
fn layer(parts: &[Vec<[f32; 4]>], how: u32, [low, high]: [f32; 2]) -> Vec<[u8; 4]> {
    let gpu = gpu();
    let size = [parts[0].len() as u32, 1];
    let images: Vec<Image> = parts.iter().map(|texels| texture(&gpu, size, texels)).collect();
    let image = |i: usize| Bind::from(&images[i.min(images.len() - 1)]);
    let exposure = gpu.buffer_from("test.exposure", &[0.0_f32; 4]).expect("a buffer");
    let pipeline = pass(&gpu, "screen.vert", "layer.frag", Shape::Triangles);
    let canvas = gpu.target("test.canvas", BYTES, size[0], 1).expect("a target");
    let depth = Vec4::new(0.5, 0.0, 0.0, 1.0); // 0.5 / d
    let frame = gpu.frame(|cmd| {
        let colors = [Attach::clear(&canvas)];
        cmd.render(&Attachments { colors: &colors, depth: None, area: [0, 0, size[0], 1] }, |draw| {
            draw.bind(&pipeline, &[image(0), (&exposure).into(), image(1), image(2)]);
            let parts = parts.len() as u32;
            draw.push(&LayerPush { how, tonemap: 3, parts, low, high, depth, ..ONE_TO_ONE });
            draw.draw(3);
        });
        Ok(())
    });
    assert!(frame.expect("a frame").problems.is_empty());
    gpu.read_image(&canvas).expect("pixels")
}

fn assert_color(found: [u8; 4], wanted: DVec3) {
    let far = (0..3).map(|c| (f64::from(found[c]) - 255.0 * wanted[c]).abs()).fold(0.0, f64::max);
    assert!(far < 1.0, "{found:?} is not {:?}", wanted * 255.0);
}

#[test]
fn layers_are_summed_and_broken_ones_marked() {
    let grey = |v: f32| [v, v, v, 0.0];
    let values = [0.05_f32, 0.3, 2.0, 40.0, 0.0];
    let parts: Vec<Vec<[f32; 4]>> =
        [0.5, 0.25, 0.25].map(|share| values.iter().map(|v| grey(share * v)).collect()).to_vec();
    for (found, value) in layer(&parts, LAYER_LUMINANCE, [0.1, 10.0]).into_iter().zip(values) {
        assert_color(found, false_color(decades(value.into(), 0.1, 10.0)));
    }
    let depths: Vec<[f32; 4]> = [1.0, 0.25, 0.05, 0.0].map(grey).to_vec();
    let found = layer(&[depths], LAYER_DEPTH, [0.5, 10.0]);
    for (found, distance) in found.iter().zip([0.5, 2.0, 10.0]) {
        assert_color(*found, false_color(decades(distance, 0.5, 10.0)));
    }
    assert_eq!(found[3], [0, 0, 0, 255], "pixels without a surface must be black");
    // An invalid value is marked in any of the layers.
    let broken = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1e-3];
    for place in 0..3 {
        let mut parts = vec![vec![grey(0.2); 6]; 3];
        for (i, value) in broken.into_iter().enumerate() {
            parts[place][i] = [0.2, value, 0.2, 0.0];
        }
        parts[place][4] = grey(-0.0);
        let found = layer(&parts, LAYER_BROKEN, [0.1, 10.0]);
        assert!(found[..4].iter().all(|pixel| *pixel == [255, 0, 255, 255]), "{found:?}");
        assert!(found[4..].iter().all(|pixel| pixel[0] == pixel[1] && pixel[1] == pixel[2]), "{found:?}");
    }
}

/// Side of the pictures with marks [pixels].
const SIDE: usize = 96;

/// Push constants for a view.
fn push_of(clip_from_world: Mat4, eye: Vec4, size: f32) -> MarkPush {
    let pixel = 2.0 / (clip_from_world.row(1).truncate().length() * SIDE as f32);
    MarkPush { clip_from_world, eye, size, pixel, how: MARK_HUE, live: 0, tonemap: 0, left: 0, top: 0 }
}

/// A parallel view along -Z, which maps z to depth.
fn along_z(size: f32) -> MarkPush {
    push_of(Mat4::IDENTITY, Vec4::Z, size)
}

/// Pixels of marks, each a number of vertices with these push constants.
fn marked(
    gpu: &Gpu,
    (vertex, shape): (&'static str, Shape),
    resources: &[Bind<'_>],
    draws: &[(MarkPush, u32)],
) -> Vec<[u8; 4]> {
    let pipeline = pass(gpu, vertex, "marks.frag", shape);
    let side = SIDE as u32;
    let canvas = gpu.target("test.canvas", BYTES, side, side).expect("a target");
    let frame = gpu.frame(|cmd| {
        let colors = [Attach::clear(&canvas)];
        cmd.render(&Attachments { colors: &colors, depth: None, area: [0, 0, side, side] }, |draw| {
            for (push, count) in draws {
                draw.bind(&pipeline, resources);
                draw.push(push);
                draw.draw(*count);
            }
        });
        Ok(())
    });
    assert_eq!(frame.expect("a frame").problems, [""; 0]);
    assert_clean(gpu);
    gpu.read_image(&canvas).expect("pixels")
}

/// Made-up inputs of the passes: a surface at depth 0.5 everywhere, exposure, live caches and proxy lights.
struct Inputs {
    depth: Image,
    exposure: Buffer,
    live: Buffer,
    args: Buffer,
    proxies: Buffer,
}

const EV: f32 = 3.0;

impl Inputs {
    fn new(gpu: &Gpu, live: &[u32], cache_count: u32, proxies: &[Proxy]) -> Self {
        let args = LiveArgs { cache_count, ..LiveArgs::default() };
        let buffer = "a buffer";
        Self {
            depth: texture(gpu, [SIDE as u32; 2], &vec![[0.5; 4]; SIDE * SIDE]),
            exposure: gpu.buffer_from("test.exposure", &[EV; 4]).expect(buffer),
            live: gpu.buffer_from("test.live", live).expect(buffer),
            args: gpu.buffer_from("test.args", &[args]).expect(buffer),
            proxies: gpu.buffer_from("test.proxies", proxies).expect(buffer),
        }
    }

    /// Resources of the passes that mark caches.
    fn of_caches<'a>(&'a self, caches: &'a Buffer) -> Vec<Bind<'a>> {
        let Self { depth, exposure, live, args, proxies } = self;
        vec![caches.into(), depth.into(), exposure.into(), live.into(), args.into(), proxies.into()]
    }
}

/// A cache with a radius of 0.2.
fn cache(x: f32, z: f32, normal: Vec3) -> Cache {
    Cache {
        position: Vec3::new(x, 0.0, z),
        exponent: 1.0,
        normal,
        area: std::f32::consts::PI * 0.04,
        middle: Vec3::ZERO,
        breadth: 0.0,
        axis: Vec3::X,
        radius: 0.2,
    }
}

/// Places of all marked pixels' centres, from -1 to 1, and their colours.
fn places(pixels: &[[u8; 4]]) -> impl Iterator<Item = (DVec2, [u8; 4])> {
    let at = |i: usize| (i as f64 + 0.5) * 2.0 / SIDE as f64 - 1.0;
    let placed = pixels.iter().enumerate().map(move |(i, pixel)| (dvec2(at(i % SIDE), at(i / SIDE)), *pixel));
    placed.filter(|(_, pixel)| pixel[3] > 0)
}

/// The pixel at a place from -1 to 1.
fn at(pixels: &[[u8; 4]], place: DVec2) -> [u8; 4] {
    let index = |v: f64| ((v + 1.0) * 0.5 * SIDE as f64) as usize;
    pixels[index(place.y) * SIDE + index(place.x)]
}

fn rgb(color: Vec3) -> DVec3 {
    color.as_dvec3()
}

/// Display colour with the hue of a light.
fn hue_of(light: Vec3) -> DVec3 {
    srgb_from_linear(rgb(light) / rgb(light).max_element())
}

/// Discs of caches on, in front of and behind a surface, and turned away from the eye.
#[test]
fn discs_lie_on_what_is_seen() {
    let gpu = gpu();
    let caches =
        [cache(-0.6, 0.5, Vec3::Z), cache(0.0, 0.6, Vec3::Z), cache(0.6, 0.3, Vec3::Z), cache(0.0, 0.6, -Vec3::Z)];
    let buffer = gpu.buffer_from("test.caches", &caches).expect("a buffer");
    let inputs = Inputs::new(&gpu, &[0; 4], 0, &[Proxy::default(); 4]);
    let pixels = marked(&gpu, ("discs.vert", Shape::Triangles), &inputs.of_caches(&buffer), &[(along_z(1.0), 3 * 4)]);
    let mut counts = [0; 3];
    for (place, pixel) in places(&pixels) {
        let which = (0..3).find(|which| place.x < [-0.3, 0.3, 1.0][*which]).expect("inside");
        let middle = dvec2(caches[which].position.x.into(), 0.0);
        assert!(place.distance(middle) < 0.2 + 1e-6, "{pixel:?} at {place}");
        counts[which] += 1;
    }
    // Area of a disc, at half as many pixels per unit as the picture has in a row.
    let wanted = PI * 0.04 * (SIDE as f64 * 0.5).powi(2);
    for count in &counts[..2] {
        assert!((f64::from(*count) - wanted).abs() < 0.05 * wanted, "{count} of {wanted} pixels");
    }
    assert_eq!(counts[2], 0, "discs behind the surface must be hidden");
    let color = |x: f64| at(&pixels, dvec2(x, 0.0));
    assert_ne!(color(-0.6), color(0.0), "neighbouring discs must have different colours");
}

/// Radiance of a white diffuse surface at a cache, in display colours of PBR Neutral or AgX.
fn light_of(cache: &Cache, proxy: &Proxy, ev: f32, tonemap: u32) -> DVec3 {
    let towards = (rgb(proxy.diffuse_position) - rgb(cache.position)).normalize();
    let irradiance = rgb(proxy.diffuse_irradiance) * rgb(cache.normal).dot(towards);
    let exposed = irradiance / PI / (1.2 * f64::from(ev).exp2());
    srgb_from_linear(if tonemap == 1 { agx(exposed) } else { pbr_neutral(exposed) })
}

/// Caches by their light and by whether they are live.
#[test]
fn discs_have_the_light_of_live_caches() {
    let gpu = gpu();
    let caches = [-0.6, 0.0, 0.6].map(|x| cache(x, 0.5, Vec3::Z));
    let proxy = |x: f32, offset: [f32; 3], irradiance: [f32; 3]| Proxy {
        diffuse_position: Vec3::new(x, 0.0, 0.5) + Vec3::from(offset),
        diffuse_irradiance: irradiance.into(),
        ..Proxy::default()
    };
    let proxies = [
        proxy(-0.6, [0.0, 0.3, 0.4], [20.0, 8.0, 3.0]),
        proxy(0.0, [0.0, 0.0, 1.0], [90.0; 3]),
        proxy(0.6, [2.0, 0.0, 0.5], [2.0, 30.0, 60.0]),
    ];
    let buffer = gpu.buffer_from("test.caches", &caches).expect("a buffer");
    // The middle cache is not live: the list has a third item, but only two count.
    let inputs = Inputs::new(&gpu, &[2, 0, 1], 2, &proxies);
    let shown = |draws: &[(u32, u32, u32)]| {
        let draws: Vec<_> = draws
            .iter()
            .map(|(how, live, tonemap)| (MarkPush { how: *how, live: *live, tonemap: *tonemap, ..along_z(1.0) }, 9))
            .collect();
        let pixels = marked(&gpu, ("discs.vert", Shape::Triangles), &inputs.of_caches(&buffer), &draws);
        [-0.6, 0.0, 0.6].map(|x| at(&pixels, dvec2(x, 0.0)))
    };
    for tonemap in [0, 1] {
        let found = shown(&[(MARK_LIGHT, 1, tonemap)]);
        for i in [0, 2] {
            assert_color(found[i], light_of(&caches[i], &proxies[i], EV, tonemap));
        }
        assert_eq!(found[1], [0; 4], "a cache that is not live has no light to show");
    }
    let every = shown(&[(MARK_HUE, 0, 0)]);
    let found = shown(&[(MARK_DARK, 0, 0), (MARK_HUE, 1, 0)]);
    assert_eq!([found[0], found[2]], [every[0], every[2]], "live caches must have their own colours");
    assert_color(found[1], DVec3::splat(0.1));
    assert_ne!(found[1], every[1]);
}

/// VALs as large as a share of their area, or at least 2 pixels, where they carry light and are seen.
#[test]
fn discs_of_virtual_lights_have_their_hue_and_place() {
    let gpu = gpu();
    let val = |x: f32, z: f32, normal: Vec3, flux: [f32; 3], radius: f32| Val {
        position: Vec3::new(x, 0.0, z),
        area: std::f32::consts::PI * radius * radius,
        normal,
        flux: flux.into(),
        ..Val::default()
    };
    let vals = [
        val(-0.8, 0.5, Vec3::Z, [3e-4, 1e-4, 0.0], 0.2),
        val(-0.3, 0.5, Vec3::Z, [5.0, 50.0, 500.0], 1e-4),
        val(0.1, 0.5, Vec3::Z, [0.0; 3], 0.2),
        val(0.4, 0.5, -Vec3::Z, [1.0; 3], 0.2),
        val(0.6, 0.4, Vec3::Z, [1.0; 3], 0.2),
        val(0.8, 0.5, Vec3::Z, [1.0; 3], 0.2),
    ];
    let buffer = gpu.buffer_from("test.vals", &vals).expect("a buffer");
    // The last one is beyond the list's end.
    let count = gpu.buffer_from("test.count", &[5_u32]).expect("a buffer");
    let inputs = Inputs::new(&gpu, &[0], 0, &[Proxy::default()]);
    let resources = [(&buffer).into(), (&inputs.depth).into(), (&inputs.exposure).into(), (&count).into()];
    let push = MarkPush { how: MARK_RIMMED, ..along_z(0.5) };
    let pixels = marked(&gpu, ("val_discs.vert", Shape::Triangles), &resources, &[(push, 3 * 6)]);
    let pixel = 2.0 / SIDE as f64;
    let (mut large, mut small) = (0, 0);
    for (place, color) in places(&pixels) {
        let is_large = place.x < -0.5;
        let (val, radius, count) =
            if is_large { (&vals[0], 0.1, &mut large) } else { (&vals[1], 2.0 * pixel, &mut small) };
        let far = place.distance(dvec2(val.position.x.into(), 0.0)) / radius;
        assert!(far < 1.0 + 1e-6, "nothing may be marked at {place}");
        if (far * far - 0.5).abs() > 0.01 {
            assert_color(color, if far * far < 0.5 { hue_of(val.flux) } else { DVec3::ZERO });
        }
        *count += 1;
    }
    let wanted = PI * (0.1 / pixel).powi(2);
    assert!((f64::from(large) - wanted).abs() < 0.1 * wanted, "{large} of {wanted} pixels");
    assert!((9..=16).contains(&small), "{small} pixels of a disc with a radius of 2");
}

/// Lines end at 1.5 radii, or at the proxy if it is nearer; caches without light, or that are not live, have none.
#[test]
fn lines_end_on_the_way_to_the_proxy() {
    let gpu = gpu();
    let mut caches = [-0.7, -0.2, 0.2, 0.5, 0.8].map(|x| cache(x, 0.5, Vec3::Z));
    caches[1].position.y = -0.5;
    let proxy = |cache: &Cache, offset: [f32; 3], irradiance: [f32; 3]| Proxy {
        diffuse_position: cache.position + Vec3::from(offset),
        diffuse_irradiance: irradiance.into(),
        ..Proxy::default()
    };
    let proxies = [
        proxy(&caches[0], [3.0, 4.0, 0.5], [1.0, 0.5, 0.25]),
        proxy(&caches[1], [0.05, 0.2, 0.1], [7.0, 7.0, 1.0]),
        proxy(&caches[2], [1.0, 1.0, 1.0], [0.0; 3]),
        proxy(&caches[3], [1.0, 1.0, 1.0], [1.0; 3]),
        proxy(&caches[4], [0.0, 1.0, -0.9], [1.0; 3]),
    ];
    let buffer = gpu.buffer_from("test.caches", &caches).expect("a buffer");
    // The fourth is not live; the fifth points below the surface.
    let inputs = Inputs::new(&gpu, &[4, 2, 1, 0, 3], 4, &proxies);
    let push = MarkPush { how: MARK_RIMMED, ..along_z(1.5) };
    let pixels = marked(&gpu, ("lines.vert", Shape::Lines), &inputs.of_caches(&buffer), &[(push, 2 * 5)]);
    let pixel = 2.0 / SIDE as f64;
    for (i, share) in [(0, 0.3 / (25.25_f64).sqrt()), (1, 1.0)] {
        let from = rgb(caches[i].position).truncate();
        let to = from + share * (rgb(proxies[i].diffuse_position) - rgb(caches[i].position)).truncate();
        let near = |place: &DVec2| place.distance(from) < 0.5;
        let on_line: Vec<_> = places(&pixels).filter(|(place, _)| near(place)).collect();
        let along = |place: DVec2| (place - from).dot((to - from).normalize());
        let aside = |place: DVec2| (place - from).perp_dot((to - from).normalize()).abs();
        let end = on_line.iter().map(|(place, _)| along(*place)).fold(0.0, f64::max);
        assert!((end - to.distance(from)).abs() < 1.2 * pixel, "{i}: ends at {end}, not {}", to.distance(from));
        for (place, color) in on_line {
            assert!(aside(place) < pixel && along(place) > -1.2 * pixel, "{i}: {place}");
            // Lines begin black.
            let rest = to.distance(from) * (1.0 - 0.5_f64.sqrt()) - along(place);
            if rest.abs() > pixel {
                assert_color(color, if rest > 0.0 { DVec3::ZERO } else { hue_of(proxies[i].diffuse_irradiance) });
            }
        }
    }
    let last = places(&pixels).filter(|(place, _)| place.x > 0.7).map(|(place, _)| place.y).fold(0.0, f64::max);
    assert!(last < 0.05, "a line must end where the surface hides it, at once, not at {last}");
    assert!(!places(&pixels).any(|(place, _)| (0.1..0.7).contains(&place.x)), "no light, no line");
}

/// Marks of a frame, against its own results read back: places of VALs, colours of discs, ends of lines.
#[test]
fn marks_of_a_frame_are_its_results() {
    let gpu = gpu();
    let mut scene = corner(&[SPOT], 20.0);
    // Some caches are out of view, and not live.
    scene.cameras[0].projection = Projection::Perspective { yfov: 0.5 };
    let knobs = Knobs { size: [SIDE as u32; 2], cull: true, ..small() };
    let world = World::new(&gpu, &scene, Some(&baked(&scene, 0.45, 8))).expect("upload");
    let frame = drawn_of(&gpu, &scene, &world, &knobs);
    let View { clip_from_world, eye, .. } = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
    let (light, surface) = (&frame.light, &frame.picture.surface);
    let (caches, vals) = (light.caches().expect("caches"), light.vals().expect("VALs"));
    let live = caches.gather.live().expect("a list");
    let depths: Vec<f32> = gpu.read_image(&surface.depth).expect("depths");
    // Place in the picture of a point in front of everything else.
    let seen = |position: Vec3, normal: Vec3| {
        let towards = rgb(eye.truncate()) - rgb(position) * f64::from(eye.w);
        let clip = clip_from_world.as_dmat4() * rgb(position).extend(1.0);
        let place = clip.truncate() / clip.w;
        let pixel = [place.x, place.y].map(|v| (v + 1.0) * 0.5 * SIDE as f64);
        let inside = pixel.iter().all(|v| (2.0..SIDE as f64 - 2.0).contains(v));
        let cosine = rgb(normal).dot(towards.normalize());
        let depth = || f64::from(depths[pixel[1] as usize * SIDE + pixel[0] as usize]);
        (inside && cosine > 0.6 && place.z > 0.99 * depth()).then(|| place.truncate())
    };
    let exposure = &frame.picture.output.exposure;

    let all: Vec<Val> = gpu.read(&vals.live).expect("VALs");
    let count = gpu.read::<u32>(&vals.live_count).expect("a count")[0] as usize;
    let lit: Vec<&Val> = all[..count].iter().filter(|val| val.flux != Vec3::ZERO).collect();
    let resources = [(&vals.live).into(), (&surface.depth).into(), exposure.into(), (&vals.live_count).into()];
    let of_view = |size| push_of(clip_from_world, eye, size);
    let pixels = marked(&gpu, ("val_discs.vert", Shape::Triangles), &resources, &[(of_view(0.4), 3 * vals.count)]);
    let spots: Vec<DVec2> = lit.iter().filter_map(|val| seen(val.position, val.normal)).collect();
    assert!(spots.len() > 50, "only {} VALs in view", spots.len());
    assert!(spots.iter().all(|spot| at(&pixels, *spot)[3] > 0), "a VAL in view is not marked");
    // No disc reaches farther than its radius, and none is larger than the largest.
    let radius = |val: &Val| 0.4 * (f64::from(val.area) / PI).sqrt();
    let reach = |val: &Val| {
        let clip = clip_from_world.as_dmat4() * rgb(val.position).extend(1.0);
        let scale = clip_from_world.as_dmat4().row(1).truncate().length() / clip.w;
        (clip.truncate() / clip.w, (radius(val) * scale).max(2.0 * 2.0 / SIDE as f64) * 1.2)
    };
    let reaches: Vec<_> = lit.iter().map(|val| reach(val)).collect();
    for (place, _) in places(&pixels) {
        let near = reaches.iter().any(|(at, reach)| at.truncate().distance(place) < *reach);
        assert!(near, "there is no VAL at {place}");
    }

    let of_atlas: Vec<Cache> = gpu.read(&caches.atlas.caches).expect("caches");
    let proxies: Vec<Proxy> = gpu.read(&caches.proxies.buffer).expect("proxies");
    let lit = gpu.read::<LiveArgs>(&live.args).expect("arguments")[0].cache_count as usize;
    let list: Vec<u32> = gpu.read(&live.list).expect("a list");
    let list = &list[..lit];
    assert!(lit < of_atlas.len(), "all of {lit} caches are live");
    let resources: [Bind<'_>; 6] = [
        (&caches.atlas.caches).into(),
        (&surface.depth).into(),
        exposure.into(),
        (&live.list).into(),
        (&live.args).into(),
        (&caches.proxies.buffer).into(),
    ];
    let count = caches.atlas.count;
    let push = MarkPush { how: MARK_LIGHT, live: 1, ..of_view(0.4) };
    let pixels = marked(&gpu, ("discs.vert", Shape::Triangles), &resources, &[(push, 3 * count)]);
    let ev = gpu.read::<f32>(exposure).expect("an exposure")[0];
    let mut compared = 0;
    for i in list.iter().map(|i| *i as usize) {
        let cache = &of_atlas[i];
        let apart = |other: &Cache| other.position.distance(cache.position) > 0.4 * (other.radius + cache.radius);
        let alone = of_atlas.iter().enumerate().all(|(j, other)| i == j || apart(other));
        if let (true, Some(place)) = (alone, seen(cache.position, cache.normal)) {
            assert_color(at(&pixels, place), light_of(cache, &proxies[i], ev, 0));
            compared += 1;
        }
    }
    assert!(compared > 10, "only {compared} of {lit} caches compared");

    let push = MarkPush { live: 1, ..of_view(1.5) };
    let pixels = marked(&gpu, ("lines.vert", Shape::Lines), &resources, &[(push, 2 * count)]);
    let ends: Vec<[DVec2; 2]> = (list.iter().map(|i| *i as usize))
        .map(|i| {
            let (from, way) = (rgb(of_atlas[i].position), rgb(proxies[i].diffuse_position - of_atlas[i].position));
            let share = (1.5 * f64::from(of_atlas[i].radius) / way.length()).min(1.0);
            [from, from + share * way].map(|point| (clip_from_world.as_dmat4().project_point3(point)).truncate())
        })
        .collect();
    let aside = |place: DVec2, [from, to]: &[DVec2; 2]| {
        let share = ((place - from).dot(to - from) / (to - from).length_squared()).clamp(0.0, 1.0);
        place.distance(from.lerp(*to, share))
    };
    let pixel = 2.0 / SIDE as f64;
    assert!(places(&pixels).count() > 100, "no lines");
    for (place, _) in places(&pixels) {
        assert!(ends.iter().any(|line| aside(place, line) < 1.2 * pixel), "no line passes {place}");
    }
    assert_clean(&gpu);
}
