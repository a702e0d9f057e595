//! Places caches on all models of a scene, for a given spacing or count. METHOD 8.

use super::closed::Surroundings;
use super::prune;
use super::seeds::{self, Bounds, Place, Seed};
use super::surface::Surface;
use super::voxel::{PIECE_LIMIT, Voxels};
use super::{BakeSettings, Density, NO_CACHE};
use crate::error::{Error, Result};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_3, PI};

/// A unit of baking: a mesh under one stretch.
pub(super) struct Model<'a> {
    /// Index into `Scene::meshes`.
    pub(super) mesh: usize,
    /// Name for messages.
    pub(super) name: &'a str,
    /// Number of instances that share the model.
    pub(super) instances: usize,
    /// The mesh in world size.
    pub(super) surface: Surface,
}

/// Caches placed on a model.
pub(super) struct Placement {
    /// The surface cut into pieces.
    pub(super) voxels: Voxels,
    /// The caches, followed by seeds in closed places, which receive no light and are never seen.
    pub(super) seeds: Vec<Seed>,
    /// Number of caches, without the seeds in closed places.
    pub(super) count: usize,
}

/// Most caches of a model: references have 16 bits, and the last value means "none".
const CACHE_LIMIT: usize = NO_CACHE as usize - 1;

/// Most placements tried for a count; with a good first guess three to six are enough.
const ATTEMPTS: i32 = 10;

/// Relative tolerance of the count.
const TOLERANCE: f64 = 0.02;

/// If there are more than this many times the requested caches, they represent wider angles than requested.
const FAR_TOO_MANY: f64 = 2.5;

/// If fewer caches than this were requested for each instance, small models get by with fewer. Otherwise little is left
/// for walls, which fill the picture. docs/choices.md has the figures.
const FEW: f64 = 8.0;

/// A model smaller than this many spacings is small.
const SMALL: f64 = 2.0;

/// `theta_eps` \[rad\] of small models if there are few caches.
const SMALL_ANGLE: f64 = 75.0 * PI / 180.0;

/// Pieces per requested cache, beyond two per triangle, above which a spacing is rejected as too fine without cutting
/// the surface. An even surface needs about one, long thin parallel strips several dozen. If more turn out to be
/// needed, the search restarts with four times as many.
const PIECES_PER_CACHE: f64 = 200.0;

/// Limits for all models of a scene.
#[derive(Clone, Copy)]
pub(super) struct SceneBounds {
    /// `d_eps` \[m\].
    pub(super) distance: f64,
    /// `theta_eps` \[rad\].
    pub(super) angle: f64,
    /// `theta_eps` of small models \[rad\].
    pub(super) small_angle: f64,
}

impl SceneBounds {
    /// The limits for one model.
    pub(super) fn of(self, surface: &Surface) -> Bounds {
        let is_small = (surface.high - surface.low).max_element() < SMALL * self.distance;
        Bounds::new(self.distance, if is_small { self.small_angle } else { self.angle })
    }
}

/// Places caches on one model, given with its index: forms, filters and prunes the seeds.
fn place((index, model): (usize, &Model), around: &Surroundings, bounds: SceneBounds) -> Result<Placement> {
    let bounds = bounds.of(&model.surface);
    let voxels = Voxels::new(&model.surface, 0.5 * bounds.distance, model.name)?;
    let openness = |place: Place| around.openness((index, model), place, bounds.distance);
    let (mut open, mut closed): (Vec<Seed>, Vec<Seed>) =
        seeds::form(&model.surface, &voxels, bounds, &openness).into_iter().partition(|seed| seed.open);
    if open.is_empty() {
        // A model has at least one cache.
        let largest = (0..closed.len()).max_by(|&a, &b| closed[a].area.total_cmp(&closed[b].area));
        open.extend(largest.map(|largest| closed.remove(largest)));
    }
    let mut seeds = prune::prune(&model.surface, &voxels, open, bounds);
    let count = seeds.len();
    seeds.extend(closed);
    if count > CACHE_LIMIT {
        return Err(Error::TooLarge(format!(
            "mesh '{}': {} caches at a spacing of {:.3e} m, but a model can hold {CACHE_LIMIT}: ask for a larger \
             spacing or a smaller count",
            model.name, count, bounds.distance
        )));
    }
    Ok(Placement { voxels, seeds, count })
}

/// Cost of a count, from the logarithm of its ratio to the requested count. The count is a budget: where a simple
/// model's voxels allow only jumps, too few caches are better than too many.
fn regret(off: f64) -> f64 {
    if off > 0.05 { 2.5 * off } else { off.abs() }
}

/// Places caches on all models; `None` if that would cut them into many more pieces than `most`.
fn place_all(
    models: &[Model],
    around: &Surroundings,
    bounds: SceneBounds,
    most: f64,
) -> Result<Option<Vec<Placement>>> {
    let beyond = |model: &Model| {
        let surface = &model.surface;
        Voxels::estimate(surface, 0.5 * bounds.distance) - 2.0 * surface.triangles.len() as f64
    };
    if models.iter().map(|model| beyond(model).max(0.0)).sum::<f64>() > most {
        return Ok(None);
    }
    models.par_iter().enumerate().map(|model| place(model, around, bounds)).collect::<Result<_>>().map(Some)
}

/// Result of a search.
pub(super) struct Found {
    /// Bounds that the caches satisfy.
    pub(super) bounds: SceneBounds,
    /// The caches of each model.
    pub(super) placements: Vec<Placement>,
}

/// Places caches according to the settings.
pub(super) fn search(
    models: &[Model],
    around: &Surroundings,
    settings: &BakeSettings,
    progress: &(dyn Fn(f32, &str) + Sync),
) -> Result<Found> {
    let angle = f64::from(settings.angle);
    let at = |spacing: f64| {
        let bounds = SceneBounds { distance: spacing, angle, small_angle: angle };
        let placements: Result<_> = models.par_iter().enumerate().map(|model| place(model, around, bounds)).collect();
        Ok(Found { bounds, placements: placements? })
    };
    let target = match settings.density {
        Density::Spacing(spacing) => {
            progress(0.0, "placing caches");
            return at(spacing);
        }
        Density::Count(target) => target,
    };
    let limit = CACHE_LIMIT * models.iter().map(|m| m.instances).sum::<usize>();
    let area: f64 = models.iter().map(|m| m.surface.area * m.instances as f64).sum();
    if area == 0.0 {
        return at(1.0);
    }
    if target > limit {
        return Err(Error::TooLarge(format!(
            "{target} caches were asked for, but the scene's models can hold {limit}: ask for a smaller count"
        )));
    }

    let target = target.max(1) as f64;
    let instances: usize = models.iter().map(|model| model.instances).sum();
    let small_angle = if target < FEW * instances as f64 { angle.max(SMALL_ANGLE) } else { angle };
    let mut pieces = PIECES_PER_CACHE * target.max(2000.0);
    let (mut off, mut found) = loop {
        match for_count(models, around, [area, target], [angle, small_angle], pieces, progress) {
            Err(_) if pieces < PIECE_LIMIT => pieces *= 4.0,
            found => break found?,
        }
    };
    // Each instance of a box needs six caches, one per direction. With very many instances that is too much.
    for wider in [2.0 * FRAC_PI_3, PI] {
        if off > FAR_TOO_MANY.ln()
            && wider > angle
            && let Ok(less) = for_count(models, around, [area, target], [wider; 2], pieces, progress)
        {
            log::info!("{:.0} caches instead of {target}: raising the angle that each represents", target * off.exp());
            (off, found) = less;
        }
    }
    Ok(found)
}

/// Searches the spacing for a count. Returns the logarithm of the ratio of the count found to `target`, and the
/// placement.
fn for_count(
    models: &[Model],
    around: &Surroundings,
    [area, target]: [f64; 2],
    [angle, small_angle]: [f64; 2],
    most_pieces: f64,
    progress: &(dyn Fn(f32, &str) + Sync),
) -> Result<(f64, Found)> {
    // A voxel that holds the whole largest model: coarser spacings change nothing.
    let widest = models.iter().filter(|m| m.surface.area > 0.0).map(|m| (m.surface.high - m.surface.low).max_element());
    let coarsest = 2.5 * widest.fold(0.0, f64::max);
    // Slanted planes meet half again as many voxels as axis-aligned ones, and pruning removes some: about 5 caches per
    // d_eps^2.
    let mut spacing = (5.0 * area / target).sqrt().min(coarsest);
    let bounds = |distance| SceneBounds { distance, angle, small_angle };
    // Spacings known to give too many and too few, with the logarithm of the ratio (`None` if beyond all limits).
    let mut fine: Option<(f64, Option<f64>)> = None;
    let mut coarse: Option<(f64, f64)> = None;
    let mut best: Option<(f64, f64, Vec<Placement>)> = None;
    let mut refused = None;
    for attempt in 0..ATTEMPTS {
        progress(0.6 * (1.0 - 0.7f32.powi(attempt)), "searching the spacing");
        match place_all(models, around, bounds(spacing), most_pieces) {
            Err(error) => {
                fine = Some((spacing, None));
                refused = Some(error);
            }
            Ok(None) => {
                log::debug!("spacing {spacing:.4} m: too many pieces for {target} caches");
                fine = Some((spacing, None));
                let what =
                    format!("{target} caches need a spacing that cuts the scene into too many pieces: ask for fewer");
                refused.get_or_insert(Error::TooLarge(what));
            }
            Ok(Some(placements)) => {
                let count: usize = models.iter().zip(&placements).map(|(m, p)| m.instances * p.count).sum();
                let off = (count as f64 / target).ln();
                log::debug!("spacing {spacing:.4} m: {count} caches of {target}");
                if best.as_ref().is_none_or(|b| regret(off) < regret(b.1)) {
                    best = Some((spacing, off, placements));
                }
                if (count as f64 - target).abs() <= TOLERANCE * target || off > 0.0 && spacing >= coarsest {
                    break;
                }
                if off > 0.0 { fine = Some((spacing, Some(off))) } else { coarse = Some((spacing, off)) }
            }
        }
        spacing = match (fine, coarse) {
            // Where the line between both ends, in logarithms, crosses zero; kept well inside, because counts jump.
            (Some((low, too_many)), Some((high, too_few))) => {
                if high < low * 1.0002 {
                    break;
                }
                let part = too_many.map_or(0.5, |too_many| (too_many / (too_many - too_few)).clamp(0.1, 0.9));
                low * (high / low).powf(part)
            }
            // The count varies with the square of the spacing, a little less where surfaces are finer than voxels.
            (Some((low, too_many)), None) => (low * too_many.map_or(4.0, |m| (0.55 * m).exp().max(1.02))).min(coarsest),
            (None, Some((high, too_few))) => high * (0.55 * too_few).exp().min(0.98),
            (None, None) => unreachable!("an attempt is too fine, too coarse, or the last"),
        };
    }
    match (best, refused) {
        // Finer spacings were refused, and the accepted ones give too few caches.
        (Some((_, off, _)), Some(error)) if off < -0.1 => Err(error),
        (Some((spacing, off, placements)), _) => Ok((off, Found { bounds: bounds(spacing), placements })),
        (None, error) => Err(error.expect("an attempt succeeds or is refused")),
    }
}
