//! Surfaces that emit, as VALs: they light caches, and pixels by brute force, beside those of the lights. METHOD 2.
//!
//! A patch of radiance `L` and area `A` sends out `pi L A` lumen from its front; a VAL's flux is what leaves it, so the
//! patch is a VAL of that flux. What a surface receives from it is shadowed as that of any VAL.

use crate::scene::material::Emission;
use crate::scene::{Mesh, Scene};
use crate::shared::Val;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Patches that all emitting surfaces together are divided into, where triangles are larger than that.
const WANTED: f64 = 1024.0;

/// Most patches; of more triangles some stand for their neighbours in the file's order.
const MOST: usize = 16_384;

/// Most parts along an edge of a triangle.
const MOST_PARTS: usize = 64;

/// Samples of a texture along an edge of a patch.
const SAMPLES: usize = 8;

/// A triangle that emits, in the world.
struct Emitter<'a> {
    mesh: &'a Mesh,
    corners: [usize; 3],
    material: usize,
    /// Relative to the scene's origin [m].
    positions: [DVec3; 3],
    /// Unit normal of its front.
    normal: DVec3,
    /// Area [m^2].
    area: f64,
}

/// A patch.
struct Patch {
    position: DVec3,
    normal: DVec3,
    area: f64,
    flux: DVec3,
}

/// The scene's emitting surfaces as VALs without weights, positions relative to `origin`: a square of a power of two a
/// side whose blocks lie near each other, filled up with VALs that carry nothing. Empty where nothing emits.
pub(super) fn vals(scene: &Scene, origin: DVec3) -> Vec<Val> {
    let emission: Vec<Option<Emission<'_>>> = scene.materials.iter().map(|m| m.emission(scene)).collect();
    let triangles = triangles(scene, &emission, origin);
    let area: f64 = triangles.iter().map(|t| t.area).sum();
    let patches: Vec<Vec<Patch>> = triangles
        .par_iter()
        .with_min_len(256)
        .map(|triangle| {
            let parts = ((triangle.area * WANTED / area).sqrt().ceil() as usize).clamp(1, MOST_PARTS);
            divide(triangle, emission[triangle.material].as_ref().expect("emits"), parts)
        })
        .collect();
    let patches: Vec<Patch> = patches.into_iter().flatten().filter(|patch| patch.flux != DVec3::ZERO).collect();
    in_square(fewer(patches))
}

/// The triangles that emit and have an area.
fn triangles<'a>(scene: &'a Scene, emission: &[Option<Emission<'_>>], origin: DVec3) -> Vec<Emitter<'a>> {
    let mut all = Vec::new();
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh];
        let side = instance.world_from_model.matrix3.determinant().signum();
        for primitive in mesh.primitives.iter().filter(|p| emission[p.material].is_some()) {
            for triangle in primitive.first_index / 3..(primitive.first_index + primitive.index_count) / 3 {
                let corners = mesh.triangle(triangle as usize);
                let place = |v: usize| instance.world_from_model.transform_point3(mesh.vertices[v].position.as_dvec3());
                let positions = corners.map(|v| place(v) - origin);
                let [a, b, c] = positions;
                let face = 0.5 * side * (b - a).cross(c - a);
                let area = face.length();
                if area > 0.0 && area.is_finite() {
                    let (material, normal) = (primitive.material, face / area);
                    all.push(Emitter { mesh, corners, material, positions, normal, area });
                }
            }
        }
    }
    all
}

/// A triangle in `parts` squared equal ones.
fn divide(triangle: &Emitter<'_>, emission: &Emission<'_>, parts: usize) -> Vec<Patch> {
    let area = triangle.area / (parts * parts) as f64;
    let patch = |weights: [DVec3; 3]| {
        let [a, b, c] = triangle.positions;
        let middle = (weights[0] + weights[1] + weights[2]) / 3.0;
        let inner = if emission.is_uniform() { 1 } else { SAMPLES };
        let mut sum = Vec3::ZERO;
        thirds(weights, inner, |sample| sum += radiance(triangle, emission, (sample[0] + sample[1] + sample[2]) / 3.0));
        let radiance = sum.as_dvec3() / (inner * inner) as f64;
        Patch {
            position: middle.x * a + middle.y * b + middle.z * c,
            normal: triangle.normal,
            area,
            flux: PI * area * radiance,
        }
    };
    let mut all = Vec::with_capacity(parts * parts);
    thirds([DVec3::X, DVec3::Y, DVec3::Z], parts, |weights| all.push(patch(weights)));
    all
}

/// The `n` squared like triangles of one, corners as barycentric weights.
fn thirds([a, b, c]: [DVec3; 3], n: usize, mut each: impl FnMut([DVec3; 3])) {
    let at = |i: usize, j: usize| a + (b - a) * (i as f64 / n as f64) + (c - a) * (j as f64 / n as f64);
    for i in 0..n {
        for j in 0..n - i {
            each([at(i, j), at(i + 1, j), at(i, j + 1)]);
            if i + j + 2 <= n {
                each([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
}

fn radiance(triangle: &Emitter<'_>, emission: &Emission<'_>, weights: DVec3) -> Vec3 {
    let [a, b, c] = triangle.corners.map(|v| &triangle.mesh.vertices[v]);
    let w = weights.as_vec3();
    let uv: [Vec2; 2] = [w.x * a.uv0 + w.y * b.uv0 + w.z * c.uv0, w.x * a.uv1 + w.y * b.uv1 + w.z * c.uv1];
    emission.radiance(uv)
}

/// At most [`MOST`] patches of the same light: where there are more, every so many lumen one is taken, and all are of
/// equal brightness.
fn fewer(patches: Vec<Patch>) -> Vec<Patch> {
    if patches.len() <= MOST {
        return patches;
    }
    log::warn!(
        "{} triangles emit light: every {:.1}th stands for its neighbours",
        patches.len(),
        patches.len() as f64 / MOST as f64
    );
    let luminance = |patch: &Patch| patch.flux.dot(DVec3::new(0.2126, 0.7152, 0.0722)).max(f64::MIN_POSITIVE);
    let step = patches.iter().map(luminance).sum::<f64>() / MOST as f64;
    // Colours of those that are left out are kept: each taken one gets the sum since the last.
    let (mut sum, mut flux, mut area) = (0.5 * step, DVec3::ZERO, 0.0);
    let mut taken = Vec::with_capacity(MOST + 1);
    for patch in patches {
        sum += luminance(&patch);
        flux += patch.flux;
        area += patch.area;
        if sum >= step {
            sum %= step;
            taken.push(Patch { flux, area, ..patch });
            (flux, area) = (DVec3::ZERO, 0.0);
        }
    }
    if let Some(last) = taken.last_mut() {
        last.flux += flux;
        last.area += area;
    }
    taken
}

/// Patches along a space-filling curve, which in a square of VALs runs through the blocks that nodes of a pyramid hold.
fn in_square(patches: Vec<Patch>) -> Vec<Val> {
    if patches.is_empty() {
        return Vec::new();
    }
    let low = patches.iter().map(|p| p.position).reduce(DVec3::min).unwrap_or_default();
    let high = patches.iter().map(|p| p.position).reduce(DVec3::max).unwrap_or_default();
    let size = (high - low).max_element().max(f64::MIN_POSITIVE);
    let key = |patch: &Patch| {
        let cell = ((patch.position - low) / size * 1023.0).as_uvec3();
        (0..10)
            .map(|bit| ((cell.x >> bit & 1) | (cell.y >> bit & 1) << 1 | (cell.z >> bit & 1) << 2) << (3 * bit))
            .sum()
    };
    let mut ordered: Vec<(u32, Patch)> = patches.into_iter().map(|patch| (key(&patch), patch)).collect();
    ordered.sort_by_key(|(key, _)| *key);
    let side = ((ordered.len() as f64).sqrt().ceil() as usize).next_power_of_two();
    let mut square = vec![Val { area: 1.0, ..Val::default() }; side * side];
    for (i, (_, patch)) in ordered.into_iter().enumerate() {
        let axis = |first: usize| (0..16).map(|bit| (i >> (2 * bit + first) & 1) << bit).sum::<usize>();
        square[axis(1) * side + axis(0)] = Val {
            position: patch.position.as_vec3(),
            area: patch.area as f32,
            normal: patch.normal.as_vec3(),
            material: 0,
            flux: patch.flux.as_vec3(),
            weight: 0.0,
        };
    }
    square
}
