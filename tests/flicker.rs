//! The measure of flicker: zero in static scenes, and lower with more VALs.

use lightskin::bake::{self, CacheSet, Density};
use lightskin::frame::ClusterRule;
use lightskin::lab::flicker::{Figures, Job, Motion, measure, model};
use lightskin::scene::Scene;
use lightskin::scene::build::{CornellSurface, cornell};

use crate::common::frames::{shoot, small};
use crate::common::{assert_clean, gpu};

fn caches(scene: &Scene) -> CacheSet {
    let settings = bake::BakeSettings { density: Density::Count(200), angle: 1.0, references: 8 };
    bake::bake(scene, &settings, &|_, _| {}).expect("bakes")
}

fn job(scene: &Scene, rsm: &[u32], pace: f64) -> Job {
    let model = model(scene);
    Job { size: [32, 32], frames: 6, rsm: rsm.to_vec(), fine: 96, cluster: None, pace, model, animation: None }
}

#[test]
fn what_stands_still_does_not_flicker() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Glossy, 0.2);
    assert_eq!(model(&scene).map(|i| scene.instances[i].name.as_str()), Some("tall block"));
    for motion in [Motion::Light, Motion::Camera, Motion::Model] {
        let rows = measure(&gpu, &scene, &[caches(&scene)], motion, &job(&scene, &[16], 0.0), &|_, _| {});
        let [row] = rows.expect("measured")[..] else { panic!("one row") };
        let Figures { kept, change, flicker, flicker_trimmed, vals_own, jitter, of_mean, of_caches } = row.figures;
        assert!(kept > 0.8 && row.caches > 150, "{row:?}");
        assert_eq!([flicker, flicker_trimmed, vals_own, of_caches], [0.0; 4]);
        assert_eq!([change, jitter, of_mean], [[0.0; 2]; 3]);
    }
    assert_clean(&gpu);
}

#[test]
fn a_moving_light_flickers_and_more_vals_flicker_less() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Glossy, 0.2);
    let job = job(&scene, &[12, 24, 48], 1.0);
    let rows = measure(&gpu, &scene, &[caches(&scene)], Motion::Light, &job, &|_, _| {}).expect("measured");
    let figures: Vec<Figures> = rows.iter().map(|row| row.figures).collect();
    for f in &figures {
        println!("{f:?}");
        assert!(f.change.iter().all(|c| *c > 0.0) && f.flicker > 0.0, "{f:?}");
    }
    for pair in figures.windows(2) {
        let all = |f: &Figures| [f.flicker, f.vals_own, f.jitter[0], f.jitter[1], f.of_mean[0], f.of_mean[1]];
        let less = all(&pair[1]).iter().zip(all(&pair[0])).all(|(finer, coarser)| *finer < coarser);
        assert!(less, "{pair:?}");
    }
    assert_clean(&gpu);
}

/// Clusters do not affect brute force. They affect caches, and less so with finer cuts.
#[test]
fn clusters_are_measured_by_their_rule() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Glossy, 0.2);
    let set = [caches(&scene)];
    let [none, fine, coarse] = [None, Some(1e6), Some(1.0)].map(|radii| {
        let job = Job { cluster: radii.map(ClusterRule::Distance), ..job(&scene, &[32], 1.0) };
        measure(&gpu, &scene, &set, Motion::Light, &job, &|_, _| {}).expect("measured")[0].figures
    });
    let of_truth = |f: &Figures| [f.vals_own, f.change[1], f.jitter[1], f.of_mean[1]];
    let apart = |f: &Figures| (f.of_caches / none.of_caches - 1.0).abs();
    assert!(of_truth(&none) == of_truth(&fine) && of_truth(&none) == of_truth(&coarse), "{none:?} {coarse:?}");
    assert!(apart(&fine) < 1e-4 && apart(&coarse) > 1e-3, "{none:?} {fine:?} {coarse:?}");
    assert_clean(&gpu);
}

/// A moving camera says nothing about the stability of the diffuse lobe, because diffuse light does not depend on the
/// camera.
#[test]
fn the_diffuse_light_of_caches_does_not_know_the_camera() {
    let gpu = gpu();
    let scene = cornell(CornellSurface::Glossy, 0.2);
    let mut other = scene.clone();
    other.cameras[0].world_from_camera.translation.x += 0.37;
    let caches = caches(&scene);
    let [a, b] = [&scene, &other].map(|scene| shoot(&gpu, scene, Some(&caches), &small()));
    assert!(
        a.proxies.iter().zip(&b.proxies).all(|(a, b)| a.diffuse == b.diffuse),
        "diffuse proxies must be equal to the bit"
    );
    assert!(
        a.proxies.iter().zip(&b.proxies).any(|(a, b)| a.glossy != b.glossy),
        "glossy proxies must depend on the view"
    );
}
