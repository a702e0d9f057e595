//! Samples, stage 1: finds which surface each sample of a multisampled image shows, without shading it. METHOD 13.

use super::gbuffer::Surface;
use super::plan::Plan;
use super::view::View;
use super::world::{ByKind, VERTEX_PLAIN, Which, World};
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Device, Extent, Format, Image, ImageDesc, Pipeline, Raster,
    Shape, Use,
};
use crate::shared::{KIND_MASKED, SamplesPush};

/// Surfaces at the samples of a picture's pixels.
pub(super) struct Samples {
    /// Draw and normal.
    surface: Image,
    depth: Image,
    draw: ByKind,
    find: Pipeline,
}

/// A draw's number and a coded normal. Floats, since devices need not have multisampled integers.
const SAMPLE: Format = Format::R32G32_SFLOAT;

impl Samples {
    /// Creates the resources for pictures of this size.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub(super) fn new(gpu: &Device, world: &World, plan: &Plan, size: [u32; 2]) -> Result<Self> {
        let image =
            |name, format| gpu.image(&ImageDesc { name, format, size, extent: Extent::Samples, storage: false });
        let draw = |kind| {
            gpu.raster(&Raster {
                vertex: "mesh_plain.vert",
                fragment: Some(if kind & KIND_MASKED == 0 { "samples.frag" } else { "samples_holes.frag" }),
                shape: Shape::Triangles,
                streams: &[VERTEX_PLAIN],
                colors: &[SAMPLE],
                blend: Blend::Replace,
                depth: Depth::Nearest,
                cull: Cull::Back,
                multisampled: true,
                constants: &[kind],
            })
        };
        Ok(Self {
            surface: image("edges.samples", SAMPLE)?,
            depth: image("edges.sample_depth", Format::D32_SFLOAT)?,
            draw: world.by_kind(draw)?,
            find: gpu.compute(if plan.elements() { "samples_elements.comp" } else { "samples.comp" }, &[])?,
        })
    }

    /// Writes the codes of a view's samples, after its first surfaces are drawn.
    pub(super) fn record(&self, cmd: &Cmd<'_>, world: &World, view: &View, first: &Surface, codes: &Image) {
        let color = [Attach::clear(&self.surface)];
        let into = Attachments { colors: &color, depth: Some(Attach::clear(&self.depth)), area: first.area() };
        cmd.render(&into, |draw| world.draw(draw, &self.draw, Which::Solid, view.clip_from_world, view.eye));
        cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::ComputeRead | Use::ComputeWrite);
        let mut resources: Vec<Bind<'_>> =
            [&first.depth, &first.albedo, &first.specular, &self.depth, &self.surface, codes].map(Bind::from).to_vec();
        resources.extend(first.element.as_ref().map(Bind::from));
        cmd.bind(&self.find, &resources);
        cmd.push(&SamplesPush { world_from_clip: view.world_from_clip });
        cmd.dispatch(first.size[0], first.size[1], 1);
    }
}
