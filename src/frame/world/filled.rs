//! Translucent bodies, for shaders. METHOD 7.

use super::update::InstanceLayout;
use super::{CacheSurface, DrawItem};
use crate::error::Result;
use crate::gpu::{Buffer, Device};
use crate::scene::medium::Medium;
use crate::scene::{Mesh, Scene};
use crate::shared::{self, FilledCache, HOLLOW, ModelCache};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

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
        (scene, layouts): (&Scene, &[InstanceLayout]),
        draws: &[DrawItem],
        (caches, surfaces): (&[ModelCache], &[CacheSurface]),
    ) -> Result<Option<Self>> {
        let (mut numbers, mut known) = (BTreeMap::new(), BTreeMap::new());
        let mut media: Vec<Medium> = Vec::new();
        let mut part = |instance: u32, material: usize| {
            let inside = scene.materials[material].subsurface?;
            let number = *numbers.entry((instance, material)).or_insert(media.len() as u32);
            if number as usize == media.len() {
                // Measured in the shape in which caches were placed. Instances of equal size are measured once.
                let linear = layouts[instance as usize].linear;
                let mesh = scene.instances[instance as usize].mesh;
                let size = linear.to_cols_array().map(f64::to_bits);
                media.push(*known.entry((mesh, material, size)).or_insert_with(|| {
                    let (points, area) = points(linear, &scene.meshes[mesh], material);
                    inside.medium().in_body(&points, area)
                }));
            }
            Some(number)
        };
        let of_draws: Vec<u32> =
            draws.iter().map(|d| part(d.instance, d.material as usize).unwrap_or(HOLLOW)).collect();
        let mut of_caches = Vec::new();
        for (i, (cache, surface)) in caches.iter().zip(surfaces).enumerate() {
            if let Some(filled) = part(cache.instance, surface.material) {
                of_caches.push(FilledCache { cache: i as u32, filled });
            }
        }
        if media.is_empty() {
            return Ok(None);
        }
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

/// Points distributed evenly over the triangles of a material \[m\], and the area per point [m^2].
fn points(linear: DMat3, mesh: &Mesh, material: usize) -> (Vec<DVec3>, f64) {
    let materials = mesh.triangle_materials();
    let own = || (0..mesh.triangle_count()).filter(|t| materials[*t] == material);
    let corners = |t: usize| mesh.triangle(t).map(|v| linear * mesh.vertices[v].position.as_dvec3());
    let area = |t: usize| {
        let [a, b, c] = corners(t);
        0.5 * (b - a).cross(c - a).length()
    };
    let each = own().map(area).sum::<f64>() / POINTS as f64;
    let (mut points, mut passed) = (Vec::new(), 0.0);
    for t in own().filter(|_| each > 0.0) {
        passed += area(t);
        while points.len() < POINTS && passed > (points.len() as f64 + 0.5) * each {
            // Sequence of the plastic number, folded into the triangle.
            let [mut v, mut w] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2]
                .map(|step| (0.5 + step * points.len() as f64).fract());
            if v + w > 1.0 {
                (v, w) = (1.0 - v, 1.0 - w);
            }
            let [a, b, c] = corners(t);
            points.push(a + v * (b - a) + w * (c - a));
        }
    }
    (points, each)
}

/// A medium in the form that shaders use.
fn filled(medium: &Medium) -> shared::Filled {
    let Medium { albedo, sigma_tr, z_r, z_v, ior, entering, share, .. } = *medium;
    let of_source = |z: DVec3| (share * albedo * (-sigma_tr * z).exp()).as_vec3();
    shared::Filled {
        z_r: z_r.as_vec3(),
        entering: entering as f32,
        z_v: z_v.as_vec3(),
        ior: ior as f32,
        sigma_tr: sigma_tr.as_vec3(),
        of_real: of_source(z_r),
        of_virtual: of_source(z_v),
    }
}
