//! Surfaces at a picture's pixels, and the caches that light them.

use glam::DVec3;
use rayon::prelude::*;

use super::Lights;
use super::exact::{Exact, Receiver, receive};
use super::vals::Texel;
use crate::bake::seeds::error;
use crate::bake::{CacheSet, NO_CACHE};
use crate::reference::brdf::fitted;
use crate::reference::gather::{Cache, Gathered, Received, gather_received, luminance};
use crate::reference::path_trace::camera_ray;
use crate::reference::phong::{Material, mirrored_view, reflect};
use crate::reference::world::{Sides, World};
use crate::scene::{Camera, Projection};

/// A scene with its caches, seen by a camera.
pub struct Stage<'a> {
    /// The scene.
    pub world: World<'a>,
    set: &'a CacheSet,
    /// Caches of all instances in the world, in atlas order.
    pub caches: Vec<Cache>,
    /// Index of each instance's first cache.
    first_cache: Vec<usize>,
    /// Position of the viewer \[m\].
    pub eye: DVec3,
    /// The pixels that show a surface.
    pub pixels: Vec<Pixel>,
    /// Whether any pixel has a glossy lobe.
    pub glossy: bool,
}

/// The surface at a pixel's centre.
#[derive(Clone, Debug)]
pub struct Pixel {
    /// Index, row by row from the top.
    pub index: usize,
    /// World position \[m\].
    pub position: DVec3,
    /// Unit shading normal.
    pub normal: DVec3,
    /// Unit vertex normal, interpolated.
    pub vertex_normal: DVec3,
    /// Unit view direction, reflected about the shading normal.
    pub mirrored: DVec3,
    /// Reflectance.
    pub material: Material,
    instance: usize,
    vertices: [usize; 3],
    weights: [f64; 3],
}

/// A point at which references are averaged: a vertex, or the pixel itself.
pub struct Point {
    /// Barycentric weight in the pixel.
    pub share: f64,
    /// World position \[m\].
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Unit view direction, reflected about the normal.
    pub mirrored: DVec3,
    /// Indices of caches.
    pub references: Vec<usize>,
}

/// Location at which references are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// At the triangle's corners, as in the engine.
    Vertex,
    /// At the pixel, with the caches of least error there.
    Pixel,
}

impl<'a> Stage<'a> {
    /// Casts rays through every pixel's centre of a picture of this size.
    pub fn new(world: World<'a>, camera: &Camera, set: &'a CacheSet, size: [u32; 2]) -> Self {
        let scene = world.scene();
        let (mut caches, mut first_cache) = (Vec::new(), Vec::new());
        for (instance, model) in scene.instances.iter().zip(&set.instance_model) {
            first_cache.push(caches.len());
            let mesh = &scene.meshes[instance.mesh];
            let materials = mesh.triangle_materials();
            let normals = instance.world_from_model.matrix3.inverse().transpose();
            for cache in &set.models[*model].caches {
                let [a, b, c] = mesh.triangle(cache.triangle as usize).map(|v| &mesh.vertices[v]);
                let [v, w] = cache.barycentric;
                let u = 1.0 - v - w;
                let uv = [u * a.uv0 + v * b.uv0 + w * c.uv0, u * a.uv1 + v * b.uv1 + w * c.uv1];
                let material = &scene.materials[materials[cache.triangle as usize]];
                caches.push(Cache {
                    position: instance.world_from_model.transform_point3(cache.position.as_dvec3()),
                    normal: (normals * cache.normal.as_dvec3()).normalize_or(DVec3::Y),
                    exponent: material.reflectance(scene, uv, glam::Vec4::ONE).cache_exponent().into(),
                });
            }
        }
        let pose = camera.world_from_camera;
        let eye = match camera.projection {
            Projection::Perspective { .. } => pose.translation,
            // Parallel rays: a viewer so far away that directions differ by at most 1e-6.
            Projection::Orthographic { .. } => pose.translation + 1e6 * world.radius * pose.matrix3.z_axis.normalize(),
        };
        let seen = |index: usize| {
            let (origin, direction) = camera_ray(camera, size, index);
            let hit = world.nearest(origin, direction, Sides::Front)?;
            let surface = world.surface(&hit);
            Some(Pixel {
                index,
                position: surface.position,
                normal: surface.normal,
                vertex_normal: surface.vertex_normal,
                mirrored: reflect(direction, surface.normal),
                material: fitted(&surface.reflection, -direction.dot(surface.normal)),
                instance: hit.instance,
                vertices: scene.meshes[scene.instances[hit.instance].mesh].triangle(hit.triangle),
                weights: [1.0 - hit.weights.x - hit.weights.y, hit.weights.x, hit.weights.y],
            })
        };
        let count = size[0] as usize * size[1] as usize;
        let pixels: Vec<Pixel> = (0..count).into_par_iter().filter_map(seen).collect();
        let glossy = pixels.iter().any(|pixel| pixel.material.specular != DVec3::ZERO);
        Self { world, set, caches, first_cache, eye, pixels, glossy }
    }

    /// Gathers these VALs at every cache; with `shadows` each pair is tested by a ray.
    pub fn gather(&self, texels: &[Texel], exact: Exact, shadows: bool) -> Vec<Gathered> {
        let gather = |cache: &Cache| {
            let mirrored = mirrored_view(cache.position, cache.normal, self.eye);
            let lobe = self.glossy.then_some((mirrored, cache.exponent));
            let at = Receiver { position: cache.position, normal: cache.normal, lobe };
            let received = texels.iter().filter_map(|texel| {
                let (geometry, _, lobe) = receive(texel, &at, exact);
                if geometry == 0.0 || (shadows && self.world.blocked(at.position, texel.val.position)) {
                    return None;
                }
                let pull = geometry * luminance(texel.val.flux);
                let offset = texel.val.position - at.position;
                Some(Received { offset, irradiance: texel.val.flux * geometry, pull, lobe })
            });
            gather_received(cache, mirrored, received)
        };
        self.caches.par_iter().map(gather).collect()
    }

    /// Brute force: every VAL at every pixel.
    pub fn brute_force(&self, texels: &[Texel], exact: Exact) -> Lights {
        let light = |pixel: &Pixel| {
            let is_glossy = pixel.material.specular != DVec3::ZERO;
            let lobe = is_glossy.then_some((pixel.mirrored, pixel.material.exponent));
            let at = Receiver { position: pixel.position, normal: pixel.normal, lobe };
            let (mut diffuse, mut glossy) = (DVec3::ZERO, DVec3::ZERO);
            for texel in texels {
                let (geometry, _, lobe) = receive(texel, &at, exact);
                diffuse += texel.val.flux * geometry;
                glossy += texel.val.flux * (geometry * lobe);
            }
            pixel.reflect(diffuse, glossy)
        };
        self.pixels.par_iter().map(light).collect()
    }

    /// Points at which a pixel's references are averaged.
    pub fn points(&self, pixel: &Pixel, level: Level) -> Vec<Point> {
        let scene = self.world.scene();
        let instance = &scene.instances[pixel.instance];
        let model = &self.set.models[self.set.instance_model[pixel.instance]];
        let base = self.first_cache[pixel.instance];
        if model.caches.is_empty() {
            return Vec::new();
        }
        let mesh = &scene.meshes[instance.mesh];
        let each = model.references.len() / mesh.vertices.len();
        let point = |share, position, normal, references| {
            let mirrored = mirrored_view(position, normal, self.eye);
            Point { share, position, normal, mirrored, references }
        };
        if level == Level::Pixel {
            let caches = &self.caches[base..base + model.caches.len()];
            let score = |cache: &Cache| {
                error(cache.position.distance(pixel.position), cache.normal.dot(pixel.vertex_normal), self.set.spacing)
            };
            let mut all: Vec<(f64, usize)> = caches.iter().enumerate().map(|(i, c)| (score(c), base + i)).collect();
            if all.len() > each {
                all.select_nth_unstable_by(each - 1, |a, b| a.0.total_cmp(&b.0));
                all.truncate(each);
            }
            let references = all.into_iter().map(|(_, index)| index).collect();
            return vec![point(1.0, pixel.position, pixel.vertex_normal, references)];
        }
        let normals = instance.world_from_model.matrix3.inverse().transpose();
        let at_vertex = |(vertex, share): (usize, f64)| {
            let v = &mesh.vertices[vertex];
            let references = &model.references[vertex * each..(vertex + 1) * each];
            let references = references.iter().filter(|i| **i != NO_CACHE).map(|i| base + usize::from(*i)).collect();
            let position = instance.world_from_model.transform_point3(v.position.as_dvec3());
            point(share, position, (normals * v.normal.as_dvec3()).normalize_or(DVec3::Y), references)
        };
        pixel.vertices.into_iter().zip(pixel.weights).map(at_vertex).collect()
    }
}

impl Pixel {
    /// Radiance [cd/m^2] of both lobes, from the irradiance \[lx\] and the irradiance weighted with `cos^k`.
    pub fn reflect(&self, diffuse: DVec3, glossy: DVec3) -> [DVec3; 2] {
        use std::f64::consts::{PI, TAU};
        let m = &self.material;
        [m.diffuse * diffuse / PI, m.specular * glossy * ((m.exponent + 2.0) / TAU)]
    }
}
