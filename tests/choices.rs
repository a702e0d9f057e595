//! The study of the method's choices detects the effects that it was made for. Tests next to its defaults check that
//! these are the engine's.

use lightskin::lab::choices::{Row, Study, StudySettings};
use lightskin::lab::scenes::between_walls;
use lightskin::metrics::Metrics;
use lightskin::scene::Scene;

const SIZE: [u32; 2] = [64, 36];

fn study(scene: &Scene) -> Study<'_> {
    let settings = StudySettings { size: SIZE, caches: 150, rsm: 24 };
    Study::new(scene, &scene.cameras[0], settings).expect("a study")
}

#[track_caller]
fn row(rows: &[Row], start: &str) -> Metrics {
    rows.iter().find(|row| row.name.starts_with(start)).expect("a row").metrics
}

#[test]
fn averaged_fluxes_fail_between_two_lit_walls_and_pushing_them_out_helps() {
    let scene = between_walls(0.1);
    let rows = study(&scene).diffuse();
    let [printed, pushed, facing] = ["printed: flux", "printed, pushed out", "default"].map(|start| row(&rows, start));
    assert!(printed.relmse > 10.0 * pushed.relmse, "{printed:?}, pushed {pushed:?}");
    assert!(pushed.relmse > 2.0 * facing.relmse, "{pushed:?}, facing irradiance {facing:?}");
}

#[test]
fn the_bakes_own_references_are_those_that_the_study_calls_so() {
    let scene = between_walls(0.1);
    let study = study(&scene);
    let chosen = row(&study.references(false), "8 by d + sqrt(1 - cos)");
    assert_eq!(chosen.mare, row(&study.diffuse(), "default").mare);
}

#[test]
fn vals_become_what_light_paths_see() {
    let scene = between_walls(0.1);
    let (areas, noise) = study(&scene).areas();
    assert!(noise > 0.0 && noise < 0.1, "{noise}");
    for tilt in ["square", "tilted at most 1", "tilted at most 8"] {
        let of = |rsm: usize| row(&areas[0], &format!("{rsm}^2, {tilt}"));
        // In the mean over all pixels, the noise of the paths is negligible.
        assert!(of(128).bias.abs() < 0.002 && of(128).bias.abs() < of(32).bias.abs(), "{tilt}: {:?}", of(128));
    }
}
