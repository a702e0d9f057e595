//! `lightskin render`: renders a scene to a picture or its layers, and prints times and counts.

use super::camera::camera;
use super::drawing::{DrawingArgs, METHOD};
use super::motion::{Motion, MotionArgs, numbered};
use super::path_trace::{self, PathTraceArgs};
use super::picture::{LayerArg, Layers, TonemapArg, Writing, exposure_value};
use super::session::{Session, is_session};
use super::sky::SkyArgs;
use super::supersample::{SAMPLES, Supersampled};
use super::timings::{Report, timings_file, trace_file};
use super::words::{GiArg, InterpArg, ShadowsArg};
use super::{
    Baked, CacheArgs, Command, DeviceArgs, arguments, bake_scene, called, check_messages, divide_for, load_under,
    parse, progress_bar, thousands, word, wrong_usage,
};
use anyhow::{Context, Result, bail};
use lightskin::bake::CacheSet;
use lightskin::files::check_writable;
use lightskin::frame::check::{Broken, Check};
use lightskin::frame::settings::Ways;
use lightskin::frame::{Antialiasing, Exposure, Light, Look, Picture, Settings, View, World, record, tune};
use lightskin::scene::{Camera, Scene};
use lightskin::trace::Trace;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Heading of the help.
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
    #[command(flatten)]
    drawing: DrawingArgs,
    #[command(flatten)]
    caches: CacheArgs,
    /// Place of interpolation between caches [default: vertex, or texel if vertex would need too many triangles].
    #[arg(long, help_heading = METHOD, hide_short_help = true, value_enum)]
    interp: Option<InterpArg>,
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
    /// Tone curve, exposure and background.
    fn look(&self) -> Look {
        Look {
            tonemap: self.tonemap.curve(),
            exposure: self.ev.map_or(Exposure::Automatic, Exposure::Ev),
            behind: self.sky.behind(),
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
        drawn_size: [u32; 2],
    ) -> Vec<(&'static str, Value)> {
        let (animation, first) = motion.moment(0);
        let (_, last) = motion.moment(motion.frames().len() - 1);
        let animation = animation.and_then(|index| scene.animations().nth(index)).map(|(name, ..)| name.to_owned());
        let mut facts = vec![
            ("size", json!(self.size)),
            ("caches_wanted", json!(self.caches.spacing.is_none().then(|| self.caches.count()))),
            ("spacing_wanted", json!(self.caches.spacing)),
            ("angle", json!(self.caches.angle)),
            ("max_edge", json!(self.caches.max_edge)),
            ("references", json!(self.caches.settings().references)),
            ("first_time", json!(animation.is_some().then_some(first))),
            ("last_time", json!(animation.is_some().then_some(last))),
            ("animation", json!(animation)),
            ("interp", word(interp).into()),
            ("tonemap", word(self.tonemap).into()),
            ("ev", json!(self.ev)),
            ("validation", word(self.device.validation).into()),
            ("check", json!(self.check)),
        ];
        facts.extend(self.drawing.facts(self.caches.quality(), settings, drawn_size));
        facts
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
    let level = args.caches.quality();
    let drawing = &args.drawing.clone().for_stills(level);
    drawing.check(level);
    if drawing.gi == GiArg::PathTrace && (!args.timings.is_empty() || args.trace.is_some()) {
        wrong_usage("--timings and --trace record the stages of a frame; --gi path-trace has no stages");
    }
    let first_picture = args.motion.check(&args.out, args.repeat, drawing.gi == GiArg::PathTrace);
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
    let at_vertices = match (drawing.gi, args.interp) {
        // The path tracer does not interpolate, so it needs no small triangles.
        (GiArg::PathTrace, _) => false,
        // Interpolation at pixels needs no small triangles. But the albedos of caches, which further bounces use, are
        // averaged from the triangles of the vertices.
        (GiArg::Lightskin, Some(InterpArg::Texel))
            if drawing.bounces.is_none_or(|n| n <= 1) && args.caches.max_edge.is_none() =>
        {
            false
        }
        (_, asked) => divide_for(&mut scene, &args.caches, asked == Some(InterpArg::Vertex)),
    };
    let motion = args.motion.motion(&scene, args.repeat)?;
    let mut seen_from = camera(&scene, args.camera.as_deref())?;
    let loaded = start.elapsed();
    trace.lap("load");
    if drawing.gi == GiArg::PathTrace {
        if motion.pose(&mut scene, 0) {
            lights.iter_mut().for_each(|lights| lights.follow(&mut scene));
        }
        let (scene, camera) = (scene.frozen(), camera(&scene, args.camera.as_deref())?);
        let picture = path_trace::Picture {
            out: &first_picture,
            size: args.size,
            bounces: drawing.bounces,
            of_engine: drawing.bounces(level),
            spread: drawing.antialiasing(level) != Antialiasing::Off,
            layer: args.layer,
            tonemap: args.tonemap,
            ev: args.ev,
            behind: args.sky.behind(),
        };
        return path_trace::run(&args.path_trace, &scene, &camera, &picture);
    }
    // Caches also carry the direct light of the sky and of emissive surfaces that are no lamps.
    let mut baked = (drawing.gi == GiArg::Lightskin
        && (drawing.bounces(level) > 0 || scene.emits() || scene.sky.is_some()))
    .then(|| bake_scene(&scene, args.scene.as_deref(), &args.caches.settings(), args.bake_again))
    .transpose()?;
    let interp = match &mut baked {
        Some(baked) => args.look_up(&scene, baked, at_vertices)?,
        None => args.interp.unwrap_or_default(),
    };
    trace.lap("bake");
    let gpu = args.device.open()?;
    let count = baked.as_ref().map_or(0, |b| b.count);
    let ways = if baked.is_some() && drawing.needs_ways() { tune::fastest(&gpu)?.ways } else { Ways::default() };
    let settings = drawing.settings(level, count, ways);
    let is_mean = settings.antialiasing == Antialiasing::Supersampled;
    // From sample to sample only the view changes.
    let settings = Settings { reuse: motion.reuse || (is_mean && !args.motion.no_skip), ..settings };
    let (samples, drawn_size) = if is_mean { (SAMPLES, View::size_of_samples(args.size)) } else { (1, args.size) };
    let shadows = drawing.shadows(level, count);
    if drawing.shadows.is_none() && shadows < drawing.shadows(level, 0) {
        log::info!("{count} caches: --shadows {} by default", ShadowsArg::of(shadows));
    }
    if args.trace.is_some() {
        gpu.time_shaders();
    }
    trace.lap("open device");
    let mut world = World::new(&gpu, &scene, baked.as_ref().map(|b| &b.caches))?;
    trace.lap("upload");
    let mut light = Light::new(&gpu, &scene, &world, &settings, 1)?;
    let mut picture = Picture::new(&gpu, &world, &light, drawn_size)?;
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
    // Writes a picture, or the mean of many. Returns its exposure value and the number of broken values.
    let write = |picture: &Picture, view: &View, mean: Option<&Layers>, about: &str, out: &Path| -> Result<_> {
        let Some(layers) = mean else {
            return Ok((exposure_value(&gpu, picture)?, writing.write(&gpu, picture, view, about, out)?));
        };
        let ev = args.ev.unwrap_or_else(|| layers.automatic_ev() as f32);
        Ok((ev, writing.write_layers(layers, ev, about, out)?))
    };
    let (mut mean, mut ev) = (None, 0.0);
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
            picture.fit(&gpu, &world, &light, drawn_size)?;
            view = view_of(&seen_from, &world);
        }
        let mut sum = Supersampled::new(args.size);
        for sample in 0..samples {
            let (shown, shift) = if is_mean { view.sample(sample, args.size) } else { (view, [0; 2]) };
            // On software drivers each stage is submitted separately, because they attribute the times of chained passes
            // wrongly.
            let drawn = gpu.timed_frame(|cmd| {
                record(cmd, &world, &mut light, &mut [(shown, &mut picture)], &look);
                Ok(())
            })?;
            problems.extend(drawn.problems);
            if let Some(check) = &check {
                broken.extend(check.count(&gpu, &light, &picture)?);
            }
            runs.extend(gpu.finished_times()?);
            skipped.extend(light.skipped());
            if is_mean {
                sum.add(&gpu, &picture, &shown, shift)?;
                bar.set_message(format!("{number}: {} of {samples}", sample + 1));
            }
            if count * samples as usize > 1 {
                let done = index as u64 * u64::from(samples) + u64::from(sample) + 1;
                bar.set_position(1000 * done / (count as u64 * u64::from(samples)));
            }
        }
        mean = is_mean.then(|| sum.mean());
        if motion.pictures {
            let out = numbered(&args.out, number);
            let about = format!("{about}; frame {number}, {} s", motion.moment(index).1);
            let (exposed, found) = write(&picture, &view, mean.as_ref(), &about, &out)?;
            (ev, broken_in_pictures) = (exposed, broken_in_pictures + found);
        }
        if count > 1 && !is_mean {
            bar.set_message(format!("frame {number}"));
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
        settings: args.facts(&settings, interp, &motion, &scene, drawn_size),
        runs: &runs,
    };
    if !motion.pictures {
        let (exposed, found) = write(&picture, &view, mean.as_ref(), &about, &first_picture)?;
        (ev, broken_in_pictures) = (exposed, broken_in_pictures + found);
    }
    trace.lap("picture");
    for path in &args.timings {
        report.write_timings(path)?;
    }
    if let Some(path) = &args.trace {
        report.write_trace(path, &trace)?;
    }
    report.print(loaded, ev);
    say_skipped(&skipped, count * samples as usize);
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
