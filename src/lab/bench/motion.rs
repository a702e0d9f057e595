//! Cost of motion: frames of a moving scene against frames of the same moments standing still.

use super::contexts::Contexts;
use super::measure::{Budget, bake, settings};
use super::table::{Cell, Table};
use crate::error::Result;
use crate::frame::{View, World};
use crate::gpu::FrameTimes;
use crate::lab::knobs::{Frame, Gi, Knobs};
use crate::lab::scenes::{crowd, moving};
use crate::scene::Scene;
use std::time::Instant;

/// RSM side \[texels\].
const RSM: u32 = 128;

/// Sampled moments of the animation.
const MOMENTS: usize = 15;

/// No further round through the animation starts after this time \[s\].
const LONG_ENOUGH: f64 = 8.0;

/// Longest side \[m\] of the grid cells of the room's walls.
const EDGE: f32 = 0.1;

/// Caches of the room, and of each tube of the crowd.
const CACHES: [usize; 2] = [500, 40];

/// Times \[ms\] at one moment.
struct Moment {
    /// CPU time of the animation and its consequences, up to the frame.
    host: f64,
    /// GPU time of the frame that shows the new poses.
    moving: f64,
    /// Of this, copies and posing.
    update: f64,
    deform: f64,
    /// The same frame again without motion, with all stages computed.
    standing: f64,
    /// The same, with unchanged stages skipped.
    skipped: f64,
}

impl Contexts<'_> {
    /// The table of the cost of motion.
    ///
    /// # Errors
    /// Fails if the device runs out of memory, lacks a feature, or is lost.
    pub fn motion(&mut self) -> Result<Table> {
        let [w, h] = self.extent.size;
        let columns = [
            "scene",
            "instances",
            "bend",
            "vertices posed",
            "caches",
            "standing [ms]",
            "moving [ms]",
            "update [ms]",
            "deform [ms]",
            "CPU pose and update [ms]",
            "moving / standing",
            "with the CPU's part",
            "standing and skipped [ms]",
        ];
        let how = format!(
            "Frames of {w}x{h} pixels, both lobes, {RSM}x{RSM} VALs, no shadows of indirect light. At each moment of the animation \
             three frames are timed: right after the motion, standing still with unchanged stages skipped, and standing still \
             with all stages computed. Medians over {MOMENTS} moments, repeated up to {} times but not after {LONG_ENOUGH} s; \
             ratios are taken at each moment. GPU timestamps of each stage. The CPU's part is sampling the animation and \
             comparing it with the device's state.",
            self.extent.frames
        );
        let mut table = Table::new("motion", "Motion", how, &columns);
        let mut budget = Budget::new(self.extent.budget);
        let mut scenes = vec![(moving(EDGE), CACHES[0])];
        scenes.extend(self.extent.crowds.iter().map(|n| (crowd(*n), CACHES[1] * n)));
        for (scene, caches) in scenes {
            (self.progress)(0.0, &scene.name);
            match budget.begin(caches as f64) {
                Ok(()) => table.push(self.of_scene(scene, caches)?),
                Err(reason) => table.skipped.push(format!("{}: {reason}.", scene.name)),
            }
        }
        Ok(table)
    }

    fn of_scene(&mut self, mut scene: Scene, caches: usize) -> Result<Vec<Cell>> {
        let (set, _) = bake(&scene, caches, 8)?;
        let mut buffers = World::new(self.gpu, &scene, Some(&set))?;
        let all = settings(self.extent.size, Gi::LightSkin, RSM, self.tuned.ways);
        let mut all = Frame::new(self.gpu, &scene, &buffers, &all)?;
        let some = Knobs { reuse: true, ..settings(self.extent.size, Gi::LightSkin, RSM, self.tuned.ways) };
        let mut some = Frame::new(self.gpu, &scene, &buffers, &some)?;
        let end = scene.animations().next().map_or(1.0, |(_, _, end)| end);
        // The first frames compile pipelines.
        for frame in [&mut some, &mut all] {
            self.drawn(frame, &buffers, &scene)?;
        }
        let mut measured = Vec::new();
        let begin = Instant::now();
        for i in 0..MOMENTS * self.extent.frames {
            if i > 0 && i % MOMENTS == 0 && begin.elapsed().as_secs_f64() > LONG_ENOUGH {
                break;
            }
            let start = Instant::now();
            scene.pose(0, end * (i % MOMENTS + 1) as f64 / MOMENTS as f64);
            buffers.update(self.gpu, &scene)?;
            let host = start.elapsed().as_secs_f64() * 1e3;
            // Both compared frames follow one of their kind, which has warmed a CPU's caches.
            let moving = self.drawn(&mut all, &buffers, &scene)?;
            // Data is stored in one frame and reused in the next.
            self.drawn(&mut some, &buffers, &scene)?;
            let skipped = self.drawn(&mut some, &buffers, &scene)?;
            self.drawn(&mut all, &buffers, &scene)?;
            let standing = self.drawn(&mut all, &buffers, &scene)?;
            let stage =
                |name: &str| moving.stages().iter().find(|s| s.name == name).and_then(|s| s.gpu_ms).unwrap_or(0.0);
            let sum = |times: &FrameTimes| times.stages().iter().filter_map(|s| s.gpu_ms).fold(0.0, |sum, ms| sum + ms);
            measured.push(Moment {
                host,
                moving: sum(&moving),
                update: stage("update"),
                deform: stage("deform"),
                standing: sum(&standing),
                skipped: sum(&skipped),
            });
        }
        let median = |of: &dyn Fn(&Moment) -> f64| {
            let mut all: Vec<f64> = measured.iter().map(of).collect();
            all.sort_by(f64::total_cmp);
            all[all.len() / 2]
        };
        let bent: Vec<usize> = (scene.instances.iter())
            .filter_map(|i| scene.meshes[i.mesh].deform.as_ref().map(|_| scene.meshes[i.mesh].vertices.len()))
            .collect();
        Ok(vec![
            scene.name.as_str().into(),
            scene.instances.len().into(),
            bent.len().into(),
            bent.iter().sum::<usize>().into(),
            (buffers.cache_count as usize).into(),
            median(&|m| m.standing).into(),
            median(&|m| m.moving).into(),
            median(&|m| m.update).into(),
            median(&|m| m.deform).into(),
            median(&|m| m.host).into(),
            median(&|m| m.moving / m.standing).into(),
            median(&|m| (m.moving + m.host) / m.standing).into(),
            median(&|m| m.skipped).into(),
        ])
    }

    /// Draws one frame and returns its times.
    fn drawn(&mut self, frame: &mut Frame, buffers: &World, scene: &Scene) -> Result<FrameTimes> {
        let view = View::new(&scene.cameras[0], frame.picture.size(), buffers.origin, buffers.radius);
        let drawn = self.gpu.timed_frame(|cmd| {
            frame.record(cmd, buffers, &view);
            Ok(())
        })?;
        let times = self.gpu.times(&drawn)?;
        self.problems.extend(drawn.problems);
        Ok(times)
    }
}

/// Summary sentences for the table.
pub fn headlines(table: &Table) -> Vec<String> {
    let scene = |row: usize| match &table.rows[row][0] {
        Cell::Text(name) => name.clone(),
        _ => String::new(),
    };
    let of = |row: usize, column: &str| table.number(row, column).unwrap_or(0.0);
    let line = |row: usize| {
        format!(
            "{}: a frame in motion takes {:.3} times as long as the same frame standing still ({:.3} with the CPU's part); \
             standing still with unchanged stages skipped takes {:.2} ms instead of {:.1} ms.",
            scene(row),
            of(row, "moving / standing"),
            of(row, "with the CPU's part"),
            of(row, "standing and skipped [ms]"),
            of(row, "standing [ms]")
        )
    };
    (0..table.rows.len()).map(line).collect()
}
