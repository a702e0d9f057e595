//! Albedo of the surface that a cache represents: the share of the received light that both lobes together reflect.
//! METHOD 9.

use crate::bake::{CacheSet, ModelCaches, NO_CACHE};
use crate::scene::{Mesh, Scene, Vertex};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// Minimum number of samples per cache over the whole surface; they average textures.
const SAMPLES: f64 = 256.0;

/// Maximum number of samples along a corner of a triangle, since subdivided meshes have many triangles per cache.
const MOST_STEPS: usize = 16;

/// Albedos of all instances' caches, in the order of the atlas.
pub(super) fn of_all(scene: &Scene, caches: &CacheSet) -> Vec<Vec3> {
    let models: Vec<Vec<Vec3>> = caches.models.iter().map(|model| of_caches(scene, model)).collect();
    caches.instance_model.iter().flat_map(|model| models[*model].iter().copied()).collect()
}

/// Albedo of each cache of a model, averaged by area. A third of each triangle belongs to the first reference of each
/// corner. Holes of alpha-masked materials reflect nothing. A cache that is no vertex's first reference takes the
/// albedo at its own point.
fn of_caches(scene: &Scene, model: &ModelCaches) -> Vec<Vec3> {
    let mesh = &scene.meshes[model.mesh];
    let materials = mesh.triangle_materials();
    let per_vertex = model.references.len() / mesh.vertices.len().max(1);
    let area = |t: usize| {
        let [a, b, c] = mesh.triangle(t).map(|v| mesh.vertices[v].position.as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    };
    let whole: f64 = (0..mesh.triangle_count()).map(area).sum();
    let dense = SAMPLES * model.caches.len() as f64 / whole.max(f64::MIN_POSITIVE);

    let nothing = || vec![(Vec3::ZERO, 0.0_f32); model.caches.len()];
    let sums = (0..mesh.triangle_count())
        .into_par_iter()
        .with_min_len(4096)
        .fold(nothing, |mut sums, triangle| {
            let corners = mesh.triangle(triangle);
            let area = area(triangle);
            let steps = ((area * dense / 3.0).sqrt().ceil() as usize).clamp(1, MOST_STEPS);
            for corner in 0..3 {
                let cache = model.references.get(per_vertex * corners[corner]).copied().unwrap_or(NO_CACHE);
                if cache == NO_CACHE {
                    continue;
                }
                let mut albedo = Vec3::ZERO;
                for place in 0..steps * steps {
                    let at = [place % steps, place / steps].map(|i| (i as f32 + 0.5) / steps as f32);
                    albedo += at_point(scene, mesh, materials[triangle], corners, quarter(corner, at));
                }
                let (sum, weight) = &mut sums[usize::from(cache)];
                *sum += albedo * (area / (steps * steps) as f64) as f32;
                *weight += area as f32;
            }
            sums
        })
        .reduce(nothing, |mut a, b| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a = (a.0 + b.0, a.1 + b.1));
            a
        });
    let own = |cache: &crate::bake::Cache| {
        let triangle = cache.triangle as usize;
        let [v, w] = cache.barycentric;
        at_point(scene, mesh, materials[triangle], mesh.triangle(triangle), [1.0 - v - w, v, w])
    };
    let mean = |(cache, (sum, weight)): (&crate::bake::Cache, (Vec3, f32))| {
        if weight > 0.0 { sum / weight } else { own(cache) }
    };
    model.caches.iter().zip(sums).map(mean).collect()
}

/// Weights of a triangle's corners for a point of the unit square. The square maps evenly to the part of the triangle
/// nearest to one corner in barycentric terms: the quadrilateral of the corner, the midpoints of its edges, and the
/// centre.
fn quarter(corner: usize, [x, y]: [f32; 2]) -> [f32; 3] {
    let places = [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [1.0 / 3.0; 3], [0.5, 0.0, 0.5]].map(Vec3::from);
    let [own, edge, centre, other] = places;
    // Bilinear: slightly denser towards the centre, which matters no more than the texture varies within a third of a
    // triangle.
    let at = own.lerp(edge, x).lerp(other.lerp(centre, x), y);
    let mut weights = [0.0; 3];
    at.to_array().into_iter().enumerate().for_each(|(i, weight)| weights[(corner + i) % 3] = weight);
    weights
}

fn at_point(scene: &Scene, mesh: &Mesh, material: usize, corners: [usize; 3], weights: [f32; 3]) -> Vec3 {
    let [a, b, c] = corners.map(|v| &mesh.vertices[v]);
    let [u, v, w] = weights;
    let uv: [Vec2; 2] = [u * a.uv0 + v * b.uv0 + w * c.uv0, u * a.uv1 + v * b.uv1 + w * c.uv1];
    let color = |v: &Vertex| Vec4::from(v.color.map(|c| f32::from(c) / 255.0));
    let color = u * color(a) + v * color(b) + w * color(c);
    let material = &scene.materials[material];
    if let Some(cutoff) = material.alpha_cutoff {
        let texture = material.base_color_texture.map_or(1.0, |t| t.sample(scene, uv, true).w);
        if material.base_color.w * color.w * texture < cutoff {
            return Vec3::ZERO;
        }
    }
    material.reflectance(scene, uv, color).sent_on()
}
