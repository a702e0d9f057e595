//! Stage 11, composite: all radiance, depth -> exposure; tone map -> picture. METHOD 1, 10.

use super::edges::Edges;
use super::gbuffer::Surface;
use super::interpolate::Radiance;
use super::layers::Layers;
use super::plan::Plan;
use super::settings::{Antialiasing, Behind, Exposure, Look};
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cmd, Cull, Depth, Format, Gpu, Image, Pipeline, Raster, Shape, Use,
};
use crate::shared::CompositePush;
use glam::Vec4;

/// A picture as it is shown.
pub struct Output {
    /// Tone-mapped sRGB.
    pub picture: Image,
    /// The exposure value that the picture is shown with, measured or fixed.
    pub exposure: Buffer,
}

impl Output {
    /// Of this size.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn new(gpu: &Gpu, [w, h]: [u32; 2]) -> Result<Self> {
        Ok(Self {
            picture: gpu.target("composite.output", Format::R8G8B8A8_SRGB, w, h)?,
            exposure: gpu.buffer("composite.exposure", 16)?,
        })
    }
}

/// Measures the luminance of what the picture shows and maps it to the display. METHOD 10.
pub struct Composite {
    expose: Pipeline,
    map: Pipeline,
}

/// A picture to be composed.
#[derive(Clone, Copy)]
pub struct Composed<'a> {
    /// Direct light is in its radiance.
    pub surface: &'a Surface,
    /// Indirect light.
    pub indirect: Option<&'a Radiance>,
    /// Second surfaces of pixels.
    pub edges: Option<&'a Edges>,
    /// What is seen through.
    pub layers: Option<&'a Layers>,
    /// What comes out.
    pub out: &'a Output,
}

impl<'a> Composed<'a> {
    /// A lobe that the plan has not is not read; the direct image only fills its place.
    fn binds(&self) -> Vec<Bind<'a>> {
        let [direct, diffuse, glossy] = radiances(&self.surface.radiance, self.indirect);
        vec![direct, diffuse, glossy, (&self.surface.depth).into(), (&self.out.exposure).into()]
    }

    /// The same, with what second surfaces send and where surfaces are seen through.
    fn binds_with_more(&self) -> Vec<Bind<'a>> {
        let mut binds = self.binds();
        if let Some(edges) = self.edges {
            binds.extend(radiances(&edges.before, edges.indirect_before.as_ref()));
            binds.extend(radiances(&edges.surface.radiance, edges.indirect.as_ref()));
            binds.extend([&edges.surface.depth, &edges.codes].map(Bind::from));
        }
        // What shows nearest of all.
        binds.extend(self.layers.and_then(|layers| layers.list.first()).map(|layer| Bind::from(&layer.surface.depth)));
        binds
    }
}

/// Direct light, and indirect light by lobes.
fn radiances<'a>(direct: &'a Image, indirect: Option<&'a Radiance>) -> [Bind<'a>; 3] {
    let glossy = indirect.and_then(|i| i.glossy.as_ref()).unwrap_or(direct);
    [direct, indirect.map_or(direct, |i| &i.diffuse), glossy].map(Bind::from)
}

impl Composite {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let points = plan.antialiasing.samples();
        let constants = [u32::from(plan.indirect()), u32::from(plan.indirect() && plan.glossy), points];
        Ok(Self {
            expose: gpu.compute("expose.comp", &constants)?,
            map: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some(match (plan.antialiasing, plan.layers) {
                    (Antialiasing::Off, 0) => "composite.frag",
                    (Antialiasing::Off, _) => "composite_layers.frag",
                    (_, 0) => "composite_edges.frag",
                    _ => "composite_edges_layers.frag",
                }),
                shape: Shape::Triangles,
                streams: &[],
                colors: &[Format::R8G8B8A8_SRGB],
                blend: Blend::Replace,
                depth: Depth::None,
                cull: Cull::None,
                constants: &constants,
            })?,
        })
    }

    /// Records the stage for all pictures; waits for their radiance where that is of this frame.
    pub fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        look: &Look,
        of_this_frame: bool,
        views: impl Iterator<Item = Composed<'a>> + Clone,
    ) {
        let (automatic, ev) = match look.exposure {
            Exposure::Automatic => (true, 0.0),
            Exposure::Ev(ev) => (false, ev),
        };
        let push = |composed: &Composed<'_>| {
            let [width, height] = composed.surface.size;
            let (replaced, behind) = match look.behind {
                Behind::Scene => (0, Vec4::ZERO),
                Behind::Color(color) => (1, color.extend(1.0)),
                Behind::Transparent => (1, Vec4::ZERO),
            };
            let (automatic, tonemap, step) =
                (automatic.into(), look.tonemap as u32, metering_step(composed.surface.size));
            CompositePush { ev, automatic, tonemap, width, height, step, replaced, behind }
        };
        if of_this_frame {
            cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::ComputeRead);
        }
        for composed in views.clone() {
            cmd.bind(&self.expose, &composed.binds());
            cmd.push(&push(&composed));
            cmd.dispatch(256, 1, 1);
        }
        cmd.barrier(Use::ComputeWrite | Use::ColorWrite | Use::DepthWrite, Use::FragmentRead);
        for composed in views {
            let picture = [Attach::clear(&composed.out.picture)];
            cmd.render(&Attachments { colors: &picture, depth: None, area: composed.surface.area() }, |draw| {
                draw.bind(&self.map, &composed.binds_with_more());
                draw.push(&push(&composed));
                draw.draw(3);
            });
        }
    }
}

/// Every how many pixels and rows of a picture luminance is measured: some 2^18 pixels are enough.
fn metering_step([width, height]: [u32; 2]) -> u32 {
    (f64::from(width) * f64::from(height) / f64::from(1 << 18)).sqrt().ceil() as u32
}
