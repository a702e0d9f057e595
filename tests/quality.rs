//! Error of interpolated caches against every VAL at every pixel, mainly on the Cornell box. `--nocapture` prints the
//! figures.

use lightskin::bake::{self, Density};
use lightskin::frame::{Interpolation, ProxyWeight, View, World};
use lightskin::gpu::{Gpu, Options};
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::metrics::{Metrics, metrics};
use lightskin::scene::Scene;
use lightskin::scene::build::{CornellSurface, atrium, cornell};

/// Diffuse and glossy indirect radiance, RGB per pixel, of pixels that show a surface.
struct Layers {
    diffuse: Vec<[f32; 3]>,
    glossy: Vec<[f32; 3]>,
}

fn render(gpu: &Gpu, scene: &Scene, gi: Gi, caches: usize, size: [u32; 2]) -> Layers {
    render_with(gpu, scene, &spread(caches, 60.0, 8), &Knobs { gi, ..Knobs::plain(size) })
}

/// Settings for this number of caches, this angle [degrees], and this number of references per vertex.
fn spread(caches: usize, angle: f32, references: usize) -> bake::BakeSettings {
    bake::BakeSettings { density: Density::Count(caches), angle: angle.to_radians(), references }
}

fn render_with(gpu: &Gpu, scene: &Scene, bake: &bake::BakeSettings, settings: &Knobs) -> Layers {
    let size = settings.size;
    let baked = bake::bake(scene, bake, &|_, _| {}).expect("bake");
    let buffers = World::new(gpu, scene, Some(&baked)).expect("upload");
    let mut frame = Frame::new(gpu, scene, &buffers, settings).expect("frame");
    let view = View::new(&scene.cameras[0], size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &buffers, &view);
        Ok(())
    });
    gpu.times(&drawn.expect("frame")).expect("times");
    let depth: Vec<f32> = gpu.read_image(&frame.picture.surface.depth).expect("depth");
    let indirect = frame.picture.indirect.as_ref().expect("indirect");
    let read = |image| -> Vec<[f32; 3]> {
        let texels: Vec<[f32; 4]> = gpu.read_image(image).expect("layer");
        let rgb = texels.iter().map(|t| [t[0], t[1], t[2]]);
        rgb.zip(&depth).filter(|(_, d)| **d > 0.0).map(|(p, _)| p).collect()
    };
    Layers { diffuse: read(&indirect.diffuse), glossy: indirect.glossy.as_ref().map(read).unwrap_or_default() }
}

/// The figures of one comparison, in one line.
fn line(e: &Metrics) -> String {
    let Metrics { mare, bias, relmse, relmse_trimmed, .. } = e;
    format!("MARE {mare:.4}, bias {bias:+.4}, relMSE {relmse:.4}, without the worst 1 % {relmse_trimmed:.5}")
}

const COUNTS: [usize; 4] = [50, 250, 1000, 4000];

#[test]
fn diffuse_cornell_box_converges_to_brute_force() {
    let gpu = Gpu::new(&Options::default()).expect("a Vulkan device");
    let scene = cornell(CornellSurface::Diffuse, 0.05);
    let truth = render(&gpu, &scene, Gi::BruteForce, 1, [320, 180]);
    let found = COUNTS.map(|n| metrics(&render(&gpu, &scene, Gi::LightSkin, n, [320, 180]).diffuse, &truth.diffuse));
    for (n, e) in COUNTS.iter().zip(&found) {
        println!("diffuse, {n} caches: {}", line(e));
    }
    assert!(found[2].mare < 0.08, "{:?}", found[2]);
    assert!(found[2].bias.abs() < 0.02, "{:?}", found[2]);
    assert!(found[2].relmse_trimmed < 0.01, "{:?}", found[2]);
    for pair in found.windows(2) {
        assert!(pair[1].mare < pair[0].mare, "{pair:?}");
        // With 250 caches and more, the light is correct within the noise of their placement.
        assert!(pair[1].bias.abs() < 0.01, "{pair:?}");
        assert!(pair[1].relmse_trimmed < pair[0].relmse_trimmed, "{pair:?}");
    }
}

/// No bound is known for the glossy lobe. Its error is printed, and must fall with more caches.
#[test]
fn glossy_cornell_box_is_reported() {
    let gpu = Gpu::new(&Options::default()).expect("a Vulkan device");
    let scene = cornell(CornellSurface::Glossy, 0.05);
    let size = [320, 180];
    let truth = render(&gpu, &scene, Gi::BruteForce, 1, size);
    let found = COUNTS.map(|n| metrics(&render(&gpu, &scene, Gi::LightSkin, n, size).glossy, &truth.glossy));
    for (n, e) in COUNTS.iter().zip(&found) {
        println!("glossy, k = 40, {n} caches: {}", line(e));
    }
    assert!(found[3].mare < 0.5 * found[0].mare, "{found:?}");
    assert!(found[3].relmse_trimmed < found[0].relmse_trimmed, "{found:?}");
}

/// The figures of docs/choices.md. Only the choice with a clear winner on both scenes is asserted.
#[test]
fn defaults_against_their_alternatives() {
    let gpu = Gpu::new(&Options::default()).expect("a Vulkan device");
    let base = Knobs { rsm: 64, ..Knobs::plain([320, 180]) };
    for (name, scene, caches) in
        [("Cornell box", cornell(CornellSurface::Glossy, 0.05), 1000), ("atrium", atrium(), 2000)]
    {
        let truth = render_with(&gpu, &scene, &spread(1, 60.0, 8), &Knobs { gi: Gi::BruteForce, ..base });
        let report = |what: &str, angle: f32, references: usize, settings: &Knobs| {
            let found = render_with(&gpu, &scene, &spread(caches, angle, references), settings);
            let diffuse = metrics(&found.diffuse, &truth.diffuse);
            let glossy = metrics(&found.glossy, &truth.glossy);
            println!("{name}, {caches} caches, {what}: diffuse {}; glossy {}", line(&diffuse), line(&glossy));
            diffuse
        };
        let default = report("defaults", 60.0, 8, &base);
        let printed = report("as printed", 60.0, 8, &Knobs { interpolation: Interpolation::Printed, ..base });
        report("form-factor weights", 60.0, 8, &Knobs { proxy_weight: ProxyWeight::FormFactor, ..base });
        report("16 references", 60.0, 16, &base);
        report("angle 45", 45.0, 8, &base);
        report("angle 75", 75.0, 8, &base);
        assert!(default.mare < printed.mare, "{name}: {default:?} against {printed:?}");
        assert!(default.relmse_trimmed < printed.relmse_trimmed, "{name}: {default:?} against {printed:?}");
    }
}
