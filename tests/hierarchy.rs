//! Adaptive caches in f64: coarse ones cover a model, fine ones lie between them, and what is interpolated is what a cache
//! would have gathered where its light is far.

use glam::{DVec3, dvec3};
use lightskin::bake::levels::{COARSENING, Choice, Levels};
use lightskin::reference::gather::{Cache, Gathered, ProxyWeight, gather};
use lightskin::reference::hierarchy::{Lit, Rule, light};
use lightskin::reference::rsm::Val;

/// Caches on two faces of a cube's edge, so far apart, row by row: one face up, one towards +z.
fn bent(side: usize, spacing: f64) -> Vec<Cache> {
    let cell = |i: usize| (i as f64 + 0.5) * spacing;
    let places = (0..side * side).map(|i| [cell(i % side), cell(i / side)]);
    let face = |normal: DVec3, at: fn([f64; 2]) -> DVec3| {
        places.clone().map(move |p| Cache { position: at(p), normal, exponent: 20.0 })
    };
    face(DVec3::Y, |[x, z]| dvec3(x, 0.0, -z)).chain(face(DVec3::Z, |[x, y]| dvec3(x, -y, 0.0))).collect()
}

fn levels(caches: &[Cache], spacing: f64, count: usize, choice: Choice) -> Levels {
    let points: Vec<_> = caches.iter().map(|c| (c.position, c.normal)).collect();
    Levels::new(&points, spacing, count, 8, choice)
}

#[test]
fn every_cache_has_coarser_parents_that_are_near_and_face_its_way() {
    let caches = bent(12, 0.1);
    for (count, sizes) in [(1, vec![288]), (2, vec![72, 216]), (3, vec![18, 54, 216])] {
        let made = levels(&caches, 0.1, count, Choice::Farthest);
        let found: Vec<usize> = (0..count).map(|l| made.level.iter().filter(|level| **level == l).count()).collect();
        assert_eq!(found, sizes);
        for (i, cache) in caches.iter().enumerate() {
            let parents = &made.parents[i];
            assert_eq!(parents.len(), if made.level[i] == 0 { 0 } else { 8 });
            assert!(parents.iter().all(|p| made.level[*p] < made.level[i]));
            if let Some(first) = parents.first() {
                let apart = 0.1 * (COARSENING as f64).powf(0.5 * (count - made.level[i]) as f64);
                assert!((made.apart[i] - apart).abs() < 1e-12, "{} instead of {apart}", made.apart[i]);
                assert_eq!(caches[*first].normal, cache.normal, "cache {i}");
                assert!(caches[*first].position.distance(cache.position) <= apart, "cache {i}");
            }
        }
    }
}

#[test]
fn farthest_points_cover_better_than_every_fourth() {
    let caches = bent(12, 0.1);
    let [farthest, stride] = [Choice::Farthest, Choice::Stride].map(|choice| {
        let made = levels(&caches, 0.1, 2, choice);
        let uncovered =
            |i: &usize| made.parents[*i].first().map_or(0.0, |p| caches[*p].position.distance(caches[*i].position));
        (0..caches.len()).map(|i| uncovered(&i)).fold(0.0, f64::max)
    });
    assert!(farthest < 0.9 * stride, "{farthest} and {stride}");
}

#[test]
fn small_models_stay_as_they_are() {
    let made = levels(&bent(2, 0.1), 0.1, 3, Choice::Farthest);
    assert!(made.level.iter().all(|level| *level == 0) && made.parents.iter().all(Vec::is_empty));
}

/// Caches lit by one VAL at this place by a rule, and all of them gathered.
fn lit(place: DVec3, rule: Rule) -> (Vec<Cache>, Lit, Vec<Gathered>) {
    let caches = bent(12, 0.1);
    let Levels { level, parents, apart } = levels(&caches, 0.1, 2, Choice::Farthest);
    let normal = (dvec3(0.6, 0.0, 0.0) - place).normalize();
    let vals = [Val { position: place, normal, area: 1e-4, flux: dvec3(1.0, 2.0, 0.5) }];
    let eye = Some(dvec3(0.5, 3.0, 3.0));
    let full: Vec<_> = caches.iter().map(|c| gather(c, &vals, eye, ProxyWeight::Irradiance)).collect();
    let needed: Vec<usize> = (0..caches.len()).collect();
    let lights = |i: usize, above: &[(Cache, Gathered)]| rule.lights(&caches[i], above, apart[i]);
    let made = light(&caches, eye, [&level, &needed], &parents, lights, |i| full[i]);
    (caches, made, full)
}

#[test]
fn far_light_is_interpolated_as_it_would_be_gathered() {
    let (caches, made, full) = lit(dvec3(0.6, 4.0, 4.0), Rule { near: 4.0, differ: 0.5 });
    assert_eq!((made.lit, made.interpolated), (72, 216));
    let mut worst = 0.0_f64;
    for (i, gathered) in made.gathered.iter().enumerate() {
        let (found, wanted) = (gathered.expect("needed").diffuse, full[i].diffuse);
        assert!(found.lit && wanted.lit);
        assert!(found.position.distance(wanted.position) < 1e-9, "cache {i} at {}", caches[i].position);
        worst =
            worst.max(found.facing_irradiance.distance(wanted.facing_irradiance) / wanted.facing_irradiance.length());
        assert!((found.distance2 / wanted.distance2 - 1.0).abs() < 1e-9, "cache {i}");
    }
    // Stage 8's falloff goes by the distance, not its square: at a rim, where all parents lie on one side, half is missed.
    assert!(worst < 0.02, "{worst}");
}

#[test]
fn near_light_and_light_that_ends_are_gathered() {
    // Near the edge between both faces, and below the horizon of one.
    let (caches, made, full) = lit(dvec3(0.6, 0.1, -0.3), Rule::near(2.0));
    assert!(made.lit > 72 && made.interpolated > 0, "{} lit", made.lit);
    let mut worst = 0.0_f64;
    for (i, gathered) in made.gathered.iter().enumerate() {
        let found = gathered.expect("needed").diffuse;
        assert_eq!(found.lit, full[i].diffuse.lit, "cache {i} at {}", caches[i].position);
        let wanted = full[i].diffuse.facing_irradiance;
        worst = worst.max(found.facing_irradiance.distance(wanted) / wanted.length().max(1e-9));
    }
    assert!(worst < 0.1, "{worst}");
    let (_, all, _) = lit(dvec3(0.6, 0.1, -0.3), Rule { near: 0.0, differ: 0.0 });
    let dark = all.gathered.iter().flatten().filter(|g| !g.diffuse.lit).count();
    assert!(all.interpolated < dark, "only what lies in the dark with all its parents: {}", all.interpolated);
}
