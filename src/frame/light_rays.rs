//! Stage 2, first part: rays from pixels to lights. METHOD 14. Every pixel that a light can reach has one ray. Pixels
//! whose neighbours' rays differ are listed and have more. Only tiles of pixels with a surface, and only tiles that the
//! light reaches, are worked on.

use super::arrivals::Arrivals;
use super::gbuffer::Surface;
use super::plan::Plan;
use super::view::View;
use super::world::{LightInfo, World};
use crate::error::{Error, Result};
use crate::gpu::{Bind, Cmd, Device, Pipeline, Use};
use crate::shared::LightRaysPush;

/// Traces rays from pixels to lights.
pub(super) struct LightRays {
    tiles: Pipeline,
    first: Pipeline,
    /// For lights without and with a size.
    agree: [Pipeline; 2],
    more: Pipeline,
    /// Whether pixels have more points than their centre.
    edges: bool,
    /// Whether a barrier has waited for the surfaces.
    waited: bool,
}

/// Surfaces of all views with their arrivals.
fn surfaces<'a>(
    views: impl Iterator<Item = (&'a View, &'a Surface)>,
) -> impl Iterator<Item = (&'a View, &'a Surface, &'a Arrivals)> {
    views.filter_map(|(view, surface)| Some((view, surface, surface.arrivals.as_ref()?)))
}

impl LightRays {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Fails if the world has no rays or the driver rejects the shaders.
    pub(super) fn new(gpu: &Device, world: &World, plan: &Plan) -> Result<Self> {
        let rays = world.rays().ok_or_else(|| Error::Nothing("the world has no rays".into()))?;
        let [stack, levels, texels, holes] = rays.constants(gpu);
        let points = plan.antialiasing.points();
        let constants = [stack, levels, texels, holes, points, gpu.subpixels().unwrap_or(0)];
        Ok(Self {
            tiles: gpu.compute("light_tiles.comp", &[])?,
            first: gpu.compute("light_first.comp", &constants)?,
            agree: [gpu.compute("light_agree.comp", &[0])?, gpu.compute("light_agree.comp", &[1])?],
            more: gpu.compute("light_rays.comp", &constants)?,
            edges: points > 0,
            waited: points > 0 && plan.layers == 0,
        })
    }

    /// Lists the tiles of surfaces, before the first light.
    pub(super) fn record_tiles<'a>(&self, cmd: &Cmd<'_>, views: impl Iterator<Item = (&'a View, &'a Surface)> + Clone) {
        for (.., arrivals) in surfaces(views.clone()) {
            arrivals.empty(cmd, &arrivals.shown_work);
        }
        let drawn = Use::ColorWrite | Use::DepthWrite | Use::ComputeWrite;
        let from = if self.waited { Use::CopyWrite } else { Use::CopyWrite | drawn };
        cmd.barrier(from, Use::ComputeRead | Use::ComputeWrite);
        for (_, surface, arrivals) in surfaces(views) {
            let Arrivals { shown, shown_work, firsts, .. } = arrivals;
            let resources = [Bind::from(&surface.depth), shown_work.into(), shown.into(), firsts.into()];
            cmd.bind(&self.tiles, &resources);
            cmd.dispatch(surface.size[0], surface.size[1], 1);
        }
    }

    /// Finds the share of a light that arrives at surfaces. Shading may read it after a barrier.
    pub(super) fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        (number, light): (usize, &LightInfo),
        views: impl Iterator<Item = (&'a View, &'a Surface)> + Clone,
    ) {
        let Some(rays) = world.rays() else { return };
        let has_more = self.edges || light.is_soft;
        for (.., arrivals) in surfaces(views.clone()) {
            arrivals.empty(cmd, &arrivals.lit_work);
            if has_more {
                arrivals.empty(cmd, &arrivals.undecided_work);
            }
        }
        let reads = Use::ComputeRead | Use::ComputeWrite | Use::IndirectRead;
        cmd.barrier(Use::CopyWrite | Use::ComputeWrite, reads);
        let trace =
            |pipeline: &Pipeline, (view, surface, arrivals): (&View, &Surface, &Arrivals), lists: &[Bind<'_>]| {
                let mut resources = rays.binds(world).to_vec();
                resources.push((&world.light_buffer).into());
                resources.extend([&surface.depth, &surface.normal, &surface.albedo, &surface.specular].map(Bind::from));
                resources.push((&arrivals.pixels).into());
                resources.extend_from_slice(lists);
                cmd.bind(pipeline, &resources);
                let View { world_from_clip, eye, .. } = *view;
                let (light, is_second) = (number as u32, u32::from(surface.is_second));
                cmd.push(&LightRaysPush { world_from_clip, eye, light, root: rays.root, is_second });
            };
        for of @ (.., arrivals) in surfaces(views.clone()) {
            let Arrivals { shown, shown_work, lit, lit_work, firsts, .. } = arrivals;
            trace(&self.first, of, &[shown_work, shown, lit_work, lit, firsts].map(Bind::from));
            cmd.dispatch_indirect(shown_work, 0);
        }
        if !has_more {
            return;
        }
        cmd.barrier(Use::ComputeWrite, reads);
        for (.., arrivals) in surfaces(views.clone()) {
            let Arrivals { firsts, pixels, lit, lit_work, undecided, undecided_work, .. } = arrivals;
            let resources = [firsts, pixels, lit_work, lit, undecided_work, undecided].map(Bind::from);
            cmd.bind(&self.agree[usize::from(light.is_soft)], &resources);
            cmd.dispatch_indirect(lit_work, 0);
        }
        cmd.barrier(Use::ComputeWrite, reads);
        for of @ (.., arrivals) in surfaces(views) {
            trace(&self.more, of, &[&arrivals.undecided_work, &arrivals.undecided].map(Bind::from));
            cmd.dispatch_indirect(&arrivals.undecided_work, 0);
        }
    }
}
