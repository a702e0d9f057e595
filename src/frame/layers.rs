//! What is seen through, stages 1 and 8: surfaces of blended and transmitting materials, nearest first, each shaded like a
//! picture of its own and laid over what is behind it. METHOD 15.

use super::gbuffer::{GBuffer, Surface};
use super::interpolate::Radiance;
use super::light::Light;
use super::near::NearPixels;
use super::view::View;
use super::visible::VisibleList;
use super::world::{ByKind, Which, World};
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Format, Gpu, Image, Pipeline, Raster, Shape, Use,
};

/// What shows nearest before the opaque surfaces, next nearest, and so on.
pub struct Layers {
    /// Nearest first.
    pub list: Vec<Layer>,
    draw: ByKind,
    /// Dims what is behind, and adds what the layer sends.
    mix: [Pipeline; 2],
}

/// One of them: of each pixel one surface, or none.
pub struct Layer {
    /// Stages 1 and 2.
    pub surface: Surface,
    /// Share of the light from behind that comes through, and as alpha the share of the layer's own.
    pub through: Image,
    /// Stage 5; only where caches are interpolated.
    pub visible: Option<VisibleList>,
    /// Stage 8, first; only with short rays.
    pub near: Option<NearPixels>,
    /// Stage 8; only with indirect light.
    pub indirect: Option<Radiance>,
}

impl Layers {
    /// Makes what a light's plan needs.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub(super) fn new(gpu: &Gpu, world: &World, light: &Light, size: [u32; 2]) -> Result<Option<Self>> {
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
                constants: &[dims],
            })
        };
        Ok(Some(Self {
            list: (0..plan.layers).map(layer).collect::<Result<_>>()?,
            draw: GBuffer::of_layers(gpu, world, plan)?,
            mix: [mix(Blend::Multiply, 1)?, mix(Blend::Add, 0)?],
        }))
    }

    /// Draws the layers of a view, after its opaque surfaces: of what is before these and behind the layer before, the nearest.
    pub(super) fn record(&self, cmd: &Cmd<'_>, world: &World, view: &View, opaque: &Surface) {
        let mut before = world.white();
        for Layer { surface, through, .. } in &self.list {
            cmd.barrier(Use::DepthWrite, Use::FragmentRead); // of opaque surfaces, and of the layer before
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

    /// Lays the light of layers over that of the opaque surfaces, direct or indirect, once all are done.
    pub(super) fn record_mix(&self, cmd: &Cmd<'_>, behind: (&Surface, Option<&Radiance>), which: (bool, bool)) {
        let (direct, indirect) = which;
        self.mix_one(cmd, direct.then_some(&behind.0.radiance), |layer| Some(&layer.surface.radiance));
        let behind = behind.1.filter(|_| indirect);
        self.mix_one(cmd, behind.map(|out| &out.diffuse), |layer| Some(&layer.indirect.as_ref()?.diffuse));
        let glossy = behind.and_then(|out| out.glossy.as_ref());
        self.mix_one(cmd, glossy, |layer| layer.indirect.as_ref()?.glossy.as_ref());
    }

    fn mix_one<'a>(&'a self, cmd: &Cmd<'_>, to: Option<&Image>, of: impl Fn(&'a Layer) -> Option<&'a Image>) {
        let Some(to) = to else { return };
        let into = Attachments { colors: &[Attach::keep(to)], depth: None, area: [0, 0, to.width, to.height] };
        cmd.render(&into, |draw| {
            for layer in self.list.iter().rev() {
                let Some(from) = of(layer) else { continue };
                for mix in &self.mix {
                    draw.bind(mix, &[from, &layer.through, &layer.surface.depth].map(Bind::from));
                    draw.draw(3);
                }
            }
        });
    }
}
