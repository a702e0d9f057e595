//! Places the caches on the surfaces of a scene, once. METHOD 8, thesis 5.6.
//!
//! Each mesh is cut into pieces by voxels of side `d_eps / 2` ([`voxel`]); in each voxel caches are formed for groups
//! of like normals and snapped onto triangles ([`seeds`]); those that others make superfluous go; then every vertex
//! gets its references and every cache its area. All of it happens in world size, so that the spacing is in metres of
//! the world under any scale, and around the mesh's own centre, so that it may lie anywhere.
//!
//! *Guarantee*: every point of the surface has a cache within `d_eps` of it whose triangle's normal is within
//! `theta_eps` of its own. It holds by construction (a piece's cache lies in its own voxel, whose diagonal is
//! 0.87 `d_eps`), is kept by every step, and is measured at the end ([`Coverage`]). Caches in gaps between things that
//! stand still are then left out (`closed`): nothing lights them and nobody sees what they stand for.

mod area;
mod assign;
pub mod bvh;
mod cells;
mod closed;
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
use closed::Surroundings;
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use search::{Model, Placement};
use seeds::{Bounds, Seed};
use std::sync::atomic::{AtomicUsize, Ordering};
use surface::Surface;

/// What the bake is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeSettings {
    /// How densely caches stand.
    pub density: Density,
    /// `theta_eps`: largest angle \[rad\] between a surface's normal and its cache's.
    pub angle: f32,
    /// References per vertex, 8 or 16.
    pub references: usize,
}

/// How densely caches stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// About this many caches over all instances of the scene; the bake searches the spacing.
    Count(usize),
    /// `d_eps` [m in world space]: largest distance of a surface point to a cache.
    Spacing(f64),
}

/// The caches of a scene and which of them each vertex refers to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CacheSet {
    /// `d_eps` \[m\] that was used or found.
    pub spacing: f64,
    /// One per mesh and stretch: instances that differ only by rotation, mirroring and translation share one.
    pub models: Vec<ModelCaches>,
    /// For each of `Scene::instances`, the index into `models`.
    pub instance_model: Vec<usize>,
    /// Where pixels find their caches; only where they look for themselves. See [`CacheSet::with_cells`].
    pub cells: Option<CellSet>,
}

/// The caches of one mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelCaches {
    /// Index into `Scene::meshes`.
    pub mesh: usize,
    /// Linear part of the transform from model to world space that the caches were placed under.
    pub linear: DMat3,
    /// The caches, in a space-filling order.
    pub caches: Vec<Cache>,
    /// For each vertex of the mesh, `BakeSettings::references` indices into `caches`, best first; `NO_CACHE` pads.
    pub references: Vec<u16>,
    /// What was found when every piece of surface was checked against its caches.
    pub coverage: Coverage,
}

/// A cache: a point on a triangle. Position and normal are the triangle's, interpolated in the mesh's model space.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Cache {
    /// Model-space position.
    pub position: Vec3,
    /// Unit model-space shading normal: the triangle's vertex normals, interpolated at the cache.
    pub normal: Vec3,
    /// Share of the surface that this cache stands for [m^2 in world space]; METHOD 6, eq. 5.58.
    pub area: f32,
    /// Middle, in model space, of the rectangle that stands for that share when it is in the way of light.
    pub middle: Vec3,
    /// From there to the middle of an edge, in model space; square to the normal in the world.
    pub axis: Vec3,
    /// From there to the next edge, square to both [m in world space].
    pub breadth: f32,
    /// Triangle of the mesh the cache lies on.
    pub triangle: u32,
    /// Barycentric weights of the triangle's second and third corner.
    pub barycentric: [f32; 2],
}

/// The proof that every surface point has its cache.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Largest distance \[m\] of a surface point to the cache that covers it; at most `d_eps`.
    pub distance: f64,
    /// Largest angle \[rad\] between a surface's geometric normal and that of the covering cache's triangle.
    pub angle: f64,
}

/// Pads reference lists of models with fewer caches than references.
pub const NO_CACHE: u16 = u16::MAX;

/// Stretches that agree to this part of their largest element are one.
const SAME_STRETCH: f64 = 1e-4;

/// Places the caches of a scene and finds each vertex its references. METHOD 8.
///
/// `progress` is told how much is done, from 0 to 1, and what is being done; it may be called from several threads.
/// The result depends on the scene and the settings alone, not on the number of threads. A count that cannot be met
/// (an instance needs one cache) gives the nearest that can. Where far more caches than the count were needed because
/// very many instances face all ways, caches stand for wider angles than asked for; [`Coverage::angle`] tells.
///
/// # Errors
/// A scene without triangles. `TooLarge` where a model would get more caches than 16-bit references can name, or where the
/// spacing is minute against a model.
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

/// What is to be baked, and the model of each instance.
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

/// Whether two transforms differ by no more than rotation and mirroring.
fn same_stretch(a: DMat3, b: DMat3) -> bool {
    let (a, b) = (a.transpose() * a, b.transpose() * b);
    let largest = a.to_cols_array().into_iter().fold(0.0, f64::max);
    (a - b).to_cols_array().into_iter().all(|difference| difference.abs() <= SAME_STRETCH * largest)
}

/// Turns a placement into what is kept of it.
fn finish(
    model: &Model,
    mesh: &Mesh,
    Placement { voxels, seeds, count }: Placement,
    bounds: Bounds,
    references: usize,
    step: &(dyn Fn(&str) + Sync),
) -> ModelCaches {
    let (surface, spacing) = (&model.surface, bounds.distance);
    step("measuring areas");
    let coverage = prune::measure(surface, &voxels, &seeds, bounds);
    let mut caches: Vec<Cache> = seeds.iter().map(|seed| cache(surface, mesh, seed)).collect();
    let normals: Vec<DVec3> = (caches.iter().zip(&seeds))
        .map(|(cache, seed)| (surface.normal_matrix * cache.normal.as_dvec3()).normalize_or(seed.normal))
        .collect();
    let model_from_bake = inverse(surface.linear);
    for (cache, share) in caches.iter_mut().zip(area::shares(surface, &voxels, &seeds, &normals, spacing)) {
        cache.area = share.area as f32;
        cache.middle = cache.position + (model_from_bake * share.middle).as_vec3();
        cache.axis = (model_from_bake * share.axis).as_vec3();
        cache.breadth = share.breadth as f32;
    }
    drop(voxels);
    step("finding references");
    // Those in gaps have had their share of the surface, and go.
    caches.truncate(count);
    let positions: Vec<DVec3> = seeds[..count].iter().map(|s| s.position).collect();
    let references = assign::assign(surface, &caches, &positions, references, spacing);
    ModelCaches { mesh: model.mesh, linear: surface.linear, caches, references, coverage }
}

/// The inverse of a transform; of one that flattens, the shortest way back.
fn inverse(linear: DMat3) -> DMat3 {
    let squares = linear.transpose() * linear;
    let trace = squares.x_axis.x + squares.y_axis.y + squares.z_axis.z;
    let least = (1e-12 * trace).max(f64::MIN_POSITIVE);
    (squares + DMat3::from_diagonal(DVec3::splat(least))).inverse() * linear.transpose()
}

/// A cache in terms of the mesh, without its share of the surface.
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
        normal: interpolated.try_normalize().unwrap_or(geometric).as_vec3(),
        triangle: triangle.index,
        barycentric: seed.weights,
        ..Cache::default()
    }
}
