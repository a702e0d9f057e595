//! A picture of a world: targets and results of one view. A second view needs a second picture.

use super::background::Background;
use super::composite::{Composed, Composite, Output};
use super::edges::{Edges, Second};
use super::gbuffer::{GBuffer, Surface};
use super::interpolate::Radiance;
use super::layers::{Layer, Layers};
use super::light::Light;
use super::near::NearPixels;
use super::plan::Plan;
use super::revision::{Made, Watched};
use super::settings::Look;
use super::view::View;
use super::visible::VisibleList;
use super::world::World;
use crate::error::Result;
use crate::gpu::Device;
use glam::Vec4;

/// Images of one view, and the passes that belong to it.
pub struct Picture {
    /// Stages 1 and 2.
    pub surface: Surface,
    /// Stage 5; only where caches are interpolated.
    pub visible: Option<VisibleList>,
    /// Stage 8, first part; only with short rays.
    pub near: Option<NearPixels>,
    /// Stage 8; only with indirect light.
    pub indirect: Option<Radiance>,
    /// What the points of pixels show; only with antialiasing.
    pub edges: Option<Edges>,
    /// Transparent layers, if the scene has any.
    pub layers: Option<Layers>,
    /// Stage 11.
    pub output: Output,
    pub(super) gbuffer: GBuffer,
    pub(super) background: Option<Background>,
    pub(super) composite: Composite,
    pub(super) made: MadeOfPicture,
    pub(super) outdated: Outdated,
    size: [u32; 2],
    plan: Plan,
    layout: u64,
}

/// Revisions of the results.
#[derive(Default)]
pub(super) struct MadeOfPicture {
    pub(super) view: Watched<View>,
    pub(super) eye: Watched<Vec4>,
    pub(super) look: Watched<Look>,
    pub(super) surface: Made,
    pub(super) radiance: Made,
    pub(super) visible: Made,
    pub(super) indirect: Made,
    pub(super) output: Made,
}

/// Parts that the next frame must recompute.
#[derive(Clone, Copy, Default)]
pub(super) struct Outdated {
    /// Stages 1 and 2, which write the same radiance.
    pub(super) surface: bool,
    pub(super) visible: bool,
    pub(super) indirect: bool,
    pub(super) output: bool,
}

impl Picture {
    /// Creates a picture of this size \[pixels\]. Frames skip empty pictures, such as those of a minimised window.
    ///
    /// # Errors
    /// Fails if the size exceeds the device's limits or the device runs out of memory.
    pub fn new(gpu: &Device, world: &World, light: &Light, size: [u32; 2]) -> Result<Self> {
        let (plan, images) = (light.plan, size.map(|side| side.max(1)));
        Ok(Self {
            surface: Surface::new(gpu, &plan, images)?,
            visible: plan.lightskin.then(|| VisibleList::new(gpu, world, &plan, images)).transpose()?,
            near: (light.caches().and_then(|caches| caches.near.as_ref()))
                .map(|rays| NearPixels::new(gpu, rays, images))
                .transpose()?,
            indirect: plan.indirect().then(|| Radiance::new(gpu, &plan, images)).transpose()?,
            edges: Edges::new(gpu, world, &plan, images)?,
            layers: Layers::new(gpu, world, light, images)?,
            output: Output::new(gpu, images)?,
            gbuffer: GBuffer::new(gpu, world, &plan, images)?,
            background: plan.sky.then(|| Background::new(gpu)).transpose()?,
            composite: Composite::new(gpu, &plan)?,
            made: MadeOfPicture::default(),
            outdated: Outdated::default(),
            size,
            plan,
            layout: world.layout,
        })
    }

    /// Rebuilds the picture if it no longer fits the light or the size; otherwise it costs nothing.
    ///
    /// # Errors
    /// As `new`; then the picture has not changed.
    pub fn fit(&mut self, gpu: &Device, world: &World, light: &Light, size: [u32; 2]) -> Result<()> {
        if self.size != size || !self.fits(world, light) {
            *self = Self::new(gpu, world, light, size)?;
        }
        Ok(())
    }

    /// Whether the picture was created for the light in its current state.
    pub fn fits(&self, world: &World, light: &Light) -> bool {
        self.plan == light.plan && self.layout == world.layout
    }

    /// Width and height \[pixels\].
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Whether it has no pixels.
    pub fn is_empty(&self) -> bool {
        self.size.contains(&0)
    }

    /// First and second surfaces of the pixels.
    pub(super) fn surfaces(&self) -> impl Iterator<Item = &Surface> + Clone {
        [&self.surface].into_iter().chain(self.second().map(|second| &second.surface))
    }

    /// Second surfaces of the pixels.
    pub fn second(&self) -> Option<&Second> {
        self.edges.as_ref().and_then(|edges| edges.second.as_ref())
    }

    /// Transparent layers, nearest first.
    fn seen_through(&self) -> impl Iterator<Item = &Layer> + Clone {
        self.layers.iter().flat_map(|layers| &layers.list)
    }

    /// All surfaces of the pixels, including transparent layers.
    pub(super) fn lit(&self) -> impl Iterator<Item = &Surface> + Clone {
        self.surfaces().chain(self.seen_through().map(|layer| &layer.surface))
    }

    /// Surfaces with short rays of their own.
    pub(super) fn near(&self) -> impl Iterator<Item = (&Surface, &NearPixels)> + Clone {
        let first = self.near.as_ref().map(|near| (&self.surface, near));
        let layers = self.seen_through().filter_map(|layer| Some((&layer.surface, layer.near.as_ref()?)));
        first.into_iter().chain(layers)
    }

    /// Surfaces with the lists of their visible vertices or cells.
    pub(super) fn lists(&self) -> impl Iterator<Item = (&Surface, &VisibleList)> + Clone {
        let first = self.visible.as_ref().map(|list| (&self.surface, list));
        let second = self.second().and_then(|second| Some((&second.surface, second.visible.as_ref()?)));
        let layers = self.seen_through().filter_map(|layer| Some((&layer.surface, layer.visible.as_ref()?)));
        first.into_iter().chain(second).chain(layers)
    }

    /// Surfaces with their indirect light, and the short rays that this light uses.
    pub(super) fn shaded(&self) -> impl Iterator<Item = (&Surface, &Radiance, Option<&NearPixels>)> + Clone {
        let near = self.near.as_ref();
        let first = self.indirect.as_ref().map(|out| (&self.surface, out, near));
        let second = self.second().and_then(|second| Some((&second.surface, second.indirect.as_ref()?, near)));
        let own = self.seen_through();
        let own = own.filter_map(|layer| Some((&layer.surface, layer.indirect.as_ref()?, layer.near.as_ref())));
        first.into_iter().chain(second).chain(own)
    }

    /// Inputs and output of stage 11.
    pub(super) fn composed(&self) -> Composed<'_> {
        Composed {
            surface: &self.surface,
            indirect: self.indirect.as_ref(),
            edges: self.edges.as_ref(),
            layers: self.layers.as_ref(),
            out: &self.output,
        }
    }
}
