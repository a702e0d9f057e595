//! `lightskin info`: the contents of a scene, the stages of its frame, their memory, and the cost of the quality
//! levels.

use super::gather::ClusterArgs;
use super::words::{AntialiasingArg, ShadowsArg, light_shadows_word};
use super::{CacheArgs, DeviceArgs, QualityArg, bake_scene, check_messages, load_scene, thousands, word};
use anyhow::{Context, Result};
use glam::{DAffine3, DVec3};
use lightskin::frame::plan::STAGES;
use lightskin::frame::settings::Gather;
use lightskin::frame::{Indirect, Light, Look, Near, Picture, Quality, Settings, View, World, record, tune};
use lightskin::gpu::Gpu;
use lightskin::scene::{Camera, Instance, LightKind, Scene, luminance};
use lightskin::shared::Val;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Size of the picture for which memory and times are measured [pixels].
const SIZE: [u32; 2] = [1280, 720];

/// Reduced albedo below which the dipole model is inexact. METHOD 7 has the figures.
const LEAST_ALBEDO: f64 = 0.8;

/// Angle by which the camera turns from one measured frame to the next \[rad\].
const TURN: f64 = 0.01;

/// Number of measured frames of each kind per quality level; the median is printed.
const FRAMES: usize = 3;

#[derive(clap::Args)]
pub(super) struct Info {
    /// glTF or GLB file, or a folder that contains one [default: the built-in showpiece].
    scene: Option<PathBuf>,
    #[command(flatten)]
    caches: CacheArgs,
    /// Virtual lights per light source: N x N [default: 128 at --quality high].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    rsm: Option<u32>,
    /// Bake and draw at every quality level, and print the memory and frame time of each on this device.
    #[arg(long)]
    measure: bool,
    #[command(flatten)]
    cluster: ClusterArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

pub(super) fn run(args: &Info) -> Result<()> {
    let scene = load_scene(args.scene.as_deref(), &args.caches)?;
    say!("scene {}", scene.name);
    say!(
        "  {} triangles in {} meshes, {} instances",
        thousands(scene.triangle_count()),
        scene.meshes.len(),
        scene.instances.len()
    );
    if let Some((low, high)) = scene.bounds() {
        let size = high - low;
        say!(
            "  {:.3} x {:.3} x {:.3} m around ({:.3}, {:.3}, {:.3})",
            size.x,
            size.y,
            size.z,
            (low.x + high.x) / 2.0,
            (low.y + high.y) / 2.0,
            (low.z + high.z) / 2.0
        );
    }
    say!("  {} materials, {} images", scene.materials.len(), scene.images.len());
    for (i, camera) in scene.cameras.iter().enumerate() {
        say!("  camera {i} '{}' {:?}", camera.name, camera.projection);
    }
    for (i, light) in scene.lights.iter().enumerate() {
        let (kind, unit) = match light.kind {
            LightKind::Directional => ("directional".to_owned(), "lx"),
            LightKind::Point => ("point".to_owned(), "cd"),
            LightKind::Spot { inner, outer } => {
                (format!("spot {:.1} to {:.1} degrees", inner.to_degrees(), outer.to_degrees()), "cd")
            }
        };
        say!("  light {i} '{}' {kind}, {} {unit}", light.name, light.intensity);
    }
    say_media(&scene);
    let bent = scene.instances.iter().filter(|instance| instance.pose.is_some()).count();
    if bent > 0 {
        say!("  {} instances are skinned or morphed", thousands(bent));
    }
    for (i, animation) in scene.rig.iter().flat_map(|rig| &rig.parts().animations).enumerate() {
        let (begin, end) = animation.span();
        say!("  animation {i} '{}' {begin} to {end} s, {} channels", animation.name, animation.channels.len());
    }

    let baked = bake_scene(&scene, args.scene.as_deref(), &args.caches.settings(), false)?;
    say!("caches");
    say!(
        "  {} at {:.4} m spacing in {} models",
        thousands(baked.count),
        baked.caches.spacing,
        baked.caches.models.len()
    );

    let gpu = args.device.open()?;
    let quality = args.caches.quality();
    let mut settings = Settings::at(quality, baked.count);
    settings.rsm = args.rsm.unwrap_or(settings.rsm);
    if let (Some(rule), Indirect::Caches(caches)) = (args.cluster.rule(), &mut settings.indirect) {
        caches.gather = Gather::Clusters { rule, dim: false };
    }
    let world = World::new(&gpu, &scene, Some(&baked.caches))?;
    let light = Light::new(&gpu, &scene, &world, &settings, 1)?;
    let _picture = Picture::new(&gpu, &world, &light, SIZE)?;
    let patches = world.emitters.iter().filter(|patch| patch.flux != glam::Vec3::ZERO);
    if !world.areas.is_empty() {
        say!("area lights");
        for area in &world.areas {
            let [x, y, z] = area.middle.to_array();
            let [width, height] = [area.right, area.up].map(|side| 2.0 * side.length());
            let (samples, luminance) = (area.samples[0] * area.samples[1], luminance(area.radiance));
            say!("  {width:.4} by {height:.4} m at ({x:.4}, {y:.4}, {z:.4}), {luminance:.4} cd/m^2, {samples} samples");
        }
    }
    if !world.bodies.is_empty() {
        say!("small emissive bodies");
        for body in &world.bodies {
            let [x, y, z] = body.middle.to_array();
            say!("  at ({x:.4}, {y:.4}, {z:.4}), radius {:.4} m, {:.4} cd", body.radius, luminance(body.intensity));
        }
    }
    if light.plan.emitters {
        let flux: f64 = patches.clone().map(|p| luminance(p.flux.as_dvec3())).sum();
        say!("emitters");
        say!("  {} patches of other emissive surfaces, {flux:.4} lm", thousands(patches.count()));
    }
    say!("frame plan");
    for stage in STAGES {
        let runs = if (stage.planned)(&light.plan) { "runs" } else { "-" };
        say!("  {:>2} {:<12} {runs:<5} {}", stage.number, stage.name, light.plan.why(stage));
    }

    say!("memory on {} at {}x{}", gpu.report().name, SIZE[0], SIZE[1]);
    let mut stages: BTreeMap<String, BTreeMap<String, u64>> = BTreeMap::new();
    for resource in gpu.resources() {
        let (stage, thing) = resource.name.split_once('.').unwrap_or(("other", &resource.name));
        let thing = if thing.starts_with("texture ") { "textures" } else { thing };
        *stages.entry(stage.into()).or_default().entry(thing.into()).or_default() += resource.bytes;
    }
    for (stage, things) in &stages {
        say!("  {stage:<12} {:>10} KiB", kib(things.values().sum()));
        for (thing, bytes) in things {
            say!("    {thing:<20} {:>10} KiB", kib(*bytes));
        }
    }
    let caches = baked.count.max(1) as f64;
    let each = |name: &str| {
        let bytes = name.split_once('.').and_then(|(stage, thing)| stages.get(stage)?.get(thing));
        bytes.map_or(0.0, |bytes| *bytes as f64 / caches)
    };
    let state = ["scene.model_caches", "atlas.caches", "gather.proxies", "cull.flags", "cull.live"];
    let told: Vec<String> = state.iter().map(|name| format!("{name} {:.0}", each(name))).collect();
    say!("  of each cache {:.0} bytes ({})", state.iter().map(|name| each(name)).sum::<f64>(), told.join(", "));
    for (name, why) in [
        ("gather.parts", "partial sums over the VALs, which keep the device busy if there are few caches"),
        ("gather.depth_images", "the depth image of each cache, for --shadows per-light"),
        ("scene.references", "the caches that each vertex interpolates"),
    ] {
        let bytes = each(name);
        if bytes > 0.0 {
            say!("    and {bytes:.0} in {name}: {why}");
        }
    }
    if let (Some(rays), Some(things)) = (world.rays(), stages.get("rays")) {
        let triangles = rays.triangle_count.max(1) as f64;
        let each = |thing: &str| things.get(thing).map_or(0.0, |bytes| *bytes as f64 / triangles);
        let told = ["nodes", "triangles", "instances"].map(|thing| format!("rays.{thing} {:.1}", each(thing)));
        let all = thousands(rays.triangle_count);
        say!("  of each of {all} triangles in the ray hierarchy, in bytes: {}", told.join(", "));
    }
    say_levels(&gpu, &world, quality);
    if args.measure {
        measure_levels(args, &gpu)?;
    } else {
        say!("  --measure adds the caches, the memory and the frame time of each level on this device");
    }
    check_messages(&gpu, &[])
}

/// Prints the media inside bodies: how far light travels in them compared to the size of the bodies.
fn say_media(scene: &Scene) {
    for (index, material) in scene.materials.iter().enumerate() {
        let Some(inside) = material.subsurface else { continue };
        let medium = inside.medium();
        let path = medium.extinction.recip();
        let millimetres = |v: DVec3| format!("{:.4} {:.4} {:.4} mm", 1e3 * v.x, 1e3 * v.y, 1e3 * v.z);
        say!("  inside '{}': mean free path {}, albedo {:.4}", material.name, millimetres(path), medium.albedo);
        let is_filled = |instance: &&Instance| {
            scene.meshes[instance.mesh].primitives.iter().any(|primitive| primitive.material == index)
        };
        let size = |instance: &Instance| {
            let points = scene.meshes[instance.mesh].vertices.iter();
            let points = points.map(|v| instance.world_from_model.transform_point3(v.position.as_dvec3()));
            let (low, high) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
            (high - low).max_element()
        };
        let smallest = scene.instances.iter().filter(is_filled).map(size).fold(f64::INFINITY, f64::min);
        if smallest.is_finite() {
            let share = 100.0 * path / smallest;
            say!("    {:.3} {:.3} {:.3} % of the smallest model, {smallest:.4} m", share.x, share.y, share.z);
        }
        if path.max_element() > 0.5 * smallest {
            say!("    warning: light crosses the model with little scattering; the diffusion model is not valid");
        }
        if medium.albedo.min_element() < LEAST_ALBEDO {
            say!(
                "    warning: with an albedo below {LEAST_ALBEDO} light is absorbed before it scatters much; diffusion is inexact"
            );
        }
    }
}

/// Prints the settings of each quality level.
fn say_levels(gpu: &Gpu, world: &World, now: Quality) {
    let most = gpu.most_buffer_bytes() / size_of::<Val>() as u64;
    let mut too_many = Vec::new();
    say!("quality       caches  refs   VALs  shadow map  near rays  bounces    aa  shadows");
    for quality in Quality::ALL {
        let sides =
            world.lights().iter().map(|light| u64::from(light.views) * u64::from(light.rsm_size(quality.rsm())).pow(2));
        let vals = sides.sum::<u64>() + world.emitters.len() as u64;
        too_many.extend((vals > most).then(|| quality.name()));
        say!(
            "{} {:<10} {:>6} {:>5} {:>6} {:>11} {:>10} {:>8} {:>5}  {}",
            if quality == now { '*' } else { ' ' },
            quality.name(),
            quality.caches(),
            quality.references(),
            vals,
            light_shadows_word(quality.light_shadows()),
            match quality.near() {
                Near::Off => "off".to_owned(),
                near => format!("{} / {}", near.per_pixel(), near.every(SIZE).pow(2)),
            },
            quality.bounces(),
            word(AntialiasingArg::of(quality.antialiasing())),
            ShadowsArg::of(quality.shadows(quality.caches(), quality.near()))
        );
    }
    say!(
        "  At --quality reference short rays are endless. lightskin render takes 4 per pixel in each of 64 pictures (--aa 64)."
    );
    if !too_many.is_empty() {
        let device = &gpu.report().name;
        say!("  more VALs than {device} allows ({most}) at {}: lower --rsm or --quality", too_many.join(", "));
    }
}

/// Bakes and draws each quality level, and prints its caches, memory and frame time.
fn measure_levels(args: &Info, gpu: &Gpu) -> Result<()> {
    say!("  on {} at {}x{}, median of {FRAMES} frames:", gpu.report().name, SIZE[0], SIZE[1]);
    say!("  (camera: the time of a frame in which only the camera has moved)");
    say!("              caches   memory [MiB]   frame [ms]   camera [ms]");
    for quality in Quality::ALL {
        let caches = CacheArgs { quality: QualityArg::of(quality), ..args.caches.clone() };
        let scene = load_scene(args.scene.as_deref(), &caches)?;
        let baked = bake_scene(&scene, args.scene.as_deref(), &caches.settings(), false)?;
        let before: u64 = gpu.resources().iter().map(|resource| resource.bytes).sum();
        let world = World::new(gpu, &scene, Some(&baked.caches))?;
        let settings = Settings::at(quality, baked.count).with_ways(tune::fastest(gpu)?.ways);
        let camera = scene.cameras.first().context("the scene has no camera")?;
        // Everything anew in each frame; then only what follows the camera.
        let (mut bytes, mut times) = (0, [String::new(), String::new()]);
        for (reuse, median) in [false, true].into_iter().zip(&mut times) {
            let mut light = Light::new(gpu, &scene, &world, &Settings { reuse, ..settings }, 1)?;
            let mut picture = Picture::new(gpu, &world, &light, SIZE)?;
            if !reuse {
                bytes = gpu.resources().iter().map(|resource| resource.bytes).sum::<u64>() - before;
            }
            let mut measured = Vec::new();
            for i in 0..=FRAMES {
                let turned = DAffine3::from_rotation_y(TURN * i as f64);
                let camera = Camera { world_from_camera: camera.world_from_camera * turned, ..camera.clone() };
                let view = View::new(&camera, SIZE, world.origin, world.radius);
                let drawn = gpu.timed_frame(|cmd| {
                    record(cmd, &world, &mut light, &mut [(view, &mut picture)], &Look::default());
                    Ok(())
                })?;
                // Drivers defer work to the first frame, so it is not counted.
                measured.extend(gpu.times(&drawn)?.gpu_ms().filter(|_| i > 0));
            }
            measured.sort_by(f64::total_cmp);
            *median = measured.get(measured.len() / 2).map_or("-".into(), |ms| format!("{ms:.1}"));
        }
        let (mib, [all, camera]) = (bytes as f64 / f64::from(1 << 20), times);
        say!("  {:<10} {:>8} {mib:>14.1} {all:>12} {camera:>13}", quality.name(), thousands(baked.count));
    }
    Ok(())
}

fn kib(bytes: u64) -> String {
    format!("{:.1}", bytes as f64 / 1024.0)
}
