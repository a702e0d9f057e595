//! Light clustering against none: pairs evaluated and error added by each rule, and flicker while lights move.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::study::{Study, pictures};
use super::variants::{Proxy, Variant};
use crate::metrics::metrics;
use crate::reference::cluster::{Cut, GROUP, Pyramid, Rule, Share};
use crate::reference::gather::{Cache, Gathered, Lobe, ProxyWeight, luminance};
use crate::reference::rsm::Val;
use crate::scene::{Light, LightKind};

/// One rule against no clustering.
#[derive(Clone, Debug, PartialEq)]
pub struct Clustered {
    /// The rule.
    pub name: String,
    /// Traversal by each cache alone, and by groups of neighbours.
    pub walks: [Walked; 2],
    /// Mean absolute relative error of the pixels' diffuse and glossy radiance, with groups.
    pub pixels: [f64; 2],
}

/// Cost and error of a rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walked {
    /// Evaluated pairs, as a share of all pairs of caches and live VALs.
    pub pairs: f64,
    /// Tested nodes, in the same unit.
    pub tests: f64,
    /// Mean relative error of the caches' irradiance.
    pub error: f64,
    /// Largest relative error.
    pub worst: f64,
    /// Relative error of the irradiance summed over caches.
    pub bias: f64,
    /// Mean change of direction to the diffuse proxy \[degrees\].
    pub turned: f64,
}

/// Flicker of one rule.
#[derive(Clone, Debug, PartialEq)]
pub struct Flickered {
    /// The rule.
    pub name: String,
    /// Evaluated share of all pairs, with groups.
    pub pairs: f64,
    /// Largest change of a cache's irradiance between frames, relative to its mean.
    pub largest: f64,
    /// Largest difference of such a change between clustering and none.
    pub added: f64,
    /// Root mean square of that difference.
    pub rms: f64,
}

/// Frames along a light's path.
const FRAMES: usize = 12;

/// Motion of a light per frame, in radii of the scene or radians.
const STEP: f64 = 0.002;

/// Alternative ways to merge a node, which the pyramid does not use.
#[derive(Clone, Copy, Debug)]
enum Altered {
    /// Positions weighted by area.
    PositionByArea,
    /// Sum of the areas instead of their mean.
    AreaSummed,
    /// Flux multiplied by the length of the mean normal.
    NormalAsLong,
}

/// `Cut::spread` of rows that do not name one: for distances and for bounds.
const SPREAD: f64 = 0.3;
const BOUND_SPREAD: f64 = 0.5;

fn hard(rule: Rule) -> Cut {
    let spread = match rule {
        Rule::Distance(_) => SPREAD,
        Rule::Bound(_) => BOUND_SPREAD,
        Rule::Change(..) => f64::INFINITY,
    };
    Cut { rule, spread, blend: 1.0 }
}

fn soft(rule: Rule) -> Cut {
    Cut { blend: 1.5, ..hard(rule) }
}

/// The cuts to compare.
fn cuts() -> Vec<(String, Cut)> {
    let mut all = Vec::new();
    for c in [2.0, 4.0, 6.0, 8.0, 16.0] {
        all.push((format!("distance {c}"), hard(Rule::Distance(c))));
        all.push((format!("distance {c}, blended"), soft(Rule::Distance(c))));
    }
    for p in [0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4] {
        all.push((format!("bound {p}"), hard(Rule::Bound(p))));
        all.push((format!("bound {p}, blended"), soft(Rule::Bound(p))));
    }
    for p in [0.1, 0.01] {
        all.push((format!("change {p} of own"), hard(Rule::Change(p, Share::Own))));
    }
    for p in [1e-3, 1e-5] {
        all.push((format!("change {p} of total"), hard(Rule::Change(p, Share::Total))));
    }
    for spread in [0.1, 0.6, 1.0, f64::INFINITY] {
        let cut = Cut { spread, ..hard(Rule::Distance(4.0)) };
        all.push((format!("distance 4, spread {spread}"), cut));
    }
    for spread in [0.25, 1.0, 2.0, f64::INFINITY] {
        let cut = Cut { spread, ..hard(Rule::Bound(1e-2)) };
        all.push((format!("bound 0.01, spread {spread}"), cut));
    }
    all
}

impl Study<'_> {
    /// All rules, and the alternative merges, against no clustering.
    pub fn clusters(&self) -> Vec<Clustered> {
        let (vals, sizes) = pictures(self.scene, &self.world, &self.scene.lights, self.settings.rsm, None);
        let pyramid = Pyramid::new(&vals, &sizes, ProxyWeight::Irradiance);
        let full = self.gather(ProxyWeight::Irradiance);
        let truth = self.images(&full);
        let mut rows: Vec<_> =
            cuts().into_iter().map(|(name, cut)| self.clustered(name, &pyramid, &cut, &full, &truth)).collect();
        for how in [Altered::PositionByArea, Altered::AreaSummed, Altered::NormalAsLong] {
            let mut other = Pyramid::new(&vals, &sizes, ProxyWeight::Irradiance);
            alter(&mut other, how);
            for (name, rule) in [("distance 4", Rule::Distance(4.0)), ("bound 0.01", Rule::Bound(1e-2))] {
                rows.push(self.clustered(format!("{name}, {how:?}"), &other, &hard(rule), &full, &truth));
            }
        }
        rows
    }

    fn clustered(
        &self,
        name: String,
        pyramid: &Pyramid<'_>,
        cut: &Cut,
        full: &[Gathered],
        truth: &[Vec<[f32; 3]>; 2],
    ) -> Clustered {
        let alone = self.walked(pyramid, cut, 1, full).0;
        let (together, gathered) = self.walked(pyramid, cut, GROUP, full);
        let images = self.images(&gathered);
        let error = |lobe: usize| if images[lobe].is_empty() { 0.0 } else { metrics(&images[lobe], &truth[lobe]).mare };
        Clustered { name, walks: [alone, together], pixels: [error(0), error(1)] }
    }

    /// Traverses in groups of this many neighbours.
    fn walked(&self, pyramid: &Pyramid<'_>, cut: &Cut, group: usize, full: &[Gathered]) -> (Walked, Vec<Gathered>) {
        let order = morton_order(&self.caches);
        let eye = self.is_glossy().then(|| self.eye());
        let parts: Vec<_> = order
            .par_chunks(group)
            .map(|chunk| {
                let caches: Vec<Cache> = chunk.iter().map(|i| self.caches[*i]).collect();
                pyramid.gather(&caches, eye, cut)
            })
            .collect();
        let all = (self.caches.len() * self.vals.len()) as f64;
        let mut walked = Walked { pairs: 0.0, tests: 0.0, error: 0.0, worst: 0.0, bias: 0.0, turned: 0.0 };
        let mut gathered = full.to_vec();
        for (chunk, (found, cost)) in order.chunks(group).zip(parts) {
            walked.pairs += cost.pairs as f64 / all;
            walked.tests += cost.tests as f64 / all;
            chunk.iter().zip(found).for_each(|(i, g)| gathered[*i] = g);
        }
        let count = self.caches.len() as f64;
        let light = |all: &[Gathered]| -> Vec<f64> {
            self.caches.iter().zip(all).map(|(cache, g)| irradiance(cache, &g.diffuse)).collect()
        };
        let (with, without) = (light(&gathered), light(full));
        let (sum, wanted): (f64, f64) = (with.iter().sum(), without.iter().sum());
        walked.bias = sum / wanted - 1.0;
        for (i, cache) in self.caches.iter().enumerate() {
            // A hundredth of the mean keeps dark caches from dominating.
            let error = (with[i] - without[i]).abs() / (without[i] + 0.01 * wanted / count);
            walked.error += error / count;
            walked.worst = walked.worst.max(error);
            let towards = |g: &Gathered| g.diffuse.position - cache.position;
            walked.turned += towards(&gathered[i]).angle_between(towards(&full[i])).to_degrees() / count;
        }
        (walked, gathered)
    }

    /// Pictures of both lobes from the caches' light, interpolated as in the engine.
    pub(super) fn images(&self, gathered: &[Gathered]) -> [Vec<[f32; 3]>; 2] {
        let image = |is_glossy: bool| {
            let proxy = |(cache, g): (_, &Gathered)| {
                let lobe = if is_glossy { g.glossy } else { g.diffuse };
                Proxy { cache, mirrored: g.mirrored_view, lobe, nearest: 0.0 }
            };
            let proxies: Vec<Proxy<'_>> = self.caches.iter().zip(gathered).map(proxy).collect();
            self.render(if is_glossy { &Variant::GLOSSY } else { &Variant::DIFFUSE }, &proxies, is_glossy)
        };
        [image(false), if self.is_glossy() { image(true) } else { Vec::new() }]
    }

    /// Flicker while all lights move: without clustering, then for each rule.
    pub fn cluster_flicker(&self) -> Vec<Flickered> {
        let frames: Vec<(Vec<Val>, Vec<usize>)> = (0..FRAMES)
            .map(|frame| {
                let moved = |light: &Light| self.moved(light, frame as f64 * STEP);
                let lights: Vec<Light> = self.scene.lights.iter().map(moved).collect();
                pictures(self.scene, &self.world, &lights, self.settings.rsm, None)
            })
            .collect();
        let pyramids: Vec<Pyramid<'_>> =
            frames.iter().map(|(vals, sizes)| Pyramid::new(vals, sizes, ProxyWeight::Irradiance)).collect();
        let everything = hard(Rule::Distance(f64::MAX));
        let without = self.light_over_time(&pyramids, &everything);
        let mut all = vec![("no clustering".to_owned(), everything)];
        for rule in [2.0, 4.0, 8.0].map(Rule::Distance).into_iter().chain([0.1, 0.03, 0.01].map(Rule::Bound)) {
            all.push((format!("{rule:?}"), hard(rule)));
            all.push((format!("{rule:?}, blended"), soft(rule)));
        }
        // Rules with as many pairs as the blended ones, and more.
        let finer = [12.0, 16.0, 32.0, 64.0, 128.0].map(Rule::Distance).into_iter();
        for rule in finer.chain([3e-3, 1e-3, 3e-4].map(Rule::Bound)) {
            all.push((format!("{rule:?}"), hard(rule)));
        }
        let row = |(name, cut): (String, Cut)| {
            let with = self.light_over_time(&pyramids, &cut);
            let mut row = Flickered { name, pairs: with.1, largest: 0.0, added: 0.0, rms: 0.0 };
            let floor = 0.01 * without.0.iter().flatten().sum::<f64>() / (without.0.len() * FRAMES) as f64;
            for (with, without) in with.0.iter().zip(&without.0) {
                let mean = without.iter().sum::<f64>() / FRAMES as f64 + floor;
                for (w, o) in with.windows(2).zip(without.windows(2)) {
                    let [change, usual] = [(w[1] - w[0]) / mean, (o[1] - o[0]) / mean];
                    row.largest = row.largest.max(change.abs());
                    row.added = row.added.max((change - usual).abs());
                    row.rms += (change - usual).powi(2) / ((FRAMES - 1) * self.caches.len()) as f64;
                }
            }
            Flickered { rms: row.rms.sqrt(), ..row }
        };
        all.into_iter().map(row).collect()
    }

    /// A light moved along its path: sideways, or rotated.
    fn moved(&self, light: &Light, way: f64) -> Light {
        let axis = light.direction.as_dvec3().normalize_or(DVec3::NEG_Y).any_orthonormal_vector();
        let mut light = light.clone();
        match light.kind {
            LightKind::Directional => {
                light.direction = (DQuat::from_axis_angle(axis, way) * light.direction.as_dvec3()).as_vec3();
            }
            _ => light.position += way * self.world.radius * axis,
        }
        light
    }

    /// Irradiance of every cache in every frame with groups, and the evaluated share of all pairs.
    fn light_over_time(&self, pyramids: &[Pyramid<'_>], cut: &Cut) -> (Vec<Vec<f64>>, f64) {
        let mut light = vec![Vec::new(); self.caches.len()];
        let (mut pairs, mut all) = (0, 0);
        let order = morton_order(&self.caches);
        for pyramid in pyramids {
            let parts: Vec<_> = order
                .par_chunks(GROUP)
                .map(|chunk| {
                    let caches: Vec<Cache> = chunk.iter().map(|i| self.caches[*i]).collect();
                    let (gathered, cost) = pyramid.gather(&caches, None, cut);
                    let sums: Vec<f64> = caches.iter().zip(&gathered).map(|(c, g)| irradiance(c, &g.diffuse)).collect();
                    (sums, cost.pairs)
                })
                .collect();
            for (chunk, (sums, cost)) in order.chunks(GROUP).zip(parts) {
                pairs += cost;
                chunk.iter().zip(sums).for_each(|(i, sum)| light[*i].push(sum));
            }
            all += self.caches.len() * pyramid.vals.iter().filter(|val| pyramid.weight(val) > 0.0).count();
        }
        (light, pairs as f64 / all as f64)
    }
}

/// Luminance of a cache's irradiance \[lx\].
fn irradiance(cache: &Cache, lobe: &Lobe) -> f64 {
    let towards = (lobe.position - cache.position).normalize_or_zero();
    luminance(lobe.facing_irradiance) * cache.normal.dot(towards)
}

/// Indices of caches in Morton order, which keeps neighbours together.
fn morton_order(caches: &[Cache]) -> Vec<usize> {
    let places = || caches.iter().map(|cache| cache.position);
    let low = places().fold(DVec3::INFINITY, DVec3::min);
    let size = (places().fold(DVec3::NEG_INFINITY, DVec3::max) - low).max_element().max(f64::MIN_POSITIVE);
    let key = |cache: &Cache| {
        let cell = ((cache.position - low) / size * 1023.0).as_uvec3();
        (0..30).fold(0_u32, |key, bit| key | (cell[bit % 3] >> (bit / 3) & 1) << bit)
    };
    let mut order: Vec<usize> = (0..caches.len()).collect();
    order.sort_by_key(|i| key(&caches[*i]));
    order
}

fn alter(pyramid: &mut Pyramid<'_>, how: Altered) {
    for index in 0..pyramid.nodes.len() {
        let mut vals: Vec<Val> = Vec::new();
        for below in index..pyramid.nodes[index].skip {
            vals.extend(pyramid.vals_of(&pyramid.nodes[below]));
        }
        let mean = |of: &dyn Fn(&Val) -> DVec3, by: &dyn Fn(&Val) -> f64| {
            let total: f64 = vals.iter().map(by).sum();
            vals.iter().map(|val| by(val) * of(val)).sum::<DVec3>() / total
        };
        let node = &mut pyramid.nodes[index];
        if vals.is_empty() {
            continue;
        }
        match how {
            Altered::PositionByArea => {
                node.position = mean(&|val| val.position, &|val| val.area);
                node.radius = vals.iter().map(|v| v.position.distance(node.position)).fold(0.0, f64::max);
            }
            Altered::AreaSummed => node.area = vals.iter().map(|val| val.area).sum(),
            Altered::NormalAsLong => node.flux *= mean(&|val| val.normal, &|val| luminance(val.flux)).length(),
        }
    }
}
