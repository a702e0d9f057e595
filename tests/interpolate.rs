//! Pictures against the f64 references: interpolated indirect light, brute force, and direct light.
//!
//! The references use the device's own VALs, caches, proxies and reflectances, so each picture tests only its own
//! stage. The remaining error is f32 rounding of directions and of pixels' positions, which are computed from depth.

use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};
use lightskin::bake::{CacheSet, NO_CACHE};
use lightskin::frame::{Interpolation, LightShadows};
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::reference::gather::{Cache, Gathered};
use lightskin::reference::interpolate::{Interpolated, Scheme, interpolate, shade};
use lightskin::reference::light::direct_irradiance;
use lightskin::reference::phong::{DIFFUSE_LOBE, Material as Reflection, mirrored_view, phong_lobe};
use lightskin::reference::{brute_force, light};
use lightskin::scene::build::quad;
use lightskin::scene::{LightKind, Scene};

use crate::common::frames::{
    PixelSurface, SPOT, Shot, add, baked, camera, corner, lamp, phong, reflection, seen, shoot, small,
};
use crate::common::gpu;

/// Fraction of pixels whose centre lies on an edge, where the device may see another triangle.
const RIMS: f64 = 0.001;

/// Asserts that a picture is the twins' within `bound`, relative to the radiance plus a hundredth of the brightest
/// pixel. The fraction `RIMS` of pixels may differ.
#[track_caller]
pub(crate) fn assert_picture(picture: &[DVec3], twins: &[(usize, DVec3)], bound: f64, what: &str) {
    let brightest = twins.iter().map(|(_, radiance)| radiance.length()).fold(0.0, f64::max);
    assert!(brightest > 0.0 && twins.len() * 3 > picture.len(), "{what}: nothing to see");
    let off = |&(pixel, radiance): &(usize, DVec3)| {
        let actual = picture[pixel];
        assert!(actual.is_finite() && actual.min_element() >= 0.0, "{what}: pixel {pixel} is {actual}");
        (actual.distance(radiance) / (radiance.length() + 0.01 * brightest), pixel, actual, radiance)
    };
    let mut all: Vec<_> = twins.iter().map(off).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rims = (RIMS * all.len() as f64) as usize;
    let (worst, pixel, actual, radiance) = all[all.len() - 1 - rims];
    let over = all.iter().filter(|a| a.0 > bound).count();
    eprintln!("{what}: error {worst:.2e} without the {rims} worst of {} pixels, {over} above {bound}", all.len());
    assert!(worst <= bound, "{what}: pixel {pixel} is {actual} instead of {radiance}, and {over} pixels like it");
}

/// Reflectances of a pixel from the device's own G-buffer.
fn material(s: &PixelSurface, scene: &Scene, shot: &Shot) -> Reflection {
    let (diffuse, specular) = (shot.albedo[s.pixel], shot.specular[s.pixel]);
    Reflection { diffuse, specular, ..reflection(scene, s.material) }
}

// Stage 1.

#[test]
fn the_g_buffer_keeps_reflectances_as_halves() {
    let gpu = gpu();
    let scene = corner(&[SPOT], 30.0);
    let settings = Knobs { gi: Gi::Off, ..small() };
    let shot = shoot(&gpu, &scene, None, &settings);
    // The last bit of a 16-bit float is 1e-3 of the number, and devices may truncate.
    let twins = |of: fn(&Reflection) -> DVec3| -> Vec<_> {
        seen(&scene, settings.size).iter().map(|s| (s.pixel, of(&reflection(&scene, s.material)))).collect()
    };
    assert_picture(&shot.albedo, &twins(|r| r.diffuse), 1e-3, "albedo");
    assert_picture(&shot.specular, &twins(|r| r.specular), 1e-3, "specular");
}

/// The references take positions and normals from the device, so these are tested alone: against rays.
#[test]
fn the_g_buffer_is_the_surface_that_rays_hit() {
    let gpu = gpu();
    let scene = corner(&[SPOT], 30.0);
    let settings = Knobs { gi: Gi::Off, ..small() };
    let shot = shoot(&gpu, &scene, None, &settings);
    let of =
        |s: &PixelSurface| [shot.positions[s.pixel].distance(s.position), shot.normals[s.pixel].distance(s.normal)];
    let seen = seen(&scene, settings.size);
    for (i, what, bounds) in [(0, "position", [5e-6, 5e-3]), (1, "normal", [1e-5, 0.05])] {
        let mut off: Vec<f64> = seen.iter().map(|s| of(s)[i]).collect();
        off.sort_by(f64::total_cmp);
        let worst = off[off.len() - 1 - (RIMS * off.len() as f64) as usize];
        println!("{what}: off by {worst:.1e} without the rim");
        assert!(worst < bounds[usize::from(shot.subpixels.is_some())], "{what}: {worst}");
    }
}

// Stage 8 (METHOD 5).

/// The references of a vertex, from the scene's own list.
fn references(scene: &Scene, caches: &CacheSet, shot: &Shot, instance: usize, vertex: usize) -> Vec<(Cache, Gathered)> {
    let count = |i: usize| caches.models[caches.instance_model[i]].caches.len();
    let base: usize = (0..instance).map(count).sum();
    let model = &caches.models[caches.instance_model[instance]];
    let each = model.references.len() / scene.meshes[model.mesh].vertices.len();
    let indices = &model.references[vertex * each..(vertex + 1) * each];
    let of = |&index: &u16| (shot.caches[base + usize::from(index)], shot.proxies[base + usize::from(index)]);
    indices.iter().filter(|&&index| index != NO_CACHE).map(of).collect()
}

/// The averaged light of a vertex.
fn at_vertex(
    scene: &Scene,
    references: &[(Cache, Gathered)],
    s: &PixelSurface,
    corner: usize,
    scheme: Scheme,
) -> Interpolated {
    let instance = &scene.instances[s.instance];
    let vertex = scene.meshes[instance.mesh].vertices[s.vertices[corner]];
    let x = instance.world_from_model.transform_point3(vertex.position.as_dvec3());
    let normals = instance.world_from_model.matrix3.inverse().transpose();
    let normal = (normals * vertex.normal.as_dvec3()).normalize();
    let eye = scene.cameras[0].world_from_camera.translation;
    let mut light = interpolate(x, normal, mirrored_view(x, normal, eye), references, scheme);
    if scheme == Scheme::Printed {
        // Flux is interpolated over the triangle. The pixel's own distance converts it to irradiance.
        light.diffuse_irradiance *= light.diffuse_position.distance_squared(x);
        light.glossy_irradiance *= light.glossy_position.distance_squared(x);
    }
    light
}

/// Radiance of both lobes in every pixel, by the references.
fn interpolated(
    scene: &Scene,
    caches: &CacheSet,
    shot: &Shot,
    size: [u32; 2],
    scheme: Scheme,
) -> [Vec<(usize, DVec3)>; 2] {
    let eye = scene.cameras[0].world_from_camera.translation;
    let mut twins = [Vec::new(), Vec::new()];
    for s in seen(scene, size) {
        let lights = [0, 1, 2].map(|corner| {
            let references = references(scene, caches, shot, s.instance, s.vertices[corner]);
            at_vertex(scene, &references, &s, corner, scheme)
        });
        let mean = |of: fn(&Interpolated) -> DVec3| -> DVec3 { (0..3).map(|i| s.weights[i] * of(&lights[i])).sum() };
        let mut light = Interpolated {
            diffuse_position: mean(|l| l.diffuse_position),
            diffuse_irradiance: mean(|l| l.diffuse_irradiance),
            has_diffuse: true,
            glossy_position: mean(|l| l.glossy_position),
            glossy_irradiance: mean(|l| l.glossy_irradiance),
            has_glossy: true,
        };
        if scheme == Scheme::Printed {
            light.diffuse_irradiance /= light.diffuse_position.distance_squared(s.position);
            light.glossy_irradiance /= light.glossy_position.distance_squared(s.position);
        }
        let normal = shot.normals[s.pixel];
        let mirrored = mirrored_view(s.position, normal, eye);
        let shaded = shade(&light, s.position, normal, mirrored, &material(&s, scene, shot));
        twins[0].push((s.pixel, shaded.0));
        twins[1].push((s.pixel, shaded.1));
    }
    twins
}

#[test]
fn interpolated_pictures_are_the_references() {
    let gpu = gpu();
    for k in [1.0, 30.0] {
        // A spot on the wall. The wall's own caches and those on the far side of the ball are unlit.
        let mut scene = corner(&[LightKind::Spot { inner: 0.1, outer: 0.25 }], k);
        scene.lights[0].direction = vec3(-2.0, -0.4, 0.2).normalize();
        for count in [8, 16] {
            let caches = baked(&scene, 0.4, count);
            for (interpolation, scheme) in
                [(Interpolation::Facing, Scheme::Facing), (Interpolation::Printed, Scheme::Printed)]
            {
                let settings = Knobs { interpolation, ..small() };
                let shot = shoot(&gpu, &scene, Some(&caches), &settings);
                let unlit = shot.proxies.iter().filter(|p| !p.diffuse.lit).count();
                assert!(unlit > 20 && unlit < shot.proxies.len() / 2, "{unlit} caches unlit");
                let [diffuse, glossy] = interpolated(&scene, &caches, &shot, settings.size, scheme);
                assert_picture(&shot.diffuse, &diffuse, 1e-4, &format!("diffuse, {scheme:?}, {count}, k {k}"));
                assert_picture(&shot.glossy, &glossy, 1e-4, &format!("glossy, {scheme:?}, {count}, k {k}"));
            }
        }
    }
}

#[test]
fn surfaces_with_fewer_caches_than_references_use_those_they_have() {
    let gpu = gpu();
    let scene = corner(&[SPOT, LightKind::Point], 10.0);
    let caches = baked(&scene, 1.8, 16);
    assert!(caches.models.iter().all(|m| (2..16).contains(&m.caches.len()) && m.references.contains(&NO_CACHE)));
    for (interpolation, scheme) in [(Interpolation::Facing, Scheme::Facing), (Interpolation::Printed, Scheme::Printed)]
    {
        let settings = Knobs { interpolation, ..small() };
        let shot = shoot(&gpu, &scene, Some(&caches), &settings);
        let [diffuse, glossy] = interpolated(&scene, &caches, &shot, settings.size, scheme);
        assert_picture(&shot.diffuse, &diffuse, 1e-4, &format!("few caches, diffuse, {scheme:?}"));
        assert_picture(&shot.glossy, &glossy, 1e-4, &format!("few caches, glossy, {scheme:?}"));
    }
}

#[test]
fn where_all_weights_vanish_the_device_falls_back_like_the_reference() {
    let gpu = gpu();
    // The caches' normals are perpendicular to the surface's, so all kernel weights are zero.
    let scene = corner(&[SPOT], 10.0);
    let mut caches = baked(&scene, 0.6, 8);
    caches.models[0].caches.iter_mut().for_each(|cache| cache.normal = Vec3::NEG_X);
    for (interpolation, scheme) in [(Interpolation::Facing, Scheme::Facing), (Interpolation::Printed, Scheme::Printed)]
    {
        let settings = Knobs { interpolation, ..small() };
        let shot = shoot(&gpu, &scene, Some(&caches), &settings);
        let [diffuse, _] = interpolated(&scene, &caches, &shot, settings.size, scheme);
        assert_picture(&shot.diffuse, &diffuse, 1e-4, &format!("fallback, {scheme:?}"));
    }
}

// Brute force (METHOD 3).

#[test]
fn brute_force_pictures_are_the_references() {
    let gpu = gpu();
    for k in [1.0, 40.0, 500.0] {
        let scene = corner(&[SPOT, LightKind::Point], k);
        let settings = Knobs { gi: Gi::BruteForce, ..small() };
        let shot = shoot(&gpu, &scene, None, &settings);
        let eye = scene.cameras[0].world_from_camera.translation;
        let (mut diffuse, mut glossy) = (Vec::new(), Vec::new());
        for s in seen(&scene, settings.size) {
            let (position, normal) = (shot.positions[s.pixel], shot.normals[s.pixel]);
            let mirrored = mirrored_view(position, normal, eye);
            let material = material(&s, &scene, &shot);
            let twin = brute_force::radiance(position, normal, mirrored, &material, &shot.vals);
            diffuse.push((s.pixel, twin.0));
            glossy.push((s.pixel, twin.1));
        }
        assert_picture(&shot.diffuse, &diffuse, 1e-4, &format!("diffuse by brute force, k {k}"));
        assert_picture(&shot.glossy, &glossy, 1e-4 + 2e-6 * f64::from(k), &format!("glossy by brute force, k {k}"));
    }
}

// Stage 2 (METHOD 1).

/// A tilted floor on its own, where nothing casts a shadow.
fn floor(kind: LightKind) -> Scene {
    let mut scene = Scene::default();
    let tilt = DAffine3::from_rotation_x(0.3);
    add(
        &mut scene,
        quad(vec3(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 1.0),
        phong([0.7, 0.5, 0.3], [0.2; 3], 12.0),
        tilt,
    );
    scene.lights.push(lamp(kind));
    scene.cameras.push(camera(dvec3(0.5, 2.0, 1.5), DVec3::ZERO, 0.5));
    scene
}

#[test]
fn direct_light_is_the_references_in_lux_and_candela() {
    let gpu = gpu();
    let wide = LightKind::Spot { inner: 0.2, outer: 1.3 }; // six views
    for (kind, range) in [
        (SPOT, None),
        (wide, Some(3.0)),
        (LightKind::Point, None),
        (LightKind::Point, Some(2.0)),
        (LightKind::Directional, None),
    ] {
        let mut scene = floor(kind);
        scene.lights[0].range = range;
        let settings = Knobs { gi: Gi::Off, ..small() };
        let shot = shoot(&gpu, &scene, None, &settings);
        let eye = scene.cameras[0].world_from_camera.translation;
        let radiance = |s: &PixelSurface| {
            let m = material(s, &scene, &shot);
            let towards = light::facing_irradiance(&scene.lights[0], s.position).1;
            let lobe = phong_lobe(m.exponent, mirrored_view(s.position, s.normal, eye).dot(towards));
            (m.diffuse * DIFFUSE_LOBE + m.specular * lobe) * direct_irradiance(&scene.lights[0], s.position, s.normal)
        };
        let twins: Vec<_> = seen(&scene, settings.size).iter().map(|s| (s.pixel, radiance(s))).collect();
        assert_picture(&shot.direct, &twins, 1e-4, &format!("direct, {kind:?}, range {range:?}"));
    }
}

#[test]
fn shadows_are_black_and_what_is_lit_is_not_dimmed() {
    let gpu = gpu();
    for kind in [SPOT, LightKind::Point, LightKind::Directional] {
        let mut scene = floor(kind);
        scene.instances[0].world_from_model = DAffine3::IDENTITY;
        // A tile above the floor. Floor points are in its shadow if the line to the light passes through the tile.
        let tile = quad(vec3(-0.3, 0.4, -0.3), Vec3::Z * 0.6, Vec3::X * 0.6, 0.6);
        add(&mut scene, tile, phong([0.5; 3], [0.0; 3], 1.0), DAffine3::IDENTITY);
        // Shadows shrink by a few texels of the map. These are small compared with the 5 cm that the test leaves out.
        let settings = Knobs { gi: Gi::Off, light_shadows: LightShadows::Maps(1536), ..small() };
        let shot = shoot(&gpu, &scene, None, &settings);
        let (mut dark, mut bright) = (0, 0);
        for s in seen(&scene, settings.size).iter().filter(|s| s.instance == 0) {
            let (facing, towards) = light::facing_irradiance(&scene.lights[0], s.position);
            let over = s.position + towards * (0.4 / towards.y);
            let outside = over.x.abs().max(over.z.abs()) - 0.3;
            if facing == DVec3::ZERO || outside.abs() < 0.05 {
                continue;
            }
            if outside < 0.0 {
                assert_eq!(shot.direct[s.pixel], DVec3::ZERO, "{kind:?}: light in the shadow at {}", s.position);
                dark += 1;
            } else {
                let least = DVec3::new(0.7, 0.5, 0.3) * DIFFUSE_LOBE * facing * towards.y * 0.998;
                assert!(shot.direct[s.pixel].cmpge(least).all(), "{kind:?}: shadow in the light at {}", s.position);
                bright += 1;
            }
        }
        assert!(dark > 20 && bright > 200, "{kind:?}: {dark} pixels in the shadow, {bright} in the light");
    }
}
