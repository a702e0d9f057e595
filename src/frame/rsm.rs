//! Stage 4, extended RSM: draws the scene as each light sees it and turns texels into VALs. METHOD 2, thesis 5.2. Area
//! lights trace a ray per VAL, or draw from several points where rays cannot be traced.

use super::inside::Inside;
use super::live::Live;
use super::pack::PackVals;
use super::plan::Plan;
use super::revision::Made;
use super::settings::ProxyWeight;
use super::vals::Vals;
use super::world::{ByKind, LightInfo, VERTEX_PLAIN, Which, World};
use crate::error::{Error, Result};
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Cmd, Cull, Depth, Device, Format, Image, Pipeline, Raster, Shape, Use,
};
use crate::shared::{AREA_VALS_ROW, AreaValsPush, Val, ValPush};

/// How far behind a surface depth images still show what it hides, in radii of the scene: `MARGIN` of trace_images.comp.
const MARGIN: f64 = 0.01;

/// Draws an RSM per view of each light, one at a time, and turns its texels into VALs.
pub struct Rsm {
    /// World position; w is 1 where there is a surface.
    pub position: Image,
    /// Normal on the lit side, and the material.
    pub normal: Image,
    /// `rho_d`.
    pub albedo: Image,
    /// Reversed depth.
    pub depth: Image,
    /// VALs of the texels.
    pub vals: Vals,
    /// Light that enters translucent bodies; only if the scene has any.
    pub inside: Option<Inside>,
    draw: ByKind,
    to_vals: Pipeline,
    /// Traces the VALs of area lights.
    trace: Option<Pipeline>,
    pack: PackVals,
    weight: ProxyWeight,
    /// Whether lights have VALs. Otherwise only emissive surfaces have them.
    reflects: bool,
    /// Whether caches send the sky's light on. Then its lights only have VALs for light that enters bodies.
    sends_sky: bool,
}

impl Rsm {
    /// Creates pipelines and images with `side` texels a side. Lights have VALs if the plan says that they reflect. If
    /// the gather `lights_all` caches, its dispatch size depends only on the number of VALs. With `grids` the VALs of
    /// every light lie in square images, as clusters need.
    ///
    /// # Errors
    /// Fails if there are more VALs than can be numbered.
    pub fn new(
        gpu: &Device,
        world: &World,
        side: u32,
        weight: ProxyWeight,
        [lights_all, grids]: [bool; 2],
        plan: &Plan,
    ) -> Result<Self> {
        let reflects = plan.reflects;
        let n = if reflects { side.max(1) } else { 1 };
        let lights: Vec<&LightInfo> =
            lights_of(world, reflects, !plan.sends_sky || plan.inside).map(|(_, light)| light).collect();
        let count: u64 = lights.iter().map(|l| u64::from(l.views) * u64::from(l.rsm_size(n)).pow(2)).sum();
        let count = u32::try_from(count + world.emitters.len() as u64).ok().filter(|count| *count <= 1 << 25);
        let count =
            count.ok_or_else(|| Error::TooLarge("more than 33 million VALs; ask for a smaller --rsm".into()))?;
        // If there are no VALs, a dark one takes their place, since a sky may still light caches.
        let dark = [Val { area: 1.0, ..Val::default() }];
        let given = if count == 0 { &dark[..] } else { &world.emitters };
        let count = count.max(1);
        let inside = plan.inside.then(|| Inside::new(gpu, n, count)).transpose()?;
        let by_irradiance = u32::from(weight == ProxyWeight::Irradiance);
        let lobes = u32::from(plan.sends_lobes);
        let has_areas = lights.iter().any(|light| light.is_area);
        let rays = world.rays().filter(|_| plan.rays() && has_areas && !grids && inside.is_none());
        let trace = rays.map(|rays| {
            let [stack, levels, texels, holes] = rays.constants(gpu);
            gpu.compute("area_vals.comp", &[stack, levels, texels, holes, by_irradiance, lobes])
        });
        let float = Format::R32G32B32A32_SFLOAT;
        Ok(Self {
            position: gpu.target("rsm.position", float, n, n)?,
            normal: gpu.target("rsm.normal", float, n, n)?,
            albedo: gpu.target("rsm.albedo", float, n, n)?,
            depth: gpu.target("rsm.depth", Format::D32_SFLOAT, n, n)?,
            vals: Vals::with(gpu, count, given, weight)?,
            draw: world.by_kind(|kind| {
                gpu.raster(&Raster {
                    vertex: "mesh_plain.vert",
                    fragment: Some(if plan.inside { "rsm_inside.frag" } else { "rsm.frag" }),
                    shape: Shape::Triangles,
                    streams: &[VERTEX_PLAIN],
                    colors: &[Format::R32G32B32A32_SFLOAT; 4][..if plan.inside { 4 } else { 3 }],
                    blend: Blend::Replace,
                    depth: Depth::Nearest,
                    cull: Cull::None,
                    multisampled: false,
                    constants: &[kind, lobes],
                })
            })?,
            to_vals: gpu.compute(if plan.inside { "vals_inside.comp" } else { "vals.comp" }, &[by_irradiance])?,
            trace: trace.transpose()?,
            pack: PackVals::new(gpu, lights_all)?,
            inside,
            weight,
            reflects,
            sends_sky: plan.sends_sky,
        })
    }

    /// The lights that have VALs, with their indices.
    pub(super) fn lights<'a>(&self, world: &'a World) -> impl Iterator<Item = (usize, &'a LightInfo)> + use<'a> {
        lights_of(world, self.reflects, !self.sends_sky || self.inside.is_some())
    }

    /// Records the stage for the lights that are `due`; the VALs of other lights do not change. `emitters` says whether
    /// the VALs of emissive surfaces are outdated. `caches` is the list for gathers that light all caches.
    pub fn record(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        due: impl Fn(usize) -> bool,
        emitters: bool,
        caches: Option<&Live>,
    ) {
        if emitters {
            self.vals.update(cmd, &world.emitters, self.weight);
            cmd.barrier(Use::CopyWrite, Use::ComputeRead | Use::ComputeWrite);
        }
        let (mut first, mut drawn, mut traced) = (0, false, false);
        for (i, light) in self.lights(world) {
            let size = light.rsm_size(self.depth.width);
            let count = light.views * size * size;
            if !due(i) {
                first += count;
                continue;
            }
            if let (true, Some(trace), Some(rays)) = (light.is_area, &self.trace, world.rays()) {
                cmd.barrier(Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite); // ray hierarchies -> here
                let close = (MARGIN * world.radius) as f32;
                let mut resources = rays.binds(world).to_vec();
                resources.extend([&world.light_buffer, &self.vals.all, &self.vals.flags].map(Bind::from));
                cmd.bind(trace, &resources);
                cmd.push(&AreaValsPush { light: i as u32, first, count, root: rays.root, close });
                cmd.dispatch(count.min(AREA_VALS_ROW), count.div_ceil(AREA_VALS_ROW), 1);
                first += count;
                traced = true;
                continue;
            }
            for view in light.first_view..light.first_view + light.views {
                if drawn {
                    cmd.barrier(Use::ComputeRead | Use::DepthWrite, Use::ColorWrite | Use::DepthWrite); // last view was read
                }
                let inside = self.inside.as_ref();
                let colors = [&self.position, &self.normal, &self.albedo].into_iter();
                let colors: Vec<&Image> = colors.chain(inside.map(|inside| &inside.image)).collect();
                self.draw_view(cmd, world, (light, view), (&colors, &self.depth));
                if drawn {
                    cmd.barrier(Use::ColorWrite | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
                } else {
                    cmd.barrier(Use::ColorWrite, Use::ComputeRead);
                }
                let mut resources = vec![
                    (&world.light_buffer).into(),
                    (&world.view_buffer).into(),
                    (&self.position).into(),
                    (&self.normal).into(),
                    (&self.albedo).into(),
                    (&self.vals.all).into(),
                    (&self.vals.flags).into(),
                ];
                if let Some(Inside { image, vals, .. }) = inside {
                    resources.extend([Bind::from(image), (&vals.all).into(), (&vals.flags).into()]);
                }
                cmd.bind(&self.to_vals, &resources);
                let reflects = u32::from(!(light.of_sky && self.sends_sky));
                cmd.push(&ValPush { light: i as u32, view, size, first, reflects });
                cmd.dispatch(size, size, 1);
                first += size * size;
                drawn = true;
            }
        }
        if drawn || traced {
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead); // VALs, flags -> their list
        }
        self.pack.record(cmd, &self.vals, caches);
        if let Some(inside) = &self.inside {
            inside.record_list(cmd);
        }
    }

    /// Whether this light has RSMs. Lights whose VALs are traced have none, nor have those without VALs.
    pub fn draws(&self, world: &World, light: usize) -> bool {
        let is_traced = |info: &LightInfo| info.is_area && self.trace.is_some();
        self.lights(world).any(|(i, info)| i == light && !is_traced(info))
    }

    /// Draws the scene as a view of a light sees it into these images: position, normal, albedo and, if light enters
    /// bodies, its share; and depth.
    fn draw_view(
        &self,
        cmd: &Cmd<'_>,
        world: &World,
        (light, view): (&LightInfo, u32),
        (colors, depth): (&[&Image], &Image),
    ) {
        let size = light.rsm_size(depth.width);
        let attachments = Attachments {
            colors: &colors.iter().map(|image| Attach::clear(image)).collect::<Vec<_>>(),
            depth: Some(Attach::clear(depth)),
            area: [0, 0, size, size],
        };
        let (clip, eye) = (world.clip_from_world(view), world.eye(light, view));
        let filled = world.filled.as_ref().filter(|_| self.inside.is_some());
        let more: Vec<Bind<'_>> = filled.map_or(Vec::new(), |f| vec![(&f.of_draws).into(), (&f.parts).into()]);
        cmd.render(&attachments, |draw| {
            world.draw_large(draw, &self.draw, (Which::All, &more), (clip, eye), light.least(size));
        });
    }
}

/// A copy of one view's RSM, to look at. Stage 4 draws all views into the same images, one after another, and keeps only
/// the VALs. So this view is drawn again.
pub struct RsmCopy {
    /// As `Rsm::position`.
    pub position: Image,
    /// As `Rsm::normal`.
    pub normal: Image,
    /// As `Rsm::albedo`.
    pub albedo: Image,
    /// As `Rsm::depth`.
    pub depth: Image,
    /// As `Inside::image`.
    pub inside: Option<Image>,
    made: Made,
}

impl RsmCopy {
    /// Creates images like those of stage 4.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn new(gpu: &Device, rsm: &Rsm) -> Result<Self> {
        let target = |name, like: &Image| gpu.target(name, like.format, like.width, like.height);
        Ok(Self {
            position: target("rsm.copy_position", &rsm.position)?,
            normal: target("rsm.copy_normal", &rsm.normal)?,
            albedo: target("rsm.copy_albedo", &rsm.albedo)?,
            depth: target("rsm.copy_depth", &rsm.depth)?,
            inside: rsm.inside.as_ref().map(|inside| target("rsm.copy_inside", &inside.image)).transpose()?,
            made: Made::default(),
        })
    }

    /// Whether the images are like those of this stage 4.
    pub fn fits(&self, rsm: &Rsm) -> bool {
        self.depth.width == rsm.depth.width && self.inside.is_some() == rsm.inside.is_some()
    }

    /// Draws a view of a light, counted from 0, unless the images already have it. To be recorded after stage 4. Returns
    /// whether anything was drawn: then a barrier must follow before the images are read.
    ///
    /// # Panics
    /// Panics if the images do not fit, or there is no such light or view.
    pub fn record(&mut self, cmd: &Cmd<'_>, world: &World, rsm: &Rsm, (light, view): (usize, u32)) -> bool {
        assert!(self.fits(rsm), "images of another size or number than those of stage 4");
        let info = &world.lights()[light];
        assert!(view < info.views, "view {view} of {}", info.views);
        let of_light = [world.revisions.surfaces, world.revisions.lights[light]];
        if !self.made.renew(of_light.into_iter().chain([light as u64, view.into()])) {
            return false;
        }
        let colors: Vec<&Image> =
            [&self.position, &self.normal, &self.albedo].into_iter().chain(&self.inside).collect();
        rsm.draw_view(cmd, world, (info, info.first_view + view), (&colors, &self.depth));
        true
    }
}

/// The lights, with their indices, if any have VALs; those that represent the sky only with `sky`.
fn lights_of(world: &World, reflects: bool, sky: bool) -> impl Iterator<Item = (usize, &LightInfo)> {
    world.lights().iter().enumerate().filter(move |(_, light)| reflects && (sky || !light.of_sky))
}
