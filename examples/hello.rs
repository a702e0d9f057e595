//! Renders a glTF file to a picture: `cargo run --release --example hello -- scene.glb picture.png`.

use lightskin::frame::engine::Loaded;
use lightskin::frame::{Engine, Look, Quality};
use lightskin::gpu::{Gpu, Options};
use lightskin::image::write_png;

fn main() -> lightskin::Result<()> {
    let mut args = std::env::args().skip(1);
    let scene = args.next().unwrap_or_else(|| "assets/cornell_glossy.glb".into());
    let out = args.next().unwrap_or_else(|| "picture.png".into());
    let size = [640, 360];

    let loaded = Loaded::open(scene.as_ref(), Quality::High, &|_, _| {})?;
    let (camera, settings) = (loaded.scene.cameras[0].clone(), loaded.settings(Quality::High));
    let gpu = Gpu::new(&Options::default())?;
    let mut engine = Engine::new(&gpu, loaded, &settings)?;
    let mut picture = engine.picture(&gpu, size)?;
    let view = engine.view(&camera, size);
    gpu.run_once("frame", |cmd| engine.record(cmd, &mut [(view, &mut picture)], &Look::default()))?;
    write_png(out.as_ref(), size[0], size[1], &gpu.read_image(&picture.output.picture)?)
}
