//! `lightskin render`: a scene to a picture, with its layers, times and counts.

use super::path_trace::{self, PathTraceArgs};
use super::picture::{LayerArg, Layers, TonemapArg, is_exr};
use super::{Baked, CacheArgs, DeviceArgs, GatherArgs, bake_scene, check_messages, load_scene, load_whole, thousands};
use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use glam::{DAffine3, DMat3, DVec3};
use lightskin::frame::check::{Broken, Check};
use lightskin::frame::{Exposure, Frame, Gi, Interpolation, ProxyWeight, SceneBuffers, Settings, Tonemap, View};
use lightskin::gpu::{Gpu, ZoneTime};
use lightskin::image::{check_writable, replace_file, write_png};
use lightskin::scene::{Camera, Projection, Scene};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(clap::Args)]
pub(super) struct Render {
    /// glTF or GLB file, or a folder with one; the built-in atrium without one.
    scene: Option<PathBuf>,
    /// Picture to write: .png (tone-mapped sRGB) or .exr (linear float, all layers).
    #[arg(short, long, value_name = "FILE", default_value = "lightskin.png", value_parser = picture)]
    out: PathBuf,
    /// Picture size [pixels].
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: [u32; 2],
    /// Camera by name or index, or "eye;target;up;fov" with vectors as x,y,z and the vertical field in degrees.
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true)]
    camera: Option<String>,
    /// Exposure value at ISO 100 (1.2 * 2^EV cd/m^2 becomes white); measured from the picture without it.
    #[arg(long, value_name = "EV", allow_hyphen_values = true, value_parser = exposure)]
    ev: Option<f32>,
    /// Curve from scene to display.
    #[arg(long, value_enum, default_value_t)]
    tonemap: TonemapArg,
    /// How indirect light is made.
    #[arg(long, value_enum, default_value_t)]
    gi: GiArg,
    #[command(flatten)]
    caches: CacheArgs,
    /// Texels of an RSM's side: about N*N virtual lights per light.
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..=4096))]
    rsm: u32,
    /// Texels of a shadow map's side.
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(16..=16384))]
    shadow_map: u32,
    #[command(flatten)]
    gather: GatherArgs,
    /// What is averaged between caches, with which weights.
    #[arg(long, value_enum, default_value_t)]
    interpolation: InterpolationArg,
    /// What pulls a proxy light's position.
    #[arg(long, value_enum, default_value_t)]
    proxy_weight: ProxyWeightArg,
    /// Write this layer alone as R, G, B.
    #[arg(long, value_enum, value_name = "NAME")]
    layer: Option<LayerArg>,
    /// Render the frame N times, for steady times; the last one is written.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,
    /// Write one JSON object per frame with the time of each stage.
    #[arg(long, value_name = "FILE.jsonl")]
    timings: Option<PathBuf>,
    /// Bake even if the result is kept already.
    #[arg(long)]
    bake_again: bool,
    /// Count NaN, infinite and negative values in all layers, VALs and proxies of every frame; any makes the run fail.
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    path_trace: PathTraceArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
enum GiArg {
    /// Interpolated caches.
    #[default]
    Lightskin,
    /// Every virtual light onto every pixel.
    BruteForce,
    /// Light paths drawn at random on the CPU: the reference (see --spp).
    PathTrace,
    /// Direct light alone.
    Off,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum InterpolationArg {
    /// Facing irradiance and position of lit caches, faster kernel.
    #[default]
    Facing,
    /// Flux and position with the thesis's weights.
    Printed,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum ProxyWeightArg {
    /// Irradiance on the cache.
    #[default]
    Irradiance,
    /// Form factor, as printed.
    FormFactor,
}

fn picture(text: &str) -> std::result::Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()).map(str::to_lowercase).as_deref() {
        Some("png" | "exr") => Ok(path),
        _ => Err("the name must end in .png or .exr".into()),
    }
}

pub(super) fn size(text: &str) -> std::result::Result<[u32; 2], String> {
    let parsed = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match parsed {
        Some([w, h]) if (1..=16384).contains(&w) && (1..=16384).contains(&h) => Ok([w, h]),
        _ => Err("needs WIDTHxHEIGHT, each from 1 to 16384, like 1280x720".into()),
    }
}

fn exposure(text: &str) -> std::result::Result<f32, String> {
    match text.parse::<f32>() {
        Ok(v) if v.abs() <= 100.0 => Ok(v),
        _ => Err("needs an exposure value from -100 to 100".into()),
    }
}

impl Render {
    fn settings(&self, gpu: &Gpu) -> Result<Settings> {
        Ok(Settings {
            size: self.size,
            gi: match self.gi {
                GiArg::Lightskin => Gi::LightSkin,
                GiArg::BruteForce => Gi::BruteForce,
                GiArg::PathTrace | GiArg::Off => Gi::Off,
            },
            references: self.caches.settings().references,
            rsm: self.rsm,
            shadow_map: self.shadow_map,
            interpolation: match self.interpolation {
                InterpolationArg::Facing => Interpolation::Facing,
                InterpolationArg::Printed => Interpolation::Printed,
            },
            proxy_weight: match self.proxy_weight {
                ProxyWeightArg::Irradiance => ProxyWeight::Irradiance,
                ProxyWeightArg::FormFactor => ProxyWeight::FormFactor,
            },
            tonemap: match self.tonemap {
                TonemapArg::PbrNeutral => Tonemap::PbrNeutral,
                TonemapArg::Agx => Tonemap::Agx,
                TonemapArg::Aces => Tonemap::Aces,
                TonemapArg::Linear => Tonemap::Linear,
            },
            gather: self.gather.settings(gpu)?,
            cull: !self.gather.no_cull,
            exposure: self.ev.map_or(Exposure::Automatic, Exposure::Ev),
        })
    }
}

/// The camera that `--camera` names, or the first.
pub(super) fn camera(scene: &Scene, wanted: Option<&str>) -> Result<Camera> {
    let names = || {
        let all: Vec<_> = scene.cameras.iter().enumerate().map(|(i, c)| format!("{i} '{}'", c.name)).collect();
        all.join(", ")
    };
    let Some(wanted) = wanted else {
        return scene.cameras.first().cloned().context("the scene has no camera");
    };
    if wanted.contains(';') {
        return free_camera(wanted);
    }
    let found = match wanted.parse::<usize>() {
        Ok(index) => scene.cameras.get(index),
        Err(_) => scene.cameras.iter().find(|c| c.name == wanted),
    };
    found.cloned().with_context(|| format!("--camera {wanted} is none of the scene's: {}", names()))
}

/// A camera from "eye;target;up;fov".
fn free_camera(text: &str) -> Result<Camera> {
    let form = || format!("--camera '{text}': needs 'eye;target;up;fov' like '0,1,4;0,1,0;0,1,0;40'");
    let parts: Vec<&str> = text.split(';').collect();
    let [eye, target, up, fov] = parts[..] else { bail!(form()) };
    let vector = |text: &str| -> Result<DVec3> {
        let numbers: Vec<f64> =
            text.split(',').map(|n| n.trim().parse()).collect::<std::result::Result<_, _>>().with_context(form)?;
        match numbers[..] {
            [x, y, z] if DVec3::new(x, y, z).is_finite() => Ok(DVec3::new(x, y, z)),
            _ => bail!(form()),
        }
    };
    let (eye, target, up) = (vector(eye)?, vector(target)?, vector(up)?);
    let fov: f32 = fov.trim().parse().with_context(form)?;
    if !(0.1..=179.0).contains(&fov) {
        bail!("--camera: the vertical field of view must be from 0.1 to 179 degrees");
    }
    let backward = (eye - target).normalize_or_zero();
    let right = up.cross(backward).normalize_or_zero();
    if right == DVec3::ZERO {
        bail!("--camera: eye and target coincide, or up points along the view");
    }
    let world_from_camera =
        DAffine3::from_mat3_translation(DMat3::from_cols(right, backward.cross(right), backward), eye);
    Ok(Camera {
        name: "--camera".into(),
        world_from_camera,
        projection: Projection::Perspective { yfov: fov.to_radians() },
    })
}

pub(super) fn run(args: &Render) -> Result<()> {
    // Both outputs are tried before long work is done for them.
    for path in [Some(&args.out), args.timings.as_ref()].into_iter().flatten() {
        check_writable(path)?;
    }
    let start = Instant::now();
    if args.gi == GiArg::PathTrace {
        path_trace::stop_in_order()?;
    }
    let scene = match args.gi {
        // Rays need no small triangles.
        GiArg::PathTrace => load_whole(args.scene.as_deref())?,
        _ => load_scene(args.scene.as_deref(), &args.caches)?,
    };
    let camera = camera(&scene, args.camera.as_deref())?;
    let loaded = start.elapsed();
    if args.gi == GiArg::PathTrace {
        let picture = path_trace::Picture {
            out: &args.out,
            size: args.size,
            layer: args.layer,
            tonemap: args.tonemap,
            ev: args.ev,
        };
        return path_trace::run(&args.path_trace, &scene, &camera, &picture);
    }
    let baked = (args.gi == GiArg::Lightskin)
        .then(|| bake_scene(&scene, &args.caches.settings(), args.bake_again))
        .transpose()?;
    let gpu = args.device.open()?;
    let settings = args.settings(&gpu)?;
    let buffers = SceneBuffers::new(&gpu, &scene, baked.as_ref().map(|b| &b.caches))?;
    let frame = Frame::new(&gpu, &scene, &buffers, &settings)?;
    let view = View::new(&camera, settings.size, buffers.origin, buffers.radius);

    let mut runs = Vec::new();
    let mut problems = Vec::new();
    let check = args.check.then(|| Check::new(&gpu)).transpose()?;
    let mut broken = Vec::new();
    for _ in 0..args.repeat {
        let begin = Instant::now();
        // Software drivers attribute chained passes wrongly: there each stage is submitted alone.
        let drawn = gpu.frame(gpu.is_software(), |cmd| {
            frame.record(cmd, &buffers, &view);
            Ok(())
        })?;
        let stages = gpu.times(&drawn)?;
        problems.extend(drawn.problems);
        if let Some(check) = &check {
            broken.extend(check.count(&gpu, &frame.targets)?);
        }
        runs.push(Run { stages, cpu_ms: begin.elapsed().as_secs_f64() * 1e3 });
    }
    let report =
        Report { args, scene: &scene, camera: &camera, baked: baked.as_ref(), gpu: &gpu, frame: &frame, runs: &runs };
    let measured_ev = gpu.read::<f32>(&frame.targets.exposure)?[0];
    let ev = args.ev.unwrap_or(measured_ev);
    let layers = read_layers(&gpu, &frame, &view)?;
    if args.layer.is_none() && !is_exr(&args.out) {
        let [w, h] = settings.size;
        write_png(&args.out, w, h, &gpu.read_image(&frame.targets.output)?)?;
    } else {
        layers.write(&args.out, args.layer, args.tonemap, ev, &report.metadata(ev))?;
    }
    let broken_in_picture = layers.broken();
    if let Some(path) = &args.timings {
        report.write_timings(path)?;
    }
    report.print(loaded, ev);
    check_messages(&gpu, &problems)?;
    report_broken(&broken)?;
    if broken_in_picture > 0 {
        bail!("{broken_in_picture} values of the picture are negative or not finite; this is a bug of lightskin");
    }
    Ok(())
}

/// Says what `--check` has found in all frames, target by target, and fails if that is anything.
fn report_broken(all: &[Broken]) -> Result<()> {
    let mut targets: Vec<Broken> = Vec::new();
    for found in all {
        match targets.iter_mut().find(|t| t.target == found.target) {
            Some(t) => (t.broken, t.values) = (t.broken + found.broken, t.values + found.values),
            None => targets.push(*found),
        }
    }
    for t in &targets {
        say!("check     {:<16} {} of {} values broken", t.target, t.broken, thousands(t.values as usize));
    }
    if targets.iter().any(|t| t.broken > 0) {
        bail!("--check found values that are negative or not finite; this is a bug of lightskin");
    }
    Ok(())
}

/// Reads the layers back.
fn read_layers(gpu: &Gpu, frame: &Frame, view: &View) -> Result<Layers> {
    let t = &frame.targets;
    let dark = || vec![[0.0; 4]; t.size[0] as usize * t.size[1] as usize];
    let optional = |image: Option<&lightskin::gpu::Image>| -> Result<Vec<[f32; 4]>> {
        Ok(image.map(|image| gpu.read_image(image)).transpose()?.unwrap_or_else(dark))
    };
    Ok(Layers {
        size: t.size,
        direct: gpu.read_image(&t.direct)?,
        diffuse: optional(t.indirect.as_ref().map(|i| &i.diffuse))?,
        glossy: optional(t.indirect.as_ref().and_then(|i| i.glossy.as_ref()))?,
        albedo: read_half(gpu, &t.albedo)?,
        normal: gpu.read_image(&t.normal)?,
        depth: view_depth(&gpu.read_image::<f32>(&t.depth)?, view, t.size),
    })
}

/// RGBA16F texels as f32.
fn read_half(gpu: &Gpu, image: &lightskin::gpu::Image) -> Result<Vec<[f32; 4]>> {
    let texels: Vec<[u16; 4]> = gpu.read_image(image)?;
    Ok(texels.into_iter().map(|t| t.map(|h| half::f16::from_bits(h).to_f32())).collect())
}

/// Distances [m] from the camera's plane; infinite where nothing is.
fn view_depth(depth: &[f32], view: &View, [w, h]: [u32; 2]) -> Vec<[f32; 4]> {
    let middle = |i: usize| {
        let (x, y) = (i as u32 % w, i as u32 / w);
        glam::Vec4::new((x as f32 + 0.5) / w as f32 * 2.0 - 1.0, (y as f32 + 0.5) / h as f32 * 2.0 - 1.0, depth[i], 1.0)
    };
    let distance = |i: usize| {
        if depth[i] == 0.0 {
            return f32::INFINITY;
        }
        let world = view.world_from_clip * middle(i);
        view.plane.dot(world / world.w)
    };
    (0..depth.len()).map(|i| [distance(i); 4]).collect()
}

/// One rendered frame.
struct Run {
    stages: Vec<ZoneTime>,
    cpu_ms: f64,
}

/// Everything there is to say about a render.
struct Report<'a> {
    args: &'a Render,
    scene: &'a Scene,
    camera: &'a Camera,
    baked: Option<&'a Baked>,
    gpu: &'a Gpu,
    frame: &'a Frame,
    runs: &'a [Run],
}

impl Report<'_> {
    fn caches(&self) -> usize {
        self.baked.map_or(0, |b| b.count)
    }

    fn vals(&self) -> u32 {
        self.frame.targets.rsm.as_ref().map_or(0, |r| r.vals.count)
    }

    /// How the times were taken.
    fn method(&self) -> &'static str {
        if self.gpu.is_software() { "each stage submitted alone" } else { "timestamps within one submission" }
    }

    fn metadata(&self, ev: f32) -> String {
        let (scene, camera, device) = (&self.scene.name, &self.camera.name, &self.gpu.report().name);
        let (caches, vals) = (self.caches(), self.vals());
        format!("scene {scene}; camera {camera}; device {device}; EV {ev}; {caches} caches; {vals} VALs")
    }

    /// Median time [ms] of each stage over the frames.
    fn medians(&self) -> Vec<(&'static str, f64)> {
        let Some(first) = self.runs.first() else { return Vec::new() };
        let median = |name| {
            let mut all: Vec<f64> =
                self.runs.iter().flat_map(|r| &r.stages).filter(|s| s.name == name).map(|s| s.time_ms).collect();
            all.sort_by(f64::total_cmp);
            all[all.len() / 2]
        };
        first.stages.iter().map(|s| (s.name, median(s.name))).collect()
    }

    fn print(&self, loaded: std::time::Duration, ev: f32) {
        let report = self.gpu.report();
        say!(
            "scene     {} ({} triangles, {} lights; loaded in {:.2} s)",
            self.scene.name,
            thousands(self.scene.triangle_count()),
            self.scene.lights.len(),
            loaded.as_secs_f64()
        );
        say!("device    {} ({}, {})", report.name, report.kind, report.driver);
        if let Some(baked) = self.baked {
            let how = if baked.kept { "read from the kept bake" } else { "baked" };
            say!(
                "caches    {} at {:.3} m spacing ({how} in {:.2} s)",
                thousands(baked.count),
                baked.caches.spacing,
                baked.time.as_secs_f64()
            );
        }
        say!("VALs      {}", thousands(self.vals() as usize));
        say!("exposure  EV {ev:.2}");
        let medians = self.medians();
        for (name, ms) in &medians {
            let pairs = self.caches() as f64 * f64::from(self.vals());
            let per_pair = if *name == "gather" && pairs > 0.0 {
                format!("  ({:.3} ns per cache and VAL)", ms * 1e6 / pairs)
            } else {
                String::new()
            };
            say!("  {name:<12}{ms:>10.3} ms{per_pair}");
        }
        say!(
            "  {:<12}{:>10.3} ms  ({}, median of {})",
            "frame",
            medians.iter().map(|m| m.1).sum::<f64>(),
            self.method(),
            self.runs.len()
        );
        say!("picture   {}", self.args.out.display());
    }

    /// One JSON object per frame.
    fn write_timings(&self, path: &Path) -> Result<()> {
        let report = self.gpu.report();
        let settings = self.frame.targets.size;
        replace_file(path, |temporary| {
            let mut file = std::io::BufWriter::new(std::fs::File::create(temporary)?);
            for (i, run) in self.runs.iter().enumerate() {
                let stages: Vec<_> =
                    run.stages.iter().map(|s| serde_json::json!({ "name": s.name, "gpu_ms": s.time_ms })).collect();
                let gather = run.stages.iter().find(|s| s.name == "gather").map(|s| s.time_ms * 1e6);
                let pairs = self.caches() as f64 * f64::from(self.vals());
                let line = serde_json::json!({
                    "schema": 1,
                    "frame": i,
                    "device": report.name,
                    "driver": report.driver,
                    "software": self.gpu.is_software(),
                    "method": self.method(),
                    "scene": self.scene.name,
                    "triangles": self.scene.triangle_count(),
                    "size": settings,
                    "caches": self.caches(),
                    "vals": self.vals(),
                    "references": self.args.caches.settings().references,
                    "stages": stages,
                    "gather_ns_per_pair": gather.filter(|_| pairs > 0.0).map(|ns| ns / pairs),
                    "gpu_ms": run.stages.iter().map(|s| s.time_ms).sum::<f64>(),
                    "cpu_ms": run.cpu_ms,
                });
                writeln!(file, "{line}")?;
            }
            file.flush()
        })?;
        Ok(())
    }
}
