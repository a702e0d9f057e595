//! The automatic exposure against its f64 twin. It meters surfaces, but not lamps and not the sky behind surfaces.

use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::frame::{Exposure, LightShadows, View, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::lab::shot::radiance;
use lightskin::reference::tonemap::automatic_ev;
use lightskin::scene::build::{CornellSurface, cornell, quad};
use lightskin::scene::sky::Sky;
use lightskin::scene::{LightKind, Material, Projection, Scene};

use crate::cli::{ATRIUM, folder, works};
use crate::common::frames::{SPOT, add, camera, corner, phong};
use crate::common::{assert_clean, gpu};

/// EV that shows this luminance [cd/m^2] as middle grey.
fn ev_of(luminance: f64) -> f64 {
    (luminance / (1.2 * 0.18)).log2()
}

/// EV that the device measures, after a comparison with the twin.
#[track_caller]
fn metered(gpu: &Gpu, scene: &Scene, knobs: &Knobs) -> f64 {
    let world = World::new(gpu, scene, None).expect("uploaded");
    let mut frame = Frame::new(gpu, scene, &world, knobs).expect("made");
    let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &world, &view);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    assert_clean(gpu);
    let picture = &frame.picture;
    let indirect = picture.indirect.iter().flat_map(|i| [Some(&i.diffuse), i.glossy.as_ref()]).flatten();
    let mut color = radiance(gpu, &picture.surface.radiance).expect("read");
    for layer in indirect {
        for (sum, light) in color.iter_mut().zip(radiance(gpu, layer).expect("read")) {
            *sum += light;
        }
    }
    let depth: Vec<f32> = gpu.read_image(&picture.surface.depth).expect("read");
    let seen: Vec<bool> = depth.iter().map(|depth| *depth > 0.0).collect();
    let ev = f64::from(gpu.read::<f32>(&picture.output.exposure).expect("read")[0]);
    if knobs.exposure == Exposure::Automatic {
        let expected = automatic_ev(knobs.size, &color, &seen);
        assert!((ev - expected).abs() < 0.01, "EV {ev} instead of {expected}");
        // Four times the light is two stops.
        let brighter: Vec<DVec3> = color.iter().map(|c| 4.0 * *c).collect();
        let stops = automatic_ev(knobs.size, &brighter, &seen) - expected;
        assert!((stops - 2.0).abs() < 1e-9 || expected == 0.0, "{stops} stops");
    }
    ev
}

fn direct(size: [u32; 2]) -> Knobs {
    Knobs { gi: Gi::Off, light_shadows: LightShadows::Maps(64), ..Knobs::plain(size) }
}

/// Emissive rectangles seen straight on, in a picture from -1 to 1 in both directions. Later rectangles are in front of
/// earlier ones. Each has left, bottom, width, height and radiance.
fn poster(rectangles: &[[f32; 5]]) -> Scene {
    let mut scene = Scene::default();
    for (i, [x, y, w, h, radiance]) in rectangles.iter().enumerate() {
        let surface = quad(vec3(*x, *y, 0.01 * i as f32), Vec3::X * *w, Vec3::Y * *h, 4.0);
        let material = Material { emissive: Vec3::splat(*radiance), ..phong([0.0; 3], [0.0; 3], 1.0) };
        add(&mut scene, surface, material, DAffine3::IDENTITY);
    }
    let mut camera = camera(dvec3(0.0, 0.0, 3.0), DVec3::ZERO, 1.0);
    camera.projection = Projection::Orthographic { ymag: 1.0 };
    scene.cameras.push(camera);
    scene
}

/// EV of a poster.
#[track_caller]
fn of_poster(gpu: &Gpu, rectangles: &[[f32; 5]]) -> f64 {
    metered(gpu, &poster(rectangles), &direct([100, 100]))
}

/// A rectangle that fills the picture.
fn wall(radiance: f32) -> [f32; 5] {
    [-1.0, -1.0, 2.0, 2.0, radiance]
}

/// Five columns. Each is one stop brighter than the one before.
fn steps() -> Vec<[f32; 5]> {
    (0..5).map(|i| [-1.0 + 0.4 * i as f32, -1.0, 0.4, 2.0, 10.0 * (i as f32).exp2()]).collect()
}

#[test]
fn the_device_measures_what_the_twin_does() {
    let gpu = gpu();
    let brute_force =
        Knobs { gi: Gi::BruteForce, rsm: 16, light_shadows: LightShadows::Maps(64), ..Knobs::plain([48, 48]) };
    let room = cornell(CornellSurface::Glossy, 1.0);
    println!("a room: EV {:.3}", metered(&gpu, &room, &brute_force));
    println!("a room, large: EV {:.3}", metered(&gpu, &room, &direct([1200, 801])));
    println!("a room, long: EV {:.3}", metered(&gpu, &room, &direct([5000, 3])));
    println!("a corner: EV {:.3}", metered(&gpu, &corner(&[SPOT, LightKind::Point], 8.0), &direct([97, 41])));
    // The EV of a picture with one luminance follows from this luminance, however bright it is.
    for luminance in [1e-6, 0.01, 1.0, 777.0, 1e6] {
        let ev = of_poster(&gpu, &[wall(luminance)]);
        assert!((ev - ev_of(luminance.into())).abs() < 0.003, "{luminance}: EV {ev}");
    }
}

#[test]
fn a_bright_sky_behind_an_object_does_not_change_its_exposure() {
    let gpu = gpu();
    // A small object with light and shade, off the centre.
    let mut scene = corner(&[LightKind::Point], 8.0);
    scene.cameras[0] = camera(dvec3(5.0, 6.0, 8.0), dvec3(1.5, 0.5, 0.0), 0.8);
    let alone = metered(&gpu, &scene, &direct([160, 90]));
    for radiance in [0.01, 1e5] {
        let mut under_sky = scene.clone();
        // The sky is visible, but its light is switched off.
        Sky::even(Vec3::splat(radiance)).put_over(&mut under_sky, 1);
        under_sky.lights[1].intensity = 0.0;
        let ev = metered(&gpu, &under_sky, &direct([160, 90]));
        assert!((ev - alone).abs() < 1e-6, "EV {alone}, in front of a sky of {radiance} cd/m^2 {ev}");
        // If nothing else is visible, the sky is metered.
        under_sky.cameras[0] = camera(dvec3(0.0, 5.0, 0.0), dvec3(0.0, 9.0, 1.0), 0.8);
        let ev = metered(&gpu, &under_sky, &direct([64, 36]));
        assert!((ev - ev_of(radiance.into())).abs() < 0.01, "EV {ev} for a sky of {radiance} cd/m^2");
    }
}

#[test]
fn a_lamp_in_view_does_not_blacken_the_picture() {
    let gpu = gpu();
    let alone = of_poster(&gpu, &steps());
    // A lamp on 3 % of the picture, a thousand times as bright as the wall, in the centre and at the border.
    for at in [-0.173, -0.98] {
        let mut lit = steps();
        lit.push([at, at, 0.346, 0.346, 40_000.0]);
        let ev = of_poster(&gpu, &lit);
        println!("EV {alone:.3}, with a lamp {ev:.3}");
        assert!((ev - alone).abs() < 0.15, "EV {alone}, with a lamp {ev}");
    }
    // Nearly black areas do not overexpose the rest, because they count as five stops darker.
    let spot = of_poster(&gpu, &[wall(1e-5), [-0.4, -0.4, 0.8, 0.8, 100.0]]);
    assert!(spot > ev_of(100.0) - 5.0 && spot < ev_of(100.0), "EV {spot}");
    // Black areas do not count at all. Neither do areas without a surface.
    let spot = of_poster(&gpu, &[wall(0.0), [0.5, 0.5, 0.1, 0.1, 100.0]]);
    assert!((spot - ev_of(100.0)).abs() < 0.003, "EV {spot}");
    let lamp = of_poster(&gpu, &[[0.5, 0.5, 0.1, 0.1, 1e6]]);
    assert!((lamp - ev_of(1e6)).abs() < 0.003, "EV {lamp}");
}

/// Light that is 16 stops darker than the rest is no light: it comes from rounding errors and leaks.
#[test]
fn what_is_nearly_black_does_not_brighten_the_picture() {
    let gpu = gpu();
    let lit = [-0.5, -0.5, 0.8, 0.8, 2.0];
    let alone = of_poster(&gpu, &[wall(0.0), lit]);
    let leaked = of_poster(&gpu, &[wall(1e-6), lit]);
    let dim = of_poster(&gpu, &[wall(1e-3), lit]);
    println!("EV {alone} alone, {leaked} with a leak, {dim} with dim light");
    assert!((leaked - alone).abs() < 0.01 && dim < alone - 0.5, "EV {alone}, {leaked}, {dim}");
}

#[test]
fn the_centre_matters_more_than_the_rim() {
    let gpu = gpu();
    // The square in the centre and the area around it each fill half of the picture.
    let square = |around, inside| of_poster(&gpu, &[wall(around), [-0.707, -0.707, 1.414, 1.414, inside]]);
    let (bright, dark) = (square(1.0, 8.0), square(8.0, 1.0));
    println!("bright centre EV {bright:.3}, bright border EV {dark:.3}");
    assert!(bright - dark > 0.5, "bright centre EV {bright}, bright border EV {dark}");
    assert!(
        (bright + dark - ev_of(1.0) - ev_of(8.0)).abs() < 0.01,
        "both must be symmetric to the mean of the two luminances"
    );
}

#[test]
fn black_is_ev_0_and_a_fixed_value_stays() {
    let gpu = gpu();
    assert_eq!(of_poster(&gpu, &[wall(0.0)]), 0.0);
    let fixed = Knobs { exposure: Exposure::Ev(3.25), ..direct([20, 20]) };
    assert_eq!(metered(&gpu, &poster(&[wall(7.0)]), &fixed), 3.25);
}

#[test]
fn the_path_tracer_exposes_as_the_device_does() {
    let folder = folder("exposure");
    let ev = |args: &[&str]| -> f64 {
        let out =
            works(&folder, &[&["render", ATRIUM, "--size", "160x90", "--aa", "off", "-o", "a.png"], args].concat());
        let line = out.lines().find_map(|l| l.strip_prefix("exposure  EV ")).expect("an exposure");
        line.trim().parse().expect("a number")
    };
    let (drawn, traced) = (ev(&["--gi", "off"]), ev(&["--gi", "path-trace", "--bounces", "0"]));
    println!("drawn EV {drawn}, traced EV {traced}");
    assert!((drawn - traced).abs() < 0.05, "drawn EV {drawn}, traced EV {traced}");
}
