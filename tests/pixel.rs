//! Where the light of one pixel comes from: its direct light by sources, and the caches that it averages.

use crate::common::frames::{SPOT, Shot, add, baked, camera, corner, drawn_of, phong, seen, shoot, small};
use crate::common::{assert_clean, gpu};
use glam::{DVec3, Vec3, dvec3, vec3};
use lightskin::bake::{CacheSet, NO_CACHE};
use lightskin::frame::pixel::PixelLight;
use lightskin::frame::{Interpolation, LightShadows, View, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Knobs};
use lightskin::reference::gather::Cache;
use lightskin::reference::interpolate::{Scheme, falloff, weights};
use lightskin::scene::build::quad;
use lightskin::scene::{LightKind, Material, Scene};

/// The light of a pixel of a drawn frame.
fn found(gpu: &Gpu, world: &World, frame: &Frame, view: &View, at: [u32; 2]) -> PixelLight {
    let found = PixelLight::find(gpu, (world, &frame.light), (view, &frame.picture), at).expect("found");
    assert_clean(gpu);
    found
}

/// Radiance of the emissive surface [cd/m^2].
const EMITTED: f32 = 1000.0;

/// The direct light of a pixel is the sum over its sources, with shadow maps and with rays, for lamps, suns, soft lights
/// and emissive surfaces. Light behind something counts for nothing.
#[test]
fn direct_light_is_the_sum_of_its_sources() {
    let gpu = gpu();
    let mut soft = corner(&[SPOT, LightKind::Point, LightKind::Directional], 20.0);
    soft.lights[1].radius = 0.2;
    let mut lamp = corner(&[SPOT], 20.0);
    let emissive = Material { emissive: Vec3::splat(EMITTED), ..phong([0.0; 3], [0.0; 3], 1.0) };
    add(&mut lamp, quad(vec3(-0.2, 1.9, 0.2), Vec3::X * 0.5, Vec3::Z * 0.5, 1.0), emissive, Default::default());
    let shadows = [LightShadows::Maps(256), LightShadows::Rays];
    for (name, scene) in [("corner", soft), ("emissive surface", lamp)] {
        for light_shadows in shadows {
            let size = [61, 45];
            let knobs = Knobs { size, light_shadows, ..small() };
            let world = World::new(&gpu, &scene, Some(&baked(&scene, 0.6, 8))).expect("upload");
            let frame = drawn_of(&gpu, &scene, &world, &knobs);
            let view = View::new(&scene.cameras[0], size, world.origin, world.radius);
            let radiance: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.radiance).expect("read");
            let depth: Vec<f32> = gpu.read_image(&frame.picture.surface.depth).expect("read");
            let (mut lit, mut dark, mut worst) = (0, 0, 0.0_f64);
            for at in (0..size[1]).step_by(4).flat_map(|y| (0..size[0]).step_by(5).map(move |x| [x, y])) {
                let pixel = (at[1] * size[0] + at[0]) as usize;
                let lights = found(&gpu, &world, &frame, &view, at).lights;
                assert_eq!(lights.len(), world.lights().len());
                let sum: DVec3 = lights.iter().map(|light| light.as_dvec3()).sum();
                let whole = glam::Vec4::from(radiance[pixel]).truncate().as_dvec3();
                if depth[pixel] > 0.0 && whole != DVec3::splat(f64::from(EMITTED)) {
                    worst = worst.max(sum.distance(whole) / (whole.length() + 1e-2));
                    lit += usize::from(sum.max_element() > 0.0);
                    dark += lights.iter().filter(|light| light.max_element() == 0.0).count();
                } else if depth[pixel] == 0.0 {
                    assert_eq!(sum, DVec3::ZERO, "{at:?}");
                }
            }
            println!("{name}, {light_shadows:?}: {lit} pixels lit, {dark} lights dark, off by {worst:.1e}");
            // GPUs round the positions differently, and with them the texels of shadow maps.
            let most = if gpu.is_software() { 1e-4 } else { 2e-3 };
            assert!(lit > 40 && dark > 3 && worst < most, "{name}, {light_shadows:?}: {lit}, {dark}, {worst}");
        }
    }
}

/// Numbers, from 0, weights and light [lx] of the caches at a visible point, from the scene's own lists.
fn twin(
    scene: &Scene,
    caches: &CacheSet,
    shot: &Shot,
    at: &lightskin::lab::shot::PixelSurface,
    scheme: Scheme,
) -> Vec<(usize, f64, DVec3)> {
    let count = |i: usize| caches.models[caches.instance_model[i]].caches.len();
    let base: usize = (0..at.instance).map(count).sum();
    let instance = &scene.instances[at.instance];
    let mesh = &scene.meshes[instance.mesh];
    let normals = instance.world_from_model.matrix3.inverse().transpose();
    let normal = |i: usize| (normals * mesh.vertices[at.vertices[i]].normal.as_dvec3()).normalize();
    let mut all = vec![(0.0, DVec3::ZERO); shot.caches.len()];
    let mut add = |numbers: &[usize], x: DVec3, normal: DVec3, reach: Option<f64>, share: f64| {
        let caches: Vec<Cache> = numbers.iter().map(|i| shot.caches[*i]).collect();
        let farthest = caches.iter().map(|cache| cache.position.distance(x)).fold(0.0, f64::max);
        let weights = weights(x, normal, &caches, scheme, reach.unwrap_or(farthest));
        for ((number, weight), cache) in numbers.iter().zip(weights).zip(&caches) {
            let lobe = &shot.proxies[*number].diffuse;
            let (there, here) = (lobe.position.distance_squared(cache.position), lobe.position.distance_squared(x));
            let left = match scheme {
                Scheme::Facing => falloff(lobe.distance2, there, here),
                Scheme::Printed => there / here,
            };
            all[*number].0 += share * weight;
            if lobe.lit {
                all[*number].1 += share * weight * left * lobe.facing_irradiance;
            }
        }
    };
    if let Some(cells) = &caches.cells {
        let mean = (0..3).map(|i| at.weights[i] * normal(i)).sum::<DVec3>().normalize();
        let near = |i: &usize| {
            let cache = &shot.caches[*i];
            cache.position.distance(at.position) < cells.reach && cache.normal.dot(mean) > 0.0
        };
        let own: Vec<usize> = (base..base + count(at.instance)).filter(near).collect();
        add(&own, at.position, mean, Some(cells.reach), 1.0);
    } else {
        let model = &caches.models[caches.instance_model[at.instance]];
        let each = model.references.len() / mesh.vertices.len();
        for i in 0..3 {
            let vertex = at.vertices[i];
            let listed = model.references[vertex * each..][..each].iter().filter(|cache| **cache != NO_CACHE);
            let own: Vec<usize> = listed.map(|cache| base + usize::from(*cache)).collect();
            let x = instance.world_from_model.transform_point3(mesh.vertices[vertex].position.as_dvec3());
            add(&own, x, normal(i), None, at.weights[i]);
        }
    }
    let numbered = all.into_iter().enumerate().map(|(number, (weight, light))| (number, weight, light));
    numbered.filter(|(_, weight, _)| *weight > 0.0).collect()
}

/// A pixel's caches, their weights and their light are the references', at vertices and in cells, by both kernels.
#[test]
fn caches_of_a_pixel_have_the_weights_of_the_references() {
    let gpu = gpu();
    let mut scene = corner(&[LightKind::Spot { inner: 0.1, outer: 0.25 }, SPOT], 10.0);
    scene.cameras[0] = camera(dvec3(0.9, 1.1, 1.3), dvec3(-0.1, 0.5, -0.1), 0.8);
    let by_vertices = baked(&scene, 0.4, 8);
    let by_cells = by_vertices.clone().with_cells(&scene).expect("cells");
    for (name, caches) in [("vertices", by_vertices), ("cells", by_cells)] {
        for (interpolation, scheme) in
            [(Interpolation::Facing, Scheme::Facing), (Interpolation::Printed, Scheme::Printed)]
        {
            let knobs = Knobs { interpolation, ..small() };
            let shot = shoot(&gpu, &scene, Some(&caches), &knobs);
            let world = World::new(&gpu, &scene, Some(&caches)).expect("upload");
            let frame = drawn_of(&gpu, &scene, &world, &knobs);
            let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
            let (mut worst, mut off, mut listed, mut pixels) = (0.0_f64, 0.0_f64, 0, 0);
            for s in seen(&scene, knobs.size).iter().step_by(37) {
                let at = [s.pixel as u32 % knobs.size[0], s.pixel as u32 / knobs.size[0]];
                let caches_here = found(&gpu, &world, &frame, &view, at).caches;
                let sum: f32 = caches_here.iter().map(|cache| cache.weight).sum();
                let twin = twin(&scene, &caches, &shot, s, scheme);
                if twin.is_empty() {
                    continue;
                }
                assert!((sum - 1.0).abs() < 1e-5, "{name}: the weights of {at:?} sum to {sum}");
                assert!(caches_here.is_sorted_by(|a, b| a.weight >= b.weight), "heaviest first");
                let all: DVec3 = twin.iter().map(|(.., light)| *light).sum();
                for (number, weight, light) in &twin {
                    let own = caches_here.iter().find(|cache| cache.number as usize == number + 1);
                    let is = own.map_or(0.0, |cache| f64::from(cache.weight));
                    worst = worst.max((is - weight).abs());
                    if let Some(own) = own {
                        let cache = &shot.caches[*number];
                        assert!(own.position.as_dvec3().distance(cache.position - world.origin) < 1e-5 * world.radius);
                        off = off.max(own.irradiance.as_dvec3().distance(*light) / (all.length() + 1e-3));
                    }
                }
                (listed, pixels) = (listed + caches_here.len(), pixels + 1);
            }
            println!(
                "{name}, {scheme:?}: {listed} caches of {pixels} pixels, weights off by {worst:.1e}, light by {off:.1e}"
            );
            let is_right = worst < 1e-5 && off < 1e-4;
            assert!(pixels > 20 && listed > 3 * pixels && is_right, "{name}, {scheme:?}: {worst}, {off}");
        }
    }
}
