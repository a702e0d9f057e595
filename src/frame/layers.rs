//! Transparency, stages 1 and 8: surfaces of alpha-blended and transmitting materials, nearest first. Each layer is
//! shaded like a separate picture and blended over the layers behind it. METHOD 15.

use super::gbuffer::{GBuffer, Surface};
use super::interpolate::Radiance;
use super::light::Light;
use super::near::NearPixels;
use super::refract::{Behind, Refract};
use super::view::View;
use super::visible::VisibleList;
use super::world::{ByKind, Which, World};
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Device, Format, Image, Pipeline, Raster, Shape, Use,
};

/// Transparent layers in front of the opaque surfaces.
pub struct Layers {
    /// Layers, nearest first.
    pub list: Vec<Layer>,
    draw: ByKind,
    /// Only with bodies of glass.
    refract: Option<Refract>,
    /// The first dims the light from behind; the second adds the layer's light.
    mix: [Pipeline; 2],
}

/// One layer: at most one transparent surface per pixel.
pub struct Layer {
    /// Stages 1 and 2.
    pub surface: Surface,
    /// Share of the light from behind that passes through; in alpha, the weight of the layer's own light.
    pub through: Image,
    /// Stage 5; only where caches are interpolated.
    pub visible: Option<VisibleList>,
    /// Stage 8, first part; only with short rays.
    pub near: Option<NearPixels>,
    /// Stage 8; only with indirect light.
    pub indirect: Option<Radiance>,
}

impl Layers {
    /// Creates the layers that a light's plan needs.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub(super) fn new(gpu: &Device, world: &World, light: &Light, size: [u32; 2]) -> Result<Option<Self>> {
        let plan = &light.plan;
        if plan.layers == 0 {
            return Ok(None);
        }
        let layer = |_| {
            Ok(Layer {
                surface: Surface::new(gpu, plan, size)?,
                through: gpu.target("layers.through", Format::R16G16B16A16_SFLOAT, size[0], size[1])?,
                visible: plan.lightskin.then(|| VisibleList::new(gpu, world, plan, size)).transpose()?,
                near: (light.caches().and_then(|caches| caches.near.as_ref()))
                    .map(|rays| NearPixels::new(gpu, rays, size))
                    .transpose()?,
                indirect: plan.indirect().then(|| Radiance::new(gpu, plan, size)).transpose()?,
            })
        };
        let mix = |blend, dims| {
            gpu.raster(&Raster {
                vertex: "screen.vert",
                fragment: Some("layers_mix.frag"),
                shape: Shape::Triangles,
                streams: &[],
                colors: &[Format::R32G32B32A32_SFLOAT],
                blend,
                depth: Depth::None,
                cull: Cull::None,
                multisampled: false,
                constants: &[dims],
            })
        };
        Ok(Some(Self {
            list: (0..plan.layers).map(layer).collect::<Result<_>>()?,
            draw: GBuffer::of_layers(gpu, world, plan)?,
            refract: Refract::new(gpu, world, plan)?,
            mix: [mix(Blend::Multiply, 1)?, mix(Blend::Add, 0)?],
        }))
    }

    /// Draws the layers of a view after its opaque surfaces. Each layer keeps the nearest surface in front of the
    /// opaque ones and behind the previous layer.
    pub(super) fn record(&self, cmd: &Cmd<'_>, world: &World, view: &View, opaque: &Surface) {
        let mut before = world.white();
        for Layer { surface, through, .. } in &self.list {
            cmd.barrier(Use::DepthWrite, Use::FragmentRead); // depth of opaque surfaces and of the previous layer
            let colors: Vec<_> = surface.targets(Some(through)).map(Attach::clear).collect();
            let depth = Some(Attach::clear(&surface.depth));
            cmd.render(&Attachments { colors: &colors, depth, area: surface.area() }, |draw| {
                let limits = [&opaque.depth, before].map(Bind::from);
                let view = (view.clip_from_world, view.eye);
                world.draw_large(draw, &self.draw, (Which::SeenThrough, &limits), view, 0.0);
            });
            before = &surface.depth;
        }
    }

    /// Blends the light of the layers, direct or indirect, over that of the opaque surfaces, which bodies of glass shift.
    /// Call it after all shading.
    pub(super) fn record_mix(
        &self,
        cmd: &Cmd<'_>,
        of: (&World, &Light),
        view: &View,
        behind: (&Surface, Option<&Radiance>),
        which: (bool, bool),
    ) {
        let behind = Behind { direct: &behind.0.radiance, indirect: behind.1 };
        let Some(refract) = &self.refract else {
            return self.mix(cmd, self.list.iter().rev(), &behind, which);
        };
        for (i, layer) in self.list.iter().rev().enumerate() {
            if i > 0 {
                cmd.barrier(Use::ColorWrite, Use::ColorWrite); // the layer behind -> here
            }
            refract.record(cmd, of, view, (&layer.surface, &layer.through), &behind);
            cmd.barrier(Use::ColorWrite, Use::ColorWrite);
            self.mix(cmd, [layer].into_iter(), &behind, which);
        }
    }

    /// Blends layers, the farthest first.
    fn mix<'a>(
        &'a self,
        cmd: &Cmd<'_>,
        layers: impl Iterator<Item = &'a Layer> + Clone,
        behind: &Behind<'_>,
        (direct, indirect): (bool, bool),
    ) {
        let one = |to: Option<&Image>, of: &dyn Fn(&'a Layer) -> Option<&'a Image>| {
            let Some(to) = to else { return };
            let into = Attachments { colors: &[Attach::keep(to)], depth: None, area: [0, 0, to.width, to.height] };
            cmd.render(&into, |draw| {
                for layer in layers.clone() {
                    let Some(from) = of(layer) else { continue };
                    for mix in &self.mix {
                        draw.bind(mix, &[from, &layer.through, &layer.surface.depth].map(Bind::from));
                        draw.draw(3);
                    }
                }
            });
        };
        one(direct.then_some(behind.direct), &|layer| Some(&layer.surface.radiance));
        let behind = behind.indirect.filter(|_| indirect);
        one(behind.map(|out| &out.diffuse), &|layer| Some(&layer.indirect.as_ref()?.diffuse));
        one(behind.and_then(|out| out.glossy.as_ref()), &|layer| layer.indirect.as_ref()?.glossy.as_ref());
    }
}
