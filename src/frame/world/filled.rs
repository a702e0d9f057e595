//! Translucent bodies, for shaders. METHOD 7.

use super::update::InstanceLayout;
use super::{CacheSurface, DrawItem};
use crate::bake::CacheSet;
use crate::error::Result;
use crate::gpu::{Buffer, Device};
use crate::scene::medium::{Medium, SOURCES, Shape};
use crate::scene::{Material, Mesh, Scene};
use crate::shared::{self, FilledCache, HOLLOW, ModelCache};
use glam::{DMat3, DVec3};
use std::collections::{BTreeMap, HashSet};
use std::f64::consts::PI;
use std::rc::Rc;

/// Number of points on a body's surface that measure it.
const POINTS: usize = 512;

/// Translucent parts: for each instance, its surfaces with one scattering material.
pub struct FilledBuffers {
    /// Media of the parts.
    pub media: Vec<Medium>,
    /// Media of the parts, for shaders.
    pub parts: Buffer,
    /// Part of each draw, or `HOLLOW`.
    pub of_draws: Buffer,
    /// Caches of the parts, in the order of the atlas.
    pub caches: Buffer,
    /// Number of caches.
    pub count: u32,
}

impl FilledBuffers {
    /// Creates the parts of a scene; `None` without translucent bodies.
    pub(super) fn new(
        gpu: &Device,
        (scene, layouts, close_by): (&Scene, &[InstanceLayout], &[CloseBy]),
        draws: &[DrawItem],
        (caches, surfaces): (&[ModelCache], &[CacheSurface]),
    ) -> Result<Option<Self>> {
        let (mut numbers, mut known) = (BTreeMap::new(), BTreeMap::new());
        let mut parts: Vec<(Medium, Rc<HashSet<usize>>)> = Vec::new();
        let mut part = |instance: u32, material: usize| {
            let inside = scene.materials[material].subsurface?;
            let number = *numbers.entry((instance, material)).or_insert(parts.len() as u32);
            if number as usize == parts.len() {
                // Measured in the shape in which caches were placed. Instances of equal size are measured once.
                let linear = layouts[instance as usize].linear;
                let mesh = scene.instances[instance as usize].mesh;
                let size = linear.to_cols_array().map(f64::to_bits);
                let measured = known.entry((mesh, material, size)).or_insert_with(|| {
                    let (shape, backs) = shape(linear, &scene.meshes[mesh], material);
                    let flat = inside.medium();
                    let medium = flat.in_body(&shape);
                    // Pixels reflect what a half space returns close by. The body may return more from afar.
                    let all = medium.returned.max(flat.returned).max(DVec3::splat(f64::MIN_POSITIVE));
                    let CloseBy { share, around } = close_by[material];
                    let close_by = share * flat.returned / all;
                    (Medium { close_by, around: around.max(medium.around), ..medium }, Rc::new(backs))
                });
                parts.push(measured.clone());
            }
            Some(number)
        };
        let of_draws: Vec<u32> =
            draws.iter().map(|d| part(d.instance, d.material as usize).unwrap_or(HOLLOW)).collect();
        let mut of_caches = Vec::new();
        for (i, (cache, surface)) in caches.iter().zip(surfaces).enumerate() {
            if let Some(filled) = part(cache.instance, surface.material) {
                of_caches.push((surface.triangle, FilledCache { cache: i as u32, filled }));
            }
        }
        if parts.is_empty() {
            return Ok(None);
        }
        of_caches.retain(|(triangle, cache)| !parts[cache.filled as usize].1.contains(triangle));
        let mut of_caches: Vec<FilledCache> = of_caches.into_iter().map(|(_, cache)| cache).collect();
        let media: Vec<Medium> = parts.iter().map(|(medium, _)| *medium).collect();
        let count = of_caches.len() as u32;
        if of_caches.is_empty() {
            of_caches.push(FilledCache { cache: 0, filled: 0 });
        }
        Ok(Some(Self {
            parts: gpu.buffer_from("scene.filled_parts", &media.iter().map(filled).collect::<Vec<_>>())?,
            media,
            of_draws: gpu.buffer_from("scene.filled_draws", &of_draws)?,
            caches: gpu.buffer_from("scene.filled_caches", &of_caches)?,
            count,
        }))
    }
}

/// Light from inside that leaves close to where it entered. Caches cannot resolve it: pixels reflect it themselves.
#[derive(Clone, Copy, Default)]
pub(super) struct CloseBy {
    /// Its part of the light that leaves a half space.
    pub share: DVec3,
    /// Squared radius of the surface around a point from which it comes [m^2].
    around: f64,
}

/// Light that leaves close to where it entered, by material: within a circle of twice a mean cache's surface.
pub(super) fn close_by(scene: &Scene, caches: Option<&CacheSet>) -> Vec<CloseBy> {
    let mut sums = vec![(0.0, 0.0); scene.materials.len()];
    for model in caches.iter().flat_map(|caches| &caches.models) {
        let materials = scene.meshes[model.mesh].triangle_materials();
        for cache in &model.caches {
            let (area, count) = &mut sums[materials[cache.triangle as usize]];
            (*area, *count) = (*area + f64::from(cache.area), *count + 1.0);
        }
    }
    let of = |(material, (area, count)): (&Material, (f64, f64))| match material.subsurface {
        Some(inside) if count > 0.0 => {
            let around = 2.0 * area / (count * PI);
            CloseBy { share: inside.medium().within(around.sqrt()), around }
        }
        _ => CloseBy::default(),
    };
    scene.materials.iter().zip(sums).map(of).collect()
}

/// The shape of the surfaces of a material. Where a file marks a closed surface as double-sided, its backs lie inside the
/// body and do not count; their triangles are returned.
fn shape(linear: DMat3, mesh: &Mesh, material: usize) -> (Shape, HashSet<usize>) {
    let materials = mesh.triangle_materials();
    let own: Vec<usize> = (0..mesh.triangle_count()).filter(|t| materials[*t] == material).collect();
    let corners = |t: &usize| mesh.triangle(*t).map(|v| linear * mesh.vertices[v].position.as_dvec3());
    let mut seen = HashSet::new();
    let (mut fronts, mut backs): (Vec<_>, Vec<_>) = own.iter().partition(|t| seen.insert(sorted(&corners(t))));
    let volume = volume(&fronts.iter().map(corners).collect::<Vec<_>>());
    if volume.is_none() {
        fronts.append(&mut backs);
    }
    let (points, area) = points(&fronts.iter().map(corners).collect::<Vec<_>>());
    (Shape { points, area, volume }, backs.into_iter().collect())
}

/// A triangle's corners, equal for both of its sides.
fn sorted(triangle: &[DVec3; 3]) -> [[u64; 3]; 3] {
    let mut corners = triangle.map(|corner| corner.to_array().map(f64::to_bits));
    corners.sort_unstable();
    corners
}

/// Largest hole of a body that counts as closed, as a share of its surface seen from one side.
const LARGEST_HOLE: f64 = 0.1;

/// Volume inside triangles; `None` if they are open.
fn volume(triangles: &[[DVec3; 3]]) -> Option<f64> {
    let doubled = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a);
    let surface: f64 = triangles.iter().map(|t| doubled(t).length()).sum();
    let middle = triangles.iter().map(|t| doubled(t).length() * (t[0] + t[1] + t[2]) / 3.0).sum::<DVec3>() / surface;
    let hole = triangles.iter().map(doubled).sum::<DVec3>().length();
    let volume = triangles.iter().map(|t| doubled(t).dot(t[0] - middle)).sum::<f64>().abs() / 6.0;
    (surface > 0.0 && hole < LARGEST_HOLE * surface && volume > 0.0).then_some(volume)
}

/// Points distributed evenly over triangles \[m\] with unit normals, and the area per point [m^2].
fn points(triangles: &[[DVec3; 3]]) -> (Vec<[DVec3; 2]>, f64) {
    let area = |[a, b, c]: &[DVec3; 3]| 0.5 * (*b - *a).cross(*c - *a).length();
    let each = triangles.iter().map(area).sum::<f64>() / POINTS as f64;
    let (mut points, mut passed) = (Vec::new(), 0.0);
    for triangle in triangles.iter().filter(|_| each > 0.0) {
        passed += area(triangle);
        while points.len() < POINTS && passed > (points.len() as f64 + 0.5) * each {
            // Sequence of the plastic number, folded into the triangle.
            let [mut v, mut w] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2]
                .map(|step| (0.5 + step * points.len() as f64).fract());
            if v + w > 1.0 {
                (v, w) = (1.0 - v, 1.0 - w);
            }
            let [a, b, c] = *triangle;
            points.push([a + v * (b - a) + w * (c - a), (b - a).cross(c - a).normalize_or_zero()]);
        }
    }
    (points, each)
}

/// A medium in the form that shaders use.
fn filled(medium: &Medium) -> shared::Filled {
    let Medium { sigma_tr, depths: [near, far], ior, entering, strength, returned, close_by, around, .. } = *medium;
    let of_source = |share: f64, z: DVec3| (share * strength * (-sigma_tr * z).exp()).as_vec3();
    shared::Filled {
        near: near.as_vec3(),
        entering: entering as f32,
        far: far.as_vec3(),
        ior: ior as f32,
        sigma_tr: sigma_tr.as_vec3(),
        of_near: of_source(SOURCES[0], near),
        of_far: of_source(SOURCES[1], far),
        close_by: (close_by * returned).as_vec3(),
        from_afar: (1.0 - close_by).as_vec3(),
        around: around as f32,
    }
}
