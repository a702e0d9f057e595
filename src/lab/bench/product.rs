//! Cost of what `render` and the window draw: each quality level, and each choice that a level makes.

use super::contexts::Contexts;
use super::extent::Shown;
use super::measure::Budget;
use super::table::{Cell, Table};
use crate::error::Result;
use crate::frame::engine::Loaded;
use crate::frame::settings::{Caches, Gather};
use crate::frame::{
    Antialiasing, Indirect, Light, LightShadows, Look, Near, Picture, Settings, Shadows, View, World, record,
};
use crate::gpu::{FrameTimes, Gpu};
use crate::lab::eval::measure::medians;
use crate::lab::plot::short;
use crate::scene::build::{self, Fineness};
use crate::scene::medium::Subsurface;
use crate::scene::{Camera, Scene};
use glam::DAffine3;

/// Stages with a column of their own; the others are summed.
const STAGES: [&str; 10] = [
    "gbuffer",
    "edges",
    "direct",
    "rsm",
    "depth images",
    "gather",
    "near rays",
    "interpolate",
    "mix edges",
    "composite",
];

/// Angle by which the camera turns from one frame to the next \[rad\].
const TURN: f64 = 0.002;

/// Choices drawn in turn with the level.
const TOGETHER: usize = 3;

/// A flag of `render`, and what it changes.
type Choice = (&'static str, fn(&mut Settings));

/// One choice at a time, most important first.
const CHOICES: [Choice; 12] = [
    ("--aa off", |settings| settings.antialiasing = Antialiasing::Off),
    ("--aa fast", |settings| settings.antialiasing = Antialiasing::Fast),
    ("--aa 4", |settings| settings.antialiasing = Antialiasing::Four),
    ("--aa 8", |settings| settings.antialiasing = Antialiasing::Eight),
    ("--bounces 1", |settings| *of_gather(settings).0 = 1),
    ("--bounces 8", |settings| *of_gather(settings).0 = 8),
    ("--near off", |settings| *of_gather(settings).2 = Near::Off),
    ("--near endless", |settings| *of_gather(settings).2 = Near::Endless { per_pixel: 8, every: 0 }),
    ("--shadows proxy", |settings| *of_gather(settings).1 = Shadows::Proxy),
    ("--shadows off", |settings| *of_gather(settings).1 = Shadows::Off),
    ("--shadow-map 2048", |settings| settings.light_shadows = LightShadows::Maps(2048)),
    ("--rsm 64", |settings| settings.rsm = 64),
];

/// Bounces, shadows and short rays of the compute gather.
fn of_gather(settings: &mut Settings) -> (&mut u32, &mut Shadows, &mut Near) {
    match &mut settings.indirect {
        Indirect::Caches(Caches { gather: Gather::Compute { bounces, shadows, near, .. }, .. }) => {
            (bounces, shadows, near)
        }
        _ => unreachable!("every level gathers by compute"),
    }
}

/// Median times \[ms\] of one kind of frame.
struct Drawn {
    /// By stage, of frames in which everything is computed.
    stages: Vec<(String, f64)>,
    /// Of frames in which only the camera has moved.
    camera: f64,
    /// Device memory \[bytes\] that light and picture take.
    bytes: u64,
    vals: usize,
    /// Short rays of one frame.
    rays: f64,
}

impl Drawn {
    fn frame(&self) -> f64 {
        self.stages.iter().map(|stage| stage.1).sum()
    }

    fn stage(&self, name: &str) -> Option<f64> {
        self.stages.iter().find(|stage| stage.0 == name).map(|stage| stage.1)
    }
}

impl Contexts<'_> {
    /// The tables of levels, choices and a translucent body.
    ///
    /// # Errors
    /// As `Contexts::views`.
    pub fn product(&mut self) -> Result<[Table; 3]> {
        let [w, h] = self.extent.size;
        let name = match self.extent.shown {
            Shown::Showpiece => "built-in showpiece",
            Shown::Atrium => "built-in atrium",
        };
        let frames = format!(
            "{w}x{h} pixels, prepared as `lightskin render` does. \"frame\": everything is computed. \"camera\": only the \
             camera has moved, as in a window; what does not depend on it is kept. GPU time, median of {} frames after {} that do \
             not count.",
            self.extent.shown_frames, self.extent.warm_up
        );
        let columns: Vec<String> = ["quality", "caches", "VALs", "frame [ms]", "camera [ms]"]
            .map(str::to_owned)
            .into_iter()
            .chain(STAGES.map(|stage| format!("{stage} [ms]")))
            .chain(["others [ms]", "short rays [M/s]", "memory [MiB]"].map(str::to_owned))
            .collect();
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        let how = format!(
            "The {name}, as a window draws it at each level. {frames} \"short rays\" per second of their stage, which also lights what \
             they hit, at most: guided rays below the horizon count, rays in glossy lobes do not. \"memory\" without the scene."
        );
        let mut levels = Table::new("levels", "Quality levels", how, &columns);
        let how = format!(
            "The {name}. {frames} One flag differs from `--quality {}`. \"over\": relative to its frames without the flag, drawn in turn.",
            self.extent.level.name()
        );
        let columns = ["flag", "frame [ms]", "over", "camera [ms]", "over (camera)", "memory [MiB]"];
        let mut choices = Table::new("choices", "Choices", how, &columns);
        let how = format!(
            "The statue of the showpiece alone at `--quality {}`, as stone and filled with marble. {frames} Light inside it is carried by its caches \
             (stages 9 and 10). Thesis: table 6.3, both lobes with and without subsurface scattering, 1000 caches, 65 536 VALs.",
            self.extent.level.name()
        );
        let columns = [
            "body",
            "caches",
            "frame [ms]",
            "over",
            "camera [ms]",
            "dipole gather [ms]",
            "scatter [ms]",
            "thesis [ms]",
        ];
        let mut subsurface = Table::new("subsurface", "Subsurface scattering", how, &columns);

        let mut budget = Budget::new(3.0 * self.extent.budget);
        for level in self.extent.levels.clone() {
            (self.progress)(0.0, &format!("--quality {}", level.name()));
            if let Err(reason) = budget.begin(level.caches() as f64) {
                levels.skipped.push(format!("--quality {}: {reason}.", level.name()));
                continue;
            }
            let prepared = Loaded::of(self.shown(), level, &|_, _| ())?;
            let world = World::new(self.gpu, &prepared.scene, prepared.caches.as_ref())?;
            let settings = prepared.settings(level).with_ways(self.tuned.ways);
            let drawn = self.frames_of(&prepared.scene, &world, &[settings])?.remove(0);
            let mut row: Vec<Cell> = vec![level.name().into(), (world.cache_count as usize).into(), drawn.vals.into()];
            row.extend([drawn.frame(), drawn.camera].map(Cell::from));
            let of_stages = STAGES.map(|stage| drawn.stage(stage));
            row.extend(of_stages.map(Cell::from));
            row.push((drawn.frame() - of_stages.iter().flatten().sum::<f64>()).into());
            let rate = drawn.stage("near rays").map(|ms| drawn.rays / (1e3 * ms));
            row.extend([Cell::from(rate), mib(drawn.bytes).into()]);
            levels.push(row);
        }
        self.subsurface(&mut subsurface, &mut budget)?;
        self.choices(&mut choices, &mut budget)?;
        Ok([levels, choices, subsurface])
    }

    fn choices(&mut self, table: &mut Table, budget: &mut Budget) -> Result<()> {
        let level = self.extent.level;
        let made = Loaded::of(self.shown(), level, &|_, _| ())?;
        let world = World::new(self.gpu, &made.scene, made.caches.as_ref())?;
        let usual = made.settings(level).with_ways(self.tuned.ways);
        let changed = |change: fn(&mut Settings)| {
            let mut settings = usual;
            change(&mut settings);
            settings
        };
        let all: Vec<(&str, Settings)> = CHOICES.iter().map(|(flag, change)| (*flag, changed(*change))).collect();
        let all: Vec<_> = all.iter().filter(|(_, settings)| *settings != usual).take(self.extent.choices).collect();
        for (number, together) in all.chunks(TOGETHER).enumerate() {
            let flags: Vec<&str> = together.iter().map(|(flag, _)| *flag).collect();
            let flags = flags.join(", ");
            (self.progress)(0.4 + 0.6 * (TOGETHER * number) as f32 / all.len() as f32, &flags);
            if let Err(reason) = budget.begin(1.0) {
                table.skipped.push(format!("{flags}: {reason}."));
                continue;
            }
            let settings: Vec<Settings> =
                [usual].into_iter().chain(together.iter().map(|(_, settings)| *settings)).collect();
            let mut drawn = self.frames_of(&made.scene, &world, &settings)?;
            let usual = drawn.remove(0);
            for ((flag, _), drawn) in together.iter().zip(drawn) {
                let mut row: Vec<Cell> = vec![(*flag).into()];
                row.extend([drawn.frame(), drawn.frame() / usual.frame()].map(Cell::from));
                row.extend([drawn.camera, drawn.camera / usual.camera, mib(drawn.bytes)].map(Cell::from));
                table.push(row);
            }
        }
        Ok(())
    }

    fn subsurface(&mut self, table: &mut Table, budget: &mut Budget) -> Result<()> {
        (self.progress)(0.3, "translucent statue");
        if let Err(reason) = budget.begin(2.0) {
            table.skipped.push(format!("the statue: {reason}."));
            return Ok(());
        }
        let thesis =
            ["DG_65536", "SSS_65536"].map(|column| super::thesis::frame_ms(super::thesis::CACHES, &[1000], column));
        let mut statue = build::showpiece(Fineness { texels: 64, cell: self.extent.cell });
        statue.instances.retain(|instance| instance.name == "statue");
        statue.cameras.clear();
        let mut stone = None;
        for (body, thesis) in ["stone", "marble"].into_iter().zip(thesis) {
            let mut scene = statue.clone();
            if body == "marble" {
                let marble = Subsurface::preset("marble").expect("a known medium");
                scene.materials.iter_mut().for_each(|material| material.fill(marble));
            }
            let prepared = Loaded::of(scene, self.extent.level, &|_, _| ())?;
            let world = World::new(self.gpu, &prepared.scene, prepared.caches.as_ref())?;
            let settings = prepared.settings(self.extent.level).with_ways(self.tuned.ways);
            let drawn = self.frames_of(&prepared.scene, &world, &[settings])?.remove(0);
            let unit = *stone.get_or_insert(drawn.frame());
            let mut row: Vec<Cell> = vec![body.into(), (world.cache_count as usize).into()];
            row.extend([drawn.frame(), drawn.frame() / unit, drawn.camera].map(Cell::from));
            row.extend([drawn.stage("dipole gather"), drawn.stage("scatter"), thesis].map(Cell::from));
            table.push(row);
        }
        Ok(())
    }

    /// The scene that is drawn.
    fn shown(&self) -> Scene {
        match self.extent.shown {
            Shown::Showpiece => build::showpiece(Fineness { cell: self.extent.cell, ..Fineness::default() }),
            Shown::Atrium => build::atrium(),
        }
    }

    /// Frames of these settings, drawn in turn; first with everything computed, then with only the camera moved.
    fn frames_of(&mut self, scene: &Scene, world: &World, all: &[Settings]) -> Result<Vec<Drawn>> {
        let (gpu, extent) = (self.gpu, self.extent);
        let mut drawn: Vec<Drawn> = Vec::new();
        for reuse in [false, true] {
            let mut frames = Vec::new();
            for settings in all {
                let before = bytes(gpu);
                let light = Light::new(gpu, scene, world, &Settings { reuse, ..*settings }, 1)?;
                let picture = Picture::new(gpu, world, &light, extent.size)?;
                frames.push((light, picture, Vec::<FrameTimes>::new(), bytes(gpu) - before));
            }
            // The first frame after a change of settings computes everything.
            let warm_up = extent.warm_up.max(usize::from(reuse));
            for i in 0..warm_up + extent.shown_frames {
                let camera = &scene.cameras[0];
                let turned = camera.world_from_camera * DAffine3::from_rotation_y(TURN * i as f64);
                let camera = Camera { world_from_camera: turned, ..camera.clone() };
                let view = View::new(&camera, extent.size, world.origin, world.radius);
                for (light, picture, runs, _) in &mut frames {
                    // Software drivers attribute chained passes wrongly: submit each stage alone there.
                    let frame = gpu.timed_frame(|cmd| {
                        record(cmd, world, light, &mut [(view, picture)], &Look::default());
                        Ok(())
                    })?;
                    let times = gpu.times(&frame)?;
                    self.problems.extend(frame.problems);
                    if i >= warm_up {
                        runs.push(times);
                    }
                }
            }
            for (index, (light, picture, runs, bytes)) in frames.iter().enumerate() {
                let stages = medians(runs);
                if reuse {
                    drawn[index].camera = stages.iter().map(|stage| stage.1).sum();
                    continue;
                }
                let vals = light.counts(gpu)?.vals as usize;
                let rays = rays(gpu, light, picture)?;
                drawn.push(Drawn { stages, camera: 0.0, bytes: *bytes, vals, rays });
            }
        }
        Ok(drawn)
    }
}

/// Number of short rays about normals, and of guided ones.
fn rays(gpu: &Gpu, light: &Light, picture: &Picture) -> Result<f64> {
    let near = light.plan.near;
    if near == Near::Off {
        return Ok(0.0);
    }
    let per_pixel = near.per_pixel();
    let [width, height] = picture.size();
    let every = near.every([width, height]) as usize;
    let depth: Vec<f32> = gpu.read_image(&picture.surface.depth)?;
    let shown = |x: usize, y: usize| depth[y * width as usize + x] > 0.0;
    let rows = (0..height as usize).step_by(every);
    let traced =
        rows.flat_map(|y| (0..width as usize).step_by(every).map(move |x| (x, y))).filter(|(x, y)| shown(*x, *y));
    Ok(traced.count() as f64 * f64::from(per_pixel + per_pixel.div_ceil(4)))
}

/// Device memory of light and pictures \[bytes\]; not of what belongs to the scene.
fn bytes(gpu: &Gpu) -> u64 {
    let of_scene = |name: &str| ["scene.", "rays.", "deform."].iter().any(|start| name.starts_with(start));
    gpu.resources().iter().filter(|resource| !of_scene(&resource.name)).map(|resource| resource.bytes).sum()
}

fn mib(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

/// Summary sentences of the tables.
pub fn headlines(levels: &Table, choices: &Table) -> Vec<String> {
    let mut lines = Vec::new();
    let of = |row: usize, column: &str| levels.number(row, column).map_or("-".into(), short);
    let level = |row: usize| {
        let name = if let Some(Cell::Text(name)) = levels.rows[row].first() { name.clone() } else { String::new() };
        format!("{name} {} ({})", of(row, "frame [ms]"), of(row, "camera [ms]"))
    };
    let all: Vec<String> = (0..levels.rows.len()).map(level).collect();
    if !all.is_empty() {
        lines.push(format!("Frame by quality [ms], and with only the camera moving: {}.", all.join(", ")));
    }
    let over = |flag: &str| {
        (0..choices.rows.len()).find(|row| choices.has(*row, flag)).and_then(|row| choices.number(row, "over"))
    };
    if let (Some(one), Some(eight)) = (over("--bounces 1"), over("--bounces 8")) {
        lines.push(format!("Eight bounces take {} times as long as one.", short(eight / one)));
    }
    lines
}
