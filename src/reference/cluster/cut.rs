//! Cuts through a pyramid: the nodes that stand for their VALs at a cache, or at a group of caches that traverse
//! together.
//!
//! A cache descends from a node to its children with a share in [0, 1], at most the share with which it reached the
//! node. The remaining share is received from the node itself. So each VAL is received exactly once, directly or
//! through the nodes above it. If the share is continuous in the positions of caches and VALs, the light has no jumps.

use glam::DVec3;

use super::Pyramid;
use crate::reference::gather::{Cache, Gathered, Received, gather_received, luminance, receive, val_geometry};
use crate::reference::phong::mirrored_view;
use crate::reference::rsm::Val;

/// Most caches per group.
pub const GROUP: usize = 32;

/// Criterion for using a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// The node is farther away than this many of its radii: `c_val` of listing 6.6.
    Distance(f64),
    /// The node's largest possible irradiance, times the sum of its radius over its distance and its spread, is at most
    /// this share of the cache's irradiance from a coarse cut.
    Bound(f64),
}

/// A cut: the rule, the treatment of differing normals, and the softness of decisions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Criterion.
    pub rule: Rule,
    /// `Distance`: largest spread of a usable node's normals. `Bound`: unit in which the spread counts.
    pub spread: f64,
    /// Ratio of the two thresholds between which a node fades in: the rule's own, and one that is stricter by this
    /// factor. 1 is a hard decision.
    pub blend: f64,
}

/// Cost of a traversal, counted once per cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// VALs and nodes whose light was evaluated.
    pub pairs: usize,
    /// Nodes that were tested.
    pub tests: usize,
}

/// The cut that estimates a cache's total light. It is blended if the cut that it serves is, which would otherwise
/// jump.
fn coarse(cut: &Cut) -> Cut {
    let blend = if cut.blend == 1.0 { 1.0 } else { 2.0 };
    Cut { rule: Rule::Distance(1.0), spread: f64::INFINITY, blend }
}

/// Smooth step from 0 at `low` to 1 at `high`; a hard step just above `low` if both are equal.
fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    if x >= high && x > low {
        return 1.0;
    }
    let t = ((x - low) / (high - low)).max(0.0);
    if t > 0.0 { t * t * (3.0 - 2.0 * t) } else { 0.0 }
}

/// State of one group's traversal.
struct Walk<'w> {
    caches: &'w [Cache],
    cut: Cut,
    totals: [f64; GROUP],
    each: &'w mut dyn FnMut(&Val, f64, &[f64]),
    cost: Cost,
}

impl Pyramid<'_> {
    /// Calls `each` with all light that a group of caches receives: a VAL (or a node as one), its weight, and the share
    /// that each cache receives. Without blending a group descends as a whole if any of its caches does.
    pub fn walk(&self, caches: &[Cache], cut: &Cut, each: &mut dyn FnMut(&Val, f64, &[f64])) -> Cost {
        assert!(caches.len() <= GROUP, "a group holds {GROUP} caches");
        let mut walk = Walk { caches, cut: *cut, totals: [0.0; GROUP], each, cost: Cost::default() };
        if matches!(cut.rule, Rule::Bound(_)) {
            let mut sums = [0.0; GROUP];
            let cost = self.walk(caches, &coarse(cut), &mut |val, _, shares| {
                for ((sum, cache), share) in sums.iter_mut().zip(caches).zip(shares) {
                    *sum += share * brightness(val, cache);
                }
            });
            (walk.totals, walk.cost) = (sums, cost);
        }
        let mut index = 0;
        while let Some(node) = self.nodes.get(index) {
            self.descend(&mut walk, index, &[1.0; GROUP]);
            index = node.skip;
        }
        walk.cost
    }

    fn descend(&self, walk: &mut Walk<'_>, index: usize, passed: &[f64; GROUP]) {
        let node = &self.nodes[index];
        let caches = walk.caches;
        if node.weight == 0.0 {
            return;
        }
        walk.cost.tests += caches.len();
        if caches.iter().all(|cache| node.is_dark(cache.position, cache.normal)) {
            return;
        }
        let (mut passes, mut kept) = (*passed, [0.0; GROUP]);
        for (i, cache) in caches.iter().enumerate() {
            passes[i] = passed[i].min(self.passes(index, cache, walk.totals[i], &walk.cut));
        }
        if walk.cut.blend == 1.0 {
            passes = [passes[..caches.len()].iter().copied().fold(0.0, f64::max); GROUP];
        }
        for i in 0..caches.len() {
            kept[i] = passed[i] - passes[i];
        }
        if kept.iter().any(|share| *share > 0.0) {
            walk.cost.pairs += caches.len();
            (walk.each)(&node.val(), node.weight, &kept[..caches.len()]);
        }
        if passes[..caches.len()].iter().all(|share| *share == 0.0) {
            return;
        }
        if node.alive == 0 {
            self.children(index).for_each(|child| self.descend(walk, child, &passes));
        }
        for val in self.vals_of(node) {
            walk.cost.pairs += caches.len();
            (walk.each)(val, self.weight(val), &passes[..caches.len()]);
        }
    }

    /// Share with which a cache descends from a node, if it reached the node with share 1.
    fn passes(&self, index: usize, cache: &Cache, total: f64, cut: &Cut) -> f64 {
        let node = &self.nodes[index];
        if node.is_dark(cache.position, cache.normal) {
            return 0.0;
        }
        let distance = node.position.distance(cache.position);
        match cut.rule {
            Rule::Distance(c) => {
                let near = 1.0 - smoothstep(c * node.radius, cut.blend * c * node.radius, distance);
                near.max(smoothstep(cut.spread / cut.blend, cut.spread, node.spread))
            }
            Rule::Bound(share) => {
                let unlike = node.radius / distance + node.spread / cut.spread;
                let most = node.brightest(cache.position, cache.normal) * unlike;
                smoothstep(share * total / cut.blend, share * total, most)
            }
        }
    }

    /// Light that a group of caches gathers by a cut; with an `eye` \[m\] also in the glossy lobe.
    pub fn gather(&self, caches: &[Cache], eye: Option<DVec3>, cut: &Cut) -> (Vec<Gathered>, Cost) {
        let mirrored = |cache: &Cache| eye.map(|eye| mirrored_view(cache.position, cache.normal, eye));
        let mut received: Vec<Vec<Received>> = vec![Vec::new(); caches.len()];
        let cost = self.walk(caches, cut, &mut |val, weight, shares| {
            for ((all, cache), share) in received.iter_mut().zip(caches).zip(shares).filter(|(_, share)| **share > 0.0)
            {
                let part = Val { flux: val.flux * *share, ..*val };
                all.push(receive(cache, mirrored(cache), &part, weight * share));
            }
        });
        let all = caches.iter().zip(received);
        let gathered = all.map(|(c, all)| gather_received(c, mirrored(c).unwrap_or_default(), all.into_iter()));
        (gathered.collect(), cost)
    }
}

/// Luminance of the irradiance from a VAL at a cache.
fn brightness(val: &Val, cache: &Cache) -> f64 {
    luminance(val.flux) * val_geometry(cache.position, cache.normal, val).0
}
