//! Draws eight pictures of a lamp that moves on a circle: `cargo run --release --example moving_light -- scene.glb`.
//! Between two frames no caches are placed, and nothing is rebuilt or recompiled.
#![allow(clippy::print_stdout, reason = "its output")]

use lightskin::frame::engine::Loaded;
use lightskin::frame::{Engine, Look, Quality};
use lightskin::gpu::{Gpu, Options};
use lightskin::image::write_png;
use lightskin::scene::{Light, LightKind};
use std::f64::consts::TAU;

fn main() -> lightskin::Result<()> {
    let file = std::env::args().nth(1).unwrap_or_else(|| "assets/cornell_glossy.glb".into());
    let (size, frames) = ([320, 180], 8);

    let mut loaded = Loaded::open(file.as_ref(), Quality::Medium, &|_, _| {})?;
    let (least, most) = loaded.scene.bounds().expect("a scene with triangles");
    let (middle, reach) = (0.5 * (least + most), 0.25 * (most - least));
    loaded.scene.lights.push(Light {
        name: "moving lamp".into(),
        kind: LightKind::Point,
        color: glam::Vec3::ONE,
        intensity: 100.0,
        range: None,
        radius: 0.0,
        position: middle,
        direction: glam::Vec3::NEG_Y,
    });
    let (camera, settings) = (loaded.scene.cameras[0].clone(), loaded.settings(Quality::Medium));
    let gpu = Gpu::new(&Options::default())?;
    let mut engine = Engine::new(&gpu, loaded, &settings)?;
    let mut picture = engine.picture(&gpu, size)?;
    let view = engine.view(&camera, size);
    for frame in 0..frames {
        let (sin, cos) = (TAU * f64::from(frame) / f64::from(frames)).sin_cos();
        engine.edit(&gpu, |scene| {
            let lamp = scene.lights.last_mut().expect("the lamp from above");
            lamp.position = middle + reach * glam::DVec3::new(cos, 0.5, sin);
        })?;
        engine.fit(&gpu, &mut [(&mut picture, size)])?;
        let drawn = gpu.timed_frame(|cmd| {
            engine.record(cmd, &mut [(view, &mut picture)], &Look::default());
            Ok(())
        })?;
        println!("frame {frame}: {:.1} ms", gpu.times(&drawn)?.gpu_ms().unwrap_or(f64::NAN));
        let out = format!("lamp_{frame:02}.png");
        write_png(out.as_ref(), size[0], size[1], &gpu.read_image(&picture.output.picture)?)?;
    }
    Ok(())
}
