//! Area lights: the largest flat emissive surfaces as rectangles. They light pixels directly, and the scene through
//! their own RSMs.
//!
//! Triangles of one material that share edges and face the same way form a surface. A surface that is nearly flat and
//! nearly a rectangle becomes a rectangle with the same centre, area and mean radiance. Other surfaces stay patches.

use super::emitters::{Emitter, Places, emissive};
use crate::scene::material::Emission;
use crate::scene::{Scene, luminance};
use glam::{DVec2, DVec3};
use std::collections::HashMap;

/// Maximum number of area lights and small emissive bodies together.
pub(super) const MOST: usize = 16;

/// Number of samples of all area lights together. A sample is a point from which shadow maps and RSMs are drawn.
const SAMPLES: usize = 16;

/// Maximum number of triangles drawn into the maps of all samples together. In larger scenes lights have fewer samples,
/// but at least one each.
const MOST_DRAWN: usize = 64_000_000;

/// Minimum cosine between neighbours that face the same way. Those of a coarse ball do, those of a box do not.
const SAME_SIDE: f64 = 0.75;

/// Minimum length of the sum of a flat surface's normals, relative to its area.
const FLAT: f64 = 0.95;

/// Minimum share of its bounding rectangle that a nearly rectangular surface fills; a disc fills 0.79.
const FILLED: f64 = 0.6;

/// Maximum number of edge directions to try for a rectangle, longest edges first, and minimum sine between different
/// ones.
const TRIED: usize = 16;
const SAME_DIRECTION: f64 = 1e-3;

/// A rectangle in the world that emits from its front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaLight {
    /// Centre \[m\].
    pub middle: DVec3,
    /// Unit normal of the emitting side.
    pub normal: DVec3,
    /// From the centre to the middle of an edge \[m\].
    pub right: DVec3,
    /// From the centre to the middle of a perpendicular edge \[m\]; `right` x `up` points along the normal.
    pub up: DVec3,
    /// Radiance [cd/m^2].
    pub radiance: DVec3,
    /// Number of samples along `right` and along `up`.
    pub samples: [u32; 2],
    /// Share of the power of all area lights when they were chosen. The light has the same share of their VALs.
    pub share: f64,
}

impl AreaLight {
    /// Luminance times area \[cd\].
    pub(super) fn power(&self) -> f64 {
        luminance(self.radiance) * 4.0 * self.right.length() * self.up.length()
    }

    /// The centre of each sample's cell \[m\], row by row.
    pub fn sample_points(&self) -> impl Iterator<Item = DVec3> + '_ {
        let [columns, rows] = self.samples;
        let place = |i: u32, n: u32| (2.0 * f64::from(i) + 1.0) / f64::from(n) - 1.0;
        (0..columns * rows)
            .map(move |i| self.middle + place(i % columns, columns) * self.right + place(i / columns, rows) * self.up)
    }
}

/// A triangle of an area light or a small emissive body.
pub(super) struct Part {
    pub(super) instance: usize,
    /// Vertices of the mesh.
    pub(super) corners: [usize; 3],
    pub(super) material: usize,
    /// Mean share of the material's radiance after its texture.
    pub(super) share: DVec3,
}

impl Part {
    /// Luminance [cd/m^2] if materials have this radiance without their textures.
    pub(super) fn light(&self, emissive: impl Fn(usize) -> DVec3) -> f64 {
        luminance(self.share * emissive(self.material))
    }
}

/// The area lights of a scene, as triangles that do not depend on their positions.
#[derive(Default)]
pub(super) struct AreaLights(Vec<Surface>);

/// A surface that is an area light.
struct Surface {
    parts: Vec<Part>,
    samples: [u32; 2],
    share: f64,
}

impl AreaLights {
    /// Takes the largest area lights out of the emissive triangles.
    pub(super) fn take<'a>(
        scene: &Scene,
        emission: &[Option<Emission<'_>>],
        places: &mut Places<'_>,
        triangles: Vec<Emitter<'a>>,
    ) -> (Self, Vec<Emitter<'a>>) {
        let surfaces = connected(&triangles, places, SAME_SIDE);
        let mut nominal = |parts: &[Part]| -> Option<(AreaLight, f64)> {
            let of = |material: usize| emission[material].as_ref().map_or(DVec3::ZERO, |e| e.factor().as_dvec3());
            let (light, filled) = fit(parts, places, of)?;
            let power = light.power();
            (filled >= FILLED && power > 0.0).then_some((light, power))
        };
        let mut found: Vec<(Vec<usize>, Vec<Part>, AreaLight, f64)> = surfaces
            .into_iter()
            .filter_map(|surface| {
                let parts: Vec<Part> = surface.iter().map(|&i| part(&triangles[i], emission)).collect();
                let (light, power) = nominal(&parts)?;
                Some((surface, parts, light, power))
            })
            .collect();
        found.sort_by(|a, b| b.3.total_cmp(&a.3));
        found.truncate(MOST);
        let taken: Vec<usize> = found.iter().flat_map(|surface| &surface.0).copied().collect();
        let total: f64 = found.iter().map(|surface| surface.3).sum();
        let samples = (MOST_DRAWN / scene.triangle_count().max(1)).clamp(found.len(), SAMPLES.max(found.len()));
        let spare = (samples - found.len()) as f64;
        let lights = found
            .into_iter()
            .map(|(_, parts, light, power)| {
                let share = power / total;
                Surface { parts, samples: grid(&light, 1 + (spare * share + 1e-9) as u32), share }
            })
            .collect();
        (Self(lights), without(triangles, &taken))
    }

    /// All triangles of the area lights, by instance and vertices of its mesh.
    pub(super) fn triangles(&self) -> impl Iterator<Item = (usize, [usize; 3])> + '_ {
        self.0.iter().flat_map(|surface| &surface.parts).map(|part| (part.instance, part.corners))
    }

    /// Whether any area light is part of this instance.
    pub(super) fn any_of(&self, instance: usize) -> bool {
        self.0.iter().flat_map(|surface| &surface.parts).any(|part| part.instance == instance)
    }

    /// The area lights in the current state of the scene. Hidden lights and those collapsed to a line have no radiance.
    pub(super) fn now(&self, scene: &Scene) -> Vec<AreaLight> {
        let mut places = Places::new(scene);
        let nothing = AreaLight {
            middle: DVec3::ZERO,
            normal: DVec3::Y,
            right: DVec3::Z,
            up: DVec3::X,
            radiance: DVec3::ZERO,
            samples: [1, 1],
            share: 1.0,
        };
        let light = |surface: &Surface| {
            let fitted = fit(&surface.parts, &mut places, |material| emissive(scene, material));
            let light = fitted.map_or(nothing, |(light, _)| light);
            AreaLight { samples: surface.samples, share: surface.share, ..light }
        };
        self.0.iter().map(light).collect()
    }
}

/// The triangles without those of these indices.
pub(super) fn without<'a>(triangles: Vec<Emitter<'a>>, taken: &[usize]) -> Vec<Emitter<'a>> {
    let mut stays = vec![true; triangles.len()];
    taken.iter().for_each(|&i| stays[i] = false);
    triangles.into_iter().zip(stays).filter_map(|(triangle, stays)| stays.then_some(triangle)).collect()
}

pub(super) fn part(triangle: &Emitter<'_>, emission: &[Option<Emission<'_>>]) -> Part {
    let share = emission[triangle.material].as_ref().map_or(DVec3::ZERO, |emission| triangle.mean_share(emission));
    Part { instance: triangle.instance, corners: triangle.corners, material: triangle.material, share }
}

/// At most `count` samples in a grid with roughly square cells.
fn grid(light: &AreaLight, count: u32) -> [u32; 2] {
    let aspect = light.right.length() / light.up.length();
    let columns = ((f64::from(count) * aspect).sqrt().round() as u32).clamp(1, count);
    [columns, (count / columns).max(1)]
}

/// Groups triangles of one material and instance that share edges, at which the cosine of their normals is larger than
/// `least`: ordered lists of indices.
pub(super) fn connected(triangles: &[Emitter<'_>], places: &mut Places<'_>, least: f64) -> Vec<Vec<usize>> {
    let placed: Vec<([DVec3; 3], DVec3)> = triangles.iter().map(|t| places.triangle(t.instance, t.corners)).collect();
    // Union-find: each triangle's parent is itself or an earlier triangle.
    let mut parent: Vec<usize> = (0..triangles.len()).collect();
    let root = |parent: &mut Vec<usize>, mut i: usize| {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    };
    let mut edges: HashMap<[[u64; 3]; 2], Vec<usize>> = HashMap::new();
    for (i, (corners, normal)) in placed.iter().enumerate() {
        let keys = corners.map(|c| c.to_array().map(|x| (x + 0.0).to_bits()));
        for edge in 0..3 {
            let mut key = [keys[edge], keys[(edge + 1) % 3]];
            key.sort_unstable();
            let met = edges.entry(key).or_default();
            for &other in met.iter() {
                let (a, b) = (normal.normalize_or_zero(), placed[other].1.normalize_or_zero());
                let same = triangles[i].material == triangles[other].material
                    && triangles[i].instance == triangles[other].instance;
                if same && a.dot(b) > least {
                    let (a, b) = (root(&mut parent, i), root(&mut parent, other));
                    parent[a.max(b)] = a.min(b);
                }
            }
            met.push(i);
        }
    }
    let mut surfaces: Vec<Vec<usize>> = vec![Vec::new(); triangles.len()];
    for i in 0..triangles.len() {
        let root = root(&mut parent, i);
        surfaces[root].push(i);
    }
    surfaces.retain(|surface| !surface.is_empty());
    surfaces
}

/// The rectangle of a nearly flat surface, and the share of its bounding rectangle that the surface fills. `None` for
/// other surfaces and hidden ones.
fn fit(parts: &[Part], places: &mut Places<'_>, emissive: impl Fn(usize) -> DVec3) -> Option<(AreaLight, f64)> {
    if parts.iter().any(|part| places.is_hidden(part.instance)) {
        return None;
    }
    let triangles: Vec<([DVec3; 3], DVec3)> =
        parts.iter().map(|part| places.triangle(part.instance, part.corners)).collect();
    let (mut area, mut facing, mut middle, mut light) = (0.0, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for (([a, b, c], face), part) in triangles.iter().zip(parts) {
        let own = 0.5 * face.length();
        area += own;
        facing += 0.5 * *face;
        middle += own / 3.0 * (*a + *b + *c);
        light += own * part.share * emissive(part.material);
    }
    if !(area > 0.0 && area.is_finite() && facing.length() >= FLAT * area) {
        return None;
    }
    let (normal, middle) = (facing.normalize(), middle / area);

    // The smallest bounding rectangle has a side along an edge.
    let mut edges: Vec<DVec3> = triangles
        .iter()
        .flat_map(|([a, b, c], _)| [*b - *a, *c - *b, *a - *c])
        .map(|edge| edge.reject_from(normal))
        .collect();
    edges.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
    let mut sides: Vec<DVec3> = Vec::new();
    for edge in edges.iter().filter_map(|edge| edge.try_normalize()) {
        let is_new = sides.iter().all(|side| side.cross(edge).length() > SAME_DIRECTION);
        if is_new && sides.len() < TRIED {
            sides.push(edge);
        }
    }
    let bounds = |right: DVec3| {
        let up = normal.cross(right);
        let flat = |p: &DVec3| DVec2::new(right.dot(*p - middle), up.dot(*p - middle));
        let corners = || triangles.iter().flat_map(|(corners, _)| corners).map(flat);
        let size = corners().reduce(DVec2::max)? - corners().reduce(DVec2::min)?;
        Some(size.x * size.y)
    };
    let tried = sides.into_iter().filter_map(|right| Some((bounds(right)?, right)));
    let (bounding, right) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let up = normal.cross(right);

    // Second moments give the aspect ratio; the area is kept. For a triangle: A/12 (sum v v + (sum v)(sum v)).
    let mut moments = DVec2::ZERO;
    for (corners, face) in &triangles {
        let flat = corners.map(|p| DVec2::new(right.dot(p - middle), up.dot(p - middle)));
        let sum: DVec2 = flat.iter().sum();
        moments += face.length() / 24.0 * (flat.iter().map(|v| *v * *v).sum::<DVec2>() + sum * sum);
    }
    let half = DVec2::new((3.0 * moments.x / area).sqrt(), (3.0 * moments.y / area).sqrt());
    let half = half * (area / (4.0 * half.x * half.y)).sqrt();
    if !(half.min_element() > 0.0 && half.is_finite()) {
        return None;
    }
    let (right, up) = (half.x * right, half.y * up);
    let light = AreaLight { middle, normal, right, up, radiance: light / area, samples: [1, 1], share: 1.0 };
    Some((light, area / bounding))
}
