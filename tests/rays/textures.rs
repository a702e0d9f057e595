//! Materials at hits: textures in one buffer, at reduced size.

use super::{Asked, NOTHING, Ray, Tracer, random_rays, still};
use crate::analytic::numbers;
use crate::common::data;
use crate::common::frames::add;
use glam::{Affine2, DAffine3, DVec3, Vec2, Vec3, Vec4, dvec3, vec3};
use lightskin::reference::world::{self, Sides};
use lightskin::scene::build::quad;
use lightskin::scene::{Image, Material, Sampler, Scene, Texture, Wrap, gltf};
use std::collections::BTreeMap;

/// An image of noise.
fn noise(seed: u64, width: u32, height: u32) -> Image {
    let mut next = numbers(seed);
    let rgba = (0..4 * width * height).map(|_| (256.0 * next()) as u8).collect();
    Image { name: format!("noise {seed}"), width, height, rgba }
}

/// A row of squares of 1 m, one per material. Texture coordinates run from -1 to 2.
fn squares(materials: impl IntoIterator<Item = Material>, images: Vec<Image>) -> Scene {
    let mut scene = Scene { name: "squares".into(), images, ..Scene::default() };
    for (i, material) in materials.into_iter().enumerate() {
        let mut surface = quad(Vec3::ZERO, Vec3::X, Vec3::Y, 0.3);
        for v in &mut surface.vertices {
            v.uv0 = 3.0 * Vec2::new(v.position.x, v.position.y) - 1.0;
            v.uv1 = 2.0 * Vec2::new(v.position.y, v.position.x) - 0.5;
            v.color = [255, 200, 150, 255];
        }
        add(&mut scene, surface, material, DAffine3::from_translation(dvec3(i as f64, 0.0, 0.0)));
    }
    scene
}

fn textured(image: usize, uv_set: u8, transform: Affine2, wrap_u: Wrap, wrap_v: Wrap) -> Texture {
    Texture { image, uv_set, transform, sampler: Sampler { wrap_u, wrap_v, nearest: false } }
}

fn plain() -> Material {
    Material { metallic: 0.0, base_color: Vec4::new(0.9, 0.8, 1.0, 1.0), ..Material::default() }
}

/// Perpendicular rays, evenly spaced over the squares.
fn at_squares(tracer: &Tracer, count: usize) -> Vec<Ray> {
    let mut rays = Vec::new();
    for (i, y, x) in (0..count).flat_map(|i| (0..60).flat_map(move |y| (0..60).map(move |x| (i, y, x)))) {
        let at = |k: i32| (f64::from(k) + 0.37) / 60.0;
        let point = dvec3(i as f64 + at(x), at(y), 1.0) - tracer.world.origin;
        rays.push(Ray::new(point.as_vec3(), Vec3::NEG_Z));
    }
    rays
}

/// Errors of rho_d for one material: sums of exact values, errors and absolute errors; largest error; number of hits.
#[derive(Clone, Copy, Debug, Default)]
struct Error {
    sum: DVec3,
    off: DVec3,
    size: f64,
    worst: f64,
    hits: usize,
}

impl Error {
    /// Mean absolute error and bias, relative to the mean.
    fn relative(&self) -> [f64; 2] {
        let whole = self.sum.length();
        [self.size / whole, self.off.length() / whole]
    }
}

fn errors(tracer: &Tracer, scene: &Scene, rays: &[Ray]) -> BTreeMap<usize, Error> {
    let (frozen, _) = still(scene);
    let truth = world::World::new(&frozen);
    let found = tracer.trace(rays, Asked::default());
    let mut errors: BTreeMap<usize, Error> = BTreeMap::new();
    for (ray, met) in rays.iter().zip(&found).filter(|(_, met)| met.triangle != NOTHING) {
        let origin = tracer.world.origin + ray.origin.as_dvec3();
        let Some(hit) = truth.nearest(origin, ray.direction.as_dvec3(), Sides::Both) else { continue };
        if hit.material != met.material as usize {
            continue;
        }
        let exact = truth.surface(&hit).reflection.sent_on().as_dvec3();
        let off = met.diffuse.as_dvec3() - exact;
        let error = errors.entry(hit.material).or_default();
        error.sum += exact;
        error.off += off;
        error.size += off.length();
        error.worst = error.worst.max(off.abs().max_element());
        error.hits += 1;
    }
    errors
}

#[test]
fn small_textures_are_the_f64_tracers() {
    let turned = Affine2::from_scale_angle_translation(Vec2::new(0.7, 1.6), 0.4, Vec2::new(0.3, -0.2));
    let kinds = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
    let both = kinds.into_iter().flat_map(|u| kinds.map(|v| (u, v)));
    let mut materials: Vec<Material> = both
        .enumerate()
        .map(|(i, (u, v))| {
            let place = if i % 2 == 0 { Affine2::IDENTITY } else { turned };
            Material { base_color_texture: Some(textured(0, (i % 2) as u8, place, u, v)), ..plain() }
        })
        .collect();
    let repeated = |image| Some(textured(image, 0, Affine2::IDENTITY, Wrap::Repeat, Wrap::Repeat));
    let mut squared = textured(0, 0, turned, Wrap::Repeat, Wrap::Clamp);
    squared.sampler.nearest = true;
    materials.push(Material { base_color_texture: Some(squared), ..plain() });
    // Each texture that rho_d depends on.
    materials.push(Material { metallic: 0.8, metallic_roughness_texture: repeated(1), ..plain() });
    let shiny = Material { ior: 6.0, specular: 0.9, specular_color: vec3(1.0, 0.9, 0.5), ..plain() };
    materials.push(Material { specular_texture: repeated(1), ..shiny.clone() });
    materials.push(Material { specular_color_texture: repeated(0), ..shiny });
    let count = materials.len();
    let scene = squares(materials, vec![noise(1, 37, 23), noise(2, 64, 8)]);
    let tracer = Tracer::new(&scene);
    let rays = at_squares(&tracer, count);
    let errors = errors(&tracer, &scene, &rays);
    assert_eq!(errors.len(), count);
    for (material, error) in &errors {
        let [mean, bias] = error.relative();
        println!(
            "{material}: mean error {mean:.5}, bias {bias:.5}, largest error {:.5}, {} hits",
            error.worst, error.hits
        );
        // Texels are square roots in 8 bits: half a step of v is sqrt(v) / 255. On the border between unfiltered texels
        // either one may be seen.
        let square = scene.materials[*material].base_color_texture.is_some_and(|t| t.sampler.nearest);
        assert!(error.hits > 3000 && mean < 0.005 && bias < 2e-3, "{material}: {error:?}");
        assert!(error.worst < 0.0055 || square, "{material}: {error:?}");
    }
}

/// Devices run several rays together. What one of them finds must not depend on the others.
#[test]
fn hits_do_not_depend_on_the_rays_beside_them() {
    let repeated = |image| Some(textured(image, 0, Affine2::IDENTITY, Wrap::Repeat, Wrap::Mirror));
    let materials = [0, 1, 2].map(|image| Material { base_color_texture: repeated(image), ..plain() });
    let count = materials.len();
    let scene = squares(materials, vec![noise(1, 256, 128), noise(2, 64, 256), noise(3, 16, 16)]);
    let tracer = Tracer::new(&scene);
    let mut next = numbers(5);
    let rays = (0..4096).map(|_| {
        let point = dvec3(count as f64 * next(), next(), 0.01 + 4.0 * next() * next()) - tracer.world.origin;
        let way = dvec3(next() - 0.5, next() - 0.5, -0.5);
        Ray::new(point.as_vec3(), way.normalize().as_vec3())
    });
    let rays: Vec<Ray> = rays.collect();
    let place = |i: usize| i * 1237 % rays.len();
    let shuffled: Vec<Ray> = (0..rays.len()).map(|i| rays[place(i)]).collect();
    for spread in [0.0, 0.02, 0.2] {
        let asked = Asked { spread, more: 4, ..Asked::default() };
        let (found, again) = (tracer.trace(&rays, asked), tracer.trace(&shuffled, asked));
        let hits = found.iter().filter(|met| met.direct != Vec3::ZERO).count();
        let differs = |i: &usize| {
            let (one, other) = (&found[place(*i)], &again[*i]);
            (one.diffuse, one.direct) != (other.diffuse, other.direct)
        };
        let differ = (0..rays.len()).filter(differs).count();
        println!("{differ} of {hits} hits at spread {spread} differ");
        assert!(differ == 0 && hits > 1000);
    }
}

#[test]
fn holes_are_where_the_f64_tracer_has_them() {
    let repeated = |image| Some(textured(image, 0, Affine2::IDENTITY, Wrap::Repeat, Wrap::Mirror));
    let cut = |image| Material { base_color_texture: repeated(image), alpha_cutoff: Some(0.45), ..plain() };
    // The second image exceeds the size to which textures without holes are reduced.
    let scene = squares([cut(0), cut(1)], vec![noise(4, 40, 60), noise(5, 600, 410)]);
    let tracer = Tracer::new(&scene);
    let rays = at_squares(&tracer, 2);
    let found = tracer.trace(&rays, Asked::default());
    let truth = world::World::new(&scene);
    let is_hole = |ray: &Ray| {
        let origin = tracer.world.origin + ray.origin.as_dvec3();
        truth.nearest(origin, ray.direction.as_dvec3(), Sides::Both).is_none()
    };
    for (square, all) in rays.chunks(rays.len() / 2).zip(found.chunks(rays.len() / 2)).enumerate() {
        let pairs = all.0.iter().map(is_hole).zip(all.1.iter().map(|met| met.triangle == NOTHING));
        let holes = pairs.clone().filter(|pair| pair.0).count();
        let differ = pairs.filter(|pair| pair.0 != pair.1).count();
        println!("square {square}: {holes} holes of {} rays, {differ} differ", all.0.len());
        assert!(
            holes > 500 && holes + 500 < all.0.len() && differ <= 2,
            "square {square}: {holes} holes, {differ} differ"
        );
    }
}

#[test]
fn wide_rays_see_textures_mean() {
    let texture = textured(0, 0, Affine2::IDENTITY, Wrap::Repeat, Wrap::Repeat);
    let scene = squares([Material { base_color_texture: Some(texture), ..plain() }], vec![noise(3, 64, 64)]);
    let tracer = Tracer::new(&scene);
    let rays = at_squares(&tracer, 1);
    let deviation = |spread: f32| {
        let found = tracer.trace(&rays, Asked { spread, ..Asked::default() });
        let mean = found.iter().map(|met| met.diffuse.as_dvec3()).sum::<DVec3>() / found.len() as f64;
        let of = |met: &super::Met| (met.diffuse.as_dvec3() - mean).length_squared();
        (mean, (found.iter().map(of).sum::<f64>() / found.len() as f64).sqrt())
    };
    // A texel is 1/192 of the square. Rays are 1 m long.
    let widths = [0.0, 2.2 / 192.0, 9.0 / 192.0, 36.0 / 192.0, 10.0];
    let all = widths.map(deviation);
    println!("{all:?}");
    for pair in all.windows(2) {
        assert!(pair[1].1 < 0.8 * pair[0].1, "{all:?}");
        assert!(pair[1].0.distance(all[0].0) < 0.03 * all[0].0.length(), "{all:?}");
    }
    assert!(all[4].1 < 1e-3, "{all:?}");
}

#[test]
fn large_textures_lose_detail_but_no_light() {
    let Some(data) = data() else { return };
    let scene = gltf::load(&data.join("scenes/sponza/Sponza.gltf")).expect("Sponza");
    let tracer = Tracer::new(&scene);
    let errors = errors(&tracer, &scene, &random_rays(&tracer, &scene, 100_000));
    let mut judged = 0;
    for (material, error) in &errors {
        let texture = scene.materials[*material].base_color_texture;
        let size = texture.map(|t| [scene.images[t.image].width, scene.images[t.image].height]);
        let [mean, bias] = error.relative();
        let name = &scene.materials[*material].name;
        println!("{name} {size:?}: {} hits, mean error {mean:.4}, bias {bias:.4}", error.hits);
        if error.hits >= 300 {
            judged += 1;
            assert!(bias < 0.03, "{name}: {error:?}");
        }
    }
    assert!(judged >= 8, "only {judged} materials have enough hits");
}
