//! `lightskin info`: what a scene holds, which stages its frame has, and the memory of each.

use super::render::default_shadows;
use super::{CacheArgs, ClusterArgs, DeviceArgs, bake_scene, check_messages, load_scene, thousands};
use anyhow::Result;
use lightskin::frame::{Frame, Knobs, Shadows, World};
use lightskin::scene::LightKind;
use std::collections::BTreeMap;
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct Info {
    /// glTF or GLB file, or a folder with one; the built-in atrium without one.
    scene: Option<PathBuf>,
    #[command(flatten)]
    caches: CacheArgs,
    /// Texels of an RSM's side.
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..=4096))]
    rsm: u32,
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
    let bent = scene.instances.iter().filter(|instance| instance.pose.is_some()).count();
    if bent > 0 {
        say!("  {} instances bend", thousands(bent));
    }
    for (i, animation) in scene.rig.iter().flat_map(|rig| &rig.parts().animations).enumerate() {
        let (begin, end) = animation.span();
        say!("  animation {i} '{}' {begin} to {end} s, {} channels", animation.name, animation.channels.len());
    }

    let baked = bake_scene(&scene, &args.caches.settings(), false)?;
    say!("caches");
    say!(
        "  {} at {:.4} m spacing in {} models",
        thousands(baked.count),
        baked.caches.spacing,
        baked.caches.models.len()
    );

    let gpu = args.device.open()?;
    let (references, cluster) = (args.caches.settings().references, args.cluster.rule());
    let shadows = if cluster.is_some() { Shadows::Off } else { default_shadows(baked.count) };
    let settings = Knobs { references, rsm: args.rsm, cluster, shadows, ..Knobs::default() };
    let buffers = World::new(&gpu, &scene, Some(&baked.caches))?;
    let frame = Frame::new(&gpu, &scene, &buffers, &settings)?;
    let patches = buffers.emitters.iter().filter(|patch| patch.flux != glam::Vec3::ZERO);
    if frame.light.plan.emitters {
        let flux: f32 = patches.clone().map(|p| p.flux.dot(glam::Vec3::new(0.2126, 0.7152, 0.0722))).sum();
        say!("emitters");
        say!("  {} patches of surfaces that emit, {flux:.4} lm", thousands(patches.count()));
    }
    say!("frame plan");
    for line in frame.light.plan.lines() {
        say!("  {:>2} {:<12} {:<5} {}", line.number, line.name, if line.runs { "runs" } else { "-" }, line.because);
    }

    say!("memory on {} at {}x{}", gpu.report().name, settings.size[0], settings.size[1]);
    let images = frame.targets.images().into_iter().map(|i| (i.name.as_str(), i.bytes()));
    let written = frame.buffers().into_iter().map(|b| (b.name.as_str(), b.size));
    let fixed = buffers.buffers().into_iter().map(|b| (b.name.as_str(), b.size));
    let textures = [("scene.textures", buffers.texture_bytes())];
    let mut stages: BTreeMap<&str, Vec<(&str, u64)>> = BTreeMap::new();
    for (name, bytes) in images.chain(written).chain(fixed).chain(textures) {
        let (stage, thing) = name.split_once('.').unwrap_or(("scene", name));
        stages.entry(stage).or_default().push((thing, bytes));
    }
    for (stage, things) in &stages {
        say!("  {stage:<12} {:>10} KiB", kib(things.iter().map(|t| t.1).sum()));
        for (thing, bytes) in things {
            say!("    {thing:<20} {:>10} KiB", kib(*bytes));
        }
    }
    let caches = baked.count.max(1) as f64;
    let each = |stage: &str, thing: &str| {
        let all = stages.get(stage).into_iter().flatten().filter(|(name, _)| *name == thing);
        all.map(|(_, bytes)| *bytes as f64).sum::<f64>() / caches
    };
    let state = ["scene.model_caches", "atlas.caches", "gather.proxies", "cull.flags", "cull.live"];
    let of_state = state.map(|name| name.split_once('.').map_or(0.0, |(stage, thing)| each(stage, thing)));
    let told: Vec<String> = state.iter().zip(of_state).map(|(name, bytes)| format!("{name} {bytes:.0}")).collect();
    say!("  of each cache {:.0} bytes ({})", of_state.iter().sum::<f64>(), told.join(", "));
    for (name, why) in [
        ("gather.parts", "sums of parts of the VALs, which fill the device where caches are few"),
        ("gather.depth_images", "what each sees of the others, for --shadows per-light"),
        ("scene.references", "which caches each vertex refers to"),
    ] {
        let bytes = name.split_once('.').map_or(0.0, |(stage, thing)| each(stage, thing));
        if bytes > 0.0 {
            say!("    and {bytes:.0} in {name}: {why}");
        }
    }
    check_messages(&gpu, &[])
}

fn kib(bytes: u64) -> String {
    format!("{:.1}", bytes as f64 / 1024.0)
}
