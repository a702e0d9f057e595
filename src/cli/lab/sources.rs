//! `lightskin lab sources`: tables of the sources of error in indirect light.

use crate::cli::{
    Baked, CacheArgs, DeviceArgs, bake_scene, check_messages, divided, load_punctual, progress_bar, render, thousands,
};
use anyhow::Result;
use clap::Args;
use glam::DVec3;
use lightskin::files;
use lightskin::frame::{View, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Knobs};
use lightskin::lab::sources::curves::{
    FORM_FACTOR_DISTANCES, Receives, TILTS, form_factor_error, lobe_csv, lobe_errors,
};
use lightskin::lab::sources::table::Figures;
use lightskin::lab::sources::{Lights, Sources, SourcesSettings, sources};
use lightskin::scene::{Camera, Scene};
use std::path::PathBuf;
use std::time::Instant;

#[derive(Args)]
pub(super) struct SourcesArgs {
    /// glTF or GLB file, or a folder that contains one [default: the built-in atrium].
    scene: Option<PathBuf>,
    /// Picture size [pixels]. Errors are measured at every pixel.
    #[arg(long, value_name = "WxH", default_value = "96x54", value_parser = render::size)]
    size: [u32; 2],
    /// Camera of the scene by name or index, or "eye;target;up;fov" [default: the first camera].
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true, value_parser = crate::cli::camera::readable)]
    camera: Option<String>,
    /// Virtual lights per light source: N x N.
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..=1024))]
    rsm: u32,
    /// Samples per pixel of the path tracer.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(32..=1_000_000))]
    spp: u32,
    /// Only write the error of assuming a constant BRDF over a square (figure 5.7) to this file.
    #[arg(long, value_name = "FILE.csv")]
    curves: Option<PathBuf>,
    #[command(flatten)]
    caches: CacheArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

pub(super) fn run(args: &SourcesArgs) -> Result<()> {
    if let Some(path) = &args.curves {
        files::write(path, lobe_csv(&lobe_errors()).as_bytes())?;
        print_form_factors();
        say!("curves    {}", path.display());
        return Ok(());
    }
    let start = Instant::now();
    let mut scene = divided(load_punctual(args.scene.as_deref())?, &args.caches);
    // The measured stages use the directional lights that approximate a sky. Without `sky`, the paths use them as well.
    scene.sky = None;
    let camera = crate::cli::camera::camera(&scene, args.camera.as_deref())?;
    let baked = bake_scene(&scene, args.scene.as_deref(), &args.caches.settings(), false)?;
    let settings = SourcesSettings { size: args.size, rsm: args.rsm, samples: args.spp, ..SourcesSettings::default() };
    let gpu = args.device.open()?;
    let device = device_picture(&gpu, &scene, &camera, &baked, &settings)?;

    let bar = progress_bar("[{bar:40}] {percent:>3} %  {elapsed}  {wide_msg}");
    let progress = |part: f32, what: &str| {
        bar.set_message(what.to_owned());
        bar.set_position((part * 1000.0) as u64);
    };
    let found = sources(&scene, &camera, &baked.caches, &settings, &progress);
    bar.finish_and_clear();
    print(&found, &scene, &settings, &device);
    say!("time      {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

fn print(found: &Sources, scene: &Scene, settings: &SourcesSettings, device: &[[DVec3; 2]]) {
    let [w, h] = settings.size;
    say!(
        "scene     {} ({} triangles, {} caches, {} VALs)",
        scene.name,
        thousands(scene.triangle_count()),
        thousands(found.caches),
        thousands(found.vals)
    );
    say!("pixels    {} of {w}x{h} show a surface", thousands(found.pixels.len()));
    for (lobe, table) in found.tables.iter().enumerate() {
        let of = |lights: &[[DVec3; 2]]| lights.iter().map(|light| light[lobe]).collect::<Vec<_>>();
        let seen: Lights = found.pixels.iter().map(|i| device[*i]).collect();
        let twin = Figures::of(&of(&seen), &of(&found.engine), &of(&found.engine));
        let far = |(a, b): &(&[DVec3; 2], &[DVec3; 2])| (a[lobe] - b[lobe]).length() > 0.01 * b[lobe].length();
        let off = seen.iter().zip(&found.engine).filter(far).count();
        say!("");
        let [limit, truth] = table.noise.map(|f| format!("{:.2} % (RMSE {:.2} %)", 100.0 * f.mae, 100.0 * f.rmse));
        say!(
            "{}: the device and the start of the chain differ by {:.3} % on average; {off} pixels differ by more than 1 %",
            table.lobe,
            100.0 * twin.mae
        );
        say!("mean absolute noise of the path tracer: {limit} without shadows, {truth} with shadows");
        say!("");
        for line in table.markdown().lines() {
            say!("{line}");
        }
    }
}

/// The engine's own indirect light without shadows, both lobes of every pixel. The missing shadows are a row of the
/// tables.
fn device_picture(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    baked: &Baked,
    settings: &SourcesSettings,
) -> Result<Lights> {
    let wanted = Knobs { rsm: settings.rsm, ..Knobs::plain(settings.size) };
    let world = World::new(gpu, scene, Some(&baked.caches))?;
    let mut frame = Frame::new(gpu, scene, &world, &wanted)?;
    let view = View::new(camera, wanted.size, world.origin, world.radius);
    let drawn = gpu.timed_frame(|cmd| {
        frame.record(cmd, &world, &view);
        Ok(())
    })?;
    gpu.times(&drawn)?;
    let mut lights = vec![[DVec3::ZERO; 2]; settings.size[0] as usize * settings.size[1] as usize];
    if let Some(indirect) = &frame.picture.indirect {
        for (lobe, image) in [Some(&indirect.diffuse), indirect.glossy.as_ref()].into_iter().enumerate() {
            let Some(image) = image else { continue };
            let texels: Vec<[f32; 4]> = gpu.read_image(image)?;
            lights
                .iter_mut()
                .zip(texels)
                .for_each(|(light, t)| light[lobe] = DVec3::new(t[0].into(), t[1].into(), t[2].into()));
        }
    }
    check_messages(gpu, &drawn.problems)?;
    Ok(lights)
}

/// Prints the table of the disc's form factor.
fn print_form_factors() {
    for (receives, name) in [
        (Receives::Facing, "normal towards the disc's centre"),
        (Receives::Parallel, "normal opposite to the disc's"),
        (Receives::Upright, "normal at right angles to the disc's"),
    ] {
        say!("{name}; distance in square roots of the area, angle off the disc's axis");
        say!("");
        say!("| | {} |", TILTS.map(|tilt| format!("{tilt} deg")).join(" | "));
        say!("|{}", " ---: |".repeat(TILTS.len() + 1));
        for distance in FORM_FACTOR_DISTANCES {
            let cell = |tilt| {
                form_factor_error(receives, distance, tilt).map_or("-".into(), |e| format!("{:+.2} %", 100.0 * e))
            };
            say!("| {distance} | {} |", TILTS.map(cell).join(" | "));
        }
        say!("");
    }
}
