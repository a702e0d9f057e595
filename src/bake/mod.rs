//! Places the caches on the surfaces of a scene, once per scene. METHOD 8, thesis 5.6.
//!
//! Voxels of side `d_eps / 2` cut each mesh into pieces ([`voxel`]). In each voxel, caches are formed for groups of
//! similar normals and snapped onto triangles ([`seeds`]). Superfluous caches are removed. Then every vertex gets its
//! references and every cache its area. All of this happens at world scale, so that the spacing is in metres of the
//! world under any scale, and relative to the mesh's own centre, so that the mesh's place does not matter.
//!
//! *Guarantee*: every point of the surface has a cache within `d_eps` whose triangle's normal is within `theta_eps` of
//! the point's normal. The guarantee holds by construction (a piece's cache lies in the piece's own voxel, whose
//! diagonal is 0.87 `d_eps`). Every later step keeps it, and [`Coverage`] measures it at the end. Caches in gaps
//! between static things are then left out (`closed`): they receive no light and their surface is never seen.

mod area;
mod assign;
pub mod bvh;
mod cells;
pub mod closed;
mod file;
mod grid;
mod prune;
mod search;
pub mod seeds;
mod surface;
pub mod voxel;

pub use cells::{CellSet, Cells};
pub use file::{bake_cached, bake_kept_in};

use crate::error::Result;
use crate::scene::{Mesh, Scene};
use area::Share;
use closed::Surroundings;
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use search::{Model, Placement, SceneBounds};
use seeds::Seed;
use std::sync::atomic::{AtomicUsize, Ordering};
use surface::Surface;

/// Settings of the bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeSettings {
    /// How densely caches are placed.
    pub density: Density,
    /// `theta_eps`: largest angle \[rad\] between the normals of a surface and its cache.
    /// With a count below 8 for each instance, small models are allowed 75 degrees.
    pub angle: f32,
    /// References per vertex, 8 or 16.
    pub references: usize,
}

/// How densely caches are placed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// About this many caches over all instances of the scene; the bake searches for the spacing.
    Count(usize),
    /// `d_eps` [m in world space]: largest distance of a surface point to a cache.
    Spacing(f64),
}

/// The caches of a scene and the references of its vertices to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CacheSet {
    /// `d_eps` \[m\], as given or found.
    pub spacing: f64,
    /// One per mesh and stretch. Instances that differ only by rotation, mirroring and translation share one.
    pub models: Vec<ModelCaches>,
    /// For each of `Scene::instances`, the index into `models`.
    pub instance_model: Vec<usize>,
    /// Cells in which pixels look up their caches; only for lookup per pixel. See [`CacheSet::with_cells`].
    pub cells: Option<CellSet>,
}

/// The caches of one mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelCaches {
    /// Index into `Scene::meshes`.
    pub mesh: usize,
    /// Linear part of the transform from model to world space with which the caches were placed.
    pub linear: DMat3,
    /// The caches, in a space-filling order.
    pub caches: Vec<Cache>,
    /// For each vertex of the mesh, `BakeSettings::references` indices into `caches`, best first; padded with
    /// `NO_CACHE`.
    pub references: Vec<u16>,
    /// Result of checking every piece of surface against its caches.
    pub coverage: Coverage,
}

/// A cache: a point on a triangle, in the mesh's model space.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Cache {
    /// Model-space position.
    pub position: Vec3,
    /// Unit model-space normal of the triangle, on the side of its vertex normals. A vertex normal leans over the
    /// triangle's edge and would receive light from behind it.
    pub normal: Vec3,
    /// Area of the surface that this cache represents [m^2 in world space]; METHOD 6, eq. 5.58.
    pub area: f32,
    /// Centre, in model space, of the rectangle that represents this surface as an occluder.
    pub middle: Vec3,
    /// From the centre to the middle of an edge, in model space; perpendicular to the normal in world space.
    pub axis: Vec3,
    /// From the centre to the adjacent edge, perpendicular to normal and axis [m in world space].
    pub breadth: f32,
    /// Index of the mesh's triangle that the cache lies on.
    pub triangle: u32,
    /// Barycentric weights of the triangle's second and third corners.
    pub barycentric: [f32; 2],
}

/// Measured proof that every surface point has its cache.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Largest distance \[m\] from a surface point to the cache that covers it; at most `d_eps`.
    pub distance: f64,
    /// Largest angle \[rad\] between a surface's geometric normal and that of the covering cache's triangle.
    pub angle: f64,
}

/// Padding of reference lists, for models with fewer caches than references.
pub const NO_CACHE: u16 = u16::MAX;

/// Relative tolerance, as a part of the largest element, within which two stretches count as the same.
const SAME_STRETCH: f64 = 1e-4;

/// Places the caches of a scene and assigns each vertex its references. METHOD 8.
///
/// `progress` gets the completed part from 0 to 1 and the current step; several threads may call it. The result depends
/// only on the scene and the settings, not on the number of threads. If a count cannot be met (each instance needs one
/// cache), the nearest possible count is used. If very many instances face all ways and therefore need far more caches
/// than the count, each cache represents wider angles than requested; [`Coverage::angle`] reports the angle.
///
/// # Errors
/// Fails if the scene has no triangles. Fails with `TooLarge` if a model would get more caches than 16-bit references
/// can address, or if the spacing is tiny compared to a model.
pub fn bake(scene: &Scene, settings: &BakeSettings, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<CacheSet> {
    assert!(settings.angle.is_finite() && settings.angle > 0.0, "bake: angle {}", settings.angle);
    assert!(settings.references > 0, "bake: no references");
    if let Density::Spacing(spacing) = settings.density {
        assert!(spacing.is_finite() && spacing > 0.0, "bake: spacing {spacing}");
    }
    progress(0.0, "reading surfaces");
    let (models, instance_model) = models(scene);
    let around = Surroundings::new(scene, &instance_model, models.len());
    let search::Found { bounds, placements } = search::search(&models, &around, settings, progress)?;

    let done = AtomicUsize::new(0);
    let steps = 2 * models.len().max(1);
    let step = |what: &str| progress(0.6 + 0.4 * done.fetch_add(1, Ordering::Relaxed) as f32 / steps as f32, what);
    let models = (models.par_iter().zip(placements))
        .map(|(model, placement)| {
            finish(model, &scene.meshes[model.mesh], placement, bounds, settings.references, &step)
        })
        .collect();
    progress(1.0, "caches placed");
    Ok(CacheSet { spacing: bounds.distance, models, instance_model, cells: None })
}

/// The models to bake, and the model of each instance.
fn models(scene: &Scene) -> (Vec<Model<'_>>, Vec<usize>) {
    let mut models: Vec<Model> = Vec::new();
    let mut of_mesh = vec![Vec::new(); scene.meshes.len()];
    let instance_model = (scene.instances.iter())
        .map(|instance| {
            let linear = instance.stretch();
            let same = |&&model: &&usize| same_stretch(models[model].surface.linear, linear);
            if let Some(&model) = of_mesh[instance.mesh].iter().find(same) {
                models[model].instances += 1;
                return model;
            }
            let mesh = &scene.meshes[instance.mesh];
            let surface = Surface::new(mesh, linear);
            models.push(Model { mesh: instance.mesh, name: &mesh.name, instances: 1, surface });
            of_mesh[instance.mesh].push(models.len() - 1);
            models.len() - 1
        })
        .collect();
    (models, instance_model)
}

/// Whether two transforms differ only by rotation and mirroring.
fn same_stretch(a: DMat3, b: DMat3) -> bool {
    let (a, b) = (a.transpose() * a, b.transpose() * b);
    let largest = a.to_cols_array().into_iter().fold(0.0, f64::max);
    (a - b).to_cols_array().into_iter().all(|difference| difference.abs() <= SAME_STRETCH * largest)
}

/// Turns a placement into the caches of a model.
fn finish(
    model: &Model,
    mesh: &Mesh,
    Placement { voxels, seeds, count }: Placement,
    bounds: SceneBounds,
    references: usize,
    step: &(dyn Fn(&str) + Sync),
) -> ModelCaches {
    let (surface, spacing) = (&model.surface, bounds.distance);
    let bounds = bounds.of(surface);
    step("measuring areas");
    let coverage = prune::measure(surface, &voxels, &seeds, bounds);
    let mut caches: Vec<Cache> = seeds.iter().map(|seed| cache(surface, mesh, seed)).collect();
    let normals: Vec<DVec3> = (caches.iter().zip(&seeds))
        .map(|(cache, seed)| (surface.normal_matrix * cache.normal.as_dvec3()).normalize_or(seed.normal))
        .collect();
    let model_from_bake = inverse(surface.linear);
    let shares = area::shares(surface, &voxels, &seeds, &normals, spacing);
    for ((cache, share), seed) in caches.iter_mut().zip(shares).zip(&seeds) {
        let share = if mesh.placing.is_some() { on_own_shape(share, surface, mesh, seed) } else { share };
        cache.area = share.area as f32;
        cache.middle = cache.position + (model_from_bake * share.middle).as_vec3();
        cache.axis = (model_from_bake * share.axis).as_vec3();
        cache.breadth = share.breadth as f32;
    }
    drop(voxels);
    step("finding references");
    // Caches in gaps have taken their share of the surface; drop them now.
    caches.truncate(count);
    let positions: Vec<DVec3> = seeds[..count].iter().map(|s| s.position).collect();
    let references = assign::assign(surface, &caches, &positions, references, spacing);
    ModelCaches { mesh: model.mesh, linear: surface.linear, caches, references, coverage }
}

/// A share of the surface at placing positions as one of the surface itself, by the map of the cache's triangle.
fn on_own_shape(share: Share, surface: &Surface, mesh: &Mesh, seed: &Seed) -> Share {
    let triangle = &surface.triangles[seed.triangle as usize];
    let own = triangle.vertices.map(|v| surface.linear * mesh.vertices[v as usize].position.as_dvec3());
    let frame = |[a, b, c]: [DVec3; 3]| {
        let cross = (b - a).cross(c - a);
        let area = cross.length();
        (DMat3::from_cols(b - a, c - a, cross / area * area.sqrt()), area)
    };
    let ((to, own_area), (from, area)) = (frame(own), frame(surface.corners(triangle)));
    let map = to * from.inverse();
    let axis = map * share.axis;
    let shrunk = share.axis.length() / axis.length().max(f64::MIN_POSITIVE);
    Share {
        area: share.area * own_area / area,
        middle: map * share.middle,
        axis,
        breadth: share.breadth * shrunk * own_area / area,
    }
}

/// The inverse of a transform; the regularised pseudo-inverse of a flattening one.
fn inverse(linear: DMat3) -> DMat3 {
    let squares = linear.transpose() * linear;
    let trace = squares.x_axis.x + squares.y_axis.y + squares.z_axis.z;
    let least = (1e-12 * trace).max(f64::MIN_POSITIVE);
    (squares + DMat3::from_diagonal(DVec3::splat(least))).inverse() * linear.transpose()
}

/// A cache relative to its mesh, without its share of the surface.
fn cache(surface: &Surface, mesh: &Mesh, seed: &Seed) -> Cache {
    let triangle = &surface.triangles[seed.triangle as usize];
    let [second, third] = seed.weights.map(f64::from);
    let corners = triangle.vertices.map(|v| mesh.vertices[v as usize]);
    let [a, b, c] = corners.map(|v| v.position.as_dvec3());
    let [na, nb, nc] = corners.map(|v| v.normal.as_dvec3());
    let geometric = {
        let winding = (b - a).cross(c - a).normalize_or_zero();
        if (na + nb + nc).dot(winding) < 0.0 { -winding } else { winding }
    };
    let interpolated = na * (1.0 - second - third) + nb * second + nc * third;
    Cache {
        position: (a + (b - a) * second + (c - a) * third).as_vec3(),
        normal: geometric.try_normalize().or(interpolated.try_normalize()).unwrap_or(DVec3::Y).as_vec3(),
        triangle: triangle.index,
        barycentric: seed.weights,
        ..Cache::default()
    }
}
