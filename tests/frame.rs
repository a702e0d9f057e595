//! Every plan, recorded twice on few pixels: no validation message, no missing barrier, no idle one, no bad value.

use glam::{DAffine3, DVec3, Vec2, Vec3};
use lightskin::bake::{self, CacheSet, Density};
use lightskin::frame::{ClusterRule, Exposure, Interpolation, ProxyWeight, Shadows, View, World};
use lightskin::gpu::{Gpu, Options, Validation};
use lightskin::image::broken_values;
use lightskin::lab::knobs::{Frame, Gi, Knobs, Path};
use lightskin::scene::build::{CornellSurface, cornell};
use lightskin::scene::{Camera, Light, LightKind, Projection, Scene};

/// A device under both kinds of validation.
fn open() -> Gpu {
    Gpu::new(&Options { device: None, validation: Validation::Sync }).expect("a Vulkan device and the validation layer")
}

fn light(kind: LightKind) -> Light {
    let intensity = if kind == LightKind::Directional { 1000.0 } else { 500.0 };
    let (position, direction) = (DVec3::new(0.2, 1.8, 0.5), Vec3::new(-0.5, -0.8, -0.3).normalize());
    Light { name: "test".into(), kind, color: Vec3::ONE, intensity, range: None, position, direction }
}

fn caches(scene: &Scene, references: usize) -> CacheSet {
    let settings = bake::Settings { density: Density::Count(60), angle: 1.0, references };
    bake::bake(scene, &settings, &|_, _| {}).expect("bake")
}

/// Records a frame twice and gives the values of its three radiance images.
fn render(gpu: &Gpu, scene: &Scene, settings: &Knobs) -> Vec<f32> {
    let mut caches = (settings.gi == Gi::LightSkin).then(|| caches(scene, settings.references));
    if settings.level == Level::Texel {
        caches = caches.map(|caches| caches.with_cells(scene).expect("cells"));
    }
    let mut buffers = World::new(gpu, scene, caches.as_ref()).expect("upload");
    if let Some(caches) = caches.as_ref().filter(|_| settings.bounces > 1) {
        buffers.add_albedos(gpu, scene, caches).expect("albedos");
    }
    let frame = Frame::new(gpu, scene, &buffers, settings).expect("frame");
    let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
    for split in [false, true] {
        let drawn = gpu.frame(split, |cmd| {
            frame.record(cmd, &buffers, &view);
            Ok(())
        });
        let drawn = drawn.expect("frame");
        gpu.times(&drawn).expect("times");
        assert_eq!(drawn.problems, [] as [String; 0], "{settings:?}");
    }
    let t = &frame.targets;
    let mut values: Vec<f32> = gpu.read_image(&t.direct).expect("direct");
    if let Some(indirect) = &t.indirect {
        values.extend(gpu.read_image::<f32>(&indirect.diffuse).expect("diffuse"));
        if let Some(glossy) = &indirect.glossy {
            values.extend(gpu.read_image::<f32>(glossy).expect("glossy"));
        }
    }
    values
}

#[test]
fn every_plan_is_clean() {
    let gpu = open();
    let kinds = [
        vec![],
        vec![LightKind::Spot { inner: 0.2, outer: 0.8 }],
        vec![LightKind::Point, LightKind::Directional],
        vec![LightKind::Spot { inner: 0.0, outer: 1.5 }, LightKind::Spot { inner: 0.3, outer: 0.3 }, LightKind::Point],
    ];
    for surface in [CornellSurface::Diffuse, CornellSurface::Glossy] {
        for lights in &kinds {
            for gi in [Gi::LightSkin, Gi::BruteForce, Gi::Off] {
                for (exposure, references) in [(Exposure::Automatic, 8), (Exposure::Ev(3.0), 16)] {
                    let mut scene = cornell(surface, 0.5);
                    scene.lights = lights.iter().map(|k| light(*k)).collect();
                    if references == 16 {
                        // A holed material takes the other shadow pipeline.
                        scene.materials[0].alpha_cutoff = Some(0.5);
                    }
                    let settings =
                        Knobs { size: [16, 16], gi, references, rsm: 16, shadow_map: 48, exposure, ..Knobs::default() };
                    let values = render(&gpu, &scene, &settings);
                    assert_eq!(broken_values(&values), 0, "{settings:?}");
                    let lit = values.iter().any(|v| *v > 0.0);
                    assert_eq!(lit, !lights.is_empty(), "light and dark differ: {settings:?}");
                }
            }
        }
    }
    assert_eq!(gpu.messages(), [] as [String; 0]);
}

#[test]
fn shadows_bounces_levels_and_ways_go_together() {
    let gpu = open();
    let mut scene = cornell(CornellSurface::Glossy, 0.5);
    scene.materials[0].emissive = Vec3::splat(20.0);
    let mut count = 0;
    for shadows in [Shadows::Off, Shadows::Proxy, Shadows::PerLight] {
        for bounces in [1, 3] {
            for level in [Level::Vertex, Level::Texel] {
                for path in [Path::DRAWS, Path::Compute] {
                    for cluster in [None, Some(ClusterRule::Distance(6.0))] {
                        let by_compute = bounces > 1 || shadows == Shadows::PerLight;
                        let refused = (path == Path::DRAWS && (by_compute || cluster.is_some()))
                            || (by_compute && cluster.is_some());
                        if refused {
                            continue;
                        }
                        let gather = GatherSettings { path, ..GatherSettings::default() };
                        let (size, rsm, shadow_map) = ([16, 16], 16, 48);
                        let settings = Knobs {
                            size,
                            rsm,
                            shadow_map,
                            gather,
                            shadows,
                            bounces,
                            level,
                            cluster,
                            ..Knobs::default()
                        };
                        let values = render(&gpu, &scene, &settings);
                        assert_eq!(broken_values(&values), 0, "{settings:?}");
                        assert!(values.iter().any(|v| *v > 0.0), "{settings:?}");
                        count += 1;
                    }
                }
            }
        }
    }
    assert_eq!(count, 20);
    assert_eq!(gpu.messages(), [] as [String; 0]);
}

#[test]
fn other_kernels_weights_and_cameras_are_clean() {
    let gpu = open();
    let mut scene = cornell(CornellSurface::Glossy, 0.4);
    scene.cameras[0] = Camera {
        name: "parallel".into(),
        world_from_camera: DAffine3::from_translation(DVec3::new(0.0, 1.0, 3.0)),
        projection: Projection::Orthographic { ymag: 1.0 },
    };
    for interpolation in [Interpolation::Facing, Interpolation::Printed] {
        for proxy_weight in [ProxyWeight::Irradiance, ProxyWeight::FormFactor] {
            let settings =
                Knobs { size: [24, 16], rsm: 20, shadow_map: 64, interpolation, proxy_weight, ..Knobs::default() };
            let values = render(&gpu, &scene, &settings);
            assert_eq!(broken_values(&values), 0, "{settings:?}");
            assert!(values.iter().any(|v| *v > 0.0));
        }
    }
    assert_eq!(gpu.messages(), [] as [String; 0]);
}

#[test]
fn slivers_and_opposed_normals_leave_no_bad_value() {
    let gpu = open();
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
    for gi in [Gi::LightSkin, Gi::BruteForce] {
        let settings = Knobs { size: [64, 64], gi, rsm: 32, shadow_map: 64, ..Knobs::default() };
        assert_eq!(broken_values(&render(&gpu, &scene, &settings)), 0, "{gi:?}");
    }
    assert_eq!(gpu.messages(), [] as [String; 0]);
}

#[test]
fn two_renders_are_bit_identical() {
    let settings = Knobs { size: [48, 32], rsm: 32, shadow_map: 128, ..Knobs::default() };
    let scene = cornell(CornellSurface::Glossy, 0.2);
    let [one, other] = [(); 2].map(|()| render(&open(), &scene, &settings));
    assert!(one == other, "the same device and scene give the same bits");
}
