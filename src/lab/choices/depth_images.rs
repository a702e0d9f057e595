//! Depth images against rays, measured at the caches, for several ways of drawing them.

use rayon::prelude::*;

use super::study::Study;
use crate::reference::depth_image::{DepthImage, Rule, Shape};
use crate::reference::gather::{Cache, luminance, val_geometry};
use crate::reference::rsm::Val;
use crate::reference::world::Sides;

/// Errors of one way to draw the images.
#[derive(Clone, Debug, PartialEq)]
pub struct Occluded {
    /// The variation.
    pub name: String,
    /// Relative error of the irradiance, summed over all surfaces.
    pub bias: f64,
    /// Root mean square error of a cache's irradiance over the mean, weighted by area.
    pub rmse: f64,
}

/// Distance above a surface at which rays start, as a share of the scene's radius.
const ABOVE: f64 = 1e-5;

/// The variations to compare.
fn rules() -> Vec<(String, Rule)> {
    // With few VALs neighbours are too far apart to share a visibility test.
    let base = Rule { together: 1, ..Rule::default() };
    let mut all = vec![("default".to_owned(), base)];
    all.extend([12, 16, 20, 32, 48].map(|side| (format!("{side} x {side} texels"), Rule { side, ..base })));
    let shape = |name: String, shape| (name, Rule { shape, ..base });
    all.extend([0.9, 0.95, 1.05, 1.1].map(|size| shape(format!("rectangles x {size}"), Shape::Rectangle(size))));
    all.extend([0.9, 1.0, 1.1].map(|size| shape(format!("ellipses x {size}"), Shape::Ellipse(size))));
    all.extend([0.8, 0.9, 1.0].map(|radius| shape(format!("discs, radius {radius}"), Shape::Disc(radius))));
    all.extend([0.0, 0.5, 1.0, 4.0].map(|margin| (format!("margin {margin}"), Rule { margin, ..base })));
    all.extend([0.0, 0.05, 0.2, 0.4].map(|plane| (format!("plane {plane}"), Rule { plane, ..base })));
    all.extend([0.0, 0.5].map(|slope| (format!("slope {slope}"), Rule { slope, ..base })));
    all.push(("no slope, no margin".to_owned(), Rule { slope: 0.0, margin: 0.0, ..base }));
    all.push(("from the front alone".to_owned(), Rule { two_sided: false, ..base }));
    all.extend([2, 4, 8].map(|together| (format!("{together} VALs together"), Rule { together, ..base })));
    all
}

impl Study<'_> {
    /// No shadows, then every way to draw depth images, against a ray from each cache to every VAL. Caches inside of
    /// bodies do not count: their light is never seen.
    pub fn depth_images(&self) -> Vec<Occluded> {
        let reached: Vec<Option<Vec<(f64, bool)>>> = self.caches.par_iter().map(|cache| self.reached(cache)).collect();
        let sum = |of: &dyn Fn(f64, bool) -> f64| -> Vec<f64> {
            reached.iter().map(|all| all.iter().flatten().map(|(light, seen)| of(*light, *seen)).sum()).collect()
        };
        let truth = sum(&|light, seen| if seen { light } else { 0.0 });
        let row = |name: String, found: &[f64]| {
            let mean = |of: &dyn Fn(usize) -> f64| {
                let counted = (0..found.len()).filter(|i| reached[*i].is_some());
                let (sum, area) =
                    counted.fold((0.0, 0.0), |(s, a), i| (s + self.discs[i].area * of(i), a + self.discs[i].area));
                sum / area
            };
            let wanted = mean(&|i| truth[i]);
            let rmse = mean(&|i| (found[i] - truth[i]).powi(2)).sqrt() / wanted;
            Occluded { name, bias: mean(&|i| found[i]) / wanted - 1.0, rmse }
        };
        let mut rows = vec![row("no shadows".to_owned(), &sum(&|light, _| light))];
        for (name, rule) in rules() {
            let by_image = |(cache, reached): (&_, &Option<Vec<(f64, bool)>>)| -> f64 {
                let Some(reached) = reached else { return 0.0 };
                let image = DepthImage::new(cache, &self.plates, &rule);
                let chunks = self.vals.chunks(rule.together).zip(reached.chunks(rule.together));
                let seen = chunks.filter(|(vals, _)| image.sees_most_lit(cache, vals));
                seen.flat_map(|(_, lights)| lights).map(|(light, _)| light).sum()
            };
            let found: Vec<f64> = self.caches.par_iter().zip(&reached).map(by_image).collect();
            rows.push(row(name, &found));
        }
        rows
    }

    /// Irradiance \[lx\] of a cache from each VAL, and whether a ray reaches it; `None` for a cache inside a body.
    fn reached(&self, cache: &Cache) -> Option<Vec<(f64, bool)>> {
        let lift = ABOVE * self.world.radius;
        let from = cache.position + lift * cache.normal;
        let aside = cache.normal.any_orthonormal_vector();
        let is_inside = [0.1, -0.5].iter().all(|tilt| {
            let up = (cache.normal + *tilt * aside).normalize();
            self.world.nearest(from, up, Sides::Both).is_some_and(|hit| !hit.front)
        });
        let ray = |val: &Val| {
            let light = luminance(val.flux) * val_geometry(cache.position, cache.normal, val).0;
            (light, light > 0.0 && !self.world.blocked(from, val.position + lift * val.normal))
        };
        (!is_inside).then(|| self.vals.iter().map(ray).collect())
    }
}
