//! Stage 6, adaptive: caches in levels, of which the fine ones are lit only where light changes between the coarse ones.
//! METHOD 9, thesis lines 2670-2685.
//!
//! A fine cache is to its coarse parents what a vertex is to its references: where it is not lit, it takes their
//! averaged lights for its own proxies.

use glam::DVec3;

use super::gather::{Cache, Gathered, LEAST_COSINE, Lobe, luminance};
use super::interpolate::{Scheme, distance_kernel, falloff, interpolate, kernel};
use super::phong::mirrored_view;

/// When a fine cache is lit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// A parent's proxy is nearer to it than so many times the distance that the parents stand apart.
    pub near: f64,
    /// What the parents' proxies would each bring to the cache, as vectors, differs by more than this share.
    pub differ: f64,
}

impl Rule {
    /// By nearness alone.
    pub const fn near(factor: f64) -> Self {
        Self { near: factor, differ: f64::INFINITY }
    }

    /// Whether a cache is lit rather than interpolated; `apart` [m] is the distance that its parents stand apart.
    pub fn lights(&self, cache: &Cache, parents: &[(Cache, Gathered)], apart: f64) -> bool {
        let lobes = |(_, g): &(Cache, Gathered)| [g.diffuse, g.glossy];
        let is_near = |parent: &(Cache, Gathered)| {
            let near = |lobe: Lobe| lobe.lit && lobe.position.distance(parent.0.position) < self.near * apart;
            lobes(parent).into_iter().any(near)
        };
        // Between light and darkness nearness says nothing.
        let count = parents.iter().filter(|(_, g)| g.diffuse.lit).count();
        (count > 0 && count < parents.len()) || parents.iter().any(is_near) || self.differs(cache, parents)
    }

    fn differs(&self, cache: &Cache, parents: &[(Cache, Gathered)]) -> bool {
        let weights = weights(cache, parents);
        let spread = |lobe: fn(&Gathered) -> &Lobe| {
            let (mut total, mut sum, mut squares) = (0.0, DVec3::ZERO, 0.0);
            for ((parent, gathered), weight) in parents.iter().zip(&weights) {
                let brought = vector(cache, lobe(gathered), parent);
                total += weight;
                sum += *weight * brought;
                squares += weight * brought.length_squared();
            }
            let mean = sum / total;
            let deviation = (squares / total - mean.length_squared()).max(0.0).sqrt();
            if squares > 0.0 { deviation / mean.length() } else { 0.0 }
        };
        spread(|g| &g.diffuse) > self.differ || spread(|g| &g.glossy) > self.differ
    }
}

/// Light that another cache's proxy sends to a cache: towards the proxy, as long as the luminance of its facing
/// irradiance there [lx].
pub fn vector(cache: &Cache, lobe: &Lobe, of: &Cache) -> DVec3 {
    if !lobe.lit {
        return DVec3::ZERO;
    }
    let offset = lobe.position - cache.position;
    let there2 = lobe.position.distance_squared(of.position);
    let left = falloff(lobe.distance2, there2, offset.length_squared());
    left * luminance(lobe.facing_irradiance) * offset.normalize_or_zero()
}

/// Weights of parents as stage 8 weighs references.
fn weights(cache: &Cache, parents: &[(Cache, Gathered)]) -> Vec<f64> {
    let distance = |parent: &Cache| parent.position.distance(cache.position);
    let farthest = parents.iter().map(|(parent, _)| distance(parent)).fold(f64::MIN_POSITIVE, f64::max);
    let t = |parent: &Cache| distance(parent) / farthest;
    let weights: Vec<f64> =
        parents.iter().map(|(c, _)| kernel(Scheme::Facing, t(c), cache.normal.dot(c.normal))).collect();
    if weights.iter().any(|w| *w != 0.0) {
        return weights;
    }
    parents.iter().map(|(c, _)| distance_kernel(t(c))).collect()
}

/// The proxies of a cache that is not lit, from its parents'.
pub fn between(cache: &Cache, eye: Option<DVec3>, parents: &[(Cache, Gathered)]) -> Gathered {
    let mirrored = eye.map_or(DVec3::ZERO, |eye| mirrored_view(cache.position, cache.normal, eye));
    let light = interpolate(cache.position, cache.normal, mirrored, parents, Scheme::Facing);
    let weights = weights(cache, parents);
    // The VALs of all lit parents as they are seen from here: their spread about each proxy, and the proxies'.
    let distance2 = |lobe: fn(&Gathered) -> &Lobe| {
        let (mut total, mut sum) = (0.0, 0.0);
        for ((parent, gathered), weight) in parents.iter().zip(&weights).filter(|((_, g), _)| lobe(g).lit) {
            let lobe = lobe(gathered);
            let spread = (lobe.distance2 - lobe.position.distance_squared(parent.position)).max(0.0);
            total += weight;
            sum += weight * (spread + lobe.position.distance_squared(cache.position));
        }
        if total > 0.0 { sum / total } else { 0.0 }
    };
    Gathered {
        diffuse: lobe(
            cache,
            light.has_diffuse,
            light.diffuse_position,
            light.diffuse_irradiance,
            distance2(|g| &g.diffuse),
        ),
        glossy: lobe(cache, light.has_glossy, light.glossy_position, light.glossy_irradiance, distance2(|g| &g.glossy)),
        mirrored_view: mirrored,
    }
}

fn lobe(cache: &Cache, lit: bool, position: DVec3, facing_irradiance: DVec3, distance2: f64) -> Lobe {
    let direction = (position - cache.position).normalize_or_zero();
    if !lit || cache.normal.dot(direction) <= LEAST_COSINE {
        let position = cache.position + cache.normal;
        return Lobe { position, facing_irradiance: DVec3::ZERO, lit: false, distance2: 0.0 };
    }
    // No mean of squares is below the square of the mean; the glossy position is another mean than that of the distances.
    Lobe { position, facing_irradiance, lit, distance2: distance2.max(position.distance_squared(cache.position)) }
}

/// What became of the caches.
pub struct Lit {
    /// Their proxies; `None` of those that nobody needs.
    pub gathered: Vec<Option<Gathered>>,
    /// How many were lit.
    pub lit: usize,
    /// How many were interpolated.
    pub interpolated: usize,
}

/// Lights the caches that are `needed`, level by level, coarsest first: those of level 0, and of the finer ones those that
/// `lights` says, which is told their parents and these' proxies; `gather` lights one.
pub fn light(
    caches: &[Cache],
    eye: Option<DVec3>,
    [levels, needed]: [&[usize]; 2],
    parents: &[Vec<usize>],
    lights: impl Fn(usize, &[(Cache, Gathered)]) -> bool,
    gather: impl Fn(usize) -> Gathered,
) -> Lit {
    let mut order: Vec<usize> = (0..caches.len()).collect();
    order.sort_by_key(|i| levels[*i]);
    let mut wanted = vec![false; caches.len()];
    needed.iter().for_each(|i| wanted[*i] = true);
    for i in order.iter().rev().filter(|i| levels[**i] > 0) {
        if wanted[*i] {
            parents[*i].iter().for_each(|parent| wanted[*parent] = true);
        }
    }
    let mut made = Lit { gathered: vec![None; caches.len()], lit: 0, interpolated: 0 };
    for i in order.into_iter().filter(|i| wanted[*i]) {
        let above: Vec<(Cache, Gathered)> =
            parents[i].iter().filter_map(|p| made.gathered[*p].map(|gathered| (caches[*p], gathered))).collect();
        let lit = above.is_empty() || lights(i, &above);
        made.gathered[i] = Some(if lit { gather(i) } else { between(&caches[i], eye, &above) });
        if lit { made.lit += 1 } else { made.interpolated += 1 }
    }
    made
}
