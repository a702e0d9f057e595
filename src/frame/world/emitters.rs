//! VALs for emissive surfaces that are not area lights. Like the VALs of lights, they light caches, and pixels by brute
//! force. METHOD 2.
//!
//! A patch with radiance `L` and area `A` emits `pi L A` lumen from its front. A VAL's flux is the light that leaves
//! it, so the patch is a VAL with that flux. Its light is shadowed like that of any VAL.

use super::area_lights::{self, AreaLight, AreaLights};
use super::bodies::Bodies;
use super::enclosed;
use crate::scene::material::Emission;
use crate::scene::{Instance, Mesh, Scene, Vertex, luminance};
use crate::shared::Val;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Number of patches for all emissive surfaces together, if triangles are larger than a patch.
const WANTED: f64 = 1024.0;

/// Maximum number of patches. With more triangles, a patch represents its neighbours in the file's order.
const MOST: usize = 16_384;

/// Maximum number of parts along an edge of a triangle.
const MOST_PARTS: usize = 64;

/// Samples of a texture along an edge of a patch.
const SAMPLES: usize = 8;

/// An emissive triangle.
pub(super) struct Emitter<'a> {
    pub(super) instance: usize,
    mesh: &'a Mesh,
    /// Vertices of the mesh.
    pub(super) corners: [usize; 3],
    pub(super) material: usize,
    /// Corners in the world \[m\], counter-clockwise seen from the front.
    pub(super) corners_in_world: [DVec3; 3],
    /// Normal of its front, with twice its area as length [m^2].
    pub(super) face: DVec3,
}

/// A patch: part of a triangle, independent of the triangle's position.
struct Patch {
    instance: usize,
    /// Vertices of the mesh.
    corners: [usize; 3],
    /// Barycentric weights of its centre.
    weights: DVec3,
    /// Its share of the triangle's area, plus that of the neighbours it represents.
    area: f64,
    material: usize,
    /// Mean share of the material's radiance after its texture.
    share: DVec3,
}

/// The emissive surfaces of a scene as patches that do not depend on their positions. They fill a square whose side is
/// a power of two and whose blocks hold patches near each other. Unused places are `None`.
#[derive(Default)]
pub(super) struct Patches(Vec<Option<Patch>>);

/// Radiance of a material without its texture [cd/m^2].
pub(super) fn emissive(scene: &Scene, material: usize) -> DVec3 {
    scene.materials[material]
        .emissive
        .to_array()
        .map(|c| if c.is_finite() { f64::from(c.max(0.0)) } else { 0.0 })
        .into()
}

impl Patches {
    /// Finds the area lights and small bodies of a scene, and divides its other emissive surfaces into patches. Empty
    /// without emissive surfaces.
    pub(super) fn new(scene: &Scene) -> (AreaLights, Bodies, Self) {
        let emission: Vec<Option<Emission<'_>>> = (0..scene.materials.len()).map(|m| scene.emission(m)).collect();
        // The choice includes materials that emit now and those that an animation may let emit.
        let nominal: Vec<DVec3> =
            (emission.iter()).map(|e| e.as_ref().map_or(DVec3::ZERO, |e| e.factor().as_dvec3())).collect();
        let mut places = Places::new(scene);
        let triangles = enclosed::outer(scene, triangles(scene, &emission, &mut places));
        let (areas, triangles) = AreaLights::take(scene, &emission, &mut places, triangles);
        let lights = areas.now(scene);
        let others = lights.iter().map(AreaLight::power).sum();
        let room = area_lights::MOST - lights.len();
        let (bodies, triangles) = Bodies::take(scene, &emission, &mut places, triangles, (room, others));
        let area: f64 = triangles.iter().map(Emitter::area).sum();
        let patches: Vec<Vec<Patch>> = triangles
            .par_iter()
            .with_min_len(256)
            .map(|triangle| {
                let parts = ((triangle.area() * WANTED / area).sqrt().ceil() as usize).clamp(1, MOST_PARTS);
                divide(triangle, emission[triangle.material].as_ref().expect("emits"), parts)
            })
            .collect();
        let shines = |patch: &Patch| patch.share * nominal[patch.material] != DVec3::ZERO;
        let patches: Vec<Patch> = patches.into_iter().flatten().filter(shines).collect();
        let vals: Vec<Val> = patches.iter().map(|p| places.val(p, DVec3::ZERO, nominal[p.material])).collect();
        (areas, bodies, in_square(fewer(&nominal, patches.into_iter().zip(vals).collect())))
    }

    /// Whether there are no patches.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether any patch is part of this instance.
    pub(super) fn any_of(&self, instance: usize) -> bool {
        self.0.iter().flatten().any(|patch| patch.instance == instance)
    }

    /// The patches in the current state of the scene as VALs without weights, at positions relative to `origin`. Unused
    /// places become VALs without light.
    pub(super) fn vals(&self, scene: &Scene, origin: DVec3) -> Vec<Val> {
        let mut places = Places::new(scene);
        let nothing = Val { area: 1.0, ..Val::default() };
        self.0
            .iter()
            .map(|patch| {
                patch.as_ref().map_or(nothing, |patch| places.val(patch, origin, emissive(scene, patch.material)))
            })
            .collect()
    }
}

/// Positions of vertices. Deformed instances are posed once and then reused.
pub(super) struct Places<'a> {
    scene: &'a Scene,
    posed: Vec<Option<Vec<Vertex>>>,
}

impl<'a> Places<'a> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        Self { scene, posed: scene.instances.iter().map(|_| None).collect() }
    }

    /// Whether an instance is hidden.
    pub(super) fn is_hidden(&self, instance: usize) -> bool {
        self.scene.instances[instance].hidden
    }

    /// A triangle's corners, and its front normal with twice its area as length.
    pub(super) fn triangle(&mut self, instance: usize, corners: [usize; 3]) -> ([DVec3; 3], DVec3) {
        let Instance { mesh, world_from_model, pose, .. } = &self.scene.instances[instance];
        let mesh = &self.scene.meshes[*mesh];
        let vertices = match pose {
            Some(pose) => self.posed[instance].get_or_insert_with(|| mesh.posed(pose)),
            None => &mesh.vertices,
        };
        let positions = corners.map(|v| world_from_model.transform_point3(vertices[v].position.as_dvec3()));
        let [a, b, c] = positions;
        (positions, world_from_model.matrix3.determinant().signum() * (b - a).cross(c - a))
    }

    fn val(&mut self, patch: &Patch, origin: DVec3, emissive: DVec3) -> Val {
        let ([a, b, c], face) = self.triangle(patch.instance, patch.corners);
        let area = 0.5 * face.length() * patch.area;
        if self.scene.instances[patch.instance].hidden || !(area > 0.0 && area.is_finite()) {
            return Val { area: 1.0, ..Val::default() };
        }
        let position = patch.weights.x * a + patch.weights.y * b + patch.weights.z * c;
        Val {
            position: (position - origin).as_vec3(),
            area: area as f32,
            normal: face.normalize().as_vec3(),
            kind: 0,
            flux: (PI * area * patch.share * emissive).as_vec3(),
            weight: 0.0,
        }
    }
}

/// The emissive triangles with an area above 0.
fn triangles<'a>(scene: &'a Scene, emission: &[Option<Emission<'_>>], places: &mut Places<'a>) -> Vec<Emitter<'a>> {
    let mut all = Vec::new();
    for (i, instance) in scene.instances.iter().enumerate() {
        let mesh = &scene.meshes[instance.mesh];
        for primitive in mesh.primitives.iter().filter(|p| emission[p.material].is_some()) {
            for triangle in primitive.first_index / 3..(primitive.first_index + primitive.index_count) / 3 {
                let corners = mesh.triangle(triangle as usize);
                let ([a, b, c], face) = places.triangle(i, corners);
                let area = 0.5 * face.length();
                if area > 0.0 && area.is_finite() {
                    let material = primitive.material;
                    let corners_in_world = if face.dot((b - a).cross(c - a)) < 0.0 { [a, c, b] } else { [a, b, c] };
                    all.push(Emitter { instance: i, mesh, corners, material, corners_in_world, face });
                }
            }
        }
    }
    all
}

impl Emitter<'_> {
    /// Area in the world [m^2].
    pub(super) fn area(&self) -> f64 {
        0.5 * self.face.length()
    }

    /// Mean share of the material's radiance after its texture.
    pub(super) fn mean_share(&self, emission: &Emission<'_>) -> DVec3 {
        let parts = if emission.is_uniform() { 1 } else { 4 * SAMPLES };
        let mut sum = Vec3::ZERO;
        thirds([DVec3::X, DVec3::Y, DVec3::Z], parts, |sample| {
            sum += share(self, emission, (sample[0] + sample[1] + sample[2]) / 3.0);
        });
        sum.as_dvec3() / (parts * parts) as f64
    }
}

/// Divides a triangle into `parts` squared equal ones.
fn divide(triangle: &Emitter<'_>, emission: &Emission<'_>, parts: usize) -> Vec<Patch> {
    let patch = |weights: [DVec3; 3]| {
        let inner = if emission.is_uniform() { 1 } else { SAMPLES };
        let mut sum = Vec3::ZERO;
        thirds(weights, inner, |sample| sum += share(triangle, emission, (sample[0] + sample[1] + sample[2]) / 3.0));
        Patch {
            instance: triangle.instance,
            corners: triangle.corners,
            weights: (weights[0] + weights[1] + weights[2]) / 3.0,
            area: 1.0 / (parts * parts) as f64,
            material: triangle.material,
            share: sum.as_dvec3() / (inner * inner) as f64,
        }
    };
    let mut all = Vec::with_capacity(parts * parts);
    thirds([DVec3::X, DVec3::Y, DVec3::Z], parts, |weights| all.push(patch(weights)));
    all
}

/// Calls `each` for the `n` squared equal parts of a triangle, with corners as barycentric weights.
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

fn share(triangle: &Emitter<'_>, emission: &Emission<'_>, weights: DVec3) -> Vec3 {
    let [a, b, c] = triangle.corners.map(|v| &triangle.mesh.vertices[v]);
    let w = weights.as_vec3();
    let uv: [Vec2; 2] = [w.x * a.uv0 + w.y * b.uv0 + w.z * c.uv0, w.x * a.uv1 + w.y * b.uv1 + w.z * c.uv1];
    emission.share(uv)
}

/// Reduces the patches to at most [`MOST`] with the same total light. If there are more, one patch is taken per fixed
/// amount of light \[lm\], and all taken ones are equally bright.
fn fewer(nominal: &[DVec3], patches: Vec<(Patch, Val)>) -> Vec<(Patch, Val)> {
    if patches.len() <= MOST {
        return patches;
    }
    log::warn!(
        "{} triangles emit light: every {:.1}th represents its neighbours",
        patches.len(),
        patches.len() as f64 / MOST as f64
    );
    let light = |val: &Val| luminance(val.flux.as_dvec3()).max(f64::MIN_POSITIVE);
    let step = patches.iter().map(|(_, val)| light(val)).sum::<f64>() / MOST as f64;
    // Keeps the colours of skipped patches: each taken one gets the sum since the last.
    let (mut sum, mut flux, mut area) = (0.5 * step, DVec3::ZERO, 0.0);
    let mut taken: Vec<(Patch, Val, DVec3, f64)> = Vec::with_capacity(MOST + 1);
    for (patch, val) in patches {
        sum += light(&val);
        flux += val.flux.as_dvec3();
        area += f64::from(val.area);
        if sum >= step {
            sum %= step;
            taken.push((patch, val, flux, area));
            (flux, area) = (DVec3::ZERO, 0.0);
        }
    }
    if let Some(last) = taken.last_mut() {
        last.2 += flux;
        last.3 += area;
    }
    let stands_for = |(patch, val, flux, area): (Patch, Val, DVec3, f64)| {
        // Radiance relative to the material's. Channels that the material lacks get as much as possible.
        let own = nominal[patch.material];
        let own = own.max(DVec3::splat(1e-6 * own.max_element()));
        let share = flux / (PI * area) / own;
        (Patch { area: patch.area * area / f64::from(val.area), share, ..patch }, val)
    };
    taken.into_iter().map(stands_for).collect()
}

/// Orders patches along a space-filling curve. In a square of VALs it runs through the blocks that the nodes of a
/// pyramid cover.
fn in_square(patches: Vec<(Patch, Val)>) -> Patches {
    if patches.is_empty() {
        return Patches::default();
    }
    let low = patches.iter().map(|(_, val)| val.position).reduce(Vec3::min).unwrap_or_default();
    let high = patches.iter().map(|(_, val)| val.position).reduce(Vec3::max).unwrap_or_default();
    let size = (high - low).max_element().max(f32::MIN_POSITIVE);
    let key = |val: &Val| -> u32 {
        let cell = ((val.position - low) / size * 1023.0).as_uvec3();
        (0..10)
            .map(|bit| ((cell.x >> bit & 1) | (cell.y >> bit & 1) << 1 | (cell.z >> bit & 1) << 2) << (3 * bit))
            .sum()
    };
    let mut ordered: Vec<(u32, Patch)> = patches.into_iter().map(|(patch, val)| (key(&val), patch)).collect();
    ordered.sort_by_key(|(key, _)| *key);
    let side = ((ordered.len() as f64).sqrt().ceil() as usize).next_power_of_two();
    let mut square: Vec<Option<Patch>> = (0..side * side).map(|_| None).collect();
    for (i, (_, patch)) in ordered.into_iter().enumerate() {
        let axis = |first: usize| (0..16).map(|bit| (i >> (2 * bit + first) & 1) << bit).sum::<usize>();
        square[axis(1) * side + axis(0)] = Some(patch);
    }
    Patches(square)
}
