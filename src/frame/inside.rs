//! Subsurface scattering, stages 4, 9 and 10. Light that enters translucent bodies in RSMs becomes inner VALs. These
//! light a proxy dipole at each cache of a body. The dipoles give pixels the light that leaves the body. METHOD 7,
//! thesis 5.5.

use super::atlas::Atlas;
use super::gbuffer::Surface;
use super::interpolate::Shaded;
use super::pack::PackVals;
use super::plan::Plan;
use super::proxies::Proxies;
use super::vals::Vals;
use super::view::View;
use super::visible::VisibleList;
use super::world::World;
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Bind, Buffer, Cmd, Device, Format, Image, Pipeline, Use};
use crate::shared::{
    DIPOLE_THREADS, DipolePush, HOLLOW, INNER_RUN, InnerPush, InterpolatePush, ProxyDipole, VisibleArgs,
};

/// Stage 4: light that enters translucent bodies where lights reach them.
pub struct Inside {
    /// Share of the light that enters, index of the part from 1, and cosine at the triangle.
    pub image: Image,
    /// Inner VALs, one per texel. `material` is the part, `area` the area on the surface, `flux` the light that has
    /// entered.
    pub vals: Vals,
    pack: PackVals,
}

impl Inside {
    pub(super) fn new(gpu: &Device, side: u32, count: u32) -> Result<Self> {
        let dark = vec![0_u32; count as usize];
        Ok(Self {
            image: gpu.target("inside.entering", Format::R32G32B32A32_SFLOAT, side, side)?,
            // VALs that have no texel stay dark.
            vals: Vals { flags: gpu.buffer_from("inside.val_flags", &dark)?, ..Vals::new(gpu, "inside", count)? },
            pack: PackVals::new(gpu, false)?,
        })
    }

    /// Compacts the VALs that carry light. The VALs must be complete.
    pub(super) fn record_list(&self, cmd: &Cmd<'_>) {
        self.pack.record(cmd, &self.vals, None);
    }
}

/// Stages 9 and 10 with caches.
pub struct Dipoles {
    /// One dipole per cache; `HOLLOW` for caches outside translucent bodies.
    pub buffer: Buffer,
    gather: Pipeline,
    /// Only at vertex level.
    below: Option<Pipeline>,
    scatter: Pipeline,
}

impl Dipoles {
    /// Creates the pipelines, and dark dipoles for a world's caches.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub(super) fn new(gpu: &Device, plan: &Plan, world: &World) -> Result<Option<Self>> {
        if !plan.inside {
            return Ok(None);
        }
        let by_cells = world.cells.is_some();
        let references = world.references_each as u32;
        let hollow = ProxyDipole { filled: HOLLOW, ..ProxyDipole::default() };
        let fragment = if by_cells { "scatter_cells.frag" } else { "scatter.frag" };
        Ok(Some(Self {
            buffer: gpu.buffer_from("inside.dipoles", &vec![hollow; world.cache_count.max(1) as usize])?,
            gather: gpu.compute("dipoles.comp", &[])?,
            below: (!by_cells).then(|| gpu.compute("below.comp", &[references])).transpose()?,
            scatter: Surface::adding(gpu, fragment, &[references])?,
        }))
    }

    /// Records stage 9. VALs and proxies must be complete.
    pub(super) fn record(&self, cmd: &Cmd<'_>, world: &World, vals: &Vals, atlas: &Atlas, proxies: &Proxies) {
        let Some(filled) = world.filled.as_ref().filter(|filled| filled.count > 0) else { return };
        let lists = [&atlas.caches, &filled.caches, &filled.parts, &vals.live, &vals.live_count];
        let resources: Vec<Bind<'_>> =
            lists.into_iter().chain([&proxies.buffer, &self.buffer]).map(Bind::from).collect();
        cmd.bind(&self.gather, &resources);
        cmd.push(&DipolePush { count: filled.count });
        // Several rows of workgroups, since a single row may be too short.
        let rows = filled.count.div_ceil(ROW);
        cmd.dispatch(filled.count.min(ROW) * DIPOLE_THREADS, rows, 1);
    }

    /// Records stage 10 for views, after their indirect light.
    pub(super) fn record_pixels<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        atlas: &Atlas,
        views: impl Iterator<Item = Shaded<'a>> + Clone,
    ) {
        let Some(filled) = &world.filled else { return };
        if let Some(below) = &self.below {
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead); // positions of vertices, dipoles -> here
            for Shaded { visible, .. } in views.clone() {
                let Some(out) = &visible.below else { continue };
                let lists = [&visible.list, &world.draw_records, &world.references, &visible.args, &visible.lights];
                let more = [&atlas.caches, &filled.of_draws, &filled.parts, &self.buffer, out];
                let resources: Vec<Bind<'_>> = lists.into_iter().chain(more).map(Bind::from).collect();
                cmd.bind(below, &resources);
                cmd.dispatch_indirect(&visible.args, std::mem::offset_of!(VisibleArgs, groups_x) as u64);
            }
        }
        cmd.barrier(Use::ComputeWrite | Use::ColorWrite, Use::FragmentRead | Use::ColorWrite); // both, radiance -> here
        let reach = world.cells.as_ref().map_or(0.0, |cells| cells.reach as f32);
        for Shaded { view, surface, visible, first_proxy, .. } in views {
            let Some(resources) = self.of_pixels(world, atlas, surface, visible) else { continue };
            let radiance =
                Attachments { colors: &[Attach::keep(&surface.radiance)], depth: None, area: surface.area() };
            cmd.render(&radiance, |draw| {
                draw.bind(&self.scatter, &resources);
                let View { clip_from_world, eye, .. } = *view;
                draw.push(&InterpolatePush { clip_from_world, eye, reach, first_proxy });
                draw.draw(3);
            });
        }
    }

    /// Resources of the pass over pixels.
    fn of_pixels<'a>(
        &'a self,
        world: &'a World,
        atlas: &'a Atlas,
        surface: &'a Surface,
        visible: &'a VisibleList,
    ) -> Option<Vec<Bind<'a>>> {
        let filled = world.filled.as_ref()?;
        let mut resources = vec![Bind::from(surface.element.as_ref()?), (&world.draw_records).into()];
        match &visible.below {
            Some(below) => {
                resources.extend([world.indices(), &visible.slots, &visible.lights, below].map(Bind::from));
            }
            None => {
                let of_cells = [&world.references, world.indices(), &world.instances, &world.corners, &visible.slots];
                resources.extend(of_cells.into_iter().chain([&atlas.caches, &self.buffer]).map(Bind::from));
            }
        }
        resources.extend([Bind::from(&surface.normal), (&filled.of_draws).into(), (&filled.parts).into()]);
        Some(resources)
    }
}

/// Workgroups per row of the gather's dispatch.
const ROW: u32 = 32_768;

/// Stage 10 with brute force.
pub struct InsideBruteForce {
    pipeline: Pipeline,
}

impl InsideBruteForce {
    pub(super) fn new(gpu: &Device, plan: &Plan) -> Result<Option<Self>> {
        let make = || Ok(Self { pipeline: Surface::adding(gpu, "scatter_brute_force.frag", &[])? });
        plan.inside.then(make).transpose()
    }

    /// Records the stage for a surface of a view.
    pub(super) fn record(&self, cmd: &Cmd<'_>, world: &World, vals: &Vals, view: &View, surface: &Surface) {
        let (Some(filled), Some(element)) = (&world.filled, &surface.element) else { return };
        let View { world_from_clip, eye, .. } = *view;
        let radiance = Attachments { colors: &[Attach::keep(&surface.radiance)], depth: None, area: surface.area() };
        cmd.render(&radiance, |draw| {
            for first in (0..vals.count).step_by(INNER_RUN as usize) {
                let images = [element, &surface.depth, &surface.normal].map(Bind::from);
                let lists = [&filled.of_draws, &filled.parts, &vals.live, &vals.live_count].map(Bind::from);
                draw.bind(&self.pipeline, &images.into_iter().chain(lists).collect::<Vec<_>>());
                draw.push(&InnerPush { world_from_clip, eye, first });
                draw.draw(3);
            }
        });
    }
}
