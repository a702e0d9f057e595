//! Stage 11, composite: all radiance, exposure, tone map -> picture. METHOD 1.

use super::{Exposure, Plan, Settings, Targets};
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Format, Gpu, Pipeline, Raster, Shape, Use};
use crate::shared::CompositePush;

/// Measures the picture's luminance and maps it to the display.
pub struct Composite {
    expose: Option<Pipeline>,
    map: Pipeline,
    push: CompositePush,
}

impl Composite {
    /// Makes the pipelines.
    pub fn new(gpu: &Gpu, plan: &Plan, settings: &Settings) -> Result<Self> {
        let constants = [u32::from(plan.indirect()), u32::from(plan.indirect() && plan.glossy)];
        let automatic = settings.exposure == Exposure::Automatic;
        let ev = if let Exposure::Ev(ev) = settings.exposure { ev } else { 0.0 };
        Ok(Self {
            expose: automatic.then(|| gpu.compute("expose.comp", &constants)).transpose()?,
            map: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some("composite.frag"),
                shape: Shape::Triangles,
                streams: &[],
                colors: &[Format::R8G8B8A8_SRGB],
                blend: Blend::Replace,
                depth: Depth::None,
                cull: Cull::None,
                constants: &constants,
            })?,
            push: CompositePush {
                ev,
                automatic: automatic.into(),
                tonemap: settings.tonemap as u32,
                width: settings.size[0],
                height: settings.size[1],
            },
        })
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, t: &Targets) {
        let _zone = cmd.zone("composite");
        // A lobe that the plan has not is not read; the direct image only fills its place.
        let diffuse = t.indirect.as_ref().map_or(&t.direct, |i| &i.diffuse);
        let glossy = t.indirect.as_ref().and_then(|i| i.glossy.as_ref()).unwrap_or(&t.direct);
        let binds: [Bind<'_>; 4] = [(&t.direct).into(), diffuse.into(), glossy.into(), (&t.exposure).into()];
        if let Some(expose) = &self.expose {
            cmd.barrier(Use::ColorWrite, Use::ComputeRead);
            cmd.bind(expose, &binds);
            cmd.push(&self.push);
            cmd.dispatch(256, 1, 1);
            cmd.barrier(Use::ComputeWrite | Use::ColorWrite, Use::FragmentRead);
        } else {
            cmd.barrier(Use::ColorWrite, Use::FragmentRead);
        }
        cmd.render(
            &Attachments { colors: &[Attach::clear(&t.output)], depth: None, area: [0, 0, t.size[0], t.size[1]] },
            |draw| {
                draw.bind(&self.map, &binds);
                draw.push(&self.push);
                draw.draw(3);
            },
        );
    }
}
