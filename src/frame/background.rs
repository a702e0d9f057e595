//! Stage 2, where no surface is: the sky's radiance. Its light on surfaces is `sky_light`'s.

use super::gbuffer::Surface;
use super::view::View;
use super::world::SkyBuffer;
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Cmd, Gpu, Pipeline, Use};
use crate::shared::SkyPush;

/// Fills the background.
pub struct Background {
    pipeline: Pipeline,
}

impl Background {
    /// Makes the pipeline.
    ///
    /// # Errors
    /// A driver that refuses the shaders.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        let pipeline = Surface::adding(gpu, "sky.frag", &[])?;
        Ok(Self { pipeline })
    }

    /// Records the pass for views and what they see of surfaces.
    pub fn record<'a>(&self, cmd: &Cmd<'_>, sky: &SkyBuffer, views: impl Iterator<Item = (&'a View, &'a Surface)>) {
        cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::FragmentRead | Use::ColorWrite); // G-buffer, direct light
        for (view, surface) in views {
            let radiance =
                Attachments { colors: &[Attach::keep(&surface.radiance)], depth: None, area: surface.area() };
            cmd.render(&radiance, |draw| {
                draw.bind(&self.pipeline, &[(&surface.depth).into(), (&sky.texels).into()]);
                draw.push(&SkyPush {
                    world_from_clip: view.world_from_clip,
                    eye: view.eye,
                    width: sky.width,
                    height: sky.height,
                    turn: sky.turn,
                });
                draw.draw(3);
            });
        }
    }
}
