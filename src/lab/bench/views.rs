//! Cost of a second view: frames of two eyes against frames of one.

use super::contexts::Contexts;
use super::measure::{Budget, bake, settings};
use super::table::{Cell, Table};
use crate::error::Result;
use crate::frame::{Light, Picture, View, World, record};
use crate::gpu::FrameTimes;
use crate::lab::eval::measure::medians;
use crate::lab::knobs::{Gi, Knobs};
use crate::lab::scenes::valley;
use crate::scene::Scene;

/// RSM side \[texels\].
const RSM: u32 = 128;

/// Caches requested.
const CACHES: usize = 1000;

/// Distance between the eyes \[m\].
const EYES: f64 = 0.064;

/// Frames with a given number of views.
struct Drawn {
    light: Light,
    pictures: Vec<(View, Picture)>,
    runs: Vec<FrameTimes>,
}

impl Contexts<'_> {
    /// The table of the cost of a second view.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn views(&mut self) -> Result<Table> {
        let columns =
            ["lobes", "caches", "VALs", "views", "frame [ms]", "gather [ms]", "frame / one view", "gather / one view"];
        let [w, h] = self.extent.size;
        let how = format!(
            "Frames of one view and of two views {EYES} m apart, in turn: {w}x{h} pixels each, {RSM}x{RSM} VALs, every cache lit. \
             VALs and the caches' diffuse lobe are computed once for both eyes, the glossy lobe for each eye in the same pass. \
             Medians of {} frames after {} warm-up frames; of several pipelines the one with the median time of two views.",
            self.extent.frames, self.extent.warm_up
        );
        let mut table = Table::new("views", "Two views", how, &columns);
        let mut budget = Budget::new(self.extent.budget);
        for (glossy, lobes) in [(false, "D"), (true, "DG")] {
            (self.progress)(0.0, &format!("two views, {lobes}"));
            if let Err(reason) = budget.begin(1.0) {
                table.skipped.push(format!("{lobes}: {reason}."));
                continue;
            }
            let scene = valley(self.extent.ground, glossy);
            let set = bake(&scene, CACHES, 8)?.0;
            let world = World::new(self.gpu, &scene, Some(&set))?;
            let knobs = Knobs { cull: false, ..settings(self.extent.size, Gi::LightSkin, RSM, self.tuned.ways) };
            let mut rounds = Vec::new();
            for _ in 0..self.extent.pipelines {
                self.gpu.forget_pipelines();
                rounds.push(self.one_and_two(&scene, &world, &knobs)?);
            }
            let gather = |stages: &[(String, f64)]| stages.iter().find(|s| s.0 == "gather").map_or(0.0, |s| s.1);
            let frame = |stages: &[(String, f64)]| stages.iter().map(|s| s.1).sum::<f64>();
            rounds.sort_by(|a, b| gather(&a.stages[1]).total_cmp(&gather(&b.stages[1])));
            let middle = rounds.swap_remove(rounds.len() / 2);
            let [one, two] = &middle.stages;
            for (views, stages) in [(1_usize, one), (2, two)] {
                let mut row: Vec<Cell> = vec![lobes.into(), middle.caches.into(), middle.vals.into(), views.into()];
                row.extend([frame(stages), gather(stages)].map(Cell::from));
                row.extend([frame(stages) / frame(one), gather(stages) / gather(one)].map(Cell::from));
                table.push(row);
            }
        }
        Ok(table)
    }

    fn one_and_two(&mut self, scene: &Scene, world: &World, knobs: &Knobs) -> Result<OneAndTwo> {
        let gpu = self.gpu;
        let made = |views: usize| -> Result<Drawn> {
            let light = Light::new(gpu, scene, world, &knobs.settings(), views)?;
            let picture = |i: usize| -> Result<(View, Picture)> {
                let mut camera = scene.cameras[0].clone();
                let pose = &mut camera.world_from_camera;
                pose.translation += pose.matrix3.x_axis.normalize() * (EYES * i as f64);
                let view = View::new(&camera, knobs.size, world.origin, world.radius);
                Ok((view, Picture::new(gpu, world, &light, knobs.size)?))
            };
            let pictures = (0..views).map(picture).collect::<Result<_>>()?;
            Ok(Drawn { light, pictures, runs: Vec::new() })
        };
        let mut both = [made(1)?, made(2)?];
        for i in 0..self.extent.warm_up + self.extent.frames {
            for Drawn { light, pictures, runs } in &mut both {
                let mut views: Vec<_> = pictures.iter_mut().map(|(view, picture)| (*view, picture)).collect();
                let drawn = gpu.timed_frame(|cmd| {
                    record(cmd, world, light, &mut views, &knobs.look());
                    Ok(())
                })?;
                let times = gpu.times(&drawn)?;
                self.problems.extend(drawn.problems);
                if i >= self.extent.warm_up {
                    runs.push(times);
                }
            }
        }
        Ok(OneAndTwo {
            caches: world.cache_count as usize,
            vals: both[0].light.counts(gpu)?.vals as usize,
            stages: both.map(|drawn| medians(&drawn.runs)),
        })
    }
}

/// Stages with their times \[ms\] for one view and for two.
struct OneAndTwo {
    caches: usize,
    vals: usize,
    stages: [Vec<(String, f64)>; 2],
}

/// Summary sentences for the table.
pub fn headlines(table: &Table) -> Vec<String> {
    let line = |row: usize| {
        let of = |column: &str| table.number(row, column).unwrap_or(0.0);
        let lobes = if table.has(row, "DG") { "both lobes" } else { "the diffuse lobe" };
        format!(
            "With {lobes}, a frame of two views takes {:.2} times as long as a frame of one, its gather {:.2} times.",
            of("frame / one view"),
            of("gather / one view")
        )
    };
    (0..table.rows.len()).filter(|row| table.number(*row, "views") == Some(2.0)).map(line).collect()
}
