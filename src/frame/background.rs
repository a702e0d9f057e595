//! Stage 2 in pixels without a surface: adds the sky's radiance. `sky_light` handles the sky's light on surfaces.

use super::gbuffer::Surface;
use super::view::View;
use super::world::SkyBuffer;
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Cmd, Device, Pipeline, Use};
use crate::shared::SkyPush;

/// Draws the background.
pub struct Background {
    pipeline: Pipeline,
}

impl Background {
    /// Creates the pipeline.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn new(gpu: &Device) -> Result<Self> {
        let pipeline = Surface::adding(gpu, "sky.frag", &[])?;
        Ok(Self { pipeline })
    }

    /// Records the pass for views and their surfaces.
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
