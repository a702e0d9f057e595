//! Leaves out caches that receive no light and are never seen: in gaps between touching things, and on inner sides of
//! thin walls, which files have wherever a closed body is double-sided. METHOD 8, "beyond the print".
//!
//! They would be half of the caches of a furnished room, and dark neighbours of visible caches on the same wall.

use super::search::Model;
use super::seeds::Place;
use crate::scene::rays::{Rays, cosine_directions};
use crate::scene::{Instance, Mesh, Scene};
use glam::DVec3;

/// Number of cosine-distributed rays that search for a way out.
const RAYS: u32 = 32;

/// Length of the rays, in units of `d_eps`.
const FAR: f64 = 0.5;

/// A place is closed in if all rays but one end within this distance, in units of `d_eps`: a cache for such a space is
/// useless.
pub const GAP: f64 = 0.15;

/// A place is in the open if this many rays hit nothing: it is as good as any place nearby.
pub(super) const OPEN: u32 = 8;

/// Offset of a ray's start from its surface, in radii of the scene; more than the rounding of single precision.
const LIFT: f64 = 1e-5;

/// The static part of a scene, for visibility rays.
pub(super) struct Surroundings<'a> {
    scene: &'a Scene,
    rays: Rays,
    /// Instances of each model; empty if one of its instances moves.
    places: Vec<Vec<usize>>,
    /// Offset of ray starts from surfaces \[m\].
    lift: f64,
}

impl<'a> Surroundings<'a> {
    /// The surroundings for a scene whose instances have these models.
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

    /// How open a point of a model is, at a spacing \[m\], in the most open of its instances: 0 if closed in, at least
    /// [`OPEN`] in the open.
    pub(super) fn openness(&self, (index, model): (usize, &Model<'_>), place: Place, spacing: f64) -> u32 {
        let places = &self.places[index];
        let mesh = &self.scene.meshes[model.mesh];
        let mut most = if places.is_empty() { OPEN } else { 0 };
        for &instance in places {
            if most < OPEN {
                let (position, normal) = placed(&self.scene.instances[instance], mesh, model, place);
                most = most.max(self.escaped(position, normal, spacing));
            }
        }
        most
    }

    /// Number of rays from a surface that hit nothing within a distance \[m\]. If there are none: 1 if some rays leave
    /// the gap, otherwise 0.
    fn escaped(&self, position: DVec3, normal: DVec3, spacing: f64) -> u32 {
        let start = position + normal * self.lift;
        let (mut free, mut out) = (0, 0);
        for direction in cosine_directions(normal, RAYS) {
            let met = self.rays.within(start, direction, FAR * spacing);
            free += u32::from(met.is_none());
            out += u32::from(met.is_none_or(|met| met.distance > GAP * spacing));
            if free == OPEN {
                break;
            }
        }
        if out > 1 { free.max(1) } else { 0 }
    }
}

/// World position of a place, and the unit normal of the shaded side of its triangle.
fn placed(instance: &Instance, mesh: &Mesh, model: &Model<'_>, (triangle, weights): Place) -> (DVec3, DVec3) {
    let triangle = &model.surface.triangles[triangle as usize];
    let vertices = triangle.vertices.map(|v| mesh.vertices[v as usize]);
    let [a, b, c] = vertices.map(|v| instance.world_from_model.transform_point3(v.position.as_dvec3()));
    let normal = (b - a).cross(c - a).normalize_or_zero();
    // Flipped if the model's own normal is flipped.
    let [p, q, r] = model.surface.corners(triangle);
    let mirrored = instance.world_from_model.matrix3.determinant() * model.surface.linear.determinant() < 0.0;
    let turned = ((q - p).cross(r - p).dot(triangle.normal) < 0.0) != mirrored;
    let [second, third] = weights.map(f64::from);
    (a + (b - a) * second + (c - a) * third, if turned { -normal } else { normal })
}
