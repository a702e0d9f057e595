//! Stage 8, before layers are mixed: what bodies of glass show. Rays follow the light through them. METHOD 15.

use super::gbuffer::Surface;
use super::interpolate::Radiance;
use super::light::Light;
use super::near::SEEN_LIFT;
use super::plan::Plan;
use super::view::View;
use super::world::World;
use crate::error::{Error, Result};
use crate::gpu::{Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Device, Format, Image, Pipeline, Raster, Shape};
use crate::shared::RefractPush;

/// Shows what is behind bodies of glass.
pub(super) struct Refract {
    draw: Pipeline,
}

/// Light behind a layer, which the pass replaces where the layer bends light.
pub(super) struct Behind<'a> {
    pub(super) direct: &'a Image,
    pub(super) indirect: Option<&'a Radiance>,
}

impl Refract {
    /// Creates the pass that a plan needs. The world must have rays.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub(super) fn new(gpu: &Device, world: &World, plan: &Plan) -> Result<Option<Self>> {
        if !plan.refracts {
            return Ok(None);
        }
        let rays = world.rays().ok_or_else(|| Error::Nothing("the world has no rays".into()))?;
        let [stack, levels, texels, holes] = rays.constants(gpu);
        let by_cells = u32::from(world.references_of_pixels().is_some());
        let constants = [stack, levels, texels, holes, world.references_each as u32, by_cells];
        let lit = plan.bounces > 0;
        let lobes = if plan.indirect() { 1 + usize::from(plan.glossy) } else { 0 };
        let fragment = match (lit, plan.sky_light) {
            (false, _) => "refract.frag",
            (true, false) => "refract_lit.frag",
            (true, true) => "refract_lit_sky.frag",
        };
        let draw = gpu.raster(&Raster {
            vertex: "screen.vert",
            fragment: Some(fragment),
            shape: Shape::Triangles,
            streams: &[],
            colors: &[Format::R32G32B32A32_SFLOAT; 3][..1 + lobes],
            blend: Blend::Replace,
            depth: Depth::None,
            cull: Cull::None,
            multisampled: false,
            constants: &constants[..if lit { 6 } else { 4 }],
        })?;
        Ok(Some(Self { draw }))
    }

    /// Records the pass for a layer's surface and the share of light that passes through it. Earlier barriers must have
    /// waited for the layer, the light behind it and the light of caches.
    pub(super) fn record(
        &self,
        cmd: &Cmd<'_>,
        (world, light): (&World, &Light),
        view: &View,
        (surface, through): (&Surface, &Image),
        behind: &Behind<'_>,
    ) {
        let Some(rays) = world.rays() else { return };
        let caches = light.caches();
        let none = Bind::from(&world.light_buffer);
        let [b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11] = rays.binds(world);
        let atlas = caches.map(|caches| &caches.atlas.caches);
        let cells = world.cells.as_ref().map(|c| [&c.grids, &c.entries].map(Bind::from));
        let [grids, entries] = cells.unwrap_or([none; 2]);
        let seen = caches.and_then(|caches| caches.sky.as_ref()).map(|(of_caches, _)| &of_caches.seen);
        #[rustfmt::skip]
        let all: [Bind<'_>; 28] = [
            b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, // 0
            (&world.light_buffer).into(), // 12
            (&surface.depth).into(), (&surface.normal).into(), (&surface.albedo).into(), (&surface.specular).into(), // 13
            through.into(), world.sky.as_ref().map_or(none, |sky| (&sky.texels).into()), // 17
            atlas.map_or(none, Bind::from), (&world.references).into(), (&world.instance_caches).into(), // 19
            grids, entries, atlas.map_or(none, Bind::SomeTexels), // 22
            caches.and_then(|caches| caches.gather.cache_vals()).map_or(none, Bind::from), // 25
            world.cache_albedos().map_or(none, Bind::from), seen.map_or(none, Bind::from), // 26
        ];
        let used: Vec<_> = self.draw.bindings().map(|i| all[i as usize]).collect();
        let glossy = behind.indirect.and_then(|indirect| indirect.glossy.as_ref());
        let colors = [Some(behind.direct), behind.indirect.map(|indirect| &indirect.diffuse), glossy];
        let colors: Vec<_> = colors.into_iter().flatten().map(Attach::keep).collect();
        let sky_lights = if seen.is_some() && light.plan.bounces > 0 { world.sky_lights() } else { 0..0 };
        let (sky_width, sky_height, sky_turn) =
            world.sky.as_ref().map_or((0, 0, 0.0), |sky| (sky.width, sky.height, sky.turn));
        cmd.render(&Attachments { colors: &colors, depth: None, area: surface.area() }, |draw| {
            draw.bind(&self.draw, &used);
            draw.push(&RefractPush {
                world_from_clip: view.world_from_clip,
                eye: view.eye,
                root: rays.root,
                light_count: world.lights().len() as u32,
                first_sky_light: sky_lights.start,
                sky_light_count: sky_lights.len() as u32,
                cache_reach: world.cells.as_ref().map_or(world.spacing(), |cells| cells.reach) as f32,
                seen_lift: (SEEN_LIFT * world.spacing()) as f32,
                sky_width,
                sky_height,
                sky_turn,
            });
            draw.draw(3);
        });
    }
}
