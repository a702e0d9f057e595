//! The hard cases of `lightskin lab hard-cases`, one test for each kind.

use lightskin::lab::hard_cases::{lines, run};

use crate::common::{assert_clean, gpu};

/// Runs the cases of a kind and reports all failures.
fn hold(kind: &str) {
    let gpu = gpu();
    let (mut count, mut failed) = (0, Vec::new());
    for case in lines().iter().filter(|case| case.kind == kind) {
        let line = run(&gpu, case).unwrap_or_else(|error| panic!("{kind}: {}: {error}", case.input));
        let text = format!("{kind}: {}: {}, expected: {}", line.input, line.measured, line.expected);
        println!("{text}");
        count += 1;
        if !line.pass {
            failed.push(text);
        }
    }
    assert!(count > 0, "no case of {kind}");
    assert!(failed.is_empty(), "{} of {count} cases fail:\n{}", failed.len(), failed.join("\n"));
    assert_clean(&gpu);
}

macro_rules! kinds {
    ($($name:ident: $kind:literal)*) => {
        $(#[test]
        fn $name() {
            hold($kind);
        })*

        #[test]
        fn every_kind_has_its_test() {
            for case in lines() {
                assert!([$($kind),*].contains(&case.kind), "no test runs {}", case.kind);
            }
        }
    };
}

kinds! {
    scale: "scale"
    offset: "offset"
    intensity: "intensity"
    sums_in_f32: "f32 sums"
    exponent: "exponent"
    caches: "caches"
    vals: "VALs"
    touching_vals: "touching VAL"
    grazing_vals: "grazing VALs"
    vals_behind: "VALs behind"
    nodes: "nodes"
    triangles: "triangles"
    normals: "normals"
    black: "black"
    white: "white"
    grazing_light: "grazing light"
    coplanar_vals: "coplanar VALs"
    light_in_a_wall: "light in a wall"
    light_on_a_wall: "light on a wall"
    closed_box: "closed box"
    no_lights: "no lights"
    far_camera: "far camera"
}
