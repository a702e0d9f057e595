//! Small emissive bodies, such as bulbs and flames, as lamps. Rays would find them only by chance. METHOD 2.

use super::area_lights::{Part, connected, part, without};
use super::emitters::{Emitter, Places, emissive};
use crate::scene::material::Emission;
use crate::scene::rays::{Rays, cosine_directions};
use crate::scene::{Scene, luminance};
use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// Largest radius, in radii of the scene. Rays find larger bodies well.
const SMALL: f64 = 0.05;

/// Least power, as a share of that of all emissive surfaces.
const LEAST: f64 = 1.0 / 256.0;

/// Maximum number of triangles of a body, which each change of the surfaces visits again.
const MOST_TRIANGLES: usize = 32_768;

/// Directions from which a body's silhouette is measured: corners of an icosahedron and of a dodecahedron, without opposite
/// ones. The mean of a polynomial of degree 5 over them is that over all directions.
const AXES: [DVec3; 16] = {
    let [long, short] = [1.618_033_988_749_895, 0.618_033_988_749_895];
    [
        DVec3::new(0.0, 1.0, long),
        DVec3::new(0.0, -1.0, long),
        DVec3::new(1.0, long, 0.0),
        DVec3::new(-1.0, long, 0.0),
        DVec3::new(long, 0.0, 1.0),
        DVec3::new(long, 0.0, -1.0),
        DVec3::new(1.0, 1.0, 1.0),
        DVec3::new(1.0, 1.0, -1.0),
        DVec3::new(1.0, -1.0, 1.0),
        DVec3::new(-1.0, 1.0, 1.0),
        DVec3::new(0.0, short, long),
        DVec3::new(0.0, -short, long),
        DVec3::new(short, long, 0.0),
        DVec3::new(-short, long, 0.0),
        DVec3::new(long, 0.0, short),
        DVec3::new(long, 0.0, -short),
    ]
};

/// Maximum number of triangles, and rays from each, that measure how much of its light a body keeps from getting out.
const TRIED: usize = 256;
const RAYS: u32 = 32;

/// A small emissive body in the world. In the unit direction `d` it shines with the intensity
/// `intensity max(sqrt(d.q d) + lean.d, 0)`: an ellipsoid of which a part may be missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyLight {
    /// Centre of its surface \[m\].
    pub middle: DVec3,
    /// Root of the mean squared intensity of the ellipsoid \[cd\].
    pub intensity: DVec3,
    /// Quadratic form of the squared silhouette over its mean: the identity for balls.
    pub q: DMat3,
    /// Half of the sum of the triangles' normals, by area, over the root of the mean squared silhouette: 0 for closed bodies.
    pub lean: DVec3,
    /// Radius of a disc as large as its mean silhouette \[m\].
    pub radius: f64,
    /// Radius of a ball about its centre that holds all of it \[m\].
    pub clear: f64,
    /// Share of the power of all bodies when they were chosen. The light has the same share of their VALs.
    pub share: f64,
}

/// The small emissive bodies of a scene, as triangles that do not depend on their positions.
#[derive(Default)]
pub(super) struct Bodies(Vec<Body>);

struct Body {
    parts: Vec<Part>,
    /// Share of its light that does not meet the body itself.
    escaping: f64,
    share: f64,
}

impl Bodies {
    /// Takes at most `most` bodies out of the emissive triangles, those of the largest power. `other`: power of all other
    /// emissive surfaces.
    pub(super) fn take<'a>(
        scene: &Scene,
        emission: &[Option<Emission<'_>>],
        places: &mut Places<'_>,
        triangles: Vec<Emitter<'a>>,
        (most, other): (usize, f64),
    ) -> (Self, Vec<Emitter<'a>>) {
        let small = scene.bounds().map_or(0.0, |(low, high)| 0.5 * SMALL * low.distance(high));
        let of = |material: usize| emission[material].as_ref().map_or(DVec3::ZERO, |e| e.factor().as_dvec3());
        let mut found: Vec<(Vec<usize>, Body, f64)> = connected(&triangles, places, -2.0)
            .into_iter()
            .map(|members| {
                let parts: Vec<Part> = members.iter().map(|&i| part(&triangles[i], emission)).collect();
                let power = members.iter().zip(&parts).map(|(&i, part)| triangles[i].area() * part.light(of)).sum();
                (members, Body { parts, escaping: 1.0, share: 1.0 }, power)
            })
            .collect();
        let least = LEAST * (other + found.iter().map(|body| body.2).sum::<f64>());
        let is_small = |light: &BodyLight| light.clear <= small && light.intensity.as_vec3().is_finite();
        found.retain(|(members, body, power)| {
            *power > least
                && members.len() <= MOST_TRIANGLES
                && body.now(places, of).is_some_and(|light| is_small(&light))
        });
        found.sort_by(|a, b| b.2.total_cmp(&a.2));
        found.truncate(most);
        let all: f64 = found.iter().map(|body| body.2).sum();
        let taken: Vec<usize> = found.iter().flat_map(|(members, ..)| members).copied().collect();
        let bodies = found.into_iter().map(|(members, body, power)| {
            let escaping = escaping(&members.iter().map(|&i| &triangles[i]).collect::<Vec<_>>());
            Body { escaping, share: power / all, ..body }
        });
        (Self(bodies.collect()), without(triangles, &taken))
    }

    /// All triangles of the bodies, by instance and vertices of its mesh.
    pub(super) fn triangles(&self) -> impl Iterator<Item = (usize, [usize; 3])> + '_ {
        self.0.iter().flat_map(|body| &body.parts).map(|part| (part.instance, part.corners))
    }

    /// Whether any body is part of this instance.
    pub(super) fn any_of(&self, instance: usize) -> bool {
        self.0.iter().any(|body| body.instance() == instance)
    }

    /// The bodies in the current state of the scene. Hidden ones have no light.
    pub(super) fn now(&self, scene: &Scene) -> Vec<BodyLight> {
        let mut places = Places::new(scene);
        let dark = BodyLight {
            middle: DVec3::ZERO,
            intensity: DVec3::ZERO,
            q: DMat3::IDENTITY,
            lean: DVec3::ZERO,
            radius: 0.0,
            clear: 1.0,
            share: 1.0,
        };
        let mut light = |body: &Body| {
            let hidden = places.is_hidden(body.instance());
            let found = body.now(&mut places, |material| emissive(scene, material)).filter(|_| !hidden);
            BodyLight { share: body.share, ..found.unwrap_or(dark) }
        };
        self.0.iter().map(&mut light).collect()
    }
}

impl Body {
    /// The instance of all its triangles.
    fn instance(&self) -> usize {
        self.parts[0].instance
    }

    /// The light of these triangles where they are; `None` if they have no area or no light.
    fn now(&self, places: &mut Places<'_>, emissive: impl Fn(usize) -> DVec3) -> Option<BodyLight> {
        let (mut area, mut middle, mut sent) = (0.0, DVec3::ZERO, DVec3::ZERO);
        let mut faces = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            let ([a, b, c], face) = places.triangle(part.instance, part.corners);
            let own = 0.5 * face.length();
            area += own;
            middle += own / 3.0 * (a + b + c);
            sent += own * part.share * emissive(part.material);
            faces.push(([a, b, c], 0.5 * part.light(&emissive) * face));
        }
        let (middle, weight) = (middle / area, luminance(sent) / area);
        let clear = faces.iter().flat_map(|(corners, _)| corners).map(|p| p.distance(middle)).fold(0.0, f64::max);
        if !(area > 0.0 && weight > 0.0 && weight.is_finite() && clear > 0.0 && clear.is_finite()) {
            return None;
        }
        // Silhouettes of both sides together, by luminance; what is missing on one side leans to the other.
        let silhouette = |d: DVec3| 0.5 * faces.iter().map(|(_, face)| face.dot(d).abs()).sum::<f64>() / weight;
        let lean = 0.5 * faces.iter().map(|(_, face)| *face).sum::<DVec3>() / weight;
        // The squared silhouette of an ellipsoid is a quadratic form `q`. The mean of `d d^T d.q d` over all directions is
        // `(trace(q) + 2 q) / 15`.
        let (mut mean, mut moments) = (0.0, DMat3::ZERO);
        for d in AXES.map(DVec3::normalize) {
            let seen = silhouette(d);
            mean += seen / AXES.len() as f64;
            moments += DMat3::from_cols(d * d.x, d * d.y, d * d.z) * (seen * seen / AXES.len() as f64);
        }
        let trace = moments.x_axis.x + moments.y_axis.y + moments.z_axis.z;
        let q = (moments * 7.5 - DMat3::from_diagonal(DVec3::splat(1.5 * trace))) * (1.0 / trace);
        let size = trace.sqrt();
        Some(BodyLight {
            middle,
            intensity: self.escaping * size * sent / area,
            q,
            lean: lean / size,
            radius: (mean / PI).sqrt().min(clear),
            clear,
            share: self.share,
        })
    }
}

/// Share of its light that a body does not keep to itself.
fn escaping(body: &[&Emitter<'_>]) -> f64 {
    let rays = Rays::of_triangles(body.iter().map(|triangle| (triangle.corners_in_world, false)).collect());
    let (mut free, mut all) = (0.0, 0.0);
    for triangle in body.iter().step_by(body.len().div_ceil(TRIED)) {
        let [a, b, c] = triangle.corners_in_world;
        let normal = triangle.face.normalize_or(DVec3::Y);
        let size = triangle.area().sqrt();
        let start = (a + b + c) / 3.0 + 1e-4 * size * normal;
        let gets_out = |direction: &DVec3| rays.within(start, *direction, f64::MAX).is_none();
        let share = cosine_directions(normal, RAYS).filter(gets_out).count() as f64 / f64::from(RAYS);
        free += triangle.area() * share;
        all += triangle.area();
    }
    free / all
}
