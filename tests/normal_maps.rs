//! Normal maps tilt in the direction of their texture coordinates: with tangents, without, and on mirrored instances.
//! The G-buffer also stays finite where pixels are smaller than the resolution of f32 positions.

use crate::common::frames::drawn_of;
use crate::common::{assert_clean, gpu};
use glam::{Affine2, DAffine3, DQuat, DVec3, Vec2, Vec3, Vec4};
use lightskin::frame::{Antialiasing, LightShadows, View, World};
use lightskin::image::broken_values;
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::scene::build::sphere;
use lightskin::scene::{
    Camera, Image, Instance, Light, LightKind, Material, Mesh, Primitive, Projection, Sampler, Scene, Texture, Vertex,
};

/// A 2 m quad in the xy plane that faces +z, with a camera and a lamp on the z axis.
fn quad(map: [u8; 3], tangents: bool, scale: DVec3, edge: f32) -> Scene {
    let corner = |x: f32, y: f32| Vertex {
        position: Vec3::new(x, y, 0.0) * edge,
        normal: Vec3::Z,
        tangent: if tangents { [1.0, 0.0, 0.0, 1.0] } else { [0.0; 4] },
        // In glTF v points down, so the bitangent is +y.
        uv0: Vec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y),
        color: [255; 4],
        ..Vertex::default()
    };
    let texture = Texture { image: 0, uv_set: 0, transform: Affine2::IDENTITY, sampler: Sampler::default() };
    Scene {
        name: "quad".into(),
        meshes: vec![Mesh {
            name: "quad".into(),
            vertices: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
            indices: vec![0, 1, 2, 0, 2, 3],
            primitives: vec![Primitive { first_index: 0, index_count: 6, material: 0 }],
            ..Mesh::default()
        }],
        materials: vec![Material { normal_texture: Some(texture), ..Material::default() }],
        images: vec![Image { name: "map".into(), width: 1, height: 1, rgba: vec![map[0], map[1], map[2], 255] }],
        instances: vec![Instance {
            name: "quad".into(),
            mesh: 0,
            world_from_model: DAffine3::from_scale(scale),
            ..Instance::default()
        }],
        lights: vec![Light {
            name: "lamp".into(),
            kind: LightKind::Point,
            color: Vec3::ONE,
            intensity: 100.0,
            range: None,
            radius: 0.0,
            position: DVec3::new(0.0, 0.0, 3.0 * f64::from(edge)),
            direction: Vec3::NEG_Z,
        }],
        cameras: vec![Camera {
            name: "front".into(),
            world_from_camera: DAffine3::from_translation(DVec3::new(0.0, 0.0, 4.0)),
            projection: Projection::Perspective { yfov: 0.5 },
        }],
        ..Scene::default()
    }
}

/// The normal in the centre of the picture, and the direct radiance of all pixels.
fn shoot(scene: &Scene) -> (Vec3, Vec<f32>) {
    let gpu = gpu();
    let settings = Knobs { gi: Gi::Off, light_shadows: LightShadows::Maps(64), ..Knobs::plain([33, 33]) };
    let buffers = World::new(&gpu, scene, None).expect("upload");
    let mut frame = Frame::new(&gpu, scene, &buffers, &settings).expect("frame");
    let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &buffers, &view);
        Ok(())
    });
    gpu.times(&drawn.expect("frame")).expect("times");
    let normals: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.normal).expect("normals");
    let direct = gpu.read_image(&frame.picture.surface.radiance).expect("direct");
    assert_clean(&gpu);
    let [x, y, z, _] = normals[16 * 33 + 16];
    (Vec3::new(x, y, z), direct)
}

#[test]
fn bumps_tilt_along_the_texture_with_and_without_tangents() {
    // 45 degrees towards +u, and 45 degrees towards the bitangent.
    let tilts = [([218, 128, 218], Vec3::X), ([128, 218, 218], Vec3::Y)];
    for (map, along) in tilts {
        for tangents in [true, false] {
            for scale in [DVec3::ONE, DVec3::new(-1.0, 1.0, 1.0)] {
                let (n, _) = shoot(&quad(map, tangents, scale, 1.0));
                let wanted = (along * scale.as_vec3() + Vec3::Z).normalize();
                // Texels of 8 bits represent the tilt within 0.3 degrees.
                assert!(n.dot(wanted) > 0.9999, "map {map:?}, tangents {tangents}, scale {scale}: {n} is not {wanted}");
            }
        }
    }
}

/// Seen from behind, bumps of a double-sided surface are dents: the normal is the front's, negated.
#[test]
fn second_sides_turn_the_whole_frame_round() {
    for (map, along) in [([218, 128, 218], Vec3::X), ([128, 218, 218], Vec3::Y)] {
        for tangent in [[-1.0, 0.0, 0.0, -1.0], Vertex::SECOND_SIDE] {
            for scale in [DVec3::ONE, DVec3::new(-1.0, 1.0, 1.0)] {
                let mut scene = quad(map, false, scale, 1.0);
                for vertex in &mut scene.meshes[0].vertices {
                    vertex.normal = Vec3::NEG_Z;
                    vertex.tangent = tangent;
                }
                scene.meshes[0].indices = vec![0, 2, 1, 0, 3, 2];
                let behind = DAffine3::from_rotation_y(std::f64::consts::PI);
                scene.cameras[0].world_from_camera = behind * scene.cameras[0].world_from_camera;
                let (n, _) = shoot(&scene);
                let wanted = -(along * scale.as_vec3() + Vec3::Z).normalize();
                assert!(n.dot(wanted) > 0.9999, "map {map:?}, tangent {tangent:?}, scale {scale}: {n} is not {wanted}");
            }
        }
    }
}

#[test]
fn pixels_below_float_resolution_stay_finite() {
    let mut scene = quad([128, 128, 255], false, DVec3::ONE, 1000.0);
    // A floor of 2 km, and a camera that sees half a millimetre of it, 900 m from its centre.
    scene.cameras[0].world_from_camera = DAffine3::from_translation(DVec3::new(900.0, 900.0, 0.3));
    scene.cameras[0].projection = Projection::Perspective { yfov: 0.002 };
    let (n, direct) = shoot(&scene);
    assert!((n - Vec3::Z).length() < 1e-3, "{n}");
    assert_eq!(broken_values(&direct), 0);
    assert!(direct.iter().any(|v| *v > 0.0), "the lamp must reach the floor");
}

#[test]
fn near_things_show_in_wide_scenes() {
    let mut scene = quad([128, 128, 255], false, DVec3::ONE, 10_000.0);
    // A second quad of 2 cm, half a metre in front of the camera.
    let small = DAffine3::from_scale_rotation_translation(DVec3::splat(1e-6), DQuat::IDENTITY, DVec3::Z * 3.5);
    scene.instances.push(Instance { name: "near".into(), mesh: 0, world_from_model: small, ..Instance::default() });
    let gpu = gpu();
    let settings = Knobs { gi: Gi::Off, light_shadows: LightShadows::Maps(64), ..Knobs::plain([33, 33]) };
    let buffers = World::new(&gpu, &scene, None).expect("upload");
    let mut frame = Frame::new(&gpu, &scene, &buffers, &settings).expect("frame");
    let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &buffers, &view);
        Ok(())
    });
    gpu.times(&drawn.expect("frame")).expect("times");
    let depth: Vec<f32> = gpu.read_image(&frame.picture.surface.depth).expect("depth");
    // Reversed depth is inversely proportional to distance: 0.5 m against 4 m.
    assert!((depth[16 * 33 + 16] / depth[0] - 8.0).abs() < 0.01, "{} {}", depth[16 * 33 + 16], depth[0]);
    assert_clean(&gpu);
}

#[test]
fn what_exceeds_the_device_is_refused_with_its_name() {
    let gpu = gpu();
    let scene = quad([128, 128, 255], false, DVec3::ONE, 1.0);
    let buffers = World::new(&gpu, &scene, None).expect("upload");
    let settings = Knobs { gi: Gi::Off, light_shadows: LightShadows::Maps(64), ..Knobs::plain([1 << 17, 4]) };
    let error = Frame::new(&gpu, &scene, &buffers, &settings).err().expect("no device has 131 072 texels");
    assert!(error.to_string().contains("gbuffer.depth needs 131072x4"), "{error}");
    let settings =
        Knobs { rsm: 2048, gi: Gi::BruteForce, light_shadows: LightShadows::Maps(64), ..Knobs::plain([4, 4]) };
    if gpu.report().kind == "software" {
        // 6 x 836^2 VALs of 48 bytes need more than the 128 MiB that lavapipe can bind.
        let mut frame = Frame::new(&gpu, &scene, &buffers, &settings).expect("frame");
        let view = View::new(&scene.cameras[0], settings.size, buffers.origin, buffers.radius);
        let drawn = gpu.frame(|cmd| {
            frame.record(cmd, &buffers, &view);
            Ok(())
        });
        let error = drawn.err().expect("the binding is refused").to_string();
        assert!(error.contains("rsm.vals needs"), "{error}");
    }
    assert_clean(&gpu);
}

/// A metal plate and metal balls, lit by a lamp. The plate has bumps that are much finer than pixels.
fn hammered(height: f32) -> Scene {
    let side = 256_u32;
    let texel = |i: u32| {
        // Slopes are sums of random numbers, so they are nearly normally distributed.
        let die = |k: u32| (i * 8 + k).wrapping_mul(0x9e37_79b9).rotate_left(15).wrapping_mul(0x85eb_ca6b) >> 8;
        let three = |k: u32| (k..k + 3).map(|k| die(k) as f32 / 2.0_f32.powi(23) - 1.0).sum::<f32>();
        let n = Vec3::new(height * three(0), height * three(4), 1.0).normalize();
        let code = |c: f32| ((c + 1.0) * 127.5).round() as u8;
        [code(n.x), code(n.y), code(n.z), 255]
    };
    let rgba = (0..side * side).flat_map(texel).collect();
    let mut scene = quad([128, 128, 255], true, DVec3::ONE, 1.0);
    scene.images[0] = Image { name: "hammered".into(), width: side, height: side, rgba };
    let metal =
        Material { base_color: Vec4::new(0.9, 0.8, 0.6, 1.0), metallic: 1.0, roughness: 0.25, ..Material::default() };
    scene.materials = vec![Material { normal_texture: scene.materials[0].normal_texture, ..metal.clone() }, metal];
    let ball = sphere(0.5, 48);
    scene.meshes.push(Mesh {
        name: "ball".into(),
        primitives: vec![Primitive { first_index: 0, index_count: ball.indices.len() as u32, material: 1 }],
        vertices: ball.vertices,
        indices: ball.indices,
        ..Mesh::default()
    });
    for x in [-0.6, 0.6] {
        let place =
            DAffine3::from_scale_rotation_translation(DVec3::splat(0.7), DQuat::IDENTITY, DVec3::new(x, 0.4, 0.5));
        scene.instances.push(Instance { name: "ball".into(), mesh: 1, world_from_model: place, ..Instance::default() });
    }
    scene
}

#[test]
fn bumps_and_bends_finer_than_pixels_make_lobes_wider() {
    let gpu = gpu();
    for height in [0.05, 0.1, 0.2] {
        let scene = hammered(height);
        let world = World::new(&gpu, &scene, None).expect("made");
        let direct = |size: u32, antialiasing| {
            let knobs = Knobs {
                size: [size; 2],
                gi: Gi::Off,
                light_shadows: LightShadows::Rays,
                antialiasing,
                ..Knobs::plain([size; 2])
            };
            let frame = drawn_of(&gpu, &scene, &world, &knobs);
            let texels: Vec<[f32; 4]> = gpu.read_image(&frame.picture.surface.radiance).expect("read");
            texels.iter().map(|t| f64::from(t[1])).collect::<Vec<_>>()
        };
        let size = 24_usize;
        let fine = direct(32 * size as u32, Antialiasing::Off);
        let mean = |i: usize| {
            let first = i / size * 32 * 32 * size + i % size * 32;
            (0..1024).map(|s| fine[first + s / 32 * 32 * size + s % 32]).sum::<f64>() / 1024.0
        };
        let truth: Vec<f64> = (0..size * size).map(mean).collect();
        let all = truth.iter().sum::<f64>();
        let error = |antialiasing| {
            let seen = direct(size as u32, antialiasing);
            let squares: f64 = seen.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum();
            [(squares * seen.len() as f64).sqrt() / all, seen.iter().sum::<f64>() / all - 1.0]
        };
        let ([off, bias_off], [four, bias]) = (error(Antialiasing::Off), error(Antialiasing::Four));
        println!(
            "{height}: RMSE over the mean {four:.3}, bias {bias:+.3}; with pixels' centres alone {off:.3}, {bias_off:+.3}"
        );
        assert!(four < 0.5 * off && bias.abs() < 0.2, "{height}: {four}, {bias}");
    }
}
