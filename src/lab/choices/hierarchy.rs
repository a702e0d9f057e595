//! Adaptive caches against all caches lit: light computed and error added by each rule.

use std::collections::BTreeSet;

use glam::DVec3;

use super::study::Study;
use crate::bake::levels::{Choice, Levels};
use crate::metrics::metrics;
use crate::reference::gather::{Cache, Gathered, Lobe, ProxyWeight};
use crate::reference::hierarchy::{Rule, between, light, vector};

/// One rule against all needed caches lit.
#[derive(Clone, Debug, PartialEq)]
pub struct Adapted {
    /// What was varied.
    pub name: String,
    /// Caches lit.
    pub count: usize,
    /// The same as a share of those that pixels need.
    pub lit: f64,
    /// Mean absolute relative error of the pixels' diffuse and glossy radiance against all caches lit.
    pub error: [f64; 2],
    /// Relative error of their sum.
    pub bias: [f64; 2],
    /// Mean absolute relative error against brute force.
    pub truth: [f64; 2],
}

/// What is compared.
#[derive(Clone, Copy)]
struct Case {
    levels: usize,
    parents: usize,
    choice: Choice,
    rule: Rule,
    /// Instead of the rule: lit where interpolation would differ from what the cache really receives by more than this
    /// share, the larger one of both lobes. No frame can know that.
    oracle: Option<f64>,
}

const BASE: Case = Case { levels: 2, parents: 8, choice: Choice::Farthest, rule: Rule::near(0.0), oracle: None };

fn cases() -> Vec<(String, Case)> {
    let mut all = Vec::new();
    for (levels, factors) in
        [(2, &[0.0, 0.5, 1.0, 1.5, 2.0, 3.0, f64::INFINITY][..]), (3, &[0.5, 1.0, 2.0, 3.0]), (4, &[1.0, 2.0])]
    {
        for factor in factors {
            let case = Case { levels, rule: Rule::near(*factor), ..BASE };
            all.push((format!("{levels} levels, near {factor}"), case));
        }
    }
    for (levels, near, differ) in
        [(2, 0.0, 0.4), (2, 0.0, 0.2), (2, 0.0, 0.1), (3, 0.0, 0.2), (2, 0.5, 0.2), (2, 1.0, 0.2), (2, 1.0, 0.1)]
    {
        let case = Case { levels, rule: Rule { near, differ }, ..BASE };
        all.push((format!("{levels} levels, near {near} or differ {differ}"), case));
    }
    for (levels, share) in [(2, 0.8), (2, 0.4), (2, 0.2), (2, 0.1), (2, 0.05), (3, 0.4), (3, 0.2), (3, 0.1)] {
        all.push((format!("{levels} levels, oracle {share}"), Case { levels, oracle: Some(share), ..BASE }));
    }
    for factor in [1.0, 2.0] {
        let base = Case { rule: Rule::near(factor), ..BASE };
        all.push((format!("2 levels, near {factor}, every 4th"), Case { choice: Choice::Stride, ..base }));
        for parents in [3, 4, 16] {
            all.push((format!("2 levels, near {factor}, {parents} parents"), Case { parents, ..base }));
        }
    }
    all
}

impl Study<'_> {
    /// All needed caches lit, then every rule.
    pub fn hierarchy(&self) -> Vec<Adapted> {
        let full = self.gather(ProxyWeight::Irradiance);
        let needed: BTreeSet<usize> = self.vertices.iter().flat_map(|v| v.references.iter().copied()).collect();
        let needed: Vec<usize> = needed.into_iter().collect();
        let usual = self.images(&full);
        let row = |name, lit: usize, gathered: &[Gathered]| {
            let images = self.images(gathered);
            // MARE and bias.
            let of = |lobe: usize, truth: &[[f32; 3]]| match images[lobe].is_empty() {
                true => [0.0; 2],
                false => [metrics(&images[lobe], truth)].map(|m| [m.mare, m.bias])[0],
            };
            let against = [of(0, &usual[0]), of(1, &usual[1])];
            Adapted {
                name,
                count: lit,
                lit: lit as f64 / needed.len() as f64,
                error: against.map(|m| m[0]),
                bias: against.map(|m| m[1]),
                truth: [of(0, &self.truth[0])[0], of(1, &self.truth[1])[0]],
            }
        };
        let mut rows = vec![row("all lit".to_owned(), needed.len(), &full)];
        let eye = self.is_glossy().then(|| self.eye());
        for (name, case) in cases() {
            let Levels { level, parents, apart } = self.levels(&case);
            let lights = |i: usize, above: &[(Cache, Gathered)]| match case.oracle {
                None => case.rule.lights(&self.caches[i], above, apart[i]),
                Some(share) => apart_by(&self.caches[i], &between(&self.caches[i], eye, above), &full[i]) > share,
            };
            let made = light(&self.caches, eye, [&level, &needed], &parents, lights, |i| full[i]);
            let nothing = Lobe { position: DVec3::ZERO, facing_irradiance: DVec3::ZERO, lit: false, distance2: 0.0 };
            let unused = Gathered { diffuse: nothing, glossy: nothing, mirrored_view: DVec3::ZERO };
            let gathered: Vec<Gathered> = made.gathered.into_iter().map(|g| g.unwrap_or(unused)).collect();
            rows.push(row(name, made.lit, &gathered));
        }
        rows
    }

    /// Levels of all instances' caches, by indices into all.
    fn levels(&self, case: &Case) -> Levels {
        let mut all = Levels::default();
        let ends = self.first.iter().copied().skip(1).chain([self.caches.len()]);
        for (first, end) in self.first.iter().copied().zip(ends) {
            let points: Vec<_> = self.caches[first..end].iter().map(|c| (c.position, c.normal)).collect();
            let own = Levels::new(&points, self.spacing, case.levels, case.parents, case.choice);
            all.level.extend(own.level);
            all.apart.extend(own.apart);
            all.parents.extend(own.parents.into_iter().map(|p| p.into_iter().map(|i| first + i).collect::<Vec<_>>()));
        }
        all
    }
}

/// Relative difference of a cache's light, the larger one of both lobes.
fn apart_by(cache: &Cache, found: &Gathered, wanted: &Gathered) -> f64 {
    let of = |lobe: fn(&Gathered) -> &Lobe| {
        let [found, wanted] = [found, wanted].map(|g| vector(cache, lobe(g), cache));
        found.distance(wanted) / (wanted.length() + f64::MIN_POSITIVE)
    };
    of(|g| &g.diffuse).max(of(|g| &g.glossy))
}
