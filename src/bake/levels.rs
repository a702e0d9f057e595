//! Caches of a model -> coarse ones among them, and for each of the others the coarse ones that it lies between.
//! METHOD 9, thesis lines 2670-2685.

use super::cluster::error;
use glam::DVec3;
use rayon::prelude::*;

/// Caches of a coarser level are one in this many.
pub const COARSENING: usize = 4;

/// A model with fewer caches than this has no coarser level.
pub const FEWEST: usize = 16;

/// Ways to choose the coarse caches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// Each next one is the farthest from all before, in place and normal.
    Farthest,
    /// Every fourth along the bake's space-filling order.
    Stride,
}

/// The caches of one model in levels; a level's caches belong to all finer ones too.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Levels {
    /// For each cache the coarsest level it belongs to; 0 is the coarsest of all.
    pub level: Vec<usize>,
    /// For each cache those of coarser levels that it lies between, nearest in place and normal first; none at level 0.
    pub parents: Vec<Vec<usize>>,
    /// Distance [m] that a cache's parents stand apart.
    pub apart: Vec<f64>,
}

impl Levels {
    /// Sorts the caches at `points` (position [m], unit normal), `spacing` [m] apart, into `count` levels at most, and
    /// finds each its `parents`.
    pub fn new(points: &[(DVec3, DVec3)], spacing: f64, count: usize, parents: usize, choice: Choice) -> Self {
        let mut made = Self {
            level: vec![0; points.len()],
            parents: vec![Vec::new(); points.len()],
            apart: vec![spacing; points.len()],
        };
        let (mut all, mut apart) = ((0..points.len()).collect::<Vec<_>>(), spacing);
        for _ in 1..count {
            if all.len() < FEWEST {
                break;
            }
            // A quarter as many on a surface are twice as far apart.
            apart *= (COARSENING as f64).sqrt();
            let wanted = all.len().div_ceil(COARSENING);
            let coarse = match choice {
                Choice::Farthest => farthest(points, &all, wanted, apart),
                Choice::Stride => all.iter().copied().step_by(COARSENING).collect(),
            };
            let is_coarse: std::collections::BTreeSet<usize> = coarse.iter().copied().collect();
            let fine: Vec<usize> = all.into_iter().filter(|i| !is_coarse.contains(i)).collect();
            let found: Vec<_> = fine.par_iter().map(|i| nearest(points, &coarse, *i, parents, apart)).collect();
            // What is finer than all of these moves down.
            made.level.iter_mut().for_each(|level| *level += 1);
            coarse.iter().for_each(|i| made.level[*i] = 0);
            for (i, found) in fine.into_iter().zip(found) {
                made.parents[i] = found;
                made.apart[i] = apart;
            }
            all = is_coarse.into_iter().collect();
        }
        made
    }
}

/// So many of the points `all`, each the farthest from those before; the first is the first.
fn farthest(points: &[(DVec3, DVec3)], all: &[usize], count: usize, apart: f64) -> Vec<usize> {
    let mut chosen = vec![all[0]];
    let mut nearest = vec![f64::INFINITY; all.len()];
    while chosen.len() < count {
        let last = points[chosen[chosen.len() - 1]];
        let mut next = 0;
        for (at, i) in all.iter().enumerate() {
            nearest[at] = nearest[at].min(difference(points[*i], last, apart));
            if nearest[at] > nearest[next] {
                next = at;
            }
        }
        chosen.push(all[next]);
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// The `count` of least difference from a point, equal ones by index.
fn nearest(points: &[(DVec3, DVec3)], among: &[usize], point: usize, count: usize, apart: f64) -> Vec<usize> {
    let mut found: Vec<_> = among.iter().map(|i| (difference(points[*i], points[point], apart), *i)).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.into_iter().take(count).map(|(_, i)| i).collect()
}

/// As vertices choose their references, eq. 5.95.
fn difference(a: (DVec3, DVec3), b: (DVec3, DVec3), apart: f64) -> f64 {
    error(a.0.distance(b.0), a.1.dot(b.1), apart)
}
