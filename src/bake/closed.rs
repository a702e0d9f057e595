//! Caches that nothing lights and nobody sees are left out: those in gaps between things that touch, and on the inner sides of
//! thin walls, which files have wherever a closed body is double-sided. METHOD 8, "beyond the print".
//!
//! They would be half of the caches of a furnished room, and dark neighbours of those on the same wall that are seen.

use super::search::Model;
use super::seeds::Place;
use crate::scene::rays::Rays;
use crate::scene::{Instance, Mesh, Scene};
use glam::DVec3;

/// Rays that look for a way out, as dense as their cosine.
const RAYS: u32 = 32;

/// How far rays look, in units of `d_eps`.
const FAR: f64 = 0.5;

/// A place is closed in where all rays but one end within this part of that: a cache for its room is no use.
const GAP: f64 = 0.3;

/// A place is in the open where so many rays meet nothing: it is as good as any near it.
pub(super) const OPEN: u32 = 8;

/// Start of a ray above its surface, in radii of the scene: more than single precision rounds by.
const LIFT: f64 = 1e-5;

/// What stands still of a scene, to look about in.
pub(super) struct Surroundings<'a> {
    scene: &'a Scene,
    rays: Rays,
    /// Instances of each model; none of a model of which one moves.
    places: Vec<Vec<usize>>,
    /// How far above surfaces rays start \[m\].
    lift: f64,
}

impl<'a> Surroundings<'a> {
    /// Of a scene whose instances have these models.
    pub(super) fn new(scene: &'a Scene, instance_model: &[usize], models: usize) -> Self {
        let moves: Vec<bool> = (0..scene.instances.len()).map(|index| scene.may_move(index)).collect();
        let mut places = vec![Vec::new(); models];
        instance_model.iter().enumerate().for_each(|(instance, &model)| places[model].push(instance));
        for of_model in &mut places {
            if of_model.iter().any(|&instance| moves[instance]) {
                of_model.clear();
            }
        }
        let radius = scene.bounds().map_or(0.0, |(low, high)| 0.5 * low.distance(high));
        Self { scene, rays: Rays::of(scene, |index| !moves[index]), places, lift: LIFT * radius }
    }

    /// How far a point of a model is open in any of its places, at a spacing \[m\]: 0 where it is closed in, [`OPEN`] and more
    /// in the open.
    pub(super) fn openness(&self, (index, model): (usize, &Model<'_>), place: Place, spacing: f64) -> u32 {
        let places = &self.places[index];
        let mesh = &self.scene.meshes[model.mesh];
        let mut most = if places.is_empty() { OPEN } else { 0 };
        for &instance in places {
            if most < OPEN {
                let (position, normal) = placed(&self.scene.instances[instance], mesh, model, place);
                most = most.max(self.escaped(position, normal, FAR * spacing));
            }
        }
        most
    }

    /// Rays from a surface that meet nothing within a distance \[m\]; 1 where there are none, but others come out of the gap, and
    /// 0 where these do not either.
    fn escaped(&self, position: DVec3, normal: DVec3, reach: f64) -> u32 {
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let start = position + normal * self.lift;
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let (mut free, mut out) = (0, 0);
        for i in 0..RAYS {
            let square = (f64::from(i) + 0.5) / f64::from(RAYS);
            let (sin, cos) = (f64::from(i) * golden).sin_cos();
            let direction = (tangent * cos + bitangent * sin) * square.sqrt() + normal * (1.0 - square).sqrt();
            let met = self.rays.within(start, direction, reach);
            free += u32::from(met.is_none());
            out += u32::from(met.is_none_or(|met| met.distance > GAP * reach));
            if free == OPEN {
                break;
            }
        }
        if out > 1 { free.max(1) } else { 0 }
    }
}

/// Where a place is in the world, and the unit normal of its triangle on the side that is shaded.
fn placed(instance: &Instance, mesh: &Mesh, model: &Model<'_>, (triangle, weights): Place) -> (DVec3, DVec3) {
    let triangle = &model.surface.triangles[triangle as usize];
    let vertices = triangle.vertices.map(|v| mesh.vertices[v as usize]);
    let [a, b, c] = vertices.map(|v| instance.world_from_model.transform_point3(v.position.as_dvec3()));
    let normal = (b - a).cross(c - a).normalize_or_zero();
    // Turned over as the model's own is.
    let [p, q, r] = model.surface.corners(triangle);
    let mirrored = instance.world_from_model.matrix3.determinant() * model.surface.linear.determinant() < 0.0;
    let turned = ((q - p).cross(r - p).dot(triangle.normal) < 0.0) != mirrored;
    let [second, third] = weights.map(f64::from);
    (a + (b - a) * second + (c - a) * third, if turned { -normal } else { normal })
}
