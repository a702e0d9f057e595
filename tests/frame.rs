//! Every plan, recorded twice on few pixels: no validation messages, no missing or idle barriers, no invalid values.

use crate::common::frames::{add, phong};
use crate::common::{frame_of, gpu};
use glam::{Affine2, DAffine3, DQuat, DVec3, Vec2, Vec3};
use lightskin::bake::{self, CacheSet, Density};
use lightskin::frame::{
    Antialiasing, ClusterRule, DrawSource, Exposure, Interpolation, LightShadows, ProxyWeight, Shadows, View, World,
};
use lightskin::gpu::Gpu;
use lightskin::image::broken_values;
use lightskin::lab::knobs::{Frame, Gi, Knobs, Path};
use lightskin::scene::build::{CornellSurface, cornell, sphere};
use lightskin::scene::{Camera, Image, Light, LightKind, Projection, Sampler, Scene, Texture};

fn light(kind: LightKind) -> Light {
    let intensity = if kind == LightKind::Directional { 1000.0 } else { 500.0 };
    let (position, direction) = (DVec3::new(0.2, 1.8, 0.5), Vec3::new(-0.5, -0.8, -0.3).normalize());
    Light { name: "test".into(), kind, color: Vec3::ONE, intensity, range: None, radius: 0.0, position, direction }
}

fn caches(scene: &Scene, references: usize) -> CacheSet {
    let settings = bake::BakeSettings { density: Density::Count(60), angle: 1.0, references };
    bake::bake(scene, &settings, &|_, _| {}).expect("bake")
}

/// Records a frame twice and returns the values of its three radiance images.
fn render(gpu: &Gpu, scene: &Scene, caches: Option<&CacheSet>, settings: &Knobs) -> Vec<f32> {
    let world = World::new(gpu, scene, caches).expect("upload");
    let mut frame = Frame::new(gpu, scene, &world, settings).expect("frame");
    let view = View::new(&scene.cameras[0], settings.size, world.origin, world.radius);
    for split in [false, true] {
        let drawn = frame_of(gpu, split, |cmd| {
            frame.record(cmd, &world, &view);
            Ok(())
        });
        let drawn = drawn.expect("frame");
        gpu.times(&drawn).expect("times");
        assert_eq!(drawn.problems, [] as [String; 0], "{settings:?}");
    }
    let indirect = frame.picture.indirect.as_ref();
    let images =
        [Some(&frame.picture.surface.radiance), indirect.map(|i| &i.diffuse), indirect.and_then(|i| i.glossy.as_ref())];
    let texels = images.into_iter().flatten().flat_map(|image| gpu.read_image::<[f32; 4]>(image).expect("read"));
    texels.flat_map(|[r, g, b, _]| [r, g, b]).collect()
}

#[test]
fn every_plan_is_clean() {
    let gpu = gpu();
    let kinds = [
        vec![],
        vec![LightKind::Spot { inner: 0.2, outer: 0.8 }],
        vec![LightKind::Point, LightKind::Directional],
        vec![LightKind::Spot { inner: 0.0, outer: 1.5 }, LightKind::Spot { inner: 0.3, outer: 0.3 }, LightKind::Point],
    ];
    for surface in [CornellSurface::Diffuse, CornellSurface::Glossy] {
        for lights in &kinds {
            for gi in [Gi::LightSkin, Gi::BruteForce, Gi::Off] {
                let maps = LightShadows::Maps(48);
                for (exposure, references, antialiasing, light_shadows) in [
                    (Exposure::Automatic, 8, Antialiasing::Off, maps),
                    (Exposure::Ev(3.0), 16, Antialiasing::Four, maps),
                    (Exposure::Ev(3.0), 16, Antialiasing::Fast, LightShadows::Rays),
                    (Exposure::Automatic, 8, Antialiasing::Four, LightShadows::Rays),
                ] {
                    let mut scene = cornell(surface, 0.5);
                    scene.lights = lights.iter().map(|k| light(*k)).collect();
                    if references == 16 {
                        // A material with an alpha mask uses the other shadow pipeline.
                        scene.materials[0].alpha_cutoff = Some(0.5);
                    }
                    let settings =
                        Knobs { gi, rsm: 16, light_shadows, exposure, antialiasing, ..Knobs::plain([16, 16]) };
                    let caches = (gi == Gi::LightSkin).then(|| caches(&scene, references));
                    let values = render(&gpu, &scene, caches.as_ref(), &settings);
                    assert_eq!(broken_values(&values), 0, "{settings:?}");
                    let lit = values.iter().any(|v| *v > 0.0);
                    assert_eq!(
                        lit,
                        !lights.is_empty(),
                        "lit pixels must exist exactly if there are lights: {settings:?}"
                    );
                }
            }
        }
    }
    assert_eq!(gpu.messages(), [] as [String; 0]);
}

#[test]
fn shadows_bounces_levels_and_ways_go_together() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Glossy, 0.5);
    scene.materials[0].emissive = Vec3::splat(20.0);
    let by_vertices = caches(&scene, 8);
    let by_texels = by_vertices.clone().with_cells(&scene).expect("cells");
    let paths = [
        Path::Compute,
        Path::DRAWS,
        Path::Draws(DrawSource::Storage, 64),
        Path::Clusters(ClusterRule::Distance(6.0)),
        Path::Clusters(ClusterRule::Error(0.05)),
    ];
    let mut count = 0;
    for shadows in [Shadows::Off, Shadows::Proxy, Shadows::PerLight] {
        for bounces in [1, 3] {
            for path in paths {
                let plain = Knobs { rsm: 16, light_shadows: LightShadows::Maps(48), ..Knobs::plain([16, 16]) };
                let settings = Knobs { shadows, bounces, path, ..plain };
                if !settings.go_together() {
                    continue;
                }
                for caches in [&by_vertices, &by_texels] {
                    let kinds = [Antialiasing::Off, Antialiasing::Fast, Antialiasing::Four, Antialiasing::Eight];
                    let antialiasing = kinds[(count + count / 4) % 4]; // both kinds of caches meet all
                    let values = render(&gpu, &scene, Some(caches), &Knobs { antialiasing, ..settings });
                    assert_eq!(broken_values(&values), 0, "{settings:?}");
                    assert!(values.iter().any(|v| *v > 0.0), "{settings:?}");
                    count += 1;
                }
            }
        }
    }
    // Compute supports all three kinds of shadows with one and more bounces. Each other path supports two of them with
    // one bounce.
    assert_eq!(count, 2 * (3 * 2 + 4 * 2));
    assert_eq!(gpu.messages(), [] as [String; 0]);
}

#[test]
fn other_kernels_weights_and_cameras_are_clean() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Glossy, 0.4);
    scene.cameras[0] = Camera {
        name: "parallel".into(),
        world_from_camera: DAffine3::from_translation(DVec3::new(0.0, 1.0, 3.0)),
        projection: Projection::Orthographic { ymag: 1.0 },
    };
    let caches = caches(&scene, 8);
    for interpolation in [Interpolation::Facing, Interpolation::Printed] {
        for proxy_weight in [ProxyWeight::Irradiance, ProxyWeight::FormFactor] {
            let settings = Knobs {
                rsm: 20,
                light_shadows: LightShadows::Maps(64),
                interpolation,
                proxy_weight,
                ..Knobs::plain([24, 16])
            };
            let values = render(&gpu, &scene, Some(&caches), &settings);
            assert_eq!(broken_values(&values), 0, "{settings:?}");
            assert!(values.iter().any(|v| *v > 0.0));
        }
    }
    assert_eq!(gpu.messages(), [] as [String; 0]);
}

#[test]
fn slivers_and_opposed_normals_leave_no_bad_value() {
    let gpu = gpu();
    let mut scene = cornell(CornellSurface::Glossy, 0.4);
    let mesh = &mut scene.meshes[0];
    for (i, vertex) in mesh.vertices.iter_mut().enumerate() {
        match i % 7 {
            0 => vertex.position.x += 1e-7,
            1 => vertex.normal = -vertex.normal,
            2 => vertex.position = Vec3::new(0.3, 0.7, vertex.position.z),
            3 => vertex.normal = Vec3::ZERO,
            _ => vertex.uv0 = Vec2::splat(1e30),
        }
    }
    let caches = caches(&scene, 8);
    for (gi, caches) in [(Gi::LightSkin, Some(&caches)), (Gi::BruteForce, None)] {
        let settings = Knobs { gi, rsm: 32, light_shadows: LightShadows::Maps(64), ..Knobs::plain([64, 64]) };
        assert_eq!(broken_values(&render(&gpu, &scene, caches, &settings)), 0, "{gi:?}");
    }
    assert_eq!(gpu.messages(), [] as [String; 0]);
}

/// Where textured triangles are few, depth is drawn first. A finely divided ball inside a block makes them many and stays
/// hidden.
#[test]
fn depth_drawn_first_changes_no_bit() {
    let size = [96, 64];
    let mut few = cornell(CornellSurface::Glossy, 0.2);
    few.images.push(Image { name: "grey".into(), width: 1, height: 1, rgba: vec![200; 4] });
    let texture = Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler: Sampler::default() };
    few.materials.iter_mut().for_each(|material| material.base_color_texture = Some(texture));
    let mut many = few.clone();
    let place =
        DAffine3::from_scale_rotation_translation(DVec3::splat(0.05), DQuat::IDENTITY, DVec3::new(-0.326, 0.6, -0.256));
    add(&mut many, sphere(1.0, 64), phong([0.5; 3], [0.0; 3], 1.0), place);
    let pixels = (size[0] * size[1]) as usize;
    assert!(few.triangle_count() <= pixels && many.triangle_count() > pixels, "{}", many.triangle_count());
    for antialiasing in [Antialiasing::Off, Antialiasing::Four] {
        let light_shadows = LightShadows::Maps(128);
        let settings = Knobs { gi: Gi::Off, light_shadows, antialiasing, ..Knobs::plain(size) };
        let [first, second] = [&few, &many].map(|scene| render(&gpu(), scene, None, &settings));
        assert!(first.iter().any(|value| *value > 0.0), "the picture is black");
        assert!(first == second, "{antialiasing:?}");
    }
}

#[test]
fn two_renders_are_bit_identical() {
    let antialiasing = Antialiasing::Eight;
    let settings = Knobs { rsm: 32, light_shadows: LightShadows::Maps(128), antialiasing, ..Knobs::plain([48, 32]) };
    let scene = cornell(CornellSurface::Glossy, 0.2);
    let caches = caches(&scene, 8);
    let [one, other] = [(); 2].map(|()| render(&gpu(), &scene, Some(&caches), &settings));
    assert!(one == other, "the same device and scene must give the same bits");
}
