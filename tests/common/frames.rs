//! Small worlds, whole frames of them, and what the device made on the way, as the references read it.

use std::f32::consts::FRAC_PI_2;

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3, Vec3, dvec3, vec3};
use lightskin::bake::{self, CacheSet, Density};
use lightskin::frame::{Exposure, Frame, SceneBuffers, Settings, View};
use lightskin::gpu::{Gpu, Image};
use lightskin::reference::gather::{Cache, Gathered, Lobe};
use lightskin::reference::phong::{Material as Reflection, mirrored_view};
use lightskin::reference::rsm::{self, Val};
use lightskin::reference::triangle::Triangle;
use lightskin::scene::build::{Surface, quad, sphere};
use lightskin::scene::{Camera, Instance, Light, LightKind, Material, Mesh, Phong, Primitive, Projection, Scene};
use lightskin::shared;

/// A material with an exact Phong lobe.
pub(crate) fn phong(diffuse: [f32; 3], specular: [f32; 3], exponent: f32) -> Material {
    let phong = Some(Phong { specular: specular.into(), exponent });
    Material { base_color: Vec3::from(diffuse).extend(1.0), metallic: 0.0, phong, ..Material::default() }
}

/// Adds a mesh of one surface and stands it in the world.
pub(crate) fn add(scene: &mut Scene, surface: Surface, material: Material, world_from_model: DAffine3) {
    let primitives =
        vec![Primitive { first_index: 0, index_count: surface.indices.len() as u32, material: scene.materials.len() }];
    scene.materials.push(material);
    let name = format!("mesh {}", scene.meshes.len());
    scene.instances.push(Instance { name: name.clone(), mesh: scene.meshes.len(), world_from_model });
    scene.meshes.push(Mesh { name, vertices: surface.vertices, indices: surface.indices, primitives });
}

/// A light of one kind for the worlds below.
pub(crate) fn lamp(kind: LightKind) -> Light {
    let (position, target) = match kind {
        LightKind::Point => (dvec3(0.6, 1.3, 0.6), DVec3::ZERO),
        _ => (dvec3(1.0, 1.7, 0.4), dvec3(-0.6, 0.2, -0.1)),
    };
    let intensity = if kind == LightKind::Directional { 300.0 } else { 500.0 };
    let direction = (target - position).as_vec3().normalize();
    Light { name: "lamp".into(), kind, color: vec3(1.0, 0.8, 0.5), intensity, range: None, position, direction }
}

/// A spot of 23 degrees to 34.
pub(crate) const SPOT: LightKind = LightKind::Spot { inner: 0.4, outer: 0.6 };

/// A camera that stands at `eye` and looks at `target`, +Y up in the picture.
pub(crate) fn camera(eye: DVec3, target: DVec3, yfov: f32) -> Camera {
    let back = (eye - target).normalize();
    let right = if back.cross(DVec3::Y).length() < 1e-9 { DVec3::X } else { DVec3::Y.cross(back).normalize() };
    let rotation = DMat3::from_cols(right, back.cross(right), back);
    Camera {
        name: "camera".into(),
        world_from_camera: DAffine3::from_mat3_translation(rotation, eye),
        projection: Projection::Perspective { yfov },
    }
}

/// A floor and a wall of 2 m, and above the floor a ball that its instance turns, squeezes and stretches. Every glossy
/// lobe has this exponent.
pub(crate) fn corner(lights: &[LightKind], exponent: f32) -> Scene {
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let low = vec3(-1.0, 0.0, -1.0);
    let mut scene = Scene { name: "corner".into(), ..Scene::default() };
    add(&mut scene, quad(low, z, x, 0.25), phong([0.7, 0.5, 0.3], [0.2, 0.3, 0.1], exponent), DAffine3::IDENTITY);
    add(&mut scene, quad(low, y, z, 0.25), phong([0.2, 0.6, 0.8], [0.3, 0.1, 0.1], exponent), DAffine3::IDENTITY);
    let turn = DQuat::from_axis_angle(dvec3(1.0, 2.0, 0.5).normalize(), 0.7);
    let stretch = DAffine3::from_scale_rotation_translation(dvec3(0.3, 0.4, 0.25), turn, dvec3(0.1, 0.5, -0.1));
    add(&mut scene, sphere(1.0, 8), phong([0.6, 0.6, 0.2], [0.1, 0.3, 0.2], exponent), stretch);
    scene.lights = lights.iter().copied().map(lamp).collect();
    scene.cameras.push(camera(dvec3(1.4, 1.5, 2.0), dvec3(-0.3, 0.5, -0.1), 0.8));
    scene
}

/// Caches this far apart [m].
pub(crate) fn baked(scene: &Scene, spacing: f64, references: usize) -> CacheSet {
    let settings = bake::Settings { density: Density::Spacing(spacing), angle: 0.5 * FRAC_PI_2, references };
    bake::bake(scene, &settings, &|_, _| ()).expect("bakes")
}

/// Small pictures; the references do every pixel.
pub(crate) fn small() -> Settings {
    Settings { size: [48, 48], rsm: 24, shadow_map: 256, exposure: Exposure::Ev(0.0), ..Settings::default() }
}

/// What one frame made. Places are in the world, in f64.
pub(crate) struct Shot {
    /// VALs; `Val::NOTHING` where the device gives neither flux nor weight.
    pub(crate) vals: Vec<Val>,
    /// Caches in atlas order.
    pub(crate) caches: Vec<Cache>,
    /// Their proxies, and the mirrored view that the shaders make on the fly.
    pub(crate) proxies: Vec<Gathered>,
    /// `rho_d` of every pixel, as halves keep it.
    pub(crate) albedo: Vec<DVec3>,
    /// `rho_g`, likewise.
    pub(crate) specular: Vec<DVec3>,
    /// Emitted and directly reflected radiance.
    pub(crate) direct: Vec<DVec3>,
    /// Indirect radiance; empty without a lobe.
    pub(crate) diffuse: Vec<DVec3>,
    /// The same of the glossy lobe.
    pub(crate) glossy: Vec<DVec3>,
    /// The lights' pictures as the references know them.
    pub(crate) views: Vec<rsm::View>,
}

/// Draws one frame from the scene's first camera, checks what validation and barrier check say, and reads it back.
#[track_caller]
pub(crate) fn shoot(gpu: &Gpu, scene: &Scene, caches: Option<&CacheSet>, settings: &Settings) -> Shot {
    let buffers = SceneBuffers::new(gpu, scene, caches).expect("upload");
    let frame = Frame::new(gpu, scene, &buffers, settings).expect("frame");
    let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(false, |cmd| {
        frame.record(cmd, &buffers, &view);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    let (t, origin, eye) = (&frame.targets, buffers.origin, scene.cameras[0].world_from_camera.translation);

    let mut shot = Shot {
        vals: Vec::new(),
        caches: Vec::new(),
        proxies: Vec::new(),
        albedo: halves(gpu, &t.albedo),
        specular: halves(gpu, &t.specular),
        direct: radiance(gpu, &t.direct),
        diffuse: t.indirect.as_ref().map_or(Vec::new(), |i| radiance(gpu, &i.diffuse)),
        glossy: t.indirect.as_ref().and_then(|i| i.glossy.as_ref()).map_or(Vec::new(), |image| radiance(gpu, image)),
        views: light_views(gpu, scene, &buffers),
    };
    if let Some(rsm) = &t.rsm {
        let all: Vec<shared::Val> = gpu.read(&rsm.vals).expect("VALs");
        shot.vals = all[..rsm.val_count as usize].iter().map(|v| val(v, origin)).collect();
    }
    if let Some(targets) = &t.caches {
        let n = targets.count as usize;
        let all: Vec<shared::Cache> = gpu.read(&targets.atlas).expect("caches");
        shot.caches = all[..n].iter().map(|c| cache(c, origin)).collect();
        let all: Vec<shared::Proxy> = gpu.read(&targets.proxies).expect("proxies");
        shot.proxies = all[..n].iter().zip(&shot.caches).map(|(p, c)| gathered(p, c, origin, eye)).collect();
    }
    super::assert_clean(gpu);
    shot
}

fn radiance(gpu: &Gpu, image: &Image) -> Vec<DVec3> {
    let texels: Vec<[f32; 4]> = gpu.read_image(image).expect("image");
    texels.iter().map(|t| Vec3::new(t[0], t[1], t[2]).as_dvec3()).collect()
}

fn halves(gpu: &Gpu, image: &Image) -> Vec<DVec3> {
    let texels: Vec<[u16; 4]> = gpu.read_image(image).expect("image");
    let number = |bits: u16| half::f16::from_bits(bits).to_f64();
    texels.iter().map(|t| dvec3(number(t[0]), number(t[1]), number(t[2]))).collect()
}

fn val(v: &shared::Val, origin: DVec3) -> Val {
    if v.weight == 0.0 && v.flux == Vec3::ZERO {
        return Val::NOTHING;
    }
    let (position, area) = (v.position.as_dvec3() + origin, f64::from(v.area));
    Val { position, area, normal: v.normal.as_dvec3(), flux: v.flux.as_dvec3() }
}

fn cache(c: &shared::Cache, origin: DVec3) -> Cache {
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
        glossy: lobe(p.glossy_position, p.glossy_irradiance, p.glossy_lit, 0.0),
        mirrored_view: mirrored_view(cache.position, cache.normal, eye),
    }
}

/// The device's frusta as the references' own, so that both look through the same texels. Rows run against `up`.
fn light_views(gpu: &Gpu, scene: &Scene, buffers: &SceneBuffers) -> Vec<rsm::View> {
    let views: Vec<shared::LightView> = gpu.read(&buffers.view_buffer).expect("views");
    let mut all = Vec::new();
    for (light, info) in scene.lights.iter().zip(&buffers.lights) {
        for view in &views[info.first_view as usize..(info.first_view + info.views) as usize] {
            let (right, up, forward) = (view.right.as_dvec3(), view.up.as_dvec3(), view.forward.as_dvec3().normalize());
            let parallel = light.kind == LightKind::Directional;
            all.push(rsm::View {
                origin: if parallel { buffers.origin - 2.0 * buffers.radius * forward } else { light.position },
                right: right.normalize(),
                up: up.normalize(),
                forward,
                half: DVec2::new(right.length(), up.length()),
                parallel,
            });
        }
    }
    all
}

/// World-space corners and normals of every triangle with its instance, for the references. Normals are interpolated in
/// the model, as those of caches are, and then transformed: the corners' keep the lengths that the transform gives them.
pub(crate) fn triangles(scene: &Scene) -> Vec<(Triangle, usize)> {
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
            let diffuse = reflection(scene, material).diffuse;
            all.push((Triangle { positions, normals, diffuse }, i));
        }
    }
    all
}

/// What a material without textures reflects.
pub(crate) fn reflection(scene: &Scene, material: usize) -> Reflection {
    let material = &scene.materials[material];
    let lobe = material.phong.unwrap_or(Phong { specular: Vec3::ZERO, exponent: 1.0 });
    let diffuse = material.base_color.truncate().as_dvec3();
    Reflection { diffuse, specular: lobe.specular.as_dvec3(), exponent: lobe.exponent.into() }
}

/// What a pixel's centre sees.
pub(crate) struct Seen {
    /// Row by row from the top.
    pub(crate) pixel: usize,
    /// Which instance.
    pub(crate) instance: usize,
    /// Which material.
    pub(crate) material: usize,
    /// Its mesh's vertices at the corners.
    pub(crate) vertices: [usize; 3],
    /// Barycentric weights of the corners.
    pub(crate) weights: [f64; 3],
    /// World position [m].
    pub(crate) position: DVec3,
    /// Shading normal.
    pub(crate) normal: DVec3,
}

/// The nearest front face at the centre of every pixel, by trying all triangles.
pub(crate) fn seen(scene: &Scene, size: [u32; 2]) -> Vec<Seen> {
    let camera = &scene.cameras[0];
    let Projection::Perspective { yfov } = camera.projection else { panic!("a pinhole") };
    let half = (0.5 * f64::from(yfov)).tan();
    let [width, height] = size.map(f64::from);
    let pose = camera.world_from_camera;
    let all = triangles(scene);
    let mut seen = Vec::new();
    for pixel in 0..size[0] as usize * size[1] as usize {
        let at = DVec2::new((pixel % size[0] as usize) as f64 + 0.5, (pixel / size[0] as usize) as f64 + 0.5);
        let ray = dvec3((2.0 * at.x / width - 1.0) * width / height, 1.0 - 2.0 * at.y / height, -1.0 / half);
        let ray = pose.matrix3 * ray;
        let mut nearest: Option<(f64, Seen)> = None;
        let mut index = 0;
        for (i, (triangle, instance)) in all.iter().enumerate() {
            index = if i > 0 && all[i - 1].1 == *instance { index + 1 } else { 0 };
            let [a, b, c] = triangle.positions;
            let face = (b - a).cross(c - a);
            let distance = (a - pose.translation).dot(face) / ray.dot(face);
            // Also false where the triangle is seen from the side.
            if !(ray.dot(face) < 0.0 && distance > 0.0) || nearest.as_ref().is_some_and(|n| n.0 < distance) {
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
                nearest = Some((
                    distance,
                    Seen { pixel, instance: *instance, material, vertices, weights, position: p, normal },
                ));
            }
        }
        seen.extend(nearest.map(|(_, s)| s));
    }
    seen
}
