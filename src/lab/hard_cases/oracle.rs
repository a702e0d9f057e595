//! Expectations for frames: other frames, and the f64 references on the frame's own VALs and reflectances.

use crate::lab::shot::{PixelSurface, Shot, reflection, seen, small, triangles};
use crate::reference::brute_force;
use crate::reference::form_factor;
use crate::reference::gather::val_geometry;
use crate::reference::phong::{Material, cos_power, mirrored_view};
use crate::reference::rsm::{Val, cast_view};
use crate::scene::Scene;
use glam::DVec3;
use rayon::prelude::*;

/// Pixels left out of a comparison: rounding decides where the rim of a shadow or a surface crosses a sample.
pub(super) const RIMS: usize = 4;

/// Largest difference between two images, where `b` should be `factor` times `a`. It is relative to the brightness plus
/// a hundredth of the image's mean, which limits the weight of dark pixels. The worst four pixels are left out.
/// Infinite if a value is not finite, 0 for two black images.
pub fn difference(a: &[DVec3], b: &[DVec3], factor: f64) -> f64 {
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    let mean = a.iter().map(|p| p.length()).sum::<f64>() / a.len().max(1) as f64;
    let off = |(a, b): (&DVec3, &DVec3)| {
        let apart = (*b / factor - *a).length();
        let error = if apart == 0.0 { 0.0 } else { apart / (a.length() + 0.01 * mean) };
        if error.is_finite() { error } else { f64::INFINITY }
    };
    let mut all: Vec<f64> = a.iter().zip(b).map(off).collect();
    all.sort_by(f64::total_cmp);
    all.len().checked_sub(1 + RIMS).map_or(0.0, |i| all[i])
}

/// Largest difference over the three layers.
pub(super) fn layers(a: &Shot, b: &Shot, factor: f64) -> f64 {
    let of = |layer: fn(&Shot) -> &[DVec3]| difference(layer(a), layer(b), factor);
    of(|s| &s.direct).max(of(|s| &s.diffuse)).max(of(|s| &s.glossy))
}

/// Reflectance of a pixel from the device's G-buffer, which stores half floats.
pub(super) fn material(s: &PixelSurface, scene: &Scene, shot: &Shot) -> Material {
    let (diffuse, specular) = (shot.albedo[s.pixel], shot.specular[s.pixel]);
    Material { diffuse, specular, ..reflection(scene, s.material) }
}

/// Difference of a brute-force frame's diffuse and glossy layer from f64 brute force at the surface that the device has
/// at each pixel. Rasterisers move surfaces by up to a step of their grid.
pub(super) fn brute_force_picture(scene: &Scene, shot: &Shot) -> [f64; 2] {
    brute_force_picture_near(scene, shot, 0.0)
}

/// The same if positions are known only within `apart` \[m\] along each axis: compares with the nearest radiance in
/// that range.
pub(super) fn brute_force_picture_near(scene: &Scene, shot: &Shot, apart: f64) -> [f64; 2] {
    let eye = scene.cameras[0].world_from_camera.translation;
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let places = [DVec3::ZERO, x, -x, y, -y, z, -z];
    let at = |s: &PixelSurface| {
        let radiance = |place: &DVec3| {
            let (position, normal) = (shot.positions[s.pixel] + apart * *place, shot.normals[s.pixel]);
            let mirrored = mirrored_view(position, normal, eye);
            let (diffuse, glossy) =
                brute_force::radiance(position, normal, mirrored, &material(s, scene, shot), &shot.vals);
            [diffuse, glossy]
        };
        let all: Vec<_> = places[..if apart > 0.0 { 7 } else { 1 }].iter().map(radiance).collect();
        let found = [&shot.diffuse, &shot.glossy].map(|layer| layer.get(s.pixel).copied().unwrap_or_default());
        let nearest = |lobe: usize| {
            let (low, high) =
                all.iter().fold((all[0][lobe], all[0][lobe]), |(l, h), r| (l.min(r[lobe]), h.max(r[lobe])));
            found[lobe].clamp(low, high)
        };
        [(nearest(0), found[0]), (nearest(1), found[1])]
    };
    let pixels: Vec<_> = seen(scene, small().size).par_iter().map(at).collect();
    [0, 1].map(|lobe| {
        let (twins, found): (Vec<_>, Vec<_>) = pixels.iter().map(|p| p[lobe]).unzip();
        difference(&twins, &found, 1.0)
    })
}

/// Largest error of the gather's irradiance sums against f64, relative to the sum; diffuse and glossy. Sums below 1e-9
/// of the light with all VALs facing the cache are rounding errors of cosines near 0, or of `cos^k`.
pub(super) fn sums_against_twins(scene: &Scene, shot: &Shot) -> [f64; 2] {
    let eye = scene.cameras[0].world_from_camera.translation;
    let at = |i: usize| {
        let cache = &shot.caches[i];
        let mirrored = mirrored_view(cache.position, cache.normal, eye);
        let (mut all, mut lobe, mut facing) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for val in &shot.vals {
            let (geometry, direction) = val_geometry(cache.position, cache.normal, val);
            all += val.flux * geometry;
            lobe += val.flux * (geometry * cos_power(cache.exponent, mirrored.dot(direction)));
            facing += val.flux.length()
                * form_factor::val_geometry(val.area, 1.0, 1.0, val.position.distance_squared(cache.position));
        }
        let error = |sum: Option<&DVec3>, twin: DVec3| match sum {
            Some(sum) if *sum != twin => sum.distance(twin) / twin.length().max(1e-9 * facing),
            _ => 0.0,
        };
        [error(shot.sums[0].get(i), all), error(shot.sums[1].get(i), lobe)]
    };
    let worst = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].max(b[1])];
    (0..shot.caches.len()).into_par_iter().map(at).reduce(|| [0.0; 2], worst)
}

/// VALs of the first light against f64 rays through the same texels: share of texels that hit another place; for the
/// others the largest distance between normals, and the largest difference of flux relative to the brightest.
pub(super) fn cast_vals(scene: &Scene, shot: &Shot) -> [f64; 3] {
    let triangles: Vec<_> = triangles(scene).into_iter().map(|(triangle, _)| triangle).collect();
    let n = (shot.vals.len() / shot.views.len()).isqrt();
    // The device's rows start at the top.
    let rows = |vals: Vec<Val>| vals.chunks(n).rev().flatten().copied().collect::<Vec<_>>();
    let cast = |view| rows(cast_view(&triangles, &scene.lights[0], view, n));
    let twins: Vec<Val> = shot.views.iter().flat_map(cast).collect();
    let brightest = twins.iter().map(|val| val.flux.length()).fold(0.0, f64::max);
    let (mut elsewhere, mut turned, mut brighter) = (0, 0.0_f64, 0.0_f64);
    for (val, twin) in shot.vals.iter().zip(&twins) {
        let moved = val.position.distance(twin.position);
        if moved > shot.most_moved(twin) {
            elsewhere += 1;
            continue;
        }
        // Normals of a ball turn as the place moves.
        turned = turned.max(val.normal.distance(twin.normal) - 4.0 * moved);
        brighter = brighter.max(val.flux.distance(twin.flux) / brightest - moved);
    }
    [f64::from(elsewhere) / twins.len() as f64, turned, brighter]
}

/// Largest vector length.
pub(super) fn largest(layer: &[DVec3]) -> f64 {
    layer.iter().map(|p| p.length()).fold(0.0, f64::max)
}
