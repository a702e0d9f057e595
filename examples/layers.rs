//! Reads back single layers of a picture, in physical units: `cargo run --release --example layers -- scene.glb`.
#![allow(clippy::print_stdout, reason = "its output")]

use lightskin::frame::engine::Loaded;
use lightskin::frame::{Engine, Look, Quality};
use lightskin::gpu::{Gpu, Options};

/// Mean of each channel.
fn mean(texels: &[[f32; 4]]) -> [f32; 3] {
    [0, 1, 2].map(|c| texels.iter().map(|t| t[c]).sum::<f32>() / texels.len() as f32)
}

fn main() -> lightskin::Result<()> {
    let file = std::env::args().nth(1).unwrap_or_else(|| "assets/cornell_glossy.glb".into());
    let size = [320, 180];

    let loaded = Loaded::open(file.as_ref(), Quality::High, &|_, _| {})?;
    let (camera, settings) = (loaded.scene.cameras[0].clone(), loaded.settings(Quality::High));
    let gpu = Gpu::new(&Options::default())?;
    let mut engine = Engine::new(&gpu, loaded, &settings)?;
    let mut picture = engine.picture(&gpu, size)?;
    let view = engine.view(&camera, size);
    gpu.run_once("frame", |cmd| engine.record(cmd, &mut [(view, &mut picture)], &Look::default()))?;

    println!("radiance [cd/m^2], means of red, green, blue");
    println!("direct            {:?}", mean(&gpu.read_image(&picture.surface.radiance)?));
    if let Some(indirect) = &picture.indirect {
        println!("indirect, diffuse {:?}", mean(&gpu.read_image(&indirect.diffuse)?));
        if let Some(glossy) = &indirect.glossy {
            println!("indirect, glossy  {:?}", mean(&gpu.read_image(glossy)?));
        }
    }
    // Depth is reversed: 1 at the near plane, 0 where there is no surface.
    let depth: Vec<f32> = gpu.read_image(&picture.surface.depth)?;
    println!("pixels that show a surface: {}", depth.iter().filter(|d| **d > 0.0).count());
    Ok(())
}
