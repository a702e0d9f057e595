//! `lightskin render`: renders a scene to a picture or its layers, and prints times and counts.

use super::camera::camera;
use super::gather::GatherArgs;
use super::motion::{Motion, MotionArgs, numbered};
use super::path_trace::{self, PathTraceArgs};
use super::picture::{LayerArg, TonemapArg, Writing, exposure_value};
use super::session::{Session, is_session};
use super::sky::SkyArgs;
use super::timings::{Report, timings_file, trace_file};
use super::words::{
    AntialiasingArg, GiArg, InterpArg, InterpolationArg, NearArg, ProxyWeightArg, ShadowsArg, light_shadows,
    light_shadows_word,
};
use super::{
    Baked, CacheArgs, Command, DeviceArgs, arguments, bake_scene, called, check_messages, divide_for, load_under,
    parse, progress_bar, thousands, word, wrong_usage,
};
use anyhow::{Context, Result, bail};
use lightskin::bake::CacheSet;
use lightskin::files::check_writable;
use lightskin::frame::check::{Broken, Check};
use lightskin::frame::settings::{Caches, Gather};
use lightskin::frame::{
    Antialiasing, Exposure, Indirect, Interpolation, Light, LightShadows, Look, Near, Picture, ProxyWeight, Quality,
    Settings, Shadows, View, World, record,
};
use lightskin::gpu::Gpu;
use lightskin::scene::{Camera, Scene};
use lightskin::trace::Trace;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Headings of the help.
pub(super) const QUALITY: &str = "Quality";
const METHOD: &str = "Variants of the method";
pub(super) const MEASURE: &str = "Measuring";

#[derive(clap::Args)]
pub(super) struct Render {
    /// glTF or GLB file, a folder that contains one, or a saved session [default: the built-in showpiece].
    ///
    /// A session is a .json file that the window saves with Ctrl+S. It is rendered with its edited lights and materials,
    /// its camera and its settings. Other flags override those of the session.
    scene: Option<PathBuf>,
    /// Picture file to write, .png or .exr.
    ///
    /// .png is tone-mapped sRGB. .exr is linear float with all layers. {frame} or {frame:04} in the name becomes the
    /// frame number.
    #[arg(short, long, value_name = "FILE", default_value = "lightskin.png", value_parser = picture)]
    out: PathBuf,
    /// Picture size [pixels].
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: [u32; 2],
    /// Camera of the scene by name or index, or "eye;target;up;fov" [default: the first camera].
    ///
    /// eye, target and up are x,y,z [m]; fov is the vertical field of view [degrees].
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true, value_parser = super::camera::readable)]
    camera: Option<String>,
    /// Exposure value at ISO 100 [default: metered from the picture].
    ///
    /// A luminance of 1.2 * 2^EV cd/m^2 becomes white.
    #[arg(long, value_name = "EV", allow_hyphen_values = true, value_parser = exposure)]
    ev: Option<f32>,
    /// Tone curve from radiance to display colours.
    #[arg(long, value_enum, default_value_t)]
    tonemap: TonemapArg,
    /// Write only this layer instead of the picture.
    #[arg(long, value_enum, value_name = "NAME")]
    layer: Option<LayerArg>,
    /// Method for indirect light.
    #[arg(long, value_enum, default_value_t)]
    gi: GiArg,
    /// Number of indirect bounces [default: set by --quality; no limit with --gi path-trace].
    ///
    /// 0 renders only direct light: lamps, emissive surfaces and the sky. Caches support up to 16 bounces, brute force
    /// one.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1000))]
    bounces: Option<u32>,
    #[command(flatten)]
    caches: CacheArgs,
    /// Virtual lights per light source: N x N, the texels of its reflective shadow map [default: 128 at --quality
    /// high].
    ///
    /// A virtual light is a lit surface point that gives indirect light. More of them give smoother indirect light.
    #[arg(long, help_heading = QUALITY, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    rsm: Option<u32>,
    /// Shadows of lamps and the sun: rays, or shadow maps of N x N texels [default: rays at --quality high].
    #[arg(long, help_heading = QUALITY, value_name = "rays|N", value_parser = light_shadows)]
    shadow_map: Option<LightShadows>,
    /// Antialiasing: extra sample points per pixel [default: 4 at --quality high].
    ///
    /// With --gi path-trace, any value but off spreads the samples over the pixel.
    #[arg(long, help_heading = QUALITY, value_name = "POINTS", value_enum)]
    aa: Option<AntialiasingArg>,
    /// Maximum number of glass and blended layers per pixel; the nearest are drawn [default: 4 at --quality high].
    #[arg(long, help_heading = QUALITY, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    layers: Option<u32>,
    #[command(flatten)]
    gather: GatherArgs,
    /// Place of interpolation between caches [default: vertex, or texel if vertex would need too many triangles].
    #[arg(long, help_heading = METHOD, hide_short_help = true, value_enum)]
    interp: Option<InterpArg>,
    /// Quantity that is interpolated between caches.
    ///
    /// Each cache condenses all indirect light into one diffuse and one glossy proxy light.
    #[arg(long, help_heading = METHOD, hide_short_help = true, value_enum, default_value_t)]
    interpolation: InterpolationArg,
    /// Weight of each virtual light when the position of a proxy light is averaged.
    #[arg(long, help_heading = METHOD, hide_short_help = true, value_enum, default_value_t)]
    proxy_weight: ProxyWeightArg,
    /// Shadows of indirect light [default: per-light at --quality high].
    ///
    /// The default is cheaper above 20000 caches (4096 with --near off), with --gather fragment and with clusters.
    #[arg(long, help_heading = QUALITY, value_enum)]
    shadows: Option<ShadowsArg>,
    /// Light and occlusion from surfaces within one cache spacing [default: rays at --quality high].
    #[arg(long, help_heading = QUALITY, value_enum)]
    near: Option<NearArg>,
    /// Short rays per traced pixel; 16 neighbouring pixels share their rays [default: 8 at --quality high].
    #[arg(long, help_heading = QUALITY, hide_short_help = true, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32))]
    near_rays: Option<u32>,
    /// Trace short rays at every N-th pixel of every N-th row [default: 2 at --quality high].
    #[arg(long, help_heading = QUALITY, hide_short_help = true, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    near_every: Option<u32>,
    /// Render the frame N times to measure it; only the last picture is written.
    #[arg(long, help_heading = MEASURE, hide_short_help = true, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,
    /// Write the time of every stage of every frame to a .jsonl or .csv file.
    ///
    /// .jsonl has one object per frame, .csv one row per frame and stage. Repeat the flag to write both.
    #[arg(long, help_heading = MEASURE, hide_short_help = true, value_name = "FILE", value_parser = timings_file)]
    timings: Vec<PathBuf>,
    /// Write a CPU and GPU timeline as a Chrome trace, for ui.perfetto.dev: every stage and, on
    /// GPUs, every compute shader.
    #[arg(long, help_heading = MEASURE, hide_short_help = true, value_name = "FILE.json", value_parser = trace_file)]
    trace: Option<PathBuf>,
    /// Bake again, even if a matching bake is stored.
    #[arg(long, help_heading = MEASURE, hide_short_help = true)]
    bake_again: bool,
    /// Fail if a layer, virtual light or proxy light contains a NaN, an infinity or a negative value.
    #[arg(long, help_heading = MEASURE, hide_short_help = true)]
    check: bool,
    #[command(flatten)]
    motion: MotionArgs,
    #[command(flatten)]
    sky: SkyArgs,
    #[command(flatten)]
    path_trace: PathTraceArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

fn picture(text: &str) -> std::result::Result<PathBuf, String> {
    if text.contains("{frame") && numbered(text.as_ref(), 0) == Path::new(text) {
        return Err("needs {frame} for the frame number, or {frame:04} for at least four digits".into());
    }
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

pub(super) fn exposure(text: &str) -> std::result::Result<f32, String> {
    match text.parse::<f32>() {
        Ok(v) if v.abs() <= 100.0 => Ok(v),
        _ => Err("needs an exposure value from -100 to 100".into()),
    }
}

impl Render {
    /// Number of indirect bounces: as requested, else that of the quality level, or 1 if the method supports only one.
    fn bounces(&self) -> u32 {
        let has_one = self.gi == GiArg::BruteForce || self.gather.by_draws() || self.gather.by_clusters();
        self.bounces.unwrap_or(if has_one { 1 } else { self.caches.quality().bounces() })
    }

    /// Antialiasing: as requested, or that of the quality level.
    fn antialiasing(&self) -> Antialiasing {
        self.aa.map_or(self.caches.quality().antialiasing(), Antialiasing::from)
    }

    /// The settings of the quality level, overridden by the flags.
    pub(super) fn settings(&self, gpu: &Gpu, caches: usize, reuse: bool) -> Result<Settings> {
        let mut settings = Settings::at(self.caches.quality(), caches);
        settings.reuse = reuse;
        settings.rsm = self.rsm.unwrap_or(settings.rsm);
        settings.light_shadows = self.shadow_map.unwrap_or(settings.light_shadows);
        settings.antialiasing = self.antialiasing();
        settings.layers = self.layers.unwrap_or(settings.layers);
        settings.indirect = match self.gi {
            GiArg::PathTrace | GiArg::Off => Indirect::Off,
            _ if self.bounces() == 0 && (self.gather.by_draws() || self.gather.by_clusters()) => Indirect::Off,
            GiArg::BruteForce if self.bounces() == 0 => Indirect::Off,
            GiArg::BruteForce => Indirect::BruteForce,
            GiArg::Lightskin => Indirect::Caches(Caches {
                gather: self.gather.gather(gpu, self.shadows(caches), self.near(), self.bounces())?,
                cull: !self.gather.no_cull,
                interpolation: match self.interpolation {
                    InterpolationArg::Facing => Interpolation::Facing,
                    InterpolationArg::Printed => Interpolation::Printed,
                },
                proxy_weight: match self.proxy_weight {
                    ProxyWeightArg::Irradiance => ProxyWeight::Irradiance,
                    ProxyWeightArg::FormFactor => ProxyWeight::FormFactor,
                },
            }),
        };
        Ok(settings)
    }

    /// Tone curve, exposure and background.
    fn look(&self) -> Look {
        Look {
            tonemap: self.tonemap.curve(),
            exposure: self.ev.map_or(Exposure::Automatic, Exposure::Ev),
            behind: self.sky.behind(),
        }
    }

    /// Short rays: as requested, or those of the quality level if the other flags allow them.
    fn near(&self) -> Near {
        let of_level = self.caches.quality().near();
        let near = match self.near {
            _ if self.gi != GiArg::Lightskin || self.gather.by_clusters() || self.gather.by_draws() => Near::Off,
            Some(NearArg::Off) => Near::Off,
            Some(NearArg::Rays) if of_level == Near::Off => Quality::High.near(),
            Some(NearArg::Rays) | None => of_level,
        };
        match near {
            Near::Off => Near::Off,
            Near::Rays { per_pixel, every } => {
                Near::Rays { per_pixel: self.near_rays.unwrap_or(per_pixel), every: self.near_every.unwrap_or(every) }
            }
        }
    }

    /// Shadows of indirect light: as requested, or the best kind that the level, the other flags and the number of
    /// caches allow.
    fn shadows(&self, caches: usize) -> Shadows {
        match self.shadows {
            _ if self.gi != GiArg::Lightskin => Shadows::Off,
            Some(asked) => asked.kind(),
            None if self.gather.by_clusters() => Shadows::Off,
            // The gather by draws cannot read depth images.
            None if self.gather.by_draws() => self.caches.quality().shadows(caches, Near::Off).min(Shadows::Proxy),
            None => self.caches.quality().shadows(caches, self.near()),
        }
    }

    /// Place of interpolation: as requested, or at vertices if triangles are small enough. For interpolation at pixels,
    /// adds the cells with which pixels look up caches.
    fn look_up(&self, scene: &Scene, baked: &mut Baked, at_vertices: bool) -> Result<InterpArg> {
        let with_cells =
            |caches: CacheSet| caches.with_cells(scene).with_context(|| called(scene, self.scene.as_deref()));
        match self.interp {
            Some(InterpArg::Vertex) => return Ok(InterpArg::Vertex),
            Some(InterpArg::Texel) => baked.caches = with_cells(std::mem::take(&mut baked.caches))?,
            None if at_vertices => return Ok(InterpArg::Vertex),
            None => match with_cells(baked.caches.clone()) {
                Ok(caches) => {
                    log::warn!(
                        "{}: interpolation at vertices would need too many triangles; --interp texel is used instead. \
                         --interp vertex subdivides up to about two million triangles",
                        scene.name
                    );
                    baked.caches = caches;
                }
                Err(error) => {
                    log::warn!("{error:#}: light is interpolated at vertices without subdividing triangles");
                    return Ok(InterpArg::Vertex);
                }
            },
        }
        Ok(InterpArg::Texel)
    }

    /// The settings that affect cost, named like the flags.
    fn facts(
        &self,
        settings: &Settings,
        interp: InterpArg,
        motion: &Motion,
        scene: &Scene,
    ) -> Vec<(&'static str, Value)> {
        let (animation, first) = motion.moment(0);
        let (_, last) = motion.moment(motion.frames().len() - 1);
        let animation = animation.and_then(|index| scene.animations().nth(index)).map(|(name, ..)| name.to_owned());
        // No `..`, so that a new setting must be added to this list.
        let Settings { indirect, rsm, light_shadows, antialiasing, layers, reuse } = *settings;
        let caches = if let Indirect::Caches(caches) = indirect { Some(caches) } else { None };
        let gather = caches.map(|caches| caches.gather);
        let ways = if let Some(Gather::Compute { ways, .. }) = gather { Some(ways) } else { None };
        vec![
            ("size", json!(self.size)),
            ("gi", word(self.gi).into()),
            ("quality", word(self.caches.quality).into()),
            ("bounces", json!(self.bounces())),
            ("caches_wanted", json!(self.caches.spacing.is_none().then(|| self.caches.count()))),
            ("spacing_wanted", json!(self.caches.spacing)),
            ("angle", json!(self.caches.angle)),
            ("max_edge", json!(self.caches.max_edge)),
            ("references", json!(self.caches.settings().references)),
            ("rsm", json!(rsm)),
            ("shadow_map", light_shadows_word(light_shadows).into()),
            ("aa", json!(antialiasing.samples())),
            ("layers", json!(layers)),
            ("gather", json!(gather.map(|gather| gather.name()))),
            ("gather_vals", json!(ways.map(|ways| ways.source.name()))),
            ("gather_caches_per_thread", json!(ways.map(|ways| ways.caches_per_thread))),
            ("gather_split", json!(ways.map(|ways| ways.split))),
            ("cluster", json!(self.gather.cluster.cluster)),
            ("cluster_error", json!(self.gather.cluster.cluster_error)),
            ("cull", json!(caches.is_some_and(|caches| caches.cull))),
            ("near_rays", json!(gather.map(|gather| gather.near().rays().0))),
            ("near_every", json!(gather.map(|gather| gather.near().rays().1))),
            ("shadows", json!(ShadowsArg::of(gather.map_or(Shadows::Off, |gather| gather.shadows())))),
            ("skip", json!(reuse)),
            ("first_time", json!(animation.is_some().then_some(first))),
            ("last_time", json!(animation.is_some().then_some(last))),
            ("animation", json!(animation)),
            ("interp", word(interp).into()),
            ("interpolation", word(self.interpolation).into()),
            ("proxy_weight", word(self.proxy_weight).into()),
            ("tonemap", word(self.tonemap).into()),
            ("ev", json!(self.ev)),
            ("validation", word(self.device.validation).into()),
            ("check", json!(self.check)),
        ]
    }
}

pub(super) fn run(args: &Render) -> Result<()> {
    let Some(file) = args.scene.as_deref().filter(|scene| is_session(scene)) else { return render(args, None) };
    let read = || -> Result<(Command, Session)> {
        let session = Session::read(file)?;
        let (grammar, scene) = session.grammar(&arguments()).context("correct this, or save the session again")?;
        let mut command = parse(grammar, arguments())?.command;
        if let Command::Render(args) = &mut command {
            args.scene = scene;
        }
        Ok((command, session))
    };
    match read().with_context(|| file.display().to_string())? {
        (Command::Render(args), session) => render(&args, Some(&session)),
        _ => bail!("the session has flags of another command; save it again"),
    }
}

/// Renders a scene, with the edits of a session.
fn render(args: &Render, session: Option<&Session>) -> Result<()> {
    args.gather.check(args.shadows(0));
    match args.gi {
        GiArg::Lightskin if args.bounces() > 16 => wrong_usage("--bounces: caches support 16 at most"),
        GiArg::Lightskin if args.bounces() > 1 => args.gather.check_bounces(),
        GiArg::BruteForce if args.bounces() > 1 => wrong_usage("--gi brute-force has one bounce: use --bounces 0 or 1"),
        _ => {}
    }
    if args.gi == GiArg::PathTrace && (!args.timings.is_empty() || args.trace.is_some()) {
        wrong_usage("--timings and --trace record the stages of a frame; --gi path-trace has no stages");
    }
    let first_picture = args.motion.check(&args.out, args.repeat, args.gi == GiArg::PathTrace);
    // Check that all outputs can be written before the long work begins.
    for path in [&first_picture].into_iter().chain(&args.timings).chain(&args.trace) {
        check_writable(path)?;
    }
    let start = Instant::now();
    let mut trace = Trace::default();
    let mut scene = load_under(args.scene.as_deref(), args.sky.sky()?, args.caches.ground)?;
    args.sky.put_behind(&mut scene)?;
    args.sky.size_lights(&mut scene);
    let mut lights = session.map(|session| session.change(&mut scene));
    let at_vertices = match (args.gi, args.interp) {
        // The path tracer does not interpolate, so it needs no small triangles.
        (GiArg::PathTrace, _) => false,
        // Interpolation at pixels needs no small triangles. But the albedos of caches, which further bounces use, are
        // averaged from the triangles of the vertices.
        (GiArg::Lightskin, Some(InterpArg::Texel))
            if args.bounces.is_none_or(|n| n <= 1) && args.caches.max_edge.is_none() =>
        {
            false
        }
        (_, asked) => divide_for(&mut scene, &args.caches, asked == Some(InterpArg::Vertex)),
    };
    let motion = args.motion.motion(&scene, args.repeat)?;
    let mut seen_from = camera(&scene, args.camera.as_deref())?;
    let loaded = start.elapsed();
    trace.lap("load");
    if args.gi == GiArg::PathTrace {
        if motion.pose(&mut scene, 0) {
            lights.iter_mut().for_each(|lights| lights.follow(&mut scene));
        }
        let (scene, camera) = (scene.frozen(), camera(&scene, args.camera.as_deref())?);
        let picture = path_trace::Picture {
            out: &first_picture,
            size: args.size,
            bounces: args.bounces,
            of_engine: args.bounces(),
            spread: args.antialiasing() != Antialiasing::Off,
            layer: args.layer,
            tonemap: args.tonemap,
            ev: args.ev,
            behind: args.sky.behind(),
        };
        return path_trace::run(&args.path_trace, &scene, &camera, &picture);
    }
    // Caches also carry the direct light of the sky and of small and curved emissive surfaces.
    let mut baked = (args.gi == GiArg::Lightskin && (args.bounces() > 0 || scene.emits() || scene.sky.is_some()))
        .then(|| bake_scene(&scene, args.scene.as_deref(), &args.caches.settings(), args.bake_again))
        .transpose()?;
    let interp = match &mut baked {
        Some(baked) => args.look_up(&scene, baked, at_vertices)?,
        None => args.interp.unwrap_or_default(),
    };
    trace.lap("bake");
    let gpu = args.device.open()?;
    let count = baked.as_ref().map_or(0, |b| b.count);
    let settings = args.settings(&gpu, count, motion.reuse)?;
    if args.shadows.is_none() && args.shadows(count) < args.shadows(0) {
        log::info!("{count} caches: --shadows {} by default", ShadowsArg::of(args.shadows(count)));
    }
    if args.trace.is_some() {
        gpu.time_shaders();
    }
    trace.lap("open device");
    let mut world = World::new(&gpu, &scene, baked.as_ref().map(|b| &b.caches))?;
    trace.lap("upload");
    let mut light = Light::new(&gpu, &scene, &world, &settings, 1)?;
    let mut picture = Picture::new(&gpu, &world, &light, args.size)?;
    let look = args.look();
    let check = args.check.then(|| Check::new(&gpu)).transpose()?;
    trace.lap("pipelines and targets");

    let (mut runs, mut problems, mut broken, mut skipped) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut broken_in_pictures = 0;
    let vals = light.vals().map_or(0, |vals| vals.count);
    let about = format!(
        "scene {}; camera {}; device {}; {} caches; {vals} VALs",
        scene.name,
        seen_from.name,
        gpu.report().name,
        baked.as_ref().map_or(0, |baked| baked.count)
    );
    let writing = Writing { layer: args.layer, tonemap: args.tonemap, behind: look.behind };
    let view_of = |camera: &Camera, world: &World| View::new(camera, args.size, world.origin, world.radius);
    let mut view = view_of(&seen_from, &world);
    // Drivers defer work to the first frame, such as compiling shaders. It is drawn separately and not counted.
    let mut first_ms = None;
    if !settings.reuse {
        let drawn = gpu.timed_frame(|cmd| {
            record(cmd, &world, &mut light, &mut [(view, &mut picture)], &look);
            Ok(())
        })?;
        first_ms = Some(gpu.times(&drawn)?.cpu_span_ms());
        problems.extend(drawn.problems);
        trace.lap("first frame");
    }
    let bar = progress_bar("{msg:>12} [{bar:40}] {percent:>3} %  {elapsed}");
    let frames = motion.frames();
    let count = frames.len();
    for (index, number) in frames {
        if motion.pose(&mut scene, index) {
            lights.iter_mut().for_each(|lights| lights.follow(&mut scene));
            seen_from = camera(&scene, args.camera.as_deref())?;
            world.update(&gpu, &scene)?;
            light.fit(&gpu, &scene, &world, &settings, 1)?;
            picture.fit(&gpu, &world, &light, args.size)?;
            view = view_of(&seen_from, &world);
        }
        // On software drivers each stage is submitted separately, because they attribute the times of chained passes
        // wrongly.
        let drawn = gpu.timed_frame(|cmd| {
            record(cmd, &world, &mut light, &mut [(view, &mut picture)], &look);
            Ok(())
        })?;
        problems.extend(drawn.problems);
        if let Some(check) = &check {
            broken.extend(check.count(&gpu, &light, &picture)?);
        }
        runs.extend(gpu.finished_times()?);
        skipped.extend(light.skipped());
        if motion.pictures {
            let out = numbered(&args.out, number);
            let about = format!("{about}; frame {number}, {} s", motion.moment(index).1);
            broken_in_pictures += writing.write(&gpu, &picture, &view, &about, &out)?;
        }
        if count > 1 {
            bar.set_message(format!("frame {number}"));
            bar.set_position(1000 * (index as u64 + 1) / count as u64);
        }
    }
    bar.finish_and_clear();
    gpu.wait()?;
    runs.extend(gpu.finished_times()?);
    trace.lap("frames");
    trace.frames(&runs);
    let report = Report {
        scene: &scene,
        camera: &seen_from,
        baked: baked.as_ref(),
        gpu: &gpu,
        light: &light,
        counts: light.counts(&gpu)?,
        first_ms,
        settings: args.facts(&settings, interp, &motion, &scene),
        runs: &runs,
    };
    let ev = exposure_value(&gpu, &picture)?;
    if !motion.pictures {
        broken_in_pictures += writing.write(&gpu, &picture, &view, &about, &first_picture)?;
    }
    trace.lap("picture");
    for path in &args.timings {
        report.write_timings(path)?;
    }
    if let Some(path) = &args.trace {
        report.write_trace(path, &trace)?;
    }
    report.print(loaded, ev);
    say_skipped(&skipped, count);
    match (motion.pictures, motion.frames().next(), motion.frames().last()) {
        (true, Some((_, first)), Some((_, last))) if first < last => {
            say!("pictures  {} to {}", numbered(&args.out, first).display(), numbered(&args.out, last).display());
        }
        _ => say!("picture   {}", first_picture.display()),
    }
    check_messages(&gpu, &problems)?;
    report_broken(&broken)?;
    if broken_in_pictures > 0 {
        bail!("{broken_in_pictures} values of the picture are negative or not finite; this is a bug of lightskin");
    }
    Ok(())
}

/// Prints how many frames have skipped each stage.
fn say_skipped(skipped: &[&'static str], frames: usize) {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for name in skipped {
        match counts.iter_mut().find(|(known, _)| known == name) {
            Some((_, count)) => *count += 1,
            None => counts.push((name, 1)),
        }
    }
    if !counts.is_empty() {
        let all: Vec<String> = counts.iter().map(|(name, count)| format!("{name} {count}")).collect();
        say!("skipped   {} of {frames} frames, because their inputs had not changed", all.join(", "));
    }
}

/// Prints the broken values that `--check` has found in all frames, by target. Fails if there are any.
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
