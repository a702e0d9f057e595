//! The sun of a sky: it is split off with all of its energy, but bright lamps remain in the sky.

use glam::{DVec2, DVec3, Vec3, dvec3, vec3};
use lightskin::image::read_radiance;
use lightskin::scene::sky::Sky;
use lightskin::scene::{Light, LightKind, Scene, luminance};

use crate::common::data;

/// Direction to the sun in these skies.
const TO_SUN: DVec3 = dvec3(0.6, 0.64, -0.48);

fn sky(width: u32, height: u32, turn: f64, radiance: impl Fn(DVec3) -> Vec3) -> Sky {
    let empty = Sky::new(width, height, (0..width * height).map(|_| Vec3::ZERO), turn);
    let middle = |i: u32| DVec2::new(f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
    Sky::new(width, height, (0..width * height).map(|i| radiance(empty.direction_at(middle(i)))), turn)
}

const BLUE: Vec3 = vec3(1000.0, 2000.0, 4000.0);

fn is_within(direction: DVec3, degrees: f64, of: DVec3) -> bool {
    direction.angle_between(of.normalize()).to_degrees() < degrees
}

/// A disc of this radius [degrees] and radiance in a blue sky over dark ground.
fn sunny(direction: DVec3, to_sun: DVec3, radius: f64, sun: Vec3) -> Vec3 {
    match () {
        () if is_within(direction, radius, to_sun) => sun,
        () if direction.y > 0.0 => BLUE,
        () => Vec3::splat(100.0),
    }
}

fn energy(light: &Light) -> DVec3 {
    light.color.as_dvec3() * f64::from(light.intensity)
}

/// The scene under a sky, its sun, and the remaining sky.
fn under(sky: Sky) -> (Scene, Option<Light>, Sky) {
    let mut scene = Scene::default();
    let whole = sky.illuminance();
    sky.clone().put_over(&mut scene, 4);
    let sun = scene.lights.iter().find(|light| light.name == "sun").cloned();
    let left = scene.sky.clone().expect("a sky");
    let all = left.illuminance() + sun.as_ref().map_or(DVec3::ZERO, energy);
    assert!((all / whole - 1.0).abs().max_element() < 1e-6, "{all} instead of {whole}");
    let stand_ins: DVec3 = scene.lights[left.lights.clone()].iter().map(energy).sum();
    assert!(stand_ins.distance(left.illuminance()) < 1e-6 * whole.length(), "{stand_ins} for {}", left.illuminance());
    assert!(!left.lights.clone().any(|light| scene.lights[light].name == "sun"), "no stand-in may be the sun");
    assert_eq!(scene.behind().expect("a backdrop").texels, sky.texels, "the backdrop must keep the sun");
    assert_eq!(sun.is_some(), left.shown.is_some());
    assert_eq!(scene.notes.len(), usize::from(sun.is_some()));
    (scene, sun, left)
}

#[test]
fn a_sun_becomes_a_light_of_its_energy_beyond_the_sky() {
    let radiance = vec3(4e7, 3e7, 2e7);
    // Suns at the seam, straight up, and in a turned sky are included.
    for (to_sun, turn) in [(TO_SUN, 0.0), (dvec3(0.0, 0.3, 1.0), 0.0), (DVec3::Y, 0.0), (TO_SUN, 2.0)] {
        for radius in [0.3, 1.0, 2.3] {
            let of = |sun: Vec3| sky(1024, 512, turn, |d| sunny(d, to_sun, radius, sun));
            let expected = of(radiance).illuminance() - of(BLUE).illuminance();
            let (_, sun, left) = under(of(radiance));
            let sun = sun.unwrap_or_else(|| panic!("no sun of {radius} degrees at {to_sun}"));
            assert_eq!(sun.kind, LightKind::Directional);
            assert!((energy(&sun) / expected - 1.0).abs().max_element() < 1e-5, "{} of {expected}", energy(&sun));
            let off = (-sun.direction.as_dvec3()).angle_between(to_sun.normalize()).to_degrees();
            assert!(off < 0.1, "{off} degrees off at {to_sun}, radius {radius}");
            assert_eq!(left.texels, of(BLUE).texels, "the remaining sky must be the sky around the sun");
        }
    }
}

#[test]
fn glare_stays_around_the_sun() {
    let glare = |d: DVec3| 3e4 * (-d.angle_between(TO_SUN).to_degrees() / 4.0).exp() as f32;
    let all = |d: DVec3| sunny(d, TO_SUN, 0.5, vec3(4e6, 3e6, 2e6)) + glare(d);
    let (_, sun, left) = under(sky(1024, 512, 0.0, all));
    let without = sky(1024, 512, 0.0, |d| sunny(d, TO_SUN, 0.0, Vec3::ZERO) + glare(d));
    let sun = energy(&sun.expect("a sun"));
    let core = sky(1024, 512, 0.0, all).illuminance() - without.illuminance();
    let widest = left.texels.iter().map(|t| t.x).fold(0.0, f32::max);
    println!("sun {sun}, core {core}, remaining maximum {widest} cd/m^2");
    assert!((sun / core - 1.0).abs().max_element() < 0.1, "{sun} of {core}");
    assert!(widest < 4e4, "{widest}");
}

#[test]
fn one_texel_can_be_a_sun() {
    let mut bright = Sky::even(BLUE);
    let texel = 90 * bright.width as usize + 300;
    bright.texels[texel] = Vec3::splat(1e7);
    let (_, sun, left) = under(bright);
    assert!(sun.is_some());
    assert_eq!(left.texels, Sky::even(BLUE).texels);
    // If nothing else emits light, nothing remains.
    let mut alone = Sky::even(Vec3::ZERO);
    alone.texels[texel] = Vec3::ONE;
    let mut scene = Scene::default();
    alone.put_over(&mut scene, 4);
    assert_eq!(scene.lights.len(), 1);
    assert_eq!(scene.sky.expect("a sky").illuminance(), DVec3::ZERO);
}

#[test]
fn skies_without_a_sun_stay_as_they_are() {
    let sun = |radius: f64, radiance: f32| sky(512, 256, 0.0, |d| sunny(d, TO_SUN, radius, Vec3::splat(radiance)));
    let soft = sky(512, 256, 0.0, |d| BLUE + 1e6 * (-d.angle_between(TO_SUN).to_degrees() / 8.0).exp() as f32);
    for (name, sky) in [
        ("even", Sky::even(BLUE)),
        ("black", Sky::even(Vec3::ZERO)),
        ("blue", sun(0.0, 0.0)),
        ("a lamp of 10 degrees", sun(5.0, 1e6)),
        ("a disc of a moon's light", sun(0.3, 2e4)),
        ("a soft lamp", soft),
        ("studio", Sky::studio(DVec3::Z, true)),
        ("day", Sky::day()),
    ] {
        let before = sky.texels.clone();
        let mut scene = Scene::default();
        sky.put_over(&mut scene, 4);
        let left = scene.sky.expect("a sky");
        assert!(left.shown.is_none() && left.texels == before, "{name}");
        assert!(scene.lights.iter().all(|light| light.name != "sun"), "{name}");
    }
}

#[test]
fn probes_lose_their_suns_alone() {
    let Some(data) = data() else { return };
    for (name, has_sun) in [("venice_sunset_1k.hdr", true), ("studio_small_03_1k.hdr", false)] {
        let picture = read_radiance(&data.join("env").join(name)).expect("a light probe");
        let sky = Sky::new(picture.width, picture.height, picture.rgb.into_iter().map(Vec3::from), 0.0);
        let shades = |sky: &Sky| sky.texels.iter().map(|t| luminance(t.as_dvec3())).fold(0.0, f64::max);
        let (whole, mean) = (luminance(sky.illuminance()), luminance(sky.illuminance()) / (4.0 * std::f64::consts::PI));
        let peak = shades(&sky);
        let (scene, sun, left) = under(sky);
        println!(
            "{name}: {whole:.4} lx, brightest texel {:.0} times the mean, without the sun {:.0} times",
            peak / mean,
            shades(&left) / mean
        );
        scene.notes.iter().for_each(|note| println!("  {note}"));
        assert_eq!(sun.is_some(), has_sun, "{name}");
    }
}
