//! Scenes made in code move as specified.

use super::placed;
use glam::{DQuat, DVec3};
use lightskin::bake::{BakeSettings, Density, bake};
use lightskin::lab::scenes::{crowd, moving};
use lightskin::scene::Scene;
use std::time::Instant;

fn leaves(scene: &Scene) -> bool {
    let (low, high) = scene.extent.expect("moves");
    let all = scene.instances.iter().flat_map(|instance| placed(scene, instance).0);
    let outside = |p: DVec3| p.cmplt(low).any() || p.cmpgt(high).any();
    all.into_iter().any(outside)
}

#[test]
fn a_crowd_sways_out_of_step() {
    let mut scene = crowd(1000);
    assert_eq!((scene.instances.len(), scene.meshes.len()), (1001, 2));
    let vertices = scene.meshes[1].vertices.len();
    assert!((150..300).contains(&vertices), "{vertices}");
    let begin = Instant::now();
    for frame in 0..10 {
        scene.pose(0, 0.1 * f64::from(frame));
    }
    println!("{:.2} ms to pose 1000 skeletons", begin.elapsed().as_secs_f64() * 100.0);
    assert!(!leaves(&scene));
    let tip = |i: usize| {
        let instance = &scene.instances[i];
        let joint = instance.pose.as_ref().expect("bends").joints[3];
        joint.transform_point3(DVec3::Y)
    };
    assert!(tip(1).distance(tip(2)) > 0.05, "{} {}", tip(1), tip(2));
    let settings = BakeSettings { density: Density::Count(20_000), angle: 0.8, references: 8 };
    assert_eq!(bake(&scene, &settings, &|_, _| {}).expect("bakes").models.len(), 2);
}

#[test]
fn everything_in_the_moving_room_moves() {
    let mut scene = moving(0.25);
    let (block, tube, ball) = (1, 2, 3);
    let all = [block, tube, ball];
    let rest = all.map(|i| placed(&scene, &scene.instances[i]).0);
    scene.pose(0, 1.0);
    for (i, rest) in all.into_iter().zip(rest) {
        let posed = placed(&scene, &scene.instances[i]).0;
        let farthest = posed.iter().zip(&rest).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(farthest > 0.05, "{i}: {farthest} m");
    }
    assert!(scene.lights[0].position.distance(DVec3::new(0.0, 1.7, 0.5)) < 1e-6);
    let turned = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2) * DQuat::from_rotation_x(0.6);
    let found = scene.instances[block].world_from_model.matrix3;
    assert!(found.abs_diff_eq(glam::DMat3::from_quat(turned), 1e-6), "{found}");
    // With half of the morph target, the height is 1.35 times as large.
    let high = placed(&scene, &scene.instances[ball]).0.iter().map(|p| p.y).fold(0.0, f64::max);
    assert!((high - 0.35 - 0.2 * 1.35).abs() < 1e-6, "{high}");
    for time in [0.3, 1.7, 2.9, 4.0] {
        scene.pose(0, time);
        assert!(!leaves(&scene), "at {time} s");
    }
}
