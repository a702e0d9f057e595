//! Further bounces: light that caches receive turns them into VALs, which light all caches. METHOD 9, thesis 6.1.7.
//!
//! The form factors of all caches at one cache can sum to more than 1: discs of caches at an edge do not match the
//! surface there, and nothing occludes one cache from another. Since no point sees more than its hemisphere, larger
//! sums are scaled down to 1.

use glam::DVec3;
use rayon::prelude::*;

use super::brute_force;
use super::gather::{Cache, val_geometry};
use super::rsm::Val;
use crate::shared::{NO_REFERENCES, UNKNOWN_CACHE};

/// A cache and its share of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// The point that receives light.
    pub cache: Cache,
    /// Area [m^2], eq. 5.58.
    pub area: f64,
    /// Diffuse albedo, mean over the area.
    pub albedo: DVec3,
}

impl Patch {
    /// The patch as a light, given its irradiance \[lx\]: flux `rho E A` \[lm\].
    pub fn val(&self, irradiance: DVec3) -> Val {
        let Self { cache, area, albedo } = *self;
        Val { position: cache.position, area, normal: cache.normal, flux: albedo * irradiance * area }
    }
}

/// Sum of the form factors of all patches at a cache: 1 if their surfaces fill its hemisphere and the discs match them.
pub fn form_factors(cache: &Cache, patches: &[Patch]) -> f64 {
    let geometry = |patch: &Patch| val_geometry(cache.position, cache.normal, &patch.val(DVec3::ZERO)).0;
    patches.iter().map(|patch| patch.area * geometry(patch)).sum()
}

/// Factor on the light of all patches at a cache.
pub fn scale(form_factors: f64) -> f64 {
    1.0 / form_factors.max(1.0)
}

/// Irradiance \[lx\] at every cache after this number of bounces: light of the primary lights' VALs and, from the
/// second bounce on, of the patches lit by the previous bounce: `E_(k+1) = E_1 + s sum_j rho_j E_k,j A_j G_j`.
pub fn irradiances(patches: &[Patch], vals: &[Val], bounces: u32) -> Vec<DVec3> {
    let at = |patch: &Patch, vals: &[Val]| brute_force::irradiance(patch.cache.position, patch.cache.normal, vals);
    let first: Vec<DVec3> = patches.par_iter().map(|patch| at(patch, vals)).collect();
    let scales: Vec<f64> = patches.par_iter().map(|patch| scale(form_factors(&patch.cache, patches))).collect();
    (1..bounces).fold(first.clone(), |before, _| {
        let lit: Vec<Val> = patches.iter().zip(&before).map(|(patch, irradiance)| patch.val(*irradiance)).collect();
        let again = |i: usize| first[i] + scales[i] * at(&patches[i], &lit);
        (0..patches.len()).into_par_iter().map(again).collect()
    })
}

/// What a cache's ray meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Met {
    /// Nothing.
    Nothing,
    /// A surface without a cache on this side.
    Unknown,
    /// A surface, whose light this cache knows.
    Cache(usize),
}

impl Met {
    /// What the device stores as this number.
    pub fn of(number: u32) -> Self {
        match number {
            NO_REFERENCES => Self::Nothing,
            UNKNOWN_CACHE => Self::Unknown,
            cache => Self::Cache(cache as usize),
        }
    }
}

/// Irradiance \[lx\] at a cache from what its rays meet: the mean radiosity [lm/m^2] of the caches there. Every ray has
/// an equal share of the cosine-weighted hemisphere; unknown surfaces count as the mean of all else.
pub fn exchange(met: &[Met], radiosities: &[DVec3]) -> DVec3 {
    let known = met.iter().filter(|met| **met != Met::Unknown);
    let count = known.clone().count().max(1) as f64;
    known.map(|met| if let Met::Cache(cache) = met { radiosities[*cache] } else { DVec3::ZERO }).sum::<DVec3>() / count
}
