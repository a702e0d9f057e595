//! Stage 11, composite: measures exposure from all radiance, then tone-maps it into the picture. METHOD 1, 10.

use super::edges::Edges;
use super::gbuffer::Surface;
use super::interpolate::Radiance;
use super::layers::Layers;
use super::plan::Plan;
use super::settings::{Behind, Exposure, Look};
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cmd, Cull, Depth, Device, Format, Image, Pipeline, Raster, Shape, Use,
};
use crate::shared::{CompositePush, EXPOSURE_BINS};
use glam::Vec4;

/// A finished picture.
pub struct Output {
    /// Tone-mapped sRGB.
    pub picture: Image,
    /// The exposure value of the picture, measured or fixed.
    pub exposure: Buffer,
    /// Histogram of luminance; all 0 between frames.
    bins: Buffer,
}

impl Output {
    /// Creates the images for a picture of this size \[pixels\].
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, [w, h]: [u32; 2]) -> Result<Self> {
        Ok(Self {
            picture: gpu.target("composite.output", Format::R8G8B8A8_SRGB, w, h)?,
            exposure: gpu.buffer("composite.exposure", 16)?,
            bins: gpu.buffer_from("composite.bins", &[0_u32; 4 * EXPOSURE_BINS as usize])?,
        })
    }
}

/// Measures the luminance of the visible radiance and maps it to the display. METHOD 10.
pub struct Composite {
    fill: Pipeline,
    expose: Pipeline,
    map: Pipeline,
}

/// Pixels per workgroup of the exposure's histogram, and the maximum number of workgroups.
const PIXELS_PER_GROUP: u32 = 2048;
const MOST_GROUPS: u32 = 64;

/// Inputs and output of the composite stage for one picture.
#[derive(Clone, Copy)]
pub struct Composed<'a> {
    /// First surfaces, with direct light in their radiance.
    pub surface: &'a Surface,
    /// Indirect light.
    pub indirect: Option<&'a Radiance>,
    /// Second surfaces of pixels.
    pub edges: Option<&'a Edges>,
    /// Transparent layers.
    pub layers: Option<&'a Layers>,
    /// Output.
    pub out: &'a Output,
}

impl<'a> Composed<'a> {
    /// The inputs without edges and layers, and this buffer. A lobe that the plan lacks is not read; the direct image
    /// takes its binding.
    fn binds(&self, last: &'a Buffer) -> Vec<Bind<'a>> {
        let [direct, diffuse, glossy] = radiances(&self.surface.radiance, self.indirect);
        vec![direct, diffuse, glossy, (&self.surface.depth).into(), last.into()]
    }

    /// The inputs and the exposure, with second surfaces and the depth of the nearest layer.
    fn binds_with_more(&self) -> Vec<Bind<'a>> {
        let mut binds = self.binds(&self.out.exposure);
        if let Some(edges) = self.edges {
            binds.extend(radiances(&edges.before, edges.indirect_before.as_ref()));
            // Without second surfaces no point shows them; the first ones take their bindings.
            let second = edges.second.as_ref();
            let indirect = second.map_or(edges.indirect_before.as_ref(), |second| second.indirect.as_ref());
            binds.extend(radiances(second.map_or(&edges.before, |second| &second.surface.radiance), indirect));
            let depth = second.map_or(&self.surface.depth, |second| &second.surface.depth);
            binds.extend([depth, &edges.codes].map(Bind::from));
        }
        // The nearest layer.
        binds.extend(self.layers.and_then(|layers| layers.list.first()).map(|layer| Bind::from(&layer.surface.depth)));
        binds
    }
}

/// Direct light, then indirect light of each lobe.
fn radiances<'a>(direct: &'a Image, indirect: Option<&'a Radiance>) -> [Bind<'a>; 3] {
    let glossy = indirect.and_then(|i| i.glossy.as_ref()).unwrap_or(direct);
    [direct, indirect.map_or(direct, |i| &i.diffuse), glossy].map(Bind::from)
}

impl Composite {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, plan: &Plan) -> Result<Self> {
        let points = plan.antialiasing.points();
        let constants = [u32::from(plan.indirect()), u32::from(plan.indirect() && plan.glossy), points];
        Ok(Self {
            fill: gpu.compute("expose_bins.comp", &constants[..2])?,
            expose: gpu.compute("expose.comp", &[])?,
            map: gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some(match (points, plan.layers) {
                    (0, 0) => "composite.frag",
                    (0, _) => "composite_layers.frag",
                    (_, 0) => "composite_edges.frag",
                    _ => "composite_edges_layers.frag",
                }),
                shape: Shape::Triangles,
                streams: &[],
                colors: &[Format::R8G8B8A8_SRGB],
                blend: Blend::Replace,
                depth: Depth::None,
                cull: Cull::None,
                multisampled: false,
                constants: &constants,
            })?,
        })
    }

    /// Records the stage for all pictures. Waits for their radiance if this frame wrote it.
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
        if automatic {
            if of_this_frame {
                cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::ComputeRead);
            }
            for composed in views.clone() {
                cmd.bind(&self.fill, &composed.binds(&composed.out.bins));
                let push = push(&composed);
                cmd.push(&push);
                let pixels = push.width.div_ceil(push.step) * push.height.div_ceil(push.step);
                cmd.dispatch(256 * pixels.div_ceil(PIXELS_PER_GROUP).clamp(1, MOST_GROUPS), 1, 1);
            }
            cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
        }
        for composed in views.clone() {
            cmd.bind(&self.expose, &[&composed.out.exposure, &composed.out.bins].map(Bind::from));
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

/// Distance in columns and rows between pixels whose luminance is measured: about 2^18 pixels are enough.
fn metering_step([width, height]: [u32; 2]) -> u32 {
    (f64::from(width) * f64::from(height) / f64::from(1 << 18)).sqrt().ceil() as u32
}
