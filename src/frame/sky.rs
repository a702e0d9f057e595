//! Stage 2, where no surface is: the sky's radiance. Its light is that of directional lights (`scene::sky`).

use super::{SceneBuffers, Targets, View};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Blend, Buffer, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster, Shape, Use};
use crate::scene::sky::Sky;
use crate::shared::SkyPush;

/// A sky on the device.
pub struct SkyBuffer {
    /// Radiances, row by row.
    pub texels: Buffer,
    width: u32,
    height: u32,
    turn: f32,
}

impl SkyBuffer {
    /// Uploads a sky.
    pub fn new(gpu: &Gpu, sky: &Sky) -> Result<Self> {
        let texels = gpu.buffer_from("scene.sky", &sky.texels)?;
        Ok(Self { texels, width: sky.width, height: sky.height, turn: sky.turn as f32 })
    }
}

/// Fills the background.
pub struct Background {
    pipeline: Pipeline,
}

impl Background {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        let pipeline = gpu.raster(&Raster {
            vertex: "screen.vert",
            fragment: Some("sky.frag"),
            shape: Shape::Triangles,
            streams: &[],
            colors: &[Format::R32G32B32A32_SFLOAT],
            blend: Blend::Add,
            depth: Depth::None,
            cull: Cull::None,
            constants: &[],
        })?;
        Ok(Self { pipeline })
    }

    /// Records the pass.
    pub fn record(&self, cmd: &Cmd<'_>, scene: &SceneBuffers, view: &View, t: &Targets) {
        let _zone = cmd.zone("sky");
        let sky = scene.sky.as_ref().expect("the plan has a sky");
        cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::FragmentRead | Use::ColorWrite); // G-buffer, direct light
        let radiance =
            Attachments { colors: &[Attach::keep(&t.direct)], depth: None, area: [0, 0, t.size[0], t.size[1]] };
        cmd.render(&radiance, |draw| {
            draw.bind(&self.pipeline, &[(&t.depth).into(), (&sky.texels).into()]);
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
