//! Stage 2, direct light: adds shadowed light to the radiance of the G-buffer's surfaces. METHOD 1 and 14. Lights are
//! handled one by one, with rays from the visible surfaces or with shadow maps. If maps are kept between frames, each
//! light has its own. Otherwise all lights share one map, and all views use it before the next light is drawn. An area
//! light has one map for each of its samples.

use super::gbuffer::Surface;
use super::ggx_area;
use super::light_rays::LightRays;
use super::plan::Plan;
use super::view::View;
use super::world::{ByKind, LightInfo, VERTEX_PLACE, VERTEX_PLAIN, Which, World};
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cmd, Cull, Depth, Device, Draw, Format, Image, Pipeline, Raster, Shape,
    Use,
};
use crate::shared::{AreaPush, LightWork, ScreenPush};
use glam::Vec4;
use std::mem::offset_of;

/// Shadows and shading of direct light.
pub struct Direct {
    hidden: Hidden,
    /// Only with punctual lights.
    shade: Option<Pipeline>,
    /// Only with area lights: the pipeline, and the table of `lib/ggx_area.glsl`.
    shade_area: Option<(Pipeline, Buffer)>,
    /// Whether caches see the sky, so that no light represents it here.
    sky_light: bool,
}

/// How shadows are computed.
enum Hidden {
    Maps(Box<Maps>),
    Rays(LightRays),
}

/// Shadow maps.
struct Maps {
    /// One map per light if they are kept from frame to frame, otherwise one for all. The faces of a six-view light
    /// tile it three by two.
    images: Vec<Image>,
    opaque: ByKind,
    masked: ByKind,
}

/// Maximum size of maps that are kept \[bytes\].
const MOST_KEPT: u64 = 512 << 20;

impl Maps {
    fn new(gpu: &Device, world: &World, side: u32, keep: bool) -> Result<Self> {
        let depth_only = Raster {
            vertex: "mesh_depth.vert",
            fragment: None,
            shape: Shape::Triangles,
            streams: &[VERTEX_PLACE],
            colors: &[],
            blend: Blend::Replace,
            depth: Depth::Nearest,
            cull: Cull::None,
            multisampled: false,
            constants: &[],
        };
        let with_holes = Raster {
            vertex: "mesh_plain.vert",
            fragment: Some("shadow_mask.frag"),
            streams: &[VERTEX_PLAIN],
            ..depth_only
        };
        let lights = world.lights().len().max(1);
        let kept = keep && 4 * u64::from(side).pow(2) * lights as u64 <= MOST_KEPT;
        let image = |_| gpu.target("direct.shadow", Format::D32_SFLOAT, side, side);
        Ok(Self {
            images: (0..if kept { lights } else { 1 }).map(image).collect::<Result<_>>()?,
            opaque: world.by_kind(|_| gpu.raster(&depth_only))?,
            masked: world.by_kind(|kind| gpu.raster(&Raster { constants: &[kind], ..with_holes }))?,
        })
    }

    /// Whether every light has its own map.
    fn are_kept(&self, world: &World) -> bool {
        self.images.len() == world.lights().len()
    }

    /// The map of a light.
    fn image(&self, light: usize) -> &Image {
        &self.images[light.min(self.images.len() - 1)]
    }

    /// Draws the map of a light.
    fn record(&self, cmd: &Cmd<'_>, world: &World, (i, light): (usize, &LightInfo)) {
        let Self { opaque, masked, .. } = self;
        let image = self.image(i);
        let size = light.shadow_size(image.width);
        let depth =
            Attachments { colors: &[], depth: Some(Attach::clear(image)), area: [0, 0, image.width, image.height] };
        cmd.render(&depth, |draw| {
            for face in 0..light.views {
                let [x, y] = light.tile(face);
                draw.area([x * size, y * size, size, size]);
                let clip = world.clip_from_world(light.first_view + face);
                let (least, view) = (light.least(size), (clip, Vec4::ZERO));
                world.draw_large(draw, opaque, (Which::Opaque, &[]), view, least);
                world.draw_large(draw, masked, (Which::Masked, &[]), view, least);
            }
        });
    }
}

impl Direct {
    /// Creates the pipelines and, if shadows use maps, maps with `side` texels a side. `keep` asks for maps that last
    /// across frames in which lights and surfaces do not change.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, world: &World, plan: &Plan, (side, keep): (u32, bool)) -> Result<Self> {
        let used = |light: &&LightInfo| !(plan.sky_light && light.of_sky);
        let has = |area| world.lights().iter().filter(used).any(|light| light.is_area == area);
        let points = plan.antialiasing.points();
        let (hidden, shade, shade_area) = if plan.light_rays {
            let names = if plan.coated {
                ["direct_rays_coat.frag", "direct_area_rays_coat.frag"]
            } else {
                ["direct_rays.frag", "direct_area_rays.frag"]
            };
            (Hidden::Rays(LightRays::new(gpu, world, plan)?), (names[0], &[][..]), names[1])
        } else {
            let names = if plan.coated {
                ["direct_coat.frag", "direct_area_coat.frag"]
            } else {
                ["direct.frag", "direct_area.frag"]
            };
            (Hidden::Maps(Box::new(Maps::new(gpu, world, side, keep)?)), (names[0], &[points][..]), names[1])
        };
        let vertex = if plan.light_rays { "tiles.vert" } else { "screen.vert" };
        Ok(Self {
            hidden,
            shade: has(false).then(|| Surface::adding_over(gpu, vertex, shade.0, shade.1)).transpose()?,
            shade_area: has(true)
                .then(|| {
                    let table = gpu.buffer_from("direct.ggx_area", &ggx_area::TABLE)?;
                    Ok((Surface::adding_over(gpu, vertex, shade_area, &[])?, table))
                })
                .transpose()?,
            sky_light: plan.sky_light,
        })
    }

    /// Records the stage for views and their surfaces. If maps are kept, only those of lights that are `due` are drawn.
    pub fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        due: impl Fn(usize) -> bool,
        views: impl Iterator<Item = (&'a View, &'a Surface)> + Clone,
    ) {
        let used = |(_, light): &(usize, &LightInfo)| !(self.sky_light && light.of_sky);
        let lights = || world.lights().iter().enumerate().filter(used);
        if let Hidden::Maps(maps) = &self.hidden
            && maps.are_kept(world)
        {
            for light in lights().filter(|(i, _)| due(*i)) {
                maps.record(cmd, world, light);
            }
            if lights().next().is_some() {
                cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::FragmentRead | Use::ColorWrite);
            }
            return self.record_shading(cmd, world, lights, views);
        }
        for (n, light) in lights().enumerate() {
            self.record_next(cmd, world, (light, n == 0), views.clone());
        }
    }

    /// Records the stage for one light alone. A map that is kept must be up to date.
    pub(super) fn record_light<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        light: usize,
        views: impl Iterator<Item = (&'a View, &'a Surface)> + Clone,
    ) {
        let Some(info) = world.lights().get(light).filter(|info| !(self.sky_light && info.of_sky)) else { return };
        match &self.hidden {
            Hidden::Maps(maps) if maps.are_kept(world) => {
                self.record_shading(cmd, world, || std::iter::once((light, info)), views);
            }
            _ => self.record_next(cmd, world, ((light, info), true), views),
        }
    }

    /// Finds the share of a light that arrives, and adds the light.
    fn record_next<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        ((i, light), is_first): ((usize, &LightInfo), bool),
        views: impl Iterator<Item = (&'a View, &'a Surface)> + Clone,
    ) {
        match &self.hidden {
            Hidden::Maps(maps) => {
                if !is_first {
                    cmd.barrier(Use::FragmentRead, Use::DepthWrite); // the previous light's map has been read
                }
                maps.record(cmd, world, (i, light));
                cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::FragmentRead | Use::ColorWrite);
            }
            Hidden::Rays(rays) => {
                if is_first {
                    rays.record_tiles(cmd, views.clone());
                } else {
                    // The last light's shading has read its rays and lists.
                    let shaded = Use::FragmentRead | Use::VertexRead | Use::IndirectRead | Use::ComputeRead;
                    cmd.barrier(shaded, Use::CopyWrite | Use::ComputeRead | Use::ComputeWrite);
                }
                rays.record(cmd, world, (i, light), views.clone());
                let drawn = if is_first { Use::ColorWrite | Use::DepthWrite } else { Use::ColorWrite };
                let shades = Use::FragmentRead | Use::VertexRead | Use::IndirectRead | Use::ColorWrite;
                cmd.barrier(drawn | Use::ComputeWrite, shades);
            }
        }
        self.record_shading(cmd, world, || std::iter::once((i, light)), views);
    }

    /// The shadow map of a light, if it keeps one of its own. `LightInfo` says where its views lie in it.
    pub fn shadow_map(&self, world: &World, light: usize) -> Option<&Image> {
        match &self.hidden {
            Hidden::Maps(maps) if maps.are_kept(world) => {
                let is_drawn = |info: &LightInfo| !(self.sky_light && info.of_sky);
                maps.images.get(light).filter(|_| world.lights().get(light).is_some_and(is_drawn))
            }
            _ => None,
        }
    }

    /// Adds the light that views' surfaces reflect from these lights.
    fn record_shading<'a, 'l, Lights: Iterator<Item = (usize, &'l LightInfo)>>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        lights: impl Fn() -> Lights,
        views: impl Iterator<Item = (&'a View, &'a Surface)>,
    ) {
        let shaded = || lights().filter_map(|(i, light)| Some((i, light, self.shading(light)?)));
        for (view, surface) in views.filter(|_| shaded().next().is_some()) {
            let radiance =
                Attachments { colors: &[Attach::keep(&surface.radiance)], depth: None, area: surface.area() };
            cmd.render(&radiance, |draw| {
                for (i, light, shade) in shaded() {
                    self.shade(draw, world, (i, light), shade, (view, surface));
                }
            });
        }
    }

    /// The pipeline that adds a light.
    fn shading(&self, light: &LightInfo) -> Option<&Pipeline> {
        if light.is_area { self.shade_area.as_ref().map(|(pipeline, _)| pipeline) } else { self.shade.as_ref() }
    }

    /// Adds the light that a view's surfaces reflect from one light.
    fn shade(
        &self,
        draw: &Draw<'_, '_>,
        world: &World,
        (i, light): (usize, &LightInfo),
        shade: &Pipeline,
        (view, surface): (&View, &Surface),
    ) {
        let (first, second, size): (Bind<'_>, Option<Bind<'_>>, u32) = match &self.hidden {
            Hidden::Maps(maps) => {
                let image = maps.image(i);
                ((&world.view_buffer).into(), Some(image.into()), light.shadow_size(image.width))
            }
            Hidden::Rays(_) => match &surface.arrivals {
                Some(arrivals) => ((&arrivals.pixels).into(), None, 1),
                None => return,
            },
        };
        let mut resources = vec![Bind::from(&world.light_buffer), first];
        resources.extend([&surface.depth, &surface.normal, &surface.albedo, &surface.specular].map(Bind::from));
        resources.extend(second);
        resources.extend(surface.coat.as_ref().map(Bind::from));
        resources.extend(surface.arrivals.as_ref().map(|arrivals| Bind::from(&arrivals.lit)));
        resources.extend(self.shade_area.as_ref().filter(|_| light.is_area).map(|(_, table)| Bind::from(table)));
        draw.bind(shade, &resources);
        let View { world_from_clip, eye, .. } = *view;
        let light_number = i as u32;
        if light.is_area {
            let columns = light.columns();
            draw.push(&AreaPush { world_from_clip, eye, light: light_number, face_size: size, columns });
        } else {
            draw.push(&ScreenPush { world_from_clip, eye, light: light_number, shadow_size: size, first_val: 0 });
        }
        match &surface.arrivals {
            Some(arrivals) => draw.draw_indirect(&arrivals.lit_work, offset_of!(LightWork, vertices) as u64),
            None => draw.draw(3),
        }
    }
}
