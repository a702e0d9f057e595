//! One frame of a small world, read back with all intermediate results in the references' types.

use crate::bake::CacheSet;
use crate::error::Result;
use crate::frame::check::Check;
use crate::frame::gather::Gather;
use crate::frame::{Exposure, LightShadows, View, World};
use crate::gpu::{Gpu, Image};
use crate::lab::knobs::{Frame, Knobs};
use crate::reference::gather::{Cache, Gathered, Lobe};
use crate::reference::phong::{Material as Reflection, mirrored_view};
use crate::reference::rsm::{self, Val};
use crate::reference::triangle::Triangle;
use crate::scene::{LightKind, Phong, Projection, Scene};
use crate::shared::{self, GatherSums, LiveArgs, TEXEL_CACHES};
use glam::{DVec2, DVec3, Vec3, Vec4, dvec3};

/// Small pictures with every cache lit; references compute every pixel.
pub fn small() -> Knobs {
    Knobs {
        rsm: 24,
        light_shadows: LightShadows::Maps(256),
        exposure: Exposure::Ev(0.0),
        cull: false,
        ..Knobs::plain([48, 48])
    }
}

/// Results of one frame. Positions are in the world, in f64.
pub struct Shot {
    /// VALs; `Val::NOTHING` for those with neither flux nor weight.
    pub vals: Vec<Val>,
    /// Caches in atlas order.
    pub caches: Vec<Cache>,
    /// Proxies, with the mirrored view that shaders compute on the fly.
    pub proxies: Vec<Gathered>,
    /// `rho_d` of every pixel, as stored in half floats.
    pub albedo: Vec<DVec3>,
    /// `rho_g`, likewise.
    pub specular: Vec<DVec3>,
    /// The surface's world position at every pixel, as shading computes it from depth.
    pub positions: Vec<DVec3>,
    /// Its shading normal.
    pub normals: Vec<DVec3>,
    /// Emitted and directly reflected radiance.
    pub direct: Vec<DVec3>,
    /// Indirect radiance of the diffuse lobe; empty without one.
    pub diffuse: Vec<DVec3>,
    /// The same for the glossy lobe.
    pub glossy: Vec<DVec3>,
    /// Whether a pixel shows a surface.
    pub covered: Vec<bool>,
    /// The gather's sums of irradiance \[lx\] at each cache: all light, and light times `cos^k`; empty without the
    /// lobe.
    pub sums: [Vec<DVec3>; 2],
    /// The lights' views in the references' types.
    pub views: Vec<rsm::View>,
    /// Steps of the rasteriser's grid along a pixel's side, if it is not exact.
    pub subpixels: Option<u32>,
    /// Complaints of the validation layer, the barrier check and the check for broken values about the frame.
    pub complaints: Vec<String>,
}

impl Shot {
    /// Distance \[m\] by which a VAL may be off the point that a ray through its texel's centre hits: a rasteriser's
    /// grid moves it by a part of the texel.
    pub fn most_moved(&self, val: &Val) -> f64 {
        if self.subpixels.is_some() { 1e-4_f64.max(0.01 * val.area.sqrt()) } else { 1e-4 }
    }
}

/// Draws one frame from the scene's first camera and reads it back.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn shoot(gpu: &Gpu, scene: &Scene, caches: Option<&CacheSet>, knobs: &Knobs) -> Result<Shot> {
    let said = gpu.messages().len();
    let world = World::new(gpu, scene, caches)?;
    let mut frame = Frame::new(gpu, scene, &world, knobs)?;
    let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &world, &view);
        Ok(())
    })?;
    let (origin, eye) = (world.origin, scene.cameras[0].world_from_camera.translation);
    let Frame { light, picture, .. } = &frame;
    let (surface, indirect) = (&picture.surface, picture.indirect.as_ref());

    let mut complaints = drawn.problems;
    for found in Check::new(gpu)?.count(gpu, light, picture)?.iter().filter(|found| found.broken > 0) {
        complaints.push(format!("{}: {} of {} values are broken", found.target, found.broken, found.values));
    }
    let depth: Vec<f32> = gpu.read_image(&surface.depth)?;
    let world_from_clip = view.world_from_clip.as_dmat4();
    let [width, height] = knobs.size.map(|side| side as usize);
    let place = |(pixel, depth): (usize, &f32)| {
        let at = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        let ndc = at / DVec2::new(width as f64, height as f64) * 2.0 - 1.0;
        origin + world_from_clip.project_point3(ndc.extend(f64::from(*depth)))
    };
    let mut shot = Shot {
        vals: Vec::new(),
        caches: Vec::new(),
        proxies: Vec::new(),
        albedo: halves(gpu, &surface.albedo)?,
        specular: halves(gpu, &surface.specular)?,
        positions: depth.iter().enumerate().map(place).collect(),
        normals: radiance(gpu, &surface.normal)?,
        direct: radiance(gpu, &surface.radiance)?,
        diffuse: indirect.map_or(Ok(Vec::new()), |i| radiance(gpu, &i.diffuse))?,
        glossy: match indirect.and_then(|i| i.glossy.as_ref()) {
            Some(image) => radiance(gpu, image)?,
            None => Vec::new(),
        },
        covered: depth.iter().map(|depth| *depth > 0.0).collect(),
        sums: Default::default(),
        views: light_views(gpu, scene, &world)?,
        subpixels: gpu.subpixels(),
        complaints: Vec::new(),
    };
    if let Some(vals) = light.vals() {
        let all: Vec<shared::Val> = gpu.read(&vals.all)?;
        shot.vals = all.iter().map(|v| val(v, origin)).collect();
    }
    if let Some(caches) = light.caches() {
        let n = caches.atlas.count as usize;
        let all: Vec<shared::Cache> = gpu.read(&caches.atlas.caches)?;
        shot.caches = all[..n].iter().map(|c| cache(c, origin)).collect();
        let all: Vec<shared::Proxy> = gpu.read(&caches.proxies.buffer)?;
        shot.proxies = all[..n].iter().zip(&shot.caches).map(|(p, c)| gathered(p, c, origin, eye)).collect();
        let sums = gather_sums(gpu, &caches.gather, caches.atlas.count)?;
        shot.sums = [
            sums.iter().map(|s| s.diffuse_irradiance.as_dvec3()).collect(),
            sums.iter().filter(|_| light.plan.lobes).map(|s| s.glossy_irradiance.as_dvec3()).collect(),
        ];
    }
    complaints.extend(gpu.messages().into_iter().skip(said));
    shot.complaints = complaints;
    Ok(shot)
}

/// The gather's sums at each of this many caches; culled caches have no light.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn gather_sums(gpu: &Gpu, gather: &Gather, count: u32) -> Result<Vec<GatherSums>> {
    let mut sums = vec![GatherSums::default(); count as usize];
    let (live, parts, bounces) = match gather {
        Gather::Compute(by) => (&by.live, &by.parts, by.bounces.as_ref()),
        Gather::Clusters(by) => (&by.live, &by.parts, None),
        Gather::Draws(by) => {
            let images: Vec<Vec<Vec4>> = by.sums.iter().map(|image| gpu.read_image(image)).collect::<Result<_>>()?;
            for (i, s) in sums.iter_mut().enumerate() {
                let of_cache = images.len() / TEXEL_CACHES as usize;
                let own = &images[i % TEXEL_CACHES as usize * of_cache..][..of_cache];
                let texel =
                    |image: usize| own.get(image).map_or(Vec4::ZERO, |texels| texels[by.texels.texel(i as u32)]);
                *s = GatherSums {
                    diffuse_position: texel(0).truncate(),
                    diffuse_weight: texel(0).w,
                    diffuse_irradiance: texel(1).truncate(),
                    distance2: texel(1).w,
                    glossy_position: texel(2).truncate(),
                    glossy_weight: texel(2).w,
                    glossy_irradiance: texel(3).truncate(),
                    glossy_distance2: texel(3).w,
                };
            }
            return Ok(sums);
        }
    };
    let (all, list): (Vec<GatherSums>, Vec<u32>) = (gpu.read(parts)?, gpu.read(&live.list)?);
    let args = gpu.read::<LiveArgs>(&live.args)?[0];
    let scales: Vec<f32> = bounces.map_or(Ok(Vec::new()), |bounces| gpu.read(&bounces.scales))?;
    let of_caches = bounces.map_or(0, |bounces| bounces.parts) as usize;
    let parts = all.chunks(sums.len().max(1)).take(of_caches + args.groups_y as usize);
    for (index, part) in parts.enumerate() {
        let items = list[..args.cache_count as usize].iter();
        let lit = items.flat_map(|item| (item * live.group)..((item + 1) * live.group).min(count));
        for (cache, p) in lit.zip(part) {
            let s = &mut sums[cache as usize];
            let scale = if index < of_caches { scales[cache as usize] } else { 1.0 };
            *s = GatherSums {
                diffuse_position: s.diffuse_position + scale * p.diffuse_position,
                diffuse_weight: s.diffuse_weight + scale * p.diffuse_weight,
                diffuse_irradiance: s.diffuse_irradiance + scale * p.diffuse_irradiance,
                distance2: s.distance2 + scale * p.distance2,
                glossy_position: s.glossy_position + scale * p.glossy_position,
                glossy_weight: s.glossy_weight + scale * p.glossy_weight,
                glossy_irradiance: s.glossy_irradiance + scale * p.glossy_irradiance,
                glossy_distance2: s.glossy_distance2 + scale * p.glossy_distance2,
            };
        }
    }
    Ok(sums)
}

/// RGB values of a float image.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn radiance(gpu: &Gpu, image: &Image) -> Result<Vec<DVec3>> {
    let texels: Vec<[f32; 4]> = gpu.read_image(image)?;
    Ok(texels.iter().map(|t| Vec3::new(t[0], t[1], t[2]).as_dvec3()).collect())
}

fn halves(gpu: &Gpu, image: &Image) -> Result<Vec<DVec3>> {
    let texels: Vec<[u16; 4]> = gpu.read_image(image)?;
    let number = |bits: u16| half::f16::from_bits(bits).to_f64();
    Ok(texels.iter().map(|t| dvec3(number(t[0]), number(t[1]), number(t[2]))).collect())
}

/// A VAL in the references' type.
pub fn val(v: &shared::Val, origin: DVec3) -> Val {
    if v.weight == 0.0 && v.flux == Vec3::ZERO {
        return Val::NOTHING;
    }
    let (position, area) = (v.position.as_dvec3() + origin, f64::from(v.area));
    Val { position, area, normal: v.normal.as_dvec3(), flux: v.flux.as_dvec3() }
}

/// A cache in the references' type.
pub fn cache(c: &shared::Cache, origin: DVec3) -> Cache {
    let (position, normal) = (c.position.as_dvec3() + origin, c.normal.as_dvec3().normalize());
    Cache { position, normal, exponent: c.exponent.into() }
}

fn gathered(p: &shared::Proxy, cache: &Cache, origin: DVec3, eye: DVec3) -> Gathered {
    let lobe = |position: Vec3, irradiance: Vec3, lit: f32, distance2: f32| Lobe {
        position: position.as_dvec3() + origin,
        facing_irradiance: irradiance.as_dvec3(),
        lit: lit > 0.0,
        distance2: distance2.into(),
    };
    Gathered {
        diffuse: lobe(p.diffuse_position, p.diffuse_irradiance, p.diffuse_distance2, p.diffuse_distance2),
        glossy: lobe(p.glossy_position, p.glossy_irradiance, p.glossy_distance2, p.glossy_distance2),
        mirrored_view: mirrored_view(cache.position, cache.normal, eye),
    }
}

/// The device's frusta in the references' type, so that both use the same texels. Rows run against `up`.
fn light_views(gpu: &Gpu, scene: &Scene, world: &World) -> Result<Vec<rsm::View>> {
    let views: Vec<shared::LightView> = gpu.read(&world.view_buffer)?;
    let mut all = Vec::new();
    for (light, info) in scene.lights.iter().zip(world.lights()) {
        for view in &views[info.first_view as usize..(info.first_view + info.views) as usize] {
            let (right, up, forward) = (view.right.as_dvec3(), view.up.as_dvec3(), view.forward.as_dvec3().normalize());
            let parallel = light.kind == LightKind::Directional;
            all.push(rsm::View {
                origin: if parallel { world.origin - 2.0 * world.radius * forward } else { light.position },
                right: right.normalize(),
                up: up.normalize(),
                forward,
                half: DVec2::new(right.length(), up.length()),
                parallel,
            });
        }
    }
    Ok(all)
}

/// World-space corners and normals of every triangle with its instance, for the references. Like those of caches,
/// normals are interpolated in model space and then transformed, so corner normals keep the lengths that the transform
/// gives them.
pub fn triangles(scene: &Scene) -> Vec<(Triangle, usize)> {
    let mut all = Vec::new();
    for (i, instance) in scene.instances.iter().enumerate() {
        let mesh = &scene.meshes[instance.mesh];
        let placed = instance.world_from_model;
        let normals = placed.matrix3.inverse().transpose();
        let materials = mesh.triangle_materials();
        for (t, material) in materials.into_iter().enumerate() {
            let corners = mesh.triangle(t).map(|v| mesh.vertices[v]);
            let positions = corners.map(|v| placed.transform_point3(v.position.as_dvec3()));
            let normals = corners.map(|v| normals * v.normal.as_dvec3());
            let diffuse = sent_on(scene, material);
            all.push((Triangle { positions, normals, diffuse }, i));
        }
    }
    all
}

/// Reflected share of light of a material without textures.
pub fn sent_on(scene: &Scene, material: usize) -> DVec3 {
    scene.materials[material].reflectance(scene, Default::default(), Vec4::ONE).sent_on().as_dvec3()
}

/// Reflectance of a material without textures.
pub fn reflection(scene: &Scene, material: usize) -> Reflection {
    let material = &scene.materials[material];
    let lobe = material.phong.unwrap_or(Phong { specular: Vec3::ZERO, exponent: 1.0 });
    let diffuse = material.reflectance(scene, Default::default(), Vec4::ONE).diffuse(1.0).as_dvec3();
    Reflection { diffuse, specular: lobe.specular.as_dvec3(), exponent: lobe.exponent.into() }
}

/// The surface at a pixel's centre.
pub struct PixelSurface {
    /// Index, row by row from the top.
    pub pixel: usize,
    /// Index of the instance.
    pub instance: usize,
    /// Index of the material.
    pub material: usize,
    /// Vertices of its mesh at the triangle's corners.
    pub vertices: [usize; 3],
    /// Barycentric weights of the corners.
    pub weights: [f64; 3],
    /// World position \[m\].
    pub position: DVec3,
    /// Shading normal.
    pub normal: DVec3,
}

/// The nearest front face at the centre of every pixel, for the scene's first (perspective) camera, by testing all
/// triangles that can cover the pixel.
pub fn seen(scene: &Scene, size: [u32; 2]) -> Vec<PixelSurface> {
    let camera = &scene.cameras[0];
    let Projection::Perspective { yfov } = camera.projection else { panic!("a pinhole") };
    let half = (0.5 * f64::from(yfov)).tan();
    let [width, height] = size.map(f64::from);
    let pose = camera.world_from_camera;
    let all = triangles(scene);
    // Pixel coordinates and distance along the view [m] of a point.
    let camera_from_world = pose.inverse();
    let on_screen = |p: DVec3| {
        let p = camera_from_world.transform_point3(p);
        let at = DVec2::new(p.x * height / width, -p.y) / (half * -p.z);
        ((at + 1.0) * 0.5 * DVec2::new(width, height), -p.z)
    };
    let mut nearest: Vec<Option<(f64, PixelSurface)>> = (0..size[0] * size[1]).map(|_| None).collect();
    let mut index = 0;
    for (i, (triangle, instance)) in all.iter().enumerate() {
        index = if i > 0 && all[i - 1].1 == *instance { index + 1 } else { 0 };
        let [a, b, c] = triangle.positions;
        let face = (b - a).cross(c - a);
        // Pixels that the triangle can cover: all of them if a corner is beside or behind the eye.
        let corners = [a, b, c].map(on_screen);
        let (mut low, mut high) = (DVec2::ZERO, DVec2::new(width, height));
        if corners.iter().all(|corner| corner.1 > 0.0) {
            low = corners.iter().fold(high, |low, corner| low.min(corner.0)).max(DVec2::ONE) - 1.0;
            high = corners.iter().fold(DVec2::ZERO, |high, corner| high.max(corner.0 + 1.0)).min(high);
        }
        let columns = low.x as usize..high.x.ceil() as usize;
        for (row, column) in (low.y as usize..high.y.ceil() as usize).flat_map(|y| columns.clone().map(move |x| (y, x)))
        {
            let pixel = row * size[0] as usize + column;
            let at = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
            let ray = dvec3((2.0 * at.x / width - 1.0) * width / height, 1.0 - 2.0 * at.y / height, -1.0 / half);
            let ray = pose.matrix3 * ray;
            let distance = (a - pose.translation).dot(face) / ray.dot(face);
            // Mirroring flips the winding. Also fails for triangles seen edge-on.
            let front = ray.dot(face) * scene.instances[*instance].world_from_model.matrix3.determinant();
            if !(front < 0.0 && distance > 0.0) || nearest[pixel].as_ref().is_some_and(|n| n.0 < distance) {
                continue;
            }
            let p = pose.translation + distance * ray;
            let part = |u: DVec3, v: DVec3| (u - p).cross(v - p).dot(face) / face.length_squared();
            let weights = [part(b, c), part(c, a), part(a, b)];
            if weights.iter().all(|&w| w >= 0.0) {
                let [na, nb, nc] = triangle.normals;
                let normal = (weights[0] * na + weights[1] * nb + weights[2] * nc).normalize();
                let mesh = &scene.meshes[scene.instances[*instance].mesh];
                let (vertices, material) = (mesh.triangle(index), mesh.triangle_materials()[index]);
                nearest[pixel] = Some((
                    distance,
                    PixelSurface { pixel, instance: *instance, material, vertices, weights, position: p, normal },
                ));
            }
        }
    }
    nearest.into_iter().flatten().map(|(_, surface)| surface).collect()
}
