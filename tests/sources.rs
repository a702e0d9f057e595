//! Sources of error: exact integrals against closed forms and quadrature, VALs by rays against the references, the
//! start of the chain against the device, and each replacement where its effect is known.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, dvec3, vec3};
use lightskin::lab::sources::curves::{Receives, form_factor_error, lobe_error};
use lightskin::lab::sources::exact::{Exact, Receiver, receive};
use lightskin::lab::sources::stage::{Level, Stage};
use lightskin::lab::sources::vals::{Texel, cast, cast_view, views};
use lightskin::lab::sources::{Lights, SourcesSettings, sources};
use lightskin::reference::disc::{disc_form_factor, lobe_mean, polygon_form_factor, regular_polygon};
use lightskin::reference::form_factor::disc_form_factor_integral;
use lightskin::reference::rsm::{self, Val};
use lightskin::reference::world::World;
use lightskin::scene::build::quad;
use lightskin::scene::{LightKind, Scene};

use crate::common::frames::{SPOT, add, baked, camera, corner, lamp, phong, shoot, small, triangles};
use crate::common::gpu;

#[track_caller]
fn assert_near(actual: f64, expected: f64, relative: f64, what: &str) {
    assert!((actual - expected).abs() <= relative * expected.abs(), "{what}: {actual} instead of {expected}");
}

/// Directions spread over the sphere by the golden ratio.
pub(crate) fn directions(count: usize) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (sin, cos) = (i as f64 * PI * (3.0 - 5_f64.sqrt())).sin_cos();
        let r = (1.0 - z * z).sqrt();
        dvec3(r * cos, r * sin, z)
    })
}

// Exact integrals.

#[test]
fn a_disc_on_the_axis_has_its_closed_form() {
    for d in [1e-3, 0.1, 1.0, 10.0, 1e4] {
        let factor = disc_form_factor(PI * 0.25, dvec3(3.0, 0.0, d), -DVec3::Z, dvec3(3.0, 0.0, 0.0), DVec3::Z);
        assert_near(factor, 0.25 / (0.25 + d * d), 1e-12, "on the axis");
        assert_eq!(disc_form_factor(PI * 0.25, DVec3::Z * d, DVec3::Z, DVec3::ZERO, DVec3::Z), 0.0, "from behind");
        assert_eq!(disc_form_factor(PI * 0.25, DVec3::Z * d, -DVec3::Z, DVec3::ZERO, -DVec3::Z), 0.0, "below");
    }
}

/// A disc that cuts a cap off a sphere hides exactly the cap from every point on the rest of the sphere. Such a point
/// receives equal light from equal parts of the sphere. The form factor is therefore the cap's fraction of the sphere,
/// for every point.
#[test]
fn a_disc_in_a_sphere_is_its_caps_share_from_everywhere() {
    for half_angle in [0.05_f64, 0.5, 1.2] {
        let (sin, cos) = half_angle.sin_cos();
        let share = 0.5 * (1.0 - cos);
        let mut count = 0;
        for point in directions(200).filter(|p| p.z < cos - 1e-3) {
            let factor = disc_form_factor(PI * sin * sin, DVec3::Z * cos, -DVec3::Z, point, -point);
            assert_near(factor, share, 1e-9, &format!("{half_angle}, {point}"));
            count += 1;
        }
        assert!(count > 50);
    }
}

#[test]
fn a_disc_that_the_horizon_halves_has_its_closed_form() {
    for x in [0.1_f64, 1.0, 8.0] {
        let expected = (x.atan() - x / (1.0 + x * x)) / PI;
        let factor = disc_form_factor(PI * x * x, DVec3::Z, -DVec3::Z, DVec3::ZERO, DVec3::X);
        // The code uses a polygon for the rim in this case.
        let relative = (factor / expected - 1.0).abs();
        println!("half a disc of radius {x} at distance 1: relative error {relative:.1e}");
        assert!(relative < 4e-4, "{factor} instead of {expected}");
    }
}

#[test]
fn a_rectangle_over_a_corner_has_its_closed_form() {
    for (x, y) in [(1.0_f64, 1.0_f64), (0.2, 3.0), (10.0, 0.01)] {
        let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        let expected = (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / (2.0 * PI);
        let corners = [(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)].map(|(x, y)| dvec3(x, y, 1.0));
        assert_near(polygon_form_factor(&corners, DVec3::ZERO, DVec3::Z), expected, 1e-12, "rectangle");
    }
}

#[test]
fn any_disc_is_its_integral() {
    let mut cut = 0;
    for (i, disc_normal) in directions(30).enumerate() {
        let distance = 0.8 + 0.2 * (i % 10) as f64;
        let point = dvec3(1.0, 2.0, 3.0);
        let centre = point + distance * DVec3::Z;
        for normal in directions(8) {
            let factor = disc_form_factor(1.0, centre, disc_normal, point, normal);
            // The point may be behind the plane of a tilted disc. Then the integral sees no part of the disc, either.
            let integral = disc_form_factor_integral(1.0, centre, disc_normal, point, normal, 600);
            // Both have errors: midpoints along a horizon, and a polygon for the rim.
            assert!((factor - integral).abs() < 2e-3 * integral + 1e-5, "{disc_normal} {normal}: {factor}, {integral}");
            let polygon = regular_polygon::<1024>(1.0, centre, disc_normal);
            if factor > 0.0 {
                let by_polygon = polygon_form_factor(&polygon, point, normal);
                assert!((factor - by_polygon).abs() < 1e-3 * factor + 1e-6, "{factor}, by polygon {by_polygon}");
                cut += usize::from(polygon.iter().any(|c| normal.dot(*c - point) < 0.0));
            }
        }
    }
    assert!(cut > 30, "{cut} discs at the horizon");
}

#[test]
fn a_patch_in_the_points_own_plane_brings_nothing() {
    // Rotated walls are coplanar only up to rounding.
    let turn = DQuat::from_axis_angle(dvec3(1.0, 2.0, 3.0).normalize(), 0.7);
    let place = |x: f64, y: f64| turn * dvec3(x, y, 0.3);
    let normal = turn * DVec3::Z;
    for point in [place(0.001, 0.002), place(0.3, 0.0), place(-0.02, 5.0)] {
        for slip in [0.0, 1e-17, -1e-17, 1e-16] {
            let corners = [place(-0.1, -0.1), place(0.1, -0.1), place(0.1, 0.1), place(-0.1, 0.1)];
            assert!(polygon_form_factor(&corners, point + slip * normal, normal) < 1e-8);
            assert!(disc_form_factor(0.04, place(0.0, 0.0), normal, point + slip * normal, normal) < 1e-8);
        }
    }
}

#[test]
fn the_mean_of_a_lobe_is_its_integral() {
    let point_normal = dvec3(0.2, -0.1, 1.0).normalize();
    let mut worst = 0.0_f64;
    for k in [0.5, 3.0, 40.0, 300.0, 2000.0] {
        for (distance, tilt, aim) in
            [(0.2, 0.3, 0.0), (1.0, 0.0, 0.1), (1.0, 1.0, 0.3), (4.0, 0.5, 0.05), (15.0, 0.8, 0.1)]
        {
            let turn = DQuat::from_rotation_y(tilt);
            let corner = |x: f64, y: f64| dvec3(0.0, 0.0, distance) + turn * dvec3(x, 0.7 * y, 0.0);
            let corners = [corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)];
            let mirrored = dvec3(aim, 0.3 * aim, 1.0).normalize();
            let steps = 1200;
            let (mut weight, mut lobe) = (0.0, 0.0);
            for i in 0..steps * steps {
                let place = |i: usize| (i as f64 + 0.5) / f64::from(steps as u32) - 0.5;
                let p = corner(place(i % steps), place(i / steps));
                let w = point_normal.dot(p).max(0.0) / p.length_squared().powi(2);
                weight += w;
                lobe += w * mirrored.dot(p.normalize()).max(0.0).powf(k);
            }
            let mean = lobe_mean(&corners, 0.7, DVec3::ZERO, point_normal, mirrored, k);
            let expected = lobe / weight;
            // Far outside the lobe the result need not be exact.
            let error = (mean - expected).abs() / (expected + 1e-4);
            worst = worst.max(error);
            assert!(error < 3e-3, "k {k}, {distance} m, {tilt}, {aim}: {mean} instead of {expected}");
        }
    }
    println!("lobe over a patch: largest error {worst:.1e}");
}

#[test]
fn curves_are_what_is_known() {
    // Over a small square at which the lobe aims, cos^k is 1 - k/2 theta^2. The mean of theta^2 is a sixth of the
    // squared ratio of side and distance.
    for (k, distance) in [(3.0, 20.0), (10.0, 20.0), (30.0, 40.0)] {
        let expected = k / 12.0 / (distance * distance);
        assert_near(lobe_error(k, 0.0, distance), expected, 0.05, "constant BRDF");
    }
    // The thesis's claim: less than 10 % for k < 30 at a distance of five sides.
    assert!(lobe_error(29.0, 0.0, 5.0) < 0.10 && lobe_error(31.0, 0.0, 5.0) > 0.10);
    // On the axis of a disc of 1 m^2, F = 1 / (1 + pi d^2).
    for distance in [0.3, 3.0] {
        let sphere = PI * distance * distance;
        let expected = (1.0 + sphere) / sphere.max(1.0) - 1.0;
        assert!(form_factor_error(Receives::Parallel, distance, 0.0).is_some_and(|e| (e - expected).abs() < 1e-9));
    }
    assert!(form_factor_error(Receives::Parallel, 0.5, 60.0).is_some_and(|e| e < -0.5));
}

// VALs by rays.

#[test]
fn vals_by_rays_are_the_references() {
    for kind in [SPOT, LightKind::Spot { inner: 1.2, outer: 1.4 }, LightKind::Point, LightKind::Directional] {
        let mut scene = corner(&[kind], 40.0);
        scene.lights[0].range = (kind != LightKind::Directional).then_some(2.3);
        let world = World::new(&scene);
        let all: Vec<_> = triangles(&scene).into_iter().map(|(triangle, _)| triangle).collect();
        let (mut lit, mut elsewhere) = (0, 0);
        for (light, view, n) in views(&world, 60) {
            let twins = rsm::cast_view(&all, light, &view, n);
            for (texel, twin) in cast_view(&world, light, &view, n).into_iter().zip(twins) {
                let val = texel.map_or(Val::NOTHING, |texel| texel.val);
                if val.position.distance(twin.position) > 1e-6 {
                    elsewhere += 1; // a ray along the edge of a triangle
                    continue;
                }
                lit += usize::from(val.flux != DVec3::ZERO);
                assert!(val.normal.distance(twin.normal) < 1e-6, "{kind:?}: {val:?} instead of {twin:?}");
                assert!((val.area - twin.area).abs() <= 1e-6 * twin.area, "{kind:?}: {val:?} instead of {twin:?}");
                assert!(val.flux.distance(twin.flux) <= 1e-6 * twin.flux.length(), "{kind:?}: {val:?}, {twin:?}");
            }
        }
        println!("{kind:?}: {lit} VALs, {elsewhere} elsewhere");
        assert!(lit > 200 && elsewhere * 500 < lit, "{kind:?}");
    }
}

/// A floor of 2 m and a light at a distance of 3 m, which shines straight or obliquely down.
fn floor(kind: LightKind, direction: DVec3) -> Scene {
    let mut scene = Scene { name: "floor".into(), ..Scene::default() };
    let surface = quad(vec3(-1.0, 0.0, -1.0), vec3(0.0, 0.0, 2.0), vec3(2.0, 0.0, 0.0), 0.25);
    add(&mut scene, surface, phong([0.5; 3], [0.2; 3], 30.0), glam::DAffine3::IDENTITY);
    let direction = direction.normalize();
    scene.lights.push(lamp(kind));
    scene.lights[0].position = -3.0 * direction;
    scene.lights[0].direction = direction.as_vec3();
    scene.cameras.push(camera(dvec3(0.5, 1.0, 2.5), DVec3::ZERO, 0.8));
    scene
}

#[test]
fn footprints_tile_the_surface() {
    for (kind, direction) in [
        (LightKind::Directional, dvec3(0.0, -1.0, 0.0)),
        (LightKind::Directional, dvec3(1.5, -1.0, 0.2)),
        (LightKind::Spot { inner: 0.55, outer: 0.6 }, dvec3(0.0, -1.0, 0.0)),
        (LightKind::Spot { inner: 0.55, outer: 0.6 }, dvec3(0.8, -1.0, 0.0)),
    ] {
        let scene = floor(kind, direction);
        let texels = cast(&World::new(&scene), 400);
        let (footprint, square) = texels.iter().fold((0.0, 0.0), |(f, s), t| (f + t.footprint(), s + t.val.area));
        println!("{kind:?} {direction}: {footprint} m^2, perpendicular to the axis {square} m^2");
        // Texels on the floor's edge count fully or not at all. Their size is 1 % of its side.
        assert_near(footprint, 4.0, 0.02, "footprints");
        if direction.x != 0.0 {
            assert!(square < 0.9 * footprint);
        } else {
            assert_near(square, footprint, 1e-6, "a floor perpendicular to the axis");
        }
        let corners = texels[texels.len() / 3].corners();
        assert!(corners.iter().all(|c| c.y.abs() < 1e-9), "corners off the floor: {corners:?}");
    }
}

// The chain.

#[test]
fn the_chain_begins_with_the_devices_picture() {
    let gpu = gpu();
    for kind in [SPOT, LightKind::Point, LightKind::Directional] {
        let scene = corner(&[kind], 30.0);
        let caches = baked(&scene, 0.4, 8);
        let settings = lightskin::lab::knobs::Knobs { rsm: 40, ..small() };
        let shot = shoot(&gpu, &scene, Some(&caches), &settings);
        let stage = Stage::new(World::new(&scene), &scene.cameras[0], &caches, settings.size);
        let texels = cast(&stage.world, settings.rsm);
        let engine = stage.interpolate(&stage.gather(&texels, Exact::default(), false), Level::Vertex);
        for (lobe, picture) in [&shot.diffuse, &shot.glossy].into_iter().enumerate() {
            let total: DVec3 = engine.iter().map(|light| light[lobe]).sum();
            let off: DVec3 =
                stage.pixels.iter().zip(&engine).map(|(p, light)| (light[lobe] - picture[p.index]).abs()).sum();
            let relative = off.element_sum() / total.element_sum();
            println!("{kind:?}, lobe {lobe}: relative error {relative:.1e} over {} pixels", engine.len());
            // f32 rounding moves texels over edges of triangles: about one VAL in some hundred may differ.
            assert!(total.min_element() > 0.0 && relative < 2e-3, "{kind:?}, lobe {lobe}: {relative} off");
        }
    }
}

/// A VAL of 1 m^2 that shines straight down from a height.
fn far_val(height: f64, x: f64) -> Texel {
    let val =
        Val { position: dvec3(x, height, 0.0), area: 1.0, normal: -DVec3::Y, flux: DVec3::splat(height * height) };
    Texel { val, edges: [DVec3::X, DVec3::Z] }
}

/// Largest difference of a lobe over all pixels, relative to the brightest pixel.
fn apart(a: &Lights, b: &Lights, lobe: usize) -> f64 {
    let brightest = b.iter().map(|light| light[lobe].max_element()).fold(0.0, f64::max);
    assert!(brightest > 0.0, "nothing to see");
    a.iter().zip(b).map(|(a, b)| (a[lobe] - b[lobe]).abs().max_element() / brightest).fold(0.0, f64::max)
}

#[test]
fn from_afar_nothing_is_left_to_replace() {
    let at = |normal: DVec3| Receiver {
        position: DVec3::ZERO,
        normal,
        lobe: Some((dvec3(0.1, 1.0, 0.0).normalize(), 30.0)),
    };
    let all = Exact { form_factor: true, lobe: true, footprint: true };
    let each = [Exact { form_factor: true, ..Exact::default() }, Exact { lobe: true, ..Exact::default() }, all];
    for normal in [DVec3::Y, dvec3(0.5, 1.0, 0.3).normalize()] {
        let error = |height: f64, exact: Exact| {
            let [(g, _, lobe), (g0, _, lobe0)] =
                [exact, Exact::default()].map(|e| receive(&far_val(height, 0.3 * height), &at(normal), e));
            ((g * lobe) / (g0 * lobe0) - 1.0).abs()
        };
        for exact in each {
            let [near, far, farther] = [1.0, 20.0, 200.0].map(|height| error(height, exact));
            assert!(near > 0.01, "{exact:?}: {near}");
            assert!(far < 0.02 * near.max(0.5) && farther < 1e-3, "{exact:?}: {near}, {far}, {farther}");
        }
    }
    // Perpendicular to the axis the footprint equals the area, so the footprint alone changes nothing.
    let footprint = Exact { footprint: true, ..Exact::default() };
    let here = far_val(0.3, 0.1);
    assert_eq!(receive(&here, &at(DVec3::Y), footprint), receive(&here, &at(DVec3::Y), Exact::default()));
    let tilted = Texel { edges: [dvec3(2.0, 0.0, 0.0), DVec3::Z], ..here };
    let area = PI * here.val.position.length_squared();
    let ratio = receive(&tilted, &at(DVec3::Y), footprint).0 / receive(&here, &at(DVec3::Y), Exact::default()).0;
    assert_near(ratio, area.max(1.0) / area.max(2.0), 1e-12, "twice the area");
}

#[test]
fn caches_and_proxies_are_exact_where_light_is_even() {
    let scene = floor(SPOT, -DVec3::Y);
    let caches = baked(&scene, 0.4, 8);
    let stage = Stage::new(World::new(&scene), &scene.cameras[0], &caches, [40, 24]);
    let none = Exact::default();
    // A single distant light is the same everywhere, so proxies and interpolation cause no error.
    let one = [far_val(1e4, 0.0)];
    let truth = stage.brute_force(&one, none);
    for level in [Level::Vertex, Level::Pixel] {
        let proxies = stage.gather(&one, none, false);
        assert!(apart(&stage.interpolate(&proxies, level), &truth, 0) < 1e-3);
        assert!(apart(&stage.interpolate_each(&one, level), &truth, 0) < 1e-3);
    }
    // A single nearby light: caches cause errors, its proxy does not.
    let one = [far_val(0.7, 0.2)];
    let truth = stage.brute_force(&one, none);
    let engine = stage.interpolate(&stage.gather(&one, none, false), Level::Pixel);
    let each = stage.interpolate_each(&one, Level::Pixel);
    for lobe in [0, 1] {
        assert!(apart(&each, &engine, lobe) < 1e-5, "one light must equal its proxy, lobe {lobe}");
        assert!(apart(&engine, &truth, lobe) > 0.01, "caches 0.4 m apart below a light at 0.7 m");
    }
    // Two distant lights that are mirrored at different places of the floor. One proxy lies between them, but
    // interpolating all lights keeps their directions.
    let two = [0.27, -0.27].map(|x| {
        let val = Val { position: 1e4 * dvec3(x, 0.36, -0.9), ..far_val(1e4, 0.0).val };
        Texel { val, ..far_val(1e4, 0.0) }
    });
    let truth = stage.brute_force(&two, none);
    let proxies = stage.gather(&two, none, false);
    assert!(apart(&stage.interpolate(&proxies, Level::Pixel), &truth, 1) > 0.02);
    assert!(apart(&stage.interpolate_each(&two, Level::Pixel), &truth, 1) < 1e-3);
}

#[test]
fn shadows_are_no_source_where_nothing_is_in_the_way() {
    let mut scene = corner(&[SPOT], 30.0);
    let with_ball = scene.clone();
    scene.instances.truncate(2);
    let moved = |scene: &Scene| -> f64 {
        let caches = baked(scene, 0.4, 8);
        let stage = Stage::new(World::new(scene), &scene.cameras[0], &caches, [24, 24]);
        let texels = cast(&stage.world, 40);
        let [with, without] = [true, false]
            .map(|shadows| stage.interpolate(&stage.gather(&texels, Exact::default(), shadows), Level::Vertex));
        // A pixel may become brighter if its caches' proxies move, but all pixels together may not.
        let total = |lights: &Lights| lights.iter().map(|light| light[0].element_sum()).sum::<f64>();
        assert!(total(&with) <= total(&without), "shadows brighten");
        apart(&with, &without, 0)
    };
    assert_eq!(moved(&scene), 0.0);
    assert!(moved(&with_ball) > 0.01);
}

#[test]
fn the_steps_add_up_to_the_whole() {
    let mut scene = corner(&[SPOT], 30.0);
    scene.instances.truncate(2);
    let caches = baked(&scene, 0.4, 8);
    let settings = SourcesSettings { size: [24, 16], rsm: 16, samples: 512, bounces: 2 };
    let found = sources(&scene, &scene.cameras[0], &caches, &settings, &|_, _| {});
    assert_eq!((found.tables.len(), found.engine.len()), (2, found.pixels.len()));
    for table in &found.tables {
        println!("{}\n{}", table.lobe, table.markdown());
        let sum = |of: fn(&lightskin::lab::sources::table::Row) -> f64| table.rows.iter().map(of).sum::<f64>();
        assert!((sum(|row| row.change.bias) - table.whole.bias).abs() < 1e-9);
        assert!((sum(|row| row.share) - 1.0).abs() < 1e-9);
        assert!((sum(|row| row.square_share) - 1.0).abs() < 1e-9);
        // Nothing is occluded, so the last step contains only the noise of both pictures.
        let shadows = table.rows.last().expect("rows");
        let noise = table.noise.map(|f| f.rmse);
        assert!(shadows.change.rmse < 2.0 * noise[0].hypot(noise[1]), "{shadows:?}, noise {noise:?}");
        assert!(shadows.change.bias.abs() < 0.01, "{shadows:?}");
        // Of all RSM sizes the finest is closest to the limit.
        let resolution: Vec<f64> =
            table.rows.iter().filter(|r| r.name.starts_with("RSM")).map(|r| r.change.mae).collect();
        assert!(resolution.len() == 3 && resolution[1] < resolution[0], "{resolution:?}");
    }
    let lobe = |row: &str, lobe: usize| {
        found.tables[lobe].rows.iter().find(|r| r.name == row).map(|r| r.change.mae).expect(row)
    };
    assert_eq!(lobe("BRDF constant over the disc", 0), 0.0, "a diffuse BRDF is constant");
    assert!(lobe("BRDF constant over the disc", 1) > 0.0);
}
