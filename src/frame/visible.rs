//! Stage 5, first half: what pixels show -> the vertices that stages 5, 6 and 8 have to work on. METHOD 9.

use super::SceneBuffers;
use super::targets::VisibleTargets;
use crate::error::{Error, Result};
use crate::gpu::{Cmd, Gpu, Image, Pipeline, Use};
use crate::shared::{VisibleArgs, VisiblePush};
use std::cell::Cell;

/// Lists the corners of visible triangles.
pub struct Visible {
    pipeline: Pipeline,
    /// Number of the next frame: marks of earlier ones need no clearing.
    frame: Cell<u32>,
}

impl Visible {
    /// Makes the pipeline. Fails on devices whose fragment shaders cannot number triangles.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        numbered_triangles(gpu)?;
        Ok(Self { pipeline: gpu.compute("visible.comp", &[])?, frame: Cell::new(1) })
    }

    /// Records the pass for all `views`, images of elements: a vertex that one of them shows is listed.
    pub fn record(&self, cmd: &Cmd<'_>, scene: &SceneBuffers, views: &[&Image], out: &VisibleTargets) {
        let _zone = cmd.zone("visible");
        let frame = self.frame.get();
        self.frame.set(frame.checked_add(1).unwrap_or(1));
        cmd.copy_buffer(&out.none, &out.args, size_of::<VisibleArgs>() as u64);
        cmd.barrier(Use::CopyWrite | Use::ColorWrite, Use::ComputeRead | Use::ComputeWrite); // elements -> here
        for (i, view) in views.iter().enumerate() {
            if i > 0 {
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            }
            cmd.bind(
                &self.pipeline,
                &[
                    (*view).into(),
                    (&scene.draw_records).into(),
                    scene.indices().into(),
                    (&out.seen).into(),
                    (&out.slots).into(),
                    (&out.list).into(),
                    (&out.args).into(),
                ],
            );
            cmd.push(&VisiblePush { frame });
            cmd.dispatch(view.width, view.height, 1);
        }
    }
}

/// Fails on devices whose fragment shaders cannot number triangles.
pub(super) fn numbered_triangles(gpu: &Gpu) -> Result<()> {
    if gpu.numbers_triangles() {
        return Ok(());
    }
    let name = &gpu.report().name;
    Err(Error::NoDevice(format!(
        "{name} lacks the feature geometryShader, by which pixels know their triangle; choose another --device, or \
         --gi brute-force"
    )))
}
