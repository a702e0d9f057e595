//! Debug views of the window: false colours, marked invalid values, caches as discs.

use glam::{DVec3, Mat4, Vec3, Vec4};
use lightskin::gpu::{Attach, Attachments, Bind, Blend, Cull, Depth, Format, Gpu, Image, Pipeline, Raster, Shape, Use};
use lightskin::reference::false_color::{decades, false_color};
use lightskin::shared::{Cache, DISC_CORNERS, DiscPush, LAYER_BROKEN, LAYER_DEPTH, LAYER_LUMINANCE, LayerPush};

use crate::common::{gpu, map_on_gpu};

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
const BYTES: Format = Format::R8G8B8A8_UNORM;

fn pass(gpu: &Gpu, vertex: &'static str, fragment: &'static str) -> Pipeline {
    let raster = Raster {
        vertex,
        fragment: Some(fragment),
        shape: Shape::Triangles,
        streams: &[],
        colors: &[BYTES],
        blend: Blend::Replace,
        depth: Depth::None,
        cull: Cull::None,
        constants: &[],
    };
    gpu.raster(&raster).expect("a pass")
}

fn texture(gpu: &Gpu, [width, height]: [u32; 2], texels: &[[f32; 4]]) -> Image {
    gpu.texture("test", FLOAT, width, height, &[bytemuck::cast_slice(texels).to_vec()]).expect("a texture")
}

/// Pixels of a layer pass over one row of texels.
fn layer(parts: &[Vec<[f32; 4]>], how: u32, [low, high]: [f32; 2]) -> Vec<[u8; 4]> {
    let gpu = gpu();
    let size = [parts[0].len() as u32, 1];
    let images: Vec<Image> = parts.iter().map(|texels| texture(&gpu, size, texels)).collect();
    let image = |i: usize| Bind::from(&images[i.min(images.len() - 1)]);
    let exposure = gpu.buffer_from("test.exposure", &[0.0_f32; 4]).expect("a buffer");
    let (pipeline, canvas) = (pass(&gpu, "screen.vert", "layer.frag"), gpu.target("test.canvas", BYTES, size[0], 1));
    let canvas = canvas.expect("a target");
    let depth = Vec4::new(0.5, 0.0, 0.0, 1.0); // 0.5 / d
    let frame = gpu.frame(|cmd| {
        let colors = [Attach::clear(&canvas)];
        cmd.render(&Attachments { colors: &colors, depth: None, area: [0, 0, size[0], 1] }, |draw| {
            draw.bind(&pipeline, &[image(0), (&exposure).into(), image(1), image(2)]);
            let parts = parts.len() as u32;
            draw.push(&LayerPush { how, tonemap: 3, left: 0, top: 0, parts, low, high, depth });
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

/// Discs of caches on, in front of and behind a surface, and turned away from the eye, in a parallel view along -Z.
#[test]
fn discs_lie_on_what_is_seen() {
    let gpu = gpu();
    let size = [48_u32, 48];
    let area = std::f32::consts::PI * 0.04; // of a radius of 0.2
    let cache = |x: f32, z: f32, normal: Vec3| Cache {
        position: Vec3::new(x, 0.0, z),
        exponent: 1.0,
        normal,
        area,
        middle: Vec3::ZERO,
        breadth: 0.0,
        axis: Vec3::X,
        radius: 0.2,
    };
    let caches =
        [cache(-0.6, 0.5, Vec3::Z), cache(0.0, 0.6, Vec3::Z), cache(0.6, 0.3, Vec3::Z), cache(0.0, 0.6, -Vec3::Z)];
    let buffer = gpu.buffer_from("test.caches", &caches).expect("a buffer");
    let depth = texture(&gpu, size, &vec![[0.5; 4]; 48 * 48]);
    let (pipeline, canvas) = (pass(&gpu, "discs.vert", "discs.frag"), gpu.target("test.canvas", BYTES, 48, 48));
    let canvas = canvas.expect("a target");
    let frame = gpu.frame(|cmd| {
        let colors = [Attach::clear(&canvas)];
        cmd.render(&Attachments { colors: &colors, depth: None, area: [0, 0, 48, 48] }, |draw| {
            draw.bind(&pipeline, &[(&buffer).into(), (&depth).into()]);
            // This view maps z to depth.
            draw.push(&DiscPush { clip_from_world: Mat4::IDENTITY, eye: Vec4::Z, size: 1.0, left: 0, top: 0 });
            draw.draw(caches.len() as u32 * 3 * DISC_CORNERS);
        });
        cmd.barrier(Use::ColorWrite, Use::CopyRead);
        Ok(())
    });
    drop(frame.expect("a frame"));
    let pixels: Vec<[u8; 4]> = gpu.read_image(&canvas).expect("pixels");
    let mut counts = [0; 3];
    for (i, pixel) in pixels.iter().enumerate().filter(|(_, pixel)| pixel[3] > 0) {
        let (x, y) = ((i % 48) as f32 / 24.0 - 1.0 + 1.0 / 48.0, (i / 48) as f32 / 24.0 - 1.0 + 1.0 / 48.0);
        let which = if x < -0.3 {
            0
        } else if x < 0.3 {
            1
        } else {
            2
        };
        let middle = caches[which].position;
        assert!((x - middle.x).hypot(y) < 0.21, "{pixel:?} at {x} {y}");
        counts[which] += 1;
    }
    // Area of a polygon with 16 corners, at 24 pixels per unit.
    let wanted = 16.0 * 0.5 * 0.04 * (std::f64::consts::TAU / 16.0).sin() * 576.0;
    for count in &counts[..2] {
        assert!((f64::from(*count) - wanted).abs() < 0.1 * wanted, "{count} of {wanted} pixels");
    }
    assert_eq!(counts[2], 0, "discs behind the surface must be hidden");
    let color = |x: usize| pixels[24 * 48 + x];
    assert_ne!(color(9), color(24), "neighbouring discs must have different colours");
}
