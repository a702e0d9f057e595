//! Stage 2, direct light: G-buffer, what hides lights -> radiance. METHOD 1 and 14. Light by light: rays from what pixels show,
//! or one shadow map for all lights, which all views use before the next light is drawn. An area light has a map for each of
//! its samples.

use super::gbuffer::Surface;
use super::plan::Plan;
use super::view::View;
use super::world::{LightInfo, VERTEX, Which, World};
use crate::error::{Error, Result};
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Format, Gpu, Image, Pipeline, Raster, Shape, Use,
};
use crate::shared::{AreaPush, LightRaysPush, ScreenPush};
use glam::Vec4;

/// What hides lights, and shading by them.
pub struct Direct {
    hidden: Hidden,
    /// Only with punctual lights.
    shade: Option<Pipeline>,
    /// Only with area lights.
    shade_area: Option<Pipeline>,
    /// Whether caches see the sky, so that no light stands for it here.
    sky_light: bool,
    /// Whether pixels have more points than their middle.
    edges: bool,
    /// Whether what pixels show has been waited for.
    waited: bool,
}

/// What tells where light arrives.
enum Hidden {
    Maps(Box<Maps>),
    Rays(Pipeline),
}

/// Shadow maps.
struct Maps {
    /// Of one light at a time; six-view lights tile it three by two.
    image: Image,
    opaque: Pipeline,
    masked: Pipeline,
}

impl Maps {
    fn new(gpu: &Gpu, side: u32) -> Result<Self> {
        let depth_only = Raster {
            vertex: "mesh.vert",
            fragment: None,
            shape: Shape::Triangles,
            streams: &[VERTEX],
            colors: &[],
            blend: Blend::Replace,
            depth: Depth::Nearest,
            cull: Cull::None,
            constants: &[],
        };
        Ok(Self {
            image: gpu.target("direct.shadow", Format::D32_SFLOAT, side, side)?,
            opaque: gpu.raster(&depth_only)?,
            masked: gpu.raster(&Raster { fragment: Some("shadow_mask.frag"), ..depth_only })?,
        })
    }

    /// Draws the map of a light.
    fn record(&self, cmd: &Cmd<'_>, world: &World, light: &LightInfo) {
        let Self { image, opaque, masked } = self;
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
    /// Makes the pipelines, and a shadow map with this many texels a side where maps hide lights.
    ///
    /// # Errors
    /// What the device has no memory for, and a driver that refuses the shaders.
    pub fn new(gpu: &Gpu, world: &World, plan: &Plan, side: u32) -> Result<Self> {
        let used = |light: &&LightInfo| !(plan.sky_light && light.of_sky);
        let has = |area| world.lights().iter().filter(used).any(|light| light.is_area == area);
        let samples = plan.antialiasing.samples();
        let (hidden, shade, shade_area) = if plan.light_rays {
            let rays = world.rays().ok_or_else(|| Error::Nothing("the world has no rays".into()))?;
            let [stack, levels, texels, holes] = rays.constants(gpu);
            let steps = gpu.coarse_subpixels().unwrap_or(0);
            let trace = gpu.compute("light_rays.comp", &[stack, levels, texels, holes, samples, steps])?;
            let names = if plan.coated {
                ["direct_rays_coat.frag", "direct_area_rays_coat.frag"]
            } else {
                ["direct_rays.frag", "direct_area_rays.frag"]
            };
            (Hidden::Rays(trace), (names[0], &[][..]), names[1])
        } else {
            let names = if plan.coated {
                ["direct_coat.frag", "direct_area_coat.frag"]
            } else {
                ["direct.frag", "direct_area.frag"]
            };
            (Hidden::Maps(Box::new(Maps::new(gpu, side)?)), (names[0], &[samples][..]), names[1])
        };
        Ok(Self {
            hidden,
            shade: has(false).then(|| Surface::adding(gpu, shade.0, shade.1)).transpose()?,
            shade_area: has(true).then(|| Surface::adding(gpu, shade_area, &[])).transpose()?,
            sky_light: plan.sky_light,
            edges: samples > 0,
            waited: samples > 0 && plan.layers == 0,
        })
    }

    /// Records the stage for views and what they see of surfaces.
    pub fn record<'a>(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        views: impl Iterator<Item = (&'a View, &'a Surface)> + Clone,
    ) {
        let used = |(_, light): &(usize, &LightInfo)| !(self.sky_light && light.of_sky);
        let mut is_first = true;
        for (i, light) in world.lights().iter().enumerate().filter(used) {
            match &self.hidden {
                Hidden::Maps(maps) => {
                    if !is_first {
                        cmd.barrier(Use::FragmentRead, Use::DepthWrite); // the last light's map has been read
                    }
                    maps.record(cmd, world, light);
                    cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::FragmentRead | Use::ColorWrite);
                }
                Hidden::Rays(trace) => {
                    if !is_first {
                        cmd.barrier(Use::FragmentRead, Use::ComputeRead | Use::ComputeWrite); // what arrives of the last light has been read
                    } else if !self.waited {
                        cmd.barrier(Use::ColorWrite | Use::DepthWrite | Use::ComputeWrite, Use::ComputeRead);
                    }
                    record_rays(cmd, world, (i as u32, true), trace, views.clone());
                    if self.edges || light.is_soft {
                        cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                        record_rays(cmd, world, (i as u32, false), trace, views.clone());
                    }
                    let drawn = if is_first { Use::ColorWrite | Use::DepthWrite } else { Use::ColorWrite };
                    cmd.barrier(drawn | Use::ComputeWrite, Use::FragmentRead | Use::ColorWrite);
                }
            }
            is_first = false;
            let Some(shade) = (if light.is_area { &self.shade_area } else { &self.shade }) else { continue };
            for (view, surface) in views.clone() {
                self.record_shading(cmd, world, (i as u32, light), shade, (view, surface));
            }
        }
    }

    /// Adds what a view's surfaces reflect of a light.
    fn record_shading(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        (i, light): (u32, &LightInfo),
        shade: &Pipeline,
        (view, surface): (&View, &Surface),
    ) {
        let radiance = Attachments { colors: &[Attach::keep(&surface.radiance)], depth: None, area: surface.area() };
        let (hides, size): (Vec<Bind<'_>>, u32) = match &self.hidden {
            Hidden::Maps(maps) => {
                (vec![(&world.view_buffer).into(), (&maps.image).into()], light.shadow_size(maps.image.width))
            }
            Hidden::Rays(_) => (surface.arriving.iter().map(Bind::from).collect(), 1),
        };
        cmd.render(&radiance, |draw| {
            let mut resources = vec![Bind::from(&world.light_buffer), hides[0]];
            resources.extend([&surface.depth, &surface.normal, &surface.albedo, &surface.specular].map(Bind::from));
            resources.extend(hides.get(1));
            resources.extend(surface.coat.as_ref().map(Bind::from));
            draw.bind(shade, &resources);
            let View { world_from_clip, eye, .. } = *view;
            if light.is_area {
                draw.push(&AreaPush { world_from_clip, eye, light: i, face_size: size, columns: light.columns() });
            } else {
                draw.push(&ScreenPush { world_from_clip, eye, light: i, shadow_size: size, first_val: 0 });
            }
            draw.draw(3);
        });
    }
}

/// Finds what of a light arrives at surfaces.
fn record_rays<'a>(
    cmd: &Cmd<'_>,
    world: &World,
    (light, is_first): (u32, bool),
    trace: &Pipeline,
    views: impl Iterator<Item = (&'a View, &'a Surface)>,
) {
    let Some(rays) = world.rays() else { return };
    for (view, surface) in views {
        let Some(arriving) = &surface.arriving else { continue };
        let mut resources = rays.binds(world).to_vec();
        resources.push((&world.light_buffer).into());
        resources.extend([&surface.depth, &surface.normal, &surface.albedo, &surface.specular].map(Bind::from));
        resources.push(arriving.into());
        cmd.bind(trace, &resources);
        let View { world_from_clip, eye, .. } = *view;
        cmd.push(&LightRaysPush {
            world_from_clip,
            eye,
            light,
            root: rays.root,
            is_first: u32::from(is_first),
            is_second: u32::from(surface.is_second),
        });
        let [width, height] = surface.size;
        cmd.dispatch(width, height, 1);
    }
}
