//! Stage 4, extended RSM: draws the scene as each light sees it and turns texels into VALs. METHOD 2, thesis 5.2. Area
//! lights trace a ray per VAL, or draw from several points where rays cannot be traced.

use super::inside::Inside;
use super::live::Live;
use super::pack::PackVals;
use super::plan::Plan;
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
        let has_areas = lights.iter().any(|light| light.is_area);
        let rays = world.rays().filter(|_| plan.rays() && has_areas && !grids && inside.is_none());
        let trace = rays.map(|rays| {
            let [stack, levels, texels, holes] = rays.constants(gpu);
            gpu.compute("area_vals.comp", &[stack, levels, texels, holes, by_irradiance])
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
                    constants: &[kind],
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
                let images = [&self.position, &self.normal, &self.albedo];
                let images = images.into_iter().chain(inside.map(|inside| &inside.image));
                let attachments = Attachments {
                    colors: &images.clone().map(Attach::clear).collect::<Vec<_>>(),
                    depth: Some(Attach::clear(&self.depth)),
                    area: [0, 0, size, size],
                };
                let clip = world.clip_from_world(view);
                let eye = world.eye(light, view);
                let least = light.least(size);
                let filled = world.filled.as_ref().filter(|_| inside.is_some());
                let more: Vec<Bind<'_>> = filled.map_or(Vec::new(), |f| vec![(&f.of_draws).into(), (&f.parts).into()]);
                cmd.render(&attachments, |draw| {
                    world.draw_large(draw, &self.draw, (Which::All, &more), (clip, eye), least)
                });
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
}

/// The lights, with their indices, if any have VALs; those that represent the sky only with `sky`.
fn lights_of(world: &World, reflects: bool, sky: bool) -> impl Iterator<Item = (usize, &LightInfo)> {
    world.lights().iter().enumerate().filter(move |(_, light)| reflects && (sky || !light.of_sky))
}
