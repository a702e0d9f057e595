//! Caches whose light a surface sends on where a ray hits it. Twin of `glsl/lib/hit_caches.glsl`. METHOD 11.

use super::gather::Cache;
use super::interpolate::{Scheme, kernel};
use super::world::{Surface, World};

/// The caches, and what stands between them and a point.
pub struct Around<'a> {
    /// The scene.
    pub world: &'a World<'a>,
    /// All caches.
    pub caches: &'a [Cache],
    /// Distance up to which a cache counts \[m\].
    pub reach: f64,
    /// Distance of both ends of a ray between the point and a cache from their surfaces \[m\].
    pub lift: f64,
}

impl Around<'_> {
    /// Weight of a cache at a surface; 0 if it faces away.
    pub fn weight(&self, surface: &Surface, cache: usize) -> f64 {
        let Cache { position, normal, .. } = self.caches[cache];
        let t = position.distance(surface.position) / self.reach;
        kernel(Scheme::Facing, t.min(0.99), normal.dot(surface.vertex_normal))
    }

    /// Whether nothing stands between a surface and a cache.
    pub fn sees(&self, surface: &Surface, cache: usize) -> bool {
        let Cache { position, normal, .. } = self.caches[cache];
        let start = surface.position + self.lift * surface.geometric;
        !self.world.blocked(start, position + self.lift * normal)
    }

    /// The caches of non-zero weight among `references`, the largest weight first.
    pub fn sorted(&self, surface: &Surface, references: &[usize]) -> Vec<usize> {
        let mut sorted: Vec<usize> = references.iter().copied().filter(|c| self.weight(surface, *c) > 0.0).collect();
        sorted.sort_by(|a, b| self.weight(surface, *b).total_cmp(&self.weight(surface, *a)).then(a.cmp(b)));
        sorted.dedup();
        sorted
    }

    /// The first that the surface sees of the three caches of largest weight; the first of all if it sees none.
    pub fn first_seen(&self, surface: &Surface, sorted: &[usize]) -> Option<usize> {
        sorted.iter().copied().take(3).find(|cache| self.sees(surface, *cache)).or(sorted.first().copied())
    }
}
