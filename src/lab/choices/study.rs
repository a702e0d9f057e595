//! A scene prepared for studies: pixels, their vertices, caches, VALs and the ground truth, all in f64 on the CPU.

use std::collections::HashMap;

use glam::{DVec3, Vec4};
use rayon::prelude::*;

use crate::bake::{self, CacheSet, Density, NO_CACHE};
use crate::error::Result;
use crate::reference::brdf::fitted;
use crate::reference::brute_force;
use crate::reference::gather::Cache;
use crate::reference::path_trace::camera_ray;
use crate::reference::phong::{Material, mirrored_view};
use crate::reference::rsm::{self, Val, View};
use crate::reference::triangle::{Hit, Triangle};
use crate::reference::world::{Sides, World};
use crate::scene::{Camera, Light, Scene};

/// Parameters of a study.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StudySettings {
    /// Grid of pixels.
    pub size: [u32; 2],
    /// Caches requested.
    pub caches: usize,
    /// Side of an RSM \[texels\]; the six views of a point light share as many texels.
    pub rsm: usize,
}

/// The surface at a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pixel {
    /// World position \[m\].
    pub(super) position: DVec3,
    /// Unit shading normal.
    pub(super) normal: DVec3,
    /// Unit view direction, reflected about the normal.
    pub(super) mirrored: DVec3,
    /// Reflectance.
    pub(super) material: Material,
    /// Indices into [`Study::vertices`].
    pub(super) corners: [usize; 3],
    /// Their barycentric weights.
    pub(super) weights: [f64; 3],
}

/// A vertex that a pixel depends on.
#[derive(Clone, Debug)]
pub(super) struct Vertex {
    /// World position \[m\].
    pub(super) position: DVec3,
    /// Unit normal.
    pub(super) normal: DVec3,
    /// Unit view direction, reflected about the normal.
    pub(super) mirrored: DVec3,
    /// Indices of caches, best first.
    pub(super) references: Vec<usize>,
    /// Caches of the vertex's instance.
    pub(super) own: std::ops::Range<usize>,
}

/// A scene ready to be measured.
pub struct Study<'a> {
    pub(super) scene: &'a Scene,
    pub(super) camera: &'a Camera,
    pub(super) settings: StudySettings,
    pub(super) world: World<'a>,
    pub(super) pixels: Vec<Pixel>,
    pub(super) vertices: Vec<Vertex>,
    pub(super) caches: Vec<Cache>,
    /// Index of each instance's first cache.
    pub(super) first: Vec<usize>,
    /// `d_eps` \[m\] of the bake.
    pub(super) spacing: f64,
    pub(super) vals: Vec<Val>,
    /// Diffuse and glossy radiance of every pixel from all VALs.
    pub(super) truth: [Vec<[f32; 3]>; 2],
}

impl<'a> Study<'a> {
    /// Bakes 8 references per vertex, casts the VALs and computes the ground truth.
    ///
    /// # Errors
    /// As `bake::bake`.
    pub fn new(scene: &'a Scene, camera: &'a Camera, settings: StudySettings) -> Result<Self> {
        let density = Density::Count(settings.caches);
        let bake_settings = bake::BakeSettings { density, angle: 60_f32.to_radians(), references: 8 };
        let baked = bake::bake(scene, &bake_settings, &|_, _| ())?;
        let world = World::new(scene);
        let (caches, first) = caches(scene, &baked);
        let vals = vals(scene, &world, settings.rsm, None);
        let mut study = Self {
            scene,
            camera,
            settings,
            world,
            pixels: Vec::new(),
            vertices: Vec::new(),
            caches,
            first,
            spacing: baked.spacing,
            vals,
            truth: Default::default(),
        };
        study.look(&baked);
        study.truth = study.by_vals(&study.vals);
        Ok(study)
    }

    /// Numbers of caches and VALs.
    pub fn counts(&self) -> [usize; 2] {
        [self.caches.len(), self.vals.len()]
    }

    /// Whether any pixel has a glossy lobe.
    pub fn is_glossy(&self) -> bool {
        self.pixels.iter().any(|pixel| pixel.material.specular != DVec3::ZERO)
    }

    /// Position of the viewer \[m\].
    pub(super) fn eye(&self) -> DVec3 {
        self.camera.world_from_camera.translation
    }

    fn look(&mut self, baked: &CacheSet) {
        let mut known = HashMap::new();
        for index in 0..(self.settings.size[0] * self.settings.size[1]) as usize {
            let (origin, direction) = camera_ray(self.camera, self.settings.size, index);
            let Some(hit) = self.world.nearest(origin, direction, Sides::Front) else { continue };
            let surface = self.world.surface(&hit);
            let instance = &self.scene.instances[hit.instance];
            let mesh = &self.scene.meshes[instance.mesh];
            let corners = mesh.triangle(hit.triangle).map(|v| {
                *known.entry((hit.instance, v)).or_insert_with(|| {
                    let position = instance.world_from_model.transform_point3(mesh.vertices[v].position.as_dvec3());
                    let normals = instance.world_from_model.matrix3.inverse().transpose();
                    let normal = (normals * mesh.vertices[v].normal.as_dvec3()).normalize_or(surface.geometric);
                    let mirrored = mirrored_view(position, normal, self.eye());
                    let (model, base) = (&baked.models[baked.instance_model[hit.instance]], self.first[hit.instance]);
                    let references = model.references[8 * v..8 * (v + 1)].iter().filter(|r| **r != NO_CACHE);
                    let references = references.map(|r| base + usize::from(*r)).collect();
                    let own = base..base + model.caches.len();
                    self.vertices.push(Vertex { position, normal, mirrored, references, own });
                    self.vertices.len() - 1
                })
            });
            self.pixels.push(Pixel {
                position: surface.position,
                normal: surface.normal,
                mirrored: mirrored_view(surface.position, surface.normal, self.eye()),
                material: fitted(&surface.reflection, -direction.dot(surface.normal)),
                corners,
                weights: [1.0 - hit.weights.x - hit.weights.y, hit.weights.x, hit.weights.y],
            });
        }
    }

    /// Diffuse and glossy radiance of every pixel from these VALs.
    pub(super) fn by_vals(&self, vals: &[Val]) -> [Vec<[f32; 3]>; 2] {
        let radiance = |p: &Pixel| {
            let (diffuse, glossy) = brute_force::radiance(p.position, p.normal, p.mirrored, &p.material, vals);
            (diffuse.as_vec3().to_array(), glossy.as_vec3().to_array())
        };
        let (diffuse, glossy) = self.pixels.par_iter().map(radiance).unzip();
        [diffuse, glossy]
    }
}

/// Caches of all instances in the world, and the index of each instance's first cache.
fn caches(scene: &Scene, baked: &CacheSet) -> (Vec<Cache>, Vec<usize>) {
    let (mut caches, mut first) = (Vec::new(), Vec::new());
    for (instance, &model) in scene.instances.iter().zip(&baked.instance_model) {
        first.push(caches.len());
        let mesh = &scene.meshes[instance.mesh];
        let materials = mesh.triangle_materials();
        let normals = instance.world_from_model.matrix3.inverse().transpose();
        caches.extend(baked.models[model].caches.iter().map(|cache| {
            let [a, b, c] = mesh.triangle(cache.triangle as usize).map(|v| &mesh.vertices[v]);
            let [second, third] = cache.barycentric;
            let mix = |of: fn(&crate::scene::Vertex) -> glam::Vec2| {
                of(a) * (1.0 - second - third) + of(b) * second + of(c) * third
            };
            let material = &scene.materials[materials[cache.triangle as usize]];
            Cache {
                position: instance.world_from_model.transform_point3(cache.position.as_dvec3()),
                normal: (normals * cache.normal.as_dvec3()).normalize(),
                exponent: material
                    .reflectance(scene, [mix(|v| v.uv0), mix(|v| v.uv1)], Vec4::ONE)
                    .cache_exponent()
                    .into(),
            }
        }));
    }
    (caches, first)
}

/// VALs of all lights. Areas are perpendicular to the light's axis (5.10). With `tilted` they are the texel's footprint
/// on the surface, at most this many times the area perpendicular to the ray.
pub(super) fn vals(scene: &Scene, world: &World<'_>, rsm: usize, tilted: Option<f64>) -> Vec<Val> {
    let all = pictures(scene, world, &scene.lights, rsm, tilted).0;
    all.into_iter().filter(|val| *val != Val::NOTHING).collect()
}

/// Texels of all images of these lights, row by row, and the sides of the images.
pub(super) fn pictures(
    scene: &Scene,
    world: &World<'_>,
    lights: &[Light],
    rsm: usize,
    tilted: Option<f64>,
) -> (Vec<Val>, Vec<usize>) {
    // Parallel views only need bounds.
    let (low, high) = scene.bounds().unwrap_or_default();
    let corner = |i: usize| DVec3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] }));
    let bounds = [[0, 1, 2], [3, 4, 5], [6, 7, 0]].map(|corners| Triangle {
        positions: corners.map(corner),
        normals: [DVec3::Y; 3],
        diffuse: DVec3::ZERO,
    });
    let (mut all, mut sizes) = (Vec::new(), Vec::new());
    for light in lights {
        let views = rsm::views(&bounds, light);
        let n = if views.len() == 1 { rsm } else { ((rsm as f64 / 6_f64.sqrt()).round() as usize).max(1) };
        for view in &views {
            let texel = |i: usize| {
                let [x, y] = [i % n, i / n];
                let (origin, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5, n);
                let Some(hit) = world.nearest(origin, direction, Sides::Both) else { return Val::NOTHING };
                let surface = world.surface(&hit);
                let met = Hit {
                    distance: hit.distance,
                    position: surface.position,
                    normal: surface.vertex_normal,
                    geometric: surface.geometric,
                    diffuse: surface.reflection.sent_on().as_dvec3(),
                };
                let mut val = rsm::val(light, view, [x, y], n, &met);
                if let (Some(limit), true) = (tilted, val != Val::NOTHING) {
                    let cos = (-surface.geometric.dot(direction)).max(1.0 / limit);
                    val.area = square_to_ray(view, [x, y], n, hit.distance) / cos;
                }
                val
            };
            sizes.push(n);
            all.extend((0..n * n).into_par_iter().map(texel).collect::<Vec<_>>());
        }
    }
    (all, sizes)
}

/// Cross section [m^2] of a texel's beam at a distance \[m\].
fn square_to_ray(view: &View, [x, y]: [usize; 2], n: usize, distance: f64) -> f64 {
    if view.parallel {
        return 4.0 * view.half.x * view.half.y / (n * n) as f64;
    }
    rsm::texel_solid_angle(x, y, n, view.half.x) * distance * distance
}
