//! Proxy shadows (stage 7) with every choice that METHOD 6 leaves open, against rays from each cache to each VAL.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::study::Study;
use crate::reference::gather::{Cache, Lobe, ProxyWeight, Received, gather_received, luminance, receive};
use crate::reference::occlude::{Cap, Choices, Facing, Light, Radius, Tangents, visible};
use crate::reference::phong::mirrored_view;

/// One row of the table: errors of the light at caches against rays.
#[derive(Clone, Debug, PartialEq)]
pub struct Dimmed {
    /// The variation.
    pub name: String,
    /// Errors of the diffuse and the glossy lobe.
    pub lobes: [DimmedLobe; 2],
}

/// Errors of a lobe's light at the caches that it reaches. All are 0 if it reaches none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DimmedLobe {
    /// Relative error of the mean.
    pub bias: f64,
    /// Root mean square error, divided by the mean.
    pub rmse: f64,
    /// Mean relative error over caches with more than a hundredth of the mean.
    pub mape: f64,
}

/// A cache's lobe without shadows, and the visible share of its light by rays.
struct Truth {
    lobe: Lobe,
    /// Variance along each world axis [m^2].
    variance: DVec3,
    light: f64,
    visible: f64,
}

impl Study<'_> {
    /// No occlusion, the engine's choices, and single variations.
    pub fn dimming(&self) -> Vec<Dimmed> {
        let truths: Vec<[Truth; 2]> = self.caches.par_iter().map(|cache| self.truth_at(cache)).collect();
        let base = Choices::default();
        let printed = Choices {
            square: 1.0,
            fade: 1.0,
            facing: Facing::Front,
            radius: Radius::LongestAxis,
            tangents: Tangents::Surface,
            ..base
        };
        let both = Choices { facing: Facing::Both, ..printed };
        let variants = [
            ("default: sqrt(2 F), both sides, 2 r".to_owned(), base),
            ("side sqrt(F)".into(), Choices { square: 1.0, ..base }),
            ("side sqrt(pi F)".into(), Choices { square: PI, ..base }),
            ("front sides of discs".into(), Choices { facing: Facing::Front, ..base }),
            ("front sides, sqrt(pi F)".into(), Choices { facing: Facing::Front, square: PI, ..base }),
            ("fade over 1 r".into(), Choices { fade: 1.0, ..base }),
            ("fade over 3 r".into(), Choices { fade: 3.0, ..base }),
            ("sqrt(F), fade over 1 r".into(), Choices { square: 1.0, fade: 1.0, ..base }),
            ("radius: longest axis".into(), Choices { radius: Radius::LongestAxis, ..base }),
            ("radius: twice the longest axis".into(), Choices { radius: Radius::TwiceLongestAxis, ..base }),
            ("radius: deviation in space".into(), Choices { radius: Radius::Deviation, ..base }),
            ("tangents of the surface".into(), Choices { tangents: Tangents::Surface, ..base }),
            ("no cap".into(), Choices { cap: Cap::None, ..base }),
            ("cap by discs behind the light too".into(), Choices { cap: Cap::All, ..base }),
            ("printed".into(), printed),
            ("printed, sqrt(pi F)".into(), Choices { square: PI, ..printed }),
            ("printed, both sides".into(), both),
            ("printed, both sides, sqrt(pi F)".into(), Choices { square: PI, ..both }),
        ];
        let row = |name: String, share: &(dyn Fn(&Cache, &Truth) -> f64 + Sync)| {
            let shares: Vec<[f64; 2]> = (self.caches.par_iter().zip(&truths))
                .map(|(cache, lobes)| [0, 1].map(|i| if lobes[i].lobe.lit { share(cache, &lobes[i]) } else { 1.0 }))
                .collect();
            let lobes = [0, 1].map(|lobe| errors(truths.iter().zip(&shares).map(|(t, s)| (&t[lobe], s[lobe]))));
            Dimmed { name, lobes }
        };
        let mut rows = vec![row("no shadows".into(), &|_, _| 1.0)];
        rows.extend(variants.map(|(name, choices)| {
            row(name, &|cache, truth| {
                let light = Light::new(cache, truth.lobe.position, choices.radius.of(truth.variance), &choices);
                visible(cache, &light, &self.discs, &choices)
            })
        }));
        rows
    }

    fn truth_at(&self, cache: &Cache) -> [Truth; 2] {
        let mirrored = mirrored_view(cache.position, cache.normal, self.eye());
        let view = self.is_glossy().then_some(mirrored);
        let received: Vec<(Received, bool)> = (self.vals.iter())
            .map(|val| (receive(cache, view, val, ProxyWeight::Irradiance.of(val)), val.position))
            .filter(|(r, _)| r.pull > 0.0)
            .map(|(r, at)| (r, !self.world.blocked(cache.position, at)))
            .collect();
        let all = gather_received(cache, mirrored, received.iter().map(|(r, _)| *r));
        [(all.diffuse, false), (all.glossy, true)].map(|(lobe, glossy)| {
            let weight = |r: &Received| r.pull * if glossy { r.lobe } else { 1.0 };
            let light = |r: &Received| luminance(r.irradiance) * if glossy { r.lobe } else { 1.0 };
            let sum = |of: &dyn Fn(&Received) -> f64, seen: bool| -> f64 {
                received.iter().filter(|(_, visible)| *visible || !seen).map(|(r, _)| of(r)).sum()
            };
            let mean = lobe.position - cache.position;
            let squares: DVec3 = received.iter().map(|(r, _)| weight(r) * (r.offset - mean) * (r.offset - mean)).sum();
            let (total, all) = (sum(&weight, false), sum(&light, false));
            let share = if all > 0.0 { sum(&light, true) / all } else { 1.0 };
            Truth {
                lobe,
                variance: if total > 0.0 { squares / total } else { DVec3::ZERO },
                light: all,
                visible: share,
            }
        })
    }
}

/// Errors of the light with these visible shares against the true ones.
fn errors<'a>(shares: impl Iterator<Item = (&'a Truth, f64)>) -> DimmedLobe {
    let pairs: Vec<(f64, f64)> = (shares.filter(|(truth, _)| truth.light > 0.0))
        .map(|(truth, share)| (share * truth.light, truth.visible * truth.light))
        .collect();
    let count = pairs.len().max(1) as f64;
    let mean = pairs.iter().map(|p| p.1).sum::<f64>() / count;
    if mean == 0.0 {
        return DimmedLobe::default();
    }
    let relative: Vec<f64> = pairs.iter().filter(|p| p.1 > 0.01 * mean).map(|p| (p.0 / p.1 - 1.0).abs()).collect();
    DimmedLobe {
        bias: pairs.iter().map(|p| p.0 - p.1).sum::<f64>() / count / mean,
        rmse: (pairs.iter().map(|p| (p.0 - p.1).powi(2)).sum::<f64>() / count).sqrt() / mean,
        mape: relative.iter().sum::<f64>() / relative.len().max(1) as f64,
    }
}
