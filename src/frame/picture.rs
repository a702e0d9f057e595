//! A picture of a world: what one view sees, and what is made of it. A second view is a second picture.

use super::background::Background;
use super::composite::{Composed, Composite, Output};
use super::edges::Edges;
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
use crate::gpu::Gpu;
use glam::Vec4;

/// The images of one view, and the passes that are its own.
pub struct Picture {
    /// Stages 1 and 2.
    pub surface: Surface,
    /// Stage 5; only where caches are interpolated.
    pub visible: Option<VisibleList>,
    /// Stage 8, first; only with short rays.
    pub near: Option<NearPixels>,
    /// Stage 8; only with indirect light.
    pub indirect: Option<Radiance>,
    /// Second surfaces of pixels, where edges are smoothed.
    pub edges: Option<Edges>,
    /// What is seen through, where the scene has any.
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

/// What is up to date.
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

/// What the next frame has to make.
#[derive(Clone, Copy, Default)]
pub(super) struct Outdated {
    /// Stages 1 and 2, which write the same radiance.
    pub(super) surface: bool,
    pub(super) visible: bool,
    pub(super) indirect: bool,
    pub(super) output: bool,
}

impl Picture {
    /// Makes a picture of this many pixels. A picture without any, as in a minimised window, is left out of frames.
    ///
    /// # Errors
    /// Sizes beyond the device's limits, and what it has no memory for.
    pub fn new(gpu: &Gpu, world: &World, light: &Light, size: [u32; 2]) -> Result<Self> {
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
            gbuffer: GBuffer::new(gpu, world, &plan)?,
            background: plan.sky.then(|| Background::new(gpu)).transpose()?,
            composite: Composite::new(gpu, &plan)?,
            made: MadeOfPicture::default(),
            outdated: Outdated::default(),
            size,
            plan,
            layout: world.layout,
        })
    }

    /// Rebuilds it if it no longer fits the light or the size; costs nothing otherwise.
    ///
    /// # Errors
    /// As `new`; the picture is then as it was.
    pub fn fit(&mut self, gpu: &Gpu, world: &World, light: &Light, size: [u32; 2]) -> Result<()> {
        if self.size != size || !self.fits(world, light) {
            *self = Self::new(gpu, world, light, size)?;
        }
        Ok(())
    }

    /// Whether it was made for a light as that is now.
    pub fn fits(&self, world: &World, light: &Light) -> bool {
        self.plan == light.plan && self.layout == world.layout
    }

    /// Pixels of a row, and rows.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Whether it has no pixels.
    pub fn is_empty(&self) -> bool {
        self.size.contains(&0)
    }

    /// First and second surfaces of its pixels.
    pub(super) fn surfaces(&self) -> impl Iterator<Item = &Surface> + Clone {
        [&self.surface].into_iter().chain(self.edges.as_ref().map(|edges| &edges.surface))
    }

    /// Surfaces that are seen through, nearest first.
    fn seen_through(&self) -> impl Iterator<Item = &Layer> + Clone {
        self.layers.iter().flat_map(|layers| &layers.list)
    }

    /// All surfaces of its pixels.
    pub(super) fn lit(&self) -> impl Iterator<Item = &Surface> + Clone {
        self.surfaces().chain(self.seen_through().map(|layer| &layer.surface))
    }

    /// Surfaces with short rays of their own.
    pub(super) fn near(&self) -> impl Iterator<Item = (&Surface, &NearPixels)> + Clone {
        let first = self.near.as_ref().map(|near| (&self.surface, near));
        let layers = self.seen_through().filter_map(|layer| Some((&layer.surface, layer.near.as_ref()?)));
        first.into_iter().chain(layers)
    }

    /// Surfaces with the lists of what they show.
    pub(super) fn lists(&self) -> impl Iterator<Item = (&Surface, &VisibleList)> + Clone {
        let first = self.visible.as_ref().map(|list| (&self.surface, list));
        let second = self.edges.as_ref().and_then(|edges| Some((&edges.surface, edges.visible.as_ref()?)));
        let layers = self.seen_through().filter_map(|layer| Some((&layer.surface, layer.visible.as_ref()?)));
        first.into_iter().chain(second).chain(layers)
    }

    /// Surfaces with their indirect light, and the short rays that it takes into account.
    pub(super) fn shaded(&self) -> impl Iterator<Item = (&Surface, &Radiance, Option<&NearPixels>)> + Clone {
        let near = self.near.as_ref();
        let first = self.indirect.as_ref().map(|out| (&self.surface, out, near));
        let second = self.edges.as_ref().and_then(|edges| Some((&edges.surface, edges.indirect.as_ref()?, near)));
        let own = self.seen_through();
        let own = own.filter_map(|layer| Some((&layer.surface, layer.indirect.as_ref()?, layer.near.as_ref())));
        first.into_iter().chain(second).chain(own)
    }

    /// What stage 11 reads and writes.
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
